"""Rounds of contacts. The contacts of a round are in sets that have no body in common and can be solved at once.

Bodies that follow each other form blocks. The contacts within blocks are the first round. The contacts between two
blocks are further rounds, in each of which no block occurs twice. Rounds depend on the contacts only, so that results
have the same bits for any number of threads.
"""

from typing import NamedTuple

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran.geometry.morton import block_count


class Rounds(NamedTuple):
    """Order in which contacts are visited.

    rows: (m,) rows of the contacts, set after set.  ends: (s + 1,) where each set begins among them, and the last one
    ends.  sets: (r + 1,) first set of each round; that of block b is set b.  bodies: (b + 1,) first body of each block.
    """

    rows: Integers
    ends: Integers
    sets: Integers
    bodies: Integers

    def of_each(self, values: Floats) -> Floats:
        """Return values of the contacts, (m,), in the order of the visits; one value of all, (1,), stays."""
        return values if len(values) == 1 else values[self.rows]


def rounds_of(i: Integers, j: Integers, bodies: int, *, shared: bool = False) -> Rounds:
    """Return the rounds of contacts (m,), (m,) of bodies; j is negative at a wall, which does not move.

    shared: whether there is something else that all contacts move; then, and with few bodies, they are a single set.
    """
    blocks = 1 if shared else block_count(bodies)
    first = np.arange(blocks + 1) * bodies // blocks
    if blocks == 1:
        return Rounds(np.arange(len(i)), np.array([0, len(i)]), np.array([0, 1]), first)
    block = np.repeat(np.arange(blocks), np.diff(first))
    one, other = block[i], block[np.where(j < 0, i, j)]
    pair = np.minimum(one, other) * blocks + np.maximum(one, other)
    between = np.bincount(pair, minlength=blocks**2)
    between[:: blocks + 1] = 0
    held: list[set[int]] = []
    rounds: list[list[int]] = []
    for p in np.flatnonzero(between).tolist():
        two = set(divmod(p, blocks))
        free = next((r for r, others in enumerate(held) if not others & two), len(held))
        if free == len(held):
            held.append(set())
            rounds.append([])
        held[free] |= two
        rounds[free].append(p)
    sets = [np.arange(blocks) * (blocks + 1), *map(np.array, rounds)]
    place = np.zeros(blocks**2, dtype=np.int16)
    place[np.concatenate(sets)] = np.arange(sum(map(len, sets)))
    at = place[pair]
    ends = np.cumsum([0, *np.bincount(at, minlength=place.max() + 1)])
    return Rounds(np.argsort(at, kind="stable"), ends, np.cumsum([0, *map(len, sets)]), first)
