"""Platonic solids: the five regular convex polyhedra, the shapes of common dice."""

from typing import get_args

import numpy as np

from voxgran._base.arrays import as_choice
from voxgran._base.config import parameter, parameter_class
from voxgran.shapes.family import ShapeFamily, Sized, sized
from voxgran.shapes.generating.regular_solids import PlatonicSolid, corners_of
from voxgran.shapes.mesh import hull_of
from voxgran.shapes.model import Shape


@parameter_class
class Platonic(Sized):
    """Parameters of a Platonic solid.

    Parameters
    ----------
    solid
        which of the five Platonic solids.

    Examples
    --------
    >>> import voxgran as vg
    >>> len(vg.shapes.platonic(solid="dodecahedron").vertices)
    20
    """

    solid: PlatonicSolid = parameter("icosahedron")


def make(parameters: Platonic, generator: np.random.Generator) -> Shape:
    """Return the solid; nothing is random."""
    as_choice(parameters.solid, "solid", get_args(PlatonicSolid))
    return sized(hull_of(corners_of(parameters.solid)), parameters.diameter, name="platonic")


registration = ShapeFamily(
    summary="tetrahedron, cube, octahedron, dodecahedron or icosahedron", parameters=Platonic, make=make
)
