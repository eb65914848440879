"""Coordination number as a function of the gap up to which neighbours are counted, its distribution, and rattlers.

Computed packings leave gaps between grains in contact, of the order of a voxel, of the spacing of control points or of
a tolerance. The coordination number is meaningful where its curve over the gap has a plateau.

A rattler is a grain that bears no load. Which contacts prove that depends on the packing:

- Where the forces at the contacts are known, as in a settled bed, rattlers are the grains that rest and carry nothing
  but themselves, as :func:`voxgran.equilibrium` finds them.
- Spheres and disks without gravity are held without friction by at least d + 1 contacts in d dimensions. Rattlers are
  removed repeatedly, since they hold no others: O'Hern, Silbert, Liu & Nagel 2003, doi:10.1103/PhysRevE.68.011306;
  Donev, Torquato & Stillinger 2005, doi:10.1103/PhysRevE.71.011105.
- With friction, and for other shapes, whose faces and edges touch in many points, two contacts can hold a grain.
  Rattlers have at most one: Thornton 2000, doi:10.1680/geot.2000.50.1.43. Without gravity they are removed repeatedly;
  under gravity they are not, since a grain may carry the weight of a rattler.

Walls and the lid count as contacts of a grain for this decision, but not in its coordination number.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import Booleans, Floats, Integers, as_floats, as_number
from voxgran._base.errors import InputError
from voxgran.contacts.model import Contacts
from voxgran.contacts.verify import TOLERANCE
from voxgran.contacts.walls import walls_touched
from voxgran.measures.model import Groups, Measure, dataset, variable
from voxgran.packing.jamming.coordination import NearPairs
from voxgran.packing.model import Packing

#: gap for the neighbours of a single grain where the packing has no contact gap, and largest gap of the curve, in mean
#: diameters
REFERENCE_GAP = 0.01
WIDEST_GAP = 0.1
#: fewest contacts that can hold a grain by friction, or by its faces
FEWEST = 2


@dataclass(frozen=True, eq=False)
class Coordination:
    """Numbers of neighbours; gaps are in mean diameters."""

    gaps: Floats  # (k,)
    mean: Floats  # (k,) mean number of neighbours with at most that gap; NaN without grains
    of_grain: Integers  # (n,) number of neighbours of each grain at the reference gap
    reference_gap: float


@dataclass(frozen=True, eq=False)
class Rattlers:
    """The grains that bear no load, and the contacts among the others."""

    mask: Booleans  # (n,) whether each grain is a rattler
    share: float  # of all grains; NaN without grains
    coordination: float  # mean number of contacts of the other grains with each other; NaN where there are none
    definition: str  # what makes a grain a rattler


def coordination_number(
    packing: Packing, gaps: "ArrayLike | None" = None, *, reference_gap: float | None = None
) -> Coordination:
    """Return the coordination number as a function of the gap, and that of each grain at the reference gap.

    Gaps are largest distances of the surfaces in mean diameters, by default 0 and values from 1e-6 to 0.1, and
    :func:`usual_gap`. A pair within the gap across several periodic images counts once for each.

    Raises
    ------
    InputError
        If a gap is negative or not finite.
    """
    default = np.concatenate([[0.0], np.logspace(-6, libm.log10(WIDEST_GAP), 11)])
    wanted = as_floats(default if gaps is None else gaps, "gaps", shape=(None,))
    if wanted.min(initial=0.0) < 0:
        raise InputError(f"gaps hold {wanted.min()}: none may be negative; take 0 for grains that touch")
    usual = usual_gap(packing) if reference_gap is None else reference_gap
    reference = as_number(usual, "reference_gap", at_least=0.0)
    diameter = mean_diameter(packing)
    found = near_contacts(packing, max(reference, float(wanted.max(initial=0.0))))
    ordered = np.sort(found.gap)
    pairs = np.searchsorted(ordered, (wanted + TOLERANCE) * diameter, side="right")
    with np.errstate(invalid="ignore"):
        mean = 2.0 * pairs / np.float64(packing.count)
    return Coordination(wanted, mean, _of_grains(packing, found, (reference + TOLERANCE) * diameter), reference)


def find_rattlers(packing: Packing) -> Rattlers:
    """Return the rattlers of a packing, found once and kept.

    The definition depends on what is known of the packing, see the head of this file. Contacts are those at
    :func:`usual_gap`, walls included.
    """
    if "rattlers" not in packing._found:
        packing._found["rattlers"] = _rattlers(packing)
    found: Rattlers = packing._found["rattlers"]
    return found


def _rattlers(packing: Packing) -> Rattlers:
    """Find the rattlers of a packing."""
    contacts, n = touching_contacts(packing), packing.count
    if packing.forces is not None:
        mask = packing.forces.rattler
        definition = "a grain that rests and, by the contact forces, carries nothing but itself"
        if packing.forces.stress is not None:
            definition = "a grain with fewer than 2 contacts that bear forces"
    else:
        free = packing.gravity is None
        round_grains = all(packing.shapes[k].is_sphere for k in np.unique(packing.shape_id))
        fewest = packing.dimension + 1 if free and round_grains else FEWEST
        walls = walls_touched(packing, usual_gap(packing) * mean_diameter(packing))
        at_wall = np.repeat(np.arange(n), walls)
        near = NearPairs(
            *(n, packing.dimension, contacts.i, contacts.j, np.zeros(contacts.count)),
            *(at_wall, np.zeros(len(at_wall))),
        )
        mask = ~near.bearing(0.0, fewest, repeated=free)
        definition = f"a grain with fewer than {fewest} contacts with grains{', rattlers removed,' * free} and walls"
    among = int((~mask[contacts.i] & ~mask[contacts.j]).sum())
    bearing = n - int(mask.sum())
    mean = 2.0 * among / bearing if bearing else math.nan
    return Rattlers(mask, float(mask.mean()) if n else math.nan, mean, definition)


def rattler_variables(packing: Packing) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the variables of the rattlers, of the root and of the grains, the same for all measures."""
    found = find_rattlers(packing)
    share = variable((), found.share, "1", "share of the grains that are rattlers")
    column = variable(("grain",), found.mask, "1", "whether the grain is a rattler")
    for _, _, attributes in (share, column):
        attributes["definition"] = found.definition
    return {"share_of_rattlers": share}, {"rattler": column}


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
    return packing.contacts(wanted * mean_diameter(packing))


def touching_contacts(packing: Packing) -> Contacts:
    """Return the contacts up to :func:`usual_gap`, found once and kept."""
    if "touching" not in packing._found:
        found = near_contacts(packing)
        near = found.gap <= (usual_gap(packing) + TOLERANCE) * mean_diameter(packing)
        packing._found["touching"] = found.where(near)
    touching: Contacts = packing._found["touching"]
    return touching


def mean_diameter(packing: Packing) -> float:
    """Return the mean equivalent diameter of the grains, 0 without grains."""
    return float(packing.diameters.mean()) if packing.count else 0.0


def _of_grains(packing: Packing, found: Contacts, reach: float) -> Integers:
    """Count the neighbours of each grain."""
    near, n = found.gap <= reach, packing.count
    counts = np.bincount(found.i[near], minlength=n) + np.bincount(found.j[near], minlength=n)
    return counts.astype(np.int64)


def _compute(packing: Packing) -> Groups:
    """Return the curve, the coordination numbers of the grains, their mean and distribution, and the rattlers."""
    found, rattlers = coordination_number(packing), find_rattlers(packing)
    where = f"at a gap of at most {found.reference_gap:g} mean diameters"
    column = variable(("grain",), found.of_grain, "1", f"number of neighbours {where}")
    curve = variable(("gap",), found.mean, "1", "mean number of neighbours with at most that gap")
    gaps = variable(("gap",), found.gaps, "1", "largest gap, in mean diameters")
    mean = float(found.of_grain.mean()) if packing.count else math.nan
    others = variable(
        (), rattlers.coordination, "1", f"mean number of neighbours {where}, without rattlers and contacts with them"
    )
    others[2]["definition"] = rattlers.definition
    of_root, of_grains = rattler_variables(packing)
    root = {
        "mean_coordination_number": variable((), mean, "1", f"mean number of neighbours {where}"),
        "coordination_without_rattlers": others,
        **of_root,
    }
    return {
        "/": dataset(root),
        "/grains": dataset({"coordination_number": column, **of_grains}),
        "/profiles": dataset({"coordination_number": curve}, {"gap": gaps}),
        "/contact_numbers": dataset(*_distribution(found.of_grain, rattlers, where)),
    }


def _distribution(of_grain: Integers, rattlers: Rattlers, where: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the probabilities of the numbers of contacts and their standard errors, and the numbers as coordinate."""
    counts = np.bincount(of_grain)
    share = counts / max(len(of_grain), 1)
    error = np.sqrt(share * (1.0 - share) / max(len(of_grain), 1))
    row = ("contact_number",)
    values = {
        "probability": variable(row, share, "1", f"share of the grains with that number of neighbours {where}"),
        "probability_error": variable(row, error, "1", "standard error of the share, for independent grains"),
        "rattlers": variable(
            row, np.bincount(of_grain[rattlers.mask], minlength=len(counts)), "1", "number of rattlers among them"
        ),
    }
    return values, {"contact_number": variable(row, np.arange(len(counts)), "1", "number of neighbours of a grain")}


registration = Measure(
    summary="mean number of neighbours with and without rattlers, its distribution, and its curve over the gap",
    groups=("/", "/grains", "/profiles", "/contact_numbers"),
    compute=_compute,
    tilted=True,
)
