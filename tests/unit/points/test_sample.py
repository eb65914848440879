import numpy as np
import pytest
from scipy.spatial import cKDTree

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran._base.seeds import stream
from voxgran.geometry.tree import grow_tree
from voxgran.points.covering import covering_radius
from voxgran.points.sample import SurfacePoints, sample_surface
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.tessellate import sphere, unit_box


@pytest.fixture(scope="module")
def scan(data_dir):
    return vg.load_shape(data_dir / "itokawa_lp.obj")


def dense_points(shape, count=40_000):
    """Return many points of the surface by a way of their own: faces by area, weights by the square root rule."""
    generator = stream(12, "dense")
    a, b, c = np.moveaxis(shape.vertices[shape.faces], 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    face = generator.choice(len(area), size=count, p=area / area.sum())
    root, share = np.sqrt(generator.random((1, count))), generator.random((1, count))
    w = np.concatenate([1 - root, root * (1 - share), root * share]).T[:, :, None]
    return w[:, 0] * a[face] + w[:, 1] * b[face] + w[:, 2] * c[face]


@pytest.mark.parametrize("method", ["poisson", "uniform"])
@pytest.mark.parametrize("name", ["scan", "box", "cone", "solid_union"])
def test_every_point_of_the_surface_has_a_sample_within_half_the_spacing(scan, name, method):
    shape = scan if name == "scan" else vg.make_shape(name)
    points = sample_surface(shape, spacing=0.17 * shape.diameter, method=method)
    assert isinstance(points, SurfacePoints)
    assert points.dtype == np.float64
    assert points.spacing <= 0.17 * shape.diameter
    probes = np.concatenate([dense_points(shape), shape.vertices])
    far = cKDTree(points).query(probes)[0].max()
    assert far <= points.spacing / 2
    # and the bound is tight
    assert far >= 0.9 * points.spacing / 2
    apart = grow_tree(shape.vertices, shape.faces).nearest(np.asarray(points))[0]
    assert np.abs(apart).max() <= 1e-9 * shape.diameter


def test_points_that_keep_apart_are_fewer(scan):
    apart = sample_surface(scan, spacing=0.2 * scan.diameter)
    free = sample_surface(scan, spacing=0.2 * scan.diameter, method="uniform")
    assert 2 * len(apart) < len(free)
    gaps = cKDTree(apart).query(apart, k=2)[0][:, 1]
    assert gaps.min() > 0.25 * apart.spacing


def test_half_the_spacing_takes_four_times_the_points(scan):
    coarse, fine = (sample_surface(scan, spacing=s * scan.diameter) for s in (0.2, 0.1))
    assert 3 < len(fine) / len(coarse) < 5


def test_points_of_a_sphere_lie_on_it():
    sphere = vg.make_shape("sphere").scaled(3.0)
    points = sample_surface(sphere, spacing=0.5)
    assert np.allclose(np.linalg.norm(points, axis=1), 1.5, rtol=1e-15, atol=0)
    unit = stream(13, "sphere").normal(size=(50_000, 3))
    unit *= 1.5 / np.linalg.norm(unit, axis=1, keepdims=True)
    assert cKDTree(points).query(unit)[0].max() <= points.spacing / 2


def test_the_same_seed_gives_the_same_bits(scan):
    first = sample_surface(scan, spacing=0.2 * scan.diameter, seed=7)
    again = sample_surface(scan, spacing=0.2 * scan.diameter, seed=7)
    other = sample_surface(scan, spacing=0.2 * scan.diameter, seed=8)
    assert first.tobytes() == again.tobytes()
    assert first.spacing == again.spacing
    assert first.tobytes() != other.tobytes()


@pytest.mark.parametrize("factor", [2.0**-30, 2.0**30])
def test_a_power_of_two_gives_the_same_bits(scan, factor):
    points = sample_surface(scan, spacing=0.25 * scan.diameter)
    scaled = sample_surface(scan.scaled(factor), spacing=0.25 * scan.diameter * factor)
    assert np.array_equal(scaled, points * factor)
    assert scaled.spacing == points.spacing * factor


def test_slices_and_copies_keep_the_spacing(scan):
    points = sample_surface(scan, spacing=0.3 * scan.diameter)
    assert points[3:].spacing == points.spacing
    assert points.copy().spacing == points.spacing
    assert np.isnan(np.zeros((2, 3)).view(SurfacePoints).spacing)


@pytest.mark.parametrize(
    "outline",
    [Outline("disk", radius=0.7), Outline("polygon", vertices=np.array([[0, 0], [3, 0], [3, 1], [1, 1.5]]))],
    ids=["disk", "polygon"],
)
def test_points_along_an_outline(outline):
    shape = Shape.of(outline, name=outline.kind)
    points = sample_surface(shape, spacing=0.2)
    assert points.spacing <= 0.2
    assert (points[:, 2] == 0).all()
    step = np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1)
    assert step.max() <= points.spacing * (1 + 1e-12)
    assert step.sum() == pytest.approx(shape.surface_area, rel=2e-2)
    if outline.kind == "disk":
        assert np.allclose(np.hypot(points[:, 0], points[:, 1]), 0.7)
    else:
        corners = shape.geometry.vertices
        assert cKDTree(points[:, :2]).query(corners)[0].max() < 1e-12


def test_bad_input_is_refused(scan):
    with pytest.raises(InputError, match="spacing"):
        sample_surface(scan, spacing=-1.0)
    with pytest.raises(InputError, match="method"):
        sample_surface(scan, spacing=1.0, method="best")
    with pytest.raises(InputError, match="seed"):
        sample_surface(scan, spacing=1.0, seed=-1)
    with pytest.raises(InputError, match="make it larger"):
        sample_surface(scan, spacing=1e-4 * scan.diameter)


def test_covering_radius_of_the_corners_of_a_cube():
    # the middle of a face is the farthest point, half a diagonal away
    vertices, faces, _ = unit_box()
    for accuracy in (0.1, 1e-3):
        radius = covering_radius(vertices, vertices, faces, accuracy=accuracy)
        assert np.sqrt(0.5) <= radius <= np.sqrt(0.5) * (1 + accuracy)


def test_covering_radius_of_the_poles_of_a_sphere():
    vertices, faces, error = sphere(4)
    radius = covering_radius(np.array([[0, 0, 1.0], [0, 0, -1.0]]), vertices, faces, accuracy=1e-4)
    assert radius == pytest.approx(np.sqrt(2), abs=2 * error)


def test_covering_radius_of_slivers():
    # a face 1000 times as long as wide, covered from one end
    vertices = np.array([[0.0, 0, 0], [1000, 0, 0], [1000, 1, 0]])
    assert covering_radius(vertices[:1], vertices, np.array([[0, 1, 2]])) == pytest.approx(1000, rel=0.02)
    assert covering_radius(vertices[1:2], vertices, np.array([[0, 1, 2]])) == pytest.approx(1000, rel=0.02)


def test_points_are_kept_between_calls(monkeypatch):
    shape = vg.make_shape("convex_polyhedron", seed=11)
    first = sample_surface(shape, spacing=0.3, seed=5)
    monkeypatch.setattr("voxgran.points.sample.spread_points", lambda *given, **named: 1 / 0)
    again = sample_surface(vg.make_shape("convex_polyhedron", seed=11), spacing=0.3, seed=5)
    assert again.tobytes() == first.tobytes()
    assert again.spacing == first.spacing
    # what is changed is a copy
    again[:] = 0.0
    assert sample_surface(shape, spacing=0.3, seed=5).tobytes() == first.tobytes()
