"""Radial distribution function and structure factor: independent points, lattices, published values, freud."""

import math
import warnings

import numpy as np
import pytest
from kit import lattice, mesh_box, slow
from scipy.spatial import cKDTree
from scipy.special import j1

from voxgran._base.errors import InputError, PackingWarning
from voxgran._base.seeds import stream
from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.cylinder import Cylinder
from voxgran.containers.kinds.disk import Disk
from voxgran.containers.kinds.mesh import ClosedMesh
from voxgran.containers.kinds.polygon import Polygon
from voxgran.containers.kinds.rectangle import Rectangle
from voxgran.containers.kinds.sphere import Sphere
from voxgran.geometry.periods import OPEN
from voxgran.measures.model import measure
from voxgran.measures.pair_sums import pair_sums
from voxgran.measures.pair_window import PairWindow
from voxgran.measures.registered.rdf import (
    lattice_structure,
    radial_distribution,
    structure_factor,
    transformed_structure,
)
from voxgran.packing.model import Packing
from voxgran.packing.pack import pack
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive

SPHERE = Shape.of(Primitive("sphere", (0.5,)), name="sphere")
DISK = Shape.of(Outline("disk", radius=0.5), name="disk")
CONTAINERS = {
    "periodic": Box((8, 9, 10), periodic="xyz"),
    "slab": Box((8, 9, 10), periodic="xy"),
    "walls": Box((8, 9, 10)),
    "cylinder": Cylinder(4, 9),
    "sphere": Sphere(4.5),
    "mesh": ClosedMesh(mesh_box((8.0, 9.0, 7.0))),
    "periodic rectangle": Rectangle((8, 9), periodic="xy"),
    "rectangle": Rectangle((8, 9)),
    "disk": Disk(4.5),
    "polygon": Polygon([[0, 0], [9, 1], [8, 8], [3, 9]]),
}


def grains(position, container, scale=1.0, **more):
    """Return spheres, or disks, of equal size at positions."""
    shape = SPHERE if container.dimension == 3 else DISK
    more = {"gravity": None} | more
    return Packing.of([shape], container, position=position, scale=np.full(len(position), scale), **more)


def gas(container, count, seed):
    """Return tiny spheres at independent places in a container."""
    low, high = container.bounds
    position = low + stream(seed, "gas").random((4 * count, 3)) * (high - low)
    if container.dimension == 2:
        position[:, 2] = 0
    return grains(position[container.signed_distance(position) < 0][:count], container, 1e-5)


@pytest.mark.parametrize(
    "name", [slow(name) if name in ("mesh", "cylinder", "polygon", "sphere") else name for name in CONTAINERS]
)
def test_independent_points_have_one_up_to_every_wall(name):
    container = CONTAINERS[name]
    many = 12 if name in ("cylinder", "sphere", "mesh") else 40
    found = [radial_distribution(gas(container, 1000, seed), reach=1.5, step=0.15, inset=0.0) for seed in range(many)]
    kept = np.min([one.pairs for one in found], axis=0) > 20
    assert kept.sum() >= 6
    z = np.array([(one.g[kept] - 1) / one.error[kept] for one in found])
    # the standard error is that of the scatter: the mean of z**2 over so many values has a deviation of about 0.1
    assert (z**2).mean() == pytest.approx(1.0, abs=0.4)
    # no bias: the deviation of the mean of z is one over the root of the number of packings
    assert np.abs(z.mean(axis=0)).max() < 4 / math.sqrt(many)
    assert np.abs(np.mean([one.g[kept] for one in found], axis=0) - 1).max() < 0.06


def test_the_mean_over_directions_of_the_common_part():
    """The isotropized set covariances of a sphere and a disk are closed forms; that of a box is a polynomial."""
    r = np.linspace(0, 2.2, 23)
    none = np.zeros((0, 3))
    box = PairWindow.of(grains(none, Box((5, 6, 7))), 0.0)
    exact = 1 - r * (1 / 5 + 1 / 6 + 1 / 7) / 2 + 2 * r**2 / (3 * math.pi) * (18 / 210) - r**3 / (4 * math.pi * 210)
    assert box.covariance(r) == pytest.approx(exact, abs=1e-12)
    flat = PairWindow.of(grains(none, Rectangle((5, 6))), 0.0)
    assert flat.covariance(r) == pytest.approx(1 - 2 * r * (11 / 30) / math.pi + r**2 / (30 * math.pi), abs=1e-12)
    slab = PairWindow.of(grains(none, Box((5, 6, 7), periodic="xy")), 0.0)
    assert slab.covariance(r) == pytest.approx(1 - r / 14, abs=1e-12)
    for inset in (0.0, 0.37):
        radius = 4 - inset
        sphere = PairWindow.of(grains(none, Sphere(4)), inset)
        assert sphere.covariance(r) == pytest.approx(1 - 3 * r / (4 * radius) + r**3 / (16 * radius**3), rel=2e-3)
        assert sphere.volume == pytest.approx(4 / 3 * math.pi * radius**3, rel=1e-3)
        disk, x = PairWindow.of(grains(none, Disk(4)), inset), r / (2 * radius)
        assert disk.covariance(r) == pytest.approx(2 / math.pi * (np.arccos(x) - x * np.sqrt(1 - x**2)), rel=2e-4)
    nodes, shares = np.polynomial.legendre.leggauss(200)
    u, shares = (nodes + 1) / 2, shares / 2
    x = r[:, None] * np.sqrt(1 - u**2) / 8
    exact = (2 / math.pi * (np.arccos(x) - x * np.sqrt(1 - x**2)) * (1 - r[:, None] * u / 9)) @ shares
    assert PairWindow.of(grains(none, Cylinder(4, 9)), 0.0).covariance(r) == pytest.approx(exact, rel=2e-3)
    mesh = PairWindow.of(grains(none, ClosedMesh(mesh_box((5.0, 6.0, 7.0)))), 0.0)
    assert mesh.covariance(r) == pytest.approx(box.covariance(r), rel=2e-3)


@pytest.mark.parametrize("rise", [0.0, 0.8])
def test_weights_against_pairs_of_random_points(rise):
    for container in (Box((4, 5, 6)), Box((4, 5, 6), periodic="x"), Cylinder(2, 5), Rectangle((4, 5)), Disk(2)):
        window = PairWindow.of(grains(np.zeros((0, 3)), container), 0.2, rise)
        low, high = container.bounds
        draw = stream(1, "points").random((2, 400_000, 3))
        points = low + draw[0] * (high - low)
        w = window.weights(points)
        assert window.volume == pytest.approx(w.mean() * np.prod((high - low)[: container.dimension]), rel=0.01)
        step = stream(1, "steps").standard_normal(points.shape)
        step[:, container.dimension :] = 0
        step *= (1.1 / np.linalg.norm(step, axis=1))[:, None]
        moved = points + step
        moved[:, 0] = (moved[:, 0] - low[0]) % (high - low)[0] + low[0] if container.periodic[0] else moved[:, 0]
        sampled = (w * window.weights(moved)).mean() / w.mean()
        assert window.covariance(np.array([1.1]))[0] == pytest.approx(sampled, rel=0.01)


@pytest.mark.parametrize("periodic", [(False,) * 3, (True, False, True), (True,) * 3])
@pytest.mark.parametrize("bins", [4, 17])
def test_pairs_against_a_tree(periodic, bins):
    edges, step = np.array([9.0, 10.0, 12.0]), 0.24
    points = stream(2, "points").random((300, 3)) * edges
    weights = stream(2, "weights").random(300)
    found = pair_sums(points, weights, step, bins, periods=np.diag(np.where(periodic, edges, 0.0)))
    apart = points[:, None] - points
    apart -= np.where(periodic, edges * np.rint(apart / edges), 0.0)
    distance = np.linalg.norm(apart, axis=2)
    np.fill_diagonal(distance, np.inf)
    for k in range(bins):
        near = (distance >= max(0, (k - 0.5) * step)) & (distance < (k + 0.5) * step)
        q = weights * (near @ weights)
        other = weights * (weights.sum() - weights)
        values = near.sum(), q.sum(), (near * np.outer(weights, weights) ** 2).sum(), (q**2).sum(), (q * other).sum()
        assert [one[k] for one in found] == pytest.approx(values, rel=1e-12)
    assert found.pairs.sum() > 0


def test_pairs_of_points_in_a_line_and_in_a_long_box():
    line = np.zeros((50, 3))
    line[:, 0] = np.arange(50) * 1e4
    ones = np.ones(50)
    found = pair_sums(line, ones, 1e4, 4, periods=OPEN)
    assert found.pairs.tolist() == [0, 98, 96, 94]
    same = pair_sums(np.zeros((5, 3)), np.ones(5), 1.0, 2, periods=OPEN)
    assert same.pairs.tolist() == [20, 0]


def test_the_shells_of_lattices():
    """Counts and distances of neighbours in simple cubic, face-centred cubic and square lattices."""
    cubic = radial_distribution(grains(lattice(10, 10, 10), Box((10, 10, 10), periodic="xyz")), reach=2.4)
    peaks = cubic.middle[cubic.g > 0]
    assert peaks == pytest.approx([1, 1.4, 1.75, 2, 2.25], abs=1e-9)
    inside = (cubic.edges[:-1] <= np.sqrt([1, 2, 3, 4, 5])[:, None]) & (
        np.sqrt([1, 2, 3, 4, 5])[:, None] < cubic.edges[1:]
    )
    assert cubic.neighbours[inside.argmax(axis=1)] == pytest.approx([6, 18, 26, 32, 56], abs=1e-9)
    assert (cubic.error == 0).all()
    cell = np.array([[0, 0, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]])
    edge = math.sqrt(2)
    fcc = ((lattice(6, 6, 6)[:, None] - 0.5 + cell).reshape(-1, 3)) * edge
    found = radial_distribution(grains(fcc, Box((6 * edge,) * 3, periodic="xyz")), reach=2.2)
    assert found.neighbours[np.searchsorted(found.edges, np.sqrt([1, 2, 3, 4])) - 1] == pytest.approx([12, 18, 42, 54])
    assert (found.g > 0).sum() == 4
    square = np.column_stack([lattice(12, 12), np.zeros(144)])
    found = radial_distribution(grains(square, Rectangle((12, 12), periodic="xy")), reach=2.1)
    assert found.neighbours[np.searchsorted(found.edges, np.sqrt([1, 2, 4])) - 1] == pytest.approx([4, 8, 12])


def test_equal_bins_as_in_freud():
    freud = pytest.importorskip("freud")
    for container, points in (
        (Box((9, 10, 11), periodic="xyz"), gas(CONTAINERS["walls"], 3000, 5).position),
        (Rectangle((9, 10), periodic="xy"), gas(CONTAINERS["rectangle"], 3000, 5).position),
    ):
        found = radial_distribution(grains(points, container, 0.1), reach=4.0, step=0.05)
        edges, n = container.bounds[1] - container.bounds[0], len(points)
        box = freud.box.Box(*edges[: container.dimension], is2D=container.dimension == 2)
        peer = freud.density.RDF(bins=len(found.g) - 1, r_max=found.edges[-1], r_min=found.edges[1])
        centered = points - edges / 2
        centered[:, container.dimension :] = 0
        peer.compute((box, centered))
        assert found.g[1:] * (n - 1) / n == pytest.approx(peer.rdf, rel=2e-3, abs=1e-4)


def test_dilute_hard_spheres_at_contact():
    """Percus & Yevick 1958: (1 + f / 2) / (1 - f)**2 at contact; random sequential addition agrees to first order."""
    fraction, values = 0.06, []
    for seed in range(6):
        packing = pack([SPHERE], Box((25, 25, 25), periodic="xyz"), method="rsa", solid_fraction=fraction, seed=seed)
        found = radial_distribution(packing, reach=2.0, step=0.1)
        # the bin of contact is half inside the spheres
        values.append(np.append(found.g[11], 2 * found.g[10]))
    mean, error = np.mean(values, axis=0), np.std(values, axis=0) / math.sqrt(6)
    contact = (1 + fraction / 2) / (1 - fraction) ** 2
    # first order in the solid fraction: 1 + f (8 - 6 r + r**3 / 2)
    assert abs(mean[0] - (1 + fraction * (8 - 6.6 + 1.1**3 / 2))) < 4 * error[0] + 0.02
    assert abs(mean[1] - contact) < 4 * error[1] + 0.03


@pytest.mark.slow
def test_layers_at_walls_do_not_change_the_level():
    """In a dense packing g(r) is that of a periodic one, up to the walls of the window."""
    dense = {}
    for periodic in (True, False):
        packings = [
            pack([SPHERE], Box((9,) * 3, periodic=periodic), method="expand", solid_fraction=0.57, seed=s)
            for s in (1, 2, 3)
        ]
        found = [radial_distribution(p, step=0.25) for p in packings]
        dense[periodic] = [np.mean([one.g[: len(found[0].g)] for one in found], axis=0), found[0].error]
    n = min(len(dense[True][0]), len(dense[False][0]))
    apart = dense[True][0][6:n] - dense[False][0][6:n]
    assert np.abs(apart).max() < 0.12
    assert abs(apart.mean()) < 0.03


@pytest.mark.slow
def test_errors_of_dense_packings_are_those_of_replicates():
    packings = [
        pack([SPHERE], Box((7,) * 3, periodic="xyz"), method="expand", solid_fraction=0.55, seed=s) for s in range(12)
    ]
    found = [radial_distribution(packing, step=0.1) for packing in packings]
    kept = np.min([one.pairs for one in found], axis=0) > 30
    scatter = np.std([one.g for one in found], axis=0, ddof=1)[kept]
    stated = np.mean([one.error for one in found], axis=0)[kept]
    assert np.median(scatter / stated) == pytest.approx(1.0, abs=0.35)


@pytest.mark.parametrize("scale", [1e-50, 1e50])
def test_tiny_and_huge_lengths(scale):
    for container in (Box((8, 9, 10)), Box((8, 9, 10), periodic="xyz"), Cylinder(4, 9), Rectangle((8, 9))):
        plain = gas(container, 120, 1)
        plain = grains(plain.position, container, 0.2)
        large = grains(plain.position * scale, container.scaled(scale), 0.2 * scale)
        one, two = radial_distribution(plain), radial_distribution(large)
        assert two.g == pytest.approx(one.g, rel=1e-6)
        assert two.error == pytest.approx(one.error, rel=1e-6)
        assert two.neighbours == pytest.approx(one.neighbours, rel=1e-6)
        assert two.edges == pytest.approx(one.edges * scale)
        one, two = structure_factor(plain), structure_factor(large)
        assert two.value == pytest.approx(one.value, rel=1e-5, abs=1e-8)
        assert two.wave_number * scale == pytest.approx(one.wave_number)


def test_moved_on_periodic_axes():
    container = Box((8, 9, 10), periodic="xyz")
    position = gas(container, 200, 3).position
    moved = position + np.array([8, 9, 10]) * stream(3, "turns").integers(-3, 4, position.shape)
    one, two = (radial_distribution(grains(p, container, 0.3)) for p in (position, moved))
    assert two.pairs.tolist() == one.pairs.tolist()


def test_what_has_no_pairs():
    for container in CONTAINERS.values():
        with warnings.catch_warnings(action="error"):
            for count in (0, 1):
                tree = measure(grains(container.bounds.mean(axis=0)[None][:count], container), "rdf")
                assert int(tree.pair_window_count) <= count
                assert np.isnan(tree["profiles"].radial_distribution).all()
    one = measure(grains([[1.0, 1.0, 1.0]], Box((2, 3, 4), periodic="xyz")), "rdf")
    assert float(one.number_density) == pytest.approx(1 / 24)
    with pytest.warns(PackingWarning, match="window of the radial distribution function holds 0 of the centroids"):
        assert not len(radial_distribution(grains([[0.5, 0.5, 0.5], [1.5, 0.5, 0.5]], Box((2, 2, 2)))).g)


def test_what_is_refused():
    packing = grains(lattice(8, 8, 8), Box((8, 8, 8), periodic="xyz"))
    with pytest.raises(InputError, match=r"reach is 4\.1: it must be at most half the shortest edge"):
        radial_distribution(packing, reach=4.1)
    with pytest.raises(InputError, match="step is 0"):
        radial_distribution(packing, step=0)
    with pytest.raises(InputError, match="inset is -1"):
        radial_distribution(packing, inset=-1)
    with pytest.raises(InputError, match="reach is 0"):
        structure_factor(packing, reach=0)


def test_below_the_surface_of_a_bed():
    position = lattice(10, 10, 10)[lattice(10, 10, 10)[:, 2] < 6]
    bed = grains(position, Box((10, 10, 20)), gravity="-z")
    window = PairWindow.of(bed, 1.0)
    assert window.lower.tolist() == [1, 1, 1]
    assert window.upper[:2].tolist() == [9, 9]
    assert window.upper[2] == pytest.approx(0.85 * 6, abs=0.3)


def test_the_structure_factor_is_that_of_its_definition():
    points, periods = stream(4, "points").random((50, 3)) * [4, 5, 6], np.array([4.0, 5.0, 6.0])
    found = lattice_structure(points, np.diag(periods), reach=4.0, step=0.5)
    every = np.stack(np.meshgrid(*[np.arange(-5, 6)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    waves = every * 2 * math.pi / periods
    length = np.linalg.norm(waves, axis=1)
    for k, low in enumerate(np.unique(np.floor(found.wave_number / 0.5)) * 0.5):
        shell = (length >= low) & (length < low + 0.5) & (length > 0)
        power = np.abs(np.exp(-1j * points @ waves[shell].T).sum(axis=0)) ** 2 / 50
        if shell.sum() <= 120:
            assert found.vectors[k] * 2 == shell.sum()
            assert found.value[k] == pytest.approx(power.mean(), rel=1e-9)
            assert found.wave_number[k] == pytest.approx(length[shell].mean())


@pytest.mark.parametrize("name", ["periodic", "periodic rectangle", "walls", "rectangle"])
def test_the_structure_factor_of_independent_points_is_one(name):
    container = CONTAINERS[name]
    points = gas(container, 3000, 7)
    if all(container.periodic[: container.dimension]):
        found = structure_factor(grains(points.position, container, 0.3))
        many = found.vectors > 20
        z = (found.value[many] - 1) / found.error[many]
        assert (z**2).mean() == pytest.approx(1.0, abs=0.4)
        assert abs(found.value[many].mean() - 1) < 0.03
    else:
        rdf = radial_distribution(points, reach=3.0, step=0.05, inset=0.0)
        waves = np.arange(3.0, 40.0, 0.5)
        found = transformed_structure(
            rdf.edges, rdf.g, rdf.error, density=rdf.density, dimension=container.dimension, waves=waves
        )
        assert ((found.value - 1) / found.error).std() < 1.6
        assert abs(found.value.mean() - 1) < 0.12


def test_bragg_peaks():
    found = structure_factor(grains(lattice(6, 6, 6), Box((6, 6, 6), periodic="xyz")), reach=6.3)
    last = found.wave_number > 6.2
    assert found.value[~last] == pytest.approx(np.zeros((~last).sum()), abs=1e-18)
    # one of the shell's vectors is 2 pi along each axis, where S is the number of points
    shell = found.vectors[last][0]
    assert found.value[last][0] * shell == pytest.approx(3 * 216, rel=1e-9)


def test_many_vectors_are_drawn_evenly():
    periods = np.array([30.0, 40.0, 50.0])
    found = lattice_structure(stream(5, "points").random((2000, 3)) * periods, np.diag(periods), reach=20.0, step=0.4)
    assert found.vectors.max() == 60
    assert (found.vectors[10:] >= 55).all()
    assert np.diff(found.wave_number) == pytest.approx(np.full(len(found.value) - 1, 0.4), abs=0.15)
    assert found.value.mean() == pytest.approx(1.0, abs=0.05)


def test_both_ways_to_the_structure_factor_agree():
    packing = pack([SPHERE], Box((14,) * 3, periodic="xyz"), method="rsa", solid_fraction=0.3, seed=1)
    exact, rdf = structure_factor(packing, reach=20.0), radial_distribution(packing)
    kept = (exact.wave_number > 2) & (exact.vectors > 30)
    made = transformed_structure(
        rdf.edges, rdf.g, rdf.error, density=rdf.density, dimension=3, waves=exact.wave_number[kept]
    )
    apart = (made.value - exact.value[kept]) / np.hypot(made.error, exact.error[kept])
    assert apart.std() < 1.8
    # compressibility: far below that of independent points at small wave numbers
    assert exact.value[exact.wave_number < 2].mean() < 0.35


def test_the_transform_of_a_step():
    """Points around which others are missing up to a distance: closed form in 3D and 2D, without the window."""
    edges = np.linspace(0, 40, 8001)
    middle = (edges[1:] + edges[:-1]) / 2
    g = (middle > 1) * 1.0
    waves = np.linspace(0.5, 12, 24)
    for d in (2, 3):
        found = transformed_structure(edges, g, np.zeros(8000), density=0.01, dimension=d, waves=waves)
        sphere = 4 * math.pi * (np.sin(waves) - waves * np.cos(waves)) / waves**3
        exact = 1 - 0.01 * (sphere if d == 3 else 2 * math.pi * j1(waves) / waves)
        assert found.value == pytest.approx(exact, abs=2e-4)


def test_the_tree():
    packing = grains(lattice(8, 8, 8) * 2, Box((16,) * 3, periodic="xyz"), 2.0, unit="mm")
    tree = measure(packing, "rdf")
    assert float(tree.number_density) == pytest.approx(1 / 8)
    assert tree.number_density.attrs["units"] == "mm^-3"
    profiles = tree["profiles"]
    assert float(profiles.pair_distance[-1]) == pytest.approx(3.95)
    seen = profiles.radial_distribution.values > 0
    assert profiles.pair_distance.values[seen][:3] == pytest.approx([1.0, 1.4, 1.75])
    assert float(profiles.neighbours_within[profiles.pair_distance.values < 1.1][-1]) == pytest.approx(6)
    assert float(profiles.wave_number[-1]) == pytest.approx(25, abs=0.2)
    assert "radial_distribution" not in measure(packing)["profiles"]


def test_a_tree_of_many_points_is_the_twin():
    """The plain twin: pairs from a k-d tree."""
    points = stream(8, "points").random((2000, 3)) * 10
    found = radial_distribution(grains(points, Box((10,) * 3, periodic="xyz"), 0.2), reach=3.0, step=0.1)
    tree = cKDTree(points, boxsize=10)
    counts = tree.count_neighbors(tree, found.edges[1:]) - 2000
    assert (2 * np.cumsum(found.pairs)).tolist() == counts.tolist()
    assert found.neighbours == pytest.approx(counts / 2000)


def test_the_reach_that_is_taken():
    """Five diameters in dense packings, five spacings in sparse ones, half of small windows."""
    dense = radial_distribution(grains(lattice(12, 12, 12), Box((12, 12, 12), periodic="xyz")))
    assert dense.edges[-1] == pytest.approx(4.975)
    assert np.diff(dense.edges)[1:] == pytest.approx(0.05)
    sparse = radial_distribution(grains(lattice(12, 12, 12) * 2, Box((24, 24, 24), periodic="xyz")))
    assert sparse.edges[-1] == pytest.approx(9.975)
    small = radial_distribution(grains(lattice(6, 6, 6), Box((6, 6, 6), periodic="xyz")))
    assert small.edges[-1] == pytest.approx(2.975)
    walled = radial_distribution(grains(lattice(8, 8, 8), Box((8, 8, 8))))
    assert walled.edges[-1] == pytest.approx(2.975)


def test_one_shell_in_the_window_of_lorch():
    edges, g = np.linspace(0, 5, 501), np.ones(500)
    g[200] = 3.0
    waves = np.array([0.5, 2.0, 7.0])
    found = transformed_structure(edges, g, 0.1 * (g > 1), density=0.4, dimension=3, waves=waves)
    shell, r = 4 / 3 * math.pi * (edges[201] ** 3 - edges[200] ** 3), edges[200:202].mean()
    weight = 0.4 * shell * math.sin(math.pi * r / 5) / (math.pi * r / 5) * np.sin(waves * r) / (waves * r)
    assert found.value == pytest.approx(1 + 2 * weight)
    assert found.error == pytest.approx(0.1 * np.abs(weight))
