"""Random sequential addition: seconds against what is missing to saturation, and seconds of a proof against grains.

Seconds are CPU seconds. Equal spheres in periodic boxes. Candidates: by the classic scheme with more and
more tries, beside a plain program with NumPy and the trees of SciPy that tries as often; what both miss is the
difference to the published solid fraction at saturation. To saturation: disks, spheres, aligned squares and cubes, with
the proof.
"""

import math
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from benchmarks.model import panels_of, timed, write_rows
from benchmarks.peers import addition as peers
from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.rectangle import Rectangle
from voxgran.packing.pack import pack
from voxgran.shapes.family import make_shape
from voxgran.shapes.model import Shape

#: shape, program, tries per area or volume of a grain (0: to proven saturation), grains, least seconds, solid fraction,
#: its standard error (0: of one run)
Row: TypeAlias = tuple[str, str, int, int, float, float, float]
#: published solid fractions at saturation: Zhang & Torquato 2013 (disks, spheres), Brosilow, Ziff & Vigil 1991
#: (squares), Jodrey & Tory 1980 (cubes)
SATURATED = {"disk": 0.5470735, "sphere": 0.3841307, "square": 0.562009, "cube": 0.4227}
TRIES = (1, 3, 10, 30, 100, 300)
#: grains of the comparison, and of the proofs; up to FEW of them, several runs are made
GRAINS, FEW, RUNS = 10_000, 10_000, 6
PROVEN = {
    "disk": (1_000, 10_000, 100_000, 1_000_000),
    "sphere": (1_000, 10_000, 100_000),
    "square": (1_000, 10_000, 100_000),
    "cube": (1_000, 10_000, 100_000),
}
CORNERS = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))


def body(name: str) -> Shape:
    """Return a shape by the name that rows use, of diameter or edge 1."""
    if name == "square":
        return make_shape("polygon", vertices=CORNERS)
    return make_shape("box", lengths=(1, 1, 1)) if name == "cube" else make_shape(name)


def room_for(name: str, count: int) -> Box | Rectangle:
    """Return the periodic box in which about so many grains are at saturation."""
    shape = body(name)
    edge = (count * shape.volume / SATURATED[name]) ** (1 / shape.dimension)
    return Rectangle((edge,) * 2, "xy") if shape.dimension == 2 else Box((edge,) * 3, "xyz")


def measure_tries(
    names: tuple[str, ...] = ("disk", "sphere"), tries: tuple[int, ...] = TRIES, count: int = GRAINS
) -> list[Row]:
    """Add disks or spheres with voxgran and with the plain program, by tries: random places per area or volume of a
    grain; `count` is about the number of grains at saturation.
    """
    rows: list[Row] = []
    for name in names:
        shape, room = body(name), room_for(name, count)
        volume = shape.volume / room.volume
        lengths = np.array(room.lengths)
        peers.scipy_addition(np.full(len(lengths), 4.0), 99)
        for many in tries:
            places = round(many / volume)
            (centers, *_), seconds = timed(peers.scipy_addition, lengths, places)
            rows.append((name, "SciPy", many, len(centers), seconds, len(centers) * volume, 0.0))
            # one coordinate after the other, as the plain program does: as many as the grains that fill the box
            options: dict[str, Any] = {"scheme": "2", "retry": "next", "tries": many}
            rows.append((name, "voxgran", many, *_timed(shape, room, 1, **options)))
    return rows


def measure_proofs(counts: dict[str, tuple[int, ...]] | None = None) -> list[Row]:
    """Add grains to proven saturation, about as many as `counts` says by the name of the shape."""
    rows: list[Row] = []
    for name, many in (PROVEN if counts is None else counts).items():
        for count in many:
            options: dict[str, Any] = {"until": "saturated", "aligned": name in ("square", "cube")}
            runs = RUNS if count <= FEW else 1
            rows.append((name, "voxgran", 0, *_timed(body(name), room_for(name, count), runs, **options)))
    return rows


def _timed(shape: Shape, room: Box | Rectangle, runs: int, **options: Any) -> tuple[int, float, float, float]:
    """Return grains, least seconds, mean solid fraction and its standard error; compiling and loading do not count."""
    small = Rectangle((4, 4), "xy") if shape.dimension == 2 else Box((4, 4, 4), "xyz")
    pack(shape, small, method="rsa", **options)
    counts, seconds, found = [], [], []
    for seed in range(runs):
        packing, took = timed(pack, shape, room, method="rsa", seed=seed, **options)
        seconds.append(took)
        counts.append(packing.count)
        found.append(packing.solid_fraction)
    error = float(np.std(found, ddof=1) / math.sqrt(runs)) if runs > 1 else 0.0
    return round(float(np.mean(counts))), min(seconds), float(np.mean(found)), error


def run(folder: Path) -> tuple[Path, ...]:
    """Measure, and write rows as CSV and a figure as SVG."""
    rows = [*measure_tries(), *measure_proofs()]
    seconds = {row[:3]: row[4] for row in rows if row[1] == "SciPy"}
    head = "shape,program,tries,grains,seconds:.4f,ratio_to_scipy:.1f,solid_fraction:.5f,standard_error:.5f,missing:.5f"
    values = []
    for name, program, tries, grains, took, found, error in rows:
        peer = seconds.get((name, "SciPy", tries))
        ratio = None if peer is None or program == "SciPy" else peer / took
        missing = SATURATED[name] - found
        values.append((name, program, tries or "saturated", grains, took, ratio, found, error or None, missing))
    _draw(rows, folder / "rsa.svg")
    return write_rows(folder / "rsa.csv", head, values), folder / "rsa.svg"


def _draw(rows: list[Row], path: Path) -> None:
    """Draw what is missing against seconds on the left, seconds of proofs against grains on the right."""
    with panels_of(path, 2, width=10.0) as (left, right):
        for k, name in enumerate(("disk", "sphere")):
            for program, style in (("SciPy", ":"), ("voxgran", "-")):
                found = [(row[4], SATURATED[name] - row[5]) for row in rows if row[:2] == (name, program) and row[2]]
                if found:
                    label = f"{GRAINS} {name}s, {program}"
                    left.loglog(*zip(*found, strict=True), f"C{k}{style}", marker="o", label=label)
            proof = [row[4] for row in rows if row[0] == name and not row[2] and abs(row[3] / GRAINS - 1) < 0.1]
            left.axvline(proof[0], color=f"C{k}", linestyle="--", label=f"{GRAINS} {name}s, saturated, proven")
        left.set(xlabel="CPU seconds", ylabel="solid fraction missing to saturation")
        for k, name in enumerate(PROVEN):
            proofs = [(row[3], row[4]) for row in rows if row[0] == name and not row[2]]
            right.loglog(*zip(*proofs, strict=True), f"C{k}-", marker="o", label=f"{name}s")
        right.set(xlabel="grains at proven saturation", ylabel="CPU seconds")
