"""Contact points of grains made of convex parts: unions of spheres, ellipsoids, boxes, cylinders, cones, convex meshes.

Each pair of spheres of two unions within the margin is a contact, in closed form. Of other parts the gap and normal are
those of :mod:`voxgran.contacts.manifolds.convex_distance`, which starts along the normal of the step before; faces that
lie on each other get further contact points (:mod:`voxgran.contacts.manifolds.face_contacts`).
"""

import math

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel, inlined_kernel, kernel
from voxgran.contacts.manifolds.blocks import Blocks, pairs_of_kind
from voxgran.contacts.manifolds.convex_bodies import ConvexBodies, ConvexWork, has_rows
from voxgran.contacts.manifolds.convex_distance import ellipsoid_gap, part_gap
from voxgran.contacts.manifolds.face_contacts import SAME, write_face_contacts
from voxgran.contacts.manifolds.rows import CONVEX, ContactRows, Grains, PairList, write_contact


def find_convex_contacts(
    grains: Grains,
    bodies: ConvexBodies,
    work: Blocks[ConvexWork],
    pairs: PairList,
    size: int,
    rows: ContactRows,
    m: int,
    margin: float,
    rest: float,
) -> int:
    """Write rows m, ... for the pairs of kind `CONVEX`; return the next row.

    Returns -1 if there is no space in `rows`; what was known of pairs is then to be restored.

    margin: gap, beyond the room of a pair, up to which contacts are written.  rest: length that is subtracted from each
    gap, beside the room.
    """
    # what is None is not compiled: it slows the search among corners
    curved = 1 if has_rows(bodies) else None
    _place(grains, bodies, work.arrays, curved)

    def find(own: ConvexWork, part: ContactRows, start: int, first: int, last: int) -> int:
        return int(_find(grains, bodies, own, pairs, part, start, margin, rest, curved, first, last))

    chosen = pairs_of_kind(grains, pairs, size, CONVEX)
    return work.find(find, pairs=pairs, chosen=chosen, rows=rows, m=m)


@kernel
def _place(grains, bodies, work, curved):  # type: ignore[no-untyped-def]
    """Write the corners and rows of all grains, rotated and scaled."""
    for i in range(len(grains.shape)):
        s, turn = grains.shape[i], grains.matrix[i]
        _place_corners(
            bodies.corner, bodies.radius, bodies.first[s], bodies.first[s + 1], turn, grains.scale[i],
            work.corner, work.radius, work.first[i],
        )  # fmt: skip
        kind = bodies.kind[s]
        if curved is not None and kind != 0 and kind != 2 and kind >= 0:
            place_row(bodies.row[s], turn, grains.scale[i], work.row[i])
            if kind == 1:
                _write_form(work.row[i], work.form[i])


@bare_kernel
def _place_corners(corner, radius, first, last, turn, f, placed, scaled, start):  # type: ignore[no-untyped-def]
    """Write corners first ... last - 1 of a shape, rotated and scaled, from row `start`, and their radii."""
    xx, xy, xz = f * turn[0, 0], f * turn[0, 1], f * turn[0, 2]
    yx, yy, yz = f * turn[1, 0], f * turn[1, 1], f * turn[1, 2]
    zx, zy, zz = f * turn[2, 0], f * turn[2, 1], f * turn[2, 2]
    to = start - first
    for q in range(first, last):
        x, y, z = corner[q, 0], corner[q, 1], corner[q, 2]
        placed[to + q, 0] = xx * x + xy * y + xz * z
        placed[to + q, 1] = yx * x + yy * y + yz * z
        placed[to + q, 2] = zx * x + zy * y + zz * z
        scaled[to + q] = f * radius[q]


@bare_kernel
def place_row(row: Floats, turn: Floats, f: float, placed: Floats) -> None:
    """Write the row of an ellipsoid, cylinder or cone, rotated and scaled."""
    placed[0] = row[0]
    for c in range(3):
        placed[1 + c] = f * row[1 + c]
        for d in range(3):
            placed[4 + 3 * c + d] = turn[c, 0] * row[4 + d] + turn[c, 1] * row[7 + d] + turn[c, 2] * row[10 + d]


@bare_kernel
def _write_form(placed, form):  # type: ignore[no-untyped-def]
    """Write the matrix of the quadratic form of an ellipsoid."""
    for c in range(3):
        d, other = (c + 1) % 3, (c + 2) % 3
        form[c], mixed = 0.0, 0.0
        for k in range(3):
            square = placed[1 + k] * placed[1 + k]
            form[c] += square * (placed[4 + 3 * c + k] * placed[4 + 3 * c + k])
            mixed += square * placed[4 + 3 * c + k] * placed[4 + 3 * d + k]
        # xy, yz and zx are numbers 3, 5 and 4
        form[3 if other == 2 else (5 if other == 0 else 4)] = mixed


@kernel
def _find(grains, bodies, work, pairs, rows, m, margin, rest, curved, begin, end):  # type: ignore[no-untyped-def]
    """Write the contacts of the pairs from `begin` to `end` - 1; return the next row, or -1.

    curved: None where there are no ellipsoids, cylinders and cones.
    """
    offset = work.offset
    for p in range(begin, end):
        i, j = pairs.i[p], pairs.j[p]
        if max(grains.kind[i], grains.kind[j]) != CONVEX:
            continue
        old, count = pairs.first[p], pairs.count[p]
        pairs.first[p], pairs.count[p] = m, 0
        reach, moved = margin + pairs.room[p], grains.way[i] + grains.way[j]
        if pairs.bound[p] - (moved - pairs.way[p]) > reach:
            continue
        for c in range(3):
            offset[c] = grains.position[j, c] + pairs.shift[p, c] - grains.position[i, c]
        distance = math.sqrt(offset[0] ** 2 + offset[1] ** 2 + offset[2] ** 2)
        apart = distance - grains.radius[i] - grains.radius[j]
        pairs.way[p] = moved
        if apart > reach:
            pairs.bound[p] = apart
            continue
        # gaps are known up to here, so that a pair that is farther apart is not looked at in each step
        look = reach + margin
        kind_i, kind_j = bodies.kind[grains.shape[i]], bodies.kind[grains.shape[j]]
        old_rows, normal, gap = (old, count, rest + pairs.room[p]), pairs.normal[p], look
        if kind_i > 0 and kind_j > 0:
            one, two = _solid(grains, bodies, work, i), _solid(grains, bodies, work, j)
            start = _first_direction(normal, offset[0], offset[1], offset[2], distance, True)
            m, gap = _touch_two(
                grains, bodies, work, rows, m, one, two, offset, start, reach, look, old_rows, normal,
                curved,
            )  # fmt: skip
        elif kind_i == 0 and kind_j == 0:
            m, gap = _touch_spheres(grains, work, rows, m, i, j, offset, reach, look, old_rows, normal)
        elif kind_i >= 0 and kind_j >= 0:
            m, gap = _touch_union(grains, bodies, work, rows, m, i, j, offset, reach, look, old_rows, normal, curved)
        if m < 0:
            return -1
        pairs.bound[p] = gap
        pairs.count[p] = m - pairs.first[p]
    return m


@bare_kernel
def _select_near(work, i, x, y, z, radius, look, selected):  # type: ignore[no-untyped-def]
    """Write which spheres of a union are near a sphere, relative to the centroid; return how many."""
    many = 0
    for q in range(work.first[i], work.first[i + 1]):
        dx, dy, dz = work.corner[q, 0] - x, work.corner[q, 1] - y, work.corner[q, 2] - z
        far = work.radius[q] + radius + look
        if dx * dx + dy * dy + dz * dz <= far * far:
            selected[many] = q
            many += 1
    return many


@bare_kernel
def _touch_spheres(grains, work, rows, m, i, j, offset, reach, look, old_rows, normal):  # type: ignore[no-untyped-def]
    """Write the contacts of two unions of spheres; return the next row and the gap, and write the normal."""
    old, count, rest = old_rows
    x, y, z = offset[0], offset[1], offset[2]
    mine = _select_near(work, i, x, y, z, grains.radius[j], look, work.one)
    theirs = _select_near(work, j, -x, -y, -z, grains.radius[i], look, work.two) if mine > 0 else 0
    best = look
    corner, radius = work.corner, work.radius
    for s in range(mine):
        a = work.one[s]
        for t in range(theirs):
            b = work.two[t]
            dx, dy, dz = (
                x + corner[b, 0] - corner[a, 0],
                y + corner[b, 1] - corner[a, 1],
                z + corner[b, 2] - corner[a, 2],
            )
            far = radius[a] + radius[b] + look
            square = dx * dx + dy * dy + dz * dz
            if square > far * far:
                continue
            distance = math.sqrt(square)
            gap = distance - radius[a] - radius[b]
            if distance > 0.0:
                nx, ny, nz = dx / distance, dy / distance, dz / distance
            else:
                nx, ny, nz = 0.0, 0.0, 1.0
            if gap < best:
                best = gap
                normal[0], normal[1], normal[2] = nx, ny, nz
            if gap >= reach:
                continue
            if m >= len(rows.row):
                return -1, best
            ax, ay, az = corner[a, 0] + radius[a] * nx, corner[a, 1] + radius[a] * ny, corner[a, 2] + radius[a] * nz
            bx, by, bz = ax + gap * nx - x, ay + gap * ny - y, az + gap * nz - z
            same = 0.5 * min(radius[a], radius[b])
            write_contact(rows, m, i, j, nx, ny, nz, ax, ay, az, bx, by, bz, gap - rest, old, count, same)
            m += 1
    return m, best


@bare_kernel
def _touch_union(grains, bodies, work, rows, m, i, j, offset, reach, look, old_rows, normal, curved):  # type: ignore[no-untyped-def]
    """Write the contacts of a union of spheres and a solid; return the next row and the gap."""
    kind_i = bodies.kind[grains.shape[i]]
    x, y, z = offset[0], offset[1], offset[2]
    best = look
    if kind_i == 0:
        many = _select_near(work, i, x, y, z, grains.radius[j], look, work.one)
    else:
        many = _select_near(work, j, -x, -y, -z, grains.radius[i], look, work.one)
    # the normals of several spheres differ from each other
    u = i if kind_i == 0 else j
    single = work.first[u + 1] - work.first[u] == 1
    for k in range(many):
        q = work.one[k]
        sphere = (0, u, q, q + 1, 0, work.radius[q])
        sign = -1.0 if kind_i == 0 else 1.0
        dx, dy, dz = x + sign * work.corner[q, 0], y + sign * work.corner[q, 1], z + sign * work.corner[q, 2]
        start = _first_direction(normal, dx, dy, dz, math.sqrt(dx * dx + dy * dy + dz * dz), single)
        if kind_i == 0:
            one, two = sphere, _solid(grains, bodies, work, j)
        else:
            one, two = _solid(grains, bodies, work, i), sphere
        before = normal[0], normal[1], normal[2]
        m, gap = _touch_two(
            grains, bodies, work, rows, m, one, two, offset, start, reach, look, old_rows, normal, curved
        )
        if m < 0:
            return -1, best
        if gap < best:
            best = gap
        else:
            normal[0], normal[1], normal[2] = before
    return m, best


@inlined_kernel
def _solid(grains, bodies, work, i):  # type: ignore[no-untyped-def]
    """Return a grain as a part of `convex_distance`."""
    s = grains.shape[i]
    return bodies.kind[s], i, work.first[i], work.first[i + 1], bodies.first[s], 0.0


@inlined_kernel
def _first_direction(normal, x, y, z, distance, remembered):  # type: ignore[no-untyped-def]
    """Return the normal of the step before, or that from center to center."""
    if remembered and normal[0] <= 1.5:
        return normal[0], normal[1], normal[2]
    if distance > 0.0:
        return x / distance, y / distance, z / distance
    return 0.0, 0.0, 1.0


@bare_kernel
def _touch_two(  # type: ignore[no-untyped-def]
    grains, bodies, work, rows, m, one, two, offset, start, reach, look, old_rows, normal, curved,
):  # fmt: skip
    """Write the contacts of two parts, and their normal; return the next row and the gap."""
    old, count, rest = old_rows
    kind_i, i, lo_i, _, _, radius_i = one
    kind_j, j, lo_j, _, _, radius_j = two
    near, place = work.simplex.near, (offset[0], offset[1], offset[2])
    thick = min(
        radius_i if kind_i == 0 else bodies.thick[grains.shape[i]] * grains.scale[i],
        radius_j if kind_j == 0 else bodies.thick[grains.shape[j]] * grains.scale[j],
    )
    smooth = False
    if curved is not None:
        smooth = kind_i <= 1 and kind_j <= 1
        if smooth:
            ax, ay, az = 0.0, 0.0, 0.0
            x, y, z = place
            if kind_i == 0:
                ax, ay, az = work.corner[lo_i, 0], work.corner[lo_i, 1], work.corner[lo_i, 2]
                x, y, z = x - ax, y - ay, z - az
            if kind_j == 0:
                x, y, z = x + work.corner[lo_j, 0], y + work.corner[lo_j, 1], z + work.corner[lo_j, 2]
            gap, nx, ny, nz = ellipsoid_gap(
                work.form[i], radius_i, work.form[j], radius_j, (x, y, z), start, look, near
            )
            near[3], near[4], near[5] = ax + near[3], ay + near[4], az + near[5]
    if not smooth:
        gap, nx, ny, nz = part_gap(bodies, work, one, two, place, start, thick, look, curved)
    ax, ay, az = near[3], near[4], near[5]
    normal[0], normal[1], normal[2] = nx, ny, nz
    if gap >= reach:
        return m, gap
    if m >= len(rows.row):
        return -1, gap
    ax, ay, az = ax + radius_i * nx, ay + radius_i * ny, az + radius_i * nz
    bx, by, bz = ax + gap * nx - offset[0], ay + gap * ny - offset[1], az + gap * nz - offset[2]
    write_contact(rows, m, i, j, nx, ny, nz, ax, ay, az, bx, by, bz, gap - rest, old, count, SAME * thick)
    m += 1
    if kind_i >= 2 and kind_j >= 2:
        m = write_face_contacts(
            grains, bodies, work, rows, m, i, j, offset, (nx, ny, nz), reach, rest, thick, m - 1, old, count,
            curved,
        )  # fmt: skip
    return m, gap
