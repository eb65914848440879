"""Walls of control-point packing: flat and round ones exactly, by the convex hull of a grain; a mesh by its own points.

Flat and round walls are convex; a grain is within them where the corners of its convex hull are. The mesh of a closed
container is sampled like a grain, and grains keep clear of its points. A lid is a flat wall, whatever the container.
"""

import numpy as np

from voxgran._base.arrays import Integers
from voxgran._base.kernels import bare_kernel, inlined_kernel
from voxgran.geometry.rotation import write_matrix
from voxgran.packing.control_point.point_contact import holds, list_points
from voxgran.packing.control_point.records import (
    BALL,
    HALF_SPACING,
    HALF_THICKNESS,
    RADIUS,
    ROUND,
    Bodies,
    GrainPoses,
    Scratch,
    Walls,
)

#: how far from the top wall a grain enters, and from a grain the lid stops, in median diameters: more than rounding
CLEAR = 1e-9
#: how far beyond a wall rounding may put a grain that touches it, in median diameters
EXACT = 1e-12


@inlined_kernel
def is_outside(
    grains: GrainPoses, bodies: Bodies, walls: Walls, mesh: bool | None, scratch: Scratch, g: int, moved: float
) -> bool:
    """Return whether a grain in the tried pose reaches beyond a wall; `moved` bounds how far its points came.

    `mesh` is that of the walls: None unless the container is a mesh.
    """
    if mesh is not None:
        if _is_outside_mesh(grains, bodies, walls, scratch, g, moved):
            return True
        if not walls.lid:
            return False
    s, size = grains.shape[g], grains.diameter[g]
    margin, begin, end = bodies.margin[s] * size, bodies.hull_start[s], bodies.hull_start[s + 1]
    walled, lower, upper = walls.walled, walls.lower, walls.upper
    place, turn, hull, radius = scratch.place, scratch.turn, bodies.hull, grains.extent[g, RADIUS]
    spanned = len(grains.span) > 0
    if _is_beyond_flat(
        place, turn, hull, begin, end, size, walled, lower, upper, radius, margin, scratch.span, spanned
    ):
        return True
    if walls.kind not in (ROUND, BALL):
        return False
    deep = 1.0 if walls.kind == BALL else 0.0
    return _is_beyond_round(
        place, turn, hull, begin, end, size, walls.offset, walls.radius - margin + EXACT, radius, deep
    )


@bare_kernel
def room_of_lid(grains: GrainPoses, bodies: Bodies, walls: Walls, scratch: Scratch, down: Integers) -> float:
    """Return how far the lid, the flat wall against `down`, may come down before it meets a grain."""
    axis = 0 if down[0] != 0 else (1 if down[1] != 0 else 2)
    room = walls.upper[axis] - walls.lower[axis]
    for g in range(len(grains.placed)):
        if grains.placed[g] == 0:
            continue
        s, size, turn = grains.shape[g], grains.diameter[g], scratch.turn
        lid = walls.upper[axis] if down[axis] < 0 else walls.lower[axis]
        # counted from the lid, downward
        center = down[axis] * (grains.position[g, axis] - lid)
        margin = bodies.margin[s] * size + CLEAR
        if center - grains.extent[g, RADIUS] - margin >= room:
            continue
        write_matrix(grains.orientation[g], turn)
        for k in range(bodies.hull_start[s], bodies.hull_start[s + 1]):
            p = bodies.hull[k]
            along = size * (turn[axis, 0] * p[0] + turn[axis, 1] * p[1] + turn[axis, 2] * p[2])
            room = min(room, center + down[axis] * along - margin)
    return max(room, 0.0)


@bare_kernel
def _is_beyond_flat(place, turn, hull, begin, end, size, walled, lower, upper, radius, margin, span, spanned):  # type: ignore[no-untyped-def]
    """Return whether a point of the convex hull lies beyond a flat wall."""
    for axis in range(3):
        x, low, high = place[axis], lower[axis] + margin - EXACT, upper[axis] - margin + EXACT
        if walled[axis] == 0 or low + radius < x < high - radius:
            continue
        if spanned and low < x + span[2 * axis] and x + span[2 * axis + 1] < high:
            continue
        t, u, v = turn[axis, 0], turn[axis, 1], turn[axis, 2]
        for k in range(begin, end):
            along = x + size * (t * hull[k, 0] + u * hull[k, 1] + v * hull[k, 2])
            if along < low or along > high:
                return True
    return False


@bare_kernel
def _is_beyond_round(place, turn, hull, begin, end, size, offset, room, radius, deep):  # type: ignore[no-untyped-def]
    """Return whether a point of the convex hull lies outside of a cylinder along z, or (deep is 1) of a sphere."""
    x, y, z = place[0] - offset[0], place[1] - offset[1], deep * (place[2] - offset[2])
    if np.sqrt(x * x + y * y + z * z) + radius < room:
        return False
    for k in range(begin, end):
        px = x + size * (turn[0, 0] * hull[k, 0] + turn[0, 1] * hull[k, 1] + turn[0, 2] * hull[k, 2])
        py = y + size * (turn[1, 0] * hull[k, 0] + turn[1, 1] * hull[k, 1] + turn[1, 2] * hull[k, 2])
        pz = z + deep * size * (turn[2, 0] * hull[k, 0] + turn[2, 1] * hull[k, 1] + turn[2, 2] * hull[k, 2])
        if room < 0.0 or px * px + py * py + pz * pz > room * room:
            return True
    return False


@bare_kernel
def _is_outside_mesh(grains, bodies, walls, scratch, g, moved):  # type: ignore[no-untyped-def]
    """Return whether a grain meets the mesh of the container, or lies outside of it."""
    s, size, last = grains.shape[g], grains.diameter[g], len(bodies.spacing) - 1
    distance = grains.extent[g, HALF_SPACING] + 0.5 * bodies.spacing[last]
    for k in range(3):
        scratch.shift[k] = scratch.place[k] - walls.offset[k]
        for m in range(3):
            scratch.relative[k, m] = size * scratch.turn[k, m]
    if list_points(bodies, scratch, s, last, size, distance, distance)[0] < 0:
        return True
    return moved > grains.extent[g, HALF_THICKNESS] and not holds(bodies, s, last, scratch.relative, scratch.shift)
