"""Rain of turned cubes: depths against convex hulls, exact unions against half-spaces and random points."""

import math

import numpy as np
import pytest
from scipy.spatial import ConvexHull, HalfspaceIntersection

import voxgran as vg
from voxgran._base.seeds import stream
from voxgran.geometry.rotation import rotation_matrices
from voxgran.shapes.repairing.diagnose import refuse_dirty
from voxgran.shapes.tessellate import unit_box


def cubes_of(shape):
    """Return centers, edges and rotations of the cubes of a shape of diameter 1."""
    return shape.record["centers"], shape.record["edges"], rotation_matrices(shape.record["orientations"])


def depth(k, j, cubes):
    """Return how deep two cubes are in each other: the depth of the origin in the hull of differences of corners."""
    centers, edges, turns = cubes
    one, two = (centers[i] + edges[i] * unit_box()[0] @ turns[i].T for i in (k, j))
    return float((-ConvexHull((one[:, None] - two).reshape(-1, 3)).equations[:, 3]).min())


def check(seed, **given):
    shape = vg.make_shape("cube_rain", seed=seed, **given)
    refuse_dirty(shape.vertices, shape.faces, f"cube_rain {seed}")
    assert np.isfinite(shape.vertices).all()
    assert shape.diameter == pytest.approx(1.0, rel=1e-14)
    centers, edges, turns = cubes_of(shape)
    generator, many = stream(seed, "inside"), 20_000
    lower, upper = shape.bounds
    points = generator.uniform(lower, upper, (many, 3))
    local = np.einsum("nji,pnj->pni", turns, points[:, None] - centers)
    share = (np.abs(local) <= edges[:, None] / 2).all(axis=2).any(axis=1).mean()
    box = np.prod(upper - lower)
    return (box * share - shape.volume) / (box * math.sqrt(share * (1 - share) / many))


def test_unions_are_one_solid_with_the_volume_of_random_points():
    scores = np.array([check(seed) for seed in range(20)])
    assert np.abs(scores).max() < 4
    assert (scores**2).sum() < 20 + 4 * math.sqrt(40)


@pytest.mark.slow
def test_many_unions_are_one_solid_with_the_volume_of_random_points():
    scores = np.array([check(seed) for seed in range(1000)])
    assert np.abs(scores).max() < 5
    assert (scores**2).sum() == pytest.approx(1000, abs=4 * math.sqrt(2000))


@pytest.mark.parametrize("overlap", [0.01, 0.3, 0.9])
def test_cubes_sink_as_deep_as_is_asked(overlap):
    for seed in range(3):
        cubes = cubes_of(vg.make_shape("cube_rain", seed=seed, overlap=overlap, cubes=8))
        for k in range(1, 8):
            reached = [depth(k, j, cubes) / min(cubes[1][k], cubes[1][j]) for j in range(k)]
            # a cube stops at the first that it has sunk into
            assert max(reached) == pytest.approx(overlap, abs=1e-9)


def test_cubes_that_fall_down_meet_nothing_above():
    cubes = cubes_of(vg.make_shape("cube_rain", seed=2, cubes=15, fall="down"))
    for k in range(1, 15):
        for way in (0.05, 0.2, 0.5):
            centers = cubes[0].copy()
            centers[k, 2] += way
            moved = (centers, *cubes[1:])
            assert max(depth(k, j, moved) / min(cubes[1][k], cubes[1][j]) for j in range(k)) < 0.3
    assert np.ptp(cubes[0], axis=0)[2] > np.ptp(cubes[0], axis=0)[:2].max()


@pytest.mark.parametrize("seed", range(5))
def test_the_union_of_two_cubes_is_exact(seed):
    shape = vg.make_shape("cube_rain", seed=seed, cubes=2, overlap=0.5)
    centers, edges, turns = cubes_of(shape)
    sides = [
        (sign * turns[k][:, axis], -edges[k] / 2 - sign * turns[k][:, axis] @ centers[k])
        for k in range(2)
        for axis in range(3)
        for sign in (-1, 1)
    ]
    planes = np.array([[*normal, offset] for normal, offset in sides])
    # the point that is deepest in both
    middle = max(
        (centers[0] + t * (centers[1] - centers[0]) for t in np.linspace(0, 1, 101)),
        key=lambda point: -(planes[:, :3] @ point + planes[:, 3]).max(),
    )
    common = ConvexHull(HalfspaceIntersection(planes, middle).intersections).volume
    assert shape.volume == pytest.approx((edges**3).sum() - common, rel=1e-9)


def test_edges_and_orientations_are_uniform():
    shapes = [vg.make_shape("cube_rain", seed=seed, cubes=2, edges=(0.4, 1.0)) for seed in range(60)]
    edges = np.array([shape.record["edges"] for shape in shapes])
    assert (edges.max(axis=1) / edges.min(axis=1) <= 2.5).all()
    axes = np.concatenate([cubes_of(shape)[2][:, :, 2] for shape in shapes])
    assert (axes**2).mean(axis=0) == pytest.approx(np.full(3, 1 / 3), abs=4 * math.sqrt(4 / 45 / 120))
    one = vg.make_shape("cube_rain", seed=1, cubes=1)
    assert one.surface_area == pytest.approx(6 * (math.pi / 6) ** (2 / 3), rel=1e-9)
