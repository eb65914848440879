"""KD-trees of point sets as flat arrays, and the one question that is asked of them: which of their points are near
each other?

The trees of all sets lie one after another in the same arrays. A tree is balanced and implicit: the points are sorted
so that node k of level l holds points ``k n >> l`` to ``(k + 1) n >> l``, and its children are nodes 2 k and 2 k + 1 of
the next level; so nothing is stored but the points and, for each node, a sphere that holds its points. Spheres stay
spheres under rotation: two sets in any relative pose are compared by walking both trees at once, and only parts that
are near each other are visited.

References
----------
Bentley 1975, Multidimensional binary search trees used for associative searching, Communications of the ACM 18(9),
509-517, doi:10.1145/361002.361007
"""

from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import Floats, Integers
from voxgran._base.errors import InputError
from voxgran._base.kernels import bare_kernel, inlined_kernel

#: points at most in a leaf
LEAF = 8
#: relative room by which spheres are made larger, so that rounding never hides a point
ROOM = 1e-12


#: a rotation matrix times a scale, a shift, and the scale: p of one frame lies at ``turn @ p + shift`` in another
Pose: TypeAlias = tuple[Floats, Floats, float]


class Trees(NamedTuple):
    """KD-trees of several point sets."""

    points: Floats  # (n, 3): points of all sets, each set in the order of its tree
    start: Integers  # (sets + 1,): where the points of each set begin
    spheres: Floats  # (nodes, 4): center and radius; node k of level l of a tree is entry 2**l - 1 + k
    first: Integers  # (sets + 1,): where the nodes of each set begin
    depth: Integers  # (sets,): level of the leaves


def make_trees(sets: Sequence[Floats]) -> Trees:
    """Return the trees of point sets (n, 3), each in its own frame.

    Raises
    ------
    InputError
        If a set has no points.
    """
    for k, points in enumerate(sets):
        if len(points) == 0:
            raise InputError(f"set {k} has 0 points: a tree needs at least 1; use a smaller spacing")
    count = np.array([len(points) for points in sets], dtype=np.int64)
    depth = np.array([max(0, int(np.ceil(libm.log2(n / LEAF)))) for n in count], dtype=np.int64)
    start = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
    first = np.concatenate([[0], np.cumsum(2 ** (depth + 1) - 1)]).astype(np.int64)
    joined = np.zeros((int(start[-1]), 3))
    spheres = np.zeros((int(first[-1]), 4))
    for k, points in enumerate(sets):
        ordered = np.array(points, dtype=np.float64)
        _build(ordered, int(depth[k]), spheres[first[k] : first[k + 1]])
        joined[start[k] : start[k + 1]] = ordered
    return Trees(joined, start, spheres, first, depth)


def stack_room(trees: Trees) -> int:
    """Return how many rows the stack of a walk over two of these trees needs."""
    return 2 * (int(trees.depth.max(initial=0)) + 2)


def _build(points: Floats, depth: int, spheres: Floats) -> None:
    """Sort points in place into the order of their tree, and fill in the spheres of the nodes."""
    n = len(points)
    for level in range(depth + 1):
        nodes = np.arange(2**level)
        begin, middle = (nodes * n) >> level, ((2 * nodes + 1) * n) >> (level + 1)
        kinds = np.column_stack((((nodes + 1) * n >> level) - begin, middle - begin))
        # nodes of a level have at most two numbers of points, and two of those in their first child: each kind at once
        for size, half in np.unique(kinds, axis=0):
            mine = np.flatnonzero((kinds == (size, half)).all(axis=1))
            rows = begin[mine, None] + np.arange(size)
            part = points[rows]
            low, high = part.min(axis=1), part.max(axis=1)
            center = (low + high) / 2
            radius = np.sqrt(((part - center[:, None]) ** 2).sum(axis=2).max(axis=1))
            spheres[2**level - 1 + mine] = np.column_stack((center, radius * (1 + ROOM)))
            if level < depth:
                along = np.take_along_axis(part, (high - low).argmax(axis=1)[:, None, None], axis=2)[:, :, 0]
                order = np.argsort(along, axis=1, kind="stable")
                points[rows] = np.take_along_axis(part, order[:, :, None], axis=1)


@bare_kernel
def list_near(
    trees: Trees, a: int, b: int, pose: Pose, low: float, high: float, stack: Integers, listed: Integers
) -> tuple[int, float]:
    """List the points of tree a, put into the frame of tree b, that are nearer than a distance to points of tree b.

    The pairs that are nearer than `high` go to the rows of `listed`; where they are too many, `high` is lowered. As
    soon as two points are nearer than `low`, the walk ends with these two in the first row. `stack` is scratch of
    `stack_room` rows of 2. Return how many rows were filled, -1 where two points are nearer than `low`, and the
    distance up to which the rows are complete.
    """
    (turn, shift, scale), spheres, first = pose, trees.spheres, trees.first
    leaves_a, leaves_b = (1 << trees.depth[a]) - 1, (1 << trees.depth[b]) - 1
    stack[0, 0], stack[0, 1], top = 0, 0, 1
    count = 0
    while top > 0:
        top -= 1
        na, nb = stack[top, 0], stack[top, 1]
        x, y, z = placed(spheres, first[a] + na, turn, shift)
        at = first[b] + nb
        dx, dy, dz = x - spheres[at, 0], y - spheres[at, 1], z - spheres[at, 2]
        reach = spheres[first[a] + na, 3] * scale + spheres[at, 3] + high
        if dx * dx + dy * dy + dz * dz >= reach * reach * (1.0 + ROOM):
            continue
        if na >= leaves_a and nb >= leaves_b:
            leaves = (na - leaves_a, nb - leaves_b)
            count, high = _list_leaves(trees, a, b, leaves, pose, low, high, listed, count)
            if count < 0:
                return -1, high
            continue
        wide_a = spheres[first[a] + na, 3] * scale > spheres[at, 3]
        split_a = nb >= leaves_b or (na < leaves_a and wide_a)
        for child in range(1, 3):
            stack[top, 0] = 2 * na + child if split_a else na
            stack[top, 1] = nb if split_a else 2 * nb + child
            top += 1
    return count, high


@inlined_kernel
def leaf_of(trees: Trees, a: int, k: int) -> tuple[int, int]:
    """Return the first point of leaf k of tree a, and the one after the last."""
    begin, level = trees.start[a], trees.depth[a]
    count = trees.start[a + 1] - begin
    return begin + ((k * count) >> level), begin + (((k + 1) * count) >> level)


@bare_kernel
def point_distance(points: Floats, i: int, j: int, turn: Floats, shift: Floats) -> float:
    """Return the distance of point i, turned and shifted, and point j."""
    x, y, z = placed(points, i, turn, shift)
    dx, dy, dz = x - points[j, 0], y - points[j, 1], z - points[j, 2]
    return float(np.sqrt(dx * dx + dy * dy + dz * dz))


@inlined_kernel
def placed(points: Floats, i: int, turn: Floats, shift: Floats) -> tuple[float, float, float]:
    """Return a point turned and shifted."""
    x, y, z = points[i, 0], points[i, 1], points[i, 2]
    return (
        turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z + shift[0],
        turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z + shift[1],
        turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z + shift[2],
    )


@bare_kernel
def _list_leaves(trees, a, b, leaves, pose, low, high, listed, count):  # type: ignore[no-untyped-def]
    """Add the near pairs of two leaves; return the count, -1 where a pair is too near, and the distance that is
    complete.
    """
    points, (turn, shift, _) = trees.points, pose
    begin_a, end_a = leaf_of(trees, a, leaves[0])
    begin_b, end_b = leaf_of(trees, b, leaves[1])
    for i in range(begin_a, end_a):
        x, y, z = placed(points, i, turn, shift)
        for j in range(begin_b, end_b):
            dx, dy, dz = x - points[j, 0], y - points[j, 1], z - points[j, 2]
            square = dx * dx + dy * dy + dz * dz
            if square < high * high:
                if square < low * low:
                    listed[0, 0], listed[0, 1] = i, j
                    return -1, high
                while count == len(listed):
                    high = low + 0.5 * (high - low)
                    count = keep_near(points, turn, shift, high, listed)
                if square < high * high:
                    listed[count, 0], listed[count, 1] = i, j
                    count += 1
    return count, high


@bare_kernel
def keep_near(points: Floats, turn: Floats, shift: Floats, high: float, listed: Integers) -> int:
    """Drop the rows of full `listed` that are not nearer than `high`; return how many are left."""
    count = 0
    for k in range(len(listed)):
        i, j = listed[k, 0], listed[k, 1]
        if point_distance(points, i, j, turn, shift) < high:
            listed[count, 0], listed[count, 1] = i, j
            count += 1
    return count
