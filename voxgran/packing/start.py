"""Poses of the grains from which a run starts: those of another packing, present before any other grain enters.

Methods keep a distance between grains beyond what true shapes need: the width of a voxel, or the bulge of a surface
between control points. Grains of a start may therefore touch, and be nearer than the method would place them. Without a
lattice they keep their poses where their true shapes overlap neither each other nor a wall; each stays until a move
provides the distance that the method requires. On a lattice they are displaced until their voxels do not overlap
(:mod:`voxgran.packing.digital.initial_sites`).
"""

from dataclasses import dataclass

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.errors import InputError
from voxgran.contacts.assembly import Assembly
from voxgran.containers.model import Container


@dataclass(frozen=True, eq=False)
class Start:
    """Poses of the first grains of a problem: centroids (m, 3) in median diameters, and unit quaternions (m, 4)."""

    position: Floats
    orientation: Floats

    @property
    def count(self) -> int:
        """Number of grains of the start."""
        return len(self.position)

    def rising(self, gravity: Integers) -> Integers:
        """Return the indices of the grains from the lowest to the highest."""
        order: Integers = np.argsort(-(self.position @ gravity), kind="stable")
        return order

    def wrapped(self, container: Container) -> Floats:
        """Return the positions brought into the periodic lengths of a container."""
        wraps, (lower, upper), position = list(container.periodic), container.bounds, self.position.copy()
        lengths = (upper - lower)[wraps]
        position[:, wraps] -= np.floor((position - lower)[:, wraps] / lengths) * lengths
        return np.asarray(position)

    def queue(self, count: int) -> Integers:
        """Return the indices of all `count` grains: first those not yet placed, then those of the start."""
        return np.concatenate([np.arange(self.count, count), np.arange(self.count)]).astype(np.int64)


def refuse_start(grain: int) -> None:
    """Raise the error that no place is found for a grain of the start.

    Raises
    ------
    InputError
        Always.
    """
    raise InputError(
        f"grain {grain} of start finds no place near or above its own: the method needs gaps between grains; give a "
        "taller container, finer voxels or points, or a looser start"
    )


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
