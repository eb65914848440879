"""Contacts from grids of distance: near the exact gaps, turned with the bed, complete when rows fill."""

import numpy as np
import pytest
from kit import slow
from scipy.spatial import cKDTree
from surface_scenes import bring_near, couples, exact_gaps, grains_of, pairs_of, rows_of

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran.contacts.manifolds.distance_grids import surface_bodies, surface_points
from voxgran.contacts.manifolds.rows import GAP, PUSH, Pair, Search
from voxgran.contacts.manifolds.surface_contacts import MOST, find_surface_contacts
from voxgran.contacts.manifolds.surface_memory import surface_work, write_spread
from voxgran.geometry.rotation import normalized, rotation_matrices


@pytest.fixture(scope="module")
def scene():
    shapes = [vg.make_shape("solid_union", seed=seed) for seed in (1, 2)]
    grains, turns, pairs = couples(80, shapes, 3)
    box = vg.Box((4000.0, 40.0, 40.0))
    for k in range(3):
        bring_near(shapes, grains, turns, pairs, box, np.random.Generator(np.random.Philox(k)))
    return shapes, surface_bodies(shapes), grains, pairs, exact_gaps(shapes, grains, turns, pairs, 0.03, box)


def look(grains, bodies, pairs, margin=0.04, rest=0.0, cap=2000):
    rows, work = rows_of(cap), surface_work(bodies, len(pairs.i))
    return rows, find_surface_contacts(Search(grains, pairs, margin, rest), work, rows, 0)


def test_gaps_are_near_the_exact_ones_and_depths_are_found(scene):
    _, bodies, grains, again, (gap, normal, _, proven) = scene
    pairs = pairs_of(again.i, again.j)
    rows, _ = look(grains, bodies, pairs)
    near = np.flatnonzero(proven & (gap < 0.02))
    assert (pairs.count[near] > 0).all()
    error = rows.row[pairs.first[near], GAP] - gap[near]
    assert error.min() > -2e-3
    assert np.median(error) < 7e-3
    assert error.max() < 0.02
    assert np.median((rows.row[pairs.first[near], :3] * normal[near]).sum(axis=1)) > 0.98
    deep = np.flatnonzero(~proven)
    assert (pairs.bound[deep] < 5e-3).all()


def test_room_and_rest_are_subtracted_and_bounds_skip(scene):
    _, bodies, grains, again, _ = scene
    pairs, other = pairs_of(again.i, again.j), pairs_of(again.i, again.j)
    rows, _ = look(grains, bodies, pairs)
    other.room[:] = 1e-3
    moved, _ = look(grains, bodies, other, rest=2e-3)
    some = np.flatnonzero(pairs.count)
    np.testing.assert_allclose(moved.row[other.first[some], GAP], rows.row[pairs.first[some], GAP] - 3e-3, atol=1e-12)
    # no way was gone since: pairs beyond the margin are not looked at, and keep no contacts
    far = pairs.bound > 0.04
    grains.way[:] = 0.0
    bound = pairs.bound.copy()
    look(grains, bodies, pairs)
    np.testing.assert_array_equal(bound[far], pairs.bound[far])
    assert not pairs.count[far].any()


def test_what_is_remembered_does_not_change_the_contacts(scene):
    """Points that are listed when a pair is looked at are enough while its grains move."""
    _, bodies, grains, again, _ = scene
    grains, generator = grains._replace(position=grains.position.copy()), np.random.Generator(np.random.Philox(6))
    pairs, work = pairs_of(again.i, again.j), surface_work(bodies, len(again.i))
    kept = 0
    for step in range(6):
        pairs.bound[:], rows = -1e9, rows_of(2000)
        before = work.arrays.pose[:, 0].copy()
        m = find_surface_contacts(Search(grains, pairs, 0.02, 1e-3), work, rows, 0)
        kept += int((work.arrays.pose[:, 0] == before).all(axis=1).sum())
        fresh = pairs_of(again.i, again.j)
        other, same = look(grains, bodies, fresh, margin=0.02, rest=1e-3)
        assert m == same > 50
        np.testing.assert_array_equal(rows.row[:m], other.row[:m])
        np.testing.assert_array_equal(pairs.count, fresh.count)
        grains.position[:] += generator.normal(size=grains.position.shape) * (2e-3 if step < 4 else 2e-2)
    assert kept > 100


def spread_twin(candidate, most, reach, spacing):
    """Return the places and gaps of the candidates that are kept, by sorting."""
    left = candidate[candidate[:, 6] < reach]
    left = left[np.argsort(left[:, 6] - 1e-12 * (left[:, :3] ** 2).sum(axis=1), kind="stable")]
    kept = []
    while len(left) and len(kept) < most:
        best = left[0]
        kept.append(best)
        near = np.linalg.norm(left[:, :3] - best[:3], axis=1) < spacing
        left = left[1:][~(near & (left[:, 3:6] @ best[3:6] > 0.7))[1:]]
    return np.array(kept)


@pytest.mark.parametrize("many", [0, 1, 5, 60])
def test_the_deepest_points_apart_from_each_other_are_kept(many):
    generator = np.random.Generator(np.random.Philox(many))
    candidate = np.zeros((80, 8))
    candidate[:, :3] = 0.3 * generator.random((80, 3))
    candidate[:, 3:6] = normalized(np.column_stack([generator.normal(size=(80, 3)), np.zeros(80)]))[:, :3]
    # some gaps are the same: the outer one of these counts
    candidate[:, 6] = np.round(0.03 * generator.random(80), 3)
    twin = spread_twin(candidate[:many], MOST, 0.02, 0.1)
    rows, pair = rows_of(20), Pair(3, 7, (1.0, 2.0, 3.0), 0, 0, 0.02, 1e-3)
    m = write_spread(rows, 2, pair, candidate, many, MOST, 0.1)
    assert m == 2 + len(twin)
    if len(twin):
        np.testing.assert_array_equal(rows.row[2:m, 3:6], twin[:, :3])
        np.testing.assert_array_equal(rows.row[2:m, :3], twin[:, 3:6])
        np.testing.assert_array_equal(rows.row[2:m, GAP], twin[:, 6] - 1e-3)
    if many == 60:
        assert m == 2 + MOST
        assert write_spread(rows_of(4), 2, pair, candidate, many, MOST, 0.1) == -1


def test_a_turned_bed_has_turned_contacts(scene):
    _, bodies, grains, again, _ = scene
    turn = rotation_matrices(normalized(np.array([[0.3, -0.5, 0.7, 0.2]])))[0]
    turned = grains._replace(
        position=np.ascontiguousarray(grains.position @ turn.T), matrix=np.ascontiguousarray(turn @ grains.matrix)
    )
    one, other = pairs_of(again.i, again.j), pairs_of(again.i, again.j)
    rows, m = look(grains, bodies, one)
    there, same = look(turned, bodies, other)
    assert m == same
    np.testing.assert_allclose(there.row[:m, :3], rows.row[:m, :3] @ turn.T, atol=1e-6)
    np.testing.assert_allclose(there.row[:m, GAP], rows.row[:m, GAP], atol=1e-6)


def test_impulses_are_taken_over_and_nothing_is_lost_when_rows_are_full(scene):
    _, bodies, grains, again, _ = scene
    pairs = pairs_of(again.i, again.j)
    rows, m = look(grains, bodies, pairs)
    rows.row[:m, PUSH] = 1.0 + np.arange(m)
    first, count = pairs.first.copy(), pairs.count.copy()
    work = surface_work(bodies, len(pairs.i))
    short, long = rows_of(m - 1), rows_of(m)
    for room in (short, long):
        full = room._replace(old=rows.row)
        # as the bed does where it makes room: no old row is taken
        full.old[:, 14] = 0.0
        pairs.first[:], pairs.count[:] = first, count
        pairs.bound[:] = -1e9
        end = find_surface_contacts(Search(grains, pairs, 0.04, 0.0), work, full, 0)
        assert end == (m if room is long else -1)
    np.testing.assert_array_equal(pairs.first[count > 0], first[count > 0])
    np.testing.assert_array_equal(pairs.count, count)
    np.testing.assert_allclose(long.row[:m, PUSH], rows.row[:m, PUSH])


def test_other_solids_have_contacts_with_meshes():
    rock = vg.make_shape("solid_union", seed=0)
    others = [
        vg.make_shape("sphere"),
        vg.make_shape("ellipsoid", aspect=(1.4, 1.0, 0.8)),
        vg.make_shape("box", lengths=(1.0, 0.8, 0.7)),
        vg.make_shape("cylinder"),
    ]
    shapes = [rock, *others]
    bodies = surface_bodies(shapes)
    turns = normalized(np.random.Generator(np.random.Philox(2)).normal(size=(8, 4)))
    place = np.zeros((8, 3))
    place[:, 0] = np.repeat(10.0 * np.arange(4), 2)
    place[1::2, 2] = 2.0
    grains = grains_of(shapes, [0, 1, 0, 2, 0, 3, 0, 4], place, turns)
    pairs = pairs_of([0, 2, 4, 6], [1, 3, 5, 7])
    low, high = np.full(4, 0.0), np.full(4, 2.0)
    # the height of first contact to 5e-4 by bisection, against the points of each surface in the other
    for _ in range(12):
        middle = (low + high) / 2
        grains.position[1::2, 2] = middle
        pairs.bound[:] = -1e9
        look(grains, bodies, pairs)
        high, low = np.where(pairs.bound > 0, middle, high), np.where(pairs.bound > 0, low, middle)
    # edges may touch each other between their ends
    dense = [np.concatenate([shape.vertices, vg.sample_surface(shape, spacing=0.06)]) for shape in shapes]
    for p in range(4):
        one, other = shapes[0], shapes[p + 1]
        offset = grains.position[2 * p + 1] - grains.position[2 * p]
        mine = dense[0] @ grains.matrix[2 * p].T - offset
        theirs = dense[p + 1] @ grains.matrix[2 * p + 1].T + offset
        gap = min(
            other.signed_distance(mine @ grains.matrix[2 * p + 1]).min(),
            one.signed_distance(theirs @ grains.matrix[2 * p]).min(),
        )
        assert abs(gap) < 0.02


@pytest.mark.parametrize("gap", [1e-3, 0.02])
@pytest.mark.parametrize("place", [(0.0, 0.0, 1.0), (0.0, 0.8, 0.6), (0.6, 0.64, 0.48)], ids=["face", "edge", "corner"])
def test_spheres_whose_centers_lie_beyond_the_grid_have_their_gap(place, gap):
    """Beside faces, edges and corners; the way to the grid and from there to the surface is no straight one."""
    cube = vg.shapes.box(lengths=(1.0, 1.0, 1.0))
    shapes = [vg.Shape.from_mesh(cube.vertices, cube.faces), vg.shapes.sphere(diameter=1.0)]
    turns = normalized(np.random.Generator(np.random.Philox(4)).normal(size=(2, 4)))
    corner = 0.5 * np.sign(place)
    center = rotation_matrices(turns[:1])[0] @ (corner + (0.5 + gap) * np.array(place))
    grains = grains_of(shapes, [0, 1], np.stack([np.zeros(3), center]), turns)
    pairs = pairs_of([0], [1])
    rows, m = look(grains, surface_bodies(shapes), pairs, margin=0.1)
    assert m == 1
    assert rows.row[0, GAP] == pytest.approx(gap, abs=5e-3)
    assert pairs.bound[0] <= gap


def test_long_edges_of_round_sides_have_points():
    cone = vg.make_shape("cone", radius=0.2, height=2.0)
    points = surface_points(cone.vertices, cone.faces, 0.07)
    # on the whole height, although neighbouring facets of the side differ by four degrees only
    assert np.diff(np.sort(points[:, 2])).max() < 0.1


@pytest.mark.parametrize("family", ["box", "cylinder", "platonic"])
def test_flat_faces_have_points_apart(family):
    solid, spacing = vg.make_shape(family), 0.07
    points = surface_points(solid.vertices, solid.faces, spacing)
    weights = np.random.Generator(np.random.Philox(1)).dirichlet(np.ones(3), size=(len(solid.faces), 40))
    places = np.einsum("fkc,fcx->fkx", weights, solid.vertices[solid.faces]).reshape(-1, 3)
    assert cKDTree(points).query(places)[0].max() < 4 * spacing
    # an edge within a plane needs no more than the plane, while round sides have long edges
    assert len(points) < (1.0 if family == "cylinder" else 0.5) * solid.surface_area / spacing**2
    for factor in (2.0**-40, 2.0**40):
        scaled = surface_points(factor * solid.vertices, solid.faces, factor * spacing)
        np.testing.assert_allclose(scaled, factor * points, rtol=1e-12)


@pytest.mark.parametrize("seed", [slow(3), 5])
def test_flat_faces_on_each_other_do_not_sink_in(seed):
    # two cylinders of which one is wide: stacked coins, which have edges at their rims only
    coins = vg.make_shape("solid_union", kinds=["cylinder"], solids=2, seed=3)
    bed = vg.pack(coins, vg.Box((6, 6, 6)), method="gravity", count=60, seed=seed)
    assert vg.verify(bed).ok
    assert bed.stop_reason == "settled"


def test_spikes_that_cross_far_from_their_tips_are_parted():
    spiky = vg.make_shape("solid_union", seed=1, kinds=["cone"])
    bed = vg.pack(spiky, vg.Box((4, 4, 9), periodic="xy"), method="gravity", count=30, seed=1)
    assert vg.verify(bed).ok
    assert bed.stop_reason == "settled"


def test_points_lie_on_the_surface_and_flat_shapes_are_refused():
    rock = vg.make_shape("solid_union", seed=1)
    points = surface_points(rock.vertices, rock.faces, 0.07)
    assert np.abs(rock.signed_distance(points)).max() < 1e-9
    with pytest.raises(InputError, match="flat"):
        surface_bodies([vg.make_shape("disk")])
