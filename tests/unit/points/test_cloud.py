"""Point clouds: thinning, stray points, normals, bodies, and the way back to a shape."""

import os

import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran._base.errors import DirtyMeshError, InputError
from voxgran._base.seeds import stream
from voxgran.geometry.rotation import random_rotations, rotation_matrices
from voxgran.points.blue_noise import random_points
from voxgran.points.cloud import Cloud


def sphere_points(count, seed=1):
    """Return points anyhow on a unit sphere."""
    points = stream(seed, "sphere").normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1)[:, None]


def scan_of(shape, count, noise, seed=1):
    """Return noisy points anyhow on a shape."""
    corners, faces, _ = shape.geometry.tessellation()
    points = random_points(corners, faces, count, seed=seed)
    return points + noise * stream(seed, "noise").normal(size=points.shape)


@pytest.mark.slow
def test_eros_comes_back_from_noisy_points(eros):
    noise = 0.002 * eros.diameter
    cloud = Cloud.of(scan_of(eros, 20_000, noise) + np.array([5.0, -6.0, 7.0]))
    made = vg.shape_of_cloud(cloud, name="eros again")
    assert made.shape.name == "eros again"
    assert made.shape.volume == pytest.approx(eros.volume, rel=0.01)
    assert vg.diagnose(made.shape).ok
    # independent: Open3D's distances of clean points of the true body from the surface that came of the noisy ones
    clean = Cloud.of(scan_of(eros, 5000, 0.0, seed=2) + np.array([5.0, -6.0, 7.0]))
    tree_distance = made.shape.geometry.tree.nearest(clean.points - np.array(made.shape.offset))[0]
    assert tree_distance.mean() < 2 * noise
    assert made.mean_residual == pytest.approx(noise * np.sqrt(2 / np.pi), rel=0.15)
    assert made.rms_residual > made.mean_residual
    assert made.largest_hole < 4 * made.spacing
    assert np.array(made.shape.offset) == pytest.approx([5.0, -6.0, 7.0], abs=0.01 * eros.diameter)


@pytest.mark.slow
def test_a_sphere_converges():
    """Clean points: flat faces lose volume by the square of the spacing; the smooth surface errs far less."""
    sphere, lost, off, residual = 36 * np.pi, [], [], []
    for count in (1500, 6000, 24_000):
        cloud = Cloud.of(3.0 * sphere_points(count))
        lost.append(1 - vg.shape_of_cloud(cloud, method="alpha").shape.volume / sphere)
        smooth = vg.shape_of_cloud(cloud)
        off.append(abs(smooth.shape.volume / sphere - 1))
        residual.append(smooth.mean_residual)
    assert np.log2(np.array(lost[:-1]) / lost[1:]) == pytest.approx([2.0, 2.0], abs=0.1)
    assert max(off) < 1e-3
    assert residual[0] > 2 * residual[1] > 4 * residual[2]


def test_alpha_keeps_the_points():
    made = vg.shape_of_cloud(Cloud.of(sphere_points(4000)), method="alpha")
    assert made.largest_residual < 1e-6
    assert made.shape.volume < 4 / 3 * np.pi


@pytest.mark.parametrize("factor", [1e-9, slow(1e9)])
def test_unit_does_not_matter(factor):
    points = sphere_points(2000)
    made = vg.shape_of_cloud(Cloud.of(factor * points))
    one = vg.shape_of_cloud(Cloud.of(points))
    assert made.shape.volume / factor**3 == pytest.approx(one.shape.volume, rel=1e-6)
    assert made.mean_residual / factor == pytest.approx(one.mean_residual, rel=1e-3)


def test_same_cloud_same_bits():
    cloud = Cloud.of(sphere_points(3000))
    first, second = vg.shape_of_cloud(cloud), vg.shape_of_cloud(cloud)
    assert first.shape.key == second.shape.key


def test_a_half_scanned_body_is_refused_with_the_place():
    points = sphere_points(4000)
    with pytest.raises(
        InputError, match=r"too sparse to close: around \(0\.[2-9]\d*, .*no point lies within (0\.[3-9]|1\.)"
    ):
        vg.shape_of_cloud(Cloud.of(points[points[:, 0] < 0.2]))


@pytest.mark.parametrize(
    ("points", "options", "words"),
    [
        (sphere_points(20), {}, "has 20 points"),
        (sphere_points(300) * [1, 1, 0], {}, "lies in a plane"),
        (sphere_points(300), {"method": "posson"}, "method"),
        (sphere_points(300), {"depth": 1}, "depth"),
        (sphere_points(300), {"depth": 15}, "depth is 15"),
        (sphere_points(300), {"alpha": -1.0}, "alpha"),
        (sphere_points(300), {"max_gap": 0.0}, "max_gap"),
    ],
)
def test_bad_input_is_refused(points, options, words):
    with pytest.raises(InputError, match=words):
        vg.shape_of_cloud(Cloud.of(points), **options)


def test_nothing_comes_of_spheres_too_small():
    with pytest.raises((DirtyMeshError, InputError), match=r"alpha|sparse|certain|holes"):
        vg.shape_of_cloud(Cloud.of(sphere_points(500)), method="alpha", alpha=1e-6)


def test_spacing_is_that_of_the_area():
    assert Cloud.of(sphere_points(5000)).spacing == pytest.approx(np.sqrt(4 * np.pi / 5000), rel=0.03)
    assert Cloud.of(np.zeros((0, 3))).spacing == 0.0


def test_normals_point_outward():
    points = sphere_points(3000) * [1.0, 2.0, 0.5]
    cloud = Cloud.of(points + np.array([100.0, 0.0, 0.0])).with_normals()
    true = points / np.array([1.0, 4.0, 0.25])
    true /= np.linalg.norm(true, axis=1)[:, None]
    assert (cloud.normals * true).sum(axis=1).mean() > 0.99


def test_stray_points_go():
    points = np.concatenate([sphere_points(3000), 3.0 + sphere_points(30)])
    kept = Cloud.of(points, grain=np.arange(len(points))).without_outliers(2.0)
    assert 2700 < len(kept) <= 3000
    assert kept.grain.max() < 3000


def test_bodies_are_told_apart():
    points = np.concatenate([sphere_points(2000), 0.5 * sphere_points(1000) + [3.0, 0, 0], [[9.0, 9.0, 9.0]]])
    bodies = Cloud.of(points).clusters()
    assert [len(body) for body in bodies] == [2000, 1000]
    assert [int(body.grain[0]) for body in bodies] == [0, 1]
    assert bodies[1].points.mean(axis=0) == pytest.approx([3.0, 0, 0], abs=0.05)
    assert Cloud.of(np.zeros((0, 3))).clusters() == []


def test_thinning_takes_the_mean_of_each_cube():
    points = np.array([[0.1, 0.1, 0.1], [0.3, 0.3, 0.3], [2.0, 2.0, 2.0], [0.2, 0.2, 0.2]])
    thin = Cloud.of(points, grain=[0, 0, 0, 1]).thinned(1.0)
    assert sorted(thin.grain.tolist()) == [0, 0, 1]
    assert np.sort(thin.points[:, 0]) == pytest.approx([0.2, 0.2, 2.0])


def test_cropping_keeps_the_border():
    cloud = Cloud.of([[0, 0, 0], [1, 1, 1], [2, 2, 2]], grain=[4, 5, 6]).cropped([0.5] * 3, [2.0] * 3)
    assert cloud.grain.tolist() == [5, 6]
    with pytest.raises(InputError, match="lower"):
        cloud.cropped([1, 0, 0], [0, 1, 1])


def test_normals_without_length_are_refused():
    with pytest.raises(InputError, match="normal 1 has length 0"):
        Cloud.of(np.eye(3), [[1, 0, 0], [0, 0, 0], [0, 0, 1]])


def test_two_scans_are_registered(eros):
    noise = 0.002 * eros.diameter
    target = Cloud.of(scan_of(eros, 12_000, noise))
    turn = rotation_matrices(random_rotations(stream(3, "turn"), 1))[0]
    second = scan_of(eros, 12_000, noise, seed=9)
    # a scan of its own, of three quarters of the body, from another side
    part = second[second[:, 0] < np.quantile(second[:, 0], 0.75)]
    found = vg.register_clouds(Cloud.of(part @ turn.T + [1.0, 2.0, 3.0]), target)
    assert found.rotation @ turn == pytest.approx(np.eye(3), abs=0.005)
    back = found.moved(Cloud.of(part @ turn.T + [1.0, 2.0, 3.0]))
    assert np.abs(back.points - part).max() < 3 * noise
    assert found.overlap > 0.95
    assert found.residual < 10 * noise


def test_scans_of_nothing_alike_are_refused():
    line = np.linspace(0, 1, 400)[:, None] * [1.0, 0, 0]
    with pytest.raises(InputError, match=r"finds partners|points left in cubes"):
        vg.register_clouds(Cloud.of(50.0 * sphere_points(400)), Cloud.of(line + 1e-3 * sphere_points(400)))
    with pytest.raises(InputError, match="has 3 points"):
        vg.register_clouds(Cloud.of(np.eye(3)), Cloud.of(line))
    with pytest.raises(InputError, match=r"has lengths in mm and .* in um: both scans must have one unit"):
        vg.register_clouds(Cloud.of(line, unit="mm"), Cloud.of(line, unit="um"))


@pytest.mark.parametrize("height", [0.0, 0.7])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_spheres_that_get_inside_are_refused_with_the_place(seed, height):
    points = sphere_points(4000, seed)
    with pytest.raises(InputError, match=r"too sparse to close: .*around \(.*, .*, (0\.\d+|-?\d\S*)\)"):
        vg.shape_of_cloud(Cloud.of(points[points[:, 2] < height]), method="alpha")


@pytest.mark.slow
def test_a_thin_plate_is_a_body():
    plate = vg.make_shape("box", lengths=(2.0, 2.0, 0.2))
    for method in ("alpha", "poisson"):
        made = vg.shape_of_cloud(Cloud.of(scan_of(plate, 8000, 0.0)), method=method)
        assert made.shape.volume == pytest.approx(0.8, rel=0.05)


@pytest.mark.parametrize("method", [slow("poisson"), "alpha"])
def test_two_bodies_and_stray_points_are_refused(method):
    two = np.concatenate([sphere_points(3000), sphere_points(2000, 2) + np.array([3.0, 0, 0])])
    with pytest.raises(InputError, match=r"take bodies apart with clusters|without_outliers"):
        vg.shape_of_cloud(Cloud.of(two), method=method)
    stray = np.concatenate([sphere_points(4000), [[20.0, 0, 0]]])
    with pytest.raises(InputError, match=r"without_outliers"):
        vg.shape_of_cloud(Cloud.of(stray), method=method)
    body = Cloud.of(two).clusters()[1]
    assert vg.shape_of_cloud(body, method=method).shape.volume == pytest.approx(4 / 3 * np.pi, rel=0.02)


@pytest.mark.parametrize("method", [slow("poisson"), "alpha"])
def test_points_that_stand_twice_do_not_matter(method):
    points = sphere_points(1500)
    once, often = (vg.shape_of_cloud(Cloud.of(np.repeat(points, k, axis=0)), method=method) for k in (1, 5))
    assert often.spacing == once.spacing
    assert often.shape.volume == pytest.approx(once.shape.volume, rel=0.01)
    with pytest.raises(InputError, match="has 1 points that differ"):
        vg.shape_of_cloud(Cloud.of(np.ones((200, 3))))


def test_arrays_of_the_caller_stay_his():
    points = sphere_points(100)
    cloud = Cloud.of(points[:50], points[:50])
    points[0] = 99.0
    assert np.abs(cloud.points).max() <= 1.0
    assert np.abs(cloud.normals).max() <= 1.0
    with pytest.raises(InputError, match=r"grain is 0\.5"):
        Cloud.of(points, grain=np.full(100, 0.5))


def test_thinning_survives_opposite_normals_and_refuses_dust():
    plate = Cloud.of([[0, 0, 0], [0, 0, 0.01]], [[0, 0, -1], [0, 0, 1]])
    assert np.linalg.norm(plate.thinned(1.0).normals, axis=1) == pytest.approx([1.0])
    with pytest.raises(InputError, match="spacing is 1e-12"):
        Cloud.of(sphere_points(50)).thinned(1e-12)


def test_scans_in_other_units_are_refused(capfd):
    cloud = Cloud.of(sphere_points(2000))
    for other in (Cloud.of(1000.0 * sphere_points(2000)), Cloud.of(np.ones((100, 3)))):
        with pytest.raises(InputError, match="bring both scans to one unit"):
            vg.register_clouds(cloud, other)
    with pytest.raises(InputError, match="lower distance"):
        vg.register_clouds(cloud, cloud, distance=1e9)
    assert capfd.readouterr().out == ""


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_a_cloud_has_finite_points_however_it_is_made(wrong):
    points = np.ones((5, 3))
    points[3, 1] = wrong
    with pytest.raises(InputError, match="finite"):
        Cloud(points)
    with pytest.raises(InputError, match="normals"):
        Cloud(np.ones((5, 3)), np.ones((4, 3)))


def test_nothing_is_written_to_the_terminal(capfd):
    """Open3D warns of a sparse, noisy cloud by hundreds of lines, past its own log."""
    generator = np.random.default_rng(0)
    points = generator.normal(size=(300, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    points += 0.05 * generator.normal(size=points.shape)
    assert vg.shape_of_cloud(vg.Cloud(points), method="poisson").shape.volume == pytest.approx(4 * np.pi / 3, rel=0.2)
    assert capfd.readouterr() == ("", "")
    os.write(2, b"afterwards all is heard")
    assert capfd.readouterr().err == "afterwards all is heard"
