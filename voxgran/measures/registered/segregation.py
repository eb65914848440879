"""Segregation: whether large grains lie above or below small ones.

It is Spearman's rank correlation of the equivalent diameter and the height of the centroid, which runs against gravity:
1 where the grains are sorted with the largest on top, -1 with the largest at the bottom, and 0 on average, with a
standard deviation of 1 / sqrt(n - 1), where sizes and places of n grains are independent of each other. Equal values
share the mean of their ranks. Spearman 1904, doi:10.2307/1412159. What it cannot see, such as middle sizes on top, is
in the gradation of layers. Where grains have different densities, the correlation of density and height is given
likewise.

A test compares the sizes of the grains layer by layer, and tells whether their order along the height is random. Layers
hold equal numbers of grains. The distance of a layer is the Kolmogorov-Smirnov statistic of its gradation by number
against that of all grains, the largest difference of the two cumulative shares. In random order a layer is a sample of
the grains without replacement. The table of layers and size classes then has a known distribution, given the numbers of
each (Patefield 1981, doi:10.2307/2346669), from which random tables are drawn. This is a permutation test, whose
p-value (1 + b) / (1 + m) has b of m random tables with a distance at least as large; it is exact for any gradation
(Phipson & Smyth 2010, doi:10.2202/1544-6115.1585). The largest distance of all layers gives one p-value for the
packing, which needs no correction for the number of layers. Distances have few different values; for the test equal
ones are ordered by the mean squared difference of the shares, without which p-values would be too large.
"""

import math
from dataclasses import dataclass

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.lazy import Dataset, load
from voxgran._base.seeds import stream
from voxgran.measures.model import Groups, Measure, dataset, length_unit, variable
from voxgran.measures.region import Regions
from voxgran.measures.registered.density import INSET
from voxgran.packing.model import Packing

#: relative difference up to which two diameters or densities are equal
SAME = 1e-9
#: largest number of size classes
CLASSES = 5
#: a correlation above this, and above so many standard deviations of independent sizes and places, is worth a warning
NOTABLE, DEVIATIONS = 0.3, 3.0


@dataclass(frozen=True, eq=False)
class Segregation:
    """Correlations of size and height, and mean heights of size classes from small to large."""

    whole: float  # of all grains; NaN without gravity, for fewer than three grains and for equal sizes or heights
    bulk: float  # of the grains with their centroids in the bulk, likewise
    smallest: Floats  # (k,) smallest diameter of each class, in the unit of lengths
    largest: Floats  # (k,) largest one
    count: Integers  # (k,) grains of each class
    height: Floats  # (k,) mean height of their centroids above the lowest point of the bounds of the container
    by_density: float = math.nan  # correlation of density and height of all grains; NaN where all densities are equal


def segregation(packing: Packing) -> Segregation:
    """Return the correlation of size and height, in the whole packing and in the bulk.

    The bulk is that of the bulk solid fraction: at least 1.5 median diameters from each wall and below the height up to
    which 85 % of the volume of the grains lies. Grains are put in at most five classes of about equal numbers, by size;
    equal sizes are in one class.
    """
    height = heights(packing)
    if height is None or not packing.count:
        empty = np.zeros(0)
        return Segregation(math.nan, math.nan, empty, empty, np.zeros(0, np.int64), empty)
    rank = ranks_of(packing.diameters)
    bulk = math.nan
    if rank.max() > 0:
        region = Regions(packing).at(INSET * float(np.median(packing.diameters)))
        kept: Booleans = region.grains(packing)
        bulk = _spearman(rank[kept], height[kept])
    group = _classes(rank)
    members = [np.flatnonzero(group == k) for k in range(group.max() + 1)]
    return Segregation(
        _spearman(rank, height),
        bulk,
        np.array([packing.diameters[m].min() for m in members]),
        np.array([packing.diameters[m].max() for m in members]),
        np.array([len(m) for m in members]),
        np.array([height[m].mean() for m in members]),
        _spearman(ranks_of(packing.densities), height),
    )


def heights(packing: Packing) -> Floats | None:
    """Return the heights of the centroids against gravity, (n,), above the lowest point of the bounds of the container;
    None without gravity.
    """
    if packing.gravity is None:
        return None
    up = -np.array(packing.gravity)
    lower, upper = packing.container.bounds
    lowest = np.where(up > 0, lower, upper)
    return np.asarray(linear.matmul(packing.position - lowest, up))


def ranks_of(values: Floats) -> Integers:
    """Return the rank of each diameter or density among the different ones, (n,) from 0; those that differ by round-off
    are equal.
    """
    order = np.argsort(values, kind="stable")
    ordered = values[order]
    larger = np.diff(ordered, prepend=ordered[:1]) > SAME * ordered
    ranks = np.zeros(len(values), np.int64)
    ranks[order] = np.cumsum(larger)
    return ranks


def is_notable(correlation: float, count: int) -> bool:
    """Return whether a correlation in a packing of so many grains is worth a warning: above 0.3 in magnitude, and above
    three standard deviations of that of independent sizes and places.
    """
    limit = max(NOTABLE, DEVIATIONS / math.sqrt(max(count - 1, 1)))
    return abs(correlation) > limit


def warning_of(correlation: float, count: int) -> str:
    """Return a warning of a segregated packing as one sentence; empty where there is nothing to warn of."""
    if not is_notable(correlation, count):
        return ""
    side = "above" if correlation > 0 else "below"
    return (
        f"large grains lie {side} small ones: the rank correlation of diameter and height is {correlation:.2f}, where "
        f"at most {NOTABLE:g} in magnitude is usual; pack with another method, or state it with the results"
    )


def _spearman(rank: Integers, height: Floats) -> float:
    """Return Spearman's correlation of two values of each grain; NaN where one is the same for all."""
    if len(rank) < 3 or rank.min() == rank.max() or height.min() == height.max():
        return math.nan
    average = load("scipy.stats").rankdata  # bits: ranks
    one, other = (values - values.mean() for values in (average(rank), average(height)))
    return float((one * other).sum() / np.sqrt((one**2).sum() * (other**2).sum()))


def _classes(rank: Integers) -> Integers:
    """Return the class of each grain, (n,) from 0 without gaps, from small to large; equal sizes are in one class."""
    below = np.searchsorted(np.sort(rank), rank, side="left")
    within = np.searchsorted(np.sort(rank), rank, side="right")
    # by the middle of the places that grains of the same size have among all
    wanted = (below + within) * CLASSES // (2 * len(rank)) if rank.max() >= CLASSES else rank
    return np.asarray(np.unique(wanted, return_inverse=True)[1])


def _applies(packing: Packing) -> bool:
    """Return whether there are gravity and different sizes or densities."""
    different = any(ranks_of(values).any() for values in (packing.diameters, packing.densities))
    return packing.gravity is not None and packing.count > 0 and different


@dataclass(frozen=True, eq=False)
class Layers:
    """Layers of k different grains from low to high; NaN is not known."""

    count: Integers  # (k,) number of grains
    height: Floats  # (k,) mean height
    mean: Floats  # (k,) mean diameter
    error: Floats  # (k,) standard error of the mean of so many grains drawn from all without replacement
    quantiles: Floats  # (k, 5) diameters up to which the shares of QUANTILES of the grains are
    distance: Floats  # (k,) of the gradation from that of all grains
    p_values: Floats  # (k,) probability of as large a distance in random order, of this layer alone
    largest: float  # largest distance of all layers
    p_value: float  # probability of as large a distance of any layer in random order


def layers_of(packing: Packing) -> Layers:
    """Return the sizes of layers of equal numbers of grains, from low to high; none without gravity."""
    height = heights(packing)
    if height is None:
        height = np.zeros(0)
    return size_layers(packing.diameters[: len(height)], ranks_of(packing.diameters[: len(height)]), height)


def _compute(packing: Packing) -> Groups:
    """Return the correlations, the mean heights of the size classes, and the sizes of the layers."""
    found, unit, row = segregation(packing), length_unit(packing), ("size_class",)
    label = "rank correlation (Spearman) of diameter and height against gravity"
    layers = layers_of(packing)
    values = {
        "segregation": variable((), found.whole, "1", label),
        "bulk_segregation": variable((), found.bulk, "1", f"{label}, of the grains in the bulk"),
        "layer_distance": variable((), layers.largest, "1", "largest distance of the gradation of a layer"),
        "layer_p_value": variable(
            (), layers.p_value, "1", "probability of as large a distance of any layer in random order"
        ),
    }
    if not math.isnan(found.by_density):
        label = label.replace("diameter", "density")
        values["density_segregation"] = variable((), found.by_density, "1", label)
    classes = {
        "smallest_diameter": variable(row, found.smallest, unit, "smallest equivalent diameter of the size class"),
        "largest_diameter": variable(row, found.largest, unit, "largest equivalent diameter of the size class"),
        "class_count": variable(row, found.count, "1", "number of grains of the size class"),
        "mean_height": variable(row, found.height, unit, "mean height of the centroids of the size class"),
    }
    return {"/": dataset(values), "/size_classes": dataset(classes), "/layers": _layer_dataset(layers, unit)}


def _layer_dataset(layers: Layers, unit: str) -> "Dataset":
    """Return the variables of the layers."""
    row, test = ("layer",), "of the gradation, by number, from that of all grains (Kolmogorov-Smirnov)"
    made = {
        "layer_count": variable(row, layers.count, "1", "number of grains of the layer"),
        "mean_height": variable(row, layers.height, unit, "mean height of the centroids of the layer"),
        "mean_diameter": variable(row, layers.mean, unit, "mean equivalent diameter of the layer"),
        "mean_diameter_error": variable(row, layers.error, unit, "standard error of the mean of as many random grains"),
        "diameter": variable(
            (*row, "share"), layers.quantiles, unit, "equivalent diameter up to which that share of the grains is"
        ),
        "distance": variable(row, layers.distance, "1", f"largest difference {test}"),
        "p_value": variable(
            row, layers.p_values, "1", "probability of as large a distance of the layer in random order"
        ),
    }
    return dataset(made, {"share": variable(("share",), QUANTILES, "1", "share of the grains by number")})


registration = Measure(
    summary="rank correlation of diameter (and density) and height, size classes, and the gradation of layers",
    groups=("/", "/size_classes", "/layers"),
    compute=_compute,
    tilted=True,
    applies=_applies,
)


#: largest number of layers, and fewest grains of one
LAYERS, FEWEST = 8, 10
#: random tables, and largest number of size classes at whose limits gradations are compared with them
TABLES, RANKED = 999, 100
#: shares by number of which the diameter is given
QUANTILES = (0.1, 0.25, 0.5, 0.75, 0.9)
#: weight of the mean squared difference, which orders equal distances, and accuracy of a distance
TIES, ROUND_OFF = 1e-3, 1e-12


def size_layers(diameters: Floats, ranks: Integers, height: Floats) -> Layers:
    """Return layers of grains by their diameters, the ranks of these among the different ones, and heights, (n,) each.

    There are 8 layers of at least 10 grains, or fewer of them; none for fewer than 20 grains or a single size. Grains
    of equal height are in random order, drawn from a fixed seed. Distances are exact; they are compared with those of
    random tables at the limits of at most 100 size classes.
    """
    n = len(diameters)
    many = min(LAYERS, n // FEWEST)
    if many < 2 or ranks.max(initial=0) == 0:
        none, whole = np.zeros(0), np.zeros(0, np.int64)
        return Layers(whole, none, none, none, np.zeros((0, len(QUANTILES))), none, none, math.nan, math.nan)
    order = np.lexsort((stream(0, "layers of equal heights").random(n), height))
    members = np.array_split(order, many)
    count = np.array([len(some) for some in members])
    layer = np.empty(n, np.int64)
    layer[order] = np.repeat(np.arange(many), count)
    left = (n - count) / (count * (n - 1.0))
    distance = np.abs(_differences(_table(layer, ranks, many)[None])[0]).max(axis=1)
    classes = _ranked(ranks)
    p_values, p_value = _probabilities(_table(layer, classes, many))
    return Layers(
        count,
        np.array([height[some].mean() for some in members]),
        np.array([diameters[some].mean() for some in members]),
        float(diameters.std()) * np.sqrt(left),
        np.array([np.quantile(diameters[some], QUANTILES, method="inverted_cdf") for some in members]),
        distance,
        p_values,
        float(distance.max()),
        p_value,
    )


def _ranked(ranks: Integers) -> Integers:
    """Return the size class of each grain, (n,) from 0 without gaps: each size, or classes of about equal numbers."""
    if ranks.max() < RANKED:
        return ranks
    below = np.searchsorted(np.sort(ranks), ranks, side="left")
    return np.asarray(np.unique(below * RANKED // len(ranks), return_inverse=True)[1])


def _table(layer: Integers, kind: Integers, many: int) -> Integers:
    """Return how many grains of each layer are in each class, (layers, classes)."""
    width = int(kind.max()) + 1
    return np.bincount(layer * width + kind, minlength=many * width).reshape(many, width)


def _differences(tables: Integers) -> Floats:
    """Return cumulative shares of layers less the shares in all layers, (t, layers, classes), of such tables."""
    grains = tables[0].sum(axis=1)
    whole = np.cumsum(tables[0].sum(axis=0)) / grains.sum()
    return np.asarray(np.cumsum(tables, axis=2) / grains[None, :, None] - whole)


def _tested(tables: Integers) -> Floats:
    """Return what is tested of each layer, (t, layers): the distance, and a small share of the mean square."""
    difference = _differences(tables)
    return np.asarray(np.abs(difference).max(axis=2) + TIES * np.square(difference).mean(axis=2))


def _probabilities(table: Integers) -> tuple[Floats, float]:
    """Return the p-value of each layer, and that of the largest distance, against random tables."""
    draw = load("scipy.stats").random_table(table.sum(axis=1), table.sum(axis=0))  # bits: whole numbers
    generator = stream(0, "layers in random order")
    tables = np.asarray(draw.rvs(TABLES, random_state=generator)).astype(np.int64)
    here, drawn = _tested(table[None])[0] - ROUND_OFF, _tested(tables)
    each = (1.0 + (drawn >= here).sum(axis=0)) / (1.0 + TABLES)
    return each, (1.0 + int((drawn.max(axis=1) >= here.max()).sum())) / (1.0 + TABLES)
