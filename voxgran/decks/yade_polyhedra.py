"""Polyhedra of YADE: their corners, contacts, and what these leave out.

References
----------
YADE 2023.02a, source (gitlab.com/yade-dev/trunk): `Polyhedra.cpp`, `Polyhedra_Ig2.cpp`, `Polyhedra_support.cpp`,
`NewtonIntegrator.cpp`. Elias 2014, "Simulation of railway ballast using crushable polyhedral particles", Powder
Technology.
"""

import math
from typing import NamedTuple

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran._base.errors import InputError
from voxgran._base.lazy import load
from voxgran.decks.bodies import Template
from voxgran.decks.simulation import Simulation

#: most corners of a polyhedron: YADE tries all pairs of edges of two of them
MOST_CORNERS = 200
#: overlap of two spheres of the median diameter, in this diameter, at which a volume has the stiffness asked for
OVERLAP = 0.01


class Contacts(NamedTuple):
    """Lines that make materials, and the parts of an engine for geometry, physics and forces of contacts."""

    materials: list[str]
    geometry: list[str]
    physics: list[str]
    laws: list[str]


def refuse_polyhedra(simulation: Simulation) -> None:
    """Refuse what polyhedra of YADE do not have.

    Parameters
    ----------
    simulation : Simulation
        Simulation with polyhedra.

    Raises
    ------
    InputError
        If there are contacts, walls or forces that they do not have, or too many corners.
    """
    walls, law = simulation.walls, simulation.law
    remedy = "give grains='clump'"
    if simulation.bodies.of_kind("level_set").size:
        raise InputError(f"grains are polyhedra and level sets: these do not meet in YADE; {remedy}")
    if any(walls.periodic):
        raise InputError(f"container is periodic and grains are polyhedra: YADE has walls for them; {remedy}")
    if walls.round is not None or walls.mesh is not None:
        raise InputError(f"container is not flat and grains are polyhedra: YADE has planes for them; {remedy}")
    if simulation.laws.count > 1:
        raise InputError(f"material has {simulation.laws.count} materials and grains are polyhedra: give one Material")
    if law.cohesion:
        raise InputError(
            f"material cohesion is {law.cohesion:g} and grains are polyhedra: they have none in YADE; {remedy}"
        )
    if law.name == "hertz":
        raise InputError(
            "material law is 'hertz' and grains are polyhedra: YADE has a force by the volume of the overlap for them; "
            + remedy
        )
    for number in simulation.bodies.of_kind("polyhedron"):
        template = simulation.bodies.templates[simulation.bodies.assembly.shape_id[number]]
        count = len(_corners_of(template))
        if count > MOST_CORNERS:
            raise InputError(
                f"shape {template.shape.name!r} has {count} corners: a polyhedron of YADE has at most {MOST_CORNERS} "
                f"here; {remedy}"
            )


def corners(template: Template) -> list[str]:
    """Return the corners of a convex solid as lines, in its principal frame, which YADE then leaves as it is.

    Parameters
    ----------
    template : Template
        A polyhedron.
    """
    rows = linear.matmul(_corners_of(template), template.principal.axes)
    lines = [" ".join(repr(float(value)) for value in row) for row in rows]
    return [
        f"# {template.name}: corners x y z at the size of the shape, in its principal frame about the centroid",
        *lines,
    ]


def _corners_of(template: Template) -> Floats:
    """Return the corners (n, 3) of the convex hull of a solid; points in its faces are left out."""
    points = template.polyhedron.vertices
    return np.asarray(points[np.sort(load("scipy.spatial").ConvexHull(points).vertices)])


def _per_volume(simulation: Simulation) -> float:
    """Return the stiffness per volume of overlap, N/m^3.

    The overlap of two spheres of a diameter d by a depth h is a lens of the volume pi d h^2 / 4.
    """
    diameter = simulation.diameter
    return simulation.law.stiffness / (math.pi / 4 * diameter * OVERLAP * diameter)


def _local_damping(simulation: Simulation) -> float:
    """Return the local damping.

    It makes forces larger by this share where they slow a grain, and smaller where they speed it up; the energies of
    approach and rebound then have the ratio (1 - damping) / (1 + damping), which is the square of the restitution.
    """
    square = simulation.law.restitution**2
    return (1 - square) / (1 + square)


def notes_of_polyhedra(simulation: Simulation) -> list[str]:
    """Return what the contacts of polyhedra leave out, as sentences.

    Parameters
    ----------
    simulation : Simulation
        Simulation with polyhedra.
    """
    stiffness, local = _per_volume(simulation), _local_damping(simulation)
    return [
        (
            f"approximated: polyhedra repel each other and walls by {stiffness:.6g} N/m^3 times the volume of the "
            f"overlap: the stiffness asked for where two spheres of the median diameter overlap by {OVERLAP:g} of it; "
            "faces that meet are stiffer, corners and edges softer"
        ),
        (
            f"approximated: no viscous damping beside polyhedra; local damping {local:.6g} = (1 - e^2) / (1 + e^2) "
            "makes forces of contacts larger by this share where they slow a grain along x, y or z, else smaller: it "
            "gives the restitution of a central collision along an axis, and changes friction in sliding by this share "
            "too"
        ),
        (
            "approximated: YADE 2023.02a keeps one tangential force for all contacts of polyhedra together, so that "
            "friction is wrong where several act at a time"
        ),
        (
            "approximated: YADE 2023.02a has tolerances in metres for polyhedra: edges that cross are not found where "
            "they overlap by less than 5.5e-6 m, runs may abort with a memory error, above all with grains of a "
            "millimetre, and beds may not come to rest; grains='clump' has none of this"
        ),
    ]


def damping(simulation: Simulation) -> str:
    """Return the arguments of the integrator that damp contacts, but not gravity.

    Parameters
    ----------
    simulation : Simulation
        Simulation with polyhedra.
    """
    return f"damping={_local_damping(simulation)!r}, dampGravity=False"


def contacts_of_polyhedra(simulation: Simulation) -> Contacts:
    """Return materials and contacts of polyhedra, and of spheres beside them.

    Parameters
    ----------
    simulation : Simulation
        Simulation with polyhedra.
    """
    law, volumetric = simulation.law, _per_volume(simulation)
    angle = math.atan(law.friction)
    # two materials in series have half of the stiffness of each
    solid = f"PolyhedraMat(young={2 * volumetric!r}, poisson={law.shear_stiffness / volumetric!r}, "
    made = {"polyhedra": (solid, law.density), "walls0": (solid, law.density)}
    bodies, geometry = (
        simulation.bodies,
        ["Ig2_Polyhedra_Polyhedra_PolyhedraGeom()", "Ig2_Wall_Polyhedra_PolyhedraGeom()"],
    )
    physics, laws = ["Ip2_PolyhedraMat_PolyhedraMat_PolyhedraPhys()"], ["Law2_PolyhedraGeom_PolyhedraPhys_Volumetric()"]
    if len(bodies.of_kind("sphere", "clump")):
        # another member has the mass of a clump
        made |= {"grains0": ("FrictMat(", law.density), "members0": ("FrictMat(", 0.0)}
        geometry += ["Ig2_Sphere_Sphere_ScGeom()", "Ig2_Wall_Sphere_ScGeom()", "Ig2_Sphere_Polyhedra_ScGeom()"]
        normal, shear = (f"MatchMaker(algo='val', val={value!r})" for value in (law.stiffness, law.shear_stiffness))
        # also for a sphere and a polyhedron, as their material is one with friction
        physics.append(f"Ip2_FrictMat_FrictMat_FrictPhys(kn={normal}, ks={shear})")
        laws.append("Law2_ScGeom_FrictPhys_CundallStrack(sphericalBodies=False)")
    # it warns at each step
    materials = ["from yade import export, log, polyhedra_utils", "", "log.setDefaultLogLevel(log.ERROR)"]
    for name, (start, density) in made.items():
        rest = f'frictionAngle={angle!r}, density={density!r}, label="{name}"'
        materials.append(f"O.materials.append({start}{rest}))")
    return Contacts(materials, geometry, physics, laws)
