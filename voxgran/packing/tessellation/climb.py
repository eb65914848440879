"""Largest spheres in holes between spheres and plane walls: climbs of the clearance to its local maxima.

The clearance of a point is its distance from the nearest surface. Near a point it is replaced by the smallest of the
tangent planes of all distances, whose largest value in a small box is the solution of a linear program in the
displacement and the clearance. The distance from a sphere is a convex function, so that the true clearance at the
solution is at least as large: each step goes up, without any search along it. At a maximum, where the sphere touches
four others (three disks), the steps converge quadratically, as they are those of Newton for the four contacts.
"""

import math

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel, kernel
from voxgran.geometry.level_grid import LevelGrid, cells_near, first_in_cell, image_shift, link_at
from voxgran.geometry.vectors import sub

#: spheres that are looked at around a point, at most; the nearest ones
NEAREST = 64
#: steps of one climb, searches for neighbours, and changes of the basis of one linear program, at most
STEPS, SEARCHES, PIVOTS = 40, 24, 80
#: gain of a step, in lengths of the hole, below which a climb ends
SAME = 1e-14
#: share of the multipliers above which a contact carries
CARRIES = 1e-9
#: neighbours are gathered to so many sizes of the hole, and a step is at most this share of that
REACH, STRIDE = 2.0, 0.25
#: columns of a start: place, expected radius of the hole, largest radius, and whether it moves
X, Y, Z, HINT, MOST, MOVES = 0, 1, 2, 3, 4, 5
#: what becomes of a sphere: left out, placed, or to climb again
DROPPED, TAKEN, AGAIN = 0, 1, 2


@kernel
def climb_all(
    spheres: Floats, cells: LevelGrid, dimension: int, starts: Floats, planes: Floats, many: Integers, holes: Floats,
    normals: Floats,
) -> None:  # fmt: skip
    """Climb from each of the (m, 6) starts; write place and radius, (m, 4), and up to four directions of contact.

    A radius of 0 says that there is no hole. planes: (m, p, 4) walls of each start, of which the first `many` count: a
    unit vector and an offset, whose sum with a place is the distance from the wall. normals: (m, 4, 3) unit vectors
    from what is touched to the center; those left over are 0.
    """
    near, rows = np.zeros((NEAREST, 4)), np.zeros((NEAREST + planes.shape[1], 4))
    basis, inverse, box, step = np.zeros(4, np.int64), np.zeros((4, 4)), np.zeros(3), np.zeros(4)
    at = np.zeros(3)
    for k in range(len(starts)):
        for axis in range(3):
            at[axis] = starts[k, axis]
        work = (at, near, rows, basis, inverse, box, step)
        holes[k, 3] = _climb(spheres, cells, dimension, starts, planes, many[k], k, work, normals)
        for axis in range(3):
            holes[k, axis] = at[axis]


@bare_kernel
def _climb(spheres, cells, dimension, starts, planes, many, k, work, normals):  # type: ignore[no-untyped-def]
    """Move `at` to the local maximum of the clearance, at most to where it is `most`, and return the clearance."""
    hint, most, moves = starts[k, HINT], starts[k, MOST], starts[k, MOVES] > 0.0
    at, near, rows, basis, inverse, box, step = work
    reach = REACH * hint
    for i in range(4):
        for axis in range(3):
            normals[k, i, axis] = 0.0
    for _ in range(SEARCHES):
        count, reach = _gather(spheres, cells, at[0], at[1], at[2], reach, near)
        sx, sy, sz = at[0], at[1], at[2]
        for axis in range(3):
            box[axis] = STRIDE * reach if axis < dimension else 0.0
        clearance = _set_rows(near, count, planes, k, many, at, rows)
        way, ended = 0.0, not moves or clearance >= most
        for _ in range(STEPS):
            if ended or min(clearance, most) + way > reach:
                break
            _ascend(rows, count + many, box, SAME * reach, basis, inverse, step)
            if step[3] - clearance <= SAME * reach:
                ended = True
                break
            for axis in range(3):
                at[axis] += step[axis]
            higher = _set_rows(near, count, planes, k, many, at, rows)
            ended = higher <= clearance or higher >= most
            clearance = higher
            way = math.sqrt((at[0] - sx) ** 2 + (at[1] - sy) ** 2 + (at[2] - sz) ** 2)
        if min(clearance, most) + way <= reach:
            if moves and clearance < most:
                _ascend(rows, count + many, box, SAME * reach, basis, inverse, step)
                _set_normals(rows, count + many, basis, inverse, k, normals)
            return min(clearance, most)
        # where nothing is as near as that, the search widens
        reach = 2.0 * reach if way == 0.0 else max(REACH * hint, 2.0 * min(clearance, most))
    return 0.0


@bare_kernel
def _set_normals(rows, count, basis, inverse, k, normals):  # type: ignore[no-untyped-def]
    """Write the directions from those rows of the basis that hold the sphere."""
    for i in range(4):
        if basis[i] < count and inverse[3, i] > CARRIES:
            for axis in range(3):
                normals[k, i, axis] = rows[basis[i], axis]


@bare_kernel
def _gather(spheres, cells, x, y, z, reach, near):  # type: ignore[no-untyped-def]
    """Write centers and radii of all spheres whose surface is within reach; return their number and that reach.

    Where there are too many, the nearest are kept and the reach returned is smaller.
    """
    count = 0
    for level in range(len(cells.first)):
        wide = reach + cells.reach[level, 0]
        low, high = cells_near(cells, level, x, y, z, (wide, wide, wide))
        for i in range(low[0], high[0]):
            for j in range(low[1], high[1]):
                for k in range(low[2], high[2]):
                    sphere, ti, tj, tk = first_in_cell(cells, level, i, j, k)
                    px, py, pz = sub((x, y, z), image_shift(cells, ti, tj, tk))
                    while sphere >= 0:
                        dx, dy, dz = spheres[sphere, 0] - px, spheres[sphere, 1] - py, spheres[sphere, 2] - pz
                        r = spheres[sphere, 3]
                        if dx * dx + dy * dy + dz * dz <= (r + reach) * (r + reach):
                            count, reach = _keep(near, count, reach, x, y, z, x + dx, y + dy, z + dz, r)
                        sphere = cells.after[sphere]
    return count, reach


@bare_kernel
def _keep(near, count, reach, x, y, z, cx, cy, cz, r):  # type: ignore[no-untyped-def]
    """Add a sphere, for the farthest one where there are too many; return their number and how far they are whole."""
    place = count
    if count == NEAREST:
        farthest = math.sqrt((cx - x) ** 2 + (cy - y) ** 2 + (cz - z) ** 2) - r
        for i in range(count):
            gap = math.sqrt((near[i, 0] - x) ** 2 + (near[i, 1] - y) ** 2 + (near[i, 2] - z) ** 2) - near[i, 3]
            if gap > farthest:
                place, farthest = i, gap
        reach = farthest
    if place < NEAREST:
        near[place, 0], near[place, 1], near[place, 2], near[place, 3] = cx, cy, cz, r
    return min(count + 1, NEAREST), reach


@bare_kernel
def _set_rows(near, count, planes, k, many, at, rows):  # type: ignore[no-untyped-def]
    """Write direction and distance of all spheres and walls, and return the smallest distance."""
    clearance = math.inf
    for i in range(count):
        dx, dy, dz = at[0] - near[i, 0], at[1] - near[i, 1], at[2] - near[i, 2]
        away = math.sqrt(dx * dx + dy * dy + dz * dz)
        # from a center all directions lead out
        rows[i, 0] = dx / away if away > 0.0 else 1.0
        rows[i, 1] = dy / away if away > 0.0 else 0.0
        rows[i, 2] = dz / away if away > 0.0 else 0.0
        rows[i, 3] = away - near[i, 3]
        clearance = min(clearance, rows[i, 3])
    for i in range(many):
        row = count + i
        for axis in range(3):
            rows[row, axis] = planes[k, i, axis]
        rows[row, 3] = planes[k, i, 0] * at[0] + planes[k, i, 1] * at[1] + planes[k, i, 2] * at[2] + planes[k, i, 3]
        clearance = min(clearance, rows[row, 3])
    return clearance


@bare_kernel
def _ascend(rows, count, box, near, basis, inverse, step):  # type: ignore[no-untyped-def]
    """Write the displacement in a box that makes the smallest of all linear distances largest, and that distance.

    This is the dual simplex method: the basis is four rows that hold; the row that is violated most enters. Numbers of
    rows from `count` on are the faces of the box, upper and lower ones in turn. In `inverse`, column i belongs to row i
    of the basis; its last entry is the multiplier of that row.
    """
    least = 0
    for j in range(count):
        if rows[j, 3] < rows[least, 3]:
            least = j
    basis[0] = least
    for i in range(4):
        for c in range(4):
            inverse[i, c] = 0.0
    inverse[3, 0] = 1.0
    for axis in range(3):
        along = rows[least, axis] if count else 1.0
        basis[1 + axis] = count + 2 * axis + (0 if along >= 0.0 else 1)
        inverse[axis, 1 + axis] = 1.0 if along >= 0.0 else -1.0
        inverse[3, 1 + axis] = abs(along)
    for _ in range(PIVOTS):
        for i in range(4):
            step[i] = 0.0
        for c in range(4):
            bound = rows[basis[c], 3] if basis[c] < count else box[(basis[c] - count) // 2]
            for i in range(4):
                step[i] += inverse[i, c] * bound
        enters, worst = -1, near
        for j in range(count):
            beyond = step[3] - rows[j, 0] * step[0] - rows[j, 1] * step[1] - rows[j, 2] * step[2] - rows[j, 3]
            if beyond > worst:
                enters, worst = j, beyond
        for axis in range(3):
            if abs(step[axis]) - box[axis] > worst:
                enters, worst = count + 2 * axis + (0 if step[axis] > 0.0 else 1), abs(step[axis]) - box[axis]
        if enters < 0 or not _pivot(rows, count, enters, basis, inverse):
            return


@bare_kernel
def _pivot(rows, count, enters, basis, inverse):  # type: ignore[no-untyped-def]
    """Let a row enter the basis, for the one whose multiplier vanishes first; return whether there is one."""
    if enters < count:
        ax, ay, az, at = -rows[enters, 0], -rows[enters, 1], -rows[enters, 2], 1.0
    else:
        side = 1.0 if (enters - count) % 2 == 0 else -1.0
        axis = (enters - count) // 2
        ax, ay, az, at = (side if axis == 0 else 0.0), (side if axis == 1 else 0.0), (side if axis == 2 else 0.0), 0.0
    leaves, least, share = -1, math.inf, 0.0
    for c in range(4):
        part = ax * inverse[0, c] + ay * inverse[1, c] + az * inverse[2, c] + at * inverse[3, c]
        if part > 1e-12 and max(inverse[3, c], 0.0) < least * part:
            leaves, least, share = c, max(inverse[3, c], 0.0) / part, part
    if leaves < 0:
        return False
    for i in range(4):
        inverse[i, leaves] /= share
    for c in range(4):
        if c != leaves:
            part = ax * inverse[0, c] + ay * inverse[1, c] + az * inverse[2, c] + at * inverse[3, c]
            for i in range(4):
                inverse[i, c] -= part * inverse[i, leaves]
    basis[leaves] = enters
    return True


@kernel
def take_largest(spheres: Floats, level: Integers, cells: LevelGrid, slack: float, fate: Integers) -> None:
    """Take spheres in their order where they overlap none that is taken, and write the fate of each.

    One whose center lies in a taken sphere is left out, as both fill the same hole; another one climbs again. `slack`
    is what counts as rounding.
    """
    for k in range(len(spheres)):
        x, y, z, r = spheres[k, 0], spheres[k, 1], spheres[k, 2], spheres[k, 3]
        fate[k] = _fate(spheres, cells, x, y, z, r, slack)
        if fate[k] == TAKEN:
            link_at(cells, k, level[k], x, y, z)


@bare_kernel
def _fate(spheres, cells, x, y, z, r, slack):  # type: ignore[no-untyped-def]
    """Return what becomes of a sphere among those that are taken."""
    fate = TAKEN
    for level in range(len(cells.first)):
        wide = r + cells.reach[level, 0]
        low, high = cells_near(cells, level, x, y, z, (wide, wide, wide))
        for i in range(low[0], high[0]):
            for j in range(low[1], high[1]):
                for k in range(low[2], high[2]):
                    sphere, ti, tj, tk = first_in_cell(cells, level, i, j, k)
                    px, py, pz = sub((x, y, z), image_shift(cells, ti, tj, tk))
                    while sphere >= 0:
                        dx, dy, dz = px - spheres[sphere, 0], py - spheres[sphere, 1], pz - spheres[sphere, 2]
                        away, other = math.sqrt(dx * dx + dy * dy + dz * dz), spheres[sphere, 3]
                        if away <= other:
                            return DROPPED
                        if away < r + other - slack:
                            fate = AGAIN
                        sphere = cells.after[sphere]
    return fate


@kernel
def link_all(spheres: Floats, level: Integers, cells: LevelGrid) -> None:
    """Link all spheres into their cells."""
    for k in range(len(spheres)):
        link_at(cells, k, level[k], spheres[k, 0], spheres[k, 1], spheres[k, 2])
