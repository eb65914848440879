"""Depth of deep overlaps by a search, against closed forms."""

import numpy as np
import pytest

from voxgran.contacts.search import deepest_point


def cube(points):
    """Return the depth in a cube of edge 1 around the origin."""
    return 0.5 - np.abs(points).max(axis=1)


def sphere(center, radius):
    return lambda points: radius - np.linalg.norm(points - center, axis=1)


def test_the_deepest_point_is_the_innermost_one_of_both():
    center = np.array([0.3, 0.0, 0.0])
    for one, other, first in ((cube, sphere(center, 0.1), True), (sphere(center, 0.1), cube, False)):
        depth, point, in_one = deepest_point(one, other, center - 0.1, center + 0.1)
        assert depth == pytest.approx(0.3, rel=1e-3)
        assert point == pytest.approx([0.2, 0, 0], abs=0.02)
        assert in_one is first


def test_the_deepest_point_may_lie_inside_both():
    center = np.array([0.2, 0.1, 0.0])
    depth, point, in_one = deepest_point(cube, sphere(center, 0.4), np.full(3, -0.5), np.full(3, 0.6))
    assert depth == pytest.approx(0.5, rel=1e-3)
    assert point == pytest.approx(np.zeros(3), abs=1e-3)
    assert in_one


@pytest.mark.parametrize("high", [(0.9, 1.0, 1.0), (1.0, 1.0, 1.0)])
def test_no_common_point_has_no_depth(high):
    depth, _, _ = deepest_point(cube, sphere(np.full(3, 2.0), 0.1), np.ones(3), np.array(high))
    assert depth == 0.0
