"""Clumps: error against number of spheres against seconds, for all methods, beside two other programs.

Where the interpreter named by the environment variable ``VOXGRAN_PEERS`` has multisphere or clump-python (CLUMP), they
fit the same bodies, as programs of their own. A second row of each is made fair by one change of all radii that gives
the union the volume of the body. Seconds are CPU seconds, without compilation and loading; those of voxgran
include the measurement of the errors.
"""

import logging
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.model import PEERS, least_seconds, panels_of, peer_arrays, scans, write_rows
from voxgran._base.lazy import load
from voxgran.clumps.errors import clump_errors
from voxgran.clumps.fit import clump_methods, fit_clump
from voxgran.clumps.method import Body
from voxgran.clumps.methods.optimal import growth_to_volume
from voxgran.clumps.model import ClumpErrors
from voxgran.clumps.sphere_sets import SphereSet
from voxgran.shapes.family import make_shape
from voxgran.shapes.files import save_shape
from voxgran.shapes.model import Shape
from voxgran.shapes.spheres import Spheres

LOG = logging.getLogger(__name__)
#: numbers of spheres of voxgran's methods, and of other programs, which take longer
COUNTS, PEER_COUNTS = (5, 10, 20, 50, 100, 200), (20, 50)
#: scans that are fitted beside a cube
SCANS = ("eros.obj", "itokawa_lp.obj", "bennu_lp.obj")
#: other programs by the ends of the names of their scripts
PROGRAMS = {"multisphere": "multisphere", "clump": "CLUMP"}
#: errors of the table
ERRORS = ("iou", "volume", "inertia", "surface_mean", "surface_max")
#: number of seeds over which the spread is taken
SEEDS = 5
#: most seconds of one fit of another program
LONGEST = 300.0


class Row(NamedTuple):
    """One fit."""

    program: str
    body: str
    asked: int
    spheres: int
    errors: ClumpErrors
    seconds: float


def bodies() -> dict[str, Shape]:
    """Return the bodies that are fitted, by name: a cube and scans."""
    return {"cube": make_shape("box", lengths=(1.0, 1.0, 1.0)), **scans(*SCANS)}


def measure(solids: dict[str, Shape] | None = None, counts: tuple[int, ...] = COUNTS) -> list[Row]:
    """Fit each body by each method with each number of spheres."""
    rows = []
    for body, shape in (bodies() if solids is None else solids).items():
        for method in clump_methods():
            for count in counts:
                made = fit_clump(shape, method=method, max_spheres=count)
                seconds = least_seconds(
                    lambda: fit_clump(shape, method=method, max_spheres=count),  # noqa: B023
                    repeats=1,
                    processor=True,
                )
                rows.append(Row(method, body, count, made.count, made.errors, seconds))
    return rows


def measure_seeds(solids: dict[str, Shape] | None = None, count: int = 50) -> list[tuple[str, str, float, float]]:
    """Return method, body, and mean and standard deviation of the intersection over union over `SEEDS` seeds."""
    rows = []
    for body, shape in (bodies() if solids is None else solids).items():
        for method in clump_methods():
            found = [fit_clump(shape, method=method, max_spheres=count, seed=s).errors.iou for s in range(SEEDS)]
            rows.append((method, body, float(np.mean(found)), float(np.std(found, ddof=1))))
    return rows


def measure_peers(solids: dict[str, Shape] | None = None, counts: tuple[int, ...] = PEER_COUNTS) -> list[Row]:
    """Fit each body by other programs; those that are not installed are left out."""
    rows = []
    for script, program in PROGRAMS.items():
        for body, shape in (bodies() if solids is None else solids).items():
            for count in counts:
                found = peer_arrays(
                    PEERS / f"clumps_{script}.py", "body.stl", partial(save_shape, shape), str(count), longest=LONGEST
                )
                if found is None:
                    LOG.warning("%s is not installed or failed on %s: its row is left out", program, body)
                    continue
                made, seconds = found
                solid, unit = Body(shape), shape.diameter
                given = SphereSet(made["centers"] / unit, made["radii"] / unit)
                grown = given.radii + growth_to_volume(given, solid.volume)
                for name, size in ((program, given.radii), (f"{program}, same volume", grown)):
                    errors = clump_errors(solid, Spheres(given.centers, size))
                    rows.append(Row(name, body, count, len(size), errors, seconds))
    return rows


def run(folder: Path) -> tuple[Path, ...]:
    """Measure, and write rows as CSV and a figure as SVG."""
    rows = measure() + measure_peers()
    head = (
        "program,body,asked,spheres,iou:.4f,volume_error:.5f,inertia_error:.5f,surface_mean:.5f,surface_max:.5f,"
        "seconds:.3f"
    )
    values = [(*row[:4], *(getattr(row.errors, name) for name in ERRORS), row.seconds) for row in rows]
    _draw(rows, folder / "clumps.svg")
    return (
        write_rows(folder / "clumps.csv", head, values),
        write_rows(folder / "clumps_seeds.csv", "method,body,mean_iou:.4f,standard_deviation:.4f", measure_seeds()),
        folder / "clumps.svg",
    )


def _draw(rows: list[Row], path: Path) -> None:
    """Draw the error of the scans and the cube, as mean, against the number of spheres, and against seconds."""
    with panels_of(path, 2, width=10.4, legend=0) as (left, right):
        for k, program in enumerate(dict.fromkeys(row.program for row in rows)):
            counts = sorted({row.asked for row in rows if row.program == program})
            found = [[row for row in rows if row.program == program and row.asked == count] for count in counts]
            errors = [float(np.mean([1.0 - row.errors.iou for row in group])) for group in found]
            number = [float(np.mean([row.spheres for row in group])) for group in found]
            seconds = [float(np.mean([row.seconds for row in group])) for group in found]
            look = {"marker": "o", "label": program, "color": f"C{k}"}
            left.loglog(number, errors, **look)
            right.loglog(seconds, errors, **look)
        ticks = load("matplotlib.ticker").ScalarFormatter()
        for panel in (left, right):
            panel.yaxis.set_major_formatter(ticks)
            panel.set(ylabel="1 - intersection over union")
        left.set(xlabel="spheres")
        right.set(xlabel="CPU seconds")
        left.legend(frameon=False, fontsize=7)
