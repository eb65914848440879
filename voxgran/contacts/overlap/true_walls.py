"""Whether a container holds a grain of a true shape.

Flat walls are compared with the support function of the grain, round ones with its farthest point, and the triangles of
a closed mesh with the parts of the grain.
"""

import math

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel
from voxgran.contacts.manifolds.convex_contacts import place_row
from voxgran.contacts.manifolds.convex_distance import core_support, tables_of
from voxgran.contacts.overlap.true_pairs import holds, in_frame, point_of, surfaces_meet
from voxgran.contacts.overlap.true_shapes import TrueShapes
from voxgran.contacts.walls import reach_from_line
from voxgran.containers.kernel_container import MESH, KernelContainer, mesh_distance
from voxgran.geometry.farthest import farthest_of_row
from voxgran.geometry.walls import reach_from, reach_of


@bare_kernel
def is_within_walls(
    walls: KernelContainer, shapes: TrueShapes, s: int, f: float, x: float, y: float, z: float,
) -> bool:  # fmt: skip
    """Return whether the container holds a grain of shape s and scale f at (x, y, z), rotated by `work.turn`."""
    bound = f * shapes.bounding[s]
    for axis in range(3):
        place = x if axis == 0 else (y if axis == 1 else z)
        if walls.walled[axis] == 0:
            continue
        low = walls.lower[axis] - walls.slack
        high = walls.lower[axis] + walls.lengths[axis] + walls.slack
        if place + bound > high and place + f * _reach(shapes, s, axis, 1.0) > high:
            return False
        if place - bound < low and place - f * _reach(shapes, s, axis, -1.0) < low:
            return False
    for k in range(len(walls.round)):
        row = walls.round[k]
        if reach_of(row, x, y, z) + bound <= row[6] + walls.slack:
            continue
        if _farthest(shapes, s, f, x - row[0], y - row[1], z - row[2], row) > row[6] + walls.slack:
            return False
    if walls.kind == MESH:
        if -mesh_distance(walls.mesh, x, y, z) >= bound:
            return True
        return _is_within_mesh(walls, shapes, s, f, x, y, z)
    return True


@bare_kernel
def _last_part(shapes, s):  # type: ignore[no-untyped-def]
    """Return the first part of a shape and the one after the last by which its reach is found."""
    if shapes.hull[s] >= 0:
        return shapes.hull[s], shapes.hull[s] + 1
    return shapes.first[s, 0], shapes.first[s + 1, 0]


@bare_kernel
def _reach(shapes, s, axis, sign):  # type: ignore[no-untyped-def]
    """Return how far shape s reaches from its centroid along an axis or, with sign -1, against it."""
    turn, tables = shapes.work.turn, tables_of(shapes.bodies, shapes.work)
    ux, uy, uz = sign * turn[axis, 0], sign * turn[axis, 1], sign * turn[axis, 2]
    most, (begin, end) = -math.inf, _last_part(shapes, s)
    for p in range(begin, end):
        part = (shapes.part[p, 0], s, shapes.part[p, 1], shapes.part[p, 2], shapes.part[p, 3], 0.0)
        px, py, pz, _ = core_support((tables, part), 0, ux, uy, uz)
        most = max(most, px * ux + py * uy + pz * uz + shapes.margin[p])
    return most


@bare_kernel
def _farthest(shapes, s, f, x, y, z, wall):  # type: ignore[no-untyped-def]
    """Return the largest reach of the points of a grain, at (x, y, z) from the center of a wall of revolution."""
    work, most, (begin, end) = shapes.work, -math.inf, _last_part(shapes, s)
    turn, last = work.turn, len(work.row) - 1
    for p in range(begin, end):
        if shapes.part[p, 1] == shapes.part[p, 2]:
            place_row(work.row[s], turn, f, work.row[last])
            if wall[3] == 1.0:
                most = max(most, farthest_of_row(work.row[last], x, y, z))
            else:
                most = max(most, reach_from_line(work.row[last], x, y, z, wall))
        for k in range(shapes.part[p, 1], shapes.part[p, 2]):
            corner = work.corner[k]
            dx, dy, dz = _turned(turn, f, corner)
            most = max(most, reach_from(wall, x + dx, y + dy, z + dz) + f * shapes.margin[p])
    return most


@bare_kernel
def _turned(turn: Floats, f: float, corner: Floats) -> tuple[float, float, float]:
    """Return a corner, rotated and scaled."""
    return (
        f * (turn[0, 0] * corner[0] + turn[0, 1] * corner[1] + turn[0, 2] * corner[2]),
        f * (turn[1, 0] * corner[0] + turn[1, 1] * corner[1] + turn[1, 2] * corner[2]),
        f * (turn[2, 0] * corner[0] + turn[2, 1] * corner[1] + turn[2, 2] * corner[2]),
    )


@bare_kernel
def _is_within_mesh(walls, shapes, s, f, x, y, z):  # type: ignore[no-untyped-def]
    """Return whether a closed mesh, the last shape, holds a grain: no triangle meets it, and its points are inside."""
    wall, work, shift = len(shapes.first) - 2, shapes.work, walls.mesh.shift
    for i in range(3):
        for j in range(3):
            work.relative[i, j] = work.turn[i, j]
    px, py, pz = x + shift[0], y + shift[1], z + shift[2]
    if surfaces_meet(shapes, wall, s, px, py, pz, f):
        return False
    first, last = shapes.first[s, 0], shapes.first[s + 1, 0]
    # each sphere of a union is tested, one point of any other shape
    for p in range(first, last if shapes.part[first, 0] == 0 else first + 1):
        corner = work.simplex.near
        corner[0], corner[1], corner[2] = point_of(shapes, p)
        dx, dy, dz = _turned(work.turn, f, corner)
        if not holds(shapes, wall, px + dx, py + dy, pz + dz):
            return False
    if shapes.closed[s]:
        # a hole of the container may lie in the grain
        for k in range(len(shapes.outer)):
            dx, dy, dz = shapes.outer[k, 0] - px, shapes.outer[k, 1] - py, shapes.outer[k, 2] - pz
            u, v, w = in_frame(work.turn, f, dx, dy, dz)
            if holds(shapes, s, u, v, w):
                return False
    return True
