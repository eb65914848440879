"""Sizes of grains layer by layer, and whether their order along the height is random.

Layers hold equal numbers of grains. The distance of a layer is the Kolmogorov-Smirnov statistic of its gradation by
number against that of all grains, the largest difference of the two cumulative shares. In random order a layer is a
sample of the grains without replacement. The table of layers and size classes then has a known distribution, given
the numbers of each (Patefield 1981, doi:10.2307/2346669), from which random tables are drawn. This is a permutation
test, whose p-value (1 + b) / (1 + m) has b of m random tables with a distance at least as large; it is exact for any
gradation (Phipson & Smyth 2010, doi:10.2202/1544-6115.1585). The largest distance of all layers gives one p-value for
the packing, which needs no correction for the number of layers. Distances have few different values; for the test equal
ones are ordered by the mean squared difference of the shares, without which p-values would be too large.
"""

import math
from dataclasses import dataclass

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.lazy import load
from voxgran._base.seeds import stream

#: largest number of layers, and fewest grains of one
LAYERS, FEWEST = 8, 10
#: random tables, and largest number of size classes at whose limits gradations are compared with them
TABLES, CLASSES = 999, 100
#: shares by number of which the diameter is given
QUANTILES = (0.1, 0.25, 0.5, 0.75, 0.9)
#: weight of the mean squared difference, which orders equal distances, and accuracy of a distance
TIES, ROUND_OFF = 1e-3, 1e-12


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
    classes = _classes(ranks)
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


def _classes(ranks: Integers) -> Integers:
    """Return the size class of each grain, (n,) from 0 without gaps: each size, or classes of about equal numbers."""
    if ranks.max() < CLASSES:
        return ranks
    below = np.searchsorted(np.sort(ranks), ranks, side="left")
    return np.asarray(np.unique(below * CLASSES // len(ranks), return_inverse=True)[1])


def _table(layer: Integers, kind: Integers, many: int) -> Integers:
    """Return how many grains of each layer are in each class, (layers, classes)."""
    width = int(kind.max()) + 1
    return np.bincount(layer * width + kind, minlength=many * width).reshape(many, width)


def _differences(tables: Integers) -> Floats:
    """Return cumulative shares of layers less those of the whole, (t, layers, classes), of tables of that shape."""
    grains = tables[0].sum(axis=1)
    whole = np.cumsum(tables[0].sum(axis=0)) / grains.sum()
    return np.asarray(np.cumsum(tables, axis=2) / grains[None, :, None] - whole)


def _tested(tables: Integers) -> Floats:
    """Return what is tested of each layer, (t, layers): the distance, and a small share of the mean square."""
    difference = _differences(tables)
    return np.asarray(np.abs(difference).max(axis=2) + TIES * np.square(difference).mean(axis=2))


def _probabilities(table: Integers) -> tuple[Floats, float]:
    """Return the p-value of each layer, and that of the largest distance, against random tables."""
    draw = load("scipy.stats").random_table(table.sum(axis=1), table.sum(axis=0))
    generator = stream(0, "layers in random order")
    tables = np.asarray(draw.rvs(TABLES, random_state=generator)).astype(np.int64)
    here, drawn = _tested(table[None])[0] - ROUND_OFF, _tested(tables)
    each = (1.0 + (drawn >= here).sum(axis=0)) / (1.0 + TABLES)
    return each, (1.0 + int((drawn.max(axis=1) >= here.max()).sum())) / (1.0 + TABLES)
