"""Random seeds of grains in a column above the floor: spheres smaller than the grains, which do not overlap."""

import math

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran._base.errors import InputError
from voxgran._base.kernels import kernel
from voxgran._base.stopping import stop_if_asked
from voxgran.containers.model import Container, periods_of, within_periods
from voxgran.geometry.level_grid import is_free, level_cells, link_at

#: radius of a seed, in diameters of its grain, at a fill of `LOOSE`
RADIUS, LOOSE = 0.36, 0.5
#: points by which the volume of a container below a level is estimated
SAMPLES = 20_000
#: multiple of these points after which a container in which none of them lies has no room
HOPELESS = 20
#: points that are tried for each seed at once, and the factor by which seeds without a place become smaller
TRIES, SMALLER = 4, 0.8
#: share of the height of a container below which a column is thin, so that points are drawn in it alone
THIN = 0.02


def column_top(
    container: Container,
    up: Floats,
    volume: float,
    generator: np.random.Generator,
    base: float = -math.inf,
    *,
    layer: float = 0.0,
) -> tuple[float, float]:
    """Return the level along `up` below which the container has a volume above the level `base`, and how much it has
    above it in all, both estimated to about one percent.

    The level is at least the height `layer` of one layer of grains above the lowest one: few grains have a smaller
    volume in a wide container.
    """
    level = linear.matmul(points_inside(container, generator), up)
    below = float((level < base).mean())
    share = min(below + volume / container.volume, 1.0)
    top = float(np.quantile(level, share)) if share < 1.0 else float(level.max())
    lowest, highest = container_levels(container, up)
    return max(top, min(max(lowest, base) + layer, highest)), (1.0 - below) * container.volume


def container_levels(container: Container, up: Floats) -> tuple[float, float]:
    """Return the lowest and the highest level along `up` of the bounding box of a container."""
    lower, upper = (np.asarray(corner, dtype=np.float64) for corner in container.bounds)
    ends = np.stack([lower * up, upper * up])
    return float(ends.min(axis=0).sum()), float(ends.max(axis=0).sum())


def random_seeds(
    container: Container, radii: Floats, *, up: Floats, top: float, generator: np.random.Generator,
    base: float = -math.inf,
) -> tuple[Floats, Floats]:  # fmt: skip
    """Return centers (n, 3) of spheres that do not overlap, between two levels along `up`, and their radii (n,).

    Spheres are placed at random one after the other (random sequential addition), the large ones first; where there is
    no place for some, those become smaller.

    Raises
    ------
    InputError
        If there is no place for some that are a hundred times smaller.
    """
    n = len(radii)
    if not n:
        return np.zeros((0, 3)), radii.copy()
    order, lower = np.argsort(-radii, kind="stable"), np.array(container.bounds[0], dtype=np.float64)
    lengths = np.array(container.bounds[1]) - lower
    cells, level = level_cells(lengths, periods_of(container), radii, container.dimension)
    spheres = np.column_stack([np.zeros((n, 3)), radii])
    floor, ceiling = container_levels(container, up)
    floor = max(floor, base)
    span = _between(container, up, floor, top) if top - floor < THIN * (ceiling - floor) else None
    placed, smallest = 0, 1e-2 * float(radii.min(initial=1.0))
    while placed < n:
        stop_if_asked()
        points = points_inside(container, generator, max(TRIES * n, SAMPLES), span)
        room = -np.asarray(container.signed_distance(points))
        # as far from the top as from the floor, or else large grains would begin higher
        room = np.minimum(room, np.minimum(top - linear.matmul(points, up), linear.matmul(points, up) - base))
        before = placed
        placed = int(_place(spheres, level, order, placed, points, room, lower, cells))
        if placed - before < 0.01 * n:
            spheres[order[placed:], 3] *= SMALLER
            if placed < n and spheres[order[placed:], 3].min() < smallest:
                raise InputError(
                    f"{n - placed} of {n} grains find no place for their seeds: the container is too small; make it "
                    "larger, or the grains fewer"
                )
    return spheres[:, :3] + lower, spheres[:, 3].copy()


@kernel
def _place(spheres, level, order, placed, points, room, lower, cells):  # type: ignore[no-untyped-def]
    """Place spheres, in their order, at the first of the points where there is room; return how many are placed."""
    for k in range(len(points)):
        if placed == len(order):
            break
        i = order[placed]
        r = spheres[i, 3]
        if room[k] < r:
            continue
        x, y, z = points[k, 0] - lower[0], points[k, 1] - lower[1], points[k, 2] - lower[2]
        if is_free(cells, spheres, x, y, z, r, 0.0):
            spheres[i, 0], spheres[i, 1], spheres[i, 2] = x, y, z
            link_at(cells, i, level[i], x, y, z)
            placed += 1
    return placed


def _between(container: Container, up: Floats, floor: float, top: float) -> tuple[Floats, Floats]:
    """Return the corners of the bounding box of a container between two levels, where `up` is along an axis."""
    lower, upper = (np.array(corner, dtype=np.float64) for corner in container.bounds)
    axis = int(np.argmax(np.abs(up)))
    if abs(up[axis]) == 1.0:
        lower[axis], upper[axis] = sorted((floor * up[axis], top * up[axis]))
    return lower, upper


def points_inside(
    container: Container,
    generator: np.random.Generator,
    many: int = SAMPLES,
    bounds: tuple[Floats, Floats] | None = None,
) -> Floats:
    """Return random points (many, 3) in a container, within its bounds or others.

    Raises
    ------
    InputError
        If none of many points lies in it.
    """
    lower, upper = container.bounds if bounds is None else bounds
    found, missing, tried = [], many, 0
    flat = np.arange(3) < container.dimension
    while missing > 0:
        points = np.array(lower) + (np.array(upper) - lower) * generator.random((many, 3)) * flat
        inside = points[container.signed_distance(points) <= 0.0]
        found.append(inside[:missing])
        missing -= len(inside)
        tried += many
        if missing == many and tried >= HOPELESS * SAMPLES:
            raise InputError(
                f"none of {tried} random points lies where grains have room: obstacles or walls leave none; make them "
                "smaller, or the container larger"
            )
    return within_periods(np.concatenate(found), container)
