"""Contacts of closed triangle meshes with spheres and other primitives.

The partner of the mesh is not tessellated. The contact of a sphere is at the surface point nearest to its center. For
the other solids each close triangle is one convex solid and the partner another. The depth of an overlap is that of the
triangles in the partner; for a cylinder or cone, whose rims and tips can be deeper in the mesh than the mesh in them,
it is the larger of this and the depth of its surface in the mesh. (The depth in a sphere, ellipsoid or spherocylinder
is never the smaller one, up to its smallest radius of curvature.) Boxes are meshes.
"""

import math

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran._base.kernels import kernel
from voxgran.contacts.convex import TOUCHING, part_size, penetration
from voxgran.contacts.depth import deepest_of_round
from voxgran.contacts.inside import inner_distance, placed
from voxgran.contacts.meshes import outward
from voxgran.contacts.model import Touch, direction
from voxgran.contacts.parts import Parts, row_of
from voxgran.contacts.search import deepest_point
from voxgran.contacts.separation import separation
from voxgran.contacts.solid import Solid
from voxgran.geometry.rotation import stretch_of
from voxgran.geometry.support import CONE, CYLINDER, TRIANGLE, support
from voxgran.geometry.tree import TreeArrays, push_halves, square_to_box
from voxgran.shapes.describing.body import Geometry
from voxgran.shapes.primitive import Primitive


def touch_spheres(
    solid: Solid, geometry: Geometry, parts: Parts, *, matrix: Floats, offset: Floats, reach: float
) -> Touch:
    """Return the contact, from the mesh to the spheres, of a mesh with a union of spheres.

    `parts` are the spheres of this one body in its own frame; `matrix` and `offset` map it to that of the mesh.
    """
    factor = stretch_of(matrix)
    centers, radii = linear.matmul(parts.center, matrix.T) + offset, parts.margin * factor
    distance, nearest, _ = solid.tree.nearest(centers, reach=float(radii.max()) + reach)
    # a center without close triangles is outside, or so deep inside that another center decides
    if not np.isfinite(distance).all():
        inside = ((centers > solid.tree.low[0]) & (centers < solid.tree.high[0])).all(axis=1)
        again = ~np.isfinite(distance) & (inside | solid.inside_out)
        distance[again], nearest[again] = solid.tree.nearest(centers[again])[:2]
    gaps = distance - radii
    k = int(gaps.argmin())
    if gaps[k] > reach:
        return Touch.apart()
    if distance[k] < 0:
        return _touch_deep(solid, geometry, radii[k], centers[k] - radii[k], centers[k] + radii[k], matrix, offset)
    normal = direction(centers[k] - nearest[k], outward(solid, nearest[k], offset))
    return Touch(float(gaps[k]), normal, nearest[k] + 0.5 * gaps[k] * normal)


def touch_convex(solid: Solid, primitive: Primitive, *, matrix: Floats, offset: Floats, reach: float) -> Touch:
    """Return the contact, from the mesh to its partner, of a mesh with another primitive than a sphere."""
    row = placed_row(primitive, matrix)
    sphere = primitive.bounding_radius * stretch_of(matrix)
    near = np.zeros(9)
    distance = distance_to_triangles(row, offset, sphere, solid.tree.arrays, float(reach), near)
    size = float(part_size(row)) + solid.tree.size
    if distance > TOUCHING * size:
        if _holds_center(solid, offset):
            return _touch_deep(solid, primitive, 0.0, offset - sphere, offset + sphere, matrix, offset)
        if distance > reach:
            return Touch.apart()
        return Touch(distance, direction(-near[6:], offset), (near[:3] + near[3:6]) / 2)
    contact = np.zeros(7)
    deep = depth_in_convex(row, offset, sphere, size, solid.tree.arrays, contact)
    depth, normal, point = float(contact[0]), -contact[1:4], contact[4:]
    if int(row[0]) in (CYLINDER, CONE):
        deeper, where, surface = deepest_of_round(solid.tree, row, offset)
        if deeper > depth:
            depth, normal, point = deeper, direction(surface - where, offset), (where + surface) / 2
    if deep or solid.tree.signed_distance(offset[None])[0] < 0:
        touch = _touch_deep(solid, primitive, depth, offset - sphere, offset + sphere, matrix, offset)
        if -touch.gap > depth:
            return touch
    return Touch(-depth, direction(normal, offset), point)


def placed_row(primitive: Primitive, matrix: Floats) -> Floats:
    """Return the (13,) row of a primitive other than a sphere, rotated and scaled by a matrix."""
    factor = stretch_of(matrix)
    row = row_of(primitive)
    row[1:4] *= factor
    row[4:] = linear.matmul(matrix / factor, row[4:].reshape(3, 3)).ravel()
    return row


def _holds_center(solid: Solid, center: Floats) -> bool:
    """Return whether the center of a grain lies in a mesh, at any distance from the surface."""
    outside = ((center < solid.tree.low[0]) | (center > solid.tree.high[0])).any()
    if outside:
        return solid.inside_out
    return bool(solid.tree.signed_distance(center[None])[0] < 0)


def _touch_deep(
    solid: Solid, geometry: Geometry, depth: float, low: Floats, high: Floats, matrix: Floats, offset: Floats
) -> Touch:
    """Return the depth, by a search, of a grain whose center lies in a mesh."""
    inner = placed(inner_distance(geometry), matrix=matrix, offset=offset)
    if not solid.inside_out:
        low, high = np.maximum(low, solid.tree.low[0]), np.minimum(high, solid.tree.high[0])
    found, point, _ = deepest_point(solid.inner_distance, inner, low, high)
    return Touch(-max(found, depth), direction(offset, offset), point)


@kernel
def distance_to_triangles(
    row: Floats, center: Floats, sphere: float, tree: TreeArrays, reach: float, near: Floats
) -> float:
    """Return the distance of a convex solid from a surface; write the nearest points, that of the solid first."""
    low, high = tree.low, tree.high
    best, hit = reach, False
    stack, triangle, points = np.zeros(64, dtype=np.int64), np.zeros(13), np.zeros(9)
    triangle[0] = TRIANGLE
    shift = np.zeros(3)
    depth, leaves = 1, len(low) // 2
    while depth > 0:
        depth -= 1
        node = stack[depth]
        if math.sqrt(square_to_box(low, high, node, center[0], center[1], center[2])) - sphere > best:
            continue
        if node < leaves:
            push_halves(low, high, node, center[0], center[1], center[2], stack, depth)
            depth += 2
            continue
        for t in range(tree.start[node, 0], tree.start[node, 1]):
            _load(tree.corners, t, center, triangle)
            if _plane_gap(row, triangle) > best:
                continue
            distance = separation(row, triangle, 0.0, shift, points)
            if distance < best or (not hit and distance <= best):
                best, hit = distance, True
                for i in range(3):
                    near[i], near[3 + i] = points[i] + center[i], points[3 + i] + center[i]
                    near[6 + i] = points[6 + i]
        if hit and best <= 0.0:
            return best
    return best if hit else np.inf


@kernel
def _load(corners, t, center, triangle):  # type: ignore[no-untyped-def]
    """Write a triangle as a row relative to a center."""
    for c in range(3):
        for i in range(3):
            triangle[4 + 3 * c + i] = corners[t, c, i] - center[i]


@kernel
def _plane_gap(row, triangle):  # type: ignore[no-untyped-def]
    """Return a lower bound of the distance of a solid from the plane of a triangle."""
    ax, ay, az = triangle[4], triangle[5], triangle[6]
    ux, uy, uz = triangle[7] - ax, triangle[8] - ay, triangle[9] - az
    vx, vy, vz = triangle[10] - ax, triangle[11] - ay, triangle[12] - az
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    if length == 0.0:
        return -np.inf
    level = nx * ax + ny * ay + nz * az
    if level < 0.0:
        nx, ny, nz, level = -nx, -ny, -nz, -level
    px, py, pz = support(row, 0.0, nx, ny, nz)
    # reduced by the rounding error
    return (level - (nx * px + ny * py + nz * pz)) / length - 1e-12 * (level / length)


@kernel
def depth_in_convex(row: Floats, center: Floats, sphere: float, size: float, tree: TreeArrays, contact: Floats) -> bool:
    """Write the deepest contact of all triangles in a convex solid; return whether one is too deep to be exact."""
    low, high = tree.low, tree.high
    deep, shift = False, np.zeros(3)
    stack, triangle = np.zeros(64, dtype=np.int64), np.zeros(13)
    points, trial = np.zeros(9), np.zeros(7)
    triangle[0] = TRIANGLE
    depth, leaves = 1, len(low) // 2
    while depth > 0:
        depth -= 1
        node = stack[depth]
        if square_to_box(low, high, node, center[0], center[1], center[2]) > sphere * sphere:
            continue
        if node < leaves:
            stack[depth], stack[depth + 1] = 2 * node + 1, 2 * node + 2
            depth += 2
            continue
        for t in range(tree.start[node, 0], tree.start[node, 1]):
            _load(tree.corners, t, center, triangle)
            if _plane_gap(row, triangle) > 0.0 or separation(row, triangle, contact[0], shift, points) > 0.0:
                continue
            deep |= penetration(row, 0.0, triangle, 0.0, shift, size, trial)
            if trial[0] >= contact[0]:
                for i in range(len(trial)):
                    contact[i] = trial[i]
                for i in range(3):
                    contact[4 + i] += center[i]
    return deep
