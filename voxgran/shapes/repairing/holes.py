"""Holes of a triangle mesh: the loops of its open edges, and triangles that close them.

A loop is closed by the triangulation of least area among all that add no vertex (Liepa 2003, Filling holes in meshes,
doi:10.2312/SGP/SGP03/200-206), and one of many edges by triangles to its middle.
"""

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers
from voxgran.shapes.shells import half_edges

#: loops of more edges are closed from their middle: the search takes the third power of the edges
MOST_EDGES = 300


def hole_loops(faces: Integers, vertex_count: int) -> list[Integers]:
    """Return the loops of open edges as rings of vertices (k,), each in the order that its new faces have.

    A ring that passes a vertex twice is cut there; paths that are not closed are left out.
    """
    start, end, edge, uses = half_edges(faces, vertex_count)
    open_ = uses[edge] == 1
    onward: dict[int, list[int]] = {}
    # the new face runs along the edge the other way
    for a, b in zip(end[open_].tolist(), start[open_].tolist(), strict=True):
        onward.setdefault(a, []).append(b)
    loops = []
    for first in sorted(onward):
        while onward[first]:
            loops += _walk(onward, first)
    return [np.array(loop, dtype=np.int64) for loop in loops]


def _walk(onward: dict[int, list[int]], first: int) -> list[list[int]]:
    """Follow open edges until they end, and return the simple rings on the way."""
    path, place, rings = [first], {first: 0}, []
    while onward.get(path[-1]):
        vertex = onward[path[-1]].pop()
        if vertex in place:
            ring = path[place[vertex] :]
            rings.append(ring)
            for left in ring[1:]:
                del place[left]
            del path[place[vertex] + 1 :]
        else:
            place[vertex] = len(path)
            path.append(vertex)
    return [ring for ring in rings if len(ring) > 2]


def extent(points: Floats, loop: Integers) -> float:
    """Return how wide a hole is: the longest side of the box around its corners along their own axes."""
    corners = points[loop] - points[loop].mean(axis=0)
    axes = linear.svd(corners)[2]
    return float(np.ptp(linear.matmul(corners, axes.T), axis=0).max())


def closed_loop(points: Floats, faces: Integers, loop: Integers) -> tuple[Floats, Integers]:
    """Return new vertices, (0 or 1, 3), and the triangles that close a ring of vertices.

    No edge of the mesh is used again.
    """
    found = _least_area(points[loop], _taken(faces, loop, len(points))) if len(loop) <= MOST_EDGES else None
    if found is not None:
        return np.zeros((0, 3)), loop[found]
    middle = np.full(len(loop), len(points))
    return points[loop].mean(axis=0)[None], np.column_stack([loop, np.roll(loop, -1), middle])


def _taken(faces: Integers, loop: Integers, vertex_count: int) -> np.ndarray[tuple[int, int], np.dtype[np.bool_]]:
    """Tell for each pair of corners of a loop whether the mesh has that edge already."""
    near = faces[np.isin(faces, loop).sum(axis=1) >= 2]
    start, end, _, _ = half_edges(near, vertex_count)
    keys = np.unique(np.minimum(start, end) * np.int64(vertex_count) + np.maximum(start, end))
    one, two = np.minimum.outer(loop, loop), np.maximum.outer(loop, loop)
    return np.isin(one * np.int64(vertex_count) + two, keys)


def _least_area(ring: Floats, taken: np.ndarray[tuple[int, int], np.dtype[np.bool_]]) -> Integers | None:
    """Return the triangles of least area in a ring that has none of the taken diagonals; None where there are none."""
    count = len(ring)
    cost = np.full((count, count), np.inf)
    split = np.zeros((count, count), dtype=np.int64)
    steps = np.arange(count - 1)
    cost[steps, steps + 1] = 0.0
    for span in range(2, count):
        for i in range(count - span):
            k = i + span
            if taken[i, k] and span < count - 1:
                continue
            j = np.arange(i + 1, k)
            area = linear.norm(np.cross(ring[j] - ring[i], ring[k] - ring[i]), axis=1) / 2
            total = cost[i, j] + cost[j, k] + area
            best = int(total.argmin())
            cost[i, k], split[i, k] = total[best], i + 1 + best
    if not np.isfinite(cost[0, count - 1]):
        return None
    triangles, spans = [], [(0, count - 1)]
    while spans:
        first, last = spans.pop()
        if last - first < 2:
            continue
        between = int(split[first, last])
        triangles.append((first, between, last))
        spans += [(first, between), (between, last)]
    return np.array(triangles, dtype=np.int64)
