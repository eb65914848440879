"""Lattice sites for the grains of a start, at which no two grains share a voxel."""

from collections.abc import Callable

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers
from voxgran.containers.gravity import upward
from voxgran.packing.digital.container_lattice import ContainerLattice
from voxgran.packing.problem import Problem
from voxgran.packing.start import Start, refuse_start
from voxgran.settling.parting import spread

#: largest distance of a grain of a start from its nearest site, and distances by which all grains are separated until
#: each has a site, in voxels
REACH, SPREADS = 2, (0, 1, 2, 3)


def stand_on_lattice(
    problem: Problem, start: Start, lattice: ContainerLattice, gravity: Integers, *,
    put: Callable[[int, Integers, Integers], bool], remove: Callable[[int, Integers], None],
) -> Integers:  # fmt: skip
    """Place the grains of a start at lattice sites at which they share no voxel; return the sites, (m, 3).

    Each grain is put at the site nearest to its position, or at a free one within two voxels. If a grain has no free
    site, all grains are separated until their true shapes are 1, then 2, then 3 voxels apart, and the search is
    repeated; finally, from the original positions, grains without a site are raised to the first free one.

    `gravity` is a lattice vector, zero for none. `put` tries a grain at a site, which it changes to that where it puts
    the grain, with offsets as those of `ways_from`, and returns whether one was free; `remove` undoes this.

    Raises
    ------
    InputError
        If there is no free site for a grain.
    """

    def stuck(order: Integers, sites: Integers, ways: Integers) -> int:
        """Place all grains and return -1, or none and return the first that finds no site."""
        for k, grain in enumerate(order.tolist()):
            if not put(grain, sites[grain], ways):
                for other in order[:k].tolist():
                    remove(other, sites[other])
                return grain
        return -1

    up, near = upward(gravity, problem.dimension), ways_from(gravity, lattice.shape, raised=False)
    grains = problem.start_assembly(start)
    for voxels in SPREADS:
        if voxels:
            grains = spread(grains, voxels * lattice.voxel_size, up.astype(np.float64))
        sites = _sites(grains.position, lattice)
        if stuck(Start(grains.position, start.orientation).rising(gravity), sites, near) < 0:
            return sites
    sites = _sites(start.position, lattice)
    grain = stuck(start.rising(gravity), sites, ways_from(gravity, lattice.shape, raised=True))
    if grain >= 0:
        refuse_start(start, grain, problem.container)
    return sites


def _sites(position: Floats, lattice: ContainerLattice) -> Integers:
    """Return the voxel corners nearest to positions."""
    return np.rint((position - lattice.corner) / lattice.voxel_size).astype(np.int64)


def ways_from(gravity: Integers, places: Integers, *, raised: bool) -> Integers:
    """Return the offsets (m, 3) in voxels from its nearest site at which a grain of a start is tried, in their order.

    They are all offsets of length 2 or less, the shorter first and of equal ones the higher, or, if `raised`, lead
    straight upward through the whole container. `gravity` is a lattice vector, zero for none; `places` are the voxels
    along x, y, z, 1 along z in two dimensions.
    """
    dimension = 3 if places[2] > 1 else 2
    up = upward(gravity, dimension)
    if raised:
        return np.arange(int(linear.matmul(np.abs(up), places)) + 1)[:, None] * up
    ticks = np.arange(-REACH, REACH + 1)
    near: Integers = np.stack(np.meshgrid(ticks, ticks, ticks if dimension == 3 else [0]), axis=-1).reshape(-1, 3)
    square = (near**2).sum(axis=1)
    near, square = near[square <= REACH**2], square[square <= REACH**2]
    return near[np.lexsort((*near.T, -linear.matmul(near, up), square))]
