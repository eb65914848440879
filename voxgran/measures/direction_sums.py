"""Sums over many directions: their products of four components, the waves of these, and their shares of cells.

One pass over the directions each, in their order, so that the sums do not depend on the number of threads.
"""

import math
from itertools import combinations_with_replacement, product

import numpy as np

from voxgran._base.arrays import Booleans, Floats
from voxgran._base.kernels import kernel

#: rings of an equal-area map around the cell of its pole
RINGS = 4
#: distance from the equator of a map at which a direction lies on it
ON_EQUATOR = 1e-9
#: directions that are added up before their sum is added to that of all
BLOCK = 512
#: at least the number of different products of four components; loops of this constant length run on vector units
WIDTH = 16


def multisets(d: int) -> list[tuple[int, ...]]:
    """Return the different products of four components, as sorted indices: 15 in space and 5 in the plane."""
    return list(combinations_with_replacement(range(d), 4))


def wave_signs(d: int) -> Floats:
    """Return the waves with one period, or none, along each axis, each without its opposite: (13, 3) or (4, 2)."""
    signs = np.array(list(product((0.0, 1.0, -1.0), repeat=d)))
    first = np.array([row[row != 0][:1].sum() for row in signs])
    return signs[first > 0]


def unit_vectors(vectors: Floats) -> tuple[Floats, Booleans]:
    """Return unit vectors along the vectors (m, d) that are not 0, of any length, and which these are."""
    found, kept = np.empty(vectors.shape), np.empty(len(vectors), dtype=np.bool_)
    many = int(_find_unit_vectors(vectors, found, kept))
    return found[:many], kept


def mean_products(way: Floats, share: Floats) -> Floats:
    """Return the sum (k,) of the products of four components of directions (m, d), each with its share (m,)."""
    d = way.shape[1]
    return _summed(way, share, way, np.zeros((0, d)))[0]


def wave_products(way: Floats, share: Floats, turns: Floats) -> Floats:
    """Return the waves (2 w, k) of the products of four components of directions (m, d) with their shares (m,).

    These are the sums with the cosines and then the sines of 2 pi times `wave_signs` times `turns` (m, d) as factors.
    """
    return _summed(way, share, turns, wave_signs(way.shape[1]))[1:]


def values_along(way: Floats, second: Floats, fourth: Floats) -> tuple[Floats, Floats]:
    """Return the values (m,) along directions (m, d) of two symmetric tensors.

    The tensor of fourth order is given by the sums (k,) of its equal components for each product of four components.
    """
    found = np.empty((2, len(way)))
    _find_values(way, np.ascontiguousarray(second), fourth, np.array(multisets(way.shape[1])), found)
    return found[0], found[1]


def shares_of_map(way: Floats, weight: Floats, pole: int) -> tuple[Floats, Floats]:
    """Return the sums of weights (m,), and of their squares, in the cells of an equal-area map of directions (m, 3).

    Each direction or its opposite lies on the hemisphere around the axis `pole`; both count half where both do.
    """
    sums = np.zeros((2, (2 * RINGS + 1) ** 2))
    _sum_over_map(way, weight, pole, sums)
    return sums[0], sums[1]


def _summed(way: Floats, share: Floats, turns: Floats, signs: Floats) -> Floats:
    """Return the sum of the products of four components and its waves, (1 + 2 w, k)."""
    sets = np.array(multisets(way.shape[1]))
    sums = np.zeros((1 + 2 * len(signs), len(sets)))
    _sum_products(way, share, np.ascontiguousarray(turns), signs, sets, sums)
    return sums


@kernel
def _find_unit_vectors(vectors, found, kept):  # type: ignore[no-untyped-def]
    """Write the unit vectors along the vectors that are not 0, one after the other; return how many these are."""
    many, d = 0, vectors.shape[1]
    for k in range(len(vectors)):
        largest = 0.0
        for i in range(d):
            largest = max(largest, abs(vectors[k, i]))
        kept[k] = largest > 0.0
        if not kept[k]:
            continue
        square = 0.0
        for i in range(d):
            # relative lengths, whose squares neither overflow nor vanish
            found[many, i] = vectors[k, i] / largest
            square += found[many, i] * found[many, i]
        length = math.sqrt(square)
        for i in range(d):
            found[many, i] /= length
        many += 1
    return many


@kernel
def _write_products(way, k, sets, row):  # type: ignore[no-untyped-def]
    """Write the products of four components of a direction."""
    for p in range(len(sets)):
        row[p] = way[k, sets[p, 0]] * way[k, sets[p, 1]] * (way[k, sets[p, 2]] * way[k, sets[p, 3]])


@kernel
def _sum_products(way, share, turns, signs, sets, sums):  # type: ignore[no-untyped-def]
    """Add the products of each direction and, with the cosine and sine of each wave, those of the waves.

    Sums of blocks lose fewer digits than one sum of all.
    """
    d, waves = way.shape[1], len(signs)
    row, cosine, sine, block = np.zeros(WIDTH), np.zeros(d), np.zeros(d), np.zeros((len(sums), WIDTH))
    for k in range(len(way)):
        if k % BLOCK == 0:
            sums += block[:, : len(sets)]
            block[:] = 0.0
        _write_products(way, k, sets, row)
        for p in range(len(sets)):
            row[p] *= share[k]
            block[0, p] += row[p]
        if waves == 0:
            continue
        for i in range(d):
            phase = 2.0 * math.pi * turns[k, i]
            cosine[i], sine[i] = math.cos(phase), math.sin(phase)
        for w in range(waves):
            # the wave is the product of those along the axes, as complex numbers
            a, b = 1.0, 0.0
            for i in range(d):
                if signs[w, i] != 0.0:
                    c, s = cosine[i], signs[w, i] * sine[i]
                    a, b = a * c - b * s, a * s + b * c
            for p in range(WIDTH):
                block[1 + w, p] += a * row[p]
            for p in range(WIDTH):
                block[1 + waves + w, p] += b * row[p]
    sums += block[:, : len(sets)]


@kernel
def _find_values(way, second, fourth, sets, found):  # type: ignore[no-untyped-def]
    """Write the values of two tensors along each direction."""
    d, row = way.shape[1], np.zeros(len(sets))
    for k in range(len(way)):
        one = two = 0.0
        for i in range(d):
            for j in range(d):
                one += way[k, i] * second[i, j] * way[k, j]
        _write_products(way, k, sets, row)
        for p in range(len(sets)):
            two += row[p] * fourth[p]
        found[0, k], found[1, k] = one, two


@kernel
def _sum_over_map(way, weight, pole, sums):  # type: ignore[no-untyped-def]
    """Add the weight of each direction, and its square, to the cells in which it and its opposite lie."""
    for k in range(len(way)):
        height = way[k, pole]
        part = 0.5 * weight[k] if abs(height) <= ON_EQUATOR else weight[k]
        for side in (1.0, -1.0):
            z = side * height
            if z < -ON_EQUATOR:
                continue
            radius = math.sqrt(max(1.0 - max(z, 0.0), 0.0)) * (2 * RINGS + 1)
            ring = min(int((radius + 1.0) / 2.0), RINGS)
            cell = 0
            if ring > 0:
                angle = math.atan2(side * way[k, (pole + 2) % 3], side * way[k, (pole + 1) % 3])
                place = math.floor(angle / (2.0 * math.pi) * (8 * ring) + 0.5)
                cell = (2 * ring - 1) ** 2 + place % (8 * ring)
            sums[0, cell] += part
            sums[1, cell] += part * part
