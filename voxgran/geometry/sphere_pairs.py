"""Cell lists: all pairs of spheres whose surfaces are nearer than a gap, periodic axes included."""

from functools import partial
from typing import NamedTuple

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, Integers
from voxgran._base.compiling.threads import at_once, blocks_of
from voxgran._base.errors import InputError
from voxgran._base.kernels import kernel
from voxgran.geometry.periods import OPEN, along_edges, face_distances, images_within, turns_of

#: corner of a cell without one
ORIGIN = np.zeros(3)
#: spheres share cells if their sizes differ by no more than this power of two
CLASS = 2.0
#: most periodic images that are compared with a sphere
MOST_IMAGES = 10_000
#: spheres of which a thread takes no fewer
BLOCK = 4096


def near_pairs(
    centers: Floats, radii: Floats, gap: float, *, lower: Floats = ORIGIN, periods: Floats = OPEN
) -> tuple[Integers, Integers, Integers]:
    """Return each pair of spheres with ``distance - r_i - r_j <= gap``, once per periodic image.

    The pairs (i, j), (m,), are in lexical order with i <= j; i == j stands for a sphere and its own image. A pair is
    (center i, center j + image @ periods) with the (n, 3) centers as given, anywhere on periodic axes, and `image` (m,
    3). The periods are those of a cell with the corner `lower` (:mod:`voxgran.geometry.periods`).

    Raises
    ------
    InputError
        If more than 10,000 images lie within the gap and the largest radii.
    """
    n = len(centers)
    if n == 0:
        return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 3), np.int64)
    place, turns = _placed(centers, radii, lower, periods)
    # spheres of similar size share cells, whose width is that of the largest of them
    size = _classes(radii + max(0.0, 0.5 * gap))
    found = []
    for k in np.unique(size):
        members = np.flatnonzero(size == k)
        found.append(_pairs_with(place, members, members, gap))
        smaller = np.flatnonzero(size > k)
        if len(smaller):
            found.append(_pairs_with(place, smaller, members, gap))
    rows = found[0] if len(found) == 1 else _in_order(np.concatenate(found))
    i, j = rows[:, 0].copy(), rows[:, 1].copy()
    return i, j, rows[:, 2:] + turns[i] - turns[j]


def spheres_near(
    points: Floats, reach: Floats, centers: Floats, radii: Floats, *, lower: Floats = ORIGIN, periods: Floats = OPEN
) -> tuple[Integers, Integers, Integers]:
    """Return each pair of a point and a sphere whose surface is within the reach (n,) of the point, or which holds it.

    The pairs (i, j), (m,), are in the order of the points. A pair is (point i, center j + image @ periods) with `image`
    (m, 3). The periods are those of a cell with the corner `lower` (:mod:`voxgran.geometry.periods`).

    Raises
    ------
    InputError
        If more than 10,000 images lie within the largest reach and radius.
    """
    n = len(points)
    found = [np.zeros((0, 5), dtype=np.int64)]
    turns = np.zeros((n, 3), dtype=np.int64)
    if n and len(centers):
        both = np.concatenate([points, centers]), np.concatenate([reach, radii])
        place, turns = _placed(*both, lower, periods)
        size = _classes(radii)
        found += [_pairs_with(place, np.arange(n), n + np.flatnonzero(size == k), 0.0) for k in np.unique(size)]
    rows = np.concatenate(found)
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    i, j = rows[:, 0].copy(), rows[:, 1].copy()
    return i, j - n, rows[:, 2:] + turns[i] - turns[j]


class Cells(NamedTuple):
    """Spheres in cells of a box.

    sphere: (m, 4) centers and radii, cell by cell.  order: (m,) their numbers.  start: (c + 1,) first one of each cell.
    many: (3,) cells along each axis.  around: (3,) cells on each side that are within reach.  wraps: (3,)
    which axes are periodic.  periods: (3, 3) vectors by which the box repeats.
    """

    sphere: Floats
    order: Integers
    start: Integers
    many: Integers
    around: Integers
    wraps: Integers
    periods: Floats


class Placed(NamedTuple):
    """Spheres in the bounds: wrapped centers (n, 3), radii (n,), lower corner, lengths, and periods."""

    centers: Floats
    radii: Floats
    low: Floats
    span: Floats
    periods: Floats


def _placed(centers: Floats, radii: Floats, lower: Floats, periods: Floats) -> tuple[Placed, Integers]:
    """Return spheres in the bounds, and by how many periods (n, 3) they were moved there."""
    turns, lengths = turns_of(centers, lower, periods), periods.diagonal()
    wraps, moved = lengths > 0.0, centers - linear.matmul(turns, periods)
    low = np.where(wraps, lower, moved.min(axis=0))
    span = np.where(wraps, lengths, np.maximum(moved.max(axis=0) - low, 1e-300))
    return Placed(moved, radii, low, span, periods), turns


def _classes(reach: Floats) -> Integers:
    """Return the classes (n,) of similar sizes, 0 for the largest."""
    most = reach.max()
    return np.asarray(np.floor(libm.log2(most / np.maximum(reach, 1e-18 * most) + 1e-300) / CLASS).astype(np.int64))


def _pairs_with(place: Placed, queries: Integers, members: Integers, gap: float) -> Integers:
    """Return the pairs (i, j, image) of each of `queries` with `members` as j, (m, 5); within a set each pair once."""
    low, span, periods = place.low, place.span, place.periods
    wraps = periods.diagonal() > 0.0
    reach = place.radii[members].max() + place.radii[queries].max() + gap
    if (many := float(images_within(max(reach, 0.0), periods))) > MOST_IMAGES:
        raise InputError(
            f"spheres are compared up to a distance of {reach:g} between their centers, within which there are about "
            f"{many:.0f} periodic images: there must be at most {MOST_IMAGES}; lower the gap or enlarge the container"
        )
    # no more cells than spheres (per axis: cube root), no cell narrower than the reach
    most = max(1, int(np.ceil(2 * len(members) ** (1 / 3))))
    across = np.where(wraps, face_distances(periods), span)
    cells = np.clip(np.floor(across / max(reach, 1e-300)), 1, most).astype(np.int64)
    index = np.clip((along_edges(place.centers - low, periods) / span * cells).astype(np.int64), 0, cells - 1)
    # layer by layer along z, as grains of a bed are numbered, which are then near each other in memory
    flat = ((index[:, 2] * cells[1] + index[:, 1]) * cells[0] + index[:, 0])[members]
    order = np.argsort(flat, kind="stable")
    start = np.searchsorted(flat[order], np.arange(int(np.prod(cells)) + 1))
    # an open axis along which all centers agree has no width to divide by
    width = np.where(wraps, across / cells, 1.0)
    around = np.where(wraps & (reach > width), np.ceil(reach / width), 1).astype(np.int64)
    rows = np.column_stack([place.centers, place.radii])
    filled = Cells(rows[members][order], order, start, cells, around, wraps.astype(np.int64), periods)
    arguments = rows[queries], index[queries], filled, float(gap), queries is members

    def of_block(begin: int, end: int) -> Integers:
        pairs = np.zeros((16 * (end - begin), 5), dtype=np.int64)
        while (found := _visit_pairs(*arguments, begin, end, pairs)) > len(pairs):
            pairs = np.zeros((found, 5), dtype=np.int64)
        pairs = pairs[:found]
        pairs[:, 0], pairs[:, 1] = queries[pairs[:, 0]], members[pairs[:, 1]]
        return pairs

    blocks = at_once([partial(of_block, *block) for block in blocks_of(len(queries), BLOCK)])
    return blocks[0] if len(blocks) == 1 else np.concatenate(blocks)


def _in_order(pairs: Integers) -> Integers:
    """Return pairs with i <= j, in lexical order."""
    swapped = pairs[:, 0] > pairs[:, 1]
    pairs[swapped] = pairs[swapped][:, [1, 0, 2, 3, 4]] * [1, 1, -1, -1, -1]
    return np.asarray(pairs[np.lexsort(pairs.T[::-1])])


@kernel
def _visit_pairs(queries, index, cells, gap, one_set, begin, end, pairs):  # type: ignore[no-untyped-def]
    """Walk the cells around queries `begin` to `end` - 1, write the pairs in lexical order, and return their number.

    Where they are more than `pairs` has rows for, those that have no row are counted only. In one set, each pair comes
    once.
    """
    many, around, wraps, p, packed = cells.many, cells.around, cells.wraps, cells.periods, cells.sphere
    count = 0
    for i in range(begin, end):
        first = count
        x, y, z, r = queries[i, 0], queries[i, 1], queries[i, 2], queries[i, 3] + gap
        for ox in range(-around[0], around[0] + 1):
            cx = index[i, 0] + ox
            ix = cx // many[0]
            if ix != 0 and wraps[0] == 0:
                continue
            for oy in range(-around[1], around[1] + 1):
                cy = index[i, 1] + oy
                iy = cy // many[1]
                if iy != 0 and wraps[1] == 0:
                    continue
                for oz in range(-around[2], around[2] + 1):
                    cz = index[i, 2] + oz
                    iz = cz // many[2]
                    if iz != 0 and wraps[2] == 0:
                        continue
                    own = ix == 0 and iy == 0 and iz == 0
                    ahead = ix > 0 or (ix == 0 and (iy > 0 or (iy == 0 and iz > 0)))
                    cell = ((cz - iz * many[2]) * many[1] + cy - iy * many[1]) * many[0] + cx - ix * many[0]
                    px = x - (ix * p[0, 0] + iy * p[1, 0] + iz * p[2, 0])
                    py, pz = y - (iy * p[1, 1] + iz * p[2, 1]), z - iz * p[2, 2]
                    # backwards: in one set no pair is left once the numbers are smaller
                    for k in range(cells.start[cell + 1] - 1, cells.start[cell] - 1, -1):
                        j = cells.order[k]
                        if one_set and j < i:
                            break
                        dx, dy, dz = packed[k, 0] - px, packed[k, 1] - py, packed[k, 2] - pz
                        reach = packed[k, 3] + r
                        if dx * dx + dy * dy + dz * dz > reach * reach or reach < 0.0:
                            continue
                        if one_set and j == i and (own or not ahead):
                            continue
                        if count < len(pairs):
                            _insert(pairs, first, count, i, j, ix, iy, iz)
                        count += 1
    return count


@kernel
def _insert(pairs, first, count, i, j, ix, iy, iz):  # type: ignore[no-untyped-def]
    """Insert a pair among those of sphere i, rows first to count, so that they stay in lexical order."""
    k = count
    while k > first and (
        pairs[k - 1, 1] > j
        or (
            pairs[k - 1, 1] == j
            and (
                pairs[k - 1, 2] > ix
                or (
                    pairs[k - 1, 2] == ix and (pairs[k - 1, 3] > iy or (pairs[k - 1, 3] == iy and pairs[k - 1, 4] > iz))
                )
            )
        )
    ):
        for c in range(5):
            pairs[k, c] = pairs[k - 1, c]
        k -= 1
    pairs[k, 0], pairs[k, 1], pairs[k, 2], pairs[k, 3], pairs[k, 4] = i, j, ix, iy, iz
