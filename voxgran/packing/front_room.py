"""The room that a container leaves to balls: its walls as kernels take them, in coordinates from its lower corner."""

import math
from typing import NamedTuple

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel
from voxgran._base.tree import STACK, grow_tree, is_behind, search_triangles
from voxgran.containers.closed_mesh import ClosedMesh
from voxgran.containers.cylinder import Cylinder
from voxgran.containers.model import Container
from voxgran.containers.sphere import Sphere
from voxgran.shapes.mesh import Mesh

FLAT, UPRIGHT, ROUND, MESH = 0, 1, 2, 3
#: most cells of the map of clearances along an axis
MOST_CELLS = 64


class MeshWalls(NamedTuple):
    """The walls of a closed mesh.

    corners ... normals: its tree, about `shift`.  clearance: distance of the centers of cells of width `cell` from the
    walls, negative inside.  stack: room for searches.
    """

    corners: Floats
    low: Floats
    high: Floats
    start: Integers
    normals: Floats
    shift: Floats
    clearance: Floats
    cell: float
    stack: Integers


class FrontRoom(NamedTuple):
    """Where the center of a ball may be.

    kind: FLAT, UPRIGHT (a cylinder), ROUND (a sphere) or MESH.  lengths: of the bounds.  periodic, walled: which axes
    are, as 0 or 1.  center: where the room is widest.  radius: of a cylinder or a sphere.  slack: lengths up to here
    are rounding.
    """

    kind: int
    dimension: int
    lengths: Floats
    periodic: Integers
    walled: Integers
    center: Floats
    radius: float
    slack: float
    mesh: MeshWalls


def front_room_of(container: Container, smallest: float) -> FrontRoom:
    """Return the room of a container.

    Parameters
    ----------
    container : Container
        What holds the balls.
    smallest : float
        Radius of the smallest ball, in the unit of the container.

    Returns
    -------
    FrontRoom
    """
    lower, upper = container.bounds
    lengths = np.array(upper - lower)
    periodic = np.array(container.periodic, dtype=np.int64)
    walled = np.where(np.arange(3) < container.dimension, 1 - periodic, 0).astype(np.int64)
    slack = 1e-12 * smallest + 8 * float(np.spacing(lengths.max()))
    none = MeshWalls(
        *(np.zeros((0, 3, 3)), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 2), np.int64), np.zeros((0, 7, 3))),
        *(np.zeros(3), np.zeros((0, 0, 0)), 1.0, np.zeros(0, dtype=np.int64)),
    )
    head = (container.dimension, lengths, periodic, walled)
    if isinstance(container, ClosedMesh):
        walls = _walls_of_mesh(container, lengths, smallest)
        return FrontRoom(MESH, *head, _widest(walls), 0.0, slack, walls)
    if isinstance(container, Cylinder):
        return FrontRoom(UPRIGHT, *head, lengths / 2, float(container.radius), slack, none)
    if isinstance(container, Sphere):
        return FrontRoom(ROUND, *head, lengths / 2, float(container.radius), slack, none)
    return FrontRoom(FLAT, *head, lengths / 2, 0.0, slack, none)


def _walls_of_mesh(container: ClosedMesh, lengths: Floats, smallest: float) -> MeshWalls:
    """Return the tree of a mesh, and the map of its clearances."""
    geometry = container.shape.geometry
    assert isinstance(geometry, Mesh)
    tree = grow_tree(geometry.vertices, geometry.faces)
    shift = container.bounds[0] - np.array(container.shape.offset)
    cell = float(max(smallest, lengths.max() / MOST_CELLS))
    count = np.ceil(lengths / cell).astype(np.int64)
    points: Floats = (np.indices(count.tolist()).reshape(3, -1).T + 0.5) * cell
    clearance = tree.signed_distance(points + shift).reshape(count)
    # copies that may be written, as the arrays of other containers may: kernels are compiled once
    arrays = (tree.corners.copy(), tree.low.copy(), tree.high.copy(), tree.start.copy(), tree.normals.copy())
    return MeshWalls(*arrays, shift, clearance, cell, np.zeros(STACK, dtype=np.int64))


def _widest(walls: MeshWalls) -> Floats:
    """Return the center of the cell that is farthest from the walls."""
    cell = np.unravel_index(int(np.argmin(walls.clearance)), walls.clearance.shape)
    return (np.array(cell, dtype=np.float64) + 0.5) * walls.cell


@bare_kernel
def is_inside(room: FrontRoom, x: float, y: float, z: float, r: float) -> bool:
    """Tell whether a ball reaches through no wall, and not through itself across a periodic axis."""
    if not _within(room, 0, x, r) or not _within(room, 1, y, r):
        return False
    if room.dimension == 3 and not _within(room, 2, z, r):
        return False
    if room.kind == UPRIGHT:
        return math.hypot(x - room.radius, y - room.radius) + r <= room.radius + room.slack
    if room.kind == ROUND:
        dx, dy, dz = x - room.radius, y - room.radius, z - room.radius
        return math.sqrt(dx * dx + dy * dy + dz * dz) + r <= room.radius + room.slack
    return room.kind == FLAT or _mesh_distance(room, x, y, z, r) + r <= room.slack


@bare_kernel
def pulled_in(room: FrontRoom, x: float, y: float, z: float, r: float) -> tuple[float, float, float]:
    """Return a place at which a ball keeps off flat walls, the side of a cylinder and the wall of a sphere."""
    x, y = _between_walls(room, 0, x, r), _between_walls(room, 1, y, r)
    z = _between_walls(room, 2, z, r) if room.dimension == 3 else z
    if room.kind in (UPRIGHT, ROUND):
        dx, dy = x - room.radius, y - room.radius
        dz = z - room.radius if room.kind == ROUND else 0.0
        part = max(room.radius - r, 0.0) / max(math.sqrt(dx * dx + dy * dy + dz * dz), 1e-300)
        if part < 1.0:
            x, y = room.radius + part * dx, room.radius + part * dy
            z = room.radius + part * dz if room.kind == ROUND else z
    return x, y, z


@bare_kernel
def _between_walls(room: FrontRoom, axis: int, at: float, r: float) -> float:
    """Return the nearest coordinate at which a ball keeps off both walls of an axis."""
    return min(max(at, r), room.lengths[axis] - r) if room.walled[axis] == 1 else at


@bare_kernel
def _within(room: FrontRoom, axis: int, at: float, r: float) -> bool:
    """Tell whether a ball keeps the room along an axis."""
    length = room.lengths[axis]
    if room.walled[axis] == 0:
        return 2.0 * r <= length + room.slack
    return at - r >= -room.slack and at + r <= length + room.slack


@bare_kernel
def _mesh_distance(room: FrontRoom, x: float, y: float, z: float, r: float) -> float:
    """Return the distance of a point from the wall of a mesh, negative inside; a bound where that tells enough.

    A distance changes by no more than the way: far from where a ball touches, the map of clearances tells.
    """
    mesh = room.mesh
    i = min(max(int(x / mesh.cell), 0), mesh.clearance.shape[0] - 1)
    j = min(max(int(y / mesh.cell), 0), mesh.clearance.shape[1] - 1)
    k = min(max(int(z / mesh.cell), 0), mesh.clearance.shape[2] - 1)
    known = mesh.clearance[i, j, k]
    dx, dy, dz = x - (i + 0.5) * mesh.cell, y - (j + 0.5) * mesh.cell, z - (k + 0.5) * mesh.cell
    way = math.sqrt(dx * dx + dy * dy + dz * dz)
    if known + way < -r:
        return known + way
    if known - way > -r:
        return known - way
    return wall_of_mesh(room, x, y, z)[0]


@bare_kernel
def wall_of_mesh(room: FrontRoom, x: float, y: float, z: float) -> tuple[float, float, float, float]:
    """Return the distance of a point from the wall of a mesh, negative inside, and the nearest point of the wall."""
    mesh = room.mesh
    sx, sy, sz = mesh.shift[0], mesh.shift[1], mesh.shift[2]
    px, py, pz = x + sx, y + sy, z + sz
    square, triangle, feature, qx, qy, qz = search_triangles(
        mesh.corners, mesh.low, mesh.high, mesh.start, px, py, pz, np.inf, mesh.stack
    )
    behind = is_behind(mesh.normals, triangle, feature, px - qx, py - qy, pz - qz)
    return -math.sqrt(square) if behind else math.sqrt(square), qx - sx, qy - sy, qz - sz


@bare_kernel
def is_near_mesh(room: FrontRoom, x: float, y: float, z: float, reach: float) -> bool:
    """Tell whether a point may be within reach of the wall of a mesh, by the map of clearances."""
    mesh = room.mesh
    i = min(max(int(x / mesh.cell), 0), mesh.clearance.shape[0] - 1)
    j = min(max(int(y / mesh.cell), 0), mesh.clearance.shape[1] - 1)
    k = min(max(int(z / mesh.cell), 0), mesh.clearance.shape[2] - 1)
    dx, dy, dz = x - (i + 0.5) * mesh.cell, y - (j + 0.5) * mesh.cell, z - (k + 0.5) * mesh.cell
    return mesh.clearance[i, j, k] + math.sqrt(dx * dx + dy * dy + dz * dz) >= -reach
