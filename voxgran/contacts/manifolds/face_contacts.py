"""Further contact points of two solids whose flat faces or straight edges lie on each other.

The face of each solid that is most nearly perpendicular to the normal n of the contact is clipped, along n, to that of
the other one (Sutherland & Hodgman 1974, doi:10.1145/360767.360802). Each corner of the common polygon is a contact
point, whose gap is the distance along n from a point of one surface to the plane of the other face. The other solid
lies beyond this plane, so that no gap is too large.

Ends of cylinders and cones are polygons of points on the rim; their sides, and those of spherocylinders, are segments.
"""

import math

from voxgran._base.kernels import bare_kernel
from voxgran.contacts.manifolds.convex_bodies import ConvexWork
from voxgran.contacts.manifolds.rows import ContactRows, Grains, Pair, write_contact
from voxgran.geometry.vectors import Vector, along, dot, rotate, rotate_back, row_of, sub, times

#: cosine of the largest angle between a face and the plane of contact
FLAT = 0.5
#: change of that cosine that counts as much as the height of the second corner of a face, in inner radii
DEEP = 30.0
#: corners of the polygon that stands for a rim
RIM = 8
#: most contact points of a pair, beside that of the smallest gap
MOST_POINTS = 8
#: distance that contact points keep from each other, and within which they are the same as in the step before, in inner
#: radii of the thinner solid
SPACING, SAME = 0.1, 0.2
#: half the width of the strip, in radii, that stands for the side of a cylinder, cone or spherocylinder
STRIP = 0.02


@bare_kernel
def write_face_contacts(
    grains: Grains, work: ConvexWork, rows: ContactRows, m: int, pair: Pair, normal: Vector, thick: float,
) -> int:  # fmt: skip
    """Write rows m, ... for the faces of two solids along a normal; return the next row, -1 if there is no space.

    The row before is that of the smallest gap of the pair.
    """
    start, offset, (nx, ny, nz) = m - 1, pair.offset, normal
    mine, gx, gy, gz, level, strip = _write_face(grains, work, pair.i, nx, ny, nz, work.window)
    if mine == 0:
        return m
    theirs, hx, hy, hz, other_level, _ = _write_face(grains, work, pair.j, -nx, -ny, -nz, work.ring)
    if theirs == 0:
        return m
    for k in range(theirs):
        for c in range(3):
            work.ring[k, c] += offset[c]
    side = 1.0
    if mine == 2 and theirs > 2:
        # the segment is clipped to the face
        for k in range(max(mine, theirs)):
            for c in range(3):
                work.window[k, c], work.ring[k, c] = work.ring[k, c], work.window[k, c]
        mine, theirs, side = theirs, mine, -1.0
        gx, gy, gz = hx, hy, hz
        level = other_level + gx * offset[0] + gy * offset[1] + gz * offset[2]
    x, y, z = side * nx, side * ny, side * nz
    if mine == 2:
        left = _clip_to_strip(work.window, work.ring, work.other, theirs, x, y, z, strip)
    else:
        left = _clip_to_window(work.window, work.ring, work.other, mine, theirs, x, y, z)
    slope = gx * x + gy * y + gz * z
    ring, other = work.ring, work.other
    # the row of `other` holds the gap and the square of the distance from the nearest contact point
    for k in range(left):
        other[k, 0] = (gx * ring[k, 0] + gy * ring[k, 1] + gz * ring[k, 2] - level) / slope
        if side > 0.0:
            for c in range(3):
                ring[k, c] -= other[k, 0] * normal[c]
        other[k, 1] = 1e300 if other[k, 0] < pair.reach else -1.0
        _shorten(rows, start, m, ring[k], other[k])
    least = (SPACING * thick) ** 2
    for _ in range(MOST_POINTS):
        at = -1
        for k in range(left):
            if other[k, 1] > least and (at < 0 or other[k, 1] > other[at, 1]):
                at = k
        if at < 0:
            break
        # of corners so near to each other that one stands for all, that of the least gap
        far = at
        for k in range(left):
            off = sub(row_of(ring, k), row_of(ring, far))
            if other[k, 1] >= 0.0 and other[k, 0] < other[at, 0] and dot(off, off) <= least:
                at = k
        if m >= len(rows.row):
            return -1
        gap, arm = other[at, 0], row_of(ring, at)
        other_arm = sub(along(arm, gap, normal), offset)
        write_contact(rows, m, pair, normal, arm, other_arm, gap - pair.rest, SAME * thick)
        m += 1
        for k in range(left):
            _shorten(rows, m - 1, m, ring[k], other[k])
    return m


@bare_kernel
def _shorten(rows, start, stop, point, known):  # type: ignore[no-untyped-def]
    """Lower the square of the distance of a point from the contact points of some rows."""
    for q in range(start, stop):
        row = rows.row[q]
        square = (row[3] - point[0]) ** 2 + (row[4] - point[1]) ** 2 + (row[5] - point[2]) ** 2
        known[1] = min(known[1], square)


@bare_kernel
def _write_face(grains, work, i, nx, ny, nz, ring):  # type: ignore[no-untyped-def]
    """Write the corners of the face of a grain that is most nearly perpendicular to n, relative to its centroid.

    Return how many they are (0: no such face, 2: the side of a cylinder, cone or spherocylinder), the outward normal
    and the level of the face, and half the width of a side.
    """
    kind = work.bodies.kind[grains.shape[i]]
    if kind == 2 and work.radius[work.first[i]] > 0.0:
        return _write_side(work, work.first[i], (nx, ny, nz), ring)
    if kind == 2:
        return _write_flat_face(grains, work, i, (nx, ny, nz), ring)
    if kind == 3 or kind == 4:
        return _write_round_face(work.row[i], nx, ny, nz, ring)
    return 0, 0.0, 0.0, 0.0, 0.0, 0.0


@bare_kernel
def _write_flat_face(grains, work, i, normal, ring):  # type: ignore[no-untyped-def]
    """Write the face of a hull, one with the edge that is most nearly perpendicular to the normal."""
    bodies, s, turn = work.bodies, grains.shape[i], grains.matrix[i]
    x, y, z = rotate_back(turn, normal)
    most, at, deep = -math.inf, -1, DEEP / (bodies.thick[s] * grains.scale[i])
    for f in range(bodies.face_first[s], bodies.face_first[s + 1]):
        cosine = bodies.face[f, 0] * x + bodies.face[f, 1] * y + bodies.face[f, 2] * z
        if cosine > FLAT:
            high, second = -math.inf, -math.inf
            for k in range(bodies.ring_first[f], bodies.ring_first[f + 1]):
                height = dot(row_of(work.corner, work.first[i] + bodies.ring[k]), normal)
                high, second = max(high, height), max(second, min(high, height))
            score = cosine + deep * second
            if score > most:
                most, at = score, f
    if at < 0:
        return 0, 0.0, 0.0, 0.0, 0.0, 0.0
    x, y, z = rotate(turn, row_of(bodies.face, at))
    first = bodies.ring_first[at]
    many = bodies.ring_first[at + 1] - first
    for k in range(many):
        q = work.first[i] + bodies.ring[first + k]
        for c in range(3):
            ring[k, c] = work.corner[q, c]
    return many, x, y, z, bodies.face[at, 3] * grains.scale[i], 0.0


@bare_kernel
def _write_side(work, q, normal, ring):  # type: ignore[no-untyped-def]
    """Write the side of a spherocylinder whose axis ends at the corners q and q + 1."""
    start, radius = row_of(work.corner, q), work.radius[q]
    axis = sub(row_of(work.corner, q + 1), start)
    out = along(normal, -dot(axis, normal) / max(dot(axis, axis), 1e-300), axis)
    across = math.sqrt(dot(out, out))
    if across < FLAT:
        return 0, 0.0, 0.0, 0.0, 0.0, 0.0
    x, y, z = times(out, 1.0 / across)
    for k in range(2):
        for c in range(3):
            ring[k, c] = work.corner[q + k, c] + radius * out[c] / across
    return 2, x, y, z, dot(start, (x, y, z)) + radius, STRIP * radius


@bare_kernel
def _write_round_face(row, nx, ny, nz, ring):  # type: ignore[no-untyped-def]
    """Write the end or the side of a cylinder or cone."""
    kind, a, b = row[0], row[1], row[2]
    x, y, z = row[6], row[9], row[12]
    along = x * nx + y * ny + z * nz
    rx, ry, rz = nx - along * x, ny - along * y, nz - along * z
    across = math.sqrt(rx * rx + ry * ry + rz * rz)
    end = -1.0 if kind == 4.0 or along < 0.0 else 1.0
    height = 0.25 * b if kind == 4.0 else 0.5 * b
    # the normal of the side is this far outward and along the axis
    slant = math.sqrt(a * a + b * b)
    out, up = (b / slant, a / slant) if kind == 4.0 else (1.0, 0.0)
    if across == 0.0 or end * along >= out * across + up * along:
        if end * along < FLAT:
            return 0, 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(RIM):
            angle = 2.0 * math.pi * k / RIM
            p, q = a * math.cos(angle), a * end * math.sin(angle)
            for c in range(3):
                ring[k, c] = end * height * row[6 + 3 * c] + p * row[4 + 3 * c] + q * row[5 + 3 * c]
        return RIM, end * x, end * y, end * z, height, 0.0
    if out * across + up * along < FLAT:
        return 0, 0.0, 0.0, 0.0, 0.0, 0.0
    rx, ry, rz = rx / across, ry / across, rz / across
    top, radius = (0.75 * b, 0.0) if kind == 4.0 else (0.5 * b, a)
    ring[0, 0], ring[0, 1], ring[0, 2] = a * rx - height * x, a * ry - height * y, a * rz - height * z
    ring[1, 0], ring[1, 1], ring[1, 2] = radius * rx + top * x, radius * ry + top * y, radius * rz + top * z
    gx, gy, gz = out * rx + up * x, out * ry + up * y, out * rz + up * z
    return 2, gx, gy, gz, gx * ring[0, 0] + gy * ring[0, 1] + gz * ring[0, 2], STRIP * a


@bare_kernel
def _clip_to_window(window, ring, other, corners, left, x, y, z):  # type: ignore[no-untyped-def]
    """Clip a polygon to the prism over another one along n; return the number of corners."""
    u = corners - 1
    for v in range(corners):
        ex, ey, ez = window[v, 0] - window[u, 0], window[v, 1] - window[u, 1], window[v, 2] - window[u, 2]
        qx, qy, qz = ey * z - ez * y, ez * x - ex * z, ex * y - ey * x
        level = qx * window[v, 0] + qy * window[v, 1] + qz * window[v, 2]
        left = _clip(ring, other, left, qx, qy, qz, level)
        u = v
    return left


@bare_kernel
def _clip_to_strip(window, ring, other, left, x, y, z, half):  # type: ignore[no-untyped-def]
    """Clip a polygon to the strip over a segment; return the number of corners."""
    ex, ey, ez = window[1, 0] - window[0, 0], window[1, 1] - window[0, 1], window[1, 2] - window[0, 2]
    qx, qy, qz = ey * z - ez * y, ez * x - ex * z, ex * y - ey * x
    size = half * math.sqrt(qx * qx + qy * qy + qz * qz)
    low = ex * window[0, 0] + ey * window[0, 1] + ez * window[0, 2]
    high = ex * window[1, 0] + ey * window[1, 1] + ez * window[1, 2]
    middle = qx * window[0, 0] + qy * window[0, 1] + qz * window[0, 2]
    left = _clip(ring, other, left, ex, ey, ez, high)
    left = _clip(ring, other, left, -ex, -ey, -ez, -low)
    left = _clip(ring, other, left, qx, qy, qz, middle + size)
    return _clip(ring, other, left, -qx, -qy, -qz, size - middle)


@bare_kernel
def _clip(ring, other, left, qx, qy, qz, level):  # type: ignore[no-untyped-def]
    """Keep the part of a polygon where q.x is at most a level; return the number of corners."""
    if left == 0:
        return 0
    made, u = 0, left - 1
    before = qx * ring[u, 0] + qy * ring[u, 1] + qz * ring[u, 2] - level
    for v in range(left):
        now = qx * ring[v, 0] + qy * ring[v, 1] + qz * ring[v, 2] - level
        if (before <= 0.0) != (now <= 0.0) and made < len(other):
            share = before / (before - now)
            for c in range(3):
                other[made, c] = ring[u, c] + share * (ring[v, c] - ring[u, c])
            made += 1
        if now <= 0.0 and made < len(other):
            for c in range(3):
                other[made, c] = ring[v, c]
            made += 1
        before, u = now, v
    for k in range(made):
        for c in range(3):
            ring[k, c] = other[k, c]
    return made
