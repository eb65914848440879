"""A rectangle with walls or periodic sides, for packings in two dimensions."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base import ExplainedAttributes
from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers, as_floats
from voxgran._base.axes import Periodic
from voxgran._base.calls import explained
from voxgran.containers.kinds.box import Block
from voxgran.containers.model import ContainerKind


@dataclass(frozen=True, init=False)
class Rectangle(ExplainedAttributes, Block):
    """A rectangle along the axes in the plane z = 0, or a periodic one whose sides are tilted.

    Parameters
    ----------
    lengths : (2,) sequence of float
        Sides, in the unit of lengths.
    periodic : str, bool or sequence
        Periodic axes: names such as ``"x"`` or ``["x", "y"]``, two flags, or True for both.
    origin : (2,) sequence of float
        Lower corner.
    tilt : float
        Tilt xy, as in LAMMPS: the sides are (lx, 0) and (xy, ly). Both axes must be periodic. A tilt beyond half a
        length is brought within it by a side that makes the same lattice.

    Raises
    ------
    CallError
        If there are other arguments than these.
    InputError
        If a length is not between 1e-60 and 1e60, the corner is out of this range, `periodic` is invalid, or the
        rectangle is tilted and not periodic along both axes.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.Rectangle((4, 3), periodic="x").volume  # its area
    12.0
    """

    lengths: tuple[float, float]
    origin: tuple[float, float]
    tilt: tuple[float]
    kind: ClassVar[str] = "rectangle"
    dimension: ClassVar[int] = 2

    @explained(hint='Rectangle((4, 6)) or Rectangle((4, 6), periodic="x")')
    def __init__(
        self,
        lengths: "ArrayLike",
        periodic: Periodic = False,
        *,
        origin: "ArrayLike" = (0.0, 0.0),
        tilt: "ArrayLike" = 0.0,
    ) -> None:
        self._set(lengths, periodic, origin, tilt)

    def signed_distance(self, points: "ArrayLike") -> Floats:
        """Return the distance of (n, 2 or 3) points from the nearest wall, negative inside; z does not count.

        Raises
        ------
        InputError
            If the points are not finite numbers in two or three columns.

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.Rectangle((2, 2)).signed_distance([(1, 1, 0), (1, 2.5, 0)]).tolist()
        [-1.0, 0.5]
        """
        columns = 2 if np.ndim(points) == 2 and np.shape(points)[1] == 2 else 3
        return self._distance(as_floats(points, "points", shape=(None, columns))[:, :2])

    def mesh(self) -> tuple[Floats, Integers]:
        """Return vertices and triangles of the area.

        Examples
        --------
        >>> import voxgran as vg
        >>> vertices, faces = vg.Rectangle((2, 2)).mesh()
        >>> vertices.shape
        (4, 3)
        """
        vertices = np.zeros((4, 3))
        vertices[:, :2] = linear.matmul(np.array([[0, 0], [1, 0], [1, 1], [0, 1]]), self.vectors) + np.array(
            self.origin
        )
        return vertices, np.array([[0, 1, 2], [0, 2, 3]])


registration = ContainerKind(container=Rectangle)
