"""Frictionless beds: their descent against plain NumPy, and rest against linear programs of HiGHS."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from kit import slow
from scipy.optimize import linprog
from scipy.spatial import ConvexHull

import voxgran as vg
from tests.unit.settling.test_interior_point import DOWN
from voxgran.settling import equilibrium, stages
from voxgran.settling.equilibrium import normalized_bed
from voxgran.settling.progress import Progress
from voxgran.settling.soft_contacts import WIDE, Descent, Springs, descend, shares_of_corners, spring_forces

SHAPES = {
    "spheres": lambda: vg.shapes.sphere(),
    "hulls": lambda: [vg.make_shape("convex_polyhedron", points=20, seed=seed) for seed in range(4)],
    "ellipsoids": lambda: vg.make_shape("ellipsoid", aspect=(1.25, 1.0, 0.8)),
    "clumps": lambda: vg.fit_clump(vg.make_shape("solid_union", seed=1), max_spheres=8).to_shape(),
}


def random_springs(seed, count=12, many=30):
    """Return springs between random points of bodies, a fifth of them at walls, with motions of the bodies."""
    generator = np.random.default_rng(seed)
    i, j = generator.integers(0, count, many), generator.integers(0, count + 1, many)
    j[::5], j[i == j] = -1, -1
    line, arms = generator.normal(size=(many, 3)), 0.5 * generator.normal(size=(2, many, 3))
    reach = np.linalg.norm(line, axis=1) + 0.1 * generator.normal(size=many)
    springs = Springs(i, j, line, *arms, reach, generator.uniform(1.0, 3.0, many))
    return springs, 0.1 * generator.normal(size=(count + 1, 6))


def depths(springs, motion):
    """Return by how much springs are compressed, (m,), by plain NumPy."""
    lines = springs.line - motion[springs.i, :3] - np.cross(motion[springs.i, 3:], springs.arm_i)
    inner = (springs.j >= 0)[:, None]
    lines = lines + inner * (motion[springs.j, :3] + np.cross(motion[springs.j, 3:], springs.arm_j))
    return np.maximum(springs.reach - np.linalg.norm(lines, axis=1), 0.0)


def still(springs, motion):
    """Return bodies without gravity that make no step: the descent only writes their forces."""
    zeros, size = np.zeros_like(motion), (len(motion), 2)
    return Descent(motion, zeros.copy(), zeros.copy(), zeros[:, :3], np.zeros(size), np.ones(size), zeros[:, 0], DOWN)


def test_springs_push_as_their_energy_says():
    springs, motion = random_springs(1)
    push = spring_forces(springs, motion)
    np.testing.assert_allclose(push, springs.stiffness * depths(springs, motion), atol=1e-12)
    assert 5 < np.count_nonzero(push) < len(push)
    bodies = still(springs, motion)
    _, _, deepest = descend(springs, bodies, np.array([0.1, 0.1, 0.0]), 0, 0.0, 1.0, False)
    assert deepest == pytest.approx(depths(springs, motion).max())

    def energy(moved):
        return 0.5 * springs.stiffness @ depths(springs, moved) ** 2

    slope = np.zeros_like(motion)
    for body in range(len(motion)):
        for part in range(6):
            change = np.zeros_like(motion)
            change[body, part] = 1e-6
            slope[body, part] = (energy(motion + change) - energy(motion - change)) / 2e-6
    np.testing.assert_allclose(bodies.force[:-1], -slope[:-1], atol=1e-6)
    # the lid moves along gravity only
    np.testing.assert_allclose(bodies.force[-1], [0.0, 0.0, -slope[-1, 2], 0.0, 0.0, 0.0], atol=1e-6)


def shares(points, gaps):
    """Return the shares of contact points (k, 2) of one pair, with the gaps (k,)."""
    row = np.zeros((len(points), 16))
    row[:, 2], row[:, 3:5], row[:, 9] = 1.0, points, gaps
    return shares_of_corners(row, np.zeros(len(points), dtype=np.int64), np.ones(len(points), dtype=np.int64))


def turns(points):
    """Return the share of a full turn by which the boundary of the hull of points (k, 2) turns at each of them."""
    ring, found = ConvexHull(points).vertices, np.zeros(len(points))
    before, after = points[ring] - points[np.roll(ring, 1)], points[np.roll(ring, -1)] - points[ring]
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    found[ring] = np.arctan2(cross, (before * after).sum(axis=1)) / (2 * np.pi)
    return found


def test_shares_of_contact_points_are_the_turns_at_the_corners_of_their_polygon():
    generator = np.random.default_rng(0)
    for many in range(3, 10):
        points = generator.normal(size=(many, 2))
        np.testing.assert_allclose(shares(points, np.full(many, -1e-4)), turns(points), atol=1e-7)
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    inner = [[0.5, 0.0], [0.5, 0.5], [0.0, 0.0]]
    np.testing.assert_allclose(shares(np.vstack([corners, inner]), np.zeros(7)), [0.25] * 4 + [0.0] * 3, atol=1e-9)
    np.testing.assert_allclose(shares(corners[:2], np.zeros(2)), [0.5, 0.5])
    np.testing.assert_allclose(shares(corners[:1], np.zeros(1)), [1.0])
    # a corner with a wide gap counts by the share of the gaps at which it is there, and one that comes begins with none
    three = np.array([0.0, 0.0, 0.25 * WIDE])
    mean = 0.25 * np.array([0.5, 0.5, 0.0]) + 0.75 * turns(corners[:3])
    np.testing.assert_allclose(shares(corners[:3], three), mean, atol=1e-7)
    np.testing.assert_allclose(shares(corners[:3], [0.0, 0.0, WIDE * (1 - 1e-9)])[2], 0.0, atol=1e-8)


def test_springs_descend_to_the_compression_by_a_weight():
    """A column of three grains: each spring bears what lies above it, to the accuracy that is asked for."""
    zeros, down = np.zeros((3, 3)), np.tile(DOWN, (3, 1))
    springs = Springs(np.arange(3), np.arange(-1, 2), down, zeros, zeros, np.ones(3), np.array([30.0, 20.0, 10.0]))
    motion, lightness = np.zeros((4, 6)), np.zeros((4, 2))
    lightness[:3] = 4.0 / 60.0
    load = np.vstack([down, np.zeros(3)])
    bodies = Descent(motion, 0 * motion, 0 * motion, load, lightness, np.full((4, 2), 1e-6), np.zeros(4), DOWN)
    made, restless, deepest = descend(springs, bodies, np.array([0.05, 0.02, 0.0]), 20_000, 0.0, 9.0, True)
    assert restless == 0
    assert made < 5000
    np.testing.assert_allclose(spring_forces(springs, motion), [3.0, 2.0, 1.0], atol=1e-5)
    assert deepest == pytest.approx(0.1, abs=1e-6)


def least_descent(packing, far=0.01):
    """Return how far the mean grain can sink, over `far`, if touching points do not approach: by HiGHS."""
    bed = normalized_bed(packing, DOWN)
    bed.find(1e-3, 0.0)
    m, n = bed.m, bed.count
    row, i, j = bed.rows.row[:m], bed.rows.i[:m], bed.rows.j[:m]
    gaps = np.zeros((m, n, 6))
    for k in range(m):
        normal = row[k, :3]
        gaps[k, i[k]] -= np.concatenate([normal, np.cross(row[k, 3:6], normal)])
        if j[k] >= 0:
            gaps[k, j[k]] += np.concatenate([normal, np.cross(row[k, 6:9], normal)])
    mass = 1.0 / bed.bodies[:n, 6]
    height = np.zeros((n, 6))
    height[:, 2] = mass / mass.sum()
    solved = linprog(height.ravel(), A_ub=-gaps.reshape(m, -1), b_ub=np.zeros(m), bounds=(-1.0, 1.0), method="highs")
    assert solved.status == 0
    return -solved.fun


@pytest.mark.parametrize("kind", [slow(kind) if kind in ("clumps", "ellipsoids") else kind for kind in SHAPES])
def test_beds_rest_and_no_small_motion_lets_them_sink(kind):
    box = vg.Box((3.2, 3.2, 10), periodic="xy")
    bed = vg.pack(SHAPES[kind](), box, "gravity", count=40, friction=0.0, seed=2)
    assert bed.stop_reason == "settled"
    assert bed.verify().ok
    assert vg.equilibrium(bed, 0.0).attrs["share_at_rest"] >= (0.99 if kind == "hulls" else 0.95)
    # grains that rest may rise or sink by motions of which no part is larger than 1
    assert least_descent(bed) < 0.03
    rough = vg.pack(SHAPES[kind](), box, "gravity", count=40, seed=2)
    assert least_descent(rough) > 0.2


def test_large_beds_are_proven_from_the_forces_of_their_springs(monkeypatch):
    """As beds are for which an interior point takes too long; without these forces a gradient needs many rounds."""
    monkeypatch.setattr(equilibrium, "is_direct", lambda bed: False)
    box = vg.Box((6, 6, 20), periodic="xy")
    bed = vg.pack(SHAPES["spheres"](), box, "gravity", count=300, friction=0.0, seed=1)
    assert bed.stop_reason == "settled"
    assert bed.verify().ok
    few = {**equilibrium.balance_bed.__kwdefaults__, "iterations": 32}
    monkeypatch.setattr(equilibrium.balance_bed, "__kwdefaults__", few)
    assert vg.equilibrium(bed, 0.0).attrs["share_at_rest"] >= 0.98
    assert vg.equilibrium(dataclasses.replace(bed, forces=None), 0.0).attrs["share_at_rest"] < 0.5


@pytest.mark.parametrize(("count", "moving", "ends"), [(4999, 0.02, False), (5000, 0.02, True), (5000, 0.03, False)])
def test_a_bed_of_many_grains_is_left_once_enough_of_them_rest(monkeypatch, count, moving, ends):
    """The last steps of a large bed take most of its time; trembling springs do not say that it rests."""
    monkeypatch.setattr(stages, "soft_step", lambda bed, size, velocity, **how: (0.99, velocity, 4e-4))
    progress, ended = Progress(stage=stages.STILL, still_steps=3, length=1e-4), []

    def examine(iterations):
        assert iterations == (stages.THOROUGH if count >= stages.NUMEROUS else stages.USUAL)
        progress.moving, progress.smallest = moving, 0.0

    settler = SimpleNamespace(
        progress=progress, bed=SimpleNamespace(count=count), how=SimpleNamespace(rest=0.95), _more_steps=1,
        _examine=examine, _end=lambda begun: ended.append(begun),
    )  # fmt: skip
    stages.Settler._sink(settler, stages.SOFT[0])
    assert ended == ([True] if ends else [])


def test_a_bed_of_which_no_more_grains_come_to_rest_is_left_if_it_rests_as_asked(monkeypatch):
    monkeypatch.setattr(stages, "soft_step", lambda bed, size, velocity, **how: (0.99, velocity, 4e-4))
    for best, examinations in ((0.04, stages.UNCHANGED), (0.06, None)):
        progress, ended = Progress(stage=stages.STILL, length=1e-4, best=best, moving=best), []
        settler = SimpleNamespace(
            progress=progress, bed=SimpleNamespace(count=100), how=SimpleNamespace(rest=0.95), _more_steps=9,
            _examine=lambda iterations: None, _end=lambda begun, ended=ended: ended.append(begun),
        )  # fmt: skip
        while not ended and progress.still_steps < 200:
            stages.Settler._sink(settler, stages.SOFT[0])
        steps = stages.SOFT[0].examined * examinations if examinations else 200
        assert (progress.still_steps, bool(ended)) == (steps, examinations is not None)


def test_a_row_that_fits_between_walls_rests_without_overlap():
    # twelve disks between walls at the distance of twelve diameters keep no distance from each other
    bed = vg.pack(vg.make_shape("disk"), vg.Rectangle((12, 25)), "gravity", count=150, friction=0.0, seed=1)
    assert bed.stop_reason == "settled"
    assert bed.verify().ok


def test_a_tight_row_between_grains_and_walls_rests():
    # spheres whose rows fit exactly, between two walls that both touch them: no distance can be kept
    bed = vg.pack(SHAPES["spheres"](), vg.Box((4, 1, 8)), "gravity", count=16, friction=0.0, seed=1)
    assert bed.stop_reason == "settled"
    assert bed.verify().ok
    assert bed.provenance["settling"]["steps"] < 1000


def test_springs_prove_the_rest_of_grains_that_weigh_little():
    # the smallest of these spheres weigh a thousandth of the largest: the optimum of forces is too coarse for them
    sizes = vg.sizes.uniform(0.1, 2.0)
    bed = vg.pack(SHAPES["spheres"](), vg.Box((4, 4, 12)), "gravity", count=80, sizes=sizes, friction=0.0, seed=1)
    assert bed.stop_reason == "settled"
    assert vg.equilibrium(bed, 0.0).attrs["share_at_rest"] == 1.0
    assert bed.provenance["settling"]["steps"] < 1000


def test_forces_of_a_bed_with_fewer_grains_than_asked_for_are_in_weights_of_its_median_grain():
    sizes = vg.sizes.uniform(0.2, 4.0)
    with pytest.warns(vg.PackingWarning, match="8 of 20 grains"):
        bed = vg.pack(SHAPES["spheres"](), vg.Box((5, 5, 9)), "gravity", count=20, sizes=sizes, friction=0.0, seed=1)
    weight = ((bed.diameter / bed.median_diameter) ** 3).sum()
    assert -bed.forces.force[bed.forces.j < 0, 2].sum() == pytest.approx(weight, rel=1e-3)
    assert vg.equilibrium(bed, 0.0).attrs["share_at_rest"] == 1.0


@pytest.mark.slow
def test_grains_below_a_heavy_lid_do_not_go_to_and_fro():
    # large forces at contacts that are linearized turned one ellipsoid by as much to each side, for thousands of steps
    bed = vg.pack(
        SHAPES["ellipsoids"](), vg.Box((4, 4, 14)), "gravity", count=50, lid={"weight": 100}, friction=0.0, seed=1
    )
    assert bed.stop_reason == "settled"
    assert bed.provenance["settling"]["steps"] < 1000


def test_spheres_in_a_cylinder_of_their_radius_rest_without_overlap():
    bed = vg.pack(SHAPES["spheres"](), vg.Cylinder(0.5, 10), "gravity", count=3, friction=0.0, seed=1)
    assert bed.stop_reason == "settled"
    assert bed.verify().ok
    assert bed.provenance["settling"]["steps"] < 700


@pytest.mark.slow
def test_cubes_that_the_fall_wedged_between_walls_come_free():
    # five cubes side by side are wider than the box: the fall ends with a row that overlaps by a hundredth
    bed = vg.pack(vg.make_shape("box"), vg.Box((4, 4, 14)), "gravity", count=40, friction=0.0, seed=1)
    assert bed.stop_reason == "settled"
    assert bed.verify().ok
    assert bed.provenance["settling"]["steps"] < 700


@pytest.mark.slow
def test_polyhedra_below_a_lid_do_not_jump_between_contact_points():
    # edges of thin faces, and edges beside faces that are nearer to the normal, had one contact point of two
    bed = vg.pack(SHAPES["hulls"](), vg.Box((4, 4, 14)), "gravity", count=50, lid={"weight": 5}, friction=0.0, seed=1)
    assert bed.stop_reason == "settled"
    assert bed.provenance["settling"]["steps"] < 700


@pytest.mark.parametrize("corners", [3, 5])
def test_polygons_rest(corners):
    shape = vg.make_shape("polygon", corners=corners)
    bed = vg.pack(shape, vg.Rectangle((7.3, 25)), "gravity", count=60, friction=0.0, seed=1)
    assert bed.stop_reason == "settled"
    assert bed.verify().ok
    assert vg.equilibrium(bed, 0.0).attrs["share_at_rest"] >= 0.98
    # twelve beds: 642 to 646, one of them 664
    assert bed.provenance["settling"]["steps"] < 700


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "count", "width"),
    [
        ("hulls", 300, 6.0),
        ("ellipsoids", 300, 6.0),
        ("clumps", 150, 5.0),
        ("spheres", 3000, 13.0),
        ("spheres", 10_000, 17.0),
    ],
)
def test_large_beds_rest(kind, count, width):
    box = vg.Box((width, width, 3.0 + 2.0 * count / width**2), periodic="xy")
    bed = vg.pack(SHAPES[kind](), box, "gravity", count=count, friction=0.0, seed=1)
    assert bed.verify().ok
    assert vg.equilibrium(bed, 0.0).attrs["share_at_rest"] >= 0.95


@pytest.mark.slow
def test_large_forces_do_not_close_gaps():
    # the grains at the floor carry so much that their contacts would overlap at the usual softness
    box = vg.Box((7, 7, 4000 / 49), periodic="xy")
    bed = vg.pack(SHAPES["spheres"](), box, "gravity", count=1000, friction=0.0, seed=1)
    assert bed.stop_reason == "settled"
    assert bed.verify().ok
