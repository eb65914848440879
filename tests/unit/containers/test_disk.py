"""Disks as containers: closed forms, all methods of the plane, settling, and which measures are exact or sampled."""

import json
import math
import warnings

import numpy as np
import pytest
from kit import ASKED_IN_PLANE, methods_of_the_plane

import voxgran as vg
from voxgran._base.errors import CallError, InputError, PackingWarning
from voxgran._base.seeds import stream
from voxgran.contacts.walls import escape_depths
from voxgran.containers.kinds.disk import Disk
from voxgran.containers.model import Container
from voxgran.measures.region import Regions
from voxgran.measures.registered.density import bulk_solid_fraction
from voxgran.measures.registered.profile import axis_profile, wall_profile

GRAIN = vg.make_shape("disk")
ROUND = Disk(1.5, origin=(3, -1))


def test_signed_distance_is_that_from_a_fine_polygon():
    region = Disk(2.0, origin=(1, -3))
    angle = np.arange(20_000) * 2 * np.pi / 20_000
    rim = np.array(region.origin) + 2.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    points = stream(1, "disk").uniform([-2, -6], [4, 0], (300, 2))
    nearest = np.linalg.norm(points[:, None] - rim, axis=2).min(axis=1)
    found = region.signed_distance(points)
    # the nearest of the points of the rim is farther than the rim by half their distance at most
    assert (np.abs(found) <= nearest + 1e-14).all()
    assert (nearest - np.abs(found)).max() < 2 * math.pi / 20_000
    np.testing.assert_allclose(np.abs(found)[nearest > 0.1], nearest[nearest > 0.1], atol=2e-6)
    np.testing.assert_array_equal(found < 0, np.hypot(points[:, 0] - 1, points[:, 1] + 3) < 2)
    np.testing.assert_array_equal(found, region.signed_distance(np.column_stack([points, points[:, 0]])))
    np.testing.assert_allclose(region.signed_distance([(1, -3), (4, 1), (1, -1)]), [-2, 3, 0], atol=1e-15)
    with pytest.raises(InputError, match="points has shape"):
        region.signed_distance([(1, 2, 3, 4)])


def test_area_bounds_and_triangles_agree():
    assert ROUND.volume == pytest.approx(2.25 * math.pi, rel=1e-15)
    np.testing.assert_array_equal(ROUND.bounds, [[1.5, -2.5, 0], [4.5, 0.5, 0]])
    vertices, faces = ROUND.mesh()
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    areas = np.cross(b - a, c - a)[:, 2] / 2
    assert (areas > 0).all()
    assert areas.sum() == pytest.approx(ROUND.volume, rel=1e-2)
    assert ROUND.signed_distance(vertices).max() < 1e-14
    assert (vertices[:, 2] == 0).all()
    assert isinstance(ROUND, Container)
    assert (ROUND.dimension, ROUND.periodic, ROUND.kind) == (2, (False,) * 3, "disk")


def test_scaling_and_units_take_the_center_along():
    assert ROUND.scaled(2) == Disk(3, origin=(6, -2))
    for factor, words in ((0, "factor is 0"), (np.inf, "factor is inf"), (1e61, r"origin is 3e\+61")):
        with pytest.raises(InputError, match=words):
            ROUND.scaled(factor)
    packing = vg.Packing.of([GRAIN], ROUND, position=[(3, -1, 0)], unit="mm")
    meters = packing.to_unit("m")
    assert meters.container.radius == pytest.approx(1.5e-3, rel=1e-15)
    assert meters.container.origin == pytest.approx((3e-3, -1e-3), rel=1e-15)
    assert meters.solid_fraction == pytest.approx(1 / 9, rel=1e-12)


@pytest.mark.parametrize(
    ("radius", "origin", "words"),
    [
        (0, (0, 0), "^radius of the disk is 0: it must be finite and above 0"),
        (-1, (0, 0), "^radius of the disk is -1: it must be finite and above 0"),
        (np.nan, (0, 0), "^radius of the disk is nan"),
        (np.inf, (0, 0), "^radius of the disk is inf"),
        (1e-61, (0, 0), r"^radius of the disk is 1e-61: it must be between 1e-60 and 1e\+60; choose another unit"),
        (1e61, (0, 0), r"^radius of the disk is 1e\+61"),
        ("1", (0, 0), "^radius of the disk is '1': it must be a number"),
        (True, (0, 0), "^radius of the disk is True: it must be a number"),
        ([1, 2], (0, 0), r"^radius of the disk is \[1, 2\]: it must be a number"),
        (1, (0, 0, 0), r"^origin has shape \(3,\): it must have shape \(2,\)"),
        (1, (np.nan, 0), r"^origin is nan at index \(0,\): every value must be finite"),
        (1, (0, 1e61), r"^origin is 1e\+61: it must be between 1e-60 and 1e\+60"),
        (1, 3, "^origin is 3: it must be an array"),
    ],
)
def test_what_is_no_disk_is_refused(radius, origin, words):
    with pytest.raises(InputError, match=words):
        Disk(radius, origin=origin)


def test_other_arguments_are_told():
    with pytest.raises(CallError, match=r"'center' is unknown: known are origin, radius; write Disk\(radius=2\)"):
        Disk(1, center=(0, 0))
    with pytest.raises(CallError, match="Disk takes 1 argument by position"):
        Disk(1, (0, 0))
    with pytest.raises(CallError, match="Disk needs radius"):
        Disk()


SCENE = """
[scene]
unit = "mm"
[[shape]]
family = "disk"
[container]
kind = "disk"
radius = 2.5
origin = [1, 0.3]
[packing]
method = "gravity"
count = 8
[measure]
which = ["coordination"]
[output]
statistics = false
report = false
"""


def test_scenes_and_saved_packings_keep_the_disk(tmp_path):
    (tmp_path / "scene.toml").write_text(SCENE)
    scene = vg.Scene.from_toml(tmp_path / "scene.toml")
    assert scene.container == Disk(2.5, origin=(1, 0.3))
    assert type(scene).from_mapping(json.loads(json.dumps(scene.to_mapping()))).container == scene.container
    packing = scene.run(tmp_path / "out").packing
    back = vg.load(tmp_path / "out" / "packing.vtp")
    assert back.container == packing.container
    assert packing.container.radius == pytest.approx(2.5, rel=1e-15)
    assert packing.container.origin == pytest.approx((1, 0.3), rel=1e-15)
    assert back == packing
    # gravity was not told: in the plane it acts along -y
    assert packing.gravity == (0.0, -1.0, 0.0)
    assert packing.stop_reason == "settled"
    with pytest.warns(PackingWarning, match="the bulk holds 0 of the grains"):
        statistics = vg.measure(packing)
    vg.save_statistics(statistics, tmp_path / "statistics.nc")
    held = vg.load_statistics(tmp_path / "statistics.nc")
    assert float(held["/"].container_volume) == float(statistics["/"].container_volume) == packing.container.volume
    assert json.loads(str(held["/provenance"].record.values))["container"]["kind"] == "disk"


#: solid fractions that each method reaches at least in the disk above, with disks from 0.3 to 0.5
LEAST = {
    "advancing_front": 0.6,
    "control_point": 0.55,
    "deposition": 0.6,
    "digital": 0.54,
    "digital_fill": 0.61,
    "digital_rsa": 0.46,
    "expand": 0.6999,
    "gravity": 0.59,
    "jam": 0.76,
    "rsa": 0.52,
}


def packed(method, seed=2):
    with warnings.catch_warnings(action="ignore", category=PackingWarning):
        return vg.pack(
            GRAIN, ROUND, method=method, sizes=vg.sizes.uniform(0.3, 0.5), seed=seed, **ASKED_IN_PLANE.get(method, {})
        )


@pytest.mark.parametrize("method", methods_of_the_plane())
def test_every_method_of_the_plane_fills_a_disk(method):
    packing = packed(method)
    assert vg.verify(packing).ok
    away = np.hypot(packing.position[:, 0] - 3, packing.position[:, 1] + 1)
    assert (away + packing.diameters / 2).max() <= 1.5 + 1e-9
    assert packing.solid_fraction >= LEAST.get(method, 0.2)


def test_grains_escape_by_their_farthest_point():
    """Disks in closed form, and a square by its corners."""
    square = vg.make_shape("polygon", corners=4)
    side = math.sqrt(math.pi / 4)
    for shape, far in ((GRAIN, 1.1 + 0.5), (square, math.hypot(1.1 + side / 2, side / 2))):
        grain = vg.Packing.of([shape], ROUND, position=[(4.1, -1, 0)], gravity=None)
        assert escape_depths(grain) == pytest.approx([far - 1.5], abs=1e-12)
        assert vg.verify(grain).escaped == 1
        held = vg.Packing.of([shape], Disk(far + 1e-9, origin=(3, -1)), position=[(4.1, -1, 0)], gravity=None)
        assert vg.verify(held).ok


def test_grains_settle_in_a_disk():
    loose = packed("rsa")
    with pytest.raises(InputError, match="give gravity='-y' along an axis that has walls"):
        vg.settle(loose)
    bed = vg.settle(loose, gravity="-y")
    assert bed.stop_reason == "settled"
    assert vg.verify(bed).ok
    # the lowest grains lie at the bottom of the disk
    away = np.hypot(bed.position[:, 0] - 3, bed.position[:, 1] + 1) + bed.diameters / 2
    lowest = np.argmin(bed.position[:, 1])
    assert away[lowest] == pytest.approx(1.5, abs=1e-3)
    assert bed.position[:, 1].mean() < loose.position[:, 1].mean()


def beyond(radius, x):
    """Area of a disk beyond a line at a distance from its center."""
    return radius**2 * math.acos(x / radius) - x * math.sqrt(radius**2 - x**2)


def test_profiles_along_axes_are_exact():
    grain = vg.Packing.of([GRAIN], Disk(2.0), position=[(0, 0, 0)], scale=[2.0], gravity=None)
    inner = 2 * math.pi - beyond(2.0, 1.0)
    for axis in "xy":
        profile = axis_profile(grain, axis, bins=4)
        np.testing.assert_allclose(profile.solid_fraction, [0, math.pi / 2 / inner, math.pi / 2 / inner, 0], atol=1e-12)
        assert profile.error.max() == 0.0
        fine = axis_profile(grain, axis, bins=8)
        room = beyond(2.0, 0.5) - beyond(2.0, 1.0)
        assert fine.solid_fraction[2] * room == pytest.approx(beyond(1.0, 0.5), abs=1e-12)


def test_regions_within_the_wall_are_sampled_and_tell_their_error():
    grain = vg.Packing.of([GRAIN], Disk(2.5), position=[(0, 0, 0)], scale=[3.0], gravity=None)
    regions = Regions(grain)
    for inset in (0.5, 1.2, 2.0):
        region = regions.at(inset)
        for found, radius in ((region.volume, 2.5 - inset), (region.solid(regions.solids), min(1.5, 2.5 - inset))):
            assert abs(found - math.pi * radius**2) <= 4 * found.error + 1e-12
            assert found.error < 0.1 * found
    wall = wall_profile(grain, step=0.25)
    np.testing.assert_array_equal(wall.solid_fraction[:3], 0.0)
    # points of a grain lie in fine voxels, a half of which reaches beyond its surface
    assert 0.0 <= wall.solid_fraction[3] < 0.02
    assert (np.abs(wall.solid_fraction[4:] - 1.0) < 4 * wall.error[4:]).all()
    assert 0.01 < wall.error[4] < 0.08


def test_the_bulk_of_a_disk():
    """A hexagonal lattice: its solid fraction is known, and that of the bulk holds it within a few errors."""
    rows = np.stack(np.meshgrid(np.arange(-20, 21), np.arange(-20, 21)), axis=-1).reshape(-1, 2)
    places = np.column_stack([rows[:, 0] + rows[:, 1] / 2, rows[:, 1] * math.sqrt(3) / 2, np.zeros(len(rows))])
    container = Disk(9.0, origin=(0.2, 0.1))
    held = places[container.signed_distance(places) <= -0.5]
    bulk = bulk_solid_fraction(vg.Packing.of([GRAIN], container, position=held, gravity=None))
    assert 0 < bulk.error < 0.01
    assert abs(bulk - math.pi / math.sqrt(12)) < 4 * bulk.error
