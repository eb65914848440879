"""Contacts of grains with the walls of their container and with a lid."""

import math

import numpy as np

from voxgran._base.arrays import Integers
from voxgran._base.kernels import bare_kernel, kernel
from voxgran.contacts.manifolds.candidates import choose_candidates, write_candidates
from voxgran.contacts.manifolds.mesh_wall_contacts import near_mesh
from voxgran.contacts.manifolds.rows import WALL, ContactRows, Pair, Search
from voxgran.contacts.manifolds.wall_bodies import Lid, WallBodies
from voxgran.contacts.manifolds.wall_candidates import near_plane, near_round
from voxgran.containers.kernel_container import MESH, KernelContainer
from voxgran.geometry.vectors import row_of, vector_at
from voxgran.geometry.walls import reach_of

#: most contacts of a grain with one flat or round wall
MOST = 8
#: most contacts of a grain with the walls of a closed mesh, or with a lid on it
MOST_IN_MESH = 16
#: sides of a container: the lid, two for each axis, and then its walls of revolution
LID, AROUND = -1, 6


def find_wall_contacts(
    search: Search, walls: KernelContainer, lid: Lid, bodies: WallBodies, at_walls: tuple[Integers, Integers],
    rows: ContactRows, m: int,
) -> int:  # fmt: skip
    """Write where grains are near walls and a lid, from row m; return the next row, or -1 where the rows are full.

    A contact has the normal from the grain into the wall, the arm of the point on the grain, and the gap minus the rest
    distance, which is at most the margin. At a wall the partner is `WALL`, at the lid it is the number of the grains;
    its arm is 0. Of each grain the smallest gap of its contacts is exact at flat and round walls, also where it is
    negative. In a closed mesh it is exact for spheres and for meshes, down to depths of about half their bounding
    radius.

    Parameters
    ----------
    search : Search
        The n grains, not wrapped along periodic axes, which have no walls; those of a radius below 0 touch none.
    walls : KernelContainer
        Container, in the coordinates of the grains.
    lid : Lid
        Flat wall besides; none where its level is infinite.
    bodies : WallBodies
        Tables of the shapes, made for the same container.
    at_walls : tuple of ndarray of int
        First row and number of the rows, (n,), that were last written for each grain, of which ``rows.old`` holds the
        contents; replaced by the new ones.
    rows : ContactRows
        Rows that are written.
    m : int
        First row.

    Returns
    -------
    int
        The row after the last one; -1 where the rows are full. Then `at_walls` are those given and the rows
        before `m` are untouched: with larger arrays that hold the same old rows the call can be made again.
    """
    # closed meshes have a kernel of their own: others need not be compiled with what only these use
    find = _find_in_mesh if walls.kind == MESH else _find_in_closed_form
    return int(find(search, walls, lid, bodies, at_walls, rows, m))


@kernel
def _find_in_closed_form(search, walls, lid, bodies, at_walls, rows, m):  # type: ignore[no-untyped-def]
    """Write the contacts with flat and round walls and with a lid."""
    grains, reach, around = search.grains, search.margin + search.rest, len(walls.round)
    begin = np.zeros(len(grains.position) + 1, dtype=np.int64)
    for g in range(len(grains.position)):
        begin[g] = m
        if grains.radius[g] < 0.0:
            continue
        for index in range(AROUND + around + 1):
            side = index if index < AROUND + around else LID
            room, normal = _side_of(walls, lid, side, row_of(grains.position, g))
            if room > reach + grains.radius[g]:
                continue
            if side >= AROUND and walls.round[side - AROUND, 4] != 0.0:
                c = near_round(bodies, grains, g, walls.round[side - AROUND], reach)
            else:
                c = near_plane(bodies, grains, g, normal, room, reach)
            m = _write_side(search, bodies, at_walls, rows, m, g, side, c, MOST)
            if m < 0:
                return -1
    begin[-1] = m
    _keep_spans(at_walls, begin)
    return m


@kernel
def _find_in_mesh(search, walls, lid, bodies, at_walls, rows, m):  # type: ignore[no-untyped-def]
    """Write the contacts with the walls of a closed mesh and with a lid."""
    grains, reach = search.grains, search.margin + search.rest
    begin = np.zeros(len(grains.position) + 1, dtype=np.int64)
    for g in range(len(grains.position)):
        begin[g] = m
        if grains.radius[g] < 0.0:
            continue
        c = near_mesh(bodies, walls.mesh, grains, g, reach)
        if walls.dimension == 2:
            _lay_flat(bodies.found, c)
        m = _write_side(search, bodies, at_walls, rows, m, g, 0, c, MOST_IN_MESH)
        room, normal = _side_of(walls, lid, LID, row_of(grains.position, g))
        if m >= 0 and room <= reach + grains.radius[g]:
            c = near_plane(bodies, grains, g, normal, room, reach)
            m = _write_side(search, bodies, at_walls, rows, m, g, LID, c, MOST_IN_MESH)
        if m < 0:
            return -1
    begin[-1] = m
    _keep_spans(at_walls, begin)
    return m


@bare_kernel
def _write_side(search, bodies, at_walls, rows, m, g, side, c, most):  # type: ignore[no-untyped-def]
    """Write the c candidates of a grain at a side, of many those that are kept; return the next row, or -1."""
    grains, nowhere, (first, count) = search.grains, (math.inf, math.inf, math.inf), at_walls
    kept = choose_candidates(bodies.found, c, most, bodies.spread[grains.shape[g]] * grains.scale[g])
    partner = len(grains.position) if side == LID else WALL
    pair = Pair(g, partner, nowhere, first[g], count[g], search.margin + search.rest, search.rest)
    return write_candidates(rows, m, pair, bodies.found, kept)


@bare_kernel
def _keep_spans(at_walls, begin):  # type: ignore[no-untyped-def]
    """Note the rows of each grain, which begin where those of the grain before end."""
    for g in range(len(begin) - 1):
        at_walls[0][g], at_walls[1][g] = begin[g], begin[g + 1] - begin[g]


@bare_kernel
def _lay_flat(found, many):  # type: ignore[no-untyped-def]
    """Put arms and normals of candidates into the plane, which they leave by rounding only."""
    for k in range(many):
        nx, ny = found[k, 3], found[k, 4]
        length = max(math.sqrt(nx * nx + ny * ny), 1e-300)
        found[k, 2], found[k, 3], found[k, 4], found[k, 5] = 0.0, nx / length, ny / length, 0.0


@bare_kernel
def _side_of(walls, lid, side, place):  # type: ignore[no-untyped-def]
    """Return the distance of a point from a side of a container, infinite without such a side, and its normal.

    The sides are two for each axis, and the walls of revolution, of which the normal is that of planes.
    """
    if side == LID:
        n = vector_at(lid.normal, 0)
        return lid.level - place[0] * n[0] - place[1] * n[1] - place[2] * n[2], n
    if side >= AROUND:
        row = walls.round[side - AROUND]
        return row[6] - reach_of(row, place[0], place[1], place[2]), vector_at(row, 13)
    axis = side // 2
    if walls.flat[axis] == 0:
        return math.inf, (0.0, 0.0, 0.0)
    along, sign = place[axis] - walls.lower[axis], 2.0 * (side % 2) - 1.0
    room = along if side % 2 == 0 else walls.lengths[axis] - along
    return room, (sign if axis == 0 else 0.0, sign if axis == 1 else 0.0, sign if axis == 2 else 0.0)
