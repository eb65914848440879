"""Points that keep apart: their number, distances, density and spectrum, beside Open3D's and a plain program."""

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.stats import chi2

import voxgran as vg
from benchmarks.peers import sampling as peers
from voxgran._base.seeds import stream
from voxgran.geometry.triangles import areas_of
from voxgran.points import blue_noise
from voxgran.points.blue_noise import random_points, spread_points
from voxgran.points.covering import covering_radius

SHEET = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]), np.array([[0, 1, 2], [0, 2, 3]])


@pytest.fixture(scope="module")
def scan(data_dir):
    return vg.load_shape(data_dir / "itokawa_lp.obj")


def hexagonal(mesh, count):
    """Return the distance of as many points in a hexagonal arrangement."""
    return np.sqrt(areas_of(mesh[0][mesh[1]]).sum() * 2 / (np.sqrt(3) * count))


def nearest(points):
    """Return the distance of each point from the next one."""
    return cKDTree(points).query(points, k=2)[0][:, 1]


@pytest.mark.parametrize("count", [1, 2, 13, 700])
@pytest.mark.parametrize("lengths", [(1, 1, 1), (1, 30, 30), (1, 1, 500)], ids=["cube", "plate", "needle"])
def test_as_many_points_as_asked_lie_on_the_surface_and_keep_apart(lengths, count):
    box = vg.make_shape("box", lengths=lengths)
    for points in (spread_points(box.vertices, box.faces, count, seed=4) for _ in range(2)):
        assert points.shape == (count, 3)
        off = np.abs(points) / (np.array(lengths) / 2)
        assert off.max(axis=1) == pytest.approx(np.ones(count), abs=1e-12)
    if count > 1:
        # along a needle the distance of a line is larger than that of its surface
        assert nearest(points).min() > 0.6 * hexagonal((box.vertices, box.faces), count)


def test_distances_and_holes_are_better_than_those_of_open3d(scan):
    mesh, count = (scan.vertices / scan.diameter, scan.faces), 4000
    own, peer = (sampled(*mesh, count, seed=1) for sampled in (spread_points, peers.open3d_points))
    unit = hexagonal(mesh, count)
    assert nearest(own).min() >= 0.69 * unit
    assert nearest(own).min() > 0.99 * nearest(peer).min()
    assert nearest(own).mean() > nearest(peer).mean()
    assert covering_radius(own, *mesh) < 0.97 * covering_radius(peer, *mesh)


def test_a_seed_gives_the_same_bits_at_any_power_of_two(scan):
    first, again = (spread_points(scan.vertices * factor, scan.faces, 500, seed=2) for factor in (1.0, 2.0**-40))
    assert (first * 2.0**-40).tobytes() == again.tobytes()
    assert first.tobytes() != spread_points(scan.vertices, scan.faces, 500, seed=3).tobytes()


@pytest.mark.parametrize("sampled", [random_points, spread_points])
def test_the_density_is_that_of_the_area(sampled):
    """A square of four triangles that meet near its corner, of areas from 1 to 9, inside a frame: borders attract
    points that keep apart, those of Open3D, too.
    """
    inner, outer = (np.array([[-w, -w], [w, -w], [w, w], [-w, w]]) for w in (1.0, 1.3))
    vertices = np.column_stack([np.concatenate([inner, outer, [[-0.8, -0.8]]]), np.zeros(9)])
    turn = [(k, (k + 1) % 4) for k in range(4)]
    frame = [face for k, m in turn for face in ((4 + k, 4 + m, m), (4 + k, m, k))]
    faces = np.array([(k, m, 8) for k, m in turn] + frame)
    assert areas_of(vertices[faces]).sum() == pytest.approx(2.6**2)
    points = np.concatenate([sampled(vertices, faces, 1500, seed=seed) for seed in range(4)])
    found = np.histogram2d(*points[:, :2].T, bins=np.linspace(-1, 1, 11))[0]
    expected = len(points) * 0.2**2 / 2.6**2
    assert ((found - expected) ** 2 / expected).sum() < chi2.ppf(0.99, 100)


def power(points, edges):
    """Return the radial means of the periodogram of points on a unit square, under a Hann window, between edges."""
    wave = np.arange(-50, 51)
    window = 4 * (np.sin(np.pi * points[:, :2]) ** 2).prod(axis=1)
    x, y = (np.exp(-2j * np.pi * np.outer(points[:, k], wave)) for k in (0, 1))
    found = np.abs((x * window[:, None]).T @ y) ** 2 / (window**2).sum()
    ring = np.digitize(np.hypot(wave[:, None], wave), edges)
    return np.array([found[ring == k].mean() for k in range(1, len(edges))])


def test_the_spectrum_is_as_blue_as_that_of_open3d():
    # 1000 points: the peak lies at about 1 / 0.031, and independent points have 1 everywhere
    edges = (2.5, 10, 20, 30, 40)
    own, peer, random = (
        np.mean([power(sampled(*SHEET, 1000, seed=seed), edges) for seed in range(4)], axis=0)
        for sampled in (spread_points, peers.open3d_points, random_points)
    )
    assert own[0] < 1.1 * peer[0]
    assert own[1] < peer[1]
    assert max(own[:2]) < 0.15
    assert own[3] > 1.2
    assert random[1:] == pytest.approx(1.0, abs=0.25)


def plain(points, order, radius, count):
    """Return what the kernel does, by all distances."""
    chosen = []
    while True:
        before = len(chosen)
        for p in order:
            if p not in chosen and (not chosen or (((points[chosen] - points[p]) ** 2).sum(axis=1) >= radius**2).all()):
                chosen.append(p)
        if len(chosen) >= count:
            return chosen, before
        radius *= blue_noise.LOWER


@pytest.mark.parametrize("radius", [0.35, 0.08])
def test_a_plain_program_chooses_the_same_points(radius):
    points = stream(5, "cube").random((300, 3)) - 0.5
    order = blue_noise._mixed(points, 0.3, np.uint64(1), np.uint64(2))
    assert np.array_equal(np.sort(order), np.arange(300))
    chosen, before = blue_noise._chosen(points, order, radius, 60)
    expected, earlier = plain(points, order.tolist(), radius, 60)
    assert chosen.tolist() == expected
    assert before == earlier
    # the small radius leaves more than asked at once
    assert (before > 0) == (radius > 0.1)


def test_points_of_a_tile_come_one_after_another_in_random_order():
    points = stream(6, "row").random((2000, 3)) * [4, 1, 1]
    order = blue_noise._mixed(points, 1.0, np.uint64(1), np.uint64(2))
    tile = np.floor(points[order, 0])
    assert (np.diff(tile) != 0).sum() == 3
    first = order[tile == tile[0]]
    assert abs(np.corrcoef(first, np.arange(len(first)))[0, 1]) < 0.15
