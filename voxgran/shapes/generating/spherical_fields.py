"""Fields on the sphere as sums of real spherical harmonics, and random ones of given spectra.

The harmonics are Schmidt semi-normalized: those of degree l add up to ``sum of S_lm(u) S_lm(v) = P_l(u . v)``, so that
a field whose coefficients of degree l are independent with variance c_l has the covariance ``sum c_l P_l(u . v)``.
"""

from collections.abc import Iterator

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats


def harmonics(degrees: int, directions: Floats) -> Iterator[tuple[int, int, Floats, Floats]]:
    """Give degree, order, and the harmonics with cos(m t) and sin(m t) of the azimuth t at (n, 3) unit vectors.

    All degrees below the number of degrees are given, order by order; the second part of order 0 is 0.
    """
    x, y, z = directions.T
    flat = np.hypot(x, y)
    # on the axis the azimuth is 0; products of complex numbers have other bits on other processors
    x, y = (np.where(flat > 0, part / np.where(flat > 0, flat, 1.0), along) for part, along in ((x, 1.0), (y, 0.0)))
    cosine, sine, first = np.ones(len(z)), np.zeros(len(z)), np.ones(len(z))
    for m in range(degrees):
        if m:
            cosine, sine = cosine * x - sine * y, sine * x + cosine * y
            first = first * flat * (1.0 if m == 1 else np.sqrt((2 * m - 1) / (2 * m)))
        older, old = np.zeros(len(z)), first
        yield m, m, old * cosine, old * sine
        for degree in range(m + 1, degrees):
            back = np.sqrt((degree - 1) ** 2 - m * m) if degree > m + 1 else 0.0
            new = ((2 * degree - 1) * z * old - back * older) / np.sqrt(degree * degree - m * m)
            yield degree, m, new * cosine, new * sine
            older, old = old, new


def field_values(cosines: Floats, sines: Floats, directions: Floats) -> Floats:
    """Return the values (n,) of a field at (n, 3) unit vectors.

    `cosines` and `sines` (degree, order) are the coefficients of the harmonics with the factors cos(m t) and sin(m t)
    of the azimuth t; entries whose order is above the degree are not used, and sines of order 0 neither.
    """
    total = np.zeros(len(directions))
    for degree, order, cosine, sine in harmonics(len(cosines), directions):
        total += cosines[degree, order] * cosine
        if order:
            total += sines[degree, order] * sine
    return total


def sphere_quadrature(degrees: int) -> tuple[Floats, Floats]:
    """Return directions (n, 3) and weights (n,), of sum 1, that integrate products of harmonics below some degree.

    They are Gauss-Legendre nodes along z and equal steps around it.
    """
    z, weights = linear.gauss_legendre(degrees)
    turns = np.pi * np.arange(2 * degrees) / degrees
    flat = np.sqrt(1 - z * z)[:, None]
    around = [flat * libm.cos(turns), flat * libm.sin(turns), np.broadcast_to(z[:, None], (degrees, 2 * degrees))]
    return np.stack(around, axis=-1).reshape(-1, 3), np.repeat(weights, 2 * degrees) / (4 * degrees)


def coefficients_of(degrees: int, directions: Floats, weights: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Return the coefficients (degree, order) of the field that has given values (n,) at the nodes of a quadrature."""
    cosines, sines = np.zeros((2, degrees, degrees))
    weighted = weights * values
    for degree, order, cosine, sine in harmonics(degrees, directions):
        cosines[degree, order] = (2 * degree + 1) * linear.matmul(weighted, cosine)
        sines[degree, order] = (2 * degree + 1) * linear.matmul(weighted, sine)
    return cosines, sines


def powers_of(cosines: Floats, sines: Floats) -> Floats:
    """Return the power (degree,) of each degree: the part of the mean square of the field that it makes."""
    lower = np.tri(len(cosines))
    squares = lower * (cosines**2 + sines**2)
    return squares.sum(axis=1) / (2 * np.arange(len(cosines)) + 1)


def coefficients_of_powers(powers: Floats, generator: np.random.Generator) -> tuple[Floats, Floats]:
    """Return coefficients (degree, order) of which each degree has a given power and a random direction among all."""
    cosines, sines = generator.standard_normal((2, len(powers), len(powers)))
    sines[:, 0] = 0.0
    lower = np.tri(len(powers))
    cosines, sines = cosines * lower, sines * lower
    factor = np.sqrt(powers / np.maximum(powers_of(cosines, sines), 1e-300))[:, None]
    return cosines * factor, sines * factor


def random_coefficients(variances: Floats, generator: np.random.Generator) -> tuple[Floats, Floats]:
    """Return normally distributed coefficients of a field, (degree, order) each, with a variance for each degree."""
    cosines, sines = generator.standard_normal((2, len(variances), len(variances))) * np.sqrt(variances)[:, None]
    return cosines, sines


def section_table(degrees: int) -> Floats:
    """Return the parts (n, l) of cos(n t) in ``P_l(cos t)``, for n and l below the number of degrees.

    They are products of the coefficients of ``(1 - x)^(-1/2)`` (Laplace; DLMF 18.5.11 with lambda = 1/2).
    """
    factor = np.cumprod([1.0, *((2 * k - 1) / (2 * k) for k in range(1, degrees))])
    table = np.zeros((degrees, degrees))
    for degree in range(degrees):
        for k in range(degree // 2 + 1):
            order = degree - 2 * k
            table[order, degree] = factor[k] * factor[degree - k] * (2.0 if order else 1.0)
    return table


def variances_of_sections(descriptors: Floats) -> Floats:
    """Return the variance of each degree of the isotropic field whose sections have given descriptors, on average.

    Along great circles the mean square of ``A_n^2 + B_n^2`` is that of descriptor n, for n of at least 2; a result
    below 0 says that no isotropic field has these. A part of the order 0 and 1 follows from the higher ones.
    """
    table = section_table(len(descriptors))
    found = np.zeros(len(descriptors))
    found[2:] = linear.solve(table[2:, 2:], descriptors[2:] ** 2 / 2)
    return found
