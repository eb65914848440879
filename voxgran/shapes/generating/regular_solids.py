"""Corners of the five Platonic and the thirteen Archimedean solids, exact to rounding.

All solids are centered at the origin. Snub solids have a handedness: the negative of their corners is the mirror image.
"""

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Literal

import numpy as np

from voxgran._base.arrays import Floats

PlatonicSolid = Literal["tetrahedron", "cube", "octahedron", "dodecahedron", "icosahedron"]
ArchimedeanSolid = Literal[
    "truncated_tetrahedron",
    "cuboctahedron",
    "truncated_cube",
    "truncated_octahedron",
    "rhombicuboctahedron",
    "truncated_cuboctahedron",
    "snub_cube",
    "icosidodecahedron",
    "truncated_dodecahedron",
    "truncated_icosahedron",
    "rhombicosidodecahedron",
    "truncated_icosidodecahedron",
    "snub_dodecahedron",
]

#: golden ratio and square root of 2
GOLDEN, ROOT = (1.0 + 5.0**0.5) / 2.0, 2.0**0.5
#: cyclic permutations of three coordinates, which are the even ones, and all of them
EVEN = ((0, 1, 2), (1, 2, 0), (2, 0, 1))
ALL = tuple(itertools.permutations(range(3)))


def corners_of(solid: PlatonicSolid | ArchimedeanSolid) -> Floats:
    """Return the corners (n, 3) of a solid."""
    g, r = GOLDEN, ROOT
    if solid == "tetrahedron":
        return _orbit([(1, 1, 1)], EVEN, parity=1)
    if solid == "truncated_tetrahedron":
        return _orbit([(3, 1, 1)], EVEN, parity=1)
    if solid == "snub_cube":
        return _snub_cube()
    if solid == "snub_dodecahedron":
        return _snub_dodecahedron()
    cubic: dict[str, tuple[float, float, float]] = {
        "cube": (1, 1, 1),
        "octahedron": (1, 0, 0),
        "cuboctahedron": (1, 1, 0),
        "truncated_cube": (r - 1, 1, 1),
        "truncated_octahedron": (0, 1, 2),
        "rhombicuboctahedron": (1, 1, 1 + r),
        "truncated_cuboctahedron": (1, 1 + r, 1 + 2 * r),
    }
    if solid in cubic:
        return _orbit([cubic[solid]], ALL)
    icosahedral: dict[str, list[tuple[float, float, float]]] = {
        "dodecahedron": [(1, 1, 1), (0, 1 / g, g)],
        "icosahedron": [(0, 1, g)],
        "icosidodecahedron": [(0, 0, 2 * g), (1, g, g * g)],
        "truncated_dodecahedron": [(0, 1 / g, 2 + g), (1 / g, g, 2 * g), (g, 2, g + 1)],
        "truncated_icosahedron": [(0, 1, 3 * g), (1, 2 + g, 2 * g), (g, 2, 2 * g + 1)],
        "rhombicosidodecahedron": [(1, 1, g**3), (g * g, g, 2 * g), (2 + g, 0, g * g)],
        "truncated_icosidodecahedron": [
            (1 / g, 1 / g, 3 + g),
            (2 / g, g, 1 + 2 * g),
            (1 / g, g * g, 3 * g - 1),
            (2 * g - 1, 2, 2 + g),
            (g, 3, 2 * g),
        ],
    }
    return _orbit(icosahedral[solid], EVEN)


def _orbit(points: Iterable[Sequence[float]], orders: Iterable[Sequence[int]], *, parity: int = 0) -> Floats:
    """Return some permutations of points with all signs, each once; parity 1 or -1 is that of the signs."""
    found = {
        tuple(float(point[k]) * sign + 0.0 for k, sign in zip(order, signs, strict=True))
        for point in points
        for order in orders
        for signs in _signs(parity)
    }
    return np.array(sorted(found))


def _signs(parity: int) -> Iterator[tuple[int, int, int]]:
    """Return the signs of three coordinates, all or those whose product is the parity."""
    for a, b, c in itertools.product((1, -1), repeat=3):
        if parity in (0, a * b * c):
            yield a, b, c


def _snub_cube() -> Floats:
    """Return the corners of a snub cube from the tribonacci constant t, the real root of t^3 = t^2 + t + 1."""
    t = (1 + (19 + 3 * 33**0.5) ** (1 / 3) + (19 - 3 * 33**0.5) ** (1 / 3)) / 3
    odd = [order for order in ALL if order not in EVEN]
    return np.concatenate([_orbit([(1, 1 / t, t)], EVEN, parity=1), _orbit([(1, 1 / t, t)], odd, parity=-1)])


def _snub_dodecahedron() -> Floats:
    """Return the corners of a snub dodecahedron from the real root x of x^3 - 2 x = golden ratio."""
    g = GOLDEN
    inner = math.sqrt(g - 5 / 27)
    x = ((g + inner) / 2) ** (1 / 3) + ((g - inner) / 2) ** (1 / 3)
    a, b = x - 1 / x, x * g + g * g + g / x
    points = [
        (2 * a, 2, 2 * b),
        (a + b / g + g, -a * g + b + 1 / g, a / g + b * g - 1),
        (a + b / g - g, a * g - b + 1 / g, a / g + b * g + 1),
        (-a / g + b * g + 1, -a + b / g - g, a * g + b - 1 / g),
        (-a / g + b * g - 1, a - b / g - g, a * g + b + 1 / g),
    ]
    return _orbit(points, EVEN, parity=-1)
