"""Shortest translation that separates two crossing open surfaces, among straight ones in many directions.

While one triangle is translated past another, both cross during one interval of the path: along each of eleven axes
(their normals and the cross products of their edges) the projections overlap during one interval (separating axes, as
in :mod:`voxgran.geometry.crossing`), and the triangles cross while all projections overlap. The translation is
extended to the end of such an interval as long as it lies within one; then the surfaces are separate, and no shorter
translation in that direction separates them. Intervals of adjacent triangles abut, so that the result is nearly
independent of the triangulation.

All directions are tried with both signs: three perpendicular ones, the normals at the crossing, the mean normals, their
cross product and the offset of the centroids, then directions around the best. The depth is therefore an upper bound of
the minimum. The first directions are tilted slightly, so that none lies along an edge or in a triangle: surfaces that
meet along an edge of both only touch there but cross as soon as they move; surfaces that only touch are separated at
once in one of the directions.
"""

import math

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats
from voxgran._base.kernels import kernel
from voxgran.contacts.triangles import pair_bound, turn_triangles
from voxgran.geometry.tree import TriangleTree
from voxgran.geometry.triangles import normals_of

#: three perpendicular directions that are parallel to no common edge, in rows
AXES = np.array([[3.4, 1.2, 6.0], [-1.2, -6.6, 2.0], [6.0, -2.0, -3.0]]) / 7.0
#: tilt of each direction
TILT = 1e-4 * AXES[0]
#: lengths of the steps from the best direction to those about it
STEPS = (0.4, 0.2, 0.1, 0.05)
#: rounding errors of the start and of the end of an interval, in sizes of the pair
BEGIN, END = 1e-10, 1e-12


def crossing_depth(one: TriangleTree, other: TriangleTree, *, matrix: Floats, offset: Floats) -> tuple[float, Floats]:
    """Return length and direction of the shortest translation found of `other` that separates two surfaces.

    The length, in the unit of `one`, is an upper bound of the minimum; 0 if the surfaces only touch.
    """
    turn, size = np.ascontiguousarray(matrix), np.abs(matrix)
    place = np.ascontiguousarray(offset)
    extent = one.size + float(linear.norm(matrix, axis=0).max()) * other.size
    best, way = math.inf, np.zeros(3)

    def try_all(directions: Floats) -> None:
        nonlocal best, way
        for ahead in directions:
            found = float(_free_along(one.arrays, other.arrays, turn, size, place, ahead, best, extent))
            if found < best:
                best, way = found, ahead

    try_all(_both_ways(AXES))
    if best > 0.0:
        try_all(_both_ways(_directions(one, other, turn, size, place)))
    for step in STEPS:
        if best > 0.0:
            try_all(_about(way, step))
    return best, way


def _directions(one: TriangleTree, other: TriangleTree, matrix: Floats, size: Floats, offset: Floats) -> Floats:
    """Return normals at the crossing, mean normals, their cross product and the offset of the centroids, in rows."""
    crossing = np.zeros((2, 3))
    _add_normals(one.arrays, other.arrays, matrix, size, offset, crossing)
    mean, other_mean = (
        normals_of(one.corners).sum(axis=0),
        normals_of(linear.matmul(other.corners, matrix.T)).sum(axis=0),
    )
    between = linear.matmul(other.corners.mean(axis=(0, 1)), matrix.T) + offset - one.corners.mean(axis=(0, 1))
    return np.array([*crossing, mean, other_mean, np.cross(mean, other_mean), between])


def _both_ways(directions: Floats) -> Floats:
    """Return the vectors of nonzero length as tilted unit vectors, each followed by its opposite."""
    length = linear.norm(directions, axis=1)
    some = length > END * length.max(initial=0.0)
    tilted = directions[some] / length[some, None] + TILT
    tilted /= linear.norm(tilted, axis=1, keepdims=True)
    return np.stack([tilted, -tilted], axis=1).reshape(-1, 3)


def _about(way: Floats, step: float) -> Floats:
    """Return eight unit vectors around a given one."""
    aside = np.cross(way, AXES[np.abs(linear.matmul(AXES, way)).argmin()])
    aside /= linear.norm(aside)
    angle = np.arange(8) * np.pi / 4
    turned = way + step * (libm.cos(angle)[:, None] * aside + libm.sin(angle)[:, None] * np.cross(way, aside))
    return np.asarray(turned / linear.norm(turned, axis=1, keepdims=True))


@kernel
def _push_halves(stack, depth, a, b, leaves, other_leaves):  # type: ignore[no-untyped-def]
    """Push both halves of the larger of two boxes, each with the other box; return the new size of the stack."""
    split_one = a < leaves and (b >= other_leaves or a <= b)
    for side in range(2):
        stack[depth + side, 0] = 2 * a + 1 + side if split_one else a
        stack[depth + side, 1] = b if split_one else 2 * b + 1 + side
    return depth + 2


@kernel
def _free_along(one, other, matrix, size, offset, way, most, extent):  # type: ignore[no-untyped-def]
    """Return the distance that the other surface moves along `way` until nothing crosses, at most `most`."""
    leaves, other_leaves = len(one.low) // 2, len(other.low) // 2
    stack, turned, place = np.zeros((256, 2), dtype=np.int64), np.zeros((16, 3, 3)), offset.copy()
    near = BEGIN * extent
    moved, before = 0.0, -1.0
    while moved > before:
        before = moved
        stack[0, 0], stack[0, 1], depth = 0, 0, 1
        while depth > 0:
            depth -= 1
            a, b = stack[depth, 0], stack[depth, 1]
            if pair_bound(one, a, other, b, matrix, size, place) > near * near:
                continue
            if a < leaves or b < other_leaves:
                depth = _push_halves(stack, depth, a, b, leaves, other_leaves)
                continue
            turn_triangles(other.corners, other.start[b, 0], other.start[b, 1], matrix, offset, turned)
            for i in range(one.start[a, 0], one.start[a, 1]):
                for j in range(other.start[b, 1] - other.start[b, 0]):
                    end = _end_of_crossing(one.corners, i, turned, j, way, moved + near)
                    if end > moved + END * extent:
                        moved = end
                        if moved >= most:
                            return most
                        for k in range(3):
                            place[k] = offset[k] + moved * way[k]
    return moved


@kernel
def _end_of_crossing(one, i, other, j, way, moved):  # type: ignore[no-untyped-def]
    """Return the distance at which triangle j leaves triangle i, or -1 if they do not cross after `moved`."""
    last = math.inf
    ax, ay, az = one[i, 0, 0], one[i, 0, 1], one[i, 0, 2]
    for k in range(11):
        x, y, z = _direction(one, i, other, j, k)
        if x == 0.0 and y == 0.0 and z == 0.0:
            continue
        low_one = high_one = 0.0
        low_two, high_two = math.inf, -math.inf
        for c in range(3):
            s = x * (one[i, c, 0] - ax) + y * (one[i, c, 1] - ay) + z * (one[i, c, 2] - az)
            t = x * (other[j, c, 0] - ax) + y * (other[j, c, 1] - ay) + z * (other[j, c, 2] - az)
            low_one, high_one = min(low_one, s), max(high_one, s)
            low_two, high_two = min(low_two, t), max(high_two, t)
        speed = x * way[0] + y * way[1] + z * way[2]
        # the projections overlap while back < speed * moved < ahead
        back, ahead = low_one - high_two, high_one - low_two
        if speed < 0.0:
            back, ahead, speed = -ahead, -back, -speed
        if back >= speed * moved or ahead <= 0.0:
            return -1.0
        if ahead < speed * last:
            last = ahead / speed
    return last


@kernel
def _direction(one, i, other, j, k):  # type: ignore[no-untyped-def]
    """Return candidate axis k of two triangles: a cross product of edges, or a normal; 0 for parallel edges."""
    if k == 9:
        e, f = _edge(one, i, 0), _edge(one, i, 1)
    elif k == 10:
        e, f = _edge(other, j, 0), _edge(other, j, 1)
    else:
        e, f = _edge(one, i, k // 3), _edge(other, j, k % 3)
    x, y, z = e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0]
    length = math.sqrt(x * x + y * y + z * z)
    spans = math.sqrt((e[0] * e[0] + e[1] * e[1] + e[2] * e[2]) * (f[0] * f[0] + f[1] * f[1] + f[2] * f[2]))
    # the cross product of parallel edges is rounding error
    if length <= 1e-14 * spans:
        return 0.0, 0.0, 0.0
    return x / length, y / length, z / length


@kernel
def _edge(triangles, i, k):  # type: ignore[no-untyped-def]
    """Return edge k of triangle i."""
    m = (k + 1) % 3
    return (
        triangles[i, m, 0] - triangles[i, k, 0],
        triangles[i, m, 1] - triangles[i, k, 1],
        triangles[i, m, 2] - triangles[i, k, 2],
    )


@kernel
def _add_normals(one, other, matrix, size, offset, normals):  # type: ignore[no-untyped-def]
    """Sum the normals of the crossing triangles of each surface."""
    leaves, other_leaves = len(one.low) // 2, len(other.low) // 2
    stack, turned, still, depth = np.zeros((256, 2), dtype=np.int64), np.zeros((16, 3, 3)), np.zeros(3), 1
    while depth > 0:
        depth -= 1
        a, b = stack[depth, 0], stack[depth, 1]
        if pair_bound(one, a, other, b, matrix, size, offset) > 0.0:
            continue
        if a < leaves or b < other_leaves:
            depth = _push_halves(stack, depth, a, b, leaves, other_leaves)
            continue
        turn_triangles(other.corners, other.start[b, 0], other.start[b, 1], matrix, offset, turned)
        for i in range(one.start[a, 0], one.start[a, 1]):
            for j in range(other.start[b, 1] - other.start[b, 0]):
                if _end_of_crossing(one.corners, i, turned, j, still, 1.0) > 0.0:
                    for n in range(2):
                        normal = _direction(one.corners, i, turned, j, 9 + n)
                        for k in range(3):
                            normals[n, k] += normal[k]
