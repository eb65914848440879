"""Voxel surface: the outer faces of voxels, each as two triangles (cuberille, Herman & Liu 1979).

Voxels that share only an edge or a corner would give edges with four faces. The surface is split there, so that each
voxel keeps its own faces: vertices on such edges and corners are doubled. None is displaced, since neighbours that
occupy the voxels beside such an edge would overlap, and the volume would not be that of the voxels.

References
----------
Herman & Liu 1979, Three-dimensional display of human organs from computed tomograms, Computer Graphics and Image
Processing 9(1), 1-21, doi:10.1016/0146-664X(79)90079-0
"""

import numpy as np

from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran.lattice.label import components


def voxel_surface(mask: Booleans) -> tuple[Floats, Integers]:
    """Return vertices (n, 3) and triangles (m, 3) of the surface of an (nx, ny, nz) mask with at least one occupied
    voxel.

    Voxel (i, j, k) is the cube from (i, j, k) to (i + 1, j + 1, k + 1); vertices are corners of voxels, and middles of
    edges that two voxels of the mask share without a common face. There vertices coincide. Triangles are outward, those
    of cavities inward. Each edge has two faces, and voxels without a common face are not connected.
    """
    faces, owner = _outer_faces(mask)
    corner = np.unique(faces)
    at = np.column_stack(np.unravel_index(corner, np.array(mask.shape) + 1)).astype(np.float64)
    faces = np.searchsorted(corner, faces)
    at, faces = with_middles(at, faces, owner)
    vertex = fans(faces, *edge_sides(faces))
    original = np.zeros(int(vertex.max()) + 1, dtype=np.int64)
    original[vertex] = faces.ravel()
    return at[original], vertex.reshape(-1, 3)


def _outer_faces(mask: Booleans) -> tuple[Integers, Integers]:
    """Return the triangles of the outer faces, by numbers of lattice corners, and the voxel that each belongs to."""
    corners = np.array(mask.shape) + 1
    steps = np.array([corners[1] * corners[2], corners[2], 1])
    around = np.pad(mask, 1)
    faces, owners = [], []
    for axis in range(3):
        one, two = steps[(axis + 1) % 3], steps[(axis + 2) % 3]
        for side in (0, 1):
            beside = np.roll(around, 1 - 2 * side, axis)[1:-1, 1:-1, 1:-1]
            place = np.nonzero(mask & ~beside)
            first = np.ravel_multi_index(place, tuple(corners)) + side * steps[axis]
            ring = np.column_stack([first, first + one, first + one + two, first + two])
            turned = ring if side else ring[:, [0, 3, 2, 1]]
            # the diagonal of a face is the same from both sides
            faces += [turned[:, [0, 1, 2]], turned[:, [0, 2, 3]]]
            owners += [np.ravel_multi_index(place, mask.shape)] * 2
    return np.concatenate(faces).astype(np.int64), np.concatenate(owners).astype(np.int64)


def with_middles(at: Floats, faces: Integers, owner: Integers) -> tuple[Floats, Integers]:
    """Return vertices and faces with a vertex of each owner of its faces on every edge of more than two faces."""
    many = len(at)
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1), axis=-1)
    edges, count = np.unique(ends[..., 0] * many + ends[..., 1], return_counts=True)
    crowded = edges[count > 2]
    keys = np.zeros(0, dtype=np.int64)
    for _ in range(3 if len(crowded) else 0):
        # at most three edges of a triangle, one at a time
        low, high = np.minimum(faces, np.roll(faces, -1, axis=1)), np.maximum(faces, np.roll(faces, -1, axis=1))
        edge = np.where(high < many, low * many + high, -1)
        wrong = np.isin(edge, crowded)
        split = np.flatnonzero(wrong.any(axis=1))
        if not len(split):
            break
        slot = wrong[split].argmax(axis=1)
        p, q, r = (faces[split, (slot + k) % 3] for k in range(3))
        # an edge and the voxel whose part it is
        key = np.searchsorted(crowded, edge[split, slot]) * (int(owner.max()) + 1) + owner[split]
        keys = np.union1d(keys, key)
        # negative numbers until all are known
        m = -1 - key
        faces = np.concatenate(
            [np.delete(faces, split, axis=0), np.column_stack([p, m, r]), np.column_stack([m, q, r])]
        )
        owner = np.concatenate([np.delete(owner, split), owner[split], owner[split]])
    which = crowded[keys // (int(owner.max()) + 1)] if len(keys) else keys
    middles = (at[which // many] + at[which % many]) / 2
    faces = np.where(faces < 0, many + np.searchsorted(keys, -1 - faces), faces)
    return np.concatenate([at, middles]), faces


def fans(faces: Integers, one: Integers, two: Integers) -> Integers:
    """Return a vertex for each corner of each face: one for those that go around a point over common edges.

    A common edge joins two half-edges, `one` and `two` (n,), of which one goes along it and the other back; half-edge
    3 f + k goes from corner k of face f to the next.
    """
    item = np.arange(faces.size).reshape(-1, 3)
    first, second = item.ravel(), np.roll(item, -1, axis=1).ravel()
    pairs = np.concatenate([np.stack([first[one], second[two]]), np.stack([second[one], first[two]])], axis=1)
    return components(faces.size, *pairs)


def edge_sides(faces: Integers) -> tuple[Integers, Integers]:
    """Return the two half-edges of each edge, of which each has two."""
    begin, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    order = np.argsort(np.minimum(begin, end) * (int(faces.max()) + 1) + np.maximum(begin, end), kind="stable")
    return order[0::2], order[1::2]
