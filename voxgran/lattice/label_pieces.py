"""Pieces of labels: of several pieces of a label the largest is kept, and pieces that meet across periodic faces are
laid out in tiles, copies of the image beside each other, so that they lie side by side.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Booleans, Integers
from voxgran._base.kernels import bare_kernel, inlined_kernel, kernel
from voxgran.lattice.label import connected_components


class Tiles(NamedTuple):
    """Numbers of the voxels of an image: 1 ... n for those in the image of labels 1 ... n, and others in other tiles.

    A voxel that is seen from beyond the end of an axis has the number of the tile before its own.
    """

    wraps: Booleans  # (3,) which axes are periodic
    labels: int  # n
    label: Integers  # (numbers,) label of each
    tile: Integers  # (numbers, 3) of each; the image is tile 0
    across: NDArray[np.int32]  # (3, numbers) number of a voxel as it is seen from beyond the end of each axis


def keep_largest_pieces(labels: NDArray[np.int32], among: Booleans, wraps: Booleans) -> list[int]:
    """Remove all pieces but the largest of labels 1 ... n, 0 for void, of those in `among`, (n + 1,); return which of
    them have several.

    Voxels of a piece are connected by faces, along periodic axes, `wraps`, (3,), also across the border. Of equally
    large pieces the first one stays. The image, (nx, ny, nz), is changed.
    """
    return np.flatnonzero((_remove_pieces(labels, among, wraps) > 1) & among).tolist()


def tiles_of(labels: NDArray[np.int32], count: int, wraps: Booleans, some: Sequence[int] = ()) -> Tiles:
    """Lay out some of the labels 1 ... `count`, each of one piece on a torus, in tiles; the others lie in the image.

    Where a label meets itself across a face in a way in which it cannot be laid out, as one that winds around the
    torus, it is cut in this face.  The image, (nx, ny, nz), is changed to the numbers of the tiles.
    """
    number: dict[tuple[int, ...], int] = {(label, 0, 0, 0): label for label in some}
    for label in some:
        pieces, many = connected_components(labels == label)
        tile = _laid_out(pieces, many, wraps)
        # voxels are seen from beyond the ends of up to three axes
        for seen in (tile[1:, None] - list(np.ndindex(*(1 + wraps)))).reshape(-1, 3).tolist():
            number.setdefault((label, *seen), count + 1 + len(number) - len(some))
        table = np.array([number[label, *place] for place in tile.tolist()], dtype=np.int32)
        np.copyto(labels, table[pieces], where=pieces > 0)
    total = count + 1 + len(number) - len(some)
    owner, places, across = np.arange(total), np.zeros((total, 3), dtype=np.int64), np.empty((3, total), dtype=np.int32)
    across[:] = owner
    for (label, *place), own in number.items():
        owner[own], places[own] = label, place
        for axis, step in enumerate(np.eye(3, dtype=np.int64)):
            across[axis, own] = number.get((label, *(np.array(place) - step).tolist()), own)
    return Tiles(wraps, count, owner, places, across)


def _laid_out(pieces: NDArray[np.int32], many: int, wraps: Booleans) -> Integers:
    """Return tiles, (many + 1, 3), in which pieces 1 ... `many` of an image lie side by side: a tree from the largest
    piece in the image, over faces of voxels across periodic faces.
    """
    tile = np.zeros((many + 1, 3), dtype=np.int64)
    beside: list[dict[int, Integers]] = [{} for _ in tile]
    for axis in np.flatnonzero(wraps).tolist():
        planes = np.moveaxis(pieces, axis, 0)
        last, first = planes[-1], planes[0]
        both, step = (last > 0) & (first > 0), np.eye(3, dtype=np.int64)[axis]
        for one, two in np.unique(np.stack([last[both], first[both]]), axis=1).T.tolist():
            beside[one][two], beside[two][one] = step, -step
    order = [int(np.bincount(pieces.ravel())[1:].argmax()) + 1]
    laid = set(order)
    for one in order:
        for two in beside[one].keys() - laid:
            tile[two] = tile[one] + beside[one][two]
        order += sorted(beside[one].keys() - laid)
        laid |= beside[one].keys()
    return tile


@inlined_kernel
def root_of(above: Integers, run: int) -> int:
    """Return the first run of the piece of a run, or the first of the set of any element, and halve the path to it."""
    while above[run] != run:
        above[run] = above[above[run]]
        run = above[run]
    return run


@bare_kernel
def _join(above, one, two):  # type: ignore[no-untyped-def]
    """Make one piece of the pieces of two runs."""
    first, second = root_of(above, one), root_of(above, two)
    above[max(first, second)] = min(first, second)


@bare_kernel
def _join_rows(runs, above, one, two, rows):  # type: ignore[no-untyped-def]
    """Join the runs of equal labels of two rows that are neighbours, where they lie side by side."""
    a, b = rows[one], rows[two]
    while a < rows[one + 1] and b < rows[two + 1]:
        if runs[a, 0] == runs[b, 0] and runs[a, 1] < runs[b, 2] and runs[b, 1] < runs[a, 2]:
            _join(above, a, b)
        if runs[a, 2] < runs[b, 2]:
            a += 1
        else:
            b += 1


@kernel
def _remove_pieces(labels, among, wraps):  # type: ignore[no-untyped-def]
    """Set all pieces but the largest of some labels to 0; return the number of pieces of each label, (n + 1,).

    A run is what a label takes of a row along z without a gap.
    """
    nx, ny, nz = labels.shape
    many = 0
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                many += labels[i, j, k] > 0 and (k == 0 or labels[i, j, k - 1] != labels[i, j, k])
    # label, first voxel, end
    runs, rows = np.empty((many, 3), dtype=np.int32), np.zeros(nx * ny + 1, dtype=np.int64)
    above = np.arange(many)
    n = 0
    for row in range(nx * ny):
        i, j = row // ny, row % ny
        for k in range(nz):
            if labels[i, j, k] > 0 and (k == 0 or labels[i, j, k - 1] != labels[i, j, k]):
                runs[n, 0], runs[n, 1] = labels[i, j, k], k
                n += 1
            if labels[i, j, k] > 0:
                runs[n - 1, 2] = k + 1
        rows[row + 1] = n
        if wraps[2] and n > rows[row] and labels[i, j, 0] > 0 and labels[i, j, 0] == labels[i, j, nz - 1]:
            _join(above, rows[row], n - 1)
        if j > 0:
            _join_rows(runs, above, row - 1, row, rows)
        if i > 0:
            _join_rows(runs, above, row - ny, row, rows)
        if wraps[1] and j == ny - 1:
            _join_rows(runs, above, row - j, row, rows)
        if wraps[0] and i == nx - 1:
            _join_rows(runs, above, j, row, rows)
    size, pieces = np.zeros(many, dtype=np.int64), np.zeros(len(among), dtype=np.int64)
    largest = np.full(len(among), -1, dtype=np.int64)
    for run in range(many):
        size[root_of(above, run)] += runs[run, 2] - runs[run, 1]
    for run in range(many):
        label = runs[run, 0]
        if above[run] == run:
            pieces[label] += 1
            if largest[label] < 0 or size[run] > size[largest[label]]:
                largest[label] = run
    for row in range(nx * ny):
        for run in range(rows[row], rows[row + 1]):
            if among[runs[run, 0]] and root_of(above, run) != largest[runs[run, 0]]:
                for k in range(runs[run, 1], runs[run, 2]):
                    labels[row // ny, row % ny, k] = 0
    return pieces
