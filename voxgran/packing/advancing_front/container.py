"""The room that a container leaves to the spheres of an advancing front, in coordinates from its lower corner.

Beyond :mod:`voxgran.containers.kernel_container`: where the container is widest, places that keep off walls, and for
closed meshes a coarse map of clearances, which answers far from the walls.
"""

import math
from typing import NamedTuple

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel
from voxgran.containers.kernel_container import FLAT, ROUND, UPRIGHT, MeshWalls, frame_of, mesh_distance, walls_of
from voxgran.containers.model import Container, boundary_of
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape

#: most cells of the map of clearances along an axis
MOST_CELLS = 64


class FrontRoom(NamedTuple):
    """Where the center of a sphere may be.

    kind: FLAT, UPRIGHT (a cylinder), ROUND (a sphere) or MESH.  lengths: of the bounds.  periodic, walled: which axes
    are, as 0 or 1.  center: where the room is widest.  radius: of a cylinder or a sphere.  slack: lengths up to here
    are rounding.  mesh: the walls of a mesh.  clearance: distance of the centers of cells of width `cell` from them,
    negative inside.
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
    clearance: Floats
    cell: float


def front_room_of(container: Container, smallest: float) -> FrontRoom:
    """Return the room of a container.

    Parameters
    ----------
    container : Container
        What holds the spheres.
    smallest : float
        Radius of the smallest sphere, in the unit of the container.

    Returns
    -------
    FrontRoom
    """
    frame = frame_of(container)
    lengths, walls = frame.lengths, walls_of(container, frame.lower)
    slack = 1e-12 * smallest + 8 * float(np.spacing(lengths.max()))
    center, clearance, cell = lengths / 2, np.zeros((0, 0, 0)), 1.0
    solid = boundary_of(container).solid
    if solid is not None:
        clearance, cell = _clearances(solid, walls, lengths, smallest)
        # the center of the cell that is farthest from the walls
        widest = np.unravel_index(int(np.argmin(clearance)), clearance.shape)
        center = (np.array(widest, dtype=np.float64) + 0.5) * cell
    axes = (lengths, frame.periodic, frame.walled)
    return FrontRoom(
        *(frame.kind, container.dimension, *axes, center, frame.radius, slack, walls, clearance, cell),
    )


def _clearances(solid: Shape, walls: MeshWalls, lengths: Floats, smallest: float) -> tuple[Floats, float]:
    """Return the map of clearances and the width of its cells."""
    assert isinstance(solid.geometry, Mesh)
    cell = float(max(smallest, lengths.max() / MOST_CELLS))
    count = np.ceil(lengths / cell).astype(np.int64)
    points: Floats = (np.indices(count.tolist()).reshape(3, -1).T + 0.5) * cell
    return solid.geometry.tree.signed_distance(points + walls.shift).reshape(count), cell


@bare_kernel
def is_inside(room: FrontRoom, x: float, y: float, z: float, r: float) -> bool:
    """Return whether a sphere reaches through no wall, and not through itself across a periodic axis."""
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
    """Return a place at which a sphere keeps off flat walls, the side of a cylinder and the wall of a sphere."""
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
    """Return the nearest coordinate at which a sphere keeps off both walls of an axis."""
    return min(max(at, r), room.lengths[axis] - r) if room.walled[axis] == 1 else at


@bare_kernel
def _within(room: FrontRoom, axis: int, at: float, r: float) -> bool:
    """Return whether a sphere keeps the room along an axis."""
    length = room.lengths[axis]
    if room.walled[axis] == 0:
        return 2.0 * r <= length + room.slack
    return at - r >= -room.slack and at + r <= length + room.slack


@bare_kernel
def _mesh_distance(room: FrontRoom, x: float, y: float, z: float, r: float) -> float:
    """Return the distance of a point from the wall of a mesh, negative inside; a bound where that tells enough.

    A distance changes by no more than the way: far from where a sphere touches, the map of clearances tells.
    """
    cell, last = room.cell, room.clearance.shape
    i = min(max(int(x / cell), 0), last[0] - 1)
    j = min(max(int(y / cell), 0), last[1] - 1)
    k = min(max(int(z / cell), 0), last[2] - 1)
    known = room.clearance[i, j, k]
    dx, dy, dz = x - (i + 0.5) * cell, y - (j + 0.5) * cell, z - (k + 0.5) * cell
    way = math.sqrt(dx * dx + dy * dy + dz * dz)
    if known + way < -r:
        return known + way
    if known - way > -r:
        return known - way
    return mesh_distance(room.mesh, x, y, z)


@bare_kernel
def is_near_mesh(room: FrontRoom, x: float, y: float, z: float, reach: float) -> bool:
    """Return whether a point may be within reach of the wall of a mesh, by the map of clearances."""
    cell, last = room.cell, room.clearance.shape
    i = min(max(int(x / cell), 0), last[0] - 1)
    j = min(max(int(y / cell), 0), last[1] - 1)
    k = min(max(int(z / cell), 0), last[2] - 1)
    dx, dy, dz = x - (i + 0.5) * cell, y - (j + 0.5) * cell, z - (k + 0.5) * cell
    return room.clearance[i, j, k] + math.sqrt(dx * dx + dy * dy + dz * dz) >= -reach
