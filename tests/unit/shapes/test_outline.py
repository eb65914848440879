import math

import numpy as np
import pytest

from voxgran._base.errors import InputError
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline

SQUARE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]])
ARROW = np.array([[0.0, 0.0], [2.0, 1.0], [0.0, 2.0], [0.5, 1.0]])


def test_disk_in_closed_form():
    disk = Outline("disk", radius=2.0)
    assert disk.volume == pytest.approx(4 * math.pi)
    assert disk.surface_area == pytest.approx(4 * math.pi)
    assert disk.inertia == pytest.approx(np.diag([4, 4, 8]) * math.pi)
    assert disk.bounding_radius == 2.0
    assert disk.contains(np.array([[2.0, 0, 0], [0, 2.01, 0]])).tolist() == [True, False]


def test_rectangle_in_closed_form():
    box = Outline("polygon", vertices=SQUARE)
    assert box.volume == 2.0
    assert box.surface_area == 6.0
    assert box.centroid == pytest.approx([1.0, 0.5, 0.0])
    assert box.inertia == pytest.approx(np.diag([2 / 12, 8 / 12, 10 / 12]))


@pytest.mark.parametrize("corners", [3, 5, 8])
def test_regular_polygon_in_closed_form(corners):
    angles = 2 * np.pi * np.arange(corners) / corners
    polygon = Outline("polygon", vertices=np.column_stack([np.cos(angles) + 3, np.sin(angles) + 1]))
    area = corners / 2 * math.sin(2 * math.pi / corners)
    polar = area / 6 * (2 + math.cos(2 * math.pi / corners))
    assert polygon.volume == pytest.approx(area, rel=1e-13)
    assert polygon.centroid == pytest.approx([3, 1, 0], rel=1e-13)
    assert polygon.inertia == pytest.approx(np.diag([polar / 2, polar / 2, polar]), rel=1e-12, abs=1e-13)
    assert polygon.surface_area == pytest.approx(2 * corners * math.sin(math.pi / corners), rel=1e-13)


def test_product_of_inertia_of_a_right_triangle():
    triangle = Outline("polygon", vertices=np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
    assert triangle.inertia == pytest.approx(np.array([[2, 1, 0], [1, 2, 0], [0, 0, 4]]) / 72, rel=1e-13)


@pytest.mark.parametrize("corners", [SQUARE, ARROW, SQUARE[[0, 1, 2, 3]] * 1e-9])
def test_tessellation_covers_the_area(corners):
    polygon = Outline("polygon", vertices=corners)
    vertices, faces, error = polygon.tessellation()
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    areas = np.cross(b - a, c - a)[:, 2] / 2
    assert error == 0
    assert (areas > 0).all()
    assert areas.sum() == pytest.approx(polygon.volume, rel=1e-13)


def test_tessellation_of_a_disk_states_its_error():
    disk = Shape.of(Outline("disk", radius=3.0, center=(1.0, 2.0)), name="disk")
    assert disk.offset == (1.0, 2.0, 0.0)
    a, b, c = np.moveaxis(disk.vertices[disk.faces], 1, 0)
    missing = disk.volume - np.cross(b - a, c - a)[:, 2].sum() / 2
    assert 0 < missing < disk.tessellation_error * disk.surface_area
    assert np.linalg.norm(disk.vertices, axis=1) == pytest.approx(3.0, rel=1e-14)


def test_points_in_a_concave_polygon():
    inside = [[1.0, 1.0], [0.6, 1.0], [0.5, 1.0], [0.0, 0.0], [1.0, 0.5], [1.0, 1.5]]
    outside = [[0.4, 1.0], [0.0, 1.0], [2.1, 1.0], [1.0, 0.49], [0.2, 0.5], [-1.0, 0.0]]
    got = Outline("polygon", vertices=ARROW).contains(np.array(inside + outside))
    assert got.tolist() == [True] * 6 + [False] * 6


def test_moving_turning_and_stretching():
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    polygon = Outline("polygon", vertices=ARROW)
    other = polygon.rotated(turn).scaled(2.0).moved(np.array([1.0, 1.0, 0.0]))
    assert other.volume == pytest.approx(4 * polygon.volume)
    assert other.centroid == pytest.approx(2 * turn @ polygon.centroid + [1, 1, 0])
    assert other.inertia == pytest.approx(16 * turn @ polygon.inertia @ turn.T)
    disk = Outline("disk", radius=1.0, center=(1.0, 0.0)).rotated(turn)
    assert disk.center == (0.0, 1.0)
    assert disk.bounding_radius == 2.0


@pytest.mark.parametrize(
    ("corners", "message"),
    [
        (SQUARE[:2], "at least 3"),
        (SQUARE[::-1], "counterclockwise"),
        (SQUARE[[0, 2, 1, 3]], "meets itself"),
        (SQUARE[[0, 1, 1, 2, 3]], "meets itself"),
        (SQUARE[[0, 1, 2, 0, 3]], "meets itself"),
        ([[0.0, 0.0], [2.0, 0.0], [1.0, 0.0], [1.0, 1.0]], "meets itself"),
        ([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]], "meets itself"),
        ([[0.0, 0.0], [math.nan, 0.0], [2.0, 0.0]], "finite"),
    ],
)
def test_crooked_polygons_are_refused(corners, message):
    with pytest.raises(InputError, match=message):
        Outline("polygon", vertices=np.array(corners))


@pytest.mark.parametrize(("kind", "radius"), [("disk", 0.0), ("disk", -1.0), ("square", 1.0)])
def test_bad_disks_are_refused(kind, radius):
    with pytest.raises(InputError):
        Outline(kind, radius=radius)
