"""Triangles of one surface that cut through each other.

Two triangles are convex; they overlap unless one of eleven directions separates them: the two normals and the
nine products of their edges (separating axis theorem). The smallest overlap along these directions is how far one
must be moved to free it. Triangles that only touch, share a corner or lie on each other in one plane have the overlap 0
and do not count, nor does what rounding of the coordinates makes of that. The near pairs come from a tree of boxes over
the triangles in Morton order.

References
----------
Gottschalk, Lin & Manocha 1996, OBBTree: a hierarchical structure for rapid interference detection,
doi:10.1145/237170.237244
"""

import math

import numpy as np

from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.kernels import kernel

#: overlap from which on two triangles count as crossing, in diagonals of the bounding box
DEPTH = 1e-9


def count_crossings(vertices: Floats, faces: Integers) -> int:
    """Return the number of pairs of triangles that cut through each other.

    Parameters
    ----------
    vertices : (n, 3) ndarray of float
        Corner points, finite.
    faces : (m, 3) ndarray of int
        Triangles; those that share an edge are not looked at.
    """
    return _crossings(vertices, faces)[0]


def crossing_faces(vertices: Floats, faces: Integers) -> Booleans:
    """Tell which triangles are cut through by another one.

    Parameters
    ----------
    vertices : (n, 3) ndarray of float
        Corner points, finite.
    faces : (m, 3) ndarray of int
        Triangles.
    """
    return _crossings(vertices, faces)[1]


def _crossings(vertices: Floats, faces: Integers) -> tuple[int, Booleans]:
    """Return the number of pairs that cross, and whether each triangle is in one."""
    marked = np.zeros(len(faces), dtype=np.bool_)
    if len(faces) < 2:
        return 0, marked
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    diagonal = float(np.linalg.norm(high - low))
    if diagonal == 0.0:
        return 0, marked
    points = (vertices - (low + high) / 2) / diagonal
    triangles = points[faces]
    order = np.argsort(_morton(triangles.mean(axis=1)), kind="stable")
    triangles, corners = np.ascontiguousarray(triangles[order]), np.ascontiguousarray(faces[order])
    below, above = _box_tree(triangles.min(axis=1), triangles.max(axis=1))
    hit = np.zeros(len(faces), dtype=np.bool_)
    count = int(_count_crossings(triangles, corners, below, above, DEPTH, hit))
    marked[order] = hit
    return count, marked


def _morton(points: Floats) -> Integers:
    """Return the order of points in [-0.5, 0.5]**3 along the Z curve."""
    cells = np.clip((points + 0.5) * 2**20, 0, 2**20 - 1).astype(np.int64)
    code = np.zeros(len(points), dtype=np.int64)
    for bit in range(20):
        for axis in range(3):
            code |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    return code


def _box_tree(low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """Return the boxes of a binary tree: node k has the children 2 k and 2 k + 1, leaf i is node size + i."""
    size = 1 << (len(low) - 1).bit_length()
    below, above = np.full((2 * size, 3), np.inf), np.full((2 * size, 3), -np.inf)
    below[size : size + len(low)], above[size : size + len(low)] = low, high
    level = size
    while level > 1:
        half = level // 2
        below[half:level] = np.minimum(below[level : 2 * level : 2], below[level + 1 : 2 * level : 2])
        above[half:level] = np.maximum(above[level : 2 * level : 2], above[level + 1 : 2 * level : 2])
        level = half
    return below, above


@kernel
def _count_crossings(triangles, faces, below, above, depth, hit):  # type: ignore[no-untyped-def]
    """Walk the tree for each triangle, test the later ones whose boxes overlap, mark those that cross."""
    size = len(below) // 2
    stack = np.empty(128, dtype=np.int64)
    count = 0
    for i in range(len(triangles)):
        low, high = below[size + i], above[size + i]
        stack[0] = 1
        top = 1
        while top > 0:
            top -= 1
            node = stack[top]
            apart = False
            for axis in range(3):
                if below[node, axis] > high[axis] or above[node, axis] < low[axis]:
                    apart = True
            if apart:
                continue
            if node < size:
                stack[top], stack[top + 1] = 2 * node, 2 * node + 1
                top += 2
            elif node - size > i:
                j = node - size
                if _shared(faces, i, j) < 2 and _is_crossing(triangles[i], triangles[j], depth):
                    count += 1
                    hit[i] = hit[j] = True
    return count


@kernel
def _shared(faces, i, j):  # type: ignore[no-untyped-def]
    """Count the corners that two triangles share."""
    count = 0
    for a in range(3):
        for b in range(3):
            count += faces[i, a] == faces[j, b]
    return count


@kernel
def _edge(triangle, k):  # type: ignore[no-untyped-def]
    """Edge k of a triangle."""
    m = (k + 1) % 3
    return (
        triangle[m, 0] - triangle[k, 0],
        triangle[m, 1] - triangle[k, 1],
        triangle[m, 2] - triangle[k, 2],
    )


@kernel
def _is_crossing(one, two, depth):  # type: ignore[no-untyped-def]
    """Return whether no direction separates two triangles but for the depth."""
    reach = 0.0
    for k in range(3):
        for axis in range(3):
            reach = max(reach, abs(two[k, axis] - one[0, axis]), abs(one[k, axis] - one[0, axis]))
    if _separates(_edge(one, 0), _edge(one, 1), one, two, depth, reach):
        return False
    if _separates(_edge(two, 0), _edge(two, 1), one, two, depth, reach):
        return False
    for p in range(3):
        for q in range(3):
            if _separates(_edge(one, p), _edge(two, q), one, two, depth, reach):
                return False
    return True


@kernel
def _separates(e, f, one, two, depth, reach):  # type: ignore[no-untyped-def]
    """Return whether two triangles overlap by no more than the depth along the product of two edges."""
    x, y, z = e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0]
    length = math.sqrt(x * x + y * y + z * z)
    spans = math.sqrt((e[0] * e[0] + e[1] * e[1] + e[2] * e[2]) * (f[0] * f[0] + f[1] * f[1] + f[2] * f[2]))
    # nearly parallel edges: rounding of their product would outweigh the depth
    if 1e-14 * spans * reach >= depth * length:
        return False
    low_one = high_one = 0.0
    low_two, high_two = math.inf, -math.inf
    for k in range(3):
        a = x * (one[k, 0] - one[0, 0]) + y * (one[k, 1] - one[0, 1]) + z * (one[k, 2] - one[0, 2])
        b = x * (two[k, 0] - one[0, 0]) + y * (two[k, 1] - one[0, 1]) + z * (two[k, 2] - one[0, 2])
        low_one, high_one = min(low_one, a), max(high_one, a)
        low_two, high_two = min(low_two, b), max(high_two, b)
    # how far one must be moved to leave the other
    return min(high_one - low_two, high_two - low_one) <= depth * length
