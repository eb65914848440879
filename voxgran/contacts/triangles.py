"""Nearest points of two surfaces with box trees."""

import math

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel, kernel
from voxgran.geometry.tree import TreeArrays, TriangleTree
from voxgran.geometry.triangles import box_gap, plane_gap, triangle_distance

#: corners, start and boxes of a tree that have axes of their own, as kernels take them
BoxedArrays = tuple[Floats, Integers, Floats]
#: by how much a bound must exceed the best distance, relative to it and to the sizes, so that rounding drops no pair
RELATIVE, ABSOLUTE = 1e-9, 1e-13


def nearest_points(
    one: TriangleTree, other: TriangleTree, *, matrix: Floats, offset: Floats, reach: float = math.inf
) -> tuple[float, Floats, Floats]:
    """Return the distance of two surfaces and the nearest point of each, in the frame and unit of `one`.

    The distance is 0 if the surfaces meet, infinite if nothing is within `reach`.
    """
    found = np.zeros(6)
    turn, place = np.ascontiguousarray(matrix), np.ascontiguousarray(offset)
    square = find_nearest_pair(boxed_arrays(one), boxed_arrays(other), turn, place, float(reach), found)
    return math.sqrt(square), found[:3], found[3:]


def boxed_arrays(tree: TriangleTree, pairs: int = 1) -> BoxedArrays:
    """Return triangles and boxes of a tree, as kernels take them for so many pairs of surfaces."""
    return tree.corners, tree.start, tree.boxes_for(pairs)


@bare_kernel
def pair_bound(
    one: TreeArrays, a: int, other: TreeArrays, b: int, matrix: Floats, size: Floats, offset: Floats
) -> float:
    """Return a lower bound of the squared distance of box a from the contents of box b."""
    low, high, other_low, other_high = one.low, one.high, other.low, other.high
    bound = 0.0
    for i in range(3):
        center, half = offset[i], 0.0
        for j in range(3):
            center += matrix[i, j] * 0.5 * (other_low[b, j] + other_high[b, j])
            half += size[i, j] * 0.5 * (other_high[b, j] - other_low[b, j])
        gap = max(low[a, i] - center - half, center - half - high[a, i], 0.0)
        bound += gap * gap
    return bound


@kernel
def find_nearest_pair(
    one: BoxedArrays, other: BoxedArrays, matrix: Floats, offset: Floats, reach: float, found: Floats
) -> float:
    """Traverse both trees, closer boxes first; write both points and return the squared distance."""
    corners, start, boxes = one
    other_corners, other_start, other_boxes = other
    factor = math.sqrt(matrix[0, 0] ** 2 + matrix[1, 0] ** 2 + matrix[2, 0] ** 2)
    slack = 0.0
    for i in range(3):
        slack += ABSOLUTE * (boxes[0, 4, i] + factor * other_boxes[0, 4, i] + abs(offset[i]))
    best, hit = reach * reach, False
    bar = _raised(best, slack)
    leaves, other_leaves = len(boxes) // 2, len(other_boxes) // 2
    stack, bounds = np.zeros((256, 2), dtype=np.int64), np.zeros(256)
    turned, points, apart, depth = np.zeros((16, 3, 3)), np.zeros(6), np.zeros(2), 1
    while depth > 0:
        depth -= 1
        a, b = stack[depth, 0], stack[depth, 1]
        if bounds[depth] > bar:
            continue
        if a >= leaves and b >= other_leaves:
            turn_triangles(other_corners, other_start[b, 0], other_start[b, 1], matrix, offset, turned)
            for i in range(start[a, 0], start[a, 1]):
                for j in range(other_start[b, 1] - other_start[b, 0]):
                    if box_gap(corners, i, turned, j) > bar or plane_gap(corners, i, turned, j) > bar:
                        continue
                    if plane_gap(turned, j, corners, i) > bar:
                        continue
                    square = triangle_distance(corners, i, turned, j, points)
                    if square < best or (not hit and square == best):
                        best, hit = square, True
                        bar = _raised(best, slack)
                        for k in range(6):
                            found[k] = points[k]
            if best == 0.0 and hit:
                return 0.0
            continue
        wide = 0.0
        for i in range(3):
            wide += boxes[a, 4, i] - factor * other_boxes[b, 4, i]
        split_one = a < leaves and (wide >= 0.0 or b >= other_leaves)
        for side in range(2):
            c = 2 * a + 1 + side if split_one else a
            d = b if split_one else 2 * b + 1 + side
            stack[depth + side, 0], stack[depth + side, 1] = c, d
            bounds[depth + side], apart[side] = turned_bound(boxes, c, other_boxes, d, matrix, factor, offset)
        nearer = bounds[depth] < bounds[depth + 1]
        # of boxes that overlap both, the one with the nearer middle has the nearer triangles more often
        if nearer or (bounds[depth] == bounds[depth + 1] and apart[0] < apart[1]):
            for k in range(2):
                stack[depth, k], stack[depth + 1, k] = stack[depth + 1, k], stack[depth, k]
            bounds[depth], bounds[depth + 1] = bounds[depth + 1], bounds[depth]
        depth += 2
    return best if hit else np.inf


@bare_kernel
def _raised(best: float, slack: float) -> float:
    """Return the squared bound beyond which rounding hides no pair that is nearer than the best."""
    return (math.sqrt(best) * (1.0 + RELATIVE) + slack) ** 2


@bare_kernel
def turned_bound(
    one: Floats, a: int, other: Floats, b: int, matrix: Floats, factor: float, offset: Floats
) -> tuple[float, float]:
    """Return a lower bound of the squared distance of two turned boxes, and the squared distance of their middles.

    It is the larger one of the distances of each box from the box along its axes around the other.
    """
    # vector between the middles, and below the axes of the other box, each as long as the factor
    tx, ty, tz = offset[0] - one[a, 0, 0], offset[1] - one[a, 0, 1], offset[2] - one[a, 0, 2]
    x, y, z = other[b, 0, 0], other[b, 0, 1], other[b, 0, 2]
    tx += matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] * z
    ty += matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] * z
    tz += matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * z
    gx = abs(one[a, 1, 0] * tx + one[a, 1, 1] * ty + one[a, 1, 2] * tz) - one[a, 4, 0]
    gy = abs(one[a, 2, 0] * tx + one[a, 2, 1] * ty + one[a, 2, 2] * tz) - one[a, 4, 1]
    gz = abs(one[a, 3, 0] * tx + one[a, 3, 1] * ty + one[a, 3, 2] * tz) - one[a, 4, 2]
    bound = 0.0
    for j in range(3):
        x, y, z, wide = other[b, 1 + j, 0], other[b, 1 + j, 1], other[b, 1 + j, 2], other[b, 4, j]
        ux = matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] * z
        uy = matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] * z
        uz = matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * z
        rx = abs(one[a, 1, 0] * ux + one[a, 1, 1] * uy + one[a, 1, 2] * uz)
        ry = abs(one[a, 2, 0] * ux + one[a, 2, 1] * uy + one[a, 2, 2] * uz)
        rz = abs(one[a, 3, 0] * ux + one[a, 3, 1] * uy + one[a, 3, 2] * uz)
        gx, gy, gz = gx - rx * wide, gy - ry * wide, gz - rz * wide
        near = rx * one[a, 4, 0] + ry * one[a, 4, 1] + rz * one[a, 4, 2]
        gap = max((abs(ux * tx + uy * ty + uz * tz) - near) / factor - factor * wide, 0.0)
        bound += gap * gap
    gx, gy, gz = max(gx, 0.0), max(gy, 0.0), max(gz, 0.0)
    return max(bound, gx * gx + gy * gy + gz * gz), tx * tx + ty * ty + tz * tz


@bare_kernel
def turn_triangles(corners: Floats, first: int, last: int, matrix: Floats, offset: Floats, turned: Floats) -> None:
    """Write the triangles first ... last in the frame of the other surface."""
    for k in range(first, last):
        for c in range(3):
            for i in range(3):
                turned[k - first, c, i] = (
                    matrix[i, 0] * corners[k, c, 0]
                    + matrix[i, 1] * corners[k, c, 1]
                    + matrix[i, 2] * corners[k, c, 2]
                    + offset[i]
                )
