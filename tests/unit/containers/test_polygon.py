"""Polygons with holes as containers: against point-to-segment distances and winding numbers, formulas, and pictures."""

import math
import warnings
from dataclasses import replace

import numpy as np
import pytest
from kit import ASKED_IN_PLANE, methods_of_the_plane

import voxgran as vg
from voxgran._base.errors import CallError, InputError, PackingWarning
from voxgran._base.seeds import stream
from voxgran.contacts.walls import escape_depths
from voxgran.containers.kinds.polygon import Polygon
from voxgran.containers.model import Container
from voxgran.containers.plane import area_of
from voxgran.measures.region import Regions
from voxgran.measures.registered.density import bulk_solid_fraction
from voxgran.measures.registered.profile import axis_profile, wall_profile
from voxgran.shapes.images.outline_images import _loops as loops_of

SQUARE = [(0, 0), (6, 0), (6, 4), (0, 4)]
HOLE = [(2, 1), (3, 1), (3, 2), (2, 2)]
#: with a roof that comes down to a re-entrant corner, and a hole
HOLED = Polygon([(0, 0), (6, 0), (6, 4), (3, 2.5), (0, 4)], holes=[HOLE])
DISK = vg.make_shape("disk")


def star(count, generator, *, center=(0.0, 0.0), size=1.0):
    """Corners of a loop around a center at random distances: about half of them are re-entrant."""
    angle = (np.arange(count) + generator.uniform(0.1, 0.9, count)) * 2 * np.pi / count
    radius = size * generator.uniform(0.3, 1.0, count)
    return np.array(center) + radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])


def twin(loops, points):
    """Distance from the nearest segment, negative where the loops wind around the point once in all."""
    nearest, turns = np.full(len(points), np.inf), np.zeros(len(points))
    for loop in loops:
        for a, b in zip(loop, np.roll(loop, -1, axis=0), strict=True):
            share = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
            nearest = np.minimum(nearest, np.linalg.norm(points - a - share[:, None] * (b - a), axis=1))
            u, v = a - points, b - points
            turns += np.arctan2(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0], (u * v).sum(axis=1)) / (2 * np.pi)
    winding = np.rint(turns)
    assert np.isin(winding, (0, 1)).all()
    return np.where(winding == 1, -nearest, nearest)


def regular(count, radius, center=(0.0, 0.0)):
    angle = np.arange(count) * 2 * np.pi / count
    return np.array(center) + radius * np.column_stack([np.cos(angle), np.sin(angle)])


GENERATOR = stream(3, "polygons")
REGIONS = {
    "holed": HOLED,
    "stars": Polygon(
        star(24, GENERATOR, size=4.0) * 3.0,
        holes=[star(9, GENERATOR, size=0.8), star(5, GENERATOR, center=(1.5, 1.5), size=0.6)[::-1]],
    ),
    "far": Polygon(star(11, GENERATOR, center=(3e4, -2e4)), holes=[star(7, GENERATOR, center=(3e4, -2e4), size=0.2)]),
    "clockwise": Polygon(SQUARE[::-1], holes=[HOLE]),
}


@pytest.mark.parametrize("name", REGIONS)
def test_signed_distance_is_that_from_the_segments(name):
    region = REGIONS[name]
    loops, (low, high) = (region.corners, *region.holes), region.bounds[:, :2]
    generator, margin = stream(1, "points"), 0.4 * (high - low)
    around = generator.uniform(low - margin, high + margin, (3000, 2))
    # where corners decide: next to each of them, and on the edges
    flat = np.concatenate(loops)
    near = np.repeat(flat, 20, axis=0) + 1e-3 * (high - low).max() * generator.normal(size=(20 * len(flat), 2))
    points, scale = np.concatenate([around, near]), np.abs(region.bounds).max()
    found = region.signed_distance(points)
    np.testing.assert_allclose(found, twin(loops, points), atol=4e-15 * scale, rtol=1e-12)
    assert 0.05 < (found < 0).mean() < 0.95
    assert np.abs(region.signed_distance(flat)).max() <= 1e-15 * scale
    np.testing.assert_array_equal(
        found, region.signed_distance(np.column_stack([points, generator.random(len(points))]))
    )


def test_known_distances_at_corners():
    # inside of a re-entrant corner it is the corner that is near, outside of it the edges, and the other way at a hole
    points = [(3, 2.2), (3, 2.9), (1.7, 0.6), (2.2, 1.4), (2.5, 1.5), (7, -1), (-0.1, 1)]
    beyond = 0.4 * 2 / math.sqrt(5)
    expected = [-0.2, beyond, -0.5, 0.2, 0.5, math.sqrt(2), 0.1]
    np.testing.assert_allclose(HOLED.signed_distance(points), expected, atol=1e-15)


@pytest.mark.parametrize("points", [[(1, 2, 3, 4)], [(1,)], [1, 2], [(np.nan, 1)]])
def test_points_need_two_or_three_finite_columns(points):
    with pytest.raises(InputError, match="points"):
        HOLED.signed_distance(points)


def test_area_is_that_of_the_formula():
    region = Polygon(regular(17, 3.0, (5, -2)), holes=[regular(6, 0.5, (6, -2)), regular(5, 0.25, (4, -1.5))])
    areas = [count / 2 * radius**2 * math.sin(2 * math.pi / count) for count, radius in ((17, 3), (6, 0.5), (5, 0.25))]
    assert region.volume == pytest.approx(areas[0] - areas[1] - areas[2], rel=1e-14)
    assert HOLED.volume == 18.5
    # far away no digits are lost but those of the coordinates
    assert Polygon(np.array(SQUARE) + 2.0**30, holes=[np.array(HOLE) + 2.0**30]).volume == 23.0
    assert isinstance(region, Container)
    assert (region.dimension, region.periodic, region.kind) == (2, (False,) * 3, "polygon")


@pytest.mark.parametrize("name", REGIONS)
def test_triangles_cover_the_area_and_no_hole(name):
    region = REGIONS[name]
    vertices, faces = region.mesh()
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    areas = np.cross(b - a, c - a)[:, 2] / 2
    assert (areas >= 0).all()
    assert areas.sum() == pytest.approx(region.volume, rel=1e-9)
    assert (vertices[:, 2] == 0).all()
    thick = areas > 1e-6 * region.volume
    assert region.signed_distance(((a + b + c) / 3)[thick]).max() < 0
    np.testing.assert_array_equal(region.bounds, [vertices.min(axis=0), vertices.max(axis=0)])


def test_loops_turn_one_way_and_do_not_change():
    for corners in (SQUARE, SQUARE[::-1], [*SQUARE, SQUARE[0]]):
        for hole in (HOLE, HOLE[::-1]):
            region = Polygon(corners, holes=[hole])
            assert len(region.corners) == len(region.holes[0]) == 4
            assert region.volume == 23.0
            x, y = region.corners.T
            assert (x * np.roll(y, -1) - np.roll(x, -1) * y).sum() == 48.0
            x, y = region.holes[0].T
            assert (x * np.roll(y, -1) - np.roll(x, -1) * y).sum() == -2.0
    given = np.array(SQUARE, dtype=float)
    region = Polygon(given)
    given[0] = 1.0
    assert region.volume == 24.0
    with pytest.raises(ValueError, match="read-only"):
        region.corners[0] = 1.0
    assert Polygon(np.array(SQUARE), holes=np.array([HOLE])) == Polygon(SQUARE, holes=(HOLE,))
    assert Polygon(SQUARE) != HOLED
    assert Polygon(SQUARE) != 3
    assert repr(Polygon(SQUARE, holes=[HOLE])) == "Polygon(4 corners, 1 holes, area=23)"


def test_equal_polygons_have_equal_hashes():
    one, other = Polygon(SQUARE), Polygon([(-0.0, 0), (6, -0.0), (6, 4), (-0.0, 4)])
    assert one == other
    assert hash(one) == hash(other)
    assert len({one, other, HOLED}) == 2


def test_scaling_takes_all_loops_along():
    made = HOLED.scaled(0.5)
    assert made == Polygon(HOLED.corners * 0.5, holes=[HOLE * np.full((4, 2), 0.5)])
    assert made.volume == 18.5 / 4
    points = stream(2, "scaled").uniform(-1, 7, (200, 2))
    np.testing.assert_array_equal(made.signed_distance(points * 0.5), HOLED.signed_distance(points) * 0.5)
    assert HOLED.scaled(1e-50).scaled(1e50).volume == pytest.approx(18.5, rel=1e-12)
    for factor, words in ((0, "factor is 0"), (-1, "factor is -1"), (np.nan, "factor is nan"), (1e70, "extent of the")):
        with pytest.raises(InputError, match=words):
            HOLED.scaled(factor)


WRONG = [
    ([(0, 0), (1, 0)], (), r"^corners has 2 corners: a loop needs at least 3; add corners$"),
    ([(0, 0), (1, 0), (0, 0)], (), r"^corners has 2 corners"),
    ([(0, 0), (1, 1), (2, 2), (5, 5)], (), r"^corners has no area: its corners must not lie on one line; move them$"),
    ([(0, 0), (2, 2), (2, 0), (0, 1)], (), r"^edge 0 of corners meets edge 2 of corners: loops must neither cross nor"),
    # a bow tie, whose two parts have areas of opposite sign
    ([(0, 0), (1, 1), (1, 0), (0, 1)], (), r"^edge 0 of corners meets edge 2 of corners"),
    # touching: a corner on an edge, a corner on a corner, an edge that folds back
    ([(0, 0), (4, 0), (4, 4), (2, 0), (0, 4)], (), r"^edge 0 of corners meets edge 3 of corners"),
    ([(0, 0), (2, 1), (4, 0), (4, 2), (2, 1), (0, 2)], (), r"^edge 0 of corners meets edge 3 of corners"),
    ([(0, 0), (4, 0), (2, 0), (2, 3)], (), r"^edge 0 of corners meets edge 1 of corners"),
    (
        [(0, 0), (1, 0), (1, 0), (1, 1)],
        (),
        r"^corners\[1\] and the next one are both \[1.0, 0.0\]: an edge has a length",
    ),
    ([(0, 0), (1, 0), (np.nan, 1)], (), r"^corners is nan at index \(2, 0\): every value must be finite"),
    ([(0, 0), (1, 0), (np.inf, 1)], (), r"^corners is inf at index \(2, 0\)"),
    ([(0, 0, 0), (1, 0, 0), (1, 1, 0)], (), r"^corners has shape \(3, 3\): it must have shape \(n, 2\)$"),
    ([0, 1, 2], (), r"^corners has shape \(3,\)"),
    ("abc", (), r"^corners is 'abc': it must be an array of numbers of shape \(n, 2\)"),
    (None, (), r"^corners is None: it must be an array"),
    ([(0, 0), (1e-70, 0), (0, 1e-70)], (), r"^extent of the polygon is 1e-70: it must be between 1e-60 and 1e\+60"),
    ([(0, 0), (1e70, 0), (0, 1e70)], (), r"^corners is 1e\+70 at index \(1, 0\): coordinates must be at most"),
    (SQUARE, [[(7, 1), (8, 1), (8, 2)]], r"^holes\[0\] lies outside of the polygon: a hole is a part that is left out"),
    (SQUARE, [[(-1, -1), (7, -1), (7, 5), (-1, 5)]], r"^holes\[0\] lies outside of the polygon"),
    (
        SQUARE,
        [[(5, 1), (8, 1), (8, 2)]],
        r"^edge 1 of corners meets edge \d of holes\[0\]: loops must neither cross nor",
    ),
    (SQUARE, [[(0, 1), (1, 1), (1, 2)]], r"^edge 3 of corners meets edge \d of holes\[0\]"),
    (SQUARE, [[(0, 0), (1, 1), (1, 2)]], r"^edge 0 of corners meets edge \d of holes\[0\]"),
    (SQUARE, [SQUARE], r"^edge 0 of corners meets edge \d of holes\[0\]"),
    (SQUARE, [HOLE, [(3, 1), (4, 1), (4, 2)]], r"^edge \d of holes\[0\] meets edge \d of holes\[1\]"),
    (SQUARE, [HOLE, HOLE], r"^edge 0 of holes\[0\] meets edge 0 of holes\[1\]"),
    (SQUARE, [HOLE, [(2.2, 1.2), (2.4, 1.2), (2.4, 1.4)]], r"^holes\[1\] lies in holes\[0\]: holes must lie apart"),
    (SQUARE, [[(2.2, 1.2), (2.4, 1.2), (2.4, 1.4)], HOLE], r"^holes\[0\] lies in holes\[1\]"),
    (SQUARE, [[(1, 1), (2, 2)]], r"^holes\[0\] has 2 corners: a loop needs at least 3"),
    (SQUARE, [HOLE, [(4, 1), (5, 1), (np.nan, 2)]], r"^holes\[1\] is nan at index \(2, 0\)"),
    (SQUARE, [[]], r"^holes\[0\] has shape \(0,\)"),
    (SQUARE, [None], r"^holes\[0\] is None: it must be an array"),
    (SQUARE, [[(1, 1), (2,)]], r"^holes\[0\] is \[\(1, 1\), \(2,\)\]: it must be an array"),
    (SQUARE, HOLE, r"^holes begins with \(2, 1\): it must be a list of loops, one for each hole; add brackets$"),
    (SQUARE, np.array(HOLE), r"^holes begins with array\(\[2, 1\]\)"),
    (SQUARE, "abc", r"^holes is 'abc': it must be a list of loops, each a list of corners; give one$"),
    (SQUARE, 3, r"^holes is 3: it must be a list of loops"),
    (SQUARE, None, r"^holes is None: it must be a list of loops"),
    (SQUARE, {"one": HOLE}, r"^holes is \{'one': .*\}: it must be a list of loops"),
    (SQUARE, np.array(3), r"^holes is array\(3\): it must be a list of loops"),
]


@pytest.mark.parametrize(("corners", "holes", "words"), WRONG)
def test_what_is_no_region_is_refused(corners, holes, words):
    with pytest.raises(InputError, match=words):
        Polygon(corners, holes=holes)


def test_other_arguments_are_told():
    with pytest.raises(CallError, match=r"'hole' is unknown: did you mean 'holes'\?"):
        Polygon(SQUARE, hole=[HOLE])
    with pytest.raises(CallError, match=r"Polygon needs corners; write Polygon\("):
        Polygon()


def test_many_holes_are_checked_quickly():
    """1600 holes within each other's bounds nowhere: pairs whose bounds lie apart are not compared."""
    places = np.stack(np.meshgrid(np.arange(40), np.arange(40)), axis=-1).reshape(-1, 2) + 0.5
    holes = [place + np.array([(-0.2, -0.2), (0.2, -0.2), (0, 0.2)]) for place in places]
    region = Polygon([(0, 0), (40, 0), (40, 40), (0, 40)], holes=holes)
    assert region.volume == pytest.approx(1600 - 1600 * 0.08, rel=1e-12)
    with pytest.raises(InputError, match=r"holes\[1600\] lies in holes\[77\]"):
        Polygon([(0, 0), (40, 0), (40, 40), (0, 40)], holes=[*holes, places[77] + 0.1 * np.array(holes[0] - places[0])])


X, Y = np.indices((90, 70))
#: a disk about (40, 30) with a hole above the middle and to the right, in pixels whose middles are at 0.5, 1.5, ...
DRAWN = (np.hypot(X + 0.5 - 40, Y + 0.5 - 30) < 28) & (np.hypot(X + 0.5 - 48, Y + 0.5 - 42) > 7)


def test_a_picture_becomes_a_polygon():
    region = Polygon.from_image(DRAWN, pixel_size=0.1, origin=(5, -2))
    assert len(region.holes) == 1
    # a pixel at the boundary is an error of a pixel at most
    wanted, around = math.pi * (2.8**2 - 0.7**2), 2 * math.pi * (2.8 + 0.7)
    assert abs(region.volume - wanted) < 0.1 * 0.1 * around
    for loop, (x, y), radius in ((region.corners, (9, 1), 2.8), (region.holes[0], (9.8, 2.2), 0.7)):
        distance = np.hypot(*(loop - (x, y)).T)
        assert np.abs(distance - radius).max() < 0.1
    # mirrored in x or y, the hole would be elsewhere
    assert region.signed_distance([(9.8, 2.2), (8.2, 2.2), (9.8, -0.2), (2.2, 9.8)])[0] > 0.6
    assert region.signed_distance([(8.2, 2.2), (9.8, -0.2)]).max() < -0.8
    # nothing is lost at the border of a picture that is bright all over its edge
    full = np.ones((20, 10))
    full[5:9, 4:7] = 0
    cut = Polygon.from_image(full, pixel_size=1.0)
    np.testing.assert_allclose(cut.bounds, [[0, 0, 0], [20, 10, 0]], atol=1e-5)
    # but for the corners, which are cut by half a pixel
    assert cut.volume == pytest.approx(200 - 4 / 8 - (12 - 4 / 8), abs=1e-9)


def test_a_picture_file_has_y_upward(tmp_path):
    from matplotlib.image import imsave

    path = tmp_path / "region.png"
    # the first row of a picture is its top
    imsave(path, DRAWN.T[::-1].astype(float), cmap="gray")
    assert Polygon.from_image(path, pixel_size=0.1) == Polygon.from_image(DRAWN, pixel_size=0.1)
    assert Polygon.from_image(str(path), pixel_size=0.1).holes[0][:, 1].mean() == pytest.approx(4.2, abs=0.05)


def test_grey_values_place_the_boundary_within_pixels():
    grey = np.clip(28 - np.hypot(X + 0.5 - 40, Y + 0.5 - 30), -3, 3)
    region = Polygon.from_image(grey, pixel_size=1.0, level=0.0)
    assert np.abs(np.hypot(*(region.corners - (40, 30)).T) - 28).max() < 0.02
    wider = Polygon.from_image(grey, pixel_size=1.0, level=-1.5)
    assert wider.volume == pytest.approx(math.pi * 29.5**2, rel=1e-3)
    assert Polygon.from_image(grey, pixel_size=1.0) == region


def test_values_that_equal_the_level_count_as_darker():
    """Traced through the middles of such pixels, boundaries would touch each other there, which polygons may not."""
    generator = stream(4, "grey")
    for _ in range(60):
        values = np.zeros((14, 14))
        values[2:12, 2:12] = generator.integers(0, 3, (10, 10))
        values[4:10, 4:10] = np.minimum(values[4:10, 4:10] + 1, 2)
        regions = [area for loop in loops_of(values, 1.0) if (area := area_of(loop)) > 0]
        region = Polygon.from_image(values, pixel_size=1.0, min_area=0.999 * max(regions))
        # holes that are smaller are left out
        assert region.volume == pytest.approx(max(regions), rel=1e-12)
        assert not region.holes


def test_small_regions_and_holes_are_noise():
    spotted = DRAWN.copy()
    spotted[2, 2] = spotted[80:83, 60:62] = True
    spotted[40, 20] = False
    assert Polygon.from_image(spotted, pixel_size=0.1) == Polygon.from_image(DRAWN, pixel_size=0.1)
    with pytest.raises(InputError, match=r"shows 2 regions of 5 pixels or more, brighter than 0.5: a container is one"):
        Polygon.from_image(spotted, pixel_size=0.1, min_area=5)
    assert len(Polygon.from_image(DRAWN, pixel_size=0.1, min_area=200).holes) == 0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (
            {"source": np.zeros((9, 9))},
            r"image of shape \(9, 9\) shows 0 regions of 9 pixels or more, brighter than 0: ",
        ),
        (
            {"level": 2.0},
            "shows 0 regions of 9 pixels or more, brighter than 2: a container is one region; lower min_area",
        ),
        ({"source": np.zeros((9, 9, 3))}, r"image has the shape \(9, 9, 3\): outlines need two axes"),
        ({"source": np.array([[0.0, np.nan], [1.0, 0.0]])}, "image holds values that are not finite"),
        ({"pixel_size": 0}, "pixel_size is 0"),
        ({"pixel_size": "1"}, "pixel_size is '1'"),
        ({"min_area": -1}, "min_area is -1"),
        ({"level": np.nan}, "level is nan"),
        ({"origin": (0, 0, 0)}, r"origin has shape \(3,\)"),
    ],
)
def test_pictures_without_one_region_are_refused(options, words):
    given = {"source": DRAWN, "pixel_size": 0.1, **options}
    with pytest.raises(InputError, match=words):
        Polygon.from_image(given.pop("source"), **given)


def test_two_regions_are_refused_in_one_sentence():
    two = np.zeros((40, 20), dtype=bool)
    two[3:15, 3:15] = two[20:35, 3:15] = True
    with pytest.raises(InputError) as told:
        Polygon.from_image(two, pixel_size=1.0)
    text = str(told.value)
    assert text.startswith("image of shape (40, 20) shows 2 regions of 9 pixels or more, brighter than 0.5")
    assert text.endswith("raise min_area above all but the largest, or join them")
    # what the message says helps
    assert Polygon.from_image(two, pixel_size=1.0, min_area=160).bounds[0, 0] == pytest.approx(20)


SCENE = """
[scene]
seed = 1
unit = "mm"
[[shape]]
family = "disk"
[sizes]
kind = "uniform"
low = 0.3
high = 0.5
[container]
{container}
[packing]
method = "rsa"
count = 20
"""
CORNERS = (
    'kind = "polygon"\ncorners = [[0, 0], [6, 0], [6, 4], [3, 2.5], [0, 4]]\nholes = [[[2, 1], [3, 1], [3, 2], [2, 2]]]'
)
PICTURE = 'kind = "polygon"\nfile = "region.png"\npixel_size = 0.1\norigin = [5, -2]'


@pytest.mark.parametrize("text", [CORNERS, PICTURE], ids=["corners", "picture"])
def test_scenes_and_saved_packings_keep_the_polygon(text, tmp_path):
    from matplotlib.image import imsave

    imsave(tmp_path / "region.png", DRAWN.T[::-1].astype(float), cmap="gray")
    (tmp_path / "scene.toml").write_text(SCENE.format(container=text))
    scene = vg.Scene.from_toml(tmp_path / "scene.toml")
    wanted = HOLED if text == CORNERS else Polygon.from_image(DRAWN, pixel_size=0.1, origin=(5, -2))
    assert scene.container == wanted
    again = type(scene).from_mapping(scene.to_mapping())
    assert again.container == wanted
    packing = vg.pack(DISK, wanted, "rsa", count=20, sizes=vg.sizes.uniform(0.3, 0.5), seed=1, unit="mm")
    vg.save(packing, tmp_path / "packing.vtp")
    back = vg.load(tmp_path / "packing.vtp")
    assert back == packing
    assert back.container == packing.container
    for loop, kept in zip(
        (wanted.corners, *wanted.holes), (back.container.corners, *back.container.holes), strict=True
    ):
        np.testing.assert_allclose(kept, loop, rtol=1e-15)
    meters = packing.to_unit("m")
    np.testing.assert_allclose(meters.container.bounds, wanted.bounds * 1e-3, rtol=1e-15)
    assert meters.container.volume == pytest.approx(wanted.volume * 1e-6, rel=1e-12)
    assert meters.solid_fraction == pytest.approx(packing.solid_fraction, rel=1e-12)
    assert vg.verify(meters).ok


#: solid fractions that each method reaches at least in the region below, with disks from 0.3 to 0.5
LEAST = {
    "advancing_front": 0.58,
    "control_point": 0.43,
    "deposition": 0.31,
    "digital": 0.48,
    "digital_fill": 0.57,
    "digital_rsa": 0.44,
    "expand": 0.6999,
    "gravity": 0.55,
    "jam": 0.74,
    "rsa": 0.48,
}
SMALL = Polygon([(0, 0), (4, 0), (4, 3), (2, 2), (0, 3)], holes=[[(0.9, 0.9), (1.5, 0.9), (1.5, 1.5), (0.9, 1.5)]])


def packed(method):
    with warnings.catch_warnings(action="ignore", category=PackingWarning):
        return vg.pack(
            DISK, SMALL, method=method, sizes=vg.sizes.uniform(0.3, 0.5), seed=2, **ASKED_IN_PLANE.get(method, {})
        )


@pytest.mark.parametrize("method", methods_of_the_plane())
def test_every_method_of_the_plane_fills_a_region_with_a_hole_and_a_reentrant_corner(method):
    packing = packed(method)
    assert vg.verify(packing).ok
    # by the twin: each disk is wholly in the region, none in the hole
    depth = -twin((SMALL.corners, *SMALL.holes), packing.position[:, :2])
    assert (depth - packing.diameters / 2).min() > -1e-9
    assert packing.solid_fraction >= LEAST.get(method, 0.2)
    x = packing.position[:, 0]
    # on both sides of the hole and of the corner, but for a cluster that ends at the hole
    assert (x > 2.5).sum() > 4
    assert (x < 1.2).sum() > 4 or method == "deposition"


def test_rsa_in_a_region_is_saturated():
    """No disk that is asked for fits anywhere else."""
    packing = vg.pack(vg.make_shape("disk", diameter=0.35), SMALL, "rsa", until="saturated", seed=1)
    assert packing.stop_reason == "saturated"
    points = stream(5, "room").uniform((0, 0), (4, 3), (40_000, 2))
    free = twin((SMALL.corners, *SMALL.holes), points) <= -0.175
    free &= np.linalg.norm(points[:, None] - packing.position[:, :2], axis=2).min(axis=1) >= 0.35
    assert not free.any()
    assert 0.45 < packing.solid_fraction < 0.55


def test_a_grain_across_an_edge_is_found():
    inside = vg.Packing.of([DISK], HOLED, position=[(2.5, 0.5, 0), (5, 2, 0)], scale=[0.99, 1.0], gravity=None)
    assert vg.verify(inside).ok
    for place, depth in (((2.5, 0.501, 0), 1e-3), ((2.5, 1.5, 0), 1.0), ((3, 2.1, 0), 0.4), ((7, 2, 0), 1.5)):
        beyond = vg.Packing.of([DISK], HOLED, position=[place], gravity=None)
        assert vg.verify(beyond).escaped == 1
        assert escape_depths(beyond) == pytest.approx([depth], abs=1e-12)


SQUARE_GRAIN = vg.make_shape("polygon", corners=4)
#: scale at which that grain has sides of 1
UNIT_SIDE = math.sqrt(4 / math.pi)


def test_a_wall_that_enters_the_side_of_a_grain_is_found():
    """All corners of the grain lie in the region, while a corner of the wall, or all of a hole, is in the grain."""

    def proof(region, x, y):
        grain = vg.Packing.of([SQUARE_GRAIN], region, position=[(x, y, 0)], scale=[UNIT_SIDE], gravity=None)
        corners = grain.position[0, :2] + np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) / 2
        assert region.signed_distance(corners).max() < 0
        return vg.verify(grain)

    roofed = Polygon(HOLED.corners)
    assert proof(roofed, 3.0, 2.0 - 1e-6).ok
    assert proof(roofed, 3.0, 2.0 + 1e-6).escaped == 1
    pierced = Polygon(SQUARE, holes=[[(3, 2), (3.1, 2), (3, 2.1)]])
    assert proof(pierced, 3.2, 2.2).escaped == 1
    assert proof(pierced, 3.61, 2.2).ok


def test_profiles_along_axes_are_exact():
    region = Polygon(SQUARE, holes=[HOLE])
    packing = vg.Packing.of([DISK], region, position=[(4.5, 2, 0)], scale=[2.0], gravity=None)
    profile = axis_profile(packing, "x", bins=6)
    # a disk of radius 1 about 4.5: a segment beyond 4, the strip between, and a segment beyond 5
    segment = math.pi / 3 - math.sqrt(3) / 4
    np.testing.assert_allclose(
        profile.solid_fraction * (4, 4, 3, 4, 4, 4), [0, 0, 0, segment, math.pi - 2 * segment, segment], atol=1e-12
    )
    assert profile.error.max() == 0.0
    rooms = axis_profile(vg.Packing.of([DISK], HOLED, position=[(1, 1, 0)], scale=[2.0], gravity=None), "y", bins=4)
    # the hole takes 1 of the second slice; the roof narrows the last two
    solid = [math.pi / 2, math.pi / 2, 0, 0]
    np.testing.assert_allclose(rooms.solid_fraction, np.array(solid) / (6, 5, 6 - 0.5, 2), atol=1e-12)


def test_regions_within_the_walls_are_sampled_and_tell_their_error():
    packing = vg.Packing.of([DISK], Polygon(SQUARE, holes=[HOLE]), position=[(4.5, 2, 0)], gravity=None)
    for inset in (0.2, 0.5):
        room = Regions(packing).at(inset).volume
        wanted = (6 - 2 * inset) * (4 - 2 * inset) - 1 - 4 * inset - math.pi * inset**2
        assert 0 < room.error < 0.01 * wanted
        assert abs(room - wanted) < 4 * room.error
    # concentric squares: the solid begins at a distance of 1 from the wall
    container = Polygon([(0, 0), (4, 0), (4, 4), (0, 4)])
    square = vg.Packing.of([SQUARE_GRAIN], container, position=[(2, 2, 0)], scale=[2 * UNIT_SIDE], gravity=None)
    wall = wall_profile(square, step=0.25)
    np.testing.assert_array_equal(wall.solid_fraction[:3], 0.0)
    # points of a grain lie in fine voxels, a half of which reaches beyond its surface
    assert 0.0 <= wall.solid_fraction[3] < 0.02
    inside = slice(4, 8)
    assert (np.abs(wall.solid_fraction[inside] - 1.0) < 4 * wall.error[inside]).all()
    assert (wall.error[inside] > 0).all()
    assert wall.error[4] < 0.1


def test_the_bulk_of_a_region_is_that_of_its_rectangle():
    """The same grains in the same walls: one time exact, one time sampled."""
    packing = vg.pack(DISK, vg.Rectangle((9, 7)), "rsa", sizes=vg.sizes.uniform(0.3, 0.5), seed=3)
    exact = bulk_solid_fraction(packing)
    found = bulk_solid_fraction(replace(packing, container=Polygon([(0, 0), (9, 0), (9, 7), (0, 7)])))
    assert exact.error == 0.0
    assert 0 < found.error < 0.01
    assert abs(found - exact) < 4 * found.error


def test_grains_settle_in_a_region_with_a_hole():
    loose = packed("rsa")
    with pytest.raises(
        InputError, match=r"packing.gravity is None: .*; give gravity='-y' along an axis that has walls$"
    ):
        vg.settle(loose)
    bed = vg.settle(loose, gravity="-y")
    assert bed.stop_reason == "settled"
    assert vg.verify(bed).ok
    assert bed.gravity == (0.0, -1.0, 0.0)
    # grains came to rest on the hole, and some below it on the floor
    x, y = bed.position[:, :2].T
    over = (x > 0.9) & (x < 1.5)
    assert ((y > 1.5) & over).any()
    assert ((y < 0.9) & over).any()
    assert y.mean() < loose.position[:, 1].mean()
