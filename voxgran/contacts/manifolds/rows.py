"""Grains, near pairs and contact points as the rows of numbers that kernels share.

Lengths are in median diameters, forces in weights of a grain of the median diameter, and times in sqrt(d / g). The
functions that find contact points write one row for each; a row takes over the impulses of the nearest row of the same
pair in the step before, from which the next solution starts.
"""

from typing import NamedTuple

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel

#: numbers in a row: normal (3) from i to j, arm from centroid i (3), arm from centroid j (3), gap, normal impulse,
#: tangential impulse (3), and the effective masses along the normal and across it
ROW = 16
#: first columns of these
NORMAL, ARM_I, ARM_J, GAP, PUSH, DRAG, MASS, MASS_ACROSS = 0, 3, 6, 9, 10, 11, 14, 15
#: partner of a grain at a wall; the lid is a body with the number of the grains
WALL = -1
#: kinds of grains by what finds their contacts; that of a pair is the larger of its two
SPHERE, CONVEX, SURFACE, OUTLINE = 0, 1, 2, 3


class Grains(NamedTuple):
    """Grains in their present poses and sizes.

    position: (n, 3), not wrapped at periodic sides.  matrix: (n, 3, 3) rotations.  scale: (n,) factors on the lengths
    of the shapes.  radius: (n,) of the bounding spheres about the centroids.  shape, kind: (n,).
    way: (n,) bounds of how far any point of a surface has moved since the list of pairs was made.
    """

    position: Floats
    matrix: Floats
    scale: Floats
    radius: Floats
    shape: Integers
    kind: Integers
    way: Floats


class PairList(NamedTuple):
    """Near pairs of grains, in lexical order, and what is remembered of them; `size` rows are in use.

    i, j: (cap,) grains.  shift: (cap, 3) lengths that are added to the position of j (periodic sides).
    first, count: (cap,) rows of the contacts that were last written for the pair.
    bound: (cap,) gap when the pair was last looked at (-1e9: never), and way: (cap,) the sum of the ways of the two
    grains then: the pair is farther apart than ``bound - (way_i + way_j - way)``.
    normal: (cap, 3) normal when last looked at; its first number is above 1.5 where none is known.
    room: (cap,) distance beyond the usual one that the surfaces keep, where their gap is known to be inexact.
    """

    i: Integers
    j: Integers
    shift: Floats
    first: Integers
    count: Integers  # type: ignore[assignment]
    bound: Floats
    way: Floats
    normal: Floats
    room: Floats


class ContactRows(NamedTuple):
    """Rows of contacts.

    row: (cap, 16).  i, j: (cap,) bodies; j is `WALL` at a wall and the number of grains at the lid.
    old: (cap, 16) rows of the step before.
    """

    row: Floats
    i: Integers
    j: Integers
    old: Floats


def carry_rows(rows: ContactRows, m: int, motion: Floats) -> None:
    """Carry m rows along with small motions (n, 6) of the grains: gaps change to first order, and arms turn.

    Rows at walls, and of the lid, stay as they are.
    """
    row, n = rows.row[:m], len(motion)
    moved = np.vstack([motion, np.zeros((1, 6))])
    inner = (rows.j[:m] >= 0) & (rows.j[:m] < n)
    normal = row[:, NORMAL:ARM_I]
    for at, arm, sign in ((rows.i[:m], ARM_I, -1.0), (rows.j[:m], ARM_J, 1.0)):
        one = moved[np.where(inner, at, n)]
        turned = np.cross(one[:, 3:], row[:, arm : arm + 3])
        row[:, GAP] += sign * ((one[:, :3] + turned) * normal).sum(axis=1)
        row[:, arm : arm + 3] += turned


@bare_kernel
def write_contact(
    rows: ContactRows, m: int, i: int, j: int, nx: float, ny: float, nz: float, ax: float, ay: float, az: float,
    bx: float, by: float, bz: float, gap: float, first: int, count: int, within: float,
) -> None:  # fmt: skip
    """Write row m: normal n from i to j, arms a and b from the centroids, and the gap.

    first, count: the old rows of the same pair, of which the nearest that no other took passes on its impulses if its
    arm on i is within a distance. An old row is taken when its number of column 14 is negative.
    """
    row = rows.row[m]
    rows.i[m], rows.j[m] = i, j
    row[0], row[1], row[2] = nx, ny, nz
    row[3], row[4], row[5] = ax, ay, az
    row[6], row[7], row[8] = bx, by, bz
    row[9] = gap
    best, at = within * within, -1
    for k in range(first, first + count):
        old = rows.old[k]
        square = (old[3] - ax) ** 2 + (old[4] - ay) ** 2 + (old[5] - az) ** 2
        if square < best and old[14] >= 0.0:
            best, at = square, k
    for column in range(10, 14):
        row[column] = rows.old[at, column] if at >= 0 else 0.0
    row[14] = 0.0
    if at >= 0:
        rows.old[at, 14] = -1.0
