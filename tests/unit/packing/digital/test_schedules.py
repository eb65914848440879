"""Ways of digital packing beyond the plain walk: gravity, vibration, feeding, guided moves, lid, schedules."""

import itertools

import kit
import numpy as np
import pytest
from kit import run, slow

import voxgran as vg
from voxgran._base.errors import PackingWarning
from voxgran._base.seeds import philox_key
from voxgran.packing.digital.precompute import precomputed_of
from voxgran.packing.digital.walk_method import registration as digital

BOX = vg.Box((4, 4, 6))


def task_of(shapes, container=BOX, *, count=30, **parameters):
    usual = {"voxel_size": 0.125, "sweeps": 400, "cycles": None if "period" in parameters else 2}
    return kit.task_of("digital", shapes, container, count=count, **{**usual, **parameters})


def occupied_again(problem, state):
    """Return the occupancy made from the poses alone, and that which the walk kept."""
    setting = precomputed_of(problem, state)
    total = np.zeros(setting.lattice.shape, dtype=int)
    for grain in np.flatnonzero(state.arrays["member"] >= 0):
        member, turn = int(state.arrays["member"][grain]), int(state.arrays["turn"][grain])
        mask = problem.voxels(grain, setting.base[member], setting.lattice.voxel_size, cover=problem.parameters.cover)
        half = np.array(mask.shape) / 2
        if mask.shape[2] == 1:
            half[2] = 0.5
        centers = np.argwhere(mask) + 0.5 - half
        voxels = np.floor(centers @ setting.rotations[turn].T).astype(int) + state.arrays["site"][grain]
        voxels = np.where(setting.canvas.periodic, voxels % setting.lattice.shape, voxels)
        np.add.at(total, tuple(voxels.T), 1)
    return total, setting.canvas.occupied(state.derived["words"])


WAYS = [
    {"gravity": (0.3, 0.2, -1.0)},
    {"gravity": "-x"},
    {"period": 50, "decay": 0.7},
    {"feed": "layers"},
    {"feed": "at_once"},
    {"rate": 0.5},
    {"guided": 0.5},
    {"schedule": "sorted"},
    {"schedule": "sleeping"},
    {"lid": True},
    {"schedule": "sleeping", "guided": 0.3, "feed": "layers", "lid": True, "decay": 0.5},
]


@pytest.mark.parametrize("way", WAYS, ids=str)
def test_every_way_keeps_its_promises(way):
    shapes = [vg.make_shape("solid_union", seed=2), vg.make_shape("box", lengths=(1.1, 0.8, 0.6))]
    count = 15 if way.get("feed") == "at_once" else 30
    task = task_of(shapes, count=count, **way)
    state, packing = run(task)
    assert packing.count == count
    assert vg.verify(packing).ok
    total, kept = occupied_again(task.problem, state)
    assert total.max() == 1
    if not way.get("lid"):
        assert np.array_equal(total == 1, kept)
    # chunks do not matter
    again = run(task_of(shapes, count=count, **way), chunk=777)[1]
    assert again.position.tobytes() == packing.position.tobytes()
    assert again.orientation.tobytes() == packing.orientation.tobytes()


def test_gravity_in_any_direction_piles_grains_up_there():
    packing = run(
        task_of(vg.make_shape("sphere"), vg.Box((5, 5, 5)), count=20, gravity=(1.0, 0.0, -1.0), vibration_up=0.0)
    )[1]
    along = (packing.position - 2.5) @ np.array([1.0, 0.0, -1.0])
    assert along.min() > -0.5
    assert along.mean() > 1.5
    assert packing.provenance["parameters"]["gravity"] == [1.0, 0.0, -1.0]
    with pytest.warns(PackingWarning, match="bulk"):
        assert float(vg.measure(packing)["solid_fraction"]) == pytest.approx(packing.solid_fraction)


def plain_attempts(problem, state, setting, first, last, *, order=None, patience=None):
    """Walk on a label grid, one attempt after the other, without turns: the schedules as they are told."""
    steps = setting.directions
    classes, settings, n = setting.classes, problem.parameters, problem.count
    key = philox_key(problem.seed, "digital")
    whole = [problem.voxels(g, setting.base[g], setting.lattice.voxel_size, cover="touch") for g in range(n)]
    masks, half = [np.argwhere(mask) for mask in whole], [mask.shape[0] // 2 for mask in whole]
    sites = state.arrays["site"].copy()
    grid = np.full(setting.lattice.shape, -1)
    for g in range(n):
        grid[tuple((masks[g] - half[g] + sites[g]).T)] = g
    calm, deepest, slept, sunk_at, skipped = np.zeros(n, int), np.full(n, -(2**40)), np.full(n, -1), {}, 0
    fed, attempts = state.feeding_ended_at, settings.sweeps * n
    edge, cells = state.arrays["cells"][3], state.arrays["cells"][:3]

    def boxes(g):
        low = (masks[g] - half[g]).min(axis=0) + sites[g] - 1
        size = np.ptp(masks[g], axis=0) + 1
        begin, end = low // edge, (low + size + 1) // edge + 1
        spans = (range(a, b) for a, b in zip(begin, end, strict=True))
        return [tuple(np.array(cell) % cells) for cell in itertools.product(*spans)]

    for attempt in range(first, last):
        r0, r1, r2, _ = (int(w) for w in np.random.Philox(key=key, counter=[attempt - 1, 0, 0, 0]).random_raw(4))
        if order is None:
            g = int(state.waiting[n - 1 - ((r0 >> 32) * n >> 32)])
        else:
            start = attempt // 512 % -(-n // 64) * 64
            g = int(order[start + ((r0 >> 32) * min(64, n - start) >> 32)])
        if patience is not None and slept[g] >= 0:
            if attempt - fed >= attempts:
                cycle = fed + attempts
            else:
                cycle = fed + (attempt - fed) * settings.cycles // attempts * attempts // settings.cycles
            if slept[g] >= cycle and all(sunk_at.get(c, -1) <= slept[g] for c in boxes(g)):
                skipped += 1
                continue
            slept[g], calm[g], deepest[g] = -1, 0, -(2**40)
        along = (attempt - fed) / attempts * settings.cycles
        cycle = np.floor(along)
        up = (
            settings.vibration_up * (1 - cycle / settings.cycles) * (1 - (along - cycle))
            if attempt - fed < attempts
            else 0.0
        )
        share = (r1 >> 11) / 2.0**53
        which = 0 if share < settings.downward_share else 2 if share < settings.downward_share + up else 1
        low, count = int(classes[which]), int(classes[which + 1] - classes[which])
        step = steps[low + ((r2 >> 32) * count >> 32)]
        there = masks[g] - half[g] + sites[g] + step
        inside = (there >= 0).all() and (there < grid.shape).all()
        if inside and np.isin(grid[tuple(there.T)], (-1, g)).all():
            grid[grid == g] = -1
            sites[g] = sites[g] + step
            grid[tuple(there.T)] = g
        if patience is None:
            continue
        depth = -sites[g][2]
        if depth <= deepest[g]:
            calm[g] += 1
            slept[g] = attempt if calm[g] >= patience else slept[g]
            continue
        for cell in boxes(g) if deepest[g] > -(2**40) else ():
            sunk_at[cell] = attempt
        deepest[g], calm[g] = depth, 0
    return sites, skipped


@pytest.mark.parametrize("schedule", [slow("random"), slow("sorted"), "sleeping"])
def test_schedules_are_those_of_a_plain_program(schedule):
    """Bit for bit the same trajectory over some thousand attempts under gravity."""
    box, shape = vg.Box((3, 3, 4)), vg.make_shape("ellipsoid")
    task = task_of(shape, box, count=12, schedule=schedule, rotation_share=0.0, orientations=1, sweeps=300)
    problem = task.problem
    state = digital.prepare(problem)
    while state.feeding_ended_at is None:
        state = digital.advance(problem, state, 1)
    setting = precomputed_of(problem, state)
    begin, many = state.done, 9000 if schedule != "sorted" else 16 * 12 - 1
    order = state.arrays["order"].copy() if schedule == "sorted" else None
    for name, value in (("calm", 0), ("depth", -(2**40)), ("slept", -1), ("stirred", -1)):
        state.arrays[name][...] = value
    before = state.counters["slept_through"]
    twin, skipped = plain_attempts(
        problem, state, setting, begin, begin + many, order=order, patience=128 if schedule == "sleeping" else None
    )
    state = digital.advance(problem, state, many)
    assert np.array_equal(state.arrays["site"], twin)
    assert state.counters["slept_through"] - before == skipped
    if schedule == "sleeping":
        assert skipped > 0


def test_sorted_picks_follow_the_curve_anew():
    task = task_of(vg.make_shape("sphere"), vg.Box((6, 6, 6)), count=80, schedule="sorted", sweeps=40, cycles=1)
    state, packing = run(task)
    assert sorted(state.arrays["order"]) == list(range(80))
    assert vg.verify(packing).ok


def test_a_lid_compacts_and_is_recorded():
    shape = vg.make_shape("sphere")
    free = run(task_of(shape, vg.Box((4, 4, 8)), count=50, sweeps=600))[1]
    held = run(task_of(shape, vg.Box((4, 4, 8)), count=50, sweeps=600, lid=True))[1]
    lowered = held.provenance["lid_lowered"]
    assert lowered > 1.5
    # no grain reaches above the lid
    assert held.position[:, 2].max() + 0.5 <= 8 - lowered + 1e-9
    assert held.position[:, 2].max() <= free.position[:, 2].max() + 0.5
    assert free.provenance["lid_lowered"] == 0


def test_sleeping_grains_are_passed_over_and_the_bed_is_as_dense():
    shape = vg.make_shape("sphere")
    plain = run(task_of(shape, count=40, sweeps=1500, cycles=4, vibration_up=0.0))
    sleeping = run(task_of(shape, count=40, sweeps=1500, cycles=4, vibration_up=0.0, schedule="sleeping"))
    counters = sleeping[0].counters
    # most attempts are slept through once the bed has settled
    assert counters["slept_through"] > 0.3 * sleeping[0].done
    heights = [packing.position[:, 2].mean() for _, packing in (plain, sleeping)]
    assert heights[1] < heights[0] + 0.25


@pytest.mark.parametrize(
    "way",
    [{"schedule": "sleeping", "guided": 0.3}, *map(slow, ({"lid": True}, {"feed": "layers"}, {"schedule": "sorted"}))],
    ids=str,
)
def test_every_way_goes_on_after_a_stop_to_the_same_bits(way, tmp_path, monkeypatch):
    monkeypatch.setattr("voxgran.packing.driver.FIRST_CHUNK", 1000)
    options = {
        "method": "digital",
        "settle": False,
        "count": 15,
        "voxel_size": 0.125,
        "sweeps": 200,
        "cycles": 2,
        "seed": 3,
        **way,
    }
    shape, path, stops = vg.make_shape("solid_union", seed=2), tmp_path / "run.checkpoint", 0
    whole = vg.pack(shape, BOX, **options)
    for _ in range(500):
        packing = vg.pack(shape, BOX, checkpoint=path, resume=True, time_limit=1e-6, **options)
        if packing.stop_reason != "interrupted":
            break
        stops += 1
    assert stops > 3
    assert packing.stop_reason == whole.stop_reason
    assert packing.position.tobytes() == whole.position.tobytes()
    assert packing.provenance["lid_lowered"] == whole.provenance["lid_lowered"]


@pytest.mark.parametrize("gravity", ["-x", "+x", "-y", "+y", "-z", "+z"])
@pytest.mark.parametrize("kind", ["mesh", "sphere", "cylinder", "box"])
def test_grains_enter_any_container_from_any_side(kind, gravity):
    """At the top of a mesh, a sphere or a cylinder that lies there may be no room: grains enter where there is."""
    boxed = vg.Box((3.0, 3.0, 3.1))
    containers = {
        "mesh": vg.ClosedMesh(vg.Shape.from_mesh(*boxed.mesh())),
        "sphere": vg.Sphere(1.9),
        "cylinder": vg.Cylinder(1.6, 3.3),
        "box": boxed,
    }
    options = {
        "method": "digital",
        "settle": False,
        "count": 6,
        "sweeps": 20,
        "cycles": 1,
        "voxel_size": 0.12,
        "gravity": gravity,
    }
    for feed in ("rain", "layers"):
        packing = vg.pack(vg.make_shape("sphere"), containers[kind], feed=feed, **options)
        assert packing.count == 6
        assert vg.verify(packing).ok
