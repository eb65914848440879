"""The end of settling: the best bed that was examined is remembered and replaces one that is worse."""

from dataclasses import replace

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran.packing.settling_run import normalized_assembly
from voxgran.settling.bed import Bed
from voxgran.settling.fall import let_fall
from voxgran.settling.parameters import Settling
from voxgran.settling.parting import part_grains
from voxgran.settling.progress import AGAIN, ENDED, FALL, STILL
from voxgran.settling.quasi_static import FRICTIONAL, GRIDS, TRIANGLES
from voxgran.settling.stages import ROOM_ROUNDS, Settler

DOWN = np.array([0.0, 0.0, -1.0])


@pytest.fixture(scope="module")
def resting():
    """Return 40 spheres of which a further step moves none."""
    bed = vg.pack(vg.make_shape("sphere"), vg.Box((3, 3, 12), periodic="xy"), "gravity", count=40, seed=1)
    assert bed.stop_reason == "settled"
    return normalized_assembly(bed)[0]


def examined(assembly):
    """Return a settler after an examination of a bed that rests, and its position."""
    settler = Settler(assembly, Settling(), DOWN)
    settler.progress.stage = STILL
    settler._examine(3000)
    return settler, settler.bed.grains.position.copy()


@pytest.mark.parametrize("rise", [-0.05, 0.05], ids=["overlaps", "floats"])
def test_a_bed_that_became_worse_ends_as_the_best_one(resting, rise):
    settler, position = examined(resting)
    assert settler.progress.best < 0.05
    # three of the highest grains, more than may move in a bed at rest
    motion = np.zeros((settler.bed.count + 1, 6))
    motion[-4:-1, 2] = rise
    settler.bed.move(motion, 1.0)
    settler._end()
    np.testing.assert_array_equal(settler.bed.grains.position, position)
    assert settler.progress.stage == ENDED
    assert settler.progress.proven
    assert settler.progress.smallest >= 0.0
    assert not settler.progress.best_position.size


@pytest.mark.parametrize(("shape", "small", "time"), [("sphere", 1, 0.0625), ("sphere", None, 0.05), ("box", 1, 0.05)])
def test_single_spheres_that_have_grown_fall_in_longer_steps(shape, small, time):
    """One grain falls by t^2 / 2 within two steps, and an eighth more by its eight substeps."""
    high = vg.pack(vg.make_shape(shape), vg.Box((3, 3, 9)), "rsa", count=1, seed=1)
    high = replace(high, position=np.array([[1.5, 1.5, 7.0]]))
    settler = Settler(normalized_assembly(high)[0], Settling(), DOWN, small=None if small is None else np.ones(1))
    settler.progress.stage = FALL
    settler.step()
    settler.step()
    fallen = 7.0 / high.median_diameter - settler.bed.grains.position[0, 2]
    assert fallen == pytest.approx(0.5 * (2 * time) ** 2 * (1 + 1 / 8), rel=1e-9)


def test_a_bed_that_rests_stays_where_it_is(resting):
    settler, _ = examined(resting)
    settler.progress.best_position = settler.progress.best_position + 1.0
    before = settler.bed.grains.position.copy()
    settler._end()
    np.testing.assert_array_equal(settler.bed.grains.position, before)


def test_beds_that_overlap_are_not_remembered(resting):
    settler = Settler(resting, Settling(), DOWN)
    settler.progress.stage = STILL
    settler.bed.move(np.tile([0, 0, -0.1, 0, 0, 0.0], (settler.bed.count + 1, 1)), 1.0)
    settler._examine(300)
    assert settler.progress.smallest < 0.0
    assert not settler.progress.best_position.size


@pytest.mark.slow
def test_meshes_go_on_with_the_same_bits():
    """Contacts that are carried along, and what is remembered of pairs, are in a checkpoint or do not change bits."""
    rocks = [vg.make_shape("solid_union", seed=seed) for seed in (1, 2)]
    loose = vg.pack(rocks, vg.Box((3, 3, 6), periodic="xy"), "gravity", count=12, rest=0.01)
    assembly = normalized_assembly(loose)[0]
    # less friction than that of the bed, so that grains move
    how = Settling(friction=0.05)
    settler = Settler(assembly, how, DOWN)
    settler.progress.stage, settler.progress.exact, settler.progress.length = STILL, 1, 0.05
    settler.bed.finders.exact = True
    for _ in range(6):
        settler.step()
    again = Settler(assembly, how, DOWN)
    again.restore({name: np.array(array) for name, array in settler.arrays.items()}, settler.counters)
    for _ in range(9):
        settler.step()
        again.step()
        np.testing.assert_array_equal(again.bed.grains.position, settler.bed.grains.position)
        # an examination, also one that fails, leaves the contacts of the bed as they are
        assert settler.ended or settler.bed.carried[0] == TRIANGLES.margin
    assert np.isfinite(settler.bed.carried).all()
    # bounds of the gaps of pairs beyond the margin may differ
    for name in ("position", "orientation", "row", "row_i", "row_j", "pair_first", "pair_count", "pair_way"):
        np.testing.assert_array_equal(again.arrays[name], settler.arrays[name])


def test_rocks_have_sunk_by_what_grids_miss_when_exact_contacts_are_found_first():
    rocks = [vg.make_shape("solid_union", seed=seed) for seed in (1, 2)]
    loose = vg.pack(rocks, vg.Box((3, 3, 6), periodic="xy"), "gravity", count=12, rest=0.01)
    settler = Settler(normalized_assembly(loose)[0], Settling(), DOWN)
    progress, bed = settler.progress, settler.bed
    progress.stage, progress.length, bed.finders.exact = STILL, GRIDS.first, False
    while not progress.exact:
        settler.step()
    assert progress.roomed == ROOM_ROUNDS
    bed.find(0.01, 0.0)
    touching = np.flatnonzero(bed.pairs.count)
    gaps = [bed.gap[bed.pairs.first[p] :][: bed.pairs.count[p]].min() for p in touching]
    assert np.median(gaps) < 2e-3


@pytest.mark.slow
def test_a_small_bed_that_is_wedged_comes_free():
    """Squares grow in the neck of a funnel and jam across it: forces that gravity does not need hold them there."""
    neck = vg.Polygon([(2, 0), (3, 0), (3, 1), (5, 2.5), (5, 5), (0, 5), (0, 2.5), (2, 1)])
    square = vg.make_shape("polygon", corners=4)
    bed = vg.pack(square, neck, "gravity", sizes=vg.sizes.fixed(0.4), seed=5)
    assert bed.stop_reason == "settled"
    assert bed.verify().ok


def test_a_bed_that_moves_a_little_is_known_to_rest(resting):
    """A copy is examined while some grains move; where it does not rest, the bed keeps its places and its forces."""
    settler, _ = examined(resting)
    progress, bed, preset = settler.progress, settler.bed, settler._preset
    bed.find(0.1, 5e-4)
    before = {name: np.array(array) for name, array in bed.arrays.items()}
    progress.moved = 0.2
    assert settler._rests_as_copy(preset)
    assert settler.bed is not bed
    for name, array in before.items():
        np.testing.assert_array_equal(bed.arrays[name], array)
    # one grain overlaps: it is parted, and the rest is proven again
    lowered = np.where(np.arange(bed.count + 1)[:, None] == bed.count - 1, [0, 0, -2e-3, 0, 0, 0], 0.0)
    settler.bed = bed
    bed.move(lowered, 1.0)
    assert settler._rests_as_copy(preset)
    assert progress.smallest >= 0.0
    # it floats, farther than contacts are examined: those that bear it are closed
    settler.bed = bed
    bed.move(-1.8 * lowered, 1.0)
    assert settler._rests_as_copy(preset)
    assert progress.moving == 0.0
    bed.find(0.1, 0.0)
    settler.bed.find(0.1, 0.0)
    bears = [b.gap[b.rows.row[: b.m, 10] > 0.0].max() for b in (bed, settler.bed)]
    assert bears[0] > 1e-3 > bears[1]
    # all of them float
    settler.bed = bed
    bed.move(np.tile([0, 0, 0.05, 0, 0, 0.0], (bed.count + 1, 1)), 1.0)
    assert not settler._rests_as_copy(preset)
    assert settler.bed is bed
    assert progress.moving > 0.5


def test_steps_stay_long_while_few_grains_fall():
    """Steps that became shorter at once were 300 for the pentagons and 88 for the spheres: grains still fell freely."""
    pentagons, spheres = vg.make_shape("polygon"), vg.make_shape("sphere")
    flat = vg.pack(pentagons, vg.Rectangle((20, 45), periodic="x"), "gravity", count=300, seed=2)
    graded, box = vg.sizes.lognormal(1.0, 0.3), vg.Box((8, 8, 20), periodic="xy")
    round_ones = [vg.pack(spheres, box, "gravity", count=300, sizes=graded, seed=seed) for seed in (1, 2, 3)]
    assert {bed.stop_reason for bed in (flat, *round_ones)} == {"settled"}
    # all steps: of growth and of the fall about 180 and 137; in all 210 and 170, with standard deviations of 15 and 17
    assert flat.provenance["settling"]["steps"] < 300
    assert np.mean([bed.provenance["settling"]["steps"] for bed in round_ones]) < 210


def test_steps_become_shorter_where_a_bed_does_not_come_to_rest(resting):
    settler, _ = examined(resting)
    progress, preset = settler.progress, FRICTIONAL
    progress.length, progress.still_steps = preset.first, 0
    settler._rest()
    assert progress.moved < 0.03
    assert progress.length == preset.first
    progress.still_steps = preset.late
    settler._rest()
    assert preset.last <= progress.length < preset.first


def test_only_small_beds_fall_once_more(resting):
    """That a bed may do so counts in the bound of its steps."""
    settler, _ = examined(resting)
    assert settler._more_falls == 1
    large = vg.pack(vg.make_shape("sphere"), vg.Box((12, 12, 12), periodic="xy"), "rsa", count=1000)
    assert Settler(normalized_assembly(large)[0], Settling(), DOWN)._more_falls == 0
    top = settler.bed.count - 1
    settler.bed.move(np.where(np.arange(top + 2)[:, None] == top, [0, 0, 0.05, 0, 0, 0], 0.0), 1.0)
    settler.progress.best, settler.progress.still_steps, settler.progress.trials = 1.0, 7, 2
    before = settler.bed.grains.position.copy()
    settler.how = Settling(rest=0.99)
    settler._end()
    assert (settler.progress.stage, settler.progress.falls) == (AGAIN, 1)
    assert (settler.progress.still_steps, settler.progress.trials, settler.progress.substep) == (0, 0, 0.0)
    np.testing.assert_array_equal(settler.bed.grains.position, before)
    # not twice
    settler.progress.stage = STILL
    settler._end()
    assert settler.progress.stage == ENDED


def test_meshes_that_overlap_a_little_are_parted_by_their_triangles_and_those_that_cross_are_not():
    rock = vg.make_shape("solid_union", seed=3)
    bed = vg.pack(rock, vg.Box((3, 3, 8), periodic="xy"), "gravity", count=12)
    settler = Settler(normalized_assembly(bed)[0], Settling(), DOWN)
    progress, grains = settler.progress, settler.bed.grains
    progress.stage, progress.exact, settler.bed.finders.exact = STILL, 1, True
    higher = grains.position[:, 2] > np.median(grains.position[:, 2])
    settler.bed.move(np.where(np.append(higher, False)[:, None], [0, 0, -1e-3, 0, 0, 0], 0.0), 1.0)
    settler._examine(300)
    assert -2e-3 < progress.smallest < 0.0
    assert settler._part()
    settler._examine(300)
    assert progress.smallest >= 0.0
    settler.bed.move(np.where(np.append(higher, False)[:, None], [0, 0, -0.2, 0, 0, 0], 0.0), 1.0)
    assert not settler._part()


@pytest.mark.slow
def test_rocks_that_were_locked_in_each_other_while_they_grew_come_free():
    rock = vg.load_shape(vg.data_file("eros.obj"))
    width = 2.3 * rock.diameter
    bed = vg.pack(rock, vg.Box((width, width, 14 * rock.diameter)), "gravity", count=20)
    assert bed.stop_reason == "settled"
    assert bed.verify().ok
    # contacts by triangles are found in few steps only
    assert bed.provenance["settling"]["steps"] < 700


def test_grains_that_would_fall_without_end_are_refused():
    grains = vg.Packing.of(vg.shapes.sphere(), vg.Box((4, 4, 8)), position=[(1, 1, 1), (2, 2, 5)], scale=[2e-6] * 2)
    with pytest.raises(InputError, match=r"4e\+06 median diameters high along gravity: grains fall through at most"):
        vg.settle(grains, gravity="-z")


def test_a_bed_that_cannot_be_parted_far_is_parted_a_little_and_not_put_back(resting, monkeypatch):
    """Where parting to the usual distance leaves overlaps after the last step, less distance is enough."""
    settler, position = examined(resting)
    least = settler.bed.gap.min()
    settler.bed.resize(np.full(settler.bed.count, 1.0 + 2.0 * least))

    def part(bed, distance, rounds, **more):
        return -1e-5 if distance > 1e-9 else part_grains(bed, distance, rounds, **more)

    monkeypatch.setattr("voxgran.settling.examination.part_grains", part)
    settler.progress.best, settler.progress.best_position = 1.0, np.zeros((0, 3))
    settler.progress.falls = 1
    settler._judge(settler._preset, last=True)
    assert settler.progress.smallest >= 0.0
    assert not np.array_equal(settler.bed.grains.position, position)


@pytest.mark.parametrize("solid", [True, False])
def test_the_few_meshes_that_do_not_rest_fall_between_the_others(solid):
    """A rock far above others, which exact steps would lower by 0.004 diameters each; spheres have no grids."""
    rocks = [vg.make_shape("solid_union", seed=seed) for seed in (1, 2)]
    if not solid:
        rocks.append(vg.shapes.sphere())
    bed = vg.pack(rocks, vg.Box((3, 3, 9), periodic="xy"), "gravity", count=12, rest=0.01)
    settler = Settler(normalized_assembly(bed)[0], Settling(), DOWN)
    bed, residual = settler.bed, np.zeros(12)
    bed.finders.exact = True
    top = int(bed.grains.position[:, 2].argmax())
    bed.grains.position[top, 2] += 1.0
    bed.find(0.01, 0.0)
    before, row, residual[top] = bed.grains.position.copy(), bed.rows.row[: bed.m].copy(), 1.0
    assert let_fall(bed, residual, settler._fall) is bed
    sunk = before - bed.grains.position
    assert not np.delete(sunk, top, axis=0).any()
    # 19 steps of 0.05 at less and less acceleration: as fast as grains may fall, less the start
    assert (0.35 < sunk[top, 2] < 0.55) if solid else not sunk.any()
    # forces stay, and all pairs of the grain are listed and looked at again
    np.testing.assert_array_equal(bed.rows.row[: bed.m], row)
    assert np.isnan(bed.carried).all() or not solid
    bed.find(0.01, 0.0)
    fresh = Bed(bed.moved_assembly(), DOWN, exact=True)
    fresh.find(0.01, 0.0)
    assert np.sort(bed.gap) == pytest.approx(np.sort(fresh.gap), abs=1e-9)
    # where most grains move, they are left to the steps
    here = bed.grains.position.copy()
    let_fall(bed, np.ones(12), settler._fall)
    np.testing.assert_array_equal(bed.grains.position, here)
