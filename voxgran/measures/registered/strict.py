"""Strict solid fraction: that of the packing with its grains shrunk in place until nothing overlaps."""

from dataclasses import replace

from voxgran.contacts.verify import verify
from voxgran.measures.model import Groups, Measure, dataset, variable
from voxgran.measures.registered.coordination import near_contacts
from voxgran.measures.window import NO_DEPTH
from voxgran.packing.model import Packing

#: precision of the factor on all lengths
PRECISION = 2.0**-20


def strict_solid_fraction(packing: Packing) -> float:
    """Return the solid fraction with all grains shrunk in place, by one factor, until `verify` is ok.

    The factor on the lengths is found by bisection to 2**-20, rounded down; 0 if no factor suffices.
    """
    if not packing.count or verify(packing).ok:
        return packing.solid_fraction
    low, high = 0.0, 1.0
    while high - low > PRECISION:
        middle = (low + high) / 2
        if verify(_shrunk(packing, middle)).ok:
            low = middle
        else:
            high = middle
    return packing.solid_fraction * low**packing.dimension


def _shrunk(packing: Packing, factor: float) -> Packing:
    """Return the packing with the grains shrunk about their centroids."""
    return replace(packing, scale=packing.scale * factor, forces=None)


def _overlaps(packing: Packing) -> bool:
    """Return whether grains overlap, as true shapes may after a method that works with voxels."""
    if packing.count < 2:
        return False
    gap = near_contacts(packing).gap
    return bool(gap.min(initial=0.0) < -NO_DEPTH * packing.diameters.mean())


def _compute(packing: Packing) -> Groups:
    """Return the strict solid fraction."""
    label = "solid fraction with all grains shrunk in place until none overlap"
    return {"/": dataset({"strict_solid_fraction": variable((), strict_solid_fraction(packing), "1", label)})}


registration = Measure(
    name="strict",
    summary="solid fraction after shrinking all grains until nothing overlaps",
    groups=("/",),
    compute=_compute,
    applies=_overlaps,
)
