"""Polyhedra against closed formulas: regular solids, hulls of random points, and Steiner's formula."""

import math

import numpy as np
import pytest
from scipy.spatial import ConvexHull

import voxgran as vg
from voxgran._base.seeds import stream
from voxgran.shapes.families.random.polyhedron import COVERING, Polyhedron, edges_of_hull, sphere_swept, steiner_volume
from voxgran.shapes.generating.hulls import points_on_sphere
from voxgran.shapes.generating.regular_solids import corners_of
from voxgran.shapes.mesh import hull_of
from voxgran.shapes.repairing.diagnose import diagnose, refuse_dirty
from voxgran.shapes.tessellate import sphere_points

G, R2, R5 = (1 + 5**0.5) / 2, 2**0.5, 5**0.5
TRIBONACCI = 1.8392867552141612
#: real root of x^3 - 2 x = golden ratio
ROOT = 1.7155614996973678
#: corners, edges, numbers of faces by their sides, and the volume at edge 1 (Weisstein, Archimedean Solid, MathWorld;
#: the snub solids from their pages there)
ARCHIMEDEAN = {
    "truncated_tetrahedron": (12, 18, {3: 4, 6: 4}, 23 * R2 / 12),
    "cuboctahedron": (12, 24, {3: 8, 4: 6}, 5 * R2 / 3),
    "truncated_cube": (24, 36, {3: 8, 8: 6}, (21 + 14 * R2) / 3),
    "truncated_octahedron": (24, 36, {4: 6, 6: 8}, 8 * R2),
    "rhombicuboctahedron": (24, 48, {3: 8, 4: 18}, (12 + 10 * R2) / 3),
    "truncated_cuboctahedron": (48, 72, {4: 12, 6: 8, 8: 6}, 22 + 14 * R2),
    "snub_cube": (
        24,
        60,
        {3: 32, 4: 6},
        (3 * (TRIBONACCI - 1) ** 0.5 + 4 * (TRIBONACCI + 1) ** 0.5) / (3 * (2 - TRIBONACCI) ** 0.5),
    ),
    "icosidodecahedron": (30, 60, {3: 20, 5: 12}, (45 + 17 * R5) / 6),
    "truncated_dodecahedron": (60, 90, {3: 20, 10: 12}, 5 * (99 + 47 * R5) / 12),
    "truncated_icosahedron": (60, 90, {5: 12, 6: 20}, (125 + 43 * R5) / 4),
    "rhombicosidodecahedron": (60, 120, {3: 20, 4: 30, 5: 12}, (60 + 29 * R5) / 3),
    "truncated_icosidodecahedron": (120, 180, {4: 30, 6: 20, 10: 12}, 95 + 50 * R5),
    "snub_dodecahedron": (
        60,
        150,
        {3: 80, 5: 12},
        (12 * ROOT**2 * (3 * G + 1) - ROOT * (36 * G + 7) - (53 * G + 6)) / (6 * (3 - ROOT**2) ** 1.5),
    ),
}
SNUB = ("snub_cube", "snub_dodecahedron")


def faces_by_sides(corners):
    """Return the number of faces with each number of sides."""
    planes = np.unique(ConvexHull(corners).equations.round(8), axis=0)
    sides = (np.abs(corners @ planes[:, :3].T + planes[:, 3]) < 1e-6).sum(axis=0)
    return dict(zip(*(values.tolist() for values in np.unique(sides, return_counts=True)), strict=True))


@pytest.mark.parametrize("solid", ARCHIMEDEAN)
def test_archimedean_solids(solid):
    count, edges, faces, volume = ARCHIMEDEAN[solid]
    corners = corners_of(solid)
    assert len(corners) == count
    found = edges_of_hull(corners).ends
    lengths = np.linalg.norm(corners[found[:, 0]] - corners[found[:, 1]], axis=1)
    assert len(lengths) == edges
    assert np.ptp(lengths) < 1e-14 * count
    radii = np.linalg.norm(corners, axis=1)
    assert np.ptp(radii) < 1e-14 * radii[0]
    assert np.abs(corners.mean(axis=0)).max() < 1e-14
    assert faces_by_sides(corners) == faces
    assert hull_of(corners).volume == pytest.approx(volume * lengths.mean() ** 3, rel=1e-13)


def same_up_to_rotation(one, other):
    """Return whether one set of corners is the other after a proper rotation, tried on all pairs of two corners."""
    a, b = one[0], one[np.argsort(np.linalg.norm(one - one[0], axis=1))[1]]
    frame = np.linalg.inv(np.column_stack([a, b, np.cross(a, b)]))
    length = np.linalg.norm(a - b)
    for c in other:
        for d in other[np.abs(np.linalg.norm(other - c, axis=1) - length) < 1e-9]:
            turned = one @ (np.column_stack([c, d, np.cross(c, d)]) @ frame).T
            if np.linalg.norm(turned[:, None] - other, axis=2).min(axis=1).max() < 1e-9:
                return True
    return False


def test_snub_solids_have_two_forms():
    for solid in SNUB:
        corners = corners_of(solid)
        assert same_up_to_rotation(corners, corners @ np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]]))
        assert not same_up_to_rotation(corners, -corners)
        one, other = (vg.make_shape("polyhedron", solid=solid, mirror=mirror) for mirror in (False, True))
        assert other.volume == pytest.approx(one.volume, rel=1e-14)
        assert not same_up_to_rotation(one.vertices, other.vertices)
    assert same_up_to_rotation(corners_of("truncated_icosahedron"), -corners_of("truncated_icosahedron"))


def mean_volume(n):
    """Return the mean volume of the hull of n uniform points on the unit sphere.

    With the density 3/2 (1 - h^2) of the distance h of the plane through three of them, and pi/4 (1 - h^2) for the mean
    area of their triangle at that distance (affine Blaschke-Petkantschin formula).
    """
    return 4 * math.pi / 3 * (n - 1) * (n - 2) * (n - 3) / ((n + 1) * (n + 2) * (n + 3))


@pytest.mark.parametrize("n", [4, 5, 12, 40])
def test_hulls_of_random_points_have_their_mean_volume(n):
    generator = stream(3, "mean volume", n)
    volumes = np.array([ConvexHull(points_on_sphere(n, generator)).volume for _ in range(1500)])
    error = volumes.std() / math.sqrt(len(volumes))
    assert error < 0.025 * volumes.mean()
    assert abs(volumes.mean() - mean_volume(n)) < 3.5 * error
    if n == 4:
        assert mean_volume(4) == pytest.approx(4 * math.pi / 105)


def test_corners_of_random_polyhedra_lie_on_an_ellipsoid():
    counts = []
    for shape in vg.make_shapes("polyhedron", count=150, seed=2, aspect=(1, 2, 3)):
        radii = np.linalg.norm((shape.vertices + shape.offset) / (1, 2, 3), axis=1)
        assert np.ptp(radii) < 1e-12
        counts.append(len(shape.vertices))
    assert (min(counts), max(counts)) == (8, 20)
    assert len(vg.make_shape("polyhedron", points=5, seed=3).vertices) == 5
    assert (
        vg.make_shape("polyhedron", points=(5, 5), seed=3).key == vg.make_shape("polyhedron", points=[5, 5], seed=3).key
    )
    assert len(vg.make_shape(Polyhedron(points=5), seed=3).vertices) == 5


@pytest.mark.parametrize("solid", ["cube", "tetrahedron", "truncated_icosahedron", "snub_cube", "random"])
@pytest.mark.parametrize("radius", [0.05, 0.5, 2.0])
def test_rounded_polyhedra_obey_the_formula_of_steiner(solid, radius):
    corners = points_on_sphere(12, stream(5, "steiner")) if solid == "random" else corners_of(solid)
    true, sharp = steiner_volume(corners, radius), hull_of(corners)
    misses = []
    for error in (0.02 * radius, 0.005 * radius):
        rounded = sphere_swept(corners, radius, error)
        refuse_dirty(rounded.vertices, rounded.faces, solid)
        assert ConvexHull(rounded.vertices).volume == pytest.approx(rounded.volume, rel=1e-12)
        # all vertices are at the radius from the sharp solid, and nothing of the mesh is nearer than the error allows
        assert sharp.tree.signed_distance(rounded.vertices) == pytest.approx(radius, abs=1e-12)
        inside = sharp.tree.signed_distance(rounded.triangles.mean(axis=1))
        assert radius - error < inside.min() < inside.max() < radius + 1e-12
        misses.append(1 - rounded.volume / true)
        assert 0 < misses[-1] < error * rounded.surface_area / true
    # a quarter of the error takes away three quarters of what misses
    assert misses[1] < 0.4 * misses[0]


def test_formula_of_steiner_for_a_cube():
    corners = corners_of("cube") / 2
    for r in (0.1, 1.0):
        assert steiner_volume(corners, r) == pytest.approx(1 + 6 * r + 3 * math.pi * r**2 + 4 / 3 * math.pi * r**3)


def test_directions_cover_the_sphere():
    spatial = pytest.importorskip("scipy.spatial")
    for n in (30, 300, 3000):
        points = sphere_points(n)
        gaps = spatial.cKDTree(points).query(spatial.SphericalVoronoi(points).vertices)[0]
        assert 0.98 * COVERING < 2 * np.arcsin(gaps.max() / 2) * math.sqrt(n) < COVERING


def test_rounding_is_a_fraction_of_the_sharp_diameter():
    shape = vg.make_shape("polyhedron", solid="cube", rounding=0.3, tolerance=1e-3)
    edge = (math.pi / 6) ** (1 / 3)  # of the cube whose equivalent diameter is 1
    true = edge**3 + 6 * edge**2 * 0.3 + 3 * math.pi * edge * 0.09 + 4 / 3 * math.pi * 0.027
    width = (edge + 0.6) / (6 / math.pi * true) ** (1 / 3)
    assert np.ptp(shape.vertices, axis=0) == pytest.approx([width] * 3, rel=2e-3)


def test_some_seeds_are_one_clean_solid():
    for seed in range(20):
        shape = vg.make_shape("polyhedron", seed=seed, rounding=(0.0, 0.3))
        found = diagnose(shape)
        assert found.ok, (seed, found.sentences())
        assert found.bodies == 1


@pytest.mark.slow
def test_a_thousand_seeds_are_one_clean_solid():
    for seed in range(1000):
        aspect = (1, (0.3, 1), (0.3, 1))
        for rounding in (0.0, (0.005, 0.5)):
            shape = vg.make_shape("polyhedron", seed=seed, aspect=aspect, rounding=rounding)
            refuse_dirty(shape.vertices, shape.faces, f"seed {seed}")
            assert ConvexHull(shape.vertices).volume == pytest.approx(shape.volume, rel=1e-9)
