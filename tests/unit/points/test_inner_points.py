"""Control points inside of shapes."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran.contacts.inside import inner_distance
from voxgran.points.control import inner_count, inner_points

SHAPES = [
    vg.make_shape("box", lengths=(1.1, 0.9, 0.7)),
    vg.make_shape("sphere"),
    vg.make_shape("solid_union", seed=3),
    vg.make_shape("polygon", seed=1),
]


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.name)
def test_each_place_inside_has_a_point_within_half_the_spacing(shape):
    """Or is as near to the surface; and there are as many points as the volume says."""
    spacing = 0.15
    points = inner_points(shape, spacing=spacing)
    inner = inner_distance(shape.geometry)
    low, high = shape.vertices.min(axis=0), shape.vertices.max(axis=0)
    places = low + (high - low) * np.random.Generator(np.random.Philox(1)).random((4000, 3))
    depth = inner(places)
    near = cKDTree(points).query(places)[0]
    assert (inner(points) > -1e-12).all()
    assert (near <= spacing / 2)[depth > spacing / 2].all()
    assert near[depth > spacing / 2].max() > 0.8 * spacing / 2
    assert len(points) == pytest.approx(inner_count(shape, spacing=spacing), rel=0.15)


def test_bad_spacings_are_named():
    with pytest.raises(InputError, match="spacing is -1"):
        inner_points(SHAPES[0], spacing=-1.0)
    with pytest.raises(InputError, match="needs more than 500000 points"):
        inner_points(SHAPES[0], spacing=0.01)
