"""How grains enter control-point packing, where down is, vibration, and the lid."""

import kit
import numpy as np
import pytest
from kit import run, slow

import voxgran as vg
from voxgran._base.errors import GrainTooLargeError, InputError
from voxgran._base.seeds import philox_key
from voxgran.packing.control_point.attempts import GROWTH
from voxgran.packing.control_point.method import LID_STEP
from voxgran.packing.control_point.method import registration as control_point
from voxgran.packing.walking.feeding import LAYER_REFUSALS

BOX = vg.Box((4, 4, 6))


def task_of(shapes, container=BOX, *, count=20, **parameters):
    usual = {"spacing": 0.25, "sweeps": 200, "cycles": None if "period" in parameters else 2}
    return kit.task_of("control_point", shapes, container, count=count, **{**usual, **parameters})


def stay_apart(packing):
    """Return whether grains overlap no deeper than their edges may between points a spacing of 0.25 apart."""
    proof = vg.verify(packing)
    return proof.deepest < 0.125 and proof.largest_escape < 0.125


def unit(word):
    """Return a word of the random stream as a number from 0 to 1."""
    return (int(word) >> 11) / 2.0**53


def words_of(problem, attempt, draw):
    key = philox_key(problem.seed, "control_point")
    return np.random.Philox(key=key, counter=[attempt - 1, draw, 0, 0]).random_raw(4)


WAYS = [
    {"gravity": (0.3, 0.2, -1.0)},
    {"period": 50, "decay": 0.7},
    {"feed": "layers"},
    {"rate": 0.5},
    {"lid": True},
    {"feed": "layers", "layer_sweeps": 15, "lid": True, "decay": 0.5, "gravity": (-1.0, 0.0, 0.4)},
]


@pytest.mark.parametrize("way", [slow(way) if way in WAYS[1:5:3] else way for way in WAYS], ids=str)
def test_every_way_keeps_its_promises(way):
    shapes = [vg.make_shape("solid_union", seed=2), vg.make_shape("box", lengths=(1.1, 0.8, 0.6))]
    state, packing = run(task_of(shapes, **way))
    assert packing.count == 20
    # edges that rock between points may keep a bed from ever being still
    assert state.stop_reason in {"count", "steps"}
    assert stay_apart(packing)
    # chunks do not matter
    again = run(task_of(shapes, **way), chunk=777)[1]
    assert again.position.tobytes() == packing.position.tobytes()
    assert again.orientation.tobytes() == packing.orientation.tobytes()
    assert again.provenance["lid_lowered"] == packing.provenance["lid_lowered"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("container", "way"),
    [
        (vg.Cylinder(2.2, 6), {"feed": "layers"}), (vg.Box((5, 5, 6), "y"), {"lid": True}),
        slow(vg.Cylinder(2.2, 6), {"lid": True}), slow(vg.Box((5, 5, 6), "xy"), {"feed": "layers"}),
    ],
    ids=str,
)  # fmt: skip
def test_periodic_and_round_containers_take_every_way(container, way):
    _, packing = run(task_of(vg.make_shape("cone"), container, count=12, **way))
    assert packing.count == 12
    assert stay_apart(packing)


@pytest.mark.parametrize(
    "way", [{"feed": "layers"}, {"lid": True}, {"gravity": (0.4, -1.0, 0.0), "lid": True}], ids=str
)
def test_every_way_works_in_the_plane(way):
    shapes = [vg.make_shape("disk"), vg.make_shape("polygon", seed=1)]
    _, packing = run(task_of(shapes, vg.Rectangle((7, 14)), **way))
    assert packing.count == 20
    assert stay_apart(packing)
    assert np.all(packing.position[:, 2] == 0)
    top = max(packing.world_vertices(g)[:, 1].max() for g in range(20))
    gap = 14 - packing.provenance["lid_lowered"] - top
    assert -1e-9 < gap < (2 * LID_STEP if way.get("lid") else 14)


def test_gravity_in_any_direction_piles_grains_up_there():
    packing = run(task_of(vg.make_shape("sphere"), vg.Box((5, 5, 5)), gravity=(1.0, 0.0, -1.0), vibration_up=0.0))[1]
    along = (packing.position - 2.5) @ np.array([1.0, 0.0, -1.0])
    # the grains fell along gravity, into a heap that is steep
    assert along.min() > -1.5
    assert along.mean() > 1.5
    assert packing.provenance["parameters"]["gravity"] == [1.0, 0.0, -1.0]


def test_a_vector_along_an_axis_is_that_axis():
    told = [run(task_of(vg.make_shape("cone"), gravity=way))[1] for way in ("-x", (-2.5, 0.0, 0.0))]
    assert told[0].position.tobytes() == told[1].position.tobytes()


@pytest.mark.parametrize("gravity", ["+x", (-1.0, 0.3, 0.2)])
def test_grains_enter_a_cylinder_that_lies(gravity):
    """Its side has no room for a whole grain."""
    packing = run(task_of(vg.make_shape("sphere"), vg.Cylinder(2.0, 5), gravity=gravity, count=12))[1]
    assert packing.count == 12
    assert stay_apart(packing)
    assert (packing.position[:, 0].mean() < 0) == (gravity != "+x")


def test_a_free_grain_falls_as_a_plain_program_says():
    """One grain far from all walls: gravity as a vector, cycles by their period, and what they keep by decay."""
    gravity, sweeps, period, decay, up, tilt = np.array([0.6, 0.0, -0.8]), 240, 60, 0.6, 0.9, 0.5
    told = {"gravity": (1.5, 0.0, -2.0), "period": period, "decay": decay, "vibration_up": up, "gravity_bias": tilt}
    told |= {"feed": "at_once", "rotation_share": 0.0, "sweeps": sweeps}
    problem = task_of(vg.make_shape("sphere"), vg.Box((60, 60, 60)), count=1, seed=5, **told).problem
    state = control_point.advance(problem, control_point.prepare(problem), 1)
    assert state.feeding_ended_at == 1
    state.arrays["position"][:] = 30.0
    # cells are made anew
    state.derived = {}
    place, step, longest, went_up = np.full(3, 30.0), float(state.arrays["step"][0]), 1 / 12, 0
    for attempt in range(1, 1 + sweeps + 20):
        w, more = words_of(problem, attempt, 0), words_of(problem, attempt, 1)
        c, angle = 2 * unit(w[1]) - 1, 2 * np.pi * unit(w[2])
        way = np.array([np.sqrt(1 - c * c) * np.cos(angle), np.sqrt(1 - c * c) * np.sin(angle), c])
        cycle, into = divmod(attempt - 1, period)
        share = up * decay**cycle * (1 - into / period) if attempt - 1 < sweeps else 0.0
        if unit(more[1]) >= share:
            along = way @ gravity
            way = way + (tilt + max(0.0, -2 * along)) * gravity
        went_up += way @ gravity < 0
        place = place + step * (1 - unit(w[3])) * way / np.linalg.norm(way)
        step = min(step * GROWTH, longest)
    state = control_point.advance(problem, state, sweeps + 20)
    assert state.arrays["position"][0] == pytest.approx(place, abs=1e-9)
    assert 5 < went_up < sweeps / 2


@pytest.mark.parametrize("rate", [0.05, 0.3, 1.0])
def test_the_rate_is_the_share_of_attempts_that_feed(rate):
    problem = task_of(vg.make_shape("sphere"), vg.Box((30, 30, 30)), count=400, rate=rate).problem
    state = control_point.advance(problem, control_point.prepare(problem), 300)
    # the first one always
    expected = 1 + sum(unit(words_of(problem, attempt, 1)[0]) < rate for attempt in range(1, 300))
    assert state.counters["feeds_tried"] == expected
    assert state.counters["moves_tried"] == 300 - expected


def test_layers_enter_at_once_and_then_sink():
    problem = task_of(vg.make_shape("sphere"), vg.Box((4, 4, 9)), count=30, feed="layers", layer_sweeps=25).problem
    state, layers, before = control_point.prepare(problem), [], 0
    while state.feeding_ended_at is None:
        while state.layer_ends is None and state.feeding_ended_at is None:
            state = control_point.advance(problem, state, 1)
        placed, moves = state.counters["placed"], state.counters["moves_tried"]
        layers.append(placed - before)
        # a layer enters while nothing moves
        assert moves == 25 * sum(np.cumsum(layers)[:-1])
        if state.feeding_ended_at is None:
            assert state.counters["feeds_refused_in_a_row"] == LAYER_REFUSALS
            top = 9 - state.arrays["position"][state.arrays["entered"] == 1, 2].max()
            assert top == pytest.approx(0.5, abs=0.02)
            state = control_point.advance(problem, state, 25 * placed)
            assert state.counters["placed"] == placed
            assert state.layer_ends is None
        before = placed
    assert len(layers) >= 3
    assert sum(layers) == 30
    # no more spheres than touch each other side by side on 4 by 4
    assert max(layers) <= 16


def in_the_room_left(packing, container):
    """Return whether the packing is a valid one of the container that the lid has left."""
    moved = vg.Packing.of(
        packing.shapes,
        container,
        position=packing.position,
        scale=packing.scale,
        shape_id=packing.shape_id,
        orientation=packing.orientation,
    )
    return stay_apart(moved)


@pytest.mark.parametrize("shape", ["sphere", "octahedron"])
def test_a_lid_lies_on_the_bed_and_is_recorded(shape):
    shape = vg.make_shape("sphere") if shape == "sphere" else vg.make_shape("platonic", solid="octahedron")
    told = {"count": 40, "sweeps": 800}
    free, held = (run(task_of(shape, vg.Box((4, 4, 8)), lid=lid, **told))[1] for lid in (False, True))
    lowered = held.provenance["lid_lowered"]
    assert in_the_room_left(held, vg.Box((4, 4, 8 - lowered)))
    assert free.provenance["lid_lowered"] == 0
    tops = [max(p.world_vertices(g)[:, 2].max() for g in range(40)) for p in (free, held)]
    assert tops[1] < tops[0] + 0.5
    assert 8 - lowered - tops[1] < 2 * LID_STEP


def test_a_lid_comes_down_by_small_steps_from_any_side():
    problem = task_of(vg.make_shape("cone"), vg.Box((5, 4, 4)), count=10, gravity=(1.0, 0.2, 0.0), lid=True).problem
    state = control_point.prepare(problem)
    while state.feeding_ended_at is None:
        state = control_point.advance(problem, state, 1)
    before, ways = 0.0, []
    for _ in range(150):
        state = control_point.advance(problem, state, 10)
        lowered = state.lid_lowered
        left = control_point.finish(problem, state)
        nearest = min(left.world_vertices(g)[:, 0].min() for g in range(10)) / problem.unit_length
        # no grain is in its way
        assert lowered < nearest
        ways.append(lowered - before)
        before = lowered
    assert min(ways) >= 0.0
    assert max(ways) == pytest.approx(LID_STEP)
    assert sum(way < LID_STEP / 2 for way in ways) > 5


def test_the_walk_goes_on_until_the_lid_lies_on_the_bed():
    state, packing = run(task_of(vg.make_shape("sphere"), vg.Box((3, 3, 14)), count=6, lid=True, sweeps=20))
    assert state.stop_reason == "count"
    assert 14 - packing.provenance["lid_lowered"] == pytest.approx(packing.position[:, 2].max() + 0.5, abs=2 * LID_STEP)


@pytest.mark.parametrize("kind", ["cylinder", "lying", slow("sphere")])
def test_a_lid_in_any_container(kind):
    sphere = vg.make_shape("sphere").scaled(4.6)
    container = {
        "cylinder": vg.Cylinder(1.8, 6),
        "lying": vg.Cylinder(2.2, 3),
        "sphere": vg.ClosedMesh(vg.Shape.from_mesh(sphere.vertices + 3.0, sphere.faces)),
    }[kind]
    axis = 0 if kind == "lying" else 2
    gravity = "-x" if kind == "lying" else "-z"
    _, packing = run(task_of(vg.make_shape("cone"), container, count=8, lid=True, gravity=gravity))
    assert packing.count == 8
    assert stay_apart(packing)
    top = max(packing.world_vertices(g)[:, axis].max() for g in range(8))
    gap = container.bounds[1][axis] - packing.provenance["lid_lowered"] - top
    assert -1e-12 < gap < 2 * LID_STEP
    assert packing.provenance["lid_lowered"] > 0.3


@pytest.mark.filterwarnings("ignore:.*pairs of grains overlap")
def test_a_lid_closes_a_bed_that_was_there_from_the_beginning():
    shape, told = (
        vg.make_shape("cone"),
        {"method": "control_point", "settle": False, "spacing": 0.25, "sweeps": 100, "cycles": 1},
    )
    bed = vg.pack(shape, BOX, count=15, **told)
    closed = vg.pack([], BOX, start=bed, lid=True, vibration_up=0.0, **told)
    assert bed.provenance["lid_lowered"] == 0
    assert in_the_room_left(closed, vg.Box((4, 4, 6 - closed.provenance["lid_lowered"])))
    assert closed.provenance["lid_lowered"] > 2.0


def test_the_way_of_the_lid_is_in_the_unit_of_lengths():
    ways = []
    for factor in (1.0, 2.0**20):
        shape, box = vg.make_shape("cone").scaled(factor), vg.Box((4 * factor, 4 * factor, 6 * factor))
        ways.append(run(task_of(shape, box, count=8, lid=True))[1].provenance["lid_lowered"] / factor)
    assert ways[0] == ways[1] > 1.0


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*pairs of grains overlap")
@pytest.mark.parametrize("way", [slow({"lid": True}), slow({"feed": "layers"}), {"gravity": (0.5, 0.0, -1.0)}], ids=str)
def test_every_way_goes_on_after_a_stop_to_the_same_bits(way, tmp_path, monkeypatch):
    monkeypatch.setattr("voxgran.packing.driver.FIRST_CHUNK", 1000)
    told = {
        "method": "control_point",
        "settle": False,
        "count": 12,
        "spacing": 0.25,
        "sweeps": 200,
        "cycles": 2,
        "seed": 3,
        **way,
    }
    shape, path, stops = vg.make_shape("solid_union", seed=2), tmp_path / "run.checkpoint", 0
    whole = vg.pack(shape, BOX, **told)
    for _ in range(500):
        packing = vg.pack(shape, BOX, checkpoint=path, resume=True, time_limit=1e-6, **told)
        if packing.stop_reason != "interrupted":
            break
        stops += 1
    assert stops > 3
    assert packing.stop_reason == whole.stop_reason
    assert packing.position.tobytes() == whole.position.tobytes()
    assert packing.provenance["lid_lowered"] == whole.provenance["lid_lowered"]


class Other:
    """A container of a kind that voxgran does not have."""

    kind = "other"
    boundary = None

    def __init__(self, box):
        self.box = box

    def __getattr__(self, name):
        return getattr(self.box, name)

    def scaled(self, factor):
        return Other(self.box.scaled(factor))


def test_a_container_of_an_unknown_kind_is_refused_and_its_mesh_is_not():
    with pytest.raises(
        InputError, match="container is of type Other, known by its signed distance only, which method 'control_point'"
    ):
        run(task_of(vg.make_shape("sphere"), Other(BOX), count=2))
    mesh = vg.ClosedMesh(vg.Shape.from_mesh(*Other(BOX).mesh()))
    _, packing = run(task_of(vg.make_shape("sphere"), mesh, count=2, lid=True))
    assert packing.count == 2
    assert stay_apart(packing)


@pytest.mark.parametrize("contact", ["sdf", "kdtree"])
@pytest.mark.parametrize("feed", ["rain", "at_once"])
def test_a_sphere_as_wide_as_the_container_enters(contact, feed):
    for size, room in ((1.0, vg.Box((1, 1, 1))), (0.1, vg.Box((0.1, 0.1, 0.2))), (7.3, vg.Cylinder(7.3 / 2, 7.3))):
        packing = vg.pack(
            vg.make_shape("sphere", diameter=size), room, method="control_point", count=1, sweeps=20,
            contact=contact, feed=feed, settle=False,
        )  # fmt: skip
        assert packing.count == 1
        assert stay_apart(packing)
        with pytest.raises(GrainTooLargeError):
            vg.pack(vg.make_shape("sphere", diameter=size * (1 + 1e-9)), room, method="control_point", count=1)
