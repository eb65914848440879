"""Exact volumes of solids, and exact areas of plane figures, inside boxes along the axes.

Spheres and disks are cut in closed form (:mod:`voxgran.geometry.halfspaces`). For a closed mesh the volume
inside the box is the sum over its triangles, with the sign of the vertical component of their normals, of the integral
of ``min(max(z, bottom), top)`` over the part of the triangle above the base of the box: each vertical line enters and
leaves the solid alternately, so that the intersections with the faces of the box are not needed. Where only faces
across one axis cut the mesh, no triangle is clipped. Polygons are clipped side by side (Sutherland & Hodgman 1974,
Reentrant polygon clipping, doi:10.1145/360767.360802).
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers, float_array
from voxgran._base.errors import InputError, shown
from voxgran._base.kernels import kernel


def as_window(lower: "ArrayLike", upper: "ArrayLike", dimension: int) -> tuple[Floats, Floats]:
    """Return the corners of a box, infinite on open sides; in 2D a third coordinate is ignored.

    Raises
    ------
    InputError
        If a corner has the wrong shape, holds NaN, or a lower one is above the upper one.
    """
    corners = [float_array(corner) for corner in (lower, upper)]
    low, high = (np.zeros(0) if c is None else c.ravel()[:dimension] if c.size == 3 else c.ravel() for c in corners)
    if len(low) != dimension or len(high) != dimension or not (low <= high).all():
        raise InputError(
            f"window runs from {shown(lower)} to {shown(upper)}: give two corners of {dimension} "
            "numbers, none of the first above the second"
        )
    return low, high


def cut_mesh(
    vertices: Floats, faces: Integers, maps: Floats, centers: Floats, *, lower: Floats, upper: Floats
) -> Floats:
    """Return the volume (k,) inside a box of each of k copies of a closed mesh of vertices (v, 3) and faces (m, 3).

    A copy has a linear map (3, 3), rotation times scale, and a position of the origin (3,); the box is infinite on open
    sides.
    """
    volumes = np.zeros(len(centers))
    # copies, since numba compiles for arrays that cannot be written anew
    arrays = (np.array(array, order="C") for array in (vertices, faces, maps, centers))
    _cut_copies(*arrays, lower, upper, np.zeros((len(vertices), 3)), np.zeros((2, 12, 3)), volumes)
    return volumes


def cut_polygon(vertices: Floats, maps: Floats, centers: Floats, *, lower: Floats, upper: Floats) -> Floats:
    """Return the area (k,) inside a rectangle of each of k copies of a simple, counterclockwise polygon with corners
    (m, 2).

    Maps, centers and rectangle are as for :func:`cut_mesh`, with two coordinates.
    """
    areas = np.zeros(len(centers))
    # a line cuts each edge of a polygon at most once, so that each of the four cuts at most doubles it
    work = np.zeros((2, 16 * len(vertices) + 8, 3))
    for copy in range(len(centers)):
        work[0, : len(vertices), :2] = linear.matmul(vertices, maps[copy].T)
        low, high = lower - centers[copy], upper - centers[copy]
        areas[copy] = _flat(work, len(vertices), low, high)
    return areas


@kernel
def _clip(work, here, count, axis, bound, sign):  # type: ignore[no-untyped-def]
    """Clip the polygon in `work[here]` to ``sign * x[axis] <= sign * bound``, into the other half of `work`.

    A nonconvex polygon may keep overlapping edges on the line, which add no area.
    """
    there, kept = 1 - here, 0
    for k in range(count):
        after = (k + 1) % count
        a = sign * (work[here, k, axis] - bound)
        b = sign * (work[here, after, axis] - bound)
        if a <= 0.0:
            for c in range(3):
                work[there, kept, c] = work[here, k, c]
            kept += 1
        if (a < 0.0 and b > 0.0) or (a > 0.0 and b < 0.0):
            share = a / (a - b)
            for c in range(3):
                start, end = work[here, k, c], work[here, after, c]
                work[there, kept, c] = start + share * (end - start)
            work[there, kept, axis] = bound
            kept += 1
    return kept


@kernel
def _clip_sides(work, count, lower, upper):  # type: ignore[no-untyped-def]
    """Clip the polygon in `work[0]` to a rectangle in x and y; return its half of `work`, and its size."""
    here = 0
    for axis in range(2):
        for side in range(2):
            bound, sign = (lower[axis], -1.0) if side == 0 else (upper[axis], 1.0)
            beyond = False
            for k in range(count):
                beyond = beyond or sign * (work[here, k, axis] - bound) > 0.0
            if beyond:
                count = _clip(work, here, count, axis, bound, sign)
                here = 1 - here
    return here, count


@kernel
def _flat(work, count, lower, upper):  # type: ignore[no-untyped-def]
    """Return the area inside the rectangle of the polygon in `work[0]`."""
    here, kept = _clip_sides(work, count, lower, upper)
    total = 0.0
    for k in range(1, kept - 1):
        total += _twice_area(work, here, k)
    return 0.5 * total


@kernel
def _twice_area(work, here, k):  # type: ignore[no-untyped-def]
    """Return twice the signed area, seen along z, of the triangle of corners 0, k and k + 1."""
    ux, uy = work[here, k, 0] - work[here, 0, 0], work[here, k, 1] - work[here, 0, 1]
    vx, vy = work[here, k + 1, 0] - work[here, 0, 0], work[here, k + 1, 1] - work[here, 0, 1]
    return ux * vy - uy * vx


@kernel
def _under(work, here, count, bottom):  # type: ignore[no-untyped-def]
    """Return the signed volume between a plane polygon and the height `bottom`."""
    total = 0.0
    for k in range(1, count - 1):
        height = (work[here, 0, 2] + work[here, k, 2] + work[here, k + 1, 2]) / 3.0 - bottom
        total += _twice_area(work, here, k) * height
    return 0.5 * total


@kernel
def _cut_copies(vertices, faces, maps, centers, lower, upper, moved, work, volumes):  # type: ignore[no-untyped-def]
    """Write the volume of each copy of a mesh inside the box."""
    low, high = np.zeros(3), np.zeros(3)
    for copy in range(len(centers)):
        crossed, along, inside = 0, 0, True
        for axis in range(3):
            x, y, z = maps[copy, axis, 0], maps[copy, axis, 1], maps[copy, axis, 2]
            least, most = math.inf, -math.inf
            for v in range(len(vertices)):
                place = x * vertices[v, 0] + y * vertices[v, 1] + z * vertices[v, 2]
                moved[v, axis] = place
                least, most = min(least, place), max(most, place)
            # the box is translated instead of the mesh, so that no digits are lost far from the origin
            low[axis], high[axis] = lower[axis] - centers[copy, axis], upper[axis] - centers[copy, axis]
            if low[axis] > least or high[axis] < most:
                crossed, along = crossed + 1, axis
            low[axis], high[axis] = max(low[axis], least), min(high[axis], most)
            inside = inside and low[axis] < high[axis]
        if inside and crossed > 1:
            volumes[copy] = _columns(moved, faces, low, high, work)
        elif inside:
            volumes[copy] = _layer(moved, faces, along, low[along], high[along])


@kernel
def _layer(points, faces, axis, bottom, top):  # type: ignore[no-untyped-def]
    """Return the volume of a closed mesh between two planes across an axis, by Gauss's theorem: over each triangle, the
    mean length between the planes times the area seen along the axis.
    """
    one, two, total = (axis + 1) % 3, (axis + 2) % 3, 0.0
    for t in range(len(faces)):
        a, b, c = faces[t, 0], faces[t, 1], faces[t, 2]
        p, q, r = points[a, axis], points[b, axis], points[c, axis]
        first, last = min(p, q, r), max(p, q, r)
        if last <= bottom:
            continue
        if first >= top:
            length = top - bottom
        else:
            middle = p + q + r - first - last
            length = _height_above(first, middle, last, bottom) - _height_above(first, middle, last, top)
        ux, uy = points[b, one] - points[a, one], points[b, two] - points[a, two]
        vx, vy = points[c, one] - points[a, one], points[c, two] - points[a, two]
        total += 0.5 * (ux * vy - uy * vx) * length
    return total


@kernel
def _height_above(first, middle, last, level):  # type: ignore[no-untyped-def]
    """Return the mean over a triangle of the height above a level, 0 below it; corners are in the order of height."""
    if level >= last:
        return 0.0
    if level > first and level >= middle:
        return (last - level) ** 3 / (3.0 * (last - first) * (last - middle))
    height = (first - level + (middle - level) + (last - level)) / 3.0
    if level > first:
        height += (level - first) ** 3 / (3.0 * (middle - first) * (last - first))
    return height


@kernel
def _columns(points, faces, lower, upper, work):  # type: ignore[no-untyped-def]
    """Return the volume inside the box: the sum over the triangles of the clamped volume under each."""
    bottom, top, total = lower[2], upper[2], 0.0
    for t in range(len(faces)):
        outside, low, high = False, math.inf, -math.inf
        for axis in range(2):
            a, b, c = points[faces[t, 0], axis], points[faces[t, 1], axis], points[faces[t, 2], axis]
            outside = outside or max(a, b, c) <= lower[axis] or min(a, b, c) >= upper[axis]
        for k in range(3):
            low, high = min(low, points[faces[t, k], 2]), max(high, points[faces[t, k], 2])
            for axis in range(3):
                work[0, k, axis] = points[faces[t, k], axis]
        if outside or high <= bottom:
            continue
        here, count = _clip_sides(work, 3, lower, upper)
        if low < bottom:
            count = _clip(work, here, count, 2, bottom, -1.0)
            here = 1 - here
        if high <= top:
            total += _under(work, here, count, bottom)
            continue
        for k in range(1, count - 1):
            total += 0.5 * _twice_area(work, here, k) * (top - bottom)
        # the part below the top misses the difference
        count = _clip(work, here, count, 2, top, 1.0)
        total += _under(work, 1 - here, count, top)
    return total
