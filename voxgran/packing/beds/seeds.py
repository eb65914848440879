"""Random seeds of grains in a column above the floor: spheres smaller than the grains, which do not overlap."""

import math
from typing import NamedTuple

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.errors import InputError
from voxgran._base.kernels import kernel
from voxgran._base.scalars import cube_root
from voxgran._base.stopping import stop_if_asked
from voxgran.containers.model import Container

#: radius of a seed, in diameters of its grain, at a fill of `LOOSE`
RADIUS, LOOSE = 0.36, 0.5
#: points by which the volume of a container below a level is estimated
SAMPLES = 20_000
#: points that are tried for each seed at once, and the factor by which seeds without a place become smaller
TRIES, SMALLER = 4, 0.8


def column_top(
    container: Container, up: Floats, volume: float, generator: np.random.Generator, base: float = -math.inf
) -> tuple[float, float]:
    """Return the level along `up` below which the container has a volume above the level `base`, and how much it has
    above it in all, both estimated to about one percent.
    """
    level = points_inside(container, generator) @ up
    below = float((level < base).mean())
    share = min(below + volume / container.volume, 1.0)
    top = float(np.quantile(level, share)) if share < 1.0 else float(level.max())
    return top, (1.0 - below) * container.volume


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
    order, radii = np.argsort(-radii, kind="stable"), radii.copy()
    centers, cells = np.zeros((n, 3)), _cells(container, radii)
    placed, smallest = 0, 1e-2 * float(radii.min(initial=1.0))
    while placed < n:
        stop_if_asked()
        points = points_inside(container, generator, max(TRIES * n, SAMPLES))
        room = -np.asarray(container.signed_distance(points))
        # as far from the top as from the floor, or else large grains would begin higher
        room = np.minimum(room, np.minimum(top - points @ up, points @ up - base))
        before = placed
        placed = int(_place(centers, radii, order, placed, points, room, cells))
        if placed - before < 0.01 * n:
            radii[order[placed:]] *= SMALLER
            if placed < n and radii[order[placed:]].min() < smallest:
                raise InputError(
                    f"{n - placed} of {n} grains find no place for their seeds: the container is too small; make it "
                    "larger, or the grains fewer"
                )
    return centers, radii


class Cells(NamedTuple):
    """A grid of cells; a sphere is listed in all cells that its bounding box meets.

    lower, lengths, wraps: corner and lengths of the container, and which axes are periodic.  count: cells along each
    axis.  heads: first row of each cell.  lists: (n, 2) spheres and the next row, -1 for none; the last one has the
    number of rows in use.
    """

    lower: Floats
    lengths: Floats
    wraps: Integers
    count: Integers  # type: ignore[assignment]
    heads: Integers
    lists: Integers


def _cells(container: Container, radii: Floats) -> Cells:
    """Return empty cells for spheres of these radii."""
    lower, upper = (np.array(corner, dtype=np.float64) for corner in container.bounds)
    lengths = np.where(np.arange(3) < container.dimension, upper - lower, 1.0)
    edge = max(2.0 * float(np.median(radii)), cube_root(float(lengths.prod()) / (8.0 * len(radii))))
    count = np.maximum(1, (lengths / edge).astype(np.int64))
    links = 1 + int(np.prod(2 + np.ceil(2.0 * radii[:, None] * count / lengths), axis=1).sum())
    wraps = np.array(container.periodic, dtype=np.int64)
    heads, lists = np.full(int(count.prod()), -1, dtype=np.int64), np.zeros((links, 2), dtype=np.int64)
    return Cells(lower, lengths, wraps, count, heads, lists)


@kernel
def _place(centers, radii, order, placed, points, room, cells):  # type: ignore[no-untyped-def]
    """Place spheres, in their order, at the first of the points where there is room; return how many are placed."""
    lower, lengths, wraps, count, heads, lists = cells
    used, low, high = lists[len(lists) - 1, 0], np.zeros(3, dtype=np.int64), np.zeros(3, dtype=np.int64)
    for k in range(len(points)):
        if placed == len(order):
            break
        i = order[placed]
        r = radii[i]
        if room[k] < r:
            continue
        for c in range(3):
            scale = count[c] / lengths[c]
            low[c] = math.floor((points[k, c] - r - lower[c]) * scale)
            high[c] = math.floor((points[k, c] + r - lower[c]) * scale)
            if high[c] - low[c] >= count[c]:
                low[c], high[c] = 0, count[c] - 1
        free = True
        for write in range(2):
            for x in range(low[0], high[0] + 1):
                for y in range(low[1], high[1] + 1):
                    for z in range(low[2], high[2] + 1):
                        cell = ((x % count[0]) * count[1] + y % count[1]) * count[2] + z % count[2]
                        if write == 1:
                            lists[used, 0], lists[used, 1] = i, heads[cell]
                            heads[cell] = used
                            used += 1
                            continue
                        at = heads[cell]
                        while free and at >= 0:
                            j, at, square = lists[at, 0], lists[at, 1], 0.0
                            for c in range(3):
                                d = points[k, c] - centers[j, c]
                                if wraps[c] == 1:
                                    d -= lengths[c] * math.floor(d / lengths[c] + 0.5)
                                square += d * d
                            free = square >= (r + radii[j]) ** 2
            if not free:
                break
        if free:
            for c in range(3):
                centers[i, c] = points[k, c]
            placed += 1
    lists[len(lists) - 1, 0] = used
    return placed


def points_inside(container: Container, generator: np.random.Generator, many: int = SAMPLES) -> Floats:
    """Return random points (many, 3) in a container."""
    lower, upper = container.bounds
    found, missing = [], many
    flat = np.arange(3) < container.dimension
    while missing > 0:
        points = np.array(lower) + (np.array(upper) - lower) * generator.random((many, 3)) * flat
        inside = points[container.signed_distance(points) <= 0.0]
        found.append(inside[:missing])
        missing -= len(inside)
    return np.concatenate(found)
