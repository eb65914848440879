"""A convex polyhedron that is cut by planes one after the other, in kernels.

Faces are lists of corners, counterclockwise seen from outside. A plane keeps the corners on its inner side; each edge
that it crosses gets one new corner, which both faces at that edge share, so that the faces stay closed whatever the
rounding errors. The new face follows from the pieces that the plane cuts off the other ones.
"""

import math
from typing import NamedTuple

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel

#: what a cut does: nothing, takes a part away, takes everything; rounding made it impossible; no room in the arrays
UNCUT, CUT, EMPTY, FAILED, CROWDED = 0, 1, 2, 3, 4


class Polyhedron(NamedTuple):
    """Arrays of a polyhedron of up to F faces.

    count: numbers of corners and of faces.  corner: (4 F, 3) places.  side: (4 F,) signed distances from a plane.
    renumbered: (4 F,) new numbers of corners.  size: (F,) corners of each face.  loop: (F, F) corners of each face.
    plane: (F, 4) outward normals, and offsets along them.  owner: (F,) what made each face.  span: (F,) distance of the
    seed that made it.  edge: (F, 2) corners inside and outside at the ends of the edges that are crossed.  after: (F,)
    which new corner comes after each.  kept: (F,) corners of one face.
    """

    count: Integers  # type: ignore[assignment]
    corner: Floats
    side: Floats
    renumbered: Integers
    size: Integers
    loop: Integers
    plane: Floats
    owner: Integers
    span: Floats
    edge: Integers
    after: Integers
    kept: Integers


def empty_polyhedron(faces: int) -> Polyhedron:
    """Return arrays for a polyhedron of up to so many faces."""
    corners, whole = 4 * faces, np.int64
    return Polyhedron(
        count=np.zeros(2, whole),
        corner=np.zeros((corners, 3)),
        side=np.zeros(corners),
        renumbered=np.zeros(corners, whole),
        size=np.zeros(faces, whole),
        loop=np.zeros((faces, faces), whole),
        plane=np.zeros((faces, 4)),
        owner=np.zeros(faces, whole),
        span=np.zeros(faces),
        edge=np.zeros((faces, 2), whole),
        after=np.zeros(faces, whole),
        kept=np.zeros(faces, whole),
    )


@bare_kernel
def set_box(cell: Polyhedron, low: Floats, high: Floats) -> None:
    """Make the polyhedron a box; its faces belong to -1 and -2 across x, -3 and -4 across y, -5 and -6 across z."""
    cell.count[0], cell.count[1] = 8, 6
    for k in range(8):
        for c in range(3):
            cell.corner[k, c] = high[c] if (k >> c) & 1 else low[c]
    for f in range(6):
        c, up = f // 2, f % 2
        p, q = 1 << ((c + 1) % 3), 1 << ((c + 2) % 3)
        base = up << c
        cell.size[f], cell.owner[f], cell.span[f] = 4, -1 - f, 0.0
        cell.loop[f, 0], cell.loop[f, 2] = base, base + p + q
        cell.loop[f, 1], cell.loop[f, 3] = (base + p, base + q) if up == 1 else (base + q, base + p)
        for d in range(3):
            cell.plane[f, d] = 0.0
        cell.plane[f, c] = 1.0 if up == 1 else -1.0
        cell.plane[f, 3] = high[c] if up == 1 else -low[c]


@bare_kernel
def clip(cell: Polyhedron, nx: float, ny: float, nz: float, offset: float, owner: int, span: float) -> int:
    """Keep what lies on the inner side of a plane, ``n . x <= offset``; return what the cut has done.

    After FAILED and CROWDED the polyhedron is not of use any more.
    """
    corners, outside = cell.count[0], 0
    for v in range(corners):
        cell.side[v] = nx * cell.corner[v, 0] + ny * cell.corner[v, 1] + nz * cell.corner[v, 2] - offset
        outside += cell.side[v] > 0.0
    if outside == 0:
        return UNCUT
    if outside == corners:
        return EMPTY
    made, faces = 0, 0
    for f in range(cell.count[1]):
        made = _cut_face(cell, f, faces, made)
        if made < 0:
            return FAILED if made == -1 else CROWDED
        faces += cell.size[faces] > 0
    if made == 0:
        return FAILED
    if faces + 1 >= len(cell.size):
        return CROWDED
    turn, many = 0, 0
    while many < made:
        cell.loop[faces, many] = corners + turn
        turn = cell.after[turn]
        many += 1
        if turn == 0:
            break
    if turn != 0 or many < made:
        return FAILED
    cell.size[faces], cell.owner[faces], cell.span[faces] = made, owner, span
    cell.plane[faces, 0], cell.plane[faces, 1], cell.plane[faces, 2], cell.plane[faces, 3] = nx, ny, nz, offset
    cell.count[0], cell.count[1] = corners + made, faces + 1
    _close_ranks(cell, corners)
    return CUT


@bare_kernel
def _cut_face(cell, f, target, made):  # type: ignore[no-untyped-def]
    """Write what is left of face f to face `target`; return the number of new corners, -1 or -2 where it fails."""
    corners, many, ends = cell.count[0], cell.size[f], 0
    new, enter, leave = 0, 0, 0
    crossed = f != target
    for k in range(many):
        crossed = crossed or cell.side[cell.loop[f, k]] > 0.0
    if not crossed:
        return made
    for k in range(many):
        a = cell.loop[f, k]
        b = cell.loop[f, k + 1 if k + 1 < many else 0]
        inside, goes_on = cell.side[a] <= 0.0, cell.side[b] <= 0.0
        if new + 2 >= len(cell.kept):
            return -2
        if inside:
            cell.kept[new] = a
            new += 1
        if inside != goes_on:
            number = _crossing(cell, a if inside else b, b if inside else a, made)
            if number < 0:
                return -2
            made = max(made, number + 1)
            cell.kept[new] = corners + number
            new += 1
            ends += 1
            if inside:
                leave = number
            else:
                enter = number
    if ends > 2:
        return -1
    if ends == 2:
        cell.after[enter] = leave
    for k in range(new):
        cell.loop[target, k] = cell.kept[k]
    cell.owner[target], cell.span[target] = cell.owner[f], cell.span[f]
    for c in range(4):
        cell.plane[target, c] = cell.plane[f, c]
    cell.size[target] = new
    return made


@bare_kernel
def _crossing(cell, a, b, made):  # type: ignore[no-untyped-def]
    """Return the number of the new corner between a, inside, and b, outside; make it where there is none yet."""
    for k in range(made):
        if cell.edge[k, 0] == a and cell.edge[k, 1] == b:
            return k
    place = cell.count[0] + made
    if made >= len(cell.edge) or place >= len(cell.corner):
        return -1
    cell.edge[made, 0], cell.edge[made, 1] = a, b
    share = cell.side[a] / (cell.side[a] - cell.side[b])
    for c in range(3):
        cell.corner[place, c] = cell.corner[a, c] + share * (cell.corner[b, c] - cell.corner[a, c])
    return made


@bare_kernel
def _close_ranks(cell, earlier):  # type: ignore[no-untyped-def]
    """Leave out the corners that were cut off, of the first `earlier` ones."""
    many = 0
    for v in range(cell.count[0]):
        cell.renumbered[v] = many
        if v >= earlier or cell.side[v] <= 0.0:
            if many < v:
                for c in range(3):
                    cell.corner[many, c] = cell.corner[v, c]
            many += 1
    cell.count[0] = many
    for f in range(cell.count[1]):
        for k in range(cell.size[f]):
            cell.loop[f, k] = cell.renumbered[cell.loop[f, k]]


@bare_kernel
def reach_of(cell: Polyhedron, flat: bool) -> float:
    """Return the distance of the farthest corner from the origin, across z alone if `flat`."""
    most = 0.0
    for v in range(cell.count[0]):
        z = 0.0 if flat else cell.corner[v, 2]
        most = max(most, cell.corner[v, 0] * cell.corner[v, 0] + cell.corner[v, 1] * cell.corner[v, 1] + z * z)
    return math.sqrt(most)


@bare_kernel
def area_of_face(cell: Polyhedron, f: int) -> float:
    """Return the area of a face."""
    ax = ay = az = 0.0
    o = cell.loop[f, 0]
    for k in range(1, cell.size[f] - 1):
        p, q = cell.loop[f, k], cell.loop[f, k + 1]
        ux, uy, uz = _edge(cell, o, p)
        vx, vy, vz = _edge(cell, o, q)
        ax, ay, az = ax + uy * vz - uz * vy, ay + uz * vx - ux * vz, az + ux * vy - uy * vx
    return 0.5 * math.sqrt(ax * ax + ay * ay + az * az)


@bare_kernel
def _edge(cell, a, b):  # type: ignore[no-untyped-def]
    """Return the way from one corner to another."""
    return (
        cell.corner[b, 0] - cell.corner[a, 0],
        cell.corner[b, 1] - cell.corner[a, 1],
        cell.corner[b, 2] - cell.corner[a, 2],
    )


@bare_kernel
def volume_and_center(cell: Polyhedron, center: Floats) -> float:
    """Write the centroid and return the volume, from tetrahedra between the first corner and the faces."""
    volume = mx = my = mz = 0.0
    for f in range(cell.count[1]):
        o = cell.loop[f, 0]
        ox, oy, oz = _edge(cell, 0, o)
        for k in range(1, cell.size[f] - 1):
            px, py, pz = _edge(cell, 0, cell.loop[f, k])
            qx, qy, qz = _edge(cell, 0, cell.loop[f, k + 1])
            part = ox * (py * qz - pz * qy) + oy * (pz * qx - px * qz) + oz * (px * qy - py * qx)
            volume += part
            mx, my, mz = mx + part * (ox + px + qx), my + part * (oy + py + qy), mz + part * (oz + pz + qz)
    if volume <= 0.0:
        center[0], center[1], center[2] = 0.0, 0.0, 0.0
        return 0.0
    center[0] = cell.corner[0, 0] + mx / (4.0 * volume)
    center[1] = cell.corner[0, 1] + my / (4.0 * volume)
    center[2] = cell.corner[0, 2] + mz / (4.0 * volume)
    return volume / 6.0


@bare_kernel
def copy_polyhedron(cell: Polyhedron, copy: Polyhedron) -> None:
    """Write corners and faces of a polyhedron to another one with as much room."""
    copy.count[0], copy.count[1] = cell.count[0], cell.count[1]
    for v in range(cell.count[0]):
        for c in range(3):
            copy.corner[v, c] = cell.corner[v, c]
    for f in range(cell.count[1]):
        copy.size[f], copy.owner[f], copy.span[f] = cell.size[f], cell.owner[f], cell.span[f]
        for k in range(cell.size[f]):
            copy.loop[f, k] = cell.loop[f, k]
        for c in range(4):
            copy.plane[f, c] = cell.plane[f, c]
