"""What random sequential addition makes of a problem: extents, whose turn it is, classes of sizes, coordinates."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Floats, Integers
from voxgran._base.errors import InputError, TooLargeError
from voxgran._base.rotation import random_rotations
from voxgran._base.seeds import philox_key, stream
from voxgran.containers.kernel_container import FLAT, KernelContainer, kernel_container
from voxgran.packing.problem import Problem
from voxgran.packing.rsa.available_cells import Classes, make_classes
from voxgran.packing.rsa.candidates import SCAN, Rules, fill_table
from voxgran.packing.rsa.level_grid import Cells, lay_out, sort_into_levels
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive

#: coordinates at the most, where they are kept
MOST_COORDINATES = 2**31
#: overlap, in median diameters, that a grain which was moved away may keep by rounding
TOUCHING = 1e-10
#: classes of sizes that have open cells of their own
CLASSES = 32
#: the linear congruential sequence of Chu 2011: factor, summand, modulus, and first numbers of x and y; that of z is
#: ours, and a bad one as any: all are shifts of one cycle
FACTOR, SUMMAND, MODULUS, FIRST = 2053, 13849, 65536, (20001, 60001, 40001)


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """What follows from the problem.

    Attributes
    ----------
    half : (n, 1 or 3) ndarray of float
        Half the extents of the grains; of spheres one column, the radii.
    level : (n,) ndarray of int
        Their levels of size.
    room : KernelContainer
        The container.
    cells : Cells
        Cells of the grains that are in.
    queue : (m,) ndarray of int
        Grains that are to enter, as they come.
    kind : (n,) ndarray of int
        Classes of their sizes, where these matter.
    table : (c, 3) ndarray of float
        Coordinates, where they are made beforehand.
    rules : Rules
        How candidates are made.
    classes : Classes or None
        Classes of sizes where open places are searched.
    boxes : bool
        Whether grains are boxes.
    """

    half: Floats
    level: NDArray[np.int8]
    room: KernelContainer
    cells: Cells
    queue: NDArray[np.int32]
    kind: NDArray[np.int32]
    table: Floats
    rules: Rules
    classes: Classes | None
    boxes: bool


def searches(problem: Problem) -> bool:
    """Return whether open places are searched as soon as a grain has made all its tries in vain.

    They are where so many grains are asked for and nothing else is said, in the scheme that only drops: the law is the
    same, and what has room is found.
    """
    settings = problem.parameters
    return bool(
        settings.until is None and problem.target and settings.scheme == "classic" and settings.numbers == "philox"
    )


def make_setting(problem: Problem, search_from: int) -> Setting:
    """Return the setting of a problem, with no grain in its cells yet.

    Parameters
    ----------
    problem : Problem
        In the normalized frame.
    search_from : int
        From which turn on open places are searched; -1: they are not.

    Raises
    ------
    InputError
        If grains are asked to stand aligned that are no boxes along the axes, or the container is round or closed.
    TooLargeError
        If there are more than 2**31 coordinates, and they must be kept.
    """
    settings, room, half = problem.parameters, kernel_container(problem.container), half_extents(problem)
    search, scan = search_from >= 0, settings.retaining == SCAN
    many = coordinate_count(problem)
    level = sort_into_levels(half[:, : problem.dimension])
    queue = queue_of(problem, half, room)
    kind, rest = np.zeros(0, dtype=np.int32), queue[max(search_from, 0) :]
    if search or scan:
        kind = np.zeros(problem.count, dtype=np.int32)
        found = sizes_of(half[rest], CLASSES if search else None)
        # where all are in the first class zeros take no memory
        if found.any():
            kind[rest] = found
    corrections = settings.corrections if settings.correcting else 0
    return Setting(
        half=half,
        level=level,
        room=room,
        cells=lay_out(half, level, room, problem.dimension),
        queue=queue,
        kind=kind,
        table=coordinate_table(problem, many),
        rules=Rules(
            settings.retaining, settings.tries, many, corrections, TOUCHING if corrections else 0.0, searches(problem)
        ),
        classes=make_classes(half, kind, rest, room, problem.dimension, settings.tries) if search else None,
        boxes=bool(settings.aligned),
    )


def coordinate_count(problem: Problem) -> int:
    """Return how many coordinates are drawn at the most.

    Raises
    ------
    TooLargeError
        If there are more than 2**31, and they must be kept.
    """
    settings = problem.parameters
    many: int = settings.tries * newcomers(problem)
    if (settings.tabled or settings.retaining == SCAN) and many > MOST_COORDINATES:
        raise TooLargeError(
            f"tries gives {many} coordinates to be sorted, replayed or scanned: at most {MOST_COORDINATES} can be "
            "kept; make tries or the grains fewer"
        )
    return many


def half_extents(problem: Problem) -> Floats:
    """Return half the extents of the grains as the method treats them, in median diameters.

    Boxes have a column for each axis, spheres one: (n, 3) or (n, 1).

    Raises
    ------
    InputError
        If grains are asked to stand aligned that are no boxes along the axes, or the container is round or closed.
    """
    if problem.parameters.aligned:
        if kernel_container(problem.container).kind != FLAT:
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


def orientations(problem: Problem, placed: Integers) -> Floats | None:
    """Return the orientations of some grains, (m, 4): random, but of spheres, of aligned grains and of the start.

    None where no grain is turned.

    Parameters
    ----------
    problem : Problem
        In the normalized frame.
    placed : (m,) ndarray of int
        Which grains, in their order.
    """
    spheres = all(shape.is_sphere for shape in problem.shapes)
    if problem.start is None and (spheres or problem.parameters.aligned):
        return None
    orientation = np.tile([1.0, 0.0, 0.0, 0.0], (len(placed), 1))
    if not spheres and not problem.parameters.aligned:
        generator = stream(problem.seed, "orientations")
        turned = np.array([not shape.is_sphere for shape in problem.shapes])[problem.shape_id[placed]]
        if problem.dimension == 3:
            orientation[turned] = random_rotations(generator, problem.count)[placed[turned]]
        else:
            angle = np.pi * generator.random(problem.count)[placed[turned]]
            orientation[turned, 0], orientation[turned, 3] = np.cos(angle), np.sin(angle)
    if problem.start is not None:
        orientation[: problem.start.count] = problem.start.orientation
    return orientation


def newcomers(problem: Problem) -> int:
    """Return how many grains are not there from the beginning."""
    return problem.count - (0 if problem.start is None else problem.start.count)


def queue_of(problem: Problem, half: Floats, room: KernelContainer) -> NDArray[np.int32]:
    """Return the grains that are to enter, as they come; those wider than the container stay out.

    Parameters
    ----------
    problem : Problem
        In the normalized frame.
    half : (n, 1 or 3) ndarray of float
        Half the extents of the grains.
    room : KernelContainer
        The container.
    """
    n, m = problem.count, newcomers(problem)
    queue = np.arange(n - m, n, dtype=np.int32)
    if problem.parameters.order == "largest":
        queue = queue[np.argsort(-problem.volumes[queue], kind="stable")]
    elif problem.parameters.order == "random":
        queue = queue[stream(problem.seed, "order").permutation(m)]
    across = slice(0, problem.dimension)
    return queue[(2 * half[queue, across] <= room.lengths[across] + room.slack).all(axis=1)]


def sizes_of(half: Floats, most: int | None = None) -> Integers:
    """Return the class of each grain, such that grains of a class have the same extents.

    Parameters
    ----------
    half : (n, 1 or 3) ndarray of float
        Half the extents.
    most : int or None
        If there are more sizes than this, they are put together to as many classes, by the geometric mean.
    """
    if (half == half[:1]).all():
        return np.zeros(len(half), dtype=np.int64)
    rows, kind = np.unique(half if half.shape[1] > 1 else half[:, 0], axis=0, return_inverse=True)
    rows, kind = rows.reshape(-1, half.shape[1]), kind.reshape(-1)
    if most is None or len(rows) <= most:
        return kind
    size = np.log(rows).mean(axis=1)
    share = (size - size.min()) / (size.max() - size.min())
    classes = np.minimum((share * most).astype(np.int64), most - 1)
    _, classes = np.unique(classes, return_inverse=True)
    return np.asarray(classes.reshape(-1)[kind])


def coordinate_table(problem: Problem, many: int) -> Floats:
    """Return the coordinates of a sorted or replayed run, (many, 3) in 0 ... 1; none of other runs."""
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
    """Return the linear congruential sequence x' = (2053 x + 13849) mod 65536 after its first number.

    Parameters
    ----------
    first : int
        The first number, which is left out.
    many : int
        How many numbers.
    """
    cycle = np.zeros(MODULUS, dtype=np.int64)
    x = first
    for k in range(min(many, MODULUS)):
        x = (FACTOR * x + SUMMAND) % MODULUS
        cycle[k] = x
    return np.resize(cycle, many) if many else cycle[:0]
