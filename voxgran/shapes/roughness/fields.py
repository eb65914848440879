"""Random height fields on lattices of two or three dimensions, and their values at any points.

A curved surface has no lattice of its own. Its heights are those of a field in space, at its vertices: the field has
the same autocorrelation as a function of the distance, and a section of it by a plane the same Hurst exponent.

``patir`` is a moving average of white noise (Patir 1978, doi:10.1016/0043-1648(78)90157-6); its coefficients, which
Patir finds by Newton's method, are the Fourier transform of the root of the power spectrum. ``spectral`` is the same
with the spectrum of a self-affine field. ``whitehouse`` is a recursion along each axis, with the exponential
autocorrelation of Whitehouse & Archard 1970 (doi:10.1098/rspa.1970.0068). ``midpoint`` displaces midpoints (Fournier,
Fussell & Carpenter 1982, doi:10.1145/358523.358553): centers of cells, then of their faces and edges, each by an amount
that grows with the distance from the points that are there by the power of the Hurst exponent.
"""

import itertools
from dataclasses import dataclass

import numpy as np

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import Floats
from voxgran._base.errors import TooLargeError
from voxgran._base.lazy import load
from voxgran.shapes.roughness.autocorrelation import correlation, self_affine_density
from voxgran.shapes.roughness.johnson import johnson
from voxgran.shapes.roughness.parameters import RoughField

#: points of a lattice at the most
MOST_POINTS = 2**24
#: correlation lengths beyond the points, on both sides together, and in all at least: lattices are periodic
MARGIN, LEAST = 4.0, 8.0
#: correlation lengths of fields of displaced midpoints in spacings of the first lattice, by Hurst exponent, in two and
#: in three dimensions; means of 150 and 40 fields
HURST = (0.05, 0.2, 0.4, 0.6, 0.8, 1.0)
FIRST = {2: (0.211, 0.381, 0.575, 0.696, 0.769, 0.814), 3: (0.154, 0.278, 0.479, 0.635, 0.736, 0.800)}


@dataclass(frozen=True, slots=True)
class LatticeField:
    """Heights of variance near 1 on a periodic lattice."""

    values: Floats
    origin: Floats  # place of the first point, (d,)
    spacing: Floats  # along each axis, (d,)

    def at(self, points: Floats) -> Floats:
        """Return the heights (n,) at points (n, d) by cubic splines, which give those of the lattice at its points."""
        index = ((points - self.origin) / self.spacing).T
        found = load("scipy.ndimage").map_coordinates(self.values, index, order=3, mode="grid-wrap")
        return np.asarray(found, dtype=np.float64)


def draw_field(
    field: RoughField, low: Floats, high: Floats, spacing: Floats, generator: np.random.Generator
) -> LatticeField:
    """Return a random field over a box of d axes.

    Points at `low` plus whole multiples of the spacing are points of the lattice, but for midpoints, whose spacing is
    near the one that is asked for.

    Raises
    ------
    TooLargeError
        If the lattice has more than 2**24 points.
    """
    fft = load("scipy.fft")
    first = field.lengths / np.interp(field.hurst, HURST, FIRST[len(low)])
    levels = max(0, round(float(libm.log2(first / spacing).max())))
    step = first / 2**levels if field.method == "midpoint" else spacing
    before = np.ceil(MARGIN / 2 * field.lengths / step)
    number = np.maximum(np.ceil((high - low) / step) + 2 * before, np.ceil(LEAST * field.lengths / step)) + 1
    if field.method == "midpoint":
        size = tuple(max(2, int(np.ceil(n / 2**levels))) * 2**levels for n in number)
    else:
        size = tuple(int(fft.next_fast_len(int(min(n, MOST_POINTS)), real=True)) for n in number)
    points = float(np.prod(number if max(size) >= MOST_POINTS else np.array(size, dtype=np.float64)))
    if points > MOST_POINTS:
        excess = (points / MOST_POINTS) ** (1 / len(size))
        if spacing.min() < 0.99 * field.edge:  # coarser waves would not make the mesh coarser
            raise TooLargeError(
                f"correlation_length is {field.lengths.max():.4g}: the random field would need {points:.3g} points, at "
                f"most {MOST_POINTS:.3g} are drawn; give at most {0.9 * field.lengths.max() / excess:.2g}"
            )
        raise TooLargeError(
            f"shortest is {field.shortest:.4g}: the random field would need {points:.3g} points, at most "
            f"{MOST_POINTS:.3g} are drawn; give at least {field.shortest * excess:.2g}"
        )
    if field.method == "whitehouse":
        values = recursive_field(size, libm.exp(-step / field.lengths), generator)
    elif field.method == "midpoint":
        base = tuple(n // 2**levels for n in size)
        values = midpoint_field(base, levels, field.hurst, generator)
    else:
        amplitude, transform = amplitudes(field, size, step), johnson(field.skewness, field.kurtosis)
        values = transform.of(moving_average(amplitude, generator.standard_normal(size)))
    return LatticeField(values, low - before * step, step)


def amplitudes(field: RoughField, size: tuple[int, ...], spacing: Floats) -> Floats:
    """Return the root of the power spectrum of the Gaussian field on a periodic lattice, in the layout of `rfftn`.

    It is normalized to unit variance. Where the heights are transformed, the Gaussian field has the autocorrelation
    from which the wanted one results; negative powers, which the wrapped function may have, are left out.
    """
    fft = load("scipy.fft")
    if field.method == "spectral":
        axes = [2 * np.pi * np.fft.fftfreq(n, h) * ell for n, h, ell in zip(size, spacing, field.lengths, strict=True)]
        axes[-1] = np.abs(axes[-1][: size[-1] // 2 + 1])
        q = np.sqrt(sum(axis**2 for axis in np.meshgrid(*axes, indexing="ij", sparse=True)))
        power = self_affine_density(q, field.hurst, field.roll_off, field.cut_off * (1 + 1e-9), len(size))
        if field.skewness == 0.0 and field.kurtosis == 3.0:
            return np.sqrt(power / _variance(power, size))
        wanted = fft.irfftn(power, s=size)
        wanted /= wanted.flat[0]
    else:
        steps = [
            np.minimum(np.arange(n), n - np.arange(n)) * h / ell
            for n, h, ell in zip(size, spacing, field.lengths, strict=True)
        ]
        distance = np.sqrt(sum(axis**2 for axis in np.meshgrid(*steps, indexing="ij", sparse=True)))
        wanted = correlation(field.autocorrelation, distance)
    gaussian = johnson(field.skewness, field.kurtosis).gaussian_correlation(wanted)
    power = np.maximum(fft.rfftn(gaussian).real, 0.0)
    return np.asarray(np.sqrt(power / _variance(power, size)))


def _variance(power: Floats, size: tuple[int, ...]) -> float:
    """Return the mean of a power spectrum in the layout of `rfftn` over all wave vectors."""
    twice = np.full(power.shape[-1], 2.0)
    twice[0] = 1.0
    if size[-1] % 2 == 0:
        twice[-1] = 1.0
    return float((power * twice).sum()) / float(np.prod(size))


def moving_average(amplitude: Floats, noise: Floats) -> Floats:
    """Return the moving average of white noise whose coefficients are the transform of the amplitudes."""
    fft = load("scipy.fft")
    return np.asarray(fft.irfftn(fft.rfftn(noise) * amplitude, s=noise.shape))


def recursive_field(size: tuple[int, ...], decay: Floats, generator: np.random.Generator) -> Floats:
    """Return a stationary field in which a value is `decay` times the one before it, along each axis, plus noise."""
    values = generator.standard_normal(size)
    for axis, ratio in enumerate(decay):
        values = np.moveaxis(values, axis, 0)
        values[1:] *= np.sqrt(1.0 - ratio**2)
        values = np.moveaxis(load("scipy.signal").lfilter([1.0], [1.0, -ratio], values, axis=0), 0, axis)
    return np.ascontiguousarray(values)


def midpoint_field(base: tuple[int, ...], levels: int, hurst: float, generator: np.random.Generator) -> Floats:
    """Return a periodic field from white noise on a lattice whose cells are halved a number of times.

    In each round the centers of cells come first, then those of faces, then those of edges: each is the mean of its
    nearest neighbours among the points that are there, plus noise.
    """
    values = generator.standard_normal(base)
    for level in range(levels):
        values = _halved(values, 0.5**level, hurst, generator)
    return values


def _halved(coarse: Floats, cell: float, hurst: float, generator: np.random.Generator) -> Floats:
    """Return the field on a lattice of half the spacing; `cell` is the old one in units of the first."""
    d = coarse.ndim
    values = np.zeros([2 * n for n in coarse.shape])
    values[(slice(None, None, 2),) * d] = coarse
    kinds = sorted(itertools.product((0, 1), repeat=d), key=sum, reverse=True)
    for odd in kinds[:-1]:
        total, count = np.zeros(coarse.shape), 0
        own = tuple(slice(k, None, 2) for k in odd)
        across = [axis for axis in range(d) if odd[axis]]
        # the corners of the cell, face or edge of which the point is the center
        for sides in itertools.product((0, 1), repeat=len(across)):
            total += np.roll(coarse, [-side for side in sides], across)
            count += 1
        # and the centers on both sides of a face, or around an edge
        for axis in (axis for axis in range(d) if not odd[axis]):
            center = values[tuple(slice(1 if axis == k else odd[k], None, 2) for k in range(d))]
            total += center + np.roll(center, 1, axis)
            count += 2
        distance = cell / 2 * (np.sqrt(d) if len(across) == d else 1.0)
        noise = generator.standard_normal(coarse.shape)
        values[own] = total / count + libm.power(distance, hurst) * noise
    return values
