"""Overlaps of convex solids of which one is so thin that distances lose the digits of its width.

The Minkowski difference of crossing needles is as flat as they are wide. Space is stretched so that it is about as wide
in all directions, which leaves solids that meet solids that meet; there the factor on the sizes of both solids, in
place, is found at which they touch. It is the largest value of n.o / (h(n) + g(n)) over all normals n, where o is the
offset of the centers and h and g are the reaches of the solids along n and -n (Dinkelbach 1967,
doi:10.1287/mnsc.13.7.492); from below it is found by distances of smaller solids.

The solids are the rows of :mod:`voxgran.geometry.support`, with a margin around them.
"""

import math

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel, kernel
from voxgran.geometry.gjk import Accuracy, Simplex, search_distance
from voxgran.geometry.support import support
from voxgran.geometry.vectors import Vector, cross, dot, rotate, rotate_back, row_of, times, vector_at

#: ratio of the largest to the smallest extent above which a solid is thin; it is less for ellipsoids, whose erosion is
#: exact up to the smallest radius of curvature only
THIN, THIN_ELLIPSOID = 1e5, 100.0
#: when a distance is found, how often the factor is improved, and by how much at least
FINE, MOST_FACTORS, GAINED = Accuracy(0.0, 1e-12, 500, 20), 60, 1e-13


@bare_kernel
def half_extents(row: Floats, margin: float) -> Vector:
    """Return the extents from the center of a row with a margin along its axes, the larger one of each."""
    a, b, c, kind = row[1], row[2], row[3], int(row[0])
    if kind == 2:
        a, b, c = 0.5 * a, 0.5 * b, 0.5 * c
    elif kind == 3:
        a, b, c = a, a, 0.5 * b
    elif kind == 4:
        a, b, c = a, a, 0.75 * b
    elif kind != 1:
        a, b, c = 0.0, 0.0, 0.5 * b
    return a + margin, b + margin, c + margin


@bare_kernel
def thickness(row: Floats, margin: float) -> float:
    """Return the smallest extent of a thin row with a margin; infinity if it is not thin, or is a triangle."""
    extents = half_extents(row, margin)
    aspect = THIN_ELLIPSOID if row[0] == 1.0 else THIN
    return 2.0 * min(extents) if row[0] != 5.0 and max(extents) > aspect * min(extents) else np.inf


@bare_kernel
def _reach(solid, at, x, y, z):  # type: ignore[no-untyped-def]
    """Return the support point of a row with a margin, multiplied by a factor, in the stretched frame."""
    row, margin, factor, stretch = solid
    point = rotate(stretch, times(_corner(row, margin, rotate_back(stretch, (x, y, z))), factor))
    return point[0], point[1], point[2], at


@bare_kernel
def _corner(row, margin, normal):  # type: ignore[no-untyped-def]
    """Return the support point of a row with a margin."""
    x, y, z = normal
    px, py, pz = support(row, 0.0, x, y, z)
    share = margin / max(math.sqrt(dot(normal, normal)), 1e-300)
    return px + share * x, py + share * y, pz + share * z


@bare_kernel
def _reaches(one, margin, other, other_margin, normal):  # type: ignore[no-untyped-def]
    """Return how far the first solid reaches along a normal and the second one against it, in all."""
    return dot(normal, _corner(one, margin, normal)) - dot(normal, _corner(other, other_margin, times(normal, -1.0)))


@kernel
def _axes_of(one, margin, other, other_margin, axes, stretch):  # type: ignore[no-untyped-def]
    """Write the directions in which both solids are longest, and the matrix that makes all of these alike."""
    edges = np.zeros((6, 3))
    for k in range(3):
        mine, its = half_extents(one, margin), half_extents(other, other_margin)
        for c in range(3):
            edges[k, c] = mine[k] * (one[4 + 3 * c + k] if one[0] > 0.0 else (1.0 if c == k else 0.0))
            edges[3 + k, c] = its[k] * (other[4 + 3 * c + k] if other[0] > 0.0 else (1.0 if c == k else 0.0))
    for k in range(2):
        longest, most = (0.0, 0.0, 0.0), -1.0
        for t in range(6):
            rest = row_of(edges, t)
            for _ in range(2):
                for q in range(k):
                    along = dot(rest, row_of(axes, q))
                    rest = (rest[0] - along * axes[q, 0], rest[1] - along * axes[q, 1], rest[2] - along * axes[q, 2])
            if dot(rest, rest) > most:
                longest, most = rest, dot(rest, rest)
        for c in range(3):
            axes[k, c] = longest[c] / math.sqrt(most)
    third = cross(row_of(axes, 0), row_of(axes, 1))
    for c in range(3):
        axes[2, c] = third[c]
    for k in range(3):
        width = 0.0
        for t in range(6):
            width = max(width, abs(dot(row_of(axes, k), row_of(edges, t))))
        for c in range(3):
            stretch[k, c] = axes[k, c] / width


@kernel
def thin_overlap(
    one: Floats, margin: float, other: Floats, other_margin: float, offset: Floats, contact: Floats
) -> float:
    """Return how deep two solids overlap along the normal along which that is least; 0 if they are separate.

    The normal and the middle point are written to the contact from its second number on. The depth is no more than
    half of the thickness of the thicker solid.
    """
    place, factor = vector_at(offset, 0), 0.0
    simplex = Simplex(np.zeros((4, 3)), np.zeros((4, 3)), np.zeros(4), np.zeros(6), np.zeros((4, 2), dtype=np.int64))
    axes, stretch = np.zeros((3, 3)), np.zeros((3, 3))
    _axes_of(one, margin, other, other_margin, axes, stretch)
    normal = found = place
    for _ in range(MOST_FACTORS):
        reach = _reaches(one, margin, other, other_margin, found)
        better = dot(found, place) / reach if reach > 0.0 else 0.0
        if better >= 1.0:
            return 0.0
        if better <= factor + GAINED:
            break
        factor, normal = better, found
        # a little smaller, so that the solids are separate
        size, away = factor * (1.0 - 1e-9), rotate(stretch, place)
        bodies = (one, margin, size, stretch), (other, other_margin, size, stretch)
        if search_distance(_reach, bodies[0], bodies[1], away, away, 1e150, FINE, True, simplex, 0) <= 0.0:
            break
        found = rotate_back(stretch, vector_at(simplex.near, 0))
    least = 1e300
    for k in range(7):
        # others than that of the factor may be nearer where overlaps are deep
        direction = normal if k == 0 else times(row_of(axes, (k - 1) % 3), 1.0 if k < 4 else -1.0)
        length = math.sqrt(dot(direction, direction))
        if length == 0.0:
            continue
        direction = times(direction, 1.0 / length)
        depth = _reaches(one, margin, other, other_margin, direction) - dot(direction, place)
        if depth < least:
            least = depth
            corner = _corner(one, margin, direction)
            for c in range(3):
                contact[1 + c], contact[4 + c] = direction[c], corner[c] - 0.5 * depth * direction[c]
    return min(least, max(min(half_extents(one, margin)), min(half_extents(other, other_margin))))
