"""Material of the grains in an engine, and the contact law that follows from it."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from voxgran._base import ExplainedAttributes
from voxgran._base.arrays import Floats
from voxgran._base.config import check_bounds, parameter, parameter_class
from voxgran._base.errors import InputError, PackingWarning
from voxgran._base.warning import warn

#: acceleration of gravity at the surface of the Earth, m/s^2
GRAVITY = 9.81
#: density where neither material nor packing states one, kg/m^3: that of quartz
QUARTZ = 2650.0
#: time steps in the duration of the shortest collision under the linear law
STEPS_PER_COLLISION = 50
#: share of the Rayleigh time that is a time step under the law of Hertz
RAYLEIGH_SHARE = 0.2
#: overlap under the weight of the bed for which a stiffness is chosen, in diameters of the most loaded grain; that
#: from which grains are warned of; and refused
CHOSEN_OVERLAP, LARGE_OVERLAP, LARGEST_OVERLAP = 1e-3, 1e-2, 1e-1
#: shear over normal stiffness where none is given
SHEAR_RATIO = 2 / 7
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


@dataclass(frozen=True, kw_only=True, slots=True)
class ContactLaw:
    """Numbers of the contact law of a simulation, in SI units; those of the other law are 0."""

    name: Literal["linear", "hertz"]
    density: float  # kg/m^3; where shapes differ, their mean by volume
    stiffness: float  # N/m
    shear_stiffness: float  # N/m
    young_modulus: float  # Pa
    poisson_ratio: float
    restitution: float
    friction: float
    cohesion: float  # J/m^2
    damping_ratio: float  # zeta: damping over that which ends all rebound
    stable_step: float  # s
    formula: str  # of the stable step, in words

    def damping(self, mass: float) -> float:
        """Return the damping of the linear law, N s/m, for two grains of an effective mass in kg."""
        return 2 * self.damping_ratio * math.sqrt(self.stiffness * mass)


def damping_ratio(restitution: float) -> float:
    """Return the damping, as share of that which ends all rebound, with which a linear spring-dashpot has a
    restitution.
    """
    logarithm = math.log(restitution)
    # without damping 0.0, not -0.0
    return -logarithm / math.hypot(math.pi, logarithm) + 0.0


def contact_law(
    material: Material,
    *,
    density: float,
    mass: Floats,
    quickest: tuple[float, float],
    diameter: float,
    load: tuple[float, float],
) -> ContactLaw:
    """Return the contact law of grains with masses (n,) in kg and the mean `density`, the sphere that waves cross in
    the least time, by its radius in m and its density, and the median `diameter` in m; `load` is what the most loaded
    grain bears, in N, and its diameter in m.

    Raises
    ------
    InputError
        If the stiffness is so low that the load presses grains into each other by more than a tenth of the diameter.

    Warns
    -----
    PackingWarning
        If that is more than a hundredth.
    """
    lightest = float(mass.min())
    stiffness = shear = young = 0.0
    if material.law == "linear":
        stiffness = _stiffness(material, diameter, *load)
        shear = SHEAR_RATIO * stiffness if material.shear_stiffness is None else material.shear_stiffness
        overlap = load[0] / stiffness / load[1]
        # two of the lightest grains collide for the shortest time
        step = math.pi * math.sqrt(lightest / 2 / stiffness) / STEPS_PER_COLLISION
        formula = f"pi sqrt(m / k) / {STEPS_PER_COLLISION}, with half the least mass m of a grain and the stiffness k"
    else:
        young = material.young_modulus or 0.0
        effective = young / (2 * (1 - material.poisson_ratio**2))
        overlap = (0.75 * load[0] / (effective * math.sqrt(load[1] / 4))) ** (2 / 3) / load[1]
        shear_modulus = young / (2 * (1 + material.poisson_ratio))
        radius, own = quickest
        rayleigh = math.pi * radius * math.sqrt(own / shear_modulus) / (0.1631 * material.poisson_ratio + 0.8766)
        step = RAYLEIGH_SHARE * rayleigh
        formula = f"{RAYLEIGH_SHARE} pi r sqrt(density / G) / (0.1631 nu + 0.8766), with the least radius r of a sphere"
        formula += "" if own == density else f" times root of its density {own:g}"
    _refuse_soft(material, overlap, *load)
    return ContactLaw(
        name=material.law,
        density=density,
        stiffness=stiffness,
        shear_stiffness=shear,
        young_modulus=young,
        poisson_ratio=material.poisson_ratio,
        restitution=material.restitution,
        friction=material.friction,
        cohesion=material.cohesion,
        damping_ratio=damping_ratio(material.restitution),
        stable_step=step,
        formula=formula,
    )


def _stiffness(material: Material, diameter: float, load: float, loaded: float) -> float:
    """Return the normal stiffness of the linear law."""
    if material.stiffness is not None:
        return material.stiffness
    if material.young_modulus is not None:
        # that of a bar between the centers of two grains, as thick as they are
        return math.pi / 4 * material.young_modulus * diameter
    return load / (CHOSEN_OVERLAP * loaded)


def _refuse_soft(material: Material, overlap: float, load: float, diameter: float) -> None:
    """Refuse grains that are too soft for the weight of the bed, and warn of soft ones."""
    if overlap <= LARGE_OVERLAP:
        return
    name, factor = ("stiffness", 1.0) if material.law == "linear" else ("young_modulus", 1.5)
    if name == "stiffness" and material.stiffness is None:
        name = "young_modulus"
    given = getattr(material, name)
    enough = float(np.format_float_positional(given * (overlap / CHOSEN_OVERLAP) ** factor, 2, fractional=False))
    text = (
        f"material {name} is {given:g}: the weight of the bed, {load:.3g} N on a grain at its bottom, presses grains "
        f"into each other by {overlap:.2g} of the diameter {diameter:.3g} m; give about {enough:g}"
    )
    if overlap > LARGEST_OVERLAP:
        raise InputError(text)
    warn(text, PackingWarning)
