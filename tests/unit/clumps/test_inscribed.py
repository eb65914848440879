import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran.clumps.method import Body
from voxgran.clumps.methods.inscribed import SLACK, Inscribed, _choose, _maximal, _refined, fit
from voxgran.lattice.distance import inside_distance
from voxgran.shapes.model import Shape
from voxgran.shapes.spheres import Spheres


@pytest.fixture(scope="module")
def three():
    solid = Spheres(np.array([[0, 0, 0], [0.9, 0.1, 0], [0.2, 0.8, 0.1]]), np.array([0.6, 0.5, 0.4]))
    return Shape.of(solid, name="three")


def test_spheres_touch_the_surface_from_inside(eros):
    body = Body(eros)
    found = fit(body, 20, Inscribed(), 0)
    assert len(found.radii) == 20
    assert np.allclose(found.radii, body.depth(found.centers), atol=1e-12)


def test_a_tessellated_sphere_has_no_bias():
    shape = vg.make_shape("sphere")
    mesh = vg.Shape.from_mesh(shape.vertices, shape.faces, name="tessellated")
    clump = vg.fit_clump(mesh, method="inscribed", max_spheres=1)
    assert clump.errors.iou > 0.995
    assert abs(clump.errors.volume) < 0.005


def test_the_first_sphere_of_a_box_is_the_largest_inscribed_one():
    clump = vg.fit_clump(vg.make_shape("box", lengths=(1, 2, 3)), method="inscribed", max_spheres=2)
    assert np.allclose(clump.radii, 0.5, atol=1e-3)
    assert np.allclose(clump.centers[:, 0], 0.0, atol=1e-3)


def test_refinement_climbs_to_the_middle_along_the_medial_surface():
    body = Body(vg.make_shape("box", lengths=(1, 1, 4)))
    thickness = body.shape.bounds[1, 0]
    start = np.array([[0.007, -0.004, 0.3], [-0.003, 0.006, -0.5]])
    centers, radii = _refined(body, start, body.depth(start), 1 / 64)
    assert np.allclose(radii, thickness, atol=2e-4)
    assert np.allclose(centers[:, 2], start[:, 2], atol=1e-12)


def test_the_greedy_choice_is_that_of_a_plain_search(three):
    voxels = Body(three).voxels(12.0)
    room = inside_distance(voxels.mask, 1.0)
    places = np.argwhere(_maximal(room)) + 0.1
    radii = np.random.default_rng(1).uniform(0.9, 1.1, len(places)) * room[tuple(places.astype(int).T)]
    taken = np.full(6, -1)
    _choose(places, radii, voxels.mask.copy(), taken)
    all_voxels = np.argwhere(voxels.mask)
    inside = ((all_voxels[None] - places[:, None]) ** 2).sum(axis=2) <= radii[:, None] ** 2
    left = np.ones(len(all_voxels), dtype=bool)
    for chosen in taken:
        gains = (inside & left).sum(axis=1)
        assert gains[chosen] == gains.max()
        left &= ~inside[chosen]


def test_kernels_agree_with_plain_python():
    mask = np.zeros((9, 8, 7), dtype=bool)
    mask[1:8, 1:7, 1:6] = True
    mask[6:, 4:, :] = False
    room = inside_distance(mask, 1.0)
    keep, padded = _maximal(room), np.pad(room, 1)
    for place in np.argwhere(room > 0):
        around = padded[tuple(slice(k, k + 3) for k in place)] - np.linalg.norm(np.indices((3, 3, 3)) - 1.0, axis=0)
        assert keep[tuple(place)] == (np.delete(around.ravel(), 13) < room[tuple(place)] - SLACK).all()
    assert not keep[room == 0].any()
    places, radii = np.argwhere(keep) + 0.25, room[keep]
    fast, plain = np.full(5, -1), np.full(5, -1)
    _choose(places, radii, mask.copy(), fast)
    _choose.plain(places, radii, mask.copy(), plain)
    assert np.array_equal(fast, plain)
    assert (fast >= 0).any()


def test_the_smallest_radius_limits_the_number():
    cube = vg.make_shape("box", lengths=(1, 1, 1))
    found = fit(Body(cube), 50, Inscribed(min_radius=0.39), 0)
    assert 1 <= len(found.radii) < 50
    assert (found.radii >= 0.39).all()
    assert "min_radius" in found.reason
    with pytest.raises(InputError, match="min_radius"):
        vg.fit_clump(cube, method="inscribed", min_radius=0.45)


def test_bad_parameters_are_refused():
    with pytest.raises(InputError, match="min_radius"):
        Inscribed(min_radius=-0.1)
    with pytest.raises(InputError, match="resolution"):
        Inscribed(resolution=2)
