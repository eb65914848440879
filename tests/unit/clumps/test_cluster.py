import numpy as np
import pytest
from kit import slow
from scipy.spatial import cKDTree

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran.clumps.method import Body
from voxgran.clumps.methods.cluster import CELL, SPACING, Cluster, _choose_merged, _lattice_points, fit

BOX = np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])


@pytest.mark.parametrize(("lattice", "neighbours", "covering"), [("cubic", 6, 3**0.5 / 2), ("hexagonal", 12, 0.5**0.5)])
def test_lattices_have_their_density_neighbours_and_covering_radius(lattice, neighbours, covering):
    points = _lattice_points(lattice, 0.1, np.array([0.3, 0.7, 0.1]), BOX)
    assert len(points) == pytest.approx(8 / (CELL[lattice] * 0.1**3), rel=0.02)
    inner = points[(np.abs(points) < 0.8).all(axis=1)]
    apart, _ = cKDTree(points).query(inner, neighbours + 2)
    assert np.allclose(apart[:, 1 : neighbours + 1], 0.1)
    assert (apart[:, neighbours + 1] > 0.12).all()
    anywhere = np.random.default_rng(0).uniform(-0.8, 0.8, (20_000, 3))
    far = cKDTree(points).query(anywhere)[0].max()
    assert 0.9 * covering < far / 0.1 <= covering + 1e-9
    # spheres at the default spacing leave no hole
    assert SPACING[lattice] * covering < 1


@pytest.mark.parametrize("lattice", ["cubic", "hexagonal"])
def test_equal_spheres_at_lattice_points_cover_the_inside(eros, lattice):
    body = Body(eros)
    found = fit(body, 80, Cluster(lattice=lattice), 0)
    radius = found.radii[0]
    assert 8 <= len(found.radii) <= 80
    assert np.ptp(found.radii) == 0
    apart = cKDTree(found.centers).query(found.centers, 2)[0][:, 1]
    assert np.allclose(apart, SPACING[lattice] * radius)
    deep = np.random.default_rng(0).uniform(*body.shape.bounds, (20_000, 3))
    deep = deep[body.depth(deep) > radius]
    assert len(deep) > 1000
    assert (cKDTree(found.centers).query(deep)[0] <= radius).all()


SOLIDS = [vg.shapes.box(lengths=(1, 1, 1)), slow(vg.shapes.box(lengths=(1, 1.5, 2))), slow(vg.make_shape("platonic"))]


@pytest.mark.parametrize("solid", SOLIDS)
def test_more_spheres_are_never_a_worse_cluster(solid):
    """The clusters of fewer spheres are among those of more, and none is cut through spheres that are alike."""
    clumps = [vg.fit_clump(solid, method="cluster", max_spheres=n) for n in (8, 27, 30, 50, 64, 70)]
    assert all(8 <= clump.count <= n for clump, n in zip(clumps, (8, 27, 30, 50, 64, 70), strict=True))
    found = [float(clump.errors.iou) for clump in clumps]
    # the errors of the clump are counted in other voxels
    assert (np.diff(found) > -0.004).all()
    assert 1 <= vg.fit_clump(solid, method="cluster", max_spheres=5).count <= 5


def test_the_cluster_of_a_cube_has_all_its_corners():
    for n in (30, 50, 100):
        clump = vg.fit_clump(vg.shapes.box(lengths=(1, 1, 1)), method="cluster", max_spheres=n)
        centers = clump.centers - clump.centers.mean(axis=0)
        # each corner has a sphere, and reflections leave the cluster as it is
        assert (np.abs(np.abs(centers).max(axis=1) - np.abs(centers).max()) < 1e-9).sum() >= 8
        for axis in np.eye(3):
            reflected = centers * (1 - 2 * axis)
            assert cKDTree(centers).query(reflected)[0].max() < 1e-9


def test_all_points_inside_are_kept_for_a_given_radius():
    cube = vg.make_shape("box", lengths=(1, 1, 1))
    body = Body(cube)
    half, radius = body.shape.bounds[1, 0], 0.25
    for inside, depth in ((0.0, 0.0), (1.0, radius)):
        found = fit(body, 1000, Cluster(radius=radius, spacing=1.0, inside=inside), 0)
        assert body.depth(found.centers).min() >= depth
        # as many as a lattice at the best position holds, in each direction
        sides = round(len(found.radii) ** (1 / 3))
        assert sides**3 == len(found.radii)
        assert abs(sides - 2 * (half - depth) / radius) <= 1
        assert "lattice" in found.reason


def test_a_radius_with_too_many_spheres_is_refused(eros):
    with pytest.raises(InputError, match=r"max_spheres to \d+"):
        fit(Body(eros), 10, Cluster(radius=0.1), 0)


def test_merged_spheres_contain_those_that_they_replace(eros):
    body = Body(eros)
    chosen = {"radius": 0.1, "inside": 0.6}
    small, merged = (fit(body, 5000, Cluster(merge=merge, **chosen), 0) for merge in (False, True))
    assert len(merged.radii) < 0.5 * len(small.radii)
    assert merged.radii.max() > 2 * small.radii[0]
    assert merged.radii.min() == small.radii[0]
    # the larger spheres protrude by no more than the small ones may
    assert (merged.radii - body.depth(merged.centers) <= 0.4 * 0.1 + 0.021).all()
    asked = fit(body, 60, Cluster(merge=True), 0)
    assert len(asked.radii) == 60
    assert len(np.unique(asked.radii)) > 2


def test_the_merging_kernel_agrees_with_plain_python_and_removes_what_it_reaches():
    points = _lattice_points("cubic", 0.25, np.zeros(3), BOX)
    reach = 0.9 - np.linalg.norm(points, axis=1)
    points, reach = points[reach > 0], reach[reach > 0]
    outcomes = []
    for choose in (_choose_merged, _choose_merged.plain):
        left, chosen = np.ones(len(points), dtype=bool), np.full(len(points), -1)
        choose(points, reach, np.full(len(points), 1e9), left, chosen)
        outcomes.append((left, chosen))
    assert np.array_equal(outcomes[0][0], outcomes[1][0])
    assert np.array_equal(outcomes[0][1], outcomes[1][1])
    left, chosen = outcomes[0]
    large = chosen[chosen >= 0]
    apart = np.linalg.norm(points[:, None] - points[large], axis=2)
    assert np.array_equal(left, ~(apart <= reach[large]).any(axis=1))
    # the first reaches most
    assert (apart[:, 0] <= reach[large[0]]).sum() == max(
        (np.linalg.norm(points - p, axis=1) <= r).sum() for p, r in zip(points, reach, strict=True)
    )


def test_bad_parameters_are_refused():
    for wrong in ({"radius": 0.001}, {"spacing": 0.0}, {"inside": 1.5}, {"lattice": "random"}):
        with pytest.raises(InputError, match=next(iter(wrong))):
            Cluster(**wrong)
