"""Digital packing: moves per second against the voxels of a grain beside other programs, and density against seconds.

Moves: equal spheres at a solid fraction of 0.3 on lattices of 256 and 512 voxels along each edge walk in 26 directions,
all alike, by voxgran, by a plain NumPy program and by a numba program that tests the voxels which each direction newly
covers; the shares of accepted moves are written beside the rates. A body of many triangles walks as fast as a sphere of
as many voxels. Density: the bulk solid fraction of a bed of equal spheres, true and without overlap, against voxels per
diameter and against the seconds that it took, after the walk and after settling.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from benchmarks.model import best_rate, panels_of, ratios, scans, timed, write_rows
from benchmarks.peers import walks as peers
from voxgran._base.lazy import load
from voxgran._base.seeds import stream
from voxgran.containers.kinds.box import Box
from voxgran.measures.registered.density import bulk_solid_fraction
from voxgran.packing.digital.precompute import precomputed_of
from voxgran.packing.digital.schedule import SORT_SWEEPS
from voxgran.packing.digital.state import DigitalState
from voxgran.packing.draw import Request
from voxgran.packing.method import method_registry
from voxgran.packing.pack import pack, prepare_task
from voxgran.packing.problem import Problem
from voxgran.shapes.family import make_shape
from voxgran.shapes.model import Shape

#: edge of the lattice, shape, voxels of a grain, program, attempts per second, share of accepted moves
MoveRow: TypeAlias = tuple[int, str, int, str, float, float]
#: voxels per diameter, sweeps, stage, seconds, bulk solid fraction
BedRow: TypeAlias = tuple[int, int, str, float, float]
#: voxels along an edge of the lattice, and per diameter of the spheres
EDGE = 256
DIAMETERS = (12, 20, 40, 57)
LARGE = 512
LARGE_DIAMETERS = (12, 20, 40)
SOLID = 0.3
#: other programs, all as they are drawn, and how each lattice is
PEERS = ("NumPy", "numba fronts")
PROGRAMS = ("voxgran", "voxgran, sorted", *PEERS[::-1])
DASHES = {EDGE: "-", LARGE: ":"}
#: least seconds that a program is timed
SECONDS = 0.6
#: voxels per diameter of the beds, and sweeps of their walks
BEDS = (12, 20, 32)
SWEEPS = (250, 1000, 4000)


def walking_task(
    shape: Shape, cells: int, edge: int = EDGE, *, schedule: str = "random"
) -> tuple[Problem, DigitalState]:
    """Return equal grains at random places on a lattice, ready to walk in all directions alike: voxels per equivalent
    diameter, voxels along each edge, and the schedule, ``"random"`` or ``"sorted"``.
    """
    box = Box((edge / cells,) * 3)
    count = int(SOLID * edge**3 / cells**3 / (shape.volume / shape.diameter**3) / 1.2)
    parameters = {
        "voxel_size": 1 / cells, "gravity": "none", "rotation_share": 0.0, "orientations": 1, "sweeps": 10**9,
        "feed": "at_once", "schedule": schedule,
    }  # fmt: skip
    unit = shape.scaled(1 / shape.diameter)
    task = prepare_task(Request(unit, box, "digital", count=count, parameters=parameters))
    method = method_registry().get("digital")
    state: Any = method.prepare(task.problem)
    while state.feeding_ended_at is None:
        method.advance(task.problem, state, 10_000)
    return task.problem, state


def rate_of_walk(problem: Problem, state: DigitalState) -> tuple[float, float]:
    """Return attempts per second and the share of accepted moves of voxgran's walk."""
    advance = method_registry().get("digital").advance
    advance(problem, state, 2000)
    before, tried = state.moves_accepted, state.moves_tried
    # in the order of space, all that comes between two sortings
    attempts = SORT_SWEEPS * state.placed if len(state.order) else 20_000
    best, _ = best_rate(lambda: advance(problem, state, attempts), attempts, least_time=SECONDS)
    return best, (state.moves_accepted - before) / (state.moves_tried - tried)


def rate_of_peer(
    walk: Callable[..., int],
    occupied: Callable[..., NDArray[np.int8]],
    problem: Problem,
    state: DigitalState,
    attempts: int,
) -> tuple[float, float]:
    """Return attempts per second and the share of accepted moves of another program, from the same places."""
    setting = precomputed_of(problem, state)
    mask = problem.voxels(0, setting.base[0], setting.lattice.voxel_size, cover="touch")
    half = np.array(mask.shape) // 2
    filled = [np.flatnonzero(mask.any(axis=tuple(k for k in range(3) if k != axis))) for axis in range(3)]
    low = np.array([line[0] for line in filled])
    box = mask[tuple(slice(line[0], line[-1] + 1) for line in filled)]
    sites = state.site[state.member >= 0] - half + low + 1
    grid = occupied(setting.lattice.shape + 2, box, sites)
    generator = stream(1, "bench picks")
    best, accepted = best_rate(
        lambda picks, ways: walk(grid, sites, picks, ways), attempts, least_time=SECONDS,
        draw=lambda: (generator.integers(0, len(sites), attempts), generator.integers(0, 26, attempts)),
    )  # fmt: skip
    return best, sum(accepted) / (len(accepted) * attempts)


def measure_spheres(diameters: tuple[int, ...] = DIAMETERS, edge: int = EDGE) -> list[MoveRow]:
    """Time the walks of equal spheres, by voxels per diameter, on a lattice of so many voxels along each edge."""
    rows: list[MoveRow] = []
    steps = np.array([d for d in np.ndindex(3, 3, 3) if d != (1, 1, 1)], dtype=np.int64) - 1
    for cells in diameters:
        problem, state = walking_task(make_shape("sphere"), cells, edge)
        setting = precomputed_of(problem, state)
        mask = problem.voxels(0, setting.base[0], setting.lattice.voxel_size, cover="touch")
        box = mask[np.ix_(*(mask.any(axis=tuple(k for k in range(3) if k != axis)) for axis in range(3)))]
        voxels = int(box.sum())
        known = edge, "sphere", voxels
        walk, fast = peers.numpy_walk(box, steps), peers.front_walk(box, steps)
        rows.append((*known, "NumPy", *rate_of_peer(walk, peers.occupied, problem, state, 2000)))
        rows.append((*known, "numba fronts", *rate_of_peer(fast, peers.occupied, problem, state, 100_000)))
        rows.append((*known, "voxgran", *rate_of_walk(problem, state)))
        turns = walking_task(make_shape("sphere"), cells, edge, schedule="sorted")
        rows.append((*known, "voxgran, sorted", *rate_of_walk(*turns)))
    return rows


def measure_bodies(edge: int = EDGE) -> list[MoveRow]:
    """Time the walks of bodies of few and of many triangles, of 20 voxels per diameter; rows as of
    :func:`measure_spheres`.
    """
    rows: list[MoveRow] = []
    for file, body in {"box": make_shape("box"), "sphere": make_shape("sphere"), **scans("bennu_lp.obj")}.items():
        problem, state = walking_task(body, 20, edge)
        mask = problem.voxels(0, precomputed_of(problem, state).base[0], 1 / 20, cover="touch")
        known = edge, f"{file.removesuffix('_lp')}, {len(body.faces)} triangles", int(mask.sum())
        rows.append((*known, "voxgran", *rate_of_walk(problem, state)))
    return rows


def measure_beds(beds: tuple[int, ...] = BEDS, sweeps: tuple[int, ...] = SWEEPS) -> list[BedRow]:
    """Pack beds of equal spheres, by voxels per diameter and sweeps (attempts per grain)."""
    rows, box, sphere = [], Box((7, 7, 17)), make_shape("sphere")
    for cells in beds:
        for many in sweeps:
            for stage, settling in (("walk", False), ("walk and settling", True)):
                packing, seconds = timed(
                    pack, sphere, box, method="digital", count=420, seed=1, voxel_size=1 / cells, sweeps=many, cycles=6,
                    orientations=1, settle=settling,
                )  # fmt: skip
                rows.append((cells, many, stage, seconds, float(bulk_solid_fraction(packing))))
    return rows


def run(folder: Path) -> tuple[Path, ...]:
    """Measure, and write rows as CSV and a figure as SVG."""
    moves = [*measure_spheres(), *measure_spheres(LARGE_DIAMETERS, LARGE), *measure_bodies()]
    beds = measure_beds()
    rates = {row[:4]: row[4] for row in moves}
    rows = [(*row, *ratios(row[4], [rates.get((*row[:3], peer)) for peer in PEERS])) for row in moves]
    head = "edge,shape,voxels,program,attempts_per_second:.0f,accepted:.3f,ratio_to_numpy:.1f,ratio_to_numba_fronts:.1f"
    bed_head = "voxels_per_diameter,sweeps,stage,seconds:.2f,bulk_solid_fraction:.4f"
    _draw(moves, beds, folder / "digital.svg")
    return (
        write_rows(folder / "digital_moves.csv", head, rows),
        write_rows(folder / "digital_beds.csv", bed_head, beds),
        folder / "digital.svg",
    )


def _draw(moves: list[MoveRow], beds: list[BedRow], path: Path) -> None:
    """Draw rates on the left, density against seconds in the middle and against voxels per diameter on the right."""
    stages, line = {"walk": ":", "walk and settling": "-"}, load("matplotlib.lines").Line2D
    with panels_of(path, 3, width=13.2, legend=0) as (left, middle, right):
        for k, program in enumerate(PROGRAMS):
            for edge, style in DASHES.items():
                rates = [(row[2], row[4]) for row in moves if row[:2] == (edge, "sphere") and row[3] == program]
                if rates:
                    left.loglog(*zip(*rates, strict=True), f"C{k}{style}", marker="o")
        # colors tell the program, dashes the lattice
        keys = [line([], [], color=f"C{k}", label=program) for k, program in enumerate(PROGRAMS)]
        keys += [line([], [], color="black", linestyle=style, label=f"{edge}³") for edge, style in DASHES.items()]
        left.set(xlabel="voxels of a grain", ylabel="attempts per second")
        for k, cells in enumerate(sorted({row[0] for row in beds})):
            for stage, style in stages.items():
                found = [(row[3], row[4]) for row in beds if row[0] == cells and row[2] == stage]
                label = f"{cells} voxels per diameter, {stage}"
                middle.semilogx(*zip(*found, strict=True), f"C{k}{style}", marker="o", label=label)
        middle.set(xlabel="CPU seconds", ylabel="bulk solid fraction, true spheres")
        longest = max(row[1] for row in beds)
        for stage, style in stages.items():
            ends = [(row[0], row[4]) for row in beds if row[1] == longest and row[2] == stage]
            right.plot(*zip(*ends, strict=True), f"k{style}", marker="o", label=stage)
        right.set(xlabel="voxels per diameter", ylabel="bulk solid fraction, true spheres")
        for panel, handles in ((left, keys), (middle, None), (right, None)):
            panel.legend(handles=handles, frameon=False, fontsize=7, ncols=1 if handles is None else 2)
