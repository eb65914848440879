"""A box with walls or periodic faces, and what it shares with a rectangle."""

import math
from collections.abc import Sized
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base import ExplainedAttributes
from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers, as_length, as_place, as_points, as_positive, as_vector
from voxgran._base.axes import Flags, Periodic, as_periodic
from voxgran._base.calls import explained
from voxgran._base.errors import InputError
from voxgran.containers.model import Boundary, ContainerKind
from voxgran.geometry.walls import planes_across
from voxgran.shapes.tessellate import unit_box

#: part of a tilt that is left by rounding where it was a multiple of a length
ROUNDING = 1e-15


@dataclass(frozen=True, init=False)
class Block:
    """A box along the axes in two or three dimensions: what :class:`Box` and :class:`Rectangle` share."""

    lengths: tuple[float, ...]
    periodic: Flags
    origin: tuple[float, ...]
    tilt: tuple[float, ...]
    kind: ClassVar[str]
    dimension: ClassVar[int]

    def _set(self, lengths: "ArrayLike", periodic: Periodic, origin: "ArrayLike", tilt: "ArrayLike") -> None:
        """Check and set the attributes."""
        d = self.dimension
        if isinstance(lengths, Sized) and len(lengths) == 5 - d:
            other = "Rectangle, which has 2" if d == 3 else "Box, which has 3"
            raise InputError(
                f"lengths has shape ({5 - d},): it must have shape ({d},), as a {self.kind} has {d} dimensions; use a "
                f"{other}"
            )
        edges = tuple(
            as_length(float(v), f"length of the {self.kind}") for v in as_vector(lengths, "lengths", length=d)
        )
        corner = tuple(float(value) for value in as_place(origin, "origin", length=d))
        object.__setattr__(self, "lengths", edges)
        object.__setattr__(self, "periodic", as_periodic(periodic, d))
        object.__setattr__(self, "origin", corner)
        object.__setattr__(self, "tilt", self._least_tilt(as_place(np.atleast_1d(tilt), "tilt", length=2 * d - 3)))

    def _least_tilt(self, tilt: Floats) -> tuple[float, ...]:
        """Return the tilts of the same lattice that are at most half a length, and check the axes that they are along.

        Raises
        ------
        InputError
            If an axis along which the box is tilted is not periodic.
        """
        vectors = self._vectors(tilt)
        # the last vector first, whose multiple of the second one changes its tilt along x
        for row, axis in ((2, 1), (2, 0), (1, 0))[-len(tilt) :]:
            given = vectors[row, axis]
            vectors[row] -= np.rint(given / vectors[axis, axis]) * vectors[axis]
            if abs(vectors[row, axis]) <= ROUNDING * abs(given):
                vectors[row, axis] = 0.0
        least = vectors[np.tril_indices(self.dimension, -1)]
        for value, name in zip(least, ("xy", "xz", "yz"), strict=False):
            if value and not all(self.periodic["xyz".index(axis)] for axis in name):
                raise InputError(
                    f"tilt {name} is {value:g}: the {self.kind} must be periodic along {name[0]} and {name[1]}, as "
                    f"what leaves it along {name[1]} comes back shifted along {name[0]}; make them periodic, or leave "
                    "the tilt out"
                )
        return tuple(float(value) for value in least)

    def _vectors(self, tilt: "ArrayLike") -> Floats:
        """Return the edges of the cell, the rows of an array, by its tilt."""
        vectors = np.diag(self.lengths)
        vectors[np.tril_indices(self.dimension, -1)] = tilt
        return vectors

    @property
    def vectors(self) -> Floats:
        """Edges of the cell, (3, 3), one in each row, by which it repeats along periodic axes; (2, 2) in 2D.

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.Rectangle((4, 3), "xy", tilt=1.0).vectors.tolist()
        [[4.0, 0.0], [1.0, 3.0]]
        """
        return self._vectors(self.tilt)

    @property
    def volume(self) -> float:
        """Volume, or area in 2D."""
        return math.prod(self.lengths)

    @property
    def bounds(self) -> Floats:
        """Lower and upper corner, (2, 3), as if the container stood upright; z = 0 in 2D."""
        low, span = (np.array([*vector, 0.0][:3]) for vector in (self.origin, self.lengths))
        return np.array([low, low + span])

    @property
    def boundary(self) -> Boundary:
        """The walls in closed form."""
        axes = (axis for axis, wraps in zip("xyz"[: self.dimension], self.periodic, strict=False) if not wraps)
        return Boundary(planes_across(self.bounds, "".join(axes)))

    def scaled(self, factor: float) -> Self:
        """Return the container with lengths and corner multiplied.

        Raises
        ------
        InputError
            If the factor is not above 0, or a length is not between 1e-60 and 1e60 any longer.

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.Box((1, 2, 3)).scaled(2.0).lengths
        (2.0, 4.0, 6.0)
        """
        times = as_positive(factor, "factor")
        lengths, origin, tilt = ([v * times for v in vector] for vector in (self.lengths, self.origin, self.tilt))
        return self._with(lengths, self.periodic[: self.dimension], origin, tilt)

    def with_periodic(self, periodic: Periodic) -> Self:
        """Return the container with other periodic axes.

        Raises
        ------
        InputError
            If `periodic` names no axes, or leaves out one along which the container is tilted.

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.Box((1, 2, 3)).with_periodic("xy").periodic
        (True, True, False)
        """
        return self._with(self.lengths, periodic, self.origin, self.tilt)

    def _with(self, lengths: "ArrayLike", periodic: Periodic, origin: "ArrayLike", tilt: "ArrayLike") -> Self:
        """Return a container of the same kind."""
        made = object.__new__(type(self))
        made._set(lengths, periodic, origin, tilt)
        return made

    def to_mapping(self) -> dict[str, Any]:
        """Return kind and parameters as JSON-able values.

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.Rectangle((1, 2)).to_mapping()
        {'kind': 'rectangle', 'lengths': [1.0, 2.0], 'periodic': [False, False], 'origin': [0.0, 0.0]}
        """
        flags = list(self.periodic[: self.dimension])
        made = {"kind": self.kind, "lengths": list(self.lengths), "periodic": flags, "origin": list(self.origin)}
        return made | ({"tilt": list(self.tilt)} if any(self.tilt) else {})

    def _distance(self, points: Floats) -> Floats:
        """Return the distance of points (n, dimension) from the nearest wall, negative inside; -inf without walls."""
        axes = [k for k in range(self.dimension) if not self.periodic[k]]
        if not axes:
            return np.full(len(points), -np.inf)
        low, high = self.bounds[:, axes]
        beyond = np.maximum(low - points[:, axes], points[:, axes] - high)
        outside = linear.norm(np.maximum(beyond, 0.0), axis=1)
        return np.where(outside > 0, outside, beyond.max(axis=1))


@dataclass(frozen=True, init=False)
class Box(ExplainedAttributes, Block):
    """A box along the axes, or a periodic one whose edges are tilted.

    Parameters
    ----------
    lengths : (3,) sequence of float
        Edges, in the unit of lengths.
    periodic : str, bool or sequence
        Periodic axes: names such as ``"xy"`` or ``["x", "y"]``, three flags, or True for all of them.
    origin : (3,) sequence of float
        Lower corner.
    tilt : (3,) sequence of float
        Tilts xy, xz and yz, as in LAMMPS: the edges are (lx, 0, 0), (xy, ly, 0) and (xz, yz, lz). All axes that a tilt
        names must be periodic. Tilts beyond half a length are brought within it by edges that make the same lattice.

    Raises
    ------
    CallError
        If there are other arguments than these.
    InputError
        If a length is not between 1e-60 and 1e60, the corner is out of this range, `periodic` is invalid, or the box is
        tilted along an axis that is not periodic.

    Examples
    --------
    >>> import voxgran as vg
    >>> box = vg.Box((4, 4, 6), periodic="xy")
    >>> box.volume, box.periodic
    (96.0, (True, True, False))
    >>> vg.Box((4, 4, 6), periodic="xyz", tilt=(3, 0, 1)).tilt
    (-1.0, 0.0, 1.0)
    """

    lengths: tuple[float, float, float]
    origin: tuple[float, float, float]
    tilt: tuple[float, float, float]
    kind: ClassVar[str] = "box"
    dimension: ClassVar[int] = 3

    @explained(hint='Box((4, 4, 6)) or Box((4, 4, 6), periodic="xy")')
    def __init__(
        self,
        lengths: "ArrayLike",
        periodic: Periodic = False,
        *,
        origin: "ArrayLike" = (0.0, 0.0, 0.0),
        tilt: "ArrayLike" = (0.0, 0.0, 0.0),
    ) -> None:
        self._set(lengths, periodic, origin, tilt)

    def signed_distance(self, points: "ArrayLike") -> Floats:
        """Return the distance of (n, 3) points from the nearest wall, negative inside.

        Raises
        ------
        InputError
            If the points are not an (n, 3) array of finite numbers.

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.Box((2, 2, 2)).signed_distance([(1, 1, 1), (1, 1, 2.5)]).tolist()
        [-1.0, 0.5]
        """
        return self._distance(as_points(points))

    def mesh(self) -> tuple[Floats, Integers]:
        """Return vertices and triangles of the boundary.

        Examples
        --------
        >>> import voxgran as vg
        >>> vertices, faces = vg.Box((2, 2, 2)).mesh()
        >>> vertices.shape, faces.shape
        ((8, 3), (12, 3))
        """
        vertices, faces, _ = unit_box()
        return linear.matmul(vertices + 0.5, self.vectors) + np.array(self.origin), faces


registration = ContainerKind(container=Box)
