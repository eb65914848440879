"""Diffusion through pores: seconds and error by the voxels of a diameter, with cells of one to three voxels.

Spheres that do not conduct on a simple cubic lattice have a conductivity in closed form, by a series of high order.
Jammed spheres stand for dense packings; they are compared with cells of three voxels on the finest voxels, whose
numbers change least with the voxels.
"""

from pathlib import Path

import numpy as np

from benchmarks.model import panels_of, timed, write_rows
from voxgran.containers.kinds.box import Box
from voxgran.lattice.diffusion import effective_diffusivity
from voxgran.measures.pores import pores_of
from voxgran.packing.model import Packing
from voxgran.packing.pack import pack
from voxgran.shapes.family import make_shape

#: voxels of a diameter; 20 is the default of the measure
RESOLUTIONS = (10, 20, 40)
#: edge of the box of jammed spheres in diameters, their number, and voxels of a diameter of the image to compare with
EDGE, COUNT, FINEST = 4, 74, 64
#: edge of the box of the lattice in periods, and its solid fraction
PERIODS, FRACTION = 4, 0.4

#: packing, voxels of a diameter, voxels, voxels across a cell, seconds, relative error of the diffusivity
Row = tuple[str, int, int, int, float, float]


def by_poles(fraction: float) -> float:
    """Return the conductivity of a matrix around spheres that do not conduct, on a simple cubic lattice.

    The series of Rayleigh 1892, doi:10.1080/14786449208620364, with the poles of McPhedran & McKenzie 1978,
    doi:10.1098/rspa.1978.0031, by the coefficients of Sangani & Acrivos 1983, doi:10.1098/rspa.1983.0036.
    """
    one, two, three, four, five = (-(2 * n - 1) / (2 * n) for n in range(1, 6))
    f = fraction ** (1 / 3)
    poles = 1.305 * two * f**10 * (1 + 0.231 * three * f**11) / (1 - 0.405 * two * f**7)
    poles += 0.0723 * three * f**14 + 0.153 * four * f**18 + 0.0105 * five * f**22
    return 1 - 3 * fraction / (-1 / one + fraction + poles)


def cubic_lattice(fraction: float = FRACTION, periods: int = PERIODS) -> Packing:
    """Return spheres on a simple cubic lattice of a solid fraction, periodic, which lie anywhere in voxels."""
    period = float((np.pi / 6 / fraction) ** (1 / 3))
    places = np.stack(np.meshgrid(*[np.arange(periods)] * 3, indexing="ij"), axis=-1).reshape(-1, 3) * period
    box = Box((periods * period,) * 3, periodic="xyz")
    return Packing.of(make_shape("sphere"), box, position=places + np.array([0.31, 0.43, 0.57]))


def measured(name: str, packing: Packing, exact: float, resolutions: tuple[int, ...] = RESOLUTIONS) -> list[Row]:
    """Return the rows of a packing whose diffusivity, as the mean of the axes, is known."""
    rows = []
    for resolution in resolutions:
        mask = pores_of(packing, 1 / resolution).mask
        for block in (1, 2, 3):
            effective_diffusivity(mask[:2, :2, :2], block=block)
            found, seconds = timed(effective_diffusivity, mask, periodic="xyz", block=block)
            rows.append((name, resolution, mask.size, block, seconds, float(found.relative.mean()) / exact - 1))
    return rows


def run(folder: Path) -> tuple[Path, ...]:
    """Measure, and write rows as CSV and a figure as SVG."""
    jammed = pack(make_shape("sphere"), Box((EDGE,) * 3, periodic="xyz"), "jam", count=COUNT)
    rows = measured("cubic lattice", cubic_lattice(), by_poles(FRACTION))
    finest = effective_diffusivity(pores_of(jammed, 1 / FINEST).mask, periodic="xyz", block=3)
    rows += measured("jammed spheres", jammed, float(finest.relative.mean()))
    head = "packing,voxels_of_a_diameter,voxels,voxels_across_a_cell,cpu_seconds:.3g,relative_error:.2g"
    draw(rows, folder / "transport.svg")
    return write_rows(folder / "transport.csv", head, rows), folder / "transport.svg"


def draw(rows: list[Row], path: Path) -> None:
    """Draw the errors against the seconds, a line for each packing and width of cells."""
    with panels_of(path, 1, width=6.0) as (panel,):
        for name, block in dict.fromkeys((row[0], row[3]) for row in rows):
            mine = [row for row in rows if (row[0], row[3]) == (name, block)]
            label = f"{name}, cells of {block} voxel{'s' if block > 1 else ''}"
            panel.loglog([row[4] for row in mine], [abs(row[5]) for row in mine], "o-", label=label)
        # room for the legend above the lines
        panel.set(xlabel="CPU seconds", ylabel="relative error of the diffusivity", ylim=(5e-4, 10))
