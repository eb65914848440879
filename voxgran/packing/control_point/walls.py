"""Walls of control-point packing: flat and round ones exactly, by the convex hull of a grain; a mesh by its own points.

Flat and round walls are convex; a grain is within them where the corners of its convex hull are. The mesh of a closed
container is sampled like a grain, and grains keep clear of its points. A lid is a flat wall, whatever the container.
"""

import numpy as np

from voxgran._base.arrays import Integers
from voxgran._base.kernels import bare_kernel, inlined_kernel
from voxgran.geometry.rotation import write_matrix
from voxgran.packing.control_point.point_contact import holds, list_points
from voxgran.packing.control_point.records import BALL, HALF_SPACING, HALF_THICKNESS, MESH, RADIUS, ROUND, Pairs, Walls

#: how far from the top wall a grain enters, and from a grain the lid stops, in median diameters: more than rounding
CLEAR = 1e-9
#: how far beyond a wall rounding may put a grain that touches it, in median diameters
EXACT = 1e-12


@inlined_kernel
def is_outside(pairs: Pairs, walls: Walls, g: int, moved: float) -> bool:
    """Return whether a grain in the tried pose reaches beyond a wall; `moved` bounds how far its points came."""
    grains, bodies = pairs.grains, pairs.bodies
    if walls.kind == MESH:
        if _is_outside_mesh(pairs, walls, g, moved):
            return True
        if not walls.lid:
            return False
    margin = bodies.margin[grains.shape[g]] * grains.diameter[g]
    if _is_beyond_flat(pairs, walls, g, margin):
        return True
    return walls.kind in (ROUND, BALL) and _is_beyond_round(pairs, walls, g, margin)


@bare_kernel
def room_of_lid(pairs: Pairs, walls: Walls, down: Integers) -> float:
    """Return how far the lid, the flat wall against `down`, may come down before it meets a grain."""
    grains, bodies, turn = pairs.grains, pairs.bodies, pairs.scratch.turn
    axis = 0 if down[0] != 0 else (1 if down[1] != 0 else 2)
    room = walls.upper[axis] - walls.lower[axis]
    for g in range(len(grains.placed)):
        if grains.placed[g] == 0:
            continue
        s, size = grains.shape[g], grains.diameter[g]
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


@inlined_kernel
def _is_beyond_flat(pairs, walls, g, margin):  # type: ignore[no-untyped-def]
    """Return whether a point of the convex hull lies beyond a flat wall."""
    grains, bodies, turn, span = pairs.grains, pairs.bodies, pairs.scratch.turn, pairs.scratch.span
    s, size, radius, hull = grains.shape[g], grains.diameter[g], grains.extent[g, RADIUS], bodies.hull
    for axis in range(3):
        x, low, high = pairs.scratch.place[axis], walls.lower[axis] + margin - EXACT, walls.upper[axis] - margin + EXACT
        if walls.walled[axis] == 0 or low + radius < x < high - radius:
            continue
        if len(grains.span) > 0 and low < x + span[2 * axis] and x + span[2 * axis + 1] < high:
            continue
        t, u, v = turn[axis, 0], turn[axis, 1], turn[axis, 2]
        for k in range(bodies.hull_start[s], bodies.hull_start[s + 1]):
            along = x + size * (t * hull[k, 0] + u * hull[k, 1] + v * hull[k, 2])
            if along < low or along > high:
                return True
    return False


@inlined_kernel
def _is_beyond_round(pairs, walls, g, margin):  # type: ignore[no-untyped-def]
    """Return whether a point of the convex hull lies outside of a cylinder along z or of a sphere."""
    grains, bodies, place, turn = pairs.grains, pairs.bodies, pairs.scratch.place, pairs.scratch.turn
    s, size, hull, offset = grains.shape[g], grains.diameter[g], bodies.hull, walls.offset
    room, deep = walls.radius - margin + EXACT, 1.0 if walls.kind == BALL else 0.0
    x, y, z = place[0] - offset[0], place[1] - offset[1], deep * (place[2] - offset[2])
    if np.sqrt(x * x + y * y + z * z) + grains.extent[g, RADIUS] < room:
        return False
    for k in range(bodies.hull_start[s], bodies.hull_start[s + 1]):
        px = x + size * (turn[0, 0] * hull[k, 0] + turn[0, 1] * hull[k, 1] + turn[0, 2] * hull[k, 2])
        py = y + size * (turn[1, 0] * hull[k, 0] + turn[1, 1] * hull[k, 1] + turn[1, 2] * hull[k, 2])
        pz = z + deep * size * (turn[2, 0] * hull[k, 0] + turn[2, 1] * hull[k, 1] + turn[2, 2] * hull[k, 2])
        if room < 0.0 or px * px + py * py + pz * pz > room * room:
            return True
    return False


@bare_kernel
def _is_outside_mesh(pairs, walls, g, moved):  # type: ignore[no-untyped-def]
    """Return whether a grain meets the mesh of the container, or lies outside of it."""
    grains, bodies, scratch = pairs.grains, pairs.bodies, pairs.scratch
    s, size, last = grains.shape[g], grains.diameter[g], len(bodies.spacing) - 1
    distance = grains.extent[g, HALF_SPACING] + 0.5 * bodies.spacing[last]
    for k in range(3):
        scratch.shift[k] = scratch.place[k] - walls.offset[k]
        for m in range(3):
            scratch.relative[k, m] = size * scratch.turn[k, m]
    if list_points(bodies, scratch, s, last, size, distance, distance)[0] < 0:
        return True
    return moved > grains.extent[g, HALF_THICKNESS] and not holds(bodies, s, last, scratch.relative, scratch.shift)
