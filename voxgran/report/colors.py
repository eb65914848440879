"""Colouring of grains: one value per grain, with name and unit."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from voxgran._base.arrays import Floats, as_choice
from voxgran._base.lazy import load
from voxgran.measures.registered.coordination import coordination_number
from voxgran.measures.registered.forces import known_forces
from voxgran.packing.model import Packing

ColorBy: TypeAlias = Literal["diameter", "height", "shape", "density", "coordination", "distance", "force"]
COLOR_BY: tuple[ColorBy, ...] = ("diameter", "height", "shape", "density", "coordination", "distance", "force")
#: map of the colours, whose lightness increases evenly
COLORS = "viridis"


@dataclass(frozen=True, slots=True)
class Coloring:
    """Values (n,) of grains, with name and unit (``""`` if there is none) for the colour bar."""

    values: Floats
    label: str
    unit: str = ""

    @property
    def limits(self) -> tuple[float, float]:
        """Smallest and largest value; slightly different if all values are equal."""
        low, high = float(self.values.min(initial=np.inf)), float(self.values.max(initial=-np.inf))
        if low < high:
            return low, high
        return (0.6 * low, 1.2 * high) if low == high and low > 0 else (-0.5, 0.5)


def coloring(packing: Packing, color_by: str) -> Coloring:
    """Return the colouring of the grains by one of :data:`COLOR_BY`: equivalent diameter, height of the centroid above
    the lowest point of the container, index of the shape, density of its material, number of neighbours within the
    contact gap, distance of the centroid from the nearest other one, or largest contact force.

    Raises
    ------
    InputError
        If `color_by` is unknown, or it is "force" and the forces of the packing are not known.
    """
    as_choice(color_by, "color_by", COLOR_BY)
    unit = "" if packing.unit == "1" else packing.unit
    if color_by == "force":
        return Coloring(known_forces(packing).largest_force(), "largest contact force", "weights of a median grain")
    if color_by == "diameter" or not packing.count:
        return Coloring(packing.diameters, "equivalent diameter", unit)
    if color_by == "height":
        return Coloring(_heights(packing), "height of the centroid", unit)
    if color_by == "shape":
        return Coloring(packing.shape_id.astype(np.float64), "number of the shape")
    if color_by == "density":
        return Coloring(np.asarray(packing.densities, np.float64), "density of the material")
    if color_by == "coordination":
        neighbours = coordination_number(packing).of_grain
        return Coloring(neighbours.astype(np.float64), "coordination number")
    return Coloring(_nearest(packing), "distance of the centroid from the nearest one", unit)


def gradient() -> list[str]:
    """Return nine evenly spaced colours of the map, from that of the smallest value to that of the largest."""
    scale = load("matplotlib").colormaps[COLORS]
    return [load("matplotlib.colors").to_hex(scale(k / 8)) for k in range(9)]


def _heights(packing: Packing) -> Floats:
    """Return the heights of the centroids against gravity, along the last axis where there is none, above the lowest
    corner of the bounds.
    """
    up = np.eye(3)[packing.dimension - 1] if packing.gravity is None else -np.asarray(packing.gravity, np.float64)
    bounds = packing.container.bounds
    return np.asarray(packing.position @ up - np.minimum(*(bounds * up)).sum())


def _nearest(packing: Packing) -> Floats:
    """Return the distance of each centroid from the nearest other one, across periodic faces too."""
    lower, upper = packing.container.bounds
    lengths = np.where(packing.container.periodic, upper - lower, 0.0)
    local = packing.position - lower
    local = np.where(lengths > 0, np.mod(local, np.where(lengths > 0, lengths, 1.0)), local)
    tree = load("scipy.spatial").cKDTree(local, boxsize=lengths)
    distance: Floats = tree.query(local, k=2)[0][:, 1]
    return np.where(np.isfinite(distance), distance, 0.0)
