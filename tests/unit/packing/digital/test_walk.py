"""Digital packing: the walk against a plain program, its rules, and what it refuses."""

import itertools
import signal
import warnings
from functools import partial

import kit
import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import CheckpointError, InputError, Interrupted, PackingWarning, UnknownNameError
from voxgran._base.seeds import philox_key
from voxgran.packing.digital.walk_method import registration as digital
from voxgran.packing.driver import Drive, drive

task_of = partial(kit.task_of, "digital", count=8)


def plain_walk(masks, sites, shape, order, *, key, first, last):
    """Move grains on a label grid, one attempt after the other, without gravity: the method as its paper tells it."""
    steps = np.array([d for d in itertools.product((-1, 0, 1), repeat=3) if any(d)])
    half = masks[0].shape[0] // 2
    voxels = [np.argwhere(mask) - half for mask in masks]
    for attempt in range(first, last):
        generator = np.random.Philox(key=key, counter=[attempt - 1, 0, 0, 0])
        r0, _, r2, _ = generator.random_raw(4)
        slot = len(masks) - 1 - ((int(r0) >> 32) * len(masks) >> 32)
        step = steps[(int(r2) >> 32) * 26 >> 32]
        grain = order[slot]
        moved = sites[grain] + step
        places = voxels[grain] + moved
        if places.min() < 0 or (places >= shape).any():
            continue
        taken = {tuple(p) for other in range(len(masks)) if other != grain for p in voxels[other] + sites[other]}
        if not any(tuple(p) in taken for p in places):
            sites[grain] = moved
    return sites


def test_walk_is_that_of_a_plain_program():
    """Bit for bit the same trajectory: 300 attempts of 6 grains in a tight box without gravity."""
    task = task_of(
        [vg.make_shape("ellipsoid", aspect=(1.2, 1.0, 0.8))],
        vg.Box((3, 3, 3)),
        count=6,
        voxel_size=0.125,
        gravity="none",
        rotation_share=0.0,
        orientations=1,
        sweeps=10_000,
        feed="at_once",
    )
    problem = task.problem
    state = digital.prepare(problem)
    while state.feeding_ended_at is None:
        state = digital.advance(problem, state, 1)
    assert state.counters["placed"] == 6
    setting = state.derived["precomputed"]
    masks = [problem.voxels(g, setting.base[g], setting.lattice.voxel_size, cover="touch") for g in range(6)]
    begin, sites = state.done, state.arrays["site"].copy()
    twin = plain_walk(
        masks,
        sites,
        setting.lattice.shape,
        state.waiting.tolist(),
        key=philox_key(problem.seed, "digital"),
        first=begin,
        last=begin + 300,
    )
    state = digital.advance(problem, state, 300)
    assert state.done == begin + 300
    assert np.array_equal(state.arrays["site"], twin)
    assert 0 < state.counters["moves_accepted"] < state.counters["moves_tried"]
    occupied = setting.canvas.occupied(state.derived["words"])
    assert occupied.sum() == sum(mask.sum() for mask in masks)


def test_true_solids_never_overlap_and_sink():
    shapes = [vg.make_shape("solid_union", seed=3), vg.make_shape("box", lengths=(1.2, 0.9, 0.7))]
    packing = vg.pack(
        shapes,
        vg.Box((4, 4, 6), periodic=(True, True, False)),
        method="digital",
        settle=False,
        count=40,
        seed=2,
        voxel_size=1 / 16,
        sweeps=1500,
        cycles=4,
    )
    assert packing.count == 40
    assert packing.stop_reason == "count"
    assert vg.verify(packing).ok
    assert packing.position[:, 2].mean() < 2.5
    assert packing.provenance["parameters"]["gravity"] == "-z"


@pytest.mark.parametrize(("gravity", "axis", "sign"), [("+z", 2, 1), ("-x", 0, -1), ("+y", 1, 1)])
def test_gravity_points_where_it_is_told(gravity, axis, sign):
    packing = vg.pack(
        vg.make_shape("sphere"),
        vg.Box((5, 5, 5)),
        method="digital",
        settle=False,
        count=12,
        voxel_size=0.125,
        gravity=gravity,
        sweeps=400,
        cycles=1,
        vibration_up=0.0,
    )
    along = (packing.position[:, axis] - 2.5) * sign
    assert along.min() > 0.4
    assert vg.verify(packing).ok


def test_disks_settle_in_two_dimensions():
    packing = vg.pack(
        vg.make_shape("disk"),
        vg.Rectangle((8, 10), periodic=(True, False)),
        method="digital",
        settle=False,
        count=40,
        voxel_size=1 / 24,
        sweeps=3000,
        cycles=6,
    )
    assert packing.count == 40
    assert vg.verify(packing).ok
    assert np.all(packing.position[:, 2] == 0)
    assert packing.position[:, 1].max() < 7.5


def test_lengths_scale_exactly_by_powers_of_two():
    def packed(factor):
        return vg.pack(
            [vg.make_shape("solid_union", seed=1).scaled(factor)],
            vg.Box((4 * factor, 4 * factor, 5 * factor)),
            method="digital",
            settle=False,
            count=15,
            sizes=vg.sizes.lognormal(factor, 0.2),
            voxel_size=factor / 12,
            sweeps=200,
            cycles=1,
        )

    one = packed(1.0)
    for factor in (2.0**20, 2.0**-20):
        other = packed(factor)
        assert (other.position / factor).tobytes() == one.position.tobytes()
        assert other.orientation.tobytes() == one.orientation.tobytes()
    near = packed(1e6)
    assert np.allclose(near.position / 1e6, one.position, rtol=0, atol=1e-9)


def test_too_many_grains_stop_as_full():
    with pytest.warns(PackingWarning, match="of 90 grains were placed"):
        packing = vg.pack(
            vg.make_shape("sphere"),
            vg.Box((4, 4, 4)),
            method="digital",
            settle=False,
            count=90,
            voxel_size=0.125,
            sweeps=100,
        )
    assert packing.stop_reason == "full"
    assert 20 < packing.count < 90
    assert packing.provenance["missed"]["count"] == 90 - packing.count


@pytest.mark.parametrize(
    ("parameters", "error", "words"),
    [
        ({"voxel_sizee": 0.1}, UnknownNameError, "did you mean 'voxel_size'"),
        ({"voxel_size": -0.1}, InputError, "voxel_size is -0.1"),
        ({"gravity": "down"}, InputError, "gravity"),
        ({"downward_share": 0.7, "vibration_up": 0.7}, InputError, r"downward_share \+ vibration_up is 1.4"),
        ({"voxel_size": 9.0}, InputError, "make the voxels smaller"),
        ({"rotation_share": 1.5}, InputError, "rotation_share is 1.5"),
    ],
)
def test_bad_parameters_are_named(parameters, error, words):
    with pytest.raises(error, match=words):
        vg.pack(vg.make_shape("sphere"), vg.Box((4, 4, 4)), method="digital", count=2, **parameters)


def test_gravity_along_a_periodic_axis_is_refused():
    with pytest.raises(InputError, match=r"not set and thus .-z.: .* walled axis"):
        vg.pack(vg.make_shape("sphere"), vg.Box((4, 4, 4), (False, False, True)), method="digital", count=2)


def test_periodic_lengths_need_a_common_voxel():
    box = vg.Box((4.0, np.pi, 5.0), periodic=(True, True, False))
    with pytest.raises(InputError, match="divides the periodic lengths"):
        vg.pack(vg.make_shape("sphere"), box, method="digital", count=2, voxel_size=0.1)


def test_signals_leave_a_checkpoint_and_resume_to_the_same_bits(tmp_path):
    arguments = {"count": 12, "voxel_size": 0.125, "sweeps": 3000, "seed": 4, "cycles": 2}
    shape, box = vg.make_shape("cone"), vg.Box((4, 4, 5))
    whole = drive(digital, task_of([shape], box, **arguments).problem, Drive())
    for number in (signal.SIGINT, signal.SIGTERM):
        path = tmp_path / f"{number}.checkpoint"

        def interrupt(step, number=number):
            if step.done > 5000:
                signal.raise_signal(number)

        task = task_of([shape], box, **arguments)
        with pytest.raises(Interrupted, match="resume from") as stopped:
            drive(digital, task.problem, Drive(checkpoint=path, on_step=interrupt, chunk=2000))
        assert stopped.value.signal_number == number
        resumed = drive(digital, task_of([shape], box, **arguments).problem, Drive(checkpoint=path, resume=True))
        for name, array in whole.arrays.items():
            assert resumed.arrays[name].tobytes() == array.tobytes()
        assert resumed.counters == whole.counters
        other = task_of([shape], box, **{**arguments, "seed": 5})
        with pytest.raises(CheckpointError, match="another run"):
            drive(digital, other.problem, Drive(checkpoint=path, resume=True))


@pytest.mark.parametrize(
    ("method", "options"),
    [("digital", {}), ("digital", {"orientations": 2400}), ("digital_fill", {}), ("digital_rsa", {})],
    ids=str,
)
def test_a_grain_without_a_center_of_a_voxel_is_refused(method, options):
    """Also where it is one of several sizes, and where the orientations are voxelized when they are needed."""
    told = {"method": method, "voxel_size": 0.125, "cover": "center", **options}
    for sizes in (None, vg.sizes.discrete([0.15, 0.6], [0.5, 0.5])):
        with pytest.raises(InputError, match=r"voxel_size is 0.125: .* diameter 0.15 holds no center"):
            vg.pack(vg.make_shape("sphere", diameter=0.15), vg.Box((2, 2, 2)), count=20, sizes=sizes, **told)
    packing = vg.pack(vg.make_shape("sphere", diameter=0.25), vg.Box((2, 2, 2)), count=3, **told)
    assert packing.count == 3


@pytest.mark.parametrize("method", ["digital", "digital_fill", "digital_rsa"])
def test_overlaps_of_grains_of_voxel_centers_are_told(method):
    told = {"method": method, "voxel_size": 0.2, "count": 30, "seed": 1}
    told |= {"sweeps": 30} if method == "digital" else {}
    box = vg.Box((3, 3, 4))
    extra = {"settle": False} if method == "digital" else {}
    with pytest.warns(PackingWarning, match=r"\d+ pairs of grains overlap by up to 0\.\d+ mean diameters"):
        packing = vg.pack(vg.make_shape("sphere"), box, cover="center", **told, **extra)
    assert not vg.verify(packing).ok
    assert packing.stop_reason != "settled"
    assert vg.verify(vg.pack(vg.make_shape("sphere"), box, **{**told, "count": 8}, **extra)).ok


@pytest.mark.filterwarnings("ignore:.*pairs of grains overlap")
@pytest.mark.parametrize("method", ["digital", "control_point"])
def test_a_walk_that_ends_proves_no_rest(method):
    """Its grains are all placed, and nothing sinks any more; only forces in balance give the word."""
    told = {"count": 6, "sweeps": 60, "seed": 1, **({"voxel_size": 0.1} if method == "digital" else {"spacing": 0.2})}
    walk = vg.pack(vg.make_shape("box"), vg.Box((3, 3, 4)), method=method, settle=False, **told)
    assert walk.stop_reason in {"count", "steps"}
    assert walk.forces is None
    assert vg.settle(walk).stop_reason == "settled"


@pytest.mark.parametrize("method", ["digital", "digital_fill"])
@pytest.mark.parametrize("width", [30, 45])
@pytest.mark.parametrize(("height", "count"), [(84.5, 3), (56.1, 2), (142.0, 5), (84.0, 2)])
def test_a_column_holds_as_many_grains_as_it_is_high(method, width, height, count):
    """In a narrow one one grain less where they fill it to the last digit, for which a lattice has no room."""
    sphere, box = vg.shapes.sphere(diameter=28), vg.Box((width, width, height))
    with warnings.catch_warnings(action="ignore"):
        assert vg.pack(sphere, box, method, count=int(height // 28), settle=False).count >= count


@pytest.mark.parametrize("method", ["digital", "digital_fill", "digital_rsa"])
def test_a_container_hardly_wider_than_a_grain_gets_voxels_in_which_it_fits(method):
    """By default; a container as wide as the grain has no room on any lattice, and the warning names the voxels."""
    sphere, asked = vg.shapes.sphere(diameter=28), {"count": 1, "seed": 1, "settle": False}
    for width in (30, 28.5):
        assert vg.pack(sphere, vg.Box((width, width, 60)), method, **asked).count == 1
    with pytest.warns(PackingWarning, match="no grain finds room between voxels any more; give a smaller voxel_size"):
        tight = vg.pack(sphere, vg.Box((28, 28, 60)), method, **asked)
    wide = vg.pack(sphere, vg.Box((60, 60, 60)), method, **asked)
    assert tight.provenance["parameters"]["voxel_size"] == pytest.approx(
        wide.provenance["parameters"]["voxel_size"], rel=0.05
    )
