"""Exact volumes of solids, and exact areas of plane figures, inside boxes along the axes.

Spheres and disks are cut in closed form (:mod:`voxgran.measures.halfspaces`). For a closed mesh the volume
inside the box is the sum over its triangles, with the sign of the vertical component of their normals, of the integral
of ``min(max(z, bottom), top)`` over the part of the triangle above the base of the box: each vertical line enters and
leaves the solid alternately, so that the intersections with the faces of the box are not needed. Polygons are clipped
side by side (Sutherland & Hodgman 1974, Reentrant polygon clipping, doi:10.1145/360767.360802).
"""

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arrays import Floats, as_faces, as_floats, as_points, float_array
from voxgran._base.errors import InputError, shown
from voxgran._base.kernels import kernel
from voxgran.measures.halfspaces import cut_disks, cut_spheres


def sphere_box_volume(centers: ArrayLike, radii: ArrayLike, *, lower: ArrayLike, upper: ArrayLike) -> Floats:
    """Return the exact volume of each sphere inside a box along the axes.

    Parameters
    ----------
    centers : (n, 3) array_like of float
        Centers, in the unit of lengths.
    radii : (n,) array_like of float
        Radii, above 0.
    lower, upper : (3,) array_like of float
        Corners of the box; infinite on open sides.

    Returns
    -------
    (n,) ndarray of float
        Volumes, to about 1e-15 of the volume of the sphere.

    Raises
    ------
    InputError
        If an array has the wrong shape, a value is not finite or a radius is not above 0.

    Examples
    --------
    >>> float(sphere_box_volume([[0, 0, 0]], [1.0], lower=[0, 0, 0], upper=[2, 2, 2])[0] * 6)
    3.141592653589793
    """
    points, sizes = _spheres(centers, radii, 3)
    low, high = as_window(lower, upper, 3)
    return cut_spheres(points, sizes, lower=low, upper=high)


def disk_rectangle_area(centers: ArrayLike, radii: ArrayLike, *, lower: ArrayLike, upper: ArrayLike) -> Floats:
    """Return the exact area of each disk inside a rectangle along the axes.

    Parameters
    ----------
    centers : (n, 2) array_like of float
        Centers, in the unit of lengths.
    radii : (n,) array_like of float
        Radii, above 0.
    lower, upper : (2,) array_like of float
        Corners of the rectangle; infinite on open sides.

    Returns
    -------
    (n,) ndarray of float
        Areas, to about 1e-15 of the area of the disk.

    Raises
    ------
    InputError
        If an array has the wrong shape, a value is not finite or a radius is not above 0.
    """
    points, sizes = _spheres(centers, radii, 2)
    low, high = as_window(lower, upper, 2)
    return cut_disks(points, sizes, lower=low, upper=high)


def mesh_box_volume(vertices: ArrayLike, faces: ArrayLike, *, lower: ArrayLike, upper: ArrayLike) -> float:
    """Return the exact volume of a closed mesh inside a box along the axes.

    Parameters
    ----------
    vertices : (n, 3) array_like of float
        Corner points, in the unit of lengths.
    faces : (m, 3) array_like of int
        Triangles of a closed surface, counterclockwise seen from outside.
    lower, upper : (3,) array_like of float
        Corners of the box; infinite on open sides.

    Returns
    -------
    float
        Volume.

    Raises
    ------
    InputError
        If an array has the wrong shape, an index is out of range or a vertex is not finite.
    """
    points = as_points(vertices, "vertices")
    triangles = points[as_faces(faces, len(points))]
    low, high = as_window(lower, upper, 3)
    return float(cut_mesh(triangles, np.eye(3)[None], np.zeros((1, 3)), lower=low, upper=high)[0])


def polygon_rectangle_area(vertices: ArrayLike, *, lower: ArrayLike, upper: ArrayLike) -> float:
    """Return the exact area of a simple polygon inside a rectangle along the axes.

    Parameters
    ----------
    vertices : (n, 2) array_like of float
        Corners, counterclockwise, in the unit of lengths.
    lower, upper : (2,) array_like of float
        Corners of the rectangle; infinite on open sides.

    Returns
    -------
    float
        Area.

    Raises
    ------
    InputError
        If an array has the wrong shape or a corner is not finite.
    """
    points = as_points(vertices, "vertices", dimension=2)
    low, high = as_window(lower, upper, 2)
    return float(cut_polygon(points, np.eye(2)[None], np.zeros((1, 2)), lower=low, upper=high)[0])


def as_window(lower: ArrayLike, upper: ArrayLike, dimension: int) -> tuple[Floats, Floats]:
    """Return the corners of a box, infinite on open sides.

    Parameters
    ----------
    lower, upper : (dimension,) array_like of float
        Corners; in 2D a third coordinate is ignored.
    dimension : int
        2 or 3.

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


def cut_mesh(triangles: Floats, maps: Floats, centers: Floats, *, lower: Floats, upper: Floats) -> Floats:
    """Return the volume inside a box of each of k copies of a closed mesh.

    Parameters
    ----------
    triangles : (m, 3, 3) ndarray of float
        Corner points of the triangles in the body frame.
    maps : (k, 3, 3) ndarray of float
        Linear map of each copy: rotation times scale.
    centers : (k, 3) ndarray of float
        Position of the origin of the body frame.
    lower, upper : (3,) ndarray of float
        Corners of the box; infinite on open sides.
    """
    volumes = np.zeros(len(centers))
    work = np.zeros((2, 12, 3))
    for copy in range(len(centers)):
        # the box is translated instead of the mesh, so that no digits are lost far from the origin
        corners = triangles @ maps[copy].T
        low, high = lower - centers[copy], upper - centers[copy]
        low[2] = max(low[2], corners[..., 2].min())
        high[2] = min(high[2], corners[..., 2].max())
        if (low < high).all():
            volumes[copy] = _columns(corners, low, high, work)
    return volumes


def cut_polygon(vertices: Floats, maps: Floats, centers: Floats, *, lower: Floats, upper: Floats) -> Floats:
    """Return the area inside a rectangle of each of k copies of a simple polygon.

    Parameters
    ----------
    vertices : (m, 2) ndarray of float
        Corners in the body frame, counterclockwise.
    maps : (k, 2, 2) ndarray of float
        Linear map of each copy: rotation times scale.
    centers : (k, 2) ndarray of float
        Position of the origin of the body frame.
    lower, upper : (2,) ndarray of float
        Corners of the rectangle; infinite on open sides.
    """
    areas = np.zeros(len(centers))
    # a line cuts each edge of a polygon at most once, so that each of the four cuts at most doubles it
    work = np.zeros((2, 16 * len(vertices) + 8, 3))
    for copy in range(len(centers)):
        work[0, : len(vertices), :2] = vertices @ maps[copy].T
        low, high = lower - centers[copy], upper - centers[copy]
        areas[copy] = _flat(work, len(vertices), low, high)
    return areas


def _spheres(centers: ArrayLike, radii: ArrayLike, dimension: int) -> tuple[Floats, Floats]:
    """Check centers and radii."""
    points = as_points(centers, "centers", dimension=dimension)
    sizes = as_floats(radii, "radii", shape=(len(points),))
    if len(sizes) and sizes.min() <= 0:
        raise InputError(f"radius is {sizes.min()}: it must be above 0; change it")
    return points, sizes


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
def _columns(corners, lower, upper, work):  # type: ignore[no-untyped-def]
    """Return the volume inside the box: the sum over the triangles of the clamped volume under each."""
    bottom, top, total = lower[2], upper[2], 0.0
    for t in range(len(corners)):
        outside, low, high = False, corners[t, 0, 2], corners[t, 0, 2]
        for axis in range(2):
            a, b, c = corners[t, 0, axis], corners[t, 1, axis], corners[t, 2, axis]
            outside = outside or max(a, b, c) <= lower[axis] or min(a, b, c) >= upper[axis]
        for k in range(3):
            low, high = min(low, corners[t, k, 2]), max(high, corners[t, k, 2])
            for axis in range(3):
                work[0, k, axis] = corners[t, k, axis]
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
