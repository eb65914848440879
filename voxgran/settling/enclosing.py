"""Containers that are strained around fixed grains: how short they may become, and where walls push fixed grains."""

from dataclasses import replace

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran.contacts.assembly import Assembly
from voxgran.contacts.walls import grain_bounds, reach_at
from voxgran.containers.model import boundary_of
from voxgran.geometry.walls import Round
from voxgran.settling.bed import Bed

#: halvings by which a place within a round wall is found
HALVINGS = 50


def least_lengths(fixed: Assembly) -> Floats:
    """Return the lengths (3,) along the axes of the smallest container that encloses each of some fixed grains.

    Periodic sides are as far apart as a grain is long, so that it does not overlap its images, and a round wall
    encloses it around its axis. No length is above that of the container as it is, in which longer grains may lie along
    a diagonal.
    """
    least = np.zeros(3)
    if fixed.count:
        low, high = grain_bounds(fixed)
        least = (high - low).max(axis=0)
        for wall in boundary_of(fixed.container).round:
            centered = replace(fixed, position=_away(fixed, wall, 0.0))
            least[: wall.axes] = 2.0 * float(reach_at(centered, wall).max())
    return np.asarray(np.minimum(least, np.ptp(fixed.container.bounds, axis=0)))


def pushed_inside(fixed: Assembly) -> Floats:
    """Return the centroids (n, 3) of fixed grains that the walls of their container have pushed inside, by the shortest
    way, where they have room.
    """
    if not fixed.count:
        return fixed.position
    walls, (lower, upper), (low, high) = boundary_of(fixed.container), fixed.container.bounds, grain_bounds(fixed)
    least, most = lower - low, upper - high
    has_room = np.array(walls.flat) & (least <= most)
    inside = np.where(has_room, np.clip(fixed.position, least, most), fixed.position)
    for wall in walls.round:
        place = replace(fixed, position=inside)
        near, far = np.zeros(fixed.count), np.ones(fixed.count)
        out = reach_at(place, wall) > wall.radius
        out &= reach_at(replace(fixed, position=_away(place, wall, 0.0)), wall) <= wall.radius
        for _ in range(HALVINGS if out.any() else 0):
            middle = 0.5 * (near + far)
            beyond = reach_at(replace(fixed, position=_away(place, wall, middle[:, None])), wall) > wall.radius
            near, far = np.where(beyond, near, middle), np.where(beyond, middle, far)
        inside = np.where(out[:, None], _away(place, wall, near[:, None]), inside)
    return inside


def _away(fixed: Assembly, wall: Round, share: float | Floats) -> Floats:
    """Return centroids (n, 3) at a share of their distance from the center of a round wall."""
    center, moved = np.array(wall.center), fixed.position.copy()
    moved[:, : wall.axes] = (center + share * (fixed.position - center))[:, : wall.axes]
    return moved


def standing_in(bed: Bed, fixed: Integers) -> Assembly:
    """Return the grains of a bed (k,) that are fixed, where they are now."""
    assembly, rows = bed.assembly, bed.order[fixed]
    return Assembly(
        assembly.shapes, assembly.shape_id[rows], assembly.scale[rows], bed.grains.position[fixed],
        assembly.orientation[rows], assembly.container,
    )  # fmt: skip
