"""What every shape family must keep, as a class of tests to derive from."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
import pytest

from voxgran._base.config import parameters_of, to_mapping
from voxgran.shapes.family import ShapeFamily, families, make_shape
from voxgran.shapes.mesh import refuse_unfit
from voxgran.shapes.model import Shape
from voxgran.shapes.repairing.diagnose import refuse_dirty


class ShapeFamilySuite:
    """Tests of one shape family; derive from it in a test file and name the family.

    Attributes
    ----------
    family : str
        Name under which the family is registered.
    parameters : mapping
        Parameters of the shapes that are made; all others have their defaults.
    tessellation_error : float
        Largest distance of a tessellation from the true surface, in equivalent diameters.

    Examples
    --------
    >>> from voxgran.testing import ShapeFamilySuite
    >>> class TestCone(ShapeFamilySuite):
    ...     family = "cone"
    """

    family: ClassVar[str] = ""
    parameters: ClassVar[Mapping[str, Any]] = {}
    tessellation_error: ClassVar[float] = 0.02

    @classmethod
    def entry(cls) -> ShapeFamily:
        """Return the registration of the family."""
        return families().get(cls.family)

    @classmethod
    def shape(cls, *, seed: int = 0, **parameters: Any) -> Shape:
        """Return a shape of the family."""
        return make_shape(cls.family, seed=seed, **{**cls.parameters, **parameters})

    def test_the_diameter_is_one_or_what_is_asked_for(self) -> None:
        """The equivalent diameter is 1 unless another one is given, and the centroid is the origin."""
        shape = self.shape()
        assert shape.diameter == pytest.approx(1.0, rel=1e-14)
        assert self.shape(diameter=3.0).diameter == pytest.approx(3.0, rel=1e-14)
        assert shape.geometry.centroid == pytest.approx(np.zeros(3), abs=1e-13)

    def test_the_shape_is_what_the_registration_says(self) -> None:
        """Name, dimension, and whether the shape is an open surface."""
        shape, entry = self.shape(), self.entry()
        assert shape.name == self.family == entry.name
        assert shape.dimension == entry.dimension
        assert shape.is_open == entry.is_open

    def test_same_seed_same_bits(self) -> None:
        """Shapes of one seed are equal to the last bit; those of another seed differ where the family is random."""
        keys = [self.shape(seed=seed).key for seed in (0, 0, 1)]
        assert keys[0] == keys[1]
        assert (keys[0] != keys[2]) == self.entry().random

    def test_the_tessellation_bounds_one_solid_or_is_one_open_surface(self) -> None:
        """Triangles are closed, outward and free of crossings, and near the true surface."""
        shape = self.shape()
        if shape.is_open:
            refuse_unfit(shape.vertices, shape.faces, self.family)
        elif shape.dimension == 3:
            refuse_dirty(shape.vertices, shape.faces, self.family)
        assert shape.tessellation_error <= self.tessellation_error

    def test_parameters_explain_themselves(self) -> None:
        """Each parameter has a meaning and a default that a file can hold."""
        entry = self.entry()
        assert entry.summary
        for parameter in parameters_of(entry.parameters):
            assert parameter.doc, parameter.name
        assert to_mapping(entry.parameters(**self.parameters))
