"""Precomputed data of random sequential addition: extents, order of insertion, size classes, coordinates."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import Floats, Integers
from voxgran._base.errors import InputError, TooLargeError
from voxgran._base.seeds import philox_key, stream
from voxgran.contacts.overlap.true_shapes import TrueShapes, inner_radius, true_shapes
from voxgran.containers.kernel_container import KernelContainer, kernel_container
from voxgran.containers.model import boundary_of
from voxgran.geometry.level_grid import LevelGrid
from voxgran.packing.problem import Problem
from voxgran.packing.rsa.available_cells import Classes, make_classes
from voxgran.packing.rsa.candidates import SCAN, CandidateRules, fill_table
from voxgran.packing.rsa.overlaps import lay_out, sort_into_levels
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive

#: largest number of stored coordinates
MOST_COORDINATES = 2**31
#: overlap by rounding of a grain that was moved, in median diameters
TOUCHING = 1e-10
#: size classes with open cells of their own
CLASSES = 32
#: the linear congruential sequence of Chu 2011: factor, summand, modulus, and first numbers of x and y; that of z
#: is not given there, and all are shifts of one cycle
FACTOR, SUMMAND, MODULUS, FIRST = 2053, 13849, 65536, (20001, 60001, 40001)


@dataclass(frozen=True, slots=True, kw_only=True)
class Precomputed:
    """Data that follow from the problem."""

    half: Floats  # half the extents of the grains, (n, 3) of boxes, (n, 1) of (bounding) spheres, the radii
    level: NDArray[np.int8]  # their levels in the grid
    walls: KernelContainer
    cells: LevelGrid  # of the placed grains
    queue: NDArray[np.int32]  # grains to be placed, in their order
    kind: NDArray[np.int32]  # size classes of the grains; empty where they are not needed
    table: Floats  # coordinates, (c, 3); empty where they are not computed beforehand
    rules: CandidateRules
    classes: Classes | None  # if the available space is searched
    boxes: bool
    shapes: TrueShapes | None  # if any shape is neither a sphere nor an aligned box


def searches(problem: Problem) -> bool:
    """Return whether the available space is searched as soon as all tries of a grain have failed.

    It is if a count or a solid fraction is requested and `until` is omitted, in scheme ``classic``: the probability
    distribution is the same, and grains that fit are placed.
    """
    settings = problem.parameters
    return bool(
        settings.until is None and problem.target and settings.scheme == "classic" and settings.numbers == "philox"
    )


def precompute(problem: Problem, search_from: int) -> Precomputed:
    """Return the precomputed data of a problem, with empty cells.

    The available space is searched from turn `search_from` on; -1 for never.

    Raises
    ------
    InputError
        If `aligned` is set and a shape is not a box along the axes, or the container is round or a mesh.
    TooLargeError
        If more than 2**31 coordinates would have to be stored.
    """
    settings, walls, half = problem.parameters, kernel_container(problem.container), half_extents(problem)
    search, scan = search_from >= 0, settings.retaining == SCAN
    many = coordinate_count(problem)
    level = sort_into_levels(half[:, : problem.dimension])
    true = has_true_shapes(problem)
    # that of spheres inside decides where a grain certainly finds no place
    core = inner_extents(problem) if true else half
    queue = queue_of(problem, core, walls)
    kind, rest = np.zeros(0, dtype=np.int32), queue[max(search_from, 0) :]
    if search or scan:
        kind = np.zeros(problem.count, dtype=np.int32)
        sizes = core if search or not true else np.column_stack([half, problem.shape_id])
        found = sizes_of(sizes[rest], CLASSES if search else None)
        # untouched zeros take no memory
        if found.any():
            kind[rest] = found
    corrections = settings.corrections if settings.correcting else 0
    shapes = None
    if true:
        shapes = true_shapes(problem.shapes, problem.container, problem.shape_id, problem.diameter, core[:, 0])
        shapes.turns[:] *= problem.orientation is None
    return Precomputed(
        half=half,
        level=level,
        walls=walls,
        cells=lay_out(half, level, walls, problem.dimension),
        queue=queue,
        kind=kind,
        table=coordinate_table(problem, many),
        rules=CandidateRules(
            settings.retaining, settings.tries, many, corrections, TOUCHING if corrections else 0.0, searches(problem)
        ),
        classes=make_classes(core, kind, rest, walls, problem.dimension, settings.tries, inner=true)
        if search
        else None,
        boxes=bool(settings.aligned),
        shapes=shapes,
    )


def has_true_shapes(problem: Problem) -> bool:
    """Return whether any shape is neither a sphere nor an aligned box."""
    return not (problem.parameters.aligned or all(shape.is_sphere for shape in problem.shapes))


def inner_extents(problem: Problem) -> Floats:
    """Return the radii of spheres about the centroids inside the grains, (n, 1), in median diameters."""
    radii = np.array([inner_radius(shape) for shape in problem.shapes])
    return np.asarray((radii[problem.shape_id] * problem.diameter)[:, None])


def refuse_moves(problem: Problem) -> None:
    """Refuse schemes that move candidates, for shapes other than spheres.

    Raises
    ------
    InputError
        If the scheme does, and a shape is not a sphere.
    """
    if problem.parameters.correcting and has_true_shapes(problem):
        shape = next(shape for shape in problem.shapes if not shape.is_sphere)
        raise InputError(
            f"scheme {problem.parameters.scheme!r} is asked for with shape {shape.name!r}: candidates are moved along "
            "the line of the centers of spheres, which other shapes do not have; use 'classic', '2', '4a' or '4c'"
        )


def coordinate_count(problem: Problem) -> int:
    """Return the largest number of coordinates drawn.

    Raises
    ------
    TooLargeError
        If more than 2**31 would have to be stored.
    """
    settings = problem.parameters
    many: int = settings.tries * (problem.count - problem.started)
    if (settings.tabled or settings.retaining == SCAN) and many > MOST_COORDINATES:
        raise TooLargeError(
            f"tries gives {many} coordinates to be sorted, replayed or scanned: at most {MOST_COORDINATES} can be "
            "kept; make tries or the grains fewer"
        )
    return many


def half_extents(problem: Problem) -> Floats:
    """Return half the extents of the grains, in median diameters: (n, 3) of boxes, (n, 1) of bounding spheres.

    Raises
    ------
    InputError
        If `aligned` is set and a shape is not a box along the axes, or the container is round or a mesh.
    """
    if problem.parameters.aligned:
        if not boundary_of(problem.container).is_flat:
            raise InputError(
                f"aligned boxes are asked for in a container of kind {problem.container.kind!r}: it must be a box or "
                "a rectangle; choose one, or leave aligned out"
            )
        unit = np.array([_half_of_box(shape) for shape in problem.shapes])
    else:
        unit = np.array([[shape.bounding_radius] for shape in problem.shapes])
    half = unit[problem.shape_id]
    half *= problem.diameter[:, None]
    if problem.parameters.aligned and problem.dimension == 2:
        half[:, 2] = 1.0
    return np.asarray(half)


def _half_of_box(shape: Shape) -> Floats:
    """Return half the extents of a box or rectangle along the axes."""
    geometry = shape.geometry
    if isinstance(geometry, Primitive) and geometry.kind == "box" and geometry.rotation == (1.0, 0.0, 0.0, 0.0):
        return np.array(geometry.dimensions) / 2
    if isinstance(geometry, Outline) and len(geometry.vertices) == 4:
        reach = np.abs(geometry.vertices).max(axis=0)
        if np.allclose(np.abs(geometry.vertices), reach, rtol=1e-12, atol=0.0):
            return np.array([*reach, 1.0])
    raise InputError(
        f"shape {shape.name!r} is asked to stand aligned: it must be a box, in the plane a rectangle, along the axes; "
        "give such shapes, or leave aligned out"
    )


def order_of(problem: Problem) -> str:
    """Return the order in which the grains are inserted."""
    if problem.parameters.order is not None:
        return str(problem.parameters.order)
    return "largest" if searches(problem) and problem.asked_fraction is not None else "given"


def queue_of(problem: Problem, half: Floats, walls: KernelContainer) -> NDArray[np.int32]:
    """Return the grains to be placed, in their order, without those that are certainly wider than the container."""
    queue, order = np.arange(problem.started, problem.count, dtype=np.int32), order_of(problem)
    if order == "largest":
        queue = problem.largest_first(queue)
    elif order == "random":
        queue = queue[stream(problem.seed, "order").permutation(len(queue))]
    across = slice(0, problem.dimension)
    least = walls.lengths[across]
    if half.shape[1] == 1:
        # the nearest image of a sphere in a tilted cell is not along an axis
        least = np.where(walls.walled[across] == 1, least, walls.shortest)
    return queue[(2 * half[queue, across] <= least + walls.slack).all(axis=1)]


def sizes_of(half: Floats, most: int | None = None) -> Integers:
    """Return the size class of each grain, (n,), by its half extents, (n, 1 or 3), which are equal within a class.

    More than `most` sizes are merged by their geometric mean extents.
    """
    if (half == half[:1]).all():
        return np.zeros(len(half), dtype=np.int64)
    rows, kind = np.unique(half if half.shape[1] > 1 else half[:, 0], axis=0, return_inverse=True)
    rows, kind = rows.reshape(-1, half.shape[1]), kind.reshape(-1)
    if most is None or len(rows) <= most:
        return kind
    size = libm.log(np.maximum(rows, 1e-12)).mean(axis=1)
    share = (size - size.min()) / (size.max() - size.min())
    classes = np.minimum((share * most).astype(np.int64), most - 1)
    _, classes = np.unique(classes, return_inverse=True)
    return np.asarray(classes.reshape(-1)[kind])


def coordinate_table(problem: Problem, many: int) -> Floats:
    """Return the coordinates of a sorted or replicated run, (many, 3) in [0, 1]; of other runs none."""
    settings = problem.parameters
    if not settings.tabled:
        return np.zeros((0, 3))
    table = np.zeros((many, 3))
    if settings.numbers == "lcg":
        for axis in range(3):
            table[:, axis] = congruential(FIRST[axis], many) / MODULUS
    else:
        fill_table(table, philox_key(problem.seed, "rsa"))
    if settings.scheme.startswith("4"):
        table[:, "xyz".index(settings.along)].sort()
    return table


def congruential(first: int, many: int) -> Integers:
    """Return `many` values of the sequence x' = (2053 x + 13849) mod 65536 that follow on `first`."""
    cycle = np.zeros(MODULUS, dtype=np.int64)
    x = first
    for k in range(min(many, MODULUS)):
        x = (FACTOR * x + SUMMAND) % MODULUS
        cycle[k] = x
    return np.resize(cycle, many) if many else cycle[:0]
