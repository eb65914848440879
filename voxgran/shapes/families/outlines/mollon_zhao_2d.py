"""Outlines of sand grains in the plane, from Fourier descriptors of their radius and random phases.

The descriptors D_2 (elongation), D_3 (irregularity) and D_8 (roughness) are those of the outline, with a power law
between and behind them; every outline has exactly these, about the origin of the polar angle.

References
----------
Mollon & Zhao 2012, Fourier-Voronoi-based generation of realistic samples for discrete modelling of granular materials,
doi:10.1007/s10035-012-0356-x
"""

import numpy as np

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import Floats
from voxgran._base.config import parameter, parameter_class
from voxgran._base.errors import InputError
from voxgran.shapes.family import ShapeFamily, sized
from voxgran.shapes.generating.fourier_spectrum import FourierSpectrum, descriptors
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline

#: corners per period of the last harmonic
CORNERS = 4
#: largest sum of the descriptors, at which the smallest radius is still positive whatever the phases
LARGEST = 0.95


@parameter_class
class MollonZhao2d(FourierSpectrum):
    """Parameters of a grain in the plane with a Fourier spectrum.

    Parameters
    ----------
    diameter
        diameter of the disk of equal area; default: 1.

    Examples
    --------
    >>> import voxgran as vg
    >>> grain = vg.shapes.mollon_zhao_2d(d_2=0.15, seed=1)
    >>> grain.dimension, round(grain.diameter, 6)
    (2, 1.0)
    """

    diameter: float | None = parameter(None, unit="length", above=0.0)


def make(parameters: MollonZhao2d, generator: np.random.Generator) -> Shape:
    """Return a random outline.

    Raises
    ------
    InputError
        If the descriptors are so large that the radius could fall to 0.
    """
    found = descriptors(parameters)
    if found.sum() > LARGEST:
        part = np.floor(1000 * LARGEST / found.sum()) / 1000
        raise InputError(
            f"descriptors add up to {found.sum():.3g}: above {LARGEST} the radius may fall to 0; give d_2, d_3 and d_8 "
            f"of {part:g} times their values"
        )
    corners = outline(found, 2 * np.pi * generator.random(len(found)), CORNERS * parameters.harmonics)
    return sized(Outline("polygon", vertices=corners), parameters.diameter, name="mollon_zhao_2d")


def outline(found: Floats, phases: Floats, corners: int) -> Floats:
    """Return the corners (n, 2) of an outline of mean radius 1 with descriptors and phases, at equal angles."""
    angles = 2 * np.pi * np.arange(corners) / corners
    # the sum over harmonics, as the inverse of a discrete Fourier transform
    waves = np.zeros(corners // 2 + 1, dtype=np.complex128)
    waves[: len(found)] = found * (libm.cos(phases) + 1j * libm.sin(phases)) / 2
    radius = 1 + np.fft.irfft(waves, corners) * corners
    return radius[:, None] * np.column_stack([libm.cos(angles), libm.sin(angles)])


registration = ShapeFamily(
    summary="outline of a sand grain from Fourier descriptors, in 2D",
    parameters=MollonZhao2d,
    make=make,
    source="Mollon & Zhao 2012, doi:10.1007/s10035-012-0356-x",
    dimension=2,
    random=True,
)
