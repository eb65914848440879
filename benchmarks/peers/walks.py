"""The walk of digital packing as others would write it: the peers that its speed is a ratio to.

Both move one grain by one voxel in one of 26 directions, all alike, and refuse where a voxel would be taken twice; with
the same random numbers they go the same way as voxgran's walk, attempt by attempt.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Booleans, Integers
from voxgran._base.lazy import load

#: grid, sites, picks and directions to the number of accepted moves
Walk = Callable[[NDArray[np.int8], Integers, Integers, Integers], int]


def numpy_walk(mask: Booleans, steps: Integers) -> Walk:
    """Return the plain program: fancy indexing of all voxels of the grain, one move after the other."""
    voxels = np.argwhere(mask)

    def walk(grid: NDArray[np.int8], sites: Integers, picks: Integers, ways: Integers) -> int:
        accepted = 0
        for grain, way in zip(picks.tolist(), ways.tolist(), strict=True):
            here = voxels + sites[grain]
            there = here + steps[way]
            grid[tuple(here.T)] = 0
            if grid[tuple(there.T)].any():
                grid[tuple(here.T)] = 1
                continue
            grid[tuple(there.T)] = 1
            sites[grain] += steps[way]
            accepted += 1
        return accepted

    return walk


def front_walk(mask: Booleans, steps: Integers) -> Walk:
    """Return a numba program that tests and writes only the voxels that each direction newly covers or leaves."""
    fronts, tails = [], []
    padded = np.pad(mask, 1)
    voxels = np.argwhere(padded)
    for step in steps:
        fronts.append(voxels[~padded[tuple((voxels + step).T)]] + step - 1)
        tails.append(voxels[~padded[tuple((voxels - step).T)]] - 1)
    bounds = np.cumsum([0, *(len(front) for front in fronts)])
    front, tail = (np.ascontiguousarray(np.concatenate(parts)) for parts in (fronts, tails))
    compiled = load("numba").njit(nogil=True)(_front_moves)

    def walk(grid: NDArray[np.int8], sites: Integers, picks: Integers, ways: Integers) -> int:
        return int(compiled(grid, sites, picks, ways, steps, front, tail, bounds))

    return walk


def _front_moves(grid, sites, picks, ways, steps, front, tail, bounds):  # type: ignore[no-untyped-def]
    """Make the moves; compiled by numba."""
    accepted = 0
    for a in range(len(picks)):
        g, d = picks[a], ways[a]
        x, y, z = sites[g, 0], sites[g, 1], sites[g, 2]
        free = True
        for k in range(bounds[d], bounds[d + 1]):
            if grid[x + front[k, 0], y + front[k, 1], z + front[k, 2]]:
                free = False
                break
        if not free:
            continue
        for k in range(bounds[d], bounds[d + 1]):
            grid[x + front[k, 0], y + front[k, 1], z + front[k, 2]] = 1
            grid[x + tail[k, 0], y + tail[k, 1], z + tail[k, 2]] = 0
        for c in range(3):
            sites[g, c] += steps[d, c]
        accepted += 1
    return accepted


def occupied(shape: Integers, mask: Booleans, sites: Integers) -> NDArray[np.int8]:
    """Return the lattice with walls and grains."""
    grid = np.ones(shape, dtype=np.int8)
    grid[1:-1, 1:-1, 1:-1] = 0
    for site in sites:
        grid[tuple(slice(a, a + n) for a, n in zip(site, mask.shape, strict=True))] |= mask
    return grid
