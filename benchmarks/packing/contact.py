"""Tests of contact of control-point packing: attempts per second beside other programs, and error against run time.

Speed: equal grains at a solid fraction of 0.3 in a box move and turn without gravity, by steps that adapt; shares of
accepted attempts are written beside the rates. The peers go on from where the grains are, with the same steps. All run
on one thread, and seconds are CPU seconds. Accuracy: two grains in random turns come towards each other
along a line until the test refuses; where the true surfaces touch is known in closed form for spheres, from the
Minkowski difference for boxes, and from the least gap that manifold3d finds for scanned bodies. Density: beds of equal
spheres after walks with and without bias and vibration, each changed alone, and after settling.
"""

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from benchmarks.encounter import Encounter
from benchmarks.model import best_rate, panels_of, ratios, scans, timed, write_rows
from benchmarks.peers import contact as peers
from voxgran._base.arrays import Floats, Integers
from voxgran._base.lazy import load
from voxgran._base.seeds import stream
from voxgran.containers.kinds.box import Box
from voxgran.geometry.rotation import normalized, rotation_matrices
from voxgran.measures.registered.density import bulk_solid_fraction
from voxgran.packing.control_point.precompute import precomputed_of
from voxgran.packing.control_point.state import ControlState
from voxgran.packing.draw import Request
from voxgran.packing.method import method_registry
from voxgran.packing.pack import pack, prepare_task
from voxgran.packing.problem import Problem
from voxgran.shapes.family import make_shape
from voxgran.shapes.model import Shape

#: shape, control points of a grain, program, attempts per second, share of accepted attempts
SpeedRow: TypeAlias = tuple[str, int, str, float, float]
#: shape, test, control points, spacing, mean and largest size of the error, largest overlap, microseconds per attempt
AccuracyRow: TypeAlias = tuple[str, str, int, float, float, float, float, float]
#: names of the peers
PROGRAMS = ("SciPy cKDTree", "numba grid")
#: spacings at which bodies of unit diameter have about 200, 600 and 2000 control points
SPACINGS: dict[str, tuple[float, ...]] = {
    "sphere": (0.25, 0.16, 0.093),
    "box": (0.3, 0.166, 0.098),
    "eros": (0.62, 0.29, 0.13),
}
ACCURACY_SPACINGS = (0.4, 0.28, 0.2, 0.14, 0.1)
#: tests by name: contact and ways
TESTS = {"sdf": ("sdf", "both"), "sdf, one way": ("sdf", "one"), "kdtree": ("kdtree", "both")}
GRAINS, SOLID, MIXING = 150, 0.3, 400
#: spheres of a bed, and seeds of its walks
BED, SEEDS = 420, (1, 2, 3)
BOXES = {"periodic": Box((6, 6, 32), periodic="xy"), "walls": Box((8, 8, 20))}
#: kinds of vibration at constant amplitude by name, attempts per grain, and biases towards gravity
SHAKEN: dict[str, dict[str, Any]] = {
    "none": {"vibration_up": 0.0},
    "cycles": {"vibration": "cycles", "vibration_up": 1.0, "decay": 1.0},
    "collision": {"vibration": "collision", "vibration_up": 1.0, "decay": 1.0},
}
SWEEPS, BIASES = (100, 2000), (0.5, 0.0)
#: least seconds that a program is timed, and approaches of two grains
SECONDS, APPROACHES = 0.6, 24


def moving_task(shape: Shape, spacing: float, test: str, *, count: int = GRAINS) -> tuple[Problem, ControlState]:
    """Return equal grains in a box, mixed and ready to move: their shape, the spacing of control points in diameters,
    one of :data:`TESTS`, and how many.
    """
    contact, ways = TESTS[test]
    unit = shape.scaled(1 / shape.diameter)
    edge = (count * unit.volume / SOLID) ** (1 / 3)
    parameters = {
        "spacing": spacing, "contact": contact, "tested_points": ways, "gravity": "none", "feed": "at_once",
        "sweeps": 10**7,
    }  # fmt: skip
    task = prepare_task(Request(unit, Box((edge,) * 3), "control_point", count=count, parameters=parameters))
    advance = method_registry().get("control_point").advance
    state: Any = method_registry().get("control_point").prepare(task.problem)
    while state.feeding_ended_at is None:
        advance(task.problem, state, 10_000)
    advance(task.problem, state, MIXING * count)
    return task.problem, state


def rate_of_test(problem: Problem, state: ControlState) -> tuple[float, float]:
    """Return attempts per second of voxgran's walk, and the share of accepted ones."""
    advance, attempts = method_registry().get("control_point").advance, 4000
    before, tried = state.moves_accepted, state.moves_tried
    best, _ = best_rate(lambda: advance(problem, state, attempts), attempts, least_time=SECONDS)
    return best, (state.moves_accepted - before) / (state.moves_tried - tried)


def rate_of_peer(
    program: Callable[..., Any], problem: Problem, state: ControlState, *, attempts: int
) -> tuple[float, float]:
    """Return attempts per second of another program from the same places, and the share of accepted ones."""
    setting = precomputed_of(problem, state)
    inside = state.entered == 1
    lower, upper = (np.array(corner, dtype=np.float64) for corner in problem.container.bounds)
    points = problem.points(0, problem.parameters.spacing)
    grains = peers.Grains(
        points, *(state.arrays[name][inside] for name in ("position", "orientation", "step")), lower=lower, upper=upper,
        distance=2 * float(setting.extent[0, 1]),
        longest=min(problem.parameters.step, 0.5 * float(setting.extent[0, 2])),
    )  # fmt: skip
    generator, share = stream(1, "bench moves"), problem.parameters.rotation_share
    best, accepted = best_rate(
        program(grains), attempts, least_time=SECONDS,
        draw=lambda: _draw_moves(generator, len(grains.step), share, grains.radius, attempts),
    )  # fmt: skip
    return best, sum(accepted) / (len(accepted) * attempts)


def _draw_moves(
    generator: np.random.Generator, grains: int, turns: float, radius: float, attempts: int
) -> tuple[Integers, Floats, Floats, Floats]:
    """Draw grains, ways, axes and half angles as the walk does without gravity, for steps of 1."""
    picks = generator.integers(0, grains, attempts)
    ways, axes = generator.normal(size=(2, attempts, 3))
    ways, axes = (vectors / np.linalg.norm(vectors, axis=1)[:, None] for vectors in (ways, axes))
    halves = (generator.random(attempts) - 0.5) / radius * (generator.random(attempts) < turns)
    return picks, ways * generator.random(attempts)[:, None], axes, halves


def measure_speed(shapes: dict[str, Shape], spacings: dict[str, tuple[float, ...]] = SPACINGS) -> list[SpeedRow]:
    """Time the tests of contact and their peers for shapes by name, at spacings of control points in diameters."""
    rows: list[SpeedRow] = []
    for name, shape in shapes.items():
        for spacing in spacings[name]:
            for test in TESTS:
                problem, state = moving_task(shape, spacing, test)
                known = name, len(problem.points(0, spacing))
                rows.append((*known, test, *rate_of_test(problem, state)))
                if test == "kdtree":
                    for program, moves, attempts in zip(
                        PROGRAMS, (peers.tree_moves, peers.grid_moves), (400, 2000), strict=True
                    ):
                        rows.append((*known, program, *rate_of_peer(moves, problem, state, attempts=attempts)))
    return rows


def measure_accuracy(
    shapes: dict[str, Shape], speed: list[SpeedRow], spacings: tuple[float, ...] = ACCURACY_SPACINGS
) -> list[AccuracyRow]:
    """Compare where tests of contact refuse with where true surfaces touch, at these spacings (in diameters) and those
    of :data:`SPACINGS`; the run time is that of the rows of :func:`measure_speed` where a spacing was timed. Lengths
    are in diameters.
    """
    rows: list[AccuracyRow] = []
    for name, shape in shapes.items():
        unit = shape.scaled(1 / shape.diameter)
        for spacing in sorted({*spacings, *SPACINGS.get(name, ())}):
            for test, (contact, ways) in TESTS.items():
                pair = Encounter(unit, unit, contact=contact, ways=ways, spacing=spacing)
                points, gaps = pair.points[0], gaps_at_contact(unit, pair, APPROACHES)
                size = np.abs(gaps)
                timed = [row[3] for row in speed if row[:3] == (name, points, test)]
                micro = 1e6 / timed[0] if timed else float("nan")
                rows.append((name, test, points, spacing, size.mean(), size.max(), max(0.0, -min(gaps)), micro))
    return rows


def gaps_at_contact(shape: Shape, pair: Encounter, many: int) -> Floats:
    """Return the true gaps, (many,), at which two equal grains in random turns were refused, from random sides."""
    generator, gaps = stream(2, "bench approaches"), []
    for _ in range(many):
        turns, way = normalized(generator.normal(size=(2, 4))), generator.normal(size=3)
        way /= np.linalg.norm(way)
        gaps.append(true_gap(shape, turns, way, pair.first_contact(way, turns=turns)))
    return np.array(gaps)


def true_gap(shape: Shape, turns: Floats, way: Floats, offset: Floats) -> float:
    """Return the gap of the true surfaces at a contact; below 0 where they overlap, the way back until they do not.

    Both grains are of one shape: a sphere, a convex mesh or box, or any closed mesh. `turns` (2, 4) are the
    orientations of the standing and of the coming grain, which came along the unit vector `way` and was refused at
    `offset`.
    """
    if getattr(shape.geometry, "kind", "") == "sphere":
        return float(np.linalg.norm(offset)) - shape.diameter
    standing, coming = (shape.vertices @ matrix.T for matrix in rotation_matrices(turns))
    hull = load("scipy.spatial").ConvexHull(shape.vertices)
    if np.isclose(hull.volume, shape.volume, rtol=1e-6):
        corners = (standing[hull.vertices][:, None] - coming[hull.vertices][None]).reshape(-1, 3)
        planes = load("scipy.spatial").ConvexHull(corners).equations
        rise = planes[:, :3] @ way
        ahead = rise > 1e-12
        return float(offset @ way - (-planes[ahead, 3] / rise[ahead]).min())
    return _least_gap(shape, standing, coming, offset, way)


def _least_gap(shape: Shape, standing: Floats, coming: Floats, offset: Floats, way: Floats) -> float:
    """Return the least gap of two closed meshes, or minus the way back until they are apart."""
    manifold = load("manifold3d")
    one, other = (
        manifold.Manifold(manifold.Mesh(corners.astype(np.float32), shape.faces.astype(np.uint32)))
        for corners in (standing, coming)
    )

    def gap(back: float) -> float:
        """Return the gap after a way back, up to a quarter of the diameter."""
        moved = other.translate((offset + back * way).tolist())
        return float(one.min_gap(moved, 0.25 * shape.diameter))

    here = gap(0.0)
    if here > 0.0:
        return here
    low, high = 0.0, 0.25 * shape.diameter
    for _ in range(12):
        middle = (low + high) / 2
        low, high = (low, middle) if gap(middle) > 0.0 else (middle, high)
    return -high


def measure_beds(
    count: int = BED, seeds: tuple[int, ...] = SEEDS, sweeps: tuple[int, ...] = SWEEPS
) -> list[tuple[Any, ...]]:
    """Pack beds of equal spheres; return the box, the bias, the vibration and the sweeps, then means over seeds: CPU
    seconds, bulk solid fraction and its standard error. In the last row of a box, beds as by default have settled.
    """
    rows: list[tuple[Any, ...]] = []
    pack(make_shape("sphere"), BOXES["walls"], method="control_point", count=1)  # loads the kernels
    for name, box in BOXES.items():
        for many, bias, vibration in itertools.product(sweeps, BIASES, SHAKEN):
            given = {"sweeps": many, "gravity_bias": bias, **SHAKEN[vibration], "settle": False}
            rows.append((name, bias, vibration, many, *_mean_bed(box, count, seeds, given)))
        rows.append((name, 0.5, "settled", 100, *_mean_bed(box, count, seeds, {})))
    return rows


def _mean_bed(box: Box, count: int, seeds: tuple[int, ...], given: dict[str, Any]) -> tuple[float, float, float]:
    """Return means over beds, CPU seconds and bulk solid fraction, and the standard error of the latter."""
    sphere, seconds, fractions = make_shape("sphere"), [], []
    for seed in seeds:
        packing, spent = timed(pack, sphere, box, method="control_point", count=count, seed=seed, **given)
        seconds.append(spent)
        fractions.append(float(bulk_solid_fraction(packing)))
    error = float(np.std(fractions, ddof=1)) / len(seeds) ** 0.5 if len(seeds) > 1 else float("nan")
    return float(np.mean(seconds)), float(np.mean(fractions)), error


def bodies() -> dict[str, Shape]:
    """Return the shapes that are timed and compared; the scan where the repository has it."""
    return {"sphere": make_shape("sphere"), "box": make_shape("box", lengths=(1.1, 0.9, 0.7)), **scans("eros.obj")}


def run(folder: Path) -> tuple[Path, ...]:
    """Measure, and write rows as CSV and a figure as SVG."""
    shapes = bodies()
    speed = measure_speed(shapes)
    accuracy = measure_accuracy(shapes, speed, ACCURACY_SPACINGS)
    rates = {row[:3]: row[3] for row in speed}
    rows = [(*row, *ratios(row[3], [rates.get((*row[:2], peer)) for peer in PROGRAMS])) for row in speed]
    figure = folder / "contact.svg"
    _draw(speed, accuracy, figure)
    return (
        write_rows(
            folder / "contact_speed.csv",
            "shape,points,program,attempts_per_second:.0f,accepted:.3f,ratio_to_ckdtree:.1f,ratio_to_numba_grid:.1f",
            rows,
        ),
        write_rows(
            folder / "contact_accuracy.csv",
            "shape,test,points,spacing:g,mean_error:.6f,largest_error:.6f,largest_overlap:.6f,"
            "microseconds_per_attempt:.2f",
            accuracy,
        ),
        write_rows(
            folder / "contact_beds.csv",
            "box,gravity_bias:g,vibration,sweeps,seconds:.2f,bulk_solid_fraction:.4f,standard_error:.4f",
            measure_beds(),
        ),
        figure,
    )


#: how each body is drawn
DASHES = {"sphere": "-", "box": "--", "eros": ":"}


def _draw(speed: list[SpeedRow], accuracy: list[AccuracyRow], path: Path) -> None:
    """Draw rates against points on the left, errors against spacing in the middle and against time on the right."""
    programs, line = (*TESTS, *PROGRAMS), load("matplotlib.lines").Line2D
    with panels_of(path, 3, width=13.2, legend=0) as (left, middle, right):
        for k, program in enumerate(programs):
            for shape, style in DASHES.items():
                found = [(row[1], row[3]) for row in speed if row[0] == shape and row[2] == program]
                own = [row for row in accuracy if row[0] == shape and row[1] == program]
                timed = sorted((row[7], row[4]) for row in own if not np.isnan(row[7]))
                if found:
                    left.loglog(*zip(*found, strict=True), f"C{k}{style}", marker="o")
                if own:
                    middle.loglog([row[3] for row in own], [row[4] for row in own], f"C{k}{style}")
                if timed:
                    right.loglog(*zip(*timed, strict=True), f"C{k}{style}", marker="o")
        error = "mean error of the gap at contact, in diameters"
        left.set(xlabel="control points of a grain", ylabel="attempts per second")
        middle.set(xlabel="spacing of control points, in diameters", ylabel=error)
        right.set(xlabel="microseconds per attempt", ylabel=error)
        for panel in (left, middle, right):
            panel.xaxis.set_minor_formatter(load("matplotlib.ticker").NullFormatter())
        # colors and dashes mean the same in all three
        keys = [line([], [], color=f"C{k}", label=program) for k, program in enumerate(programs)]
        keys += [line([], [], color="black", linestyle=style, label=shape) for shape, style in DASHES.items()]
        left.figure.legend(handles=keys, loc="outside right center", frameon=False, fontsize=8)
