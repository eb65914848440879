"""Contacts that are carried along with small motions: gaps to first order, and none found again without need."""

import numpy as np
import pytest

import voxgran as vg
from voxgran.contacts.manifolds.rows import ARM_I, ARM_J, NORMAL, PUSH
from voxgran.geometry.rotation import normalized
from voxgran.packing.settling_run import normalized_assembly
from voxgran.settling.bed import Bed
from voxgran.settling.parting import part_grains

DOWN = np.array([0.0, 0.0, -1.0])
MARGIN, REST = 5e-3, 5e-4


@pytest.fixture(scope="module")
def assembly():
    rocks = [vg.make_shape("solid_union", seed=seed) for seed in (1, 2)]
    loose = vg.pack(rocks, vg.Box((3, 3, 6), periodic="xy"), "gravity", count=25, rest=0.01)
    return normalized_assembly(loose)[0]


def moved_bed(assembly, far, *, reuse):
    """Return a bed after a random motion of the grains by about a distance, with its contacts found again."""
    bed, generator = Bed(assembly, DOWN, exact=True), np.random.Generator(np.random.Philox(3))
    bed.find(MARGIN, REST)
    bed.move(far * generator.normal(size=(bed.count + 1, 6)), 1.0, carry=True)
    bed.find(MARGIN, REST, reuse=reuse)
    return bed


def least_gaps(bed):
    """Return the least gaps of the pairs that have contacts, by pair."""
    many = np.flatnonzero(bed.pairs.count)
    return {(bed.pairs.i[p], bed.pairs.j[p]): bed.gap[bed.pairs.first[p] :][: bed.pairs.count[p]].min() for p in many}


@pytest.mark.slow
def test_ways_of_pairs_bound_how_far_surfaces_move_relative_to_each_other(assembly):
    bed, generator = Bed(assembly, DOWN, exact=True), np.random.Generator(np.random.Philox(4))
    bed.find(MARGIN, REST)
    grains, (i, j) = bed.grains, (bed.pairs.i, bed.pairs.j)
    directions = normalized(generator.normal(size=(20, 3)))
    swapped = grains.radius[j] > grains.radius[i]
    one, other, sign = np.where(swapped, j, i), np.where(swapped, i, j), np.where(swapped, -1.0, 1.0)[:, None]

    def surface():
        """Points of the smaller bounding sphere of each pair in the frame of the other, (pairs, points, 3)."""
        points = np.einsum("pab,kb->pka", grains.matrix[other], directions) * grains.radius[other, None, None]
        points += (sign * (grains.position[j] + bed.pairs.shift - grains.position[i]))[:, None]
        return np.einsum("pab,pka->pkb", grains.matrix[one], points)

    for far in (1e-3, 2e-2):
        motion, common = far * generator.normal(size=(2, bed.count + 1, 6))
        motion[:, :3] += common[0, :3]
        for part, ratio in ((motion, 0.95), (np.tile(common[0] * [1, 1, 1, 0, 0, 0], (len(motion), 1)), 0.0)):
            before, gone = surface(), (grains.way[i] + grains.way[j] - bed.pairs.way).copy()
            absolute = grains.way[i] + grains.way[j]
            bed.move(part, 1.0)
            gone = grains.way[i] + grains.way[j] - bed.pairs.way - gone
            moved = np.linalg.norm(surface() - before, axis=2).max(axis=1)
            absolute = grains.way[i] + grains.way[j] - absolute
            # distances change by no more than the ways of both grains either
            assert (gone >= np.minimum(moved, absolute) - 1e-12).all()
            assert gone.sum() <= ratio * absolute.sum() + 1e-9


@pytest.mark.parametrize("seed", range(3))
def test_forces_stay_at_their_points_where_more_of_them_or_fewer_are_found(seed):
    tablet = vg.shapes.superquadric(e1=0.6, e2=1.0, aspect=(1, 1, 0.5), tolerance=0.01)
    bed = Bed(vg.pack(tablet, vg.Box((2.2, 2.2, 2.2)), "expand", count=9, seed=seed), DOWN)
    for wide, narrow in ((0.1, 0.05), (0.05, 0.1)):
        bed.find(wide, 0.0)
        bed.keep_forces(bed.rows.row[: bed.m, NORMAL : NORMAL + 3] * (np.arange(bed.m) % 4 == 0)[:, None])
        before = [bed.rows.row[: bed.m].copy(), bed.rows.i[: bed.m].copy(), bed.rows.j[: bed.m].copy()]
        bed.find(narrow, 0.0)
        row, same = bed.rows.row[: bed.m], 0
        for own, i, j in zip(*before, strict=True):
            near = np.abs(row[:, NORMAL:ARM_J] - own[NORMAL:ARM_J]).max(axis=1) < 1e-12
            at = np.flatnonzero(near & (bed.rows.i[: bed.m] == i) & (bed.rows.j[: bed.m] == j))
            assert own[PUSH] == 0.0 or (row[at, PUSH] == own[PUSH]).all()
            same += len(at)
        assert same > bed.m / 4


@pytest.mark.slow
def test_carried_gaps_are_those_of_a_search_to_first_order(assembly):
    worst = []
    for far in (1e-4, 5e-5, 2.5e-5):
        kept, found = (least_gaps(moved_bed(assembly, far, reuse=reuse)) for reuse in (1.0, 0.0))
        common = kept.keys() & found.keys()
        assert len(common) > 40
        errors = np.array([abs(kept[pair] - found[pair]) for pair in common])
        # most pairs keep the features that are nearest
        worst.append(np.percentile(errors, 75))
        assert worst[-1] < 50 * far**2
    assert worst[0] / worst[2] > 8


def test_arms_turn_with_their_grains(assembly):
    bed = Bed(assembly, DOWN, exact=True)
    bed.find(MARGIN, REST)
    motion = np.zeros((bed.count + 1, 6))
    motion[:, 5] = 1e-4
    before = bed.rows.row[: bed.m].copy()
    bed.move(motion, 1.0, carry=True)
    inner = (bed.rows.j[: bed.m] >= 0) & (bed.rows.j[: bed.m] < bed.count)
    for arm in (ARM_I, ARM_J):
        at = before[inner, arm : arm + 3]
        turned = np.column_stack([-at[:, 1], at[:, 0], np.zeros(len(at))]) * 1e-4
        np.testing.assert_allclose(bed.rows.row[: bed.m][inner, arm : arm + 3], at + turned, atol=1e-15)
    np.testing.assert_array_equal(bed.rows.row[: bed.m][~inner], before[~inner])


def test_contacts_are_found_again_where_they_were_not_carried_or_are_others(assembly):
    """After a motion without carrying, and for another margin: the same gaps as those of a new bed."""
    far = 1e-4 * np.random.Generator(np.random.Philox(4)).normal(size=(assembly.count + 1, 6))
    for carry, margin in ((False, MARGIN), (True, 2e-3)):
        bed = Bed(assembly, DOWN, exact=True)
        bed.find(MARGIN, REST)
        bed.move(far, 1.0, carry=carry)
        bed.find(margin, REST, reuse=1.0)
        other = Bed(bed.moved_assembly(), DOWN, exact=True)
        other.find(margin, REST)
        np.testing.assert_allclose(np.sort(bed.gap), np.sort(other.gap), atol=1e-12)


def test_no_point_moves_farther_than_told(assembly):
    bed = Bed(assembly, DOWN, exact=True)
    bed.find(MARGIN, REST)
    before = bed.grains.way.copy()
    bed.move(np.full((bed.count + 1, 6), 0.5), 1e-3, carry=True)
    assert (bed.grains.way - before <= 2e-3 * (1 + 1e-12)).all()
    assert np.abs(bed.gap).max() < MARGIN + 5e-3


def test_what_is_kept_is_all_rows_with_their_impulses(assembly):
    bed = Bed(assembly, DOWN, exact=True)
    bed.find(MARGIN, REST)
    bed.rows.row[: bed.m, 10] = 1.0 + np.arange(bed.m)
    before, pairs = bed.rows.row[: bed.m, :14].copy(), (bed.rows.i[: bed.m].copy(), bed.rows.j[: bed.m].copy())
    bed.move(np.zeros((bed.count + 1, 6)), 1.0, carry=True)
    bed.find(MARGIN, REST, reuse=1e-4)
    # rotation matrices are made again from quaternions that are normalized again
    np.testing.assert_allclose(bed.rows.row[: bed.m, :14], before, rtol=0, atol=1e-14)
    np.testing.assert_array_equal(np.array([bed.rows.i[: bed.m], bed.rows.j[: bed.m]]), np.array(pairs))


@pytest.mark.parametrize("apart", [0.02, 0.1, 0.2])
@pytest.mark.parametrize("seed", [1, 3])
def test_two_meshes_that_cross_each_other_deeply_are_parted(seed, apart):
    rock = vg.make_shape("solid_union", seed=seed)
    place = 3.0 * rock.diameter
    position = [(place, place, place), (place, place, place + apart * rock.diameter)]
    half = np.sqrt(0.5)
    crossed = vg.Packing.of(
        rock, vg.Box((2 * place,) * 3), position=position, orientation=[(1.0, 0, 0, 0), (half, 0, 0, half)]
    )
    bed = Bed(normalized_assembly(crossed)[0], DOWN)
    bed.find(0.0, 0.0)
    assert bed.gap.min() < -0.12
    # the contacts of the pair push both apart along the line of their centres
    line = bed.grains.position[1] - bed.grains.position[0]
    assert (bed.rows.row[: bed.m, :3] @ line).min() > 0.99 * np.linalg.norm(line)
    assert part_grains(bed, 1e-3, 60) > 0.0
    bed.find(0.1, 0.0)
    assert 0.0 < bed.gap.min() < 3e-3


def test_grains_are_parted_as_far_as_contacts_that_are_found_anew_say(assembly):
    """Contacts of triangles that hardly move are carried along while others are parted."""
    bed, generator = Bed(assembly, DOWN, exact=True), np.random.Generator(np.random.Philox(5))
    bed.move(3e-3 * generator.normal(size=(bed.count + 1, 6)), 1.0)
    before = bed.copy()
    before.find(MARGIN, 0.0)
    assert before.gap.min() < -1e-4
    smallest = part_grains(bed, 1e-4, 40, most=5e-4, margin=MARGIN)
    bed.finders.forget()
    bed.find(MARGIN, 0.0)
    assert 8e-5 < smallest < 1e-4
    assert abs(bed.gap.min() - smallest) < 1e-6


def test_what_is_known_of_pairs_follows_them_to_a_new_list(assembly):
    """Lists of triangles stay as they were made where grains hardly move, and no contact is missed."""
    bed, generator = Bed(assembly, DOWN, exact=True), np.random.Generator(np.random.Philox(3))
    here, many, before = bed.grains.position.copy(), np.flatnonzero(np.arange(bed.count) % 3), {}
    # a few pairs are listed, then more than there was room for, then all but those of one grain
    for away, known in ((many, 0), (many[:0], 10), (many[:1], 80)):
        fresh = Bed(assembly, DOWN, exact=True)
        bed.grains.position[:] = here + 1e-4 * generator.normal(size=here.shape)
        bed.grains.position[away, 2] += 100.0 * (1 + np.arange(len(away)))
        fresh.grains.position[:], bed.listed = bed.grains.position, False
        for one in (bed, fresh):
            one.find(MARGIN, REST)
        np.testing.assert_allclose(bed.rows.row[: bed.m], fresh.rows.row[: fresh.m], rtol=0, atol=1e-12)
        work = bed.finders._surface_work.arrays
        some = work.key[:, 1, 2] >= 0
        held = dict(zip(map(tuple, work.key[some, 1, :2].tolist()), work.pose[some, 1, :12].tolist(), strict=True))
        both = held.keys() & before.keys()
        assert len(both) >= known
        assert sum(before[pair] == held[pair] for pair in both) >= 0.8 * len(both)
        before = held


def touching(bed, sides, margin):
    """Return the pairs (k, 2) of spheres nearer than a margin, in a box that is periodic across z, by all pairs."""
    i, j = np.triu_indices(bed.count, 1)
    away = bed.grains.position[j] - bed.grains.position[i]
    away[:, :2] -= np.round(away[:, :2] / sides) * sides
    near = np.linalg.norm(away, axis=1) - bed.grains.radius[i] - bed.grains.radius[j] < margin
    return np.column_stack([i, j])[near]


def test_spheres_are_listed_by_how_far_they_are_from_where_they_were():
    """Rolling and ways back count nothing, growth does; no contact is missed."""
    generator, box, n = np.random.Generator(np.random.Philox(6)), vg.Box((5, 5, 9), periodic="xy"), 150
    place = generator.random((n, 3)) * [5.0, 5.0, 7.0] + [0.0, 0.0, 1.0]
    spheres = vg.Packing.of(vg.shapes.sphere(), box, position=place)
    bed, listed, margin = Bed(normalized_assembly(spheres)[0], DOWN), [], 0.1
    bed.resize(np.full(n, 0.5))
    bed.find(margin, 0.0)
    assert [len(known) for known in bed.pairs[5:]] == [0] * 5
    rolls = np.zeros((n + 1, 6))
    rolls[:, 3:] = 1.0
    there = np.where(np.arange(6) == 0, 0.15, 0.0) * np.ones((n + 1, 1))
    for motion in (rolls, rolls, rolls, there, -there, there, -there, there, -there):
        before = bed.pairs
        bed.move(motion, 1.0)
        bed.find(margin, 0.0)
        assert bed.pairs is before
    for k in range(40):
        before = bed.pairs
        motion = (0.04 if k >= 10 else 0.0) * generator.normal(size=(n + 1, 6))
        bed.resize(np.full(n, min(0.5 + 0.06 * (k + 1), 1.0)))
        if k == 30:
            bed.restore(bed.arrays)
        bed.move(motion, 1.0)
        bed.find(margin, 0.0)
        inner = bed.rows.j[: bed.m] >= 0
        found = np.column_stack([bed.rows.i[: bed.m], bed.rows.j[: bed.m]])[inner]
        np.testing.assert_array_equal(found, touching(bed, 5.0, margin))
        listed.append(bed.pairs is not before)
    assert 5 < sum(listed) < 35


def test_a_copy_moves_alone_and_leaves_the_next_step_as_it_was(assembly):
    """A bed of which a copy has moved and has found contacts goes on with the same bits."""
    beds = [Bed(assembly, DOWN, exact=True) for _ in range(2)]
    for bed in beds:
        bed.find(MARGIN, REST)
        bed.rows.row[: bed.m, 10] = 1.0 + np.arange(bed.m)
    made = beds[0].copy()
    for _ in range(3):
        made.move(np.full((made.count + 1, 6), 1e-3), 1.0)
        made.find(MARGIN, REST)
    for bed in beds:
        bed.finders.forget()
        bed.move(np.full((bed.count + 1, 6), -1e-3), 1.0)
        bed.find(MARGIN, REST)
    for name, array in beds[0].arrays.items():
        np.testing.assert_array_equal(array, beds[1].arrays[name], err_msg=name)


@pytest.mark.parametrize("other", ["box", "torus"])
def test_spheres_may_arrive_before_grains_of_other_shapes(other):
    """What searches remember of pairs is handed on from a list of spheres to one with another grain."""
    shapes, box = (vg.shapes.sphere(), vg.make_shape(other)), vg.Box((5, 5, 9), periodic="xy")
    place = np.array([[1.0, 1.0, 1.0], [2.1, 1.0, 1.0], [1.0, 2.1, 1.0], [2.1, 2.1, 1.0]])
    mixed = vg.Packing.of(shapes, box, position=place, shape_id=[0, 0, 0, 1])
    unit = normalized_assembly(mixed)[0]
    coming, whole = Bed(unit, DOWN, held=2), Bed(unit, DOWN)
    for bed in (coming, coming, whole):
        while bed is coming and bed.count < unit.count:
            bed.find(0.3, 0.0)
            bed.move(np.full((bed.count + 1, 6), 1e-3), 1.0)
            bed.admit(unit.position[bed.count : bed.count + 1], np.zeros(3))
        bed.find(0.3, 0.0)
        bed.put(unit.position[bed.order], unit.orientation[bed.order], np.inf)
        bed.find(0.3, 0.0)
    assert len({len(known) for known in coming.pairs}) == 1
    found = [zip(*bed.contact_grains(wall=-1, lid=-2), strict=True) for bed in (coming, whole)]
    pairs, asked = ({tuple(sorted(pair)) for pair in rows} for rows in found)
    assert pairs == asked
    assert len(pairs) >= 4
