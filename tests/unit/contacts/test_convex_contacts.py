"""Contacts of grains made of convex parts, against linear programs, minimization and closed forms."""

import itertools

import numpy as np
import pytest
from scipy.optimize import linprog, nnls

from voxgran.contacts.manifolds.convex_bodies import convex_bodies, convex_work, has_convex_parts, is_convex
from voxgran.contacts.manifolds.convex_contacts import find_convex_contacts
from voxgran.contacts.manifolds.rows import CONVEX, SPHERE, ContactRows, Grains, PairList, Search
from voxgran.contacts.manifolds.rows import ROW as NUMBERS
from voxgran.geometry.rotation import rotation_matrices
from voxgran.shapes.mesh import Mesh, hull_of
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.spheres import Spheres
from voxgran.shapes.tessellate import sphere, unit_box

UPRIGHT = (1.0, 0.0, 0.0, 0.0)


def solid(kind, *dimensions):
    return Shape(Primitive(kind, tuple(float(d) for d in dimensions)))


def random_hull(generator, *, count=20, factors=(1.0, 1.0, 1.0)):
    points = generator.normal(size=(count, 3))
    points *= 0.5 * np.array(factors) / np.linalg.norm(points, axis=1, keepdims=True)
    return Shape.of(hull_of(points), name="hull")


def random_clump(generator, count=8):
    return Shape.of(Spheres(generator.uniform(-0.3, 0.3, (count, 3)), generator.uniform(0.1, 0.3, count)), name="clump")


def random_turn(generator):
    turn = generator.normal(size=4)
    return turn / np.linalg.norm(turn)


class Bed:
    """Grains, the pairs of them, and rows."""

    def __init__(self, shapes, position, turns=None, *, scale=None, kinds=None, space=400):
        n = len(position)
        shape = np.arange(n) % len(shapes)
        scale = np.ones(n) if scale is None else np.array(scale, dtype=float)
        radius = np.array([shapes[s].geometry.bounding_radius for s in shape]) * scale
        kind = np.array([SPHERE if shapes[s].is_sphere else CONVEX for s in shape]) if kinds is None else kinds
        turns = np.array([UPRIGHT] * n if turns is None else turns, dtype=float)
        matrix = np.ascontiguousarray(rotation_matrices(turns))
        position = np.ascontiguousarray(position, dtype=float)
        self.grains = Grains(position, matrix, scale, radius, shape, kind.astype(np.int64), np.zeros(n))
        i, j = np.triu_indices(n, 1)
        m = len(i)
        self.pairs = PairList(
            np.ascontiguousarray(i), np.ascontiguousarray(j), np.zeros((m, 3)), np.zeros(m, dtype=np.int64),
            np.zeros(m, dtype=np.int64), np.full(m, -1e9), np.zeros(m), np.full((m, 3), 2.0), np.zeros(m),
            np.full((m, 6), -1),
        )  # fmt: skip
        self.work = convex_work(convex_bodies(shapes), self.grains)
        self.rows = make_rows(space)

    def find(self, margin=10.0, rest=0.0, *, m=0, again=True):
        if again:
            self.pairs.bound[:] = -1e9
        search = Search(self.grains, self.pairs, float(margin), float(rest))
        return find_convex_contacts(search, self.work, self.rows, m)

    def touch(self, margin=10.0):
        """Return gap, normal and all rows of the only pair."""
        found = self.find(margin)
        return float(self.pairs.bound[0]), self.pairs.normal[0].copy(), self.rows.row[:found].copy()


def make_rows(space):
    numbers = np.zeros(space, dtype=np.int64)
    return ContactRows(np.zeros((space, NUMBERS)), numbers, numbers.copy(), np.zeros((space, NUMBERS)))


def support(shape, scale, matrix, direction):
    """Return the height of the support plane of a shape about its centroid."""
    inner, geometry = matrix.T @ direction, shape.geometry
    if isinstance(geometry, Primitive):
        return scale * float(geometry.support(inner[None])[0] @ inner)
    if isinstance(geometry, Spheres):
        return scale * float((geometry.centers @ inner + geometry.radii).max())
    return scale * float((geometry.vertices @ inner).max())


def gap_along(bed, shapes, normal, i=0, j=1):
    grains = bed.grains
    mine = support(shapes[i % len(shapes)], grains.scale[i], grains.matrix[i], normal)
    theirs = support(shapes[j % len(shapes)], grains.scale[j], grains.matrix[j], -normal)
    return float((grains.position[j] - grains.position[i]) @ normal) - mine - theirs


def prove_gap(bed, shapes, row, gap, room):
    """Check that the support planes along a normal have a gap and that it is the largest; the points are on the grains.

    The gap along n is concave, so that its largest value on the unit sphere, if above 0, is where none near it is
    larger.
    """
    normal, grains = row[:3], bed.grains
    assert np.isclose(np.linalg.norm(normal), 1.0, rtol=0, atol=1e-14)
    assert np.isclose(gap_along(bed, shapes, normal), gap, rtol=0, atol=room)
    generator = np.random.default_rng(0)
    for size in np.repeat(10.0 ** np.arange(-6, 0), 6):
        near = normal + size * generator.normal(size=3)
        assert gap_along(bed, shapes, near / np.linalg.norm(near)) <= gap + room
    ends = row[6:9] + grains.position[1] - grains.position[0] - row[3:6]
    np.testing.assert_allclose(ends, gap * normal, atol=1e-12)
    for k, arm in ((0, row[3:6]), (1, row[6:9])):
        assert holds(shapes[k], grains.matrix[k].T @ arm / grains.scale[k], 1e-4)


def holds(shape, point, room):
    """Return whether a point lies in a solid, or outside within a room; well inside if the room is negative."""
    geometry = shape.geometry
    if isinstance(geometry, Spheres):
        return bool((np.linalg.norm(point - geometry.centers, axis=1) <= geometry.radii + room).any())
    if isinstance(geometry, Primitive):
        return bool(geometry.scaled(1 + room / min(geometry.dimensions)).contains(point[None])[0])
    corners = geometry.triangles
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return bool((((point - corners[:, 0]) * normals).sum(axis=1) <= room).all())


def separate(bed, gap):
    """Move the second grain until the gap is a given one."""
    for _ in range(8):
        found, normal, _ = bed.touch()
        bed.grains.position[1] += (gap - found) * normal
    return bed.touch()


SOLIDS = {
    "box": solid("box", 1.0, 0.8, 0.6),
    "cylinder": solid("cylinder", 0.45, 1.0),
    "cone": solid("cone", 0.5, 1.1),
    "ellipsoid": solid("ellipsoid", 0.6, 0.5, 0.35),
    "rod": solid("spherocylinder", 0.3, 0.8),
    "hull": random_hull(np.random.default_rng(3)),
    "sphere": solid("sphere", 0.4),
    "clump": Shape.of(Spheres(np.array([[0.0, 0, 0], [0.4, 0, 0]]), np.array([0.4, 0.3])), name="clump"),
}
KINDS = [pair for pair in itertools.combinations_with_replacement(SOLIDS, 2) if pair != ("sphere", "sphere")]


@pytest.mark.parametrize("pair", KINDS, ids="-".join)
def test_the_gap_of_any_two_kinds_is_the_largest_along_any_direction(pair):
    generator = np.random.default_rng(11)
    shapes = [SOLIDS[kind] for kind in pair]
    for gap in (0.3, 5e-4, 1e-7):
        turns = [random_turn(generator), random_turn(generator)]
        bed = Bed(shapes, [[0, 0, 0], generator.normal(size=3) * 1.5], turns)
        found, _, rows = separate(bed, gap)
        assert np.isclose(found, gap, rtol=0, atol=1e-9)
        if "clump" in pair:
            # the nearest of its spheres
            assert np.isclose(rows[:, 9].min(), found, rtol=0, atol=1e-12)
        else:
            prove_gap(bed, shapes, rows[0], found, 1e-9)


@pytest.mark.parametrize("pair", KINDS, ids="-".join)
def test_the_order_of_a_pair_and_a_rotation_of_the_whole_change_no_gap(pair):
    generator = np.random.default_rng(5)
    shapes = [SOLIDS[kind] for kind in pair]
    turns = [random_turn(generator), random_turn(generator)]
    bed = Bed(shapes, [[0, 0, 0], generator.normal(size=3)], turns)
    found, normal, _ = separate(bed, 1e-3)
    swapped = Bed(shapes[::-1], bed.grains.position[::-1], turns[::-1])
    back, other, _ = swapped.touch()
    assert np.isclose(back, found, rtol=0, atol=1e-10)
    np.testing.assert_allclose(other, -normal, atol=1e-3)
    turn = rotation_matrices(random_turn(generator)[None])[0]
    bed.grains.position[:] = bed.grains.position @ turn.T
    bed.grains.matrix[:] = turn @ bed.grains.matrix
    bed.pairs.normal[:] = 2.0
    turned, other, _ = bed.touch()
    assert np.isclose(turned, found, rtol=0, atol=1e-10)
    np.testing.assert_allclose(other, turn @ normal, atol=1e-3)


def distance_of_hulls(one, other):
    """Return the distance of the hulls of two point sets: that of the origin from the hull of their differences.

    Of all weights w >= 0 those that minimize |sum w d|^2 + (sum w - 1)^2 are, but for a factor, those of the point of
    the hull of the differences d that is nearest to the origin (Lawson and Hanson 1974, least distance programming).
    """
    difference = (one[:, None] - other).reshape(-1, 3)
    weights, _ = nnls(np.column_stack([difference, np.ones(len(difference))]).T, [0.0, 0.0, 0.0, 1.0])
    return float(np.linalg.norm(weights @ difference) / weights.sum())


def are_separate(one, other):
    """Return whether a plane separates two point sets, by a linear program."""
    a, b = len(one), len(other)
    rows = np.concatenate([np.column_stack([one, -np.ones(a)]), np.column_stack([-other, np.ones(b)])])
    found = linprog(np.zeros(4), A_ub=rows, b_ub=-np.ones(a + b), bounds=[(None, None)] * 4)
    return found.status == 0


def test_random_hulls_have_the_distance_of_their_points_and_overlap_where_no_plane_separates_them():
    generator = np.random.default_rng(2)
    apart = 0
    for _ in range(40):
        shapes = [random_hull(generator, count=12), random_hull(generator, count=12)]
        turns = [random_turn(generator), random_turn(generator)]
        place = generator.normal(size=3)
        place *= generator.uniform(0.4, 1.3) / np.linalg.norm(place)
        bed = Bed(shapes, [[0, 0, 0], place], turns)
        found, normal, _ = bed.touch()
        points = [
            shape.geometry.vertices @ bed.grains.matrix[k].T + bed.grains.position[k] for k, shape in enumerate(shapes)
        ]
        separate_now = are_separate(*points)
        assert (found > 0) == separate_now
        if separate_now:
            apart += 1
            assert np.isclose(found, distance_of_hulls(*points), rtol=0, atol=1e-6)
        else:
            # the translation parts them
            assert are_separate(points[0], points[1] + (1e-6 - found) * normal)
    assert 10 < apart < 35


def test_boxes_have_the_distance_and_the_depth_of_intervals():
    generator = np.random.default_rng(4)
    for _ in range(60):
        one, other = generator.uniform(0.2, 1.0, 3), generator.uniform(0.2, 1.0, 3)
        place = generator.uniform(-1.2, 1.2, 3)
        bed = Bed([solid("box", *one), solid("box", *other)], [[0, 0, 0], place])
        found, _, _ = bed.touch()
        clear = np.abs(place) - (one + other) / 2
        if (clear > 0).any():
            assert np.isclose(found, np.linalg.norm(np.maximum(clear, 0)), rtol=0, atol=1e-10)
        elif clear.max() > -0.1:
            assert found <= clear.max() + 1e-12


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("depth", [1e-9, 1e-5, 1e-3, 0.05, 0.2])
def test_boxes_that_overlap_along_an_axis_have_that_depth(axis, depth):
    place = np.array([0.05, -0.04, 0.03])
    place[axis] = 1.0 - depth
    turn = rotation_matrices(random_turn(np.random.default_rng(axis))[None])[0]
    bed = Bed([solid("box", 1, 1, 1)], [[0, 0, 0], turn @ place])
    bed.grains.matrix[:] = turn
    found, normal, _ = bed.touch()
    assert np.isclose(found, -depth, rtol=0, atol=1e-12)
    np.testing.assert_allclose(normal, turn[:, axis], atol=1e-7)


@pytest.mark.parametrize("pair", KINDS, ids="-".join)
def test_a_deep_overlap_has_a_translation_that_ends_it(pair):
    generator = np.random.default_rng(8)
    shapes = [SOLIDS[kind] for kind in pair]
    for share in (0.0, 0.1, 0.4):
        turns = [random_turn(generator), random_turn(generator)]
        bed = Bed(shapes, [[0, 0, 0], share * generator.normal(size=3)], turns)
        found, normal, _ = bed.touch()
        assert np.isfinite(normal).all()
        assert np.isclose(np.linalg.norm(normal), 1.0, rtol=0, atol=1e-12)
        if "clump" in pair:
            continue
        bed.grains.position[1] += (1e-9 - found) * normal
        bed.pairs.normal[:] = normal
        assert bed.touch()[0] > 0.0


@pytest.mark.parametrize("kind", ["hull", "box", "cylinder", "cone", "ellipsoid", "rod"])
@pytest.mark.parametrize("gap", [1e-3, 1e-5])
def test_slender_and_small_grains_have_exact_gaps(kind, gap):
    generator = np.random.default_rng(9)
    long = {
        "hull": random_hull(generator, factors=(1.0, 0.1, 0.1)),
        "box": solid("box", 1, 0.1, 0.1),
        "cylinder": solid("cylinder", 0.05, 1.0),
        "cone": solid("cone", 0.5, 0.1),
        "ellipsoid": solid("ellipsoid", 0.5, 0.05, 0.05),
        "rod": solid("spherocylinder", 0.05, 0.9),
    }[kind]
    for other, scale in itertools.product([long, SOLIDS["hull"], SOLIDS["ellipsoid"], SOLIDS["box"]], [1.0, 0.05]):
        for _ in range(2):
            shapes = [long, other]
            turns = [random_turn(generator), random_turn(generator)]
            bed = Bed(shapes, [[0, 0, 0], generator.normal(size=3)], turns, scale=[1.0, scale])
            found, _, rows = separate(bed, gap * scale)
            assert np.isclose(found, gap * scale, rtol=0, atol=1e-9 * scale)
            prove_gap(bed, shapes, rows[0], found, 1e-9 * scale)


def test_a_known_normal_does_not_change_the_gap():
    generator = np.random.default_rng(6)
    for pair in KINDS:
        shapes = [SOLIDS[kind] for kind in pair]
        bed = Bed(shapes, [[0, 0, 0], generator.normal(size=3)], [random_turn(generator), random_turn(generator)])
        found, normal, _ = separate(bed, 2e-3)
        for _ in range(5):
            wrong = normal + 0.3 * generator.normal(size=3)
            bed.pairs.normal[0] = wrong / np.linalg.norm(wrong)
            assert np.isclose(bed.touch()[0], found, rtol=0, atol=1e-10)


@pytest.mark.parametrize("apart", [1.02, 0.95, 1.3])
def test_hulls_whose_nearest_corners_are_known_have_the_same_gap(apart):
    """The corners are those of a place nearby, of another one, and any."""
    generator = np.random.default_rng(8)
    hulls = [random_hull(generator), random_hull(generator, count=60)]
    turns = [random_turn(generator), random_turn(generator)]
    reach = sum(hull.geometry.bounding_radius for hull in hulls)
    for _ in range(10):
        way = generator.normal(size=3)
        way *= apart * 0.8 * reach / np.linalg.norm(way)
        moved = way + 0.02 * generator.normal(size=3)
        known, new = (Bed(hulls, [(0, 0, 0), place], turns) for place in (way, moved))
        known.touch()
        assert known.pairs.corners[0, 0] >= 0
        expected, normal, rows = new.touch()
        for corners in (known.pairs.corners[0], new.pairs.corners[0, ::-1], [3, 5, 3, 5, 0, 0], [1, 2, 7, 7, -1, 0]):
            known.grains.position[1] = moved
            # the depth of an overlap is that along the directions near the first one
            known.pairs.corners[0], known.pairs.normal[0] = corners if min(corners[:2]) >= 0 else -1, 2.0
            gap, along, found = known.touch()
            assert gap == pytest.approx(expected, abs=1e-9)
            if gap > 1e-3:
                np.testing.assert_allclose(along, normal, atol=1e-6)
                assert len(found) == len(rows)


def test_unions_touch_at_each_pair_of_spheres_within_the_margin():
    generator = np.random.default_rng(7)
    shapes = [random_clump(generator, 30), random_clump(generator, 40)]
    turns = [random_turn(generator), random_turn(generator)]
    bed = Bed(shapes, [[0, 0, 0], [0.7, 0.1, 0.1]], turns, scale=[1.0, 0.7])
    found = bed.find(0.06, 0.01)
    places = [
        bed.grains.scale[k] * shape.geometry.centers @ bed.grains.matrix[k].T + bed.grains.position[k]
        for k, shape in enumerate(shapes)
    ]
    radii = [bed.grains.scale[k] * shape.geometry.radii for k, shape in enumerate(shapes)]
    gaps = np.linalg.norm(places[0][:, None] - places[1][None], axis=-1) - radii[0][:, None] - radii[1]
    near = np.sort(gaps[gaps < 0.06])
    assert len(near) > 5
    np.testing.assert_allclose(np.sort(bed.rows.row[:found, 9]), near - 0.01, atol=1e-13)
    assert np.isclose(bed.pairs.bound[0], gaps.min(), rtol=0, atol=1e-13)


@pytest.mark.parametrize("shape", [solid("box", 1, 1, 1), solid("cylinder", 0.5, 1)], ids=["box", "cylinder"])
def test_a_box_or_cylinder_on_end_touches_around_its_center(shape):
    gap = 1e-3
    bed = Bed([solid("box", 4, 4, 1), shape], [[0, 0, 0], [0.3, 0.2, 1.0 + gap]])
    _, normal, rows = bed.touch(0.05)
    np.testing.assert_allclose(normal, [0, 0, 1], atol=1e-9)
    np.testing.assert_allclose(rows[:, 9], gap, atol=1e-9)
    feet = rows[:, 6:8]
    np.testing.assert_allclose(rows[:, 8], -0.5, atol=1e-9)
    # the center lies well inside the polygon of the contacts
    angles = np.sort(np.arctan2(feet[:, 1], feet[:, 0])[np.linalg.norm(feet, axis=1) > 0.4])
    assert np.diff(np.append(angles, angles[0] + 2 * np.pi)).max() < 2.0


@pytest.mark.parametrize("on", ["box", "cylinder"])
def test_boxes_of_a_stack_touch_at_the_corners_of_the_common_face(on):
    lower = solid("box", 1, 1, 1) if on == "box" else solid("cylinder", 2, 1)
    bed = Bed([lower, solid("box", 1, 1, 1)], [[0, 0, 0], [0.3, 0.2, 1.0]])
    _, _, rows = bed.touch(0.05)
    arms = rows[:, 6:8]
    top = np.array([0.5, 0.5]) if on == "cylinder" else np.array([0.2, 0.3])
    for corner in itertools.product((-0.5, top[0]), (-0.5, top[1])):
        assert np.linalg.norm(arms - corner, axis=1).min() < 0.06


@pytest.mark.parametrize("kind", ["cylinder", "spherocylinder"])
def test_cylinders_and_rods_on_their_sides_touch_along_a_segment(kind):
    turn = (np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0)
    bed = Bed([solid("box", 4, 4, 1), solid(kind, 0.3, 2)], [[0, 0, 0], [0.1, 0, 0.8 + 1e-3]], [UPRIGHT, turn])
    _, _, rows = bed.touch(0.05)
    np.testing.assert_allclose(rows[:, 9], 1e-3, atol=1e-9)
    assert rows[:, 6].min() < -0.9
    assert rows[:, 6].max() > 0.9
    # two of them side by side
    bed = Bed([solid(kind, 0.3, 2)], [[0, 0, 0], [0.6 + 1e-3, 0, 0.4]])
    _, _, rows = bed.touch(0.05)
    np.testing.assert_allclose(rows[:, 9], 1e-3, atol=1e-4)
    assert rows[:, 8].min() < -0.9
    assert rows[:, 8].max() > 0.5
    # crossed, they touch at one place
    across = (np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0)
    bed = Bed([solid(kind, 0.3, 2)], [[0, 0, 0], [0.6 + 1e-3, 0, 0.4]], [UPRIGHT, across])
    assert np.ptp(bed.touch(0.05)[2][:, 6:9], axis=0).max() < 0.05
    # on end, a rod touches in one point
    bed = Bed([solid("box", 4, 4, 1), solid(kind, 0.3, 2)], [[0, 0, 0], [0.1, 0, 1.5 + 1e-3]])
    if kind == "spherocylinder":
        bed.grains.position[1, 2] += 0.3
        np.testing.assert_allclose(bed.touch(0.05)[2][:, 6:10], [[0, 0, -1.3, 1e-3]], atol=1e-12)


def test_a_cone_on_its_side_touches_along_a_segment():
    # its side makes half the angle of the apex with the axis
    height, radius = 1.2, 0.4
    angle = np.pi / 2 + np.arctan2(radius, height)
    bed = Bed(
        [solid("box", 9, 9, 1), solid("cone", radius, height)],
        [[0, 0, 0], [0, 0, 5]],
        [UPRIGHT, (np.cos(angle / 2), 0, np.sin(angle / 2), 0)],
    )
    _, _, rows = separate(bed, 1e-3)
    rows = rows[rows[:, 9] < 0.05]
    np.testing.assert_allclose(rows[:, 9], 1e-3, atol=1e-9)
    assert np.isclose(np.ptp(rows[:, 6]), np.hypot(radius, height), rtol=0, atol=0.05)


def test_a_box_on_its_edge_touches_at_both_ends():
    turn = (np.cos(np.pi / 8), np.sin(np.pi / 8), 0.0, 0.0)
    bed = Bed([solid("box", 4, 4, 1), solid("box", 1, 1, 1)], [[0, 0, 0], [0, 0, 5]], [UPRIGHT, turn])
    _, _, rows = separate(bed, 1e-3)
    rows = rows[rows[:, 9] < 0.05]
    np.testing.assert_allclose(rows[:, 9], 1e-3, atol=1e-9)
    assert np.ptp(rows[:, 6]) > 0.9


@pytest.mark.parametrize(
    "beside",
    [
        [(0.5, 0.01, 0.004), (0.5, -0.01, 0.004)],  # the faces at the edge are thin
        [(-1.0, 0.3, 0.5), (-1.0, -0.3, 0.5)],  # a face at its end is nearer to the normal than those at its sides
    ],
)
def test_a_hull_on_its_edge_touches_at_both_ends(beside):
    top = [(x, y, 1.0) for x in (0.0, 1.0) for y in (-0.6, 0.6)]
    hull = Shape.of(hull_of(np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), *beside, *top])), name="hull")
    bed = Bed([solid("box", 4, 4, 1), hull], [[0, 0, 0], [0, 0, 5]])
    _, _, rows = separate(bed, 1e-3)
    rows = rows[rows[:, 9] < 2e-3]
    np.testing.assert_allclose(rows[:, 9], 1e-3, atol=1e-9)
    assert np.isclose(np.ptp(rows[:, 6]), 1.0, rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    "pair",
    [("hull", "hull"), ("hull", "box"), ("cylinder", "hull"), ("cone", "cylinder"), ("rod", "box"), ("rod", "rod")],
)
def test_no_further_point_has_a_gap_above_the_distance_there(pair):
    """The segment from the point of one grain to that of the other is outside of both."""
    generator = np.random.default_rng(12)
    shapes = [SOLIDS[kind] for kind in pair]
    many = 0
    for _ in range(30):
        bed = Bed(shapes, [[0, 0, 0], generator.normal(size=3)], [random_turn(generator), random_turn(generator)])
        separate(bed, 1e-3)
        _, _, rows = bed.touch(0.2)
        many += len(rows) - 1
        for row in rows:
            assert row[9] >= 1e-3 - 1e-9
            for share in (0.1, 0.5, 0.9):
                point = bed.grains.position[0] + row[3:6] + share * row[9] * row[:3]
                for k in (0, 1):
                    inner = bed.grains.matrix[k].T @ (point - bed.grains.position[k])
                    assert not holds(shapes[k], inner, -1e-9)
    # rods in random poses hardly lie on each other
    assert many > (0 if "rod" in pair else 20)


def test_a_second_call_finds_what_a_first_one_had_no_space_for():
    generator = np.random.default_rng(1)
    shapes = [random_clump(generator, 20), SOLIDS["box"], SOLIDS["hull"]]
    place = generator.uniform(0, 1.6, (8, 3))
    turns = [random_turn(generator) for _ in range(8)]
    full, short = Bed(shapes, place, turns), Bed(shapes, place, turns, space=10)
    for bed in (full, short):
        bed.pairs.first[:], bed.pairs.count[:] = np.arange(len(bed.pairs.i)) % 7, 2
    old = generator.normal(size=(full.rows.old.shape))
    old[:, 14] = 0.0
    full.rows.old[:], short.rows.old[:] = old, old[:10]
    known = [array.copy() for array in short.pairs]
    assert short.find(0.1, again=False) == -1
    # as the bed does where it makes room
    for array, before in zip(short.pairs, known, strict=True):
        array[:] = before
    short.rows = make_rows(400)
    short.rows.old[:] = old
    found = full.find(0.1, again=False)
    assert found > 10
    assert short.find(0.1, again=False) == found
    np.testing.assert_array_equal(short.rows.row[:found], full.rows.row[:found])


def test_impulses_go_to_the_rows_of_the_next_step_and_far_pairs_are_skipped():
    bed = Bed([solid("box", 1, 1, 1)], [[0, 0, 0], [0.3, 0.2, 1.001]])
    found = bed.find(0.05)
    bed.rows.row[:found, 10] = np.arange(1, found + 1)
    bed.rows.old[:found] = bed.rows.row[:found]
    assert bed.find(0.05) == found
    np.testing.assert_array_equal(bed.rows.row[:found, 10], np.arange(1, found + 1))
    far = Bed([solid("box", 1, 1, 1)], [[0, 0, 0], [0, 0, 1.09]])
    assert far.find(0.05) == 0
    bound = float(far.pairs.bound[0])
    assert 0.05 < bound <= 0.09 + 1e-12
    # it is not looked at before the ways could have closed the gap
    far.grains.position[1, 2] = 1.01
    assert far.find(0.05, again=False) == 0
    far.grains.way[1] = 0.08
    assert far.find(0.05, again=False) > 0
    assert np.isclose(far.pairs.bound[0], 0.01, rtol=0, atol=1e-12)
    # room adds to the rest
    far.pairs.room[0] = 0.002
    far.find(0.05, 0.003)
    assert np.isclose(far.rows.row[0, 9], 0.01 - 0.005, rtol=0, atol=1e-12)
    # periodic: the partner is shifted
    far.pairs.shift[0] = [0, 0, 3]
    far.grains.position[1, 2] -= 3
    far.find(0.05)
    assert np.isclose(far.pairs.bound[0], 0.01, rtol=0, atol=1e-12)


def test_pairs_of_other_kinds_are_left_alone():
    bed = Bed([solid("sphere", 0.5)], [[0, 0, 0], [1, 0, 0]])
    bed.pairs.first[0], bed.pairs.count[0] = 5, 3
    assert bed.find(0.1, m=7) == 7
    assert (bed.pairs.first[0], bed.pairs.count[0]) == (5, 3)
    bed = Bed([solid("box", 1, 1, 1)], [[0, 0, 0], [1, 0, 0]], kinds=np.array([CONVEX, 2]))
    assert bed.find(0.1, m=7) == 7
    assert (bed.pairs.first[0], bed.pairs.count[0]) == (0, 0)


@pytest.mark.slow
def test_large_hulls_are_searched_along_their_edges():
    generator = np.random.default_rng(13)
    vertices, faces, _ = sphere(3)
    shapes = [Shape.of(Mesh(vertices * [0.5, 0.4, 0.3], faces), name="egg"), SOLIDS["hull"]]
    for _ in range(10):
        bed = Bed(shapes, [[0, 0, 0], generator.normal(size=3)], [random_turn(generator), random_turn(generator)])
        found, _, rows = separate(bed, 1e-3)
        prove_gap(bed, shapes, rows[0], found, 1e-9)


def test_convex_is_what_its_hull_is():
    vertices, faces, _ = unit_box()
    assert is_convex(Mesh(vertices, faces))
    ball, triangles, _ = sphere(3)
    assert is_convex(Mesh(ball, triangles))
    rounded = ball.astype(np.float32).astype(np.float64)
    assert is_convex(Mesh(rounded, triangles))
    dented = ball.copy()
    dented[7] *= 0.95
    assert not is_convex(Mesh(dented, triangles))
    assert is_convex(SOLIDS["cone"].geometry)
    assert not is_convex(SOLIDS["clump"].geometry)
    assert has_convex_parts(SOLIDS["clump"].geometry)
    bodies = convex_bodies([Shape(Mesh(dented, triangles)), SOLIDS["box"]])
    assert bodies.kind.tolist() == [-1, 2]
    assert len(bodies.face) == 6
    assert np.isclose(bodies.thick[1], 0.3)
