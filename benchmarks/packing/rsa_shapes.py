"""Random sequential addition of true shapes, extrapolated to saturation: solid fractions beside the published ones.

Runs of true shapes end before saturation, which is not proven. What is missing goes with a power of the tries (Feder
1980), whose limit, factor and exponent are fitted to the mean of several runs in periodic containers, from EARLIEST
tries per volume of a grain on. Tries are counted as if the whole container were tried: throws into the cells that are
still open are divided by the share of these. The standard error is that of the limit, by leaving out one run after the
other (jackknife).

References
----------
Feder 1980, Journal of Theoretical Biology 87, 237, doi:10.1016/0022-5193(80)90358-6.
"""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.model import panels_of, timed, write_rows
from voxgran._base.arrays import Floats
from voxgran._base.lazy import load
from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.rectangle import Rectangle
from voxgran.containers.model import Container
from voxgran.packing.draw import Request
from voxgran.packing.pack import prepare_task
from voxgran.packing.rsa.available_cells import Open, all_edges
from voxgran.shapes.family import make_shape
from voxgran.shapes.model import Shape

#: runs of each case; tries per volume of a grain from which the law is fitted, and points of the fit
RUNS, EARLIEST, POINTS = 6, 5.0, 24
#: bounds of the limit, the factor and the inverse exponent
BOUNDS = ((0.0, 0.0, 1.0), (1.0, 10.0, 30.0))
#: corners of a polygon in place of an ellipse
CORNERS = 48


def ellipse(ratio: float) -> Shape:
    """Return a polygon with the area 1 and the corners of an ellipse of such a ratio of the axes."""
    turns = 2.0 * math.pi / CORNERS * np.arange(CORNERS)
    area = 0.5 * CORNERS * math.sin(2.0 * math.pi / CORNERS)
    corners = np.column_stack([math.sqrt(ratio) * np.cos(turns), np.sin(turns) / math.sqrt(ratio)]) / math.sqrt(area)
    return make_shape("polygon", vertices=corners.tolist())


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """A shape, and what is published of its saturated packings."""

    name: str
    family: str
    parameters: dict[str, Any] = field(default_factory=dict)
    ratio: float = 0.0  # of the axes of an ellipse
    grains: int = 1000  # about so many, at a solid fraction of 0.4 in space and 0.55 in the plane
    attempts: int
    published: float | None = None
    error: float = 0.0
    source: str = ""

    @property
    def shape(self) -> Shape:
        """The shape."""
        return ellipse(self.ratio) if self.ratio else make_shape(self.family, **self.parameters)

    @property
    def room(self) -> Container:
        """A periodic container."""
        shape = self.shape
        if shape.dimension == 2:
            return Rectangle((math.sqrt(self.grains * shape.volume / 0.55),) * 2, "xy")
        return Box((math.cbrt(self.grains * shape.volume / 0.4),) * 3, "xyz")


SQUARE = {"vertices": ((0, 0), (1, 0), (1, 1), (0, 1))}
FLAT: dict[str, Any] = {"family": "polygon", "attempts": 3_000_000}
SPHEROID: dict[str, Any] = {"family": "ellipsoid", "attempts": 3_000_000}
CASES: tuple[Case, ...] = (
    Case(name="square", parameters=SQUARE, published=0.5276, error=5e-5, source="Zhang 2018", **FLAT),
    Case(name="ellipse 1.85", ratio=1.85, published=0.584, error=2e-5, source="Ciesla Pajak & Ziff 2016", **FLAT),
    Case(
        name="cube",
        family="box",
        parameters={"lengths": (1, 1, 1)},
        attempts=3_000_000,
        published=0.3686,
        error=0.0015,
        source="Ciesla & Kubala 2018",
    ),
    Case(
        name="cuboid 1.4",
        family="box",
        parameters={"lengths": (1, 1, 1.4)},
        attempts=3_000_000,
        published=0.4,
        error=0.002,
        source="Kubala & Ciesla arXiv:1804.09510",
    ),
    Case(
        name="spheroid 1.01",
        parameters={"semi_axes": (1.01, 1, 1)},
        published=0.38413,
        source="spheres: Zhang & Torquato 2013",
        **SPHEROID,
    ),
    Case(name="spheroid 1.5", parameters={"semi_axes": (1.5, 1, 1)}, **SPHEROID),
    Case(name="spheroid 0.67", parameters={"semi_axes": (1, 1.5, 1.5)}, **SPHEROID),
    Case(name="ellipsoid 1.5 1.25 1", parameters={"semi_axes": (1.5, 1.25, 1)}, **SPHEROID),
)


def kinetics(shape: Shape, room: Container, seed: int, attempts: int) -> Floats:
    """Return the tries per volume of a grain and the solid fractions during a run, (2, k)."""
    rules = {"until": "saturated", "tries": 10**6}
    task = prepare_task(Request(shape, room, "rsa", seed=seed, parameters=rules, settle=False))
    problem = task.problem
    state, tries, rows = task.method.prepare(problem), 0.0, []
    grain, along = problem.volumes[0], slice(0, room.dimension)
    while state.done < attempts and not state.stop_reason:
        before, known = state.done, Open(*(state.arrays[name] for name in Open._fields))
        cell = all_edges(state.derived["precomputed"].classes, known)[0, along].prod()
        state = task.method.advance(problem, state, max(200, state.done // 20))
        tries += (state.done - before) * grain / (known.bounds[1] * cell)
        rows.append((tries, state.counters["placed"] * grain / problem.container.volume))
    return np.array(rows).T


def extrapolated(runs: list[Floats]) -> tuple[float, float, float, float, float]:
    """Return the limit of several runs, its standard error, the exponent, and the last tries and solid fraction."""
    times = np.geomspace(EARLIEST, min(run[0, -1] for run in runs), POINTS)
    curves = np.array([np.interp(np.log(times), np.log(run[0]), run[1]) for run in runs])
    limit, exponent = _fit(times, curves.mean(axis=0))
    error = 0.0
    if len(runs) > 1:
        others = np.array([_fit(times, np.delete(curves, k, axis=0).mean(axis=0))[0] for k in range(len(runs))])
        error = math.sqrt((len(runs) - 1.0) / len(runs) * float(((others - others.mean()) ** 2).sum()))
    return limit, error, exponent, float(times[-1]), float(curves[:, -1].mean())


def _fit(times: Floats, found: Floats) -> tuple[float, float]:
    """Return the limit and the exponent of a power law of what is missing."""
    start = (min(1.05 * found[-1], 0.99), 0.2, 5.0)
    fitted = load("scipy.optimize").curve_fit(_law, times, found, p0=start, bounds=BOUNDS)[0]
    return float(fitted[0]), -1.0 / float(fitted[2])


def _law(tries: Floats, limit: float, factor: float, power: float) -> Floats:
    """Return the solid fractions after so many tries."""
    return np.asarray(limit - factor * tries ** (-1.0 / power))


def run(folder: Path) -> tuple[Path, ...]:
    """Measure, and write rows as CSV and a figure as SVG."""
    rows, found = [], {}
    for case in CASES:
        timed_runs = [timed(kinetics, case.shape, case.room, seed, case.attempts) for seed in range(RUNS)]
        found[case.name] = [run for run, _ in timed_runs]
        limit, error, exponent, tries, last = extrapolated(found[case.name])
        known = case.published, case.error or None, case.source
        seconds = sum(took for _, took in timed_runs)
        rows.append((case.name, RUNS, case.grains, seconds, tries, last, limit, error, exponent, *known))
    head = (
        "shape,runs,grains,cpu_seconds:.1f,tries:.0f,solid_fraction:.4f,extrapolated:.4f,standard_error:.4f,"
        "exponent:.3f,published:g,published_error,source"
    )
    _draw(found, folder / "rsa_shapes.svg")
    return write_rows(folder / "rsa_shapes.csv", head, rows), folder / "rsa_shapes.svg"


def _draw(found: dict[str, list[Floats]], path: Path) -> None:
    """Draw the mean solid fractions against the tries."""
    with panels_of(path, 1, width=7.0) as (panel,):
        for name, runs in found.items():
            times = np.geomspace(EARLIEST, min(run[0, -1] for run in runs), POINTS)
            panel.semilogx(times, np.mean([np.interp(times, *run) for run in runs], axis=0), label=name)
        panel.set(xlabel="tries per volume of a grain", ylabel="solid fraction")
