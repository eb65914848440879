"""Strict solid fraction: that of the packing with its grains shrunk in place until nothing overlaps."""

from voxgran._base.arithmetic import linear
from voxgran._base.compiling.threads import using_threads
from voxgran.contacts.assembly import Assembly
from voxgran.contacts.broad import Pairs, grain_pairs
from voxgran.contacts.find import contacts_of_pairs
from voxgran.contacts.verify import TOLERANCE, verify
from voxgran.contacts.walls import escape_depths
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
    # grains shrunk in place meet no others than those that they are near at full size
    near = grain_pairs(packing, 0.0)
    low, high = 0.0, 1.0
    while high - low > PRECISION:
        middle = (low + high) / 2
        if _is_free(_shrunk(packing, middle), near):
            low = middle
        else:
            high = middle
    return packing.solid_fraction * low**packing.dimension


def _shrunk(packing: Packing, factor: float) -> Assembly:
    """Return the grains shrunk about their centroids."""
    scale = packing.scale * factor
    return Assembly(
        packing.shapes,
        packing.shape_id,
        scale,
        packing.position,
        packing.orientation,
        packing.container,
        lid=packing.lid,
    )


def _is_free(assembly: Assembly, near: Pairs) -> bool:
    """Return whether `verify` finds no overlap and no escape of grains of which no other pairs can overlap."""
    limit = TOLERANCE * float(assembly.diameters.mean())
    if (escape_depths(assembly) > limit).any():
        return False
    reach = (assembly.bounding_radii[near.i] + assembly.bounding_radii[near.j]) ** 2
    pairs = near.where(linear.einsum("ki,ki->k", near.offset, near.offset) < reach)
    with using_threads(None):
        return not (contacts_of_pairs(assembly, pairs, -limit).gap < -limit).any()


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
    summary="solid fraction after shrinking all grains until nothing overlaps",
    groups=("/",),
    compute=_compute,
    tilted=True,
    applies=_overlaps,
)
