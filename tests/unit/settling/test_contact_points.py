"""Control points in signed distances: nothing slips through, what overlaps is parted, and what may overlap is told."""

import kit
import numpy as np
import pytest

import voxgran as vg
from voxgran._base.rotation import normalized
from voxgran.contacts.assembly import Assembly
from voxgran.contacts.find import overlaps
from voxgran.packing.control_point.first_contact import Encounter
from voxgran.packing.method import method_registry
from voxgran.settling.settle import part_once


def poses(many, reach, seed=0):
    generator = np.random.Generator(np.random.Philox(seed))
    offset = generator.normal(size=(many, 3))
    offset *= (reach * generator.random(many) / np.linalg.norm(offset, axis=1))[:, None]
    return offset, normalized(generator.normal(size=(2 * many, 4))).reshape(many, 2, 4)


def pair_of(one, other, offset, turns):
    """Return two grains as an assembly."""
    box = vg.Box((40.0, 40.0, 40.0))
    place = np.array([20.0, 20.0, 20.0])
    return Assembly((one, other), np.arange(2), np.ones(2), np.array([place, place + offset]), turns, box)


@pytest.mark.parametrize("partner", ["plate", "sphere", "needle"])
def test_nothing_passes_through_a_plate_thinner_than_the_points_are_apart(partner):
    """Of 400 poses each that overlaps deeper than half the thickness, which all crossings do, is refused."""
    plate = vg.make_shape("box", lengths=(1.6, 1.5, 0.04))
    other = {
        "plate": plate,
        "sphere": vg.make_shape("sphere"),
        "needle": vg.make_shape("box", lengths=(3.0, 0.1, 0.1)),
    }[partner]
    pair, crossing = Encounter(plate, other, spacing=0.3), 0
    for offset, turns in zip(*poses(400, 1.2), strict=True):
        deep = overlaps(pair_of(plate, other, offset, turns), at_least=0.018)
        if len(deep.gap):
            crossing += 1
            assert pair.is_refused(offset, turns)
    assert crossing > 100


@pytest.mark.parametrize("ways", ["both", "one"])
def test_spheres_and_ellipsoids_that_are_not_refused_do_not_overlap(ways):
    one, other = vg.make_shape("ellipsoid", aspect=(1.5, 1.0, 0.8)), vg.make_shape("sphere")
    pair, free = Encounter(one, other, spacing=0.25, ways=ways), 0
    for offset, turns in zip(*poses(400, 1.6), strict=True):
        if not pair.is_refused(offset, turns):
            free += 1
            assert len(overlaps(pair_of(one, other, offset, turns), at_least=1e-9).gap) == 0
    assert free > 100


def test_grains_overlap_as_deep_as_they_may_at_their_points():
    sphere, box = vg.make_shape("sphere"), vg.Box((4, 4, 9))
    packing = vg.pack(sphere, box, method="control_point", count=30, overlap=0.08, sweeps=600, spacing=0.15)
    gaps = packing.contacts(0.0).gap
    # between points the surface bulges less than is allowed for it
    assert -0.08 <= gaps.min() < -0.06
    assert packing.provenance["parameters"]["overlap"] == 0.08
    assert vg.verify(packing).escaped == 0


@pytest.mark.parametrize("family", ["sphere", "box"])
def test_grains_that_may_overlap_do_not_coincide(family):
    """Thrown in anywhere: no center comes nearer than two grains that overlap as deep as they may."""
    shape = vg.make_shape(family)
    packing = vg.pack(
        *(shape, vg.Box((4, 4, 6))), method="control_point", count=20, overlap=0.05, sweeps=50, feed="at_once",
        gravity="none", spacing=0.2,
    )  # fmt: skip
    apart = np.linalg.norm(packing.position[:, None] - packing.position[None], axis=2) + 9 * np.eye(20)
    assert apart.min() > (0.9 if family == "sphere" else 0.7)


def test_parting_moves_no_more_than_the_overlap():
    """Two cubes 0.01 in each other, and a third that is free: the two part by as much, the third stays."""
    cube = vg.make_shape("box", lengths=(1.0, 1.0, 1.0))
    position = np.array([[2.0, 2.0, 2.0], [2.99, 2.1, 2.05], [6.0, 6.0, 6.0]])
    upright = np.tile([1.0, 0, 0, 0], (3, 1))
    bed = Assembly((cube,), np.zeros(3, dtype=np.int64), np.ones(3), position, upright, vg.Box((8, 8, 8)))
    down, many = np.array([0.0, 0.0, -1.0]), 1
    for _ in range(20):
        bed, many = part_once(bed, down)
        if not many:
            break
    assert many == 0
    moved = np.linalg.norm(bed.position - position, axis=1)
    assert moved[2] == 0
    assert 0.004 < moved[:2].max() < 0.011
    assert len(overlaps(bed, at_least=1e-9).gap) == 0


def test_a_sphere_holds_grains():
    shapes = [vg.make_shape("box"), vg.make_shape("sphere")]
    packing = vg.pack(shapes, vg.Sphere(2.2), method="control_point", count=14, spacing=0.25, sweeps=300)
    assert packing.count == 14
    # edges of boxes between points a spacing of 0.25 apart
    assert vg.verify(packing).deepest < 0.125


def task_of(count, **parameters):
    shapes = [vg.make_shape("sphere"), vg.make_shape("ellipsoid", aspect=(1.2, 1.0, 0.8))]
    sizes = vg.sizes.uniform(0.8, 1.2)
    return kit.task_of("control_point", shapes, vg.Box((7, 7, 14)), count=count, sizes=sizes, **parameters)


def test_a_million_moves_leave_no_drift():
    """Turns stay of length 1, and what the walk takes for free is what verify takes for free."""
    task = task_of(150, spacing=0.3, sweeps=10**6, vibration_up=1.0, decay=1.0, gravity_bias=0.1)
    method = method_registry().get("control_point")
    state = method.prepare(task.problem)
    while state.counters["moves_accepted"] < 1_000_000:
        state = method.advance(task.problem, state, 100_000)
    lengths = np.linalg.norm(state.arrays["orientation"], axis=1)
    assert np.abs(lengths - 1.0).max() < 4e-16
    state.stop_reason = "interrupted"
    packing = method.finish(task.problem, state)
    assert packing.count == 150
    assert vg.verify(packing).ok


@pytest.mark.slow
def test_ten_thousand_grains_of_five_hundred_points_fit_in_memory():
    """The plan is below 4 GB, and so are the arrays of a run."""
    sphere, box = vg.make_shape("sphere"), vg.Box((24, 24, 60))
    task = kit.task_of("control_point", sphere, box, count=10_000, spacing=0.16, sweeps=1)
    method = method_registry().get("control_point")
    assert method.cost(task.problem).memory < 4e9
    state = method.advance(task.problem, method.prepare(task.problem), 200_000)
    kept = state.derived["precomputed"]
    assert len(kept.bodies.trees.points) >= 500
    held = [*kept.cache, *kept.scratch, kept.cells.head, kept.extent, *state.arrays.values()]
    assert sum(array.nbytes for array in held) < 4e8
