"""Proof that two closed meshes lie side by side: they share triangles, and meet nowhere else.

The grains of a label image or of a tessellation share the triangles between them. Where these are all that the surfaces
have in common, each other triangle lies wholly inside or wholly outside of the other mesh, which its middle decides. If
all lie outside, and shared triangles face each other, the interiors have no point in common. Corners are the same up to
a margin, by which a grain may overlap at most.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.lazy import load
from voxgran.contacts.solid import Solid
from voxgran.geometry.crossing import meet_beyond_corners
from voxgran.geometry.rotation import stretch_of


def lie_side_by_side(one: Solid, other: Solid, *, matrix: Floats, offset: Floats, margin: float) -> bool:
    """Return whether it is proven that two meshes share triangles and do not overlap by more than a margin.

    The map of `matrix` and `offset` leads from the frame of `other` to that of `one`, in which the margin is meant.
    """
    if one.inside_out or other.inside_out:
        return False
    mine, theirs = one.mesh.vertices, other.mesh.vertices @ matrix.T + offset
    low = np.maximum(mine.min(axis=0), theirs.min(axis=0)) - margin
    high = np.minimum(mine.max(axis=0), theirs.max(axis=0)) + margin
    here, there = (np.flatnonzero(((at >= low) & (at <= high)).all(axis=1)) for at in (mine, theirs))
    points, both = np.concatenate([mine, theirs]), np.concatenate([here, len(mine) + there])
    pairs = both[load("scipy.spatial").cKDTree(points[both]).query_pairs(margin, output_type="ndarray")]
    if not len(pairs):
        return False
    # corners at the same place are the first one of them; a mesh may have several there, too
    number = np.arange(len(points))
    np.minimum.at(number, pairs.max(axis=1), pairs.min(axis=1))
    faces, partners = number[one.mesh.corners], number[other.mesh.corners + np.int64(len(mine))]
    near, rest = _are_near(one.mesh.corners, mine, low, high), _are_near(other.mesh.corners, theirs, low, high)
    partners = partners[rest]
    mine_keys, their_keys = _keys(faces[near], len(points)), _keys(partners[:, ::-1], len(points))
    shared = np.intersect1d(mine_keys, their_keys)
    near[near] = ~np.isin(mine_keys, shared)
    partners = partners[~np.isin(their_keys, shared)]
    if meet_beyond_corners(one.tree, faces, near, points, partners, margin=margin):
        return False
    back, faces = matrix.T / stretch_of(matrix) ** 2, faces[near]
    outside = one.tree.signed_distance(points[partners].mean(axis=1)) > 0
    return bool(
        outside.all() and (other.tree.signed_distance((points[faces].mean(axis=1) - offset) @ back.T) > 0).all()
    )


def _are_near(corners: NDArray[Any], points: Floats, low: Floats, high: Floats) -> Booleans:
    """Return which triangles are not wholly on the outer side of one of the planes of a box."""
    side = np.packbits(np.concatenate([points < low, points > high], axis=1), axis=1)[:, 0]
    a, b, c = side[corners].T
    return np.asarray(a & b & c == 0)


def _keys(faces: Integers, count: int) -> Integers:
    """Return a number for each triangle, the same for each of its three corners that comes first."""
    first = faces.argmin(axis=1)[:, None]
    a, b, c = np.take_along_axis(faces, (first + np.arange(3)) % 3, axis=1).T
    # numbers of so many points fit in 64 bits up to two million; beyond they repeat, which loses the proof at most
    return (a * count + b) * count + c
