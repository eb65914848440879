"""LIGGGHTS-PUBLIC: spheres and rigid clumps ("multispheres") as data file, sphere files and scripts.

The linear law is the normal model `luding` with an unloading stiffness equal to that of loading up to 1e-9, which
leaves a linear spring; of the linear models of LIGGGHTS it is the one whose damping follows from the restitution, the
stiffness and the effective mass of each contact. `hooke/stiffness` has one damping for a pair of atom types.

References
----------
LIGGGHTS-PUBLIC 3.8.0, documentation and source: `fix_particletemplate_multisphere`, `fix_multisphere`,
`fix_insert_pack`, `fix_wall_gran`, `fix_mesh_surface`, `fix_mesh_surface_stress_servo`, `fix_freeze`,
`gran_model_hertz`, `normal_model_luding.h`, `tangential_model_luding_tn.h`, `global_properties.cpp`;
github.com/CFDEMproject/LIGGGHTS-PUBLIC.
"""

import math
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, Integers
from voxgran._base.errors import FileFormatError, InputError
from voxgran.decks.engine import Engine, Held, row_of, text_of
from voxgran.decks.liggghts_walls import models_of, property_commands, wall_commands, wall_files
from voxgran.decks.simulation import SETTLING, STRESS_MET, Simulation
from voxgran.geometry.rotation import quaternions_of, rotation_matrices

TITLE, INSTALL = "LIGGGHTS", "apt-get install liggghts"
#: names of files
SCRIPT, GRAINS, CLUMPS = "liggghts_run.in", "liggghts_spheres.data", "liggghts_clumps.in"
POSES, SPHERES, ENERGY = "liggghts_clumps.dump", "liggghts_spheres.dump", "liggghts_energy.txt"
#: half the edge of the region that a centroid is put in, in median diameters
PLACED = 1e-9
#: clumps that are inserted in one step: each needs three fixes, which LIGGGHTS compares pair by pair
BATCH = 50
#: time step in which clumps are inserted, in time steps: nothing moves
STILL = 1e-20
#: least restitution that LIGGGHTS takes
LEAST_RESTITUTION = 0.05
#: seeds of templates, distributions and insertions: prime numbers above 10000, all different
SEEDS = (32452843, 32452867, 49979687)
#: places in a tensor in the order of `inertia_tensor`
PLACES = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
_NUMBER = r"[-+.0-9eE]+"
_FROZEN = re.compile(r"# atom (\d+) is of the fixed grain (\d+)")
_CLUMP = re.compile(
    rf"fix t(\d+) .* file (\S+) scale ({_NUMBER}) .* mass ({_NUMBER}) inertia_tensor((?: {_NUMBER}){{6}})"
    rf".*\n.*\nregion r\d+ block((?: {_NUMBER}){{6}}).*\nfix i\d+ .*orientation constant((?: {_NUMBER}){{4}})"
)


def _write(simulation: Simulation) -> Mapping[str, str]:
    """Return the files.

    Raises
    ------
    InputError
        If the restitution is too low, or a clump is a single sphere.
    """
    bodies = simulation.bodies
    least = min(law.restitution for _, _, law in simulation.laws.pairs())
    if least < LEAST_RESTITUTION:
        raise InputError(
            f"material restitution is {least:g}: LIGGGHTS takes {LEAST_RESTITUTION} to 1; give one in between"
        )
    clumps = [template for template in bodies.templates if template.kind == "clump"]
    for template in clumps:
        if len(template.spheres[1]) < 2:
            raise InputError(
                f"clump {template.name!r} is a single sphere: a multisphere of LIGGGHTS has two and more; fit it with "
                "max_spheres=2 or more"
            )
    files = {SCRIPT: _script(simulation)}
    if len(_atoms_of(simulation)):
        files[GRAINS] = _grains(simulation)
    if len(_moving_clumps(simulation)):
        files[CLUMPS] = _clumps(simulation)
    for template in clumps:
        rows = np.column_stack(template.spheres)
        lines = [
            f"# {template.name}: spheres x y z r in m at the size of the shape, in its body frame about the centroid"
        ]
        files[_file(template.name)] = text_of([*simulation.comments(TITLE), *lines, *map(row_of, rows)])
    return files | wall_files(simulation)


def _moving_clumps(simulation: Simulation) -> Integers:
    """Return the grains that are clumps and move."""
    bodies = simulation.bodies
    return np.intersect1d(bodies.of_kind("clump"), np.flatnonzero(bodies.assembly.movable))


def _atoms_of(simulation: Simulation) -> Integers:
    """Return the numbers of the spheres of the data file: those of grains that are spheres, then of fixed clumps, which
    are frozen spheres.
    """
    bodies, grain = simulation.bodies, simulation.bodies.spheres[2]
    alone = np.isin(grain, bodies.of_kind("sphere"))
    frozen = np.isin(grain, np.setdiff1d(bodies.of_kind("clump"), _moving_clumps(simulation)))
    return np.concatenate([np.flatnonzero(alone), np.flatnonzero(frozen)])


def _file(name: str) -> str:
    """Return the name of the file of the spheres of a template."""
    return f"liggghts_{name}.txt"


def _grains(simulation: Simulation) -> str:
    """Return the data file of the grains that are spheres, whose numbers are those of their grains, from 1.

    The spheres of fixed clumps follow, with numbers after those of all grains; a comment says of which grain they are.
    """
    bodies, places = simulation.bodies, _atoms_of(simulation)
    centers, radii, grain = bodies.spheres
    mine, alone = grain[places], np.isin(grain[places], bodies.of_kind("sphere"))
    points, sizes = simulation.walls.wrapped(centers[places])[0], radii[places]
    volume = 4 / 3 * math.pi * libm.power(sizes, 3)
    density = bodies.mass[mine] / np.bincount(mine, volume, minlength=bodies.count)[mine]
    names = np.where(alone, mine + 1, bodies.count + np.cumsum(~alone))
    of_clumps = [f"# atom {name} is of the fixed grain {one + 1}"
                 for name, one in zip(names[~alone].tolist(), mine[~alone].tolist(), strict=True)]  # fmt: skip
    lines = [*of_clumps, "", f"{len(mine)} atoms", f"{simulation.laws.count} atom types", ""]
    kinds = 1 + np.array(simulation.laws.of_shapes)[bodies.assembly.shape_id[mine]]
    box = simulation.domain(float(radii.max()))
    lines += [f"{row_of(ends)} {axis}lo {axis}hi" for axis, ends in zip("xyz", box.T, strict=True)]
    lines += ["", "Atoms", ""]
    rows = np.column_stack([2 * sizes, density, points])
    numbered = zip(names.tolist(), kinds.tolist(), rows, strict=True)
    lines += [f"{number} {kind} {row_of(row)}" for number, kind, row in numbered]
    return text_of([*simulation.comments(TITLE), *lines])


def _clumps(simulation: Simulation) -> str:
    """Return the script that puts each clump at its place, in batches.

    A template is made for each grain, as each has its own scale, mass and inertia. The region that it is put in is a
    point for all that matters.
    """
    bodies, half = simulation.bodies, PLACED * simulation.diameter
    mine = _moving_clumps(simulation).tolist()
    places = simulation.walls.wrapped(bodies.assembly.position)[0]
    turns = quaternions_of(bodies.assembly.matrices)
    lines = []
    for start in range(0, len(mine), BATCH):
        batch = mine[start : start + BATCH]
        for number, grain in enumerate(batch, 1):
            lines += _clump(simulation, grain, number, np.stack([places[grain] - half, places[grain] + half]).T)
            lines.append(
                f"fix i{grain + 1} all insert/pack seed {SEEDS[2]} distributiontemplate d{grain + 1} insert_every "
                f"once overlapcheck no all_in no vel constant 0 0 0 orientation constant {row_of(turns[grain])} "
                f"particles_in_region 1 region r{grain + 1} ntry_mc 1000 check_dist_from_subdomain_border no "
                "warn_region no"
            )
        lines.append("run 1")
        for grain in batch:
            lines += [f"unfix {kind}{grain + 1}" for kind in "idt"]
            lines.append(f"region r{grain + 1} delete")
    return text_of([*simulation.comments(TITLE), *lines])


def _clump(simulation: Simulation, grain: int, number: int, block: Floats) -> list[str]:
    """Return the template of a clump and the region (3, 2) of its centroid."""
    bodies = simulation.bodies
    template, density = bodies.templates[bodies.assembly.shape_id[grain]], float(bodies.assembly.densities[grain])
    scale = float(bodies.assembly.scale[grain])
    # in the frame of the template: LIGGGHTS turns it with the clump
    tensor = template.shape.inertia * density * scale**5
    inertia = row_of(np.array([tensor[place] for place in PLACES]))
    name, kind = grain + 1, 1 + simulation.laws.of_shapes[bodies.assembly.shape_id[grain]]
    made = (
        f"fix t{name} all particletemplate/multisphere {SEEDS[0]} atom_type {kind} density constant {density!r} "
        f"nspheres {len(template.spheres[1])} ntry 1000 spheres file {_file(template.name)} scale {scale!r} "
        f"type {number} mass {float(bodies.mass[grain])!r} inertia_tensor {inertia} use_density"
    )
    return [
        made,
        f"fix d{name} all particledistribution/discrete {SEEDS[1]} 1 t{name} 1.0",
        f"region r{name} block {row_of(block.ravel())} units box volume_limit 1e-200",
    ]


def _script(simulation: Simulation) -> str:
    """Return the script: until the bed rests, with dumps and restart files."""
    bodies = simulation.bodies
    atoms, clumps = len(_atoms_of(simulation)), len(_moving_clumps(simulation))
    spheres = int(bodies.assembly.movable[bodies.of_kind("sphere")].sum())
    boundary = " ".join("p" if periodic else "f" for periodic in simulation.walls.periodic)
    models, settings = models_of(simulation)
    size = float(linear.norm(simulation.gravity))
    lines = [
        "units si",
        "atom_style granular",
        "atom_modify map array",
        f"boundary {boundary}",
        "newton off",
        "communicate single vel yes",
    ]
    if atoms:
        # there are no other atoms yet: those of clumps are inserted later
        types = " ".join(str(k + 1) for k in range(simulation.laws.count))
        lines += [f"read_data {GRAINS}", *_groups(simulation, types)]
    else:
        lines += [
            f"region box block {row_of(simulation.domain(float(bodies.spheres[1].max())).T.ravel())} units box",
            f"create_box {simulation.laws.count} box",
        ]
    lines += [
        f"neighbor {0.1 * simulation.diameter!r} bin",
        "neigh_modify delay 0",
        f"pair_style gran {models} {settings}",
        "pair_coeff * *",
        *property_commands(simulation),
        *wall_commands(simulation),
    ]
    if spheres:
        lines.append("fix move_spheres spheres nve/sphere")
    if clumps:
        lines += [
            "fix move_clumps all multisphere",
            "# clumps are put in at steps in which nothing moves",
            f"timestep {STILL * simulation.time_step!r}",
            f"include {CLUMPS}",
        ]
    if size:
        lines.append(f"fix weight all gravity {size!r} vector {row_of(simulation.gravity / size)}")
    if simulation.platens:
        lines += ["# grains that bear nothing come to rest by drag alone", f"fix drag all viscous {simulation.drag!r}"]
    if len(simulation.fixed):
        # after all else that gives them forces
        lines += ["neigh_modify exclude group fixed fixed", "fix hold fixed freeze"]
    lines.append(f"timestep {simulation.time_step!r}")
    lines += [*_outputs(simulation, spheres, clumps), *_until_rest(simulation)]
    return text_of([*simulation.comments(TITLE), *lines])


def _groups(simulation: Simulation, types: str) -> list[str]:
    """Return the commands of the groups of spheres that move, and of those that are fixed."""
    bodies, places = simulation.bodies, _atoms_of(simulation)
    alone = int(np.isin(bodies.spheres[2][places], bodies.of_kind("sphere")).sum())
    ends = [f"{first}:{last}" for first, last in simulation.fixed]
    if not ends:
        return [f"group spheres type {types}"]
    if len(places) > alone:
        ends.append(f"{bodies.count + 1}:{bodies.count + len(places) - alone}")
    return [
        # numbers of fixed clumps are those of no atom
        *(f"group fixed id {one}" for one in ends),
        f"group every_sphere type {types}",
        "group spheres subtract every_sphere fixed",
    ]


def _outputs(simulation: Simulation, spheres: int, clumps: int) -> list[str]:
    """Return the commands of outputs: poses of grains, energy, and restart files."""
    every = simulation.steps_per_output
    lines, terms = [], []
    if spheres:
        lines += ["compute move spheres ke", "compute turn spheres erotate/sphere"]
        terms += ["c_move", "c_turn"]
        lines.append(f"dump spheres spheres custom {every} {SPHERES} id x y z ix iy iz radius vx vy vz")
        lines.append(
            'dump_modify spheres first yes sort id format "%d %.17g %.17g %.17g %d %d %d %.17g %.17g %.17g %.17g"'
        )
    if clumps:
        lines += ["compute move_clumps all ke/multisphere", "compute turn_clumps all erotate/multisphere"]
        terms += ["c_move_clumps", "c_turn_clumps"]
        names = {"id": "id_multisphere", "x": "xcm", "q": "quat", "v": "vcm"}
        lines += [f"compute {name} all rigid property {value}" for name, value in names.items()]
        counts = {"x": 3, "q": 4, "v": 3}
        columns = ["c_id", *(f"c_{name}[{k + 1}]" for name, count in counts.items() for k in range(count))]
        lines.append(f"# in the order of {CLUMPS}")
        lines.append(f"dump clumps all local {every} {POSES} {' '.join(columns)}")
        lines.append('dump_modify clumps first yes format "%.0f' + " %.17g" * (len(columns) - 1) + '"')
    if simulation.platens:
        # drag does not stop the spin of grains that bear nothing
        terms = [term for term in terms if "move" in term]
        missed = (f"(abs(abs(f_{plane.name}[{plane.axis + 1}])/{force!r}-1.0)>{STRESS_MET})"
                  for plane, force, _ in simulation.platens)  # fmt: skip
        lines.append(f"variable missed equal {'+'.join(missed)}")
    lines += [
        f"variable energy equal {'+'.join(terms)}",
        f"thermo {every}",
        "thermo_style custom step v_energy",
        "thermo_modify lost error",
        f'fix energy all print {every} "$(step) ${{energy}}" file {ENERGY} screen no',
        f"restart {20 * every} liggghts_a.restart liggghts_b.restart",
    ]
    return lines


def _until_rest(simulation: Simulation) -> list[str]:
    """Return the commands that run until the bed rests, or for the longest time."""
    every, most = simulation.steps_per_output, simulation.steps
    if not simulation.gravity.any() and simulation.stress is None:
        return [f"run {most}", "write_restart liggghts_end.restart"]
    met = " && ${missed} < 0.5" if simulation.platens else ""
    start = min(most, math.ceil(SETTLING * simulation.time_unit / simulation.time_step))
    return [
        "# at the start all grains stand still",
        f"run {start}",
        f"variable output loop {max(1, math.ceil((most - start) / every))}",
        "label on",
        f'if "${{energy}} < {simulation.rest_energy!r}{met}" then "jump {SCRIPT} rest"',
        f"run {every}",
        "next output",
        f"jump {SCRIPT} on",
        "label rest",
        "write_restart liggghts_end.restart",
    ]


def _read(folder: Path) -> Held:
    """Return what the data file, the script of clumps and the sphere files hold.

    Raises
    ------
    FileFormatError
        If a file is damaged.
    """
    found: dict[int, tuple[float, Floats, Floats, Floats]] = {}
    if (folder / GRAINS).is_file():
        text = (folder / GRAINS).read_text(encoding="utf-8")
        grains = {int(atom): int(grain) for atom, grain in _FROZEN.findall(text)}
        tables: dict[int, list[list[float]]] = {}
        for line in filter(str.strip, text.split("Atoms", 1)[-1].splitlines()):
            number, *row = map(float, line.split())
            tables.setdefault(grains.get(int(number), int(number)), []).append(row)
        found = {number: _held_spheres(np.array(table)) for number, table in tables.items()}
    if (folder / CLUMPS).is_file():
        for words in _CLUMP.findall((folder / CLUMPS).read_text(encoding="utf-8")):
            found[int(words[0])] = _held_clump(folder, words[1:])
    if not found or sorted(found) != list(range(1, len(found) + 1)):
        raise FileFormatError(f"{folder} has {len(found)} grains of LIGGGHTS, with gaps: write the files again")
    masses, places, tensors, spheres = zip(*(found[number] for number in sorted(found)), strict=True)
    rows = np.concatenate(spheres)
    return Held(np.array(masses), np.array(places), np.array(tensors), rows[:, :3], rows[:, 3])


def _held_spheres(table: Floats) -> tuple[float, Floats, Floats, Floats]:
    """Return mass, centroid, inertia tensor and spheres (s, 4) of a grain by its type, diameters, densities and centers
    (s, 6).
    """
    radii, centers = table[:, 1] / 2, table[:, 3:]
    masses = table[:, 2] * 4 / 3 * math.pi * libm.power(radii, 3)
    middle = linear.matmul(masses, centers) / masses.sum()
    arms = centers - middle
    own = 0.4 * radii**2 + (arms**2).sum(axis=1)
    inertia = linear.matmul(masses, own) * np.eye(3) - linear.einsum("s,si,sj->ij", masses, arms, arms)
    return float(masses.sum()), middle, inertia, np.column_stack([centers, radii])


def _held_clump(folder: Path, words: tuple[str, ...]) -> tuple[float, Floats, Floats, Floats]:
    """Return mass, centroid, inertia tensor and spheres (s, 4) of a clump in the frame of the container."""
    name, scale, mass = words[0], float(words[1]), float(words[2])
    moments, block, turn = (np.array(word.split(), dtype=float) for word in words[3:])
    matrix = rotation_matrices(turn[None])[0]
    tensor = np.zeros((3, 3))
    for place, value in zip(PLACES, moments, strict=True):
        tensor[place] = tensor[place[::-1]] = value
    center = block.reshape(3, 2).mean(axis=1)
    spheres = np.loadtxt(folder / name, ndmin=2) * scale
    spheres[:, :3] = linear.matmul(spheres[:, :3], matrix.T) + center
    return mass, center, linear.matmul(linear.matmul(matrix, tensor), matrix.T), spheres


registration = Engine(
    title=TITLE,
    summary="data file of spheres, multisphere templates with the place of each clump, and a script",
    upright="which finds no contacts across tilted sides",
    source="LIGGGHTS-PUBLIC 3.8.0, documentation and source",
    kinds=("sphere", "clump"),
    fixed=True,
    platens=True,
    materials=True,
    rolling=("linear", "hertz"),
    install=INSTALL,
    verified="run with LIGGGHTS-PUBLIC 3.8.0 of Debian 12",
    command=f"liggghts -in {SCRIPT}",
    write=_write,
    read=_read,
)
