"""Spectra of Fourier descriptors of outlines of grains, from a few key descriptors.

A radius ``r(t) = r0 (1 + sum of A_n cos(n t) + B_n sin(n t))`` has the descriptors ``D_n = sqrt(A_n^2 + B_n^2)``. D_2
is the elongation, D_3 to D_7 make the main irregularities, and D_8 and above the roughness. D_1 is 0.
"""

import numpy as np

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import Floats
from voxgran._base.config import parameter, parameter_class


@parameter_class
class FourierSpectrum:
    """Key descriptors of a spectrum, as Mollon & Zhao 2012 choose them.

    Parameters
    ----------
    d_2
        descriptor D_2: elongation.
    d_3
        descriptor D_3: irregularity.
    d_8
        descriptor D_8: roughness.
    alpha
        exponent of the decay from D_3 to D_7: D_n = D_3 (n / 3)^alpha.
    beta
        exponent of the decay from D_8 on: D_n = D_8 (n / 8)^beta.
    harmonics
        number of the last harmonic.

    Raises
    ------
    InputError
        If a number is out of range.
    """

    d_2: float = parameter(0.1, at_least=0.0, at_most=1.0)
    d_3: float = parameter(0.1, at_least=0.0, at_most=1.0)
    d_8: float = parameter(0.015, at_least=0.0, at_most=1.0)
    alpha: float = parameter(-2.0, at_least=-10.0, at_most=0.0)
    beta: float = parameter(-2.0, at_least=-10.0, at_most=0.0)
    harmonics: int = parameter(32, at_least=8, at_most=128)


def descriptors(spectrum: FourierSpectrum) -> Floats:
    """Return the descriptors D_0 to D_harmonics, of which the first two are 0."""
    n = np.arange(spectrum.harmonics + 1, dtype=np.float64)
    found = np.zeros(len(n))
    found[2] = spectrum.d_2
    found[3:8] = spectrum.d_3 * libm.power(n[3:8] / 3, spectrum.alpha)
    found[8:] = spectrum.d_8 * libm.power(n[8:] / 8, spectrum.beta)
    return found
