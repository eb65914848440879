import math

import numpy as np
import pytest

from voxgran._base.errors import InputError
from voxgran._base.seeds import stream
from voxgran.containers.kinds.cylinder import Cylinder
from voxgran.containers.model import Container
from voxgran.shapes.mesh import Mesh


def test_signed_distance_equals_the_nearest_of_many_points_of_the_walls():
    from scipy.spatial import cKDTree

    cylinder = Cylinder(1.5, 2.0, origin=(1, -1, 3))
    angle, share = np.meshgrid(np.linspace(0, 2 * np.pi, 400), np.linspace(0, 1, 80))
    c, s, t = np.cos(angle).ravel(), np.sin(angle).ravel(), share.ravel()
    side = np.column_stack([1.5 * c, 1.5 * s, 2 * t])
    caps = [np.column_stack([1.5 * t * c, 1.5 * t * s, np.full(len(t), z)]) for z in (0.0, 2.0)]
    walls = np.concatenate([side, *caps]) + np.array([1, -1, 3])
    points = stream(1, "cylinder").uniform([-1.5, -3.5, 2], [3.5, 1.5, 6], (400, 3))
    sampled, _ = cKDTree(walls).query(points)
    found = cylinder.signed_distance(points)
    inside = (np.hypot(points[:, 0] - 1, points[:, 1] + 1) < 1.5) & (points[:, 2] > 3) & (points[:, 2] < 5)
    np.testing.assert_array_equal(found < 0, inside)
    assert (np.abs(found) <= sampled + 1e-14).all()
    assert (sampled - np.abs(found)).max() < 0.03


def test_known_distances():
    points = [(0, 0, 2), (0.5, 0, 2), (0, 2, 2), (0, 0, 5), (2, 0, 5), (0, 0, -1)]
    expected = [-1, -0.5, 1, 1, math.sqrt(2), 1]
    np.testing.assert_allclose(Cylinder(1, 4).signed_distance(points), expected, atol=1e-15)


def test_volume_bounds_and_mesh_agree():
    cylinder = Cylinder(0.5, 3.0, origin=(1, 2, 3))
    assert cylinder.volume == pytest.approx(math.pi * 0.75, rel=1e-15)
    np.testing.assert_array_equal(cylinder.bounds, [[0.5, 1.5, 3], [1.5, 2.5, 6]])
    mesh = Mesh(*cylinder.mesh())
    assert mesh.volume == pytest.approx(cylinder.volume, rel=2e-3)
    assert cylinder.signed_distance(mesh.vertices).max() < 1e-14
    assert isinstance(cylinder, Container)


def test_scaling_takes_the_base_along():
    assert Cylinder(1, 2, origin=(1, 0, 1)).scaled(0.5) == Cylinder(0.5, 1, origin=(0.5, 0, 0.5))


@pytest.mark.parametrize(("radius", "height"), [(0, 1), (1, -1), (np.nan, 1), (1, np.inf), ("1", 1)])
def test_bad_sizes_are_refused(radius, height):
    with pytest.raises(InputError, match="cylinder"):
        Cylinder(radius, height)
