"""The errors of clumps against closed formulas."""

import itertools

import numpy as np
import pytest

import voxgran as vg
from voxgran.clumps.errors import clump_errors
from voxgran.clumps.method import Body
from voxgran.shapes.model import Shape
from voxgran.shapes.spheres import Spheres


def errors_of(shape, centers, radii):
    """Return the errors of spheres in the unit of the shape."""
    return clump_errors(Body(shape), Spheres(np.asarray(centers) / shape.diameter, np.asarray(radii) / shape.diameter))


def test_a_union_has_no_error_against_itself():
    shape = Shape.of(Spheres(np.array([[0, 0, 0], [0.7, 0.1, 0]]), np.array([0.5, 0.4])), name="two")
    errors = errors_of(shape, shape.geometry.centers, shape.geometry.radii)
    assert errors.iou == pytest.approx(1.0, abs=1e-12)
    assert abs(errors.volume) < 1e-12
    assert errors.centroid < 1e-12
    assert errors.inertia < 1e-12
    # distances see the tessellation of the body
    assert errors.surface_mean < shape.tessellation_error / shape.diameter
    assert errors.surface_max < 0.01
    assert set(errors.to_mapping()) >= {"iou", "volume", "centroid", "inertia", "surface_mean", "surface_max"}


def test_one_of_two_overlapping_spheres_is_judged_by_their_lens():
    """Two unit spheres at a distance d share the volume pi (4 + d) (2 - d)^2 / 12."""
    d = 0.8
    shape = Shape.of(Spheres(np.array([[0, 0, 0], [d, 0, 0]]), np.ones(2)), name="two")
    lens, sphere = np.pi * (4 + d) * (2 - d) ** 2 / 12, 4 * np.pi / 3
    errors = errors_of(shape, [[-d / 2, 0, 0]], [1.0])
    union = 2 * sphere - lens
    assert errors.volume == pytest.approx(sphere / union - 1, abs=1e-12)
    assert errors.iou == pytest.approx(sphere / union, abs=3 * errors.iou_uncertainty)
    assert errors.centroid == pytest.approx(d / 2 / shape.diameter, abs=1e-12)
    # the pole of the missing sphere is the farthest point
    assert errors.surface_max == pytest.approx(d / shape.diameter, rel=0.02)


@pytest.mark.parametrize("side", [1, 2, 3])
def test_a_cube_of_inscribed_spheres(side):
    """Spheres of diameter 1 / n on an n by n by n lattice fill pi / 6 of a cube; inertia by Steiner's theorem."""
    cube = vg.make_shape("box", lengths=(1.0, 1.0, 1.0))
    levels = (np.arange(side) + 0.5) / side - 0.5
    centers = np.array(list(itertools.product(levels, repeat=3)))
    radius = 0.5 / side
    errors = errors_of(cube, centers, np.full(side**3, radius))
    assert errors.volume == pytest.approx(np.pi / 6 - 1, abs=1e-9)
    assert errors.iou == pytest.approx(np.pi / 6, abs=3 * errors.iou_uncertainty)
    each = np.pi / 6 / side**3
    inertia = each * (0.4 * radius**2 * side**3 + 2 * (centers[:, 0] ** 2).sum())
    assert errors.inertia == pytest.approx(1 - inertia * 6, abs=1e-9)
    # a corner of the cube is the farthest point from the nearest sphere
    corner = (np.sqrt(3) - 1) * radius
    assert errors.surface_max >= 0.9 * corner / cube.diameter


def test_a_sphere_grown_by_a_tenth():
    sphere = vg.make_shape("sphere")
    errors = errors_of(sphere, [[0.0, 0.0, 0.0]], [0.55])
    assert errors.volume == pytest.approx(0.331)
    assert errors.inertia == pytest.approx(1.1**5 - 1)
    assert errors.iou == pytest.approx(1 / 1.331, abs=3 * errors.iou_uncertainty)
    assert errors.surface_mean == pytest.approx(0.05, abs=2e-3)
    assert errors.surface_max == pytest.approx(0.05, abs=4e-3)


def test_the_standard_error_covers_the_error_of_the_overlap():
    """An ellipsoid against the sphere of its middle axis, in many sizes: the deviations are within three errors."""
    for factor in (0.7, 0.8, 0.9, 1.0, 1.1):
        ellipsoid = vg.make_shape("ellipsoid", semi_axes=(0.5, 0.5, 0.5))
        errors = errors_of(ellipsoid, [[0.0, 0.0, 0.0]], [0.5 * factor])
        exact = min(factor, 1 / factor) ** 3
        assert abs(errors.iou - exact) < 3 * errors.iou_uncertainty
        assert errors.iou_uncertainty < 5e-4
