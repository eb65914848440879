"""Lattice sites for the grains of a start, at which no two grains share a voxel."""

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran.packing.digital.container_lattice import ContainerLattice
from voxgran.packing.gravity import upward
from voxgran.packing.problem import Problem
from voxgran.packing.start import Start, refuse_start
from voxgran.settling.separate import spread

#: puts grains, in an order, at their sites or at offsets from them: -1 if all are placed, else the first that is not
PutDown: TypeAlias = Callable[[Integers, Integers, Integers], int]
#: largest distance of a grain of a start from its nearest site, and distances by which all grains are separated until
#: each has a site, in voxels
REACH, SPREADS = 2, (0, 1, 2, 3)


def stand_on_lattice(
    problem: Problem, start: Start, lattice: ContainerLattice, gravity: Integers, put_down: PutDown
) -> Integers:
    """Find lattice sites for the grains of a start at which they share no voxel.

    Each grain is put at the site nearest to its position, or at a free one within two voxels. If a grain has no free
    site, all grains are separated until their true shapes are 1, then 2, then 3 voxels apart, and the search is
    repeated; finally, from the original positions, grains without a site are raised to the first free one.

    Parameters
    ----------
    problem : Problem
        In the normalized frame.
    start : Start
        Its poses.
    lattice : ContainerLattice
        Lattice of the container.
    gravity : (3,) ndarray of int
        Lattice vector of gravity; zero for none.
    put_down : callable
        Takes grains in their order, their sites, which it changes to those that they take, and offsets as those of
        `ways_from`; returns -1, or the first grain without a free site, and has then placed none.

    Returns
    -------
    (m, 3) ndarray of int
        Sites.

    Raises
    ------
    InputError
        If there is no free site for a grain.
    """
    up, near = upward(gravity, problem.dimension), ways_from(gravity, lattice.shape, raised=False)
    grains = problem.start_assembly(start)
    for voxels in SPREADS:
        if voxels:
            grains = spread(grains, voxels * lattice.voxel_size, up.astype(np.float64))
        sites = _sites(grains.position, lattice)
        if put_down(Start(grains.position, start.orientation).rising(gravity), sites, near) < 0:
            return sites
    sites = _sites(start.position, lattice)
    grain = put_down(start.rising(gravity), sites, ways_from(gravity, lattice.shape, raised=True))
    if grain >= 0:
        refuse_start(grain)
    return sites


def _sites(position: Floats, lattice: ContainerLattice) -> Integers:
    """Return the voxel corners nearest to positions."""
    return np.rint((position - lattice.corner) / lattice.voxel_size).astype(np.int64)


def ways_from(gravity: Integers, places: Integers, *, raised: bool) -> Integers:
    """Return the offsets from its nearest site at which a grain of a start is tried, in the order of their trial.

    Parameters
    ----------
    gravity : (3,) ndarray of int
        Lattice vector of gravity; zero for none.
    places : (3,) ndarray of int
        Voxels along x, y, z; 1 along z in two dimensions.
    raised : bool
        Whether the offsets lead straight upward through the whole container.

    Returns
    -------
    (m, 3) ndarray of int
        In voxels; if not raised, all offsets of length 2 or less, the shorter first and of equal ones the higher.
    """
    dimension = 3 if places[2] > 1 else 2
    up = upward(gravity, dimension)
    if raised:
        return np.arange(int(np.abs(up) @ places) + 1)[:, None] * up
    ticks = np.arange(-REACH, REACH + 1)
    near: Integers = np.stack(np.meshgrid(ticks, ticks, ticks if dimension == 3 else [0]), axis=-1).reshape(-1, 3)
    square = (near**2).sum(axis=1)
    near, square = near[square <= REACH**2], square[square <= REACH**2]
    return near[np.lexsort((*near.T, -(near @ up), square))]
