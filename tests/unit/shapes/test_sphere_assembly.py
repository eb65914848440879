"""Assemblies of spheres: the law of their number, radii, connection, and volume."""

import itertools
import math

import numpy as np
import pytest
from scipy import stats
from scipy.sparse.csgraph import minimum_spanning_tree

import voxgran as vg
from voxgran._base.seeds import stream
from voxgran.shapes.families.random.sphere_assembly import connected, pieces
from voxgran.shapes.family import make_shape
from voxgran.shapes.repairing.diagnose import diagnose
from voxgran.shapes.spheres import Spheres

BOX = make_shape("box")


def overlaps(centers, radii, overlap):
    """Mask (n, n) of the spheres that overlap deep enough, by all pairs."""
    apart = np.linalg.norm(centers[:, None] - centers, axis=-1)
    smaller = np.minimum(radii[:, None], radii)
    return apart <= radii[:, None] + radii - overlap * smaller + 1e-11


def count_pieces(centers, radii, overlap):
    """Number of pieces, by union-find."""
    parent = list(range(len(radii)))

    def root(k):
        while parent[k] != k:
            k = parent[k]
        return k

    for i, j in zip(*np.nonzero(overlaps(centers, radii, overlap)), strict=True):
        parent[root(i)] = root(j)
    return len({root(k) for k in range(len(radii))})


def parts(shape):
    return shape.geometry.centers, shape.geometry.radii


@pytest.mark.parametrize("arrangement", ["voxels", "tetrahedra"])
@pytest.mark.parametrize("isolated", ["connect", "remove"])
def test_assemblies_are_one_piece(arrangement, isolated):
    for seed in range(6):
        shape = make_shape(
            "sphere_assembly", seed=seed, arrangement=arrangement, isolated=isolated, probability=0.3, base="ellipsoid"
        )
        assert isinstance(shape.geometry, Spheres)
        centers, radii = parts(shape)
        assert count_pieces(centers, radii, 0.2) == 1
        assert overlaps(centers, radii, 0.2).sum(axis=1).min() >= 2  # itself and another one


@pytest.mark.parametrize("parameters", [{}, {"probability": 0.35}, {"radii": 0.6, "arrangement": "tetrahedra"}])
def test_assemblies_are_closed_and_oriented(parameters):
    shape = make_shape("sphere_assembly", seed=1, spacing=0.25, **parameters)
    found = diagnose(shape)
    assert found.ok, found.sentences()
    assert found.bodies == 1


@pytest.mark.slow
def test_many_assemblies_are_one_piece():
    rng = stream(1, "parameters")
    for seed in range(1000):
        isolated = "connect" if seed % 2 else "remove"
        shape = make_shape(
            "sphere_assembly",
            seed=seed,
            spacing=float(rng.uniform(0.15, 0.4)),
            probability=float(rng.uniform(0.1, 1.0)),
            overlap=0.3,
            isolated=isolated,
            arrangement="voxels" if seed % 3 else "tetrahedra",
        )
        centers, radii = parts(shape)
        assert count_pieces(centers, radii, 0.3) == 1, seed
        assert np.isfinite(centers).all()
        if seed % 10 == 0:
            assert diagnose(shape).ok, seed


@pytest.mark.slow
def test_number_of_spheres_is_binomial():
    """Points of a lattice in a box of volume V: V / spacing**3 in the mean; each gets a sphere with its probability."""
    shapes, options = 60, {"base": BOX, "spacing": 0.22, "radii": 0.55, "overlap": 0.0}

    def numbers(probability):
        found = [make_shape("sphere_assembly", seed=s, probability=probability, **options) for s in range(shapes)]
        return np.array([len(shape.geometry.radii) for shape in found])

    points = numbers(1.0)
    assert points.mean() == pytest.approx(math.pi / 6 / 0.22**3, abs=4 * points.std() / math.sqrt(shapes))
    for probability in (0.3, 0.8):
        # the same seed has the same points
        spread = np.sqrt(points * probability * (1 - probability))
        deviations = (numbers(probability) - probability * points) / spread
        assert deviations.mean() == pytest.approx(0.0, abs=4 / math.sqrt(shapes))
        assert (deviations**2).mean() == pytest.approx(1.0, abs=4 * math.sqrt(2 / shapes))


def test_points_are_those_of_the_arrangement():
    for arrangement, neighbours in (("voxels", 6), ("tetrahedra", 8)):
        shape = make_shape(
            "sphere_assembly",
            base={"family": "box"},
            arrangement=arrangement,
            probability=1.0,
            spacing=0.1,
            radii=0.75,
            seed=1,
        )
        centers, radii = parts(shape)
        scale = radii[0] / 0.075
        apart = np.linalg.norm(centers[:, None] - centers, axis=-1) / scale
        assert apart[apart > 0].min() == pytest.approx(0.1, rel=1e-9 if arrangement == "voxels" else 0.36)
        assert np.median((apart < 0.1 * 1.15).sum(axis=1) - 1) == pytest.approx(neighbours, abs=2)


def test_radii_are_as_asked():
    centers, radii = parts(make_shape("sphere_assembly", base=BOX, probability=1.0, radii=0.7, seed=1))
    assert np.ptp(radii) < 1e-15
    apart = np.linalg.norm(centers[:, None] - centers, axis=-1)
    assert radii[0] / apart[apart > 0].min() == pytest.approx(0.7, rel=1e-12)
    ratios = []
    for seed in range(8):
        _, radii = parts(make_shape("sphere_assembly", base=BOX, probability=1.0, radii=(0.65, 1.0), seed=seed))
        ratios.extend(radii / radii.max())
    assert stats.kstest(ratios, stats.uniform(0.65, 0.35).cdf).pvalue > 1e-3


def test_removal_follows_the_percolation_of_sites():
    """Sites of a simple cubic lattice percolate from a probability of 0.3116 on (Xu et al. 2014, table 1)."""
    largest = []
    for probability in (0.22, 0.31, 0.42):
        found = []
        for seed in range(4):
            options = {"base": BOX, "spacing": 0.06, "radii": 0.6, "probability": probability, "seed": seed}
            kept = len(parts(make_shape("sphere_assembly", isolated="remove", **options))[1])
            found.append(kept / (probability * math.pi / 6 / 0.06**3))
        largest.append(np.mean(found))
    assert largest[0] < 0.15
    assert 0.1 < largest[1] < 0.7
    assert largest[2] > 0.85


@pytest.mark.parametrize("overlap", [0.0, 0.3])
def test_spheres_grow_along_a_minimum_spanning_tree(overlap):
    rng = stream(4, "spheres")
    for count in (1, 2, 7, 40):
        centers, radii = rng.random((count, 3)), rng.uniform(0.02, 0.1, count)
        grown = connected(centers, radii, overlap)
        assert count_pieces(centers, grown, overlap) == 1
        assert (pieces(centers, grown, overlap) == 0).all()
        assert (grown >= radii).all()
        apart = np.linalg.norm(centers[:, None] - centers, axis=-1)
        gaps = apart - radii[:, None] - radii + overlap * np.minimum(radii[:, None], radii)
        tree = minimum_spanning_tree(np.triu(gaps + 10.0, 1)).tocoo()
        open_ends = {
            k for i, j, gap in zip(tree.row, tree.col, tree.data - 10.0, strict=True) if gap > 1e-9 for k in (i, j)
        }
        assert set(np.flatnonzero(grown > radii)) <= open_ends
        # at a pair that just meets, nothing is wasted
        if count == 2:
            assert apart[0, 1] == pytest.approx(grown.sum() - overlap * grown.min(), rel=1e-9)
    together = np.zeros((3, 3)), np.array([0.1, 0.2, 0.3])
    assert (connected(*together, overlap) == together[1]).all()


def test_volume_is_that_of_the_union():
    """Monte Carlo by all distances against the exact volume."""
    for seed, arrangement in itertools.product(range(2), ("voxels", "tetrahedra")):
        shape = make_shape("sphere_assembly", base="ellipsoid", seed=seed, spacing=0.25, arrangement=arrangement)
        centers, radii = parts(shape)
        low, high = shape.bounds
        points = low + (high - low) * stream(seed, "points").random((60_000, 3))
        inside = np.zeros(len(points), dtype=bool)
        for center, radius in zip(centers, radii, strict=True):
            inside |= ((points - center) ** 2).sum(axis=1) <= radius**2
        share, box = inside.mean(), float(np.prod(high - low))
        assert shape.volume == pytest.approx(box * share, abs=4 * box * math.sqrt(share * (1 - share) / len(points)))
        assert shape.volume == pytest.approx(math.pi / 6, rel=1e-14)


def test_bases_may_be_given_in_three_ways():
    ellipsoid = make_shape("ellipsoid", aspect=(1, 2, 3))
    by_shape = make_shape("sphere_assembly", base=ellipsoid, seed=5)
    table = {"family": "ellipsoid", "aspect": (1, 2, 3)}
    assert by_shape == make_shape("sphere_assembly", base=table, seed=5)
    assert by_shape == make_shape(vg.families.SphereAssembly(base=ellipsoid), seed=5)
    assert by_shape == make_shape(vg.families.SphereAssembly(base=table), seed=5)
    extents = np.ptp(by_shape.geometry.centers, axis=0)
    assert extents[2] / extents[0] == pytest.approx(3, rel=0.25)
    # the size of the base does not matter
    large = parts(make_shape("sphere_assembly", base=ellipsoid.scaled(8.0), seed=5))[0]
    assert large == pytest.approx(by_shape.geometry.centers, abs=1e-12)
    # a random base has a seed of its own, or a new one for each shape
    fixed = [
        make_shape(
            "sphere_assembly", base={"family": "solid_union", "seed": 1}, spacing=0.3, probability=1.0, seed=seed
        )
        for seed in (1, 2)
    ]
    assert fixed[0] != fixed[1]


def test_a_sphere_is_certain():
    shape = make_shape("sphere_assembly", base="sphere", probability=1e-9, seed=3)
    assert len(shape.geometry.radii) == 1
    assert shape.record["base"] == "sphere"
    assert shape.record["points"] > 100
