"""A funnel: a cone between two disks."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

from voxgran._base.calls import explained_methods
from voxgran.containers.equipment import Equipment, Space, revolved_space
from voxgran.containers.model import ContainerKind


@explained_methods
@dataclass(frozen=True)
class Funnel(Equipment):
    """A truncated cone along z, closed at both ends.

    Where it is wider below than above it is the mould of a slump test.

    Parameters
    ----------
    radius : float
        Radius at the top, in the unit of lengths.
    outlet : float
        Radius at the bottom.
    height : float
        Height.
    origin : (3,) sequence of float
        Center of the bottom.

    Raises
    ------
    CallError
        If there are other arguments than these.
    InputError
        If a length is not between 1e-60 and 1e60.

    Examples
    --------
    >>> import voxgran as vg
    >>> round(vg.Funnel(radius=0.05, outlet=0.1, height=0.3).volume, 7)  # the cone of Abrams, in m
    0.0054978
    """

    radius: float
    outlet: float
    height: float
    origin: tuple[float, float, float] = field(default=(0.0, 0.0, 0.0), kw_only=True)
    kind: ClassVar[str] = "funnel"
    _lengths: ClassVar[tuple[str, ...]] = ("radius", "outlet", "height", "origin")

    def __post_init__(self) -> None:
        """Check the parameters."""
        self._check_lengths()

    @cached_property
    def space(self) -> Space:
        """The space within the walls."""
        return revolved_space([(0.0, self.outlet), (self.height, self.radius)], self.origin)


registration = ContainerKind(container=Funnel)
