"""Gradation: the requested and the placed sizes.

Sizes are equivalent diameters; the intermediate axes, by which real grains pass a sieve, are given as well. The
distance between the requested and the placed distribution is that of Kolmogorov and Smirnov: the largest difference of
the cumulative curves.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from voxgran._base.arrays import Floats
from voxgran.measures.model import Groups, Measure, dataset, length_unit, variable
from voxgran.measures.registered.grains import intermediate_axes
from voxgran.packing.model import Packing
from voxgran.shapes.size_laws.distribution import Basis, SizeDistribution
from voxgran.shapes.size_laws.sieve import Sieve

#: points of the curves
POINTS = 201
#: classes of a distribution that is no sieve curve
CLASSES = 8
#: relative difference below which two sizes count as equal
SAME = 1e-9
#: share by volume of requested sizes that may lie beyond either end of the curves
ENDS = 1e-3
BASES: tuple[Basis, Basis] = ("number", "volume")


@dataclass(frozen=True, eq=False)
class Gradation:
    """Cumulative curves over the size, by ``"number"`` and by ``"volume"``."""

    sizes: Floats  # (k,) sizes, evenly spaced in their logarithm, in the unit of lengths
    placed: dict[Basis, Floats]  # share of the placed grains with equivalent diameters up to each size
    placed_by_axis: dict[Basis, Floats]  # the same for intermediate axes
    asked: dict[Basis, Floats]  # requested share; empty without a requested distribution
    distance: dict[Basis, float]  # Kolmogorov-Smirnov distance between requested and placed; likewise
    by_axis: bool  # whether the requested sizes are intermediate axes


def gradation(packing: Packing) -> Gradation:
    """Return the placed sizes beside the requested ones; curves without points if there are no grains."""
    asked = packing.asked_sizes
    by_axis = asked is not None and asked.by_intermediate_axis
    diameters, axes = packing.diameters, intermediate_axes(packing)
    both = np.concatenate([diameters, axes])
    low, high = size_range(both, asked, packing.dimension) if packing.count else (1.0, 1.0)
    sizes = np.geomspace(low / 1.05, high * 1.05, POINTS) if packing.count else np.zeros(0)
    placed: dict[Basis, Floats] = {}
    by_axes: dict[Basis, Floats] = {}
    shares: dict[Basis, Floats] = {}
    distance: dict[Basis, float] = {}
    for basis in BASES:
        weights = np.ones(packing.count) if basis == "number" else packing.volumes
        placed[basis] = _cumulative(diameters, weights, sizes)
        by_axes[basis] = _cumulative(axes, weights, sizes)
        if asked is not None and packing.count:
            shares[basis] = asked.cumulative(sizes, basis=basis, dimension=packing.dimension)
            distance[basis] = distance_from(
                asked, axes if by_axis else diameters, weights, basis=basis, dimension=packing.dimension
            )
    return Gradation(sizes, placed, by_axes, shares, distance, by_axis)


def size_classes(packing: Packing) -> tuple[Floats, Floats, Floats] | None:
    """Return the ends (k + 1,) of classes of sizes, from small to large, and the shares by volume (k,) that each has of
    the requested distribution and of the placed grains; None without a requested distribution or grains.

    The ends are the openings of a sieve curve, else evenly spaced in their logarithm.
    """
    asked = packing.asked_sizes
    if asked is None or not packing.count:
        return None
    sizes = intermediate_axes(packing) if asked.by_intermediate_axis else packing.diameters
    if isinstance(asked, Sieve) and asked.openings is not None:
        ends = np.array(asked.openings)
    else:
        ends = np.geomspace(*size_range(sizes, asked, packing.dimension), CLASSES + 1)
    shares = asked.cumulative(ends, basis="volume", dimension=packing.dimension)
    return ends, np.diff(shares), np.diff(_cumulative(sizes, packing.volumes, ends))


def _cumulative(sizes: Floats, weights: Floats, points: Floats) -> Floats:
    """Return the share of the weights of sizes up to each point; NaN if all weights are zero."""
    if not len(sizes):
        return np.zeros(len(points))
    if not weights.any():
        return np.full(len(points), np.nan)
    order = np.argsort(sizes, kind="stable")
    total = np.concatenate([[0.0], np.cumsum(weights[order])])
    return np.asarray(total[np.searchsorted(sizes[order], points * (1 + SAME), side="right")] / total[-1])


def size_range(sizes: Floats, asked: SizeDistribution | None, dimension: int) -> tuple[float, float]:
    """Return smallest and largest size, which hold all but a thousandth by volume of the requested ones on each side
    too.
    """
    low, high = float(sizes.min()), float(sizes.max())
    if asked is None:
        return low, high
    ends = asked.quantile([ENDS, 1.0 - ENDS], basis="volume", dimension=dimension)
    return min(low, float(ends[0])), max(high, float(ends[1]))


def distance_from(asked: SizeDistribution, sizes: Floats, weights: Floats, *, basis: Basis, dimension: int) -> float:
    """Return the largest difference between the requested curve and that of sizes (n,) with weights (n,).

    Both curves increase, and that of the sizes only at these; the largest difference is therefore at one of these
    or just below.
    """
    points, d = np.unique(sizes), dimension
    at, below = points * (1 + SAME), points * (1 - SAME)
    placed_at, placed_below = _cumulative(sizes, weights, at), _cumulative(sizes, weights, below * (1 - SAME))
    differences = [
        placed_at - asked.cumulative(at, basis=basis, dimension=d),
        placed_below - asked.cumulative(below, basis=basis, dimension=d),
    ]
    return float(np.abs(np.concatenate(differences)).max())


def _compute(packing: Packing) -> Groups:
    """Return the curves and the distances."""
    found, unit, row = gradation(packing), length_unit(packing), ("size",)
    values: dict[str, Any] = {}
    for basis in BASES:
        label = f"share by {basis} of placed grains with"
        values[f"placed_{basis}"] = variable(
            row, found.placed[basis], "1", f"{label} equivalent diameters up to the size"
        )
        values[f"placed_{basis}_by_axis"] = variable(
            row, found.placed_by_axis[basis], "1", f"{label} intermediate axes up to the size"
        )
        if basis in found.asked:
            kind = "intermediate axes" if found.by_axis else "equivalent diameters"
            values[f"asked_{basis}"] = variable(
                row, found.asked[basis], "1", f"requested share by {basis}, over {kind}"
            )
            values[f"distance_{basis}"] = variable(
                (),
                found.distance[basis],
                "1",
                f"Kolmogorov-Smirnov distance by {basis} between requested and placed {kind}",
            )
    sizes = variable(row, found.sizes, unit, "size of a grain")
    return {"/gradation": dataset(values, {"size": sizes})}


registration = Measure(
    summary="cumulative curves of the requested and the placed sizes",
    groups=("/gradation",),
    compute=_compute,
    tilted=True,
)
