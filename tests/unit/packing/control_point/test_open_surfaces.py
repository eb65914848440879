"""Open surfaces in control-point packing: none passes through another, and all else holds as for solids."""

import json
import math

import kit
import numpy as np
import pytest
from kit import slow
from scipy.spatial import cKDTree

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran.contacts.triangles import nearest_points
from voxgran.geometry.rotation import random_rotations, rotation_matrices
from voxgran.packing.control_point.precompute import KEPT, WAY
from voxgran.points.control import edge_points, sample_controls

pytestmark = [pytest.mark.filterwarnings("ignore:the bulk holds"), pytest.mark.usefixtures("jagged_pictures")]

SHEETS = [
    vg.make_shape("sheet"),
    vg.make_shape("sheet", roll=200),
    vg.make_shape("random_surface", max_frequency=0.5, height=0.3, seed=1),
]
QUICK = {"method": "control_point", "contact": "kdtree", "spacing": 0.25, "sweeps": 150, "cycles": 2}


def poses_apart(generator, points, keep):
    """Return a pose of the first points at which they just keep a distance from the second ones."""
    tree, turn = cKDTree(points[1]), rotation_matrices(random_rotations(generator, 1))[0]
    way, low, high = generator.normal(size=3), 0.0, 3.0
    way /= np.linalg.norm(way)
    for _ in range(20):
        middle = (low + high) / 2
        near = tree.query(points[0] @ turn.T + middle * way)[0].min()
        low, high = (middle, high) if near < keep else (low, middle)
    return turn, high * way


def crosses_on_the_way(shapes, begin, end, parts=40):
    """Return whether the first surface, its points led straight from one pose to another, meets the second one."""
    one, other = (shape.geometry.tree for shape in shapes)
    for share in np.linspace(0.0, 1.0, parts + 1):
        matrix, offset = ((1 - share) * first + share * last for first, last in zip(begin, end, strict=True))
        if nearest_points(other, one, matrix=matrix, offset=offset, reach=1e-6)[0] <= 1e-12:
            return True
    return False


def moves(seed, length, count):
    """Yield random moves, by a length in sums of covering radii at the most, between poses that both are allowed."""
    generator = np.random.default_rng(seed)
    samples = [sample_controls(shape, spacing=0.3, seed=0) for shape in SHEETS]
    while count:
        a, b = generator.integers(0, len(SHEETS), 2)
        points = np.asarray(samples[a]), np.asarray(samples[b])
        cover = (samples[a].spacing + samples[b].spacing) / 2
        begin = poses_apart(generator, points, KEPT * cover)
        half = 0.5 * length * cover
        way = generator.normal(size=3)
        # toward the other one, more often than not
        way = half * (way / np.linalg.norm(way) - begin[1] / np.linalg.norm(begin[1]))
        way *= min(1.0, half / np.linalg.norm(way))
        angle = half / SHEETS[a].bounding_radius * (2 * generator.random() - 1)
        axis = generator.normal(size=3)
        axis *= math.sin(angle / 2) / np.linalg.norm(axis)
        spin = rotation_matrices(np.array([[math.cos(angle / 2), *axis]]))[0]
        end = spin @ begin[0], begin[1] + way
        if cKDTree(points[1]).query(points[0] @ end[0].T + end[1])[0].min() >= KEPT * cover:
            count -= 1
            yield (SHEETS[a], SHEETS[b]), begin, end


@pytest.mark.parametrize("count", [50, slow(250)])
def test_no_step_leads_through_a_surface(count):
    """Whatever the two poses, if both are allowed and no farther apart than a step, nothing crosses between them."""
    assert pytest.approx(2 * math.sqrt(KEPT**2 - 1)) == WAY
    assert not any(crosses_on_the_way(*move) for move in moves(seed=1, length=WAY, count=count))


def test_longer_steps_would():
    assert any(crosses_on_the_way(*move) for move in moves(seed=2, length=12.0, count=40))


@pytest.mark.slow
def test_no_move_of_a_walk_leads_through_a_surface():
    """Each accepted move of a crowded bed, with the longest steps, led straight from pose to pose past all others."""
    settings = {
        "contact": "kdtree",
        "spacing": 0.25,
        "step": 10.0,
        "feed": "at_once",
        "gravity": "none",
        "sweeps": 10_000,
    }
    task = kit.task_of("control_point", SHEETS, vg.Box((2.1, 2.1, 2.1)), count=6, seed=5, **settings)
    method, problem, moved = task.method, task.problem, 0
    state = method.advance(problem, method.prepare(problem), 3000)
    assert state.counters["placed"] == 6
    for _ in range(1000):
        before = [state.arrays[name].copy() for name in ("position", "orientation")]
        state = method.advance(problem, state, 1)
        after = [state.arrays[name] for name in ("position", "orientation")]
        changed = np.flatnonzero((before[0] != after[0]).any(axis=1))
        for g in changed.tolist():
            turns = [rotation_matrices(orientation[g : g + 1])[0] for orientation in (before[1], after[1])]
            for j in range(6):
                back = rotation_matrices(after[1][j : j + 1])[0].T
                begin, end = (
                    (back @ turn, back @ (place[g] - after[0][j]))
                    for turn, place in zip(turns, (before[0], after[0]), strict=True)
                )
                pair = tuple(problem.shapes[problem.shape_id[k]] for k in (g, j))
                assert j == g or not crosses_on_the_way(pair, begin, end, 6)
            moved += 1
    assert moved > 25


@pytest.mark.parametrize("prisoner", [slow("sphere"), "sheet"])
def test_what_is_in_a_shell_with_a_small_hole_stays_there(prisoner):
    """The longest steps that are allowed, 4000 sweeps without gravity, and no way out but through the shell."""
    shell = vg.make_shape("shell", opening=300, diameter=6.0)
    radius = np.ptp(shell.vertices[:, 0]) / 2
    grain = vg.make_shape(prisoner, diameter=1.1 * radius)
    assert grain.bounding_radius > radius * math.sin(math.radians(30))
    center = np.array([0.0, 0.0, shell.vertices[0, 2] - radius])
    box = vg.Box((10, 10, 10))
    start = vg.Packing.of([shell, grain], box, position=[[5, 5, 5], center + 5], shape_id=[0, 1])
    found = vg.pack(
        [], box, start=start, method="control_point", contact="kdtree", gravity="none", step=10.0, sweeps=4000,
        spacing=0.06, seed=4,
    )  # fmt: skip
    assert found.provenance["counters"]["moves_accepted"] > 500
    away = found.position[1] - (found.position[0] + found.matrices[0] @ center)
    assert np.linalg.norm(away) < radius - 0.5 * grain.bounding_radius
    assert vg.verify(found).ok


CONTAINERS = [
    (vg.Box((3, 3, 5), periodic="xy"), {}),
    slow(vg.Box((4, 4, 4)), {"gravity": (1.0, 0.0, -1.0), "feed": "layers"}),
    slow(vg.Cylinder(radius=2.0, height=4.0), {"lid": True}),
    (vg.Sphere(radius=2.2), {}),
    (vg.ClosedMesh(vg.make_shape("solid_union", seed=3, diameter=5.0)), {}),
]


@pytest.mark.parametrize(("container", "more"), CONTAINERS, ids=lambda value: getattr(value, "kind", ""))
def test_surfaces_and_solids_pack_in_any_container(container, more):
    shapes = [*SHEETS, vg.make_shape("shell"), vg.make_shape("sphere"), vg.make_shape("box", aspect=(1, 1, 0.2))]
    found = vg.pack(shapes, container, count=12, seed=2, sizes=vg.sizes.lognormal(0.8, 0.2), **QUICK, **more)
    assert found.count == 12
    assert vg.verify(found).ok
    trees = vg.pack(
        shapes, container, count=12, seed=2, sizes=vg.sizes.lognormal(0.8, 0.2), **QUICK | more | {"contact": "kdtree"}
    )
    assert np.array_equal(trees.position, found.position)
    assert np.array_equal(trees.orientation, found.orientation)


def test_small_sheets_stay_out_of_large_solids():
    """Sheets that would have room within enter anywhere: none may come to lie inside."""
    large, small = vg.make_shape("sphere", diameter=4.0), vg.make_shape("sheet", diameter=0.6)
    start = vg.Packing.of([large], vg.Box((4.6, 4.6, 4.6)), position=[[2.3, 2.3, 2.3]])
    found = vg.pack(
        small, start.container, start=start, count=25, method="control_point", contact="kdtree", feed="at_once",
        gravity="none", spacing=0.1, sweeps=60, seed=0,
    )  # fmt: skip
    assert found.count == 26
    away = np.linalg.norm(found.position[1:] - found.position[0], axis=1)
    assert away.min() > 2.0
    assert vg.verify(found).ok


def test_a_sheet_keeps_clear_of_its_own_images():
    narrow = vg.Box((1.3, 1.3, 4), periodic="xy")
    found = vg.pack(vg.make_shape("sheet", lengths=(1.0, 0.6)), narrow, count=3, seed=1, **QUICK)
    assert found.count == 3
    assert vg.verify(found).ok
    bent = vg.make_shape("sheet", lengths=(1.5, 0.6), roll=60)
    wide = vg.verify(vg.Packing.of([bent], narrow, position=[[0.6, 0.6, 2]]))
    assert [(pair.i, pair.j) for pair in wide.pairs] == [(0, 0)]


def test_surfaces_keep_the_distance_that_is_asked_for():
    found = vg.pack(SHEETS, vg.Box((3, 3, 5)), count=8, distance=0.1, seed=1, **QUICK)
    assert found.contacts(0.5).gap.min() > 0.1


def test_a_border_is_covered_by_points():
    sheet = vg.make_shape("sheet", lengths=(2.0, 1.0))
    border = edge_points(sheet.vertices, sheet.faces, 0.25)
    assert len(border) == 2 * (8 + 4)
    assert (np.abs(np.abs(border[:, :2]) - [1.0, 0.5]).min(axis=1) < 1e-12).all()
    fold = vg.Shape.from_surface([[0, 0, 0], [0, 1, 0], [1, 0, 0], [0, 0, 1]], [[0, 1, 2], [0, 1, 3]])
    for faces in (fold.faces, fold.faces[:, ::-1]):
        crease = edge_points(fold.vertices, faces, 0.25) + fold.offset
        assert (np.linalg.norm(crease[:, [0, 2]], axis=1) < 1e-9).sum() == 5


@pytest.mark.usefixtures("jagged_pictures")
def test_files_measures_and_reports_of_surfaces_alone(tmp_path):
    found = vg.pack(SHEETS, vg.Box((3, 3, 4)), count=9, seed=3, **QUICK)
    assert found.solid_fraction == 0.0
    vg.save(found, tmp_path / "packing.vtp")
    again = vg.load(tmp_path / "packing.vtp")
    assert again.shapes == found.shapes
    assert np.array_equal(again.position, found.position)
    assert vg.verify(again).ok
    vg.save_scene(again, tmp_path / "scene.vtm")
    statistics = vg.measure(again)
    assert float(statistics["specific_surface"]) == pytest.approx(9 * math.pi / 4 / 36)
    assert float(statistics["porosity"]) == 1.0
    assert (statistics["/grains/volume"] == 0).all()
    assert np.isnan(statistics["/gradation/placed_volume"]).all()
    assert float(statistics["/gradation/placed_number"][-1]) == 1.0
    assert int(statistics["/grains/coordination_number"].sum()) > 0
    vg.save_statistics(statistics, tmp_path / "statistics.nc")
    vg.save_report(again, tmp_path / "report.html")
    assert json.loads((tmp_path / "report.json").read_text())


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"contact": "sdf"}, "'sheet' is an open surface and contact 'sdf': .* use contact 'kdtree'$"),
        ({"spacing": 0.01}, "spacing is 0.01 and shape 'sheet' an open surface: it must be at least 0.02"),
        ({"count": None}, "count is None and all shapes are open surfaces"),
        ({"weights_by": "volume"}, "weights_by is 'volume' and a shape is an open surface"),
        ({"overlap": 0.1}, "grains may overlap with contact 'sdf' only"),
    ],
)
def test_what_surfaces_cannot_do_is_refused(parameters, words):
    with pytest.raises(InputError, match=words):
        vg.pack(SHEETS[0], vg.Box((3, 3, 3)), **{"count": 3} | QUICK | parameters)


def test_a_plan_refuses_signed_distances_of_surfaces():
    shape, box, packing = {"family": "sheet"}, {"kind": "box", "lengths": [3, 3, 3]}, {"method": "control_point"}
    scene = vg.Scene.from_mapping({"shape": [shape], "container": box, "packing": packing | {"count": 3}})
    with pytest.raises(InputError, match="use contact 'kdtree'"):
        scene.plan()


def test_a_scene_with_a_sheet_from_a_file(tmp_path):
    vg.save_shape(SHEETS[2], tmp_path / "rag.obj")
    (tmp_path / "scene.toml").write_text(
        """
        [scene]
        [[shape]]
        file = "rag.obj"
        surface = true
        [[shape]]
        family = "random_surface"
        [container]
        kind = "box"
        lengths = [3, 3, 4]
        [packing]
        method = "control_point"
        contact = "kdtree"
        count = 4
        spacing = 0.3
        sweeps = 40
        [output]
        report = false
        """
    )
    scene = vg.Scene.from_toml(tmp_path / "scene.toml")
    plan = scene.plan()
    assert plan.solid_fraction == 0.0
    assert scene.run(tmp_path / "out").packing.count == 4
