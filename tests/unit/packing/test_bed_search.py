"""Beds of a solid fraction that is asked for: met, checked by the measures, said where it is beyond the range, and the
same bits after an interruption."""

import warnings

import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran._base.errors import InputError, PackingWarning
from voxgran.packing import driver as run
from voxgran.packing.draw import Request
from voxgran.packing.driver import Drive, drive
from voxgran.packing.pack import prepare_task
from voxgran.packing.settle import begun
from voxgran.settling.parameters import Settling
from voxgran.testing.packing_methods import bits_of

# beds of few grains, which have no bulk
pytestmark = pytest.mark.filterwarnings("ignore:the bed is expected to be:voxgran.PackingWarning")

SPHERE, DISK = vg.make_shape("sphere"), vg.make_shape("disk")
ANGULAR = vg.make_shape("convex_polyhedron", seed=4, points=12)
BOX, SMALL = vg.Box((5, 5, 12), periodic="xy"), vg.Box((3, 3, 10), periodic="xy")


def sought_of(packing):
    """What was sought and found."""
    return packing.provenance["settling"]["sought"]


def fraction_of(packing, name):
    """A solid fraction of the packing as it is measured."""
    with warnings.catch_warnings(action="ignore"):
        return float(vg.measure(packing, which="density")[name])


def check(bed, target):
    """Check that a bed is at rest at a solid fraction, and that its record says what was done."""
    sought = sought_of(bed)
    assert sought["met"]
    assert sought["solid_fraction"] == target
    assert sought["reached"] == fraction_of(bed, sought["measure"])
    assert abs(sought["reached"] - target) <= 0.002
    assert bed.stop_reason == "settled"
    assert vg.verify(bed).ok
    assert bed.forces.friction == sought["friction"] == bed.provenance["settling"]["parameters"]["friction"]
    # proven again, by that friction
    assert vg.equilibrium(bed, sought["friction"]).attrs["share_at_rest"] >= 0.95


@pytest.mark.parametrize("target", [0.58, slow(0.615)])
def test_spheres_rest_at_a_solid_fraction_of_the_bulk(target):
    bed = vg.pack(SPHERE, BOX, "gravity", count=300, solid_fraction=target, seed=1)
    check(bed, target)
    assert sought_of(bed)["measure"] == "bulk_solid_fraction"
    # the solid fraction says nothing of how many grains there are
    assert bed.count == 300
    assert bed.provenance["missed"]["count"] == 0
    # what was found gives the same bed to the last bit, without a search
    sought = sought_of(bed)
    found = {name: sought[name] for name in ("friction", "shaking")}
    assert bits_of(vg.pack(SPHERE, BOX, "gravity", count=300, seed=1, **found)) == bits_of(bed)


@pytest.mark.slow
def test_true_shapes_rest_at_a_solid_fraction_below_their_surface():
    bed = vg.pack(ANGULAR, SMALL, "gravity", count=50, solid_fraction=0.6, seed=1)
    check(bed, 0.6)
    assert sought_of(bed)["measure"] == "bed_solid_fraction"
    assert sought_of(bed)["friction"] >= 0.05


@pytest.mark.slow
def test_disks_and_a_lid():
    bed = vg.pack(DISK, vg.Rectangle((8, 20)), "gravity", count=90, solid_fraction=0.8, seed=2, lid={"weight": 0.5})
    check(bed, 0.8)
    assert bed.lid is not None


@pytest.mark.slow
def test_less_friction_makes_denser_beds():
    fractions = []
    for friction in (1.0, 0.2, 0.02):
        bed = vg.pack(SPHERE, BOX, "gravity", count=300, friction=friction, seed=3)
        fractions.append(fraction_of(bed, "bulk_solid_fraction"))
    assert fractions[0] + 0.015 < fractions[1] < fractions[2] - 0.015


@pytest.mark.parametrize(("target", "near"), [(0.3, "loosest"), slow(0.74, "densest")])
def test_beyond_the_range_one_sentence_says_what_is_reached(target, near, monkeypatch):
    monkeypatch.setattr("voxgran.settling.search.LASTING", 2.0)
    with pytest.warns(PackingWarning) as found:
        bed = vg.pack(SPHERE, SMALL, "gravity", count=30, solid_fraction=target, seed=1)
    expected, sentence = (str(entry.message) for entry in found)
    assert expected.startswith("the bed is expected to be about")
    sought = sought_of(bed)
    assert not sought["met"]
    assert sought["beyond_range"]
    assert sought["reached"] == sought[near]["reached"] == fraction_of(bed, "bed_solid_fraction")
    loosest, densest = sought["loosest"], sought["densest"]
    assert loosest["friction"] == pytest.approx(1.0)
    assert 0.5 < loosest["reached"] < densest["reached"] < 0.73
    head = f"the solid fraction of the bed is {sought['reached']:.4g} instead of {target:g}: these grains come to rest"
    assert sentence.startswith(f"{head} at {loosest['reached']:.4g} (friction 1) to {densest['reached']:.4g} (friction")
    assert "\n" not in sentence
    assert len(bed) == 30


def test_beds_that_differ_by_chance_say_so(monkeypatch):
    monkeypatch.setattr("voxgran.settling.search.MOST_TRIES", 1)
    with pytest.warns(PackingWarning, match="the nearest of 1 tries, which differ by chance; take more grains"):
        vg.pack(SPHERE, SMALL, "gravity", count=60, solid_fraction=0.592, seed=1)


@pytest.mark.slow
def test_any_packing_settles_to_a_solid_fraction_and_a_walk_does_after_it():
    loose = vg.pack(SPHERE, BOX, "rsa", count=150, seed=2)
    bed = vg.settle(loose, gravity="-z", solid_fraction=0.6)
    check(bed, 0.6)
    sought = sought_of(bed)
    same = vg.settle(loose, gravity="-z", friction=sought["friction"], shaking=sought["shaking"])
    assert bits_of(same) == bits_of(bed)
    walk = {"count": 40, "seed": 2, "voxel_size": 0.2, "sweeps": 20}
    within = vg.pack(SPHERE, SMALL, "digital", **walk, settle={"solid_fraction": 0.59})
    check(within, 0.59)
    after = vg.settle(vg.pack(SPHERE, SMALL, "digital", **walk, settle=False), solid_fraction=0.59, seed=2)
    assert bits_of(within) == bits_of(after)
    assert within.provenance["settling"] == after.provenance["settling"]


@pytest.mark.slow
def test_a_search_goes_on_after_any_step_to_the_same_bits():
    loose = vg.pack(SPHERE, SMALL, "rsa", count=30, seed=2)
    loose = vg.Packing.of(loose.shapes, SMALL, position=loose.position, gravity="-z")
    how = Settling(solid_fraction=0.56, fall_time=5.0)
    whole, parts, steps = begun(loose, how, 0), begun(loose, how, 0), 0
    while not whole.settler.ended:
        whole.settler.step()
    assert 2 <= whole.counters["made"] < 20
    while not parts.settler.ended:
        if steps % 5 == 0:
            arrays, counters = {name: np.array(array) for name, array in parts.arrays.items()}, dict(parts.counters)
            parts = begun(loose, how, 0)
            parts.restore(arrays, counters)
        parts.settler.step()
        steps += 1
    assert steps == whole.steps - whole.settler.progress.step
    assert parts.counters == whole.counters
    assert {name: np.array(array).tobytes() for name, array in parts.arrays.items()} == {
        name: np.array(array).tobytes() for name, array in whole.arrays.items()
    }
    for one, other in zip(parts.settler.bed.poses(), whole.settler.bed.poses(), strict=True):
        assert one.tobytes() == other.tobytes()


def search_task():
    asked = {"count": 40, "solid_fraction": 0.6, "seed": 1, "parameters": {"friction": 0.9}}
    return prepare_task(Request(SPHERE, SMALL, "gravity", **asked))


@pytest.fixture(scope="module")
def whole():
    """A search without interruption: its state at the end, and its bed."""
    task = search_task()
    ended = drive(task.method, task.problem, Drive(chunk=500))
    return ended, task.method.finish(task.problem, ended)


@pytest.mark.parametrize("share", [slow(0.3), slow(0.95), slow(1.0)])
def test_a_checkpoint_in_the_midst_of_the_tries_gives_the_same_bits(share, whole, tmp_path):
    (ended, bed), first, again, path = whole, search_task(), search_task(), tmp_path / "run.voxgran"
    state = first.method.prepare(first.problem)
    while state.done < share * ended.done and not state.stop_reason:
        state = first.method.advance(first.problem, state, 100)
    run._save(first.problem, state, path, run.fingerprint(first.method, first.problem))
    resumed = drive(again.method, again.problem, Drive(path, resume=True, chunk=77))
    same = again.method.finish(again.problem, resumed)
    assert ended.counters["made"] > 2
    assert bits_of(same) == bits_of(bed)
    assert same.forces.force.tobytes() == bed.forces.force.tobytes()
    assert same.provenance["settling"] == bed.provenance["settling"]


def test_an_interrupted_search_says_what_it_has_found():
    bed = vg.pack(SPHERE, SMALL, "gravity", count=40, solid_fraction=0.6, time_limit=0.0)
    assert bed.stop_reason == "interrupted"
    assert len(bed) == 40


def test_as_parameter_of_the_method_it_is_the_same():
    asked = {"count": 30, "seed": 1}
    one = vg.pack(SPHERE, SMALL, "gravity", solid_fraction=0.57, **asked)
    two = vg.pack(SPHERE, SMALL, vg.methods.Gravity(solid_fraction=0.57), **asked)
    assert bits_of(one) == bits_of(two)
    with pytest.raises(InputError, match=r"solid_fraction is 0.6, and that of the parameters of the method is 0.5"):
        vg.pack(SPHERE, SMALL, vg.methods.Gravity(solid_fraction=0.5), solid_fraction=0.6, **asked)


@pytest.mark.parametrize("wrong", [0.0, -1, 1.5, "dense", float("nan")])
def test_what_is_no_solid_fraction_is_refused(wrong):
    with pytest.raises(InputError, match="solid_fraction is "):
        vg.pack(SPHERE, SMALL, "gravity", count=5, solid_fraction=wrong)
    with pytest.raises(InputError, match="solid_fraction"):
        vg.settle(vg.Packing.of([SPHERE], SMALL, position=[(1, 1, 1)], gravity="-z"), solid_fraction=wrong)


def test_no_grains_are_a_bed_of_any_solid_fraction():
    empty = vg.pack(SPHERE, SMALL, "gravity", count=0, solid_fraction=0.6)
    assert not len(empty)
    assert not len(vg.settle(empty, solid_fraction=0.6))


@pytest.mark.parametrize("name", ["plan", slow("run")])
def test_scenes_and_their_plans(name, tmp_path):
    scene = vg.Scene.from_mapping(
        {
            "shape": [{"family": "sphere"}],
            "container": {"kind": "box", "lengths": [3, 3, 10], "periodic": "xy"},
            "packing": {"method": "gravity", "count": 40, "solid_fraction": 0.59, "fall_time": 3.0},
            "output": {"vtk": False, "report": False, "statistics": False},
        }
    )
    assert vg.Scene.from_mapping(scene.to_mapping()).to_mapping() == scene.to_mapping()
    if name == "plan":
        plan = scene.plan()
        assert plan.grains == 40
        assert any(step.startswith("settle them at a solid fraction of 0.59, by friction") for step in plan.computed)
        return
    with warnings.catch_warnings(action="ignore"):
        packing = scene.run(tmp_path / "out").packing
    check(packing, 0.59)
