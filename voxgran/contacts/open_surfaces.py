"""Contacts of open surfaces with each other and with solids of any kind.

The gap is the smallest distance of the triangles from the partner. Two open surfaces overlap if they cross; their depth
is the length of the shortest translation found that separates them, an upper bound of the minimum. An open surface
overlaps a solid if one of its points lies inside, also if it lies inside as a whole; the depth is the largest distance
of such a point from the surface of the solid.
"""

from collections.abc import Callable
from functools import partial

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran.contacts.convex import TOUCHING, part_size
from voxgran.contacts.depth import deepest_of_triangles
from voxgran.contacts.inside import inner_distance, placed
from voxgran.contacts.mesh_parts import depth_in_convex, distance_to_triangles, placed_row
from voxgran.contacts.meshes import ROUNDING
from voxgran.contacts.model import Touch, direction
from voxgran.contacts.parts import Parts, parts_of
from voxgran.contacts.sheet_crossing import crossing_depth
from voxgran.contacts.solid import Solid
from voxgran.contacts.triangles import nearest_points
from voxgran.geometry.rotation import stretch_of
from voxgran.shapes.describing.body import Geometry
from voxgran.shapes.mesh import Mesh, Surface
from voxgran.shapes.primitive import Primitive


def open_touch(surface: Surface, partner: Geometry, solid: Callable[[], Solid]) -> Callable[..., Touch]:
    """Return the test of an open surface with a partner, a function of `matrix`, `offset` and `reach`.

    `solid` returns the partner as a closed mesh if it is a mesh or a box.
    """
    if isinstance(partner, Surface):
        return partial(touch_open, surface, partner)
    if isinstance(partner, Mesh) or (isinstance(partner, Primitive) and partner.kind == "box"):
        return partial(touch_closed, surface, solid())
    if isinstance(partner, Primitive) and partner.kind != "sphere":
        return partial(touch_round, surface, partner)
    return partial(touch_spheres, surface, parts_of([partner]))


def touch_open(one: Surface, other: Surface, *, matrix: Floats, offset: Floats, reach: float) -> Touch:
    """Return the contact, or the depth of crossing, of two open surfaces."""
    margin = ROUNDING * (one.tree.size + stretch_of(matrix) * other.tree.size + float(linear.norm(offset)))
    distance, point, partner = nearest_points(
        one.tree, other.tree, matrix=matrix, offset=offset, reach=max(reach, margin)
    )
    if distance > margin:
        return Touch.between(distance, point, partner, offset)
    depth, way = crossing_depth(one.tree, other.tree, matrix=matrix, offset=offset)
    return Touch(-depth if depth > 0.0 else distance, direction(way, offset), (point + partner) / 2)


def touch_closed(surface: Surface, solid: Solid, *, matrix: Floats, offset: Floats, reach: float) -> Touch:
    """Return the contact, or the depth of penetration, of an open surface with a closed mesh or a box."""
    factor = stretch_of(matrix)
    back = matrix / factor**2
    margin = ROUNDING * (surface.tree.size + factor * solid.tree.size + float(linear.norm(offset)))
    distance, point, partner = nearest_points(
        surface.tree, solid.tree, matrix=matrix, offset=offset, reach=max(reach, margin)
    )
    first = linear.matmul(surface.vertices[surface.faces[0, :1]] - offset, back)
    if distance > margin and not solid.tree.signed_distance(first)[0] < 0:
        return Touch.between(distance, point, partner, offset)
    depth, deepest, nearest = deepest_of_triangles(
        solid.tree, linear.matmul(surface.triangles - offset, back), inside=True
    )
    if depth > 0.0:
        inward = linear.matmul(matrix, deepest - nearest)
        return Touch(-depth * factor, direction(inward, offset), linear.matmul(matrix, deepest + nearest) / 2 + offset)
    return Touch(distance, direction(offset, offset), (point + partner) / 2)


def touch_spheres(surface: Surface, parts: Parts, *, matrix: Floats, offset: Floats, reach: float) -> Touch:
    """Return the contact of an open surface with a union of spheres in its own frame; a depth is that in one sphere."""
    centers, radii = linear.matmul(parts.center, matrix.T) + offset, parts.margin * stretch_of(matrix)
    distance, nearest, _ = surface.tree.nearest(centers, reach=float(radii.max()) + reach)
    gaps = np.abs(distance) - radii
    k = int(gaps.argmin())
    if gaps[k] > reach:
        return Touch.apart()
    normal = direction(centers[k] - nearest[k], offset)
    return Touch(float(gaps[k]), normal, nearest[k] + 0.5 * gaps[k] * normal)


def touch_round(surface: Surface, primitive: Primitive, *, matrix: Floats, offset: Floats, reach: float) -> Touch:
    """Return the contact of an open surface with another primitive than a sphere.

    A depth in an ellipsoid or spherocylinder that exceeds its smallest radius of curvature is a lower bound.
    """
    row, sphere = placed_row(primitive, matrix), primitive.bounding_radius * stretch_of(matrix)
    near, contact = np.zeros(9), np.zeros(7)
    distance = distance_to_triangles(row, offset, sphere, surface.tree.arrays, float(reach), near)
    size = float(part_size(row)) + surface.tree.size
    if distance > TOUCHING * size:
        if distance > reach:
            return Touch.apart()
        return Touch(distance, direction(-near[6:], offset), (near[:3] + near[3:6]) / 2)
    deep = depth_in_convex(row, offset, sphere, size, surface.tree.arrays, contact)
    depth, normal, point = float(contact[0]), -contact[1:4], contact[4:]
    if deep:
        places = np.concatenate([surface.vertices, surface.triangles.mean(axis=1)])
        inner = placed(inner_distance(primitive), matrix=matrix, offset=offset)(places)
        if inner.max() > depth:
            depth, point = float(inner.max()), places[inner.argmax()]
    return Touch(-depth, direction(normal, offset), point)
