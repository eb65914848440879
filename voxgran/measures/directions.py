"""Distributions of directions: fabric tensors, their anisotropy with standard errors, and roses.

A direction n and its opposite are equivalent. The fabric tensors of order 2 and 4 are the means of n n and n n n n. The
density of directions, relative to that of an isotropic distribution, is to fourth order ::

    1 + D_ij n_i n_j + D_ijkl n_i n_j n_k n_l

where D are the fabric tensors of the third kind of Kanatani 1984, doi:10.1016/0020-7225(84)90055-7: the traceless parts
of the means, times 15/2 and 315/8 in space and 4 and 16 in the plane. The anisotropy of an order is the invariant of
its tensor that is the amplitude a of a distribution around one axis: 1 + a cos 2t (Rothenburg & Bathurst 1989,
doi:10.1680/geot.1989.39.4.601) and 1 + a cos 4t in the plane; 1 + a P_2(cos t) and 1 + a P_4(cos t) in space, with the
Legendre polynomials P. In space the second one is 5 times the nematic order parameter, and 2/3 of sqrt(3/2 D_ij D_ij).

Sums over many directions take one pass over them, in their order, so that they do not depend on the number of threads.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement, permutations, product

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Booleans, Floats

#: factor of the traceless part in the tensor D, squared norm of the traceless part for a single direction, and factor
#: of the norm of D in the anisotropy; by dimension and order
FACTOR = {(2, 2): 4.0, (2, 4): 16.0, (3, 2): 15 / 2, (3, 4): 315 / 8}
SINGLE = {(2, 2): 1 / 2, (2, 4): 1 / 8, (3, 2): 2 / 3, (3, 4): 8 / 35}
AMPLITUDE = {(2, 2): math.sqrt(1 / 2), (2, 4): math.sqrt(1 / 8), (3, 2): math.sqrt(2 / 3), (3, 4): math.sqrt(8 / 35)}
#: independent components of the traceless part
COMPONENTS = {(2, 2): 2, (2, 4): 2, (3, 2): 5, (3, 4): 9}
#: sectors of a rose over half a turn
SECTORS = 18


@dataclass(frozen=True, eq=False)
class Anisotropy:
    """Anisotropy of one order, with its tensor; NaN where it is not defined."""

    deviator: Floats  # D, (d, d) or (d, d, d, d)
    plain: float  # of the means as they are: above 0 also for a sample of an isotropic distribution
    unbiased: float  # less the scatter of as many independent directions; 0 where that is larger
    error: float  # standard error, for independent directions


@dataclass(frozen=True, eq=False)
class Fabric:
    """Fabric tensors of directions in d dimensions."""

    count: int
    second: Floats  # (d, d)
    fourth: Floats  # (d, d, d, d)
    second_order: Anisotropy
    fourth_order: Anisotropy


@dataclass(frozen=True, eq=False)
class Rose:
    """Density of directions in cells of equal size, relative to an isotropic distribution."""

    cells: Floats  # (k, 2, 2) from and to, of the angle from the pole and of the azimuth, in radians
    density: Floats  # (k,) 1 everywhere on average for an isotropic distribution; NaN without directions
    error: Floats  # (k,) standard error, for independent directions


def fabric_of(vectors: Floats, weights: Floats | None = None, *, dimension: int, turns: Floats | None = None) -> Fabric:
    """Return the fabric tensors of vectors (m, 3) of any length, weighted (m,) or alike.

    The square of the plain anisotropy exceeds that of the distribution, on average by the scatter of the mean; the
    unbiased one is the root of the difference. For independent directions of equal weights it is exactly unbiased.

    Directions in a packing are not independent: contacts of one grain exclude each other, so that the mean of their
    normals scatters less than that of as many independent ones, and neighbours may be alike. With `turns` (m, d), the
    places of the vectors in lengths of the sample, the scatter is that of the directions in the longest waves that fit
    the sample, 13 in space and 4 in the plane, and the standard error changes in proportion. It is the scatter of the
    mean where directions are correlated over distances that are small beside the sample.
    """
    way, weight, kept = _unit(vectors, weights, dimension)
    total, m, d = float(weight.sum()), len(way), dimension
    if not m or not total > 0.0:
        nowhere = [Anisotropy(np.full((d,) * order, math.nan), *(math.nan,) * 3) for order in (2, 4)]
        return Fabric(0, nowhere[0].deviator, nowhere[1].deviator, *nowhere)
    share = weight / total
    fourth = _tensor(mean_products(way, share), d)
    # the trace of n n is 1
    second = linear.einsum("ijkk->ij", fourth)
    parts = traceless_2(second), traceless_4(fourth)
    # the traceless means along each direction, whose means are their squared norms
    each = values_along(way, parts[0], _sums(parts[1]))
    scatters = (None, None) if turns is None or m < 2 else _scatters(way, share, turns[kept], parts)
    found = [
        _anisotropy(parts[k], each[k], share, dimension=d, order=order, scatter=scatters[k])
        for k, order in enumerate((2, 4))
    ]
    return Fabric(m, second, fourth, *found)


def _scatters(way: Floats, share: Floats, turns: Floats, parts: tuple[Floats, Floats]) -> tuple[float, float]:
    """Return the mean squares, in the longest waves, of the traceless parts of directions (m, d) less their means.

    A wave has one period in the sample, or none, along each axis: its phases are 2 pi times a sum of `turns` (m, d).
    """
    d = way.shape[1]
    waves = wave_products(way, share, turns)
    second = fourth = 0.0
    for wave in waves:
        whole = _tensor(wave, d)
        pairs = linear.einsum("ijkk->ij", whole)
        rest = float(np.trace(pairs))
        second += float(np.square(traceless_2(pairs) - rest * parts[0]).sum())
        fourth += float(np.square(traceless_4(whole) - rest * parts[1]).sum())
    # the squares of cosine and sine have the sum 1
    return 2.0 * second / len(waves), 2.0 * fourth / len(waves)


def _tensor(values: Floats, d: int) -> Floats:
    """Return the symmetric tensor (d, d, d, d) with these different components."""
    place = {some: k for k, some in enumerate(multisets(d))}
    index = [place[tuple(sorted(some))] for some in product(range(d), repeat=4)]
    return np.asarray(values[index].reshape((d,) * 4))


def _sums(tensor: Floats) -> Floats:
    """Return for each product of four components the sum of the equal components of a symmetric tensor."""
    d = len(tensor)
    return np.array([tensor[some] * len(set(permutations(some))) for some in multisets(d)])


def _anisotropy(
    part: Floats, each: Floats, share: Floats, *, dimension: int, order: int, scatter: float | None
) -> Anisotropy:
    """Return the anisotropy of the traceless part of a mean, which has the values `each` (m,) along the directions.

    `scatter` is the mean square of the error of the traceless part; that of independent directions where it is None.
    """
    key, m = (dimension, order), len(each)
    squared = float(np.square(part).sum())
    norm, factor = math.sqrt(squared), FACTOR[key] * AMPLITUDE[key]
    if m < 2:
        return Anisotropy(FACTOR[key] * part, factor * norm, math.nan, math.nan)
    more = m / (m - 1.0)
    independent = more * float((np.square(share) * (SINGLE[key] - 2.0 * each + squared)).sum())
    variance = more * float((np.square(share) * np.square(each - squared)).sum())
    if scatter is None or not independent > 0.0:
        scatter = max(independent, 0.0)
    else:
        variance *= scatter / independent
    # the square of the norm has 4 times this variance by the linear part of the error, and by its quadratic part twice
    # the squared scatter of each component, of which a norm below the scatter tells too much
    variance += 0.5 * scatter**2 / COMPONENTS[key] * min(squared / scatter, 1.0) if scatter > 0.0 else 0.0
    return Anisotropy(
        FACTOR[key] * part,
        factor * norm,
        factor * math.sqrt(max(squared - scatter, 0.0)),
        factor * math.sqrt(variance) / norm if norm > 0.0 else 0.0,
    )


def traceless_2(mean: Floats) -> Floats:
    """Return the traceless part of a symmetric tensor (d, d)."""
    d = len(mean)
    return np.asarray(mean - np.trace(mean) / d * np.eye(d))


def traceless_4(mean: Floats) -> Floats:
    """Return the traceless part of a fully symmetric tensor (d, d, d, d)."""
    d = len(mean)
    trace = linear.einsum("ijkk->ij", mean)
    one = np.eye(d)
    first, second = _symmetric(np.multiply.outer(one, trace)), _symmetric(np.multiply.outer(one, one))
    whole = float(np.trace(trace))
    return np.asarray(mean - 6.0 / (d + 4.0) * first + 3.0 * whole / ((d + 2.0) * (d + 4.0)) * second)


def _symmetric(tensor: Floats) -> Floats:
    """Return the mean of a tensor (d, d, d, d) over all orders of its indices."""
    return np.asarray(sum(np.transpose(tensor, order) for order in permutations(range(4))) / 24.0)


def fitted_density(second: Floats, directions: Floats) -> Floats:
    """Return the density of directions (m, d) relative to an isotropic one to second order, (m,), of a tensor D."""
    return np.asarray(1.0 + linear.einsum("ci,ij,cj->c", directions, second, directions))


def rose_of(vectors: Floats, weights: Floats | None = None, *, dimension: int, pole: int = 2) -> Rose:
    """Return the rose of vectors (m, 3) of any length, weighted (m,) or alike.

    In the plane its cells are 18 sectors over half a turn, of which the first is centered at x. In space they are 81
    cells of equal area on the hemisphere around an axis, the `pole`: a cap and rings k = 1 to 4 of 8 k cells each, that
    are bounded by equal steps of the radius of Lambert's azimuthal equal-area projection.
    """
    way, weight, _ = _unit(vectors, weights, dimension)
    cells = _sectors() if dimension == 2 else _sphere_cells()
    k = len(cells)
    if dimension == 2:
        turn = np.mod(libm.arctan2(way[:, 1], way[:, 0]) / np.pi * SECTORS + 0.5, SECTORS)
        index = np.minimum(turn.astype(np.int64), SECTORS - 1)
        held = np.asarray(np.bincount(index, weights=weight, minlength=k), dtype=np.float64)
        squared = np.asarray(np.bincount(index, weights=np.square(weight), minlength=k), dtype=np.float64)
    else:
        held, squared = shares_of_map(way, weight, pole)
    total = float(weight.sum())
    if not len(way) or not total > 0.0:
        return Rose(cells, np.full(k, math.nan), np.full(k, math.nan))
    share = held / total
    # variance of a ratio of sums: sum of w^2 (inside - share)^2 over (sum of w)^2
    spread = np.sqrt(squared * (1.0 - 2.0 * share) + np.square(share) * squared.sum()) / total
    return Rose(cells, k * share, k * spread)


def _sectors() -> Floats:
    """Return the sectors of a rose in the plane, whose angle from the pole is a right one."""
    edges = (np.arange(SECTORS + 1) - 0.5) * np.pi / SECTORS
    azimuth = np.column_stack([edges[:-1], edges[1:]])
    return np.stack([np.full_like(azimuth, np.pi / 2), azimuth], axis=1)


def _sphere_cells() -> Floats:
    """Return the cells of an equal-area map, ring by ring."""
    cells = [[[0.0, _colatitude(1)], [-np.pi, np.pi]]]
    for ring in range(1, RINGS + 1):
        step = 2.0 * np.pi / (8 * ring)
        polar = [_colatitude(2 * ring - 1), _colatitude(2 * ring + 1)]
        cells += [[polar, [(k - 0.5) * step, (k + 0.5) * step]] for k in range(8 * ring)]
    return np.array(cells)


def _colatitude(steps: int) -> float:
    """Return the angle from the pole at a radius of so many steps of the map, of 9 in all."""
    return math.acos(max(1.0 - (steps / (2 * RINGS + 1)) ** 2, 0.0))


def _unit(vectors: Floats, weights: Floats | None, dimension: int) -> tuple[Floats, Floats, Booleans]:
    """Return unit vectors (m, d) and weights (m,) of all vectors that are not 0, and which they are."""
    way = np.asarray(vectors, dtype=np.float64).reshape(-1, 3)[:, :dimension]
    unit, kept = unit_vectors(np.ascontiguousarray(way))
    weight = np.ones(len(unit)) if weights is None else np.asarray(weights, dtype=np.float64)[kept]
    top = float(weight.max(initial=0.0))
    return unit, weight / top if top > 0.0 else weight, kept


#: rings of an equal-area map around the cell of its pole
RINGS = 4
#: distance from the equator of a map at which a direction lies on it
ON_EQUATOR = 1e-9
#: directions whose products are held at once
BLOCK = 4096


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
    largest = np.abs(vectors).max(axis=1, initial=0.0)
    kept = largest > 0.0
    # relative lengths, whose squares neither overflow nor vanish
    found = vectors[kept] / largest[kept, None]
    found /= np.sqrt(linear.einsum("mi,mi->m", found, found))[:, None]
    return found, kept


def mean_products(way: Floats, share: Floats) -> Floats:
    """Return the sum (k,) of the products of four components of directions (m, d), each with its share (m,)."""
    return np.asarray(sum(linear.einsum("km,m->k", _products(way[some]), share[some]) for some in _blocks(way)))


def wave_products(way: Floats, share: Floats, turns: Floats) -> Floats:
    """Return the waves (2 w, k) of the products of four components of directions (m, d) with their shares (m,).

    These are the sums with the cosines and then the sines of 2 pi times `wave_signs` times `turns` (m, d) as factors.
    """
    signs = wave_signs(way.shape[1])
    total = np.zeros((2 * len(signs), len(multisets(way.shape[1]))))
    for some in _blocks(way):
        angle = 2 * np.pi * turns[some].T
        along = list(zip(libm.cos(angle), libm.sin(angle), strict=True))
        waves = np.array([_wave(row, along) for row in signs])
        total += linear.matmul(share[some] * np.concatenate([waves[:, 0], waves[:, 1]]), _products(way[some]).T)
    return total


def _wave(signs: Floats, along: Sequence[tuple[Floats, Floats]]) -> tuple[Floats, Floats]:
    """Return the cosine and the sine of a sum of angles, each with a sign or 0, from theirs.

    Products of complex numbers of NumPy would have other bits on other processors.
    """
    cosine, sine = np.ones_like(along[0][0]), np.zeros_like(along[0][0])
    for sign, (c, s) in zip(signs, along, strict=True):
        if sign:
            cosine, sine = cosine * c - sign * sine * s, sine * c + sign * cosine * s
    return cosine, sine


def values_along(way: Floats, second: Floats, fourth: Floats) -> tuple[Floats, Floats]:
    """Return the values (m,) along directions (m, d) of two symmetric tensors.

    The tensor of fourth order is given by the sums (k,) of its equal components for each product of four components.
    """
    fourths = [linear.einsum("k,km->m", fourth, _products(way[some])) for some in _blocks(way)]
    return (linear.matmul(way, second) * way).sum(axis=1), np.concatenate(fourths)


def shares_of_map(way: Floats, weight: Floats, pole: int) -> tuple[Floats, Floats]:
    """Return the sums of weights (m,), and of their squares, in the cells of an equal-area map of directions (m, 3).

    Each direction or its opposite lies on the hemisphere around the axis `pole`; both count half where both do.
    """
    part = np.where(np.abs(way[:, pole]) <= ON_EQUATOR, 0.5 * weight, weight)
    sums = np.zeros((2, (2 * RINGS + 1) ** 2))
    for side in (way, -way):
        kept = side[:, pole] >= -ON_EQUATOR
        x, y, z = side[kept][:, np.arange(pole + 1, pole + 4) % 3].T
        radius = np.sqrt(np.maximum(1.0 - np.maximum(z, 0.0), 0.0)) * (2 * RINGS + 1)
        ring = np.minimum((radius + 1.0) / 2.0, RINGS).astype(np.int64)
        many = np.maximum(8 * ring, 1)
        place = np.floor(libm.arctan2(y, x) / (2.0 * np.pi) * many + 0.5).astype(np.int64) % many
        cell = np.where(ring > 0, (2 * ring - 1) ** 2 + place, 0)
        sums += [np.bincount(cell, held, sums.shape[1]) for held in (part[kept], part[kept] ** 2)]
    return sums[0], sums[1]


def _products(way: Floats) -> Floats:
    """Return the products (k, m) of four components of directions (m, d)."""
    rows = np.ascontiguousarray(way.T)
    return np.array([rows[a] * rows[b] * (rows[c] * rows[e]) for a, b, c, e in multisets(len(rows))])


def _blocks(way: Floats) -> list[slice]:
    """Return the rows of an array, in blocks."""
    return [slice(start, start + BLOCK) for start in range(0, len(way), BLOCK)]
