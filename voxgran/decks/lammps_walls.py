"""Contact laws and walls in the commands of LAMMPS."""

import math
from collections.abc import Iterator

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.errors import InputError
from voxgran.decks.contact_law import CHOSEN_OVERLAP, ContactLaw
from voxgran.decks.engine import row_of
from voxgran.decks.simulation import Simulation
from voxgran.decks.walls import MOST_PLANES, Platen, planes_of
from voxgran.geometry.walls import Round


def law_text(simulation: Simulation, law: ContactLaw) -> str:
    """Return a contact law as arguments of the granular pair style and walls."""
    young, ratio = law.young_modulus, law.poisson_ratio
    rolling = ""
    if law.rolling_friction:
        spring, dashpot = simulation.rolling(law)
        rolling = f" rolling sds {spring!r} {dashpot!r} {law.rolling_friction!r}"
    if law.name == "linear":
        return (
            f"hooke {law.stiffness!r} {law.restitution!r} tangential linear_history {law.shear_stiffness!r} 1.0 "
            f"{law.friction!r}{rolling} damping coeff_restitution"
        )
    shear = f"tangential mindlin NULL 1.0 {law.friction!r}{rolling} damping"
    if law.cohesion:
        # with surface energy LAMMPS takes no restitution: damping that has it for two median grains, slightly pressed
        mass, diameter = float(np.median(simulation.bodies.mass)) / 2, simulation.diameter
        stiffness = law.stiffness_at(CHOSEN_OVERLAP * diameter, diameter)
        rate = 2 * law.damping_ratio * math.sqrt(stiffness / mass)
        return f"dmt {young!r} {rate!r} {ratio!r} {law.cohesion!r} {shear} mass_velocity"
    return f"hertz/material {young!r} {law.restitution!r} {ratio!r} {shear} coeff_restitution"


def _of_walls(simulation: Simulation, wall: str, name: str) -> Iterator[tuple[str, str, str]]:
    """Yield name, group and contact law of the commands of a wall, one for each material of grains."""
    laws, other = simulation.laws, simulation.laws.of_walls[wall]
    if laws.count == 1:
        yield name, "all", law_text(simulation, laws.laws[0][other])
        return
    for k in sorted(set(laws.of_shapes)):
        yield f"{name}_{k + 1}", f"material_{k + 1}", law_text(simulation, laws.laws[k][other])


def wall_commands(simulation: Simulation) -> list[str]:
    """Return the commands of all walls.

    Raises
    ------
    InputError
        If the container is a mesh that is not convex, or has too many planes.
    """
    walls, moving = simulation.walls, {platen.plane.name: platen for platen in simulation.platens}
    lines = []
    for plane in walls.planes:
        if plane.name in moving:
            lines += _platen(simulation, moving[plane.name])
            continue
        low, high = (plane.level, "NULL") if plane.inward > 0 else ("NULL", plane.level)
        at = f"{'xyz'[plane.axis]}plane {low} {high}"
        found = _of_walls(simulation, plane.name, plane.name)
        lines += [f"fix {name} {of} wall/gran granular {law} {at}" for name, of, law in found]
    if walls.round is not None:
        x, y, z = walls.round.center
        radius = repr(walls.round.radius)
        if walls.round.kind == "sphere":
            lines.append(f"region round sphere {x!r} {y!r} {z!r} {radius} side in")
        else:
            bottom, top = (repr(float(level)) for level in walls.bounds[:, 2])
            lines.append(f"region round cylinder z {x!r} {y!r} {radius} {bottom} {top} side in open 1 open 2")
        lines += _region_walls(simulation, "round")
    regions = {name: _region(name, wall, walls.bounds) for name, wall in walls.others.items()}
    if regions and all(regions.values()):
        lines += [f"region {text}" for text in regions.values()]
        return lines + [line for name in regions for line in _region_walls(simulation, name)]
    if walls.mesh is not None:
        if not walls.convex:
            raise InputError(
                "container is a closed mesh that is not convex: LAMMPS has walls of convex ones; use engine 'liggghts'"
            )
        for name, surface in walls.surfaces.items():
            lines += [*_planes(name, *surface), *_region_walls(simulation, name)]
    return lines


def _region_walls(simulation: Simulation, wall: str, known: str = "") -> list[str]:
    """Return the commands of the wall around a region, which has the name of the wall; known: what else it computes."""
    found = _of_walls(simulation, wall, wall)
    return [f"fix {name} {of} wall/gran/region granular {law} region {wall}{known}" for name, of, law in found]


def _platen(simulation: Simulation, platen: Platen) -> list[str]:
    """Return the commands of an upper plane that moves by the force of the grains beyond that which it keeps.

    A variable of LAMMPS, `at_` and the name of the wall, holds how far it has moved.
    """
    (name, axis), force = (platen.plane.name, platen.plane.axis), platen.force
    point, normal, moves = np.zeros(3), np.zeros(3), ["NULL"] * 3
    point[axis], normal[axis], moves[axis] = platen.plane.level, -1.0, f"v_at_{name}"
    walls = [one for one, _, _ in _of_walls(simulation, name, name)]
    # columns of the forces of contacts follow one that tells whether there is one
    sums = " ".join(f"f_{one}[{axis + 2}]" for one in walls)
    known = [f"c_sum_{name}[{k}]" for k in range(1, len(walls) + 1)] if len(walls) > 1 else [f"c_sum_{name}"]
    return [
        f"variable at_{name} internal 0.0",
        f"region {name} plane {row_of(point)} {row_of(normal)} side in move {' '.join(moves)}",
        *_region_walls(simulation, name, " contacts"),
        f"compute sum_{name} all reduce sum {sums}",
        f'variable push_{name} equal "-({"+".join(known)})"',
        # its velocity is in proportion to what is missing
        f"fix servo_{name} all controller 1 {-platen.speed / force!r} 1.0 0.0 0.0 v_push_{name} {force!r} at_{name}",
    ]


def _region(name: str, wall: Round, bounds: Floats) -> str:
    """Return the region within a wall in closed form; empty where its axis is not that of a coordinate."""
    center, across = np.array(wall.center), np.flatnonzero(wall.axis)
    if wall.kind == "plane":
        return f"{name} plane {row_of(center)} {row_of(-np.array(wall.axis))} side in"
    if wall.kind == "sphere":
        return f"{name} sphere {row_of(center)} {wall.radius!r} side in"
    if len(across) > 1:
        return ""
    axis = int(across[0])
    around, sine = center[np.delete(np.arange(3), axis)], wall.sine * wall.axis[axis]
    low, high = bounds[:, axis]
    if sine:
        # not beyond the apex
        apex = center[axis] + wall.radius / sine
        low, high = (low, min(high, apex)) if sine > 0 else (max(low, apex), high)
    radii = [max(float((wall.radius - sine * (end - center[axis])) / wall.cosine), 0.0) for end in (low, high)]
    kind, sizes = ("cone", radii) if sine else ("cylinder", [wall.radius])
    return f"{name} {kind} {'xyz'[axis]} {row_of(around)} {row_of([*sizes, low, high])} side in open 1 open 2"


def _planes(name: str, vertices: Floats, faces: Integers) -> list[str]:
    """Return the region within a wall of a convex mesh: one plane for each of its flat faces.

    Raises
    ------
    InputError
        If there are too many planes.
    """
    planes = planes_of(vertices, faces)
    if len(planes) > MOST_PLANES:
        raise InputError(
            f"container is a closed mesh of {len(planes)} planes: LAMMPS takes {MOST_PLANES} here; use engine "
            "'liggghts'"
        )
    lines = []
    for number, place in enumerate(planes.tolist()):
        point, inward = (" ".join(map(repr, vector)) for vector in place)
        region = f"{name}_{number}" if len(planes) > 1 else name
        lines.append(f"region {region} plane {point} {inward} side in")
    names = " ".join(f"{name}_{number}" for number in range(len(planes)))
    return [*lines, *([f"region {name} intersect {len(planes)} {names} side in"] if len(planes) > 1 else [])]
