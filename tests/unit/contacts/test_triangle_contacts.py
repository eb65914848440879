"""Exact contacts of surfaces: gaps, normals and proofs are those of the general tests, edges and nested grains too."""

import manifold3d
import numpy as np
import pytest
from kit import hull, mesh_box
from surface_scenes import bring_near, couples, exact_gaps, grains_of, pairs_of, rows_of

import voxgran as vg
from voxgran.contacts.manifolds import surface_memory
from voxgran.contacts.manifolds.distance_grids import surface_bodies
from voxgran.contacts.manifolds.rows import GAP, Search
from voxgran.contacts.manifolds.surface_memory import surface_work, write_pose
from voxgran.contacts.manifolds.triangle_contacts import MOST, find_triangle_contacts, prove_separate
from voxgran.contacts.manifolds.triangle_depths import crossing_curve
from voxgran.geometry.rotation import normalized
from voxgran.settling.impulses import rotate

STRAIGHT = np.array([[1.0, 0.0, 0.0, 0.0]])


@pytest.fixture(scope="module")
def rocks():
    shapes = [vg.make_shape("solid_union", seed=seed) for seed in (1, 2)]
    return shapes, surface_bodies(shapes)


def contacts(grains, bodies, pairs, margin, rest=0.0):
    """Return rows and work after one look at all pairs."""
    rows, work = rows_of(MOST * len(pairs.i)), surface_work(bodies, len(pairs.i))
    m = find_triangle_contacts(Search(grains, pairs, margin, rest), work, rows, 0)
    return rows, work, m


def test_gaps_and_normals_are_those_of_the_general_tests(rocks):
    shapes, bodies = rocks
    grains, turns, pairs = couples(80, shapes, 3)
    box = vg.Box((4000.0, 40.0, 40.0))
    for k in range(3):
        bring_near(shapes, grains, turns, pairs, box, np.random.Generator(np.random.Philox(k)))
    gap, normal, _, proven = exact_gaps(shapes, grains, turns, pairs, 0.01, box)
    rows, work, m = contacts(grains, bodies, pairs, 0.01, rest=1e-3)
    near = np.flatnonzero(proven & (gap <= 0.01))
    assert len(near) > 20
    deepest = rows.row[pairs.first[near]]
    np.testing.assert_allclose(deepest[:, GAP], gap[near] - 1e-3, atol=1e-13)
    np.testing.assert_allclose(deepest[:, :3], normal[near], atol=1e-9)
    np.testing.assert_allclose(work.arrays.gap[near], gap[near], atol=1e-13)
    np.testing.assert_array_equal(work.arrays.proven, proven)
    assert not pairs.count[proven & (gap > 0.01)].any()
    overlapping = pairs.first[np.flatnonzero(~proven)]
    assert (pairs.count[~proven] > 0).all()
    assert (rows.row[overlapping, GAP] <= -1e-3).all()
    # both arms lead to the contact, a gap apart along the normal
    for k in range(m):
        i, j, row = rows.i[k], rows.j[k], rows.row[k]
        apart = (grains.position[j] + row[6:9]) - (grains.position[i] + row[3:6])
        np.testing.assert_allclose(apart, (row[GAP] + 1e-3) * row[:3], atol=1e-12)


def near_couples(shapes, seed):
    """Return a generator, and the grains, rotations and pairs of sixty couples that nearly touch."""
    generator = np.random.Generator(np.random.Philox(seed))
    grains, turns, pairs = couples(60, shapes, 4)
    box = vg.Box((3000.0, 40.0, 40.0))
    for _ in range(3):
        bring_near(shapes, grains, turns, pairs, box, generator)
    return generator, grains, turns, pairs


@pytest.mark.parametrize(("room", "reach"), [(1, 0.02), (800, 0.02), (800, 0.004)])
def test_what_is_remembered_does_not_change_the_gaps(rocks, room, reach, monkeypatch):
    """Grains of near couples move in small steps; each time the gaps are those of a look without memory."""
    monkeypatch.setattr(surface_memory, "FIRST", room)
    bodies = rocks[1]
    generator, grains, _, pairs = near_couples(rocks[0], 5)
    work, rows = surface_work(bodies, 60), rows_of(MOST * 60)
    kept = []
    for step in range(8):
        gap, proven = prove_separate(grains, pairs, work, rows, reach)
        other = surface_work(bodies, 60)
        fresh, again = prove_separate(grains, pairs, other, rows, reach)
        # of pairs that are farther apart some have the reach as their gap
        gap[gap >= reach] = fresh[fresh >= reach] = np.inf
        np.testing.assert_allclose(gap, fresh, atol=1e-13)
        np.testing.assert_array_equal(proven, again)
        kept.append(set(np.flatnonzero(work.arrays.key[:, 1, 2] > 0)))
        grains.position[:] += generator.normal(size=(120, 3)) * (1e-3 if step < 6 else 2e-2)
    # lists that found no room at first are kept when they are made again, and lie apart from each other in the pool
    assert (kept[0] < kept[1]) == (room == 1)
    assert len(kept[1]) > 20
    first, count = work.arrays.key[:, 1, 3], work.arrays.key[:, 1, 4]
    order = np.lexsort((count, first))
    assert (first[order][1:] >= (first + count)[order][:-1]).all()


def test_triangles_that_sleep_do_not_change_the_rows(rocks):
    """Grains of near couples move and turn in small steps; each time the rows are those of a look without memory."""
    bodies = rocks[1]
    generator, grains, turns, pairs = near_couples(rocks[0], 9)
    work, rows, many = surface_work(bodies, 60), rows_of(MOST * 60), 0
    for _ in range(12):
        m = find_triangle_contacts(Search(grains, pairs, 5e-3, 0.0), work, rows, 0)
        fresh, _, again = contacts(grains, bodies, pairs, 5e-3)
        assert m == again
        # depths of surfaces that cross depend on which triangles are listed
        apart = ~np.isin(rows.i[:m], pairs.i[np.isneginf(work.arrays.gap)])
        np.testing.assert_allclose(rows.row[:m, :10][apart], fresh.row[:m, :10][apart], atol=1e-9)
        many += apart.sum()
        grains.position[:] += generator.normal(size=(120, 3)) * 6e-4
        for k in range(120):
            turned = normalized((turns[k] + 5e-4 * generator.normal(size=4))[None])[0]
            turns[k] = turned
            rotate(turned, grains.matrix[k])
    assert many > 100


def test_lists_that_move_to_the_front_of_the_pool_stay_as_they_are(rocks):
    shapes, bodies = rocks
    grains, turns, pairs = couples(40, shapes, 4, reach=0.6)
    bring_near(shapes, grains, turns, pairs, vg.Box((3000.0, 40.0, 40.0)), np.random.Generator(np.random.Philox(7)))
    work, rows = surface_work(bodies, 40), rows_of(MOST * 40)
    # some overlap: their lists are looked for twice in a search, also where they find no room
    for _ in range(2):
        find_triangle_contacts(Search(grains, pairs, 0.02, 0.0), work, rows, 0)
        assert (work.arrays.key[:, 1, 3] + work.arrays.key[:, 1, 4]).max() <= len(work.arrays.apart)

    def lists():
        key, found = work.arrays.key[:, 1], []
        for first, count in key[key[:, 2] > 0][:, [3, 2]]:
            found.append((work.arrays.near[first : first + count].copy(), work.arrays.apart[first : first + count]))
        return found

    key = work.arrays.key[:, 1]
    # every second list is given up, one has found no room, and one is that of a pair that is no longer there
    key[::2, 2], key[-2:, 2] = -1, -1
    before = lists()
    key[0, 2:5] = surface_memory.LOST, 5000, 0
    key[-1, 2] = 3
    assert len(before) > 5
    surface_memory.tidy(work, 39)
    for one, other in zip(before, lists(), strict=True):
        np.testing.assert_array_equal(one[0], other[0])
        np.testing.assert_array_equal(one[1], other[1])
    assert work.arrays.used[0] == sum(len(near) for near, _ in before)
    assert len(work.arrays.apart) >= work.arrays.used[0] + 5000


def test_pairs_of_a_dense_bed_take_little_memory(rocks):
    shapes, bodies = rocks
    n, generator = 5**3, np.random.Generator(np.random.Philox(2))
    place = np.stack(np.meshgrid(*[0.97 * np.arange(5.0)] * 3), axis=-1).reshape(-1, 3)
    shape, turns = generator.integers(0, 2, n), normalized(generator.normal(size=(n, 4)))
    grains = grains_of(shapes, shape, place, turns)
    far = np.linalg.norm(place[:, None] - place, axis=2) - grains.radius[:, None] - grains.radius
    pairs = pairs_of(*np.nonzero(np.triu(far < 0.1, 1)))
    assert len(pairs.i) > 6 * n
    rows, work = rows_of(MOST * len(pairs.i)), surface_work(bodies, len(pairs.i))
    for _ in range(3):
        find_triangle_contacts(Search(grains, pairs, 5e-3, 0.0), work, rows, 0)
        grains.position[:] += 2e-3 * generator.normal(size=(n, 3))
    assert (work.arrays.key[:, 1, 2] > 0).sum() > 2 * n
    held = sum(array.nbytes for name, array in work.arrays._asdict().items() if name not in {"bodies", *work.scratch})
    assert held / n < 50e3


def test_edges_of_crossed_boxes_touch_at_one_place():
    bar = mesh_box((2.0, 0.2, 0.2))
    bodies = surface_bodies([bar])
    # each lies on an edge, the upper one across the lower
    tilt = np.array([np.cos(np.pi / 8), np.sin(np.pi / 8), 0.0, 0.0])
    over = np.array([np.cos(np.pi / 4), 0.0, 0.0, np.sin(np.pi / 4)])
    a, b = over, tilt
    product = [a[0] * b[0] - a[1:] @ b[1:], *(a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:]))]
    turns, high = np.array([tilt, product]), 0.2 * np.sqrt(2)
    grains = grains_of([bar], [0, 0], [[0, 0, 0], [0, 0, high + 1e-3]], turns)
    rows, work, m = contacts(grains, bodies, pairs_of([0], [1]), 5e-3)
    assert m == 1
    np.testing.assert_allclose(rows.row[0, :10], [0, 0, 1, 0, 0, high / 2, 0, 0, -high / 2, 1e-3], atol=1e-12)
    grains.position[1, 2] = high - 1e-3
    rows, work, m = contacts(grains, bodies, pairs_of([0], [1]), 5e-3)
    # the height of one edge over the other goes on through zero
    assert m == 1
    np.testing.assert_allclose(rows.row[0, :10], [0, 0, 1, 0, 0, high / 2, 0, 0, -high / 2, -1e-3], atol=1e-12)
    assert not work.arrays.proven[0]


def test_a_corner_in_a_face_has_its_depth():
    block = mesh_box((1.0, 1.0, 1.0))
    points = np.array([[0, 0, -1], [0.4, 0, 0], [-0.2, 0.35, 0], [-0.2, -0.35, 0]], dtype=float)
    tip = vg.Shape.from_mesh(*hull(points)[:2])
    low = float(tip.vertices[:, 2].min())
    bodies = surface_bodies([block, tip])
    for gap in (2e-3, -2e-3, -5e-3):
        place = [[0, 0, 0], [0.1, 0.2, 0.5 - low + gap]]
        for one, other in ((0, 1), (1, 0)):
            grains = grains_of([block, tip], [one, other], [place[one], place[other]], np.repeat(STRAIGHT, 2, axis=0))
            rows, work, m = contacts(grains, bodies, pairs_of([0], [1]), 4e-3)
            assert m == 1
            assert rows.row[0, GAP] == pytest.approx(gap, abs=1e-12)
            np.testing.assert_allclose(rows.row[0, :3], [0, 0, 1 if one == 0 else -1], atol=1e-12)
            assert work.arrays.proven[0] == (gap > 0)


def test_faces_touch_at_their_corners():
    block = mesh_box((1.0, 1.0, 1.0))
    grains = grains_of([block], [0, 0], [[0, 0, 0], [0.3, 0.2, 1.001]], np.repeat(STRAIGHT, 2, axis=0))
    rows, _, m = contacts(grains, surface_bodies([block]), pairs_of([0], [1]), 5e-3)
    assert m >= 4
    np.testing.assert_allclose(rows.row[:m, :3], [[0, 0, 1]] * m, atol=1e-12)
    np.testing.assert_allclose(rows.row[:m, GAP], 1e-3, atol=1e-12)
    corners = {(x, y) for x, y in np.round(rows.row[:m, 3:5], 6).tolist()}
    assert {(-0.2, -0.3), (0.5, -0.3), (-0.2, 0.5), (0.5, 0.5)} <= corners


def test_a_grain_in_a_cavity_is_separate_and_one_in_the_solid_is_not():
    outer = mesh_box((1.0, 1.0, 1.0))
    inner = mesh_box((0.2, 0.2, 0.2))
    grains = grains_of([outer, inner], [0, 1], [[0, 0, 0], [0.1, 0, 0]], np.repeat(STRAIGHT, 2, axis=0))
    rows, work, m = contacts(grains, surface_bodies([outer, inner]), pairs_of([0], [1]), 1e-2)
    assert not work.arrays.proven[0]
    assert work.arrays.gap[0] == -np.inf
    assert m > 0
    assert rows.row[:m, GAP].min() < -0.2


@pytest.mark.parametrize("family", ["solid_union", "sphere"])
def test_small_grains_just_below_the_surface_of_a_large_one_are_in_it(family):
    rock, other = vg.make_shape("solid_union", seed=1), vg.make_shape(family, seed=1)
    generator, n, depth, small = np.random.Generator(np.random.Philox(4)), 400, 1e-3, 0.02
    corners = rock.vertices[rock.faces[generator.integers(len(rock.faces), size=n)]]
    out = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    out /= np.linalg.norm(out, axis=1)[:, None]
    at = np.einsum("kc,kcx->kx", generator.dirichlet(np.ones(3), size=n), corners)
    at -= (depth + small * other.bounding_radius) * out
    place = np.zeros((2 * n, 3))
    place[:, 0] = 10.0 * np.repeat(np.arange(n), 2)
    place[1::2] += at
    grains = grains_of([rock, other], [0, 1] * n, place, np.repeat(STRAIGHT, 2 * n, axis=0))
    grains.scale[1::2], grains.radius[1::2] = small, small * other.bounding_radius
    pairs = pairs_of(np.arange(0, 2 * n, 2), np.arange(1, 2 * n, 2))
    _, work, _ = contacts(grains, surface_bodies([rock, other]), pairs, 3e-3)
    inside = rock.signed_distance(at) < -small * other.bounding_radius
    assert inside.sum() > 300
    assert not work.arrays.proven[inside].any()


def test_spheres_and_clumps_are_as_far_as_their_centers_less_the_radius(rocks):
    rock = rocks[0][0]
    sphere = vg.make_shape("sphere")
    bodies = surface_bodies([rock, sphere])
    generator = np.random.Generator(np.random.Philox(8))
    turns = normalized(generator.normal(size=(60, 4)))
    place = np.zeros((60, 3))
    place[::2, 0] = 20.0 * np.arange(30)
    way = normalized(np.column_stack([generator.normal(size=(30, 3)), np.zeros(30)]))[:, :3]
    place[1::2] = place[::2] + way * (0.5 + 0.6 * generator.random(30))[:, None]
    grains = grains_of([rock, sphere], [0, 1] * 30, place, turns)
    pairs = pairs_of(np.arange(0, 60, 2), np.arange(1, 60, 2))
    back = np.einsum("kji,kj->ki", grains.matrix[::2], place[1::2] - place[::2])
    true = rock.signed_distance(back) - sphere.bounding_radius
    rows, work, _ = contacts(grains, bodies, pairs, 0.3)
    for p in np.flatnonzero((true < 0.3) & (true > -0.4)):
        assert rows.row[pairs.first[p], GAP] == pytest.approx(true[p], abs=1e-12)
        assert work.arrays.proven[p] == (true[p] > 0)
    assert not pairs.count[true > 0.3].any()


def test_a_grain_twenty_times_smaller_is_found_exactly(rocks):
    shapes, bodies = rocks
    grains, turns, pairs = couples(60, shapes, 9, ratio=0.05, reach=1.0)
    box = vg.Box((3000.0, 40.0, 40.0))
    for k in range(4):
        bring_near(shapes, grains, turns, pairs, box, np.random.Generator(np.random.Philox(k)), most=2e-3)
    gap, _, _, proven = exact_gaps(shapes, grains, turns, pairs, 2e-3, box)
    rows, work, _ = contacts(grains, bodies, pairs, 2e-3)
    near = np.flatnonzero(proven & (gap < 2e-3))
    assert len(near) > 20
    np.testing.assert_allclose(rows.row[pairs.first[near], GAP], gap[near], atol=1e-13)
    np.testing.assert_array_equal(work.arrays.proven, proven)


def test_two_tetrahedra_edge_to_edge():
    points = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, -1.5], [0, -1, -1.5]], dtype=float)
    solid = vg.Shape.from_mesh(*hull(points)[:2])
    top = float(solid.vertices[:, 2].max())
    # upside down and turned by a quarter: the upper edges of both cross
    half = np.sqrt(0.5)
    turns = np.array([[1, 0, 0, 0], [0, half, half, 0]])
    grains = grains_of([solid], [0, 0], [[0, 0, 0], [0.2, -0.3, 2 * top + 2e-3]], turns)
    rows, _, m = contacts(grains, surface_bodies([solid]), pairs_of([0], [1]), 1e-2)
    assert m == 1
    np.testing.assert_allclose(rows.row[0, :10], [0, 0, 1, 0.2, 0, top, 0, 0.3, -top, 2e-3], atol=1e-12)


@pytest.mark.parametrize("depth", [0.03, 0.1, 0.3])
def test_ridges_that_cross_deeply_push_each_other_back(depth):
    """The ridge of each lies behind the other by more than depths are sought: the points nearest to crossing do not."""
    points = np.array([[1, 0, 0], [-1, 0, 0], [0, 0.3, -1.5], [0, -0.3, -1.5]], dtype=float)
    solid = vg.Shape.from_mesh(*hull(points)[:2])
    top = float(solid.vertices[:, 2].max())
    half = np.sqrt(0.5)
    turns = np.array([[1, 0, 0, 0], [0, half, half, 0]])
    grains = grains_of([solid], [0, 0], [[0, 0, 0], [0, 0, 2 * top - depth]], turns)
    rows, work, m = contacts(grains, surface_bodies([solid]), pairs_of([0], [1]), 5e-3)
    assert not work.arrays.proven[0]
    deepest = rows.row[: max(m, 1), GAP].argmin()
    assert rows.row[deepest, GAP] < -5e-3
    np.testing.assert_allclose(rows.row[deepest, :3], [0, 0, 1], atol=1e-9)
    assert (rows.row[:m, 2] > 0.0).all()


@pytest.mark.slow
def test_the_curve_in_which_surfaces_cross_leads_out_of_their_overlap():
    """Its direction is that in which the volume of the overlap, by exact booleans, shrinks fastest."""
    generator = np.random.Generator(np.random.Philox(7))
    shapes = [vg.Shape.from_mesh(*hull(generator.normal(size=(8, 3)))[:2]) for _ in range(2)]
    bodies, found = surface_bodies(shapes), 0
    many = [len(shape.faces) for shape in shapes]
    for _ in range(12):
        turns = normalized(generator.normal(size=(2, 4)))
        way = generator.normal(size=3)
        way *= 0.5 * sum(shape.bounding_radius for shape in shapes) / np.linalg.norm(way)
        grains = grains_of(shapes, [0, 1], [np.zeros(3), way], turns)
        solids = [
            manifold3d.Manifold(manifold3d.Mesh64(shape.vertices @ grains.matrix[k].T, shape.faces.astype(np.uint64)))
            for k, shape in enumerate(shapes)
        ]

        def overlap(at, solids=solids):
            return (solids[0] ^ solids[1].translate(at)).volume()

        work = surface_work(bodies, 1).arrays
        pair = np.stack(np.meshgrid(np.arange(many[0]), many[0] + np.arange(many[1]), indexing="ij"), axis=-1)
        work.found[: pair.size // 2, :2] = pair.reshape(-1, 2)
        write_pose(grains, 0, 1, tuple(way), work.now)
        k, gap = crossing_curve(grains, work, pair.size // 2, 0, 1)
        assert k == 0 or overlap(way) > 0.0
        if k == 0:
            continue
        slope = np.array([overlap(way + 1e-4 * axis) - overlap(way - 1e-4 * axis) for axis in np.eye(3)]) / 2e-4
        np.testing.assert_allclose(work.candidate[0, 3:6], -slope / np.linalg.norm(slope), atol=1e-4)
        assert gap < 0.0
        found += 1
    assert found > 3


def test_a_corner_that_rests_in_a_notch_of_another_rock_is_pushed_out_of_it(rocks):
    """Edges that have just crossed point to all sides of it, and would hold the corner: found in a bed of rocks."""
    shapes, bodies = rocks
    turns = normalized(np.array([[0.122142, 0.124784, 0.354883, -0.918460], [0.746009, -0.020295, 0.279590, 0.604060]]))
    way = np.array([0.381771, -0.825847, 0.442251])
    scale = np.array([0.957052, 1.200645]) / [shape.diameter for shape in shapes]
    grains, pairs = grains_of(shapes, [0, 1], [np.zeros(3), way], turns, scale), pairs_of([0], [1])
    work = surface_work(bodies, 1)
    # the second rock moves as far as the contacts ask for, as in rounds of parting
    for _ in range(20):
        rows = rows_of(MOST)
        m = find_triangle_contacts(Search(grains, pairs, 5e-3, 1e-4), work, rows, 0)
        if work.arrays.proven[0]:
            break
        normal = rows.row[:m, :3]
        assert (normal @ normal[rows.row[:m, GAP].argmin()] >= 0.0).all()
        grains.position[1] += np.linalg.lstsq(normal, np.maximum(-rows.row[:m, GAP], 0.0), rcond=None)[0]
        grains.way[:] += 0.1
    assert work.arrays.proven[0]
