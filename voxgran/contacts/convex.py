"""Contacts of grains made of convex parts: unions of spheres, and the other primitives.

Two spheres with centers at the distance `d` have the gap ``d - r1 - r2``. If they overlap, the deepest point of one in
the other is ``r1 + r2 - d`` below its surface, but no deeper than the center of the larger sphere.

For separate grains the gap is the distance of the cores minus the margins. For overlapping grains the depth is the
largest r for which one solid eroded by r still intersects the other: the largest distance, to the surface of the first,
of a point of the second inside it. The distance s(r) between the eroded solid and the other is convex in r, so that
Newton's method started beyond the root converges monotonically; if the surface is smooth at the contact (a sphere, an
ellipsoid, a face), the first step is exact. The depth of a pair is the larger of its two depths.

Solids that are thinner than their length by more than 1e5 overlap by how far they would have to be moved apart, but for
half of their thickness at the most (:mod:`voxgran.geometry.thin`).

For unions of spheres the deepest pair of spheres gives the depth of the union, as long as it is below the radii.
The erosion of an ellipsoid is exact up to its smallest radius of curvature; deeper pairs are flagged.
"""

import math

import numpy as np

from voxgran._base.arrays import Booleans, Floats
from voxgran._base.compiling.threads import in_blocks
from voxgran._base.kernels import kernel
from voxgran.contacts.broad import Pairs
from voxgran.contacts.parts import Parts
from voxgran.contacts.separation import separation
from voxgran.geometry.support import erosion_limit, support
from voxgran.geometry.thin import thickness, thin_overlap

#: distance, in sizes of the parts, at which they count as touching
TOUCHING = 1e-14
#: pairs of which a thread takes no fewer
LEAST_PAIRS = 256


def sphere_contacts(pairs: Pairs, radii: Floats) -> tuple[Floats, Floats, Floats]:
    """Return gap, normal and point, from centroid i, of m pairs of spheres with (n,) radii about the centroids.

    A negative gap is a depth; the normals (m, 3) point from grain i to its partner, along x where the centers coincide.
    """
    gap = np.zeros(pairs.count)
    normal, point = np.zeros((pairs.count, 3)), np.zeros((pairs.count, 3))
    _touch_spheres(pairs.offset, radii[pairs.i], radii[pairs.j], gap, normal, point)
    return gap, normal, point


@kernel
def sphere_gap(distance: float, one: float, other: float) -> float:
    """Return the gap of two spheres from the distance of their centers; a negative gap is a depth."""
    return max(distance - one - other, -max(one, other))


@kernel
def _touch_spheres(offset, one, other, gap, normal, point):  # type: ignore[no-untyped-def]
    """Write gap, normal and point of each pair."""
    for k in range(len(offset)):
        x, y, z = offset[k, 0], offset[k, 1], offset[k, 2]
        distance = math.sqrt(x * x + y * y + z * z)
        gap[k] = sphere_gap(distance, one[k], other[k])
        if distance > 0.0:
            normal[k, 0], normal[k, 1], normal[k, 2] = x / distance, y / distance, z / distance
        else:
            normal[k, 0] = 1.0
        middle = 0.5 * (one[k] + distance - other[k])
        for i in range(3):
            point[k, i] = middle * normal[k, i]


def part_contacts(pairs: Pairs, parts: Parts, gap: float) -> tuple[Floats, Floats, Floats, Booleans]:
    """Return gap, normal, point and deep of m pairs of grains made of convex parts; gaps beyond `gap` are infinite.

    A negative gap is a depth. The normals (m, 3) point from grain i to its partner; the points (m, 3) are the middles
    between the nearest points, from centroid i; deep is the mask of the pairs whose depth is only a lower bound.
    """
    gaps = np.full(pairs.count, np.inf)
    normal, point = np.zeros((pairs.count, 3)), np.zeros((pairs.count, 3))
    deep = np.zeros(pairs.count, dtype=np.bool_)
    in_blocks(_touch_parts, pairs.count, pairs, parts, float(gap), gaps, normal, point, deep, least=LEAST_PAIRS)
    return gaps, normal, point, deep


@kernel
def _touch_parts(pairs, parts, gap, gaps, normal, point, deep, first, stop):  # type: ignore[no-untyped-def]
    """Write the nearest or deepest contact of each pair of grains of a block."""
    shift, contact = np.zeros(3), np.zeros(7)
    start, center, margin, reach = parts.start, parts.center, parts.margin, parts.reach
    for k in range(first, stop):
        best, i, j = gap, pairs.i[k], pairs.j[k]
        for a in range(start[i], start[i + 1]):
            for b in range(start[j], start[j + 1]):
                square = 0.0
                for c in range(3):
                    shift[c] = pairs.offset[k, c] + center[b, c] - center[a, c]
                    square += shift[c] * shift[c]
                if math.sqrt(square) - reach[a] - reach[b] > best:
                    continue
                buried = touch_pair(parts.row[a], margin[a], parts.row[b], margin[b], shift, contact)
                if contact[0] <= best:
                    best = gaps[k] = contact[0]
                    deep[k] = buried
                    for c in range(3):
                        normal[k, c] = contact[1 + c]
                        point[k, c] = center[a, c] + contact[4 + c]


@kernel
def touch_pair(one: Floats, margin: float, other: Floats, other_margin: float, offset: Floats, contact: Floats) -> bool:
    """Write gap, normal and middle point of two parts; return whether the overlap is too deep for an exact depth."""
    near = np.zeros(9)
    if one[0] == 0.0 and other[0] == 0.0:
        distance = math.sqrt(offset[0] ** 2 + offset[1] ** 2 + offset[2] ** 2)
        contact[0] = sphere_gap(distance, margin, other_margin)
        for c in range(3):
            near[c], near[3 + c] = 0.0, offset[c]
            near[6 + c] = offset[c] / distance if distance > 0.0 else 0.0
        _write_contact(near, margin, other_margin, contact)
        return False
    distance = separation(one, other, 0.0, offset, near)
    size = part_size(one) + margin + part_size(other) + other_margin
    contact[0] = distance - margin - other_margin
    _write_contact(near, margin, other_margin, contact)
    thin = min(thickness(one, margin), thickness(other, other_margin))
    if thin < np.inf and contact[0] <= thin:
        depth = thin_overlap(one, margin, other, other_margin, offset, contact)
        contact[0] = -depth if depth > 0.0 else max(contact[0], 0.0)
        return False
    if contact[0] > TOUCHING * size:
        return False
    return _bury(one, margin, other, other_margin, offset, size, contact)


@kernel
def part_size(row: Floats) -> float:
    """Return the largest dimension of a part."""
    size = max(row[1], row[2], row[3])
    if row[0] == 5.0:
        for c in range(4, 13):
            size = max(size, abs(row[c]))
    return size


@kernel
def _write_contact(near, margin, other_margin, contact):  # type: ignore[no-untyped-def]
    """Write the normal and the middle point from the nearest points of the cores."""
    for c in range(3):
        contact[1 + c] = near[6 + c]
    if near[6] == 0.0 and near[7] == 0.0 and near[8] == 0.0:
        contact[1] = 1.0
    for c in range(3):
        inner, outer = near[c] + margin * contact[1 + c], near[3 + c] - other_margin * contact[1 + c]
        contact[4 + c] = 0.5 * (inner + outer)


@kernel
def _bury(one, margin, other, other_margin, offset, size, contact):  # type: ignore[no-untyped-def]
    """Write the contact of two parts that touch or overlap."""
    way, back = np.zeros(7), np.zeros(7)
    reverse = -offset
    deep = penetration(one, margin, other, other_margin, offset, size, way)
    deeper = penetration(other, other_margin, one, margin, reverse, size, back)
    contact[0] = -max(way[0], back[0])
    if way[0] >= back[0] and (way[1] != 0.0 or way[2] != 0.0 or way[3] != 0.0):
        for c in range(1, len(way)):
            contact[c] = way[c]
        return deep or deeper
    if back[1] != 0.0 or back[2] != 0.0 or back[3] != 0.0:
        for c in range(3):
            contact[1 + c] = -back[1 + c]
            contact[4 + c] = back[4 + c] + offset[c]
        return deep or deeper
    # one part contains the core of the other: use the line of centers
    length = math.sqrt(offset[0] ** 2 + offset[1] ** 2 + offset[2] ** 2)
    for c in range(3):
        contact[1 + c] = offset[c] / length if length > 0.0 else 0.0
        contact[4 + c] = 0.5 * offset[c]
    if length == 0.0:
        contact[1] = 1.0
    return deep or deeper


@kernel
def penetration(
    one: Floats, margin: float, other: Floats, other_margin: float, offset: Floats, size: float, contact: Floats
) -> bool:
    """Write the depth of `other` in `one`, with outward normal and middle point.

    Return whether the depth exceeds the range in which the erosion of an ellipsoid or a spherocylinder is exact; it is
    then a lower bound.
    """
    near = np.zeros(9)
    limit = erosion_limit(one)
    if limit == 0.0:
        # a point or a segment
        distance = separation(one, other, 0.0, offset, near)
        contact[0] = max(min(margin + other_margin - distance, margin), 0.0)
        _write_contact(near, margin, other_margin, contact)
        return False
    erosion, contact[1:4] = limit, 0.0
    for _ in range(60):
        distance = separation(one, other, erosion, offset, near) - other_margin
        _write_witness(near, erosion, contact)
        if distance <= 1e-16 * size:
            break
        nearer = erosion - distance / _recession(one, limit, near)
        if not 0.0 <= nearer < erosion:
            erosion = 0.0 if nearer < 0.0 else erosion
            break
        erosion = nearer
    contact[0] = erosion
    return erosion >= limit and (one[0] == 6.0 or (one[0] == 1.0 and min(one[1], one[2], one[3]) > limit))


@kernel
def _recession(one, limit, near):  # type: ignore[no-untyped-def]
    """Return the rate at which the support plane along the nearest points recedes with the erosion, at least 1."""
    x, y, z = near[6], near[7], near[8]
    ax, ay, az = support(one, 0.0, x, y, z)
    bx, by, bz = support(one, limit, x, y, z)
    return max(((ax - bx) * x + (ay - by) * y + (az - bz) * z) / limit, 1.0)


@kernel
def _write_witness(near, erosion, contact):  # type: ignore[no-untyped-def]
    """Write the outward normal and the middle between the deepest point and the surface above it."""
    for c in range(3):
        contact[1 + c] = near[6 + c]
        contact[4 + c] = 0.5 * (near[c] + erosion * near[6 + c] + near[3 + c])
