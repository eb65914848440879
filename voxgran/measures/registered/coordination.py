"""Coordination number as a function of the gap up to which neighbours are counted.

Computed packings leave gaps between grains in contact, of the order of a voxel, of the spacing of control points or of
a tolerance. The coordination number is meaningful where its curve over the gap has a plateau.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arrays import Floats, Integers, as_floats, as_number
from voxgran._base.errors import InputError
from voxgran.contacts.model import Contacts
from voxgran.measures.model import Groups, Measure, dataset, variable
from voxgran.packing.model import Packing

#: gap for the neighbours of a single grain where the packing has no contact gap, and largest gap of the curve, in mean
#: diameters
REFERENCE_GAP = 0.01
WIDEST_GAP = 0.1
#: accuracy of gaps, in mean diameters; it is added to all limits, so that grains in contact have the gap 0
ROUND_OFF = 1e-12


@dataclass(frozen=True, eq=False)
class Coordination:
    """Numbers of neighbours; gaps are in mean diameters."""

    gaps: Floats  # (k,)
    mean: Floats  # (k,) mean number of neighbours with at most that gap; NaN without grains
    of_grain: Integers  # (n,) number of neighbours of each grain at the reference gap
    reference_gap: float


def coordination_number(
    packing: Packing, gaps: ArrayLike | None = None, *, reference_gap: float | None = None
) -> Coordination:
    """Return the coordination number as a function of the gap, and that of each grain at the reference gap.

    Gaps are largest distances of the surfaces in mean diameters, by default 0 and values from 1e-6 to 0.1, and
    :func:`usual_gap`. A pair within the gap across several periodic images counts once for each.

    Raises
    ------
    InputError
        If a gap is negative or not finite.
    """
    default = np.concatenate([[0.0], np.logspace(-6, np.log10(WIDEST_GAP), 11)])
    wanted = as_floats(default if gaps is None else gaps, "gaps", shape=(None,))
    if wanted.min(initial=0.0) < 0:
        raise InputError(f"gaps hold {wanted.min()}: none may be negative; take 0 for grains that touch")
    usual = usual_gap(packing) if reference_gap is None else reference_gap
    reference = as_number(usual, "reference_gap", at_least=0.0)
    diameter = mean_diameter(packing)
    found = near_contacts(packing, max(reference, float(wanted.max(initial=0.0))))
    ordered = np.sort(found.gap)
    pairs = np.searchsorted(ordered, (wanted + ROUND_OFF) * diameter, side="right")
    with np.errstate(invalid="ignore"):
        mean = 2.0 * pairs / np.float64(packing.count)
    return Coordination(wanted, mean, _of_grains(packing, found, (reference + ROUND_OFF) * diameter), reference)


def usual_gap(packing: Packing) -> float:
    """Return the gap up to which grains of a packing count as touching, in mean diameters.

    It is the contact gap of the packing, such as one voxel, the spacing of the control points or the gap at which a
    settled bed rests; 0.01 where that is not known.
    """
    known = packing.contact_gap > 0 and packing.count
    return packing.contact_gap / mean_diameter(packing) if known else REFERENCE_GAP


def near_contacts(packing: Packing, gap: float | None = None) -> Contacts:
    """Return the contacts, which are cached, up to a gap in mean diameters.

    By default it is the largest gap of the curve of the coordination number and :func:`usual_gap`, so that contacts are
    found once for all measures.
    """
    wanted = max(WIDEST_GAP, usual_gap(packing)) if gap is None else as_number(gap, "gap", at_least=0.0)
    return packing.contacts((wanted + ROUND_OFF) * mean_diameter(packing))


def mean_diameter(packing: Packing) -> float:
    """Return the mean equivalent diameter of the grains, 0 without grains."""
    return float(packing.diameters.mean()) if packing.count else 0.0


def _of_grains(packing: Packing, found: Contacts, reach: float) -> Integers:
    """Count the neighbours of each grain."""
    near, n = found.gap <= reach, packing.count
    counts = np.bincount(found.i[near], minlength=n) + np.bincount(found.j[near], minlength=n)
    return counts.astype(np.int64)


def _compute(packing: Packing) -> Groups:
    """Return the curve, the coordination numbers of the grains and their mean."""
    found = coordination_number(packing)
    where = f"at a gap of at most {found.reference_gap:g} mean diameters"
    column = variable(("grain",), found.of_grain, "1", f"number of neighbours {where}")
    curve = variable(("gap",), found.mean, "1", "mean number of neighbours with at most that gap")
    gaps = variable(("gap",), found.gaps, "1", "largest gap, in mean diameters")
    mean = float(found.of_grain.mean()) if packing.count else math.nan
    return {
        "/": dataset({"mean_coordination_number": variable((), mean, "1", f"mean number of neighbours {where}")}),
        "/grains": dataset({"coordination_number": column}),
        "/profiles": dataset({"coordination_number": curve}, {"gap": gaps}),
    }


registration = Measure(
    name="coordination",
    summary="mean number of neighbours as a function of the gap, and the number of each grain",
    groups=("/", "/grains", "/profiles"),
    compute=_compute,
)
