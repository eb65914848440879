"""Kernels that try whole grains at lattice sites: by random candidates, upward, and where they are stamped."""

from typing import NamedTuple

import numpy as np

from voxgran._base.arrays import Integers, Words
from voxgran._base.kernels import kernel
from voxgran._base.seeds import shuffled
from voxgran.packing.digital.bit_columns import Field
from voxgran.packing.digital.periodic_images import find_near, look_anywhere, shifted, stamp_images

#: counters of random sequential addition, and their places
TALLY = ("placed", "skipped", "refused")
PLACED, SKIPPED, REFUSED = range(3)


class OrientedRecord(NamedTuple):
    """Oriented voxels as kernels take them: flat bit columns ``[x, word of z, y]`` with a ring of empty columns.

    at: where each one begins, (m,).  low, size: lowest voxel, counted from the lattice corner at the centroid, and
    extents, (m, 3).
    """

    words: Words
    at: Integers
    low: Integers
    size: Integers


class Lists(NamedTuple):
    """Candidates of each kind, which come in a random order.

    order: grains as they come.  kind: of each grain.  begin: first candidate of each kind.  tried: how many of a kind
    have been tried.  places: corners along each axis where a centroid may lie; a candidate is its place and, times the
    number of places, its orientation.
    """

    order: Integers
    kind: Integers
    begin: Integers
    tried: Integers
    places: Integers


@kernel
def stamp_grain(field: Field, record: OrientedRecord, member: int, site: Integers) -> None:
    """Flip the voxels of a grain whose centroid lies at a lattice corner, and of its periodic images."""
    corner = shifted(field, site, _triple(record.low[member]))
    stamp_images(field, record.words, record.at[member], _triple(record.size[member]), corner)


@kernel
def find_site(field: Field, record: OrientedRecord, member: int, site: Integers, ways: Integers) -> int:
    """Move a site, within the walls, by the first of some ways that is free; return which one, -1 for none."""
    low, size = _triple(record.low[member]), _triple(record.size[member])
    return find_near(field, record.words, record.at[member], low, size, site, ways)


@kernel
def add_at_random(
    field: Field, record: OrientedRecord, site: Integers, member: Integers, lists: Lists, tally: Integers, key: Words,
    first: int, last: int,
) -> int:  # fmt: skip
    """Make attempts `first` ... `last` - 1, a candidate each; return the number of the next one.

    It ends early when all grains are placed or skipped. tally: counters in the order of `TALLY`.
    """
    place = np.zeros(3, dtype=np.int64)
    many = lists.places[0] * lists.places[1] * lists.places[2]
    for attempt in range(first, last):
        while tally[PLACED] + tally[SKIPPED] < len(lists.order):
            kind = lists.kind[lists.order[tally[PLACED] + tally[SKIPPED]]]
            if lists.tried[kind] < lists.begin[kind + 1] - lists.begin[kind]:
                break
            tally[SKIPPED] += 1
        if tally[PLACED] + tally[SKIPPED] == len(lists.order):
            return attempt
        g = lists.order[tally[PLACED] + tally[SKIPPED]]
        kind = lists.kind[g]
        begin = lists.begin[kind]
        # never tried again, whether it is taken now or blocked for ever
        turn, size = lists.tried[kind], lists.begin[kind + 1] - begin
        candidate = begin + shuffled(turn, size, key[0] + np.uint64(kind), key[1])
        lists.tried[kind] = turn + 1
        m, rest = candidate // many, candidate % many
        place[0] = rest // (lists.places[1] * lists.places[2])
        place[1] = rest // lists.places[2] % lists.places[1]
        place[2] = rest % lists.places[2]
        corner, extent = shifted(field, place, _triple(record.low[m])), _triple(record.size[m])
        if look_anywhere(field, record.words, record.at[m], extent, corner) < 0:
            tally[REFUSED] += 1
            continue
        stamp_images(field, record.words, record.at[m], extent, corner)
        member[g] = m
        for axis in range(3):
            site[g, axis] = place[axis]
        tally[PLACED] += 1
    return last


@kernel
def _triple(row):  # type: ignore[no-untyped-def]
    """Return a row as three numbers."""
    return row[0], row[1], row[2]
