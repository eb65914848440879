"""Plan: what a run would compute, skip and cost, before anything is computed."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from voxgran._base import ExplainedAttributes
from voxgran._base.arithmetic import libm
from voxgran._base.config import to_mapping
from voxgran._base.errors import InputError
from voxgran._base.scalars import cube_root
from voxgran.containers.model import boundary_of
from voxgran.packing.beds.expected import ExpectedBed, expected_bed
from voxgran.packing.draw import Request
from voxgran.packing.method import check_memory, long_run, packing_memory
from voxgran.packing.missed import Task
from voxgran.packing.pack import prepare_task
from voxgran.packing.problem import too_coarse
from voxgran.scene.description import SceneDescription
from voxgran.scene.duration import expected_seconds, grains_of, steps_of
from voxgran.scene.entries import REMEDIES, ShapeEntry
from voxgran.settling.material import Material
from voxgran.settling.materials import Materials, friction_text
from voxgran.settling.parameters import Compression, Settling, with_friction
from voxgran.settling.search import MOST_TRIES
from voxgran.shapes.family import families
from voxgran.shapes.formats.mesh_files import read_surface
from voxgran.shapes.formats.sphere_files import SUFFIXES
from voxgran.shapes.mesh import Mesh, Surface
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.repairing.diagnose import merged, refuse_open
from voxgran.shapes.size_laws.plan import MOST_PLANNED, SizePlan, plan_sizes
from voxgran.shapes.spheres import MassProperties, Spheres

#: folder of the input of engines
DECKS = "dem"
#: spheres that a clump of which none are asked for has, without and with a target
SPHERES, FOR_A_TARGET = 50, 200
#: solid fraction from which on grains hardly find room
DENSE = 0.75
#: bytes with the libraries that check, measure and save, when the method's own arrays are gone (measured)
FINISHING_BYTES = 245 * 2**20
#: and what the libraries that draw take beside them (measured)
DRAWING_BYTES = 580 * 2**20


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan(ExplainedAttributes):
    """What a run of a scene would do.

    Attributes
    ----------
    grains : int
        Grains that are asked for or, without a number, that are drawn or expected to have room.
    solid_fraction : float
        Their volume over that of the container.
    memory : int
        Bytes at the peak, estimated.
    attempts : int
        Attempts at the most.
    voxelized_shapes, sampled_shapes : int
        Solids that are turned into voxels and into points.
    computed, skipped : tuple of str
        Steps, each with its reason.
    libraries : tuple of str
        Libraries that will be loaded.
    makes_sizes : bool
        Whether the method makes the sizes; there are then at most so many grains, of a volume that is not known.
    expected : bool
        Whether no number of grains is asked for, and the method takes as many as it expects to have room.
    amount_asked : bool
        Whether the scene has a count or a solid fraction.
    depth : float or None
        Expected depth of the bed, in median diameters; None where grains form none.
    bulk_grains : int or None
        Expected number of grains in its bulk.
    notes : tuple of str
        What in the scene may be meant otherwise, in sentences.
    seconds : float
        CPU time that packing, settling and compressing are expected to take on this machine, by runs that were
        measured, of all seeds; 0 where none of that method were.
    seconds_range : tuple of float
        Range in which it lies with a probability of 0.95, if the scene is like those that were measured.
    slow : str
        Why the packing takes long, in a sentence; empty where it does not.
    sizes : SizePlan or None
        How nearly the grains can follow the distribution of sizes; None without one.
    """

    grains: int
    solid_fraction: float
    memory: int
    attempts: int
    voxelized_shapes: int
    sampled_shapes: int
    computed: tuple[str, ...]
    skipped: tuple[str, ...]
    libraries: tuple[str, ...]
    makes_sizes: bool = False
    expected: bool = False
    amount_asked: bool = True
    depth: float | None = None
    bulk_grains: int | None = None
    notes: tuple[str, ...] = ()
    seconds: float = field(default=0.0, compare=False)
    seconds_range: tuple[float, float] = field(default=(0.0, 0.0), compare=False)
    slow: str = ""
    sizes: SizePlan | None = None

    def __str__(self) -> str:
        """Return the plan as a person reads it."""
        grains = f"{self.grains} drawn; if all find room: {self.solid_fraction:.3f} of the container"
        if self.expected:
            grains = f"{self.grains}, as many as are expected to have room: {self.solid_fraction:.3f} of the container"
        elif not self.amount_asked:
            grains = f"{self.grains} drawn, with the volume of the container: those that find room are packed"
        if self.makes_sizes:
            grains = f"at most {self.grains}, of sizes that the method makes"
        lines = [
            f"grains          {grains}",
            *(() if self.depth is None else (f"bed             {ExpectedBed(self.depth, self.bulk_grains or 0)}",)),
            f"memory          {self.memory / 2**20:.0f} MiB at the peak, estimated",
            *((f"time            {self.time}",) * bool(self.seconds)),
            f"attempts        {self.attempts:,} at the most",
            f"solids          {self.voxelized_shapes:,} turned into voxels, {self.sampled_shapes:,} into points",
            f"libraries       {', '.join(self.libraries)}",
            *(f"will be done    {step}" for step in self.computed),
            *(f"is skipped      {step}" for step in self.skipped),
            *(f"note            {note}" for note in (*self.notes, self.slow) if note),
            *(f"sizes           {line}" for line in (str(self.sizes).splitlines() if self.sizes else ())),
        ]
        return "\n".join(lines)

    @property
    def time(self) -> str:
        """How long packing takes, in words; empty where it is not known."""
        if not self.seconds:
            return ""
        least, most = self.seconds_range
        return f"{self.seconds:.2g} s of CPU time to pack; {least:.2g} to {most:.2g} s with a probability of 0.95"

    def to_mapping(self) -> dict[str, Any]:
        """Return the plan as JSON-able values."""
        made = to_mapping(self)
        made["sizes"] = None if self.sizes is None else asdict(self.sizes)
        made["memory_bytes"] = made.pop("memory")
        return made


def make_plan(scene: SceneDescription) -> Plan:
    """Return the plan of a scene.

    Raises
    ------
    InputError
        If the scene breaks a rule that shows only now, such as grains that cannot fit.
    DirtyMeshError
        If the mesh of a solid has open edges, or encloses nothing; nothing else of it is looked at.
    TooLargeError
        If it does not fit in memory.
    """
    task = task_of(scene, stand_ins(scene))
    cost, bed, free = task.method.cost(task.problem), expected_bed(task.problem), task.problem.apart
    finishing = FINISHING_BYTES + (DRAWING_BYTES if scene.output.report else 0)
    memory = max(packing_memory(cost), finishing)
    check_memory(task.method, memory, "the scene")
    many = grains_of(task, cost)
    seconds, least, most = (scene.general.seeds * one for one in expected_seconds(steps_of(scene, task, cost)))
    return Plan(
        grains=many,
        expected=many < free.count,
        solid_fraction=float(free.volumes[:many].sum() / free.container.volume),
        memory=memory,
        attempts=cost.attempts,
        voxelized_shapes=cost.voxelized_shapes,
        sampled_shapes=cost.sampled_shapes,
        **_steps(scene, task, many),
        makes_sizes=task.method.sizing == "made",
        amount_asked=_amount_asked(scene),
        depth=None if bed is None else bed.depth,
        bulk_grains=None if bed is None else bed.bulk,
        notes=_notes(scene, task, bed),
        seconds=seconds,
        seconds_range=(least, most),
        slow=long_run(task.method, task.problem, cost.seconds),
        sizes=_size_plan(scene, task),
    )


def _size_plan(scene: SceneDescription, task: Task) -> SizePlan | None:
    """Return how nearly the grains can follow the distribution of sizes; None without one, and of too many grains."""
    if task.sizes is None or task.method.sizing == "made" or not 0 < task.problem.count <= MOST_PLANNED:
        return None
    found = plan_sizes(task.sizes, task.problem.count, dimension=task.problem.dimension, seed=task.problem.seed)
    # other numbers of grains than those of a list are not asked for
    return found if scene.grains is None and scene.twin is None else replace(found, counts={}, fines=())


def _amount_asked(scene: SceneDescription) -> bool:
    """Return whether a scene says how many grains there are."""
    return any(asked is not None for asked in (scene.count, scene.solid_fraction, scene.grains))


def task_of(scene: SceneDescription, shapes: tuple[Shape, ...]) -> Task:
    """Return the packing task of a scene with its shapes made.

    Raises
    ------
    InputError
        If a value breaks a rule.
    """
    if scene.twin is not None:
        return prepare_task(scene.twin.request.stand_in(scene.general.seed))
    return prepare_task(Request(shapes, scene.container, **scene.asked(), parameters=dict(scene.parameters)))


def stand_ins(scene: SceneDescription) -> tuple[Shape, ...]:
    """Return shapes that cost as much as those that are packed."""
    return tuple(shape for entry in scene.shapes for shape in _stand_ins(entry))


def _stand_ins(entry: ShapeEntry) -> list[Shape]:
    """Return shapes that cost as much as those of an entry."""
    solid = _solid(entry)
    if entry.roughness is not None and solid.dimension == 3 and not solid.is_open:
        # a rough solid is triangles, whatever it was
        solid = Shape.of(Mesh(solid.vertices.copy(), solid.faces.copy()), name=solid.name, unit=solid.unit)
    first = _stand_in(entry, solid)
    # shapes that differ, if only by rounding, are different work for methods that keep one result per shape
    return [first, *(first.scaled(1.0 + 1e-9 * k) for k in range(1, len(entry.shares())))]


def _stand_in(entry: ShapeEntry, solid: Shape) -> Shape:
    """Return a shape that costs as much as the one that is packed; for a clump, spheres in the bounds of its solid.

    Raises
    ------
    InputError
        If the solid of a clump is flat.
    """
    if entry.clump is None or isinstance(solid.geometry, Spheres) or solid.is_sphere:
        return solid
    if solid.dimension == 2:
        raise InputError(f"[[shape]] {entry.name} is flat and has a clump: clumps are solids; leave out clump")
    solid.refuse_open("clumps of spheres")
    count = _spheres_of(entry.clump)
    half = np.abs(solid.bounds).max(axis=0)
    k = np.arange(count) + 0.5
    z, turn = 1 - 2 * k / count, k * (math.pi * (3 - math.sqrt(5)))
    flat = np.sqrt(1 - z * z)
    directions = np.column_stack([flat * libm.cos(turn), flat * libm.sin(turn), z])
    mass = MassProperties(solid.volume, np.zeros(3), solid.inertia)
    spheres = Spheres(0.6 * half * directions, np.full(count, 0.4 * float(half.min())), mass)
    return Shape.of(spheres, name=solid.name, unit=solid.unit)


def _spheres_of(clump: Mapping[str, Any]) -> int:
    """Return how many spheres a clump may have."""
    return int(clump.get("max_spheres", FOR_A_TARGET if "target" in clump else SPHERES))


def _solid(entry: ShapeEntry) -> Shape:
    """Return a shape that costs as much as the real one: meshes checked for holes, random solids as an ellipsoid."""
    if entry.source == "file" and Path(entry.name).suffix.lower() in SUFFIXES:
        return entry.make()[0]
    if entry.source == "file":
        points, faces = read_surface(entry.name)
        # the name by which lists of grains call it
        name = Path(entry.name.removesuffix(".gz")).stem
        known: dict[str, Any] = {"name": name, "unit": entry.parameters.get("unit")}
        if entry.parameters.get("surface"):
            return Shape.of(Surface(points, faces), **known)
        if not entry.parameters.get("repair"):
            points, faces = merged(points, faces)
            refuse_open(points, faces, Path(entry.name).name, remedies=REMEDIES)
        mesh = Mesh(points, faces)
        # what is wound in any way may enclose nothing until it is mended
        return Shape.of(mesh, **known) if mesh.volume > 0 else entry.make()[0]
    family = families().get(entry.name)
    if family.random and not family.is_open:
        axes = np.array([1.5, 1.0, 0.8]) / 2
        axes /= cube_root(float(np.prod(2 * axes)))
        return Shape.of(Primitive("ellipsoid", tuple(axes.tolist())), name=entry.name)
    return entry.make()[0]


def _settling_of(task: Task) -> Settling | None:
    """Return how the grains settle, after the method or as its own work; None if they do not."""
    parameters = task.problem.parameters
    return with_friction(parameters) if isinstance(parameters, Settling) else task.problem.settling


def _notes(scene: SceneDescription, task: Task, bed: ExpectedBed | None) -> tuple[str, ...]:
    """Return what in a scene may be meant otherwise, in sentences."""
    shallow = "" if bed is None else bed.note
    found = _full(scene, task), too_coarse(task.problem), _two_frictions(scene, task), shallow
    return tuple(note for note in found if note)


def _full(scene: SceneDescription, task: Task) -> str:
    """Return that grains hardly find room; empty where they do, or no amount is asked for."""
    share = float(task.problem.volumes.sum() / task.problem.container.volume)
    if not _amount_asked(scene) or task.method.sizing == "made" or share <= DENSE:
        return ""
    return (
        f"{share:.3f} of the container is more than most grains fill (spheres of one size at random 0.64): those that "
        "find room are packed; ask for less, or give a larger container"
    )


def _two_frictions(scene: SceneDescription, task: Task) -> str:
    """Return that frictions of settling and of input for engines differ; empty where they do not."""
    settling, material = _settling_of(task), scene.material
    if isinstance(material, Materials) or settling is None or isinstance(settling.friction, Materials):
        return ""
    used = bool(scene.output.dem) or material != Material()
    # a solid fraction that is asked for is reached by frictions that are not known yet
    if not used or settling.solid_fraction is not None or settling.friction == material.friction:
        return ""
    section = "[packing]" if isinstance(task.problem.parameters, Settling) else "[settle]"
    return (
        f"friction of settling is {settling.friction:g}, by {section}; that of [material], {material.friction:g}, goes "
        f"into input for engines only: give {section} friction = {material.friction:g} if the grains have it"
    )


def _compression_step(scene: SceneDescription, task: Task) -> list[str]:
    """Return how grains are compressed; nothing where they are not."""
    own = task.problem.parameters
    compression = own if isinstance(own, Compression) else scene.compress
    if compression is None:
        return []
    known = with_friction(compression).friction
    how = "" if known is None else f"with friction {friction_text(known)}"
    target = compression.solid_fraction or compression.height
    if target is not None:
        kind = f"solid fraction of the {compression.region}" if compression.height is None else "height"
        how = f"to a {kind} of {target:g}, by friction in at most {MOST_TRIES} tries"
    return [f"compress them along {compression.axes} {how}"]


def _steps(scene: SceneDescription, task: Task, many: int) -> dict[str, tuple[str, ...]]:
    """Return what is done, what is skipped and why, and the libraries that this takes."""
    clumps = [entry.clump for entry in scene.shapes if entry.clump is not None for _ in entry.shares()]
    most = max(map(_spheres_of, clumps), default=0)
    rough = sum(len(entry.shares()) for entry in scene.shapes if entry.roughness is not None)
    limits = [entry.faces for entry in scene.shapes if entry.faces is not None for _ in entry.shares()]
    computed = [f"reduce {len(limits)} of the shapes to at most {max(limits)} triangles"] if limits else []
    computed += [f"give {rough} of the shapes a rough skin"] if rough else []
    computed += [f"fit clumps of up to {most} spheres to {len(clumps)} of the shapes"] if clumps else []
    if scene.twin is not None:
        computed.append(f"learn the shapes of {len(scene.twin.request.sample.shapes)} grains of the sample")
    bound = "at most " if task.method.sizing == "made" else ""
    computed += [f"pack {bound}{many} grains by {scene.method}"]
    if (settling := _settling_of(task)) is not None:
        share, shapes = (
            f"until at least {settling.rest:.1%} of them rest",
            "" if settling.parts == "exact" else ", by hulls",
        )
        known, target = settling.friction, settling.solid_fraction
        how = "by friction and shaking" if known is None else f"with friction {friction_text(known)}"
        if target is not None:
            more = "" if known is None else ", by shaking"
            how = f"at a solid fraction of {target:g}, {how}{more} in at most {MOST_TRIES} tries"
        computed.append(f"settle them {how}{shapes}, {share}")
    computed += _compression_step(scene, task)
    computed.append("verify against the true shapes")
    if scene.general.seeds > 1:
        computed.append(f"all of it {scene.general.seeds} times, with {scene.general.seeds} seeds")
    computed.append("measure " + (", ".join(scene.which) if scene.which else "the usual measures"))
    skipped = []
    libraries = {"scipy", "xarray", "vtkmodules", *task.method.libraries}
    drawing = ("matplotlib", "jinja2", "pyvista", *(("plotly",) if scene.output.interactive else ()))
    for wanted, step, needs in (
        (scene.output.vtk, "write surfaces, container and contacts for ParaView", ()),
        (scene.output.statistics, "write statistics.nc", ("netCDF4",)),
        (scene.output.report, "draw pictures and write report.html", drawing),
    ):
        if wanted:
            computed.append(step)
            libraries.update(needs)
        else:
            skipped.append(f"{step}: not asked for in [output]")
    if scene.output.dem:
        computed.append(f"write input for {', '.join(scene.output.dem)} into {DECKS}/")
    for entry in scene.shapes:
        if entry.source == "family":
            libraries.update(families().get(entry.name).libraries)
    # polygons as containers are cut into triangles by this library, too
    polygon = bool(boundary_of(task.problem.container).loops)
    if polygon or any(isinstance(shape.geometry, Mesh) for shape in task.problem.shapes):
        libraries.add("manifold3d")
    if task.problem.dimension == 2:
        skipped.append("anything in three dimensions: the container is flat")
    if scene.settle is False:
        skipped.append("settling: [settle] says enabled = false")
    if task.sizes is None and task.method.sizing != "made":
        skipped.append("drawing sizes: each shape keeps its own")
    return {"computed": tuple(computed), "skipped": tuple(skipped), "libraries": tuple(sorted(libraries))}
