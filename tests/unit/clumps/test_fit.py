import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError, UnknownNameError
from voxgran._base.tree import grow_tree
from voxgran.clumps.errors import clump_errors
from voxgran.clumps.fit import clump_methods, fit_clump
from voxgran.clumps.methods.inscribed import _choose, _maximal
from voxgran.lattice.distance import inside_distance
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.spheres import Spheres
from voxgran.shapes.tessellate import unit_box
from voxgran.voxels.model import Voxels
from voxgran.voxels.occupy import voxelize


@pytest.fixture(scope="module")
def fifty(eros):
    return fit_clump(eros, max_spheres=50)


def test_fifty_spheres_stand_for_a_scanned_rock(eros, fifty):
    assert fifty.count == 50
    assert fifty.shape is eros
    assert fifty.errors.iou >= 0.86
    assert fifty.errors.centroid < 0.01
    assert fifty.errors.surface_mean < 0.025
    assert fifty.errors.surface_max < 0.08


def test_spheres_are_inscribed(eros, fifty):
    voxel = eros.diameter / 64
    room = -grow_tree(eros.vertices, eros.faces).nearest(fifty.centers)[0]
    assert (fifty.radii <= room + 0.5 * np.sqrt(3) * voxel).all()
    assert (fifty.radii >= room - 1.5 * voxel).all()


def test_errors_agree_with_the_union_of_the_spheres(eros, fifty):
    union = fifty.to_shape()
    assert fifty.errors.volume == pytest.approx(union.volume / eros.volume - 1)
    assert fifty.errors.volume == pytest.approx(fifty.errors.iou - 1, abs=5e-3)
    # volume by counting on a lattice of its own
    counted = voxelize(union, voxel_size=eros.diameter / 61).volume
    assert counted == pytest.approx(union.volume, rel=2e-3)
    assert np.linalg.norm(union.offset) / eros.diameter == pytest.approx(fifty.errors.centroid)


def test_the_same_call_gives_the_same_spheres(eros, fifty):
    again = fit_clump(eros, max_spheres=50)
    assert np.array_equal(again.centers, fifty.centers)
    assert np.array_equal(again.radii, fifty.radii)
    assert again.errors == fifty.errors


def test_fewer_spheres_are_the_first_of_more(eros, fifty):
    ten = fit_clump(eros, max_spheres=10)
    assert np.array_equal(ten.radii, fifty.radii[:10])
    assert ten.errors.iou < fifty.errors.iou


def test_the_target_is_reached_and_no_sphere_too_many(eros):
    clump = fit_clump(eros, target=0.8)
    assert clump.errors.iou >= 0.8
    assert fit_clump(eros, max_spheres=clump.count - 1).errors.iou < 0.8
    assert fit_clump(eros, target=0.8, max_spheres=5).count == 5


def test_the_tolerance_is_how_far_the_solid_sticks_out(eros):
    clump = fit_clump(eros, tolerance=0.05)
    centers = voxelize(eros, voxel_size=eros.diameter / 64)
    points = centers.grid.coordinates(np.argwhere(centers.mask))

    def farthest(count):
        gaps = np.linalg.norm(points[:, None] - clump.centers[None, :count], axis=2) - clump.radii[:count]
        return gaps.min(axis=1).max() / eros.diameter

    assert farthest(clump.count) <= 0.05 < farthest(clump.count - 1)


def test_the_greedy_choice_is_that_of_a_plain_search():
    solid = Shape.of(
        Spheres(np.array([[0, 0, 0], [0.9, 0.1, 0], [0.2, 0.8, 0.1]]), np.array([0.6, 0.5, 0.4])), name="s"
    )
    voxels = voxelize(solid, voxel_size=0.13)
    clump = fit_clump(voxels, max_spheres=6)
    room = inside_distance(voxels.mask, 1.0)
    places = np.argwhere(_maximal.plain(np.pad(room, 1)))
    order = np.argsort(-room[tuple(places.T)], kind="stable")
    places = places[order]
    left = {tuple(v) for v in np.argwhere(voxels.mask)}
    spheres = [
        {tuple(v) for v in np.argwhere(voxels.mask) if ((v - p) ** 2).sum() <= room[tuple(p)] ** 2 * (1 + 1e-12)}
        for p in places
    ]
    chosen = []
    for _ in range(6):
        best = int(np.argmax([len(sphere & left) for sphere in spheres]))
        left -= spheres[best]
        chosen.append(best)
    found = clump.centers + np.array(clump.shape.offset)
    assert np.allclose(found, voxels.grid.coordinates(places[chosen]))
    assert np.allclose(clump.radii, room[tuple(places[chosen].T)] * 0.13)


def test_kernels_agree_with_plain_python():
    mask = np.zeros((9, 8, 7), dtype=bool)
    mask[1:8, 1:7, 1:6] = True
    mask[6:, 4:, :] = False
    room = inside_distance(mask, 1.0)
    keep = _maximal(np.pad(room, 1))
    assert np.array_equal(keep, _maximal.plain(np.pad(room, 1)))
    places = np.argwhere(keep)
    radii = room[keep]
    fast, plain = np.zeros(5, np.int64), np.zeros(5, np.int64)
    counts = [
        choose(places, radii, mask.copy(), 10**6, 0.8, out) for choose, out in ((_choose, fast), (_choose.plain, plain))
    ]
    assert counts[0] == counts[1]
    assert np.array_equal(fast, plain)


@pytest.mark.parametrize("resolution", [32, 64])
def test_voxels_give_nearly_the_clump_of_the_mesh(eros, fifty, resolution):
    voxels = voxelize(eros, voxel_size=eros.diameter / resolution)
    clump = fit_clump(voxels, max_spheres=50)
    assert clump.count == 50
    assert clump.shape.volume == pytest.approx(voxels.volume, rel=0.01)
    assert clump.shape.volume == pytest.approx(eros.volume, rel=0.01)
    assert clump.errors.iou == pytest.approx(fifty.errors.iou, abs=0.04 if resolution == 32 else 0.005)


def test_a_cavity_stays_a_cavity():
    vertices, faces, _ = unit_box()
    both = np.concatenate([vertices * 2, vertices])
    shell = Shape.of(Mesh(both, np.concatenate([faces, faces[:, ::-1] + 8])), name="shell")
    voxels = voxelize(shell, voxel_size=0.1)
    assert voxels.mask.sum() == 20**3 - 10**3
    clump = fit_clump(voxels, max_spheres=30)
    assert clump.shape.volume == pytest.approx(7.0, rel=0.02)
    assert (np.linalg.norm(clump.centers, axis=1) > 0.5).all()


def test_a_clump_of_its_own_spheres_has_no_error():
    shape = Shape.of(Spheres(np.array([[0, 0, 0], [0.7, 0.1, 0]]), np.array([0.5, 0.4])), name="two")
    voxels = voxelize(shape, voxel_size=shape.diameter / 48)
    errors = clump_errors(voxels, shape, shape.geometry)
    assert errors.iou == 1
    assert abs(errors.volume) < 1e-12
    assert errors.centroid < 1e-12
    assert errors.inertia < 1e-12
    # distances see the tessellation of the body
    assert errors.surface_max <= 2 * shape.tessellation_error / shape.diameter + 0.02
    assert errors.surface_mean <= shape.tessellation_error / shape.diameter + 1e-3
    assert set(errors.to_mapping()) >= {"iou", "volume", "centroid", "inertia", "surface_mean", "surface_max"}


def test_errors_of_a_sphere_grown_by_a_tenth_are_known():
    sphere = vg.make_shape("sphere")
    voxels = voxelize(sphere, voxel_size=1 / 48)
    errors = clump_errors(voxels, sphere, Spheres(np.array([[0.0, 0, 0]]), np.array([0.55])))
    assert errors.volume == pytest.approx(0.331)
    assert errors.inertia == pytest.approx(1.1**5 - 1)
    # an empty layer around the voxels is all that the larger sphere can be counted in
    assert 1 / 1.331 - 1e-2 <= errors.iou < 0.85
    assert errors.surface_mean == pytest.approx(0.05, abs=2e-3)
    assert errors.surface_max == pytest.approx(0.05, abs=4e-3)


def test_bad_input_is_refused(eros):
    assert clump_methods() == ("inscribed",)
    with pytest.raises(UnknownNameError, match="inscribed"):
        fit_clump(eros, method="inscribd")
    with pytest.raises(UnknownNameError, match="min_radius"):
        fit_clump(eros, min_radios=1)
    with pytest.raises(InputError, match="min_radius"):
        fit_clump(eros, min_radius=-1.0)
    with pytest.raises(InputError, match="max_spheres"):
        fit_clump(eros, max_spheres=0)
    with pytest.raises(InputError, match="target"):
        fit_clump(eros, target=1.5)
    with pytest.raises(InputError, match="no sphere"):
        fit_clump(eros, min_radius=1000.0)
    with pytest.raises(InputError, match="flat"):
        fit_clump(vg.make_shape("disk"))
    mask = np.zeros((9, 5, 5), dtype=bool)
    mask[1:3, 1:4, 1:4] = mask[5:8, 1:4, 1:4] = True
    with pytest.raises(InputError, match="2 separate bodies"):
        fit_clump(Voxels(mask, np.zeros(3), 1.0))
    with pytest.raises(InputError, match="solid"):
        fit_clump(Voxels(np.zeros((4, 4, 4), dtype=bool), np.zeros(3), 1.0))
