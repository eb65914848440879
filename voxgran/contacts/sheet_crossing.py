"""How deep two open surfaces cross: how far the triangles that cross deepest must at least be moved to part.

Two triangles are convex; the least overlap of both along eleven directions, their normals and the products of their
edges, is how far one must be moved (separating axes, as in :mod:`voxgran.shapes.crossing`). Where surfaces cross along
an edge, each triangle only touches, and no pair of them tells; then one surface is moved a little, six ways: what
crosses after every one of these moves counts as that deep, and what only touched comes free by one of them.
"""

import math

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.kernels import kernel
from voxgran._base.tree import TriangleTree
from voxgran.contacts.triangles import box_gap, pair_bound, turn_triangles

#: lengths of the small moves, in sizes of the pair, and the depth below which they are made
MOVES = tuple(10.0**-k for k in range(2, 10))
SHALLOW = 1e-6
#: three perpendicular directions along no usual edge, in rows; moves go both ways along each
AXES = (
    np.array([[2.0, 3.0, 6.0], [3.0, -6.0, 2.0], [6.0, 2.0, -3.0]])
    / 7.0
    @ np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
)


def crossing_depth(one: TriangleTree, other: TriangleTree, *, matrix: Floats, offset: Floats) -> tuple[float, Floats]:
    """Find how deep two surfaces cross.

    Parameters
    ----------
    one, other : TriangleTree
        The surfaces, each in its own frame.
    matrix, offset : (3, 3) and (3,) ndarray of float
        Lead from the frame of `other` into that of `one`.

    Returns
    -------
    depth : float
        How far one must be moved at least to part them, in the unit of `one`; 0 where they only touch.
    way : (3,) ndarray of float
        Unit vector along which `other` leaves the deepest triangle of `one`.
    """
    turn, size = np.ascontiguousarray(matrix), np.abs(matrix)

    def depth_at(place: Floats) -> tuple[float, Floats]:
        way = np.zeros(3)
        return float(_deepest_crossing(*one.arrays, *other.arrays, turn, size, place, way)), way

    depth, way = depth_at(np.ascontiguousarray(offset))
    extent = one.size + float(np.linalg.norm(matrix, axis=0).max()) * other.size
    if depth > SHALLOW * extent:
        return depth, way
    for move in MOVES:
        moved = [depth_at(offset + sign * move * extent * axis) for axis in AXES for sign in (-1.0, 1.0)]
        least = min(found for found, _ in moved)
        if least > 0.0:
            return max(depth, min(least, move * extent)), way if way.any() else moved[0][1]
    return depth, way


@kernel
def _deepest_crossing(  # type: ignore[no-untyped-def]
    corners, low, high, start, other_corners, other_low, other_high, other_start, matrix, size, offset, way
):
    """Walk both trees where boxes meet; write the direction of the deepest crossing and return its depth."""
    best = 0.0
    leaves, other_leaves = len(low) // 2, len(other_low) // 2
    stack, turned, axis = np.zeros((256, 2), dtype=np.int64), np.zeros((16, 3, 3)), np.zeros(3)
    depth = 1
    while depth > 0:
        depth -= 1
        a, b = stack[depth, 0], stack[depth, 1]
        if pair_bound(low, high, a, other_low, other_high, b, matrix, size, offset) > 0.0:
            continue
        if a >= leaves and b >= other_leaves:
            turn_triangles(other_corners, other_start[b, 0], other_start[b, 1], matrix, offset, turned)
            for i in range(start[a, 0], start[a, 1]):
                for j in range(other_start[b, 1] - other_start[b, 0]):
                    if box_gap(corners, i, turned, j) > 0.0:
                        continue
                    overlap = _overlap(corners, i, turned, j, axis)
                    if overlap > best:
                        best = overlap
                        way[:] = axis
            continue
        split_one = a < leaves and (b >= other_leaves or a <= b)
        for side in range(2):
            stack[depth, 0] = 2 * a + 1 + side if split_one else a
            stack[depth, 1] = b if split_one else 2 * b + 1 + side
            depth += 1
    return best


@kernel
def _overlap(one, i, other, j, way):  # type: ignore[no-untyped-def]
    """Return the least overlap of two triangles along eleven directions, 0 where one parts them; write the way."""
    best = math.inf
    for k in range(11):
        if k == 9:
            e, f = _edge(one, i, 0), _edge(one, i, 1)
        elif k == 10:
            e, f = _edge(other, j, 0), _edge(other, j, 1)
        else:
            e, f = _edge(one, i, k // 3), _edge(other, j, k % 3)
        x, y, z = e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0]
        length = math.sqrt(x * x + y * y + z * z)
        spans = math.sqrt((e[0] * e[0] + e[1] * e[1] + e[2] * e[2]) * (f[0] * f[0] + f[1] * f[1] + f[2] * f[2]))
        # the product of parallel edges is rounding
        if length <= 1e-14 * spans:
            continue
        x, y, z = x / length, y / length, z / length
        low_one = high_one = 0.0
        low_two, high_two = math.inf, -math.inf
        for c in range(3):
            s = (
                x * (one[i, c, 0] - one[i, 0, 0])
                + y * (one[i, c, 1] - one[i, 0, 1])
                + z * (one[i, c, 2] - one[i, 0, 2])
            )
            t = (
                x * (other[j, c, 0] - one[i, 0, 0])
                + y * (other[j, c, 1] - one[i, 0, 1])
                + z * (other[j, c, 2] - one[i, 0, 2])
            )
            low_one, high_one = min(low_one, s), max(high_one, s)
            low_two, high_two = min(low_two, t), max(high_two, t)
        ahead, back = high_one - low_two, high_two - low_one
        if min(ahead, back) <= 0.0:
            return 0.0
        if min(ahead, back) < best:
            best = min(ahead, back)
            sign = 1.0 if ahead <= back else -1.0
            way[0], way[1], way[2] = sign * x, sign * y, sign * z
    return best


@kernel
def _edge(triangles, i, k):  # type: ignore[no-untyped-def]
    """Return edge k of triangle i."""
    m = (k + 1) % 3
    return (
        triangles[i, m, 0] - triangles[i, k, 0],
        triangles[i, m, 1] - triangles[i, k, 1],
        triangles[i, m, 2] - triangles[i, k, 2],
    )
