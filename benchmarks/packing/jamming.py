"""Jamming of true shapes: solid fraction against seconds, by the rate at which the grains grow.

Equal grains in a periodic cube. Published values are those of slow compression: of very many grains, and for solids
with faces of states that have begun to order. Seconds are CPU seconds, after a run that compiles.
"""

import warnings
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any

from benchmarks.model import panels_of, scans, timed, write_rows
from voxgran._base.errors import PackingWarning
from voxgran.contacts.verify import verify
from voxgran.containers.kinds.box import Box
from voxgran.packing.pack import pack
from voxgran.shapes.family import make_shape
from voxgran.shapes.model import Shape
from voxgran.shapes.sizes import fixed

#: grains of a run, and of one of scanned bodies
COUNT, SCANNED = 200, 40
#: rates of growth
RATES = (1.0, 0.1, 0.01)
#: shapes: family, parameters, and what is published
SHAPES: dict[str, tuple[str, dict[str, Any], float | None, str]] = {
    "ellipsoid 1.25:1:0.8": ("ellipsoid", {"semi_axes": (1.25, 1.0, 0.8)}, 0.735, "Donev et al. 2004"),
    "spherocylinder 1.45": ("spherocylinder", {"aspect": 1.45}, 0.721, "PMC10405222"),
    "tetrahedron": ("platonic", {"solid": "tetrahedron"}, 0.763, "Jiao & Torquato 2011"),
    "octahedron": ("platonic", {"solid": "octahedron"}, 0.697, "Jiao & Torquato 2011"),
    "dodecahedron": ("platonic", {"solid": "dodecahedron"}, 0.716, "Jiao & Torquato 2011"),
    "icosahedron": ("platonic", {"solid": "icosahedron"}, 0.707, "Jiao & Torquato 2011"),
    "cube": ("box", {"lengths": (1.0, 1.0, 1.0)}, None, ""),
}


@dataclass(frozen=True, slots=True)
class Row:
    """What was measured of a shape at a rate of growth."""

    shape: str
    rate: float
    grains: int
    seconds: float
    solid_fraction: float
    apart: bool  # whether nothing overlaps


def run(folder: Path) -> tuple[Path, ...]:
    """Write jamming.csv and jamming.svg into a folder and return both."""
    made = {name: make_shape(family, **options) for name, (family, options, _, _) in SHAPES.items()}
    rows = [row for name, shape in made.items() for row in rows_of(name, shape, COUNT)]
    for name, body in scans("eros.obj").items():
        rows += rows_of(name, body.scaled(1.0 / body.diameter), SCANNED)
    head = "shape,growth_rate:g,grains,cpu_seconds:.2f,solid_fraction:.4f,published:g,source,apart"
    table = write_rows(folder / "jamming.csv", head, map(_values, rows))
    _draw(rows, folder / "jamming.svg")
    return table, folder / "jamming.svg"


def rows_of(name: str, shape: Shape, count: int) -> list[Row]:
    """Return the rows of a shape: as many grains jam at each rate of growth."""
    rows = []
    edge = (2.0 * count * shape.volume) ** (1 / 3)
    with warnings.catch_warnings(action="ignore", category=PackingWarning):
        pack(shape, Box((edge,) * 3, "xyz"), "jam", count=4, sizes=fixed(shape.diameter), growth_rate=1.0)
        for rate in RATES:
            packing, seconds = timed(
                pack, shape, Box((edge,) * 3, "xyz"), "jam", count=count, sizes=fixed(shape.diameter), growth_rate=rate
            )
            rows.append(Row(name, rate, packing.count, seconds, packing.solid_fraction, verify(packing).ok))
    return rows


def _values(row: Row) -> tuple[Any, ...]:
    """Return a row of the table."""
    *values, apart = astuple(row)
    return *values, *SHAPES.get(row.shape, (None, ""))[-2:], "yes" if apart else "no"


def _draw(rows: list[Row], path: Path) -> None:
    """Draw solid fraction against seconds."""
    with panels_of(path, 1, width=8.0, height=5.0) as panels:
        for name in dict.fromkeys(row.shape for row in rows):
            here = [row for row in rows if row.shape == name]
            panels[0].semilogx([row.seconds for row in here], [row.solid_fraction for row in here], "o-", label=name)
        panels[0].set(xlabel="CPU seconds", ylabel="solid fraction", title="jamming: faster and slower growth")
