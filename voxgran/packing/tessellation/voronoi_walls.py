"""Walls of containers as cells of a tessellation are cut by them, in kernels.

Round walls cut by tangent planes at the directions of the corners beyond them, until corners protrude by little. A wall
of triangles cuts by planes through its points nearest to the seed, across the way to them: what is left is convex and
lies inside, also in containers that are not convex, where corners of the container remain empty.
"""

import math

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel
from voxgran.containers.kernel_container import ROUND, KernelContainer
from voxgran.geometry.polyhedron import CUT, EMPTY, Polyhedron, clip, reach_of
from voxgran.geometry.tree import square_to_box
from voxgran.geometry.triangles import closest_on_triangle

#: protrusion of corners beyond a round wall, in sizes of the cell, and most planes of such a wall per cell
PROTRUSION, ROUND_PLANES = 0.005, 80
#: most planes of walls of triangles per cell, and protrusion, in sizes of the container, that is rounding
TRIANGLE_PLANES, OUTSIDE = 400, 1e-12
#: owners of the faces at round walls and at walls of triangles
ROUND_WALL, MESH_WALL = -7, -8


@bare_kernel
def cut_by_round_wall(place: Floats, walls: KernelContainer, cell: Polyhedron, i: int, shift: float) -> int:
    """Cut by tangent planes of a cylinder or a sphere, at the corner that is farthest beyond it, again and again."""
    mx, my = walls.middle[0] - place[i, 0], walls.middle[1] - place[i, 1]
    mz = walls.middle[2] - place[i, 2] if walls.kind == ROUND else 0.0
    for _ in range(ROUND_PLANES):
        # of what is left of the cell: before the cuts it may reach far beyond the wall
        worst, most = -1, walls.radius + PROTRUSION * reach_of(cell, walls.dimension == 2)
        for v in range(cell.count[0]):
            x, y = cell.corner[v, 0] - mx, cell.corner[v, 1] - my
            z = cell.corner[v, 2] - mz if walls.kind == ROUND else 0.0
            far = math.sqrt(x * x + y * y + z * z)
            if far > most:
                worst, most = v, far
        if worst < 0:
            return CUT
        x, y = (cell.corner[worst, 0] - mx) / most, (cell.corner[worst, 1] - my) / most
        z = (cell.corner[worst, 2] - mz) / most if walls.kind == ROUND else 0.0
        state = clip(cell, x, y, z, walls.radius + x * mx + y * my + z * mz - shift, ROUND_WALL, 0.0)
        if state > CUT:
            return state
    return CUT


@bare_kernel
def cut_by_triangles(
    place: Floats, walls: KernelContainer, cell: Polyhedron, i: int, shift: float, near: Floats
) -> int:
    """Cut by planes through the nearest points of triangles, the nearest triangle first, until none is inside."""
    mesh = walls.mesh
    px = place[i, 0] + mesh.shift[0]
    py = place[i, 1] + mesh.shift[1]
    pz = place[i, 2] + mesh.shift[2]
    slack = OUTSIDE * max(walls.lengths[0], walls.lengths[1], walls.lengths[2])
    passed, last = -1.0, -1
    for _ in range(TRIANGLE_PLANES):
        reach = reach_of(cell, walls.dimension == 2)
        last = _next_inside(mesh, cell, px, py, pz, reach * reach, slack, passed, last, near)
        if last < 0:
            return CUT
        passed = near[3]
        if passed == 0.0:
            return EMPTY
        state = clip(cell, near[0], near[1], near[2], math.sqrt(passed) - shift, MESH_WALL, 0.0)
        if state > CUT:
            return state
    return EMPTY


@bare_kernel
def _next_inside(mesh, cell, px, py, pz, best, slack, passed, last, near):  # type: ignore[no-untyped-def]
    """Return the nearest triangle that is not yet cut off, after triangle `last` at the squared distance `passed`.

    Write the direction of its nearest point and the squared distance of that; -1 where there is none within the square
    root of `best`.
    """
    found, feature = -1, 0
    mesh.stack[0], depth, leaves = 0, 1, len(mesh.low) // 2
    while depth > 0:
        depth -= 1
        node = mesh.stack[depth]
        if square_to_box(mesh.low, mesh.high, node, px, py, pz) > best:
            continue
        if node < leaves:
            mesh.stack[depth], mesh.stack[depth + 1] = 2 * node + 1, 2 * node + 2
            depth += 2
            continue
        for t in range(mesh.start[node, 0], mesh.start[node, 1]):
            x, y, z, part = closest_on_triangle(mesh.corners, t, px, py, pz)
            x, y, z = x - px, y - py, z - pz
            square = x * x + y * y + z * z
            # those at one distance come in the order of their numbers
            comes = square > passed or (square == passed and t > last)
            nearer = square < best or (square == best and (found < 0 or t < found))
            if comes and nearer and not _is_cut_off(cell, mesh, t, px, py, pz, slack):
                best, found, feature = square, t, part
                near[0], near[1], near[2] = x, y, z
    if found >= 0:
        away = math.sqrt(best)
        for c in range(3):
            # at a face its own normal, which rounding leaves as it is
            near[c] = mesh.normals[found, 0, c] if feature == 0 else near[c] / max(away, 1e-300)
        near[3] = best
    return found


@bare_kernel
def _is_cut_off(cell, mesh, t, px, py, pz, slack):  # type: ignore[no-untyped-def]
    """Return whether a triangle lies beyond one of the planes."""
    for f in range(cell.count[1]):
        beyond = True
        for k in range(3):
            x, y, z = mesh.corners[t, k, 0] - px, mesh.corners[t, k, 1] - py, mesh.corners[t, k, 2] - pz
            side = cell.plane[f, 0] * x + cell.plane[f, 1] * y + cell.plane[f, 2] * z - cell.plane[f, 3]
            beyond = beyond and side >= -slack
        if beyond:
            return True
    return False
