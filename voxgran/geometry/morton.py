"""Morton order of lattice sites, along a space-filling curve that preserves locality, and of slabs of a bed."""

import math

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers

#: grains from which on a bed and its contacts are larger than the caches of a processor
MANY = 20_000
#: grains of a block at least, largest number of blocks, and least width of a slab of blocks
LEAST, MOST, WIDTH = 2_500, 64, 3.0


def morton_order(sites: Integers) -> Integers:
    """Return the order of sites (n, 3), with an extent below 2**21 along each axis, along the Morton curve.

    It interleaves the bits of their coordinates (Morton 1966, A computer oriented geodetic data base and a new
    technique in file sequencing, IBM).
    """
    if not len(sites):
        return np.zeros(0, dtype=np.int64)
    code = np.zeros(len(sites), dtype=np.uint64)
    local = (sites - sites.min(axis=0)).astype(np.uint64)
    for axis in range(3):
        # two empty bits after each bit
        spread = local[:, axis] & np.uint64(0x1FFFFF)
        for shift, mask in (
            (32, 0x1F00000000FFFF),
            (16, 0x1F0000FF0000FF),
            (8, 0x100F00F00F00F00F),
            (4, 0x10C30C30C30C30C3),
            (2, 0x1249249249249249),
        ):
            spread = (spread | (spread << np.uint64(shift))) & np.uint64(mask)
        code |= spread << np.uint64(axis)
    return np.argsort(code, kind="stable")


def block_count(grains: int) -> int:
    """Return in how many blocks of the same size, a power of two, grains are divided by their order; 1 if few."""
    return 2 ** int(math.log2(min(max(grains // LEAST, 1), MOST))) if grains >= MANY else 1


def layered_order(position: Floats, down: Floats) -> Integers:
    """Return an order of positions (n, 3), at least 1 apart or so, in which neighbours are near each other in memory.

    A few are in the order of their heights. Many are divided into upright slabs with the same number of grains across
    the longest horizontal side, as many as there are blocks, or half or a quarter of them and so on where slabs would
    be narrow; in each slab they are in layers, and in each layer along the Morton curve.
    """
    height, blocks = -linear.matmul(position, down), block_count(len(position))
    if blocks == 1:
        return np.argsort(height, kind="stable")
    upright = int(np.abs(down).argmax())
    sites = np.floor(position).astype(np.int64)
    sites[:, upright] = 0
    across = morton_order(sites)
    side = int(np.ptp(sites, axis=0).argmax())
    while blocks > 1 and np.ptp(sites[:, side]) < blocks * WIDTH:
        blocks //= 2
    slab = np.empty(len(position), dtype=np.int64)
    slab[np.argsort(position[:, side], kind="stable")] = np.arange(len(position)) * blocks // len(position)
    return np.asarray(across[np.lexsort([np.floor(height[across]), slab[across]])])
