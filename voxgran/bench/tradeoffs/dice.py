"""Platonic dice by control-point packing: how dense beds become, poured with friction and shaken.

The five solids walk as control points, are parted exactly, and settle as true shapes: poured ones with friction, shaken
ones are pulled and turned each its own way before, without friction. Densities are bulk solid fractions of the true
solids, without overlap, beside those that were measured with plastic dice (Baker & Kudrolli 2010,
doi:10.1103/PhysRevE.82.061304, arXiv:1008.1728; known to 0.01), loose and shaken.
"""

import time
from pathlib import Path
from typing import TypeAlias

from voxgran._base.files import write_text, written_whole
from voxgran._base.lazy import load
from voxgran.bench.model import TradeOff, calibration
from voxgran.containers.box import Box
from voxgran.measure.density import bulk_solid_fraction
from voxgran.packing.pack import pack
from voxgran.packing.verify import verify
from voxgran.shapes.family import make_shape

#: solid, whether it was shaken, seed, processor seconds, bulk solid fraction, overlapping pairs
Row: TypeAlias = tuple[str, bool, int, float, float, int]
#: solid fractions of plastic dice, poured and shaken
MEASURED = {
    "tetrahedron": (0.51, 0.64),
    "cube": (0.54, 0.67),
    "octahedron": (0.52, 0.64),
    "dodecahedron": (0.51, 0.63),
    "icosahedron": (0.50, 0.59),
}
#: friction of poured dice, sweeps of shaking, sweeps of settling at the most
FRICTION, SHAKING, SETTLING = 0.5, 200, 400
SEEDS = (1,)


def measure_dice(
    dice: tuple[str, ...] = tuple(MEASURED), *, count: int = 220, seeds: tuple[int, ...] = SEEDS, sweeps: int = 600,
    shaking: int = SHAKING, settling: int = SETTLING,
) -> list[Row]:  # fmt: skip
    """Pack beds of Platonic dice, poured and shaken.

    Parameters
    ----------
    dice : tuple of str
        The solids.
    count : int
        Dice of a bed.
    seeds : tuple of int
        One bed each.
    sweeps : int
        Of the walk, attempts per grain.
    shaking : int
        Sweeps of shaking.
    settling : int
        Sweeps of settling at the most.

    Returns
    -------
    list of tuple
        Solid, whether it was shaken, seed, processor seconds, bulk solid fraction, pairs that overlap.
    """
    rows: list[Row] = []
    box = Box((5, 5, 8 + count / 18), periodic=(True, True, False))
    for name in dice:
        for shaken in (False, True):
            for seed in seeds:
                began = time.process_time()
                packing = pack(
                    make_shape("platonic", solid=name), box, method="control_point", count=count, seed=seed,
                    sweeps=sweeps, cycles=1, up=0.0, settling=settling, friction=0.0 if shaken else FRICTION,
                    shaking=shaking if shaken else 0,
                )  # fmt: skip
                taken = time.process_time() - began
                dense, proof = float(bulk_solid_fraction(packing)), verify(packing)
                rows.append((name, shaken, seed, taken, dense, proof.overlapping_pairs))
    return rows


def run(folder: Path) -> tuple[Path, ...]:
    """Measure, and write rows as CSV and a figure as SVG."""
    rows, loop = measure_dice(), calibration()
    table, figure = folder / "dice.csv", folder / "dice.svg"
    lines = [
        f"{name},{str(shaken).lower()},{seed},{seconds:.1f},{value:.4f},{MEASURED[name][shaken]:.2f},{pairs},{loop:.5f}"
        for name, shaken, seed, seconds, value, pairs in rows
    ]
    head = "solid,shaken,seed,seconds,bulk_solid_fraction,of_plastic_dice,overlapping_pairs,calibration_seconds"
    write_text(table, "\n".join([head, *lines]) + "\n")
    _draw(rows, figure)
    return table, figure


registration = TradeOff(
    name="dice", summary="densities of Platonic dice by control-point packing, poured and shaken", run=run
)


def _draw(rows: list[Row], path: Path) -> None:
    """Draw what was reached beside what plastic dice reach."""
    figure = load("matplotlib.figure").Figure(figsize=(6.4, 4.0), layout="constrained")
    panel, places = figure.subplots(), {name: k for k, name in enumerate(MEASURED)}
    for shaken, color in ((False, "C0"), (True, "C1")):
        label = "shaken" if shaken else "poured"
        own = [row for row in rows if row[1] == shaken]
        panel.plot([places[row[0]] for row in own], [row[4] for row in own], f"{color}o", label=label)
        real = [MEASURED[name][shaken] for name in places]
        panel.errorbar(
            list(places.values()), real, yerr=0.01, fmt=f"{color}_", markersize=18, capsize=0,
            label=f"plastic dice, {label}",
        )  # fmt: skip
    panel.set_xticks(list(places.values()), list(places), rotation=20)
    panel.set_ylabel("bulk solid fraction")
    panel.grid(visible=True, alpha=0.3)
    panel.legend(frameon=False, fontsize=8)
    with written_whole(path) as draft:
        figure.savefig(draft, format="svg")
