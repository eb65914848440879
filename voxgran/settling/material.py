"""Material of grains and walls."""

from typing import Literal

from voxgran._base import ExplainedAttributes
from voxgran._base.config import check_bounds, parameter, parameter_class
from voxgran._base.errors import InputError

#: least density, stiffness and modulus, in SI units: far below those of any solid, and no time step of it is 0
LEAST = 1e-12


@parameter_class
class Material(ExplainedAttributes):
    """Material of grains and walls in an engine, in SI units.

    Under the linear law two grains that overlap by delta repel each other with ``k delta + c delta'``; the damping
    follows from the restitution e and the effective mass m as ``c = 2 zeta sqrt(k m)`` with
    ``zeta = -ln e / sqrt(pi^2 + ln^2 e)``. Under the law of Hertz the force of elastic spheres takes the place of
    ``k delta``.

    Parameters
    ----------
    law
        contact law: linear spring-dashpot, or Hertz with the tangential stiffness of Mindlin.
    density
        density of the solid, in kg/m^3; if omitted, that of the packing, or of each of its shapes; where that is 1,
        which is the value of a packing without a stated density, 2650, that of quartz.
    stiffness
        normal stiffness of the linear law, in N/m; if omitted, pi / 4 times Young's modulus times the median diameter
        where the modulus is given, else such that the weight of the bed presses the most loaded of its lowest grains
        into the floor by a thousandth of its diameter.
    shear_stiffness
        tangential stiffness of the linear law, in N/m; if omitted, 2/7 of the normal one.
    young_modulus
        Young's modulus, in Pa; the law of Hertz needs it.
    poisson_ratio
        Poisson's ratio.
    restitution
        ratio of the normal velocities after and before a collision.
    friction
        Coulomb coefficient of friction between grains and at walls.
    rolling_friction
        coefficient of rolling friction: the largest rolling moment over the normal force times the effective radius
        r1 r2 / (r1 + r2), for engines that have it; grains that settle here roll freely.
    cohesion
        surface energy of the contacts, in J/m^2, for the law of Hertz and engines that have it; two spheres of the
        effective radius R are pulled apart by the force 4 pi cohesion R (Derjaguin, Muller & Toporov 1975,
        doi:10.1016/0021-9797(75)90018-1).
    bond_strength
        strength of the bonds between the spheres of a clump, in Pa; if omitted, clumps are rigid.

    Raises
    ------
    InputError
        If a number is out of its range, the law is unknown, the law of Hertz has no Young's modulus, or there is
        cohesion under the linear law.

    References
    ----------
    Cundall & Strack 1979 (doi:10.1680/geot.1979.29.1.47); Tsuji, Tanaka & Ishida 1992
    (doi:10.1016/0032-5910(92)88030-L).

    Examples
    --------
    >>> import voxgran as vg
    >>> steel = vg.Material(law="hertz", density=7800, young_modulus=2e11, poisson_ratio=0.3, restitution=0.9)
    >>> steel.law, steel.friction
    ('hertz', 0.5)
    """

    law: Literal["linear", "hertz"] = parameter("linear")
    density: float | None = parameter(None, unit="kg/m^3", at_least=LEAST, at_most=1e12)
    stiffness: float | None = parameter(None, unit="N/m", at_least=LEAST)
    shear_stiffness: float | None = parameter(None, unit="N/m", at_least=LEAST)
    young_modulus: float | None = parameter(None, unit="Pa", at_least=LEAST)
    poisson_ratio: float = parameter(0.25, at_least=0.0, at_most=0.5)
    restitution: float = parameter(0.3, above=0.0, at_most=1.0)
    friction: float = parameter(0.5, at_least=0.0)
    rolling_friction: float = parameter(0.0, at_least=0.0)
    cohesion: float = parameter(0.0, unit="J/m^2", at_least=0.0)
    bond_strength: float | None = parameter(None, unit="Pa", above=0.0)

    def __post_init__(self) -> None:
        """Check the ranges and what the law needs."""
        check_bounds(self, of="material")
        if self.law == "hertz" and self.young_modulus is None:
            raise InputError(
                "material young_modulus is missing: the law 'hertz' needs it, in Pa; give one, or law='linear'"
            )
        if self.law == "linear" and self.cohesion:
            raise InputError(
                f"material cohesion is {self.cohesion:g} J/m^2 under the law 'linear': surface energy is that of "
                "elastic spheres; give law='hertz' and young_modulus"
            )
