"""Exact volume of spheres, and exact area of disks, cut by planes.

The volume is decomposed into cones with their apex at the center of the sphere. Each ray from the center ends at the
sphere or at a face before it, so that the volume is a third of ``r**3 * solid angle`` of the sphere plus
``distance * area`` of each face. The solid angle of the sphere is the full one (if the center is inside) minus those of
the faces. A face is a disk cut by half-planes, and the same decomposition holds one dimension lower about the
projection of the center on the face: the angle of the arcs is the full one minus those of the edges. An edge is an
interval on a line, found by clipping. Each angle is an arc tangent of distances of full relative precision, and an
error of the half-chord enters squared; so no precision is lost if a face touches the sphere or passes through the
center. A center within ON_PLANE of a face is shifted by far less than rounding error, in a direction that lies in no
common plane.

The formula for cells of a mesh instead of half-spaces is due to Strobl, Formella & Pöschel 2016, Exact calculation of
the overlap volume of spheres and mesh elements, Journal of Computational Physics 311, 158,
doi:10.1016/j.jcp.2016.02.003.
"""

import math
from typing import Any

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel, kernel

#: distance from the center, in radii, below which a plane counts as passing through it
ON_PLANE = 4e-16
SHIFT, ASKEW = 1e-100, (0.62, 0.53, 0.58)
#: sine below which two planes count as parallel
PARALLEL = 1e-15


def cut_spheres(
    centers: Floats,
    radii: Floats,
    *,
    lower: Floats,
    upper: Floats,
    planes: tuple[Integers, Floats, Floats] | None = None,
) -> Floats:
    """Return the volume (n,) of each sphere inside a box and inside half-spaces of its own, to about 1e-15
    of that of the sphere.

    The box is infinite on open sides. The half-spaces of sphere i are ``normals[k] @ (x - centers[i]) <= offsets[k]``
    with k from ``start[i]`` to ``start[i + 1]``, and `planes` is (start, normals, offsets); normals have length 1.
    """
    return _cut(_fill_spheres, 3, centers, radii, lower, upper, planes)


def cut_disks(
    centers: Floats,
    radii: Floats,
    *,
    lower: Floats,
    upper: Floats,
    planes: tuple[Integers, Floats, Floats] | None = None,
) -> Floats:
    """Return the area of each disk inside a rectangle and inside half-planes of its own.

    Parameters and result are those of :func:`cut_spheres` with two coordinates in place of three.
    """
    return _cut(_fill_disks, 2, centers, radii, lower, upper, planes)


def _cut(fill: Any, d: int, centers: Floats, radii: Floats, lower: Floats, upper: Floats, planes: Any) -> Floats:
    """Return what a kernel fills, for d dimensions."""
    none = np.zeros(len(radii) + 1, dtype=np.int64), np.zeros((0, d)), np.zeros(0)
    start, normals, offsets = none if planes is None else planes
    work = np.zeros((2 * d + int(np.diff(start).max(initial=0)), 9 if d == 3 else 3))
    volumes = np.zeros(len(radii))
    box = (np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64))
    fill(centers, radii, *box, start, normals, offsets, work, volumes)
    return volumes


@kernel
def _fill_spheres(centers, radii, lower, upper, start, normals, offsets, work, volumes):  # type: ignore[no-untyped-def]
    """Write the volume of each sphere inside the box and its half-spaces."""
    for i in range(len(radii)):
        r = radii[i]
        whole = start[i + 1] == start[i]
        for axis in range(3):
            whole = whole and lower[axis] <= centers[i, axis] - r and centers[i, axis] + r <= upper[axis]
        if whole:
            volumes[i] = r**3 * (4.0 * math.pi / 3.0)
            continue
        count = _near_planes(centers[i], r, lower, upper, start[i], normals, offsets[: start[i + 1]], work)
        if count >= 0:
            volumes[i] = radii[i] ** 3 * unit_sphere(work, count)


@bare_kernel
def _near_planes(center, radius, lower, upper, start, normals, offsets, work):  # type: ignore[no-untyped-def]
    """Write the planes of a box, and those from number `start` on, that cut a sphere or disk, in units of its radius.

    Return their number, -1 where one leaves nothing of it.
    """
    d, count = len(center), 0
    for k in range(2 * d + len(offsets) - start):
        axis, sign, m = k // 2, 2.0 * (k % 2) - 1.0, start + k - 2 * d
        if k < 2 * d:
            distance = sign * ((upper[axis] if k % 2 else lower[axis]) - center[axis]) / radius
        else:
            distance = offsets[m] / radius
        if distance <= -1.0:
            return -1
        if distance < 1.0:
            shift = 0.0
            for c in range(d):
                work[count, c] = sign * (c == axis) if k < 2 * d else normals[m, c]
                shift += ASKEW[c] * work[count, c]
            work[count, d] = SHIFT * shift if abs(distance) <= ON_PLANE else distance
            count += 1
    return count


@kernel
def unit_sphere(work: Floats, count: int) -> float:
    """Return the volume of the unit sphere inside the half-spaces in the first four columns of `work`."""
    if count == 0:
        return 4.0 * math.pi / 3.0
    if count == 1:
        return math.pi * (1.0 + work[0, 3]) ** 2 * (2.0 - work[0, 3]) / 3.0
    if count == 2 and work[0, 0] == -work[1, 0] and work[0, 1] == -work[1, 1] and work[0, 2] == -work[1, 2]:
        # between two parallel planes; without cancellation also where they are close to each other
        a, b = work[0, 3], work[1, 3]
        return max(0.0, math.pi * (a + b) * (1.0 - (a * a - a * b + b * b) / 3.0))
    total, inside = 0.0, True
    for f in range(count):
        height = work[f, 3]
        inside = inside and height >= 0.0
        lines = _trace(work, count, f)
        if lines < 0:
            continue
        area, angle = _face(work, lines, math.sqrt((1.0 - height) * (1.0 + height)), abs(height))
        total += height * area - (angle if height >= 0.0 else -angle)
    full = 4.0 * math.pi if inside else 0.0
    return max(0.0, full + total) / 3.0


@kernel
def _trace(work, count, f):  # type: ignore[no-untyped-def]
    """Write the lines of the other planes in plane f to columns 5 to 7; return their number, -1 if f is hidden."""
    nx, ny, nz, height = work[f, 0], work[f, 1], work[f, 2], work[f, 3]
    # a basis of the plane: the axis with the smallest component along the normal, orthogonalized
    ax, ay, az = 0.0, 0.0, 0.0
    if abs(nx) <= abs(ny) and abs(nx) <= abs(nz):
        ax = 1.0
    elif abs(ny) <= abs(nz):
        ay = 1.0
    else:
        az = 1.0
    ux, uy, uz = ny * az - nz * ay, nz * ax - nx * az, nx * ay - ny * ax
    length = math.sqrt(ux * ux + uy * uy + uz * uz)
    ux, uy, uz = ux / length, uy / length, uz / length
    vx, vy, vz = ny * uz - nz * uy, nz * ux - nx * uz, nx * uy - ny * ux
    lines = 0
    for g in range(count):
        if g == f:
            continue
        cosine = nx * work[g, 0] + ny * work[g, 1] + nz * work[g, 2]
        a = ux * work[g, 0] + uy * work[g, 1] + uz * work[g, 2]
        b = vx * work[g, 0] + vy * work[g, 1] + vz * work[g, 2]
        sine = math.hypot(a, b)
        if sine < PARALLEL:
            if cosine > 0.0 and (work[g, 3] < height or (work[g, 3] == height and g < f)):
                return -1
            if cosine < 0.0 and work[g, 3] + height < 0.0:
                return -1
            continue
        work[lines, 5], work[lines, 6] = a / sine, b / sine
        work[lines, 7] = (work[g, 3] - height * cosine) / sine
        lines += 1
    return lines


@kernel
def _face(work, lines, radius, height):  # type: ignore[no-untyped-def]
    """Return the area, and the solid angle seen from `height` above, of a disk cut by the lines in columns 5 to 7."""
    area, angle, turn, inside = 0.0, 0.0, 0.0, True
    for g in range(lines):
        h = work[g, 7]
        inside = inside and h >= 0.0
        low, high = _edge(work, 5, lines, g, radius)
        if low < high:
            sign, side = (1.0 if h >= 0.0 else -1.0), abs(h)
            area += 0.5 * h * (high - low)
            turn += sign * (math.atan2(high, side) - math.atan2(low, side))
            top = math.sqrt(side * side + high * high + height * height)
            bottom = math.sqrt(side * side + low * low + height * height)
            angle -= sign * (math.atan2(high * height, side * top) - math.atan2(low * height, side * bottom))
    arcs = max(0.0, (2.0 * math.pi if inside else 0.0) - turn)
    return area + 0.5 * radius * radius * arcs, turn + angle + arcs * (1.0 - height)


@kernel
def _edge(work, column, lines, g, radius):  # type: ignore[no-untyped-def]
    """Return the interval of line g inside the disk and all other half-planes; empty where low >= high."""
    nx, ny, h = work[g, column], work[g, column + 1], work[g, column + 2]
    square = (radius - h) * (radius + h)
    if square <= 0.0:
        return 0.0, 0.0
    high = math.sqrt(square)
    low = -high
    for k in range(lines):
        if k == g:
            continue
        cosine = nx * work[k, column] + ny * work[k, column + 1]
        slope = nx * work[k, column + 1] - ny * work[k, column]
        rest = work[k, column + 2] - h * cosine
        if abs(slope) < PARALLEL:
            if rest < 0.0 or (rest == 0.0 and cosine > 0.0 and k < g):
                return 0.0, 0.0
        elif slope > 0.0:
            high = min(high, rest / slope)
        else:
            low = max(low, rest / slope)
    return low, high


@kernel
def _fill_disks(centers, radii, lower, upper, start, normals, offsets, work, areas):  # type: ignore[no-untyped-def]
    """Write the area of each disk inside the rectangle and its half-planes."""
    for i in range(len(radii)):
        own = offsets[: start[i + 1]]
        count = _near_planes(centers[i], radii[i], lower, upper, start[i], normals, own, work)
        if count >= 0:
            areas[i] = radii[i] ** 2 * _unit_disk(work, count)


@kernel
def _unit_disk(work, count):  # type: ignore[no-untyped-def]
    """Return the area of the unit disk inside the half-planes in the columns of `work`."""
    area, turn, inside = 0.0, 0.0, True
    for g in range(count):
        h = work[g, 2]
        inside = inside and h >= 0.0
        low, high = _edge(work, 0, count, g, 1.0)
        if low < high:
            area += 0.5 * h * (high - low)
            turn += (1.0 if h >= 0.0 else -1.0) * (math.atan2(high, abs(h)) - math.atan2(low, abs(h)))
    return area + 0.5 * max(0.0, (2.0 * math.pi if inside else 0.0) - turn)
