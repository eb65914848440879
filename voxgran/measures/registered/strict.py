"""How dense a packing is when its grains are shrunk in place until they are free of each other and of the walls."""

from dataclasses import replace
from typing import TYPE_CHECKING

from voxgran.contacts.verify import verify
from voxgran.measures.model import Measure, dataset, variable
from voxgran.measures.window import NO_DEPTH
from voxgran.packing.model import Packing

if TYPE_CHECKING:
    from xarray import Dataset

#: the factor on all lengths is found to this precision
PRECISION = 2.0**-20


def strict_solid_fraction(packing: Packing) -> float:
    """Return the solid fraction with all grains shrunk in place, by one factor, until `verify` is ok.

    Parameters
    ----------
    packing : Packing
        The packing.

    Returns
    -------
    float
        The solid fraction itself where `verify` is ok with it; else below it, with the factor on the lengths found to
        2**-20 by bisection, on the safe side. 0 where no factor is enough.
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
    return replace(packing, scale=packing.scale * factor)


def _overlaps(packing: Packing) -> bool:
    """Return whether grains overlap, as they may in truth where a method works with voxels."""
    if packing.count < 2:
        return False
    gap = packing.contacts(0.0).gap
    return bool(gap.min(initial=0.0) < -NO_DEPTH * packing.diameters.mean())


def _compute(packing: Packing) -> "dict[str, Dataset]":
    """Return the strict solid fraction."""
    label = "solid fraction with all grains shrunk in place until none overlap"
    return {"/": dataset({"strict_solid_fraction": variable((), strict_solid_fraction(packing), "1", label)})}


registration = Measure(
    name="strict",
    summary="solid fraction after shrinking all grains until none overlap",
    groups=("/",),
    compute=_compute,
    applies=_overlaps,
)
