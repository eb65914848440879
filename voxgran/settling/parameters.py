"""Parameters of settling and of compression.

The parameters of settling say how grains fall, rub, are shaken and pressed, and what counts as rest. The parameters of
compression are the stress, the axes that move, friction, and what counts as balanced.
"""

import math
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, ClassVar, Literal, TypeVar

import numpy as np

from voxgran._base import ExplainedAttributes
from voxgran._base.arrays import Floats, as_number, as_share
from voxgran._base.calls import explained_methods
from voxgran._base.config import check_bounds, parameter, parameter_class
from voxgran._base.errors import InputError, shown
from voxgran.containers.model import Container
from voxgran.containers.stretch import stretched_together
from voxgran.settling.materials import ROUGH, USUAL_FRICTION, Materials, as_friction, largest_friction

#: largest coefficient of friction with which sweeps over the contacts are known to converge
MOST_FRICTION = 2.0
#: largest weight of a lid under which beds were seen to come to rest, in weights of all grains
HEAVIEST = 100.0
#: dilatancy factor of the densest grains (Rowe 1962, doi:10.1098/rspa.1962.0193), and by how many times grains may be
#: asked to bear more than that: few ones, and grains that interlock, do
DENSEST, ROOM = 2.0, 10.0
#: largest porosity that is asked for
MOST_POROUS = 0.9999
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


def _check_friction(friction: float | Materials | None, sought: float | None) -> None:
    """Check a friction that is given, beside a solid fraction that is sought."""
    if friction is not None:
        as_friction(friction, at_most=MOST_FRICTION, sought=sought)


def as_solid_fraction(solid_fraction: Any, porosity: Any, void_ratio: Any, *, where: str = "") -> float | None:
    """Return the solid fraction that one of three numbers gives; None where all are None.

    Raises
    ------
    InputError
        If several of them are given, or one is out of its range.
    """
    given = {"solid_fraction": solid_fraction, "porosity": porosity, "void_ratio": void_ratio}
    known = [f"{name} is {shown(value)}" for name, value in given.items() if value is not None]
    if len(known) > 1:
        raise InputError(f"{where}{' and '.join(known)}: each of them says how dense the grains become; give one")
    if porosity is not None:
        return 1.0 - as_number(porosity, f"{where}porosity", at_least=0.0, at_most=MOST_POROUS)
    if void_ratio is not None:
        return 1.0 / (1.0 + as_number(void_ratio, f"{where}void_ratio", at_least=0.0))
    return None if solid_fraction is None else as_share(solid_fraction, f"{where}solid_fraction")


def _take_density(how: "Settling | Compression") -> None:
    """Let parameters have a porosity or a void ratio that is given as a solid fraction."""
    found = as_solid_fraction(how.solid_fraction, how.porosity, how.void_ratio)
    for name, value in (("solid_fraction", found), ("porosity", None), ("void_ratio", None)):
        object.__setattr__(how, name, value)


@parameter_class
class Settling:
    """How a bed settles.

    Parameters
    ----------
    friction
        Coulomb coefficient of friction between grains and at walls; what rests with the largest one also rests with
        more; or a table of materials, with one friction for each pair; if omitted, 0.5, or the one that gives a solid
        fraction that is sought.
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
        found that give it, and the shaking only where a friction is given; that of the bulk or, in beds of few grains,
        below the surface; if omitted, as friction and shaking give it.
    porosity
        1 - solid fraction, in place of it.
    void_ratio
        volume of the voids over that of the grains, in place of the solid fraction.
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

    friction: float | Materials | None = parameter(None, at_least=0.0, at_most=MOST_FRICTION)
    restitution: float = parameter(0.0, at_least=0.0, at_most=1.0)
    shaking: Shaking | None = parameter(None)
    lid: Lid | None = parameter(None)
    fall_time: float | None = parameter(None, at_least=0.0, at_most=LONGEST)
    solid_fraction: float | None = parameter(None, above=0.0, at_most=1.0)
    porosity: float | None = parameter(None, at_least=0.0, at_most=MOST_POROUS)
    void_ratio: float | None = parameter(None, at_least=0.0)
    rest: float = parameter(0.95, above=0.0, at_most=1.0)
    parts: Literal["exact", "hulls"] = parameter("exact")

    def __post_init__(self) -> None:
        """Check the ranges."""
        check_bounds(self)
        _take_density(self)
        _check_friction(self.friction, self.solid_fraction)


@parameter_class
class Compression:
    """How grains are compressed.

    Parameters
    ----------
    stress
        mean stress along all axes, or one along each axis, compression above 0, in any unit: only the ratios decide how
        the grains lie; along axes that do not move it is not prescribed.
    axes
        axes along which the container is compressed, such as "z" for an oedometric path.
    shear
        "held": the angles of the container stay as they are, and its shear stresses are a result; "free": a cell tilts
        along each two periodic axes that move, until it has no shear stress there; if omitted, held, with a warning
        where a cell that might tilt has a shear stress above 0.05 of the mean axial one.
    friction
        Coulomb coefficient of friction between grains and at walls; less friction gives a denser packing; or a table of
        materials, with one friction for each pair; if omitted, 0.5, or the one that gives a solid fraction or a height
        that is sought.
    solid_fraction
        solid fraction of the compressed packing, met to 0.002: the friction (up to 1) is found that gives it; if
        omitted, as the friction gives it.
    porosity
        1 - solid fraction, in place of it.
    void_ratio
        volume of the voids over that of the grains, in place of the solid fraction.
    region
        where the solid fraction is measured: "specimen", from wall to wall, as in a laboratory, or "bulk", away from
        the walls, which specimens of few grains have none of.
    height
        height of the container at the end, along its last axis, which alone is compressed: the friction is found that
        gives it, as with a solid fraction, which is then that of the container.
    rate
        viscous number of the compression: strain rate times the drag of a grain of the median diameter, over stress
        times diameter (in 2D over the stress); grains that are compressed slower become a little denser; if omitted,
        3e-3, and 3e-5 with a friction below 0.05.
    rest
        share of the grains that bear forces which must be in balance so that the packing counts as compressed.

    Raises
    ------
    InputError
        If a number is out of its range, or there is a solid fraction beside a height.
    """

    #: grains are not shaken
    shaking: ClassVar[None] = None

    stress: float | tuple[float, ...] = parameter(1.0, above=0.0, at_most=1e60)
    axes: str = parameter("xyz")
    shear: Literal["held", "free"] | None = parameter(None)
    friction: float | Materials | None = parameter(None, at_least=0.0, at_most=MOST_FRICTION)
    solid_fraction: float | None = parameter(None, above=0.0, at_most=1.0)
    porosity: float | None = parameter(None, at_least=0.0, at_most=MOST_POROUS)
    void_ratio: float | None = parameter(None, at_least=0.0)
    region: Literal["specimen", "bulk"] = parameter("specimen")
    height: float | None = parameter(None, above=0.0)
    rate: float | None = parameter(None, at_least=1e-6, at_most=0.1)
    rest: float = parameter(0.98, above=0.0, at_most=1.0)

    def __post_init__(self) -> None:
        """Check the ranges and the names of the axes."""
        check_bounds(self)
        _take_density(self)
        _check_friction(self.friction, self.solid_fraction)
        if not self.axes or len(set(self.axes)) < len(self.axes) or not set(self.axes) <= set("xyz"):
            raise InputError(
                f"axes is {shown(self.axes)}: it must name axes out of x, y, z, each once, such as 'z'; correct it"
            )

        if self.height is not None and self.solid_fraction is not None:
            raise InputError(
                f"height is {self.height:g} and solid_fraction is {self.solid_fraction:g}: either says how dense the "
                "grains become; leave one of them out"
            )

    def refuse_known_friction(self) -> None:
        """Refuse a friction beside the solid fraction or the height that it decides.

        Raises
        ------
        InputError
            If both are given.
        """
        sought = {"solid_fraction": self.solid_fraction, "height": self.height}
        for name, value in sought.items():
            if value is not None and self.friction is not None:
                raise InputError(
                    f"{name} is {value:g} and friction is {shown(self.friction)}: the friction is found that gives the "
                    f"{name.replace('_', ' ')}; leave one of them out"
                )

    def stress_along(self, dimension: int) -> Floats:
        """Return the stresses (xx, yy, zz, yz, xz, xy), those of shear 0.

        Raises
        ------
        InputError
            If there are more or fewer numbers than axes.
        """
        stress, given = np.zeros(6), np.atleast_1d(np.asarray(self.stress, dtype=np.float64))
        if len(given) not in (1, dimension):
            raise InputError(
                f"stress is {shown(self.stress)}: it must be one number, or {dimension}, one along each axis; correct "
                "it"
            )
        stress[:dimension] = given
        return stress

    def modes_of(self, container: Container) -> Floats:
        """Return the projection (6, 6) onto the strains that the container may have.

        Raises
        ------
        InputError
            If none of its walls moves along the axes, stresses differ along axes that stretch together or by far more
            than grains bear, or there is a height and other axes move.
        """
        stress, modes = self.stress_along(container.dimension), np.zeros((6, 6))
        last = "xyz"[container.dimension - 1]
        if self.height is not None and self.axes != last:
            raise InputError(f"height is {self.height:g} and axes is {self.axes!r}: it needs axes={last!r}; change it")
        free = {"xyz".index(axis) for axis in self.axes}
        groups = stretched_together(container)
        for group in groups:
            if not free.issuperset(group):
                continue
            if np.ptp(stress[list(group)]) > 0.0:
                names = " and ".join("xyz"[axis] for axis in group)
                raise InputError(
                    f"stress is {shown(self.stress)}: a {container.kind} has one stress along {names}; give equal "
                    "numbers"
                )
            mode = np.zeros(6)
            mode[list(group)] = 1.0
            modes += np.outer(mode, mode) / len(group)
        if not modes.any():
            names = ", ".join(repr("".join("xyz"[axis] for axis in group)) for group in groups)
            raise InputError(
                f"axes is {self.axes!r}: a {container.kind} is compressed along {names} only; name one of them"
            )
        self._refuse_unbearable(stress[:3][np.diag(modes)[:3] > 0.0])
        if self.shear == "free":
            wrap = [axis for axis in sorted(free) if container.periodic[axis]]
            # of the six strains those of yz, xz and xy come last
            pairs = [6 - a - b for a, b in combinations(wrap, 2)]
            if not pairs:
                raise InputError(
                    f"shear is 'free', the periodic axes of the {container.kind} are {container.periodic}, and axes is "
                    f"{self.axes!r}: a cell tilts along two periodic axes that move; leave shear out"
                )
            modes[pairs, pairs] = 1.0
        return modes

    def _refuse_unbearable(self, stress: Floats) -> None:
        """Refuse stresses along moving axes (k,) of which the least is too small.

        Grains bear a ratio of the largest to the least principal stress of up to ``D tan(45 deg + angle / 2)^2``
        (Rowe 1962), with the angle of friction at a contact, and a dilatancy factor D of 1 to 2.

        Raises
        ------
        InputError
            If it is.
        """
        usual = with_friction(self).friction
        friction = ROUGH if usual is None else largest_friction(usual)
        bears, asked = DENSEST * (math.sqrt(1.0 + friction**2) + friction) ** 2, float(stress.max() / stress.min())
        if asked > ROOM * bears:
            raise InputError(
                f"stress is {shown(self.stress)}: the largest is {asked:.3g} times the least along an axis that moves, "
                f"and the densest grains with a friction of {friction:g} bear up to {bears:.3g} times (Rowe 1962); ask "
                f"for more equal stresses, up to {ROOM * bears:.3g} times, or leave axes out that need not move"
            )


How = TypeVar("How", Settling, Compression)


def with_friction(how: How) -> How:
    """Return parameters with the usual friction where none is given, and none is sought."""
    sought = how.solid_fraction is not None or getattr(how, "height", None) is not None
    return how if sought or how.friction is not None else replace(how, friction=USUAL_FRICTION)
