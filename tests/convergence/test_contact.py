"""How the tests of contact come nearer to the truth with finer control points."""

import numpy as np
import pytest

import voxgran as vg
from benchmarks.encounter import Encounter
from benchmarks.packing.contact import TESTS, gaps_at_contact

SPACINGS = (0.4, 0.28, 0.2, 0.14)


def gaps(shape, test, spacing, many=20):
    contact, ways = TESTS[test]
    return gaps_at_contact(shape, Encounter(shape, shape, contact=contact, ways=ways, spacing=spacing), many)


def order(errors):
    return np.polyfit(np.log(SPACINGS), np.log(errors), 1)[0]


@pytest.mark.parametrize("test", ["sdf", "sdf, one way"])
def test_spheres_never_overlap_and_their_gap_is_of_second_order(test):
    """The gap is no more than h^2 / (4 R), twice the mean bias h^2 / (8 R) of points in a signed distance."""
    found = [gaps(vg.make_shape("sphere"), test, spacing) for spacing in SPACINGS]
    assert all(gap.min() >= 0 for gap in found)
    assert all(gap.max() <= h**2 / 2 * 1.05 for gap, h in zip(found, SPACINGS, strict=True))
    assert order([gap.mean() for gap in found]) > 1.8


def test_boxes_are_of_first_order_and_never_too_far():
    """Sharp edges cross between control points: they overlap by a part of the spacing."""
    found = [gaps(vg.make_shape("box", lengths=(1.1, 0.9, 0.7)), "sdf", spacing) for spacing in SPACINGS[2:]]
    for gap, spacing in zip(found, SPACINGS[2:], strict=True):
        assert gap.max() <= 1e-9
        assert gap.min() >= -0.3 * spacing


def test_points_against_points_are_of_first_order():
    for shape in (vg.make_shape("sphere"), vg.make_shape("box", lengths=(1.1, 0.9, 0.7))):
        found = [gaps(shape, "kdtree", spacing) for spacing in SPACINGS]
        assert all(gap.min() > 0 for gap in found)
        assert 0.8 < order([gap.mean() for gap in found]) < 1.3


def test_faces_of_cubes_touch_exactly():
    cube = vg.make_shape("box", aspect=(1, 1, 1))
    offset = Encounter(cube, cube, spacing=0.15).first_contact((1, 0, 0), aside=(0, 0.11, 0.07))
    assert offset[0] == pytest.approx(cube.volume ** (1 / 3), abs=1e-12)


@pytest.mark.slow
def test_scanned_bodies_come_as_near_as_their_points_tell():
    """Against the least gap of manifold3d: overlaps and gaps of a rough body shrink with the spacing."""
    eros = vg.load_shape("data/eros.obj")
    eros = eros.scaled(1 / eros.diameter)
    errors = [np.abs(gaps(eros, "sdf", spacing, many=8)).mean() for spacing in (0.3, 0.15, 0.075)]
    assert errors[2] < errors[1] < errors[0]
    assert errors[2] < 0.02
