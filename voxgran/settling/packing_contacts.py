"""Contact points and masses of the grains of an assembly, in the units of the contact kernels."""

from dataclasses import replace

import numpy as np

from voxgran._base.arrays import Floats
from voxgran.contacts.assembly import Assembly
from voxgran.settling.contact_points import ContactPoints, find_contact_points, joined, near_walls
from voxgran.settling.contact_rows import ARM_I, ARM_J, GAP, NORMAL, ROW, WALL, ContactRows

#: moments of inertia, in masses times squared radii, in 2D and 3D
MOMENTS = {2: 0.5, 3: 0.4}


def contact_rows_of(assembly: Assembly, reach: float) -> ContactRows:
    """Return the contact points of all pairs of grains, of walls and of the lid, that are within a reach.

    Lengths are in median diameters, the reach too. All rows are in use, and sorted by pairs; those of walls and of the
    lid, whose number is that of the grains, are the last. No row has impulses.
    """
    length = float(np.median(assembly.diameters)) if assembly.count else 1.0
    without = replace(assembly, lid=None)
    found = find_contact_points(without, reach * length)
    if assembly.lid is not None:
        more = near_walls(assembly, reach * length)
        at_lid = np.arange(len(more.i)) >= len(near_walls(without, reach * length).i)
        partner = np.full(int(at_lid.sum()), assembly.count)
        found = joined(
            [found, ContactPoints(more.i[at_lid], partner, *(getattr(more, name)[at_lid] for name in _VALUES))]
        )
    other = np.where(found.j < 0, assembly.count + 1, found.j)
    order = np.lexsort((other, found.i, other >= assembly.count))
    row = np.zeros((len(order), ROW))
    row[:, NORMAL : NORMAL + 3] = found.normal[order]
    row[:, ARM_I : ARM_I + 3] = found.arm_i[order] / length
    row[:, ARM_J : ARM_J + 3] = found.arm_j[order] / length
    row[:, GAP] = found.gap[order] / length
    i, j = (np.ascontiguousarray(one[order], dtype=np.int64) for one in (found.i, found.j))
    return ContactRows(row, i, np.where(j < 0, WALL, j), np.zeros((0, ROW)))


_VALUES = ("normal", "gap", "arm_i", "arm_j")


def bodies_of(assembly: Assembly) -> Floats:
    """Return the rows (n + 1, 8) of grains at rest: velocities, inverse masses and inverse moments of inertia.

    The unit of mass is that of a grain of the median diameter; the moments are those of spheres (disks) of the same
    volume. The last row is the lid, which is fixed.
    """
    bodies = np.zeros((assembly.count + 1, 8))
    if assembly.count:
        size = assembly.diameters / np.median(assembly.diameters)
        bodies[:-1, 6] = size**-assembly.dimension
        bodies[:-1, 7] = bodies[:-1, 6] / (MOMENTS[assembly.dimension] * (size / 2) ** 2)
    return bodies
