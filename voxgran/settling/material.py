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
    law : {"linear", "hertz"}
        Contact law: linear spring-dashpot, or Hertz with the tangential stiffness of Mindlin.
    density : float, optional
        Density of the solid, kg/m^3. Default: that of the packing, or of each of its shapes; where that is 1, which is
        the value of a packing without a stated density, 2650, that of quartz.
    stiffness : float, optional
        Normal stiffness of the linear law, N/m. Default: ``pi / 4`` times Young's modulus times the median diameter
        where the modulus is given, else such that the weight of the bed presses the most loaded of its lowest grains
        into the floor by a thousandth of its diameter.
    shear_stiffness : float, optional
        Tangential stiffness of the linear law, N/m. Default: 2/7 of the normal one.
    young_modulus : float, optional
        Young's modulus, Pa; the law of Hertz needs it.
    poisson_ratio : float
        Poisson's ratio, from 0 to 0.5.
    restitution : float
        Ratio of the normal velocities after and before a collision, above 0 and at most 1.
    friction : float
        Coulomb coefficient of friction between grains and at walls.
    rolling_friction : float
        Coefficient of rolling friction: the largest rolling moment over the normal force times the effective radius
        ``r1 r2 / (r1 + r2)``. It goes into input for engines that have it; grains that settle here roll freely.
    cohesion : float
        Surface energy of the contacts, J/m^2; two spheres of the effective radius R are pulled apart by the force
        ``4 pi cohesion R`` (Derjaguin, Muller & Toporov 1975, doi:10.1016/0021-9797(75)90018-1). It needs the law of
        Hertz and an engine that has it.
    bond_strength : float, optional
        Strength of the bonds between the spheres of a clump, Pa. Default: clumps are rigid.

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

    law: Literal["linear", "hertz"] = parameter(
        "linear", doc="contact law: linear spring-dashpot, or Hertz with Mindlin's tangential stiffness"
    )
    density: float | None = parameter(
        None, doc="density of the solid; if omitted, that of the packing, or 2650 where it has none", unit="kg/m^3",
        at_least=LEAST, at_most=1e12,
    )  # fmt: skip
    stiffness: float | None = parameter(
        None, doc="normal stiffness of the linear law; if omitted, by Young's modulus, or such that grains overlap by "
        "a thousandth of their diameter under the weight of the bed", unit="N/m", at_least=LEAST,
    )  # fmt: skip
    shear_stiffness: float | None = parameter(
        None,
        doc="tangential stiffness of the linear law; if omitted, 2/7 of the normal one",
        unit="N/m",
        at_least=LEAST,
    )
    young_modulus: float | None = parameter(
        None, doc="Young's modulus; the law of Hertz needs it", unit="Pa", at_least=LEAST
    )
    poisson_ratio: float = parameter(0.25, doc="Poisson's ratio", at_least=0.0, at_most=0.5)
    restitution: float = parameter(
        0.3, doc="ratio of the normal velocities after and before a collision", above=0.0, at_most=1.0
    )
    friction: float = parameter(0.5, doc="Coulomb coefficient of friction", at_least=0.0)
    rolling_friction: float = parameter(
        0.0, doc="coefficient of rolling friction: largest rolling moment over normal force times effective radius",
        at_least=0.0,
    )  # fmt: skip
    cohesion: float = parameter(0.0, doc="surface energy of the contacts, for the law of Hertz", unit="J/m^2",
                                at_least=0.0)  # fmt: skip
    bond_strength: float | None = parameter(
        None, doc="strength of the bonds between the spheres of a clump; if omitted, clumps are rigid", unit="Pa",
        above=0.0,
    )  # fmt: skip

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
