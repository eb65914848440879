"""What holds for every shape: rotation changes nothing that is measured, scaling changes it by powers."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from voxgran._base.seeds import stream
from voxgran.geometry.rotation import random_rotations, rotation_matrices
from voxgran.shapes import sizes
from voxgran.shapes.family import make_shape
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.repairing.diagnose import diagnose
from voxgran.shapes.spheres import Spheres

seeds = st.integers(0, 10**6)
lengths = st.floats(0.1, 10.0)


def random_spheres(seed, count):
    generator = stream(seed, "spheres")
    return Spheres(generator.standard_normal((count, 3)), 0.3 + generator.random(count))


def random_outline(seed, count):
    generator = stream(seed, "outline")
    angles = 2 * np.pi * (np.arange(count) + 0.8 * generator.random(count)) / count
    radii = 0.5 + generator.random(count)
    return Outline("polygon", vertices=radii[:, None] * np.column_stack([np.cos(angles), np.sin(angles)]))


@st.composite
def geometries(draw):
    regular = ["ellipsoid", "box", "cylinder", "cone", "spherocylinder"]
    kind = draw(st.sampled_from(["spheres", "mesh", "outline", "disk", *regular]))
    if kind == "spheres":
        return random_spheres(draw(seeds), draw(st.integers(1, 12)))
    if kind == "outline":
        return random_outline(draw(seeds), draw(st.integers(3, 12)))
    if kind == "mesh":
        return make_shape("convex_polyhedron", seed=draw(seeds), points=draw(st.integers(4, 20))).geometry
    if kind == "disk":
        return Outline("disk", radius=draw(lengths))
    count = 3 if kind in ("ellipsoid", "box") else 2
    return Primitive(kind, tuple(draw(lengths) for _ in range(count)))


def turn_of(seed, dimension):
    if dimension == 3:
        return rotation_matrices(random_rotations(stream(seed, "turn"), 1))[0]
    angle = 2 * math.pi * stream(seed, "turn").random()
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])


@given(geometries(), seeds)
def test_turning_changes_no_measure(geometry, seed):
    shape = Shape.of(geometry, name="any")
    turn = turn_of(seed, shape.dimension)
    turned = shape.geometry.rotated(turn)
    size = np.trace(shape.inertia)
    assert turned.volume == pytest.approx(shape.volume, rel=1e-12)
    assert turned.surface_area == pytest.approx(shape.surface_area, rel=1e-12)
    assert turned.inertia == pytest.approx(turn @ shape.inertia @ turn.T, abs=1e-12 * size)
    assert turned.bounding_radius == pytest.approx(shape.bounding_radius, rel=1e-12)
    assert turned.centroid == pytest.approx(np.zeros(3), abs=1e-12 * shape.bounding_radius)


@given(geometries(), st.floats(1e-6, 1e6))
def test_scaling_changes_measures_by_powers(geometry, factor):
    shape = Shape.of(geometry, name="any")
    scaled, d = shape.scaled(factor), shape.dimension
    assert scaled.volume == pytest.approx(shape.volume * factor**d, rel=1e-11)
    assert scaled.surface_area == pytest.approx(shape.surface_area * factor ** (d - 1), rel=1e-11)
    assert scaled.inertia == pytest.approx(
        shape.inertia * factor ** (d + 2), rel=1e-9, abs=1e-11 * np.trace(scaled.inertia)
    )
    assert scaled.diameter == pytest.approx(shape.diameter * factor, rel=1e-12)


@given(geometries(), st.integers(-20, 20))
def test_scaling_by_a_power_of_two_keeps_all_bits(geometry, power):
    shape = Shape.of(geometry, name="any")
    scaled = shape.scaled(2.0**power)
    assert scaled.volume == shape.volume * 2.0 ** (power * shape.dimension)
    assert (scaled.inertia == shape.inertia * 2.0 ** (power * (shape.dimension + 2))).all()
    assert scaled.bounding_radius == shape.bounding_radius * 2.0**power


@given(geometries())
def test_inertia_obeys_the_triangle_inequality(geometry):
    moments = np.linalg.eigvalsh(Shape.of(geometry, name="any").inertia)
    assert moments.min() > 0
    assert moments[2] <= (moments[0] + moments[1]) * (1 + 1e-12)


@given(geometries())
def test_the_sphere_of_equal_volume_has_the_least_surface(geometry):
    shape = Shape.of(geometry, name="any")
    sphere = math.pi * shape.diameter ** (shape.dimension - 1)
    assert shape.surface_area >= sphere * (1 - 1e-12)
    assert shape.bounding_radius >= shape.diameter / 2 * (1 - 1e-12)


@given(seeds, st.integers(1, 10), st.integers(0, 9))
def test_one_more_sphere_adds_volume_and_no_more_than_its_own(seed, count, copy):
    union = random_spheres(seed, count)
    generator = stream(seed, "one more")
    center, radius = generator.standard_normal(3), 0.2 + generator.random()
    more = Spheres(np.vstack([union.centers, center]), np.append(union.radii, radius))
    gain = more.volume - union.volume
    assert -1e-12 * union.volume <= gain <= 4 / 3 * math.pi * radius**3 * (1 + 1e-12)
    again = copy % count
    twice = Spheres(np.vstack([union.centers, union.centers[again]]), np.append(union.radii, union.radii[again]))
    assert twice.volume == pytest.approx(union.volume, rel=1e-13)


@given(seeds, st.integers(2, 9))
def test_the_derivative_of_the_volume_by_the_radii_is_the_surface(seed, count):
    union = random_spheres(seed, count)
    step = 1e-5
    grown = Spheres(union.centers, union.radii + step).volume - Spheres(union.centers, union.radii - step).volume
    assert grown / (2 * step) == pytest.approx(union.surface_area, rel=1e-6)


@given(seeds, st.integers(4, 40))
def test_points_of_a_tessellation_lie_on_the_boundary(seed, count):
    polygon = random_outline(seed, count)
    vertices, faces, _ = polygon.tessellation()
    assert polygon.contains(vertices[faces].mean(axis=1)).all()
    assert not polygon.contains(vertices[:, :2] * (1 + 1e-9)).any()


@given(seeds)
def test_a_turned_grain_is_as_clean_as_before(seed):
    shape = make_shape("convex_polyhedron", seed=seed)
    turned = shape.geometry.rotated(turn_of(seed, 3)).scaled(0.37).moved(np.array([5.0, -3.0, 2.0]))
    assert isinstance(turned, Mesh)
    assert diagnose(turned).ok


@given(
    st.floats(0.1, 10),
    st.floats(0.05, 1.0),
    st.sampled_from(["number", "volume"]),
    st.floats(0.01, 0.99),
    st.sampled_from([2, 3]),
)
def test_volume_lies_in_larger_grains_than_number(median, sigma, basis, share, dimension):
    law = sizes.lognormal(median, sigma, basis=basis)
    by_number = law.quantile(share, basis="number", dimension=dimension)
    by_volume = law.quantile(share, basis="volume", dimension=dimension)
    assert by_volume / by_number == pytest.approx(math.exp(dimension * sigma**2), rel=1e-12)
