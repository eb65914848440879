"""Profiles of the solid fraction along the axes and with the distance from the walls."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import Floats, as_choice, as_count, as_length
from voxgran._base.errors import InputError
from voxgran.containers.model import Container, boundary_of, periods_of, refuse_tilt
from voxgran.geometry.halfspaces import cut_disks
from voxgran.measures.model import Groups, Measure, dataset, length_unit, variable
from voxgran.measures.region import Regions, SampledRegion
from voxgran.measures.registered.coordination import mean_diameter
from voxgran.measures.slices import cut_mesh
from voxgran.measures.window import Estimate, Solids
from voxgran.packing.model import Packing
from voxgran.packing.start import around_fixed, standing_in

#: width of the bins along an axis, in mean diameters, and largest number of bins
BIN, MOST_BINS = 0.25, 100
#: least size of the window of a bin, widened by a radius, in mean grains, and largest error of its solid fraction
WINDOW, DOUBT = 5.0, 0.1
#: largest distance from the walls, and width of its bins, in mean diameters
FAR, STEP = 5.0, 0.1


@dataclass(frozen=True, eq=False)
class Profile:
    """Solid fraction in bins."""

    edges: Floats  # (k + 1,) edges of the bins, in the unit of lengths
    # (k,) volume of the union of the grains over that of the container in each bin; NaN if the latter is 0 or too small
    solid_fraction: Floats
    error: Floats  # (k,) bound or standard error; 0 if exact

    @property
    def middle(self) -> Floats:
        """Middles of the bins, (k,)."""
        return (self.edges[1:] + self.edges[:-1]) / 2


def axis_profile(packing: Packing, axis: str = "z", *, bins: int | None = None) -> Profile:
    """Return the solid fraction in slices across an axis, exact except for cylinders and cones, with a bound of the
    error.

    By default the slices are about a quarter of the mean diameter thick, at most 100, and NaN where the container is so
    narrow that a slice, with half a mean diameter on each side, has room for fewer than five mean grains. Unknown axes
    and numbers of slices below 1 are refused.
    """
    few, k = bins is None, "xyz".index(as_choice(axis, "axis", "xyz"[: packing.dimension]))
    container = packing.container
    if k not in layered(container):
        refuse_tilt(container, f"a profile along {axis}", "take another axis, whose layers lie above each other")
    low, high = container.bounds[:, k]
    if bins is None:
        width = BIN * mean_diameter(packing)
        bins = int(np.clip(np.ceil((high - low) / width), 1, MOST_BINS)) if width > 0 else 1
    edges = np.linspace(low, high, as_count(bins, "bins", at_least=1) + 1)
    packing, standing = around_fixed(packing), standing_in(packing)
    parts = _parts(packing, k, edges)
    room = _rooms(container, k, edges) - (0.0 if standing is None else np.array(_parts(standing, k, edges)))
    found = _profile(edges, np.array(parts), np.array([part.error for part in parts]), room)
    if not few or not packing.count:
        return found
    wide = _widened(edges, mean_diameter(packing)).clip(low, high)
    places = np.unique(wide)
    below = np.concatenate([[0.0], np.cumsum(_rooms(container, k, places))])
    return _without_small(found, np.diff(below[np.searchsorted(places, wide)], axis=0)[0], packing)


def layered(container: Container) -> tuple[int, ...]:
    """Return the axes across which a container consists of layers that repeat: those along which it is not tilted."""
    return tuple(k for k in range(container.dimension) if not np.tril(periods_of(container), -1)[:, k].any())


def wall_profile(packing: Packing, *, step: float | None = None) -> Profile:
    """Return the solid fraction as a function of the distance from the nearest wall.

    The width of the bins is by default a tenth of the mean diameter; bins are then NaN where their windows, with half a
    mean diameter on each side, have room for fewer than five mean grains, and where the error is above 0.1. Distances
    are up to five mean diameters, or to the largest one in the container. With gravity only the part below the height
    up to which 85 % of the volume lies is included. Exact in boxes and rectangles except for cylinders and cones; by
    quadrature for spheres in cylinders; sampled otherwise, with the standard error.

    Raises
    ------
    InputError
        If all sides are periodic, there are no grains, or the step is not above 0.
    """
    regions, diameter = Regions(packing), mean_diameter(packing)
    if not regions.has_walls or not packing.count:
        raise InputError(
            f"the packing has {packing.count} grains and periodic sides {packing.container.periodic}: a profile "
            "from the walls needs grains and a wall; measure along an axis instead"
        )
    width = STEP * diameter if step is None else as_length(step, "step")

    def bare(profile: Profile) -> Profile:
        """Return a profile without bins whose windows are too small."""
        if step is not None:
            return profile
        wide = _widened(profile.edges, diameter).clip(min=0.0)
        begin, end = (np.array([float(regions.at(float(inset)).volume) for inset in insets]) for insets in wide)
        return _without_small(profile, begin - end, packing)

    edges = np.asarray(np.arange(int(np.ceil(FAR * diameter / width * (1 - 1e-9))) + 1) * width, dtype=np.float64)
    found = [regions.at(float(edge)) for edge in edges]
    room: Floats = np.array([float(region.volume) for region in found])
    kept = max(2, int(np.count_nonzero(room > 1e-9 * room[0])) + 1)
    sampled = [region for region in found if isinstance(region, SampledRegion)]
    if sampled:
        # the same points count in both regions: the error is that of the points between them
        shells = [replace(one, until=float(edge)) for one, edge in zip(sampled, edges[1:kept], strict=False)]
        parts, rooms = [shell.solid(regions.solids) for shell in shells], [shell.volume for shell in shells]
        share = np.array(parts) / np.maximum(rooms, 1e-300)
        both = np.array([part.error for part in parts]), share * np.array([part.error for part in rooms])
        return bare(_profile(edges[:kept], np.array(parts), np.hypot(*both), np.array(rooms)))
    solid = [region.solid(regions.solids) for region in found[:kept]]
    errors: Floats = np.array([part.error for part in solid])
    each, doubt = -np.diff(np.array(solid)), np.hypot(errors[1:], errors[:-1])
    return bare(_profile(edges[:kept], each, doubt, -np.diff(room[:kept])))


def _parts(packing: Packing, axis: int, edges: Floats) -> list[Estimate]:
    """Return the volume of the grains in each slice across an axis."""
    solids = Solids(packing)
    return [solids.volume(*_slab(packing.dimension, axis, edges[b : b + 2])) for b in range(len(edges) - 1)]


def _profile(edges: Floats, solid: Floats, error: Floats, room: Floats) -> Profile:
    """Return fractions of volumes."""
    known = room > 0
    span = np.where(known, room, 1.0)
    return Profile(edges, np.where(known, solid / span, np.nan), np.where(known, error / span, np.nan))


def _widened(edges: Floats, diameter: float) -> Floats:
    """Return the ends (2, k) of the bins, widened by half a diameter on each side: what grains of a bin take."""
    return np.stack([edges[:-1] - diameter / 2, edges[1:] + diameter / 2])


def _without_small(profile: Profile, room: Floats, packing: Packing) -> Profile:
    """Return a profile without the bins whose widened windows (k,) hold few grains, or whose error is large."""
    known = (room >= WINDOW * float(packing.volumes.mean())) & (profile.error <= DOUBT)
    return Profile(
        profile.edges, *(np.where(known, values, np.nan) for values in (profile.solid_fraction, profile.error))
    )


def _slab(dimension: int, axis: int, ends: Floats) -> tuple[Floats, Floats]:
    """Return the corners of a slice across an axis, open on all other sides."""
    lower, upper = np.full(dimension, -np.inf), np.full(dimension, np.inf)
    lower[axis], upper[axis] = ends
    return lower, upper


def _rooms(container: Container, axis: int, edges: Floats) -> Floats:
    """Return the volume of the container in each slice."""
    walls = boundary_of(container)
    flat = container.dimension == 2
    if walls.solid is not None or (walls.round and not walls.is_usual):
        slabs = [_slab(3, axis, edges[b : b + 2]) for b in range(len(edges) - 1)]
        vertices, faces = container.mesh() if walls.solid is None else (walls.solid.vertices, walls.solid.faces)
        pose = np.eye(3)[None], np.array([(0.0, 0.0, 0.0) if walls.solid is None else walls.solid.offset])
        found = np.array([cut_mesh(vertices, faces, *pose, lower=low, upper=high)[0] for low, high in slabs])
        if walls.solid is None:
            # triangles lie within round walls
            return np.asarray(found * (container.volume / found.sum()))
        return found / np.ptp(vertices[:, 2]) if flat else found
    if (wall := walls.cylinder) and axis < 2:
        center, lower, upper = np.array([wall.center[:2]]), *container.bounds[:, 2]
        slabs = [_slab(2, axis, edges[b : b + 2]) for b in range(len(edges) - 1)]
        disk = [cut_disks(center, np.array([wall.radius]), lower=low, upper=high)[0] for low, high in slabs]
        return np.array(disk) * (1.0 if flat else upper - lower)
    if wall := walls.sphere:
        radius = wall.radius
        heights = np.clip(edges - wall.center[axis], -radius, radius)
        return np.asarray(np.diff(math.pi * (radius**2 * heights - libm.power(heights, 3) / 3)))
    return np.asarray(np.diff(edges) * container.volume / (edges[-1] - edges[0]))


def _columns(
    profile: Profile, name: str, coordinate: str, text: tuple[str, str]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the variables and the coordinate of a profile; `text` is unit and meaning of the coordinate."""
    unit, meaning = text
    row = (coordinate,)
    values = {
        name: variable(row, profile.solid_fraction, "1", f"solid fraction over {meaning}"),
        f"{name}_error": variable(row, profile.error, "1", f"error of the solid fraction over {meaning}"),
    }
    return values, {coordinate: variable(row, profile.middle, unit, f"{meaning}, middle of the bin")}


def _mass_density(packing: Packing, axis: str, bins: int) -> Any:
    """Return the variable of the mass of the grains over the volume of the slices across an axis.

    The volume that grains of different densities have in common counts for each density.
    """
    mass = np.zeros(bins)
    for density in np.unique(packing.densities):
        of_density = packing[packing.densities == density]
        mass += density * axis_profile(of_density, axis, bins=bins).solid_fraction
    meaning = f"mass of the grains over the volume of the container, over the coordinate {axis}"
    return variable((axis,), mass, "unit of the density", meaning)


def _compute(packing: Packing) -> Groups:
    """Return the profiles along all axes and, if there are walls, with the distance from them."""
    unit = length_unit(packing)
    values: dict[str, Any] = {}
    coordinates: dict[str, Any] = {}
    for axis in ("xyz"[k] for k in layered(packing.container)):
        profile = axis_profile(packing, axis)
        more, along = _columns(profile, f"solid_fraction_{axis}", axis, (unit, f"the coordinate {axis}"))
        values, coordinates = values | more, coordinates | along
        if isinstance(packing.density, tuple):
            values[f"mass_density_{axis}"] = _mass_density(packing, axis, len(profile.solid_fraction))
    if packing.count and not all(packing.container.periodic[: packing.dimension]):
        meaning = "the distance from the nearest wall"
        more, along = _columns(wall_profile(packing), "solid_fraction_wall", "wall_distance", (unit, meaning))
        values, coordinates = values | more, coordinates | along
    return {"/profiles": dataset(values, coordinates)}


registration = Measure(
    summary="solid fraction, and mass density where densities differ, along the axes; solid fraction from the walls",
    groups=("/profiles",),
    compute=_compute,
    tilted=True,
)
