"""The first sphere that a moving one touches: on a line, on a circle, or on the way along the wall of a cylinder."""

import math

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel
from voxgran.geometry.level_grid import cells_near, first_in_cell, image_shift
from voxgran.geometry.vectors import Vector, add, row_of
from voxgran.packing.deposition.field import CENTER, FIRST, MIDDLE, REACH, SECOND, SLIGHT, WAY, Field, Motion
from voxgran.packing.deposition.tube import meet_in_tube

#: motions: none, along a line, on a circle, about a sphere along the wall of a cylinder
STILL, LINE, CIRCLE, ROUND_TUBE = 0, 1, 2, 3

#: variation on a circle, and depth of a meeting, in what is rounding at its beginning, that are rounding as well
LEVEL = 1e-3


@bare_kernel
def first_sphere(
    field: Field, motion: Motion, middle: Vector, around: float, end: float
) -> tuple[float, float, float, float, float]:
    """Return how far along a motion the first sphere is touched, up to `end`, its center and the sum of the radii.

    That sum is 0 where none is touched. The motion keeps within `around` less r of `middle`.
    """
    cells, place = field.cells, motion.place
    best, bx, by, bz, both = end, 0.0, 0.0, 0.0, 0.0
    for level in range(len(cells.count)):
        far = around + cells.reach[level, 0]
        low, high = cells_near(cells, level, *middle, (far, far, far))
        for i in range(low[0], high[0]):
            for j in range(low[1], high[1]):
                for k in range(low[2], high[2]):
                    g, ti, tj, tk = first_in_cell(cells, level, i, j, k)
                    while g >= 0:
                        x, y, z = add(row_of(field.spheres, g), image_shift(cells, ti, tj, tk))
                        reach = motion.r + field.spheres[g, 3]
                        if motion.kind == LINE:
                            t = meet_on_line(place, field.vectors[WAY], x, y, z, reach)
                        elif motion.kind == CIRCLE:
                            t = meet_on_circle(field, motion.kept, motion.radius, x, y, z, reach)
                        elif motion.kind == ROUND_TUBE:
                            t = meet_in_tube(field, x, y, z, reach)
                        else:
                            t = _overlap(place, x, y, z, reach)
                        if t <= best:
                            best, bx, by, bz, both = t, x, y, z, reach
                        g = cells.after[g]
    return best, bx, by, bz, both


@bare_kernel
def _overlap(place, x, y, z, reach):  # type: ignore[no-untyped-def]
    """Return 0 where the sphere overlaps another, infinity where it does not."""
    square = (place[0] - x) ** 2 + (place[1] - y) ** 2 + (place[2] - z) ** 2
    return 0.0 if square < reach * reach else math.inf


@bare_kernel
def meet_on_line(place: Floats, way: Floats, x: float, y: float, z: float, reach: float) -> float:
    """Return how far along the line the distance from a center is `reach`, infinite where the line leads away."""
    dx, dy, dz = place[0] - x, place[1] - y, place[2] - z
    along = dx * way[0] + dy * way[1] + dz * way[2]
    if along > -SLIGHT * reach:
        return math.inf
    beyond = dx * dx + dy * dy + dz * dz - reach * reach
    square = along * along - beyond
    if square <= LEVEL * SLIGHT * reach * reach:
        return math.inf
    # the difference of the two is exact where the sphere touches already
    return max(beyond / (math.sqrt(square) - along), 0.0)


@bare_kernel
def meet_on_circle(field: Field, kept: int, radius: float, x: float, y: float, z: float, reach: float) -> float:
    """Return the angle at which the sphere touches a center, infinite where it does not or keeps that contact.

    A negative reach is that of a round wall, which the sphere touches from inside.
    """
    contacts, vectors = field.contacts, field.vectors
    for k in range(kept):
        same = x == contacts[k, CENTER] and y == contacts[k, CENTER + 1] and z == contacts[k, CENTER + 2]
        if same and reach * contacts[k, REACH] > 0.0:
            return math.inf
    dx, dy, dz = x - vectors[MIDDLE, 0], y - vectors[MIDDLE, 1], z - vectors[MIDDLE, 2]
    far = dx * dx + dy * dy + dz * dz
    if far > (radius + abs(reach)) ** 2:
        return math.inf
    side = 2.0 * radius if reach > 0.0 else -2.0 * radius
    a = side * (dx * vectors[FIRST, 0] + dy * vectors[FIRST, 1] + dz * vectors[FIRST, 2])
    b = side * (dx * vectors[SECOND, 0] + dy * vectors[SECOND, 1] + dz * vectors[SECOND, 2])
    c = radius * radius + far - reach * reach
    if reach > 0.0:
        return first_root(a, b, c, SLIGHT * reach * reach)
    return first_root(a, b, -c, -SLIGHT * reach * radius)


@bare_kernel
def first_root(a: float, b: float, c: float, slight: float) -> float:
    """Return the first angle from 0 at which ``a cos + b sin`` reaches c from below, infinite where it does not.

    Differences up to `slight` are rounding: what is at c there has reached it if it grows.
    """
    size = math.hypot(a, b)
    # a circle in a wall neither leads to it nor away
    if size <= LEVEL * slight:
        return math.inf
    if a > c - slight:
        if abs(b) <= slight:
            return math.inf if a > 0.0 else 0.0
        # it falls first, and comes back as far beyond its lowest value as that is away
        return 0.0 if b > 0.0 else 2.0 * (math.atan2(b, a) + math.pi)
    # what is grazed by rounding is passed
    if size <= abs(c) + LEVEL * slight:
        return math.inf
    angle = math.atan2(b, a) - math.acos(c / size)
    return angle + 2.0 * math.pi if angle < 0.0 else angle
