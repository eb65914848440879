"""Penetration depth of surfaces in a closed mesh: the largest distance of any of their points to its surface.

The depth is found by branch and bound. The distance from one triangle T of the mesh is a convex function, so that its
maximum over a patch is attained at a corner of any convex hull of the patch; the smallest of these maxima over all T
bounds the distance from the mesh over the whole patch. Patches whose bound exceeds the best point found so far are
bisected. Flat overlaps need no bisection, crossing edges some twenty, and depths far below the size of the triangles
lose no digits.
"""

import math

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel, kernel
from voxgran.geometry.tree import TriangleTree, is_behind, nearest_triangle, push_halves, square_to_box
from voxgran.geometry.triangles import closest_on_triangle

#: relative difference of the bounds at which a patch is not bisected further
ACCURACY = 1e-3
#: depth, in sizes of the surface, below which no deeper point is searched for: rounding decides about it
FLOOR = 1e-12
#: largest number of patches examined
MOST_PATCHES = 20_000


def deepest_of_triangles(
    tree: TriangleTree, triangles: Floats, *, inside: bool = False
) -> tuple[float, Floats, Floats]:
    """Return depth, point and nearest point of the surface for the point of triangles farthest from a closed surface.

    The (m, 3, 3) triangles lie on one side of the surface, unless `inside` is true and only points inside count. The
    depth is a lower bound with a relative error of at most 0.001; 0 if no point counts.
    """
    found = np.zeros(6)
    depth = _search_triangles(np.ascontiguousarray(triangles), tree.arrays, inside, FLOOR * tree.size, found)
    return depth, found[:3], found[3:]


def deepest_of_round(tree: TriangleTree, row: Floats, center: Floats) -> tuple[float, Floats, Floats]:
    """Return depth, point and nearest point of the mesh for the deepest point of a cylinder or cone in a closed mesh.

    The solid is a (13,) row of :mod:`voxgran.geometry.support` with its centroid, in the frame of the mesh. The depth
    is a lower bound with a relative error of at most 0.001; 0 if no point is inside.
    """
    radius, height = float(row[1]), float(row[2])
    if int(row[0]) == 3:
        profile = np.array([(-0.5, 0.0), (-0.5, 1.0), (0.5, 1.0), (0.5, 0.0)])
    else:
        profile = np.array([(-0.25, 0.0), (-0.25, 1.0), (0.75, 0.0)])
    found = np.zeros(6)
    depth = _search_round(
        profile * np.array([height, radius]),
        np.ascontiguousarray(row[4:].reshape(3, 3)),
        np.ascontiguousarray(center),
        tree.arrays,
        1e-15 * tree.size,
        found,
    )
    return depth, found[:3], found[3:]


@kernel
def _cover(points, tree):  # type: ignore[no-untyped-def]
    """Return the minimum over all triangles of the largest distance of the points from the triangle."""
    best, low, high = np.inf, tree.low, tree.high
    stack = np.zeros(64, dtype=np.int64)
    depth, leaves = 1, len(low) // 2
    while depth > 0:
        depth -= 1
        node = stack[depth]
        bound = 0.0
        for k in range(len(points)):
            bound = max(bound, square_to_box(low, high, node, points[k, 0], points[k, 1], points[k, 2]))
        if bound >= best:
            continue
        if node < leaves:
            push_halves(low, high, node, points[0, 0], points[0, 1], points[0, 2], stack, depth)
            depth += 2
            continue
        for t in range(tree.start[node, 0], tree.start[node, 1]):
            most = 0.0
            for k in range(len(points)):
                x, y, z = points[k, 0], points[k, 1], points[k, 2]
                px, py, pz, _ = closest_on_triangle(tree.corners, t, x, y, z)
                most = max(most, (px - x) ** 2 + (py - y) ** 2 + (pz - z) ** 2)
                if most >= best:
                    break
            best = min(best, most)
    return math.sqrt(best)


@kernel
def _try_point(x, y, z, tree, inside, best, found, sight):  # type: ignore[no-untyped-def]
    """Update the best point with a point if its distance is larger; return the larger distance."""
    square, t, feature, qx, qy, qz = nearest_triangle(tree, x, y, z, np.inf)
    sight[0] = math.sqrt(square)
    if inside and not is_behind(tree.normals, t, feature, x - qx, y - qy, z - qz):
        sight[0] = -sight[0]
    if sight[0] > best:
        found[0], found[1], found[2] = x, y, z
        found[3], found[4], found[5] = qx, qy, qz
        return sight[0]
    return best


@bare_kernel
def _copy(source, target):  # type: ignore[no-untyped-def]
    """Copy a triangle number by number: numba compiles an assignment of slices for seconds."""
    for i in range(3):
        for k in range(3):
            target[i, k] = source[i, k]


@kernel
def _search_triangles(triangles, tree, inside, floor, found):  # type: ignore[no-untyped-def]
    """Bisect triangles until none can contain a point deeper than the best; return the depth of the best."""
    best, steps, sight = 0.0, 0, np.zeros(1)
    stack, patch, middle = np.zeros((256, 3, 3)), np.zeros((3, 3)), np.zeros(3)
    for t in range(len(triangles)):
        u, v, w = 0.0, 0.0, 0.0
        for c in range(3):
            x, y, z = triangles[t, c, 0], triangles[t, c, 1], triangles[t, c, 2]
            best = _try_point(x, y, z, tree, inside, best, found, sight)
            u, v, w = u + x / 3.0, v + y / 3.0, w + z / 3.0
        best = _try_point(u, v, w, tree, inside, best, found, sight)
    for t in range(len(triangles)):
        _copy(triangles[t], stack[0])
        depth = 1
        # the unused budget of one triangle passes to the next, so that a seam of the surface cannot use up all of it
        allowed = MOST_PATCHES * (t + 1) // len(triangles)
        while depth > 0 and steps < allowed:
            depth -= 1
            steps += 1
            _copy(stack[depth], patch)
            for i in range(3):
                middle[i] = (patch[0, i] + patch[1, i] + patch[2, i]) / 3.0
            x, y, z = middle[0], middle[1], middle[2]
            best = _try_point(x, y, z, tree, inside, best, found, sight)
            bar = best * (1.0 + ACCURACY) + floor
            # points near the middle cannot be much deeper; only patches that may be are compared with the triangles
            if sight[0] + _spread(patch, middle) <= bar or _cover(patch, tree) <= bar:
                continue
            if depth + 2 > len(stack):
                continue
            a = _longest_edge(patch)
            b = (a + 1) % 3
            for i in range(3):
                middle[i] = 0.5 * (patch[a, i] + patch[b, i])
            for side in range(2):
                _copy(patch, stack[depth + side])
                for i in range(3):
                    stack[depth + side, a if side == 0 else b, i] = middle[i]
            depth += 2
    return best


@kernel
def _longest_edge(patch):  # type: ignore[no-untyped-def]
    """Return the index of the corner at which the longest edge starts."""
    longest, most = 0, -1.0
    for a in range(3):
        square = 0.0
        for i in range(3):
            square += (patch[(a + 1) % 3, i] - patch[a, i]) ** 2
        if square > most:
            longest, most = a, square
    return longest


@kernel
def _place(profile, k, share, angle, stretch, matrix, center, point):  # type: ignore[no-untyped-def]
    """Write the point of a surface of revolution at a fraction of its k-th profile segment and an angle."""
    z = (1.0 - share) * profile[k, 0] + share * profile[k + 1, 0]
    radius = ((1.0 - share) * profile[k, 1] + share * profile[k + 1, 1]) * stretch
    x, y = radius * math.cos(angle), radius * math.sin(angle)
    for i in range(3):
        point[i] = matrix[i, 0] * x + matrix[i, 1] * y + matrix[i, 2] * z + center[i]


@kernel
def _hull(profile, k, patch, matrix, center, points):  # type: ignore[no-untyped-def]
    """Write six points whose hull contains a patch: both arcs' ends and tangent intersections."""
    middle, half = 0.5 * (patch[2] + patch[3]), 0.5 * (patch[3] - patch[2])
    for end in range(2):
        for side in range(2):
            _place(profile, k, patch[end], patch[2 + side], 1.0, matrix, center, points[3 * end + side])
        _place(profile, k, patch[end], middle, 1.0 / math.cos(half), matrix, center, points[3 * end + 2])


@kernel
def _search_round(profile, matrix, center, tree, floor, found):  # type: ignore[no-untyped-def]
    """Bisect patches of a surface of revolution until none can contain a point deeper than the best."""
    sectors, best, steps = 8, 0.0, 0
    stack, patch = np.zeros((512, 4)), np.zeros(4)
    hull, point, sight = np.zeros((6, 3)), np.zeros(3), np.zeros(1)
    for root in range(sectors * (len(profile) - 1)):
        k, sector = root // sectors, root % sectors
        stack[0, 0], stack[0, 1] = 0.0, 1.0
        stack[0, 2], stack[0, 3] = 2 * math.pi * sector / sectors, 2 * math.pi * (sector + 1) / sectors
        depth = 1
        allowed = MOST_PATCHES * (root + 1) // (sectors * (len(profile) - 1))
        while depth > 0 and steps < allowed:
            depth -= 1
            steps += 1
            for i in range(len(patch)):
                patch[i] = stack[depth, i]
            _hull(profile, k, patch, matrix, center, hull)
            reach = np.inf
            for trip in range(3):
                share = 0.5 * (patch[0] + patch[1]) if trip == 0 else patch[trip - 1]
                _place(profile, k, share, 0.5 * (patch[2] + patch[3]), 1.0, matrix, center, point)
                x, y, z = point[0], point[1], point[2]
                best = _try_point(x, y, z, tree, True, best, found, sight)
                if trip == 0:
                    reach = sight[0] + _spread(hull, point)
            bar = best * (1.0 + ACCURACY) + floor
            if reach <= bar or _cover(hull, tree) <= bar or depth + 2 > len(stack):
                continue
            _cut(profile, k, patch, stack, depth)
            depth += 2
    return best


@kernel
def _spread(points, middle):  # type: ignore[no-untyped-def]
    """Return the largest distance of points from a center."""
    most = 0.0
    for k in range(len(points)):
        square = 0.0
        for i in range(3):
            square += (points[k, i] - middle[i]) ** 2
        most = max(most, square)
    return math.sqrt(most)


@kernel
def _cut(profile, k, patch, stack, depth):  # type: ignore[no-untyped-def]
    """Push both halves of a patch, bisected across its longer extent, on the stack."""
    rise, run = profile[k + 1, 0] - profile[k, 0], profile[k + 1, 1] - profile[k, 1]
    long = math.sqrt(rise * rise + run * run) * (patch[1] - patch[0])
    wide = (patch[3] - patch[2]) * max(profile[k, 1] + patch[0] * run, profile[k, 1] + patch[1] * run)
    first = 0 if long > wide else 2
    middle = 0.5 * (patch[first] + patch[first + 1])
    stack[depth] = patch
    stack[depth + 1] = patch
    stack[depth, first + 1] = middle
    stack[depth + 1, first] = middle
