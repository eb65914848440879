"""Solid fraction of a packing: of the whole, of the bulk away from walls and surface, and inside a window."""

import math
import warnings
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.calls import explained
from voxgran._base.errors import InputError, PackingWarning, warn
from voxgran._base.lazy import DataTree
from voxgran.measures.model import Groups, Measure, dataset, length_unit, variable
from voxgran.measures.region import Regions
from voxgran.measures.slices import as_window
from voxgran.measures.wetted import specific_surfaces
from voxgran.measures.window import Estimate, Solids
from voxgran.packing.model import Packing, check_packing
from voxgran.packing.start import around_fixed, free_volume

#: distance of the bulk from the walls, in median diameters, and smallest number of grains in it
INSET = 1.5
FEWEST = 50


def bulk_solid_fraction(packing: Packing) -> Estimate:
    """Return the solid fraction away from the walls and from the free surface, with its error.

    The bulk lies at least 1.5 median diameters from each wall and, with gravity, below the height up to which 85 % of
    the volume of the grains lies. Grains are cut exactly, and overlapping volume counts once.

    The error is 0 for spheres, clumps, ellipsoids, boxes and meshes in boxes, and for disks and polygons in rectangles;
    a bound for cylinders and cones there; the error of the quadrature for spheres and clumps in cylinders; a standard
    error for other grains in cylinders and for all grains in closed meshes and spheres, in two dimensions in disks and
    polygons as containers, where volumes are sampled and overlapping volume counts for each grain. The result is NaN,
    with a `PackingWarning`, if fewer than 50 grains have their centroids in the bulk.
    """
    return _bulk(packing)[0]


@explained(hint="window_solid_fraction(packing, lower, upper)")
def window_solid_fraction(packing: Packing, lower: "ArrayLike", upper: "ArrayLike") -> Estimate:
    """Return the solid fraction inside a window along the axes, periodic images included.

    Parameters
    ----------
    packing : Packing
        The packing.
    lower, upper : (3,) or, in 2D, (2,) array_like of float
        Corners of the window, in the unit of lengths; it may reach across periodic faces.

    Returns
    -------
    Estimate
        Ratio of the volume of the union of the grains in the window to the volume of the window (in 2D areas): a float
        with the attribute `error`, which is 0 except for cylinders, cones and overlapping curved grains other than
        spheres.

    Raises
    ------
    InputError
        If a corner has the wrong shape, or the window has no volume or is infinite.

    Examples
    --------
    >>> import voxgran as vg
    >>> box = vg.Box((2, 2, 2), periodic="xyz")
    >>> packing = vg.Packing.of([vg.make_shape("sphere")], box, position=[[0, 0, 0]])
    >>> round(vg.window_solid_fraction(packing, (-0.5, -0.5, -0.5), (0.5, 0.5, 0.5)), 12)
    0.523598775598
    """
    check_packing(packing, "packing")
    low, high = as_window(lower, upper, packing.dimension)
    room = float(np.prod(high - low))
    if not (math.isfinite(room) and room > 0):
        raise InputError(
            f"window runs from {low.tolist()} to {high.tolist()}: its volume must be finite and above 0; move a corner"
        )
    solid = Solids(packing).volume(low, high)
    return Estimate(solid / room, solid.error / room)


def _bulk(packing: Packing, regions: Regions | None = None) -> tuple[Estimate, int, float]:
    """Return solid fraction, number of grains and volume of the bulk."""
    packing = around_fixed(packing)
    if not packing.count:
        return Estimate(math.nan, math.nan), 0, math.nan
    regions = regions or Regions(packing)
    region = regions.at(INSET * float(np.median(packing.diameters)))
    room, count = region.volume, int(region.grains(packing).sum())
    if count < FEWEST or room <= 0:
        warn(
            f"the bulk holds {count} of the grains: at least {FEWEST} are needed for a bulk solid fraction; "
            "take more grains or a container that is larger than three median diameters across",
            PackingWarning,
        )
        return Estimate(math.nan, math.nan), count, float(room)
    solid = region.solid(regions.solids)
    error = (solid.error + solid / room * room.error) / room
    return Estimate(solid / room, error), count, float(room)


def bed_fraction(packing: Packing, regions: Regions | None = None) -> Estimate | None:
    """Return the solid fraction below the surface of a bed, from wall to wall; None without grains or gravity.

    It is found once and kept.  regions: of the packing, made where left out.
    """
    packing = around_fixed(packing)
    if not packing.count or packing.gravity is None:
        return None
    if "bed_fraction" not in packing._found:
        packing._found["bed_fraction"] = _bed_fraction(Regions(packing) if regions is None else regions)
    found: Estimate = packing._found["bed_fraction"]
    return found


def _bed_fraction(regions: Regions) -> Estimate:
    """Find the solid fraction below the surface of a bed."""
    region = regions.at(0.0)
    room, solid = region.volume, region.solid(regions.solids)
    if room <= 0:
        return Estimate(math.nan, math.nan)
    return Estimate(solid / room, (solid.error + solid / room * room.error) / room)


def main_fraction(packing: Packing, statistics: "DataTree | None" = None) -> tuple[str, float]:
    """Return the region by which a packing is known, with its solid fraction: of a bed, whose container has room above
    a free surface, the ``"bulk"``, or the ``"bed"`` where the bulk holds too few grains; otherwise the ``"container"``.

    statistics : of the packing; what they lack is found.
    """
    if packing.gravity is not None and packing.count:
        known = statistics is not None and "bulk_solid_fraction" in statistics
        bulk = float(statistics["bulk_solid_fraction"]) if statistics is not None and known else _quiet_bulk(packing)
        bed = bed_fraction(packing)
        for region, fraction in (("bulk", bulk), ("bed", math.nan if bed is None else float(bed))):
            if math.isfinite(fraction):
                return region, fraction
    return "container", packing.solid_fraction


def main_numbers(packing: Packing, statistics: "DataTree | None" = None) -> dict[str, Any]:
    """Return solid fraction and porosity of the region of :func:`main_fraction`, and those of the container."""
    region, fraction = main_fraction(packing, statistics)
    return {
        "solid_fraction": fraction,
        "porosity": 1.0 - fraction,
        "region": region,
        "container_solid_fraction": packing.solid_fraction,
        "container_porosity": packing.porosity,
    }


def _quiet_bulk(packing: Packing) -> float:
    """Return the bulk solid fraction, NaN without a warning where there is none."""
    with warnings.catch_warnings(action="ignore"):
        return float(_bulk(packing)[0])


def _compute(packing: Packing) -> Groups:
    """Return the numbers of the whole packing."""
    regions = Regions(packing)
    bulk, bulk_count, room = _bulk(packing, regions)
    bed = bed_fraction(packing, regions)
    d, unit = packing.dimension, length_unit(packing)
    size = length_unit(packing, power=d)
    kind = "volume" if d == 3 else "area"
    diameters = packing.diameters if packing.count else np.array([math.nan])
    values = {
        "container_volume": variable((), free_volume(packing), size, f"{kind} of the container"),
        "grain_volume": variable((), packing.volumes.sum(), size, f"{kind} of all grains together"),
        **specific_surfaces(packing, bed),
        "mean_diameter": variable((), diameters.mean(), unit, "mean equivalent diameter of the grains"),
        "median_diameter": variable((), np.median(diameters), unit, "median equivalent diameter of the grains"),
        "bulk_solid_fraction": variable(
            (), float(bulk), "1", "solid fraction away from walls and surface", error=bulk.error
        ),
        "bulk_porosity": variable((), 1.0 - bulk, "1", "porosity away from walls and surface", error=bulk.error),
        "bulk_count": variable((), bulk_count, "1", "number of grains with their centroids in the bulk"),
        "bulk_volume": variable((), room, size, f"{kind} of the bulk region"),
    }
    if bed is not None:
        below = "below the height that holds 85 % of the volume of the grains, from wall to wall"
        values["bed_solid_fraction"] = variable((), float(bed), "1", f"solid fraction {below}", error=bed.error)
        values["bed_porosity"] = variable((), 1.0 - bed, "1", f"porosity {below}", error=bed.error)
    # of a bed the room above it is part of these, which so come last
    whole = f"of the whole container, {kind} of the grains over {kind} of the container"
    values["solid_fraction"] = variable((), packing.solid_fraction, "1", f"solid fraction {whole}")
    values["porosity"] = variable((), packing.porosity, "1", "porosity of the whole container")
    return {"/": dataset(values)}


registration = Measure(
    summary="solid fraction and porosity of the whole packing and of the bulk",
    groups=("/",),
    compute=_compute,
    tilted=True,
)
