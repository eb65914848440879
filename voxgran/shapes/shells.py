"""Edges and shells of a triangle mesh: connectivity of faces and nesting of shells.

The nesting follows from the winding numbers of the other shells about a point of each shell.
"""

from typing import TypeAlias

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.kernels import kernel
from voxgran.lattice.label import components
from voxgran.shapes.winding import winding_numbers

#: volume, in units of area times diagonal of the bounding box, below which a shell counts as having none
FLAT = 1e-12
#: how far below a triangle a point of its shell is taken, in edges of a square of twice its area
BELOW = 1e-6

#: what `numbered_edges` returns
Edges: TypeAlias = tuple[Integers, Integers, Integers, Integers, Integers]


def half_edges(faces: Integers, vertex_count: int) -> tuple[Integers, Integers, Integers, Integers]:
    """Return start, end, number of the undirected edge, and uses of that edge for the 3 m half-edges."""
    return numbered_edges(faces, vertex_count)[:4]


def numbered_edges(faces: Integers, vertex_count: int) -> Edges:
    """Return what `half_edges` does, and the half-edges in the order of the numbers of their edges."""
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    return start, end, *_numbered(start, end, vertex_count)


@kernel
def _numbered(start, end, vertex_count):  # type: ignore[no-untyped-def]
    """Return number and uses of the undirected edge of each half-edge, and the half-edges in the order of the edges.

    They are sorted by their higher corner and then, stably, by the lower one: counting takes a tenth of the time of
    np.unique.
    """
    many = len(start)
    order, before = np.empty(many, dtype=np.int64), np.empty(many, dtype=np.int64)
    for k in range(many):
        order[k] = k
    for lower in range(2):
        first = np.zeros(vertex_count + 1, dtype=np.int64)
        for h in range(many):
            first[(min(start[h], end[h]) if lower else max(start[h], end[h])) + 1] += 1
        for v in range(vertex_count):
            first[v + 1] += first[v]
        for k in range(many):
            before[k] = order[k]
        for k in range(many):
            h = before[k]
            corner = min(start[h], end[h]) if lower else max(start[h], end[h])
            order[first[corner]] = h
            first[corner] += 1
    edge, uses, count = np.empty(many, dtype=np.int64), np.zeros(many, dtype=np.int64), 0
    for k in range(many):
        h, g = order[k], order[max(k - 1, 0)]
        count += min(start[h], end[h]) != min(start[g], end[g]) or max(start[h], end[h]) != max(start[g], end[g])
        edge[h] = count
        uses[count] += 1
    return edge, uses[: min(count + 1, many)], order


def without_unused(points: Floats, faces: Integers) -> tuple[Floats, Integers]:
    """Return a mesh without the points that no face has."""
    used = np.zeros(len(points), dtype=np.bool_)
    used[faces] = True
    return points[used], (np.cumsum(used) - 1)[faces]


def edge_faults(faces: Integers, vertex_count: int, edges: Edges | None = None) -> Integers:
    """Return the numbers of open edges, of non-manifold edges, and of edges with inconsistently oriented faces."""
    start, end, edge, uses, _ = edges or numbered_edges(faces, vertex_count)
    point = np.unique(edge[start == end])
    balance = np.bincount(edge, weights=np.sign(end - start), minlength=len(uses))
    unlike = (uses == 2) & (balance != 0)
    return np.array([(uses == 1).sum(), ((uses > 2).sum() + len(point)), unlike.sum()], dtype=np.int64)


def face_pairs(faces: Integers, vertex_count: int, edges: Edges | None = None) -> tuple[Integers, Integers, Integers]:
    """Return the two faces of each edge that has two, and whether their orientations disagree."""
    start, end, edge, uses, order = edges or numbered_edges(faces, vertex_count)
    chosen = order[(uses[edge[order]] == 2) & (start != end)[order]].reshape(-1, 2)
    unlike = (start[chosen[:, 0]] == start[chosen[:, 1]]).astype(np.int64)
    return chosen[:, 0] // 3, chosen[:, 1] // 3, unlike


def turned_faces(faces: Integers, vertex_count: int) -> Booleans | None:
    """Return the mask of the faces to flip for consistent orientation, the fewer in each patch; None if impossible."""
    one, two, unlike = face_pairs(faces, vertex_count)
    m = len(faces)
    # each face is in the graph twice, as given and flipped; consistently oriented neighbours are linked
    here = np.concatenate([one, one + m])
    there = np.concatenate([two + m * unlike, two + m * (1 - unlike)])
    label = components(2 * m, here, there)
    turned: Booleans = label[:m] > label[m:]
    if (label[:m] == label[m:]).any():
        return None
    _, index, sizes = np.unique(np.minimum(label[:m], label[m:]), return_inverse=True, return_counts=True)
    turned ^= (2 * np.bincount(index, weights=turned) > sizes)[index]
    return turned


def count_flipped(faces: Integers, vertex_count: int) -> int:
    """Return the number of faces to flip for a consistent orientation; at least 1 if that is impossible."""
    turned = turned_faces(faces, vertex_count)
    return 1 if turned is None else max(1, int(turned.sum()))


def count_apart(points: Floats, faces: Integers) -> int:
    """Return the number of shells whose bounding box lies in that of no other one."""
    label = shell_labels(points, faces)
    corners = points[faces]
    low = np.array([corners[label == k].min(axis=(0, 1)) for k in range(label.max() + 1)])
    high = np.array([corners[label == k].max(axis=(0, 1)) for k in range(label.max() + 1)])
    within = (low[:, None] >= low[None]).all(axis=2) & (high[:, None] <= high[None]).all(axis=2)
    return int((within.sum(axis=1) == 1).sum())


def shell_labels(points: Floats, faces: Integers, edges: Edges | None = None) -> Integers:
    """Return the number of the shell of each face; faces that share an edge lie in one shell."""
    one, two, _ = face_pairs(faces, len(points), edges)
    return components(len(faces), one, two)


def shell_counts(points: Floats, faces: Integers, edges: Edges) -> dict[str, int]:
    """Sort the shells of a closed surface, with the edges of its faces, into bodies, cavities and faults."""
    label = shell_labels(points, faces, edges)
    order = np.argsort(label, kind="stable")
    triangles = points.take(faces[order], axis=0)
    bounds = np.searchsorted(label[order], np.arange(label.max() + 2))
    a, b, c = np.moveaxis(triangles, 1, 0)
    normals = np.cross(b - a, c - a)
    middles = np.add.reduceat(a, bounds[:-1]) / np.diff(bounds)[:, None]
    sixfold = linear.einsum("fi,fi->f", a - np.repeat(middles, np.diff(bounds), axis=0), normals)
    volumes = np.add.reduceat(sixfold, bounds[:-1]) / 6
    areas = np.sqrt(linear.einsum("fi,fi->f", normals, normals)) / 2
    flat = np.abs(volumes) <= FLAT * np.add.reduceat(areas, bounds[:-1])
    solid = np.flatnonzero(~flat)
    around = np.zeros(len(volumes), dtype=np.int64)
    low, high = (f.reduceat(f(f(a, b), c), bounds[:-1]) for f in (np.minimum, np.maximum)) if len(solid) > 1 else (a, a)
    for s in solid.tolist() if len(solid) > 1 else []:
        largest = bounds[s] + int(areas[bounds[s] : bounds[s + 1]].argmax())
        point = inner_point(triangles[largest], float(volumes[s]))
        reached = solid[((low[solid] <= point) & (point <= high[solid])).all(axis=1)]
        around[s] = _surrounding(point, s, reached, triangles, bounds)
    inward = volumes[solid] < 0
    level = around[solid]
    return {
        "zero_volume": int(flat.sum()),
        "bodies": int((~inward & (level == 0)).sum()),
        "cavities": int((inward & (level == 1)).sum()),
        "outward_inner_shells": int((~inward & (level != 0)).sum()),
        "inside_out": int((inward & (level != 1)).sum()),
    }


def inner_point(corners: Floats, volume: float) -> Floats:
    """Return a point (3,) in a shell, just below one of its triangles (3, 3), by the sign of the volume of the shell.

    A point on the surface itself may lie on that of another shell, which touches this one.
    """
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    length = float(linear.norm(normal))
    depth = np.sign(volume) * BELOW * np.sqrt(length) / length if length > 0.0 else 0.0
    return np.asarray(corners.mean(axis=0) - depth * normal)


def _surrounding(point: Floats, own: int, shells: Integers, triangles: Floats, bounds: Integers) -> int:
    """Return the winding number of all other shells about a point of a shell."""
    total = 0.0
    for other in shells.tolist():
        if other != own:
            total += float(winding_numbers(triangles[bounds[other] : bounds[other + 1]], point[None])[0])
    return round(total)
