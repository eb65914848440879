"""Autocorrelation functions and power spectra of isotropic random fields in one to three dimensions.

Distances are in correlation lengths, at which the autocorrelation is 1/e, and wave numbers in their inverse. The
power spectral density of a self-affine field of Hurst exponent H in d dimensions falls with the wave number q as
``q**(-d - 2 * H)`` between its roll-off, below which it is constant, and its cut-off, above which it is 0
(conventions of Jacobs, Junge & Pastewka 2017, doi:10.1088/2051-672X/aa51f8).
"""

import math

import numpy as np

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import Floats
from voxgran._base.errors import InputError
from voxgran._base.lazy import load

#: least roll-off that is searched, and number of wave numbers of integrals over the spectrum
LEAST, WAVES = 1e-6, 800


def correlation(kind: str, distance: Floats) -> Floats:
    """Return an autocorrelation function in closed form at distances: exponential, gaussian or linear."""
    if kind == "exponential":
        return np.asarray(libm.exp(-distance))
    if kind == "gaussian":
        return np.asarray(libm.exp(-(distance**2)))
    return np.asarray(np.maximum(0.0, 1.0 - (1.0 - math.exp(-1.0)) * distance))


def self_affine_density(q: Floats, hurst: float, roll_off: float, cut_off: float, dimension: int) -> Floats:
    """Return the power spectral density at wave numbers, in units of that below the roll-off."""
    density = libm.power(np.maximum(q / roll_off, 1.0), -dimension - 2 * hurst)
    return np.asarray(np.where(q <= cut_off, density, 0.0))


def self_affine_correlation(distance: Floats, hurst: float, roll_off: float, cut_off: float, dimension: int) -> Floats:
    """Return the autocorrelation at distances (n,): the integral of the spectrum with the waves of all directions."""
    low = np.linspace(0.0, roll_off, WAVES // 4 + 1)
    high = np.geomspace(roll_off, cut_off, WAVES)
    total, variance = np.zeros(len(distance)), 0.0
    for q in (low, high):
        density = self_affine_density(q, hurst, roll_off, cut_off * (1 + 1e-12), dimension) * libm.power(
            q, dimension - 1
        )
        phase = distance[:, None] * q
        total += np.trapezoid(_waves(phase, dimension) * density, q, axis=1)
        variance += float(np.trapezoid(density, q))
    return total / variance


def _waves(phase: Floats, dimension: int) -> Floats:
    """Return the mean of plane waves of all directions at a distance."""
    if dimension == 1:
        return np.asarray(libm.cos(phase))
    return np.asarray(load("scipy.special").j0(phase) if dimension == 2 else np.sinc(phase / np.pi))


def roll_off_of(hurst: float, cut_off: float, dimension: int, *, length: float = 1.0) -> float:
    """Return the roll-off at which the autocorrelation of a self-affine field is 1/e at the distance 1.

    `length` is the correlation length, which is the unit of distances, in that of the message.

    Raises
    ------
    InputError
        If the shortest wavelength is too long or too short for that.
    """

    def excess(log_roll: float) -> float:
        return float(self_affine_correlation(np.ones(1), hurst, math.exp(log_roll), cut_off, dimension)[0]) - math.exp(
            -1
        )

    if excess(math.log(cut_off) - 1e-9) > 0:
        raise InputError(
            f"shortest is {2 * math.pi / cut_off * length:.4g} and the correlation length is {length:.4g}: waves of "
            f"this length and above do not lose their correlation within that; give less than {2 * length:.4g}"
        )
    if excess(math.log(LEAST * cut_off)) < 0:
        raise InputError(
            f"shortest is {2 * math.pi / cut_off * length:.4g} and the correlation length is {length:.4g}: their "
            f"ratio must be below {1 / LEAST:g}; give a longer one"
        )
    return math.exp(load("scipy.optimize").brentq(excess, math.log(LEAST * cut_off), math.log(cut_off) - 1e-9))
