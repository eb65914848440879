"""Dice: how dense Platonic solids lie, poured and shaken, with one coefficient of friction, against experiments.

The loosest and the densest disordered beds of plastic dice are published for all five solids. Beds are packed by
several methods and settle with the same friction; the same beds are then shaken. All densities are bulk solid fractions
of the true solids.

References
----------
Baker & Kudrolli 2010, Maximum and minimum stable random packings of Platonic solids, Physical Review E 82, 061304,
doi:10.1103/PhysRevE.82.061304
"""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.model import panels_of, write_rows
from voxgran.contacts.verify import verify
from voxgran.containers.kinds.box import Box
from voxgran.measures.registered.density import bulk_solid_fraction
from voxgran.packing.pack import pack
from voxgran.packing.settle import settle
from voxgran.settling.parameters import Shaking
from voxgran.shapes.family import make_shape

#: loosest and densest beds of dice (Baker & Kudrolli 2010), each to 0.01
PUBLISHED = {
    "tetrahedron": (0.51, 0.64),
    "cube": (0.54, 0.67),
    "octahedron": (0.52, 0.64),
    "dodecahedron": (0.51, 0.63),
    "icosahedron": (0.50, 0.59),
}
#: methods whose beds settle
METHODS = ("gravity", "digital", "control_point")
#: coefficient of friction of all solids, and how the poured beds are shaken
FRICTION, SHAKING = 0.5, Shaking(acceleration=1.0, duration=30.0)


class Bed(NamedTuple):
    """A bed: how it was made, seconds, bulk solid fraction, whether nothing overlaps, and the share of grains that are
    proven to rest.
    """

    method: str
    solid: str
    shaken: bool
    seconds: float
    bulk: float
    apart: bool
    resting: float


def measure_beds(method: str, solid: str, count: int = 120) -> list[Bed]:
    """Pour a bed of dice by a method, one of :data:`METHODS`, and then shake it; return both beds."""
    shape, box = make_shape("platonic", solid=solid), Box((4, 4, 6 + count / 9), periodic=(True, True, False))
    began, beds = time.process_time(), []
    # parameters of a method that settles itself, or of the settling after it
    how: dict[str, Any] = {"friction": FRICTION}
    poured = pack(shape, box, method=method, count=count, seed=1, **(how if method == "gravity" else {"settle": how}))
    for shaken in (False, True):
        packing = settle(poured, friction=FRICTION, shaking=SHAKING, seed=1) if shaken else poured
        seconds, bulk = time.process_time() - began, float(bulk_solid_fraction(packing))
        resting = float(packing.provenance["settling"]["resting"])
        beds.append(Bed(method, solid, shaken, seconds, bulk, verify(packing).ok, resting))
    return beds


def write_beds(beds: Sequence[Bed], folder: Path) -> tuple[Path, ...]:
    """Write beds of all solids as CSV and as a figure, and return the files."""
    figure = folder / "dice.svg"
    head = "method,solid,shaken,friction:g,seconds:.1f,bulk_solid_fraction:.4f,apart,resting:.3f,published:.2f"
    rows = [(*bed[:3], FRICTION, *bed[3:], PUBLISHED[bed.solid][bed.shaken]) for bed in beds]
    _draw(beds, figure)
    return write_rows(folder / "dice.csv", head, rows), figure


def run(folder: Path) -> tuple[Path, ...]:
    """Measure, and write rows as CSV and a figure as SVG."""
    beds = [bed for method in METHODS for solid in PUBLISHED for bed in measure_beds(method, solid)]
    return write_beds(beds, folder)


def _draw(beds: Sequence[Bed], path: Path) -> None:
    """Draw the beds of each method beside what was published."""
    with panels_of(path, len(METHODS), width=13.2, sharey=True, legend=0) as panels:
        for panel, method in zip(panels, METHODS, strict=True):
            loose, dense = zip(*PUBLISHED.values(), strict=True)
            panel.plot(list(PUBLISHED), loose, "k_", ms=22, label="loosest, published")
            panel.plot(list(PUBLISHED), dense, "k+", ms=14, label="shaken, published")
            for shaken, label, mark in ((False, "poured", "C0o"), (True, "shaken", "C1s")):
                some = [bed for bed in beds if (bed.method, bed.shaken) == (method, shaken)]
                panel.plot([bed.solid for bed in some], [bed.bulk for bed in some], mark, ms=5, label=label)
            panel.set_title(method)
            panel.tick_params(axis="x", rotation=20)
        panels[0].set_ylabel("bulk solid fraction")
        keys = panels[0].get_legend_handles_labels()
        panels[0].figure.legend(*keys, loc="outside right center", frameon=False, fontsize=8)
