"""Contacts of closed triangle meshes.

A simultaneous traversal of both box trees finds the nearest points. If the surfaces are separated by more than rounding
and no grain lies inside the other, the grains are proven to be separate. Grains that share triangles, as those of a
label image, are proven to lie side by side where nothing else meets
(:mod:`voxgran.contacts.overlap.shared_faces`). All other pairs are intersected by manifold3d, and the surface of the
intersection is searched for the deepest point. A grain in a cavity of another, without touching it, is separate.
"""

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran.contacts.depth import deepest_of_triangles
from voxgran.contacts.inside import placed
from voxgran.contacts.model import Touch, direction
from voxgran.contacts.overlap.shared_faces import middle_of_shared, shared_by_neighbours
from voxgran.contacts.search import deepest_point
from voxgran.contacts.solid import Body, Solid, combine
from voxgran.contacts.triangles import nearest_points
from voxgran.geometry.rotation import stretch_of

#: distance, in sizes of the pair, below which rounding could hide an overlap
ROUNDING = 1e-12
#: fraction of the smaller grain's volume above which an overlap is searched in its interior too
DEEP = 1e-3


def touch_meshes(one: Solid, other: Solid, *, matrix: Floats, offset: Floats, reach: float) -> Touch:
    """Return the contact of two meshes; see :mod:`voxgran.contacts.model` for the frames."""
    factor = stretch_of(matrix)
    margin = ROUNDING * (one.tree.size + factor * other.tree.size + float(linear.norm(offset)))
    distance, point, partner = nearest_points(
        one.tree, other.tree, matrix=matrix, offset=offset, reach=max(reach, margin)
    )
    if distance > margin and not _is_nested(one, other, matrix, offset, factor):
        return Touch.between(distance, point, partner, offset)
    if distance <= margin:
        shared = shared_by_neighbours(one, other, matrix=matrix, offset=offset, margin=margin)
        if shared is not None and len(shared):
            point, normal = middle_of_shared(one, shared)
            return Touch(distance, direction(normal, offset), point)
        if shared is not None:
            return Touch(distance, outward(one, point, offset), (point + partner) / 2)
    body = combine(one, other, matrix=matrix, offset=offset, operation="common")
    depth, normal, where = body_depth(one, other, body, matrix=matrix, offset=offset)
    if depth > 0:
        return Touch(-depth, normal, where)
    if distance == np.inf:
        return Touch.apart()
    return Touch(distance, outward(one, point, offset), (point + partner) / 2)


def body_depth(one: Solid, other: Solid, body: Body, *, matrix: Floats, offset: Floats) -> tuple[float, Floats, Floats]:
    """Return depth, normal and point of the deepest point of the common body of two meshes, in the frame of `one`.

    The depth is the largest distance to the surface of one of any point inside both, 0 for an empty body; the point is
    the middle between the deepest point and the surface.
    """
    factor = stretch_of(matrix)
    back = matrix.T / factor**2
    triangles = _within_both(one, other, body.triangles, back=back, offset=offset)
    if not len(triangles):
        return 0.0, np.zeros(3), offset / 2
    depth, point, nearest = deepest_of_triangles(one.tree, triangles)
    turned, theirs, their_nearest = deepest_of_triangles(other.tree, linear.matmul(triangles - offset, back.T))
    sign = 1.0
    if turned * factor > depth:
        depth, sign = turned * factor, -1.0
        point, nearest = linear.matmul(matrix, theirs) + offset, linear.matmul(matrix, their_nearest) + offset
    if body.volume > DEEP * min(one.mesh.volume, other.mesh.volume * factor**3):
        inner_other = placed(other.inner_distance, matrix=matrix, offset=offset)
        corners = triangles.reshape(-1, 3)
        low, high = corners.min(axis=0), corners.max(axis=0)
        found, where, _ = deepest_point(one.inner_distance, inner_other, low, high)
        if found > depth:
            return found, direction(offset, offset), where
    if depth > 1e-9 * one.tree.size:
        normal = sign * direction(nearest - point, offset)
    elif sign > 0:
        normal = outward(one, point, offset)
    else:
        normal = linear.matmul(-matrix, outward(other, linear.matmul(back, point - offset), -offset)) / factor
    return depth, normal, (point + nearest) / 2


def _within_both(one: Solid, other: Solid, triangles: Floats, *, back: Floats, offset: Floats) -> Floats:
    """Return the triangles of a common body that lie in both meshes.

    If surfaces coincide up to rounding, a body without volume may bridge a crease outside one of them.
    """
    middle = triangles.mean(axis=1)
    theirs = linear.matmul(middle - offset, back.T)
    kept = one.tree.signed_distance(middle) <= ROUNDING * (one.tree.size + float(linear.norm(offset)))
    kept &= other.tree.signed_distance(theirs) <= ROUNDING * (
        other.tree.size + float(linear.norm(linear.matmul(back, offset)))
    )
    return triangles[kept]


def outward(solid: Solid, point: Floats, fallback: Floats) -> Floats:
    """Return the outward normal of a mesh at its surface point nearest to a point."""
    triangle = int(solid.tree.nearest(point[None])[2][0])
    return direction(solid.tree.normals[triangle, 0], fallback)


def _is_nested(one: Solid, other: Solid, matrix: Floats, offset: Floats, factor: float) -> bool:
    """Return whether one of two disjoint surfaces lies in the solid of the other."""
    theirs = linear.matmul(matrix, other.tree.corners[0, 0]) + offset
    mine = linear.matmul(matrix.T, one.tree.corners[0, 0] - offset) / factor**2
    return _holds(one, theirs) or _holds(other, mine)


def _holds(solid: Solid, point: Floats) -> bool:
    """Return whether a mesh contains a point."""
    low, high = solid.tree.low[0], solid.tree.high[0]
    if (point < low).any() or (point > high).any():
        return False
    return bool(solid.tree.signed_distance(point[None])[0] < 0)
