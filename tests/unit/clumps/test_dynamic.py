import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran.clumps.method import Body
from voxgran.clumps.methods.dynamic import Dynamic, _forces, _hidden, fit


def test_forces_are_those_of_a_plain_loop():
    generator = np.random.default_rng(0)
    points, centers = generator.normal(size=(50, 3)), generator.normal(size=(4, 3))
    radii = generator.uniform(0.2, 0.6, 4)
    pull, push, mass = np.zeros((4, 3)), np.zeros(4), np.zeros(4)
    for point in points:
        gaps = [np.linalg.norm(point - center) - radius for center, radius in zip(centers, radii, strict=True)]
        owner = int(np.argmin(gaps))
        direction = (point - centers[owner]) / np.linalg.norm(point - centers[owner])
        pull[owner] += gaps[owner] * direction
        push[owner] += gaps[owner]
        mass[owner] += 1
    found = _forces(points, centers, radii)
    assert np.allclose(found[0], pull / np.maximum(mass, 1)[:, None])
    assert np.allclose(found[1], push / np.maximum(mass, 1))


def test_a_sphere_is_in_equilibrium_on_a_sphere():
    generator = np.random.default_rng(0)
    points = generator.normal(size=(500, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    pull, push = _forces(points, np.zeros((1, 3)), np.ones(1))
    assert np.abs(pull).max() < 1e-12
    assert np.abs(push).max() < 1e-12
    # a sphere too small grows, one off center is drawn back
    assert _forces(points, np.zeros((1, 3)), np.array([0.8]))[1][0] == pytest.approx(0.2)
    assert _forces(points, np.array([[0.3, 0.0, 0.0]]), np.ones(1))[0][0, 0] < 0


def test_spheres_within_others_are_found_and_of_equal_ones_the_second():
    centers = np.array([[0.0, 0, 0], [0.2, 0, 0], [3.0, 0, 0], [3.0, 0, 0], [1.0, 0, 0]])
    assert _hidden(centers, np.array([1.0, 0.5, 1.0, 1.0, 0.5])).tolist() == [1, 3]


def test_more_steps_lower_the_error(eros):
    errors = [vg.fit_clump(eros, method="dynamic", max_spheres=30, steps=n).errors for n in (1, 20, 300)]
    assert errors[0].iou < errors[1].iou < errors[2].iou
    assert errors[2].iou > 0.9
    assert abs(errors[2].volume) < 0.02


def test_centers_stay_inside_a_body_with_cavities_and_thin_walls(data_dir):
    body = Body(vg.load_shape(data_dir / "bennu_lp.obj"))
    found = fit(body, 40, Dynamic(), 3)
    assert (body.depth(found.centers) > 0).all()
    assert (found.radii >= 0.02).all()


def test_seeds_differ(eros):
    found = [fit(Body(eros), 5, Dynamic(steps=5), seed) for seed in (0, 1)]
    assert not np.allclose(found[0].centers, found[1].centers)


def test_fewer_spheres_fit_with_a_reason_if_none_is_large_enough():
    thin = Body(vg.make_shape("box", lengths=(1, 1, 0.2)))
    found = fit(thin, 5, Dynamic(min_radius=0.3), 0)
    assert len(found.radii) == 0
    assert "min_radius" in found.reason


def test_bad_parameters_are_refused():
    for wrong in ({"steps": 0}, {"damping": 0.0}, {"min_radius": 0.0}):
        with pytest.raises(InputError, match=next(iter(wrong))):
            Dynamic(**wrong)
