"""Measures of packings: seconds of each, and the profile of the solid fraction against one by counted points.

Packings are random solids and spheres that touch: jammed in a periodic cell, of which copies lie beside each other in a
box with walls, under gravity. Each measure is computed on a packing of which nothing is known yet, contacts and cut
planes included. The peer counts points: each grain is represented by random points of equal weight in its solid, which
are sorted into the slices of the exact profile; its error is the largest difference of the solid fraction in a slice.
The report is the page of a packing that is measured and verified already.
"""

import math
import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.model import panels_of, timed, write_rows
from voxgran._base.arrays import Floats
from voxgran._base.seeds import stream
from voxgran.contacts.verify import verify
from voxgran.containers.kinds.box import Box
from voxgran.measures.model import measure, measure_registry
from voxgran.measures.registered.profile import axis_profile
from voxgran.packing.model import Packing
from voxgran.packing.pack import pack
from voxgran.report.page import save_report
from voxgran.shapes.family import make_shape, make_shapes
from voxgran.shapes.model import Shape
from voxgran.shapes.sizes import lognormal
from voxgran.voxels.occupy import voxelize

#: numbers of random solids and of spheres, different solids, and numbers of grains in a cell of either, about
SOLIDS, SPHERES, KINDS = 3_000, 200_000, 10
SOLIDS_OF_CELL, SPHERES_OF_CELL = 48, 1_600
#: points of a grain that the peer counts, and voxels of a shape in which they lie
POINTS, VOXELS = (10, 100, 1000), 30_000

#: grains of the packings of which a report is written
REPORTED = 20_000

#: packing, number of grains, what is computed, seconds, largest error of a solid fraction (None where none is known)
Row = tuple[str, int, str, float, float | None]


def packing_of(shapes: list[Shape], count: int, of_cell: int) -> Packing:
    """Return about so many jammed grains: copies of a periodic cell of about `of_cell`, with gravity and walls."""
    many = max(round((count / of_cell) ** (1 / 3)), 1)
    held = round(count / many**3)
    edge = math.cbrt(held)
    cell = pack(shapes, Box((edge,) * 3, periodic="xyz"), "jam", count=held, sizes=lognormal(1.0, 0.1), seed=0)
    steps = np.stack(np.meshgrid(*[np.arange(many)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    # walls lie where no grain of the cells at the sides reaches
    margin, copies = float(cell.bounding_radii.max()), len(steps)
    places = np.mod(cell.position, edge) + steps[:, None] * edge + margin
    return Packing.of(
        cell.shapes,
        Box((many * edge + 2 * margin,) * 3),
        position=places.reshape(-1, 3),
        orientation=np.tile(cell.orientation, (copies, 1)),
        scale=np.tile(cell.scale, copies),
        shape_id=np.tile(cell.shape_id, copies),
        gravity=(0.0, 0.0, -1.0),
        contact_gap=cell.contact_gap,
    )


def packings(solids: int = SOLIDS, spheres: int = SPHERES) -> dict[str, Packing]:
    """Return the packings by their names."""
    shapes = make_shapes("solid_union", count=KINDS, seed=0)
    return {
        "random solids": packing_of(shapes, solids, SOLIDS_OF_CELL),
        "spheres": packing_of([make_shape("sphere")], spheres, SPHERES_OF_CELL),
    }


def measured(name: str, packing: Packing) -> list[Row]:
    """Return the rows of a packing: each usual measure, all together, and profiles by counted points."""
    entries = [measure_registry().get(entry) for entry in measure_registry().names()]
    usual = [entry for entry in entries if entry.usual and entry.applies(packing)]
    rows: list[Row] = [(name, packing.count, one.name, _seconds(one.compute, packing), None) for one in usual]
    rows.append((name, packing.count, "all usual", _seconds(measure, packing), None))
    exact = axis_profile(packing)
    rows.append((name, packing.count, "profile along z", _seconds(axis_profile, packing), 0.0))
    for points in POINTS:
        found, seconds = timed(counted, packing, exact.edges, points)
        error = float(np.abs(found - exact.solid_fraction).max())
        rows.append((name, packing.count, f"profile by {points} points of a grain", seconds, error))
    return rows


def reported(count: int = REPORTED) -> list[Row]:
    """Return the rows of the reports of both kinds of packings, of which measures and verification are known."""
    rows: list[Row] = []
    for name, packing in packings(count, count).items():
        known: dict[str, Any] = {"statistics": measure(packing), "verification": verify(packing)}
        with tempfile.TemporaryDirectory() as folder:
            write = partial(_report, measured=packing, path=Path(folder) / "page.html", **known)
            rows.append((name, packing.count, "report", _seconds(write, packing), None))
    return rows


def _report(packing: Packing, *, measured: Packing, **options: Any) -> None:
    """Write the report of a packing of which contacts were found when it was measured."""
    packing._contacts.update(measured._contacts)
    save_report(packing, overwrite=True, **options)


def counted(packing: Packing, edges: Floats, points: int) -> Floats:
    """Return the solid fractions in slices across z by random points in the grains."""
    held = np.zeros(len(edges) - 1)
    for k, shape in enumerate(packing.shapes):
        mine = np.flatnonzero(packing.shape_id == k)
        voxels, generator = voxelize(shape, voxel_size=math.cbrt(shape.volume / VOXELS)), stream(0, "points", k)
        body = voxels.grid.coordinates(np.argwhere(voxels.mask))
        places = body[generator.integers(len(body), size=(len(mine), points))]
        places += (generator.random(places.shape) - 0.5) * voxels.voxel_size
        rows = packing.matrices[mine, 2] * packing.scale[mine, None]
        heights = np.einsum("gj,gpj->gp", rows, places) + packing.position[mine, 2, None]
        weight = np.repeat(packing.volumes[mine] / points, points)
        held += np.histogram(heights.ravel(), edges, weights=weight)[0]
    return np.asarray(held / (np.diff(edges) * packing.container.volume / np.ptp(edges)))


def _seconds(compute: Callable[[Packing], object], packing: Packing) -> float:
    """Return the least CPU time of three calls after one that is not counted, each on a packing not yet known."""
    return min([timed(compute, replace(packing))[1] for _ in range(4)][1:])


def run(folder: Path) -> tuple[Path, ...]:
    """Measure, and write rows as CSV and a figure as SVG."""
    rows = [row for name, packing in packings().items() for row in measured(name, packing)]
    _draw(rows, folder / "measures.svg")
    head = "packing,grains,computed,cpu_seconds:.3g,largest_error:.2g"
    return write_rows(folder / "measures.csv", head, [*rows, *reported()]), folder / "measures.svg"


def _draw(rows: list[Row], path: Path) -> None:
    """Draw the seconds of the measures, and the error of profiles against their seconds."""
    names = list(dict.fromkeys(row[0] for row in rows))
    with panels_of(path, 2, width=10.0) as (bars, panel):
        labels = list(dict.fromkeys(row[2] for row in rows if row[4] is None))
        for k, name in enumerate(names):
            mine = {row[2]: row for row in rows if row[0] == name}
            heights = [mine[label][3] if label in mine else 0.0 for label in labels]
            label = f"{mine['all usual'][1]} {name}"
            bars.barh(np.arange(len(labels)) + 0.4 * k, heights, height=0.4, label=label)
            points = [row for row in mine.values() if row[4]]
            (line,) = panel.loglog(
                [row[3] for row in points], [row[4] for row in points], "o-", label=f"{label}: points"
            )
            panel.axvline(mine["profile along z"][3], color=line.get_color(), linestyle=":", label=f"{label}: exact")
        bars.set_yticks(np.arange(len(labels)) + 0.2, labels)
        bars.set(xscale="log", xlabel="seconds")
        panel.set(xlabel="seconds for the profile along z", ylabel="largest error of the solid fraction")
