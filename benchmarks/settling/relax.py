"""Distance from equilibrium: packings relaxed in LAMMPS beside grains poured there, and what equilibrium has proven.

The first table compares two ways to a bed at rest: the method ``gravity`` with :func:`voxgran.relax` after it, and the
same grains that fall from a loose random packing in the engine alone. Both end by the same rest criterion. The second
compares the share of grains that :func:`voxgran.equilibrium` proves to rest with the sinking that the engine then
finds, for beds at rest, beds of a voxel walk, and random additions. Seconds are CPU seconds, without
compilation. LAMMPS must be installed.
"""

import resource
import warnings
from collections.abc import Callable
from dataclasses import astuple, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.model import calibration, panels_of, write_rows
from benchmarks.settling.settle import Case, box_of, falling_grains, packed, polyhedra, spheres
from voxgran._base.arrays import Floats
from voxgran._base.errors import PackingWarning
from voxgran.clumps.fit import fit_clump
from voxgran.containers.kinds.box import Box
from voxgran.decks.engine import engine_registry
from voxgran.decks.relax import relax
from voxgran.decks.write import described
from voxgran.packing.model import Packing
from voxgran.packing.pack import pack
from voxgran.settling.equilibrium import equilibrium
from voxgran.shapes.family import make_shape
from voxgran.shapes.model import Shape

#: spheres of a clump
SPHERES = 10
#: number of grains, and width of the box in diameters, of the comparison with pouring; more grains would take hours
FEW, MANY = (1000, 10.0), (3000, 13.0)
#: difference of the mean sinking from that of the end below which a bed no longer sinks, in median diameters
STILL = 1e-3
#: solid fraction of random additions, and that from which grains fall
SPARSE, LOOSE = 0.3, 0.1


@dataclass(frozen=True, slots=True)
class Way:
    """A bed at rest in the engine, and what it took to get there."""

    grains: str
    count: int
    start: str  # how the grains came to where the engine takes them
    seconds_packing: float
    seconds_engine: float
    duration: float  # in the engine until the bed rests, in sqrt(d / g)
    sinking_time: float  # in the engine until the mean sinking is that of the end, in sqrt(d / g)
    rests: int  # 1 or 0
    solid_fraction: float
    coordination: float
    sinking: float  # mean of all grains, in median diameters
    calibration_seconds: float


@dataclass(frozen=True, slots=True)
class Proof:
    """A packing, the share of its grains, rattlers apart, that is proven to rest, and its sinking in the engine."""

    grains: str
    made_by: str
    share_proven: float
    sinking: float
    change_of_coordination: float


HEAD = ",".join(f"{field.name}:.5g" if field.type is float else field.name for field in fields(Way))


def ellipsoids() -> list[Shape]:
    """Return a clump that stands for an ellipsoid of three axes, with the equivalent diameter 1."""
    return [_clump(make_shape("ellipsoid", aspect=(1.25, 1.0, 0.8)))]


def rocks() -> list[Shape]:
    """Return clumps that stand for unions of solids, with the equivalent diameter 1."""
    return [_clump(make_shape("solid_union", seed=seed)) for seed in range(1, 5)]


def hulls() -> list[Shape]:
    """Return clumps that stand for hulls of random points."""
    return [_clump(shape) for shape in polyhedra()[:4]]


def _clump(shape: Shape) -> Shape:
    """Return a shape as a clump with the equivalent diameter 1."""
    found = fit_clump(shape.scaled(1.0 / shape.diameter), max_spheres=SPHERES)
    return found.to_shape()


KINDS: tuple[tuple[str, Callable[[], list[Shape]], tuple[tuple[int, float], ...]], ...] = (
    ("spheres", spheres, (FEW, MANY)),
    ("ellipsoid clumps", ellipsoids, (FEW,)),
    ("rock clumps", rocks, (FEW,)),
)

#: grains of which the proof of rest is compared with their sinking
PROVEN: tuple[tuple[str, Callable[[], list[Shape]]], ...] = (("spheres", spheres), ("hull clumps", hulls))


def compare_ways(path: Path) -> list[Way]:
    """Return beds that were packed and relaxed, and beds that were poured, for each kind and number of grains.

    Rows that the table at `path` holds are kept, and new ones are added to it: the whole takes half an hour.
    """
    rows, loop = _rows_of(path), calibration()
    for name, shapes, counts in KINDS:
        for count, width in counts:
            if any((row.grains, row.count) == (name, count) for row in rows):
                continue
            case = Case(f"{count} {name}", shapes, count, width)
            packed(case, shapes(), max(20, count // 20), 1)
            bed, seconds = packed(case, shapes(), count, 1)
            # the stiffness that suits the weight of the bed, for both ways
            law = described(bed, engine_registry().get("lammps"), None)[0].law
            rows.append(_way(name, "gravity", bed, seconds, law.stiffness, loop))
            began = _processor()
            loose = falling_grains(case, count, LOOSE)
            rows.append(_way(name, "poured", loose, _processor() - began, law.stiffness, loop))
            write_rows(path, HEAD, map(astuple, rows))
    return rows


def _rows_of(path: Path) -> list[Way]:
    """Return the rows of a table; none where it is not there."""
    if not path.is_file():
        return []
    kinds: list[Any] = [field.type for field in fields(Way)]
    lines = path.read_text(encoding="utf-8").splitlines()[1:]
    return [Way(*(kind(word) for kind, word in zip(kinds, line.split(","), strict=False))) for line in lines]


def _processor() -> float:
    """Return the CPU seconds of this process and those that it has started."""
    used = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(one.ru_utime + one.ru_stime for one in used)


def _way(grains: str, start: str, bed: Packing, seconds: float, stiffness: float, loop: float) -> Way:
    """Return what it takes the engine to bring a packing to rest."""
    began = _processor()
    rested, history = relax(bed, material={"stiffness": stiffness})
    assert rested.relaxation is not None
    return Way(
        grains,
        bed.count,
        start,
        seconds,
        _processor() - began,
        rested.relaxation.duration,
        rested.relaxation.duration * _share_of_sinking(history["mean_sinking"].values),
        int(history.attrs["rests"]),
        float(history["solid_fraction"][-1]),
        float(history["coordination_number"][-1]),
        float(history["mean_sinking"][-1]),
        loop,
    )


def _share_of_sinking(sinking: Floats) -> float:
    """Return the share of the run after which the mean sinking stays as it is at the end."""
    moving = np.flatnonzero(np.abs(sinking - sinking[-1]) > STILL)
    return float(moving.max(initial=-1) + 1) / (len(sinking) - 1)


def compare_proofs(count: int = 500) -> list[Proof]:
    """Return packings of several methods, with the share of grains proven to rest and the sinking in the engine."""
    rows = []
    for name, shapes in PROVEN:
        case = Case(name, shapes, count, 8.0)
        box = box_of(case, count)
        # what rests is a column of the table
        with warnings.catch_warnings(action="ignore", category=PackingWarning):
            beds = {
                "gravity": pack(shapes(), box, "gravity", count=count, seed=1),
                "digital, not settled": pack(shapes(), box, "digital", settle=False, count=count, seed=1),
                "rsa": replace(
                    pack(shapes(), _filled(case, count), "rsa", count=count, seed=1), gravity=(0.0, 0.0, -1.0)
                ),
            }
        for method, bed in beds.items():
            found = equilibrium(bed, friction=0.5, gap=max(1e-3, bed.contact_gap))
            proven = float(found.attrs["share_at_rest_without_rattlers"])
            _, history = relax(bed)
            changes = (float(history.attrs[key]) for key in ("sinking", "change_of_coordination"))
            rows.append(Proof(name, method, proven, *changes))
    return rows


def _filled(case: Case, count: int) -> Box:
    """Return the box that random additions fill to the solid fraction SPARSE."""
    return Box((case.width, case.width, count * np.pi / 6 / (SPARSE * case.width**2)), periodic="xy")


def run(folder: Path) -> tuple[Path, ...]:
    """Measure, and write rows as CSV and a figure as SVG."""
    table = folder / "relax.csv"
    proofs, ways = compare_proofs(), compare_ways(table)
    head = "grains,made_by,share_proven:.4f,sinking:.4f,change_of_coordination:.3f"
    figure = folder / "relax.svg"
    _draw(ways, proofs, figure)
    return (table, write_rows(folder / "relax_proofs.csv", head, map(astuple, proofs)), figure)


def _draw(ways: list[Way], proofs: list[Proof], path: Path) -> None:
    """Draw seconds and density of both ways, and sinking against the share that is proven to rest."""
    with panels_of(path, 3, width=14.0, height=4.8, legend=10) as (left, middle, right):
        places = np.arange(len(ways))
        # beside each other: lengths of bars upon each other say nothing on a logarithmic axis
        left.plot([way.seconds_packing for way in ways], places, "C0o", label="packing")
        left.plot([way.seconds_engine for way in ways], places, "C1s", label="engine")
        left.set_yticks(places, [f"{way.count:,} {way.grains}, {way.start}" for way in ways], fontsize=8)
        left.set(xlabel="CPU seconds", xscale="log")
        for start, mark in (("gravity", "o"), ("poured", "s")):
            some = [way for way in ways if way.start == start]
            middle.plot([way.solid_fraction for way in some], [way.coordination for way in some], mark, label=start)
        middle.set(xlabel="solid fraction at rest", ylabel="coordination number at rest")
        for made_by in dict.fromkeys(proof.made_by for proof in proofs):
            made = [proof for proof in proofs if proof.made_by == made_by]
            right.plot([proof.share_proven for proof in made], [proof.sinking for proof in made], "o", label=made_by)
        right.set(xlabel="share of grains proven to rest", ylabel="sinking in the engine, in diameters", yscale="log")
