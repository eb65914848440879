"""A hopper: a cone, or a wedge, above an outlet, below a bin with vertical walls."""

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

from voxgran._base.arrays import as_number
from voxgran._base.calls import explained_methods
from voxgran.containers.equipment import Equipment, Space, revolved_space, space_within
from voxgran.containers.model import ContainerKind
from voxgran.geometry.walls import plane


@explained_methods
@dataclass(frozen=True)
class Hopper(Equipment):
    """A hopper along z whose outlet is closed by a flat wall.

    Parameters
    ----------
    radius : float
        Radius at the top, in the unit of lengths; of a wedge, half its width along x.
    outlet : float
        Radius of the outlet, below that at the top; of a wedge, half the width of its slot. Grains arch over an outlet
        narrower than about five diameters [1]_, which packing warns of.
    angle : float
        Angle between the inclined wall and the horizontal, in degrees.
    length : float, optional
        Length along y, which makes the hopper a wedge with vertical ends; None for a cone.
    bin_height : float, optional
        Height of the bin with vertical walls above; None for none.
    origin : (3,) sequence of float
        Center of the outlet.

    Raises
    ------
    CallError
        If there are other arguments than these.
    InputError
        If the outlet is not narrower than the top, the angle is not above 0 and at most 89 degrees, or a length is not
        between 1e-60 and 1e60.

    References
    ----------
    .. [1] Zuriguel et al. 2005, doi:10.1103/PhysRevE.71.051303.

    Examples
    --------
    >>> import voxgran as vg
    >>> hopper = vg.Hopper(radius=4, outlet=1, angle=45)
    >>> round(hopper.volume, 3), hopper.bounds[1].round(9).tolist()
    (65.973, [4.0, 4.0, 3.0])
    >>> round(vg.Hopper(radius=4, outlet=1, angle=45, length=2, bin_height=5).volume, 9)
    110.0
    """

    radius: float
    outlet: float
    angle: float = 60.0
    length: float | None = field(default=None, kw_only=True)
    bin_height: float | None = field(default=None, kw_only=True)
    origin: tuple[float, float, float] = field(default=(0.0, 0.0, 0.0), kw_only=True)
    kind: ClassVar[str] = "hopper"
    _lengths: ClassVar[tuple[str, ...]] = ("radius", "outlet", "length", "bin_height", "origin")

    def __post_init__(self) -> None:
        """Check the parameters."""
        self._check_lengths()
        as_number(self.radius, "radius of the hopper", above=self.outlet)
        self._set("angle", as_number(self.angle, "angle of the hopper", above=0.0, at_most=89.0))

    @cached_property
    def space(self) -> Space:
        """The space within the walls."""
        slope = (self.radius - self.outlet) * math.tan(math.radians(self.angle))
        profile = [(0.0, self.outlet), (slope, self.radius)]
        if self.bin_height is not None:
            profile.append((slope + self.bin_height, self.radius))
        if self.length is None:
            return revolved_space(profile, self.origin)
        sine, cosine = math.sin(math.radians(self.angle)), math.cos(math.radians(self.angle))
        top = profile[-1][0]
        walls = [(0.0, 0.0, 0.0, 0.0, 0.0, -1.0), (0.0, 0.0, top, 0.0, 0.0, 1.0)]
        for side in (-1.0, 1.0):
            walls.append((0.0, side * self.length / 2, 0.0, 0.0, side, 0.0))
            walls.append((side * self.outlet, 0.0, 0.0, side * sine, 0.0, -cosine))
            if self.bin_height is not None:
                walls.append((side * self.radius, 0.0, 0.0, side, 0.0, 0.0))
        x, y, z = self.origin
        planes = [plane((x + a, y + b, z + c), (u, v, w)) for a, b, c, u, v, w in walls]
        return space_within(planes, "hopper")


registration = ContainerKind(container=Hopper)
