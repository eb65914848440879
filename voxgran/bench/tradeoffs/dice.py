"""Dice: how dense Platonic solids lie by digital and by control-point packing, poured and shaken, against experiments.

The loosest and the densest disordered beds of plastic dice are published for all five solids. A bed stands between
them by its friction, which was not measured, so beds are poured with little friction, with that of plastics, and with
so much that nothing slides. Shaken beds are shaken without friction. All densities are bulk solid fractions of the true
solids, which are compared exactly in the end.

References
----------
Baker & Kudrolli 2010, Maximum and minimum stable random packings of Platonic solids, Physical Review E 82, 061304,
doi:10.1103/PhysRevE.82.061304
"""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from voxgran.bench.model import TradeOff, calibration, panels_of, write_rows
from voxgran.contacts.verify import verify
from voxgran.containers.box import Box
from voxgran.measures.registered.density import bulk_solid_fraction
from voxgran.packing.pack import pack
from voxgran.shapes.family import make_shape

#: loosest and densest beds of dice (Baker & Kudrolli 2010), each to 0.01
PUBLISHED = {
    "tetrahedron": (0.51, 0.64),
    "cube": (0.54, 0.67),
    "octahedron": (0.52, 0.64),
    "dodecahedron": (0.51, 0.63),
    "icosahedron": (0.50, 0.59),
}
#: coefficients of friction with which dice are poured; None: they are shaken, without friction
TREATMENTS = (0.15, 0.5, 3.0, None)
#: how each method walks before the true shapes settle, without vibration
WALKS: dict[str, dict[str, Any]] = {
    "digital": {"voxel_size": 1 / 20, "sweeps": 60, "vibration_up": 0.0, "downward_share": 0.7},
    "control_point": {"spacing": 0.1, "sweeps": 400, "vibration_up": 0.0},
}
#: sweeps of shaking, and its strength in gravities
SHAKING, ACCELERATION = 200, 0.8


class Bed(NamedTuple):
    """A bed: how it was made, seconds, bulk solid fraction, and whether nothing overlaps."""

    method: str
    solid: str
    shaken: bool
    friction: float
    seconds: float
    bulk: float
    apart: bool


def measure_bed(method: str, solid: str, friction: float | None, count: int = 120) -> Bed:
    """Pack a bed of dice by ``"digital"`` or ``"control_point"``: poured with a coefficient of friction, or, where that
    is None, shaken without friction.
    """
    shape, box = make_shape("platonic", solid=solid), Box((4, 4, 6 + count / 9), periodic=(True, True, False))
    finish: dict[str, Any] = {"settling": 400, "friction": friction or 0.0}
    if friction is None:
        finish |= {"shaking": SHAKING, "acceleration": ACCELERATION}
    began = time.perf_counter()
    packing = pack(shape, box, method=method, count=count, seed=1, **finish, **WALKS[method])
    seconds = time.perf_counter() - began
    bulk = float(bulk_solid_fraction(packing))
    return Bed(method, solid, friction is None, friction or 0.0, seconds, bulk, verify(packing).ok)


def write_beds(beds: Sequence[Bed], folder: Path) -> tuple[Path, ...]:
    """Write beds of all solids as CSV and as a figure, and return the files."""
    figure, loop = folder / "dice.svg", calibration()
    head = "method,solid,shaken,friction,seconds,bulk_solid_fraction,apart,published,calibration_seconds"
    lines = [
        f'{bed.method},"{bed.solid}",{str(bed.shaken).lower()},{bed.friction:g},{bed.seconds:.1f},{bed.bulk:.4f},'
        f"{str(bed.apart).lower()},{PUBLISHED[bed.solid][bed.shaken]:.2f},{loop:.5f}"
        for bed in beds
    ]
    _draw(beds, figure)
    return write_rows(folder / "dice.csv", head, lines), figure


def run(folder: Path) -> tuple[Path, ...]:
    """Measure, and write rows as CSV and a figure as SVG."""
    beds = [measure_bed(method, solid, way) for method in WALKS for solid in PUBLISHED for way in TREATMENTS]
    return write_beds(beds, folder)


def _draw(beds: Sequence[Bed], path: Path) -> None:
    """Draw the beds of each method beside what was published."""
    ways = sorted({(bed.shaken, bed.friction) for bed in beds})
    with panels_of(path, len(WALKS), width=10.4, sharey=True) as panels:
        for panel, method in zip(panels, WALKS, strict=True):
            loose, dense = zip(*PUBLISHED.values(), strict=True)
            panel.plot(list(PUBLISHED), loose, "k_", ms=22, label="loosest, published")
            panel.plot(list(PUBLISHED), dense, "k+", ms=14, label="shaken, published")
            for k, (shaken, friction) in enumerate(ways):
                some = [bed for bed in beds if (bed.method, bed.shaken, bed.friction) == (method, shaken, friction)]
                label, mark = ("shaken", "s") if shaken else (f"poured, friction {friction:g}", "o")
                panel.plot([bed.solid for bed in some], [bed.bulk for bed in some], f"C{k}{mark}", ms=5, label=label)
            panel.set_title(method)
            panel.tick_params(axis="x", rotation=20)
        panels[0].set_ylabel("bulk solid fraction")
        keys = panels[0].get_legend_handles_labels()
        panels[0].figure.legend(*keys, loc="outside right center", frameon=False, fontsize=8)


registration = TradeOff(
    name="dice", summary="true densities of Platonic dice, poured and shaken, by two methods", run=run
)
