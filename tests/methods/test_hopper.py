"""A container of a package of one's own, with a cone as a wall: packed, proven, measured, saved, written as decks."""

import dataclasses
import math

import numpy as np
import pytest
from kit import example_hopper, install

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran.measures.crossings import Lines, outside_intervals

Hopper = example_hopper()
HOPPER = Hopper(3.5, 1.0, 65.0)
SHAPES = [
    vg.make_shape("sphere", diameter=0.8),
    vg.make_shape("convex_polyhedron", seed=3, points=10, diameter=0.9),
    vg.make_shape("cylinder", radius=0.35, height=0.8),
]


@pytest.fixture
def registered(tmp_path, monkeypatch):
    """Register the package of the example without installing it."""
    install(tmp_path, "voxgran-example", {"voxgran.containers": {"hopper": "voxgran_hopper:registration"}})
    monkeypatch.syspath_prepend(str(tmp_path))


@pytest.fixture(scope="module")
def bed():
    """Return a bed at rest in the hopper."""
    return vg.pack(SHAPES, HOPPER, "gravity", count=60, seed=2)


def test_a_bed_rests_in_it_and_true_shapes_do_not_pass_the_cone(bed):
    assert bed.count == 60
    assert bed.stop_reason == "settled"
    assert vg.verify(bed).ok
    assert bool(vg.equilibrium(bed).rests.all())
    # some lie at the cone
    assert (HOPPER.boundary.round[0].distance(bed.position) < 0.45).sum() > 5


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


@pytest.mark.parametrize("engine", ["lammps", "yade"])
def test_engines_get_its_walls_as_triangles(bed, engine, tmp_path):
    vg.write_deck(bed, tmp_path, engine)
    files = {path.name: path.read_text() for path in tmp_path.iterdir()}
    if engine == "yade":
        assert len(files["yade_facets.txt"].splitlines()) > 100
    else:
        assert files["lammps_run.in"].count("region") > 60


def test_methods_that_know_no_cones_refuse_it():
    with pytest.raises(InputError, match="Hopper, with tilted, conical or several round walls, which method 'deposition' does"):
        vg.pack(SHAPES[:1], HOPPER, "deposition", count=3)


@pytest.mark.usefixtures("registered")
def test_scenes_make_it_by_its_kind_and_files_keep_it(tmp_path):
    mapping = {"kind": "hopper", "radius": 3.5, "outlet": 1.0, "angle": 65.0}
    assert vg.make_container(mapping) == HOPPER
    with pytest.raises(InputError, match="outlet is missing: a hopper needs it"):
        vg.make_container({"kind": "hopper", "radius": 3.0})
    packing = {"method": "rsa", "count": 5}
    scene = vg.Scene.from_mapping({"shape": [{"family": "sphere"}], "container": mapping, "packing": packing})
    assert scene.container == HOPPER
    made = vg.pack(SHAPES[:1], HOPPER, "rsa", count=3)
    for name in ("bed.vtp", "bed.txt"):
        made.save(tmp_path / name)
        assert vg.load(tmp_path / name).container == HOPPER
