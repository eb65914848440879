"""Morton order of lattice sites, along a space-filling curve that preserves locality, and of layers of a bed."""

import numpy as np

from voxgran._base.arrays import Floats, Integers

#: grains from which on a bed and its contacts are larger than the caches of a processor
MANY = 20_000


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


def layered_order(position: Floats, down: Floats) -> Integers:
    """Return an order of positions (n, 3), at least 1 apart or so, in which neighbours are near each other in memory.

    A few are in the order of their heights; many layer by layer, along the Morton curve across each layer.
    """
    height = -(position @ down)
    if len(position) < MANY:
        return np.argsort(height, kind="stable")
    sites = np.floor(position).astype(np.int64)
    sites[:, np.abs(down).argmax()] = 0
    across = morton_order(sites)
    return np.asarray(across[np.argsort(np.floor(height[across]), kind="stable")])
