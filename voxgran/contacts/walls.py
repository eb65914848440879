"""Protrusion of grains beyond the walls of their container, by their true geometry.

At flat walls and at the walls of a cylinder or sphere the protrusion follows from the support function, in closed form
or by a search for the best direction to the last digits; at a closed mesh it is the depth of the grain in the exterior
of the container. Polygons as grains and as containers are prisms. Containers that are strained do not become shorter
than fixed grains are long, and their walls push these inside.
"""

import math
from dataclasses import replace

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import kernel
from voxgran.contacts.assembly import Assembly
from voxgran.contacts.depth import deepest_of_triangles
from voxgran.contacts.mesh_parts import touch_convex
from voxgran.contacts.parts import has_parts, parts_of
from voxgran.contacts.solid import Solid, combine
from voxgran.contacts.triangles import nearest_points
from voxgran.containers.model import UNKNOWN, boundary_of
from voxgran.containers.plane import prism_of
from voxgran.geometry.farthest import farthest_of_row
from voxgran.geometry.rotation import stretch_of
from voxgran.geometry.support import support
from voxgran.geometry.vectors import add, dot
from voxgran.geometry.walls import Round, directions_toward, in_frame, out_of_frame, reach_from
from voxgran.shapes.mesh import Mesh, Surface
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive

#: number of directions in which the support function of a convex part is sampled before the best ones are refined
DIRECTIONS = 128
#: distance, in sizes of the container, below which rounding could hide an escape
ROUNDING = 1e-12
#: halvings by which a place within a round wall is found
HALVINGS = 50


def escape_depths(assembly: Assembly) -> Floats:
    """Return the largest protrusion (n,) of each grain beyond the walls of its container and beyond a lid.

    It is at most 0 inside (minus the distance of the nearest wall), minus infinity without walls. In containers of
    kinds that are not part of voxgran, grains other than spheres are represented by their tessellation.
    """
    escape = _beyond_container(assembly)
    return escape if assembly.lid is None else np.maximum(escape, beyond_lid(assembly))


def walls_touched(assembly: Assembly, gap: float) -> Integers:
    """Return how many walls, the lid among them, are within a gap of each grain, (n,), in the unit of lengths.

    Each plane side of a box or cylinder counts as a wall. Round walls, the surface of a closed mesh or polygon, and
    that of a container which is known by its signed distance only, count as one wall each, also in their corners.
    """
    touched = (beyond_lid(assembly) >= -gap).astype(np.int64)
    if not assembly.count:
        return touched
    outside = assembly.container.signed_distance(assembly.position) + assembly.bounding_radii
    near = np.flatnonzero(outside >= -gap)
    poses = assembly.shape_id[near], assembly.scale[near], assembly.position[near], assembly.orientation[near]
    part = Assembly(assembly.shapes, *poses, assembly.container)
    walls = boundary_of(assembly.container)
    if walls is UNKNOWN or walls.solid is not None:
        touched[near] += _beyond_container(part) >= -gap
        return touched
    axes = np.flatnonzero(walls.flat)
    if len(axes):
        lower, upper = assembly.container.bounds
        low, high = grain_bounds(part)
        below, above = lower - part.position - low, part.position + high - upper
        touched[near] += (below[:, axes] >= -gap).sum(axis=1) + (above[:, axes] >= -gap).sum(axis=1)
    for wall in walls.round:
        touched[near] += reach_at(part, wall) - wall.radius >= -gap
    return touched


def beyond_lid(assembly: Assembly) -> Floats:
    """Return the protrusion (n,) of each grain beyond the lid, negative below it; minus infinity without a lid."""
    if assembly.lid is None:
        return np.full(assembly.count, -np.inf)
    low, high = grain_bounds(assembly)
    normal = assembly.lid.normal
    reach = linear.matmul(np.where(normal > 0, high, -low), np.abs(normal))
    return np.asarray(linear.matmul(assembly.position, normal) + reach - assembly.lid.level)


def _beyond_container(assembly: Assembly) -> Floats:
    """Return the protrusion of each grain beyond the walls of the container."""
    walls = boundary_of(assembly.container)
    escape = np.full(assembly.count, -np.inf)
    if walls is UNKNOWN:
        for grain in range(assembly.count):
            shape = assembly.shapes[assembly.shape_id[grain]]
            if shape.is_sphere:
                points, beyond = assembly.position[grain : grain + 1], assembly.bounding_radii[grain]
            else:
                points, beyond = assembly.world_vertices(grain), shape.tessellation_error * assembly.scale[grain]
            escape[grain] = assembly.container.signed_distance(points).max() + beyond
        return escape
    if walls.solid is not None:
        for kind in range(len(assembly.shapes)):
            grains = np.flatnonzero(assembly.shape_id == kind)
            escape[grains] = _beyond_mesh(assembly, walls.solid, grains)
    if any(walls.flat):
        escape = np.maximum(escape, _beyond_planes(assembly, [axis for axis in range(3) if walls.flat[axis]]))
    for wall in walls.round:
        escape = np.maximum(escape, reach_at(assembly, wall) - wall.radius)
    return escape


def grain_bounds(assembly: Assembly) -> tuple[Floats, Floats]:
    """Return the exact extents (n, 3), low and high, of the grains along the axes, relative to their centroids."""
    low, high = np.zeros((assembly.count, 3)), np.zeros((assembly.count, 3))
    for shape, item in enumerate(assembly.shapes):
        grains = np.flatnonzero(assembly.shape_id == shape)
        geometry, scale = item.geometry, assembly.scale[grains]
        if isinstance(geometry, Primitive):
            for sign, bound in ((-1.0, low), (1.0, high)):
                # row k of a rotation matrix is axis k in the body frame
                axes = sign * assembly.matrices[grains].reshape(-1, 3)
                reach = (geometry.support(axes) * axes).sum(axis=1).reshape(-1, 3)
                bound[grains] = sign * reach * scale[:, None]
        elif has_parts(geometry):
            parts = parts_of([geometry])
            centers = linear.matmul(assembly.matrices[grains], parts.center.T)
            low[grains] = (centers - parts.margin).min(axis=2) * scale[:, None]
            high[grains] = (centers + parts.margin).max(axis=2) * scale[:, None]
        else:
            for grain in grains:
                turned = linear.matmul(_corners(geometry), assembly.matrices[grain].T)
                low[grain] = turned.min(axis=0) * assembly.scale[grain]
                high[grain] = turned.max(axis=0) * assembly.scale[grain]
    return low, high


def reach_at(assembly: Assembly, wall: Round) -> Floats:
    """Return the largest reach (n,) of any point of each grain at a wall of revolution."""
    reach = np.full(assembly.count, -np.inf)
    geometries = [shape.geometry for shape in assembly.shapes]
    parts = parts_of(geometries).placed(assembly.shape_id, assembly.scale, assembly.matrices)
    away = assembly.position - np.array(wall.center)
    _reach_out(parts.start, parts.row, parts.margin, parts.center, away, wall.row, reach)
    for grain in range(assembly.count):
        geometry = geometries[assembly.shape_id[grain]]
        if not has_parts(geometry):
            turned = linear.matmul(_corners(geometry), assembly.matrices[grain].T) * assembly.scale[grain]
            reach[grain] = wall.reach(turned + away[grain]).max()
    return reach


def least_lengths(fixed: Assembly) -> Floats:
    """Return the lengths (3,) along the axes of the smallest container that encloses each of some fixed grains.

    Periodic sides are as far apart as a grain is long, so that it does not overlap its images, and a round wall
    encloses it around its axis. No length is above that of the container as it is, in which longer grains may lie along
    a diagonal.
    """
    least = np.zeros(3)
    if fixed.count:
        low, high = grain_bounds(fixed)
        least = (high - low).max(axis=0)
        for wall in boundary_of(fixed.container).round:
            centered = replace(fixed, position=_away(fixed, wall, 0.0))
            least[: wall.axes] = 2.0 * float(reach_at(centered, wall).max())
    return np.asarray(np.minimum(least, np.ptp(fixed.container.bounds, axis=0)))


def pushed_inside(fixed: Assembly) -> Floats:
    """Return the centroids (n, 3) of fixed grains that the walls of their container have pushed inside, by the shortest
    way, where they have room.
    """
    if not fixed.count:
        return fixed.position
    walls, (lower, upper), (low, high) = boundary_of(fixed.container), fixed.container.bounds, grain_bounds(fixed)
    least, most = lower - low, upper - high
    has_room = np.array(walls.flat) & (least <= most)
    inside = np.where(has_room, np.clip(fixed.position, least, most), fixed.position)
    for wall in walls.round:
        place = replace(fixed, position=inside)
        near, far = np.zeros(fixed.count), np.ones(fixed.count)
        out = reach_at(place, wall) > wall.radius
        out &= reach_at(replace(fixed, position=_away(place, wall, 0.0)), wall) <= wall.radius
        for _ in range(HALVINGS if out.any() else 0):
            middle = 0.5 * (near + far)
            beyond = reach_at(replace(fixed, position=_away(place, wall, middle[:, None])), wall) > wall.radius
            near, far = np.where(beyond, near, middle), np.where(beyond, middle, far)
        inside = np.where(out[:, None], _away(place, wall, near[:, None]), inside)
    return inside


def _away(fixed: Assembly, wall: Round, share: float | Floats) -> Floats:
    """Return centroids (n, 3) at a share of their distance from the center of a round wall."""
    center, moved = np.array(wall.center), fixed.position.copy()
    moved[:, : wall.axes] = (center + share * (fixed.position - center))[:, : wall.axes]
    return moved


def _corners(geometry: object) -> Floats:
    """Return the corners of a mesh or polygon, (n, 3)."""
    if isinstance(geometry, Outline):
        return np.column_stack([geometry.vertices, np.zeros(len(geometry.vertices))])
    assert isinstance(geometry, Mesh | Surface)
    return geometry.vertices


def _beyond_planes(assembly: Assembly, axes: list[int]) -> Floats:
    """Return the largest protrusion beyond the walls normal to the given axes."""
    if not axes or not assembly.count:
        return np.full(assembly.count, -np.inf)
    lower, upper = assembly.container.bounds
    low, high = grain_bounds(assembly)
    below = (lower - assembly.position - low)[:, axes]
    above = (assembly.position - upper + high)[:, axes]
    return np.asarray(np.maximum(below, above).max(axis=1))


def _beyond_mesh(assembly: Assembly, wall: Shape, grains: Integers) -> Floats:
    """Return the protrusion of grains of one shape beyond the walls of a closed mesh."""
    found = np.zeros(len(grains))
    if not len(grains):
        return found
    geometry = assembly.shapes[assembly.shape_id[grains[0]]].geometry
    mesh = wall.geometry
    assert isinstance(mesh, Mesh)
    inside, outside = Solid(mesh), Solid(mesh, inside_out=True)
    offsets = assembly.position[grains] - np.array(wall.offset)
    if isinstance(geometry, Outline) and geometry.kind == "polygon":
        # as high as it is wide: all of it is far from the ends of the prism that the container is
        geometry = prism_of([geometry.vertices], geometry.bounding_radius)
    if has_parts(geometry) and not (isinstance(geometry, Primitive) and geometry.kind != "sphere"):
        parts = parts_of([geometry])
        for k, grain in enumerate(grains):
            turn = assembly.matrices[grain] * assembly.scale[grain]
            distance = inside.tree.signed_distance(linear.matmul(parts.center, turn.T) + offsets[k])
            found[k] = (distance + parts.margin * assembly.scale[grain]).max()
        return found
    solid = None
    if isinstance(geometry, Mesh):
        solid = Solid(geometry)
    elif isinstance(geometry, Primitive) and geometry.kind == "box":
        vertices, faces, _ = geometry.tessellation()
        solid = Solid(Mesh(vertices, faces))
    for k, grain in enumerate(grains):
        matrix = assembly.matrices[grain] * assembly.scale[grain]
        if isinstance(geometry, Surface):
            found[k] = _surface_beyond_mesh(inside, outside, geometry, matrix, offsets[k])
        elif solid is not None:
            found[k] = _mesh_beyond_mesh(inside, solid, matrix, offsets[k])
        else:
            assert isinstance(geometry, Primitive)
            found[k] = -touch_convex(outside, geometry, matrix=matrix, offset=offsets[k], reach=math.inf).gap
    return found


def _surface_beyond_mesh(inside: Solid, outside: Solid, surface: Surface, matrix: Floats, offset: Floats) -> float:
    """Return the protrusion of an open surface beyond a mesh that should contain it."""
    depth = deepest_of_triangles(outside.tree, linear.matmul(surface.triangles, matrix.T) + offset, inside=True)[0]
    return depth or -nearest_points(inside.tree, surface.tree, matrix=matrix, offset=offset)[0]


def _mesh_beyond_mesh(container: Solid, grain: Solid, matrix: Floats, offset: Floats) -> float:
    """Return the protrusion of one mesh beyond another that should contain it."""
    margin = ROUNDING * (container.tree.size + float(linear.norm(offset)))
    distance, _, _ = nearest_points(container.tree, grain.tree, matrix=matrix, offset=offset)
    corner = linear.matmul(matrix, grain.tree.corners[0, 0]) + offset
    if distance > margin and container.tree.signed_distance(corner[None])[0] < 0:
        return -distance
    back = matrix.T / stretch_of(matrix) ** 2
    body = combine(grain, container, matrix=back, offset=linear.matmul(-back, offset), operation="rest")
    if not len(body.triangles):
        return -distance
    return deepest_of_triangles(container.tree, linear.matmul(body.triangles, matrix.T) + offset)[0]


@kernel
def _reach_out(start, row, margin, center, position, wall, reach):  # type: ignore[no-untyped-def]
    """Write the largest reach of each grain's points at a wall of revolution about the origin."""
    for grain in range(len(position)):
        for part in range(start[grain], start[grain + 1]):
            x, y = position[grain, 0] + center[part, 0], position[grain, 1] + center[part, 1]
            z = position[grain, 2] + center[part, 2]
            if row[part, 0] == 0.0:
                far = reach_from(wall, x, y, z)
            elif wall[3] == 1.0:
                far = farthest_of_row(row[part], x, y, z)
            else:
                far = reach_from_line(row[part], x, y, z, wall)
            reach[grain] = max(reach[grain], far + margin[part])


@kernel
def reach_from_line(row: Floats, x: float, y: float, z: float, wall: Floats) -> float:
    """Return the largest reach of the points of a part centered at (x, y, z) at a wall about the origin, no sphere."""
    best, place = -math.inf, in_frame(wall, (x, y, z))
    if wall[4] == 0.0:
        return _reach_along(row, place, wall, 0.0)
    # the normal at the farthest point has its direction from the axis
    start, step = directions_toward(place[0], place[1], row[1] + row[2] + row[3], DIRECTIONS)
    before, now = _reach_along(row, place, wall, start - step), _reach_along(row, place, wall, start)
    for k in range(DIRECTIONS + 1):
        after = _reach_along(row, place, wall, start + (k + 1) * step)
        if now >= before and now >= after:
            best = max(best, _refine(row, place, wall, start + (k - 1) * step, start + (k + 1) * step))
        before, now = now, after
    return best


@kernel
def _reach_along(row, place, wall, angle):  # type: ignore[no-untyped-def]
    """Return the support function of a part, placed in the frame of a wall, along its normal at an angle."""
    normal = (wall[4] * math.cos(angle), wall[4] * math.sin(angle), wall[5])
    u, v, w = out_of_frame(wall, normal)
    point = support(row, 0.0, u, v, w)
    return dot(add(place, in_frame(wall, point)), normal)


@kernel
def _refine(row, place, wall, low, high):  # type: ignore[no-untyped-def]
    """Return the maximum of the support function between two directions, by golden-section search."""
    golden = 0.5 * (math.sqrt(5.0) - 1.0)
    one, two = high - golden * (high - low), low + golden * (high - low)
    first, second = _reach_along(row, place, wall, one), _reach_along(row, place, wall, two)
    for _ in range(48):
        if first >= second:
            high, two, second = two, one, first
            one = high - golden * (high - low)
            first = _reach_along(row, place, wall, one)
        else:
            low, one, first = one, two, second
            two = low + golden * (high - low)
            second = _reach_along(row, place, wall, two)
    return max(first, second)
