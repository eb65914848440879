import math

import numpy as np
import pytest

from voxgran._base.errors import InputError
from voxgran._base.seeds import stream
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.repairing.diagnose import diagnose
from voxgran.shapes.spheres import Spheres, _measure_way_out

DUMBBELL = Spheres(np.array([[0.0, 0.0, 0.0], [1.5, 0.0, 0.0]]), np.array([1.0, 1.0]))


def test_two_spheres_are_two_spheres_less_their_lens():
    lens = math.pi * (2 * 1.0 - 1.5) ** 2 * (1.5**2 + 4 * 1.5) / (12 * 1.5)
    assert DUMBBELL.volume == pytest.approx(8 / 3 * math.pi - lens, rel=1e-14)
    assert DUMBBELL.surface_area == pytest.approx(8 * math.pi - 2 * 2 * math.pi * 0.25, rel=1e-14)
    assert DUMBBELL.centroid == pytest.approx([0.75, 0, 0], abs=1e-15)
    assert DUMBBELL.bounding_radius == 2.5


def test_apart_spheres_are_sums():
    generator = stream(0, "apart")
    centers = np.array([[x, y, 0.0] for x in range(3) for y in range(3)]) * 3 + generator.random((9, 3))
    radii = 0.2 + 0.5 * generator.random(9)
    union = Spheres(centers, radii)
    volumes = 4 / 3 * math.pi * radii**3
    middle = volumes @ centers / volumes.sum()
    p = centers - middle
    second = np.einsum("n,ni,nj->ij", volumes, p, p) + np.eye(3) * (volumes * radii**2).sum() / 5
    assert union.volume == pytest.approx(volumes.sum(), rel=1e-14)
    assert union.centroid == pytest.approx(middle, rel=1e-13)
    inertia = np.trace(second) * np.eye(3) - second
    assert union.inertia == pytest.approx(inertia, rel=1e-13, abs=1e-13 * np.trace(inertia))
    assert union.surface_area == pytest.approx((4 * math.pi * radii**2).sum(), rel=1e-14)


def test_digits_are_kept_far_from_the_origin():
    far = DUMBBELL.moved(np.array([1e6, -2e6, 3e6]))
    assert far.volume == pytest.approx(DUMBBELL.volume, rel=1e-9)  # the centers themselves lose 1e-10
    assert far.inertia == pytest.approx(DUMBBELL.inertia, rel=1e-8, abs=1e-8)


def test_points_are_inside_any_sphere():
    points = stream(1, "points").random((500, 3)) * 4 - 1
    expected = (np.linalg.norm(points[:, None] - DUMBBELL.centers, axis=2) <= 1).any(axis=1)
    assert (DUMBBELL.contains(points) == expected).all()
    assert DUMBBELL.contains(np.array([[-1.0, 0, 0], [2.5, 0, 0]])).all()


def test_way_out_is_the_depth_within_one_sphere_and_no_less_than_it_in_a_crease():
    points = stream(2, "points").random((200, 3)) * [2, 1, 1] - [0.5, 0.5, 0.5]
    paths = np.zeros(200)
    _measure_way_out(points, DUMBBELL.centers, DUMBBELL.radii, paths)
    depth = (1 - np.linalg.norm(points[:, None] - DUMBBELL.centers, axis=2)).max(axis=1).clip(0)
    assert (paths >= depth * (1 - 1e-9)).all()
    plain = np.zeros(200)
    _measure_way_out.plain(points, DUMBBELL.centers, DUMBBELL.radii, plain)
    assert plain == pytest.approx(paths, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("count", [1, 2, 12])
def test_tessellation_is_one_closed_surface_within_its_error(count):
    generator = stream(count, "spheres")
    union = Spheres(generator.random((count, 3)), 0.5 + 0.3 * generator.random(count))
    vertices, faces, error = union.tessellation()
    found = diagnose(vertices, faces)
    assert found.ok, found.sentences()
    mesh = Mesh(vertices, faces)
    assert -4 * error < mesh.volume / union.volume - 1 < 0
    outside = np.linalg.norm(vertices[:, None] - union.centers, axis=2) - union.radii
    assert np.abs(outside.min(axis=1)).max() <= error


def test_spheres_that_touch_are_tessellated_apart():
    union = Spheres(np.array([[0.0, 0, 0], [2, 0, 0]]), np.array([1.0, 1.0]))
    assert diagnose(*union.tessellation()[:2]).bodies == 2


def test_shape_of_spheres_lies_about_its_centroid():
    shape = Shape.of(DUMBBELL, name="dumbbell")
    assert shape.offset == pytest.approx((0.75, 0, 0))
    assert shape.diameter == pytest.approx((6 * DUMBBELL.volume / math.pi) ** (1 / 3))
    assert shape.scaled(2.0).volume == pytest.approx(8 * shape.volume, rel=1e-14)
    assert shape.key != shape.scaled(2.0).key


def test_arrays_are_frozen_and_copied():
    centers, radii = np.zeros((1, 3)), np.ones(1)
    union = Spheres(centers, radii)
    radii[0] = 5
    assert union.radii[0] == 1
    with pytest.raises(ValueError, match="read-only"):
        union.radii[0] = 2


@pytest.mark.parametrize(
    ("centers", "radii", "message"),
    [
        (np.zeros((0, 3)), np.zeros(0), "no sphere"),
        (np.zeros((2, 3)), np.ones(1), "shape"),
        (np.zeros((2, 3)), np.array([1.0, -2.0]), "radius of sphere 1 is -2.0"),
        (np.zeros((1, 3)), np.array([math.nan]), "finite"),
    ],
)
def test_bad_spheres_are_refused(centers, radii, message):
    with pytest.raises(InputError, match=message):
        Spheres(centers, radii)
