"""Radial distribution function and structure factor of the centroids.

The structure factor is computed on the vectors of a reciprocal lattice, or from the radial distribution function:
``S(k) = |sum of exp(-i k x)|**2 / n``; it is 1 on average for independent points, and tends to the relative variance of
numbers of points in large windows where k tends to 0 (Hansen & McDonald, Theory of Simple Liquids).
"""

import math
from dataclasses import dataclass

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, Integers, as_length, as_number
from voxgran._base.errors import InputError, PackingWarning, warn
from voxgran._base.kernels import kernel
from voxgran._base.lazy import load
from voxgran._base.seeds import stream
from voxgran.containers.model import periods_of
from voxgran.measures.model import Groups, Measure, dataset, length_unit, variable
from voxgran.measures.pair_sums import PairSums, pair_sums
from voxgran.measures.pair_window import PairWindow
from voxgran.measures.registered.coordination import mean_diameter
from voxgran.packing.model import Packing

#: default reach, in mean diameters or, in sparse packings, in mean spacings, and width of bins in mean diameters
REACH, STEP, MOST_BINS = 5.0, 0.05, 400
#: distance from the walls at which weights are above 0, and over which they rise to 1, in mean diameters
INSET, RISE = 1.0, 1.0
#: largest wave number and width of the shells, times the mean diameter
WAVE_REACH, WAVE_STEP = 25.0, 0.2


@dataclass(frozen=True, eq=False)
class RadialDistribution:
    """Radial distribution function in bins of the distance of two centroids."""

    edges: Floats  # (k + 1,) edges of the bins, in the unit of lengths
    g: Floats  # (k,) density of pairs over that of independent points; NaN for fewer than two grains
    error: Floats  # (k,) standard error
    neighbours: Floats  # (k,) mean number of other centroids up to the outer edge of each bin, without walls
    pairs: Floats  # (k,) number of pairs in each bin
    count: int  # grains with their centroids in the window
    density: float  # their number over the volume of the window

    @property
    def middle(self) -> Floats:
        """Middles of the bins, (k,)."""
        return (self.edges[1:] + self.edges[:-1]) / 2


def radial_distribution(
    packing: Packing, *, reach: float | None = None, step: float | None = None, inset: float | None = None
) -> RadialDistribution:
    """Return the radial distribution function g(r) of the centroids.

    It is the number of pairs in each bin over that of independent points. Along walls the centroids have weights, which
    rise from 0 to 1 over a mean diameter, and pairs are compared with the autocorrelation of these weights
    (:mod:`voxgran.measures.pair_window`): so it is unbiased up to the walls, where the packing is homogeneous and
    isotropic. The autocorrelation is exact in boxes and rectangles; in other containers its relative error is below
    0.002.

    Parameters
    ----------
    packing : Packing
        The packing.
    reach : float, optional
        Largest distance, in the unit of lengths: at most half the shortest edge of the window. Default: five mean
        diameters, in sparse packings five times the mean spacing of the centroids, or that half.
    step : float, optional
        Width of the bins. The first one reaches from 0 to half a step, so that multiples of the step are middles of
        bins. Default: a twentieth of the mean diameter.
    inset : float, optional
        Distance from the walls from which weights are above 0. Default: a mean diameter; so the part that counts is on
        average that of the bulk solid fraction, and the layers at the walls do not count. With gravity only the part
        below the height up to which 85 % of the volume of the grains lies is counted.

    Returns
    -------
    RadialDistribution
        The standard error is that of a jackknife over the grains, without the part that counts each pair twice; it is
        exact for independent points, and 0 where all grains have equal numbers of neighbours.

    Raises
    ------
    InputError
        If the reach is beyond half the shortest edge of the window, or a length is not above 0.

    Examples
    --------
    >>> import voxgran as vg
    >>> from voxgran.measures.registered.rdf import radial_distribution
    >>> box = vg.Box((8, 8, 8), periodic="xyz")
    >>> position = [[x + 0.5, y + 0.5, z + 0.5] for x in range(8) for y in range(8) for z in range(8)]
    >>> found = radial_distribution(vg.Packing.of([vg.make_shape("sphere")], box, position=position), reach=1.2)
    >>> float(found.neighbours[-1].round(9))
    6.0
    """
    diameter = mean_diameter(packing)
    least = INSET * diameter if inset is None else as_number(inset, "inset", at_least=0.0)
    window = PairWindow.of(packing, least, rise=RISE * diameter)
    weights = window.weights(packing.position)
    points, weights = packing.position[weights > 0], weights[weights > 0]
    edges = _bins(window, diameter, len(points), reach, step)
    count, bins = len(points), len(edges) - 1
    if count < 2 or not bins:
        if packing.count > 1:
            warn(
                f"the window of the radial distribution function holds {count} of the centroids: it needs at least 2; "
                "take more grains, a larger container or a smaller inset",
                PackingWarning,
            )
        none = np.full(bins, np.nan)
        density = float(weights.sum()) / window.volume if window.volume > 0 else math.nan
        return RadialDistribution(edges, none, none, none, np.zeros(bins), count, density)
    sums = _sums(window, points, weights, edges)
    whole = float(weights.sum())
    other = weights * (whole - weights)
    all_pairs = float(other.sum())
    expected = all_pairs * window.pair_shares(edges)
    # jackknife over the grains; it counts the part of the variance that is of pairs, not of points, twice
    mean = sums.weight / all_pairs
    spread = sums.squares - 2 * mean * sums.cross + mean**2 * (other**2).sum()
    spread = np.maximum(spread, 0.0) * (count / (count - 1))
    variance = 4 * np.maximum(spread / 2, spread - sums.own / 2)
    g = sums.weight / expected
    rings = np.diff(libm.power(edges / edges[-1], packing.dimension))
    free = rings * _sphere(edges[-1], packing.dimension) / window.volume
    neighbours = np.cumsum(g * free) * (all_pairs / whole)
    error, density = np.sqrt(variance) / expected, whole / window.volume
    return RadialDistribution(edges, g, error, neighbours, sums.pairs / 2, count, density)


@dataclass(frozen=True, eq=False)
class StructureFactor:
    """Structure factor by wave number."""

    wave_number: Floats  # (k,) mean of the vectors of each shell, in radians per unit of length
    value: Floats  # (k,) mean over the vectors of a shell, or transform of g(r)
    error: Floats  # (k,) standard error
    vectors: Integers  # (k,) number of vectors of a shell, those of opposite sign once; 0 from g(r)


def structure_factor(packing: Packing, *, reach: float | None = None) -> StructureFactor:
    """Return the structure factor S(k) of the centroids up to a wave number.

    Where all axes are periodic it is exact on each vector of the reciprocal lattice: means over shells 0.2 mean
    diameters wide of at most 60 vectors. In other containers it is the transform of :func:`radial_distribution` with
    Lorch's window, from the wave number ``2 pi / R`` of its reach R.

    Parameters
    ----------
    packing : Packing
        The packing.
    reach : float, optional
        Largest wave number, in radians per unit of length. Default: 25 over the mean diameter.

    Raises
    ------
    InputError
        If the reach is not above 0.
    """
    if reach is not None:
        reach = as_number(reach, "reach", above=0.0)
    periodic = all(packing.container.periodic[: packing.dimension])
    return _structure(packing, None if periodic or packing.count < 2 else radial_distribution(packing), reach)


def _structure(packing: Packing, found: RadialDistribution | None, reach: float | None = None) -> StructureFactor:
    """Return the structure factor; of a packing with walls from its radial distribution function."""
    d, diameter = packing.dimension, mean_diameter(packing)
    none = np.zeros(0)
    if not packing.count:
        return StructureFactor(none, none, none, np.zeros(0, np.int64))
    # lengths in mean diameters
    furthest = WAVE_REACH if reach is None else reach * diameter
    if all(packing.container.periodic[:d]):
        places = (packing.position - packing.container.bounds[0])[:, :d] / diameter
        periods = periods_of(packing.container)[:d, :d] / diameter
        made = lattice_structure(places, periods, reach=furthest, step=WAVE_STEP)
    elif found is None or found.count < 2 or not len(found.g):
        return StructureFactor(none, none, none, np.zeros(0, np.int64))
    else:
        edges = found.edges / diameter
        waves = np.arange(2 * math.pi / edges[-1], furthest, WAVE_STEP)
        density = found.density * diameter**d
        made = transformed_structure(edges, found.g, found.error, density=density, dimension=d, waves=waves)
    return StructureFactor(made.wave_number / diameter, made.value, made.error, made.vectors)


def _bins(window: PairWindow, diameter: float, count: int, reach: float | None, step: float | None) -> Floats:
    """Return the edges of the bins, (k + 1,)."""
    d, most = window.packing.dimension, window.reach
    if reach is not None and as_length(reach, "reach") > most * (1 + 1e-12):
        raise InputError(
            f"reach is {reach:g}: it must be at most half the shortest edge of the window, {most:g}; "
            "take a smaller one, a larger container or a smaller inset"
        )
    if step is not None:
        step = as_length(step, "step")
    if not diameter or most <= 0:
        return np.zeros(1)
    # mean spacing of the centroids
    spacing = float(np.prod(window.edges / window.edges.max()) / max(count, 1)) ** (1 / d) * window.edges.max()
    end = min(REACH * max(diameter, spacing), most) if reach is None else float(reach)
    width = max(STEP * diameter, end / MOST_BINS) if step is None else step
    bins = math.floor(end / width * (1 + 1e-12) + 0.5)
    return np.concatenate([np.zeros(1), (np.arange(bins) + 0.5) * width]) if bins else np.zeros(1)


def _sums(window: PairWindow, points: Floats, weights: Floats, edges: Floats) -> PairSums:
    """Return the sums over the pairs of points in bins."""
    # lengths in steps: no power of a length overflows
    step = 2 * edges[1]
    periods = periods_of(window.packing.container) / step
    return pair_sums(points / step, weights, 1.0, len(edges) - 1, periods=periods)


def _sphere(radius: float, dimension: int) -> float:
    """Return the volume of a sphere, the area of a disk in 2D."""
    return 4 / 3 * math.pi * radius**3 if dimension == 3 else math.pi * radius**2


def _compute(packing: Packing) -> Groups:
    """Return the radial distribution function and the structure factor."""
    found, diameter = radial_distribution(packing), mean_diameter(packing)
    structure = _structure(packing, found)
    row, waves = ("pair_distance",), ("wave_number",)
    way = "on the reciprocal lattice" if structure.vectors.any() else "from g(r) with Lorch's window"
    unit = length_unit(packing, power=-packing.dimension)
    values = {
        "radial_distribution": variable(row, found.g, "1", "radial distribution function of the centroids"),
        "radial_distribution_error": variable(row, found.error, "1", "standard error of g(r)"),
        "neighbours_within": variable(
            row, found.neighbours, "1", "mean number of other centroids up to the outer edge of each bin"
        ),
        "structure_factor": variable(waves, structure.value, "1", f"structure factor of the centroids, {way}"),
        "structure_factor_error": variable(waves, structure.error, "1", "standard error of S(k)"),
    }
    scale = diameter or 1.0
    coordinates = {
        "pair_distance": variable(row, found.middle / scale, "1", "distance of centroids, in mean diameters"),
        "wave_number": variable(waves, structure.wave_number * scale, "1", "wave number times mean diameter"),
    }
    numbers = {
        "pair_window_count": variable((), found.count, "1", "number of centroids in the window of g(r)"),
        "number_density": variable((), found.density, unit, "number of these centroids over the size of the window"),
    }
    return {"/": dataset(numbers), "/profiles": dataset(values, coordinates)}


registration = Measure(
    summary="radial distribution function and structure factor of the centroids, with standard errors",
    groups=("/", "/profiles"),
    compute=_compute,
    tilted=True,
    usual=False,
)


#: vectors of a shell, at most: half of all, since those of opposite sign have the same value
MOST_VECTORS = 60


def lattice_structure(points: Floats, periods: Floats, *, reach: float, step: float) -> StructureFactor:
    """Return the structure factor of points (n, d) with the periods (d, d), in shells of width `step` up to `reach`.

    It is exact on each vector of the reciprocal lattice; of a shell with more than 60, 60 are drawn.
    """
    chosen = _vectors(periods, reach, step)
    length = linear.norm(linear.matmul(chosen, reciprocal(periods)), axis=1)
    power = np.zeros(len(chosen))
    d, turns = len(periods), np.zeros((len(points), 3))
    turns[:, :d] = linear.solve(periods.T, points.T).T % 1.0 * 2 * np.pi
    vectors = np.zeros((len(chosen), 3), np.int64)
    vectors[:, :d] = chosen
    if len(points) and len(chosen):
        real, imaginary = np.zeros(len(chosen)), np.zeros(len(chosen))
        _add_waves(turns, vectors, np.abs(vectors).max(axis=0), real, imaginary)
        power = (real**2 + imaginary**2) / len(points)
    shell = np.floor(length / step).astype(np.int64)
    many = np.bincount(shell)
    kept = many > 0
    divide = np.maximum(many, 1)
    mean = np.bincount(shell, weights=power) / divide
    spread = np.bincount(shell, weights=(power - mean[shell]) ** 2) / np.maximum(many - 1, 1)
    error = np.where(many > 1, np.sqrt(spread / divide), np.nan)
    place = np.bincount(shell, weights=length) / divide
    return StructureFactor(place[kept], mean[kept], error[kept], many[kept])


def transformed_structure(
    edges: Floats, g: Floats, error: Floats, *, density: float, dimension: int, waves: Floats
) -> StructureFactor:
    """Return the structure factor at wave numbers from the radial distribution function in bins.

    The end of g(r) at the last edge R is smoothed by Lorch's window, sin(pi r / R) / (pi r / R) (Lorch 1969,
    doi:10.1088/0022-3719/2/2/305), so that peaks are about 2 pi / R wide. Errors of the bins count as independent.
    """
    middle = (edges[1:] + edges[:-1]) / 2
    shell = np.diff(4 / 3 * np.pi * libm.power(edges, 3) if dimension == 3 else np.pi * edges**2)
    phase = waves[:, None] * middle
    wave = np.sinc(phase / np.pi) if dimension == 3 else load("scipy.special").j0(phase)
    weight = density * shell * np.sinc(middle / edges[-1]) * wave
    known = np.isfinite(g)
    value = 1 + linear.matmul(weight[:, known], g[known] - 1)
    spread = np.sqrt(linear.matmul(weight[:, known] ** 2, error[known] ** 2))
    return StructureFactor(waves, value, spread, np.zeros(len(waves), np.int64))


def reciprocal(periods: Floats) -> Floats:
    """Return the vectors of the reciprocal lattice (d, d), in the rows, of periods (d, d)."""
    return np.asarray(2 * np.pi * linear.inverse(periods).T)


def _vectors(periods: Floats, reach: float, step: float) -> Integers:
    """Return whole-number vectors (m, d) of the reciprocal lattice of periods (d, d), one of each opposite pair."""
    d, unit = len(periods), reciprocal(periods)
    # within this sphere all vectors are listed; they are some thousands
    inner = min(reach, float((MOST_VECTORS * 40 * abs(linear.determinant(unit))) ** (1 / d)))
    most = np.floor(inner * linear.norm(periods, axis=1) / (2 * np.pi) * (1 + 1e-12)).astype(np.int64)
    axes = [np.arange(-n, n + 1) for n in most]
    every = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, d)
    generator = stream(0, "wave vectors")
    aims = np.arange(inner, reach, step / MOST_VECTORS / 2) if reach > inner else np.zeros(0)
    directions = generator.standard_normal((len(aims), d))
    directions *= (aims / linear.norm(directions, axis=1))[:, None]
    drawn = np.round(linear.matmul(directions, periods.T) / (2 * np.pi)).astype(np.int64)
    drawn = drawn[linear.norm(linear.matmul(drawn, unit), axis=1) > inner]
    found = np.concatenate([every[linear.norm(linear.matmul(every, unit), axis=1) <= inner], drawn])
    # the first coordinate that is not 0 is above 0
    leading = found[np.arange(len(found)), (found != 0).argmax(axis=1)]
    found = np.unique(found[leading != 0] * np.sign(leading[leading != 0])[:, None], axis=0)
    length = linear.norm(linear.matmul(found, unit), axis=1)
    found, length = found[length < reach], length[length < reach]
    shell = np.floor(length / step).astype(np.int64)
    order = np.lexsort((generator.random(len(found)), shell))
    rank = np.arange(len(found)) - np.searchsorted(shell[order], shell[order])
    return np.asarray(found[np.sort(order[rank < MOST_VECTORS])])


@kernel
def _add_waves(turns, vectors, most, real, imaginary):  # type: ignore[no-untyped-def]
    """Add the waves of all points along each vector; powers of the wave along each axis are made once per point."""
    size = max(most[0], most[1], most[2]) + 1
    cosine, sine = np.ones((3, size)), np.zeros((3, size))
    for i in range(len(turns)):
        for a in range(3):
            c, s = np.cos(turns[i, a]), np.sin(turns[i, a])
            for n in range(1, most[a] + 1):
                cosine[a, n] = cosine[a, n - 1] * c - sine[a, n - 1] * s
                sine[a, n] = cosine[a, n - 1] * s + sine[a, n - 1] * c
        for v in range(len(vectors)):
            kx, ky, kz = vectors[v, 0], vectors[v, 1], vectors[v, 2]
            c, s = cosine[0, kx], sine[0, kx]
            cy, sy = cosine[1, abs(ky)], sine[1, abs(ky)]
            cz, sz = cosine[2, abs(kz)], sine[2, abs(kz)]
            sy = -sy if ky < 0 else sy
            sz = -sz if kz < 0 else sz
            c, s = c * cy - s * sy, c * sy + s * cy
            real[v] += c * cz - s * sz
            imaginary[v] += c * sz + s * cz
