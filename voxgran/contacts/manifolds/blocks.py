"""Blocks of near pairs, of which several threads find the contacts at the same time.

Each thread writes rows of its own, which are then put one block behind the other. What is found of a pair depends on
nothing that is found of others, so that the rows are the same for any number of threads.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Generic, TypeVar

import numpy as np

from voxgran._base.arrays import Booleans
from voxgran._base.compiling.threads import at_once, blocks_of
from voxgran.contacts.manifolds.rows import ContactRows, Grains, PairList, Search

Work = TypeVar("Work", bound=tuple[Any, ...])

#: pairs of which a thread takes no fewer
LEAST_PAIRS = 64
#: blocks for each thread: in some parts of a bed more pairs are near than in others
PARTS = 4
#: bytes of two cache lines, which processors fetch together
CACHE_LINES = 128


@dataclass
class Blocks(Generic[Work]):
    """What blocks of pairs are searched with, kept from one search to the next.

    Attributes
    ----------
    arrays : NamedTuple of ndarray
        Arrays that the kernel works with.
    scratch : tuple of str
        Names of those that each block has for itself.
    own : list of tuple
        Work and rows of each block.
    """

    arrays: Work
    scratch: tuple[str, ...]
    own: list[tuple[Work, ContactRows]] = field(default_factory=list)

    def find(
        self, find: Callable[..., int], search: Search, rows: ContactRows, m: int, *more: Any, chosen: Booleans
    ) -> int:
        """Write the contacts of some pairs from row m on; return the number of rows, or -1 where they are full.

        Parameters
        ----------
        find : callable
            Kernel of the search, the work, rows, the first row, what is in `more`, and the first and last pair + 1; it
            returns the row after its last one, or -1, and writes to `pairs.first` the first row of each chosen pair.
        search, rows, m, *more
            As `find` takes them; with m = -1 no rows are written.
        chosen : (p,) ndarray of bool
            Which pairs these are.
        """
        blocks, pairs = blocks_of(len(chosen), LEAST_PAIRS, PARTS), search.pairs
        if len(blocks) == 1:
            return int(find(search, self.arrays, rows, m, *more, 0, len(chosen)))
        own = [self._own(k, rows) for k in range(len(blocks))]
        ends = at_once([
            partial(find, search, work, room, min(m, 0), *more, first, last)
            for (work, room), (first, last) in zip(own, blocks, strict=True)
        ])  # fmt: skip
        if min(ends) < 0 or m + sum(ends) > len(rows.row):
            return -1
        for (_, room), end, (first, last) in zip(own, ends, blocks, strict=True):
            rows.row[m : m + end], rows.i[m : m + end], rows.j[m : m + end] = room.row[:end], room.i[:end], room.j[:end]
            pairs.first[first:last][chosen[first:last]] += m
            m += end
        return m

    def replace(self, **arrays: Any) -> None:
        """Replace arrays that all blocks share, by name."""
        self.arrays = self.arrays._replace(**arrays)  # type: ignore[attr-defined]
        self.own = [(work._replace(**arrays), room) for work, room in self.own]  # type: ignore[attr-defined]

    def _own(self, block: int, rows: ContactRows) -> tuple[Work, ContactRows]:
        """Return the work of a block, and room for as many rows as there are, with the same old ones."""
        if block == len(self.own):
            scratch = {name: _apart(getattr(self.arrays, name)) for name in self.scratch}
            self.own.append((self.arrays._replace(**scratch), _room_like(rows)))  # type: ignore[attr-defined]
        work, room = self.own[block]
        if len(room.row) != len(rows.row):
            room = _room_like(rows)
        self.own[block] = work, room._replace(old=rows.old)
        return self.own[block]


def _room_like(rows: ContactRows) -> ContactRows:
    """Return room for as many rows, with the same old ones."""
    return ContactRows(np.empty_like(rows.row), np.empty_like(rows.i), np.empty_like(rows.j), rows.old)


def pairs_of_kind(grains: Grains, pairs: PairList, kind: int) -> Booleans:
    """Return which pairs are of a kind, the larger one of the two grains, (p,)."""
    return np.asarray(np.maximum(grains.kind[pairs.i], grains.kind[pairs.j]) == kind)


def _apart(like: Any) -> Any:
    """Return zeros like an array, or each array of a tuple, that share no cache line with what other threads write."""
    if isinstance(like, tuple):
        return type(like)(*map(_apart, like))
    room = CACHE_LINES // like.itemsize
    made = np.zeros(like.size + 2 * room, dtype=like.dtype)
    return made[room : room + like.size].reshape(like.shape)
