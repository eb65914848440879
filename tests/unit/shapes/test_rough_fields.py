"""Random fields: spectra, autocorrelations and moments within their standard errors over seeds."""

import math

import numpy as np
import pytest
from kit import slow
from scipy import fft, integrate, optimize, special

from voxgran._base.errors import InputError
from voxgran._base.seeds import stream
from voxgran.shapes.roughness import measuring
from voxgran.shapes.roughness.autocorrelation import correlation, roll_off_of, self_affine_correlation
from voxgran.shapes.roughness.fields import amplitudes, draw_field, midpoint_field, moving_average, recursive_field
from voxgran.shapes.roughness.johnson import johnson
from voxgran.shapes.roughness.measuring import surface_statistics
from voxgran.shapes.roughness.parameters import Roughness

MOMENTS = [(0.0, 1.8), (0.0, 4.0), (0.5, 3.0), (-1.0, 3.5), (1.0, 6.0), (-1.5, 10.0)]


def drawn(field, *, seed, size=20.0, dimension=2):
    """Return a field over a square, as a lattice."""
    spacing = np.full(dimension, field.edge)
    found = draw_field(field, np.zeros(dimension), np.full(dimension, size), spacing, stream(seed, "test"))
    return found.values, found.spacing


def lagged(values, lag):
    """Return the mean product of values that are apart by a lag (without wrapping)."""
    here = tuple(slice(0, n - k) for n, k in zip(values.shape, lag, strict=True))
    there = tuple(slice(k, None) for k in lag)
    return float((values[here] * values[there]).mean())


def near(samples, wanted, *, errors=4.0, extra=0.0):
    """Return whether a mean is what is wanted within standard errors."""
    samples = np.asarray(samples)
    deviation = samples.std(ddof=1) / math.sqrt(len(samples))
    return abs(samples.mean() - wanted) <= errors * deviation + extra


@pytest.mark.parametrize(("skewness", "kurtosis"), MOMENTS)
def test_transformed_heights_have_the_moments(skewness, kurtosis):
    transform = johnson(skewness, kurtosis)

    def moment(k):
        def integrand(g):
            return float(transform.of(np.array([g]))[0]) ** k * math.exp(-g * g / 2) / math.sqrt(2 * math.pi)

        return integrate.quad(integrand, -12, 12, limit=400)[0]

    assert [moment(k) for k in (1, 2, 3, 4)] == pytest.approx([0, 1, skewness, kurtosis], abs=1e-6 * kurtosis)
    assert (np.diff(transform.of(np.linspace(-6, 6, 500))) > 0).all()


def test_lognormal_heights_are_between_the_others():
    w = 1.4
    skewness, kurtosis = (w + 2) * math.sqrt(w - 1), w**4 + 2 * w**3 + 3 * w**2 - 3
    found = johnson(skewness, kurtosis)
    assert found.kind == "lognormal"
    heights = np.linspace(-2, 2, 9)
    sigma = math.sqrt(math.log(w))
    expected = (np.exp(sigma * heights) - math.sqrt(w)) / math.sqrt(w * (w - 1))
    assert found.of(heights) == pytest.approx(expected, rel=1e-8)
    assert johnson(skewness, 1.1 * kurtosis).kind == "unbounded"
    assert johnson(skewness, 0.9 * kurtosis).kind == "bounded"


@pytest.mark.parametrize(("skewness", "kurtosis"), MOMENTS)
def test_transformed_heights_have_the_correlation(skewness, kurtosis):
    transform, generator = johnson(skewness, kurtosis), stream(3, "pairs")
    for wanted in (0.2, 0.7):
        rho = float(transform.gaussian_correlation(np.array([wanted]))[0])
        x, y = generator.standard_normal((2, 100, 4000))
        products = (transform.of(x) * transform.of(rho * x + math.sqrt(1 - rho**2) * y)).mean(axis=1)
        assert near(products, wanted)


@pytest.mark.parametrize(("skewness", "kurtosis", "message"), [(3, 4, "at least 10.3"), (0, 60, "at most 50")])
def test_impossible_moments_are_refused(skewness, kurtosis, message):
    with pytest.raises(InputError, match=message):
        Roughness(skewness=skewness, kurtosis=kurtosis)


def test_moving_average_is_the_linear_transform():
    """Patir's sum of weighted random numbers, as it stands, and by FFT."""
    field = Roughness(method="patir", correlation_length=(3.0, 2.0), shortest=4.0).on(1.0, 2)
    size, spacing = (20, 15), np.ones(2)
    amplitude = amplitudes(field, size, spacing)
    noise = stream(1, "noise").standard_normal(size)
    coefficients = fft.irfftn(amplitude, s=size)
    found, total = moving_average(amplitude, noise), np.zeros(size)
    for k in range(size[0]):
        for m in range(size[1]):
            total += coefficients[k, m] * np.roll(noise, (k, m), (0, 1))
    assert found == pytest.approx(total, abs=1e-13)
    # the equations that Patir solves by Newton's method: sums of products of coefficients are the autocorrelation
    lags = [np.minimum(np.arange(n), n - np.arange(n)) for n in size]
    wanted = np.exp(-np.hypot(lags[0][:, None] / 3, lags[1][None, :] / 2))
    sums = fft.irfftn(fft.rfftn(coefficients) * fft.rfftn(coefficients).conj(), s=size)
    assert sums == pytest.approx(wanted, abs=1e-13)


def test_coefficients_solve_the_equations_of_patir():
    """Newton's method on the nonlinear equations comes to coefficients of the same spectrum."""
    size = (6, 5)
    lags = [np.minimum(np.arange(n), n - np.arange(n)) for n in size]
    wanted = np.exp(-np.hypot(lags[0][:, None] / 1.2, lags[1][None, :] / 0.8))
    field = Roughness(method="patir", correlation_length=(1.2, 0.8), shortest=4.0).on(1.0, 2)
    amplitude = amplitudes(field, size, np.ones(2))

    # symmetric coefficients have as many unknowns as there are different lags
    _, index = np.unique(lags[0][:, None] * 5 + lags[1][None, :], return_inverse=True)
    index = index.reshape(size)

    def misses(unknown):
        alpha = unknown[index]
        found = [(alpha * np.roll(alpha, (-p, -q), (0, 1))).sum() for p in range(4) for q in range(3)]
        return np.array(found) - [wanted[p, q] for p in range(4) for q in range(3)]

    solved = optimize.root(misses, np.bincount(index.ravel(), wanted.ravel()) / np.bincount(index.ravel()), tol=1e-13)
    assert solved.success
    assert np.abs(fft.rfftn(solved.x[index])) == pytest.approx(amplitude, abs=1e-9)


@pytest.mark.parametrize("kind", ["exponential", "gaussian", "linear"])
def test_patir_has_its_autocorrelation(kind):
    field = Roughness(method="patir", autocorrelation=kind, correlation_length=(1.0, 0.5), shortest=1.0).on(1.0, 2)
    size = (64, 64) if kind != "linear" else (60, 64)
    power = amplitudes(field, size, np.full(2, 0.25)) ** 2
    expected = fft.irfftn(power, s=size)
    for lag in ((0, 0), (4, 0), (0, 2), (3, 2)):
        distance = np.array([math.hypot(lag[0] * 0.25, lag[1] * 0.5)])
        # negative powers of the truncated linear function are left out
        tolerance = 0.03 if kind == "linear" else 1e-6
        assert expected[lag] == pytest.approx(float(correlation(kind, distance)[0]), abs=tolerance)
    fields = [drawn(field, seed=seed)[0] for seed in range(25)]
    for lag in ((0, 0), (4, 0), (0, 2), (8, 4)):
        distance = np.array([math.hypot(lag[0] * 0.25, lag[1] * 0.5)])
        wanted = float(correlation(kind, distance)[0])
        assert near([lagged(values, lag) for values in fields], wanted, extra=0.03 if kind == "linear" else 0.0)


@pytest.mark.parametrize("dimension", [2, 3])
def test_recursion_has_an_exponential_autocorrelation(dimension):
    size = (90,) * dimension if dimension == 2 else (40, 30, 30)
    decay = np.exp(-np.array([0.5, 0.25, 1.0][:dimension]))
    fields = [recursive_field(size, decay, stream(seed, "recursion")) for seed in range(30)]
    for lag in ((0, 0, 0), (1, 0, 0), (2, 3, 0), (0, 4, 1)):
        used = lag[:dimension]
        assert near([lagged(values, used) for values in fields], float(np.prod(decay ** np.array(used))))
    # stationary from the first value on
    assert near([(values[(0,) * (dimension - 1)] ** 2).mean() for values in fields], 1.0)


@pytest.mark.parametrize(("hurst", "dimension"), [(0.3, 2), (0.8, 2), (0.8, 3)])
def test_self_affine_fields_have_their_spectrum_and_correlation(hurst, dimension):
    field = Roughness(hurst=hurst, correlation_length=1.0, shortest=1.0).on(1.0, dimension)
    fields = [
        drawn(field, seed=seed, size=20.0 if dimension == 2 else 6.0, dimension=dimension)[0] for seed in range(25)
    ]
    values = fields[0]
    axes = [2 * np.pi * fft.fftfreq(n, 0.25) for n in values.shape]
    q = np.sqrt(sum(axis**2 for axis in np.meshgrid(*axes, indexing="ij")))
    power = np.mean([np.abs(fft.fftn(one)) ** 2 for one in fields], axis=0)
    roll, cut = field.roll_off, 2 * np.pi
    assert power[q > cut * 1.001].max() < 1e-20 * power.max()
    plateau = power[(q < roll) & (q > 0)].mean()
    assert plateau == pytest.approx(power[(q > 0.5 * roll) & (q < roll)].mean(), rel=0.15)
    for low in (1.2 * roll, 2.0 * roll):
        band = (q > low) & (q < 1.3 * low)
        assert (power * q ** (dimension + 2 * hurst))[band].mean() == pytest.approx(
            plateau * roll ** (dimension + 2 * hurst), rel=0.12
        )
    for steps in (0, 2, 4, 8):
        wanted = self_affine_correlation(np.array([steps * 0.25]), hurst, roll, cut, dimension)[0]
        found = [lagged(one, (steps, *(0,) * (dimension - 1))) for one in fields]
        assert near(found, wanted, extra=0.01)
    assert self_affine_correlation(np.ones(1), hurst, roll, cut, dimension)[0] == pytest.approx(math.exp(-1), abs=1e-9)


def test_autocorrelation_of_a_disk_of_waves():
    """Without a power law, the integral is a closed form."""
    distance = np.array([0.3, 1.0])
    found = self_affine_correlation(distance, 0.5, 5.0 - 1e-9, 5.0, 2)
    assert found == pytest.approx(2 * special.j1(5 * distance) / (5 * distance), abs=1e-5)
    with pytest.raises(InputError, match="give less than 2"):
        roll_off_of(0.5, 2.0, 2)


@pytest.mark.parametrize("dimension", [2, 3])
def test_midpoints_are_displaced_by_the_power_of_the_distance(dimension):
    hurst, levels = 0.7, (0, 0, 4, 3)[dimension]
    values = midpoint_field((24,) * 2 if dimension == 2 else (8,) * 3, levels, hurst, stream(5, "midpoints"))
    for level in range(levels):
        step = 2 ** (levels - level - 1)
        known = values[(slice(None, None, 2 * step),) * dimension]
        middle = values[(slice(step, None, 2 * step),) * dimension]
        sides = np.ndindex(*(2,) * dimension)
        mean = sum(np.roll(known, [-k for k in side], range(dimension)) for side in sides) / 2**dimension
        wanted = (math.sqrt(dimension) * 0.5 ** (level + 1)) ** hurst
        assert (middle - mean).std() == pytest.approx(wanted, rel=4 / math.sqrt(2 * middle.size))


def test_midpoints_recover_the_exponent():
    slopes = []
    for seed in range(6):
        values = midpoint_field((1, 1), 9, 0.7, stream(seed, "deep"))
        g = [np.mean([((values - np.roll(values, k, axis)) ** 2).mean() for axis in (0, 1)]) for k in (2, 16)]
        slopes.append(math.log(g[1] / g[0]) / math.log(8) / 2)
    assert np.mean(slopes) == pytest.approx(0.7, abs=0.08)


@pytest.mark.parametrize("method", ["patir", slow("spectral")])
def test_skewness_and_kurtosis_are_met(method):
    field = Roughness(method=method, skewness=-1.0, kurtosis=4.5, correlation_length=1.0, shortest=1.0).on(1.0, 2)
    fields = [drawn(field, seed=seed)[0] for seed in range(10)]
    found = [surface_statistics(values, spacing=0.25, shortest=1.0) for values in fields]
    assert near([one.skewness for one in found], -1.0, extra=0.02)
    assert near([one.kurtosis for one in found], 4.5, extra=0.05)
    assert near([one.correlation_length for one in found], 1.0, extra=0.03)


@pytest.mark.parametrize("method", ["spectral", slow("patir"), slow("whitehouse"), slow("midpoint")])
def test_correlation_lengths_are_met(method):
    field = Roughness(method=method, correlation_length=(1.0, 0.6), shortest=0.6).on(1.0, 2)
    found = []
    for seed in range(10):
        values, spacing = drawn(field, seed=seed, size=16.0)
        found.append(surface_statistics(values, spacing=spacing, shortest=0.0).correlation_lengths)
    x, y = np.transpose(found)
    assert near(x, 1.0, extra=0.06)
    assert near(y, 0.6, extra=0.04)


@pytest.mark.parametrize("hurst", [slow(0.3), 0.8])
def test_the_hurst_exponent_is_recovered(hurst):
    field = Roughness(hurst=hurst, correlation_length=1.0, shortest=0.4).on(1.0, 2)
    found = [surface_statistics(drawn(field, seed=seed, size=12.0)[0], spacing=0.1).hurst for seed in range(3)]
    assert np.mean(found) == pytest.approx(hurst, abs=0.04)


def test_moments_of_a_wave():
    x = np.arange(240)
    heights = np.broadcast_to(3.0 * np.cos(2 * np.pi * x / 60)[:, None], (240, 50))
    found = surface_statistics(heights, spacing=0.1)
    assert found.rms == pytest.approx(3 / math.sqrt(2))
    assert (found.skewness, found.kurtosis) == pytest.approx((0.0, 1.5), abs=1e-12)
    # the autocorrelation is a cosine
    assert found.correlation_lengths[0] == pytest.approx(6 * math.acos(math.exp(-1)) / (2 * math.pi), rel=0.05)
    assert math.isnan(found.correlation_lengths[1])


def test_sums_over_lags_are_those_over_all_pairs():
    spacing, values = np.array([0.3, 0.2]), stream(1, "heights").normal(size=(11, 14))
    places = np.stack(
        np.meshgrid(*(np.arange(n) * s for n, s in zip(values.shape, spacing, strict=True)), indexing="ij")
    )
    points, heights = places.reshape(2, -1).T, values.ravel()
    distance = np.linalg.norm(points[:, None] - points, axis=2)
    near = distance < 1.49
    products, squares = np.outer(heights, heights), np.add.outer(heights**2, heights**2) / 2
    index = (distance[near] / 0.3 + 0.5).astype(int)
    twin = np.column_stack([np.bincount(index, v[near], 6) for v in (near, distance, products, squares)])
    whole = measuring._lag_sums(measuring._lagged(values, np.ones(values.shape)), spacing, 1.49)
    assert whole == pytest.approx(twin, abs=1e-9)
    # the tiles of the jackknife add up to the whole
    tiles = list(measuring._tile_sums(values, spacing, 1.49))
    assert len(tiles) == 16
    assert sum(tiles) == pytest.approx(twin, abs=1e-9)
    flat = np.column_stack([points, np.zeros(len(points))])
    blocks = measuring._blocks(flat, np.ones(len(flat)))
    assert np.bincount(blocks).tolist() == pytest.approx([len(flat) / 16] * 16, abs=2)
    pairs = np.zeros((16, 6, 4))
    measuring._add_pairs(flat, heights, np.ones(len(flat)), blocks, 1.49, 0.3, pairs)
    pairs = pairs.sum(axis=0)
    pairs[0] += [len(flat), 0.0, (heights**2).sum(), (heights**2).sum()]
    assert pairs == pytest.approx(twin, abs=1e-9)


@pytest.mark.parametrize(
    ("heights", "message"), [(np.zeros((9, 9)), "equal heights"), (np.eye(4), "8 by 8"), (np.ones(9), "shape")]
)
def test_what_has_no_statistics_is_refused(heights, message):
    with pytest.raises(InputError, match=message):
        surface_statistics(heights)
