"""Numbers and curves of a sample and its twins as one dataset: differences, and in units of their scatter."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.units import NO_UNIT
from voxgran.measures.model import dataset, variable

if TYPE_CHECKING:
    from xarray import Dataset

#: names of measures for people, and the power of their unit of length
TEXTS = {
    "solid_fraction": ("solid fraction", 0),
    "profile_deviation": ("deviation of the solid fraction over layers", 0),
    "local_solid_fraction": ("mean local solid fraction", 0),
    "local_solid_fraction_std": ("deviation of local solid fractions", 0),
    "D10": ("D10, by volume", 1), "D50": ("D50, by volume", 1), "D90": ("D90, by volume", 1),
    "sphericity": ("sphericity", 0), "elongation": ("elongation", 0), "flatness": ("flatness", 0),
    "convexity": ("convexity", 0), "roundness": ("roundness", 0),
    "coordination_number": ("mean coordination number", 0),
    "contact_area": ("area between touching grains over volume", -1),
    "wetted_surface": ("wetted surface over volume", -1),
    "pore_chord": ("mean chord of the pores", 1),
    "radial_peak": ("peak of g(r)", 0),
    "tortuosity": ("diffusive tortuosity factor", 0),
    **{f"diffusivity_{a}": (f"relative diffusivity along {a}", 0) for a in "xyz"},
    **{f"contact_normals_{a}": (f"mean square of contact normals along {a}", 0) for a in "xyz"},
    **{f"long_axes_{a}": (f"mean square of long axes along {a}", 0) for a in "xyz"},
}  # fmt: skip
#: curves: the name of the coordinate, its text and unit of length, and the text and unit of the values
CURVES = {
    "radial_distribution": ("distance", "distance of centroids", 1, "radial distribution g(r)", 0),
    "two_point_correlation": ("lag", "distance", 1, "two-point correlation of the solid", 0),
    "pore_chords": ("lag", "distance", 1, "share of longer chords of pores", 0),
    "gradation": ("share", "share by volume", 0, "size that it passes", 1),
}


def dataset_of(
    sample: tuple[Mapping[str, Any], Mapping[str, Any]],
    twins: Sequence[tuple[Mapping[str, Any], Mapping[str, Any]]],
    unit: str,
    shares: Floats,
) -> "Dataset":
    """Return numbers and scatters of a sample and of its twins, of which several are averaged."""
    known, scatter = sample
    values = {name: np.mean([made[name] for made, _ in twins], axis=0) for name in twins[0][0]}
    spread = {name: _of_several([(made[name], own[name]) for made, own in twins]) for name in twins[0][1]}
    names = [name for name in TEXTS if np.isfinite([values.get(name, math.nan), known.get(name, math.nan)]).any()]
    table = np.array(
        [[known.get(n, math.nan), scatter.get(n, math.nan), values[n], spread[n]] for n in names], dtype=np.float64
    )
    difference = table[:, 2] - table[:, 0]
    # where one scatter is not known, neither is the ratio: the other alone would tell too large a one
    both = np.hypot(table[:, 1], table[:, 3])
    # what has no scatter and differs by rounding only is equal
    least = 1e-9 * np.abs(table[:, 0])
    ratio = np.divide(difference, both, out=np.where(np.abs(difference) <= least, 0.0, np.nan), where=both > least)
    row = ("measure",)
    data = {
        "sample": variable(row, table[:, 0], "1", "of the sample"),
        "twin": variable(row, table[:, 2], "1", "of the twin"),
        "difference": variable(row, difference, "1", "twin less sample"),
        "sample_scatter": variable(row, table[:, 1], "1", "standard error of the sample"),
        "twin_scatter": variable(row, table[:, 3], "1", "standard error of the twin"),
        "ratio": variable(row, ratio, "1", "difference over both standard errors together"),
    }
    whose_values = {"sample": known, "sample_scatter": scatter, "twin": values, "twin_scatter": spread}
    places = {"distance": values["distance"], "lag": values["lag"], "share": shares}
    coordinates = {"measure": variable(row, np.array(names), "1", "measure")}
    coordinates["unit"] = variable(row, np.array([_unit(unit, TEXTS[n][1]) for n in names]), "1", "unit of the values")
    coordinates["text"] = variable(row, np.array([TEXTS[n][0] for n in names]), "1", "measure, for people")
    for name, (place, text, power, meaning, own) in CURVES.items():
        coordinates[place] = variable((place,), places[place], _unit(unit, power), text)
        for whose, found in whose_values.items():
            curve = found.get(name, np.full(len(places[place]), np.nan))
            data[f"{name}_{whose}"] = variable((place,), curve, _unit(unit, own), f"{meaning}, {whose}")
    return dataset(data, coordinates)


def _of_several(found: Sequence[tuple[Any, Any]]) -> Any:
    """Return the scatter of one packing, or the standard deviation between several, which is that of one of them."""
    if len(found) == 1:
        return found[0][1]
    return np.std([value for value, _ in found], axis=0, ddof=1)


def _unit(unit: str, power: int) -> str:
    """Return a power of the unit of lengths as text."""
    if unit == NO_UNIT or power == 0:
        return NO_UNIT
    return unit if power == 1 else f"{unit}^{power}"
