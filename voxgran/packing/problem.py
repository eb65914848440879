"""Problem: the task of a packing method, with representations of the shapes that are computed on demand.

All lengths are in the normalized frame, whose unit is the median diameter of the grains: a scene in other units gives
the same numbers. Representations are cached up to a limit of memory; the oldest are removed first.
"""

import hashlib
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Booleans, Floats, Integers, as_count
from voxgran._base.config import to_mapping
from voxgran._base.errors import InputError, PackingWarning, warn
from voxgran._base.seeds import stream
from voxgran.contacts.assembly import NOT_STATED, Assembly, Density
from voxgran.contacts.inside import Occupied
from voxgran.contacts.verify import verify
from voxgran.containers.model import Container, within_periods
from voxgran.geometry.rotation import normalized
from voxgran.lattice.grid import Grid
from voxgran.packing.draw import DrawnGrains
from voxgran.packing.model import Packing
from voxgran.packing.start import Start, joined_ids, number_fixed, refuse_start
from voxgran.points.control import sample_controls
from voxgran.points.sample import SurfacePoints
from voxgran.shapes.model import Shape
from voxgran.voxels.occupy import occupy

#: depth up to which true shapes of a start overlap by rounding, in mean diameters
ROUND_OFF = 1e-10
#: parts of the container, by length and by volume, below which sizes are likely in another unit than the container
TINY, NOTHING = 1e-3, 1e-6
#: decimals up to which diameters, in median ones, are told apart
DECIMALS = 9
#: grains up to which all overlaps are counted for a warning, since depths of thousands of them take minutes, and how
#: many neighbors are checked of more grains
MOST_CHECKED, SAMPLED = 200, 30
#: random points drawn at a time, per point that is wanted
TRIES = 2
#: voxels in median diameters beyond which grains are so enlarged that this is why they find no room
COARSEST = 0.1


@dataclass(slots=True, eq=False)
class Cache:
    """Arrays by their keys, computed once; the oldest are removed beyond a limit of memory."""

    limit: int = 2**26  # bytes
    _kept: "OrderedDict[tuple[Any, ...], Any]" = field(default_factory=OrderedDict)
    _bytes: int = 0

    def keep(self, key: tuple[Any, ...], make: Callable[[], Any]) -> Any:
        """Return the array of a key, computed if needed."""
        if key in self._kept:
            self._kept.move_to_end(key)
            return self._kept[key]
        made = make()
        self._kept[key] = made
        self._bytes += made.nbytes
        while self._bytes > self.limit and len(self._kept) > 1:
            self._bytes -= self._kept.popitem(last=False)[1].nbytes
        return made


@dataclass(frozen=True, eq=False)
class Problem:
    """A packing task in the normalized frame."""

    shapes: tuple[Shape, ...]  # of unit equivalent diameter
    shape_id: Integers  # (n,) shape of each grain
    diameter: Floats  # (n,) equivalent diameters, in median diameters: the factors on the lengths of the shapes
    container: Container  # in median diameters
    parameters: Any  # of the method, with lengths in the user's unit
    seed: int
    unit_length: float  # the median diameter, in the user's unit
    original: tuple[Shape, ...]  # the shapes as the user gave them
    start: Start | None = None  # poses of the first grains, which are present from the beginning
    fixed: int = 0  # how many of these, the first ones, are fixed
    unit: str = "1"  # the user's unit of lengths
    density: Density = NOT_STATED  # of the shapes
    settling: Any = None  # how the grains settle after the method; None if they do not
    grain_id: Integers | None = None  # (n,) row of each grain in a list, -1 for one of no list; None without a list
    given: Container | None = None  # the container in the user's unit, where it is known
    orientation: Floats | None = None  # (n, 4) of each grain, those of a start among them, where they are asked for
    # what is requested; without both, grains are more than enough
    asked_count: int | None = None
    asked_fraction: float | None = None
    cache: Cache = field(default_factory=Cache)  # of representations
    # hashes of all representations computed so far, by their counter; a checkpoint holds these, so that none is counted
    # again when it is computed again
    made: dict[str, set[int]] = field(default_factory=lambda: {"voxelized_shapes": set(), "sampled_shapes": set()})

    @property
    def count(self) -> int:
        """Number of grains."""
        return len(self.shape_id)

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return self.container.dimension

    @property
    def target(self) -> bool:
        """Whether a count or a solid fraction is requested."""
        return self.asked_count is not None or self.asked_fraction is not None

    @property
    def started(self) -> int:
        """Number of grains of the start; they are the first ones."""
        return 0 if self.start is None else self.start.count

    @cached_property
    def apart(self) -> "Problem":
        """The task without fixed grains, whose container they are a part of; itself where there are none."""
        k, start = self.fixed, self.start
        if start is None or not k:
            return self
        free = Start(start.position[k:], start.orientation[k:]) if start.count > k else None
        reach = float(self.diameter[k:].max(initial=1.0))
        standing = self.start_assembly(Start(start.position[:k], start.orientation[:k]))
        rows = None if self.grain_id is None else self.grain_id[k:]
        turns = None if self.orientation is None else self.orientation[k:]
        return replace(
            self, shape_id=self.shape_id[k:], diameter=self.diameter[k:], grain_id=rows, orientation=turns, start=free,
            fixed=0, container=Occupied(self.container, standing, reach),
        )  # fmt: skip

    def beside_fixed(self, packing: Packing) -> Packing:
        """Return a packing of the task without fixed grains with these before its own ones, in the container."""
        k, start = self.fixed, self.start
        if start is None or not k:
            return packing
        own = self.packing(
            np.arange(k), position=start.position[:k], orientation=start.orientation[:k], stop_reason="count"
        )
        both: dict[str, Any] = {
            name: np.concatenate([getattr(own, name), getattr(packing, name)])
            for name in ("shape_id", "scale", "position", "orientation")
        }
        return replace(
            packing, container=own.container, fixed=np.arange(k + packing.count) < k, **both,
            grain_id=joined_ids((own.grain_id, k), (packing.grain_id, packing.count)),
        )  # fmt: skip

    @property
    def volumes(self) -> Floats:
        """True volumes of the grains, (n,)."""
        shapes = np.array([shape.volume for shape in self.shapes])
        return shapes[self.shape_id] * libm.power(self.diameter, self.dimension)

    @property
    def bounding_radii(self) -> Floats:
        """Radii of the bounding spheres of the grains about their centroids, (n,)."""
        return np.asarray(np.array([shape.bounding_radius for shape in self.shapes])[self.shape_id] * self.diameter)

    @property
    def unit_volumes(self) -> Floats:
        """Volumes of the grains at the size at which their bounding spheres have radius 1, (n,)."""
        bounding = np.array([shape.bounding_radius for shape in self.shapes])
        volumes = np.array([shape.volume for shape in self.shapes]) / libm.power(bounding, self.dimension)
        return np.asarray(volumes[self.shape_id])

    def largest_first(self, grains: NDArray[Any]) -> NDArray[Any]:
        """Return grains, the largest first; those that differ by rounding only, as of several shapes, stay in order."""
        return grains[np.argsort(-np.round(self.diameter[grains], DECIMALS), kind="stable")]

    @property
    def counters(self) -> dict[str, int]:
        """Numbers of different solids that were voxelized and sampled."""
        return {name: len(keys) for name, keys in self.made.items()}

    def length(self, value: float) -> float:
        """Return a length, given in the user's unit, in median diameters."""
        return value / self.unit_length

    def start_assembly(self, start: Start) -> Assembly:
        """Return the grains of a start with their true shapes, in the normalized frame."""
        n = start.count
        return Assembly.of(
            self.shapes, self.container, position=start.position, scale=self.diameter[:n], shape_id=self.shape_id[:n],
            orientation=start.orientation,
        )  # fmt: skip

    def packing(
        self,
        placed: Integers,
        *,
        position: Floats,
        stop_reason: str,
        orientation: Floats | None = None,
        provenance: Mapping[str, Any] | None = None,
        gravity: "ArrayLike | None" = None,
        contact_gap: float = 0.0,
        voxel_size: float | None = None,
        diameter: Floats | None = None,
    ) -> Packing:
        """Return the packing of the grains with indices `placed`, (m,), in the user's unit of lengths.

        Positions (m, 3), the contact gap and the voxel size of methods on a lattice are in median diameters, and so are
        diameters (m,) that differ from the drawn ones; grains without orientation (m, 4) are not rotated. The
        parameters are added to the provenance. An empty stop reason becomes ``"interrupted"``; a zero gravity is none.
        """
        shape_id, unit = self.shape_id[placed], self.unit_length
        own = np.array([shape.diameter for shape in self.original])
        told, resolved = dict(provenance or {}), to_mapping(self.parameters)
        if voxel_size is not None:
            resolved["voxel_size"] = voxel_size * unit
        resolved.update(told.get("parameters", {}))
        # the container as it was given, which rounding changes on the way to median diameters and back
        known = self.given is not None and self.given.scaled(1.0 / unit) == self.container
        return Packing.of(
            self.original,
            self.given if known and self.given is not None else self.container.scaled(unit),
            position=position if unit == 1.0 else position * unit,
            scale=(self.diameter[placed] if diameter is None else diameter) * unit / own[shape_id],
            shape_id=shape_id,
            orientation=orientation,
            density=self.density,
            provenance={**told, "parameters": resolved},
            stop_reason=stop_reason or "interrupted",
            unit=self.unit,
            gravity=gravity if gravity is not None and np.any(gravity) else None,
            contact_gap=contact_gap * unit,
            grain_id=None if self.grain_id is None else self.grain_id[placed],
            fixed=placed < self.fixed if self.fixed else None,
        )

    def voxels(self, grain: int, orientation: Floats, voxel_size: float, *, cover: str) -> Booleans:
        """Return the voxels of a grain on a cubic lattice with a voxel corner at its centroid, the middle of the array.

        Parameters
        ----------
        grain : int
            Index of the grain.
        orientation : (4,) ndarray of float
            Unit quaternion (w, x, y, z).
        voxel_size : float
            Edge of a voxel, in median diameters.
        cover : {"touch", "center"}
            Rule by which voxels are occupied.

        Returns
        -------
        (2 k, 2 k, 2 k) ndarray of bool
            In 2D (2 k, 2 k, 1).

        Raises
        ------
        InputError
            If `cover` is ``"center"`` and the grain contains no center of a voxel.
        """
        shape, diameter = self.shapes[self.shape_id[grain]], float(self.diameter[grain])
        if shape.is_sphere:
            orientation = np.array([1.0, 0.0, 0.0, 0.0])
        key = ("voxels", self.shape_id[grain], diameter, orientation.tobytes(), voxel_size, cover)

        def make() -> Booleans:
            half = int(np.ceil(shape.bounding_radius * diameter / voxel_size)) + 1
            tall = 2 * half if self.dimension == 3 else 1
            low = -half * voxel_size
            grid = Grid((low, low, low if tall > 1 else 0.0), voxel_size, (2 * half, 2 * half, tall))
            self._count("voxelized_shapes", key)
            mask = occupy(shape, grid, scale=diameter, rotation=orientation, cover=cover)
            if not mask.any():
                raise InputError(
                    f"voxel_size is {voxel_size * self.unit_length:.6g}: in some orientation a grain of diameter "
                    f"{diameter * self.unit_length:.6g} holds no center of a voxel and would take no room; use smaller "
                    "voxels, or cover 'touch'"
                )
            return mask

        return self.cache.keep(key, make)

    def points(self, shape: int, spacing: float) -> SurfacePoints:
        """Return control points on a shape of unit diameter, every surface point within spacing / 2 of one."""
        key = ("points", shape, spacing)

        def make() -> SurfacePoints:
            self._count("sampled_shapes", key)
            return sample_controls(self.shapes[shape], spacing=spacing, seed=self.seed)

        return self.cache.keep(key, make)

    def _count(self, name: str, key: tuple[Any, ...]) -> None:
        """Count a representation once."""
        digest = hashlib.blake2b(repr(key).encode(), digest_size=8).digest()
        self.made[name].add(int.from_bytes(digest, "little"))


def normalized_problem(
    shapes: tuple[Shape, ...],
    container: Container,
    grains: DrawnGrains,
    settings: Any,
    *,
    seed: int,
    start: Packing | None,
    **asked: Any,
) -> Problem:
    """Return the task with shapes, grains and container in the frame whose unit is the median diameter.

    What else is asked for are fields of the task that do not depend on that unit.
    """
    fixed = number_fixed(start)
    sizes = grains.diameter[fixed:] if len(grains.diameter) > fixed else grains.diameter
    unit = float(np.median(sizes)) if len(sizes) else shapes[0].diameter
    return Problem(
        shapes=tuple(shape.scaled(1 / shape.diameter) for shape in shapes),
        shape_id=grains.shape_id,
        diameter=grains.diameter / unit,
        container=container.scaled(1 / unit),
        parameters=settings,
        seed=as_count(seed, "seed", at_most=None),
        unit_length=unit,
        original=shapes,
        start=None if start is None else Start(start.position / unit, start.orientation),
        fixed=fixed,
        grain_id=grains.grain_id,
        **asked,
        given=container,
    )


def stands_free(problem: Problem, start: Start) -> bool:
    """Return whether the true shapes of a start overlap neither each other nor a wall."""
    return verify(problem.start_assembly(start), tolerance=ROUND_OFF).ok


def warn_of_units(problem: Problem) -> None:
    """Warn if the drawn grains are so small and so few that sizes and container are likely in different units."""
    if problem.start is not None or not problem.count:
        return
    bounds = problem.container.bounds
    edge = float((bounds[1] - bounds[0])[: problem.dimension].min())
    largest, share = float(problem.diameter.max()), float(problem.volumes.sum()) / problem.container.volume
    if largest <= TINY * edge and share < NOTHING:
        unit = "" if problem.unit == "1" else f" {problem.unit}"
        warn(
            f"all {problem.count} grains, of diameters up to {largest * problem.unit_length:g}{unit}, fill "
            f"{share:.1g} of a container that is {edge * problem.unit_length:g}{unit} wide: if that is a mistake of "
            "units, give sizes and container in the same one",
            PackingWarning,
        )


def spheres_of_start(problem: Problem) -> Floats:
    """Return centers, from the lower corner of the container, and radii of the bounding spheres of a start, (m, 4).

    Raises
    ------
    InputError
        If the true shape of a grain overlaps that of another or reaches beyond a wall.
    """
    if problem.start is None:
        return np.zeros((0, 4))
    grains = problem.start_assembly(problem.start)
    proof = verify(grains)
    if not proof.ok:
        wrong = [item.grain for item in proof.escapes] or [max(pair.i, pair.j) for pair in proof.pairs]
        refuse_start(problem.start, wrong[0], problem.container)
    place = problem.start.wrapped(problem.container) - problem.container.bounds[0]
    return np.column_stack([place, grains.bounding_radii])


def packing_of_spheres(
    problem: Problem, grains: Integers, spheres: Floats, stop_reason: str, *, sized: bool = False, **told: Any
) -> Packing:
    """Return the packing of grains, (m,), by their bounding spheres, (m, 4): centers from the lower corner, and radii.

    The radii are the sizes of grains that are `sized` by the method, but for those of a start. Orientations are random.
    """
    diameter = orientation = None
    if sized:
        bounding = np.array([shape.bounding_radius for shape in problem.shapes])[problem.shape_id[grains]]
        diameter = np.where(grains < problem.started, problem.diameter[grains], spheres[:, 3] / bounding)
    if problem.started or not all(shape.is_sphere for shape in problem.shapes):
        orientation = turns_of(problem, problem.count, stream(problem.seed, "turns"))[grains]
    return problem.packing(
        grains, position=spheres[:, :3] + problem.container.bounds[0], orientation=orientation, diameter=diameter,
        stop_reason=stop_reason, **told,
    )  # fmt: skip


def random_points(container: Container, count: int, generator: np.random.Generator) -> Floats:
    """Return random points (count, 3) in a container."""
    lower, upper = container.bounds
    found, many = [np.zeros((0, 3))], 0
    while many < count:
        points = lower + generator.random((TRIES * count + 8, 3)) * (upper - lower)
        inside = points[np.asarray(container.signed_distance(points)) < 0.0]
        found.append(inside)
        many += len(inside)
    return within_periods(np.concatenate(found)[:count], container)


def turns_of(problem: Problem, count: int, generator: np.random.Generator) -> Floats:
    """Return the orientations of the first grains, (count, 4): those asked for, or those of the start and random ones.

    Random numbers are drawn in both cases, so that what is drawn after them is the same.
    """
    turns = generator.normal(size=(count, 4))
    if problem.orientation is not None:
        return problem.orientation[:count].copy()
    if problem.dimension == 2:
        turns[:, 1:3] = 0.0
    turns = normalized(turns)
    if problem.start is not None:
        turns[: problem.started] = problem.start.orientation
    return turns


def too_coarse(problem: Problem) -> str:
    """Return that voxels are too coarse, and how coarse they may be; empty where they are not."""
    settings, coarsest = problem.parameters, COARSEST * problem.unit_length
    voxel = getattr(settings, "voxel_size", None)
    if voxel is None or voxel <= coarsest or settings.cover != "touch":
        return ""
    return f"a grain takes all voxels that it touches, and voxel_size is {voxel:.4g}; make it at most {coarsest:.4g}"


def warn_of_overlaps(problem: Problem, packing: Packing) -> None:
    """Warn of grains that overlap because voxels or control points represent them, unless they have settled since."""
    settings = problem.parameters
    if getattr(settings, "cover", "touch") == "center":
        why = "a grain takes only voxels whose centers lie in it: take cover='touch'"
    elif getattr(settings, "overlap", None) == 0.0:
        why = "surfaces may cross between control points: take a smaller spacing"
    else:
        return
    checked, of = packing, ""
    if problem.settling is not None or not packing.count:
        return
    if packing.count > MOST_CHECKED:
        near = np.argsort(linear.norm(packing.position - packing.position[0], axis=1), kind="stable")[:SAMPLED]
        checked, of = packing[near], f" in a sample of {SAMPLED} of {packing.count} grains, others perhaps by more"
    proof = verify(checked)
    if proof.overlapping_pairs:
        warn(
            f"{proof.overlapping_pairs} pairs of grains overlap by up to {proof.deepest:.2g} mean diameters{of}, since "
            f"{why}, or let the grains settle",
            PackingWarning,
        )
