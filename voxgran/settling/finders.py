"""Which functions find the contacts of a scene: those for the kinds of grains that it has, and no others."""

from collections.abc import Sequence

import numpy as np

from voxgran._base.arrays import Integers
from voxgran.contacts.assembly import Assembly
from voxgran.settling.contact_rows import CONVEX, OUTLINE, SPHERE, SURFACE, ContactRows, Grains, PairList
from voxgran.settling.sphere_contacts import find_sphere_contacts
from voxgran.shapes.model import Shape


def kinds_of(shapes: Sequence[Shape]) -> Integers:
    """Return what finds the contacts of each shape, (k,): `SPHERE`, `CONVEX`, `SURFACE` or `OUTLINE`.

    Raises
    ------
    InputError
        If a shape is an open surface.
    """
    return np.array([_kind_of(shape) for shape in shapes], dtype=np.int64)


def _kind_of(shape: Shape) -> int:
    """Return the kind of one shape."""
    return SPHERE


class ContactFinders:
    """Finds the contacts of the grains of an assembly.

    Parameters
    ----------
    assembly : Assembly
        Shapes, container and lid, with lengths in median diameters.
    """

    def __init__(self, assembly: Assembly) -> None:
        self.assembly = assembly

    def find(
        self, grains: Grains, pairs: PairList, rows: ContactRows, *, at_walls: tuple[Integers, Integers],
        lid_level: float, margin: float, rest: float,
    ) -> int:  # fmt: skip
        """Write all contacts nearer than a margin, and return their number, or -1 where they are more than the rows."""
        m = find_sphere_contacts(grains, pairs, len(pairs.i), rows, 0, margin, rest)
        return _floor(self, grains, at_walls, rows, m, margin, rest) if m>=0 else m


from voxgran._base.kernels import kernel
from voxgran.settling.contact_rows import write_contact
import math
def _floor(self, g, at_walls, rows, m, margin, rest):
    lo, hi = self.assembly.container.bounds
    per = np.array(self.assembly.container.periodic)
    return _floor_k(g, at_walls[0], at_walls[1], rows, m, margin, rest, np.array(lo, float), np.array(hi, float), per)

@kernel
def _floor_k(g, first, count, rows, m, margin, rest, lo, hi, per):
    for i in range(len(g.position)):
        f, c = first[i], count[i]
        first[i], count[i] = m, 0
        for axis in range(3):
            if per[axis]:
                continue
            for side in range(2):
                gap = (g.position[i, axis] - lo[axis] if side == 0 else hi[axis] - g.position[i, axis]) - g.radius[i]
                if gap < margin:
                    if m >= len(rows.row):
                        return -1
                    s = -1.0 if side == 0 else 1.0
                    nx = s if axis == 0 else 0.0
                    ny = s if axis == 1 else 0.0
                    nz = s if axis == 2 else 0.0
                    r = g.radius[i]
                    write_contact(rows, m, i, -1, nx, ny, nz, r*nx, r*ny, r*nz, 0., 0., 0., gap - rest, f, c, 0.5*r)
                    count[i] += 1
                    m += 1
    return m
