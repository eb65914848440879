"""Contacts of grains with the walls of their container and with a lid."""

import math

import numpy as np

from voxgran._base.kernels import kernel
from voxgran.containers.kernel_container import FLAT, MESH, ROUND, UPRIGHT
from voxgran.settling.contact_rows import WALL
from voxgran.settling.mesh_wall_contacts import near_mesh
from voxgran.settling.wall_candidates import near_plane, near_round, write_candidates

#: most contacts of a grain with one flat or round wall
MOST = 8
#: most contacts of a grain with the walls of a closed mesh
MOST_IN_MESH = 16


@kernel
def find_wall_contacts(grains, walls, lid, bodies, first, count, rows, m, margin, rest):  # type: ignore[no-untyped-def]
    """Write where grains are near walls and a lid, from row m; return the next row, or -1 where the rows are full.

    A contact has the normal from the grain into the wall, the arm of the point on the grain, and the gap minus `rest`,
    which is at most `margin`. At a wall the partner is `WALL`, at the lid it is the number of the grains; its arm is 0.
    Of each grain the smallest gap of its contacts is exact at flat and round walls, also where it is negative. In a
    closed mesh it is exact for spheres and for meshes, down to depths of about half their bounding radius.

    Parameters
    ----------
    grains : Grains
        The n grains, not wrapped along periodic axes, which have no walls.
    walls : KernelContainer
        Container, in the coordinates of the grains.
    lid : Lid
        Flat wall besides; none where its level is infinite.
    bodies : WallBodies
        Tables of the shapes, made for the same container.
    first, count : (n,) ndarray of int
        Rows that were last written for each grain, of which ``rows.old`` holds the contents; replaced by the new ones.
    rows : ContactRows
        Rows that are written.
    m : int
        First row.
    margin, rest : float
        Largest distance of a contact, and distance from which gaps are counted, in the unit of lengths.

    Returns
    -------
    int
        The row after the last one; -1 where the rows are full. Then `first` and `count` are those given and the rows
        before `m` are untouched: with larger arrays that hold the same old rows the call can be made again.
    """
    n = len(grains.position)
    here, many = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    reach = margin + rest
    middle, lower, lengths, walled = walls.middle, walls.lower, walls.lengths, walls.walled
    for g in range(n):
        here[g] = m
        x, y, z = grains.position[g, 0], grains.position[g, 1], grains.position[g, 2]
        near = reach + grains.radius[g]
        shape, scale = grains.shape[g], grains.scale[g]
        spread = bodies.spread[shape] * scale
        if walls.kind == FLAT or walls.kind == UPRIGHT:
            for axis in range(0 if walls.kind == FLAT else 2, 3):
                if walled[axis] == 0:
                    continue
                place = x if axis == 0 else (y if axis == 1 else z)
                for side in range(2):
                    room = place - lower[axis] if side == 0 else lower[axis] + lengths[axis] - place
                    if room > near:
                        continue
                    sign = 2.0 * side - 1.0
                    nx, ny, nz = (
                        sign if axis == 0 else 0.0,
                        sign if axis == 1 else 0.0,
                        sign if axis == 2 else 0.0,
                    )
                    c = near_plane(bodies, shape, scale, grains.matrix[g], nx, ny, nz, room, reach)
                    m = write_candidates(rows, m, g, WALL, bodies.found, c, MOST, spread, first[g], count[g], rest)
                    if m < 0:
                        return -1
        if walls.kind == UPRIGHT or walls.kind == ROUND:
            flat = 1.0 if walls.kind == ROUND else 0.0
            dx, dy, dz = x - middle[0], y - middle[1], z - middle[2]
            if walls.radius - math.sqrt(dx * dx + dy * dy + flat * dz * dz) <= near:
                matrix = grains.matrix[g]
                c = near_round(bodies, shape, scale, matrix, dx, dy, dz, flat, walls.radius, reach)
                m = write_candidates(rows, m, g, WALL, bodies.found, c, MOST, spread, first[g], count[g], rest)
        elif walls.kind == MESH:
            c = near_mesh(bodies, walls.mesh, shape, scale, grains.matrix[g], x, y, z, grains.radius[g], reach)
            most = MOST_IN_MESH
            m = write_candidates(rows, m, g, WALL, bodies.found, c, most, spread, first[g], count[g], rest)
        if m < 0:
            return -1
        room = lid.level - x * lid.normal[0] - y * lid.normal[1] - z * lid.normal[2]
        if room <= near:
            nx, ny, nz = lid.normal[0], lid.normal[1], lid.normal[2]
            c = near_plane(bodies, shape, scale, grains.matrix[g], nx, ny, nz, room, reach)
            m = write_candidates(rows, m, g, n, bodies.found, c, MOST, spread, first[g], count[g], rest)
            if m < 0:
                return -1
        many[g] = m - here[g]
    for g in range(n):
        first[g], count[g] = here[g], many[g]
    return m
