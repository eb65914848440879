"""Compression: time, density and proof of balance of specimens under a stress, beside LAMMPS and published values.

Grains that `rsa` has placed loosely are compressed. Times are CPU seconds on one thread, without
compilation. Where the interpreter named by the environment variable ``VOXGRAN_PEERS`` has LAMMPS, its barostat
compresses the same grains from the same places. All specimens are judged by the same ruler: `equilibrium` under the
axial stresses that were asked for. Of many small specimens of four shapes it is counted how they end and, where
Clarabel is there, an interior point for cones, how many of those in balance it confirms.
"""

import itertools
import time
import warnings
from collections.abc import Callable
from dataclasses import astuple, dataclass, fields
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.model import LOG, PEERS, panels_of, peer_arrays, write_rows
from benchmarks.settling.settle import TOUCHING, peer_packing, polyhedra, rocks, spheres
from voxgran._base.errors import PackingWarning
from voxgran.contacts.verify import verify
from voxgran.containers.kinds.box import Box
from voxgran.containers.model import periods_of
from voxgran.geometry.periods import nearest_turns
from voxgran.packing.compress import compress
from voxgran.packing.jamming.expected import expected_solid_fraction
from voxgran.packing.model import Packing
from voxgran.packing.pack import pack
from voxgran.settling.compression import FRICTIONAL
from voxgran.settling.equilibrium import equilibrium
from voxgran.shapes.family import make_shape
from voxgran.shapes.model import Shape
from voxgran.shapes.sizes import SizeDistribution, discrete, lognormal

#: share of the number of grains of each case that is compressed
SIZE = 1.0
#: normal force, in mean ones, from which on a contact counts
BEARS = 1e-3
#: seconds after which the peer is stopped
LONGEST = 300
#: solid fractions and contacts of the grains that bear forces, by friction, of equal spheres that are compressed
#: isotropically (Agnolin & Roux 2007, doi:10.1103/PhysRevE.76.061302, abstract)
PUBLISHED = {0.0: (0.639, 6.0), 0.3: (0.593, 4.5)}


@dataclass(frozen=True, slots=True)
class Case:
    """Grains that are compressed."""

    name: str
    shapes: Callable[[], list[Shape]] = spheres
    count: int = 1000
    friction: float = 0.5
    rate: float | None = None
    stress: tuple[float, float, float] = (1.0, 1.0, 1.0)
    axes: str = "xyz"
    sizes: SizeDistribution | None = None
    loose: float = 0.3  # solid fraction of the start
    peer: bool = False  # whether LAMMPS compresses the same grains


@dataclass(frozen=True, slots=True)
class Row:
    """What was measured of a specimen."""

    specimen: str
    program: str
    friction: float
    rate: float | str
    grains: int
    seconds: float
    solid_fraction: float
    coordination_by_forces: float  # of the grains that bear forces
    share_of_rattlers: float
    share_in_balance: float  # of the grains that bear forces
    stress_error: float
    deepest_overlap: float  # in mean diameters
    published_solid_fraction: float | str
    published_coordination: float | str


@dataclass(frozen=True, slots=True)
class Start:
    """Density of specimens of 1,000 equal spheres by how loose they began, with friction 0.5."""

    start: float  # solid fraction
    solid_fraction: float
    solid_fraction_error: float  # standard error of the mean over the seeds
    seeds: int


@dataclass(frozen=True, slots=True)
class Ends:
    """How specimens of one shape, friction and ratio of the largest to the least axial stress end."""

    shape: str
    friction: float
    ratio: float
    runs: int
    compressed: int
    yielded: int
    steps: int  # runs that end with the largest number of steps
    confirmed: int | str  # of those that are compressed
    beyond_limit: int | str  # of those that yield: their contacts bear more equal stresses only


#: frictions and ratios of these specimens, and the solid fraction of their starts
FRICTIONS, RATIOS, THIN = (0.0, 0.1, 0.3, 0.5, 1.0), (1.0, 1.5, 2.5), 0.2
#: frictions of specimens by their number of grains
COUNTS = {70: FRICTIONS, 300: (0.1, 0.3, 0.5, 1.0), 1000: (0.3, 0.5)}
#: the same of cylinders, which take longest
FEWER = {70: FRICTIONS, 300: (0.5, 1.0)}
#: gaps, in diameters, up to which contacts of a specimen that yields count: the first with which it bears any stress
REACHES = (TOUCHING, 3e-3, 1e-2)
#: grains from which on specimens are compressed in periodic cells only
MANY = 300
#: residual of a grain in balance to what an interior point leaves, and the least share
RESIDUAL, REST = 0.0101, 0.98
#: solid fractions of starts, and how many specimens of each are compressed
STARTS, SEEDS = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5), 8
HEAD = ",".join(f"{field.name}:.4g" if field.type is float else field.name for field in fields(Row))
EQUAL = "equal spheres"
CASES = (
    *(Case(EQUAL, friction=friction, peer=friction in (0.5, 0.0)) for friction in (1.0, 0.5, 0.3, 0.1, 0.0)),
    *(Case(EQUAL, rate=rate) for rate in (3e-2, 3e-4, 3e-5)),
    *(
        Case(name, sizes=sizes, loose=0.25, friction=friction, peer=friction == 0.0 and "1.4" in name)
        for name, sizes in (
            ("lognormal spheres, sigma 0.3", lognormal(1.0, 0.3)),
            ("as many spheres of diameter 1 and 1.4", discrete([1.0, 1.4], [0.5, 0.5])),
        )
        for friction in (0.5, 0.0)
    ),
    Case("equal spheres, along z only", axes="z"),
    Case("equal spheres, stress 0.7 : 0.7 : 1", stress=(0.7, 0.7, 1.0)),
    Case(EQUAL, count=10_000),
    Case("convex polyhedra", polyhedra, 300),
    Case("rocks", rocks, 300, loose=0.2),
)


def loose_grains(case: Case, count: int) -> Packing:
    """Return grains apart from each other in a periodic cube, which all programs compress."""
    volume = count * (np.pi / 6.0 if case.sizes is None else case.sizes.mean_volume())
    cube = Box(((volume / case.loose) ** (1.0 / 3.0),) * 3, periodic="xyz")
    return pack(case.shapes(), cube, method="rsa", count=count, sizes=case.sizes, seed=1)


def compressed(case: Case, start: Packing) -> tuple[Packing, float]:
    """Return a specimen and the CPU seconds that it took."""
    began = time.process_time()
    with warnings.catch_warnings():
        # how many are in balance is a column of the table
        warnings.simplefilter("ignore", PackingWarning)
        specimen = compress(
            start, stress=case.stress, axes=case.axes, friction=case.friction, rate=case.rate, threads=1
        )
    return specimen, time.process_time() - began


def judged(case: Case, program: str, specimen: Packing, seconds: float) -> Row:
    """Return the row of a specimen, by the ruler that is the same for both programs."""
    asked = [stress if axis in case.axes else np.nan for axis, stress in zip("xyz", case.stress, strict=True)]
    # the axes of the cell stay at right angles, so that shear stresses are not prescribed
    tensor = np.where(np.eye(3) > 0.0, asked, np.nan)
    rest, proof = equilibrium(specimen, case.friction, TOUCHING, stress=tensor), verify(specimen)
    push = rest["normal_force"].values
    bearing, bears = int((~rest["rattler"].values).sum()), int((push > BEARS * push[push > 0.0].mean()).sum())
    alike = case.name == EQUAL and case.rate is None and program == "voxgran"
    published: tuple[float | str, float | str] = PUBLISHED.get(case.friction, ("", "")) if alike else ("", "")
    if case.sizes is not None and case.friction == 0.0:
        # theory of spheres of several sizes that are packed closely at random: Farr & Groot 2009
        published = round(expected_solid_fraction(case.sizes), 3), ""
    return Row(
        case.name, program, case.friction, case.rate or "", specimen.count, seconds, specimen.solid_fraction,
        2.0 * bears / max(bearing, 1), rest.attrs["share_of_rattlers"], rest.attrs["share_at_rest_without_rattlers"],
        rest.attrs["stress_error"], max(proof.deepest, 0.0), *published,
    )  # fmt: skip


def measure(cases: tuple[Case, ...] = CASES, size: float | None = None) -> list[Row]:
    """Compress each case, after a small one that compiles, and let LAMMPS do so where it is installed."""
    rows, share = [], SIZE if size is None else size
    for case in cases:
        start = loose_grains(case, max(20, round(share * case.count)))
        compressed(case, loose_grains(case, 20))
        rows.append(judged(case, "voxgran", *compressed(case, start)))
        if not case.peer:
            continue
        found = peer_packing(PEERS / "compress_lammps.py", start, case.friction, longest=LONGEST)
        if found is None:
            LOG.warning("LAMMPS is not installed or failed: its row is left out")
            continue
        rows.append(judged(case, "LAMMPS", *found))
    return rows


def starts(count: int = 1000, seeds: int = SEEDS) -> list[Start]:
    """Compress equal spheres that have grown at random to several solid fractions."""
    rows, case = [], Case(EQUAL, count=count)
    for solid in STARTS:
        cube = Box(((count * np.pi / 6.0 / solid) ** (1.0 / 3.0),) * 3, periodic="xyz")
        found = [
            compressed(case, pack(spheres(), cube, "expand", count=count, solid_fraction=solid, seed=seed))[0]
            for seed in range(seeds)
        ]
        dense = np.array([specimen.solid_fraction for specimen in found])
        rows.append(Start(solid, float(dense.mean()), float(dense.std(ddof=1) / np.sqrt(seeds)), seeds))
    return rows


def four_shapes() -> dict[str, Shape]:
    """Return the shapes of small specimens, each of diameter 1."""
    families: dict[str, dict[str, Any]] = {
        "sphere": {}, "ellipsoid": {}, "convex_polyhedron": {"seed": 4, "points": 12}, "cylinder": {}
    }  # fmt: skip
    made = {family: make_shape(family, **given) for family, given in families.items()}
    return {family: shape.scaled(1.0 / shape.diameter) for family, shape in made.items()}


def thin_starts(shape: Shape, count: int) -> list[Packing]:
    """Return loose grains in a cell and, where they are few, between walls."""
    edge = (count * np.pi / 6.0 / THIN) ** (1.0 / 3.0)
    boxes = [Box((edge,) * 3, periodic=periodic) for periodic in (("xyz", "") if count < MANY else ("xyz",))]
    return [pack(shape, box, "rsa", count=count, seed=1) for box in boxes]


def by_clarabel(
    specimen: Packing, friction: float, stress: tuple[float, ...], reach: float = TOUCHING
) -> tuple[float, float] | None:
    """Return the share of the grains that bear forces which Clarabel balances under a stress, and the limit of it.

    The limit is the largest part of what the stress is beyond its least component that the contacts bear; it is minus
    infinity where they bear none. None without Clarabel.
    """
    found = equilibrium(specimen, friction, reach, stress=stress)
    i, j, normal = (found[name].values for name in ("contact_i", "contact_j", "normal"))
    arm, gap = found["point"].values - specimen.position[i], found["gap"].values[:, None] * normal
    # from the centroid of the second grain, or its nearest image
    away, periods = found["point"].values + gap - specimen.position[j], periods_of(specimen.container)
    other = np.where(j[:, None] >= 0, away - nearest_turns(away, periods) @ periods, 0.0)
    given = {
        "i": i, "j": j, "normal": normal, "arm_i": arm, "arm_j": other, "branch": arm + gap - other,
        "radius": specimen.diameters / 2.0, "friction": friction,
        "virial": np.multiply(stress, specimen.container.volume),
    }  # fmt: skip
    made = peer_arrays(PEERS / "balance_clarabel.py", "given.npz", partial(np.savez, **given), longest=LONGEST)
    if made is None:
        LOG.warning("Clarabel is not installed or failed: a cell of the table is left out")
        return None
    bearing = made[0]["left"][~found["rattler"].values] <= RESIDUAL
    return float(bearing.mean()) if len(bearing) else 0.0, float(made[0]["limit"])


def is_confirmed(specimen: Packing, friction: float, stress: tuple[float, ...]) -> bool | None:
    """Return whether Clarabel finds nearly all grains that bear forces in balance; of a specimen that yields, whether
    no forces at its contacts have the stress, while some have one that is more equal. None without Clarabel.
    """
    if specimen.stop_reason != "yielded":
        found = by_clarabel(specimen, friction, stress)
        return found and found[0] >= REST
    for reach in REACHES:
        found = by_clarabel(specimen, friction, stress, reach)
        if found is None or np.isfinite(found[1]):
            return found and found[1] < 1.0
    return False


def ends(
    counts: dict[int, tuple[float, ...]] | None = None,
    frictions: tuple[float, ...] = FRICTIONS,
    ratios: tuple[float, ...] = RATIOS,
) -> list[Ends]:
    """Compress small specimens, count how they end, and let Clarabel judge them where it is installed."""
    rows = []
    for name, shape in four_shapes().items():
        numbers = counts or (FEWER if name == "cylinder" else COUNTS)
        starts_of = {count: thin_starts(shape, count) for count in numbers}
        for friction, ratio in itertools.product(frictions, ratios):
            case = Case(name, friction=friction, stress=(1.0, 1.0, ratio))
            some = [start for count, each in starts_of.items() if friction in numbers[count] for start in each]
            made = [compressed(case, start)[0] for start in some]
            proofs = [
                [is_confirmed(one, friction, case.stress) for one in made if one.stop_reason == reason]
                for reason in ("compressed", "yielded")
            ]
            bears, yields = map(len, proofs)
            told = ["" if None in each else each.count(True) for each in proofs]
            rows.append(Ends(name, friction, ratio, len(made), bears, yields, len(made) - bears - yields, *told))
            LOG.info("%s", rows[-1])
    return rows


def run(folder: Path) -> tuple[Path, ...]:
    """Measure, and write rows as CSV and a figure as SVG."""
    rows, begun, figure = measure(), starts(), folder / "compression.svg"
    _draw(rows, begun, figure)
    by_start, by_end = [astuple(row) for row in begun], [astuple(row) for row in ends()]
    return (
        write_rows(folder / "compression_ends.csv", ",".join(field.name for field in fields(Ends)), by_end),
        write_rows(folder / "compression.csv", HEAD, [astuple(row) for row in rows]),
        write_rows(
            folder / "compression_starts.csv", "start,solid_fraction:.4f,solid_fraction_error:.4f,seeds", by_start
        ),
        figure,
    )


def _draw(rows: list[Row], begun: list[Start], path: Path) -> None:
    """Draw solid fraction and coordination of equal spheres by friction, and the solid fraction by rate and start."""
    alike = [row for row in rows if row.specimen == EQUAL and row.grains < 5000]
    with panels_of(path, 4, width=15.0) as (left, middle, right, last):
        for program, style in (("voxgran", "C0o-"), ("LAMMPS", "C1s")):
            some = [row for row in alike if row.program == program and row.rate == ""]
            for panel, name in ((left, "solid_fraction"), (middle, "coordination_by_forces")):
                panel.plot([row.friction for row in some], [getattr(row, name) for row in some], style, label=program)
        for k, panel in enumerate((left, middle)):
            panel.plot(list(PUBLISHED), [pair[k] for pair in PUBLISHED.values()], "k_", ms=18, label="published")
            panel.set(xlabel="friction", ylabel=("solid fraction", "contacts of grains that bear forces")[k])
        alone = [row for row in alike if row.program == "voxgran" and row.friction == 0.5]
        slow = sorted((float(row.rate or FRICTIONAL.rate), row.solid_fraction) for row in alone)
        right.semilogx(*zip(*slow, strict=True), "C0o-")
        right.set(xlabel="rate", ylabel="solid fraction at friction 0.5")
        by_start = np.array([astuple(row) for row in begun]).T
        last.errorbar(*by_start[:3], fmt="C0o-", capsize=3)
        last.set(xlabel="solid fraction of the start", ylabel="solid fraction at friction 0.5")
        last.sharey(right)
