"""ShapeReport: how alike drawn grains and real ones are, beside the error that the sample has by itself."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran._base.lazy import load
from voxgran._base.seeds import stream
from voxgran.shapes.learning.likeness import (
    COMPARED,
    QUICK,
    comparable,
    descriptors,
    distances,
    energy_distance,
    nearest_neighbour_test,
    quick_descriptors,
    signatures,
    spacing,
    spread_of,
)
from voxgran.shapes.learning.sample import checked_sample
from voxgran.shapes.model import Shape

if TYPE_CHECKING:
    from xarray import Dataset

#: pairs in the picture; random halves of the sample
PAIRS, HALVES = 6, 10


@dataclass(frozen=True, eq=False, repr=False)
class ShapeReport:
    """How alike drawn and real grains are.

    Attributes
    ----------
    table : xarray.Dataset
        ``energy_distance`` of the descriptors of drawn grains from those of real ones, ``sample_error``, that of the
        sample itself (from the test grains; without these, of its random halves from each other), ``novelty``, the
        median distance of drawn grains to the nearest one of the sample over that of real new grains (mirrored copies
        count as copies), ``same_neighbour``, the share of grains whose nearest neighbour is of their own kind, drawn or
        real (1/2 where they are alike), with its ``p_value``, and along ``descriptor`` the means and standard
        deviations of both. Descriptors that more than a tenth of the grains lack are left out: the roundness of coarse
        meshes.
    pairs : tuple of Shape
        Grains of the sample, each followed by its twin, for ``vg.save_gallery(report.pairs, "pairs.png", columns=4)``.
    """

    table: "Dataset"
    pairs: tuple[Shape, ...]

    def __repr__(self) -> str:
        """Show the numbers, one a line."""
        names = [name for name, variable in self.table.data_vars.items() if not variable.dims]
        return "\n".join(f"{name}: {float(self.table[name]):.3g}" for name in names)


def compared(
    given: Sequence[Shape],
    weights: Floats,
    drawn: Sequence[Shape],
    test: Sequence[Shape] | None,
    *,
    descriptors: bool,
    seed: int,
) -> ShapeReport:
    """Return the comparison of drawn grains with test grains, or with those that are given."""
    generator = stream(seed, "comparison of learned grains")
    others = None if test is None else checked_sample(test, None, None).shapes
    real = list(given) if others is None else others
    names, describe = (COMPARED, _described) if descriptors else (QUICK, quick_descriptors)
    rows, own = describe(drawn), describe(given)
    (rows, own, other), shared = comparable(rows, own, own if others is None else describe(real))
    spread, of_real = spread_of(other), weights if others is None else None
    values: dict[str, Any] = {"energy_distance": energy_distance(other, rows, spread, of_real)}
    if others is None:
        mixed = [generator.permutation(len(own)) for _ in range(HALVES)]
        halves = [np.array_split(order, 2) for order in mixed]
        errors = [energy_distance(own[a], own[b], spread, weights[a], weights[b]) for a, b in halves]
        values["sample_error"] = float(np.mean(errors))
    else:
        values["sample_error"] = energy_distance(own, other, spread, weights)
    marks, kept, known = map(signatures, (drawn, given, real))
    values["novelty"] = novelty(marks, kept, None if others is None else known)
    fewer = min(len(marks), len(known))
    share, p_value = nearest_neighbour_test(marks[:fewer], known[:fewer], generator)
    values |= {"same_neighbour": share, "p_value": p_value}
    w = np.full(len(other), 1 / len(other)) if of_real is None else of_real
    mean = linear.matmul(w, other)
    values |= {
        "drawn_mean": ("descriptor", rows.mean(axis=0)),
        "real_mean": ("descriptor", mean),
        "drawn_deviation": ("descriptor", rows.std(axis=0)),
        "real_deviation": ("descriptor", np.sqrt(linear.matmul(w, (other - mean) ** 2))),
    }
    table = load("xarray").Dataset(values, coords={"descriptor": np.array(names)[shared]})
    table.attrs = {"drawn": len(drawn), "real": len(real), "learned": len(given)}
    chosen = [shape for twin in drawn[:PAIRS] for shape in (given[twin.record["donor"]], twin)]
    return ShapeReport(table, tuple(chosen))


#: under another name than the argument of `compared`
_described = descriptors


def novelty(drawn: Floats, given: Floats, new: Floats | None) -> float:
    """Return the median distance of drawn signatures to the nearest given one over that of new ones; without new ones,
    over that of the given ones from each other.
    """
    far = spacing(given) if new is None else float(np.median(distances(new, given).min(axis=1)))
    return float(np.median(distances(drawn, given).min(axis=1)) / max(far, 1e-300))
