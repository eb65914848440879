"""Positions at which a sphere touches two spheres and the wall of a closed mesh.

The centers at which a sphere touches two others are a circle. The distance from the wall is continuous on it, so that
there is a point of contact between a point beyond the wall and one inside; it is found to the last digits. Disks that
touch a disk and the wall of a polygon have their centers on a circle in the plane.
"""

import math

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel
from voxgran.containers.kernel_container import KernelContainer, wall_of_mesh
from voxgran.geometry.vectors import along, sub
from voxgran.packing.advancing_front.sphere_cells import BITS
from voxgran.packing.advancing_front.tangent_spheres import ON_A_LINE, PLANE, center_of, place_at

#: the wall of a mesh, among the walls of :mod:`voxgran.packing.advancing_front.tangent_spheres`
WALL = -11
#: largest number of tested points of a circle
LOOKS = 60


@bare_kernel
def place_in(
    spheres: Floats, walls: KernelContainer, a: int, b: int, c: int, r: float
) -> tuple[bool, float, float, float]:
    """Return whether a sphere of radius r can touch a, b and c, and its center, as `place_at`; c may be WALL.

    In the plane of disks WALL and PLANE are b and c; their order decides the side.
    """
    if WALL in (b, c) and PLANE in (b, c):
        return _at_edge(spheres, walls, a, 1.0 if b == WALL else -1.0, r)
    if c == WALL:
        return _at_mesh(spheres, walls, a, b, r)
    return place_at(spheres, walls.lengths, walls.periods, a, b, c, r)


@bare_kernel
def _at_mesh(spheres, walls, a, b, r):  # type: ignore[no-untyped-def]
    """Return whether a sphere can touch two spheres and the wall of a mesh, and its center.

    The circle of centers is searched to the left from its point nearest to the wall.
    """
    nothing = False, 0.0, 0.0, 0.0
    ax, ay, az = center_of(spheres, walls.periods, a)
    ux, uy, uz = center_of(spheres, walls.periods, b)
    ux, uy, uz, d1, d2 = ux - ax, uy - ay, uz - az, spheres[a >> BITS, 3] + r, spheres[b >> BITS, 3] + r
    uu = ux * ux + uy * uy + uz * uz
    part = 0.5 * ((d1 - d2) * (d1 + d2) + uu) / uu
    height = d1 * d1 - part * part * uu
    if height < 0.0:
        return nothing
    wide, long = math.sqrt(height), math.sqrt(uu)
    x, y, z = ax + part * ux, ay + part * uy, az + part * uz
    away, qx, qy, qz = wall_of_mesh(walls.mesh, x, y, z)
    if abs(away + r) > wide:
        # a distance changes by no more than the length of a move
        return nothing
    sign = 1.0 if away < 0.0 else -1.0
    ex, ey, ez = sign * (qx - x), sign * (qy - y), sign * (qz - z)
    share = (ex * ux + ey * uy + ez * uz) / uu
    ex, ey, ez = ex - share * ux, ey - share * uy, ez - share * uz
    length = math.sqrt(ex * ex + ey * ey + ez * ez)
    if length <= ON_A_LINE * r:
        return nothing
    e = (wide * ex / length, wide * ey / length, wide * ez / length)
    f = ((uy * e[2] - uz * e[1]) / long, (uz * e[0] - ux * e[2]) / long, (ux * e[1] - uy * e[0]) / long)
    turn = _turn_to_wall(walls, (x, y, z), e, f, r)
    x, y, z = along(along((x, y, z), math.cos(turn), e), math.sin(turn), f)
    return turn >= 0.0, x, y, z


@bare_kernel
def _at_edge(spheres, walls, a, side, r):  # type: ignore[no-untyped-def]
    """Return whether a disk can touch a disk and the wall of a polygon, and its center.

    The circle of centers is searched to the left (side 1) or right (-1) from its point towards the nearest wall.
    """
    nothing = False, 0.0, 0.0, 0.0
    x, y, _ = center_of(spheres, walls.periods, a)
    wide = spheres[a >> BITS, 3] + r
    away, qx, qy, _ = wall_of_mesh(walls.mesh, x, y, 0.0)
    length = math.hypot(qx - x, qy - y)
    if abs(away + r) > wide or length <= ON_A_LINE * r:
        return nothing
    share = wide / length if away < 0.0 else -wide / length
    ex, ey = share * (qx - x), share * (qy - y)
    turn = _turn_to_wall(walls, (x, y, 0.0), (ex, ey, 0.0), (-side * ey, side * ex, 0.0), r)
    c, s = math.cos(turn), side * math.sin(turn)
    return turn >= 0.0, x + c * ex - s * ey, y + c * ey + s * ex, 0.0


@bare_kernel
def _turn_to_wall(walls, middle, e, f, r):  # type: ignore[no-untyped-def]
    """Return the angle in [0, pi] on a circle at which a sphere touches the wall; -1 if there is none."""
    low, high = 0.0, math.pi
    beyond = wall_of_mesh(walls.mesh, *along(middle, 1.0, e))[0] + r
    within = wall_of_mesh(walls.mesh, *sub(middle, e))[0] + r
    if beyond < 0.0 or within > 0.0:
        return -1.0
    near, last = 0.5 * walls.slack, 0
    for look in range(LOOKS):
        # regula falsi, with a bisection at each third step so that it converges
        part = 0.5 if look % 3 == 2 else beyond / max(beyond - within, 1e-300)
        turn = low + part * (high - low)
        gap = wall_of_mesh(walls.mesh, *along(along(middle, math.cos(turn), e), math.sin(turn), f))[0] + r
        if abs(gap) <= near:
            return turn
        if gap > 0.0:
            low, beyond = turn, gap
            within = 0.5 * within if last == 1 else within
            last = 1
        else:
            high, within = turn, gap
            beyond = 0.5 * beyond if last == -1 else beyond
            last = -1
    return -1.0
