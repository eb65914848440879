"""Where a sphere touches two spheres and the wall of a closed mesh.

The centers at which a sphere touches two others are a circle. On it the distance from the wall changes steadily, so
that between a place beyond the wall and one within there is one where the sphere touches it; it is found to the last
digits.
"""

import math

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel
from voxgran.containers.kernel_container import KernelContainer, wall_of_mesh
from voxgran.packing.advancing_front.level_grid import BITS
from voxgran.packing.advancing_front.tangent_spheres import ON_A_LINE, center_of, place_at

#: the wall of a mesh, among the walls of :mod:`voxgran.packing.advancing_front.tangent_spheres`
WALL = -11
#: places of a circle that are looked at, at most
LOOKS = 60


@bare_kernel
def place_in(
    spheres: Floats, room: KernelContainer, a: int, b: int, c: int, r: float
) -> tuple[bool, float, float, float]:
    """Return whether a sphere of radius r can touch a, b and c, and its center, as `place_at`; c may be a mesh."""
    if c == WALL:
        return _at_mesh(spheres, room, a, b, r)
    return place_at(spheres, room.lengths, a, b, c, r)


@bare_kernel
def _at_mesh(spheres, room, a, b, r):  # type: ignore[no-untyped-def]
    """Return whether a sphere can touch two spheres and the wall of a mesh, and its center.

    From where the circle of centers is nearest to the wall it is searched to the left.
    """
    nothing = False, 0.0, 0.0, 0.0
    ax, ay, az = center_of(spheres, room.lengths, a)
    ux, uy, uz = center_of(spheres, room.lengths, b)
    ux, uy, uz, d1, d2 = ux - ax, uy - ay, uz - az, spheres[a >> BITS, 3] + r, spheres[b >> BITS, 3] + r
    uu = ux * ux + uy * uy + uz * uz
    along = 0.5 * ((d1 - d2) * (d1 + d2) + uu) / uu
    height = d1 * d1 - along * along * uu
    if height < 0.0:
        return nothing
    wide, long = math.sqrt(height), math.sqrt(uu)
    x, y, z = ax + along * ux, ay + along * uy, az + along * uz
    away, qx, qy, qz = wall_of_mesh(room.mesh, x, y, z)
    if abs(away + r) > wide:
        # a distance changes by no more than the way
        return nothing
    sign = 1.0 if away < 0.0 else -1.0
    ex, ey, ez = sign * (qx - x), sign * (qy - y), sign * (qz - z)
    share = (ex * ux + ey * uy + ez * uz) / uu
    ex, ey, ez = ex - share * ux, ey - share * uy, ez - share * uz
    length = math.sqrt(ex * ex + ey * ey + ez * ez)
    if length <= ON_A_LINE * r:
        return nothing
    ex, ey, ez = wide * ex / length, wide * ey / length, wide * ez / length
    fx, fy, fz = (uy * ez - uz * ey) / long, (uz * ex - ux * ez) / long, (ux * ey - uy * ex) / long
    turn = _turn_to_wall(room, x, y, z, ex, ey, ez, fx, fy, fz, r)
    c, s = math.cos(turn), math.sin(turn)
    return turn >= 0.0, x + c * ex + s * fx, y + c * ey + s * fy, z + c * ez + s * fz


@bare_kernel
def _turn_to_wall(room, x, y, z, ex, ey, ez, fx, fy, fz, r):  # type: ignore[no-untyped-def]
    """Return at which angle of a circle, from 0 to half a turn, a sphere touches the wall; -1 where it does not."""
    low, high = 0.0, math.pi
    beyond = wall_of_mesh(room.mesh, x + ex, y + ey, z + ez)[0] + r
    within = wall_of_mesh(room.mesh, x - ex, y - ey, z - ez)[0] + r
    if beyond < 0.0 or within > 0.0:
        return -1.0
    near, last = 0.5 * room.slack, 0
    for look in range(LOOKS):
        # a line between the ends; each third time the middle, so that it never crawls
        part = 0.5 if look % 3 == 2 else beyond / max(beyond - within, 1e-300)
        turn = low + part * (high - low)
        c, s = math.cos(turn), math.sin(turn)
        told = wall_of_mesh(room.mesh, x + c * ex + s * fx, y + c * ey + s * fy, z + c * ez + s * fz)[0] + r
        if abs(told) <= near:
            return turn
        if told > 0.0:
            low, beyond = turn, told
            within = 0.5 * within if last == 1 else within
            last = 1
        else:
            high, within = turn, told
            beyond = 0.5 * beyond if last == -1 else beyond
            last = -1
    return -1.0
