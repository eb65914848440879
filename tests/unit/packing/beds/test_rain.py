"""Grains that arrive one after the other, with the velocity of a fall and at a rate in time."""

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran.contacts.assembly import Assembly
from voxgran.settling.bed import Bed
from voxgran.settling.parameters import Settling
from voxgran.settling.progress import RAIN
from voxgran.settling.rain import Rain, _admit_grains, let_arrive, steps_of_rain
from voxgran.settling.stages import Settler

BALL, DISK = vg.shapes.sphere(), vg.make_shape("disk")
MIDDLE = np.array([[2.0, 2.0, 0.0]])
DOWN = np.array([0.0, 0.0, -1.0])


def assembly(count, box=None):
    """Return spheres of which all are held back at first."""
    zeros = np.zeros((count, 3))
    return Assembly.of([BALL], box or vg.Box((4, 4, 12)), position=zeros, scale=np.ones(count))


def settler(count, speed, rate, *, places=((2.0, 2.0, 0.0),), restitution=0.0):
    rain = Rain(speed, rate, lambda step, number, radius: np.array(places), -np.inf)
    return Settler(assembly(count), Settling(restitution=restitution), DOWN, rain=rain, held=count)


def test_a_grain_arrives_at_the_floor_with_the_velocity_of_its_fall():
    one, before = settler(1, speed=3.0, rate=1.0), 0.0
    while one.bed.count < 1 or one.bed.bodies[0, 2] < -0.1:
        before = one.bed.bodies[0, 2] if one.bed.count else 0.0
        one.step()
    # it begins 0.05 above the floor
    assert before == pytest.approx(-3.0, abs=0.1)
    assert one.bed.grains.position[0, 2] == pytest.approx(0.5, abs=2e-3)
    assert abs(one.bed.bodies[0, 2]) < 0.05
    bounces = settler(1, speed=3.0, rate=1.0, restitution=0.5)
    while bounces.bed.count < 1 or bounces.bed.bodies[0, 2] <= 0.0:
        bounces.step()
    assert bounces.bed.bodies[0, 2] == pytest.approx(0.5 * 3.0, rel=0.05)


def test_grains_that_were_held_back_come_with_a_velocity():
    bed = Bed(assembly(4), DOWN, held=2)
    bed.grains.position[:] = [[2, 2, 1.0], [2, 2, 2.1]]
    bed.admit(np.array([[2.0, 2.0, 4.0]]), 2.0 * DOWN)
    assert (bed.count, bed.assembly.count) == (3, 4)
    assert bed.bodies[:, 2].tolist() == [0.0, 0.0, -2.0, 0.0]
    assert bed.bodies[:3, 6].tolist() == [1.0, 1.0, 1.0]
    bed.admit(np.array([[2.0, 2.0, 6.0]]), 3.0 * DOWN)
    assert bed.grains.position[:, 2] == pytest.approx([1.0, 2.1, 4.0, 6.0], abs=1e-9)
    bed.find(0.2, 0.0)
    assert bed.gap[bed.rows.j[: bed.m] >= 0] == pytest.approx([0.1])


def test_the_rate_is_met_where_there_is_room():
    places = [(x + 0.5, y + 0.5, 0.0) for x in range(4) for y in range(4)]
    rng = np.random.default_rng(0)
    rain = Rain(0.0, 4.0, lambda step, number, radius: np.array([places[rng.integers(16)]]), -np.inf)
    run = Settler(assembly(60), Settling(), DOWN, rain=rain, held=60)
    time, came = 0.0, []
    while run.progress.stage == RAIN and time < 8.0:
        how, _ = let_arrive(run.bed, rain, run._fall, run.progress)
        run._advance(None, how)
        time += how.step
        came.append((time, run.bed.count))
    times, counts = np.transpose(came)
    assert np.polyfit(times, counts, 1)[0] == pytest.approx(4.0, rel=0.15)
    assert steps_of_rain(rain, 60, run._fall) == 300


def test_steps_are_so_short_that_no_grain_moves_too_far():
    run = settler(1, speed=10.0, rate=1.0)
    how, _ = let_arrive(run.bed, run.rain, run._fall, run.progress)
    assert how.step * 10.0 < run._fall.most
    assert how.step < run._fall.step


def test_a_grain_waits_while_another_is_in_its_way():
    run = settler(3, speed=0.0, rate=100.0)
    let_arrive(run.bed, run.rain, run._fall, run.progress)
    # the place is taken by the first one, which flies
    assert run.bed.count == 1
    assert run.progress.owed < 6.0


@pytest.mark.slow
def test_the_higher_the_fall_the_denser_the_bed():
    box = vg.Box((6, 6, 20), periodic="xy")
    beds = {h: vg.pack(BALL, box, "gravity", count=400, fall_height=h, seed=1) for h in (0.0, 10.0)}
    dense = {h: float(bed.measure("density").bulk_solid_fraction) for h, bed in beds.items()}
    # 0.583 and 0.605 with a scatter of 0.003 between seeds
    assert dense[0.0] == pytest.approx(0.583, abs=0.008)
    assert dense[10.0] > dense[0.0] + 0.012
    for bed in beds.values():
        assert bed.count == 400
        assert bed.stop_reason == "settled"
        assert vg.verify(bed).ok
        assert vg.equilibrium(bed).attrs["share_at_rest"] > 0.95


def test_grains_are_in_the_order_in_which_they_arrived():
    bed = vg.pack(BALL, vg.Box((3, 3, 14), periodic="xy"), "gravity", count=60, fall_height=0.0, seed=1)
    assert (bed.count, bed.stop_reason) == (60, "settled")
    assert vg.verify(bed).ok
    assert np.corrcoef(np.arange(60), bed.position[:, 2])[0, 1] > 0.97


def test_a_run_that_is_stopped_goes_on_with_the_same_bits(tmp_path):
    box, asked = vg.Box((4, 4, 10), periodic="xy"), {"count": 60, "fall_height": 2.0, "seed": 3}
    whole = vg.pack(BALL, box, "gravity", **asked)
    path = tmp_path / "rain.ckpt"
    for limit in (0.1, 0.2):
        part = vg.pack(BALL, box, "gravity", checkpoint=path, resume=True, time_limit=limit, **asked)
        assert part.count <= 60
    again = vg.pack(BALL, box, "gravity", checkpoint=path, resume=True, **asked)
    assert again.position.tobytes() == whole.position.tobytes()


def test_without_a_fall_height_nothing_is_different():
    assert vg.methods.Gravity().fall_height is None
    run = Settler(assembly(2), Settling(), DOWN)
    assert run.progress.stage != RAIN


def test_grains_upon_a_start_around_an_obstacle_and_of_any_shape():
    box = vg.Box((5, 5, 12))
    below = vg.pack(BALL, box, "gravity", count=8)
    bar = vg.Packing.of(BALL, box, position=[(2.5, 2.5, 5.0)])
    rocks = [vg.make_shape("polyhedron", seed=k) for k in range(2)]
    bed = vg.pack(rocks, box, "gravity", count=6, fall_height=3.0, start=below, obstacles=bar)
    assert bed.count == 15
    assert bed.fixed.sum() == 1
    assert bed.position[bed.fixed][0] == pytest.approx((2.5, 2.5, 5.0))
    assert vg.verify(bed).ok


def test_an_inlet_with_a_rate_pours_in_time():
    table, mixed = vg.Rectangle((30, 14)), vg.sizes.uniform(0.8, 1.2)
    heap = vg.pour(DISK, table, 80, inlet=vg.Inlet(radius=2, rate=5), sizes=mixed, friction=0.5, seed=1)
    assert heap.provenance["batches"] == [80]
    assert heap.stop_reason == "settled"
    assert np.median(np.abs(heap.position[:, 0] - 15.0)) < 6.0


def test_all_grains_arrive_one_by_one_beside_several_obstacles():
    """None of them begins in the corner of the container, where the others would push it through."""
    box = vg.Box((6, 6, 16))
    standing = vg.Packing.of(BALL, box, position=[(1, 1, 1), (3, 3, 1), (5, 5, 1), (1, 5, 1)])
    bed = vg.pack(BALL, box, "gravity", count=10, fall_height=1.0, obstacles=standing)
    assert bed.count == 14
    assert bed.stop_reason == "settled"
    assert vg.verify(bed).ok


def test_a_spout_at_a_height_lets_grains_fall_from_there():
    high = Settler(assembly(1), Settling(), DOWN, rain=Rain(0.0, 1.0, lambda *_: MIDDLE, 8.0), held=1)
    high.step()
    assert high.bed.grains.position[0, 2] == pytest.approx(8.05, abs=5e-3)


def test_a_container_that_is_full():
    with pytest.warns(vg.PackingWarning):
        bed = vg.pour(DISK, vg.Rectangle((5, 4)), 20, inlet=vg.Inlet(radius=1, rate=5))
    assert bed.stop_reason == "full"
    assert 8 < bed.count < 20


def test_what_cannot_be():
    box = vg.Box((5, 5, 9))
    with pytest.raises(InputError, match="lid is given with a fall_height or a rate: grains arrive"):
        vg.pack(BALL, box, "gravity", count=5, fall_height=1.0, lid=vg.Lid(weight=1))
    with pytest.raises(InputError, match=r"fill is 0\.2, and with a fall_height or a rate of the inlet grains arrive"):
        vg.methods.Gravity(fill=0.2, fall_height=3.0)
    with pytest.raises(InputError, match=r"fill is 0\.2, and with a fall_height or a rate"):
        vg.methods.Gravity(fill=0.2, inlet=vg.Inlet(rate=2.0))
    with pytest.raises(InputError, match="fall_height is -1"):
        vg.pack(BALL, box, "gravity", count=5, fall_height=-1.0)
    with pytest.raises(InputError, match="batch is 2: by deposition, at a rate or from a fall_height grains arrive"):
        vg.pour(BALL, box, 5, batch=2, fall_height=1.0)


@pytest.mark.slow
def test_a_pour_in_batches_goes_on_from_its_checkpoints(tmp_path):
    box, path = vg.Box((5, 5, 10)), tmp_path / "heap.ckpt"
    whole = vg.pour(BALL, box, 9, batch=3, seed=2)
    vg.pour(BALL, box, 6, batch=3, seed=2, checkpoint=path)
    assert sorted(one.name for one in tmp_path.iterdir()) == ["heap.ckpt", "heap.ckpt.1"]
    again = vg.pour(BALL, box, 9, batch=3, seed=2, checkpoint=path, resume=True)
    assert again.position.tobytes() == whole.position.tobytes()


@pytest.mark.filterwarnings("ignore:the bulk holds")
def test_a_scene_has_a_fall_height_and_a_rate(tmp_path):
    scene = vg.Scene.from_mapping(
        {
            "scene": {"seed": 3},
            "shape": [{"family": "sphere"}],
            "container": {"kind": "box", "lengths": [6, 6, 10]},
            "packing": {"method": "gravity", "count": 12, "fall_height": 3, "inlet": {"radius": 1.5, "rate": 4}},
            "measure": {"which": ["density"]},
            "output": {"vtk": False, "report": False, "statistics": False},
        }
    )
    assert vg.Scene.from_mapping(scene.to_mapping()) == scene
    position = scene.run(tmp_path / "out").packing.position
    called = vg.pour(BALL, vg.Box((6, 6, 10)), 12, inlet=vg.Inlet(radius=1.5, rate=4), fall_height=3, seed=3)
    assert called.position.tobytes() == position.tobytes()


def test_the_unit_of_lengths_changes_nothing():
    box, small = vg.Box((4, 4, 9), periodic="xy"), vg.Box((0.5, 0.5, 1.125), periodic="xy")
    bed = vg.pack(BALL, box, "gravity", count=20, fall_height=4.0)
    again = vg.pack(BALL.scaled(0.125), small, "gravity", count=20, fall_height=0.5)
    assert (again.position * 8).tobytes() == bed.position.tobytes()


def test_a_grain_that_arrives_meets_images_across_a_tilted_side():
    # a grain of the bed lies across the side of y: its image there is shifted along x
    box = vg.Box((4, 4, 12), "xy", tilt=(1.5, 0, 0))
    bed = Bed(assembly(2, box), DOWN, held=1)
    bed.grains.position[0] = [0.2, 0.1, 0.5]
    above = np.add([0.2, 0.1, 0.0], box.vectors[1]) - [0.1, 0.3, 0.0]
    rain = Rain(1.0, 1.0, lambda step, number, radius: above[None], -np.inf)
    assert _admit_grains(bed, rain, 1, 0) == 1
    apart = bed.grains.position[1] - bed.grains.position[0] - box.vectors[1]
    assert np.linalg.norm(apart) > 1.0
    assert apart[2] == pytest.approx(np.sqrt(1 - 0.1) + 0.05)
