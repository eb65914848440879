"""Blocks of near pairs, of which several threads find the contacts at the same time.

Each thread writes rows of its own, which are then put one block behind the other. What is found of a pair depends on
nothing that is found of others, so that the rows are the same for any number of threads.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, TypeVar

import numpy as np

from voxgran._base.arrays import Booleans
from voxgran._base.compiling.threads import at_once, blocks_of
from voxgran.settling.contact_rows import ContactRows, Grains, PairList

Work = TypeVar("Work", bound=tuple[Any, ...])

#: pairs of which a thread takes no fewer
LEAST_PAIRS = 64


def find_in_blocks(
    find: Callable[[Work, ContactRows, int, int, int], int], work: Work, scratch: Sequence[str], *, pairs: PairList,
    chosen: Booleans, rows: ContactRows, m: int,
) -> int:  # fmt: skip
    """Write the contacts of the first pairs from row m on; return the new number of rows, or -1 where they are full.

    Parameters
    ----------
    find : callable
        Kernel of the work, rows, the first row, and the first and last pair + 1; it returns the row after its last
        one, or -1, and writes to `pairs.first` the first row of each chosen pair.
    work : NamedTuple of ndarray
        What it works with.
    scratch : sequence of str
        Names of the arrays of `work` that each thread has for itself.
    pairs, rows, m
        As `find` takes them; with m = -1 no rows are written.
    chosen : (size,) ndarray of bool
        Which pairs these are.
    """
    size = len(chosen)
    blocks = blocks_of(size, LEAST_PAIRS)
    if len(blocks) == 1:
        return int(find(work, rows, m, 0, size))
    parts = [rows if m < 0 else _room_like(rows) for _ in blocks]
    ends = at_once([
        partial(find, _with_own(work, scratch), part, min(m, 0), first, last)
        for part, (first, last) in zip(parts, blocks, strict=True)
    ])  # fmt: skip
    if min(ends) < 0 or m + sum(ends) > len(rows.row):
        return -1
    for part, end, (first, last) in zip(parts, ends, blocks, strict=True):
        rows.row[m : m + end], rows.i[m : m + end], rows.j[m : m + end] = part.row[:end], part.i[:end], part.j[:end]
        pairs.first[first:last][chosen[first:last]] += m
        m += end
    return m


def pairs_of_kind(grains: Grains, pairs: PairList, size: int, kind: int) -> Booleans:
    """Return which of the first pairs are of a kind, the larger one of the two grains, (size,)."""
    return np.asarray(np.maximum(grains.kind[pairs.i[:size]], grains.kind[pairs.j[:size]]) == kind)


def _room_like(rows: ContactRows) -> ContactRows:
    """Return room for as many rows, with the same old ones."""
    return ContactRows(np.empty_like(rows.row), np.empty_like(rows.i), np.empty_like(rows.j), rows.old)


def _with_own(work: Work, scratch: Sequence[str]) -> Work:
    """Return the work with other arrays in place of those that are scratch."""
    own = {name: np.zeros(getattr(work, name).shape, dtype=getattr(work, name).dtype) for name in scratch}
    return work._replace(**own)  # type: ignore[attr-defined]
