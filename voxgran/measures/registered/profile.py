"""Profiles of the solid fraction along the axes, with the distance from the walls, and about the axis of a cylinder.

Of a bed, all profiles but those along gravity are of the part below the height that holds 85 % of the volume of the
grains, so that the room above the bed does not count.
"""

import math
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from voxgran._base.arrays import Floats, as_choice, as_count, as_length
from voxgran._base.errors import InputError
from voxgran.containers.model import Container, boundary_of, periods_of, refuse_tilt
from voxgran.geometry.halfspaces import cut_disks, cut_spheres
from voxgran.geometry.walls import Round
from voxgran.measures.model import Groups, Measure, dataset, length_unit, variable
from voxgran.measures.region import CylinderRegion, Regions, SampledRegion
from voxgran.measures.registered.coordination import mean_diameter
from voxgran.measures.registered.density import INSET
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


def axis_profile(
    packing: Packing, axis: str = "z", *, bins: int | None = None, limits: Floats | None = None
) -> Profile:
    """Return the solid fraction in slices across an axis, exact except for cylinders and cones, with a bound of the
    error.

    Of a bed, slices along gravity end at the height that holds 85 % of the volume of the grains, or at given limits,
    the (2, 3) least and largest coordinates. By default the slices are about a quarter of the mean diameter thick, at
    most 100, and NaN where the container is so narrow that a slice, with half a mean diameter on each side, has room
    for fewer than five mean grains. Unknown axes
    and numbers of slices below 1 are refused.
    """
    few, k = bins is None, "xyz".index(as_choice(axis, "axis", "xyz"[: packing.dimension]))
    container = packing.container
    if k not in layered(container):
        refuse_tilt(container, f"a profile along {axis}", "take another axis, whose layers lie above each other")
    low, high = container.bounds[:, k]
    if bins is None:
        edges = _edges(low, high, BIN * mean_diameter(packing))
    else:
        edges = np.linspace(low, high, as_count(bins, "bins", at_least=1) + 1)
    packing, standing = around_fixed(packing), standing_in(packing)
    limits = (Regions(packing).limits if limits is None else limits).copy()
    limits[:, k] = -np.inf, np.inf
    parts = _parts(packing, k, edges, limits)
    room = _rooms(container, k, edges, limits)
    if standing is not None:
        room = room - np.array(_parts(standing, k, edges, limits))
    found = _profile(edges, np.array(parts), np.array([part.error for part in parts]), room)
    if not few or not packing.count:
        return found
    wide = _widened(edges, mean_diameter(packing)).clip(low, high)
    places = np.unique(wide)
    below = np.concatenate([[0.0], np.cumsum(_rooms(container, k, places, limits))])
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


def cylinder_profiles(packing: Packing) -> tuple[Profile, Profile]:
    """Return the solid fraction over the distance from the axis of an upright cylinder, and over the height.

    The former is that of the part at least 1.5 median diameters from floor and lid and, of a bed, below the height that
    holds 85 % of the volume of the grains; the latter that of the part as far from the mantle. Bins are a tenth and a
    quarter of the mean diameter wide, at most 100, and NaN as those of :func:`wall_profile`. Exact for spheres, else
    sampled, with the standard error.
    """
    regions, diameter, radius = Regions(packing), mean_diameter(packing), _mantle(packing).radius
    (low, high), inset = packing.container.bounds[:, 2], INSET * float(np.median(packing.diameters))
    base, top = max(low + inset, regions.limits[0, 2]), min(high - inset, regions.limits[1, 2])
    within = np.array([0.0, max(radius - inset, 0.0)]), np.array([base, max(base, top)])
    found = []
    for edges, place in ((_edges(0.0, radius, STEP * diameter), 0), (_edges(low, high, BIN * diameter), 2)):

        def rings_of(ends: Floats, place: int = place) -> Floats:
            """Return the rings (k, 4) of bins with these ends (2, k), of radii or along the axis."""
            rings = np.tile(np.concatenate(within), (ends.shape[1], 1))
            rings[:, place : place + 2] = ends.T
            return rings

        rings = rings_of(np.stack([edges[:-1], edges[1:]]))
        parts, room = _held(regions, rings), _room(rings)
        if regions.standing is not None:
            room = room - np.array(_held(regions.standing, rings))
        profile = _profile(edges, np.array(parts), np.array([part.error for part in parts]), room)
        wide = _widened(edges, diameter).clip(edges[0], edges[-1])
        found.append(_without_small(profile, _room(rings_of(wide)), packing))
    return found[0], found[1]


def _mantle(packing: Packing) -> Round:
    """Return the wall of an upright cylinder."""
    wall = boundary_of(packing.container).cylinder
    assert wall is not None
    return wall


def _room(rings: Floats) -> Floats:
    """Return the volumes of rings (k, 4): least and largest distance from an axis, and ends along it."""
    inner, outer, base, top = rings.T
    return np.asarray(math.pi * (outer - inner) * (outer + inner) * (top - base))


def _held(regions: Regions, rings: Floats) -> list[Estimate]:
    """Return the volume of the grains in rings (k, 4) about the axis of a cylinder."""
    wall, solids = _mantle(regions.packing), regions.solids
    found = []
    if solids.spheres is not None:
        # rings that meet share a core
        core = cache(lambda radius, base, top: CylinderRegion(wall.center, radius, base, top).solid(solids))
        for inner, outer, *ends in rings.tolist():
            within, whole = core(inner, *ends), core(outer, *ends)
            found.append(Estimate(whole - within, whole.error + within.error))
        return found
    places = {"depths": regions.samples.points, "around_depths": regions.samples.around}
    depths = {name: wall.radius - np.hypot(*(at - wall.center)[:, :2].T) for name, at in places.items()}
    about = replace(regions.samples, **depths)
    for inner, outer, base, top in rings.tolist():
        ends = np.array([[-np.inf, -np.inf, base], [np.inf, np.inf, top]])
        region = SampledRegion(about, wall.radius - outer, ends, wall.radius - inner if inner else math.inf)
        found.append(region.solid(solids))
    return found


def _edges(low: float, high: float, width: float) -> Floats:
    """Return the edges of bins of about a width, of which there are at most MOST_BINS."""
    bins = int(np.clip(np.ceil((high - low) / width), 1, MOST_BINS)) if width > 0 else 1
    return np.linspace(low, high, bins + 1)


def _parts(packing: Packing, axis: int, edges: Floats, limits: Floats) -> list[Estimate]:
    """Return the volume of the grains in each slice across an axis."""
    solids = Solids(packing)
    return [solids.volume(*slab) for slab in _slabs(packing.dimension, axis, edges, limits)]


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


def _slabs(dimension: int, axis: int, edges: Floats, limits: Floats) -> list[tuple[Floats, Floats]]:
    """Return the corners of the slices across an axis, which end at limits (2, 3) along other axes."""
    corners = np.repeat(limits[None, :, :dimension], len(edges) - 1, axis=0)
    corners[:, 0, axis], corners[:, 1, axis] = edges[:-1], edges[1:]
    return [(lower, upper) for lower, upper in corners]


def _rooms(container: Container, axis: int, edges: Floats, limits: Floats) -> Floats:
    """Return the volume of the container in each slice, between limits (2, 3) along other axes."""
    walls, (low, high) = boundary_of(container), container.bounds
    flat = container.dimension == 2
    if walls.solid is not None or (walls.round and not walls.is_usual):
        slabs = _slabs(3, axis, edges, limits)
        vertices, faces = container.mesh() if walls.solid is None else (walls.solid.vertices, walls.solid.faces)
        pose = np.eye(3)[None], np.array([(0.0, 0.0, 0.0) if walls.solid is None else walls.solid.offset])
        found = np.array([cut_mesh(vertices, faces, *pose, lower=lo, upper=up)[0] for lo, up in slabs])
        if walls.solid is None:
            # triangles lie within round walls
            whole = cut_mesh(vertices, faces, *pose, lower=np.full(3, -np.inf), upper=np.full(3, np.inf))[0]
            return np.asarray(found * (container.volume / whole))
        return found / np.ptp(vertices[:, 2]) if flat else found
    below, above = np.maximum(limits[0], low), np.minimum(limits[1], high)
    if wall := walls.sphere:
        slabs, middle = _slabs(3, axis, edges, limits), np.array([wall.center])
        return np.array([cut_spheres(middle, np.array([wall.radius]), lower=lo, upper=up)[0] for lo, up in slabs])
    if wall := walls.cylinder:
        across = _slabs(2, axis, edges, limits) if axis < 2 else [(limits[0, :2], limits[1, :2])]
        center = np.array([wall.center[:2]])
        disk = np.array([cut_disks(center, np.array([wall.radius]), lower=lo, upper=up)[0] for lo, up in across])
        return disk * (1.0 if flat else np.diff(edges) if axis == 2 else above[2] - below[2])
    # layers of the container are alike along the axis, and from the floor to the height of a bed
    below[axis], above[axis] = low[axis], high[axis]
    share = np.divide(above - below, high - low, out=np.ones(3), where=high > low)
    return np.asarray(np.diff(edges) * container.volume / (high - low)[axis] * float(np.prod(share)))


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
    mass, limits = np.zeros(bins), Regions(packing).limits
    for density in np.unique(packing.densities):
        of_density = packing[packing.densities == density]
        mass += density * axis_profile(of_density, axis, bins=bins, limits=limits).solid_fraction
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
        if packing.dimension == 3 and boundary_of(packing.container).cylinder is not None:
            radial, axial = cylinder_profiles(packing)
            meaning = "the distance from the axis, away from floor, lid and surface"
            more, along = _columns(radial, "solid_fraction_radial", "radius", (unit, meaning))
            values, coordinates = values | more, coordinates | along
            values |= _columns(axial, "solid_fraction_axial", "z", (unit, "the coordinate z, away from the mantle"))[0]
    return {"/profiles": dataset(values, coordinates)}


registration = Measure(
    summary="solid fraction, and mass density where densities differ, along the axes; solid fraction from the walls, "
    "about the axis of a cylinder",
    groups=("/profiles",),
    compute=_compute,
    tilted=True,
)
