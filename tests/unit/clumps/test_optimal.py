"""The refined fit: its modes, limits of radii, tangent spheres, and its kernels against plain Python."""

import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran._base.seeds import stream
from voxgran.clumps.covering import covering_growth, enclosed_holes
from voxgran.clumps.fit import fit_clump
from voxgran.clumps.method import Body
from voxgran.clumps.sphere_sets import (
    INSIDE,
    SURFACE,
    Points,
    Rules,
    SphereSet,
    _add_normal_equations,
    _choose_inserts,
    _find_gaps,
    best_inserts,
    refined,
    union_gaps,
    without_cheapest,
)


@pytest.fixture(scope="module")
def cube():
    return vg.make_shape("box", lengths=(1.0, 1.0, 1.0))


def gaps_of(points, clump):
    """Return distances from the nearest sphere."""
    return (np.linalg.norm(points[:, None] - clump.centers, axis=2) - clump.radii).min(axis=1)


@pytest.mark.parametrize(("count", "least"), [(50, 0.925), slow(100, 0.95)])
def test_error_falls_with_the_number_of_spheres_on_a_cube(cube, count, least):
    errors = fit_clump(cube, max_spheres=count).errors
    assert errors.iou >= least
    assert abs(errors.volume) < 1e-3
    assert errors.inertia < 0.01


@pytest.mark.slow
def test_an_ellipsoid_needs_few_spheres():
    body = vg.make_shape("ellipsoid", semi_axes=(0.75, 0.5, 0.4))
    few, more = (fit_clump(body, max_spheres=count).errors.iou for count in (4, 20))
    assert 0.88 < few < more
    assert more > 0.97


@pytest.mark.slow
def test_centers_lie_inside_and_no_sphere_is_tiny(eros):
    clump = fit_clump(eros, max_spheres=50)
    assert (eros.signed_distance(clump.centers) < 0).all()
    assert clump.radii.min() >= 0.02 * eros.diameter * (1 - 1e-9)
    spheres = SphereSet(clump.centers / eros.diameter, clump.radii / eros.diameter)
    assert len(enclosed_holes(Body(eros), spheres)) == 0


def test_inscribed_spheres_do_not_protrude(eros, cube):
    for shape in (eros, cube):
        clump = fit_clump(shape, max_spheres=15, mode="inscribed")
        assert (clump.radii <= -shape.signed_distance(clump.centers) + 1e-9).all()
        assert clump.errors.iou > 0.75


@pytest.mark.slow
def test_bounding_spheres_cover_the_surface(eros, cube):
    for shape in (eros, cube):
        clump = fit_clump(shape, max_spheres=15, mode="bounding")
        corners = shape.vertices[shape.faces]
        weights = stream(1, "weights").dirichlet(np.ones(3), size=(len(corners), max(1, 20_000 // len(corners))))
        points = np.einsum("fnk,fkd->fnd", weights, corners).reshape(-1, 3)
        assert gaps_of(points, clump).max() <= 0.0
        assert gaps_of(shape.vertices, clump).max() <= 0.0
        # and no farther than it must be
        assert gaps_of(np.concatenate([points, shape.vertices]), clump).max() > -0.01 * shape.diameter


@pytest.mark.slow
def test_radii_keep_to_their_limits(eros):
    unit = eros.diameter
    clump = fit_clump(eros, max_spheres=30, min_radius=0.15, max_radius=0.25)
    assert clump.radii.min() >= 0.15 * unit * (1 - 1e-12)
    assert clump.radii.max() <= 0.25 * unit * (1 + 1e-12)
    even = fit_clump(eros, max_spheres=20, uniform=True)
    assert np.ptp(even.radii) < 1e-12 * unit
    assert even.errors.iou > 0.88


@pytest.mark.parametrize("parameters", [{}, slow({"uniform": True}), {"max_radius": 0.1}])
def test_tangent_spheres_touch_and_do_not_overlap(eros, parameters):
    clump = fit_clump(eros, max_spheres=40, overlap=False, **parameters)
    gap = np.linalg.norm(clump.centers[:, None] - clump.centers, axis=2) - clump.radii - clump.radii[:, None]
    np.fill_diagonal(gap, np.inf)
    assert clump.count == 40
    assert gap.min() > -1e-12
    assert (gap < 1e-4 * eros.diameter).any(axis=1).mean() > 0.8
    assert (clump.radii <= -eros.signed_distance(clump.centers) + 1e-9).all()


def test_growth_that_covers_is_exact_for_a_cube_in_a_sphere(cube):
    """A sphere at the center covers a cube of edge a from the radius a sqrt(3) / 2 on."""
    body = Body(cube)
    edge = cube.volume ** (1 / 3) / cube.diameter
    growth = covering_growth(body, SphereSet(np.zeros((1, 3)), np.array([0.3])))
    assert growth == pytest.approx(edge * np.sqrt(3) / 2 - 0.3, abs=3e-5)


def test_a_hole_between_spheres_is_found(cube):
    """Spheres at the corners of a cube that overlap along its edges and faces, but leave its center open."""
    edge = cube.volume ** (1 / 3) / cube.diameter
    corners = edge * (np.array(list(np.ndindex(2, 2, 2))) - 0.5)
    radius = 0.78 * edge
    holes = enclosed_holes(Body(cube), SphereSet(corners, np.full(8, radius)))
    assert len(holes) > 0
    assert np.linalg.norm(holes, axis=1).max() < 0.2 * edge
    assert len(enclosed_holes(Body(cube), SphereSet(corners, np.full(8, 0.9 * edge)))) == 0


def test_refinement_finds_the_sphere_through_points():
    """Points of a sphere with errors to one side: the refinement ends at the sphere itself, as the power is 1."""
    generator = stream(3, "points")
    ways = generator.normal(size=(500, 3))
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    center, radius = np.array([0.2, -0.1, 0.05]), 0.4
    far = np.where(np.arange(500) % 10 == 0, 1.2, 1.0)
    points = Points(center + radius * far[:, None] * ways, np.full(500, SURFACE), np.ones(500))
    found = refined(points, SphereSet(np.zeros((1, 3)), np.array([0.3])), Rules(width=1e-4), 200)
    np.testing.assert_allclose(found.centers[0], center, atol=2e-3)
    assert found.radii[0] == pytest.approx(radius, abs=2e-3)


def test_the_least_useful_sphere_is_removed():
    """Of two equal spheres one is enough, whatever stands beside them."""
    generator = stream(4, "points")
    ways = generator.normal(size=(400, 3))
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    centers = np.array([[0.0, 0, 0], [0.05, 0, 0], [2.0, 0, 0]])
    points = Points(np.concatenate([ways, ways + centers[2]]), np.full(800, SURFACE), np.ones(800))
    kept = without_cheapest(points, SphereSet(centers, np.array([1.0, 0.95, 1.0])), 1)
    np.testing.assert_array_equal(kept.centers, centers[[0, 2]])
    # and put back it is the best of what is offered
    pool = SphereSet(np.array([[5.0, 5, 5], [2.0, 0, 0]]), np.array([0.1, 1.0]))
    chosen = best_inserts(points, SphereSet(centers[:1], np.array([1.0])), pool, 2)
    np.testing.assert_array_equal(chosen.centers, [[2.0, 0.0, 0.0]])


@pytest.mark.parametrize(("number", "many"), [(1, 1), (40, 3), (3000, 200)])
def test_lists_of_near_spheres_change_no_bit(number, many):
    """Distances and owners are those of all spheres, also where spheres lie twice in one place."""
    generator = stream(6, "near spheres", number)
    places = np.concatenate([generator.normal(size=(number, 3)), 3.0 + 1e-3 * generator.random((number, 3))])
    centers, radii = generator.normal(size=(many, 3)), 0.05 + 0.3 * generator.random(many)
    centers[many // 2 :], radii[many // 2 :] = centers[: many - many // 2], radii[: many - many // 2]
    points = Points(places, np.full(2 * number, SURFACE), np.ones(2 * number))
    for found, plain in zip(points.gaps(SphereSet(centers, radii)), union_gaps(places, centers, radii), strict=True):
        np.testing.assert_array_equal(found, plain)


def test_kernels_agree_with_plain_python():
    generator = stream(5, "kernels")
    places, centers, radii = generator.normal(size=(60, 3)), generator.normal(size=(7, 3)), 0.2 + generator.random(7)
    apart = np.linalg.norm(places[:, None] - centers, axis=2) - radii
    gap, owner = union_gaps(places, centers, radii)
    np.testing.assert_allclose(gap, apart.min(axis=1), atol=1e-14)
    np.testing.assert_array_equal(owner, apart.argmin(axis=1))
    second = np.full(60, np.inf)
    _find_gaps(places, centers, radii, owner, second, np.zeros(60, np.int64))
    np.testing.assert_allclose(second, np.sort(apart, axis=1)[:, 1], atol=1e-14)
    results = []
    kind, weight = np.where(np.arange(60) % 3 == 0, INSIDE, SURFACE), generator.random(60)
    for plain in (False, True):
        find, add, choose = (
            kernel.plain if plain else kernel for kernel in (_find_gaps, _add_normal_equations, _choose_inserts)
        )
        made, index = np.full(60, np.inf), np.zeros(60, np.int64)
        find(places, centers, radii, np.full(60, -1), made, index)
        matrix, slope, chosen = np.zeros((7, 4, 4)), np.zeros((7, 4)), np.full(3, -1)
        add(places, made, weight, index, centers, matrix, slope)
        choose(places, kind, weight, np.minimum(made, 1.0), centers + 0.1, radii, chosen)
        results.append((made, index, matrix, slope, chosen))
    for fast, plain in zip(*results, strict=True):
        np.testing.assert_allclose(fast, plain, atol=1e-12)
    # the normal equations are those of residuals with derivatives by differences
    s, step = 2, 1e-6
    mine = owner == s
    for k in range(4):
        moved, size = centers.copy(), radii.copy()
        if k < 3:
            moved[s, k] += step
        else:
            size[s] += step
        after = np.linalg.norm(places[mine] - moved[s], axis=1) - size[s]
        slope = (weight[mine] * gap[mine] * (after - gap[mine]) / step).sum()
        assert slope == pytest.approx(results[0][3][s, k], rel=1e-3, abs=1e-4)
