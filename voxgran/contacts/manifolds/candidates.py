"""Candidates for contacts of one grain or pair, of which the deep ones that are apart are kept."""

import math

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel
from voxgran.contacts.manifolds.rows import ContactRows, Pair, write_contact
from voxgran.geometry.vectors import Vector, along, dot, row_of, sub, vector_at

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
def add_candidate(found: Floats, c: int, arm: Vector, normal: Vector, gap: float) -> int:
    """Add an arm, a normal and a gap to the candidates, of which there are c; return how many there are then."""
    if c == len(found):
        return c
    row = found[c]
    row[0], row[1], row[2] = arm
    row[3], row[4], row[5] = normal
    row[6] = gap
    return c + 1


@bare_kernel
def is_candidate(found: Floats, c: int, arm: Vector, normal: Vector, near: float) -> bool:
    """Return whether the c candidates hold an arm, to a distance, with the same normal."""
    for k in range(c):
        way = sub(row_of(found, k), arm)
        if abs(way[0]) + abs(way[1]) + abs(way[2]) < near and dot(vector_at(found[k], 3), normal) > SAME:
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
def write_candidates(rows: ContactRows, m: int, pair: Pair, found: Floats, many: int) -> int:
    """Write the first candidates as rows; return the next row, or -1 where they do not fit.

    A row takes over the impulses of the nearest old row whose normal is alike: a corner may touch two walls at once,
    with one arm, which does not tell their rows apart.
    """
    if m + many > len(rows.row):
        return -1
    for k in range(many):
        arm, normal, gap = row_of(found, k), vector_at(found[k], 3), found[k, 6]
        other_arm = (0.0, 0.0, 0.0)
        if pair.offset[0] < math.inf:
            other_arm = sub(along(arm, gap, normal), pair.offset)
        write_contact(rows, m + k, pair, normal, arm, other_arm, gap - pair.rest, MATCH, ALIKE)
    return m + many
