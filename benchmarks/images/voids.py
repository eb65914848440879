"""Pore space: seconds and errors of its measures by the voxels of a diameter.

Spheres on a cubic lattice touch; their largest pore has the diameter sqrt(3) - 1, and all pores are connected. Random
polyhedra stand for true shapes. On lines along an axis each convex grain ends one chord of the pores in the area of its
projection: the mean chord is the volume of the pores over the sum of these areas. The error stated is the largest
standard error of the mean chords, relative to them.
"""

import math
from pathlib import Path

import numpy as np

from benchmarks.model import panels_of, timed, write_rows
from voxgran._base.arrays import Floats
from voxgran.containers.kinds.box import Box
from voxgran.measures.registered.voids import voids
from voxgran.packing.model import Packing
from voxgran.packing.pack import pack
from voxgran.shapes.family import make_shape, make_shapes

#: voxels of a diameter; the middle one is the default
RESOLUTIONS = (10, 20, 40)
#: edge of the boxes in diameters, and number of polyhedra
EDGE, POLYHEDRA = 4, 40

#: place of the first sphere
OFFSET = (0.31, 0.43, 0.57)

#: packing, voxels of a diameter, seconds, error of the mean chords, error stated, error of the largest pore (None where
#: it is not known), share of the pores that is not connected
Row = tuple[str, int, float, float, float, float | None, float]


def cubic_lattice(edge: int = EDGE) -> Packing:
    """Return touching spheres of diameter 1 on a cubic lattice, periodic, whose pores lie anywhere in voxels."""
    places = np.stack(np.meshgrid(*[np.arange(edge)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    return Packing.of(make_shape("sphere"), Box((edge,) * 3, periodic="xyz"), position=places + OFFSET)


def polyhedra(count: int = POLYHEDRA, edge: int = EDGE) -> Packing:
    """Return random polyhedra by random addition, periodic."""
    return pack(make_shapes("polyhedron", count=5), Box((edge,) * 3, periodic="xyz"), "rsa", count=count)


def mean_chords(packing: Packing) -> Floats:
    """Return the exact mean chords of the pores along the axes, (3,), between convex grains in a periodic box."""
    areas = np.zeros(3)
    for grain in range(packing.count):
        shape = packing.shapes[packing.shape_id[grain]]
        if shape.is_sphere:
            areas += math.pi / 4 * packing.diameters[grain] ** 2
            continue
        a, b, c = np.moveaxis(packing.world_vertices(grain)[shape.faces], 1, 0)
        areas += np.abs(np.cross(b - a, c - a)).sum(axis=0) / 4
    volume = packing.container.volume
    return np.asarray((1 - packing.solid_fraction) * volume / areas)


def measured(
    name: str, packing: Packing, widest: float | None, resolutions: tuple[int, ...] = RESOLUTIONS
) -> list[Row]:
    """Return the rows of a packing; `widest` is the diameter of its largest pore, None where it is not known."""
    exact, rows = mean_chords(packing), []
    for resolution in resolutions:
        voxel = float(packing.diameters.mean()) / resolution
        voids(packing, voxel_size=voxel)
        found, seconds = timed(voids, packing, voxel_size=voxel)
        chords = np.array([chords.mean for chords in found.chords])
        stated = max(chords.error / chords.mean for chords in found.chords)
        error = float(np.abs(chords / exact - 1).max())
        pore = None if widest is None else abs(float(found.sizes.max()) / widest - 1)
        rows.append((name, resolution, seconds, error, stated, pore, 1 - min(found.percolating)))
    return rows


def run(folder: Path) -> tuple[Path, ...]:
    """Measure, and write rows as CSV and a figure as SVG."""
    rows = [*measured("cubic lattice", cubic_lattice(), math.sqrt(3) - 1), *measured("polyhedra", polyhedra(), None)]
    _draw(rows, folder / "voids.svg")
    head = (
        "packing,voxels_of_a_diameter,cpu_seconds:.3g,mean_chord_error:.2g,stated_error:.2g,"
        "largest_pore_error:.2g,share_not_connected:.2g"
    )
    return write_rows(folder / "voids.csv", head, rows), folder / "voids.svg"


def _draw(rows: list[Row], path: Path) -> None:
    """Draw errors against seconds."""
    with panels_of(path, 1, width=6.0) as (panel,):
        for name in dict.fromkeys(row[0] for row in rows):
            mine = [row for row in rows if row[0] == name]
            seconds = [row[2] for row in mine]
            panel.loglog(seconds, [row[3] for row in mine], "o-", label=f"{name}: mean chord")
            if mine[0][5] is not None:
                panel.loglog(seconds, [row[5] for row in mine], "s--", label=f"{name}: largest pore")
        panel.xaxis.set_minor_formatter("")
        panel.set(xlabel="CPU seconds", ylabel="relative error")
