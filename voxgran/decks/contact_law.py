"""The contact law of an engine that follows from a material."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.errors import InputError, PackingWarning, warn
from voxgran.settling.material import Material

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
    rolling_friction: float
    cohesion: float  # J/m^2
    damping_ratio: float  # zeta: damping over that which ends all rebound
    stable_step: float  # s
    formula: str  # of the stable step, in words

    def damping(self, mass: float) -> float:
        """Return the damping of the linear law, N s/m, for two grains of an effective mass in kg."""
        return 2 * self.damping_ratio * math.sqrt(self.stiffness * mass)

    @property
    def effective_modulus(self) -> float:
        """Effective modulus of the law of Hertz between two equal materials, Pa."""
        return self.young_modulus / (2 * (1 - self.poisson_ratio**2))

    def overlap_under(self, load: float, diameter: float) -> float:
        """Return the overlap, m, of two equal spheres of a diameter in m under a load in N."""
        if self.name == "linear":
            return load / self.stiffness
        return float((0.75 * load / (self.effective_modulus * math.sqrt(diameter / 4))) ** (2 / 3))

    def stiffness_at(self, overlap: float, diameter: float) -> float:
        """Return the normal stiffness, N/m, of two equal spheres of a diameter that overlap, both in m."""
        return self.stiffness or 2 * self.effective_modulus * math.sqrt(diameter / 4 * overlap)


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
        # two of the lightest grains collide for the shortest time
        step = math.pi * math.sqrt(lightest / 2 / stiffness) / STEPS_PER_COLLISION
        formula = f"pi sqrt(m / k) / {STEPS_PER_COLLISION}, with half the least mass m of a grain and the stiffness k"
    else:
        young = material.young_modulus or 0.0
        shear_modulus = young / (2 * (1 + material.poisson_ratio))
        radius, own = quickest
        rayleigh = math.pi * radius * math.sqrt(own / shear_modulus) / (0.1631 * material.poisson_ratio + 0.8766)
        step = RAYLEIGH_SHARE * rayleigh
        formula = f"{RAYLEIGH_SHARE} pi r sqrt(density / G) / (0.1631 nu + 0.8766), with the least radius r of a sphere"
        formula += "" if own == density else f" times root of its density {own:g}"
    law = ContactLaw(
        name=material.law,
        density=density,
        stiffness=stiffness,
        shear_stiffness=shear,
        young_modulus=young,
        poisson_ratio=material.poisson_ratio,
        restitution=material.restitution,
        friction=material.friction,
        rolling_friction=material.rolling_friction,
        cohesion=material.cohesion,
        damping_ratio=damping_ratio(material.restitution),
        stable_step=step,
        formula=formula,
    )
    _refuse_soft(material, law.overlap_under(*load) / load[1], *load)
    return law


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
