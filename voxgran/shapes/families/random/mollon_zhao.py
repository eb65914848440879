"""Sand grains whose sections have the Fourier descriptors of outlines of real sand.

The radius is a random field on the sphere, normally distributed and isotropic. Its covariance is such that the
descriptors of sections through the center, in any plane, have the mean squares that are asked for. Mollon & Zhao find
the modes of the field from a covariance matrix on a mesh; they are the spherical harmonics (the theorem of Funk and
Hecke), which are used here. A section of a grain has small descriptors D_0 and D_1 beside those asked for.

References
----------
Mollon & Zhao 2012, Fourier-Voronoi-based generation of realistic samples for discrete modelling of granular materials,
doi:10.1007/s10035-012-0356-x: the spectrum
Mollon & Zhao 2013, Generating realistic 3D sand particles using Fourier descriptors, doi:10.1007/s10035-012-0380-x:
random fields on the sphere whose sections have it
"""

from dataclasses import replace

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran._base.config import parameter, parameter_class
from voxgran._base.errors import InputError
from voxgran.shapes.family import ShapeFamily, sized
from voxgran.shapes.generating.fourier_spectrum import FourierSpectrum, descriptors
from voxgran.shapes.generating.spherical_fields import (
    field_values,
    random_coefficients,
    section_table,
    variances_of_sections,
)
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.tessellate import sphere

#: largest standard deviation of the radius, in mean radii
WIDEST = 0.25
#: smallest radius, in mean ones: fields that go below it are drawn again
LEAST = 0.1
#: negative variances up to this share of the largest are rounding
ROUNDING = 1e-12
#: factor on values that messages propose, so that they hold with three digits
DOWN = 0.99
#: bisections of the largest d_8
HALVINGS = 40


@parameter_class
class MollonZhao(FourierSpectrum):
    """Parameters of a grain whose sections have a Fourier spectrum.

    Parameters
    ----------
    subdivisions
        subdivisions of the triangles of an icosahedron into four, for the mesh.
    diameter
        equivalent diameter; default: 1.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.shapes.mollon_zhao(subdivisions=2, d_2=0.15, seed=1)
    Shape('mollon_zhao', mesh, diameter=1)
    """

    subdivisions: int = parameter(4, at_least=2, at_most=7)
    diameter: float | None = parameter(None, unit="length", above=0.0)


def make(parameters: MollonZhao, generator: np.random.Generator) -> Shape:
    """Return a random grain."""
    variances = variances_of(parameters)
    directions, faces, _ = sphere(parameters.subdivisions)
    while True:
        radius = 1 + field_values(*random_coefficients(variances, generator), directions)
        if radius.min() >= LEAST:
            return sized(Mesh(radius[:, None] * directions, faces), parameters.diameter, name="mollon_zhao")


def variances_of(spectrum: FourierSpectrum) -> Floats:
    """Return the variance of the radius, in mean radii, of each degree of the harmonics.

    Raises
    ------
    InputError
        If no isotropic field has this spectrum, or the radius varies so much that it may fall to 0.
    """
    found = variances_of_sections(descriptors(spectrum))
    below = ROUNDING * float(found.max(initial=0.0))
    if (found[3:] < -below).any():
        raise InputError(
            f"d_8 is {spectrum.d_8:g} with d_3 of {spectrum.d_3:g}: no random surface has such sections, since those "
            f"of small waves have longer ones too; give d_8 of at most {_largest_d_8(spectrum):.3g}, or a larger d_3"
        )
    if found[2] < -below:
        least = float(np.sqrt(linear.matmul(2 * section_table(len(found))[2, 3:], found[3:]))) / DOWN
        raise InputError(
            f"d_2 is {spectrum.d_2:g} with d_3 of {spectrum.d_3:g}: no random surface has such sections, since those "
            f"of small waves have longer ones too; give d_2 of at least {least:.3g}, or a smaller d_3"
        )
    deviation = float(np.sqrt(np.maximum(found, 0.0).sum()))
    if deviation > WIDEST:
        raise InputError(
            f"descriptors make a radius with a standard deviation of {deviation:.3g} of its mean: it may be at most "
            f"{WIDEST}, so that it stays above 0; give d_2, d_3 and d_8 of {DOWN * WIDEST / deviation:.3g} times their "
            "values"
        )
    return np.maximum(found, 0.0)


def _largest_d_8(spectrum: FourierSpectrum) -> float:
    """Return the largest d_8 that an isotropic field can have with the other descriptors, rounded down."""
    low, high = 0.0, spectrum.d_8
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        found = variances_of_sections(descriptors(replace(spectrum, d_8=middle)))
        low, high = (middle, high) if (found[3:] >= 0).all() else (low, middle)
    return low * DOWN


registration = ShapeFamily(
    summary="sand grain whose sections have given Fourier descriptors",
    parameters=MollonZhao,
    make=make,
    source="Mollon & Zhao 2013, doi:10.1007/s10035-012-0380-x",
    random=True,
)
