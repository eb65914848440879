"""The container as kernels see it: does it hold a ball or an upright box, and may a small box hold such a centre?

Boxes and rectangles may be periodic along an axis, which then has no wall. A cylinder is upright. In a
closed mesh the distance of a centre from the surface is exact (:mod:`voxgran._base.tree`), so that a ball that is
held protrudes by no more than rounding.
"""

import math
from typing import NamedTuple

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel
from voxgran._base.tree import is_behind, nearest_triangle
from voxgran.containers.closed_mesh import ClosedMesh
from voxgran.containers.cylinder import Cylinder
from voxgran.containers.model import Container
from voxgran.containers.sphere import Sphere
from voxgran.shapes.mesh import Mesh

#: kinds of containers
FLAT, ROUND, CLOSED, BALL = 0, 1, 2, 3
#: a grain that reaches beyond a wall by this share of the container, or less, does so by rounding
ROUNDING = 1e-15


class Room(NamedTuple):
    """The container: bounds, which axes have walls and which are periodic (2D: z has neither), a round wall, a mesh.

    `middle` is a point of the axis of a cylinder, the centre of a sphere or the centroid of a mesh; `slack` is what
    rounding does.
    """

    kind: int
    lower: Floats
    lengths: Floats
    walled: Integers
    periodic: Integers
    radius: float
    middle: Floats
    slack: float
    corners: Floats
    low: Floats
    high: Floats
    start: Integers
    normals: Floats


def room_of(container: Container) -> Room:
    """Return a container as kernels take it."""
    lower, upper = (np.array(corner, dtype=np.float64) for corner in container.bounds)
    axes = np.arange(3) < container.dimension
    periodic = np.array(container.periodic, dtype=np.int64)
    walled = np.where(axes, 1 - periodic, 0).astype(np.int64)
    lengths = np.where(axes, upper - lower, 1.0)
    kind, radius, middle = FLAT, 0.0, (lower + upper) / 2
    tree: tuple[Floats, Floats, Floats, Integers, Floats] = (
        *(np.zeros((0, 3, 3)), np.zeros((0, 3)), np.zeros((0, 3))),
        *(np.zeros((0, 2), dtype=np.int64), np.zeros((0, 7, 3))),
    )
    if isinstance(container, Cylinder):
        kind, radius = ROUND, float(container.radius)
    elif isinstance(container, Sphere):
        kind, radius = BALL, float(container.radius)
    elif isinstance(container, ClosedMesh):
        assert isinstance(container.shape.geometry, Mesh)
        grown = container.shape.geometry.tree
        kind, middle = CLOSED, np.array(container.shape.offset, dtype=np.float64)
        tree = (*grown.arrays, grown.normals)
    slack = ROUNDING * float(lengths.max() + np.abs(lower).max())
    return Room(kind, lower, lengths, walled, periodic, radius, middle, slack, *tree)


@bare_kernel
def is_held(room: Room, x: float, y: float, z: float, hx: float, hy: float, hz: float) -> bool:
    """Tell whether the container holds a grain with its centre at (x, y, z).

    hx, hy, hz: half its extents; in a round or a closed container it is the ball of radius hx.
    """
    if not is_between(room, x, y, z, hx, hy, hz):
        return False
    if room.kind in (ROUND, BALL):
        dx, dy, dz = x - room.middle[0], y - room.middle[1], z - room.middle[2] if room.kind == BALL else 0.0
        return math.sqrt(dx * dx + dy * dy + dz * dz) + hx <= room.radius + room.slack
    if room.kind == CLOSED:
        return _depth(room, x, y, z) >= hx
    return True


@bare_kernel
def is_between(room: Room, x: float, y: float, z: float, hx: float, hy: float, hz: float) -> bool:
    """Tell whether a box of half extents (hx, hy, hz) lies within the bounds along the axes that have walls."""
    lower, lengths, walled, slack = room.lower, room.lengths, room.walled, room.slack
    if walled[0] == 1 and (x - hx < lower[0] - slack or x + hx > lower[0] + lengths[0] + slack):
        return False
    if walled[1] == 1 and (y - hy < lower[1] - slack or y + hy > lower[1] + lengths[1] + slack):
        return False
    return walled[2] == 0 or (z - hz >= lower[2] - slack and z + hz <= lower[2] + lengths[2] + slack)


@bare_kernel
def is_barred(room: Room, x: float, y: float, z: float, ex: float, ey: float, ez: float, radius: float) -> bool:
    """Tell whether no point of a box can be the centre of a ball that the container holds.

    The box has its middle at (x, y, z) and half extents (ex, ey, ez).
    """
    if _is_beyond(room, 0, x, ex, radius) or _is_beyond(room, 1, y, ey, radius) or _is_beyond(room, 2, z, ez, radius):
        return True
    if room.kind in (ROUND, BALL):
        dx = max(abs(x - room.middle[0]) - ex, 0.0)
        dy = max(abs(y - room.middle[1]) - ey, 0.0)
        dz = max(abs(z - room.middle[2]) - ez, 0.0) if room.kind == BALL else 0.0
        return math.sqrt(dx * dx + dy * dy + dz * dz) + radius > room.radius + room.slack
    if room.kind == CLOSED:
        # a depth changes by no more than the way
        return _depth(room, x, y, z) + math.sqrt(ex * ex + ey * ey + ez * ez) < radius
    return False


@bare_kernel
def _is_beyond(room, axis, x, ex, radius):  # type: ignore[no-untyped-def]
    """Tell whether all places from x - ex to x + ex are too near to a flat wall for a ball."""
    if room.walled[axis] == 0:
        return False
    low, high = room.lower[axis] + radius, room.lower[axis] + room.lengths[axis] - radius
    return x + ex < low - room.slack or x - ex > high + room.slack


@bare_kernel
def _depth(room, x, y, z):  # type: ignore[no-untyped-def]
    """Return how deep a point lies inside a closed mesh; negative outside."""
    qx, qy, qz = x - room.middle[0], y - room.middle[1], z - room.middle[2]
    square, k, feature, px, py, pz = nearest_triangle(
        room.corners, room.low, room.high, room.start, qx, qy, qz, math.inf
    )
    inside = is_behind(room.normals, k, feature, qx - px, qy - py, qz - pz)
    return math.sqrt(square) if inside else -math.sqrt(square)
