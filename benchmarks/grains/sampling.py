"""Points on surfaces: seconds, covering radius and smallest distance by their number, beside Open3D's Poisson disks.

The covering radius is the error: half the spacing that so many points reach. A hexagonal arrangement has 0.62 in units
of the root of the area of a point. Packings in a closed mesh, whose wall is sampled once, are timed beside.
"""

import math
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.model import least_seconds, panels_of, scans, write_rows
from benchmarks.peers import sampling as peers
from voxgran._base.lazy import load
from voxgran.containers.kinds.mesh import ClosedMesh
from voxgran.packing.pack import pack
from voxgran.points.blue_noise import spread_points
from voxgran.points.covering import covering_radius
from voxgran.shapes.family import make_shape

#: numbers of points; scanned body
COUNTS, SCAN = (500, 5_000, 50_000), "itokawa_lp.obj"
#: diameter of the scan as a container, and grains in it
WIDE, GRAINS = 8.0, 20

#: program, shape, points, CPU seconds, covering radius over the root of the area of a point, smallest distance
#: over that of a hexagonal arrangement
Row = tuple[str, str, int, float, float, float]


def measured(counts: tuple[int, ...] = COUNTS) -> list[Row]:
    """Return the rows of voxgran and of Open3D."""
    programs = {"voxgran": spread_points, "Open3D": peers.open3d_points}
    rows = []
    for name, shape in {"box": make_shape("box"), **scans(SCAN)}.items():
        mesh = shape.vertices / shape.diameter, shape.faces
        for count in counts:
            share = shape.surface_area / shape.diameter**2 / count
            for program, sampled in programs.items():
                seconds = least_seconds(lambda: sampled(*mesh, count, seed=0), repeats=1, processor=True)  # noqa: B023
                points = sampled(*mesh, count, seed=0)
                apart = load("scipy.spatial").cKDTree(points).query(points, k=2)[0][:, 1].min()
                error = covering_radius(points, *mesh) / math.sqrt(share)
                rows.append((program, name, count, seconds, error, float(apart / np.sqrt(share * 2 / np.sqrt(3)))))
    return rows


def packed(wide: float = WIDE) -> list[Row]:
    """Return the rows of packings of spheres in the scan: one, and one with another seed; the points are the grains."""
    rows: list[Row] = []
    shape = make_shape("sphere")
    options: dict[str, Any] = {"method": "control_point", "count": GRAINS, "sweeps": 1, "settle": False}
    # kernels are loaded in a container of its own
    first = make_shape("platonic").scaled(wide)
    pack(shape, ClosedMesh(first), seed=0, **options)
    for name, body in scans(SCAN).items():
        container = ClosedMesh(body.scaled(wide / body.diameter))
        for seed, told in enumerate(("first packing", "another seed")):
            began = time.process_time()
            count = pack(shape, container, seed=seed, **options).count
            seconds = time.process_time() - began
            rows.append(("control_point", f"{name}, {told}", count, seconds, math.nan, math.nan))
    return rows


def run(folder: Path) -> tuple[Path, ...]:
    """Measure, and write rows as CSV and a figure as SVG."""
    rows = measured()
    head = "program,shape,points,cpu_seconds:.4f,covering_radius:.3f,smallest_distance:.3f"
    _draw(rows, folder / "sampling.svg")
    return write_rows(folder / "sampling.csv", head, [*rows, *packed()]), folder / "sampling.svg"


def _draw(rows: list[Row], path: Path) -> None:
    """Draw the covering radius, relative to the root of the area of the surface, against seconds."""
    with panels_of(path, 1, width=6.0) as (panel,):
        for program, name in dict.fromkeys(row[:2] for row in rows):
            mine = [row for row in rows if row[:2] == (program, name)]
            radius = [row[4] / math.sqrt(row[2]) for row in mine]
            style = "o-" if program == "voxgran" else "s:"
            panel.loglog([row[3] for row in mine], radius, style, label=f"{program}, {name}")
        panel.set(xlabel="CPU seconds", ylabel="covering radius / root of the area")
