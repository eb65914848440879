"""Cells of weighted seeds against SciPy, and weights that give them volumes."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull, HalfspaceIntersection, Voronoi

import voxgran as vg
from voxgran.containers.kernel_container import kernel_container
from voxgran.geometry import polyhedron
from voxgran.packing.method import State
from voxgran.packing.tessellation.voronoi_cells import Cells, seeds_of
from voxgran.packing.tessellation.voronoi_grains import corners_of, largest_factor, shapes_of
from voxgran.packing.tessellation.voronoi_steps import first_arrays, step, weight_steps
from voxgran.packing.tessellation.voronoi_walls import PROTRUSION

BENT = vg.Polygon([(0, 0), (4, 0), (4, 1), (1, 1), (1, 3), (0, 3)])


def points_in(container, count, seed=0):
    """Return random points in a container, from its lower corner."""
    lower, upper = container.bounds
    points = lower + np.random.default_rng(seed).random((20 * count, 3)) * (upper - lower)
    return points[container.signed_distance(points) < 0][:count] - lower


def diagram_of(container, place, weight=None):
    cells = Cells(kernel_container(container, from_corner=True))
    seeds = seeds_of(place, np.zeros(len(place)) if weight is None else weight, cells.walls)
    return cells, seeds, cells.measured(seeds, 7, lambda: None)


def images_of(container, place, weight):
    """Return seeds and weights with all periodic images next to the container; the seeds come first."""
    lengths = np.append(container.lengths, 0)[:3]
    steps = np.array([(x, y, z) for x in (0, -1, 1) for y in (0, -1, 1) for z in (0, -1, 1)])
    kept = [step for step in steps if not step[~np.array(container.periodic)].any()]
    return np.vstack([place + step * lengths for step in kept]), np.tile(weight, len(kept))


def by_half_spaces(container, place, weight, i):
    """Return volume and centroid of a cell as an intersection of half-spaces; 0 for an empty one."""
    d, lengths = container.dimension, np.array(container.lengths)
    seeds, weights = images_of(container, place, weight)
    others = np.arange(len(seeds)) != i
    normals = 2 * (seeds[others] - seeds[i])[:, :d]
    offsets = (seeds[others] ** 2).sum(axis=1) - (seeds[i] ** 2).sum() + weights[i] - weights[others]
    walls = np.vstack([np.eye(d), -np.eye(d)])
    # across periodic axes the own images are among the seeds
    ends = np.concatenate([np.where(container.periodic[:d], 9.0, lengths), np.where(container.periodic[:d], 9.0, 0)])
    rows = np.column_stack([np.vstack([normals, walls]), -np.concatenate([offsets, ends])])
    from scipy.optimize import linprog

    norm = np.linalg.norm(rows[:, :d], axis=1)
    inner = linprog(
        [0] * d + [-1], A_ub=np.column_stack([rows[:, :d], norm]), b_ub=-rows[:, d], bounds=[(-9, 9)] * (d + 1)
    )
    if inner.x[-1] < 1e-9:
        return 0.0, None
    corners = HalfspaceIntersection(rows, inner.x[:d]).intersections
    hull = ConvexHull(corners)
    middle = corners.mean(axis=0)
    parts = [corners[simplex] - middle for simplex in hull.simplices]
    sizes = np.array([abs(np.linalg.det(part)) for part in parts])
    return hull.volume, middle + sum(s * p.sum(axis=0) for s, p in zip(sizes, parts, strict=True)) / sizes.sum() / (
        d + 1
    )


@pytest.mark.parametrize(
    "container", [vg.Box((3, 2, 2.5)), vg.Box((3, 2, 2.5), "xz"), vg.Rectangle((3, 2)), vg.Rectangle((3, 2), "xy")]
)
def test_weighted_cells_are_intersections_of_half_spaces(container):
    place = points_in(container, 40)
    weight = 0.4 * np.random.default_rng(1).random(40)
    _, _, diagram = diagram_of(container, place, weight)
    assert diagram.volume.sum() == pytest.approx(container.volume, rel=1e-12)
    empty = 0
    for i in range(40):
        volume, center = by_half_spaces(container, place, weight, i)
        assert diagram.volume[i] == pytest.approx(volume, abs=1e-9)
        empty += volume == 0
        if volume > 1e-6:
            assert diagram.center[i, : container.dimension] == pytest.approx(center, abs=1e-7)
    # some seeds lose against heavier ones
    assert empty > 0


def test_equal_weights_give_the_voronoi_cells_of_scipy():
    container = vg.Box((2, 2, 2), "xyz")
    place = points_in(container, 60)
    seeds, _ = images_of(container, place, np.zeros(60))
    whole = Voronoi(seeds)
    _, _, diagram = diagram_of(container, place)
    volumes = [ConvexHull(whole.vertices[whole.regions[whole.point_region[i]]]).volume for i in range(60)]
    assert diagram.volume == pytest.approx(np.array(volumes), rel=1e-9)
    faces = np.isin(whole.ridge_points, np.arange(60)).sum()
    assert len(diagram.beyond) == faces


@pytest.mark.parametrize(
    ("container", "error"), [(vg.Cylinder(2, 3), 4e-3), (vg.Sphere(2), 8e-3), (vg.Disk(2), 2e-3), (BENT, 1e-2)]
)
def test_cells_fill_other_containers_and_stay_inside(container, error):
    place = points_in(container, 150)
    cells, seeds, diagram = diagram_of(container, place)
    assert diagram.volume.sum() == pytest.approx(container.volume, rel=error)
    for i in range(150):
        corners = corners_of(cells, seeds, i)
        size = np.linalg.norm(corners[:, : container.dimension], axis=1).max()
        corners += place[i] + container.bounds[0]
        if container.dimension == 2:
            corners[:, 2] = 0
        # beyond a round wall by the share that the cells allow, and not at all beyond edges
        slack = PROTRUSION * size if container is not BENT else 0.0
        assert container.signed_distance(corners).max() <= slack + 1e-9


def test_one_cell_is_the_container():
    for container in (vg.Box((3, 2, 1)), vg.Rectangle((3, 2), "x"), vg.Polygon([(0, 0), (3, 0), (3, 2), (0, 2)])):
        _, _, diagram = diagram_of(container, points_in(container, 1))
        assert diagram.volume[0] == pytest.approx(container.volume, rel=1e-12)
        assert len(diagram.beyond) == 0


def test_slopes_are_the_derivatives_of_volumes():
    container = vg.Box((2, 2, 2), "xy")
    place = points_in(container, 30)
    weight = 0.02 * np.random.default_rng(2).random(30)
    step = 1e-6 * np.random.default_rng(3).normal(size=30)
    _, _, diagram = diagram_of(container, place, weight)
    _, _, more = diagram_of(container, place, weight + step)
    _, _, less = diagram_of(container, place, weight - step)
    change = np.zeros(30)
    for i in range(30):
        faces = slice(diagram.start[i], diagram.start[i + 1])
        change[i] = (diagram.slope[faces] * (step[i] - step[diagram.beyond[faces]])).sum()
    assert (more.volume - less.volume) / 2 == pytest.approx(change, abs=1e-10)
    # and the steps of the weights are the inverse of that
    again = weight_steps(diagram, diagram.volume + change)
    assert again == pytest.approx(step - step.mean(), abs=1e-10)


def final_cells(container, share, smoothing, seed=0):
    place = points_in(container, len(share), seed)
    cells = Cells(kernel_container(container, from_corner=True))
    state = State({**first_arrays(place), "tally": np.zeros(6, dtype=np.int64)}, {})
    while not state.arrays["tally"][2]:
        step(cells, state, share, smoothing, lambda: None)
    seeds = seeds_of(state.arrays["known_place"], state.arrays["known_weight"], cells.walls)
    return state, cells, seeds, cells.measured(seeds, 50, lambda: None)


@pytest.mark.parametrize(
    ("container", "sigma", "error"),
    [
        (vg.Box((3, 3, 3), "x"), 0.6, 1e-4),
        (vg.Rectangle((3, 2)), 1.0, 1e-4),
        (vg.Cylinder(2, 3), 0.4, 0.02),
        (BENT, 0.4, 0.02),
    ],
)
def test_cells_get_the_volumes_that_are_asked_for(container, sigma, error):
    volumes = np.exp(container.dimension * sigma * np.random.default_rng(4).normal(size=80))
    state, _, _, diagram = final_cells(container, volumes / volumes.sum(), 6)
    found = diagram.volume / diagram.volume.sum() * volumes.sum()
    assert found == pytest.approx(volumes, rel=error)
    assert state.arrays["error"][0] <= error
    assert state.arrays["tally"][1] < 80


def test_smoothed_cells_are_rounder():
    container, share = vg.Rectangle((5, 5), "xy"), np.full(60, 1 / 60)
    found = []
    for smoothing in (0, 30):
        _, cells, seeds, _ = final_cells(container, share, smoothing)
        shapes = shapes_of(cells, seeds)
        found.append(np.mean([shape.surface_area / np.sqrt(shape.volume) for shape in shapes]))
    # a regular hexagon has 3.722
    assert 3.722 < found[1] < 3.82
    assert found[0] > 4


def test_shapes_of_cells_have_their_volumes_and_places():
    for container in (vg.Box((2, 2, 2)), vg.Rectangle((2, 3), "y")):
        place = points_in(container, 30)
        cells, seeds, diagram = diagram_of(container, place)
        shapes = shapes_of(cells, seeds)
        assert [shape.volume for shape in shapes] == pytest.approx(diagram.volume, rel=1e-5)
        assert np.array([shape.offset for shape in shapes]) == pytest.approx(diagram.center, abs=1e-5)


def test_cells_shrink_into_a_round_wall():
    cells, seeds, _ = diagram_of(vg.Sphere(2), points_in(vg.Sphere(2), 40))
    touching = 0
    for shape in shapes_of(cells, seeds):
        factor = largest_factor(shape, cells.walls)
        far = np.linalg.norm(np.array(shape.offset) - 2 + factor * shape.vertices, axis=1).max()
        assert far <= 2 + 1e-12
        touching += far > 2 - 1e-9
        assert 0.9 < factor <= 1
    assert touching > 10


def clipped(*planes, faces=20):
    """Return what is left of the cube from -1 to 1, and what the last cut has done."""
    cell = polyhedron.empty_polyhedron(faces)
    polyhedron.set_box(cell, -np.ones(3), np.ones(3))
    state = polyhedron.UNCUT
    for normal, offset in planes:
        x, y, z = np.array(normal) / np.linalg.norm(normal)
        state = polyhedron.clip(cell, x, y, z, offset / np.linalg.norm(normal), 3, 1.0)
    center = np.zeros(3)
    return cell, state, polyhedron.volume_and_center(cell, center), center


@pytest.mark.slow
def test_a_plane_cuts_off_a_corner_of_a_cube():
    cell, state, volume, center = clipped(((1, 1, 1), 2))
    # a tetrahedron with edges 1, 1, 1 at the corner, whose centroid is a quarter of the way
    assert state == polyhedron.CUT
    assert volume == pytest.approx(8 - 1 / 6)
    assert center == pytest.approx(-(1 / 6) * 0.75 / volume * np.ones(3))
    assert cell.count.tolist() == [10, 7]
    assert polyhedron.area_of_face(cell, 6) == pytest.approx(np.sqrt(3) / 2)
    assert polyhedron.reach_of(cell, False) == pytest.approx(np.sqrt(3))
    assert polyhedron.reach_of(cell, True) == pytest.approx(np.sqrt(2))


def test_cuts_that_take_nothing_or_all_or_have_no_room():
    assert clipped(((1, 0, 0), 1))[1:3] == (polyhedron.UNCUT, pytest.approx(8))
    assert clipped(((1, 0, 0), -1.5))[1] == polyhedron.EMPTY
    assert clipped(((1, 2, 3), 1), faces=7)[1] == polyhedron.CROWDED
    # through corners and edges
    assert clipped(((1, 1, 0), 0))[2] == pytest.approx(4)
    assert clipped(((1, 1, 0), 0), ((1, -1, 0), 0), ((0, 0, 1), 0))[2] == pytest.approx(1)


def test_many_faces_make_the_work_space_grow():
    # small cells around a large one
    rng = np.random.default_rng(6)
    around = rng.normal(size=(400, 3))
    around = 2 + 1.2 * around / np.linalg.norm(around, axis=1)[:, None]
    place = np.vstack([around, [(2, 2, 2)]])
    cells, _, diagram = diagram_of(vg.Box((4, 4, 4)), place, np.append(np.zeros(400), 1.0))
    assert len(cells.work.size) > 64
    assert diagram.start[-1] - diagram.start[-2] > 200
    assert diagram.volume.sum() == pytest.approx(64)
