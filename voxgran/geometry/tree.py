"""Trees of boxes over the triangles of a surface, for nearest points and signed distances.

The tree is a heap of axis-aligned boxes: node k has the children 2 k + 1 and 2 k + 2, each with half of its triangles,
split at the median along the longest axis. The sign of a distance is that of the pseudo-normal of the nearest feature
(face, edge or vertex), which is exact for closed surfaces (Baerentzen & Aanaes 2005,
doi:10.1109/TVCG.2005.49); no ray is shot and no angle is summed.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers, read_only
from voxgran._base.compiling.threads import in_blocks
from voxgran._base.kernels import bare_kernel, inlined_kernel, kernel
from voxgran.geometry.triangles import closest_on_triangle
from voxgran.geometry.vectors import Vector, corner_of, cross, dot, sub

#: triangles in a leaf, at most
LEAF = 4
#: boxes that wait in a search, at most
STACK = 64
#: pairs of surfaces from which on turned boxes are worth making: they take as long as some ten searches
TURNED = 16
#: points of which a thread takes no fewer
LEAST_POINTS = 512


class TreeArrays(NamedTuple):
    """A tree of boxes over triangles as kernels take it: arrays of :class:`TriangleTree`."""

    corners: Floats
    low: Floats
    high: Floats
    start: Integers
    normals: Floats


@dataclass(frozen=True, eq=False)
class TriangleTree:
    """A tree of boxes over triangles."""

    corners: Floats  # (m, 3, 3) triangles in the order of the tree
    normals: Floats  # (m, 7, 3) pseudo-normals of face, edges ab, bc, ca and corners a, b, c; of any length
    low: Floats  # (k, 3) lower corners of the boxes, the whole first
    high: Floats  # (k, 3) upper corners
    start: Integers  # (k, 2) first triangle of each box and the one after its last
    face: Integers  # (m,) number of each triangle in the mesh

    @property
    def arrays(self) -> TreeArrays:
        """Corners, boxes and normals, as kernels take them."""
        return TreeArrays(self.corners, self.low, self.high, self.start, self.normals)

    @cached_property
    def boxes(self) -> Floats:
        """Boxes (k, 5, 3) of the nodes that are turned with their triangles; see :func:`turned_boxes`."""
        return turned_boxes(self.corners, self.start)

    @cached_property
    def straight_boxes(self) -> Floats:
        """Boxes (k, 5, 3) of the nodes along the coordinates, in the form of those that are turned."""
        middle, half = (self.low + self.high)[:, None] / 2, (self.high - self.low)[:, None] / 2
        return read_only(np.concatenate([middle, np.tile(np.eye(3), (len(half), 1, 1)), half], axis=1))

    def boxes_for(self, pairs: int) -> Floats:
        """Return turned boxes where so many searches are worth making them, else those along the coordinates.

        Which they are decides between points that are equally near: it must not depend on what was computed before.
        """
        return self.boxes if pairs >= TURNED else self.straight_boxes

    @property
    def size(self) -> float:
        """Diagonal of the box around all."""
        return float(linear.norm(self.high[0] - self.low[0]))

    def nearest(self, points: Floats, *, reach: float = math.inf) -> tuple[Floats, Floats, Integers]:
        """Return for (n, 3) points the distances from the surface, negative inside, nearest points and triangles of the
        tree.

        Beyond `reach` the distance is infinite, the nearest point is the point itself and the triangle is -1.
        """
        queries = np.ascontiguousarray(points, dtype=np.float64)
        distance = np.full(len(queries), np.inf)
        found, triangle = queries.copy(), np.full(len(queries), -1, dtype=np.int64)
        arguments = queries, self.arrays, float(reach), distance, found, triangle
        in_blocks(_find_nearest, len(queries), *arguments, least=LEAST_POINTS)
        return distance, found, triangle

    def signed_distance(self, points: Floats) -> Floats:
        """Return the distance of (n, 3) points from the surface, negative inside."""
        return self.nearest(points)[0]


def grow_tree(vertices: Floats, faces: Integers) -> TriangleTree:
    """Return the tree of a closed mesh whose coincident vertices are merged and whose triangles are outward."""
    corners = np.ascontiguousarray(vertices[faces], dtype=np.float64)
    count = len(corners)
    depth = max(0, math.ceil(math.log2(max(count, 1) / LEAF)))
    middles = corners.mean(axis=1)
    order = np.arange(count)
    rank = np.column_stack([np.unique(along, return_inverse=True)[1] for along in middles.T])
    _sort_into_boxes(middles, rank, depth, order)
    ordered = corners[order]
    a, b, c = np.moveaxis(ordered, 1, 0)
    edges = (count * np.arange(2**depth + 1)) >> depth
    starts = [np.column_stack([edges[:-1], edges[1:]])]
    lows = [np.minimum.reduceat(np.minimum(np.minimum(a, b), c), edges[:-1])]
    highs = [np.maximum.reduceat(np.maximum(np.maximum(a, b), c), edges[:-1])]
    for _ in range(depth):
        # a box is that of its two halves
        starts.append(starts[-1].reshape(-1, 4)[:, [0, 3]])
        lows.append(np.minimum(lows[-1][0::2], lows[-1][1::2]))
        highs.append(np.maximum(highs[-1][0::2], highs[-1][1::2]))
    arrays = (
        *(ordered, _pseudo_normals(corners, faces)[order]),
        *(np.concatenate(levels[::-1]) for levels in (lows, highs, starts)),
        order,
    )
    return TriangleTree(*(read_only(array) for array in arrays))


def turned_boxes(corners: Floats, start: Integers) -> Floats:
    """Return the middles, the three axes and half of the edges, as rows (k, 5, 3), of boxes around ranges of triangles.

    The axes are those of the second moments of the corners, or those of the coordinates where the surface of the box is
    no larger. The ranges (k, 2) are the levels of a tree, each with all triangles.
    """
    origin = corners.reshape(-1, 3).mean(axis=0)
    points, straight = corners - origin, np.eye(3)
    moments, sums = linear.einsum("mci,mcj->mij", points, points), points.sum(axis=1)
    found = []
    for first, last in ((2**level - 1, 2 ** (level + 1) - 1) for level in range(len(start).bit_length())):
        begin, count = start[first:last, 0], np.diff(start[first:last], axis=1)[:, 0]
        mean = np.add.reduceat(sums, begin) / (3 * count[:, None])
        spread = np.add.reduceat(moments, begin) / (3 * count[:, None, None])
        axes = linear.eigh(spread - mean[:, :, None] * mean[:, None, :])[1].transpose(0, 2, 1)
        turned = _extents(points, axes, begin, count)
        plain = _extents(points, np.broadcast_to(straight, axes.shape), begin, count)
        better = _box_surface(turned[1] - turned[0]) < _box_surface(plain[1] - plain[0])
        axes = np.where(better[:, None, None], axes, straight)
        low, high = (np.where(better[:, None], one, other) for one, other in zip(turned, plain, strict=True))
        middle = linear.einsum("ki,kij->kj", (low + high) / 2, axes) + origin
        found.append(np.concatenate([middle[:, None], axes, (high - low)[:, None] / 2], axis=1))
    return read_only(np.concatenate(found))


def _extents(points: Floats, axes: Floats, begin: Integers, count: Integers) -> tuple[Floats, Floats]:
    """Return the lowest and highest coordinates (k, 3) along the axes (k, 3, 3) of ranges of triangles (m, 3, 3)."""
    along = linear.matmul(points, np.repeat(axes, count, axis=0).transpose(0, 2, 1))
    return np.minimum.reduceat(along.min(axis=1), begin), np.maximum.reduceat(along.max(axis=1), begin)


def _box_surface(edges: Floats) -> Floats:
    """Return half the surface areas (k,) of boxes with edges (k, 3)."""
    return np.asarray((edges * np.roll(edges, 1, axis=1)).sum(axis=1))


def _pseudo_normals(corners: Floats, faces: Integers) -> Floats:
    """Return the (m, 7, 3) pseudo-normals: of a face, its edges (sum of both faces), its corners (by angle)."""
    found = np.empty((len(faces), 7, 3))
    # a closed surface has 3 edges for 2 triangles, which fill a third of the table at most
    size = 1 << (4 * len(faces)).bit_length()
    _sum_normals(corners, faces, np.full((size, 2), -1), np.zeros((int(faces.max(initial=-1)) + 1, 3)), found)
    return found


@kernel
def _sum_normals(corners, faces, ends, of_corners, found):  # type: ignore[no-untyped-def]
    """Write the unit normals of triangles, and the sums of them over edges and, times their angles, over corners.

    ends: table (n,) of edges, which are looked for from a place that follows from their corners; n is a power of two.
    """
    edge, of_edges = np.empty(faces.shape, np.int64), np.zeros((len(ends), 3))
    for t in range(len(faces)):
        for k in range(3):
            at, one, two = (
                corner_of(corners, t, k),
                corner_of(corners, t, (k + 1) % 3),
                corner_of(corners, t, (k + 2) % 3),
            )
            one, two = sub(one, at), sub(two, at)
            turn = cross(one, two)
            sine = math.sqrt(dot(turn, turn))
            if k == 0:
                length = sine if sine > 0.0 else 1.0
                normal = (turn[0] / length, turn[1] / length, turn[2] / length)
            angle = math.atan2(sine, dot(one, two))
            a, b = faces[t, k], faces[t, (k + 1) % 3]
            a, b = min(a, b), max(a, b)
            place = (a * 73856093 + b * 19349663) & (len(ends) - 1)
            while ends[place, 0] >= 0 and (ends[place, 0] != a or ends[place, 1] != b):
                place = (place + 1) & (len(ends) - 1)
            ends[place, 0], ends[place, 1], edge[t, k] = a, b, place
            for axis in range(3):
                found[t, 0, axis] = normal[axis]
                of_edges[edge[t, k], axis] += normal[axis]
                of_corners[faces[t, k], axis] += angle * normal[axis]
    for t in range(len(faces)):
        for k in range(3):
            for axis in range(3):
                found[t, 1 + k, axis] = of_edges[edge[t, k], axis]
                found[t, 4 + k, axis] = of_corners[faces[t, k], axis]


@kernel
def _sort_into_boxes(middles, rank, depth, order):  # type: ignore[no-untyped-def]
    """Order triangles so that those of each box follow each other; boxes are halved along their longest axis.

    middles, rank: (m, 3) places of the triangles, and their numbers in the order of each coordinate.
    """
    count = len(order)
    box, key, spare = np.empty(count, np.int64), np.empty(count, np.int64), np.empty(count, np.int64)
    for level in range(depth):
        for k in range(1 << level):
            first, last = count * k >> level, count * (k + 1) >> level
            widest, longest = -1.0, 0
            for axis in range(3):
                low, high = math.inf, -math.inf
                for e in order[first:last]:
                    low, high = min(low, middles[e, axis]), max(high, middles[e, axis])
                if high - low > widest:
                    widest, longest = high - low, axis
            for e in order[first:last]:
                box[e], key[e] = k, rank[e, longest]
        # by the coordinate, then by the box; equal ones stay as they were
        begin = np.zeros(count + 1, np.int64)
        for e in order:
            begin[key[e] + 1] += 1
        begin = np.cumsum(begin)
        for e in order:
            spare[begin[key[e]]] = e
            begin[key[e]] += 1
        begin = count * np.arange(1 << level) >> level
        for e in spare:
            order[begin[box[e]]] = e
            begin[box[e]] += 1


@bare_kernel
def square_to_box(low: Floats, high: Floats, k: int, x: float, y: float, z: float) -> float:
    """Return the squared distance of (x, y, z) from box k; 0 inside."""
    dx = max(low[k, 0] - x, 0.0, x - high[k, 0])
    dy = max(low[k, 1] - y, 0.0, y - high[k, 1])
    dz = max(low[k, 2] - z, 0.0, z - high[k, 2])
    return dx * dx + dy * dy + dz * dz


@inlined_kernel
def push_halves(low: Floats, high: Floats, k: int, x: float, y: float, z: float, stack: Integers, depth: int) -> None:
    """Put the halves of box k on a stack, the one nearer to (x, y, z) on top, which is looked at first."""
    left = 2 * k + 1
    one, two = square_to_box(low, high, left, x, y, z), square_to_box(low, high, left + 1, x, y, z)
    stack[depth], stack[depth + 1] = (left + 1, left) if one <= two else (left, left + 1)


@kernel
def nearest_triangle(
    tree: TreeArrays, x: float, y: float, z: float, reach: float
) -> tuple[float, int, int, float, float, float]:
    """Return squared distance, triangle, feature and point nearest to (x, y, z); triangle -1 beyond `reach`."""
    stack = np.zeros(STACK, dtype=np.int64)
    return search_triangles(tree.corners, tree.low, tree.high, tree.start, x, y, z, reach, stack)


@bare_kernel
def search_triangles(
    corners: Floats,
    low: Floats,
    high: Floats,
    start: Integers,
    x: float,
    y: float,
    z: float,
    reach: float,
    stack: Integers,
) -> tuple[float, int, int, float, float, float]:
    """Return what `nearest_triangle` does, for kernels that make no arrays: `stack` holds boxes that wait."""
    best, found, feature = reach * reach, -1, 0
    qx, qy, qz = x, y, z
    stack[0], depth, leaves = 0, 1, len(low) // 2
    while depth > 0:
        depth -= 1
        node = stack[depth]
        near = square_to_box(low, high, node, x, y, z)
        while near <= best and node < leaves:
            # the nearer half at once, the other one later
            left = 2 * node + 1
            one, two = square_to_box(low, high, left, x, y, z), square_to_box(low, high, left + 1, x, y, z)
            node, stack[depth] = (left, left + 1) if one <= two else (left + 1, left)
            near = min(one, two)
            depth += 1 if max(one, two) <= best else 0
        if near > best:
            continue
        for k in range(start[node, 0], start[node, 1]):
            px, py, pz, part = closest_on_triangle(corners, k, x, y, z)
            square = (px - x) ** 2 + (py - y) ** 2 + (pz - z) ** 2
            if square < best or (found < 0 and square == best):
                best, found, feature = square, k, part
                qx, qy, qz = px, py, pz
    return best, found, feature, qx, qy, qz


@bare_kernel
def is_behind(normals: Floats, k: int, feature: int, dx: float, dy: float, dz: float) -> bool:
    """Return whether the step from a feature of triangle k leads into the solid."""
    side = normals[k, feature, 0] * dx + normals[k, feature, 1] * dy + normals[k, feature, 2] * dz
    return side < 0.0


@bare_kernel
def encloses(
    corners: Floats, normals: Floats, low: Floats, high: Floats, start: Integers, place: Vector, stack: Integers
) -> bool:
    """Return whether the triangles of a tree enclose a point; `stack` holds boxes that wait."""
    x, y, z = place
    if x < low[0, 0] or y < low[0, 1] or z < low[0, 2] or x > high[0, 0] or y > high[0, 1] or z > high[0, 2]:
        return False
    _, k, feature, px, py, pz = search_triangles(corners, low, high, start, x, y, z, 1e100, stack)
    return is_behind(normals, k, feature, x - px, y - py, z - pz)


@kernel
def _find_nearest(points, tree, reach, distance, nearest, triangle, first, stop):  # type: ignore[no-untyped-def]
    """Write signed distance, nearest point and triangle of each point of a block."""
    stack, k = np.zeros(STACK, dtype=np.int64), -1
    for p in range(first, stop):
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        bound = reach
        if k >= 0:
            # points come in order, mostly: what was nearest to the one before is near to the next
            qx, qy, qz, _ = closest_on_triangle(tree.corners, k, x, y, z)
            bound = min(reach, 1.000001 * math.sqrt((qx - x) ** 2 + (qy - y) ** 2 + (qz - z) ** 2))
        square, k, feature, qx, qy, qz = search_triangles(
            tree.corners, tree.low, tree.high, tree.start, x, y, z, bound, stack
        )
        if k < 0:
            continue
        inside = is_behind(tree.normals, k, feature, x - qx, y - qy, z - qz)
        distance[p] = -math.sqrt(square) if inside else math.sqrt(square)
        nearest[p, 0], nearest[p, 1], nearest[p, 2] = qx, qy, qz
        triangle[p] = k
