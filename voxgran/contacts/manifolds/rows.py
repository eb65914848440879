"""Grains, near pairs and contact points as the rows of numbers that kernels share.

Lengths are in median diameters, forces in weights of a grain of the median diameter, and times in sqrt(d / g). The
functions that find contact points write one row for each; a row takes over the impulses of the nearest row of the same
pair in the step before, from which the next solution starts.
"""

import math
from typing import NamedTuple

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel, inlined_kernel
from voxgran.geometry.vectors import Vector, dot, sub, vector_at

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
    normal: (cap, 3) normal of convex parts when last looked at; its first number is above 1.5 where none is known.
    corners: (cap, 6) of hulls the corners of both, in turn, between which the nearest points lay then; -1 behind the
    last, of three at most.
    room: (cap,) distance beyond the usual one that the surfaces keep, where their gap is known to be inexact.
    Where all grains are single spheres, the arrays from `bound` on are empty.
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
    corners: Integers


class ContactRows(NamedTuple):
    """Rows of contacts.

    row: (cap, 16).  i, j: (cap,) bodies; j is `WALL` at a wall and the number of grains at the lid.
    old: (cap, 16) rows of the step before.
    """

    row: Floats
    i: Integers
    j: Integers
    old: Floats


class Search(NamedTuple):
    """What contacts are looked for.

    margin: gap up to which contacts are written, beyond the room of a pair.  rest: length that is subtracted from each
    gap.  reuse: motion of a pair up to which exact contacts of meshes are those of before.
    """

    grains: Grains
    pairs: PairList
    margin: float
    rest: float
    reuse: float = 0.0


class Pair(NamedTuple):
    """A pair that is looked at: two grains, or a grain and a wall or the lid.

    i, j: bodies.  offset: from centroid i to centroid j, infinite at a wall.  first, count: old rows of the pair.
    reach: gap up to which contacts are written.  rest: length that is subtracted from each gap.
    """

    i: int
    j: int
    offset: Vector
    first: int
    count: int  # type: ignore[assignment]
    reach: float
    rest: float


def no_rows(size: int, old: Floats | None = None) -> ContactRows:
    """Return room for rows of contacts, with old ones."""
    old = np.zeros((size, ROW)) if old is None else old
    return ContactRows(np.zeros((size, ROW)), np.zeros(size, dtype=np.int64), np.zeros(size, dtype=np.int64), old)


def doubled_rows(rows: ContactRows) -> ContactRows:
    """Return rows with twice the room; the old ones are kept."""
    made = no_rows(2 * len(rows.row))
    made.old[: len(rows.old)] = rows.old
    # the search begins again: no old row is taken
    made.old[:, 14] = 0.0
    return made


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


@inlined_kernel
def offset_of(search: Search, p: int) -> Vector:
    """Return the vector from the centroid of the first grain of pair p to that of the second."""
    position, pairs = search.grains.position, search.pairs
    i, j = pairs.i[p], pairs.j[p]
    return (
        position[j, 0] + pairs.shift[p, 0] - position[i, 0],
        position[j, 1] + pairs.shift[p, 1] - position[i, 1],
        position[j, 2] + pairs.shift[p, 2] - position[i, 2],
    )


@inlined_kernel
def begin_pair(search: Search, p: int, m: int, kind: int, reach: float) -> tuple[bool, Pair]:
    """Note that the rows of pair p begin at row m, and return whether it may have any, with what it was before.

    A pair of another kind is left as it is. One that is farther apart than `reach` by its last gap, or by the bounding
    spheres, has none.
    """
    grains, pairs = search.grains, search.pairs
    i, j = pairs.i[p], pairs.j[p]
    pair = Pair(i, j, (0.0, 0.0, 0.0), pairs.first[p], pairs.count[p], reach, search.rest + pairs.room[p])
    if max(grains.kind[i], grains.kind[j]) != kind:
        return False, pair
    pairs.first[p], pairs.count[p] = m, 0
    moved = grains.way[i] + grains.way[j]
    if pairs.bound[p] - (moved - pairs.way[p]) > reach:
        return False, pair
    offset = offset_of(search, p)
    pairs.bound[p], pairs.way[p] = math.sqrt(dot(offset, offset)) - grains.radius[i] - grains.radius[j], moved
    return pairs.bound[p] <= reach, Pair(i, j, offset, pair.first, pair.count, reach, pair.rest)


@bare_kernel
def write_contact(
    rows: ContactRows, m: int, pair: Pair, normal: Vector, arm: Vector, other_arm: Vector, gap: float, within: float,
    alike: float = -2.0,
) -> None:  # fmt: skip
    """Write row m: normal from i to j, arms from both centroids, and the gap.

    The nearest old row of the pair passes on its impulses if its arm on i is within a distance, and the cosine of the
    normals is above `alike`: to the nearest new row, which takes them from one that was written before. The numbers of
    columns 14 and 15 of an old row are then -1 minus the row that has them, and the square of the distance.
    """
    row = rows.row[m]
    rows.i[m], rows.j[m] = pair.i, pair.j
    row[0], row[1], row[2] = normal
    row[3], row[4], row[5] = arm
    row[6], row[7], row[8] = other_arm
    row[9] = gap
    for column in range(10, 15):
        row[column] = 0.0
    best, at = within * within, -1
    for k in range(pair.first, pair.first + pair.count):
        old = rows.old[k]
        way = sub(vector_at(old, 3), arm)
        square = dot(way, way)
        if square < best and (old[14] >= 0.0 or square < old[15]) and dot(vector_at(old, 0), normal) > alike:
            best, at = square, k
    if at < 0:
        return
    old = rows.old[at]
    if old[14] < 0.0:
        taker = rows.row[-1 - int(old[14])]
        for column in range(10, 14):
            taker[column] = 0.0
    for column in range(10, 14):
        row[column] = old[column]
    old[14], old[15] = -1.0 - m, best
