"""Gaussian random spheres: the logarithm of the radius is a Gaussian random field on the sphere.

Two points of the surface have radii that are more alike the smaller the angle between them is: the correlation of their
logarithms is ``exp(-2 sin(g / 2)^2 / l^2)`` for the angle g, with the correlation length ``l = 2 sin(G / 2)`` for the
correlation angle G. Small angles give rough grains, large ones smooth grains.

References
----------
Muinonen, Nousiainen, Fast, Lumme & Peltoniemi 1996, doi:10.1016/0022-4073(96)00003-9: Gaussian random particles
"""

import math

import numpy as np

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import Floats
from voxgran._base.config import parameter, parameter_class
from voxgran._base.lazy import load
from voxgran.shapes.family import ShapeFamily, Sized, sized
from voxgran.shapes.generating.spherical_fields import field_values, random_coefficients
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.tessellate import sphere

#: part of the variance that degrees beyond the largest one may have
LEFT = 1e-6
#: largest number of degrees
MOST_DEGREES = 120


@parameter_class
class NoiseStar(Sized):
    """Parameters of a Gaussian random sphere.

    Parameters
    ----------
    deviation
        standard deviation of the radius, in mean radii.
    correlation_angle
        angle over which radii are correlated.
    subdivisions
        number of subdivisions of the icosahedron.

    Raises
    ------
    InputError
        If a number is out of range.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.shapes.noise_star(deviation=0.1, subdivisions=2, seed=1)
    Shape('noise_star', mesh, diameter=1)
    """

    deviation: float = parameter(0.2, at_least=0.0, at_most=1.0)
    correlation_angle: float = parameter(35.0, unit="degrees", at_least=8.0, at_most=180.0)
    subdivisions: int = parameter(4, at_least=2, at_most=6)


def make(parameters: NoiseStar, generator: np.random.Generator) -> Shape:
    """Return a random grain."""
    directions, faces, _ = sphere(parameters.subdivisions)
    variances = variances_of(parameters.deviation, parameters.correlation_angle)
    radius = libm.exp(field_values(*random_coefficients(variances, generator), directions))
    return sized(Mesh(radius[:, None] * directions, faces), parameters.diameter, name="noise_star")


def variances_of(deviation: float, correlation_angle: float) -> Floats:
    """Return the variance of the logarithm of the radius that each degree has; the angle is in degrees.

    The correlation ``exp(-x (1 - cos g))``, with x = 1 / l^2, is the sum of ``(2 n + 1) exp(-x) i_n(x) P_n(cos g)``
    with the modified spherical Bessel functions i_n (DLMF 10.60.7).
    """
    x = 1.0 / (2.0 * math.sin(math.radians(correlation_angle) / 2)) ** 2
    degrees = np.arange(MOST_DEGREES)
    # exp(-x) i_n(x), without the overflow of i_n
    scaled = np.sqrt(np.pi / (2 * x)) * load("scipy.special").ive(degrees + 0.5, x)
    parts = (2 * degrees + 1) * scaled
    needed = int(np.argmax(np.cumsum(parts) >= 1 - LEFT)) + 1
    return np.asarray(math.log1p(deviation**2) * parts[:needed])


registration = ShapeFamily(
    summary="star-shaped grain whose radius is a log-normal random field",
    parameters=NoiseStar,
    make=make,
    source="Muinonen et al. 1996, doi:10.1016/0022-4073(96)00003-9",
    random=True,
)
