"""Statistics of rough surfaces: moments of the heights, correlation length and Hurst exponent.

The correlation length is the distance at which the autocorrelation falls to 1/e. The Hurst exponent is that of the
self-affine spectrum whose height-difference function, the mean square difference of heights as a function of the
distance, fits that of the surface up to the correlation length; unlike the slope of that function it is not biased by
the shortest and the longest wavelength, which lie less than two decades apart on grains.

On lattices all pairs are summed by Fourier transforms. On triangles all pairs of vertices are summed, each vertex with
its share of the area; of many vertices a part is drawn, by their area. Standard errors are those of the jackknife: the
surface is divided into blocks, and each in turn is left out.
"""

import itertools
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base import ExplainedAttributes
from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, Integers, as_array, as_floats, as_length, as_number, as_vector, check_type
from voxgran._base.calls import explained
from voxgran._base.errors import InputError, PackingWarning, warn
from voxgran._base.kernels import kernel
from voxgran._base.lazy import load
from voxgran._base.seeds import stream
from voxgran.geometry.triangles import areas_of, normals_of
from voxgran.shapes.mesh import Surface
from voxgran.shapes.model import Shape
from voxgran.shapes.roughness.autocorrelation import roll_off_of, self_affine_correlation
from voxgran.shapes.roughness.parameters import POINTS

#: bins of distances, and vertices of which all pairs are formed at the most
BINS, MOST_POINTS = 200, 20_000
#: halvings into blocks of the jackknife, and distances that it needs, in correlation lengths
HALVINGS, NEAR = 4, 1.5
#: wave number, in inverse correlation lengths, up to which a spectrum without end is integrated
NO_CUT_OFF = 500.0
#: Hurst exponents that are searched; the ends stand for none that fits
LEAST_HURST, MOST_HURST = 0.02, 1.2


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfaceStatistics(ExplainedAttributes):
    """What is measured on a rough surface.

    Attributes
    ----------
    rms : float
        Root mean square height about the mean height, in the unit of lengths.
    skewness, kurtosis : float
        Third and fourth standardized moment of the heights; 0 and 3 for Gaussian heights.
    correlation_length : float
        Distance at which the mean autocorrelation of all directions falls to 1/e; NaN where it does not.
    correlation_lengths : tuple of float
        The same along each axis of a lattice; empty for shapes.
    hurst : float
        Hurst exponent; NaN where none between 0.03 and 1.19 fits, or there is no correlation length.
    correlation_length_error, hurst_error : float
        Standard errors of the correlation length and the Hurst exponent from 16 blocks of the surface; too small where
        the blocks are hardly wider than the correlation length.
    """

    rms: float
    skewness: float
    kurtosis: float
    correlation_length: float
    correlation_lengths: tuple[float, ...] = ()
    hurst: float
    correlation_length_error: float = math.nan
    hurst_error: float = math.nan

    def to_mapping(self) -> dict[str, Any]:
        """Return the numbers by name."""
        return asdict(self)

    def recorded(self) -> dict[str, Any]:
        """Return the numbers that records of shapes hold, which are all but the errors."""
        return {name: value for name, value in asdict(self).items() if not name.endswith("_error")}


@explained(hint="surface_statistics(shape)")
def surface_statistics(
    surface: "Shape | ArrayLike",
    *,
    smooth: Shape | None = None,
    spacing: float | tuple[float, float] = 1.0,
    shortest: float | None = None,
) -> SurfaceStatistics:
    """Measure a rough surface.

    Parameters
    ----------
    surface : Shape or (n, m) array_like of float
        An open surface, whose heights are those above its mean plane; a solid, with `smooth`; or heights on a
        lattice.
    smooth : Shape, optional
        The solid without roughness; heights are the distances of the vertices of `surface` from it, in the coordinates
        that both were made from.
    spacing : float or (2,) sequence of float
        Spacing of the lattice.
    shortest : float, optional
        Wavelength at which the spectrum ends, 0 where it does not; default: 0, or four spacings (of vertices the root
        of the area of each), whichever fits better.

    Returns
    -------
    SurfaceStatistics

    Raises
    ------
    InputError
        If a solid is given without `smooth`, the heights are not an array of at least 8 by 8 finite numbers, all
        heights are equal, or a length is not above 0.

    Warns
    -----
    PackingWarning
        If there is no correlation length.

    Examples
    --------
    >>> import numpy as np
    >>> import voxgran as vg
    >>> heights = 0.1 * np.sin(np.arange(64) * np.pi / 8)[:, None] * np.ones(64)
    >>> round(vg.surface_statistics(heights).rms, 4)
    0.0707
    """
    if shortest is not None:
        as_number(shortest, "shortest", at_least=0.0)
    if isinstance(surface, Shape):
        points, heights, weights = _heights(surface, smooth)
        # of a lattice its spacing, which is shorter than half of its edges
        edge = math.sqrt(surface.surface_area / len(surface.vertices))
        ends = (0.0, POINTS * edge) if shortest is None else (shortest,)
        dimension = 2 if surface.is_open else 3
        return scattered_statistics(points, heights, weights, edge, ends, dimension, errors=True)
    heights = as_floats(surface, "surface", shape=(None, None))
    if min(heights.shape) < 8:
        raise InputError(f"surface has shape {heights.shape}: statistics need at least 8 by 8 heights; give more")
    steps = as_vector(spacing if as_array(spacing, "spacing").ndim else (spacing, spacing), "spacing", length=2)
    for step in steps:
        as_length(step, "spacing")
    ends = (0.0, POINTS * float(steps.max())) if shortest is None else (shortest,)
    return lattice_statistics(heights, steps, ends, errors=True)


def vertex_weights(vertices: Floats, faces: Integers, along: Floats | None = None) -> Floats:
    """Return the share (n,) of each vertex in the surface area, or in that seen along a direction: a third of that of
    its triangles.
    """
    areas = (
        areas_of(vertices[faces]) if along is None else np.abs(linear.matmul(normals_of(vertices[faces]), along)) / 2
    )
    total = np.bincount(faces.ravel(), np.repeat(areas, 3), len(vertices))
    return np.asarray(total / total.sum())


def _heights(shape: Shape, smooth: Shape | None) -> tuple[Floats, Floats, Floats]:
    """Return places (n, 3), heights and shares of the area of the vertices.

    Heights are those above a smooth solid, or the mean plane of an open surface, in which its places lie. The order is
    that of the coordinates, since that of the vertices must not matter.
    """
    order = np.lexsort(shape.vertices.T[::-1])
    if smooth is not None:
        check_type(smooth, Shape, "smooth", "the Shape before it was made rough")
        moved = shape.vertices + np.array(shape.offset) - np.array(smooth.offset)
        weights = vertex_weights(shape.vertices, shape.faces)
        return shape.vertices[order], smooth.signed_distance(moved)[order], weights[order]
    if not isinstance(shape.geometry, Surface):
        raise InputError(
            f"shape {shape.name!r} is a solid: its heights are those above a smooth one; give it as smooth="
        )
    normal = linear.eigh(shape.geometry.area_inertia)[1][:, 2]
    if linear.matmul(normals_of(shape.vertices[shape.faces]).sum(axis=0), normal) < 0:
        normal = -normal
    heights = np.asarray(linear.matmul(shape.vertices, normal))
    places = shape.vertices - heights[:, None] * normal
    return places[order], heights[order], vertex_weights(shape.vertices, shape.faces, normal)[order]


def moments_of(heights: Floats, weights: Floats) -> tuple[Floats, float, float, float]:
    """Return the heights about their mean, root mean square, skewness and kurtosis.

    Raises
    ------
    InputError
        If all heights are equal.
    """
    deviations = heights - float(linear.matmul(heights, weights))
    rms = math.sqrt(float(linear.matmul(deviations**2, weights)))
    if rms <= 1e-14 * float(np.abs(heights).max(initial=1e-300)):
        raise InputError("surface has equal heights everywhere: a flat surface has no statistics; give a rough one")
    scaled = deviations / rms
    return (
        scaled,
        rms,
        float(linear.matmul(libm.power(scaled, 3), weights)),
        float(linear.matmul(libm.power(scaled, 4), weights)),
    )


def lattice_statistics(
    heights: Floats, spacing: Floats, ends: tuple[float, ...], *, errors: bool = False
) -> SurfaceStatistics:
    """Return the statistics of heights on a lattice; `ends` are wavelengths at which the spectrum may end."""
    weights = np.full(heights.size, 1.0 / heights.size)
    scaled, rms, skewness, kurtosis = moments_of(heights.ravel(), weights)
    values = scaled.reshape(heights.shape)
    lagged = _lagged(values, np.ones(values.shape))
    along = tuple(
        _length(np.arange(size) * spacing[axis], np.divide(*np.moveaxis(lagged[1:], axis + 1, 1)[:, :size, 0]))
        for axis, size in enumerate(heights.shape)
    )
    reach = float((np.array(heights.shape) * spacing).min()) / 2
    found = _Correlation(_lag_sums(lagged, spacing, reach)[None], ends, 2)
    if errors and math.isfinite(found.length):
        near = min(reach, NEAR * found.length + 2 * float(spacing.max()))
        found = _Correlation(np.stack(list(_tile_sums(values, spacing, near))), ends, 2)
    return SurfaceStatistics(
        rms=rms, skewness=skewness, kurtosis=kurtosis, correlation_lengths=along, **found.numbers(errors)
    )


def _tile_sums(values: Floats, spacing: Floats, near: float) -> Iterator[Floats]:
    """Give sums over the pairs from each tile of a lattice to all points within a distance."""
    reach = np.ceil(near / spacing).astype(int)
    ticks = [np.linspace(0, size, 2 ** (HALVINGS // 2) + 1).astype(int) for size in values.shape]
    for tile in itertools.product(*(itertools.pairwise(tick) for tick in ticks)):
        low = [max(0, int(begin - more)) for (begin, _), more in zip(tile, reach, strict=True)]
        window = tuple(slice(start, end + more) for start, (_, end), more in zip(low, tile, reach, strict=True))
        inside = np.zeros(values[window].shape)
        inside[tuple(slice(begin - start, end - start) for start, (begin, end) in zip(low, tile, strict=True))] = 1.0
        yield _lag_sums(_lagged(values[window], inside), spacing, near)


def _lagged(values: Floats, inside: Floats) -> Floats:
    """Return number, sum of products and sum of mean squares (3, ...) of pairs, from inside to anywhere, that are apart
    by each lag, as wrapped arrays.
    """
    fft = load("scipy.fft")
    size = [fft.next_fast_len(2 * n, real=True) for n in values.shape]

    def waves(array: Floats) -> Any:
        return fft.rfftn(array, s=size)

    here, there = (
        (np.conj(waves(inside)), np.conj(waves(values * inside))),
        (waves(libm.power(inside, 0)), waves(values)),
    )
    squares = np.conj(waves(values**2 * inside)) * there[0] + here[0] * waves(values**2)
    found = [fft.irfftn(product, s=size) for product in (here[0] * there[0], here[1] * there[1], squares / 2)]
    return np.array([np.round(found[0]), *found[1:]])


def _lag_sums(lagged: Floats, spacing: Floats, reach: float) -> Floats:
    """Return sums (bins, 4) over the pairs within a distance: number, distances, products, mean squares."""
    shape = lagged.shape[1:]
    lags = [np.minimum(np.arange(n), n - np.arange(n)) * step for n, step in zip(shape, spacing, strict=True)]
    distance = np.hypot(lags[0][:, None], lags[1])
    near = (distance < reach) & (lagged[0] > 0)
    width = float(spacing.max())
    index, counts = (distance[near] / width + 0.5).astype(np.int64), lagged[0][near]
    columns = (counts, counts * distance[near], lagged[1][near], lagged[2][near])
    return np.column_stack([np.bincount(index, column, int(reach / width + 0.5) + 1) for column in columns])


def scattered_statistics(
    points: Floats,
    heights: Floats,
    weights: Floats,
    edge: float,
    ends: tuple[float, ...],
    dimension: int,
    *,
    errors: bool = False,
) -> SurfaceStatistics:
    """Return the statistics of heights at points an edge apart; distances are straight."""
    scaled, rms, skewness, kurtosis = moments_of(heights, weights)
    if len(points) > MOST_POINTS:
        # by their area: one of each share of it
        levels = (np.arange(MOST_POINTS) + stream(0, "surface pairs").random(MOST_POINTS)) / MOST_POINTS
        drawn = np.minimum(np.searchsorted(np.cumsum(weights), levels), len(points) - 1)
        points, scaled, weights = points[drawn], scaled[drawn], np.ones(MOST_POINTS)
    order = np.argsort(points[:, 0], kind="stable")
    points, scaled, weights = np.ascontiguousarray(points[order]), scaled[order], weights[order]
    reach = float(linear.norm(points.max(axis=0) - points.min(axis=0))) / 3
    width = max(edge / 2, reach / BINS)
    blocks = _blocks(points, weights) if errors else np.zeros(len(points), dtype=np.int64)
    sums = np.zeros((int(blocks.max()) + 1, int(reach / width + 0.5) + 1, 4))
    _add_pairs(points, scaled, weights, blocks, reach, width, sums)
    found = _Correlation(sums, ends, dimension).numbers(errors)
    return SurfaceStatistics(rms=rms, skewness=skewness, kurtosis=kurtosis, correlation_lengths=(), **found)


def _blocks(points: Floats, weights: Floats) -> Integers:
    """Return the numbers (n,) of compact blocks of equal area, by halving along the longest extent."""
    block = np.zeros(len(points), dtype=np.int64)
    for _ in range(HALVINGS):
        block *= 2
        for number in np.unique(block):
            some = np.flatnonzero(block == number)
            order = some[np.argsort(points[some, np.argmax(np.ptp(points[some], axis=0))], kind="stable")]
            share = np.cumsum(weights[order])
            block[order[share > share[-1] / 2]] += 1
    return block


class _Correlation:
    """Correlation length and Hurst exponent from sums (blocks, bins, 4) over pairs: number, distances, products of
    heights, and means of their squares.
    """

    def __init__(self, sums: Floats, ends: tuple[float, ...], dimension: int) -> None:
        self.sums, self.ends, self.dimension = sums, ends, dimension
        self.total = sums.sum(axis=0)
        self.length = _length(*_means(self.total))

    def numbers(self, errors: bool) -> dict[str, float]:
        """Return both, and their standard errors by the jackknife if they are asked for; warn where they are NaN."""
        if math.isnan(self.length):
            why = (
                "falls below 1/e between neighbours; take a finer surface, or one several correlation lengths wide"
                if _means(self.total)[1].min(initial=1.0) < math.exp(-1.0)
                else "does not fall to 1/e; take a surface several times as wide, or a shorter correlation length"
            )
            warn(
                f"the surface has no correlation length and no Hurst exponent (NaN): its autocorrelation {why}",
                PackingWarning,
            )
        hurst, end = _hurst(self.length, *_means(self.total), self.ends, self.dimension)
        found = {"correlation_length": self.length, "hurst": hurst}
        if errors and math.isfinite(self.length):
            left = [_means(self.total - part) for part in self.sums]
            lengths = np.array([_length(*means) for means in left])
            found["correlation_length_error"] = _jackknife(lengths)
            if math.isfinite(hurst):
                fits = zip(lengths, left, strict=True)
                found["hurst_error"] = _jackknife(
                    np.array([_hurst(length, *means, (end,), self.dimension)[0] for length, means in fits])
                )
        return found


def _jackknife(values: Floats) -> float:
    """Return the standard error of a number from its values (n,) without each block; NaN where one of them is."""
    return math.sqrt((len(values) - 1) * float(np.var(values)))


def _means(sums: Floats) -> tuple[Floats, Floats]:
    """Return mean distance and autocorrelation of the pairs in each bin that has some."""
    used = (sums[:, 0] > 1e-9 * sums[:, 0].max()) & (sums[:, 3] > 0)
    return sums[used, 1] / sums[used, 0], sums[used, 2] / sums[used, 3]


def _length(distance: Floats, rho: Floats) -> float:
    """Return the distance at which an autocorrelation first falls to 1/e, between two of its values; NaN if never."""
    below = np.flatnonzero(rho < math.exp(-1.0))
    if not len(below) or below[0] == 0:
        return math.nan
    k = int(below[0])
    share = (rho[k - 1] - math.exp(-1.0)) / (rho[k - 1] - rho[k])
    return float(distance[k - 1] + share * (distance[k] - distance[k - 1]))


def _hurst(
    length: float, distance: Floats, rho: Floats, wavelengths: tuple[float, ...], dimension: int
) -> tuple[float, float]:
    """Return the Hurst exponent whose height-difference function fits best, and the wavelength at which its spectrum
    ends: of several, the one that fits better.
    """
    used = (distance > 1e-9 * length) & (distance <= length) & (rho < 1.0)
    if used.sum() < 3:
        return math.nan, math.nan
    found, places = libm.log(1.0 - rho[used]), distance[used] / length

    def misfit(hurst: float, cut_off: float) -> float:
        roll_off = roll_off_of(hurst, cut_off, dimension)
        difference = found - libm.log(1.0 - self_affine_correlation(places, hurst, roll_off, cut_off, dimension))
        return float(((difference - difference.mean()) ** 2).sum())

    search: Any = load("scipy.optimize").minimize_scalar
    fits = []
    for end in wavelengths:
        cut_off = min(2 * np.pi * length / max(end, 1e-300), NO_CUT_OFF)
        if cut_off > np.pi:
            fit = search(
                misfit, bounds=(LEAST_HURST, MOST_HURST), args=(cut_off,), method="bounded", options={"xatol": 1e-3}
            )
            fits.append((float(fit.fun), float(fit.x), end))
    _, best, end = min(fits, default=(0.0, math.nan, math.nan))
    return best if LEAST_HURST + 0.01 < best < MOST_HURST - 0.01 else math.nan, end


@kernel
def _add_pairs(points, values, weights, block, reach, width, sums):  # type: ignore[no-untyped-def]
    """Add weight, and weighted distance, product and mean square, of the pairs within reach to bins of both blocks.

    The points are sorted by x.
    """
    for i in range(len(points)):
        for j in range(i + 1, len(points)):
            x = points[j, 0] - points[i, 0]
            if x >= reach:
                break
            y, z = points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
            square = x * x + y * y + z * z
            if 0.0 < square < reach * reach:
                distance = math.sqrt(square)
                k = int(distance / width + 0.5)
                pair = weights[i] * weights[j]
                for b in (block[i], block[j]):
                    sums[b, k, 0] += pair
                    sums[b, k, 1] += pair * distance
                    sums[b, k, 2] += pair * values[i] * values[j]
                    sums[b, k, 3] += pair * (values[i] ** 2 + values[j] ** 2) / 2
