"""Digital filling: exactness of its choice, its rules, two dimensions, what it refuses."""

from functools import partial

import kit
import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran._base.errors import InputError, PackingWarning
from voxgran.packing.digital.fill_method import registration as digital_fill

task_of = partial(kit.task_of, "digital_fill")


def image_of(state, setting):
    """Return how often each voxel of the lattice is taken, from places alone."""
    total = np.zeros(setting.lattice.shape, dtype=int)
    for member, site in zip(state.arrays["member"], state.arrays["site"], strict=True):
        if member >= 0:
            voxels = np.argwhere(setting.oriented.masks[member]) + setting.oriented.record.low[member] + site
            voxels = np.where(setting.room.periodic, voxels % setting.lattice.shape, voxels)
            np.add.at(total, tuple(voxels.T), 1)
    return total


def places_of(taken, setting, member):
    """Return all places, (m, 3), at which the voxels of a member lie on the lattice and none of them is taken."""
    voxels = np.argwhere(setting.oriented.masks[member]) + setting.oriented.record.low[member]
    places = np.argwhere(np.ones(setting.room.places, dtype=bool))
    low, high = places + voxels.min(axis=0), places + voxels.max(axis=0)
    places = places[((low >= 0) & (high < taken.shape)).all(axis=1)]
    for voxel in voxels:
        places = places[taken[tuple((places + voxel).T)] == 0]
    return places


@pytest.mark.parametrize("gravity", [slow("-z"), slow("+z"), slow("-x"), "+y"])
def test_each_grain_takes_the_lowest_place_there_is(gravity):
    shapes = [vg.make_shape("solid_union", seed=2), vg.make_shape("cone")]
    task = task_of(shapes, vg.Box((3, 3, 4)), count=14, voxel_size=0.2, gravity=gravity)
    problem = task.problem
    state = digital_fill.prepare(problem)
    axis, down = "xyz".index(gravity[1]), -1 if gravity[0] == "-" else 1
    while not state.stop_reason:
        before = image_of(state, state.derived["setting"]) if "setting" in state.derived else None
        grain = int(state.arrays["order"][state.done])
        state = digital_fill.advance(problem, state, 1)
        setting = state.derived["setting"]
        if before is None:
            continue
        kind = int(setting.kind[grain])
        heights = [
            -down * places_of(before, setting, member)[:, axis]
            for member in range(setting.first[kind], setting.first[kind + 1])
        ]
        if not any(map(len, heights)):
            assert state.arrays["member"][grain] == -1
        else:
            assert -down * state.arrays["site"][grain, axis] == np.concatenate(heights).min()
    assert image_of(state, setting).max() == 1


@pytest.mark.parametrize("place", ["lowest", "contact", "wall"])
def test_rules_give_packings_without_overlap_until_nothing_fits(place):
    with pytest.warns(PackingWarning):
        packing = vg.pack(
            [vg.make_shape("sphere"), vg.make_shape("box", lengths=(0.8, 0.8, 0.8))],
            vg.Cylinder(2.5, 5.0),
            method="digital_fill",
            voxel_size=0.125,
            count=110,
            place=place,
            seed=2,
        )
    assert packing.stop_reason == "full"
    assert vg.verify(packing).ok
    # touched voxels, eight per diameter: wide gaps
    assert packing.solid_fraction > 0.2
    radius = np.hypot(packing.position[:, 0], packing.position[:, 1])
    if place == "wall":
        # the first layer lies at the wall
        assert np.count_nonzero((radius > 1.7) | (np.abs(packing.position[:, 2] - 2.5) > 1.7)) > 0.6 * packing.count


def test_a_thousand_spheres_find_a_place():
    with pytest.warns(PackingWarning, match="overlap by up to 0.0"):
        packing = vg.pack(
            vg.make_shape("sphere"),
            vg.Box((10, 10, 10)),
            method="digital_fill",
            count=1000,
            voxel_size=0.05,
            cover="center",
            turned=False,
            seed=4,
        )
    assert packing.count == 1000
    # one orientation: each placement updates one map, but for the last
    assert packing.provenance["counters"]["map_updates"] == 999
    # disordered: the heights of the second layer are not all the same
    heights = packing.position[:, 2]
    second = heights[(heights > 1.0) & (heights < 1.6)]
    assert np.ptp(second) > 0.3


def test_the_largest_come_first_when_asked():
    shapes = [vg.make_shape("sphere"), vg.make_shape("sphere").scaled(0.6), vg.make_shape("box").scaled(1.3)]
    task = task_of(shapes, vg.Box((5, 5, 6)), count=30, order="largest", voxel_size=0.125)
    state = digital_fill.prepare(task.problem)
    volumes = task.problem.volumes[state.arrays["order"]]
    assert (np.diff(volumes) <= 0).all()
    assert sorted(state.arrays["order"]) == list(range(30))
    other = task_of(shapes, vg.Box((5, 5, 6)), count=30, order="random", voxel_size=0.125)
    assert (np.diff(other.problem.volumes[digital_fill.prepare(other.problem).arrays["order"]]) > 0).any()


def test_two_dimensions_and_periodic_sides():
    bend = vg.make_shape("polygon", corners=5)
    packing = vg.pack(
        [vg.make_shape("disk"), bend],
        vg.Rectangle((9, 9), periodic=(True, False)),
        method="digital_fill",
        count=60,
        voxel_size=1 / 24,
        seed=3,
    )
    assert packing.count == 60
    assert np.all(packing.position[:, 2] == 0)
    assert vg.verify(packing).ok
    assert packing.solid_fraction > 0.55


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"gravity": "none"}, "lowest place needs a direction"),
        ({"place": "highest"}, "place"),
        ({"orientations": 0}, "orientations"),
    ],
)
def test_bad_parameters_are_named(parameters, words):
    with pytest.raises(InputError, match=words):
        vg.pack(vg.make_shape("sphere"), vg.Box((4, 4, 4)), method="digital_fill", count=2, **parameters)


def test_a_container_without_walls_has_none_to_be_near_to():
    box = vg.Box((4, 4, 4), (True, True, True))
    with pytest.raises(InputError, match="has none"):
        vg.pack(vg.make_shape("sphere"), box, method="digital_fill", count=2, place="wall")


@pytest.mark.parametrize("place", ["lowest", "contact"])
def test_maps_made_again_are_those_that_were_kept(place):
    """Also where some kinds find no place any more while others still do."""
    shapes = [vg.make_shape("sphere", diameter=size) for size in (*6 * [0.4], 1.0, 2.0)]
    runs = []
    for again in (False, True):
        problem = task_of(
            shapes, vg.Box((3, 3, 3), (True, False, False)), count=40, voxel_size=0.125, place=place
        ).problem
        state = digital_fill.prepare(problem)
        while not state.stop_reason:
            state = digital_fill.advance(problem, state, 1)
            if again:
                state.derived = {}
        assert vg.verify(digital_fill.finish(problem, state)).ok
        runs.append((state.arrays["site"].tobytes(), state.arrays["member"].tobytes(), state.counters))
    assert runs[0] == runs[1]
    came = state.arrays["member"][state.arrays["order"]] >= 0
    # some come after others have found no place
    assert (np.diff(came.astype(int)) > 0).any()
