"""Tests of spheres of an advancing front against the walls of the container, in coordinates from its lower corner.

In closed meshes a coarse map of clearances replaces the exact distance wherever it decides. A sphere must also not
overlap its own images across a periodic axis.
"""

import math

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel
from voxgran.containers.kernel_container import FLAT, ROUND, UPRIGHT, KernelContainer, kernel_container, mesh_distance
from voxgran.containers.model import Container

#: most cells of the map of clearances along an axis
MOST_CELLS = 64


def front_container(container: Container, smallest: float) -> tuple[KernelContainer, Floats]:
    """Return a container in coordinates from its lower corner, and the point (3,) farthest from the walls.

    `smallest` is the radius of the smallest sphere. A closed mesh has a map of clearances, which decides the point;
    otherwise it is the middle of the bounds.
    """
    longest = float((container.bounds[1] - container.bounds[0]).max())
    slack = 1e-12 * smallest + 8 * float(np.spacing(longest))
    cell = float(max(smallest, longest / MOST_CELLS))
    walls = kernel_container(container, from_corner=True, slack=slack, map_cell=cell)
    clearance = walls.mesh.clearance
    if not clearance.size:
        return walls, walls.middle
    widest = np.unravel_index(int(np.argmin(clearance)), clearance.shape)
    place = (np.array(widest, dtype=np.float64) + 0.5) * cell
    return walls, np.where(np.arange(3) < container.dimension, place, 0.0)


@bare_kernel
def is_inside(walls: KernelContainer, x: float, y: float, z: float, r: float) -> bool:
    """Return whether a sphere is within all walls and does not overlap its own periodic images."""
    if not _within(walls, 0, x, r) or not _within(walls, 1, y, r):
        return False
    if walls.dimension == 3 and not _within(walls, 2, z, r):
        return False
    if walls.kind == UPRIGHT:
        return math.hypot(x - walls.radius, y - walls.radius) + r <= walls.radius + walls.slack
    if walls.kind == ROUND:
        dx, dy, dz = x - walls.radius, y - walls.radius, z - walls.radius
        return math.sqrt(dx * dx + dy * dy + dz * dz) + r <= walls.radius + walls.slack
    return walls.kind == FLAT or _mesh_distance(walls, x, y, z, r) + r <= walls.slack


@bare_kernel
def pulled_in(walls: KernelContainer, x: float, y: float, z: float, r: float) -> tuple[float, float, float]:
    """Return a position moved inward until the sphere is within flat walls, a cylinder or a spherical wall."""
    x, y = _between_walls(walls, 0, x, r), _between_walls(walls, 1, y, r)
    z = _between_walls(walls, 2, z, r) if walls.dimension == 3 else z
    if walls.kind in (UPRIGHT, ROUND):
        dx, dy = x - walls.radius, y - walls.radius
        dz = z - walls.radius if walls.kind == ROUND else 0.0
        part = max(walls.radius - r, 0.0) / max(math.sqrt(dx * dx + dy * dy + dz * dz), 1e-300)
        if part < 1.0:
            x, y = walls.radius + part * dx, walls.radius + part * dy
            z = walls.radius + part * dz if walls.kind == ROUND else z
    return x, y, z


@bare_kernel
def _between_walls(walls: KernelContainer, axis: int, at: float, r: float) -> float:
    """Return the nearest coordinate at which a sphere is within both walls of an axis."""
    return min(max(at, r), walls.lengths[axis] - r) if walls.walled[axis] == 1 else at


@bare_kernel
def _within(walls: KernelContainer, axis: int, at: float, r: float) -> bool:
    """Return whether a sphere is within the walls along an axis, or fits between its periodic images."""
    length = walls.lengths[axis]
    if walls.walled[axis] == 0:
        return 2.0 * r <= walls.shortest + walls.slack
    return at - r >= -walls.slack and at + r <= length + walls.slack


@bare_kernel
def _mesh_distance(walls: KernelContainer, x: float, y: float, z: float, r: float) -> float:
    """Return the distance of a point from the wall of a mesh, negative inside; a bound where it decides.

    A distance changes by no more than the length of a move: far from contact the map of clearances decides.
    """
    known, way = _mapped(walls, x, y, z)
    if known + way < -r:
        return known + way
    if known - way > -r:
        return known - way
    return mesh_distance(walls.mesh, x, y, z)


@bare_kernel
def is_near_mesh(walls: KernelContainer, x: float, y: float, z: float, reach: float) -> bool:
    """Return whether a point may be within reach of the wall of a mesh, by the map of clearances."""
    known, way = _mapped(walls, x, y, z)
    return known + way >= -reach


@bare_kernel
def _mapped(walls, x, y, z):  # type: ignore[no-untyped-def]
    """Return what the map of clearances has in the cell of a point, and the distance of the point from its middle."""
    cell, last = walls.mesh.cell, walls.mesh.clearance.shape
    i = min(max(int(x / cell), 0), last[0] - 1)
    j = min(max(int(y / cell), 0), last[1] - 1)
    k = min(max(int(z / cell), 0), last[2] - 1)
    dx, dy, dz = x - (i + 0.5) * cell, y - (j + 0.5) * cell, z - (k + 0.5) * cell
    return walls.mesh.clearance[i, j, k], math.sqrt(dx * dx + dy * dy + dz * dz)
