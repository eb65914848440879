"""All sphere methods side by side: solid fraction, coordination, seconds, and the difference to the published value.

Each method packs spheres or, in two dimensions, disks, of equal size, of the sizes that its case gives or of those that
it makes, as many as are asked for. Where a value is published or asked for, `error` is the difference to it: of the
whole periodic container, or of the bulk of beds. Coordination numbers are means over all grains up to three gaps, in
mean diameters. Seconds are CPU seconds, the least of several runs after one that compiles. A second table
has the slopes of the solid fraction of columns in layers.
"""

import math
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.model import panels_of, timed, write_rows
from voxgran._base.errors import PackingWarning
from voxgran.contacts.verify import verify
from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.disk import Disk
from voxgran.containers.kinds.rectangle import Rectangle
from voxgran.containers.kinds.sphere import Sphere
from voxgran.containers.model import Container
from voxgran.measures.registered.coordination import coordination_number
from voxgran.measures.registered.density import bulk_solid_fraction
from voxgran.packing.jamming.multilayer import Multilayer
from voxgran.packing.model import Packing
from voxgran.packing.pack import pack
from voxgran.shapes import sizes
from voxgran.shapes.family import make_shape
from voxgran.shapes.sizes import SizeDistribution

#: numbers of grains; runs of each, of which from MANY grains only one is made
COUNTS, REPEATS, MANY = (1_000, 10_000), 3, 5_000
#: solid fractions and undercompactions of columns whose slopes are measured, and columns of each
LEVELS, UNDERCOMPACTIONS, COLUMNS = (0.50, 0.55, 0.58, 0.61), (0.0, 0.1, 0.15, 0.2), 3
#: gaps up to which grains are neighbours, in mean diameters
GAPS = (1e-6, 1e-3, 1e-2)
#: disks of two sizes, as many of each, which do not crystallize
TWO_SIZES = sizes.discrete([1.0, 1.4], [1, 1])


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """A method with parameters, and what is known of its packings."""

    method: str
    dimension: int = 3
    options: dict[str, Any] = field(default_factory=dict)
    #: solid fraction of the container of equal volume of grains
    room: float
    #: solid fraction that is published, or asked for, and where it comes from
    expected: float | None = None
    source: str = ""
    bed: bool = False  # whether it has a floor and a surface: its solid fraction is that of the bulk
    sizes: SizeDistribution | None = None
    made: bool = False  # whether the method makes the sizes
    walled: bool = False  # whether it needs a floor and a lid
    rounded: bool = False  # whether it needs a round container

    @property
    def name(self) -> str:
        """Method and parameters."""
        told = ", ".join(f"{key}={value}" for key, value in self.options.items())
        return f"{self.method} ({told})" if told else self.method


SATURATED: dict[str, Any] = {"options": {"until": "saturated"}, "source": "Zhang & Torquato 2013"}
DEPOSITED: dict[str, Any] = {"method": "deposition", "bed": True}
#: the cases of the published table
CASES: tuple[Case, ...] = (
    Case(method="rsa", room=0.384, expected=0.3841307, **SATURATED),
    Case(method="advancing_front", options={"mode": "loose"}, room=0.45),
    Case(method="advancing_front", options={"mode": "dense"}, room=0.6),
    Case(method="expand", options={"solid_fraction": 0.55}, room=0.55, expected=0.55, source="asked for"),
    Case(method="jam", room=0.64, expected=0.639, source="O'Hern et al. 2003"),
    Case(
        method="multilayer", options={"solid_fraction": 0.58}, room=0.58, expected=0.58, source="asked for", walled=True
    ),
    Case(room=0.5, expected=0.582, source="Visscher & Bolsterli 1972", **DEPOSITED),
    # its floor is denser, by a power of the height: `python -m benchmarks deposits` compares with what is published
    Case(room=0.13, options={"sticking": 1.0}, **DEPOSITED),
    Case(method="gravity", room=0.45, bed=True),
    Case(method="growth", room=0.2, made=True),
    Case(method="growth", options={"arrival": "continuous"}, room=0.35, made=True),
    Case(method="random_apollonian", room=0.7, made=True),
    Case(method="random_apollonian", options={"shift": 3}, room=0.8, made=True),
    Case(method="apollonian", room=0.9, made=True, rounded=True),
    Case(method="tetrahedral", room=0.6, made=True),
    Case(method="rsa", dimension=2, room=0.547, expected=0.5470735, **SATURATED),
    Case(method="advancing_front", dimension=2, options={"mode": "dense"}, room=0.8),
    Case(method="expand", dimension=2, options={"solid_fraction": 0.75}, room=0.75, expected=0.75, source="asked for"),
    Case(method="jam", dimension=2, room=0.842, sizes=TWO_SIZES, expected=0.841, source="O'Hern et al. 2003"),
    Case(dimension=2, room=0.7, expected=0.82, source="Visscher & Bolsterli 1972", **DEPOSITED),
    Case(method="gravity", dimension=2, room=0.65, bed=True),
    Case(method="growth", dimension=2, room=0.35, made=True),
    Case(method="random_apollonian", dimension=2, room=0.95, made=True),
    Case(method="apollonian", dimension=2, room=0.99, made=True, rounded=True),
    Case(method="tetrahedral", dimension=2, room=0.8, made=True),
)


@dataclass(frozen=True, slots=True)
class Row:
    """What was measured of a case."""

    case: Case
    grains: int
    seconds: float
    solid_fraction: float
    coordination: tuple[float, ...]
    apart: bool  # whether nothing overlaps

    @property
    def error(self) -> float | None:
        """Difference to the value that is published or asked for."""
        return None if self.case.expected is None else self.solid_fraction - self.case.expected


def room_for(case: Case, count: int) -> Container:
    """Return the container in which about so many grains of unit diameter find room: a cube, or a column of a bed."""
    gradation = sizes.fixed() if case.sizes is None else case.sizes
    volume = count * gradation.mean_volume(dimension=case.dimension) / case.room
    if case.rounded:
        return Disk(math.sqrt(volume / math.pi)) if case.dimension == 2 else Sphere(math.cbrt(0.75 * volume / math.pi))
    tall, open_top = 1.5 if case.bed else 1.0, case.bed or case.walled
    edge = (volume / tall) ** (1.0 / case.dimension)
    if case.dimension == 2:
        return Rectangle((edge, tall * edge), "x" if open_top else "xy")
    return Box((edge, edge, tall * edge), "xy" if open_top else "xyz")


def measure(case: Case, count: int, *, repeats: int = REPEATS) -> Row:
    """Pack a case, and measure what it gives."""
    shape, room = make_shape("sphere" if case.dimension == 3 else "disk", diameter=1.0), room_for(case, count)
    many = {"count": count} if case.bed or case.made or case.sizes is not None else {}
    options = {"sizes": case.sizes, **many, **case.options}
    seconds = []
    # that not all grains are placed is what the row says
    with warnings.catch_warnings(action="ignore", category=PackingWarning):
        pack(shape, room_for(case, 100), method=case.method, **{**options, **({"count": 100} if many else {})})
        for _ in range(repeats if count < MANY else 1):
            packing, took = timed(pack, shape, room, method=case.method, **options)
            seconds.append(took)
    return Row(case, packing.count, min(seconds), _solid_fraction(case, packing), *_contacts(packing))


def _solid_fraction(case: Case, packing: Packing) -> float:
    """Return the solid fraction of the container, or of the bulk of a bed."""
    return float(bulk_solid_fraction(packing)) if case.bed else packing.solid_fraction


def _contacts(packing: Packing) -> tuple[tuple[float, ...], bool]:
    """Return the coordination numbers, and whether nothing overlaps."""
    return tuple(coordination_number(packing, GAPS).mean.tolist()), verify(packing).ok


def run(folder: Path) -> tuple[Path, ...]:
    """Measure all cases, and write rows as CSV and a figure as SVG."""
    rows = [measure(case, count) for case in CASES for count in COUNTS]
    head = (
        "dimension,method,grains,cpu_seconds:.4f,solid_fraction:.5f,expected:g,error:.5f,source,"
        + ",".join(f"coordination_{gap:g}:.3f" for gap in GAPS)
        + ",apart"
    )
    table = write_rows(folder / "spheres.csv", head, map(values_of, rows))
    layers_head = "solid_fraction:g,undercompaction:g,slope:.4f,standard_error:.4f"
    layers = write_rows(folder / "spheres_layers.csv", layers_head, slopes())
    _draw(rows, folder / "spheres.svg")
    return table, layers, folder / "spheres.svg"


def slopes() -> list[tuple[float, float, float, float]]:
    """Return the rows of a table of the slopes of columns in layers, means over several with standard errors."""
    rows = []
    for wanted in LEVELS:
        for under in UNDERCOMPACTIONS:
            found = [_column_slope(wanted, under, seed) for seed in range(COLUMNS)]
            error = float(np.std(found, ddof=1)) / math.sqrt(COLUMNS)
            rows.append((wanted, under, float(np.mean(found)), error))
    return rows


def _column_slope(solid_fraction: float, undercompaction: float, seed: int) -> float:
    """Return the change of the solid fraction of a column of layers over its height, 1.5 diameters from both ends."""
    how = Multilayer(undercompaction=undercompaction)
    column = pack(make_shape("sphere"), Box((10, 10, 20), "xy"), how, solid_fraction=solid_fraction, seed=seed)
    height, radius = 20.0, 0.5 * column.diameters
    levels = np.linspace(1.5, height - 1.5, 6)
    # the volume of each sphere below a level in closed form
    cut = np.clip((levels[:, None] - column.position[:, 2]) / radius, -1.0, 1.0)
    below = (math.pi * radius**3 * (cut - cut**3 / 3.0)).sum(axis=1)
    fractions = np.diff(below) / (100.0 * np.diff(levels))
    return float(np.polyfit(0.5 * (levels[1:] + levels[:-1]) / height, fractions, 1)[0])


def values_of(row: Row) -> tuple[Any, ...]:
    """Return a row of the CSV table."""
    case, known = row.case, (row.case.expected, row.error, row.case.source)
    measured = row.grains, row.seconds, row.solid_fraction
    return case.dimension, case.name, *measured, *known, *row.coordination, "yes" if row.apart else "no"


def _draw(rows: list[Row], path: Path) -> None:
    """Draw solid fraction against microseconds per grain, spheres on the left and disks on the right."""
    most = max(COUNTS)
    with panels_of(path, 2, width=10.0, height=8.0, legend=0) as panels:
        for panel, dimension in zip(panels, (3, 2), strict=True):
            here = [row for row in rows if row.case.dimension == dimension]
            for k, name in enumerate(dict.fromkeys(row.case.name for row in here)):
                found = [row for row in here if row.case.name == name and row.grains]
                spots = [(1e6 * row.seconds / row.grains, row.solid_fraction) for row in found]
                marker = "os^Dv<>pP*X"[k % 11]
                panel.semilogx(*zip(*spots, strict=True), f"C{k % 10}-", marker=marker, label=name)
            panel.set(xlabel="CPU microseconds per grain", ylabel="solid fraction")
            panel.set_title(f"{'spheres' if dimension == 3 else 'disks'}, up to {most:,}")
            panel.legend(frameon=False, fontsize=9, loc="upper center", bbox_to_anchor=(0.5, -0.1))
