"""Planes between two grains: along some direction one ends before the other begins.

A separating direction usually remains valid after a small move, so the last one is cached. If it fails, it is reflected
about the line through the two support points, a few times (Chung & Wang 1996).

References
----------
Chung & Wang 1996, Quick collision detection of polytopes in virtual environments, Proceedings of the ACM Symposium on
Virtual Reality Software and Technology, 125-132, doi:10.1145/3304181.3304206
"""

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel, inlined_kernel
from voxgran.geometry.rotation import matrix_of
from voxgran.geometry.vectors import Vector
from voxgran.packing.control_point.distance_fields import plane_of

#: directions that are tried one after the other
TRIES = 3


@bare_kernel
def write_span(values: NDArray[np.float32], s: int, size: float, turn: Floats, span: Floats) -> None:
    """Write how far a grain in some turn reaches down and up along each axis."""
    for axis in range(3):
        x, y, z = turn[axis, 0], turn[axis, 1], turn[axis, 2]
        px, py, pz = plane_of(values, s, x, y, z)
        span[2 * axis + 1] = size * (px * x + py * y + pz * z)
        px, py, pz = plane_of(values, s, -x, -y, -z)
        span[2 * axis] = size * (px * x + py * y + pz * z)


@inlined_kernel
def find_plane(
    values: NDArray[np.float32], one: tuple[int, float, Floats], other: tuple[int, float, Floats], offset: Vector,
    low: float, way: Floats, tries: int,
) -> bool:  # fmt: skip
    """Return whether two grains are apart by `low` along `way` or a direction found from it.

    Of the first grain shape, diameter and rotation matrix are given, of the other shape, diameter and unit quaternion;
    `offset` leads from the center of the other to that of the first. `way` (7,) holds a unit vector, about from the
    other grain to the first, with which to begin and which is changed to the next one to be tried; the best one so far,
    and how far apart it shows the two. At most `tries` directions are tried.
    """
    (s, size, turn), (t, unit, q), (dx, dy, dz) = one, other, offset
    r0, r1, r2, r3, r4, r5, r6, r7, r8 = matrix_of(q)
    t0, t1, t2 = turn[0, 0], turn[0, 1], turn[0, 2]
    t3, t4, t5 = turn[1, 0], turn[1, 1], turn[1, 2]
    t6, t7, t8 = turn[2, 0], turn[2, 1], turn[2, 2]
    nx, ny, nz, best = way[0], way[1], way[2], way[6]
    for _ in range(tries):
        # the farthest points, of the one against the way and of the other along it
        ax, ay, az = plane_of(
            values, s, -(t0 * nx + t3 * ny + t6 * nz), -(t1 * nx + t4 * ny + t7 * nz), -(t2 * nx + t5 * ny + t8 * nz)
        )
        bx, by, bz = plane_of(
            values, t, r0 * nx + r3 * ny + r6 * nz, r1 * nx + r4 * ny + r7 * nz, r2 * nx + r5 * ny + r8 * nz
        )
        px = dx + size * (t0 * ax + t1 * ay + t2 * az) - unit * (r0 * bx + r1 * by + r2 * bz)
        py = dy + size * (t3 * ax + t4 * ay + t5 * az) - unit * (r3 * bx + r4 * by + r5 * bz)
        pz = dz + size * (t6 * ax + t7 * ay + t8 * az) - unit * (r6 * bx + r7 * by + r8 * bz)
        along = px * nx + py * ny + pz * nz
        if along > best:
            best, way[3], way[4], way[5], way[6] = along, nx, ny, nz, along
            if along > low:
                return True
        # as if the one were nearer by `low`
        px, py, pz = px - low * nx, py - low * ny, pz - low * nz
        turned = 2.0 * (along - low) / max(px * px + py * py + pz * pz, 1e-300)
        nx, ny, nz = nx - turned * px, ny - turned * py, nz - turned * pz
    way[0], way[1], way[2] = nx, ny, nz
    return False
