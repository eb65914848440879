"""Containers in kernels: whether a sphere or an upright box lies inside, and whether a small box may hold its center.

Boxes and rectangles may be periodic along an axis, which then has no wall. A cylinder is upright; a disk is one without
ends, and a polygon a closed mesh, both at z = 0 (:mod:`voxgran.containers.plane`). Walls of revolution are the rows of
a list (:mod:`voxgran.geometry.walls`). In a closed mesh the distance of a center from the surface is exact
(:mod:`voxgran.geometry.tree`), so that an accepted sphere protrudes by no more than rounding.

The advancing front counts coordinates from the lower corner and has tests of its own
(:mod:`voxgran.packing.advancing_front.container`). Control points keep convex hulls within walls, which move with a lid
(:mod:`voxgran.packing.control_point.walls`).
"""

import math
from typing import NamedTuple

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel
from voxgran.containers.model import Container, boundary_of, periods_of
from voxgran.geometry.periods import shortest_period
from voxgran.geometry.tree import STACK, is_behind, search_triangles
from voxgran.geometry.walls import least_reach, reach_of
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape

#: walls beside flat ones: none, a cylinder or a disk, a sphere, a closed mesh or a polygon, or any walls of revolution
FLAT, UPRIGHT, ROUND, MESH, SEVERAL = 0, 1, 2, 3, 4
#: largest reach beyond a wall that is rounding, in lengths of the container
ROUNDING = 1e-15


class MeshWalls(NamedTuple):
    """The walls of a closed mesh: its tree, about `shift`, and work space for searches; empty for other containers.

    clearance: signed distances of the centers of cubic cells of edge `cell` from the surface, negative inside, counted
    from `lower` of the container; empty where no map was asked for.
    """

    corners: Floats
    low: Floats
    high: Floats
    start: Integers
    normals: Floats
    shift: Floats
    stack: Integers
    clearance: Floats
    cell: float


class KernelContainer(NamedTuple):
    """A container as kernels take it.

    kind: FLAT, UPRIGHT, ROUND, MESH or SEVERAL.  lower, lengths: of the bounds; in two dimensions the length along z is
    1, or 0 in coordinates from the corner.
    periods: (3, 3) vectors by which it repeats, 0 along axes that are not periodic.  shortest: of their sums.
    walled, periodic: which axes are, as 0 or 1 (in two dimensions z is neither).  flat: which have plane walls.
    round: (k, 16) rows of the walls of revolution.  radius: of a cylinder or a sphere that is the only one of these.
    middle: of the bounds, which is on the axis of a cylinder and the center of a sphere.  slack: length up to which a
    sphere may reach beyond a wall, by rounding.  mesh: walls of a closed mesh.
    """

    kind: int
    dimension: int
    lower: Floats
    lengths: Floats
    periods: Floats
    shortest: float
    walled: Integers
    periodic: Integers
    flat: Integers
    round: Floats
    radius: float
    middle: Floats
    slack: float
    mesh: MeshWalls


def kernel_container(
    container: Container, *, from_corner: bool = False, slack: float | None = None, map_cell: float | None = None
) -> KernelContainer:
    """Return a container as kernels take it, with coordinates from the lower corner of the bounds if `from_corner`.

    A sphere may reach beyond a wall by `slack`, by default the rounding error of its coordinates. With `map_cell`, the
    edge of its cells, a closed mesh gets a map of clearances.
    """
    boundary = boundary_of(container)
    lower, upper = (np.array(corner, dtype=np.float64) for corner in container.bounds)
    periodic = np.array(container.periodic, dtype=np.int64)
    walled = np.where(np.arange(3) < container.dimension, 1 - periodic, 0).astype(np.int64)
    lengths, middle = upper - lower, np.mean(container.bounds, axis=0)
    mesh_walls = _mesh_walls(boundary.solid, lower if from_corner else np.zeros(3))
    if boundary.solid is not None and map_cell is not None:
        assert isinstance(boundary.solid.geometry, Mesh)
        count = np.maximum(np.ceil(lengths / map_cell), 1).astype(np.int64)
        points: Floats = (np.indices(count.tolist()).reshape(3, -1).T + 0.5) * map_cell
        distance = boundary.solid.geometry.tree.signed_distance(points + mesh_walls.shift)
        mesh_walls = mesh_walls._replace(clearance=distance.reshape(count), cell=map_cell)
    if from_corner:
        lower, middle = np.zeros(3), lengths / 2
    else:
        lengths = np.where(np.arange(3) < container.dimension, lengths, 1.0)
    if slack is None:
        slack = ROUNDING * float(lengths.max() + np.abs(lower).max())
    rows = np.array([wall.row for wall in boundary.round]).reshape(-1, 16)
    sole = boundary.cylinder or boundary.sphere
    if sole:
        kind = UPRIGHT if sole.axes == 2 else ROUND
        rows[0, :3] = middle
    else:
        kind = MESH if boundary.solid is not None else SEVERAL if len(rows) else FLAT
        rows[:, :3] -= np.array(container.bounds[0]) if from_corner else 0.0
    periods = periods_of(container)
    repeats, flat = (periods, shortest_period(periods)), np.array(boundary.flat, dtype=np.int64)
    axes = (lower, lengths, *repeats, walled, periodic, flat, rows)
    radius = float(sole.radius) if sole else 0.0
    return KernelContainer(kind, container.dimension, *axes, radius, middle, slack, mesh_walls)


def _mesh_walls(solid: Shape | None, origin: Floats) -> MeshWalls:
    """Return the walls of a closed mesh in coordinates from an origin; empty ones where there is none."""
    no_map = np.zeros((0, 0, 0)), 1.0
    if solid is None:
        return MeshWalls(
            *(np.zeros((0, 3, 3)), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 2), dtype=np.int64)),
            *(np.zeros((0, 7, 3)), np.zeros(3), np.zeros(0, dtype=np.int64)),
            *no_map,
        )
    assert isinstance(solid.geometry, Mesh)
    tree = solid.geometry.tree
    # writable copies, as the arrays of other containers are: kernels are compiled once
    corners, low, high = tree.corners.copy(), tree.low.copy(), tree.high.copy()
    shift = origin - np.array(solid.offset, dtype=np.float64)
    stack = np.zeros(STACK, dtype=np.int64)
    return MeshWalls(corners, low, high, tree.start.copy(), tree.normals.copy(), shift, stack, *no_map)


@bare_kernel
def is_held(walls: KernelContainer, x: float, y: float, z: float, hx: float, hy: float, hz: float) -> bool:
    """Return whether the container holds a grain with its centre at (x, y, z).

    hx, hy, hz: half its extents; in a round or a closed container it is the sphere of radius hx.
    """
    if not is_between(walls, x, y, z, hx, hy, hz):
        return False
    for k in range(len(walls.round)):
        if reach_of(walls.round[k], x, y, z) + hx > walls.round[k, 6] + walls.slack:
            return False
    if walls.kind == MESH:
        return -mesh_distance(walls.mesh, x, y, z) >= hx
    return True


@bare_kernel
def clearance(walls: KernelContainer, x: float, y: float, z: float) -> float:
    """Return the radius of the largest sphere about a point that the container holds; negative outside.

    In a periodic one it is half the shortest period at most, beyond which a sphere overlaps its image.
    """
    room = 0.5 * walls.shortest
    for axis in range(walls.dimension):
        along = (x if axis == 0 else y if axis == 1 else z) - walls.lower[axis]
        if walls.walled[axis] == 1:
            room = min(room, along, walls.lengths[axis] - along)
    for k in range(len(walls.round)):
        room = min(room, walls.round[k, 6] - reach_of(walls.round[k], x, y, z))
    if walls.kind == MESH and room > 0.0:
        room = min(room, -mesh_distance(walls.mesh, x, y, z))
    return room


@bare_kernel
def is_between(walls: KernelContainer, x: float, y: float, z: float, hx: float, hy: float, hz: float) -> bool:
    """Return whether a box of half extents (hx, hy, hz) lies within the bounds along the axes that have walls."""
    lower, lengths, walled, slack = walls.lower, walls.lengths, walls.walled, walls.slack
    if walled[0] == 1 and (x - hx < lower[0] - slack or x + hx > lower[0] + lengths[0] + slack):
        return False
    if walled[1] == 1 and (y - hy < lower[1] - slack or y + hy > lower[1] + lengths[1] + slack):
        return False
    return walled[2] == 0 or (z - hz >= lower[2] - slack and z + hz <= lower[2] + lengths[2] + slack)


@bare_kernel
def is_barred(
    walls: KernelContainer, x: float, y: float, z: float, ex: float, ey: float, ez: float, radius: float
) -> bool:
    """Return whether no point of a box can be the centre of a sphere that the container holds.

    The box has its middle at (x, y, z) and half extents (ex, ey, ez).
    """
    if (
        _is_beyond(walls, 0, x, ex, radius)
        or _is_beyond(walls, 1, y, ey, radius)
        or _is_beyond(walls, 2, z, ez, radius)
    ):
        return True
    for k in range(len(walls.round)):
        if least_reach(walls.round[k], x, y, z, ex, ey, ez) + radius > walls.round[k, 6] + walls.slack:
            return True
    if walls.kind == MESH:
        # a depth changes by no more than the way
        return math.sqrt(ex * ex + ey * ey + ez * ez) - mesh_distance(walls.mesh, x, y, z) < radius
    return False


@bare_kernel
def _is_beyond(walls, axis, x, ex, radius):  # type: ignore[no-untyped-def]
    """Return whether all places from x - ex to x + ex are too near to a flat wall for a sphere."""
    if walls.walled[axis] == 0:
        return False
    low, high = walls.lower[axis] + radius, walls.lower[axis] + walls.lengths[axis] - radius
    return x + ex < low - walls.slack or x - ex > high + walls.slack


@bare_kernel
def mesh_distance(mesh: MeshWalls, x: float, y: float, z: float) -> float:
    """Return the distance of a point from the surface of a closed mesh, negative inside."""
    return wall_of_mesh(mesh, x, y, z)[0]


@bare_kernel
def wall_of_mesh(mesh: MeshWalls, x: float, y: float, z: float) -> tuple[float, float, float, float]:
    """Return the distance of a point from the surface of a closed mesh, negative inside, and its nearest point."""
    sx, sy, sz = mesh.shift[0], mesh.shift[1], mesh.shift[2]
    px, py, pz = x + sx, y + sy, z + sz
    square, triangle, feature, qx, qy, qz = search_triangles(
        mesh.corners, mesh.low, mesh.high, mesh.start, px, py, pz, np.inf, mesh.stack
    )
    behind = is_behind(mesh.normals, triangle, feature, px - qx, py - qy, pz - qz)
    return -math.sqrt(square) if behind else math.sqrt(square), qx - sx, qy - sy, qz - sz
