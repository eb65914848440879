import numpy as np
import pytest

from voxgran._base.errors import InputError
from voxgran._base.seeds import stream
from voxgran.containers.kinds.rectangle import Rectangle
from voxgran.containers.model import Container


def test_signed_distance_equals_the_nearest_of_many_points_of_the_walls():
    rectangle = Rectangle((2.0, 1.0), origin=(1, 1))
    t = np.linspace(0, 1, 500)
    ends = [((1, 1), (3, 1)), ((3, 1), (3, 2)), ((3, 2), (1, 2)), ((1, 2), (1, 1))]
    walls = np.concatenate([np.outer(1 - t, a) + np.outer(t, b) for a, b in ends])
    points = stream(1, "rectangle").uniform(0, 4, (300, 2))
    sampled = np.linalg.norm(points[:, None] - walls, axis=2).min(axis=1)
    found = rectangle.signed_distance(points)
    np.testing.assert_allclose(np.abs(found), sampled, atol=5e-3)
    inside = ((points > (1, 1)) & (points < (3, 2))).all(axis=1)
    np.testing.assert_array_equal(found < 0, inside)
    np.testing.assert_array_equal(found, rectangle.signed_distance(np.column_stack([points, np.zeros(300)])))


def test_two_dimensions_and_three_flags():
    rectangle = Rectangle((4, 2), periodic=["x"])
    assert rectangle.dimension == 2
    assert rectangle.periodic == (True, False, False)
    assert rectangle.volume == 8.0
    np.testing.assert_array_equal(rectangle.bounds, [[0, 0, 0], [4, 2, 0]])
    assert rectangle.signed_distance([(100, 0.5, 0)]) == -0.5
    assert isinstance(rectangle, Container)


def test_mesh_covers_the_area():
    vertices, faces = Rectangle((4, 2), origin=(1, 1)).mesh()
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    assert np.cross(b - a, c - a)[:, 2].sum() / 2 == 8.0


def test_scaling_takes_the_corner_along():
    assert Rectangle((4, 2), (True, False), origin=(1, 1)).scaled(2) == Rectangle((8, 4), (True, False), origin=(2, 2))


@pytest.mark.parametrize("lengths", [(0, 1), (1, -1), (np.nan, 1), (1, 1, 1)])
def test_bad_lengths_are_refused(lengths):
    with pytest.raises(InputError):
        Rectangle(lengths)


def test_points_need_two_or_three_columns():
    with pytest.raises(InputError, match="shape"):
        Rectangle((1, 1)).signed_distance([(1, 2, 3, 4)])
