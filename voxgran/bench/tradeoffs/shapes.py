"""Families of shapes: milliseconds to make a shape against the error of its surface.

The error is the relative difference of the surface area, at equal volume, to that of the same shape (of the same seed)
on a much finer mesh; it is 0 where the true geometry is exact: solids in closed form, polyhedra, spheres, voxels. For
solids in closed form the tessellation that stands in for them in pictures and files is not counted.
"""

from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from voxgran.bench.model import TradeOff, panels_of, timed, write_rows
from voxgran.shapes.family import default_families, families, make_shape, seeds_of_shapes
from voxgran.shapes.mesh import Mesh, Surface

#: shapes of each family
COUNT = 20
#: shapes of which the error is measured
COMPARED = 5
#: parameters of a much finer mesh
FINER: dict[str, dict[str, Any]] = {
    "mollon_zhao": {"subdivisions": 6},
    "noise_star": {"subdivisions": 6},
    "solid_union": {"chord_error": 5e-5},
    "spherical_harmonics": {"subdivisions": 6},
    "superquadric": {"tolerance": 1e-4},
    "superspherize": {"longest_edge": 0.02},
    "torus": {"tolerance": 1e-4},
}


@dataclass(frozen=True, slots=True)
class Row:
    """Median CPU time of a shape of a family in milliseconds, its median number of faces, and its error."""

    family: str
    dimension: int
    milliseconds: float
    faces: int
    error: float


def run(folder: Path) -> tuple[Path, ...]:
    """Write shapes.csv and shapes.svg into a folder and return both."""
    rows = [row_of(name) for name in default_families()]
    head = "family,dimension,milliseconds:.3g,faces,error:.2g"
    table = write_rows(folder / "shapes.csv", head, map(astuple, rows))
    _draw(rows, folder / "shapes.svg")
    return table, folder / "shapes.svg"


def row_of(family: str) -> Row:
    """Return the row of a family, with its default parameters."""
    seeds = seeds_of_shapes(0, COUNT)
    make_shape(family)
    made, times = zip(*(timed(make_shape, family, seed=seed) for seed in seeds), strict=True)
    meshes = [shape for shape in made if isinstance(shape.geometry, Mesh | Surface)]
    faces = int(np.median([len(shape.faces) for shape in meshes])) if meshes else 0
    errors = [0.0]
    if family in FINER:
        chosen = seeds[: COMPARED if families().get(family).random else 1]
        pairs = ((make_shape(family, seed=s), make_shape(family, seed=s, **FINER[family])) for s in chosen)
        errors = [abs(shape.surface_area / finer.surface_area - 1.0) for shape, finer in pairs]
    return Row(family, families().get(family).dimension, 1e3 * float(np.median(times)), faces, float(np.median(errors)))


def _draw(rows: list[Row], path: Path) -> None:
    """Draw the time of each family on the left, and the error of those that are not exact against it on the right."""
    rows = sorted(rows, key=lambda row: -row.milliseconds)
    with panels_of(path, 2, width=11.0, height=7.5) as (times, errors):
        for place, row in enumerate(rows):
            times.plot(row.milliseconds, place, "o", color="#2f6f8f" if row.error else "#8f8f8f")
            if row.error:
                errors.plot(row.milliseconds, row.error, "o", color="#2f6f8f")
                place_of_name = {"xytext": (5, 5), "textcoords": "offset points", "fontsize": 9}
                errors.annotate(row.family, (row.milliseconds, row.error), **place_of_name)
        times.set_yticks(range(len(rows)), [row.family for row in rows], fontsize=9)
        times.set(xscale="log", xlabel="milliseconds for a shape", title="families of shapes (grey: exact)")
        errors.set(xscale="log", yscale="log", xlabel="milliseconds for a shape", ylabel="error of the surface area")
        # room for the names behind the last points
        errors.set_xlim(right=8.0 * max(row.milliseconds for row in rows))


registration = TradeOff(summary="families of shapes: milliseconds against the error of the surface", run=run)
