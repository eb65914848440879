"""Exponents of the sizes of spheres that fill gaps: growth and random Apollonian packings, and exact gaskets.

The share of the pores falls as a power of the number of spheres, from which the exponent of the number of spheres above
a size follows: with a slope -s of the logarithms in d dimensions it is d / (1 + s). Each value is that between two
numbers of spheres, a mean over several packings with its standard error. Nuclei keep arriving at one rate per volume
and time, so that more spheres stand for a longer time; they grow at one rate (Andrienko, Brilliantov & Krapivsky 1994)
or at random ones (Dodds & Weitz 2002). Exponents of gaskets are fitted to the number of spheres up to a curvature.

Squares show what the shape and its rotation change.
"""

import math
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.model import panels_of, timed, write_rows
from voxgran._base.arrays import Floats
from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.rectangle import Rectangle
from voxgran.containers.model import Container
from voxgran.packing.pack import pack
from voxgran.packing.space_filling.gaskets import in_sphere
from voxgran.shapes.family import make_shape

#: numbers of spheres, and packings of each
COUNTS, SEEDS = (1_000, 3_000, 10_000, 30_000, 100_000, 300_000), 6
#: squares in the plane, in random orientations or rotated to where they can grow further: options of the method, and
#: how many of the numbers of grains
SQUARES: dict[str, dict[str, Any]] = {
    "random_apollonian, squares": {},
    "random_apollonian, rotated squares": {"rotate": 20},
}
FEWER = 4
#: methods of spheres, and their options
SPHERES: dict[str, dict[str, Any]] = {"growth": {}, "growth, random rates": {"slowest": 0.01}, "random_apollonian": {}}
#: growth of radii while the smallest number of nuclei arrives, in diameters of equal spheres that fill the container
SPEED = 5.0
#: published exponents by dimension: of random packings (Dodds & Weitz 2002, doi:10.1103/PhysRevE.65.056108), and of
#: gaskets (McMullen 1998; Borkovec, De Paris & Peikert 1994)
RANDOM, EXACT = {2: 1.564, 3: 2.733}, {2: 1.305686729, 3: 2.4739465}
#: largest curvatures of gaskets, and from which power of them the number of spheres is fitted
CURVATURES, FITTED = {2: 30_000.0, 3: 400.0}, {2: 0.5, 3: 0.6}


@dataclass(frozen=True, slots=True)
class Row:
    """An exponent that was measured."""

    dimension: int
    method: str
    spheres: int
    exponent: float
    error: float  # standard error; 0 for gaskets
    published: float | None
    seconds: float


def run(folder: Path) -> tuple[Path, ...]:
    """Measure all exponents, and write rows as CSV and a figure as SVG."""
    rows: list[Row] = []
    for dimension in (2, 3):
        for method in (*SPHERES, *(SQUARES if dimension == 2 else ())):
            rows += random_rows(method, dimension)
        rows.append(gasket_row(dimension))
    head = "dimension,method,spheres,exponent:.5f,standard_error:.5f,published:g,cpu_seconds:.3f"
    table = write_rows(folder / "exponents.csv", head, map(astuple, rows))
    _draw(rows, folder / "exponents.svg")
    return table, folder / "exponents.svg"


def random_rows(method: str, dimension: int) -> list[Row]:
    """Return the exponents between successive numbers of spheres; seconds are those of the larger packings."""
    counts = COUNTS[:FEWER] if method in SQUARES else COUNTS
    pores = np.zeros((SEEDS, len(counts)))
    seconds = np.zeros(len(counts))
    for seed in range(SEEDS):
        for k, count in enumerate(counts):
            pores[seed, k], taken = timed(_pores, method, dimension, count, seed)
            seconds[k] += taken / SEEDS
    slopes = -np.diff(np.log(pores), axis=1) / np.diff(np.log(counts))
    found = dimension / (1.0 + slopes)
    means, errors = found.mean(axis=0), found.std(axis=0, ddof=1) / math.sqrt(SEEDS)
    return [
        Row(
            dimension,
            method,
            counts[k + 1],
            float(means[k]),
            float(errors[k]),
            None if method in SQUARES else RANDOM[dimension],
            float(seconds[k + 1]),
        )
        for k in range(len(means))
    ]


def _pores(method: str, dimension: int, count: int, seed: int) -> float:
    """Return the porosity of a periodic packing."""
    shape = make_shape("disk" if dimension == 2 else "sphere")
    room: Container = Rectangle((10, 10), "xy") if dimension == 2 else Box((10, 10, 10), "xyz")
    options, kind = {**SPHERES, **SQUARES}[method], method.partition(",")[0]
    if method in SQUARES:
        shape = make_shape("polygon", corners=4)
    if kind == "growth":
        # arrivals and growth per time and volume do not depend on the number
        speed = SPEED * (count / COUNTS[0]) ** ((dimension + 1) / dimension)
        options = {**options, "arrival": "continuous", "speed": speed}
    return 1.0 - pack(shape, room, method=kind, count=count, seed=seed, **options).solid_fraction


def gasket_row(dimension: int) -> Row:
    """Return the exponent of the gasket in a disk or a sphere."""
    most = CURVATURES[dimension]
    spheres, seconds = timed(lambda: list(in_sphere(dimension, most)))
    curvature = np.sort(np.concatenate([rows[:, 0] for rows in spheres]))
    exponent = exponent_of(curvature, most ** FITTED[dimension], most)
    return Row(dimension, "apollonian", len(curvature), exponent, 0.0, EXACT[dimension], seconds)


def exponent_of(curvature: Floats, low: float, high: float) -> float:
    """Return the slope of the logarithm of the number of spheres up to a curvature, for sorted curvatures."""
    at = np.geomspace(low, high, 60)
    return float(np.polyfit(np.log(at), np.log(np.searchsorted(curvature, at, side="right")), 1)[0])


def _draw(rows: list[Row], path: Path) -> None:
    """Draw the exponents of random packings against the number of spheres."""
    labels = {method: method.replace("random_apollonian", "random Apollonian") for method in (*SPHERES, *SQUARES)}
    with panels_of(path, 2, width=10.0, height=4.0) as panels:
        for panel, dimension in zip(panels, (2, 3), strict=True):
            for method, label in labels.items():
                here = [row for row in rows if row.dimension == dimension and row.method == method]
                if not here:
                    continue
                xs, ys = [row.spheres for row in here], [row.exponent for row in here]
                panel.errorbar(xs, ys, yerr=[row.error for row in here], marker="o", capsize=3, label=label)
            panel.axhline(RANDOM[dimension], color="k", linestyle=":", label="Dodds & Weitz 2002")
            panel.set(xscale="log", xlabel="spheres", ylabel="exponent", title=f"{dimension} dimensions")
