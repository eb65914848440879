"""Where a run begins: grains of another packing, which stand in the container before any other enters.

Methods keep grains farther apart than true shapes have to be, by the room of a voxel or of what bulges between points.
So grains of a start may touch, and be nearer than a method would ever bring them. Off a lattice, where their true
shapes overlap neither each other nor a wall, they stand as they are, and each stays until a move finds the room that
the method asks for. On a lattice they make way for their voxels, as little as that takes.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.errors import InputError
from voxgran.contacts.assembly import Assembly
from voxgran.contacts.verify import verify
from voxgran.containers.model import Container
from voxgran.settling.separate import spread

if TYPE_CHECKING:
    from voxgran.packing.digital.container_lattice import ContainerLattice
    from voxgran.packing.problem import Problem

#: puts down grains, in an order, at sites, by ways: -1 where all have found a place
PutDown: TypeAlias = Callable[[Integers, Integers, Integers], int]
#: how far from its site a grain of a start is put down, and how far apart all are spread until each has one, in voxels
REACH, SPREADS = 2, (0, 1, 2, 3)
#: depth up to which true shapes of a start overlap by rounding, in mean diameters
ROUND_OFF = 1e-10


@dataclass(frozen=True, eq=False)
class Start:
    """Poses of the first grains of a problem.

    Attributes
    ----------
    position : (m, 3) ndarray of float
        Centroids, in median diameters.
    orientation : (m, 4) ndarray of float
        Unit quaternions.
    """

    position: Floats
    orientation: Floats

    @property
    def count(self) -> int:
        """Number of grains that are there from the beginning."""
        return len(self.position)

    def rising(self, gravity: Integers) -> Integers:
        """Return the grains from the lowest to the highest, so that each can rest on those before it."""
        order: Integers = np.argsort(-(self.position @ gravity), kind="stable")
        return order

    def assembly(self, problem: "Problem") -> Assembly:
        """Return the grains with their true shapes, in the normalized frame."""
        n = self.count
        arrays = {"position": self.position, "scale": problem.diameter[:n], "shape_id": problem.shape_id[:n]}
        return Assembly.of(problem.shapes, problem.container, orientation=self.orientation, **arrays)

    def wrapped(self, container: Container) -> Floats:
        """Return the positions brought into the periodic lengths of a container."""
        wraps, (lower, upper), position = list(container.periodic), container.bounds, self.position.copy()
        lengths = (upper - lower)[wraps]
        position[:, wraps] -= np.floor((position - lower)[:, wraps] / lengths) * lengths
        return np.asarray(position)

    def queue(self, count: int) -> Integers:
        """Return all grains as the methods keep them: those that wait, then those that have entered."""
        return np.concatenate([np.arange(self.count, count), np.arange(self.count)]).astype(np.int64)


def upward(gravity: Integers, dimension: int) -> Integers:
    """Return the direction in which a grain makes way: against gravity, or along the last axis where there is none."""
    last = np.zeros(3, dtype=np.int64)
    last[dimension - 1] = 1
    return -gravity if gravity.any() else last


def stand_on_lattice(
    problem: "Problem", start: Start, lattice: "ContainerLattice", gravity: Integers, put_down: PutDown
) -> Integers:
    """Find lattice sites for the grains of a start at which they share no voxel.

    Each grain goes to the site nearest to its place, or a free one within two voxels. Where a grain finds none, all are
    spread until their true shapes are 1, then 2, then 3 voxels apart, and tried again; at last, all as they were, those
    without a place are raised to the first free one.

    Parameters
    ----------
    problem : Problem
        In the normalized frame.
    start : Start
        Its poses.
    lattice : ContainerLattice
        Where voxels lie.
    gravity : (3,) ndarray of int
        Where down is; zero for none.
    put_down : callable
        Given grains in the order in which they come, their sites, which it changes to where they stand, and ways as
        those of `ways_from`; returns -1, or the first grain without a place, and then has put down none.

    Returns
    -------
    (m, 3) ndarray of int
        Sites.

    Raises
    ------
    InputError
        If a grain finds no place.
    """
    up, near = upward(gravity, problem.dimension), ways_from(gravity, lattice.shape, raised=False)
    grains = start.assembly(problem)
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


def _sites(position: Floats, lattice: "ContainerLattice") -> Integers:
    """Return the corners of voxels that are nearest to some places."""
    return np.rint((position - lattice.corner) / lattice.voxel_size).astype(np.int64)


def ways_from(gravity: Integers, places: Integers, *, raised: bool) -> Integers:
    """Return the ways, (m, 3), by which a grain of a start makes way on a lattice, in the order of their trial.

    Parameters
    ----------
    gravity : (3,) ndarray of int
        Where down is; zero for none.
    places : (3,) ndarray of int
        Voxels along x, y, z; 1 along z in two dimensions.
    raised : bool
        Whether it goes straight upward, as far as it takes.

    Returns
    -------
    (m, 3) ndarray of int
        In voxels; where it is not raised, all that are at most 2 long, the shorter first and of equal ones the higher.
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


def refuse_start(grain: int) -> None:
    """Say that a grain of the start finds no place.

    Raises
    ------
    InputError
        Always.
    """
    raise InputError(
        f"grain {grain} of start finds no place near or above its own: the method needs gaps between grains; give a "
        "taller container, finer voxels or points, or a looser start"
    )


def stands_free(problem: "Problem", start: Start) -> bool:
    """Return whether the true shapes of a start overlap neither each other nor a wall, so that they may stay."""
    return verify(start.assembly(problem), tolerance=ROUND_OFF).ok


def check_start(start: Assembly, dimension: int) -> None:
    """Refuse a start of another dimension.

    Raises
    ------
    InputError
        If its container has another dimension.
    """
    if start.dimension != dimension:
        raise InputError(
            f"start has dimension {start.dimension}: the container has {dimension}; use packings of one dimension"
        )
