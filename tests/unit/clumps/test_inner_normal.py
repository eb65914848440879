import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran.clumps.method import Body
from voxgran.clumps.methods.inner_normal import InnerNormal, _chosen, fit


@pytest.fixture(scope="module")
def body(eros):
    return Body(eros)


@pytest.mark.parametrize("order", ["largest", "random"])
def test_spheres_lie_inside_and_touch_the_surface(body, order):
    found = fit(body, 30, InnerNormal(order=order), 0)
    depth = body.depth(found.centers)
    assert len(found.radii) == 30
    assert (found.radii <= depth + 1e-12).all()
    # the surface bends between the points by which spheres shrink
    assert (found.radii >= depth - 0.01).all()


def test_the_surface_is_followed_to_within_the_distance(body):
    found = fit(body, 500, InnerNormal(distance=0.05, min_radius=0.001), 0)
    assert found.reason
    points = body.surface(3000, seed=5).points
    gap = (np.linalg.norm(points[:, None] - found.centers, axis=2) - found.radii).min(axis=1)
    assert (gap < 0.055).mean() > 0.999


@pytest.mark.slow
def test_a_smaller_distance_takes_more_spheres(body):
    counts = [len(fit(body, 500, InnerNormal(distance=far), 0).radii) for far in (0.2, 0.1, 0.05)]
    assert counts[0] < counts[1] < counts[2]


def test_the_largest_first_is_better_than_random_order(eros):
    by_order = {
        order: vg.fit_clump(eros, method="inner_normal", max_spheres=30, order=order).errors.iou
        for order in ("largest", "random")
    }
    assert by_order["largest"] > by_order["random"]


def test_the_choice_is_that_of_a_plain_search():
    generator = np.random.default_rng(0)
    feet = generator.uniform(-1, 1, (40, 3))
    centers, radii = 0.8 * feet, generator.uniform(0.1, 0.3, 40)
    good = radii > 0.12
    chosen = []
    for k in range(40):
        near = [np.linalg.norm(feet[k] - centers[j]) - radii[j] <= 0.2 for j in chosen]
        if good[k] and not any(near):
            chosen.append(k)
    assert 5 < len(chosen) < 40
    assert _chosen(feet, centers, radii, good, 0.2, 100).tolist() == chosen
    assert _chosen(feet, centers, radii, good, 0.2, 4).tolist() == chosen[:4]


def test_bad_parameters_are_refused():
    for wrong in ({"distance": 0.0}, {"min_radius": 0.6}, {"order": "smallest"}):
        with pytest.raises(InputError, match=next(iter(wrong))):
            InnerNormal(**wrong)
