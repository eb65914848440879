"""Contacts of polygons and disks: gaps are those of the exact tests, and edges that lie on edges have two contacts."""

import math

import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran.contacts.assembly import Assembly
from voxgran.contacts.manifolds.outline_contacts import find_outline_contacts, outline_bodies
from voxgran.contacts.manifolds.rows import OUTLINE, ROW, SPHERE, ContactRows, Grains, PairList, Search
from voxgran.contacts.outlines import touch_disk, touch_polygons
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline


def polygon(*corners):
    """Return a polygon about its centroid."""
    return Shape.of(Outline("polygon", vertices=np.array(corners, dtype=float)), name="polygon")


SQUARE = polygon((0, 0), (1, 0), (1, 1), (0, 1))
COMB = polygon((0, 0), (3, 0), (3, 2), (2, 2), (2, 1), (1, 1), (1, 2), (0, 2))
SHAPES = [
    vg.make_shape("disk"),
    SQUARE,
    COMB,
    polygon((0, 0), (2, 0), (0.5, 0.4), (0, 1.5)),
    polygon(*[(math.cos(a), 0.6 * math.sin(a)) for a in 2 * math.pi * np.arange(150) / 150]),
]


def turned(angle):
    """Return the quaternion of a rotation in the plane."""
    return [math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2)]


class Found:
    """The contacts of pairs of grains in the plane."""

    def __init__(self, shapes, places, angles, pairs, margin, *, scales=None, rest=0.0, shifts=None, room=2000):
        n, k = len(shapes), len(pairs)
        position = np.column_stack([places, np.zeros(n)])
        scale = np.ones(n) if scales is None else np.array(scales, dtype=float)
        self.assembly = Assembly(
            tuple(shapes),
            np.arange(n),
            scale,
            position,
            np.array([turned(a) for a in angles]),
            vg.Rectangle((9.0, 9.0)),
        )
        kind = np.array([SPHERE if shape.is_sphere or shape.geometry.kind == "disk" else OUTLINE for shape in shapes])
        self.grains = Grains(
            *(position.copy(), self.assembly.matrices.copy(), scale.copy(), self.assembly.bounding_radii.copy()),
            *(np.arange(n), kind.astype(np.int64), np.zeros(n)),
        )
        i, j = np.array(pairs, dtype=np.int64).T.copy()
        shift = np.zeros((k, 3)) if shifts is None else np.array(shifts, dtype=float)
        self.pairs = PairList(
            *(i, j, shift, np.zeros(k, dtype=np.int64), np.zeros(k, dtype=np.int64), np.full(k, -1e9)),
            *(np.zeros(k), np.full((k, 3), 2.0), np.zeros(k), np.full((k, 6), -1)),
        )
        self.rows = ContactRows(
            np.zeros((room, ROW)), np.zeros(room, dtype=np.int64), np.zeros(room, dtype=np.int64), np.zeros((room, ROW))
        )
        self.bodies, self.margin, self.rest = outline_bodies(tuple(shapes)), margin, rest
        self.find()

    def find(self):
        """Find the contacts again; return the row after the last."""
        search = Search(self.grains, self.pairs, self.margin, self.rest)
        self.m = find_outline_contacts(search, self.bodies, self.rows, 0)
        return self.m

    def of(self, p=0):
        """Return the rows of a pair."""
        return self.rows.row[self.pairs.first[p] : self.pairs.first[p] + self.pairs.count[p]]

    def exact(self, p=0):
        """Return the exact contact of a pair."""
        i, j = self.pairs.i[p], self.pairs.j[p]
        a, scale = self.assembly, self.assembly.scale
        back = a.matrices[i].T / scale[i]
        matrix = back @ a.matrices[j] * scale[j]
        offset = back @ (a.position[j] + self.pairs.shift[p] - a.position[i])
        one, other = a.shapes[i].geometry, a.shapes[j].geometry
        call = touch_disk if other.kind == "disk" else touch_polygons
        touch = call(one, other, matrix=matrix, offset=offset, reach=math.inf)
        return touch.gap * scale[i], a.matrices[i] @ touch.normal


def random_pair(generator, one, other, *, swapped=False):
    """Return the contacts of two shapes near each other."""
    angle = 2 * math.pi * generator.random()
    reach = one.bounding_radius + other.bounding_radius
    away = reach * (0.4 + 0.8 * generator.random()) * np.array([math.cos(angle), math.sin(angle)])
    angles, scales = 2 * math.pi * generator.random(2), 0.7 + 0.6 * generator.random(2)
    places = np.array([1.0, 2.0]) + np.array([np.zeros(2), away])
    if swapped:
        return Found([other, one], places[::-1], angles[::-1], [(0, 1)], 10.0, scales=scales[::-1])
    return Found([one, other], places, angles, [(0, 1)], 10.0, scales=scales)


@pytest.mark.parametrize("other", range(5))
@pytest.mark.parametrize("one", [1, 2, 3, 4])
def test_gaps_are_exact_and_overlaps_are_seen(one, other):
    for seed in range(6):
        pair = random_pair(np.random.Generator(np.random.Philox(seed)), SHAPES[one], SHAPES[other])
        gap, normal = pair.exact()
        rows = pair.of()
        deepest = rows[rows[:, 9].argmin()]
        if gap > 1e-9:
            assert deepest[9] == pytest.approx(gap, abs=1e-9)
            again = [row for row in rows if row[9] < gap + 1e-9]
            assert min(np.linalg.norm(row[:3] - normal) for row in again) < 1e-6
        elif gap < -1e-3:
            assert deepest[9] < 0
        assert pair.pairs.bound[0] == deepest[9]
        # the points of both surfaces are a gap apart, along the normal
        offset = pair.assembly.position[1] - pair.assembly.position[0]
        np.testing.assert_allclose(offset + rows[:, 6:9] - rows[:, 3:6], rows[:, 9:10] * rows[:, :3], atol=1e-12)
        assert not rows[:, [2, 5, 8]].any()
        assert len(rows) <= 6


@pytest.mark.parametrize(("one", "other"), [(1, 2), (0, 2), (3, 4), (2, 3)])
def test_the_order_of_a_pair_does_not_matter(one, other):
    for seed in range(4):
        there, back = (
            random_pair(np.random.Generator(np.random.Philox(seed)), SHAPES[one], SHAPES[other], swapped=swapped)
            for swapped in (False, True)
        )
        assert there.of()[:, 9].min() == pytest.approx(back.of()[:, 9].min(), abs=1e-12)
        np.testing.assert_allclose(there.pairs.bound, back.pairs.bound, atol=1e-12)


def test_gaps_do_not_change_when_all_is_rotated():
    places, angles = np.array([[0.0, 0.0], [1.2, 0.9]]), np.array([0.3, 1.1])
    rows = Found([COMB, SHAPES[3]], places, angles, [(0, 1)], 2.0).of()
    turn = np.array([[math.cos(0.8), -math.sin(0.8)], [math.sin(0.8), math.cos(0.8)]])
    other = Found([COMB, SHAPES[3]], places @ turn.T, angles + 0.8, [(0, 1)], 2.0).of()
    np.testing.assert_allclose(rows[:, 9], other[:, 9], atol=1e-12)
    np.testing.assert_allclose(rows[:, :2] @ turn.T, other[:, :2], atol=1e-9)


def test_squares_in_a_stack_lie_on_two_corners():
    places = [(0.0, 0.5), (0.3, 1.501), (0.1, 2.502)]
    stack = Found([SQUARE] * 3, places, [0.0] * 3, [(0, 1), (1, 2)], 0.05, rest=1e-3)
    for p, ends in ((0, (-0.2, 0.5)), (1, (-0.5, 0.3))):
        rows = stack.of(p)
        np.testing.assert_allclose(rows[:, :2], np.tile([0.0, 1.0], (len(rows), 1)), atol=1e-12)
        np.testing.assert_allclose(rows[:, 9], 0.0, atol=1e-12)
        np.testing.assert_allclose([rows[:, 3].min(), rows[:, 3].max()], ends, atol=1e-12)
        assert len(rows) == 2


def test_squares_side_by_side_are_parted_sideways():
    """The lower one overlaps by less at its top and bottom than sideways: its corners are nearest to those edges."""
    large = polygon((0, 0), (1.004, 0), (1.004, 1.004), (0, 1.004))
    for shapes, sign in (([SQUARE, large], 1.0), ([large, SQUARE], -1.0)):
        pair = Found(shapes, [(0.0, 0.0), (sign * 0.992, 0.0)], [0.0, 0.0], [(0, 1)], 0.05)
        np.testing.assert_allclose(pair.of()[:, :2], [[sign, 0.0]] * 2, atol=1e-12)
        np.testing.assert_allclose(pair.of()[:, 9], -0.01, atol=1e-12)
        np.testing.assert_allclose(np.sort(pair.of()[:, 4]), [-0.5, 0.5], atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("corners", [slow(3), slow(4), 5, slow(7)])
def test_convex_polygons_that_overlap_are_as_deep_as_the_shortest_way_apart(corners):
    """Moved along the normal by their depth they touch, and by no shorter way in 400 directions do they part."""
    one, other = (vg.make_shape("polygon", corners=many) for many in (corners, 4))
    for seed in range(5):
        generator = np.random.Generator(np.random.Philox(seed))
        places, angles = np.array([[0.0, 0.0], generator.uniform(-0.5, 0.5, 2)]), 2 * math.pi * generator.random(2)
        rows = Found([one, other], places, angles, [(0, 1)], 0.05).of()
        deepest, depth = rows[rows[:, 9].argmin()], -rows[:, 9].min()
        assert depth > 0.0
        np.testing.assert_allclose(rows[:, :3], np.tile(deepest[:3], (len(rows), 1)))
        apart = Found([one, other], places + np.outer([0, 1], (depth + 1e-9) * deepest[:2]), angles, [(0, 1)], 0.05)
        assert apart.exact()[0] == pytest.approx(1e-9, abs=1e-8)
        for way in 2 * math.pi * np.arange(400) / 400:
            shift = 0.99 * depth * np.array([math.cos(way), math.sin(way)])
            assert Found([one, other], places + np.outer([0, 1], shift), angles, [(0, 1)], 0.05).of()[:, 9].min() < 0.0


def test_combs_that_interlock_touch_on_all_sides():
    """The tooth of one comb, turned over, stands in the notch of the other: left, right and below."""
    tooth = polygon((0, 0), (0.96, 0), (0.96, 1), (3, 1), (3, 2), (-2, 2), (-2, 1), (0, 1))
    below = np.array([1.02, 1.01]) + tooth.offset[:2] - np.array(COMB.offset[:2])
    rows = Found([COMB, tooth], [(0.0, 0.0), below], [0.0, 0.0], [(0, 1)], 0.05).of()
    found = {(round(row[0]), round(row[1])): row[9] for row in rows}
    assert found == {
        (-1, 0): pytest.approx(0.02), (1, 0): pytest.approx(0.02), (0, 1): pytest.approx(0.01)
    }  # fmt: skip


def test_a_disk_in_a_notch_touches_both_sides():
    notch = polygon((-2, -1), (2, -1), (2, 2), (0, 0), (-2, 2))
    center = np.array([0.0, (0.5 + 0.01) * math.sqrt(2)]) - np.array(notch.offset[:2])
    for shapes, places, sign in (
        ([notch, SHAPES[0]], [(0.0, 0.0), center], 1.0),
        ([SHAPES[0], notch], [center, (0.0, 0.0)], -1.0),
    ):
        rows = Found(shapes, places, [0.0, 0.0], [(0, 1)], 0.05).of()
        np.testing.assert_allclose(rows[:, 9], [0.01, 0.01], atol=1e-12)
        normals = sorted(map(tuple, np.round(sign * rows[:, :2] * math.sqrt(2), 9)))
        assert normals == [(-1.0, 1.0), (1.0, 1.0)]


def test_bars_that_cross_are_not_missed():
    bar = polygon((0, 0), (4, 0), (4, 0.2), (0, 0.2))
    rows = Found([bar, bar], [(0.0, 0.0), (0.3, 0.4)], [0.0, math.pi / 2], [(0, 1)], 0.05).of()
    assert rows[:, 9].min() < -0.05


def test_pairs_across_a_periodic_side():
    pair = Found([SQUARE, SQUARE], [(8.6, 1.0), (0.62, 1.0)], [0.0, 0.0], [(0, 1)], 0.05, shifts=[(9.0, 0.0, 0.0)])
    np.testing.assert_allclose(pair.of()[:, 9], 0.02, atol=1e-12)
    np.testing.assert_allclose(pair.of()[:, 0], 1.0)


def test_pairs_that_are_known_to_be_apart_are_passed_over():
    """A pair at a gap of 0.09 is looked at again only when both have moved by 0.04 together."""
    pair = Found([SQUARE, SQUARE], [(0.0, 0.0), (1.09, 0.0)], [0.0, 0.0], [(0, 1)], 0.05)
    assert pair.m == 0
    assert pair.pairs.bound[0] == pytest.approx(0.09)
    pair.grains.position[1, 0] = 1.03
    pair.grains.way[1] = 0.039
    assert pair.find() == 0
    pair.grains.way[1] = 0.06
    assert pair.find() == 2
    np.testing.assert_allclose(pair.of()[:, 9], 0.03, atol=1e-12)


def test_full_rows_lose_nothing():
    places = [(0.0, 0.5), (0.3, 1.501), (0.1, 2.502)]
    stack = Found([SQUARE] * 3, places, [0.0] * 3, [(0, 1), (1, 2)], 0.05)
    stack.rows.row[:4, 10:14] = np.arange(16).reshape(4, 4)
    stack.rows.old[:] = stack.rows.row
    long = stack.rows
    stack.rows = ContactRows(*(array[:3].copy() for array in long[:3]), long.old)
    assert stack.find() == -1
    stack.rows = long
    # as the bed does where it makes room: no old row is taken
    stack.pairs.first[:], stack.pairs.count[:] = [0, 2], [2, 2]
    long.old[:, 14] = 0.0
    assert stack.find() == 4
    np.testing.assert_array_equal(long.row[:4, :14], long.old[:4, :14])


def test_pairs_of_disks_are_left_alone():
    pair = Found([SHAPES[0], SHAPES[0]], [(0.0, 0.0), (1.0, 0.0)], [0.0, 0.0], [(0, 1)], 0.05)
    assert pair.m == 0
    assert pair.pairs.bound[0] == -1e9
