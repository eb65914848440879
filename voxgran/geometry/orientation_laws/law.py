"""What distributions of orientations have in common.

A distribution is one of directions: that of an axis of the body, its long principal axis by default. The rotation about
this axis is uniform. In two dimensions directions lie in the plane.
"""

from abc import ABC, abstractmethod
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, as_floats
from voxgran._base.config import check_bounds, parameter, parameter_class, to_mapping
from voxgran._base.errors import InputError, shown
from voxgran.geometry.rotation import normalized, product, rotation_matrices, rotations_between

#: names of axes in the container, and their unit vectors
NAMED = {
    f"{sign}{name}": factor * np.eye(3)[k]
    for k, name in enumerate("xyz")
    for sign, factor in (("", 1.0), ("+", 1.0), ("-", -1.0))
}
Axis = Literal["x", "y", "z", "+x", "+y", "+z", "-x", "-y", "-z"]


@parameter_class
class OrientationLaw(ABC):
    """A distribution of orientations; `kind` is its name in scene files.

    Parameters
    ----------
    body_axis
        axis of the body that the distribution is of: the principal axis of the smallest moment of inertia, that of the
        largest one, as of plates, or a vector in the frame of the shape; spheres need none.
    """

    kind: ClassVar[str]

    body_axis: Literal["long", "short"] | tuple[float, ...] = parameter("long")

    def __post_init__(self) -> None:
        """Check the ranges and the axis of the body."""
        check_bounds(self)
        if self.body_axis not in ("long", "short"):
            as_axis(self.body_axis, "body_axis")

    @abstractmethod
    def directions(self, count: int, generator: np.random.Generator, *, dimension: int) -> Floats:
        """Draw directions (count, 3), independent unit vectors.

        Raises
        ------
        InputError
            If the distribution is not one of this dimension.
        """

    @abstractmethod
    def moment(self, *, dimension: int) -> Floats:
        """Return the second moment of the directions, the orientation tensor, (dimension, dimension).

        Raises
        ------
        InputError
            If the distribution is not one of this dimension.
        """

    def to_mapping(self) -> dict[str, Any]:
        """Return kind and parameters as JSON-able values, from which `make_orientations` restores the distribution."""
        return {"kind": self.kind, **to_mapping(self)}

    def asked(self) -> dict[str, Any]:
        """Return what the provenance of a packing keeps."""
        return self.to_mapping()

    def turns(self, bodies: Floats, generator: np.random.Generator, *, dimension: int) -> Floats:
        """Draw orientations, (n, 4) unit quaternions, of bodies with these axes (n, 3), unit vectors in their frames.

        Raises
        ------
        InputError
            If the distribution is not one of this dimension.
        """
        n, ways = len(bodies), self.directions(len(bodies), generator, dimension=dimension)
        if dimension == 2:
            half = 0.5 * (libm.arctan2(ways[:, 1], ways[:, 0]) - libm.arctan2(bodies[:, 1], bodies[:, 0]))
            return normalized(np.column_stack([libm.cos(half), np.zeros((n, 2)), libm.sin(half)]))
        half = np.pi * generator.random(n)
        about = np.column_stack([libm.cos(half), libm.sin(half)[:, None] * bodies])
        return normalized(product(rotations_between(bodies, ways), about))


def as_axis(value: "ArrayLike", name: str) -> Floats:
    """Return an axis as a unit vector (3,): its name, such as ``"z"`` or ``"-x"``, or a vector of any length.

    Raises
    ------
    InputError
        If it is neither, or its length is 0.
    """
    if isinstance(value, str):
        if value not in NAMED:
            raise InputError(f"{name} is {shown(value)}: it must be one of x, y, z, -x, -y, -z or a vector; change it")
        return np.array(NAMED[value])
    vector = as_floats(value, name, shape=(None,))
    largest = float(np.abs(vector).max(initial=0.0))
    if len(vector) not in (2, 3) or not largest > 0.0:
        raise InputError(
            f"{name} is {shown(value)}: it must be a vector of 2 or 3 numbers that are not all 0; change it"
        )
    axis = np.zeros(3)
    axis[: len(vector)] = vector / largest
    return axis / linear.norm(axis)


def axis_in(value: "ArrayLike", name: str, dimension: int) -> Floats:
    """Return an axis as a unit vector (3,), in two dimensions one in the plane.

    Raises
    ------
    InputError
        If it leads out of the plane.
    """
    axis = as_axis(value, name)
    if dimension == 2 and axis[2] != 0.0:
        raise InputError(f"{name} is {shown(value)}: in two dimensions it must lie in the plane; give one of x and y")
    return axis


def frame_of(axis: Floats, dimension: int) -> Floats:
    """Return orthogonal unit vectors as columns, (dimension, dimension), of which the first is an axis."""
    if dimension == 2:
        return np.array([[axis[0], -axis[1]], [axis[1], axis[0]]])
    return rotation_matrices(rotations_between(np.eye(3)[:1], axis[None]))[0]


def in_space(ways: Floats) -> Floats:
    """Return directions (n, d) as unit vectors (n, 3)."""
    made = np.zeros((len(ways), 3))
    made[:, : ways.shape[1]] = ways / linear.norm(ways, axis=1, keepdims=True)
    return made
