"""Containers of several walls, a hopper first: packed, proven, measured, saved, written as decks."""

import dataclasses
import math

import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran.measures.crossings import Lines, outside_intervals

HOPPER = vg.Hopper(3.5, 1.0, 65.0)
SHAPES = [
    vg.make_shape("sphere", diameter=0.8),
    vg.make_shape("convex_polyhedron", seed=3, points=10, diameter=0.9),
    vg.make_shape("cylinder", radius=0.35, height=0.8),
]


# grains are large, to be few
pytestmark = pytest.mark.filterwarnings("ignore:outlet of the")

OTHERS = {
    "wedge": vg.Hopper(3.0, 1.0, 60.0, length=3.0, bin_height=1.0),
    "bin": vg.Hopper(3.0, 1.0, 45.0, bin_height=2.0, origin=(2.0, 1.0, -3.0)),
    "drum": vg.Drum(2.5, 4.0, "y"),
    "planes": vg.Planes([(-1, 0, 0), (0, -1, 0), (0, 0, -1), (1, 1, 1)], [(0, 0, 0)] * 3 + [(8, 0, 0)]),
    "walls": vg.Walls(
        [
            {"kind": "cylinder", "radius": 2.5, "axis": (1, 0, 2)},
            {"kind": "sphere", "radius": 3.5, "point": (0, 0.5, 0)},
            {"kind": "plane", "normal": (0.2, 0, 1), "point": (0, 0, 2)},
            {"kind": "cone", "radius": 2, "angle": 60, "point": (0, 0, -2)},
        ]
    ),
}


@pytest.fixture(scope="module")
def bed():
    """Return a bed at rest in the hopper."""
    return vg.pack(SHAPES, HOPPER, "gravity", count=60, seed=2)


def test_a_bed_rests_in_it_and_true_shapes_do_not_pass_the_cone(bed):
    assert bed.count == 60
    assert bed.stop_reason == "settled"
    assert vg.verify(bed).ok
    assert vg.equilibrium(bed).attrs["share_at_rest"] >= 0.95
    # some lie at the cone
    assert (HOPPER.boundary.round[0].distance(bed.position) < 0.45).sum() > 5


@pytest.mark.parametrize("name", OTHERS)
def test_beds_rest_in_the_others_and_have_their_volume(name):
    container = OTHERS[name]
    made = vg.pack(SHAPES, container, "gravity", count=30, seed=3)
    assert made.stop_reason == "settled"
    assert vg.verify(made).ok
    assert int((~vg.equilibrium(made).rests).sum()) <= 1
    lines = Lines.through(0, *container.bounds, 0.05, dimension=3)
    line, low, high = outside_intervals(container, lines)
    whole = lines.high - lines.low
    length = whole - np.bincount(line, np.clip(high, 0.0, whole) - np.clip(low, 0.0, whole), lines.count)
    assert length.sum() * lines.step.prod() == pytest.approx(container.volume, rel=2e-3)


def test_a_drum_is_a_cylinder_on_its_side():
    """Turned by 90 degrees, gravity and all, a bed in a cylinder is one in a drum."""
    upright = vg.pack(SHAPES, vg.Cylinder(2.5, 4.0), "gravity", gravity="-x", count=40, seed=3)
    turn = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    place = (upright.position - [0.0, 0.0, 2.0]) @ turn.T
    quaternion = np.array([math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0])
    w, v = quaternion[0], quaternion[1:]
    a, b = upright.orientation[:, 0], upright.orientation[:, 1:]
    turned = np.column_stack([w * a - b @ v, w * b + a[:, None] * v + np.cross(v, b)])
    drum = vg.Packing.of(
        SHAPES, vg.Drum(2.5, 4.0), position=place, scale=upright.scale, shape_id=upright.shape_id, orientation=turned,
        gravity="+z",
    )  # fmt: skip
    assert vg.verify(drum).ok
    both = [vg.equilibrium(one) for one in (upright, drum)]
    assert both[0].sizes["contact"] == both[1].sizes["contact"]
    # a grain or two of the settled ones may be undecided
    assert min(float(one.rests.mean()) for one in both) > 0.9
    np.testing.assert_allclose(np.sort(both[0].gap), np.sort(both[1].gap), atol=1e-7)


def test_random_sequential_addition_fills_it():
    packing = vg.pack(SHAPES, HOPPER, "rsa", count=50, seed=1)
    assert packing.count > 30
    assert vg.verify(packing).ok


@pytest.mark.parametrize("index", range(3))
def test_a_grain_that_is_pushed_through_the_cone_by_a_millionth_is_found(index):
    wall, shape, place = HOPPER.boundary.round[0], SHAPES[index], np.array([0.9, -0.4, 2.5])
    outward = np.array([wall.cosine * place[0], wall.cosine * place[1], 0.0]) / math.hypot(*place[:2])
    outward[2] = wall.sine
    turn = np.array([0.8, 0.4, -0.2, 0.4])
    points, radius = shape.vertices, 0.0
    if index == 0:
        points, radius = np.zeros((1, 3)), 0.4
    if index == 2:
        angle = 2 * math.pi * np.arange(20_000) / 20_000
        rim = np.column_stack([0.35 * np.cos(angle), 0.35 * np.sin(angle)])
        points = np.concatenate([np.column_stack([rim, np.full(len(rim), z)]) for z in (-0.4, 0.4)])
    one = vg.Packing.of([shape], HOPPER, position=place[None], scale=[1.0], shape_id=[0], orientation=turn[None])
    turned = points @ one.matrices[0].T

    # the way along the normal, on which the distance of no point changes by more
    way = 0.0
    for _ in range(30):
        way += wall.distance(place + way * outward + turned).min() - radius
    for by, escaped in ((-1e-6, 0), (1e-6, 1)):
        moved = dataclasses.replace(one, position=(place + (way + by) * outward)[None])
        assert vg.verify(moved).escaped == escaped


def test_its_measures_are_those_of_a_frustum(bed):
    with pytest.warns(vg.PackingWarning, match="the bulk holds"):
        tree = vg.measure(bed, ["density", "profile"])
    assert float(tree["/"].solid_fraction) == pytest.approx(bed.volumes.sum() / HOPPER.volume, rel=1e-12)
    profile = tree["profiles"]
    z, step = profile.z.values, float(np.diff(profile.z.values)[0])
    low, high = ((HOPPER.outlet + (z + s * step / 2) / math.tan(math.radians(65))) for s in (-1, 1))
    rooms = math.pi * step / 3 * (low**2 + low * high + high**2)
    solid = float((profile.solid_fraction_z.values * rooms).sum())
    assert solid == pytest.approx(bed.volumes.sum(), rel=1e-3)


@pytest.mark.parametrize("axis", range(3))
def test_lines_through_it_are_inside_over_its_volume(axis):
    lower, upper = HOPPER.bounds
    lines = Lines.through(axis, lower, upper, 0.05, dimension=3)
    line, low, high = outside_intervals(HOPPER, lines)
    whole = lines.high - lines.low
    length = whole - np.bincount(line, np.clip(high, 0.0, whole) - np.clip(low, 0.0, whole), lines.count)
    assert length.sum() * lines.step.prod() == pytest.approx(HOPPER.volume, rel=2e-3)


@pytest.mark.parametrize("engine", ["lammps", slow("yade")])
def test_engines_get_its_walls_as_they_are_or_as_triangles_outside_of_it(bed, engine, tmp_path):
    deck = vg.write_deck(bed, tmp_path, engine)
    files = {path.name: path.read_text() for path in tmp_path.iterdir()}
    if engine == "yade":
        rows = [row for row in files["yade_facets.txt"].splitlines() if not row.startswith("#")]
        corners = np.loadtxt(rows)[:, :9].reshape(-1, 3, 3)
        assert len(corners) > 100
        scale = deck.simulation.walls.bounds[1, 2] / HOPPER.bounds[1, 2]
        outside = HOPPER.signed_distance(corners.mean(axis=1) / scale)
        assert outside.min() > -1e-9
        assert outside.max() < 2e-3 * deck.simulation.diameter / scale
    else:
        assert " cone z 0.0 0.0 " in files["lammps_run.in"]


def test_methods_that_know_no_cones_refuse_it():
    with pytest.raises(
        InputError, match="Hopper, with tilted, conical or several round walls, which method 'deposition' does"
    ):
        vg.pack(SHAPES[:1], HOPPER, "deposition", count=3)


def test_scenes_make_it_by_its_kind_and_files_keep_it(tmp_path):
    mapping = {"kind": "hopper", "radius": 3.5, "outlet": 1.0, "angle": 65.0}
    assert vg.make_container(mapping) == HOPPER
    with pytest.raises(InputError, match="outlet is missing: kind 'hopper' needs it"):
        vg.make_container({"kind": "hopper", "radius": 3.0})
    packing = {"method": "rsa", "count": 5}
    scene = vg.Scene.from_mapping({"shape": [{"family": "sphere"}], "container": mapping, "packing": packing})
    assert scene.container == HOPPER
    made = vg.pack(SHAPES[:1], HOPPER, "rsa", count=3)
    for name in ("bed.vtp", "bed.txt"):
        made.save(tmp_path / name)
        assert vg.load(tmp_path / name).container == HOPPER
