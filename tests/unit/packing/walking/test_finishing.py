"""What follows the walk: overlaps of centered voxels are parted, and a lid is a wall to grains that settle."""

from dataclasses import replace

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran._base.stopping import Stopped, stopping_when
from voxgran.contacts.assembly import Assembly, Lid
from voxgran.contacts.walls import beyond_lid, escape_depths
from voxgran.packing.walking.finishing import Finishing, end_walk, finish_some
from voxgran.packing.walking.parameters import Settling
from voxgran.packing.walking.state import WalkState
from voxgran.settling.contact_points import near_walls
from voxgran.settling.settle import follow
from voxgran.settling.trial_motion import free_fall

DIGITAL = {"method": "digital", "voxel_size": 1 / 12, "sweeps": 100, "vibration_up": 0.0, "settling": 150, "seed": 2}
CONTROL = {"method": "control_point", "spacing": 0.2, "sweeps": 100, "settling": 60, "seed": 2}
UP = np.array([0.0, 0.0, 1.0])


def top(packing, axis=2):
    """Return how high the grains reach, by their tessellations."""
    return max(packing.world_vertices(grain)[:, axis].max() for grain in range(packing.count))


@pytest.mark.parametrize("name", ["sphere", "cube", "ellipsoid"])
def test_a_lid_is_one_more_wall(name):
    """Reach and nearness at a lid are those at the ceiling of a box that ends there."""
    shape = vg.make_shape("platonic", solid="cube") if name == "cube" else vg.make_shape(name)
    turn = np.array([[0.8, 0.36, 0.48, 0.0], [0.6, 0.0, 0.0, 0.8]])
    tall = Assembly.of(
        [shape], vg.Box((4, 4, 9)), position=[[1.2, 1.2, 2.4], [2.8, 2.8, 2.6]], orientation=turn, scale=[1.0, 1.3]
    )
    lidded, low = replace(tall, lid=Lid(UP, 3.0)), replace(tall, container=vg.Box((4, 4, 3)))
    assert escape_depths(lidded) == pytest.approx(escape_depths(low), abs=1e-15)
    assert beyond_lid(lidded) == pytest.approx(escape_depths(low), abs=1e-15)
    assert (beyond_lid(tall) == -np.inf).all()
    ours, theirs = near_walls(lidded, 0.4), near_walls(low, 0.4)
    assert np.sort(ours.gap) == pytest.approx(np.sort(theirs.gap), abs=1e-15)
    assert len(ours.gap) > len(near_walls(tall, 0.4).gap)


def test_grains_do_not_rise_through_a_lid():
    """Pulled upward, a sphere comes to rest at the lid, from above and from below."""
    for sign in (1.0, -1.0):
        one = Assembly.of([vg.make_shape("sphere")], vg.Box((3, 3, 6)), position=[[1.5, 1.5, 3.0]])
        one = replace(one, lid=Lid(sign * UP, sign * (3.0 + sign * 0.8)))
        for _ in range(30):
            one = follow(one, free_fall(one, sign * 0.02 * UP))[0]
        assert beyond_lid(one)[0] <= 0.0
        assert beyond_lid(one)[0] == pytest.approx(0.0, abs=4e-3)


@pytest.mark.parametrize("gravity", ["-z", "+z", "-x"])
@pytest.mark.parametrize("method", [DIGITAL, CONTROL], ids=["digital", "control_point"])
def test_the_lid_lies_on_the_settled_bed(method, gravity):
    lengths = {"-z": (2.5, 2.5, 6.0), "+z": (2.5, 2.5, 6.0), "-x": (6.0, 2.5, 2.5)}[gravity]
    packing = vg.pack(vg.make_shape("sphere"), vg.Box(lengths), count=14, lid=True, gravity=gravity, **method)
    assert vg.verify(packing).ok
    axis, radius = "xyz".index(gravity[1]), 0.5
    height = lengths[axis] - packing.position[:, axis] if gravity[0] == "+" else packing.position[:, axis]
    reached = lengths[axis] - packing.provenance["lid_lowered"]
    assert reached == pytest.approx(height.max() + radius, abs=1e-9)
    assert packing.provenance["settling"]["density_gain"] > 0


def test_shaken_grains_stay_under_the_lid():
    """Dice that are shaken hard never rise above where the lid was when the walk ended."""
    cube, box = vg.make_shape("platonic", solid="cube"), vg.Box((2.6, 2.6, 8), periodic=(True, True, False))
    options = {**DIGITAL, "count": 16, "lid": True}
    walked = vg.pack(cube, box, **{**options, "settling": 0})
    shaken = vg.pack(cube, box, **options, shaking=30, acceleration=3.0)
    assert vg.verify(shaken).ok
    assert shaken.provenance["lid_lowered"] >= walked.provenance["lid_lowered"]
    assert top(shaken) <= 8 - shaken.provenance["lid_lowered"] + 1e-9


@pytest.mark.parametrize("name", ["sphere", "cube"])
def test_grains_of_centered_voxels_are_parted_before_they_settle(name):
    """Voxels about their centers leave overlaps of up to a voxel, and none after settling."""
    shape = vg.make_shape("sphere") if name == "sphere" else vg.make_shape("platonic", solid=name)
    box = vg.Box((2.6, 2.6, 9), periodic=(True, True, False))
    options = {**DIGITAL, "count": 20, "cover": "center"}
    rough = vg.pack(shape, box, **{**options, "settling": 0})
    assert not vg.verify(rough).ok
    packing = vg.pack(shape, box, **options)
    assert packing.provenance["parting"]["overlapping"] == 0
    assert vg.verify(packing).ok
    touch = vg.pack(shape, box, **{**options, "cover": "touch"})
    assert top(packing) == pytest.approx(top(touch), rel=0.25)


def test_parting_and_lid_go_on_after_a_stop_to_the_same_bits(tmp_path, monkeypatch):
    monkeypatch.setattr("voxgran.packing.driver.FIRST_CHUNK", 1000)
    options = {**DIGITAL, "count": 10, "settling": 8, "shaking": 4, "cover": "center", "lid": True}
    shape, box = vg.make_shape("ellipsoid"), vg.Box((3, 3, 4))
    whole = vg.pack(shape, box, **options)
    path = tmp_path / "run.checkpoint"
    for _ in range(300):
        packing = vg.pack(shape, box, checkpoint=path, resume=True, time_limit=1e-6, **options)
        if packing.stop_reason != "interrupted":
            break
    assert packing.position.tobytes() == whole.position.tobytes()
    assert packing.orientation.tobytes() == whole.orientation.tobytes()
    assert packing.provenance["lid_lowered"] == whole.provenance["lid_lowered"]


def test_control_points_may_be_shaken_too():
    """A bed of spheres is denser after shaking than after settling alone."""
    box = vg.Box((2.6, 2.6, 14), periodic=(True, True, False))
    poured = vg.pack(vg.make_shape("sphere"), box, count=40, friction=0.5, **CONTROL)
    denser = vg.pack(vg.make_shape("sphere"), box, count=40, shaking=60, **CONTROL)
    assert vg.verify(denser).ok
    assert denser.position[:, 2].mean() < poured.position[:, 2].mean()
    with pytest.raises(InputError, match="shaking is 5 and settling 0"):
        vg.pack(vg.make_shape("sphere"), box, method="control_point", count=1, shaking=5)


def test_sweeps_that_are_used_up_are_told():
    box = vg.Box((2.6, 2.6, 14), periodic=(True, True, False))
    short = vg.pack(vg.make_shape("sphere"), box, count=20, **{**DIGITAL, "settling": 3})
    assert short.stop_reason == "steps"
    assert short.provenance["settling"]["sweeps"] == 3
    assert vg.pack(vg.make_shape("sphere"), box, count=20, **{**DIGITAL, "settling": 400}).stop_reason == "settled"


@pytest.mark.parametrize("settles", [False, True])
def test_a_sweep_that_is_given_up_is_not_counted(settles):
    box = vg.Box((3, 3, 4))
    places = np.array([[1, 1, 1.0], [1, 1, 1.9]])
    assembly = Assembly.of((vg.make_shape("sphere"),), box, position=places)
    finishing = Finishing(Settling(settling=9), -UP, 0, parts=not settles, step=0.1)
    state = WalkState(done=50, placed=2, waiting=np.arange(2))
    end_walk(state, finishing, assembly, "settled")
    before = state.done, dict(state.counters), state.arrays["position"].tobytes()
    with stopping_when(lambda: True), pytest.raises(Stopped):
        finish_some(state, finishing, assembly, 90)
    assert (state.done, state.counters, state.arrays["position"].tobytes()) == before
    finish_some(state, finishing, assembly, 90)
    assert state.done == 52
