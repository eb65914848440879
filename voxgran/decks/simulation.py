"""A simulation as engines take it: bodies, walls, contact law, gravity and time, in SI units.

Every engine writes its files from this description alone.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from voxgran import __version__
from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Booleans, Floats, as_positive
from voxgran._base.errors import InputError
from voxgran._base.lazy import Dataset
from voxgran._base.units import NO_UNIT
from voxgran.clumps.bonds import LEAST_AREA, TOUCHING, Strengths, bonds_of_bodies
from voxgran.contacts.assembly import NOT_STATED, Density, by_shape, density_text
from voxgran.decks.bodies import Bodies, Kind, Template
from voxgran.decks.contact_law import (
    CHOSEN_OVERLAP,
    GRAVITY,
    QUARTZ,
    SHEAR_RATIO,
    STEPS_PER_COLLISION,
    ContactLaw,
    contact_law,
)
from voxgran.decks.law_table import LawTable, law_table
from voxgran.decks.walls import Platen, Walls
from voxgran.geometry.sphere_pairs import near_pairs
from voxgran.packing.model import Packing
from voxgran.settling.material import Material
from voxgran.settling.materials import Materials

#: time step where none is given, in stable ones: collisions then have the restitution asked for to 0.01
USUAL_STEP = 0.5
#: least and largest density of a solid, kg/m^3
SPARSEST, DENSEST = 10.0, 3e4
#: most time steps of a run
MOST_STEPS = 1e12
#: room between the walls and the bounds of the domain, in median diameters, so that no grain is lost
MARGIN = 2.0
#: largest share of the velocity of a grain that a drag takes in one time step
STABLE_DRAG = 0.2
#: relative difference of a stress up to which it is met
STRESS_MET = 0.02
#: mean kinetic energy of a grain, in m g d of the median grain, below which a bed rests
REST = 1e-6
#: mean kinetic energy of a grain, in s d^3, below which grains under a stress s rest
CALM = 1e-8
#: how long a script runs at the most, the time between its outputs, and that from the start, when all grains stand
#: still, until rest is looked for, in sqrt(d / g) with the median diameter d
LONGEST = 200.0
OUTPUT = 1.0
SETTLING = 5.0
#: what grains of each kind are called, one and several of them
NAMES: Mapping[Kind, tuple[str, str]] = {
    "sphere": ("sphere", "spheres"),
    "clump": ("clump", "clumps"),
    "polyhedron": ("polyhedron", "polyhedra"),
    "mesh": ("mesh", "meshes"),
    "level_set": ("level set", "level sets"),
    "convex_parts": ("grain of convex parts", "grains of convex parts"),
}


@dataclass(frozen=True, eq=False)
class Simulation:
    """What an engine computes.

    Attributes
    ----------
    bodies : Bodies
        The grains.
    walls : Walls
        Walls and lid, in metres.
    law : ContactLaw
        Numbers of the contact law; of several materials, those of the pair with the shortest stable time step.
    laws : LawTable
        Contact laws between all materials, and the materials of grains and walls.
    gravity : (3,) ndarray of float
        Acceleration, m/s^2; zero where there is none.
    time_step : float
        Time step, s.
    bonds : xarray.Dataset or None
        Bonds between spheres, as of :meth:`voxgran.clumps.Clump.bonds`, numbered over the spheres of all bodies, in
        metres and newtons; None where clumps are rigid.
    unit : str
        Unit of lengths of the packing, ``"1"`` where none is known and metres are assumed.
    rest : float
        Mean kinetic energy of a grain below which the bed rests, in m g d of the median grain; under a stress s in
        s d^3.
    longest : float
        Longest time of a run, in sqrt(d / g) with the median diameter d; under a stress in sqrt(m / (s d)).
    stress : (3,) ndarray of float or None
        Mean stress along each axis that the periodic cell, or walls, keep, Pa, compression above 0; NaN along axes of
        which the length stays; None where the container stays as it is.
    """

    bodies: Bodies
    walls: Walls
    laws: LawTable
    gravity: Floats
    time_step: float
    bonds: "Dataset | None" = None
    unit: str = NO_UNIT
    rest: float = REST
    longest: float = LONGEST
    stress: Floats | None = None

    @property
    def pressure(self) -> float:
        """Largest stress that the cell or walls keep, Pa; 0 where there is none."""
        return 0.0 if self.stress is None else float(np.nanmax(self.stress))

    @cached_property
    def law(self) -> ContactLaw:
        """Numbers of the contact law; of several materials, those of the pair with the shortest stable time step."""
        return self.laws.slowest

    @cached_property
    def diameter(self) -> float:
        """Median equivalent diameter, m."""
        return self.bodies.assembly.median_diameter

    @cached_property
    def time_unit(self) -> float:
        """Time in which gravity, or the stress, moves a grain by half a median diameter, s.

        Without either it is that of gravity on Earth.
        """
        if self.pressure:
            return math.sqrt(float(np.median(self.bodies.mass)) / (self.pressure * self.diameter))
        return math.sqrt(self.diameter / (float(linear.norm(self.gravity)) or GRAVITY))

    @cached_property
    def platens(self) -> tuple[Platen, ...]:
        """Walls that keep a stress: the upper one of each axis that has a stress and is not periodic."""
        if self.stress is None:
            return ()
        spans, law = np.ptp(self.walls.bounds, axis=0), self.law
        overlap = law.overlap_under(self.pressure * self.diameter**2, self.diameter)
        impedance = math.sqrt(law.density * law.stiffness_at(overlap, self.diameter) / self.diameter)
        return tuple(
            Platen(plane, float(stress * self.bodies.assembly.container.volume / spans[plane.axis]), stress / impedance)
            for plane in self.walls.planes
            if plane.inward < 0 and (stress := float(self.stress[plane.axis])) == stress
        )

    def strained(self, corners: "Floats | None") -> Floats:
        """Return where the mean strain alone of a cell that has corners (2, 3) now has moved the grains, (n, 3).

        Without corners they are where they were.
        """
        position = self.bodies.assembly.position
        if corners is None:
            return position
        low, high = self.walls.bounds
        strained: Floats = corners[0] + (position - low) * (np.ptp(corners, axis=0) / (high - low))
        return strained

    def domain(self, reach: float) -> Floats:
        """Return the bounds (2, 3) of the domain of an engine: the walls, with room for grains beyond them."""
        room = np.where(self.walls.periodic, 0.0, MARGIN * self.diameter + 2 * reach)
        return np.array([self.walls.bounds[0] - room, self.walls.bounds[1] + room])

    @property
    def fixed(self) -> list[tuple[int, int]]:
        """First and last number of each row of grains that are fixed, counted from 1."""
        return rows_of(~self.bodies.assembly.movable)

    @property
    def drag(self) -> float:
        """Drag on each sphere, kg/s, by which grains that bear nothing come to rest under a stress."""
        return self.drag_within(self.time_unit)

    def drag_within(self, time: float) -> float:
        """Return the drag on each sphere, kg/s, that stops the median grain within a time in s."""
        members = max(len(template.spheres[1]) for template in self.bodies.templates)
        most = STABLE_DRAG * float(self.bodies.mass.min()) / self.time_step
        return min(float(np.median(self.bodies.mass)) / time, most) / members

    def rolling(self, law: ContactLaw) -> tuple[float, float]:
        """Return stiffness, N/m, and damping, N s/m, of the spring of rolling friction, as of median grains."""
        mass = float(np.median(self.bodies.mass)) / 2
        spring = law.shear_stiffness or SHEAR_RATIO * law.stiffness_at(CHOSEN_OVERLAP * self.diameter, self.diameter)
        return spring, 2 * law.damping_ratio * math.sqrt(spring * mass)

    @cached_property
    def overlap(self) -> float:
        """Deepest overlap of spheres of different grains, or of a sphere and a wall, m; 0 where there is none."""
        (centers, radii, grain), walls = self.bodies.spheres, self.walls
        if not len(radii):
            return 0.0
        i, j, image = near_pairs(centers, radii, 0.0, lower=walls.bounds[0], periods=walls.periods)
        apart = linear.norm(centers[j] + linear.matmul(image, walls.periods) - centers[i], axis=1)
        depth = (radii[i] + radii[j] - apart)[grain[i] != grain[j]]
        beyond = (float((radii - distance).max()) for distance in walls.distances(centers))
        return max(0.0, float(depth.max(initial=0.0)), *beyond)

    @property
    def duration(self) -> float:
        """Longest time that a script runs, s."""
        return self.longest * self.time_unit

    @property
    def steps_per_output(self) -> int:
        """Time steps between two outputs, at which rest is checked too."""
        return max(1, round(OUTPUT * self.time_unit / self.time_step))

    @property
    def steps(self) -> int:
        """Most time steps of a run."""
        return math.ceil(self.duration / self.time_step)

    @property
    def rest_energy(self) -> float:
        """Kinetic energy of all grains, J, below which the bed rests."""
        if self.pressure:
            return self.rest * self.pressure * self.diameter**3 * self.bodies.count
        weight = float(np.median(self.bodies.mass)) * (float(linear.norm(self.gravity)) or GRAVITY)
        return self.rest * weight * self.diameter * int(self.bodies.assembly.movable.sum())

    def header(self, engine: str) -> list[str]:
        """Return the lines that begin each file: content, units, contact law, and what is approximated."""
        bodies, law = self.bodies, self.law
        by_kind = {kind: len(mine) for kind in sorted(bodies.kinds) if len(mine := bodies.of_kind(kind))}
        what = ", ".join(f"{count} {NAMES[kind][count != 1]}" for kind, count in by_kind.items())
        lengths = (
            "lengths without a unit, taken as metres" if self.unit == NO_UNIT else f"lengths converted from {self.unit}"
        )
        lines = [
            f"voxgran {__version__}: {bodies.count} grains for {engine} ({what})",
            f"SI units: m, kg, s, N, Pa, J; {lengths}; total mass {float(bodies.mass.sum())!r} kg",
            *_table_lines(self.laws, density_text(bodies.assembly.density)),
            f"time step {self.time_step:.6g} s; stable up to {law.stable_step:.6g} s = {law.formula}",
        ]
        if self.bonds is not None:
            lines.append(
                f"{self.bonds.sizes['bond']} bonds join the spheres of clumps: masses are the true ones, centroids and "
                "inertia tensors are those of the spheres"
            )
        fixed = bodies.count - int(bodies.assembly.movable.sum())
        lines += [f"{fixed} grains are fixed"] if fixed else []
        for plane, force, _ in self.platens:
            lines.append(
                f"wall {plane.name} moves so that grains press on it with {force!r} N: "
                f"{float(self.stress[plane.axis])!r} Pa on the area at the start"  # type: ignore[index]
            )
        if self.overlap > 0:
            lines.append(f"spheres overlap each other or walls by up to {self.overlap:.3g} m at the start")
        lines += [f"approximated: {one.approximated}" for one in bodies.templates if one.approximated]
        # names come from files of others: none may begin a line that an engine would run, nor three quotation marks,
        # up to the next of which LAMMPS takes all for one line
        return [" ".join(line.split()).replace('"', "'") for line in lines]

    def comments(self, engine: str, *notes: str, mark: str = "#") -> list[str]:
        """Return the lines that begin each file, and notes, as comments."""
        return [f"{mark} {line}" for line in (*self.header(engine), *notes)]


def rows_of(marks: Booleans) -> list[tuple[int, int]]:
    """Return first and last number, counted from 1, of each row of grains (n,) that are marked."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], marks, [False]])))
    return [(first + 1, last) for first, last in edges.reshape(-1, 2).tolist()]


def _table_lines(laws: LawTable, density: str) -> list[str]:
    """Return the contact laws of all pairs of materials in words."""
    if laws.count == 1:
        return _law_lines(laws.laws[0][0], density)
    named = ", ".join(f"{k + 1} {name}" for k, name in enumerate(laws.names))
    rows = [(f"materials {a + 1} and {b + 1}", law) for a, b, law in laws.pairs()]
    return [f"materials: {named}", *(f"{pair}: {line}" for pair, law in rows for line in _law_lines(law, density))]


def _law_lines(law: ContactLaw, density: str) -> list[str]:
    """Return the contact law in words, with the densities."""
    common = f"density {density} kg/m^3, restitution {law.restitution:g}, friction {law.friction:g}"
    common += f", rolling friction {law.rolling_friction:g}" if law.rolling_friction else ""
    if law.name == "linear":
        stiffness = f"normal stiffness {law.stiffness:.6g} N/m, shear stiffness {law.shear_stiffness:.6g} N/m"
        return [
            f"linear spring-dashpot: {stiffness}, {common}",
            f"damping 2 zeta sqrt(k m), with zeta = -ln e / sqrt(pi^2 + ln^2 e) = {law.damping_ratio:.6g}",
        ]
    cohesion = f", surface energy {law.cohesion:g} J/m^2" if law.cohesion else ""
    return [
        f"Hertz: Young's modulus {law.young_modulus:.6g} Pa, Poisson's ratio {law.poisson_ratio:g}, {common}{cohesion}"
    ]


def simulation_of(
    packing: Packing,
    templates: tuple[Template, ...],
    material: Material | Materials,
    *,
    acceleration: float = GRAVITY,
    time_step: float | None = None,
    rest: float | None = None,
    longest: float = LONGEST,
    stress: Floats | None = None,
) -> Simulation:
    """Return the simulation of a packing whose shapes are held by these templates, in its own unit of lengths.

    Raises
    ------
    InputError
        If a grain has no volume, the stiffness is too low, or the time step is above the stable one or too short.
    """
    metric = packing if packing.unit == NO_UNIT else packing.to_unit("m")
    scaled = tuple(replace(one, shape=shape) for one, shape in zip(templates, metric.shapes, strict=True))
    bodies = Bodies(scaled, replace(metric, density=_density(material, packing)))
    strength = material.bond_strength if isinstance(material, Material) else None
    bonds = None if strength is None else _bonds(bodies, strength)
    gravity = np.zeros(3)
    if metric.gravity is not None:
        gravity = acceleration * np.array(metric.gravity, dtype=float) / linear.norm(metric.gravity)
    diameter = float(np.median(metric.diameters))
    numbers: dict[str, Any] = {
        "density": bodies.assembly.mean_density,
        "mass": bodies.mass if bonds is None else _bonded_masses(bodies, bonds),
        "quickest": bodies.quickest,
        "diameter": diameter,
        "load": _load(bodies, gravity, acceleration, 0.0 if stress is None else float(np.nanmax(stress))),
    }
    walls = Walls.of(metric)
    laws = law_table(material, lambda one: contact_law(one, **numbers), len(templates), walls.names)
    law = laws.slowest
    if bonds is not None:
        law = _slowed(law, bodies, bonds)
        laws = replace(laws, laws=((law,),))
    step = USUAL_STEP * law.stable_step if time_step is None else as_positive(time_step, "time_step")
    if step > law.stable_step:
        raise InputError(
            f"time_step is {step:g} s: it must be at most {law.stable_step:.4g} s, which is {law.formula}; leave it out"
        )
    rest = (REST if stress is None else CALM) if rest is None else rest
    made = Simulation(bodies, walls, laws, gravity, step, bonds, packing.unit, rest, longest, stress)
    if not made.duration <= MOST_STEPS * step:
        given = f"time_step is {step:g} s" if time_step is not None else f"the stable time step is {step:g} s"
        longer = "a longer one, or " if time_step is not None else ""
        raise InputError(
            f"{given}: a run of {made.duration:.4g} s would take more than {MOST_STEPS:g} steps; give {longer}a "
            "material that is less stiff or denser"
        )
    return made


def _bonded_masses(bodies: Bodies, bonds: "Dataset") -> Floats:
    """Return the masses of spheres that a contact law has to move: less than they are where several bonds pull one."""
    _, radii, grain = bodies.spheres
    share = libm.power(radii, 3) / np.bincount(grain, libm.power(radii, 3))[grain]
    several = np.bincount(np.concatenate([bonds["first"].values, bonds["second"].values]), minlength=len(radii))
    # two for the stretch of each bond, and one for its shear and the rotation that this causes
    return np.asarray(bodies.mass[grain] * share / (1.5 * np.maximum(several, 2 / 3)))


def _bonds(bodies: Bodies, strength: float) -> "Dataset":
    """Return the bonds between the spheres of clumps."""
    grains = bodies.assembly
    return bonds_of_bodies(
        [template.spheres for template in bodies.templates],
        grains.shape_id,
        scale=grains.scale,
        matrices=grains.matrices,
        position=grains.position,
        strengths=Strengths.of(strength, None, TOUCHING, LEAST_AREA),
        unit="m",
    )


def _load(bodies: Bodies, gravity: Floats, acceleration: float, pressure: float) -> tuple[float, float]:
    """Return what the most loaded grain bears, N, and its diameter, m: the larger of its own weight, and its share of
    a pressure, or of the weight of all grains on the floor.
    """
    diameters, weights = bodies.assembly.diameters, bodies.mass * acceleration
    if gravity.any():
        span = np.delete(np.diff(bodies.assembly.container.bounds, axis=0)[0], np.abs(gravity).argmax())
        pressure = float(weights.sum() / np.prod(span[span > 0]))
    loads = np.maximum(weights, pressure * libm.power(diameters, bodies.assembly.dimension - 1))
    worst = int((loads / diameters).argmax())
    return float(loads[worst]), float(diameters[worst])


def _density(material: Material | Materials, packing: Packing) -> Density:
    """Return the density of the solid, or of that of each shape, kg/m^3.

    Raises
    ------
    InputError
        If that of the packing cannot be in this unit, or the material has one although shapes differ.
    """
    several = isinstance(packing.density, tuple)
    if isinstance(material, Materials):
        own = [material.materials[name].density for name in material.of_shapes(len(packing.shapes))]
        if not several and any(one is not None for one in own):
            usual = _density(Material(), packing)
            return tuple(float(usual) if one is None else one for one in own)  # type: ignore[arg-type]
        return _density(Material(), packing)
    if material.density is not None:
        if several:
            raise InputError(
                f"material density is {material.density:g}: the shapes of the packing have "
                f"{density_text(packing.density)}; leave it out, or give the packing one with dataclasses.replace"
            )
        return material.density
    if packing.density == NOT_STATED:
        return QUARTZ
    for density in by_shape(packing.density, 1):
        if not SPARSEST <= density <= DENSEST:
            remedy = "each shape with dataclasses.replace" if several else "the material"
            raise InputError(
                f"density of the packing is {density:g}: as kg/m^3 that is no solid; give the density in kg/m^3 in "
                f"{remedy}"
            )
    return packing.density


def _slowed(law: ContactLaw, bodies: Bodies, bonds: "Dataset") -> ContactLaw:
    """Return the contact law of bonded clumps, with a time step that also suits the bonds."""
    formula = law.formula.replace("half the least mass m of a grain", "a third of the mass of a sphere over its bonds")
    step = law.stable_step
    if law.name == "hertz" and bonds.sizes["bond"]:
        centers = bodies.spheres[0]
        length = linear.norm(centers[bonds["second"].values] - centers[bonds["first"].values], axis=1)
        area = bonds["area"].values
        stiffness = float((law.young_modulus * area / np.maximum(length, np.sqrt(area / math.pi))).max())
        lightest = float(_bonded_masses(bodies, bonds).min())
        step = min(step, math.pi * math.sqrt(lightest / 2 / stiffness) / STEPS_PER_COLLISION)
        formula += f", or pi sqrt(m / k) / {STEPS_PER_COLLISION} of a bond where that is less"
    return replace(law, stable_step=step, formula=formula)
