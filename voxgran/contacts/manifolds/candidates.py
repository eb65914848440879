"""Candidates for contacts of one grain or pair, of which the deep ones that are apart are kept."""

import math

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel
from voxgran.contacts.manifolds.rows import ContactRows, write_contact

#: distance of arms, in median diameters, up to which a contact takes over the impulses of an old one
MATCH = 0.1
#: least cosine of the normals of the two
ALIKE = 0.7
#: lengths by which a contact must be farther from those kept, for each length by which its gap is larger
PREFERENCE = 10.0
#: cosine of normals above which those of one point are the same
SAME = 1.0 - 1e-9
#: distance that is added between contacts whose normals are not alike: each direction is held by its own
TURNED = 1000.0


@bare_kernel
def add_candidate(
    found: Floats, c: int, ax: float, ay: float, az: float, nx: float, ny: float, nz: float, gap: float,
) -> int:  # fmt: skip
    """Add an arm, a normal and a gap to the candidates, of which there are c; return how many there are then."""
    if c == len(found):
        return c
    row = found[c]
    row[0], row[1], row[2], row[3], row[4], row[5], row[6] = ax, ay, az, nx, ny, nz, gap
    return c + 1


@bare_kernel
def is_candidate(
    found: Floats, start: int, c: int, ax: float, ay: float, az: float, nx: float, ny: float, nz: float, near: float,
) -> bool:  # fmt: skip
    """Return whether candidates from `start` to c hold an arm, to a distance, with the same normal."""
    for k in range(start, c):
        row = found[k]
        apart = abs(row[0] - ax) + abs(row[1] - ay) + abs(row[2] - az)
        if apart < near and row[3] * nx + row[4] * ny + row[5] * nz > SAME:
            return True
    return False


@bare_kernel
def choose_candidates(found: Floats, c: int, most: int, spread: float) -> int:
    """Move those that are deep and at least `spread` apart to the front, at most so many; return how many they are.

    The deepest comes first. Of few candidates all are kept, in their order.
    """
    if c <= most:
        return c
    least = found[0, 6]
    for k in range(c):
        found[k, 7] = math.inf
        least = min(least, found[k, 6])
    for trip in range(most):
        best, at = -math.inf, -1
        for k in range(trip, c):
            if found[k, 7] < spread:
                continue
            score = (0.0 if trip == 0 else found[k, 7]) - PREFERENCE * (found[k, 6] - least)
            if score > best:
                best, at = score, k
        if at < 0:
            return trip
        for column in range(8):
            found[trip, column], found[at, column] = found[at, column], found[trip, column]
        for k in range(trip + 1, c):
            square, cosine = 0.0, 0.0
            for column in range(3):
                square += (found[k, column] - found[trip, column]) ** 2
                cosine += found[k, 3 + column] * found[trip, 3 + column]
            found[k, 7] = min(found[k, 7], math.sqrt(square) + (TURNED if cosine < ALIKE else 0.0))
    return most


@bare_kernel
def write_candidates(
    rows: ContactRows, m: int, i: int, j: int, found: Floats, many: int, ox: float, oy: float, oz: float, first: int,
    count: int, beyond: float,
) -> int:  # fmt: skip
    """Write the first candidates as rows; return the next row, or -1 where they do not fit.

    o: centroid of j relative to that of i; at a wall, j < 0 or a lid, it is infinite and the arm on j is 0.
    first, count: old rows of the grain or pair.  beyond: distance that is subtracted from the gaps.

    A row takes over the impulses of the nearest old row whose normal is alike: a corner may touch two walls at once,
    with one arm, which does not tell their rows apart.
    """
    if m + many > len(rows.row):
        return -1
    for k in range(many):
        candidate = found[k]
        ax, ay, az, nx, ny, nz = candidate[0], candidate[1], candidate[2], candidate[3], candidate[4], candidate[5]
        gap, bx, by, bz = candidate[6], 0.0, 0.0, 0.0
        if ox < math.inf:
            bx, by, bz = ax + gap * nx - ox, ay + gap * ny - oy, az + gap * nz - oz
        best, at = MATCH * MATCH, -1
        for q in range(first, first + count):
            old = rows.old[q]
            square = (old[3] - ax) ** 2 + (old[4] - ay) ** 2 + (old[5] - az) ** 2
            if square < best and old[0] * nx + old[1] * ny + old[2] * nz > ALIKE:
                best, at = square, q
        taken = 1 if at >= 0 else 0
        write_contact(
            rows, m + k, i, j, nx, ny, nz, ax, ay, az, bx, by, bz, gap - beyond, max(at, 0), taken, MATCH
        )  # fmt: skip
    return m + many
