"""Proof that two closed meshes lie side by side: they share triangles, and meet nowhere else.

The grains of a label image or of a tessellation share the triangles between them. Where these are all that the surfaces
have in common, each other triangle lies wholly inside or wholly outside of the other mesh, and so do triangles together
that are connected over corners that the other mesh has not: the middle of one of them decides. If all lie outside, and
shared triangles face each other, the interiors have no point in common. Corners are the same up to a margin, by which a
grain may overlap at most.

The contact of such grains is a whole surface, with the mean normal of its triangles: any of its points is nearest, and
the first one that is found lies on its rim as often as not, on a triangle that faces elsewhere.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.kernels import kernel
from voxgran._base.lazy import load
from voxgran.contacts.solid import Solid
from voxgran.geometry.crossing import meet_beyond_corners
from voxgran.geometry.rotation import stretch_of
from voxgran.geometry.triangles import normals_of
from voxgran.lattice.label_pieces import root_of


def shared_by_neighbours(
    one: Solid, other: Solid, *, matrix: Floats, offset: Floats, margin: float
) -> NDArray[np.int64] | None:
    """Return which triangles of `one` two meshes share that are proven not to overlap by more than a margin.

    None where this is not proven; no triangles where the meshes share edges or corners only. The map of `matrix` and
    `offset` leads from the frame of `other` to that of `one`, in which the margin is meant.
    """
    if one.inside_out or other.inside_out:
        return None
    mine, theirs = one.mesh.vertices, linear.matmul(other.mesh.vertices, matrix.T) + offset
    low = np.maximum(mine.min(axis=0), theirs.min(axis=0)) - margin
    high = np.minimum(mine.max(axis=0), theirs.max(axis=0)) + margin
    here, there = (np.flatnonzero(_side(at, low, high) == 0) for at in (mine, theirs))
    points, both = np.concatenate([mine, theirs]), np.concatenate([here, len(mine) + there])
    pairs = both[load("scipy.spatial").cKDTree(points[both]).query_pairs(margin, output_type="ndarray")]
    if not len(pairs):
        return None
    # corners at the same place are the first one of them; a mesh may have several there, too
    number = np.arange(len(points))
    np.minimum.at(number, pairs.max(axis=1), pairs.min(axis=1))
    faces, partners = number[one.mesh.corners], number[other.mesh.corners + np.int64(len(mine))]
    near, rest = _are_near(one.mesh.corners, mine, low, high), _are_near(other.mesh.corners, theirs, low, high)
    partners = partners[rest]
    mine_keys, their_keys = _keys(faces[near], len(points)), _keys(partners[:, ::-1], len(points))
    shared = np.intersect1d(mine_keys, their_keys)
    common = np.flatnonzero(near)[np.isin(mine_keys, shared)]
    near[common] = False
    partners = partners[~np.isin(their_keys, shared)]
    if meet_beyond_corners(one.tree, faces, near, points, partners, margin=margin):
        return None
    both = np.zeros(len(points), dtype=np.bool_)
    both[number[len(mine) :]] = True
    both[len(mine) :] = False
    back, faces, partners = (
        matrix.T / stretch_of(matrix) ** 2,
        *(_one_a_patch(f, both) for f in (faces[near], partners)),
    )
    outside = one.tree.signed_distance(points[partners].mean(axis=1)) > 0
    outside_too = other.tree.signed_distance(linear.matmul(points[faces].mean(axis=1) - offset, back.T)) > 0
    return common if outside.all() and outside_too.all() else None


def middle_of_shared(one: Solid, shared: NDArray[np.int64]) -> tuple[Floats, Floats]:
    """Return the point of shared triangles, one at least, that is near their centroid, and the sum of their normals."""
    triangles = one.mesh.vertices[one.mesh.corners[shared]]
    middles, normals = triangles.mean(axis=1), normals_of(triangles)
    areas = linear.norm(normals, axis=1)
    centroid = linear.matmul(areas, middles) / max(float(areas.sum()), 1e-300)
    return middles[np.square(middles - centroid).sum(axis=1).argmin()], normals.sum(axis=0)


def _one_a_patch(faces: Integers, common: Booleans) -> Integers:
    """Return a triangle of each patch of triangles that are connected over corners that are not common."""
    first = np.zeros(len(faces), dtype=np.bool_)
    _mark_first(faces, common, first)
    return faces[first]


@kernel
def _mark_first(faces, common, first):  # type: ignore[no-untyped-def]
    """Mark the first triangle of each patch; one without a corner that is not common is alone."""
    parent, seen = np.arange(len(common)), np.zeros(len(common), dtype=np.bool_)
    for t in range(len(faces)):
        known = -1
        for corner in faces[t]:
            if not common[corner]:
                root = root_of(parent, corner)
                parent[root] = root if known < 0 else known
                known = parent[root]
    for t in range(len(faces)):
        first[t] = True
        for corner in faces[t]:
            if not common[corner]:
                root = root_of(parent, corner)
                first[t], seen[root] = not seen[root], True
                break


def _side(points: Floats, low: Floats, high: Floats) -> NDArray[np.uint8]:
    """Return of each point a bit for each plane of a box on whose outer side it lies."""
    found = np.zeros(len(points), dtype=np.uint8)
    for axis, along in enumerate(points.T):
        found |= (along < low[axis]).view(np.uint8) << np.uint8(axis)
        found |= (along > high[axis]).view(np.uint8) << np.uint8(axis + 3)
    return found


def _are_near(corners: NDArray[Any], points: Floats, low: Floats, high: Floats) -> Booleans:
    """Return which triangles are not wholly on the outer side of one of the planes of a box."""
    a, b, c = _side(points, low, high)[corners].T
    return np.asarray(a & b & c == 0)


def _keys(faces: Integers, count: int) -> Integers:
    """Return a number for each triangle, the same for each of its three corners that comes first."""
    first = faces.argmin(axis=1)[:, None]
    a, b, c = np.take_along_axis(faces, (first + np.arange(3)) % 3, axis=1).T
    # numbers of so many points fit in 64 bits up to two million; beyond they repeat, which loses the proof at most
    return (a * count + b) * count + c
