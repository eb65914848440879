"""Kernels that try whole grains at lattice sites: by random candidates, upward, and where they are stamped."""

from typing import NamedTuple

import numpy as np

from voxgran._base.arrays import Integers, Words
from voxgran._base.kernels import kernel
from voxgran._base.seeds import shuffled
from voxgran.packing.digital.bit_columns import Field, Triple
from voxgran.packing.digital.periodic_images import look_anywhere, stamp_images, wrapped


class Parts(NamedTuple):
    """Oriented voxels as kernels take them."""

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
def stamp_grain(field: Field, parts: Parts, member: int, site: Integers) -> None:
    """Flip the voxels of a grain whose centroid lies at a lattice corner, and of its periodic images."""
    stamp_images(field, parts.words, parts.at[member], _extent(parts, member), _lowest(field, parts, member, site))


@kernel
def find_near(field: Field, parts: Parts, member: int, site: Integers, ways: Integers) -> int:
    """Move a site, within the walls, by the first of some ways that is free; return which one, -1 for none."""
    size = parts.size[member]
    for axis in range(3):
        if field.periodic[axis] == 0:
            low = parts.low[member, axis]
            site[axis] = max(-low, min(site[axis], field.shape[axis] - size[axis] - low))
    for k in range(len(ways)):
        for axis in range(3):
            site[axis] += ways[k, axis]
        corner = _lowest(field, parts, member, site)
        if look_anywhere(field, parts.words, parts.at[member], _extent(parts, member), corner) >= 0:
            return k
        for axis in range(3):
            site[axis] -= ways[k, axis]
    return -1


@kernel
def add_at_random(
    field: Field,
    parts: Parts,
    site: Integers,
    member: Integers,
    lists: Lists,
    tally: Integers,
    key: Words,
    first: int,
    last: int,
) -> int:
    """Make attempts `first` ... `last` - 1, a candidate each; return the number of the next one.

    It ends early when all grains are placed or skipped. tally: placed, skipped, refused.
    """
    place = np.zeros(3, dtype=np.int64)
    many = lists.places[0] * lists.places[1] * lists.places[2]
    for attempt in range(first, last):
        while tally[0] + tally[1] < len(lists.order):
            kind = lists.kind[lists.order[tally[0] + tally[1]]]
            if lists.tried[kind] < lists.begin[kind + 1] - lists.begin[kind]:
                break
            tally[1] += 1
        if tally[0] + tally[1] == len(lists.order):
            return attempt
        g = lists.order[tally[0] + tally[1]]
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
        corner = _lowest(field, parts, m, place)
        if look_anywhere(field, parts.words, parts.at[m], _extent(parts, m), corner) < 0:
            tally[2] += 1
            continue
        stamp_images(field, parts.words, parts.at[m], _extent(parts, m), corner)
        member[g] = m
        for axis in range(3):
            site[g, axis] = place[axis]
        tally[0] += 1
    return last


@kernel
def _extent(parts, member):  # type: ignore[no-untyped-def]
    """Return the extents of an oriented grain."""
    return parts.size[member, 0], parts.size[member, 1], parts.size[member, 2]


@kernel
def _lowest(field: Field, parts: Parts, member: int, site: Integers) -> Triple:
    """Return the lowest voxel of a grain, wrapped into the container."""
    return (
        wrapped(site[0] + parts.low[member, 0], field.shape[0], field.periodic[0]),
        wrapped(site[1] + parts.low[member, 1], field.shape[1], field.periodic[1]),
        wrapped(site[2] + parts.low[member, 2], field.shape[2], field.periodic[2]),
    )
