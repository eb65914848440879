"""`pack`: from shapes and a container to a packing, by any registered method."""

import inspect
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import wraps
from typing import Any, ParamSpec

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arrays import as_number, check_lengths
from voxgran._base.calls import explained
from voxgran._base.config import parameters_of, to_mapping
from voxgran._base.errors import InputError, PackingWarning, shown, warn
from voxgran._base.machine import installed_versions
from voxgran._base.progress import OnStep
from voxgran._base.registry import Parameters
from voxgran._base.scalars import number_of, whole_number_of
from voxgran._base.units import NO_UNIT
from voxgran.containers.model import Container, check_container, doubt_about
from voxgran.containers.one_unit import in_one_unit
from voxgran.geometry.orientation_laws.law import OrientationLaw
from voxgran.packing.beds.expected import tell_of_bed, warn_of_height
from voxgran.packing.compress import warn_of_imbalance
from voxgran.packing.draw import Request, draw_grains, joined, listed_grains, scaled_to
from voxgran.packing.driver import Drive, Recorder, check_drive, drive
from voxgran.packing.method import (
    PackingMethod,
    RunState,
    check_cost,
    method_registry,
    refuse_begun,
    refuse_list,
    refuse_unfit,
)
from voxgran.packing.missed import Task, ended_by_solid_fraction, misses, warn_of_misses
from voxgran.packing.model import Packing, check_packing
from voxgran.packing.obstacles import around_obstacles, start_with, unit_of, with_density_of
from voxgran.packing.problem import normalized_problem, warn_of_overlaps, warn_of_units
from voxgran.packing.settle import settling_after, warn_of_unrest, with_grain_as_container, with_target
from voxgran.packing.settling_run import with_settling
from voxgran.packing.start import asked_orientations, check_start, density_around, number_fixed, told_of, turns_asked
from voxgran.settling.parameters import Settling, as_solid_fraction
from voxgran.shapes.model import Shape, check_shapes
from voxgran.shapes.size_laws.listed import ListedGrains, with_shapes_of_list
from voxgran.shapes.sizes import SizeDistribution

P = ParamSpec("P")


def _without_shapes(function: Callable[P, Packing]) -> Callable[P, Packing]:
    """Let calls with a list of grains or a start leave out the shapes (decorator)."""

    @wraps(function)
    def call(*arguments: P.args, **keywords: P.kwargs) -> Packing:
        if not arguments and ("grains" in keywords or "start" in keywords):
            keywords.setdefault("shapes", ())
        return function(*arguments, **keywords)

    return call


@_without_shapes
@explained(hint='pack(shapes, Box((4, 4, 4)), method="gravity", count=20)')
def pack(
    shapes: Sequence[Shape] | Shape,
    container: Container,
    method: str | Parameters,
    *,
    count: int | None = None,
    solid_fraction: float | None = None,
    porosity: float | None = None,
    void_ratio: float | None = None,
    sizes: SizeDistribution | None = None,
    grains: Any = None,
    weights: "ArrayLike | None" = None,
    weights_by: str = "number",
    seed: int = 0,
    start: Packing | None = None,
    obstacles: Packing | None = None,
    unit: str | None = None,
    density: float | Sequence[float] | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    resume: bool = False,
    time_limit: float | None = None,
    threads: int | None = None,
    on_step: OnStep | None = None,
    recorder: Recorder | None = None,
    settle: bool | Mapping[str, Any] | Settling | None = None,
    orientations: "OrientationLaw | ArrayLike | None" = None,
    **parameters: Any,
) -> Packing:
    """Pack grains into a container.

    Parameters
    ----------
    shapes : sequence of Shape or Shape
        Shapes to draw the grains from. They may be left out with a list of `grains`, which then names families or is of
        spheres, disks in the plane, and with a start, whose shapes they then have.
    container : Container
        What holds the grains.
    method : str or parameter object
        Name of a packing method, one of :func:`packing_methods`, or its parameters, such as
        ``vg.methods.Digital(voxel_size=0.1)``.
    count : int, optional
        How many grains.
    solid_fraction : float, optional
        Wanted solid fraction. With a count too, the packing ends with whichever comes first; with neither, grains are
        added until the method stops. Where neither target is reached, a warning says so and the provenance holds
        under ``missed`` what is missing to each of them, and by how much the gradation differs. Of the method
        ``"gravity"`` it is that of the bed at rest, as in :func:`settle`, and says nothing of the number of grains.
    porosity, void_ratio : float, optional
        In place of the solid fraction: 1 minus it, or the volume of the voids over that of the grains.
    sizes : SizeDistribution, optional
        Distribution of the equivalent diameters, in the unit of the container; each shape at its own size where
        left out.
    grains : sequence of Shape, mapping, pandas.DataFrame or path-like, optional
        List of grains, each placed once, in place of `count` and `sizes`: shapes, without `shapes`, or a table or CSV
        file with the columns `diameter` or `mass` (left out: each shape at its own size), and `shape` (name or
        index in `shapes`; left out: taken in turn), `density` and `count`. ``packing.grain_id`` is the row of each
        grain.
    weights : (len(shapes),) array_like of float, optional
        Shares of the shapes; equal where left out.
    weights_by : {"number", "volume"}
        What the shares are of.
    seed : int
        The same seed gives the same bits on the same machine and versions.
    start : Packing, optional
        Grains that are there from the beginning, and may touch: at their places, on a lattice as near to them as voxels
        have room, at last raised (:mod:`voxgran.packing.start`). They come first in the result. `count` and
        `solid_fraction` are then those of further grains; with neither, there are none. Where `shapes` is empty they
        have those of the start. Sizes of the start stay, but for ``jam``, which multiplies all by one factor, and for
        ``expand`` without `shapes`, which makes the grains of the start meet the solid fraction. The height and the
        solid fraction of ``gravity`` are those of the whole bed. ``apollonian``, ``compress``, ``multilayer`` and
        ``voronoi_fill`` refuse a start. Fixed grains among them are obstacles, and come first.
    obstacles : Packing, optional
        Grains that stand in the container and never move, whatever the container and the density that they have: one
        shape, as of ``Packing.of(shape, container, position=[...])``, or a whole bed. They are the first grains of the
        result, ``packing.fixed`` marks them, and their volume is taken off that of the container. Methods: ``gravity``,
        ``digital``, ``digital_fill``, ``digital_rsa``, ``rsa``, ``expand``, ``jam``, ``compress`` and, around spheres,
        ``advancing_front`` and ``deposition``.
    unit : str, optional
        Unit of all lengths that have none of their own: container, sizes, parameters, regular shapes. Shapes of other
        units are converted to it. Left out: that of the start, or else the one of the shapes, where it is known.
    density : float or (len(shapes),) sequence of float, optional
        Density of the material: one number, or one for each shape (of `grains`, where these are shapes). Grains of the
        start keep theirs, unless that is 1, the value of a packing without one, and a single number is given. Default:
        that of the start, or else 1.
    checkpoint : path-like, optional
        File for checkpoints, written every ten seconds, when asked to stop, and at the end; some hundred bytes a grain.
    resume : bool
        Whether to go on from that file where it is there.
    time_limit : float, optional
        Seconds after which the run stops, though not before the first attempt, with a checkpoint; the stop reason is
        then ``interrupted``.
    threads : int, optional
        Number of threads, by default that of the processors or of ``OMP_NUM_THREADS``; the result is the same.
    on_step : callable, optional
        Told of each step; default: at a terminal and in a notebook, a line on the error stream every ten seconds,
        elsewhere a record of the logger ``voxgran`` of the level INFO.
    recorder : Recorder, optional
        Given the packing whenever a snapshot is due, such as a :class:`Series` for ParaView.
    settle : bool, mapping or Settling, optional
        Whether the grains settle afterwards, as by :func:`settle`, or its parameters, such as ``dict(friction=0.3)``;
        default: they do after methods that build beds under gravity, ``digital`` and ``control_point``, unless a shape
        is open, or grains are to keep a distance or to overlap.
    orientations : OrientationLaw or (n, 4) array_like of float, optional
        Distribution of the orientations, such as ``vg.orientations.watson("z", 4)``, or a unit quaternion for each
        grain; default: all are equally likely. Each grain keeps the one that is drawn for it, but for ``gravity``,
        ``expand``, ``jam``, ``control_point`` and settling, which begin with it. The measure ``fabric`` gives what is
        asked for beside what is placed. A whole number is the parameter of that name that some methods have.
    **parameters
        Parameters of the method, for a name.

    Returns
    -------
    Packing

    Raises
    ------
    CallError
        If an argument that must be given is missing.
    UnknownNameError
        If the method, a parameter or the unit is unknown.
    InputError
        If an argument is of another type, a value breaks a rule, shapes have several units and none is given, a length
        is not between 1e-60 and 1e60, the grains have more volume than the container, equal spheres are asked for a
        solid fraction beyond that of the densest lattice, the method packs no open surfaces, or a list of grains breaks
        a rule or is not for the method, or obstacles overlap, reach beyond a wall, leave no room, or are not for the
        method.
    GrainTooLargeError
        If no grain can fit, or one of a list cannot.
    TooLargeError
        If more than 100 million grains are asked for, or the packing does not fit in memory.
    CheckpointError
        If the checkpoint is damaged, belongs to another run, or is another file, which is not replaced.
    OutputError
        If the checkpoint cannot be written.
    InUseError
        If another process writes that checkpoint.
    Interrupted
        On SIGINT, SIGTERM or SIGHUP: after a checkpoint was written; before the first attempt, and on a second signal,
        at once.
        It is a KeyboardInterrupt, which ``except Exception`` lets pass.

    Warns
    -----
    PackingWarning
        If neither the count nor the solid fraction is reached, grains cannot fit, rows of a list find no room, the
        search takes minutes, a bed of a solid fraction that is asked for is expected to have no bulk, or the surface of
        a bed is more than a twentieth from the height that is asked for.

    Examples
    --------
    >>> import voxgran as vg
    >>> box = vg.Box((4, 4, 4))
    >>> vg.pack(vg.make_shape("sphere"), box, method="digital", count=20, voxel_size=0.1).count
    20
    """
    began = time.monotonic()
    solid_fraction = as_solid_fraction(solid_fraction, porosity, void_ratio)
    request = Request(
        *(shapes, container, method), count=count, solid_fraction=solid_fraction, sizes=sizes, grains=grains,
        weights=weights, weights_by=weights_by, seed=seed, start=start, obstacles=obstacles, unit=unit, density=density,
        settle=settle, orientations=orientations, parameters=parameters,
    )  # fmt: skip
    task = prepare_task(request)
    limit = None if time_limit is None else as_number(time_limit, "time_limit", at_least=0.0)
    check_drive(checkpoint, resume, on_step, recorder)
    check_cost(task.method, task.problem)
    tell_of_bed(task.problem, on_step)
    how = Drive(checkpoint, resume, on_step, time_limit=limit, recorder=recorder, threads=threads)
    state = drive(task.method, task.problem, how)
    packing = with_provenance(task, state, task.method.finish(task.problem, state), seconds=time.monotonic() - began)
    warn_of_misses(task, packing)
    warn_of_overlaps(task.problem, packing)
    warn_of_unrest(packing)
    warn_of_height(task, packing)
    warn_of_imbalance(packing)
    return packing


def prepare_task(request: Request) -> Task:
    """Check the arguments of :func:`pack`, draw the grains and put all into the normalized frame; nothing is packed.

    Raises
    ------
    UnknownNameError
        If the method, a parameter or the unit is unknown.
    InputError
        If a value breaks a rule.
    GrainTooLargeError
        If no grain can fit.
    TooLargeError
        If more than 100 million grains are asked for.
    """
    entry, given_settings, orientations = _chosen(request)
    settings, solid_fraction = with_target(given_settings, request.solid_fraction)
    sizes, start, count = request.sizes, request.start, request.count
    listed: ListedGrains | None = None
    shapes, table, density = with_shapes_of_list(request.shapes, request.grains, request.density)
    given = check_asked(shapes, request.container, sizes, start)
    given, container, unit = in_one_unit(given, request.container, unit_of(request))
    if start is not None:
        check_start(start, container.dimension)
        refuse_begun(entry, start)
        start = start if start.unit == NO_UNIT else start.to_unit(unit)
    refuse_unfit(entry, given if start is None else (*given, *start.shapes), container)
    begun = start
    if request.obstacles is not None:
        # grains with the shapes of the start have none of those of the obstacles
        given = given or (() if start is None else start.shapes)
        start = start_with(request.obstacles, start, container, unit)
    entry, start, room = around_obstacles(entry, start, container)
    if table is not None:
        refuse_list(entry, {"count": count, "sizes": sizes, "solid_fraction": solid_fraction})
        shapes = given or (() if begun is None else begun.shapes)
        found = replace(request, shapes=given, container=container, grains=table, density=density)
        given, listed, density = listed_grains(found, shapes, unit)
        count, sizes = len(listed.row), listed.sizes()
    density = with_density_of(request.obstacles, density_around(begun, density, len(given)))
    scaled = entry.sizing == "scaled"
    none_asked = begun is not None and count is None and (solid_fraction is None or (scaled and not given))
    none_asked = none_asked and getattr(settings, "height", None) is None
    drawn = replace(
        request, shapes=given or (() if begun is None else begun.shapes), container=room, grains=listed,
        count=0 if none_asked else count, solid_fraction=solid_fraction,
    )  # fmt: skip
    own_shapes = getattr(settings, "own_shapes", False)
    grains = draw_grains(
        drawn, surplus=entry.selects, stretches=entry.stretches, sizing=entry.sizing, own_shapes=own_shapes
    )
    asked = _asked(request, count, solid_fraction, listed, orientations)
    if start is not None:
        asked["start"] = told_of(start)
        grains = joined(start, grains, earlier=len(start.shapes) if given else 0)
        given = (*start.shapes, *given)
    if scaled and solid_fraction is not None:
        # grains of a start keep their sizes, unless there are no others
        kept = number_fixed(start) if none_asked or start is None else start.count
        given_many = len(grains.diameter) if count is not None or none_asked else kept
        grains = scaled_to(grains, given, room, solid_fraction, given=given_many, kept=kept)
    problem = normalized_problem(
        *(given, container, grains, settings), seed=request.seed, start=start, unit=unit, density=density,
        asked_count=asked["count"], asked_fraction=asked["solid_fraction"],
        orientation=turns_asked(orientations, settings, given, grains.shape_id, start=start, seed=request.seed),
    )  # fmt: skip
    settling = settling_after(entry, problem, request.settle)
    if settling is not None:
        problem, entry = replace(problem, settling=settling), with_settling(entry, settling)
    warn_of_units(problem)
    if problem.count and (doubt := doubt_about(container, problem.unit_length)):
        warn(doubt, PackingWarning)
    return Task(with_grain_as_container(entry, problem), problem, grains.removed, asked, sizes)


def _chosen(request: Request) -> tuple[PackingMethod, Any, OrientationLaw | None]:
    """Return the method, its parameters, and the distribution of orientations that is asked for."""
    orientations, keywords = asked_orientations(request.orientations, request.parameters, _keywords_of(request.method))
    chosen = method_registry().chosen(request.method, keywords, where="method", beside=_arguments())
    return chosen[1], chosen[2], orientations


def _asked(
    request: Request, count: Any, solid_fraction: Any, listed: ListedGrains | None, orientations: OrientationLaw | None
) -> dict[str, Any]:
    """Return what the provenance says of what is asked for."""
    asked: dict[str, Any] = {"count": whole_number_of(count), "solid_fraction": number_of(solid_fraction)}
    asked["sizes"] = None if request.sizes is None else request.sizes.to_mapping()
    if listed is not None:
        asked["rows"] = listed.rows
    asked["weights"] = None if request.weights is None else np.asarray(request.weights, dtype=float).tolist()
    asked["weights_by"] = request.weights_by
    if orientations is not None:
        asked["orientations"] = orientations.asked()
    return asked


def check_asked(shapes: Any, container: Any, sizes: Any, start: Any) -> tuple[Shape, ...]:
    """Check these arguments of :func:`pack`, and return the shapes as a tuple.

    Raises
    ------
    InputError
        If one of them is of another type, or a shape or the container is smaller than 1e-60 or larger than 1e60.
    """
    given = check_shapes(shapes)
    check_container(container)
    if sizes is not None and not isinstance(sizes, SizeDistribution):
        raise InputError(f"sizes is {shown(sizes)}: it must be a size distribution; for one size give sizes.fixed")
    if start is not None:
        check_packing(start, "start")
    for shape in given:
        check_lengths(shape.bounding_radius, f"bounding radius of shape {shape.name!r}")
    return given


def _keywords_of(method: Any) -> list[str]:
    """Return the names of the parameters of a method that is given by name; none of a parameter object."""
    known = parameters_of(method_registry().get(method).parameters) if isinstance(method, str) else ()
    return [item.name for item in known]


def _arguments() -> tuple[str, ...]:
    """Return the names of the arguments of `pack` itself, which a misspelt parameter may have meant."""
    return tuple(item.name for item in inspect.signature(pack).parameters.values() if item.kind is not item.VAR_KEYWORD)


def with_provenance(task: Task, state: RunState, packing: Packing, *, seconds: float) -> Packing:
    """Return the packing with the record of what was asked, done and missed, and the target that ended it."""
    problem = task.problem
    missed = misses(task, packing)
    record = {
        "method": task.method.name,
        "parameters": to_mapping(problem.parameters),
        "seed": problem.seed,
        "asked": task.asked,
        "placed": {"count": packing.count, "solid_fraction": packing.solid_fraction},
        "missed": missed,
        "shapes": [{"name": shape.name, "key": shape.key} for shape in packing.shapes],
        "median_diameter": problem.unit_length,
        # of the method, as in the plan: the steps of settling are in the record of that
        "counters": {**state.counters, **problem.counters, "attempts": state.counters.get("packing_done", state.done)},
        "versions": installed_versions("voxgran", "numpy", "scipy", "numba", "open3d", "vtk", "manifold3d"),
        "timing": {"wall_seconds": seconds},
        **packing.provenance,
    }
    made = replace(packing, provenance=record, asked_sizes=task.sizes)
    if packing.stop_reason == "count" and ended_by_solid_fraction(task) and not missed["solid_fraction"]:
        return replace(made, stop_reason="solid_fraction")
    return made
