"""Materials of Kratos: those of spheres, clusters and walls, and the contact laws between them."""

import itertools
import math
from collections.abc import Mapping
from typing import Any

from voxgran.decks.contact_law import ContactLaw
from voxgran.decks.kratos_model import clumps_of, spheres_of, walls_of
from voxgran.decks.simulation import Simulation


def cluster_file(template: str) -> str:
    """Return the name of the file of a template that is a clump."""
    return f"kratos_{template}.clu"


def law_name(law: ContactLaw) -> str:
    """Return the name of the contact law in Kratos."""
    if law.name == "linear":
        return "DEM_D_Linear_Custom_Constants"
    return "DEM_D_Hertz_viscous_Coulomb" + ("_DMT" if law.cohesion else "")


def materials_of(simulation: Simulation) -> dict[str, Any]:
    """Return the materials: of spheres, of walls, and of each template that is a clump, whose file it names."""
    bodies, laws = simulation.bodies, simulation.laws
    elastic = [
        {"YOUNG_MODULUS": _young_modulus(simulation, laws.laws[k][k]), "POISSON_RATIO": laws.laws[k][k].poisson_ratio}
        for k in range(laws.count)
    ]
    spheres, clumps = spheres_of(simulation), {material: k for k, material in clumps_of(bodies).items()}
    walls = walls_of(simulation)
    several, materials, table = len(spheres) > 1, list[dict[str, Any]](), list[list[str]]()
    names, kinds = dict[int, str](), dict[int, int]()
    for material, name, kind, density, _ in spheres:
        names[material], kinds[material] = name, kind
        materials.append(_material(name, material, {"PARTICLE_DENSITY": density, **elastic[kind]}))
        table.append([f"SpheresPart.{name.title()}" if several else "SpheresPart", name])
    for material, name, kind, parts in walls:
        names[material], kinds[material] = name, kind
        materials.append(_material(name, material, {**elastic[kind], "COMPUTE_WEAR": False}))
        own = [f"RigidFacePart.{part}" for part in parts] if walls[1:] else ["RigidFacePart"]
        table += [[part, name] for part in own]
    for material, k in clumps.items():
        name, kind = bodies.templates[k].name, laws.of_shapes[k]
        names[material], kinds[material] = name, kind
        files = {"CLUSTER_FILE_NAME": cluster_file(name), "BREAKABLE_CLUSTER": False}
        solid_of = {"PARTICLE_DENSITY": bodies.densities[k], **elastic[kind]}
        materials.append(_material(name, material, solid_of | files))
        table.append([f"ClusterPart.{name}", name])
    solid = [material for material, *_ in walls]
    relations = [
        {
            "material_names_list": [names[a], names[b]],
            "material_ids_list": [a, b],
            "Variables": _contact(laws.laws[kinds[a]][kinds[b]], wall=b in solid),
        }
        for a, b in itertools.combinations_with_replacement((*(one[0] for one in spheres), *clumps, *solid), 2)
        if a not in solid
    ]
    return {"materials": materials, "material_relations": relations, "material_assignation_table": table}


def _material(name: str, number: int, variables: Mapping[str, Any]) -> dict[str, Any]:
    """Return one material."""
    return {"material_name": name, "material_id": number, "Variables": dict(variables)}


def _young_modulus(simulation: Simulation, law: ContactLaw) -> float:
    """Return Young's modulus of a material by its law.

    That of the linear law has no effect. It is the one by which DEM_D_Linear_viscous_Coulomb, put in place of the law,
    has the normal stiffness between two spheres of the median diameter: 1.432 pi 0.31225 E / (2 (1 - nu^2)) d / 4.
    """
    if law.name == "hertz":
        return law.young_modulus
    return law.stiffness * 8 * (1 - law.poisson_ratio**2) / (1.432 * math.pi * 0.31225 * simulation.diameter)


def _contact(law: ContactLaw, *, wall: bool) -> dict[str, Any]:
    """Return the parameters of contacts between two materials, or of one with a wall, by their law.

    The moment of rolling friction is at most the coefficient times the normal force and the radius, the smaller one of
    two spheres, of which the effective radius of equal ones is half.
    """
    rolling = law.rolling_friction if wall else law.rolling_friction / 2
    variables: dict[str, Any] = {
        "COEFFICIENT_OF_RESTITUTION": law.restitution,
        "STATIC_FRICTION": law.friction,
        "DYNAMIC_FRICTION": law.friction,
        "FRICTION_DECAY": 500.0,
        "ROLLING_FRICTION": rolling,
        "ROLLING_FRICTION_WITH_WALLS": rolling,
        "DEM_ROLLING_FRICTION_MODEL_NAME": "DEMRollingFrictionModelBounded",
        "DEM_DISCONTINUUM_CONSTITUTIVE_LAW_NAME": law_name(law),
    }
    if law.name == "linear":
        variables |= {"K_NORMAL": law.stiffness, "K_TANGENTIAL": law.shear_stiffness}
    if law.cohesion:
        # Kratos pulls with 2 pi R times this
        variables["PARTICLE_COHESION"] = 2 * law.cohesion
    return variables
