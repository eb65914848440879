"""Sizes of grains: seconds, and distance from the distribution by volume, of strata and of independent draws."""

import math
from pathlib import Path

import numpy as np

from benchmarks.model import least_seconds, panels_of, write_rows
from voxgran._base.arrays import Floats
from voxgran._base.seeds import stream
from voxgran.shapes import sizes
from voxgran.shapes.size_laws.distribution import SizeDistribution

#: numbers of grains, and seeds of each
COUNTS, SEEDS = (100, 500, 2_000, 10_000, 100_000, 1_000_000), 20
#: grains above which one seed is enough
MANY = 100_000

#: distribution, way, grains, CPU seconds, mean and standard deviation of the distance by volume, of D60 over that
#: of the distribution
Row = tuple[str, str, int, float, float, float, float, float]


def laws() -> dict[str, SizeDistribution]:
    """Return a sieve curve of a gravel, a log-normal distribution by volume, and a Rosin-Rammler distribution."""
    return {
        "sieve": sizes.sieve([2.8, 4, 8, 16, 31.5, 63], [0, 4, 15, 35, 65, 100]),
        "lognormal": sizes.lognormal(2.0, 0.5, basis="volume"),
        "rosin_rammler": sizes.rosin_rammler(10.0, 1.5, low=2.0),
    }


def measured(counts: tuple[int, ...] = COUNTS, seeds: int = SEEDS) -> list[Row]:
    """Return the rows."""
    rows = []
    for name, law in laws().items():
        sixty = float(law.quantile(0.6, basis="volume"))
        for way, made in {"strata": law.strata, "independent": law.sample}.items():
            for count in counts:
                seconds = least_seconds(lambda: made(count, stream(0, "sizes")), repeats=1, processor=True)  # noqa: B023
                drawn = [np.sort(made(count, stream(seed, "sizes"))) for seed in range(seeds if count < MANY else 1)]
                far = [distance_by_volume(law, grains) for grains in drawn]
                held = [
                    float(grains[np.searchsorted(np.cumsum(grains**3) / np.sum(grains**3), 0.6)]) for grains in drawn
                ]
                rows.append((name, way, count, seconds, *_mean_and_deviation(far), *_mean_and_deviation(held, sixty)))
    return rows


def _mean_and_deviation(values: list[float], unit: float = 1.0) -> tuple[float, float]:
    """Return mean and standard deviation of values in a unit; the deviation of equal values is exactly 0."""
    return float(np.mean(values)) / unit, float(np.std(np.subtract(values, values[0]))) / unit


def distance_by_volume(law: SizeDistribution, grains: Floats) -> float:
    """Return the largest difference of the shares by volume up to a size between a distribution and sorted sizes."""
    held = np.cumsum(grains**3)
    held /= held[-1]
    asked = law.cumulative(grains, basis="volume")
    return float(max(np.abs(held - asked).max(), np.abs(np.concatenate([[0.0], held[:-1]]) - asked).max()))


def run(folder: Path) -> tuple[Path, ...]:
    """Measure, and write rows as CSV and a figure as SVG."""
    rows = measured()
    head = (
        "distribution,way,grains,cpu_seconds:.4f,distance:.2g,distance_deviation:.2g,d60_over_asked:.3f,"
        "d60_deviation:.2g"
    )
    _draw(rows, folder / "gradation.svg")
    return write_rows(folder / "gradation.csv", head, rows), folder / "gradation.svg"


def _draw(rows: list[Row], path: Path) -> None:
    """Draw the distance by volume against the number of grains."""
    names = dict.fromkeys(row[0] for row in rows)
    with panels_of(path, len(names), width=4.0 * math.ceil(len(names)), sharey=True) as panels:
        for name, panel in zip(names, panels, strict=True):
            for way, style in {"strata": "o-", "independent": "s:"}.items():
                mine = [row for row in rows if row[:2] == (name, way)]
                panel.loglog([row[2] for row in mine], [row[4] for row in mine], style, label=way)
            panel.set(xlabel="grains", title=name.replace("_", "-"))
        panels[0].set(ylabel="largest difference of the shares by volume")
