"""Places where a sphere touches three: against the distances themselves, in more digits than the kernels have."""

import math
from fractions import Fraction

import numpy as np
import pytest

from voxgran.packing.advancing_front.sphere_cells import BITS, HERE
from voxgran.packing.advancing_front.tangent_spheres import PLANE, SIDE, place_at, touch_disks, touch_spheres

LENGTHS = np.array([20.0, 20.0, 30.0])
PERIODS = np.diag(LENGTHS)


def gap(p, q, apart):
    """Distance of two points less another one, exact before the root."""
    square = sum((Fraction(float(a)) - Fraction(float(b))) ** 2 for a, b in zip(p, q, strict=True))
    wanted = Fraction(float(apart))
    # (d^2 - a^2) / (d + a), so that nothing cancels
    return float((square - wanted**2) / (Fraction(math.sqrt(square)) + wanted))


def touching_three(generator, ratio):
    """Three spheres in reach of each other, and the radius of a fourth, in random places and sizes."""
    radii = ratio ** -generator.random(4)
    centers = generator.random((3, 3)) * 10 + 5
    for k in (1, 2):
        way = generator.normal(size=3)
        apart = radii[0] + radii[k] + generator.random() * radii[3]
        centers[k] = centers[0] + apart * way / np.linalg.norm(way)
    return centers, radii[:3], float(radii[3])


@pytest.mark.parametrize("ratio", [1.0, 3.0, 1000.0])
def test_a_sphere_touches_three_to_the_last_digits(ratio):
    generator, found = np.random.Generator(np.random.Philox(1)), 0
    for _ in range(400):
        centers, radii, r = touching_three(generator, ratio)
        spheres = np.column_stack([centers, radii])
        a, b, c = ((k << BITS) + HERE for k in range(3))
        for refs in ((a, b, c), (a, c, b)):
            touches, *place = place_at(spheres, LENGTHS, PERIODS, *refs, r)
            if not touches:
                continue
            found += 1
            for k in range(3):
                assert abs(gap(place, centers[k], radii[k] + r)) <= 1e-12 * r + 8 * np.spacing(np.abs(place).max())
            side = np.cross(centers[1] - centers[0], centers[2] - centers[0]) @ (np.array(place) - centers[0])
            assert side * (1 if refs == (a, b, c) else -1) >= 0
    assert found > 100


def test_spheres_in_one_plane_and_far_apart_and_in_a_line():
    """Four centers almost in a plane: the place is ill-conditioned, its distances are not."""
    far = 2 / math.sqrt(3)
    for off in (0.0, 1e-15, 1e-12, 1e-8, 1e-4):
        d = far * (1 + off)
        corners = np.array([[math.cos(t), math.sin(t), 0.0] for t in (0.1, 2.2, 4.3)]) * far
        u, v = corners[1] - corners[0], corners[2] - corners[0]
        touches, *place = touch_spheres(*u, *v, d, d, d, 1e-14)
        if off >= 1e-12:
            assert touches
        if touches:
            assert [abs(gap(place, q, d)) < 2e-14 for q in (np.zeros(3), u, v)] == [True] * 3
    assert not touch_spheres(*u, *v, 0.9, 0.9, 0.9, 1e-14)[0]
    assert not touch_spheres(1.0, 0.0, 0.0, 2.0, 1e-9, 0.0, 1.5, 1.5, 1.5, 1e-14)[0]
    assert not touch_spheres(0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 1.5, 1.5, 1.5, 1e-14)[0]


def test_disks_left_and_right():
    left, right = touch_disks(1.0, 0.5, 1.0, 0.8, 1e-15), touch_disks(1.0, 0.5, 1.0, -0.8, 1e-15)
    for touches, x, y in (left, right):
        assert touches
        assert math.hypot(x, y) == pytest.approx(1.0, abs=1e-15)
        assert math.hypot(x - 1.0, y - 0.5) == pytest.approx(0.8, abs=1e-15)
    assert 1.0 * left[2] - 0.5 * left[1] > 0 > 1.0 * right[2] - 0.5 * right[1]
    assert not touch_disks(3.0, 0.0, 1.0, 1.0, 1e-15)[0]
    assert not touch_disks(0.0, 0.0, 1.0, 1.0, 1e-15)[0]


#: what a wall is, by the distance of a center from it
WALLS = {
    -1: lambda p: p[0], -2: lambda p: LENGTHS[0] - p[0], -3: lambda p: p[1], -4: lambda p: LENGTHS[1] - p[1],
    -5: lambda p: p[2], -6: lambda p: LENGTHS[2] - p[2], SIDE: lambda p: 10 - math.hypot(p[0] - 10, p[1] - 10),
}  # fmt: skip


@pytest.mark.parametrize("wall", WALLS)
def test_two_spheres_and_a_wall(wall):
    generator, found = np.random.Generator(np.random.Philox(2)), 0
    for _ in range(300):
        radii, r = 0.3 + generator.random(2), 0.3 + generator.random()
        one = generator.random(3) * LENGTHS
        way = generator.normal(size=3)
        two = one + way / np.linalg.norm(way) * (radii.sum() + generator.random() * r)
        spheres = np.column_stack([np.array([one, two]), radii])
        a, b = HERE, (1 << BITS) + HERE
        places = []
        for refs in ((a, b, wall), (b, a, wall)):
            touches, *place = place_at(spheres, LENGTHS, PERIODS, *refs, r)
            if touches:
                places.append(place)
                assert gap(place, one, radii[0] + r) == pytest.approx(0, abs=2e-14)
                assert gap(place, two, radii[1] + r) == pytest.approx(0, abs=2e-14)
                assert WALLS[wall](place) == pytest.approx(r, abs=2e-13)
        assert len(places) != 1
        if places:
            found += 1
            assert math.dist(*places) > 0
    assert found > 10


@pytest.mark.parametrize("walls", [(-1, -4), (-2, -5), (-6, -3), (-5, SIDE), (-6, SIDE)])
def test_a_sphere_and_two_walls(walls):
    generator, found = np.random.Generator(np.random.Philox(3)), 0
    for _ in range(3000):
        radius, r = 0.3 + generator.random(), 0.3 + generator.random()
        center = generator.random(3) * LENGTHS
        spheres, places = np.array([[*center, radius]]), []
        for refs in (walls, walls[::-1]):
            touches, *place = place_at(spheres, LENGTHS, PERIODS, HERE, *refs, r)
            if touches:
                places.append(place)
                assert gap(place, center, radius + r) == pytest.approx(0, abs=2e-14)
                assert [WALLS[wall](place) for wall in walls] == pytest.approx([r, r], abs=1e-13)
        if places:
            found += 1
            assert math.dist(*places) > 0
    assert found > 3


def test_disks_stay_in_their_plane():
    spheres = np.array([[5.0, 5.0, 0.0, 1.0], [7.0, 5.5, 0.0, 1.2]])
    _, x, y, z = place_at(spheres, LENGTHS, PERIODS, HERE, (1 << BITS) + HERE, PLANE, 0.7)
    assert z == 0.0
    assert math.hypot(x - 5, y - 5) == pytest.approx(1.7, abs=1e-14)
    assert math.hypot(x - 7, y - 5.5) == pytest.approx(1.9, abs=1e-14)
    for walls in ((-1, PLANE), (PLANE, -1)):
        _, x, y, z = place_at(np.array([[1.5, 5.0, 0.0, 1.0]]), LENGTHS, PERIODS, HERE, *walls, 0.7)
        assert (x, z) == (0.7, 0.0)
        assert math.hypot(x - 1.5, y - 5) == pytest.approx(1.7, abs=1e-14)


def test_an_image_is_a_sphere_elsewhere():
    spheres = np.array([[19.5, 5.0, 5.0, 1.0], [0.5, 6.0, 5.0, 1.0], [0.2, 5.0, 6.5, 1.0]])
    moved = spheres + np.array([20.0, 0.0, 0.0, 0.0])
    refs = HERE, (1 << BITS) + HERE + 1, (2 << BITS) + HERE + 1
    plain = np.array([spheres[0], moved[1], moved[2]])
    here = [(k << BITS) + HERE for k in range(3)]
    assert place_at(spheres, LENGTHS, PERIODS, *refs, 0.9) == place_at(plain, LENGTHS, PERIODS, *here, 0.9)
