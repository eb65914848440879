"""Random points that get the largest copy of a true shape that fits, also rotated (random Apollonian packing)."""

import warnings

import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran._base.errors import LongRunWarning
from voxgran.geometry.rotation import rotation_matrices
from voxgran.packing import method as packing_method
from voxgran.packing.draw import Request
from voxgran.packing.driver import Drive, drive
from voxgran.packing.pack import prepare_task
from voxgran.shapes.model import Shape
from voxgran.shapes.spheres import Spheres

SQUARE = vg.make_shape("polygon", corners=4)
ELL = [(0, 0), (4, 0), (4, 2), (2, 2), (2, 4), (0, 4)]
CLUMP = Shape.of(Spheres(np.array([[0.0, 0, 0], [1.1, 0, 0], [0, 0.9, 0.3]]), np.array([0.8, 0.6, 0.5])), name="clump")
UNION = vg.make_shape("solid_union", seed=1)


def filled(shapes, container, **options):
    """Return a packing that is proven to be free of overlap."""
    packing = vg.pack(shapes, container, method="random_apollonian", **options)
    assert vg.verify(packing).ok
    return packing


def enlarged(packing, grain, factor):
    """Return the grains up to one, which is so many times as large."""
    scale = packing.scale[: grain + 1].copy()
    scale[grain] *= factor
    return vg.Packing.of(
        packing.shapes,
        packing.container,
        position=packing.position[: grain + 1],
        scale=scale,
        shape_id=packing.shape_id[: grain + 1],
        orientation=packing.orientation[: grain + 1],
    )


CASES = {
    "squares": (SQUARE, vg.Rectangle((5, 4), periodic="x"), {}),
    "rotated squares": (SQUARE, vg.Rectangle((5, 4), periodic="xy"), {"rotate": 8, "shift": 1, "largest": 1.5}),
    "L in L": (vg.make_shape("polygon", vertices=ELL), vg.Polygon(ELL), {"rotate": 3}),
    "ellipsoids": (vg.make_shape("ellipsoid"), vg.Box((4, 4, 4), periodic="xy"), {"rotate": 3}),
    "boxes and spheres": ([vg.make_shape("box"), vg.make_shape("sphere")], vg.Cylinder(2, 4), {}),
    "cones in a mesh": (vg.make_shape("cone"), vg.ClosedMesh(UNION.scaled(4.0)), {}),
    "polyhedra": (vg.make_shape("convex_polyhedron", seed=1), vg.Sphere(2), {"shift": 1, "largest": 1.5}),
    "clumps": (CLUMP, vg.Box((4, 4, 4), periodic="z"), {"rotate": 3}),
    "unions": (UNION, vg.Box((4, 4, 4), periodic="x"), {}),
    "unions of a smallest size": (UNION, vg.ClosedMesh(UNION.scaled(5.0)), {"smallest": 0.4, "largest": 1.0}),
}


@pytest.mark.parametrize("name", [slow(name) if name == "cones in a mesh" else name for name in CASES])
def test_each_grain_touches_an_earlier_one_or_a_wall(name):
    shapes, container, options = CASES[name]
    packing = filled(shapes, container, count=40, **options)
    largest = options.get("largest", 0.25 * np.ptp(container.bounds, axis=0)[: packing.dimension].min())
    periodic = np.ptp(container.bounds, axis=0)[np.array(container.periodic)].min(initial=np.inf)
    for grain in range(0, 40, 3):
        # of shapes that are not convex, the bounding sphere meets its image first
        radius = packing.scale[grain] * packing.shapes[packing.shape_id[grain]].bounding_radius
        free = packing.diameter[grain] >= largest * (1 - 1e-9) or 2 * radius > periodic * (1 - 1e-9)
        # a cone is known to a mesh by its tessellation, with its error as a skin
        more = 1e-3 if name == "cones in a mesh" else 1e-6
        assert free or not vg.verify(enlarged(packing, grain, 1 + more)).ok


def support(corners, normals):
    """Return how far a polygon reaches along normals (a plain twin)."""
    return (corners @ normals.T).max(axis=0)


def test_the_scales_of_squares_are_those_of_separating_lines():
    packing = filled(SQUARE, vg.Rectangle((4, 4)), count=60, largest=4.0, seed=3)
    body = SQUARE.geometry.vertices - SQUARE.geometry.vertices.mean(axis=0)
    turns, found = rotation_matrices(packing.orientation)[:, :2, :2], []
    unit = [body @ turn.T for turn in turns]
    axes = np.vstack([np.eye(2), -np.eye(2)])
    for i, place in enumerate(packing.position[:, :2]):
        walls = support(np.array([[4.0, 4], [0, 0]]), axes) - axes @ place
        scales = [(walls / support(unit[i], axes)).min()]
        for j in range(i):
            # a normal of an edge of one of two convex polygons separates them
            sides = np.vstack([np.roll(unit[k], -1, axis=0) - unit[k] for k in (i, j)])
            normals = np.column_stack([sides[:, 1], -sides[:, 0]])
            normals = np.vstack([normals, -normals])
            other = packing.position[j, :2] - place + packing.scale[j] * unit[j]
            scales.append((-support(-other, normals) / support(unit[i], normals)).max())
        found.append(min(scales))
    assert packing.scale == pytest.approx(found, rel=1e-8)


@pytest.mark.slow
def test_polygons_of_many_corners_are_packed_as_disks():
    box = vg.Rectangle((6, 6), periodic="xy")
    disks = filled(vg.make_shape("disk"), box, count=60, seed=2)
    polygons = filled(vg.make_shape("polygon", corners=180), box, count=60, seed=2)
    assert polygons.position == pytest.approx(disks.position, abs=1e-12)
    assert polygons.diameter == pytest.approx(disks.diameter, abs=1e-3)


@pytest.mark.parametrize(
    ("shape", "container"),
    [
        (SQUARE, vg.Rectangle((6, 6), periodic="xy")),
        slow(vg.make_shape("ellipsoid"), vg.Box((5, 5, 5), periodic="xyz")),
    ],
    ids=["squares", "ellipsoids"],
)
def test_grains_that_are_rotated_or_move_fill_more(shape, container):
    options = [{}, {"rotate": 4}, {"rotate": 20}, {"rotate": 20, "shift": 1}]
    fractions = [filled(shape, container, count=400, largest=1.5, **some).solid_fraction for some in options]
    assert np.diff(fractions).min() > 0.01
    assert fractions[2] > fractions[0] + 0.05


def test_spheres_have_no_orientation():
    packing = filled([SQUARE, vg.make_shape("disk")], vg.Rectangle((5, 5)), count=60, rotate=5)
    turned = (packing.orientation != [1, 0, 0, 0]).any(axis=1)
    assert (turned == (packing.shape_id == 0)).all()


def test_the_first_square_in_a_periodic_one_fills_it():
    packing = filled(SQUARE, vg.Rectangle((2, 2), periodic="xy"), count=1, rotate=60, largest=9.0)
    assert packing.solid_fraction == pytest.approx(1.0, abs=1e-2)
    for rotate in (0, 60):
        one = filled(SQUARE, vg.Rectangle((2, 2), periodic="xy"), count=1, rotate=rotate)
        assert one.diameter == pytest.approx(0.5)


@pytest.mark.slow
@pytest.mark.parametrize("periodic", ["", "x", "xy"])
def test_rotated_squares_are_denser_by_default_too(periodic):
    # Delaney, Hutzler & Aste 2008: grains that are rotated fill more
    rectangle = vg.Rectangle((10, 10), periodic=periodic)
    for seed in range(3):
        random, rotated = (filled(SQUARE, rectangle, count=800, rotate=k, seed=seed).solid_fraction for k in (0, 20))
        assert 0.7 < random < rotated - 0.05 < 0.85


def test_solid_fraction_sizes_and_gaps_are_met():
    box = vg.Rectangle((5, 5))
    packing = filled(SQUARE, box, solid_fraction=0.55)
    assert packing.stop_reason == "solid_fraction"
    assert packing.solid_fraction == pytest.approx(0.55, abs=1e-12)
    packing = filled(SQUARE, box, smallest=0.1, largest=0.8)
    assert packing.stop_reason == "full"
    assert 0.1 <= packing.diameter.min() < packing.diameter.max() == pytest.approx(0.8, rel=1e-12)
    packing = filled(SQUARE, box, count=30, shrink=0.2, largest=5.0)
    for grain in range(30):
        assert vg.verify(enlarged(packing, grain, 1.25 * (1 - 1e-8))).ok
        assert not vg.verify(enlarged(packing, grain, 1.25 * (1 + 1e-6))).ok


def test_grains_of_a_start_stay_and_others_touch_them():
    box = vg.Rectangle((5, 5), periodic="y")
    start = filled(SQUARE, box, count=15, seed=1)
    packing = filled(SQUARE, box, count=25, start=start, seed=2)
    assert packing.scale[:15] == pytest.approx(start.scale, rel=1e-15)
    assert packing.orientation[:15].tobytes() == start.orientation.tobytes()
    assert not vg.verify(enlarged(packing, 20, 1 + 1e-6)).ok


@pytest.mark.parametrize("attempts", [1, 7])
def test_parts_of_a_run_give_the_same_bits(attempts):
    box = vg.Rectangle((5, 5), periodic="xy")
    rules = {"rotate": 5, "shift": 1}
    task = prepare_task(Request(SQUARE, box, "random_apollonian", count=30, seed=4, parameters=rules))
    whole = task.method.finish(task.problem, drive(task.method, task.problem, Drive()))
    state = task.method.prepare(task.problem)
    while not state.stop_reason:
        state = task.method.advance(task.problem, state, attempts)
        # a checkpoint holds arrays and counters
        state.derived.clear()
    again = task.method.finish(task.problem, state)
    for name in ("position", "scale", "orientation"):
        assert getattr(again, name).tobytes() == getattr(whole, name).tobytes()


def test_a_run_that_takes_long_says_so_before_it_starts_or_after_its_first_grains(monkeypatch):
    rock = vg.make_shape("solid_union", seed=1)
    box, few = vg.Box((10, 10, 10)), vg.simplify(rock, faces=100).shape

    def told(shapes, limit=None, **asked):
        with warnings.catch_warnings(record=True, action="ignore") as heard:
            warnings.simplefilter("always", LongRunWarning)
            vg.pack(shapes, box, "random_apollonian", seed=1, time_limit=limit, **asked)
        return [str(one.message) for one in heard]

    slow = told(rock, 0.0, count=5000)
    assert len(slow) == 1
    assert "method 'random_apollonian' is expected to take about" in slow[0]
    assert not told(few, 0.0, count=1000)
    assert not told(vg.make_shape("box"), 0.0, count=250_000)
    # the number of grains that a solid fraction takes is not known before some are made
    monkeypatch.setattr(packing_method, "LONG_RUN", 0.5)
    assert not told(few, solid_fraction=0.2)
    assert "fewer faces take less" in told(few, solid_fraction=0.25)[0]
