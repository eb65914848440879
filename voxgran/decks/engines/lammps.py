"""LAMMPS: spheres and rigid clumps in granular contact, as data file, file of rigid bodies, molecules and script.

References
----------
Formats and commands: docs.lammps.org, pages `read_data`, `pair_granular`, `fix_wall_gran`, `fix_wall_gran_region`,
`fix_rigid` (file of bodies), `molecule` and `compute_rigid_local`; release of 22 July 2025.
"""

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats
from voxgran._base.errors import FileFormatError, InputError
from voxgran.decks.engine import Engine, Held, row_of, text_of
from voxgran.decks.lammps_bonds import BondTexts, bond_commands, bond_texts
from voxgran.decks.lammps_states import (
    BODIES,
    BONDS,
    CLUMPS,
    DATA,
    ENERGY,
    INSTALL,
    POSE,
    SCRIPT,
    SPHERES,
    TITLE,
    lammps_states,
)
from voxgran.decks.lammps_walls import law_text, wall_commands
from voxgran.decks.simulation import OUTPUT, SETTLING, STRESS_MET, Simulation
from voxgran.shapes.formats.sphere_files import PLACES, text_of_spheres

#: types of atoms of the first material: spheres that are grains, and spheres of clumps; the next one has 3 and 4
SPHERE, CLUMP = 1, 2
#: most materials: each is a group, of which LAMMPS has 32
MOST_MATERIALS = 28
#: overlap from which grains are parted under drag at the start, in median diameters; how long; and the time in which
#: drag stops a grain, in sqrt(d / g)
DEEPEST, UNLOADING, DRAG_TIME = 5e-3, 1.0, 0.01
#: time in which the cell follows a stress, in sqrt(m / (s d))
FOLLOWS = 0.2
#: commands that read the data file where clumps are rigid
_LOADED = [
    "fix grain all property/atom mol ghost yes",
    "read_data lammps_grains.data fix grain NULL Molecules",
    "# spheres of one grain do not interact",
    "neigh_modify exclude molecule/intra all",
]


def _write(simulation: Simulation) -> Mapping[str, str]:
    """Return the files.

    Raises
    ------
    InputError
        If a clump has a single sphere, there are too many materials, or the container is not one that LAMMPS has.
    """
    bodies, many = simulation.bodies, simulation.laws.count
    if many > MOST_MATERIALS:
        raise InputError(f"material has {many} materials: LAMMPS takes {MOST_MATERIALS} here; give fewer")
    for template in bodies.templates:
        if template.kind == "clump" and len(template.spheres[1]) == 1 and simulation.bonds is None:
            raise InputError(
                f"clump {template.name!r} has 1 sphere: rigid bodies of LAMMPS have at least 2; give clump=2"
            )
    files = {SCRIPT: _script(simulation), DATA: _data(simulation)}
    if len(simulation.bodies.moving("clump")) and simulation.bonds is None:
        files[BODIES] = _bodies(simulation)
    bonds = _bond_texts(simulation)
    if bonds is not None:
        files[BONDS] = text_of([*simulation.comments(TITLE), *bonds.commands])
    for template, density in zip(bodies.templates, bodies.densities, strict=True):
        if template.kind == "clump":
            files[f"lammps_{template.name}.mol"] = text_of_spheres(template.shape, ".mol", density=density)
    return files


def _data(simulation: Simulation) -> str:
    """Return the data file: all spheres, with the grain that each belongs to as its molecule."""
    bodies, walls = simulation.bodies, simulation.walls
    centers, radii, grain = bodies.spheres
    volume = 4 / 3 * math.pi * libm.power(radii, 3)
    # the masses of the spheres of a grain add up to its true mass
    density = bodies.mass[grain] / np.bincount(grain, volume, minlength=bodies.count)[grain]
    clump = np.isin(grain, bodies.of_kind("clump"))
    places, images = simulation.walls.wrapped(centers)
    low, high = simulation.domain(radii.max())
    laws, bonds = simulation.laws, _bond_texts(simulation)
    counts = [f"{len(radii)} atoms", f"{2 * laws.count} atom types"]
    if bonds is not None:
        counts += [f"{len(bonds.section)} bonds", f"{len(bonds.commands)} bond types"]
    lines = [f"# {simulation.header(TITLE)[0]}", "", *counts, ""]
    ends = zip("xyz", low.tolist(), high.tolist(), strict=True)
    lines += [f"{lower!r} {upper!r} {axis}lo {axis}hi" for axis, lower, upper in ends]
    if (tilts := walls.periods[np.tril_indices(3, -1)]).any():
        lines.append(f"{row_of(tilts)} xy xz yz")
    style = "sphere" if simulation.bonds is None else "bpm/sphere"
    lines += ["", f"Atoms # {style}", ""]
    kinds = 2 * np.array(laws.of_shapes)[bodies.assembly.shape_id[grain]] + np.where(clump, CLUMP, SPHERE)
    rows = zip(grain.tolist(), kinds.tolist(), radii.tolist(), density.tolist(), strict=True)
    wheres = zip(places.tolist(), images.tolist(), strict=True)
    for number, ((one, kind, radius, rho), ((x, y, z), (i, j, k))) in enumerate(zip(rows, wheres, strict=True), 1):
        molecule = "" if simulation.bonds is None else f"{one + 1} "
        lines.append(f"{number} {molecule}{kind} {2 * radius!r} {rho!r} {x!r} {y!r} {z!r} {i} {j} {k}")
    if bonds is None:
        lines += ["", "Molecules", ""]
        lines += [f"{number} {molecule}" for number, molecule in enumerate((grain + 1).tolist(), 1)]
    else:
        lines += ["", "Bonds", "", *bonds.section]
    return text_of(lines)


def _bond_texts(simulation: Simulation) -> BondTexts | None:
    """Return the bonds between spheres; None where clumps are rigid."""
    if simulation.bonds is None:
        return None
    bodies = simulation.bodies
    centers, radii, grain = bodies.spheres
    share = libm.power(radii, 3) / np.bincount(grain, libm.power(radii, 3))[grain]
    return bond_texts(simulation.bonds, simulation.law, centers, bodies.mass[grain] * share)


def _bodies(simulation: Simulation) -> str:
    """Return the file of rigid bodies: true mass, centroid and inertia tensor of each clump."""
    bodies = simulation.bodies
    mine = bodies.moving("clump")
    places, images = simulation.walls.wrapped(bodies.assembly.position[mine])
    tensors = np.stack([bodies.inertia[mine][:, i, j] for i, j in PLACES], axis=1)
    lines = ["# molecule, mass, centroid, inertia xx yy zz xy xz yz, velocity, angular momentum, image flags"]
    lines.append(str(len(mine)))
    for k, grain in enumerate(mine.tolist()):
        numbers = [bodies.mass[grain], *places[k], *tensors[k]]
        body = row_of(numbers)
        lines.append(f"{grain + 1} {body} 0 0 0 0 0 0 {' '.join(map(str, images[k].tolist()))}")
    return text_of(lines)


def _contacts(simulation: Simulation) -> list[str]:
    """Return the commands of the contact laws, and of the groups of grains of each material."""
    laws = simulation.laws
    every = ["*"] if laws.count == 1 else [f"{2 * k + SPHERE}*{2 * k + CLUMP}" for k in range(laws.count)]
    lines = [f"pair_coeff {every[a]} {every[b]} {law_text(simulation, law)}" for a, b, law in laws.pairs()]
    if laws.count > 1:
        lines += [f"group material_{k + 1} type {2 * k + SPHERE} {2 * k + CLUMP}" for k in range(laws.count)]
    return lines


def _script(simulation: Simulation) -> str:
    """Return the script: until the bed rests, with dumps and restart files."""
    walls, bodies = simulation.walls, simulation.bodies
    spheres, clumps = len(bodies.moving("sphere")), len(bodies.moving("clump"))
    boundary = " ".join("p" if periodic else "f" for periodic in walls.periodic)
    reach = 2 * float(bodies.assembly.bounding_radii.max())
    rigid = simulation.bonds is None
    lines = [
        "units si",
        f"boundary {boundary}",
        f"atom_style {'sphere' if rigid else 'bpm/sphere'}",
        "atom_modify map array",
        "newton off",
        f"comm_modify vel yes cutoff {reach + 2 * float(bodies.spheres[1].max())!r}",
        *(_LOADED if rigid else [f"read_data {DATA}", *bond_commands(BONDS)]),
        f"neighbor {0.1 * simulation.diameter!r} bin",
        "neigh_modify delay 0",
        "pair_style granular",
        *_contacts(simulation),
        *_groups(simulation),
        *(_motion(simulation, spheres, clumps) if rigid else _bonded_motion(simulation)),
        "# walls",
        *wall_commands(simulation),
        *_servo(simulation),
        *_energy(spheres, clumps if rigid else 0, "spheres" if rigid else "all"),
        f"timestep {simulation.time_step!r}",
        *_outputs(simulation, spheres, clumps if rigid else 0, "spheres" if rigid else "all"),
        *_unloading(simulation),
        *_until_rest(simulation),
    ]
    return text_of([*simulation.comments(TITLE), *lines])


def _groups(simulation: Simulation) -> list[str]:
    """Return the commands of the groups of spheres and of clumps that move, and what holds fixed grains."""
    grains, many = simulation.bodies.assembly, range(simulation.laws.count)
    sphere, clump = (" ".join(str(first + 2 * k) for k in many) for first in (SPHERE, CLUMP))
    if grains.fixed is None:
        return [f"group spheres type {sphere}", f"group clumps type {clump}"]
    return [
        # grains are molecules, numbered from 1 on
        *(f"group fixed molecule {first}:{last}" for first, last in simulation.fixed),
        f"group every_sphere type {sphere}",
        f"group every_clump type {clump}",
        "group spheres subtract every_sphere fixed",
        "group clumps subtract every_clump fixed",
        "neigh_modify exclude group fixed fixed",
        "fix hold fixed freeze",
    ]


def _motion(simulation: Simulation, spheres: int, clumps: int) -> list[str]:
    """Return the commands of gravity and of the motion of grains."""
    size = float(linear.norm(simulation.gravity))
    along = " ".join(repr(float(value)) for value in simulation.gravity / (size or 1.0))
    lines = []
    if spheres:
        lines.append("fix move_spheres spheres nve/sphere")
        if size:
            lines.append(f"fix weight_spheres spheres gravity {size!r} vector {along}")
    if clumps:
        weight = ""
        if size:
            # the weight of a clump is that of its true mass, which the rigid bodies add themselves
            lines.append(f"fix weight_clumps clumps gravity {size!r} vector {along} disable")
            weight = " gravity weight_clumps"
        lines.append(f"fix move_clumps clumps rigid/small molecule infile {BODIES}{weight}")
    return lines


def _bonded_motion(simulation: Simulation) -> list[str]:
    """Return the commands of gravity and motion of spheres that are bonded."""
    size = float(linear.norm(simulation.gravity))
    along = " ".join(repr(float(value)) for value in simulation.gravity / (size or 1.0))
    weight = [f"fix weight all gravity {size!r} vector {along}"] if size else []
    return ["fix move all nve/bpm/sphere", *weight]


def _servo(simulation: Simulation) -> list[str]:
    """Return the commands of a periodic cell that keeps a stress, and of what brings grains under a stress to rest."""
    if simulation.stress is None:
        return []
    law, pressure, damping = simulation.law, simulation.pressure, FOLLOWS * simulation.time_unit
    young = law.young_modulus
    drag, spheres = simulation.drag, len(simulation.bodies.of_kind("sphere"))
    # of the grains together, about: it sets the time in which the cell follows
    modulus = young ** (2 / 3) * pressure ** (1 / 3) if law.name == "hertz" else law.stiffness / simulation.diameter
    sides = [f"{x} {s!r} {s!r} {damping!r}" for x, s in zip("xyz", simulation.stress.tolist(), strict=True) if s == s]
    return [
        *([] if simulation.platens else [f"fix servo all press/berendsen {' '.join(sides)} modulus {modulus!r}"]),
        "# without gravity grains that bear nothing come to rest by drag alone",
        f"fix drag all viscous {drag!r}",
        *([f"fix spin_drag spheres viscous/sphere {0.1 * drag * simulation.diameter**2!r}"] if spheres else []),
    ]


def _energy(spheres: int, clumps: int, single: str) -> list[str]:
    """Return the commands that compute the kinetic energy of all grains."""
    lines, terms = [], []
    if spheres or single == "all":
        lines += [f"compute move {single} ke", f"compute turn {single} erotate/sphere"]
        terms += ["c_move", "c_turn"]
    if clumps:
        lines += ["compute move_clumps clumps ke/rigid move_clumps"]
        lines += ["compute turn_clumps clumps erotate/rigid move_clumps"]
        terms += ["c_move_clumps", "c_turn_clumps"]
    return [*lines, f"variable energy equal {'+'.join(terms)}"]


def _outputs(simulation: Simulation, spheres: int, clumps: int, single: str) -> list[str]:
    """Return the commands of outputs: poses of grains, energy, and restart files."""
    every = simulation.steps_per_output
    moved = "".join(f" $(v_at_{platen.plane.name}:%.17g)" for platen in simulation.platens)
    lines = [
        f"thermo {every}",
        "thermo_style custom step v_energy",
        "thermo_modify lost error",
        f'fix energy all print {every} "$(step) $(v_energy:%.9g){moved}" file {ENERGY} screen no',
    ]
    if spheres or single == "all":
        # spheres in the order of their grains, or of all spheres where these are bonded
        number = "mol" if single == "spheres" else "id"
        lines.append(f"dump spheres {single} custom {every} {SPHERES} {number} xu yu zu radius vx vy vz")
        lines.append("dump_modify spheres sort id format float %.17g first yes")
    if clumps:
        poses = " ".join(f"c_poses[{k + 1}]" for k in range(len(POSE)))
        lines.append(f"compute poses clumps rigid/local move_clumps {' '.join(POSE)}")
        lines.append(f"dump clumps clumps local {every} {CLUMPS} {poses}")
        lines.append('dump_modify clumps format line "%.0f' + " %.17g" * (len(POSE) - 1) + '"')
    lines.append(f"restart {20 * every} lammps_a.restart lammps_b.restart")
    return lines


def _unloading(simulation: Simulation) -> list[str]:
    """Return the commands that part grains which overlap at the start, by drag that lets them gather no speed."""
    if simulation.overlap <= DEEPEST * simulation.diameter:
        return []
    drag = simulation.drag_within(DRAG_TIME * simulation.time_unit)
    return [
        f"# spheres overlap by {simulation.overlap!r} m at the start: they are parted under drag",
        f"fix parting all viscous {drag!r}",
        f"run {max(1, round(UNLOADING / OUTPUT)) * simulation.steps_per_output}",
        "unfix parting",
    ]


def _until_rest(simulation: Simulation) -> list[str]:
    """Return the commands that run until the bed rests, or for the longest time."""
    every, most = simulation.steps_per_output, simulation.steps
    if not simulation.gravity.any() and simulation.stress is None:
        return [f"run {most}", "write_restart lammps_end.restart"]
    moves, missed = f"v_energy > {simulation.rest_energy!r}", []
    if simulation.platens:
        missed = [f"(abs(v_push_{one.name}/{force!r}-1.0) > {STRESS_MET})" for one, force, _ in simulation.platens]
    elif simulation.stress is not None:
        known = enumerate(simulation.stress.tolist(), 1)
        missed = [f"(abs(c_servo_press[{k}]/{s!r}-1.0) > {STRESS_MET})" for k, s in known if s == s]
    start = min(most, math.ceil(SETTLING * simulation.time_unit / simulation.time_step))
    return [
        "# at the start all grains stand still",
        f"run {start}",
        *([f'variable unrest equal "{" || ".join([f"({moves})", *missed])}"'] if missed else []),
        f"fix rest all halt {every} {'v_unrest < 0.5' if missed else moves.replace('>', '<')} error continue",
        f"run {most - start}",
        "write_restart lammps_end.restart",
    ]


def _read(folder: Path) -> Held:
    """Return what the data file and the file of bodies hold.

    Raises
    ------
    FileFormatError
        If a file is damaged.
    """
    text = (folder / DATA).read_text(encoding="utf-8").splitlines()
    low, high = np.array([line.split()[:2] for line in text if line.endswith("hi")], dtype=float).T
    atoms, molecules = (_section(text, name) for name in ("Atoms", "Molecules"))
    if any("bpm/sphere" in line for line in text):
        atoms, molecules = np.delete(atoms, 1, axis=1), atoms[:, :2]
    if not len(atoms) or atoms.shape[1] != 10 or len(molecules) != len(atoms):
        raise FileFormatError(f"{folder / DATA} has {len(atoms)} atoms and {len(molecules)} molecules: write it again")
    radii, density = atoms[:, 2] / 2, atoms[:, 3]
    centers = atoms[:, 4:7] + atoms[:, 7:10] * (high - low)
    grain = molecules[:, 1].astype(np.int64) - 1
    count = int(grain.max()) + 1
    mass = np.zeros(count)
    np.add.at(mass, grain, density * 4 / 3 * math.pi * libm.power(radii, 3))
    position = np.zeros((count, 3))
    position[grain] = centers
    inertia = np.zeros((count, 3, 3))
    inertia[grain] = (0.4 * mass[grain] * radii**2)[:, None, None] * np.eye(3)
    if (atoms[:, 1] % 2 == CLUMP % 2).any() and "Molecules" in text:
        rows = np.loadtxt(folder / BODIES, skiprows=2, ndmin=2)
        mine = rows[:, 0].astype(np.int64) - 1
        mass[mine] = rows[:, 1]
        position[mine] = rows[:, 2:5] + rows[:, 17:20] * (high - low)
        for k, (i, j) in enumerate(PLACES):
            inertia[mine, i, j] = inertia[mine, j, i] = rows[:, 5 + k]
    return Held(mass, position, inertia, centers, radii)


def _section(lines: list[str], name: str) -> Floats:
    """Return the rows of a section of a data file."""
    start = next((k for k, line in enumerate(lines) if line.startswith(name)), len(lines)) + 2
    end = next((k for k in range(start, len(lines)) if not lines[k].strip()), len(lines))
    return np.array([line.split() for line in lines[start:end]], dtype=float)


registration = Engine(
    title=TITLE,
    summary="data file, rigid bodies, molecule templates and a script of granular contact",
    source="docs.lammps.org, release of 22 July 2025",
    kinds=("sphere", "clump"),
    tilted=True,
    cohesion=True,
    bonds=True,
    fixed=True,
    servo=True,
    platens=True,
    materials=True,
    rolling=("linear", "hertz"),
    install=INSTALL,
    verified="run with LAMMPS of 22 July 2025",
    command=f"lmp -in {SCRIPT}",
    write=_write,
    read=_read,
    run=lammps_states,
)
