"""Local solid fractions: lattices, closed forms, SciPy's and freud's cells, random points and all containers."""

import math

import numpy as np
import pytest
from kit import slow
from scipy.spatial import ConvexHull, Voronoi

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran._base.seeds import stream
from voxgran.measures.cells import cell_volumes
from voxgran.measures.model import measure
from voxgran.measures.registered.local_density import local_density, set_voronoi

SPHERE, DISK = vg.make_shape("sphere"), vg.make_shape("disk")
LATTICES = {
    "cubic": ([[0, 0, 0]], 1.0, math.pi / 6),
    "bcc": ([[0, 0, 0], [0.5, 0.5, 0.5]], 2 / math.sqrt(3), math.pi * math.sqrt(3) / 8),
    "fcc": ([[0, 0, 0], [0.5, 0.5, 0], [0.5, 0, 0.5], [0, 0.5, 0.5]], math.sqrt(2), math.pi / math.sqrt(18)),
}
CONTAINERS = {
    "box": vg.Box((3, 4, 5), periodic="xz"),
    "cylinder": vg.Cylinder(2.0, 5.0),
    "sphere": vg.Sphere(2.0),
    "rectangle": vg.Rectangle((3, 2), periodic="x"),
    "disk": vg.Disk(2.0),
    "polygon": vg.Polygon([(0, 0), (4, 0), (4, 4), (2, 1), (0, 4)], holes=[[(1, 0.5), (1.5, 0.5), (1.5, 0.7)]]),
    "torus": vg.ClosedMesh(vg.make_shape("torus").scaled(5)),
    "union": vg.ClosedMesh(vg.make_shape("solid_union", seed=1).scaled(3)),
}


def points_in(container, count, name="points"):
    """Return random points in a container."""
    low, high = container.bounds
    points = low + stream(0, name).random((20 * count, 3)) * (high - low)
    return points[container.signed_distance(points) < 0][:count]


@pytest.mark.parametrize("name", LATTICES)
def test_lattices(name):
    basis, edge, expected = LATTICES[name]
    corners = np.indices((2, 2, 2)).reshape(3, -1).T
    position = ((corners[:, None] + np.array(basis)).reshape(-1, 3) + 0.1) * edge
    found = local_density(vg.Packing.of([SPHERE], vg.Box((2 * edge,) * 3, periodic="xyz"), position=position))
    assert found.solid_fraction == pytest.approx(expected, rel=1e-12)
    assert found.error == 0.0


def test_cells_are_those_of_scipy():
    place, length = stream(1, "points").random((60, 3)) * 3.0, 3.0
    copies = (place[None] + length * (np.indices((3, 3, 3)).reshape(3, -1).T - 1)[:, None]).reshape(-1, 3)
    diagram, middle = Voronoi(copies), 13 * len(place)
    regions = [diagram.regions[diagram.point_region[middle + k]] for k in range(len(place))]
    expected = [ConvexHull(diagram.vertices[region]).volume for region in regions]
    found = cell_volumes(place, np.zeros(60), vg.Box((length,) * 3, periodic="xyz"))
    assert found == pytest.approx(expected, rel=1e-10)


def test_cells_are_those_of_freud():
    freud = pytest.importorskip("freud")
    place = (stream(2, "points").random((500, 3)) - 0.5) * [4, 5, 6]
    expected = freud.locality.Voronoi().compute((freud.box.Box(4, 5, 6), place)).volumes
    found = cell_volumes(place, np.zeros(500), vg.Box((4, 5, 6), periodic="xyz", origin=(-2, -2.5, -3)))
    assert found == pytest.approx(expected, rel=1e-5)


def test_two_spheres_of_different_size():
    # the plane of equal power
    box = vg.Box((5, 2, 2))
    packing = vg.Packing.of([SPHERE], box, position=[[1, 1, 1], [3.5, 1, 1]], scale=[1.0, 2.0])
    plane = 1 + (2.5**2 + 0.5**2 - 1.0**2) / 5.0
    found = local_density(packing)
    assert found.cell_volume == pytest.approx([4 * plane, 20 - 4 * plane], rel=1e-13)
    assert found.solid_fraction == pytest.approx(packing.volumes / found.cell_volume, rel=1e-15)


@pytest.mark.parametrize("name", CONTAINERS)
@pytest.mark.parametrize("count", [1, 2, 400])
def test_volumes_add_up_to_that_of_the_container(name, count):
    container = CONTAINERS[name]
    place = points_in(container, count)
    weights = 0.02 * stream(1, "weights").random(len(place))
    found = cell_volumes(place, weights, container)
    assert found.sum() == pytest.approx(container.volume, rel=1e-12)
    assert (found >= 0).all()


@pytest.mark.parametrize("name", [slow(name) if name in ("torus", "union") else name for name in CONTAINERS])
def test_each_cell_holds_its_share_of_random_points(name):
    container, n = CONTAINERS[name], 12
    seeds, many = points_in(container, n), points_in(container, 40_000, "many")
    apart = many[:, None] - seeds[None]
    lengths = np.where(container.periodic, container.bounds[1] - container.bounds[0], np.inf)
    apart = np.minimum(np.abs(apart), np.abs(lengths - np.abs(apart)))
    weights = 0.3 * stream(1, "weights").random(n)
    share = np.bincount(np.argmin((apart**2).sum(axis=2) - weights, axis=1), minlength=n) / len(many)
    found = cell_volumes(seeds, weights, container) / container.volume
    assert np.abs(found - share).max() < 4.5 * 0.5 / math.sqrt(len(many))


def test_disks_and_their_mean():
    packing = vg.pack([DISK], vg.Rectangle((12, 9), periodic="x"), "rsa", count=50, seed=1)
    found = local_density(packing)
    assert found.cell_volume.sum() == pytest.approx(108.0, rel=1e-12)
    assert np.average(found.solid_fraction, weights=found.cell_volume) == pytest.approx(packing.solid_fraction)


def ellipsoids():
    """Return ellipsoids at random in a periodic box."""
    shape = vg.make_shape("ellipsoid", semi_axes=(0.75, 0.5, 0.35))
    return vg.pack([shape], vg.Box((4, 4, 4), periodic="xyz"), "rsa", count=25, seed=2)


@pytest.mark.slow
def test_set_voronoi_cells_converge():
    packing = ellipsoids()
    best = set_voronoi(packing, 1500)
    counts = np.array([24, 72, 216])
    errors = [float(np.sqrt(np.mean((set_voronoi(packing, int(n)) - best) ** 2))) for n in counts]
    # the spacing is the inverse of the root of the number of points
    rate = -2 * np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert 1.0 < rate < 3.5, (rate, errors)
    assert best.sum() == pytest.approx(64.0, rel=1e-12)


@pytest.mark.slow
def test_the_error_of_set_voronoi_cells():
    packing = ellipsoids()
    found, best = local_density(packing), packing.volumes / set_voronoi(packing, 1000)
    actual = np.sqrt(np.mean((found.solid_fraction - best) ** 2))
    assert actual < found.error < 8 * actual
    assert np.average(found.solid_fraction, weights=found.cell_volume) == pytest.approx(packing.solid_fraction)


@pytest.mark.slow
def test_set_voronoi_cells_of_spheres_are_voronoi_cells():
    place = np.array([[0.2, 0.2, 0.2], [1.6, 1.0, 0.3], [0.5, 1.5, 1.4], [1.5, 0.4, 1.5]])
    packing = vg.Packing.of([SPHERE], vg.Box((2.2,) * 3, periodic="xyz"), position=place, scale=[0.8] * 4)
    exact = local_density(packing).cell_volume
    assert set_voronoi(packing, 1500) == pytest.approx(exact, rel=0.01)


def test_grains_in_grains_stay_finite():
    place = [[2, 2, 2], [2, 2, 2], [2.1, 2, 2], [2, 2, 2]]
    packing = vg.Packing.of([SPHERE], vg.Box((4, 4, 4)), position=place, scale=[2.0, 1.0, 0.2, 2.0])
    found = local_density(packing)
    # of equal spheres at one place each has half of the cell, spheres within others have none
    assert found.cell_volume == pytest.approx([32, 0, 0, 32])
    assert np.isnan(found.solid_fraction).tolist() == [False, True, True, False]
    assert math.isfinite(found.mean)
    box = vg.make_shape("box", lengths=(1, 1, 1))
    twice = vg.Packing.of([box], vg.Box((4, 4, 4)), position=[[2, 2, 2]] * 2 + [[2.1, 2, 2]], scale=[1.0, 1.0, 2.0])
    assert set_voronoi(twice, 60).sum() == pytest.approx(64.0, rel=1e-12)


def test_no_grain_one_grain_and_all_lengths():
    none = vg.Packing.of([SPHERE], vg.Box((2, 2, 2)), position=np.zeros((0, 3)))
    assert math.isnan(local_density(none).mean)
    assert measure(none, "local_density")["/local_density"].probability_density.sum() == 0
    one = vg.Packing.of([SPHERE], vg.Cylinder(1.0, 2.0), position=[[0, 0, 1]])
    assert local_density(one).solid_fraction == pytest.approx([one.solid_fraction], rel=1e-13)
    place = stream(3, "points").random((20, 3))
    usual = cell_volumes(place, np.zeros(20), vg.Box((1, 1, 1), periodic="x"))
    for factor in (2.0**-150, 1e-50, 1e40):
        box = vg.Box((factor,) * 3, periodic="x")
        assert cell_volumes(place * factor, np.zeros(20), box) / factor**3 == pytest.approx(usual, rel=1e-9)


def test_the_measure():
    packing = vg.pack([SPHERE], vg.Box((5, 5, 5), periodic="xyz"), "rsa", count=40, seed=0)
    tree = measure(packing, "local_density")
    assert tree["/grains"].cell_volume.sum() == pytest.approx(125.0, rel=1e-12)
    assert float(tree.local_solid_fraction_std) == pytest.approx(float(tree["/grains"].local_solid_fraction.std()))
    spread = tree["/local_density"]
    width = float(spread.local_solid_fraction_bin[1] - spread.local_solid_fraction_bin[0])
    assert float(spread.probability_density.sum()) * width == pytest.approx(1.0)
    middle = float(spread.local_solid_fraction_quantile.sel(quantile=0.5))
    assert middle == pytest.approx(float(tree["/grains"].local_solid_fraction.median()))
    with pytest.raises(InputError, match="points"):
        local_density(packing, points=3)
