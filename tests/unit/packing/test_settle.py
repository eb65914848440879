"""`settle`: the same as within `pack`, the same bits after an interruption, any scale, and what is refused."""

import itertools
import signal
from dataclasses import replace

import kit
import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran._base.errors import InputError, Interrupted, PackingWarning, UnknownNameError
from voxgran._base.stopping import Stopped
from voxgran.containers.gravity import as_down
from voxgran.packing import driver as run
from voxgran.packing.driver import Drive, drive
from voxgran.packing.settle import begun
from voxgran.settling.parameters import Settling
from voxgran.testing.packing_methods import bits_of, contents_of

SPHERE, DISK = vg.make_shape("sphere"), vg.make_shape("disk")
BOX, FLAT = vg.Box((3, 3, 9), periodic="xy"), vg.Rectangle((4, 10))
GRADED = vg.sizes.lognormal(1.0, 0.2)
SCENES = {
    "spheres": (SPHERE, BOX),
    "polyhedra": (vg.make_shape("convex_polyhedron", seed=4, points=12), BOX),
    "disks": (DISK, FLAT),
    "polygons": (vg.make_shape("polygon", corners=5), FLAT),
}


def loose_grains(shape=SPHERE, container=BOX, count=10, seed=2):
    """Grains at random places, which overlap nowhere."""
    packing = vg.pack(shape, container, "rsa", count=count, sizes=GRADED, seed=seed)
    return replace(packing, gravity=as_down("-z" if container.dimension == 3 else "-y", container))


def net_forces(bed):
    """Net force on each grain in its weights, from the forces at its contacts."""
    unit = np.median(bed.diameters) ** bed.dimension * (np.pi / 6 if bed.dimension == 3 else np.pi / 4)
    weight = bed.volumes / unit
    net = weight[:, None] * np.array(bed.gravity)
    np.subtract.at(net, bed.forces.i, bed.forces.force)
    inner = bed.forces.j >= 0
    np.add.at(net, bed.forces.j[inner], bed.forces.force[inner])
    return np.linalg.norm(net, axis=1) / weight


def spheres_at(*heights, size=3.0, **more):
    """Spheres of diameter 1 in the middle of a box."""
    place = [(size / 2, size / 2, height) for height in heights]
    return vg.Packing.of([SPHERE], vg.Box((size, size, 8)), position=place, **{"gravity": "-z"} | more)


def walk(settle, *, seed=2, count=10, **more):
    """The task of a walk, after which grains settle."""
    asked = {"sizes": GRADED, "voxel_size": 0.2, "sweeps": 20, "rate": 0.01}
    return kit.task_of("digital", SPHERE, BOX, count=count, seed=seed, settle=settle, **asked | more)


@pytest.mark.parametrize("scene", SCENES)
def test_grains_come_to_rest_without_overlap(scene):
    loose = loose_grains(*SCENES[scene])
    bed = vg.settle(loose)
    assert bed.stop_reason == "settled"
    assert vg.verify(bed).ok
    assert net_forces(bed).max() < 0.01
    normal = (bed.forces.force * bed.forces.normal).sum(axis=1)
    across = np.linalg.norm(bed.forces.force - normal[:, None] * bed.forces.normal, axis=1)
    assert (normal >= 0.0).all()
    assert (across <= 0.5 * normal + 1e-9).all()
    assert bed.scale.tobytes() == loose.scale.tobytes()
    assert bed.shape_id.tobytes() == loose.shape_id.tobytes()
    down = np.array(loose.gravity)
    assert (bed.position @ down).mean() > (loose.position @ down).mean()


def test_the_same_seed_gives_the_same_bits_and_another_one_other_shaking():
    loose, shaking = loose_grains(), {"acceleration": 1.0, "duration": 1.0}
    shaken = [vg.settle(loose, shaking=shaking, seed=seed) for seed in (1, 1, 2)]
    assert bits_of(shaken[0]) == bits_of(shaken[1])
    assert bits_of(shaken[0]) != bits_of(shaken[2])
    # without shaking nothing is random
    assert bits_of(vg.settle(loose, seed=1)) == bits_of(vg.settle(loose, seed=2))


def test_within_pack_it_is_the_same_to_the_last_bit():
    asked = {"count": 10, "sizes": GRADED, "seed": 2, "voxel_size": 0.2, "sweeps": 20}
    loose = vg.pack(SPHERE, BOX, "digital", **asked, settle=False)
    other = {"friction": 0.4, "fall_time": 6.0, "rest": 0.3}
    for how, more in ((True, {}), (other, other)):
        within, after = vg.pack(SPHERE, BOX, "digital", **asked, settle=how), vg.settle(loose, seed=2, **more)
        assert bits_of(within) == bits_of(after) != bits_of(loose)
        assert within.stop_reason == after.stop_reason
        assert within.forces.force.tobytes() == after.forces.force.tobytes()
        assert within.provenance["settling"] == after.provenance["settling"]
    assert bits_of(vg.pack(SPHERE, BOX, "digital", **asked)) == bits_of(
        vg.pack(SPHERE, BOX, "digital", **asked, settle=True)
    )


@pytest.mark.parametrize("unit", [1e-6, 3.7e5])
@pytest.mark.parametrize("scene", SCENES)
def test_the_unit_of_length_changes_nothing_but_rounding(scene, unit):
    """With a power of two not even rounding changes; after other ones contacts enlarge it."""
    loose, two = loose_grains(*SCENES[scene]), 2.0 ** round(np.log2(unit))
    scaled = replace(
        loose, container=loose.container.scaled(two), position=loose.position * two, scale=loose.scale * two
    )
    assert vg.settle(scaled).position == pytest.approx(vg.settle(loose).position * two, rel=0, abs=1e-12 * two)


@pytest.mark.parametrize(
    ("scene", "friction"),
    # without friction disks roll for long
    [
        slow(*case) if case in (("disks", 0.0), ("polyhedra", 0.0)) else case
        for case in itertools.product(SCENES, (0.5, 0.0))
    ],
)
def test_a_run_goes_on_after_any_step_to_the_same_bits(scene, friction):
    """What a step depends on is in the arrays and counters: a new settler takes them over after each third step."""
    loose, how = loose_grains(*SCENES[scene], count=8), Settling(friction=friction, fall_time=5.0)
    whole, parts, steps = begun(loose, how, 0).settler, begun(loose, how, 0).settler, 0
    while not whole.ended:
        whole.step()
    while not parts.ended:
        if steps % 3 == 0:
            held = {name: np.array(array) for name, array in parts.arrays.items()}, dict(parts.counters)
            parts = begun(loose, how, 0).settler
            parts.restore(*held)
        parts.step()
        steps += 1
    assert parts.counters == whole.counters
    for one, other in zip(parts.bed.poses(), whole.bed.poses(), strict=True):
        assert one.tobytes() == other.tobytes()


@pytest.mark.parametrize("share", [0.2, 0.9, 1.0])
def test_a_walk_that_is_stopped_while_it_settles_goes_on_to_the_same_bits(share, tmp_path):
    whole, first, again, path = walk(True), walk(True), walk(True), tmp_path / "run.voxgran"
    ended = drive(whole.method, whole.problem, Drive())
    state = first.method.prepare(first.problem)
    inner = ended.counters["packing_done"]
    while state.done < inner + share * (ended.done - inner) and not state.stop_reason:
        state = first.method.advance(first.problem, state, 7)
    assert state.stage == "settling"
    run._save(first.problem, state, path, run.fingerprint(first.method, first.problem))
    resumed = drive(again.method, again.problem, Drive(path, resume=True, chunk=11))
    assert contents_of(resumed)[1:] == contents_of(ended)[1:] or share == 1.0
    packings = [task.method.finish(task.problem, state) for task, state in ((whole, ended), (again, resumed))]
    assert bits_of(packings[0]) == bits_of(packings[1])
    assert packings[0].stop_reason == packings[1].stop_reason == "settled"
    assert packings[0].forces.force.tobytes() == packings[1].forces.force.tobytes()


def test_a_signal_while_grains_settle_leaves_a_checkpoint_to_go_on_from(tmp_path):
    loose, path, seen = loose_grains(), tmp_path / "bed.voxgran", []

    def interrupt(step):
        seen.append(step)
        if len(seen) == 4:
            signal.raise_signal(signal.SIGTERM)

    with pytest.raises(Interrupted, match="resume from"):
        vg.settle(loose, checkpoint=path, on_step=interrupt)
    assert {step.stage for step in seen} <= {"settling", "compiling"}
    assert 0 < seen[-1].done < seen[-1].total
    assert bits_of(vg.settle(loose, checkpoint=path, resume=True)) == bits_of(vg.settle(loose))
    # the end is kept too
    assert bits_of(vg.settle(loose, checkpoint=path, resume=True)) == bits_of(vg.settle(loose))


@pytest.mark.parametrize("stops", [1, 2, 3])
def test_a_step_that_is_stopped_in_its_midst_begins_again(stops, monkeypatch):
    """The state is that before the step, also where it had moved grains already."""
    loose = loose_grains(count=8)
    whole, stopped = (begun(loose, Settling(), 0) for _ in range(2))
    looks, interrupted = [0], 0

    def stop():
        looks[0] += 1
        if looks[0] % (stops + 1) == stops:
            raise Stopped

    while not whole.settler.ended:
        whole.settler.step()
    monkeypatch.setattr("voxgran.settling.projected_gradient.stop_if_asked", stop)
    while not stopped.settler.ended and interrupted < 1000:
        before = {name: np.array(array).tobytes() for name, array in stopped.settler.arrays.items()}
        try:
            stopped.settler.step()
        except Stopped:
            interrupted += 1
            assert {name: np.array(array).tobytes() for name, array in stopped.settler.arrays.items()} == before
            monkeypatch.setattr("voxgran.settling.projected_gradient.stop_if_asked", lambda: None)
            stopped.settler.step()
            monkeypatch.setattr("voxgran.settling.projected_gradient.stop_if_asked", stop)
    assert interrupted > 0
    assert stopped.settler.bed.poses()[0].tobytes() == whole.settler.bed.poses()[0].tobytes()


def test_a_full_container_stays_full_and_progress_names_all_stages():
    steps = []
    with pytest.warns(PackingWarning):
        bed = vg.pack(
            SPHERE, vg.Box((2, 2, 2)), "digital", count=13, voxel_size=0.2, sweeps=5, on_step=steps.append
        )  # fmt: skip
    assert bed.stop_reason == "full"
    assert bed.provenance["settling"]["smallest_gap"] >= 0.0
    stages = [step.stage for step in steps if step.stage != "compiling"]
    assert sorted(set(stages), key=stages.index) == ["expected bed", "packing", "settling"]
    assert vg.settle(bed).stop_reason == "full"


def test_a_lid_lies_on_the_bed_and_presses():
    loose = loose_grains()
    bed = vg.settle(loose, lid={"weight": 2.0})
    assert vg.verify(bed).ok
    assert bed.lid is not None
    assert bed.lid.normal == pytest.approx([0.0, 0.0, 1.0])
    top = (bed.position[:, 2] + bed.bounding_radii).max()
    assert top <= bed.lid.level <= top + 2e-3
    # grains and lid together press on the floor
    floor = bed.forces.normal[:, 2] < -0.99
    floor &= bed.forces.j == -1
    masses = bed.volumes / (np.pi / 6 * np.median(bed.diameters) ** 3)
    assert bed.forces.force[floor, 2].sum() == pytest.approx(-3.0 * masses.sum(), rel=0.02)


def test_grains_settle_in_another_container_under_another_gravity():
    loose = replace(loose_grains(), gravity=None)
    bed = vg.settle(loose, container=vg.Box((3, 3, 9)), gravity=(0.0, 0.0, 2.0))
    assert bed.container.periodic == (False, False, False)
    assert bed.gravity == (0.0, 0.0, 1.0)
    assert bed.position[:, 2].mean() > loose.position[:, 2].mean()
    assert vg.verify(bed).ok


def test_a_bed_that_rests_stays_as_it_is():
    bed = vg.settle(loose_grains())
    assert bits_of(vg.settle(bed)) == bits_of(bed)


def test_no_grains_and_one_grain():
    none = vg.settle(spheres_at())
    assert (none.count, none.stop_reason) == (0, "settled")
    # the forces are known: there are none
    empty = vg.pack(SPHERE, BOX, "gravity", count=0)
    for bed in (none, empty, vg.settle(empty)):
        assert bed.forces.count == 0
        assert np.isnan(float(vg.measure(bed, ["forces"])["share_at_rest"]))
    one = vg.settle(spheres_at(5.0))
    assert one.position[0] == pytest.approx([1.5, 1.5, 0.5], abs=1e-3)


def test_overlapping_grains_are_parted():
    bed = vg.settle(spheres_at(0.5, 1.1, 1.7, 2.3))
    assert vg.verify(bed).ok
    assert bed.stop_reason == "settled"


def test_without_gravity_settling_is_refused():
    with pytest.raises(InputError, match=r"packing.gravity is None: .*give gravity='-z' along an axis that has walls"):
        vg.settle(spheres_at(1.0, gravity=None))
    with pytest.raises(InputError, match="gravity"):
        vg.settle(loose_grains(), gravity="-x")
    with pytest.raises(InputError, match="settle is True: method 'rsa' packs without gravity here"):
        vg.pack(SPHERE, BOX, "rsa", count=2, settle=True)
    with pytest.raises(InputError, match="packs without gravity here"):
        vg.pack(SPHERE, BOX, "digital", count=2, gravity="none", settle={"friction": 0.3})


def test_methods_that_build_no_beds_do_not_settle_unless_asked():
    assert "settling" not in vg.pack(SPHERE, BOX, "rsa", count=3).provenance
    assert "settling" not in vg.pack(SPHERE, BOX, "digital", count=3, gravity="none", voxel_size=0.2).provenance


def test_grains_outside_of_the_container_are_named():
    loose = spheres_at(1.0, 6.0, 3.0, 7.0)
    with pytest.raises(InputError, match=r"grains 1, 3 of the packing: centroids must lie in the container"):
        vg.settle(loose, container=vg.Box((3, 3, 4)))
    with pytest.raises(InputError, match=r"grain 3 of the packing"):
        vg.settle(loose, container=vg.Box((3, 3, 6.5)))
    many = spheres_at(*np.linspace(1.0, 7.0, 9))
    with pytest.raises(InputError, match=r"grains 2, 3, 4, 5, 6 and 2 more of the packing"):
        vg.settle(many, container=vg.Box((3, 3, 2)))


def test_grains_that_overlap_too_deep_are_named():
    loose = spheres_at(1.0, 4.0, 1.4, 4.3)
    with pytest.raises(
        InputError, match=r"grains (0 and 2, 1 and 3|1 and 3, 0 and 2) overlap by 0.7 of their diameter"
    ):
        vg.settle(loose)


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"friction": -0.1}, "friction"),
        ({"friction": 5.0}, "friction is 5.0: it must be finite and at least 0 and at most 2"),
        ({"restitution": 1.5}, "restitution"),
        ({"rest": 0.0}, "rest"),
        ({"fall_time": -1.0}, "fall_time"),
        ({"lid": {"weight": 0.0}}, "lid weight is 0.0: it must be finite and above 0"),
        ({"lid": {"weight": 1e6}}, "lid weight is 1000000.0: it must be .* at most 100"),
        (
            {"lid": 1.0},
            r"lid is 1.0: it must be a table of weight, such as {'weight': 1.0}, or Lid\(weight=...\); or leave it out",
        ),
        ({"shaking": {"acceleration": -1.0}}, "shaking acceleration is -1.0"),
        ({"shaking": {"duration": -1.0}}, "shaking duration is -1.0"),
        ({"parts": "all"}, "parts"),
        ({"seed": -1}, "seed"),
        ({"checkpoint": 3}, "checkpoint"),
        ({"resume": True}, "resume is True and checkpoint is None: give the file"),
    ],
    ids=str,
)
def test_what_breaks_a_rule_is_refused(asked, words):
    with pytest.raises(InputError, match=words):
        vg.settle(spheres_at(1.0), **asked)


def test_settle_within_pack_takes_true_false_or_parameters():
    for wrong in ("yes", 3):
        with pytest.raises(InputError, match="must be True, False or parameters"):
            walk(wrong)
    with pytest.raises(UnknownNameError, match="'frictions' is unknown"):
        walk({"frictions": 0.3})
    assert walk(Settling(friction=0.2)).problem.settling.friction == 0.2
    assert walk(False).problem.settling is None
    assert walk(None).problem.settling == Settling(friction=0.5)
    prints = {run.fingerprint(task.method, task.problem) for task in (walk(False), walk(True), walk({"rest": 0.9}))}
    assert len(prints) == 3


def test_a_method_that_settles_itself_takes_no_second_friction():
    for asked in ({"friction": 0.9}, Settling(friction=0.9)):
        with pytest.raises(InputError, match=r"settle as they are packed; leave settle out, .* such as friction=0\.3"):
            vg.pack(SPHERE, BOX, "gravity", count=10, friction=0.3, settle=asked)
    for asked in (True, False, None):
        assert vg.pack(SPHERE, BOX, "gravity", count=10, settle=asked).stop_reason == "settled"


def lattice(spacing):
    """Return 125 spheres on a cubic lattice in a box in which they have hardly room."""
    place = np.stack(np.meshgrid(*[np.arange(5)] * 3), axis=-1).reshape(-1, 3) * spacing
    box = vg.Box((5 * spacing, 5 * spacing, 5 * spacing))
    return vg.Packing.of(SPHERE, box, position=place + 0.5 * spacing + np.array(box.bounds[0]))


def test_more_grains_than_fit_are_refused():
    with pytest.raises(InputError, match=r"the solid fraction is 1\.023: .* at most 0\.7405 .* or fewer grains"):
        vg.settle(lattice(0.8))


@pytest.mark.slow
def test_grains_that_cannot_be_parted_overlap_no_deeper_than_before():
    """The solid fraction is 0.718: possible on another lattice, which grains do not find."""
    loose = lattice(0.9)
    with pytest.warns(PackingWarning, match="give a larger container or fewer grains"):
        bed = vg.settle(loose)
    assert bed.stop_reason == "steps"
    assert vg.verify(bed).deepest <= vg.verify(loose).deepest + 1e-9


def test_hulls_in_place_of_meshes_settle_without_overlap():
    """Convex hulls hold their grains: no true shapes overlap, and more room is left than by the true shapes."""
    union = vg.make_shape("solid_union", seed=3)
    box = vg.Box((3, 3, 8), periodic="xy")
    bed = vg.pack(union, box, "gravity", count=15, parts="hulls")
    assert bed.verify().ok
    assert bed.stop_reason == "settled"
    assert bed.provenance["settling"]["parameters"]["parts"] == "hulls"


def test_each_call_with_a_short_time_limit_makes_a_step(tmp_path):
    """Attempts that only count until the next step is due are no work."""
    box, steps, how = vg.Box((4, 4, 6)), [], {"checkpoint": tmp_path / "run", "resume": True, "time_limit": 0.0}
    for _ in range(4):
        part = vg.pack(SPHERE, box, "gravity", count=20, **how)
        steps.append(part.provenance["settling"]["steps"])
    assert steps == [1, 2, 3, 4]


@pytest.mark.slow
def test_a_deep_column_between_walls_is_not_wedged():
    """Growing spheres press against walls, whose friction holds the overlaps: it took 817 steps and a second fall."""
    column = vg.pack(SPHERE, vg.Box((4, 4, 33)), "gravity", count=420, seed=1)
    assert column.provenance["settling"]["resting"] > 0.98
    assert column.provenance["settling"]["steps"] < 600
    assert vg.equilibrium(column).attrs["share_at_rest"] > 0.98
    assert vg.verify(column).ok
