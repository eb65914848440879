"""Contact points of surfaces that cross a little: corners behind faces and edges behind edges.

Where the distance of two surfaces has a minimum between a corner and a face, or between two edges, the height of the
corner over the face and that of one edge over the other, with sign, go on through zero when the surfaces cross. A
corner may lie behind several faces, of which the one that it leaves first counts. Where none of these is found, as
where sharp ridges cross deeply, the curve in which the surfaces cross leads out of the overlap.
"""

import math

from voxgran._base.kernels import bare_kernel
from voxgran.contacts.manifolds.rows import Grains
from voxgran.contacts.manifolds.surface_memory import SurfaceWork, copy_numbers
from voxgran.contacts.manifolds.triangle_features import is_minimum, place_triangle
from voxgran.geometry.triangles import pierces
from voxgran.geometry.vectors import along, corner_of, cross, dot, rotate, sub, times, vector_at

#: depth up to which they are sought, in radii of the smaller grain
DEEPEST = 0.02
#: share of the edges of a triangle by which a corner may lie beside it
BESIDE = 1e-9
#: least area of a curve in which surfaces cross that has a direction, in that of the circle of its length
ROUND = 0.02


@bare_kernel
def _over_face(one, a, normal, x, y, z):  # type: ignore[no-untyped-def]
    """Return the height of a point over triangle one[a], 1e9 if it does not lie over it."""
    for c in range(3):
        d = (c + 1) % 3
        ux, uy, uz = one[a, d, 0] - one[a, c, 0], one[a, d, 1] - one[a, c, 1], one[a, d, 2] - one[a, c, 2]
        wx, wy, wz = x - one[a, c, 0], y - one[a, c, 1], z - one[a, c, 2]
        side = normal[0] * (uy * wz - uz * wy) + normal[1] * (uz * wx - ux * wz) + normal[2] * (ux * wy - uy * wx)
        if side < -BESIDE * (ux * ux + uy * uy + uz * uz):
            return 1e9
    return normal[0] * (x - one[a, 0, 0]) + normal[1] * (y - one[a, 0, 1]) + normal[2] * (z - one[a, 0, 2])


@bare_kernel
def _between_edges(one, a, c, other, b, d, pseudo, points):  # type: ignore[no-untyped-def]
    """Return the height of edge d of other[b] over edge c of one[a], 1e9 if their nearest points are no inner ones.

    pseudo: the direction outwards at the edge of one.  points: place on one[a] (3) and direction (3), written.
    """
    c2, d2 = (c + 1) % 3, (d + 1) % 3
    px, py, pz = one[a, c, 0], one[a, c, 1], one[a, c, 2]
    ux, uy, uz = one[a, c2, 0] - px, one[a, c2, 1] - py, one[a, c2, 2] - pz
    rx, ry, rz = other[b, d, 0] - px, other[b, d, 1] - py, other[b, d, 2] - pz
    vx, vy, vz = (other[b, d2, 0] - other[b, d, 0], other[b, d2, 1] - other[b, d, 1], other[b, d2, 2] - other[b, d, 2])
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    square = nx * nx + ny * ny + nz * nz
    if square <= 1e-8 * (ux * ux + uy * uy + uz * uz) * (vx * vx + vy * vy + vz * vz):
        return 1e9
    s = (ry * vz - rz * vy) * nx + (rz * vx - rx * vz) * ny + (rx * vy - ry * vx) * nz
    t = (ry * uz - rz * uy) * nx + (rz * ux - rx * uz) * ny + (rx * uy - ry * ux) * nz
    if s < 0.0 or s > square or t < 0.0 or t > square:
        return 1e9
    length = math.sqrt(square)
    if nx * pseudo[0] + ny * pseudo[1] + nz * pseudo[2] < 0.0:
        length = -length
    nx, ny, nz, s = nx / length, ny / length, nz / length, s / square
    points[0], points[1], points[2] = px + s * ux, py + s * uy, pz + s * uz
    points[3], points[4], points[5] = nx, ny, nz
    return rx * nx + ry * ny + rz * nz


@bare_kernel
def _write(row, points, gap, from_corner):  # type: ignore[no-untyped-def]
    """Write a candidate in the frame of i: place and direction, gap, and 1 for the corner of j, -1 of i, 0 of none."""
    for c in range(6):
        row[c] = points[c]
    row[6], row[7] = gap, from_corner


@bare_kernel
def _pair_depths(bodies, s, t, pose, placed, points, candidate, k, deepest, margin):  # type: ignore[no-untyped-def]
    """Write the candidates of triangle s of i and the placed t of j; return the number; lengths in the unit of i."""
    corner, normal = bodies.corner, bodies.pseudo[s, 0]
    for c in range(3):
        x, y, z = placed[0, c, 0], placed[0, c, 1], placed[0, c, 2]
        height = _over_face(corner, s, normal, x, y, z)
        if -deepest < height < margin and k < len(candidate):
            nx, ny, nz = normal[0], normal[1], normal[2]
            if is_minimum(bodies, s, 0, t, 4 + c, pose, (nx, ny, nz), 1.0, 1.0):
                points[0], points[1], points[2] = x - height * nx, y - height * ny, z - height * nz
                points[3], points[4], points[5] = nx, ny, nz
                _write(candidate[k], points, height, 1.0)
                k += 1
    turned = points[9:12]
    for r in range(3):
        turned[r] = 0.0
        for c in range(3):
            turned[r] += pose[3 + 3 * r + c] * bodies.pseudo[t, 0, c]
    for c in range(3):
        x, y, z = corner[s, c, 0], corner[s, c, 1], corner[s, c, 2]
        height = _over_face(placed, 0, turned, x, y, z)
        if -deepest < height < margin and k < len(candidate):
            nx, ny, nz = -turned[0], -turned[1], -turned[2]
            if is_minimum(bodies, s, 4 + c, t, 0, pose, (nx, ny, nz), 1.0, 1.0):
                points[0], points[1], points[2] = x, y, z
                points[3], points[4], points[5] = nx, ny, nz
                _write(candidate[k], points, height, -1.0)
                k += 1
    for c in range(3):
        for d in range(3):
            height = _between_edges(corner, s, c, placed, 0, d, bodies.pseudo[s, 1 + c], points)
            if (
                -deepest < height < margin
                and k < len(candidate)
                and is_minimum(bodies, s, 1 + c, t, 1 + d, pose, vector_at(points, 3), 1.0, 1.0)
            ):
                _write(candidate[k], points, height, 0.0)
                k += 1
    return k


@bare_kernel
def _deeper_behind(candidate, k, q):  # type: ignore[no-untyped-def]
    """Return whether the corner of a candidate leaves another face sooner."""
    row, way = candidate[q], candidate[q, 7]
    if way == 0.0:
        return False
    for n in range(k):
        other = candidate[n]
        if other[7] == way and other[6] > row[6]:
            far = 0.0
            for c in range(3):
                here, there = row[c], other[c]
                if way > 0.0:
                    here, there = here + row[6] * row[3 + c], there + other[6] * other[3 + c]
                far += (here - there) ** 2
            if far < 1e-16 and row[6] < 0.0:
                return True
    return False


@bare_kernel
def crossing_depths(grains: Grains, work: SurfaceWork, count: int, i: int, j: int, margin: float) -> tuple[int, float]:
    """Write the candidates of listed triangles of two meshes that cross; return number and least gap.

    The number is 0 where none lies behind another.
    """
    bodies, pose, candidate, turn = work.bodies, work.now, work.candidate, grains.matrix[i]
    unit = pose[12]
    deepest = DEEPEST * min(grains.radius[i], grains.radius[j]) / unit
    if bodies.frame[grains.shape[i], 7] == 0.0 or bodies.frame[grains.shape[j], 7] == 0.0:
        return 0, 1e9
    many = 0
    for q in range(count):
        s, t = work.found[q, 0], work.found[q, 1]
        place_triangle(bodies.corner, t, pose, pose[13] / unit, work.placed[0], 0)
        many = _pair_depths(bodies, s, t, pose, work.placed[0], work.points, candidate, many, deepest, margin / unit)
        if many > 1024:
            break
    kept, low = 0, 1e9
    for q in range(many):
        if _deeper_behind(candidate, many, q):
            candidate[q, 6] = -1e9
    for q in range(many):
        row, to = candidate[q], candidate[kept]
        if row[6] == -1e9:
            continue
        place, normal, gap = vector_at(row, 0), vector_at(row, 3), row[6] * unit
        to[0], to[1], to[2] = times(rotate(turn, place), unit)
        to[3], to[4], to[5] = rotate(turn, normal)
        to[6] = gap
        low = min(low, gap)
        kept += 1
    return (kept, low) if low < 0.0 else (0, 1e9)


@bare_kernel
def _segment(bodies, s, t, pose, placed, points):  # type: ignore[no-untyped-def]
    """Write to points[6:12] the ends of the segment in which triangle s of i and the placed t of j cross.

    It runs so that the part of i within j is on its left, seen from outside of i. Returns whether there is one.
    """
    ends = 0
    for c in range(3):
        for way in range(2):
            one, a, other, b = (bodies.corner, s, placed, 0) if way == 0 else (placed, 0, bodies.corner, s)
            if ends < 2 and pierces(one, a, c, other, b, points):
                copy_numbers(points[6 + 3 * ends :], points, 3)
                ends += 1
    if ends < 2:
        return False
    run = cross(corner_of(bodies.pseudo, s, 0), rotate(pose[3:12].reshape((3, 3)), corner_of(bodies.pseudo, t, 0)))
    if dot(run, sub(vector_at(points, 9), vector_at(points, 6))) < 0.0:
        for c in range(6, 9):
            points[c], points[c + 3] = points[c + 3], points[c]
    return True


@bare_kernel
def crossing_curve(grains: Grains, work: SurfaceWork, count: int, i: int, j: int) -> tuple[int, float]:
    """Write a candidate that leads out of the overlap of two meshes whose triangles cross; return 1 and its gap.

    Half the sum of the cross products along the curve in which they cross is the direction in which the volume of the
    overlap shrinks fastest as j moves. The depth is that of two ridges at right angles that cross in such an area, but
    no more than is sought elsewhere. Returns 0 where there is no curve, or its parts point to both sides.
    """
    bodies, pose, points, unit = work.bodies, work.now, work.points, work.now[12]
    area, centre, first, length = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0
    for q in range(count):
        s, t = work.found[q, 0], work.found[q, 1]
        place_triangle(bodies.corner, t, pose, pose[13] / unit, work.placed[0], 0)
        if not _segment(bodies, s, t, pose, work.placed[0], points):
            continue
        begin, end = vector_at(points, 6), vector_at(points, 9)
        if length == 0.0:
            first = begin
        way = sub(end, begin)
        part = math.sqrt(dot(way, way))
        area = along(area, 0.5, cross(sub(begin, first), way))
        centre, length = along(centre, part, along(begin, 0.5, way)), length + part
    size = math.sqrt(dot(area, area))
    if size <= ROUND * length * length / (4.0 * math.pi):
        return 0, 1e9
    turn, row, deepest = grains.matrix[i], work.candidate[0], DEEPEST * min(grains.radius[i], grains.radius[j])
    row[0], row[1], row[2] = times(rotate(turn, times(centre, 1.0 / length)), unit)
    row[3], row[4], row[5] = rotate(turn, times(area, 1.0 / size))
    row[6] = -min(math.sqrt(size) * unit, deepest)
    return 1, row[6]
