"""Contacts of single spheres, and of disks in two dimensions, in closed form."""

import math

from voxgran._base.kernels import kernel
from voxgran.contacts.manifolds.rows import SPHERE, ContactRows, Grains, PairList, write_contact


@kernel
def find_sphere_contacts(
    grains: Grains, pairs: PairList, size: int, rows: ContactRows, m: int, margin: float, rest: float
) -> int:
    """Write the contacts, nearer than a margin, of all pairs of single spheres; gaps count from `rest`.

    Return the number of rows in use, or -1 where there is no room for more.
    """
    position, radius = grains.position, grains.radius
    for p in range(size):
        i, j = pairs.i[p], pairs.j[p]
        if grains.kind[i] != SPHERE or grains.kind[j] != SPHERE:
            continue
        first, count = pairs.first[p], pairs.count[p]
        pairs.first[p], pairs.count[p] = m, 0
        dx = position[j, 0] + pairs.shift[p, 0] - position[i, 0]
        dy = position[j, 1] + pairs.shift[p, 1] - position[i, 1]
        dz = position[j, 2] + pairs.shift[p, 2] - position[i, 2]
        a, b = radius[i], radius[j]
        square = dx * dx + dy * dy + dz * dz
        reach = a + b + margin
        if square >= reach * reach:
            continue
        if m >= len(rows.row):
            return -1
        distance = math.sqrt(square)
        if distance > 0.0:
            dx, dy, dz = dx / distance, dy / distance, dz / distance
        else:
            # two spheres at one place are parted along any direction
            dx, dy, dz = 1.0, 0.0, 0.0
        write_contact(
            rows, m, i, j, dx, dy, dz, a * dx, a * dy, a * dz, -b * dx, -b * dy, -b * dz,
            distance - a - b - rest - pairs.room[p], first, count, 1e9,
        )  # fmt: skip
        pairs.count[p] = 1
        m += 1
    return m
