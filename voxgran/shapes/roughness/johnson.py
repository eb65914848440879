"""Heights of given skewness and kurtosis: Johnson's transformations of a Gaussian field.

A height is ``f(g)`` of a Gaussian height g, with f monotone and of mean 0 and variance 1: a hyperbolic sine (unbounded
heights), a logistic function (bounded ones) or, between them, an exponential function (Johnson 1949,
doi:10.1093/biomet/36.1-2.149; Hill, Hill & Holder 1976, doi:10.2307/2346692). All pairs of skewness and kurtosis that a
random number can have are reached by one of them. The autocorrelation of f(g) is a power series in that of g, with the
squared Hermite coefficients of f, so that g is given the autocorrelation from which the wanted one results.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import Floats
from voxgran._base.errors import InputError
from voxgran._base.lazy import load

#: Gaussian heights at which integrals are summed; the trapezoidal rule converges exponentially here
NODES = np.linspace(-14.0, 14.0, 4001)
#: number of terms of the power series
TERMS = 40
#: heights are transformed by tables of this many entries
TABLE = 4001
#: largest kurtosis; above it a sample holds too few of the highest peaks for its own kurtosis to mean anything
MOST_KURTOSIS = 50.0
#: smallest distance from the least kurtosis, skewness**2 + 1, at which all heights are one of two values
LEAST_EXCESS = 0.3


@dataclass(frozen=True, slots=True)
class Johnson:
    """Heights ``(f((g - gamma) / delta) - mean) / deviation`` of Gaussian heights g."""

    kind: str  # "unbounded", "bounded", "lognormal" or "normal"
    gamma: float = 0.0
    delta: float = 1.0
    mean: float = 0.0
    deviation: float = 1.0
    sign: float = 1.0  # -1 mirrors the heights

    def of(self, gaussian: Floats) -> Floats:
        """Return the heights of Gaussian heights of variance 1."""
        if self.kind == "normal":
            return gaussian
        raw = _raw(self.kind, (self.sign * gaussian - self.gamma) / self.delta)
        return np.asarray(self.sign * (raw - self.mean) / self.deviation)

    def gaussian_correlation(self, wanted: Floats) -> Floats:
        """Return the autocorrelations of the Gaussian heights from which the wanted ones result."""
        if self.kind == "normal":
            return wanted
        heights, density = self.of(NODES), _density()
        before, now = np.ones_like(NODES), NODES
        rho = libm.sin(np.linspace(-np.pi / 2, np.pi / 2, TABLE))
        power, total = np.ones(TABLE), np.zeros(TABLE)
        for k in range(1, TERMS + 1):
            # normalized Hermite polynomials, so that no factorial overflows
            power = power * rho
            total += float((heights * now * density).sum()) ** 2 * power
            before, now = now, (NODES * now - math.sqrt(k) * before) / math.sqrt(k + 1)
        return np.asarray(np.interp(wanted, total / total[-1], rho))


def _density() -> Floats:
    """Return the weights of the nodes in integrals over Gaussian heights."""
    weights = libm.exp(-(NODES**2) / 2)
    return np.asarray(weights / weights.sum())


def _raw(kind: str, x: Floats) -> Floats:
    """Return the function before it is normalized."""
    if kind == "unbounded":
        return libm.sinh(x)
    return libm.exp(x) if kind == "lognormal" else 0.5 * (1.0 + libm.tanh(x / 2))


def _moments(kind: str, gamma: float, delta: float) -> tuple[float, float, float, float]:
    """Return mean, standard deviation, skewness and kurtosis of the raw heights."""
    raw, density = _raw(kind, (NODES - gamma) / delta), _density()
    mean = float((raw * density).sum())
    deviations = raw - mean
    second, third, fourth = (float((libm.power(deviations, k) * density).sum()) for k in (2, 3, 4))
    return mean, math.sqrt(second), third / second**1.5, fourth / second**2


@lru_cache(maxsize=64)
def johnson(skewness: float, kurtosis: float) -> Johnson:
    """Return the transformation to heights of a skewness and a kurtosis (3 for Gaussian heights).

    Raises
    ------
    InputError
        If no heights have both, or the kurtosis is above 50.
    """
    least = abs(skewness) * min(abs(skewness), 1e6) + 1.0 + LEAST_EXCESS
    if not least <= kurtosis <= MOST_KURTOSIS:
        rule = f"with the skewness {skewness:g} it must be at least {least:.4g} (skewness squared plus 1.3) and at most"
        raise InputError(f"kurtosis is {kurtosis:g}: {rule} {MOST_KURTOSIS:g}; change one of the two")
    if skewness == 0.0 and kurtosis == 3.0:
        return Johnson("normal")
    sign, skewness = math.copysign(1.0, skewness), abs(skewness)
    # the lognormal heights of this skewness, the positive root of w^3 + 3 w^2 - 4 = skewness^2
    w = 2.0 * math.cosh(math.acosh(1.0 + skewness**2 / 2.0) / 3.0) - 1.0
    border = w**4 + 2 * w**3 + 3 * w**2 - 3
    if skewness > 0.05 and abs(kurtosis - border) < 1e-6 * border:
        kind, gamma, delta = "lognormal", 0.0, 1.0 / math.sqrt(math.log(w))
    else:
        kind = "unbounded" if kurtosis > border else "bounded"
        gamma, delta = _fitted(kind, skewness, kurtosis)
    mean, deviation, *_ = _moments(kind, gamma, delta)
    return Johnson(kind, gamma, delta, mean, deviation, sign)


def _fitted(kind: str, skewness: float, kurtosis: float) -> tuple[float, float]:
    """Return shift and scale that give skewness and kurtosis, from the best of a grid on."""

    def miss(x: Floats) -> list[float]:
        *_, third, fourth = _moments(kind, float(x[0]), math.exp(float(x[1])))
        return [third - skewness, math.log((fourth - third**2 - 1) / (kurtosis - skewness**2 - 1))]

    side = -1.0 if kind == "unbounded" else 1.0
    starts = [np.array([side * g, d]) for g in (0.0, 0.5, 1.0, 2.0, 4.0, 8.0) for d in (-0.9, -0.5, 0.0, 0.5, 1.0, 1.6)]
    starts.sort(key=lambda x: float(np.abs(miss(x)).sum()))
    for start in starts[:8]:
        found = load("scipy.optimize").root(miss, start, method="hybr", tol=1e-12)
        if np.abs(found.fun).max() < 1e-9:
            return float(found.x[0]), math.exp(float(found.x[1]))
    raise InputError(
        f"skewness is {skewness:g} and kurtosis {kurtosis:g}: no transformation of Gaussian heights was found that has "
        "both; change one of the two"
    )
