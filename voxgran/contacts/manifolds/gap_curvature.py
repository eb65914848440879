"""Second derivatives of the gaps at contacts, by small motions of both bodies.

The gap of two convex parts is the largest f(n), over all directions n, of the distance of their support planes. Where
bodies move by translations u and rotations w, f changes to second order by the curvature of the support functions h:
their second derivatives K across n are the radii of curvature of the surfaces at the point of contact, which are 0 at a
corner and large along an edge or across a face that touches. With p, q the arms, v the relative motion of the material
points of contact across n, and s the motion of the support points, ``s = v + (K_i w_i + K_j w_j) x n``:

    gap'' = - h_i''(w_i) - h_j''(w_j) + s (K_i + K_j)^-1 s,
    h''(w) = (w x n) K (w x n) + (p w)(n w) - (p n) w^2.
"""

import math

import numpy as np

from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.kernels import bare_kernel, kernel
from voxgran.contacts.manifolds.convex_bodies import HULL, ConvexWork
from voxgran.contacts.manifolds.convex_contacts import place_grains
from voxgran.contacts.manifolds.convex_distance import core_support, tables_of
from voxgran.contacts.manifolds.rows import ARM_I, ARM_J, GAP, NORMAL, ContactRows, Grains
from voxgran.geometry.vectors import along, cross, dot, row_of, sub, times

#: difference of heights, along the normal, of corners that touch a plane
LEVEL = 1e-6
#: part of a radian by which directions differ in a difference
TURN = 1e-3
#: least radius of curvature of a flat face
FLAT = 100.0
#: least sum of the radii of curvature of both surfaces
SHARP = 1e-6


def gap_curvature(grains: Grains, work: ConvexWork, rows: ContactRows, some: Integers) -> Floats:
    """Return the second derivatives of the gaps of some contacts, (k, 12, 12).

    The twelve motions are the translations and rotations of body i and those of body j. Walls are flat and do not move.
    """
    i, j, n = rows.i[some], rows.j[some], len(grains.shape)
    inner = (j >= 0) & (j < n)
    j = np.where(inner, j, i)
    place_grains(grains, work)
    k = np.zeros((len(some), 2, 3, 3))
    _write_radii(work, grains.shape, rows.row[some], i, np.where(inner, j, -1), k)
    later = (some > 0) & (rows.i[some - 1] == i) & (rows.j[some - 1] == rows.j[some])
    left_out = _sort_out(work.bodies.kind[grains.shape[np.stack([i, j], axis=1)]], inner, later, k)
    row = rows.row[some]
    normal, unit = row[:, NORMAL : NORMAL + 3], np.eye(3)
    turned = _crossed(normal)
    bend = np.zeros((len(some), 12, 12))
    slide = np.zeros((len(some), 3, 12))
    for side, (arm, sign) in enumerate(((ARM_I, -1.0), (ARM_J, 1.0))):
        point, at = row[:, arm : arm + 3], 6 * side
        both = point[:, :, None] * normal[:, None, :]
        height = (point * normal).sum(axis=1)
        surface = turned.transpose(0, 2, 1) @ k[:, side] @ turned
        other = 0.5 * (both + both.transpose(0, 2, 1)) - height[:, None, None] * unit
        bend[:, at + 3 : at + 6, at + 3 : at + 6] = -surface + sign * other
        slide[:, :, at : at + 3] = sign * unit
        slide[:, :, at + 3 : at + 6] = -sign * _crossed(point) - k[:, side] @ turned
    slide -= normal[:, :, None] * (normal[:, None, :] @ slide)
    radii = k.sum(axis=1) + normal[:, :, None] * normal[:, None, :]
    radii += np.maximum(row[:, GAP], SHARP)[:, None, None] * unit
    bend += slide.transpose(0, 2, 1) @ np.linalg.solve(radii, slide) * inner[:, None, None]
    bend[~inner, 6:] = bend[~inner, :, 6:] = 0.0
    bend[left_out] = 0.0
    return bend


def _crossed(vectors: Floats) -> Floats:
    """Return the matrices (k, 3, 3) of cross products with vectors (k, 3) from the left."""
    made = np.zeros((len(vectors), 3, 3))
    for a, b, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        made[:, b, a], made[:, a, b] = vectors[:, c], -vectors[:, c]
    return made


def _sort_out(kind: Integers, inner: Booleans, later: Booleans, k: Floats) -> Booleans:
    """Take away the curvature of corners that touch a flat face, where each has a contact of its own.

    Return which contacts are left out: further ones of a pair along an edge, whose normal is not theirs.
    """
    trace = np.trace(k, axis1=2, axis2=3)
    least = 0.5 * (trace**2 - (k * k.transpose(0, 1, 3, 2)).sum(axis=(2, 3))) / np.maximum(trace, 1e-300)
    flat = least > FLAT
    first = (kind[:, 0] == HULL) & (flat[:, 1] | ~inner)
    k[first, 0] = 0.0
    second = (kind[:, 1] == HULL) & flat[:, 0] & ~first
    k[second, 1] = 0.0
    return np.asarray(later & inner & (trace.max(axis=1) > FLAT) & ~first & ~second)


@kernel
def _write_radii(work, shape, row, i, j, k):  # type: ignore[no-untyped-def]
    """Write the second derivatives (m, 2, 3, 3) of the support functions of both bodies along the normals."""
    _write_all(work, shape, row, i, j, k)


@bare_kernel
def _write_all(work, shape, row, i, j, k):  # type: ignore[no-untyped-def]
    """Write them."""
    for c in range(len(i)):
        for side in range(2):
            g = i[c] if side == 0 else j[c]
            if g < 0:
                continue
            s, sign = shape[g], 1.0 - 2.0 * side
            n = (sign * row[c, 0], sign * row[c, 1], sign * row[c, 2])
            arm = (row[c, 3 + 3 * side], row[c, 4 + 3 * side], row[c, 5 + 3 * side])
            kind, lo, hi = work.bodies.kind[s], work.first[g], work.first[g + 1]
            if kind == 0:
                _add_across(k[c, side], n, _radius_at(work, lo, hi, arm, n))
            elif kind == 2:
                _write_corners(work, lo, hi, n, k[c, side])
            elif kind > 0:
                _write_smooth(work, (kind, g, lo, hi, work.bodies.first[s], 0.0), n, k[c, side])


@bare_kernel
def _add_across(matrix, n, radius):  # type: ignore[no-untyped-def]
    """Add a radius across a normal to a matrix."""
    for a in range(3):
        for b in range(3):
            matrix[a, b] += radius * ((1.0 if a == b else 0.0) - n[a] * n[b])


@bare_kernel
def _radius_at(work, lo, hi, arm, n):  # type: ignore[no-untyped-def]
    """Return the radius of the sphere, of a union, on which a point with a normal lies."""
    best, radius = math.inf, 0.0
    for q in range(lo, hi):
        off = along(sub(arm, row_of(work.corner, q)), -work.radius[q], n)
        if dot(off, off) < best:
            best, radius = dot(off, off), work.radius[q]
    return radius


@bare_kernel
def _write_corners(work, lo, hi, n, matrix):  # type: ignore[no-untyped-def]
    """Write the scatter of the corners of a hull that are farthest along a normal, over the accepted difference."""
    most = -math.inf
    for q in range(lo, hi):
        most = max(most, dot(row_of(work.corner, q), n))
    total, mean = 0.0, (0.0, 0.0, 0.0)
    for q in range(lo, hi):
        weight = math.exp((dot(row_of(work.corner, q), n) - most) / LEVEL)
        total, mean = total + weight, along(mean, weight, row_of(work.corner, q))
    mean = times(mean, 1.0 / total)
    for q in range(lo, hi):
        weight = math.exp((dot(row_of(work.corner, q), n) - most) / LEVEL) / (total * LEVEL)
        off = sub(row_of(work.corner, q), mean)
        for a in range(3):
            for b in range(3):
                matrix[a, b] += weight * off[a] * off[b]


@bare_kernel
def _write_smooth(work, part, n, matrix):  # type: ignore[no-untyped-def]
    """Write the differences of the support points of an ellipsoid, cylinder or cone."""
    solid = tables_of(work.bodies, work), part
    t = (0.0, -n[2], n[1]) if abs(n[0]) < 0.6 else (n[2], 0.0, -n[0])
    t = times(t, 1.0 / math.sqrt(dot(t, t)))
    u = cross(n, t)
    one, other = _turned(solid, n, t), _turned(solid, n, u)
    if part[0] != 1:
        # a side is straight along one direction, which is that of the larger difference
        way = one if dot(one, one) > dot(other, other) else other
        way = along(way, -dot(way, n), n)
        if dot(way, way) > 0.0:
            t = times(way, 1.0 / math.sqrt(dot(way, way)))
            u = cross(n, t)
            one, other = _turned(solid, n, t), _turned(solid, n, u)
    mixed = 0.5 * (dot(one, u) + dot(other, t)) if part[0] == 1 else 0.0
    for a in range(3):
        for b in range(3):
            matrix[a, b] = dot(one, t) * t[a] * t[b] + dot(other, u) * u[a] * u[b] + mixed * (t[a] * u[b] + u[a] * t[b])


@bare_kernel
def _turned(solid, n, t):  # type: ignore[no-untyped-def]
    """Return how a support point moves when the normal turns towards t."""
    m, o = along(n, TURN, t), along(n, -TURN, t)
    px, py, pz, _ = core_support(solid, 0, m[0], m[1], m[2])
    qx, qy, qz, _ = core_support(solid, 0, o[0], o[1], o[2])
    return (px - qx) / (2.0 * TURN), (py - qy) / (2.0 * TURN), (pz - qz) / (2.0 * TURN)
