"""Contacts of grains, one row per pair."""

from voxgran.measures.model import Groups, Measure, dataset, length_unit, variable
from voxgran.measures.registered.coordination import mean_diameter, touching_contacts, usual_gap
from voxgran.packing.model import Packing


def _compute(packing: Packing) -> Groups:
    """Return one row per pair within the contact gap."""
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
    return {"/contacts": dataset(values)}


registration = Measure(
    name="contacts",
    summary="pairs of grains within the contact gap, with gap, normal and point",
    groups=("/contacts",),
    compute=_compute,
)
