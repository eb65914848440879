"""A drum: a cylinder on its side."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

from voxgran._base.arrays import as_choice
from voxgran._base.calls import explained_methods
from voxgran.containers.equipment import Equipment, Space, revolved_space
from voxgran.containers.model import ContainerKind


@explained_methods
@dataclass(frozen=True)
class Drum(Equipment):
    """A cylinder with flat ends whose axis is along x or y, across gravity along z.

    Parameters
    ----------
    radius : float
        Radius, in the unit of lengths.
    length : float
        Length along the axis.
    axis : {"x", "y"}
        Axis.
    origin : (3,) sequence of float
        Center.

    Raises
    ------
    CallError
        If there are other arguments than these.
    InputError
        If the axis is another one, or a length is not between 1e-60 and 1e60.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.Drum(radius=2, length=5).bounds.tolist()
    [[-2.5, -2.0, -2.0], [2.5, 2.0, 2.0]]
    """

    radius: float
    length: float
    axis: str = "x"
    origin: tuple[float, float, float] = field(default=(0.0, 0.0, 0.0), kw_only=True)
    kind: ClassVar[str] = "drum"
    _lengths: ClassVar[tuple[str, ...]] = ("radius", "length", "origin")

    def __post_init__(self) -> None:
        """Check the parameters."""
        self._check_lengths()
        as_choice(self.axis, "axis of the drum", ("x", "y"))

    @cached_property
    def space(self) -> Space:
        """The space within the walls."""
        ends = [(side * self.length / 2, self.radius) for side in (-1, 1)]
        return revolved_space(ends, self.origin, "xy".index(self.axis))


registration = ContainerKind(container=Drum)
