"""Parameters of settling: how grains fall, rub, are shaken and pressed, and what counts as rest."""

from dataclasses import dataclass
from typing import ClassVar, Literal

from voxgran._base import ExplainedAttributes
from voxgran._base.calls import explained_methods
from voxgran._base.config import check_bounds, parameter, parameter_class
from voxgran.settling.materials import Materials, as_friction

#: largest coefficient of friction with which sweeps over the contacts are known to converge
MOST_FRICTION = 2.0
#: largest weight of a lid under which beds were seen to come to rest, in weights of all grains
HEAVIEST = 100.0
#: longest times, in sqrt(d / g): no run of so many steps ends
LONGEST = 1e6


@explained_methods
@dataclass(frozen=True, slots=True)
class Shaking(ExplainedAttributes):
    """Random accelerations of all grains, with moments, which fall linearly to zero.

    Parameters
    ----------
    acceleration
        amplitude at the beginning, in gravitational accelerations.
    duration
        how long grains are shaken, in sqrt(d / g) with the median diameter d.

    Raises
    ------
    InputError
        If one of them is not above 0, or the duration above a million.

    Examples
    --------
    >>> import voxgran as vg
    >>> loose = vg.pack(vg.shapes.sphere(), vg.Box((3, 3, 6)), "rsa", count=20)
    >>> vg.settle(loose, gravity="-z", shaking=vg.Shaking(acceleration=2.0, duration=5.0)).stop_reason
    'settled'
    """

    acceleration: float = parameter(1.0, unit="gravitational accelerations", above=0.0)
    duration: float = parameter(10.0, above=0.0, at_most=LONGEST)

    def __post_init__(self) -> None:
        """Check the ranges."""
        check_bounds(self, of="shaking")


@explained_methods
@dataclass(frozen=True, slots=True)
class Lid(ExplainedAttributes):
    """A flat plate that lies on the bed and moves along gravity only.

    Parameters
    ----------
    weight
        weight, in weights of all grains together.

    Raises
    ------
    InputError
        If it is not above 0, or above 100.

    Examples
    --------
    >>> import voxgran as vg
    >>> loose = vg.pack(vg.shapes.sphere(), vg.Box((3, 3, 6)), "rsa", count=20)
    >>> pressed = vg.settle(loose, gravity="-z", lid=vg.Lid(weight=2.0))
    >>> pressed.stop_reason, pressed.lid.level < 6
    ('settled', True)
    """

    weight: float = parameter(1.0, above=0.0, at_most=HEAVIEST)

    def __post_init__(self) -> None:
        """Check the range."""
        check_bounds(self, of="lid")


@parameter_class
class Settling:
    """How a bed settles.

    Parameters
    ----------
    friction
        Coulomb coefficient of friction between grains and at walls; what rests with the largest one also rests with
        more; or a table of materials, with one friction for each pair.
    restitution
        ratio of the velocities after and before an impact, along the normal.
    shaking
        random accelerations after the fall; if omitted, none.
    lid
        plate that lies on the bed; if omitted, none.
    fall_time
        longest time of the fall with inertia, in sqrt(d / g) with the median diameter d; if omitted, until the mean
        grain sinks by less than 0.05 d in that time unit.
    solid_fraction
        solid fraction of the bed at rest, met to 0.002: the friction (up to 1) and, for denser beds, the shaking are
        found that give it, beginning with the friction that is given; that of the bulk or, in beds of few grains, below
        the surface; if omitted, as friction and shaking give it.
    rest
        share of the grains that must be proven to rest so that the bed counts as settled.
    parts
        shapes that settle: the true ones, or the convex hulls of meshes that are not convex.

    Raises
    ------
    InputError
        If a number is out of its range, or friction is by materials and a solid fraction is sought.
    """

    usual_fall: ClassVar[float] = 20.0

    friction: float | Materials = parameter(0.5, at_least=0.0, at_most=MOST_FRICTION)
    restitution: float = parameter(0.0, at_least=0.0, at_most=1.0)
    shaking: Shaking | None = parameter(None)
    lid: Lid | None = parameter(None)
    fall_time: float | None = parameter(None, at_least=0.0, at_most=LONGEST)
    solid_fraction: float | None = parameter(None, above=0.0, at_most=1.0)
    rest: float = parameter(0.95, above=0.0, at_most=1.0)
    parts: Literal["exact", "hulls"] = parameter("exact")

    def __post_init__(self) -> None:
        """Check the ranges."""
        check_bounds(self)
        as_friction(self.friction, at_most=MOST_FRICTION, sought=self.solid_fraction)
