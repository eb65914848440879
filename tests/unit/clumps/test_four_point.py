import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran.clumps.method import Body
from voxgran.clumps.methods.four_point import FourPoint, _fitted, _through_four, fit
from voxgran.clumps.sphere_sets import SphereSet


def test_spheres_pass_through_points_of_the_surface(eros):
    points = Body(eros).surface(1000, seed=0).points
    drawn = _through_four(points, 60, seed=0)
    assert len(drawn) > 30
    off = np.abs(np.linalg.norm(points[None] - drawn.centers[:, None], axis=2) - drawn.radii[:, None])
    assert (np.sort(off, axis=1)[:, :4] < 1e-6).all()


def test_four_points_of_a_sphere_give_that_sphere():
    generator = np.random.default_rng(0)
    directions = generator.normal(size=(500, 3))
    points = [0.1, 0.2, -0.1] + 0.3 * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    drawn = _through_four(points, 200, seed=0)
    assert np.allclose(drawn.radii, 0.3, atol=1e-6)
    assert np.allclose(drawn.centers, [0.1, 0.2, -0.1], atol=1e-6)


def test_a_sphere_that_protrudes_is_moved_until_it_fits():
    body = Body(vg.make_shape("box", lengths=(1, 1, 1)))
    half = body.shape.bounds[1, 0]
    points = body.surface(20_000, seed=0).points
    start = SphereSet(np.array([[half - 0.1, 0.0, 0.0]]), np.array([0.2]))
    fitted = _fitted(body, points, start, 0.0)
    # it moves by as much as it shrinks
    assert fitted.radii[0] == pytest.approx(0.15, abs=0.002)
    assert np.allclose(fitted.centers[0], [half - 0.15, 0.0, 0.0], atol=0.01)
    loose = _fitted(body, points, start, 0.05)
    assert loose.radii[0] - body.depth(loose.centers)[0] == pytest.approx(0.05, abs=0.002)
    outside = SphereSet(np.array([[half + 0.1, 0.0, 0.0]]), np.array([0.2]))
    assert len(_fitted(body, points, outside, 0.0)) == 0


def test_no_sphere_protrudes_by_more_than_the_tolerance(eros):
    body = Body(eros)
    for tolerance in (0.0, 0.03):
        found = fit(body, 20, FourPoint(tolerance=tolerance), 0)
        assert (found.radii <= body.depth(found.centers) + tolerance + 1e-12).all()


def test_a_large_smallest_radius_gives_fewer_spheres_with_a_reason():
    found = fit(Body(vg.make_shape("box", lengths=(1, 1, 1))), 40, FourPoint(min_radius=0.4), 0)
    assert len(found.radii) < 40
    assert found.reason


def test_bad_parameters_are_refused():
    for wrong in ({"tolerance": -0.1}, {"trials": 0}, {"min_radius": 0.0}):
        with pytest.raises(InputError, match=next(iter(wrong))):
            FourPoint(**wrong)
