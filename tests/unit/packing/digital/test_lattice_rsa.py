"""Random sequential addition on a lattice: against a plain program, its proof of saturation, what it refuses."""

from functools import partial

import kit
import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError, PackingWarning, TooLargeError
from voxgran._base.seeds import philox_key, shuffled
from voxgran.geometry.rotation import rotation_matrices
from voxgran.packing.digital.rsa_method import registration as digital_rsa

task_of = partial(kit.task_of, "digital_rsa")


def test_places_are_those_of_a_plain_program():
    """Each candidate in its order on a label grid: the method as it is told."""
    task = task_of(vg.make_shape("cone"), vg.Box((4, 4, 4), "x"), count=12, voxel_size=0.2)
    problem = task.problem
    state = digital_rsa.prepare(problem)
    setting = state.derived["setting"]
    oriented, places = setting.oriented, setting.places
    taken, found = np.zeros(setting.lattice.shape, dtype=bool), []
    key, size = philox_key(problem.seed, "digital_rsa"), int(setting.bounds[-1])
    tries = 0
    while len(found) < 12:
        candidate = int(shuffled(tries, size, key[0], key[1]))
        tries += 1
        member, rest = divmod(candidate, int(np.prod(places)))
        site = np.array(np.unravel_index(rest, places))
        voxels = np.argwhere(oriented.masks[member]) + oriented.record.low[member] + site
        voxels[:, 0] %= taken.shape[0]
        if voxels.min() < 0 or (voxels >= taken.shape).any() or taken[tuple(voxels.T)].any():
            continue
        taken[tuple(voxels.T)] = True
        found.append((member, *site.tolist()))
    state = digital_rsa.advance(problem, state, 10**9)
    assert state.stop_reason == "count"
    assert state.done == tries
    order = state.arrays["order"]
    assert [(int(state.arrays["member"][g]), *state.arrays["site"][g].tolist()) for g in order] == found


def test_orientations_are_those_of_the_turned_shape():
    task = task_of(vg.make_shape("cone"), vg.Box((4, 4, 4)), count=1, voxel_size=0.1, orientations=2, cover="center")
    problem = task.problem
    setting = digital_rsa.prepare(problem).derived["setting"]
    oriented = setting.oriented
    # a cone along an axis: 6 of the 24 rotations of the lattice look different; the second pose is random
    assert len(oriented.record.at) == 6 + 24
    for k in range(0, 30, 5):
        body = problem.shapes[0].rotated(oriented.orientation[k])
        mask = problem.voxels(0, oriented.orientation[k], setting.lattice.voxel_size, cover="center")
        low, size = oriented.record.low[k] + np.array(mask.shape) // 2, oriented.record.size[k]
        box = mask[tuple(slice(a, a + n) for a, n in zip(low, size, strict=True))]
        # rotated exactly or voxelized anew: round-off may move a center on the surface
        assert np.count_nonzero(box ^ oriented.masks[k]) <= 0.02 * box.sum()
        assert body.volume == pytest.approx(box.sum() * setting.lattice.voxel_size**3, rel=0.1)
        assert np.allclose(np.linalg.det(rotation_matrices(oriented.orientation[k : k + 1])), 1)


def test_saturation_is_proven():
    """An independent probe: no place is left in any orientation."""
    brick = vg.make_shape("box", lengths=(1, 1, 2))
    with pytest.warns(PackingWarning):
        packing = vg.pack(brick, vg.Box((6, 6, 6)), method="digital_rsa", voxel_size=0.25, count=80, cover="center")
    assert packing.stop_reason == "saturated"
    assert packing.provenance["candidates_left"] == 0
    assert vg.verify(packing).ok
    image = np.pad(vg.to_image(packing, 0.25, labels=False), 1, constant_values=True)
    for size in ((4, 4, 8), (4, 8, 4), (8, 4, 4)):
        windows = np.lib.stride_tricks.sliding_window_view(image, size)
        assert windows.any(axis=(3, 4, 5)).all()


def test_several_kinds_and_any_container():
    shapes = [vg.make_shape("sphere"), vg.make_shape("solid_union", seed=2).scaled(0.5)]
    packing = vg.pack(shapes, vg.Cylinder(3, 5), method="digital_rsa", voxel_size=1 / 10, count=60, seed=1)
    assert packing.count == 60
    assert vg.verify(packing).ok
    disks = vg.pack(vg.make_shape("disk"), vg.Rectangle((9, 9), "xy"), method="digital_rsa", voxel_size=1 / 32)
    assert disks.stop_reason == "saturated"
    assert 0.48 < disks.solid_fraction < 0.56
    assert vg.verify(disks).ok


def test_a_lattice_that_is_too_fine_is_refused():
    with pytest.raises(TooLargeError, match="make the voxels larger"):
        vg.pack(vg.make_shape("sphere"), vg.Box((9, 9, 9)), method="digital_rsa", voxel_size=1e-3, count=2)
    with pytest.raises(InputError, match="orientations"):
        vg.pack(vg.make_shape("sphere"), vg.Box((9, 9, 9)), method="digital_rsa", orientations=0, count=2)
