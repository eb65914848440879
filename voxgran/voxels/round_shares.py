"""Exact shares of voxels in round solids: ellipsoids, cylinders, cones, ends of spherocylinders, spheres and disks.

A slice across the axis of the solid is a disk, and the slice of a voxel is a convex polygon; their common area is a
sum over the sides of the polygon in closed form. Along the axis the area is smooth but where the slice passes a corner
of the voxel, where an edge pierces the surface and where a face touches it; between these heights it is integrated by
Gauss's rule over an angle, which takes away the roots at the ends.
"""

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import kernel

#: nodes of Gauss's rule between two heights: shares are right to some 1e-13
NODES = 20
#: columns along each edge of a voxel that several spheres touch
COLUMNS = 32


def round_shares(middles: Floats, stretch: Floats, curve: Floats, ends: Floats) -> Floats:
    """Return the shares (n,) of voxels with centers (n, 3), from the centroid in voxels, that are in a solid of
    revolution.

    `stretch` (3, 3) maps voxels to the frame of the axis, in which the squared radius at the height t is c0 + c1 t + c2
    t^2 with c in `curve` (3,), between the lowest and highest t in `ends` (2,).
    """
    nodes, weights = linear.gauss_legendre(NODES)
    angle = np.pi / 2 * (nodes + 1)
    place, weight = (1 - libm.cos(angle)) / 2, np.pi / 4 * weights * libm.sin(angle)
    share = np.zeros(len(middles))
    corner = np.ascontiguousarray(linear.matmul(middles, stretch.T))
    _integrate(corner, np.ascontiguousarray(stretch), curve, ends, place, weight, share)
    return np.clip(share / linear.determinant(stretch), 0.0, 1.0)


def disk_shares(middles: Floats, radius: float) -> Floats:
    """Return the shares of unit pixels with centers (n, 2) that lie in a disk about the origin."""
    share = np.zeros(len(middles))
    _cover_pixels(np.ascontiguousarray(middles), radius, share)
    return np.clip(share, 0.0, 1.0)


def union_shares(middles: Floats, bounds: Integers, centers: Floats, radii: Floats) -> Floats:
    """Return the shares (n,) of voxels with centers (n, 3) that several spheres touch, from columns of exact lengths
    inside.

    `centers` (m, 3) and `radii` (m,) list the spheres of one voxel after the other, and `bounds` (n + 1,) where those
    of each voxel begin and end. The root mean square error is below 5e-4 (measured).
    """
    share = np.zeros(len(middles))
    widest = int(np.diff(bounds).max(initial=1))
    _cover_columns(middles, bounds, centers, radii, COLUMNS, np.zeros((widest, 2)), share)
    return share


@kernel
def _disk_part(ax, ay, dx, dy, square):  # type: ignore[no-untyped-def]
    """Return the signed area that a disk about the origin shares with the triangle of the origin, a and a + d."""
    long, along, across = dx * dx + dy * dy, ax * dx + ay * dy, ax * dy - ay * dx
    inside = square * long - across * across
    dot = ax * (ax + dx) + ay * (ay + dy)
    if long == 0.0:
        return 0.0
    if inside > 0.0:
        root = np.sqrt(inside)
        first, last = max((-along - root) / long, 0.0), min((-along + root) / long, 1.0)
        if first < last:
            # from a to where it enters, along the side, and from where it leaves to the end
            before = np.arctan2(first * across, ax * (ax + first * dx) + ay * (ay + first * dy))
            px, py = ax + last * dx, ay + last * dy
            after = np.arctan2((1.0 - last) * across, px * (ax + dx) + py * (ay + dy))
            return 0.5 * (square * (before + after) + (last - first) * across)
    return 0.5 * square * np.arctan2(across, dot)


@kernel
def _slice_area(middle, stretch, level, square):  # type: ignore[no-untyped-def]
    """Return the area that the slice of a voxel at a height shares with a disk: a sum over the faces of the voxel."""
    total = 0.0
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        rise_b, rise_c = stretch[2, b], stretch[2, c]
        steep = rise_b * rise_b + rise_c * rise_c
        if steep == 0.0:
            continue
        for side in range(2):
            sign = 1.0 if side else -1.0
            # where the plane meets the middle of the face, in its two coordinates, and the way along the cut
            lack = (level - middle[2] - 0.5 * sign * stretch[2, a]) / steep
            beta, gamma = lack * rise_b, lack * rise_c
            along_b, along_c = sign * rise_c, -sign * rise_b
            first, last = -np.inf, np.inf
            if along_b != 0.0:
                u, v = (-0.5 - beta) / along_b, (0.5 - beta) / along_b
                first, last = max(first, min(u, v)), min(last, max(u, v))
            elif abs(beta) > 0.5:
                continue
            if along_c != 0.0:
                u, v = (-0.5 - gamma) / along_c, (0.5 - gamma) / along_c
                first, last = max(first, min(u, v)), min(last, max(u, v))
            elif abs(gamma) > 0.5:
                continue
            if first >= last:
                continue
            beta, gamma = beta + first * along_b, gamma + first * along_c
            x = middle[0] + 0.5 * sign * stretch[0, a] + beta * stretch[0, b] + gamma * stretch[0, c]
            y = middle[1] + 0.5 * sign * stretch[1, a] + beta * stretch[1, b] + gamma * stretch[1, c]
            way = last - first
            dx = way * (along_b * stretch[0, b] + along_c * stretch[0, c])
            dy = way * (along_b * stretch[1, b] + along_c * stretch[1, c])
            total += _disk_part(x, y, dx, dy, square)
    return total


@kernel
def _note_roots(square, half, rest, start, rise, low, high, levels, many):  # type: ignore[no-untyped-def]
    """Note start + rise u for the roots u of square u^2 + 2 half u + rest that lie between two values."""
    inside = half * half - square * rest
    if inside < 0.0 or (square == 0.0 and half == 0.0):
        return many
    large = -(half + np.sqrt(inside)) if half >= 0.0 else -half + np.sqrt(inside)
    for k in range(2):
        if (k == 0 and square == 0.0) or (k == 1 and large == 0.0):
            continue
        u = large / square if k == 0 else rest / large
        if low <= u <= high:
            levels[many] = start + rise * u
            many += 1
    return many


@kernel
def _note_levels(middle, stretch, curve, levels):  # type: ignore[no-untyped-def]
    """Note the heights of corners, of where edges pierce the surface, and of where faces touch it."""
    many = 0
    for corner in range(8):
        x, y, z = (corner & 1) - 0.5, (corner >> 1 & 1) - 0.5, (corner >> 2) - 0.5
        levels[many] = middle[2] + x * stretch[2, 0] + y * stretch[2, 1] + z * stretch[2, 2]
        many += 1
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        ex, ey, et = stretch[0, a], stretch[1, a], stretch[2, a]
        for corner in range(4):
            p, q = (corner & 1) - 0.5, (corner >> 1) - 0.5
            x = middle[0] + p * stretch[0, b] + q * stretch[0, c]
            y = middle[1] + p * stretch[1, b] + q * stretch[1, c]
            t = middle[2] + p * stretch[2, b] + q * stretch[2, c]
            square = ex * ex + ey * ey - curve[2] * et * et
            half = x * ex + y * ey - et * (0.5 * curve[1] + curve[2] * t)
            rest = x * x + y * y - curve[0] - t * (curve[1] + curve[2] * t)
            many = _note_roots(square, half, rest, t, et, -0.5, 0.5, levels, many)
        # normal of the faces across this axis; the line of a slice has the distance (n p - n_t t) / |n_xy|
        nx = stretch[1, b] * stretch[2, c] - stretch[2, b] * stretch[1, c]
        ny = stretch[2, b] * stretch[0, c] - stretch[0, b] * stretch[2, c]
        nt = stretch[0, b] * stretch[1, c] - stretch[1, b] * stretch[0, c]
        flat = nx * nx + ny * ny
        for side in range(2):
            sign = 0.5 if side else -0.5
            far = nx * (middle[0] + sign * ex) + ny * (middle[1] + sign * ey) + nt * (middle[2] + sign * et)
            square = nt * nt - flat * curve[2]
            half = -far * nt - 0.5 * flat * curve[1]
            rest = far * far - flat * curve[0]
            many = _note_roots(square, half, rest, 0.0, 1.0, -np.inf, np.inf, levels, many)
    return many


@kernel
def _integrate(middles, stretch, curve, ends, place, weight, share):  # type: ignore[no-untyped-def]
    """Integrate the common area over the heights of each voxel."""
    levels = np.empty(64)
    for v in range(len(middles)):
        middle = middles[v]
        many = _note_levels(middle, stretch, curve, levels)
        low, high = min(levels[0], levels[7]), max(levels[0], levels[7])
        for k in range(8):
            low, high = min(low, levels[k]), max(high, levels[k])
        low, high = max(low, ends[0]), min(high, ends[1])
        levels[many], levels[many + 1] = low, high
        many += 2
        for k in range(many):
            levels[k] = min(max(levels[k], low), max(low, high))
        ordered = np.sort(levels[:many])
        total = 0.0
        for k in range(many - 1):
            step = ordered[k + 1] - ordered[k]
            if step <= 1e-15 * (high - low):
                continue
            for n in range(len(place)):
                t = ordered[k] + step * place[n]
                square = max(curve[0] + t * (curve[1] + curve[2] * t), 0.0)
                total += step * weight[n] * _slice_area(middle, stretch, t, square)
        share[v] = total


@kernel
def _cover_pixels(middles, radius, share):  # type: ignore[no-untyped-def]
    """Add up the parts of a disk over the sides of each pixel."""
    for v in range(len(middles)):
        x, y = middles[v, 0], middles[v, 1]
        total = _disk_part(x - 0.5, y - 0.5, 1.0, 0.0, radius * radius)
        total += _disk_part(x + 0.5, y - 0.5, 0.0, 1.0, radius * radius)
        total += _disk_part(x + 0.5, y + 0.5, -1.0, 0.0, radius * radius)
        share[v] = total + _disk_part(x - 0.5, y + 0.5, 0.0, -1.0, radius * radius)


@kernel
def _cover_columns(middles, bounds, centers, radii, columns, pieces, share):  # type: ignore[no-untyped-def]
    """Join the intervals of the spheres along the columns of each voxel."""
    for v in range(len(middles)):
        x, y, z = middles[v, 0], middles[v, 1], middles[v, 2]
        total = 0.0
        for i in range(columns):
            for j in range(columns):
                dx, dy = x + (i + 0.5) / columns - 0.5, y + (j + 0.5) / columns - 0.5
                many = 0
                for b in range(bounds[v], bounds[v + 1]):
                    rest = radii[b] ** 2 - (dx - centers[b, 0]) ** 2 - (dy - centers[b, 1]) ** 2
                    if rest <= 0.0:
                        continue
                    low = max(centers[b, 2] - np.sqrt(rest), z - 0.5)
                    high = min(centers[b, 2] + np.sqrt(rest), z + 0.5)
                    if low >= high:
                        continue
                    # sorted by their lower ends as they come
                    k = many
                    while k > 0 and pieces[k - 1, 0] > low:
                        pieces[k, 0], pieces[k, 1] = pieces[k - 1, 0], pieces[k - 1, 1]
                        k -= 1
                    pieces[k, 0], pieces[k, 1] = low, high
                    many += 1
                reached = z - 0.5
                for k in range(many):
                    total += max(pieces[k, 1] - max(pieces[k, 0], reached), 0.0)
                    reached = max(reached, pieces[k, 1])
        share[v] = total / columns**2
