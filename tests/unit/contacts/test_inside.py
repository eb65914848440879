"""Signed distances of points in a grain."""

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.seeds import stream
from voxgran.contacts.inside import inner_distance


def nearest_by_sampling(points, axes):
    """Return distances to an ellipsoid: the nearest of many directions, made better by random steps around it."""
    generator = stream(5, "directions")
    found = np.empty(len(points))
    first = generator.normal(size=(5000, 3))
    first /= np.linalg.norm(first, axis=1)[:, None]
    for k, point in enumerate(points):
        far = np.linalg.norm(first * axes - point, axis=1)
        best, value, width = first[far.argmin()], far.min(), 0.1
        while width > 1e-9:
            tries = best + width * generator.normal(size=(200, 3))
            tries /= np.linalg.norm(tries, axis=1)[:, None]
            far = np.linalg.norm(tries * axes - point, axis=1)
            if far.min() < value:
                best, value = tries[far.argmin()], far.min()
            else:
                width *= 0.5
        found[k] = value
    return found


@pytest.mark.parametrize("axes", [(0.6, 0.45, 0.35), (1.0, 1.0, 1.0), (2.0, 0.5, 0.5), (1.0, 0.05, 0.3)])
def test_distances_to_ellipsoids_are_those_of_a_search(axes):
    """Inside and outside, on the middle planes and axes, at the center, and far away."""
    axes = np.array(axes)
    points = stream(1, "points").normal(size=(60, 3)) * axes
    points[:10, 2], points[5:15, 0], points[12:20, 1] = 0.0, 0.0, 0.0
    points[20], points[21], points[22] = 0.0, 1e3, (0.0, 1e-300, 0.0)
    ellipsoid = vg.make_shape("ellipsoid", semi_axes=tuple(axes)).geometry
    found = inner_distance(ellipsoid)(points)
    inside = ((points / axes) ** 2).sum(axis=1) < 1.0
    np.testing.assert_array_equal(found > 0.0, inside)
    np.testing.assert_allclose(np.abs(found), nearest_by_sampling(points, axes), atol=1e-8)


def test_points_of_an_ellipsoid_do_not_depend_on_their_company():
    """Newton's method ends for all points at once, and yet each has the bits that it has alone."""
    inner = inner_distance(vg.make_shape("ellipsoid", semi_axes=(0.6, 0.45, 0.35)).geometry)
    points = stream(2, "points").normal(size=(200, 3))
    alone = np.array([inner(point[None])[0] for point in points])
    np.testing.assert_array_equal(inner(points), alone)
