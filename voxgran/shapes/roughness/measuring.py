"""Statistics of rough surfaces: moments of the heights, correlation length and Hurst exponent.

The correlation length is the distance at which the autocorrelation falls to 1/e. The Hurst exponent is that of the
self-affine spectrum whose height-difference function, the mean square difference of heights as a function of the
distance, fits that of the surface up to the correlation length; unlike the slope of that function it is not biased by
the shortest and the longest wavelength, which lie less than two decades apart on grains.
"""

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arrays import Floats, Integers, as_floats, as_number, as_positive, check_type
from voxgran._base.calls import explained
from voxgran._base.errors import InputError
from voxgran._base.lazy import load
from voxgran._base.registry import ExplainedAttributes
from voxgran.geometry.triangles import areas_of
from voxgran.shapes.model import Shape
from voxgran.shapes.roughness.autocorrelation import roll_off_of, self_affine_correlation
from voxgran.shapes.roughness.parameters import POINTS
from voxgran.shapes.surface import Surface

#: bins of distances, and vertices from which pairs are formed with all others
BINS, CENTERS = 100, 400
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
    """

    rms: float
    skewness: float
    kurtosis: float
    correlation_length: float
    correlation_lengths: tuple[float, ...] = ()
    hurst: float

    def to_mapping(self) -> dict[str, Any]:
        """Return the numbers by name."""
        return asdict(self)


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
        Wavelength at which the spectrum ends, 0 where it does not; default: 0, or four spacings or mean edges,
        whichever fits better.

    Returns
    -------
    SurfaceStatistics

    Raises
    ------
    InputError
        If a solid is given without `smooth`, the heights are not an array of at least 8 by 8 finite numbers, all
        heights are equal, or a length is not above 0.

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
        heights = _heights(surface, smooth)
        corners = surface.vertices[surface.faces]
        edge = float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean())
        weights, ends = (
            vertex_weights(surface.vertices, surface.faces),
            (0.0, POINTS * edge) if shortest is None else (shortest,),
        )
        return scattered_statistics(surface.vertices, heights, weights, edge, ends, 2 if surface.is_open else 3)
    heights = as_floats(surface, "surface", shape=(None, None))
    if min(heights.shape) < 8:
        raise InputError(f"surface has shape {heights.shape}: statistics need at least 8 by 8 heights; give more")
    steps = as_floats(np.broadcast_to(np.asarray(spacing), 2), "spacing", shape=(2,))
    for step in steps:
        as_positive(step, "spacing")
    ends = (0.0, POINTS * float(steps.max())) if shortest is None else (shortest,)
    return lattice_statistics(heights, steps, ends)


def vertex_weights(vertices: Floats, faces: Integers) -> Floats:
    """Return the share (n,) of each vertex in the surface area: a third of that of its triangles."""
    total = np.bincount(faces.ravel(), np.repeat(areas_of(vertices[faces]), 3), len(vertices))
    return np.asarray(total / total.sum())


def _heights(shape: Shape, smooth: Shape | None) -> Floats:
    """Return the heights of the vertices above the mean plane of an open surface, or a smooth solid."""
    if smooth is not None:
        check_type(smooth, Shape, "smooth", "the Shape before it was made rough")
        moved = shape.vertices + np.array(shape.offset) - np.array(smooth.offset)
        return smooth.signed_distance(moved)
    if not isinstance(shape.geometry, Surface):
        raise InputError(
            f"shape {shape.name!r} is a solid: its heights are those above a smooth one; give it as smooth="
        )
    return np.asarray(shape.vertices @ np.linalg.eigh(shape.geometry.area_inertia)[1][:, 2])


def moments_of(heights: Floats, weights: Floats) -> tuple[Floats, float, float, float]:
    """Return the heights about their mean, root mean square, skewness and kurtosis.

    Raises
    ------
    InputError
        If all heights are equal.
    """
    deviations = heights - float(heights @ weights)
    rms = math.sqrt(float(deviations**2 @ weights))
    if rms <= 1e-14 * float(np.abs(heights).max(initial=1e-300)):
        raise InputError("surface has equal heights everywhere: a flat surface has no statistics; give a rough one")
    scaled = deviations / rms
    return scaled, rms, float(scaled**3 @ weights), float(scaled**4 @ weights)


def lattice_statistics(heights: Floats, spacing: Floats, ends: tuple[float, ...]) -> SurfaceStatistics:
    """Return the statistics of heights on a lattice; `ends` are wavelengths at which the spectrum may end."""
    weights = np.full(heights.size, 1.0 / heights.size)
    scaled, rms, skewness, kurtosis = moments_of(heights.ravel(), weights)
    products, counts = _lagged(scaled.reshape(heights.shape))
    lags = [np.minimum(np.arange(n), n - np.arange(n)) * h for n, h in zip(products.shape, spacing, strict=True)]
    along = tuple(
        _length(lag[: n // 2], np.moveaxis(products / counts, axis, 0)[: n // 2, 0])
        for axis, (lag, n) in enumerate(zip(lags, heights.shape, strict=True))
    )
    distance = np.hypot(lags[0][:, None], lags[1][None, :])
    reach = float((np.array(heights.shape) * spacing).min()) / 2
    near = distance < reach
    bins = np.arange(0.0, reach + spacing.max(), spacing.max()) - spacing.max() / 2
    centers, rho = _binned(distance[near], (products / counts)[near], counts[near], bins)
    length, hurst = _length_and_hurst(centers, rho, ends, 2)
    return SurfaceStatistics(
        rms=rms,
        skewness=skewness,
        kurtosis=kurtosis,
        correlation_length=length,
        correlation_lengths=along,
        hurst=hurst,
    )


def _lagged(values: Floats) -> tuple[Floats, Floats]:
    """Return sums of products, and numbers of pairs, of heights that are apart by each lag, as wrapped arrays."""
    fft = load("scipy.fft")
    size = [fft.next_fast_len(2 * n, real=True) for n in values.shape]
    counts = np.ones(values.shape)
    found = [fft.irfftn(np.abs(fft.rfftn(array, s=size)) ** 2, s=size) for array in (values, counts)]
    return found[0], np.maximum(np.round(found[1]), 1.0)


def scattered_statistics(
    points: Floats, heights: Floats, weights: Floats, edge: float, ends: tuple[float, ...], dimension: int
) -> SurfaceStatistics:
    """Return the statistics of heights at points an edge apart; distances are straight."""
    scaled, rms, skewness, kurtosis = moments_of(heights, weights)
    some = np.linspace(0, len(points) - 1, min(CENTERS, len(points))).astype(np.int64)
    distance = load("scipy.spatial.distance").cdist(points[some], points)
    reach = float(np.linalg.norm(points.max(axis=0) - points.min(axis=0))) / 3
    near = (distance < reach) & (distance > 0.0)
    products = (scaled[some][:, None] * scaled)[near]
    pairs = (weights[some][:, None] * weights)[near]
    width = max(edge / 2, reach / BINS)
    centers, rho = _binned(distance[near], products, pairs, np.arange(0.0, reach + width, width) - width / 2)
    length, hurst = _length_and_hurst(centers, rho, ends, dimension)
    return SurfaceStatistics(rms=rms, skewness=skewness, kurtosis=kurtosis, correlation_length=length, hurst=hurst)


def _binned(distance: Floats, products: Floats, weights: Floats, bins: Floats) -> tuple[Floats, Floats]:
    """Return mean distance and mean product of the pairs in each bin."""
    index = np.digitize(distance, bins)
    total = np.bincount(index, weights, len(bins) + 1)
    used = total > 0
    means = [np.bincount(index, weights * v, len(bins) + 1)[used] / total[used] for v in (distance, products)]
    return means[0], means[1]


def _length(distance: Floats, rho: Floats) -> float:
    """Return the distance at which an autocorrelation first falls to 1/e, between two of its values; NaN if never."""
    below = np.flatnonzero(rho < math.exp(-1.0))
    if not len(below) or below[0] == 0:
        return math.nan
    k = int(below[0])
    share = (rho[k - 1] - math.exp(-1.0)) / (rho[k - 1] - rho[k])
    return float(distance[k - 1] + share * (distance[k] - distance[k - 1]))


def _length_and_hurst(
    distance: Floats, rho: Floats, wavelengths: tuple[float, ...], dimension: int
) -> tuple[float, float]:
    """Return the correlation length, and the Hurst exponent whose height-difference function fits best.

    The spectrum ends at one of several wavelengths, whichever fits better.
    """
    length = _length(distance, rho)
    used = (distance > 1e-9 * length) & (distance <= length) & (rho < 1.0)
    if used.sum() < 3:
        return length, math.nan
    found, places = np.log(1.0 - rho[used]), distance[used] / length

    def misfit(hurst: float, cut_off: float) -> float:
        roll_off = roll_off_of(hurst, cut_off, dimension)
        difference = found - np.log(1.0 - self_affine_correlation(places, hurst, roll_off, cut_off, dimension))
        return float(((difference - difference.mean()) ** 2).sum())

    fits = []
    for cut_off in (min(2 * np.pi * length / max(end, 1e-300), NO_CUT_OFF) for end in wavelengths):
        if cut_off > np.pi:
            search: Any = load("scipy.optimize").minimize_scalar
            fits.append(
                search(
                    misfit, bounds=(LEAST_HURST, MOST_HURST), args=(cut_off,), method="bounded", options={"xatol": 1e-3}
                )
            )
    best = float(min(fits, key=lambda fit: fit.fun).x) if fits else math.nan
    return length, best if LEAST_HURST + 0.01 < best < MOST_HURST - 0.01 else math.nan
