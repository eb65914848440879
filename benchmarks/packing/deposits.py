"""Deposits and clusters of spheres that stick where they first touch: solid fraction against height, and dimension.

Near the floor a deposit is denser; its solid fraction falls by a power of the height toward that of the bulk
(Lubachevsky, Privman & Roy 1993, arXiv:cond-mat/9207014). It is measured exactly in layers between heights, below the
surface that still grows, and fitted by a constant and a power. A cluster about a point has the dimension of space in
the limit (on a lattice in the plane this is proven: Bosch & Winter 2023, arXiv:2308.13193). Its exponent is that of the
number of spheres as a power of the radius of gyration, between two numbers of one growing cluster. All values are means
over seeds with standard errors.
"""

import math
import time
from dataclasses import astuple, dataclass
from pathlib import Path

import numpy as np

from benchmarks.model import panels_of, write_rows
from voxgran._base.arrays import Floats
from voxgran._base.lazy import load
from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.rectangle import Rectangle
from voxgran.containers.model import Container
from voxgran.packing.model import Packing
from voxgran.packing.pack import pack
from voxgran.shapes.family import make_shape

#: packings of each kind
SEEDS = 8
#: heights between layers in diameters, and which of the layers are fitted
HEIGHTS, FITTED = {2: (0, 5, 10, 20, 40, 80, 160, 320), 3: (0, 5, 10, 20, 40, 80, 160, 320)}, 5.0
#: width of deposits in diameters; widths of those whose layer between the two greatest heights but one is compared
WIDTH, WIDTHS = {2: 4_000, 3: 120}, {2: (10, 20, 40, 80, 160), 3: (5, 10, 20, 40)}
#: height of deposits over the greatest height of a layer: the surface that still grows is above it
ABOVE = 1.15
#: numbers of spheres of clusters
COUNTS = (1_000, 3_000, 10_000, 30_000, 100_000)
#: about how dense deposits are, to ask for a number of spheres
ABOUT = {2: 0.36, 3: 0.148}
#: published solid fraction of the bulk (Meakin & Jullien, as recalled), and dimensions of clusters
BULK, DIMENSION = {2: math.nan, 3: 0.1465}, {2: 2.0, 3: 3.0}


@dataclass(frozen=True, slots=True)
class Row:
    """A value that was measured: of a layer, of a width, of the fit, of a cluster or of a shell of one."""

    dimension: int
    measure: str
    low: float  # height, width, number of spheres or radius from which
    high: float  # and to which
    value: float
    error: float  # standard error
    published: float  # NaN where none is known
    seconds: float  # of one packing


def run(folder: Path) -> tuple[Path, ...]:
    """Measure deposits and clusters, and write rows as CSV and a figure as SVG."""
    rows: list[Row] = []
    for dimension in (2, 3):
        rows += [*layer_rows(dimension), *width_rows(dimension), *cluster_rows(dimension)]
    head = "dimension,measure,from:g,to:g,value:.5f,standard_error:.5f,published:g,cpu_seconds:.3f"
    table = write_rows(folder / "deposits.csv", head, map(astuple, rows))
    _draw(rows, folder / "deposits.svg")
    return table, folder / "deposits.svg"


def layer_rows(dimension: int) -> list[Row]:
    """Return the solid fractions of layers, and the fit by a constant and a power of the height, of each seed."""
    edges = np.array(HEIGHTS[dimension], dtype=np.float64)
    began = time.process_time()
    layers = np.array([solid_fractions(deposit(dimension, WIDTH[dimension], seed), edges) for seed in range(SEEDS)])
    seconds = (time.process_time() - began) / SEEDS
    rows = [
        Row(dimension, "layer", edges[k], edges[k + 1], *_mean(layers[:, k]), math.nan, seconds)
        for k in range(len(edges) - 1)
    ]
    # each time without one of the seeds: fits of single ones scatter too much
    fits = np.array([fit_of(edges, np.delete(layers, seed, axis=0).mean(axis=0)) for seed in range(SEEDS)])
    whole = fit_of(edges, layers.mean(axis=0))
    errors = np.sqrt((SEEDS - 1) / SEEDS * ((fits - fits.mean(axis=0)) ** 2).sum(axis=0))
    for k, (measure, published) in enumerate((("bulk", BULK[dimension]), ("power", math.nan))):
        rows.append(Row(dimension, measure, FITTED, edges[-1], whole[k], float(errors[k]), published, seconds))
    return rows


def width_rows(dimension: int) -> list[Row]:
    """Return the solid fraction of one layer in deposits of several widths; narrow ones are repeated more often."""
    edges = np.array(HEIGHTS[dimension][-3:-1], dtype=np.float64)
    rows = []
    for width in WIDTHS[dimension]:
        began = time.process_time()
        many = SEEDS * math.ceil(max(WIDTHS[dimension]) / width)
        found = np.array([solid_fractions(deposit(dimension, width, seed), edges)[0] for seed in range(many)])
        seconds = (time.process_time() - began) / many
        rows.append(Row(dimension, "width", width, width, *_mean(found), math.nan, seconds))
    return rows


def cluster_rows(dimension: int) -> list[Row]:
    """Return the exponents of clusters between successive numbers of spheres, and solid fractions of their shells."""
    began = time.process_time()
    found = [cluster(dimension, COUNTS[-1], seed) for seed in range(SEEDS)]
    seconds = (time.process_time() - began) / SEEDS
    gyration = np.array([[radius_of_gyration(packing.position[:many]) for many in COUNTS] for packing in found])
    powers = np.diff(np.log(COUNTS)) / np.diff(np.log(gyration), axis=1)
    rows = [
        Row(dimension, "cluster", COUNTS[k], COUNTS[k + 1], *_mean(powers[:, k]), DIMENSION[dimension], seconds)
        for k in range(len(COUNTS) - 1)
    ]
    # up to where the smallest of them is complete
    radii = np.geomspace(0.05, 0.8, 5) * gyration[:, -1].min()
    shells = np.array([shell_fractions(packing, radii) for packing in found])
    return rows + [
        Row(dimension, "shell", radii[k], radii[k + 1], *_mean(shells[:, k]), math.nan, seconds)
        for k in range(len(radii) - 1)
    ]


def deposit(dimension: int, width: float, seed: int) -> Packing:
    """Return a deposit of equal spheres or disks that stick, higher than all layers."""
    height = ABOVE * HEIGHTS[dimension][-1]
    room: Container = Rectangle((width, 2 * height), "x") if dimension == 2 else Box((width, width, 2 * height), "xy")
    shape = make_shape("disk" if dimension == 2 else "sphere")
    count = math.ceil(ABOUT[dimension] * room.volume / 2 / (math.pi / (2 * dimension)))
    return pack(shape, room, method="deposition", count=count, seed=seed, sticking=1.0)


def cluster(dimension: int, count: int, seed: int) -> Packing:
    """Return a cluster of equal spheres or disks that arrive on straight lines from all sides and stick."""
    # room for a solid fraction of a thousandth
    half = 5.0 * count ** (1.0 / dimension)
    room: Container = Rectangle((2 * half,) * 2) if dimension == 2 else Box((2 * half,) * 3)
    shape = make_shape("disk" if dimension == 2 else "sphere")
    return pack(shape, room, method="deposition", count=count, seed=seed, sticking=1.0, toward="center")


def solid_fractions(packing: Packing, heights: Floats) -> Floats:
    """Return the solid fractions of layers between heights above the floor, exactly, of spheres or disks."""
    up = packing.dimension - 1
    lower, upper = packing.container.bounds
    below = volumes_below(packing, lower[up] + heights)
    area = packing.container.volume / (upper[up] - lower[up])
    return np.asarray(np.diff(below) / (area * np.diff(heights)))


def volumes_below(packing: Packing, levels: Floats) -> Floats:
    """Return the volume of spheres, or the area of disks, below some levels, (k,), by closed formulas."""
    radius, height = 0.5 * packing.diameters, packing.position[:, packing.dimension - 1]
    total = np.zeros(len(levels))
    for k, level in enumerate(levels):
        cut = np.clip((level - height) / radius, -1.0, 1.0)
        if packing.dimension == 3:
            parts = math.pi * radius**3 * (2.0 / 3.0 + cut - cut**3 / 3.0)
        else:
            parts = radius**2 * (0.5 * math.pi + np.arcsin(cut) + cut * np.sqrt(1.0 - cut**2))
        total[k] = parts.sum()
    return total


def radius_of_gyration(position: Floats) -> float:
    """Return the root of the mean square distance of points from their centroid."""
    return float(np.sqrt(position.var(axis=0).sum()))


def shell_fractions(packing: Packing, radii: Floats) -> Floats:
    """Return the solid fractions of shells about the first sphere, each sphere counted where its center is."""
    d = packing.dimension
    away = np.linalg.norm(packing.position - packing.position[0], axis=1)
    inside = np.array([np.count_nonzero(away < radius) for radius in radii])
    return np.asarray(np.diff(inside) * 0.5**d / np.diff(radii**d))


def fit_of(edges: Floats, fractions: Floats) -> tuple[float, float]:
    """Return the constant and the power p of ``constant + factor * z^-p``, as means of layers, by least squares."""
    used = edges[:-1] >= FITTED
    low, high = edges[:-1][used], edges[1:][used]

    def model(_: Floats, constant: float, factor: float, power: float) -> Floats:
        mean = (high ** (1.0 - power) - low ** (1.0 - power)) / ((1.0 - power) * (high - low))
        return np.asarray(constant + factor * mean)

    guess = fractions[-1], fractions[0], 0.7
    found, _ = load("scipy.optimize").curve_fit(model, low, fractions[used], p0=guess, maxfev=10_000)
    return float(found[0]), float(found[2])


def _mean(values: Floats) -> tuple[float, float]:
    """Return the mean and its standard error."""
    return float(values.mean()), float(values.std(ddof=1) / math.sqrt(len(values)))


def _draw(rows: list[Row], path: Path) -> None:
    """Draw solid fractions of layers against height, and exponents of clusters against the number of spheres."""
    with panels_of(path, 2, width=10.0, height=4.0) as panels:
        for dimension in (2, 3):
            here = [row for row in rows if row.dimension == dimension]
            bulk = next(row for row in here if row.measure == "bulk")
            layers = [row for row in here if row.measure == "layer"]
            clusters = [row for row in here if row.measure == "cluster"]
            name = "disks" if dimension == 2 else "spheres"
            panels[0].errorbar(
                [0.5 * (row.low + row.high) for row in layers],
                [row.value / bulk.value for row in layers],
                yerr=[row.error / bulk.value for row in layers],
                marker="o",
                label=f"{name}, bulk {bulk.value:.4f}",
            )
            panels[1].errorbar(
                [row.high for row in clusters],
                [row.value / dimension for row in clusters],
                yerr=[row.error / dimension for row in clusters],
                marker="o",
                label=name,
            )
        panels[0].set(xscale="log", xlabel="height [diameters]", ylabel="solid fraction / that of the bulk")
        panels[1].set(xscale="log", xlabel="spheres in a cluster", ylabel="exponent / dimension of space")
        for panel in panels:
            panel.axhline(1.0, color="k", linestyle=":")
