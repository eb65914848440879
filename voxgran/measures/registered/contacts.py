"""Contacts of grains, one row per pair."""

import numpy as np

from voxgran.measures.model import Groups, Measure, dataset, length_unit, variable
from voxgran.measures.registered.coordination import mean_diameter, touching_contacts, usual_gap
from voxgran.measures.wetted import shared_areas
from voxgran.packing.model import Packing


def _compute(packing: Packing) -> Groups:
    """Return one row per pair within the contact gap; with the area that grains share where some do."""
    unit, row = length_unit(packing), ("contact",)
    reach, found = usual_gap(packing) * mean_diameter(packing), touching_contacts(packing)
    values = {
        "i": variable(row, found.i, "1", "index of the first grain"),
        "j": variable(row, found.j, "1", "index of the second grain"),
        "image": variable((*row, "axis"), found.image, "1", "periods by which the second grain is shifted"),
        "gap": variable(row, found.gap, unit, "distance of the surfaces, negative where they overlap"),
        "normal": variable((*row, "axis"), found.normal, "1", "unit vector from the first to the second grain"),
        "point": variable((*row, "axis"), found.point, unit, "middle between the nearest points"),
        "largest_gap": variable((), reach, unit, "largest gap of the listed pairs"),
    }
    area = shared_areas(packing, found) if packing.dimension == 3 and packing.count else np.zeros(0)
    if area.any():
        share = 2.0 * float(area.sum()) / float(packing.surface_areas.sum())
        values |= {
            "area": variable(row, area, length_unit(packing, power=2), "area that the two grains share"),
            "share_of_surface": variable((), share, "1", "share of the surface of the grains that is shared"),
            "coordination_by_area": variable(
                (), 2.0 * int((area > 0).sum()) / packing.count, "1", "mean number of grains with which one shares area"
            ),
        }
    return {"/contacts": dataset(values)}


registration = Measure(
    summary="pairs of grains within the contact gap, with gap, normal, point, and the area that they share",
    groups=("/contacts",),
    compute=_compute,
    tilted=True,
)
