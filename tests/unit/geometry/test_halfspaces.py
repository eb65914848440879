"""Spheres and disks between planes, against closed formulas and against exact unions made another way."""

import math

import numpy as np
import pytest

from voxgran._base.seeds import stream
from voxgran.geometry.halfspaces import cut_disks, cut_spheres
from voxgran.geometry.rotation import random_rotations, rotation_matrices
from voxgran.measures.window import power_planes
from voxgran.shapes.sphere_union import union_moments

OPEN = {"lower": np.full(3, -np.inf), "upper": np.full(3, np.inf)}
BALL = 4 / 3 * math.pi


def planes_of(*planes):
    """Return the planes of one sphere from (normal, offset)."""
    normals = np.array([n / np.linalg.norm(n) for n, _ in planes], dtype=float).reshape(-1, 3)
    return np.array([0, len(planes)]), normals, np.array([d for _, d in planes], dtype=float)


def cut_unit_sphere(*planes):
    """Return the volume of the unit sphere inside half-spaces."""
    return cut_spheres(np.zeros((1, 3)), np.ones(1), planes=planes_of(*planes), **OPEN)[0]


def face_area(radius_squared, b, c):
    """Return the area of a quarter disk inside 0 <= y <= b, 0 <= z <= c."""
    radius = math.sqrt(max(0.0, radius_squared))
    b, c = min(b, radius), min(c, radius)
    if b * b + c * c <= radius_squared:
        return b * c
    at_b, at_c = math.sqrt(max(0.0, radius_squared - b * b)), math.sqrt(max(0.0, radius_squared - c * c))
    angle = max(0.0, math.atan2(c, at_c) - math.atan2(at_b, b))
    return (b * at_b + c * at_c + radius_squared * angle) / 2


def hidden_angle(a, z):
    """Return the integral from 0 to z of arccos(a / sqrt(1 - t**2))."""
    w = math.sqrt(max(0.0, 1 - a * a - z * z))
    return z * math.atan2(w, a) - a * math.atan2(z, w) + math.atan2(a * z, w)


def corner_volume(x, y, z):
    """Return the volume of the unit sphere inside [0, x] x [0, y] x [0, z], odd in each: the plain twin."""
    sign = math.prod(math.copysign(1, v) for v in (x, y, z))
    a, b, c = (min(abs(v), 1.0) for v in (x, y, z))
    if a * b * c == 0.0 or a * a + b * b + c * c <= 1:
        return sign * a * b * c
    start = math.sqrt(max(0.0, 1 - a * a - b * b))
    sphere = 0.0
    if c > start:
        sphere = math.pi / 2 * (c - start)
        for side in (a, b):
            top = math.sqrt(1 - side * side)
            sphere -= hidden_angle(side, min(c, top)) - hidden_angle(side, min(start, top))
    faces = a * face_area(1 - a * a, b, c) + b * face_area(1 - b * b, a, c) + c * face_area(1 - c * c, a, b)
    return sign * (faces + sphere) / 3


def twin(low, high):
    """Return the volume of the unit sphere inside a box as the signed sum over its corners."""
    total = 0.0
    for i, j, k in np.ndindex(2, 2, 2):
        corner = [(low, high)[side][axis] for axis, side in enumerate((i, j, k))]
        total += (-1) ** (3 - i - j - k) * corner_volume(*corner)
    return total


def test_random_boxes_agree_with_the_twin():
    generator = stream(0, "boxes")
    low = generator.uniform(-1.3, 1.0, (3000, 3))
    high = low + generator.uniform(0.0, 2.0, (3000, 3))
    for a, b in zip(low, high, strict=True):
        found = cut_spheres(np.zeros((1, 3)), np.ones(1), lower=a, upper=b)[0]
        assert found == pytest.approx(twin(a, b), abs=3e-15)


@pytest.mark.parametrize("small", [0.0, 1e-300, 1e-20, 1e-16, 3e-16, 1e-15, 1e-12, 1e-8, 1e-5])
def test_planes_near_the_center(small):
    generator = stream(1, "near")
    for _ in range(100):
        low = small * generator.integers(-2, 3, 3).astype(float)
        high = low + np.where(generator.random(3) < 0.3, small, generator.uniform(0.3, 2.0, 3))
        found = cut_spheres(np.zeros((1, 3)), np.ones(1), lower=low, upper=high)[0]
        assert found == pytest.approx(twin(low, high), abs=3e-15)


@pytest.mark.parametrize("short", [0.0, 1e-16, 1e-15, 1e-12, 1e-8, 1e-4])
def test_planes_and_edges_that_touch_the_sphere(short):
    side = math.sqrt(0.5)
    for low in ([1 - short, -2, -2], [side - short, side - short, -2], [side, side, -short], [1 - short, -1, 0]):
        for high in ([2, 2, 2], [1, 1, 1]):
            if (np.array(low) < high).all():
                found = cut_spheres(
                    np.zeros((1, 3)), np.ones(1), lower=np.array(low, float), upper=np.array(high, float)
                )
                assert found[0] == pytest.approx(twin(low, high), abs=3e-15)


def test_caps_and_wedges():
    direction = np.array([0.3, -0.5, 0.7])
    for d in (-0.9, -0.2, 0.0, 0.4, 0.999):
        assert cut_unit_sphere((direction, d)) == pytest.approx(math.pi * (2 / 3 + d - d**3 / 3), abs=2e-15)
    # two planes through the center: a share of the sphere that is the angle between them
    for angle in (0.1, 1.0, 2.0, 3.0):
        edge = np.array([1.0, 2.0, 0.5]) / np.linalg.norm([1.0, 2.0, 0.5])
        one = np.cross(edge, [0, 0, 1.0])
        one /= np.linalg.norm(one)
        other = math.cos(math.pi - angle) * one + math.sin(math.pi - angle) * np.cross(edge, one)
        assert cut_unit_sphere((one, 0), (other, 0)) == pytest.approx(BALL * angle / (2 * math.pi), abs=2e-15)


def test_a_trihedral_cone_has_the_volume_of_its_solid_angle():
    generator = stream(2, "cones")
    for _ in range(100):
        a, b, c = (v / np.linalg.norm(v) for v in generator.normal(size=(3, 3)))
        if np.dot(a, np.cross(b, c)) < 0:
            b, c = c, b
        # Van Oosterom & Strackee 1983, doi:10.1109/TBME.1983.325207
        angle = 2 * math.atan2(np.dot(a, np.cross(b, c)), 1 + a @ b + b @ c + c @ a)
        found = cut_unit_sphere((-np.cross(a, b), 0), (-np.cross(b, c), 0), (-np.cross(c, a), 0))
        assert found == pytest.approx(angle / 3, abs=5e-14)  # thin cones: the normals are rounded


def test_any_plane_leaves_two_parts_of_the_whole():
    generator = stream(3, "parts")
    for count in range(1, 12):
        planes = [
            (n, d) for n, d in zip(generator.normal(size=(count, 3)), generator.uniform(-0.3, 0.9, count), strict=True)
        ]
        whole = cut_unit_sphere(*planes)
        cut = generator.normal(size=3), generator.uniform(-0.7, 0.7)
        parts = cut_unit_sphere(*planes, cut) + cut_unit_sphere(*planes, (-cut[0], -cut[1]))
        assert parts == pytest.approx(whole, abs=5e-15)


def test_equal_and_contradicting_planes():
    x = np.array([1.0, 0, 0])
    half = cut_unit_sphere((x, 0.3))
    assert cut_unit_sphere((x, 0.3), (x, 0.3)) == pytest.approx(half, abs=1e-15)
    assert cut_unit_sphere((x, 0.3), (x, 0.5), (x, 2.0)) == pytest.approx(half, abs=1e-15)
    assert cut_unit_sphere((x, 0.3), (-x, -0.3)) == 0.0
    assert cut_unit_sphere((x, 0.3), (-x, -0.5)) == 0.0
    assert cut_unit_sphere((x, -1.0)) == 0.0
    tilted = np.array([1.0, 1e-9, 0])
    assert cut_unit_sphere((x, 0.3), (tilted, 0.3)) == pytest.approx(half, abs=1e-8)


def test_power_cells_of_many_spheres_fill_their_union():
    generator = stream(4, "union")
    for count in (2, 3, 10, 60):
        centers, radii = generator.uniform(-1, 1, (count, 3)), generator.uniform(0.2, 0.8, count)
        parts = cut_spheres(centers, radii, planes=power_planes(centers, radii), **OPEN)
        assert parts.sum() == pytest.approx(union_moments(centers, radii)[0], rel=1e-12)


def test_spheres_with_one_center_count_once():
    centers, radii = np.zeros((4, 3)), np.array([0.5, 1.0, 1.0, 0.2])
    parts = cut_spheres(centers, radii, planes=power_planes(centers, radii), **OPEN)
    assert parts == pytest.approx([0.0, BALL, 0.0, 0.0], abs=1e-15)


def test_turned_planes_give_the_same_volume():
    generator = stream(5, "turns")
    normals, offsets = generator.normal(size=(6, 3)), generator.uniform(0, 0.8, 6)
    first = cut_unit_sphere(*zip(normals, offsets, strict=True))
    for matrix in rotation_matrices(random_rotations(generator, 20)):
        assert cut_unit_sphere(*zip(normals @ matrix.T, offsets, strict=True)) == pytest.approx(first, abs=3e-15)


def test_disks_agree_with_segments_and_sectors():
    empty = np.full(2, -np.inf), np.full(2, np.inf)
    for d in (-0.8, 0.0, 0.5):
        area = cut_disks(np.zeros((1, 2)), np.ones(1), lower=empty[0], upper=np.array([d, np.inf]))[0]
        assert area == pytest.approx(math.pi - math.acos(d) + d * math.sqrt(1 - d * d), abs=1e-15)
    for angle in (0.2, 1.5, 3.0):
        normals = np.array([[0.0, -1.0], [-math.sin(angle), math.cos(angle)]])
        planes = np.array([0, 2]), normals, np.zeros(2)
        area = cut_disks(np.zeros((1, 2)), np.ones(1), lower=empty[0], upper=empty[1], planes=planes)[0]
        assert area == pytest.approx(angle / 2, abs=1e-15)
    generator = stream(6, "quarters")
    for b, c in generator.uniform(0, 1.2, (200, 2)):
        area = cut_disks(np.zeros((1, 2)), np.ones(1), lower=np.zeros(2), upper=np.array([b, c]))[0]
        assert area == pytest.approx(face_area(1.0, b, c), abs=1e-15)


@pytest.mark.parametrize("height", [-1 + 1e-9, -0.5, -1e-16, 0.0, 0.3, 1 - 1e-9])
@pytest.mark.parametrize("normal", [(0.0, 0, 1), (0.48, 0.6, 0.64)])
def test_closed_forms_of_one_plane_and_of_a_slab_agree_with_the_general_sum(height, normal):
    """A third plane, parallel to the first and behind it, cuts nothing but leads to the general sum."""
    first, behind = (normal, height), (normal, (height + 1) / 2)
    opposite = (tuple(-x for x in normal), 0.4)
    assert cut_unit_sphere(first) == pytest.approx(cut_unit_sphere(first, behind), abs=2e-15)
    assert cut_unit_sphere(first, opposite) == pytest.approx(cut_unit_sphere(first, opposite, behind), abs=2e-15)


def test_a_thin_slab_keeps_its_digits():
    for width in (1e-3, 1e-8, 1e-12):
        middle = np.array([0.0, 0.0, 0.3])
        reach = np.array([np.inf, np.inf, width / 2])
        low, high = middle - reach, middle + reach
        area = math.pi * (1 - 0.3**2) - math.pi * width**2 / 12
        found = cut_spheres(np.zeros((1, 3)), np.ones(1), lower=low, upper=high)[0]
        assert found == pytest.approx(area * (high[2] - low[2]), rel=1e-13)


def test_spheres_whole_in_a_box_and_cut_by_it():
    centers = np.array([[0.5, 0.5, 0.5], [0.5, 0.5, 0.4999999], [1.5, 0.5, 0.5], [0.0, 0.5, 0.5]])
    found = cut_spheres(centers, np.full(4, 0.5), lower=np.zeros(3), upper=np.ones(3))
    assert found[0] == BALL / 8
    assert found[1] < found[0]
    assert found[[2, 3]].tolist() == pytest.approx([0.0, BALL / 16], abs=1e-16)
