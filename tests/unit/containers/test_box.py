import numpy as np
import pytest

from voxgran._base.errors import InputError
from voxgran._base.seeds import stream
from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.rectangle import Rectangle
from voxgran.containers.model import Container
from voxgran.shapes.mesh import Mesh


def wall_samples(box, count=60):
    """Points spread over the walls of a box."""
    low, high = box.bounds
    ticks = [np.linspace(a, b, count) for a, b in zip(low, high, strict=True)]
    points = []
    for axis in range(3):
        if not box.periodic[axis]:
            others = [k for k in range(3) if k != axis]
            u, v = np.meshgrid(*(ticks[k] for k in others))
            for side in (low, high):
                wall = np.full((u.size, 3), side[axis])
                wall[:, others[0]], wall[:, others[1]] = u.ravel(), v.ravel()
                points.append(wall)
    return np.concatenate(points)


def test_signed_distance_equals_the_nearest_of_many_points_of_the_walls():
    from scipy.spatial import cKDTree

    box = Box((1.0, 2.0, 3.0), origin=(-1.0, 0.5, 2.0))
    points = stream(1, "box").uniform([-2, -1, 1], [1, 4, 6], (400, 3))
    sampled, _ = cKDTree(wall_samples(box)).query(points)
    found = box.signed_distance(points)
    low, high = box.bounds
    np.testing.assert_array_equal(found < 0, ((points > low) & (points < high)).all(axis=1))
    assert (np.abs(found) <= sampled + 1e-14).all()
    assert (sampled - np.abs(found)).max() < 0.04


def test_known_distances():
    box = Box((2, 2, 2))
    points = [(1, 1, 1), (1, 1, 1.75), (1, 1, 3), (3, 3, 1), (3, 3, 3), (2, 1, 1)]
    np.testing.assert_allclose(box.signed_distance(points), [-1, -0.25, 1, 2**0.5, 3**0.5, 0], atol=1e-15)


def test_periodic_axes_have_no_wall():
    box = Box((1, 1, 2), periodic=(True, True, False))
    np.testing.assert_array_equal(box.signed_distance([(7.5, -3, 0.5), (0, 0, 2.5)]), [-0.5, 0.5])
    assert (Box((1, 1, 1), periodic=(True,) * 3).signed_distance(np.zeros((3, 3))) == -np.inf).all()


def test_volume_bounds_and_mesh_agree():
    box = Box((1.0, 2.0, 3.0), origin=(4, 5, 6))
    mesh = Mesh(*box.mesh())
    assert box.volume == 6.0
    assert mesh.volume == pytest.approx(6.0, rel=1e-14)
    np.testing.assert_array_equal([mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)], box.bounds)
    assert isinstance(box, Container)


def test_scaling_takes_the_corner_along():
    box = Box((1, 2, 3), periodic=(True, False, False), origin=(1, 1, 1)).scaled(4.0)
    assert box == Box((4, 8, 12), periodic=(True, False, False), origin=(4, 4, 4))


@pytest.mark.parametrize("lengths", [(0, 1, 1), (1, -1, 1), (1, np.nan, 1), (1, 1), (1, 1, np.inf), "abc"])
def test_bad_lengths_are_refused(lengths):
    with pytest.raises(InputError):
        Box(lengths)


def test_a_rectangle_has_two_axes():
    assert Rectangle((1, 1), True).periodic == (True, True, False)
    with pytest.raises(InputError, match="periodic is 3: it must name axes out of x, y, each once"):
        Rectangle((1, 1), 3)


@pytest.mark.parametrize("given", [4, None])
def test_one_number_makes_no_corner(given):
    with pytest.raises(InputError, match=f"lengths is {given}: it must be an array of numbers of shape .3,.; give one"):
        Box(given)
    with pytest.raises(InputError, match=f"origin is {given}: it must be an array of numbers of shape .3,.; give one"):
        Box((1, 1, 1), origin=given)


def test_points_must_be_finite():
    with pytest.raises(InputError, match="finite"):
        Box((1, 1, 1)).signed_distance([(0, 0, np.nan)])
