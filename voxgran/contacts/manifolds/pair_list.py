"""The list of near pairs of grains (a Verlet list), and what it hands on when it is made anew.

Verlet 1967, doi:10.1103/PhysRev.159.98.
"""

import math

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.kernels import kernel
from voxgran.contacts.manifolds.rows import Grains, PairList
from voxgran.containers.model import Container, periods_of
from voxgran.geometry.sphere_pairs import near_pairs
from voxgran.geometry.vectors import add, cross, dot, row_of, sub, vector_at

#: `bound` of pairs that were never looked at, and first number of a normal that is not known
NEVER, UNKNOWN = -1e9, 2.0


def no_pairs() -> PairList:
    """Return an empty list."""
    return _blank(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros((0, 3)), known=0)


def renewed(
    pairs: PairList, grains: Grains, container: Container, skin: float, fixed: Booleans | None = None, *,
    known: bool = True,
) -> PairList:  # fmt: skip
    """Return the pairs of grains whose bounding spheres are nearer than `skin`, with what is known of those in a list.

    Pairs of which both are fixed, (n,), are left out. The ways of the grains are set to 0. `known`: whether searches
    remember anything of pairs, as they do unless all grains are single spheres; the same for all lists of a bed.
    """
    lower, periods = np.array(container.bounds[0]), periods_of(container)
    i, j, image = near_pairs(grains.position, grains.radius, skin, lower=lower, periods=periods)
    if fixed is not None:
        kept = ~(fixed[i] & fixed[j])
        i, j, image = i[kept], j[kept], image[kept]
    made = _blank(i, j, np.ascontiguousarray(linear.matmul(image, periods)), known=len(i) if known else 0)
    _hand_on(pairs, made, grains.way)
    grains.way[:] = 0.0
    return made


def _blank(i: Integers, j: Integers, shift: Floats, *, known: int) -> PairList:
    """Return a list of pairs of which nothing is known; `known`: how many of them searches remember."""
    m = len(i)
    normal = np.zeros((known, 3))
    normal[:, 0] = UNKNOWN
    return PairList(
        *(np.ascontiguousarray(i), np.ascontiguousarray(j), shift),
        *(np.zeros(m, dtype=np.int64), np.zeros(m, dtype=np.int64)),
        *(np.full(known, NEVER), np.zeros(known), normal, np.zeros(known)),
        np.full((known, 6), -1),
    )


@kernel
def _hand_on(old, new, way):  # type: ignore[no-untyped-def]
    """Copy what is known of pairs from one list to another; both are in lexical order."""
    a, many = 0, len(old.i)
    for p in range(len(new.i)):
        i, j = new.i[p], new.j[p]
        while a < many and (old.i[a] < i or (old.i[a] == i and old.j[a] < j)):
            a += 1
        b = a
        # the few images of one pair
        while b < many and old.i[b] == i and old.j[b] == j:
            if (
                abs(old.shift[b, 0] - new.shift[p, 0])
                + abs(old.shift[b, 1] - new.shift[p, 1])
                + abs(old.shift[b, 2] - new.shift[p, 2])
                < 1e-9
            ):
                new.first[p], new.count[p] = old.first[b], old.count[b]
                if len(new.bound) == 0:
                    break
                new.bound[p] = old.bound[b] - (way[i] + way[j] - old.way[b])
                new.room[p] = old.room[b]
                for c in range(3):
                    new.normal[p, c] = old.normal[b, c]
                for c in range(6):
                    new.corners[p, c] = old.corners[b, c]
                break
            b += 1


@kernel
def count_relative_ways(pairs: PairList, grains: Grains, motion: Floats) -> None:
    """Let the ways of pairs count how far surfaces are about to move relative to each other, where that is less.

    Grains that sink together hardly move relative to each other, although each of them goes a long way.

    motion: (n, 6) translations and rotations that the grains are about to make.
    """
    position, radius = grains.position, grains.radius
    for p in range(len(pairs.i)):
        i, j = pairs.i[p], pairs.j[p]
        if radius[j] > radius[i]:
            i, j = j, i
        one, other = vector_at(motion[i], 3), vector_at(motion[j], 3)
        turn, their_turn = math.sqrt(dot(one, one)), math.sqrt(dot(other, other))
        a, b = row_of(motion, i), row_of(motion, j)
        apart = math.sqrt(dot(a, a)) + math.sqrt(dot(b, b)) + turn * radius[i] + their_turn * radius[j]
        offset = add(sub(row_of(position, pairs.j[p]), row_of(position, pairs.i[p])), row_of(pairs.shift, p))
        far = math.sqrt(dot(offset, offset))
        if i != pairs.i[p]:
            offset = -offset[0], -offset[1], -offset[2]
        # in the frame of i, whose rotation moves the centroid of j too; j turns about its own
        slip, spin = sub(sub(b, a), cross(one, offset)), sub(other, one)
        relative = math.sqrt(dot(slip, slip)) + math.sqrt(dot(spin, spin)) * radius[j]
        # what rotations do to the second order
        relative += (turn + their_turn) ** 2 * (far + radius[j])
        pairs.way[p] += max(apart - relative, 0.0)
