"""Angle of repose: heaps of known slope."""

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import PackingWarning
from voxgran.measures.registered.repose import repose

BALL, DISK = vg.shapes.sphere(), vg.make_shape("disk")
SPACE, PLANE = vg.Box((60, 60, 60), origin=(-30, -30, -30)), vg.Rectangle((60, 60), origin=(-30, -30))


def cone(slope, height, rough=0.0):
    """Return spheres whose tops are on a cone and a floor around it, and others in a plane below."""
    x, y = (axis.ravel() for axis in np.meshgrid(*[np.arange(-25, 25, 0.97) + 0.13] * 2))
    noise = rough * np.random.Generator(np.random.Philox(3)).normal(size=len(x))
    top = np.maximum(height - slope * np.hypot(x, y) + noise, 0.0)
    below = np.full(len(x), -1.0)
    return np.concatenate([np.column_stack([x, y, top]), np.column_stack([x, y, below])])


@pytest.mark.parametrize("slope", [0.2, 0.45, 0.8])
@pytest.mark.parametrize("rough", [0.0, 0.3])
def test_a_cone_of_known_slope(slope, rough):
    packing = vg.Packing.of(BALL, SPACE, position=cone(slope, 20.0 * slope, rough), gravity="-z")
    found = repose(packing)
    assert found.angle == pytest.approx(np.degrees(np.arctan(slope)), abs=2.0 * found.error)
    assert found.error < (0.5 if rough == 0.0 else 1.0)
    assert found.height == pytest.approx(20.0 * slope, abs=1.5)


def test_the_direction_of_gravity_does_not_matter():
    position = cone(0.5, 8.0)
    one = repose(vg.Packing.of(BALL, SPACE, position=position, gravity="-z"))
    turned = repose(vg.Packing.of(BALL, SPACE, position=-position[:, [2, 0, 1]], gravity="+x"))
    assert turned.angle == pytest.approx(one.angle, abs=2.0 * one.error)


def test_both_flanks_in_the_plane():
    x = np.arange(-25, 25, 1.02)
    y = np.maximum(8.0 - np.where(x < 0.0, 0.4, 0.6) * np.abs(x), 0.0)
    packing = vg.Packing.of(DISK, PLANE, position=np.column_stack([x, y, 0 * x]), gravity="-y")
    found = repose(packing)
    expected = np.degrees(np.arctan([0.4, 0.6])).mean()
    assert found.angle == pytest.approx(expected, abs=1.0)
    tree = packing.measure("repose")
    assert float(tree.angle_of_repose) == found.angle
    assert float(tree.angle_of_repose_error) == found.error < 1.0


def test_a_flat_surface_has_the_angle_zero():
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(10.0), np.arange(10.0)))
    packing = vg.Packing.of(BALL, SPACE, position=np.column_stack([x, y, 0 * x]), gravity="-z")
    assert repose(packing).angle == pytest.approx(0.0, abs=1e-9)


def test_no_flank_and_no_gravity():
    few = vg.Packing.of(BALL, SPACE, position=[(0, 0, 0), (0, 0, 1)], gravity="-z")
    with pytest.warns(PackingWarning, match="the surface has no flank with at least 3 points"):
        assert np.isnan(repose(few).angle)
    assert np.isnan(repose(vg.Packing.of(BALL, SPACE, position=[(0, 0, 0)], gravity=None)).angle)
