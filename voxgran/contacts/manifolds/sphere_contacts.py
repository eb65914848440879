"""Contacts of single spheres, and of disks in two dimensions, in closed form."""

import math

from voxgran._base.kernels import kernel
from voxgran.contacts.manifolds.rows import SPHERE, ContactRows, Pair, Search, offset_of, write_contact
from voxgran.geometry.vectors import dot, times


@kernel
def find_sphere_contacts(search: Search, rows: ContactRows, m: int) -> int:
    """Write the contacts of all pairs of single spheres from row m on.

    Return the number of rows in use, or -1 where there is no room for more.
    """
    grains, pairs, margin, rest = search.grains, search.pairs, search.margin, search.rest
    for p in range(len(pairs.i)):
        i, j = pairs.i[p], pairs.j[p]
        if grains.kind[i] != SPHERE or grains.kind[j] != SPHERE:
            continue
        first, count = pairs.first[p], pairs.count[p]
        pairs.first[p], pairs.count[p] = m, 0
        offset = offset_of(search, p)
        a, b = grains.radius[i], grains.radius[j]
        square, reach = dot(offset, offset), a + b + margin
        if square >= reach * reach:
            continue
        if m >= len(rows.row):
            return -1
        distance = math.sqrt(square)
        # two spheres at one place are parted along any direction
        normal = (1.0, 0.0, 0.0)
        if distance > 0.0:
            normal = offset[0] / distance, offset[1] / distance, offset[2] / distance
        pair = Pair(i, j, offset, first, count, margin, rest)
        write_contact(rows, m, pair, normal, times(normal, a), times(normal, -b), distance - a - b - rest, 1e9)
        pairs.count[p] = 1
        m += 1
    return m
