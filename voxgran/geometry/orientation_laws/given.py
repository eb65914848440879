"""A given list of orientations, one for each grain."""

from typing import Any, ClassVar

import numpy as np

from voxgran._base.arrays import Floats, as_quaternions
from voxgran._base.config import parameter, parameter_class
from voxgran._base.errors import InputError
from voxgran.geometry.orientation_laws.law import OrientationLaw
from voxgran.geometry.rotation import normalized


@parameter_class
class Given(OrientationLaw):
    """The orientation of each grain, in the order of the grains.

    Parameters
    ----------
    quaternions
        unit quaternions (w, x, y, z), each from the frame of the shape to the container.

    Raises
    ------
    InputError
        If these are no unit quaternions.
    """

    kind: ClassVar[str] = "given"

    quaternions: tuple[tuple[float, ...], ...] = parameter()

    def __post_init__(self) -> None:
        """Check the quaternions."""
        OrientationLaw.__post_init__(self)
        as_quaternions(self.quaternions, "quaternions")

    def turns(self, bodies: Floats, generator: np.random.Generator, *, dimension: int) -> Floats:
        """Return the list.

        Raises
        ------
        InputError
            If it has another length than the grains, or one of them leads out of the plane of two dimensions.
        """
        found = as_quaternions(self.quaternions, "quaternions")
        if len(found) != len(bodies):
            raise InputError(
                f"quaternions has {len(found)} rows and there are {len(bodies)} grains: each grain has one, in the "
                "order of a list of grains or of count; give as many"
            )
        if dimension == 2 and found[:, 1:3].any():
            row = int(np.flatnonzero(found[:, 1:3].any(axis=1))[0])
            raise InputError(
                f"quaternions is {found[row].tolist()} at row {row}: in two dimensions grains rotate about z only; "
                "give (w, 0, 0, z)"
            )
        return normalized(found)

    def directions(self, count: int, generator: np.random.Generator, *, dimension: int) -> Floats:
        """Return nothing of a list."""
        return np.zeros((0, 3))

    def moment(self, *, dimension: int) -> Floats:
        """Return NaN: a list has no distribution."""
        return np.full((dimension, dimension), np.nan)

    def asked(self) -> dict[str, Any]:
        """Return what the provenance of a packing keeps: the packing has the list itself."""
        return {"kind": self.kind, "count": len(self.quaternions)}
