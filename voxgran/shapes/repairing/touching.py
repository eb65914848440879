"""Surfaces that touch themselves along edges, as those of voxels do: parted there by doubled vertices."""

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran.lattice.cuberille import fans, with_middles
from voxgran.shapes.shells import half_edges

#: angles that differ by less are one, in radians
ALIKE = 1e-9


def parted(points: Floats, faces: Integers) -> tuple[Floats, Integers] | None:
    """Return a closed surface with the vertices doubled where more than two faces share an edge; None if unclear.

    Around such an edge, the faces that bound one wedge of the solid stay together. An edge gets a vertex in its middle
    for each of its wedges, so that no two edges have the same ends; no vertex is moved.
    """
    points, faces = with_middles(points, faces, np.zeros(len(faces), dtype=np.int64))
    start, end, edge, uses = half_edges(faces, len(points))
    if (uses % 2).any() or (np.bincount(edge, weights=np.sign(end - start)) != 0).any() or (start == end).any():
        return None
    angle, crowded = np.zeros(len(edge)), np.flatnonzero(uses[edge] > 2)
    opposite = faces[crowded // 3, (crowded % 3 + 2) % 3]
    low, high = (f(start, end)[crowded] for f in (np.minimum, np.maximum))
    angle[crowded] = _angles(points[high] - points[low], points[opposite] - points[low])
    # of two faces that lie on each other, those of solids that touch there, the one that closes a solid comes first
    place = np.rint(angle / ALIKE).astype(np.int64) % round(2 * np.pi / ALIKE)
    order = np.lexsort((start > end, place, edge))
    # the solid lies between a face that goes along the edge downward and the next one, which goes upward
    first = np.searchsorted(edge[order], np.arange(len(uses)))
    down = start[order] > end[order]
    place = np.arange(len(order)) - first[edge[order]]
    following = first[edge[order]] + (place + 1) % uses[edge[order]]
    if (down == down[following]).any():
        return None
    vertex = fans(faces, order[down], order[following[down]])
    original = np.zeros(int(vertex.max()) + 1, dtype=np.int64)
    original[vertex] = faces.ravel()
    return points[original], vertex.reshape(-1, 3)


def _angles(along: Floats, away: Floats) -> Floats:
    """Return the angles of vectors (n, 3) about axes (n, 3), from a zero that depends on the axis only."""
    length = np.linalg.norm(along, axis=1, keepdims=True)
    # two vertices may lie at one place
    along = along / np.where(length > 0.0, length, 1.0)
    first = np.cross(along, np.eye(3)[np.abs(along).argmin(axis=1)])
    second = np.cross(along, first)
    return np.asarray(np.arctan2(np.einsum("ni,ni->n", away, second), np.einsum("ni,ni->n", away, first)))
