"""Where a run begins: grains of another packing, which stand in the container before any other enters."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.errors import InputError

if TYPE_CHECKING:
    from voxgran.contacts.assembly import Assembly


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

    def queue(self, count: int) -> Integers:
        """Return all grains as the methods keep them: those that wait, then those that have entered."""
        return np.concatenate([np.arange(self.count, count), np.arange(self.count)]).astype(np.int64)


def upward(gravity: Integers, dimension: int) -> Integers:
    """Return the direction in which a grain makes way: against gravity, or along the last axis where there is none."""
    last = np.zeros(3, dtype=np.int64)
    last[dimension - 1] = 1
    return -gravity if gravity.any() else last


def refuse_start(grain: int) -> None:
    """Say that a grain of the start finds no place.

    Raises
    ------
    InputError
        Always.
    """
    raise InputError(
        f"grain {grain} of start finds no place at or above its own: the method needs gaps between grains; give a "
        "taller container, finer voxels or points, or a looser start"
    )


def check_start(start: "Assembly", dimension: int) -> None:
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
