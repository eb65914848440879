"""Superquadrics, spherocylinders, tori, hollow cylinders and tablets against their closed formulas."""

import math

import numpy as np
import pytest
from scipy.spatial import ConvexHull

import voxgran as vg
from voxgran.contacts.inside import inner_distance
from voxgran.shapes.describing.extents import principal_extents
from voxgran.shapes.describing.ratios import principal_lengths
from voxgran.shapes.families.regular.superquadric import volume_of
from voxgran.shapes.repairing.diagnose import diagnose, refuse_dirty

AXES = (1.0, 2.0, 0.4)
EXPONENTS = [(1, 1), (0.5, 0.5), (0.02, 0.02), (0.1, 1), (1, 0.1), (2, 2), (0.1, 2), (2, 0.1), (3, 1), (1, 3), (4, 4)]


def _crowded(share, e):
    """Return angles whose points have coordinates in equal steps near the axes."""
    with np.errstate(over="ignore"):
        return np.arctan(np.tan(share * np.pi / 2) ** (1 / e))


def on_superquadric(e1, e2, count):
    """Return points on a superquadric by the two angles of Barr, crowded where the surface bends."""
    u, v = (share.ravel() for share in np.meshgrid(np.linspace(0, 1, count), np.linspace(0, 1, count)))
    powers = []
    for share, e in ((u, e1), (v, e2)):
        # half of the points in equal steps of the angle, half in steps of the coordinate
        angle = np.where(np.arange(len(share)) % 2, share * np.pi / 2, _crowded(share, e))
        powers.append((np.cos(angle) ** e, np.sin(angle) ** e))
    (c1, s1), (c2, s2) = powers
    return np.column_stack([c1 * c2, c1 * s2, s1]) * AXES


def test_volume_of_superquadrics():
    one = np.ones(3)
    assert volume_of(1, 1, one) == pytest.approx(4 / 3 * math.pi)
    assert volume_of(2, 2, one) == pytest.approx(4 / 3)  # octahedron
    assert volume_of(2, 1, one) == pytest.approx(2 / 3 * math.pi)  # double cone
    assert volume_of(1e-6, 1, one) == pytest.approx(2 * math.pi, rel=1e-5)  # cylinder
    assert volume_of(1e-6, 1e-6, one) == pytest.approx(8, rel=1e-5)  # box
    assert volume_of(0.7, 1.6, np.array(AXES)) == pytest.approx(0.8 * volume_of(0.7, 1.6, one))
    # by counting points of a fine lattice in the first octant
    x = (np.arange(200) + 0.5) / 200
    flat = (x[:, None] ** (2 / 1.6) + x ** (2 / 1.6)) ** (1.6 / 0.7)
    inside = (flat[:, :, None] + x ** (2 / 0.7) <= 1).mean()
    assert volume_of(0.7, 1.6, one) == pytest.approx(8 * inside, rel=2e-3)


@pytest.mark.parametrize(("e1", "e2"), EXPONENTS)
def test_superquadric_meshes_are_within_the_tolerance(e1, e2):
    true = volume_of(e1, e2, np.array(AXES))
    misses = []
    for tolerance in (0.02, 0.005):
        shape = vg.make_shape("superquadric", e1=e1, e2=e2, semi_axes=AXES, tolerance=tolerance)
        refuse_dirty(shape.vertices, shape.faces, str((e1, e2)))
        x, y, z = np.where(np.abs(shape.vertices) < 1e-12, 0.0, np.abs(shape.vertices / AXES)).T
        gauge = ((x ** (2 / e2) + y ** (2 / e2)) ** (e2 / e1) + z ** (2 / e1)) ** (e1 / 2)
        assert gauge == pytest.approx(1, abs=1e-13)
        size = (6 / math.pi * true) ** (1 / 3)
        away = np.abs(shape.signed_distance(on_superquadric(e1, e2, 30)))
        assert away.max() < tolerance * size
        if max(e1, e2) <= 2:
            assert ConvexHull(shape.vertices).volume == pytest.approx(shape.volume, rel=1e-12)
            assert shape.volume < true * (1 + 1e-14)
        misses.append(abs(shape.volume / true - 1))
        assert misses[-1] < tolerance * size * shape.surface_area / true
    assert (e1, e2) in ((2, 2), (0.02, 0.02)) or misses[1] < 0.6 * misses[0]


def test_superquadrics_between_known_solids():
    round_one = vg.make_shape("superquadric", e1=1, e2=1, diameter=2)
    assert np.linalg.norm(round_one.vertices, axis=1) == pytest.approx(1, rel=2e-3)
    box = vg.make_shape("superquadric", e1=0.02, e2=0.02, semi_axes=(1, 2, 3), tolerance=1e-3)
    assert box.volume == pytest.approx(48, rel=5e-3)
    octahedron = vg.make_shape("superquadric", e1=2, e2=2, semi_axes=(1, 2, 3))
    assert octahedron.volume == pytest.approx(8, rel=1e-14)
    assert np.ptp(vg.make_shape("superquadric", aspect=(1, 2, 3)).vertices, axis=0) @ [6, -3, 0] == pytest.approx(0)


@pytest.mark.parametrize(("radius", "height"), [(0.5, 3.0), (1.0, 2.01), (0.1, 9.0)])
def test_spherocylinders_have_closed_formulas(radius, height):
    shape = vg.make_shape("spherocylinder", radius=radius, height=height).rotated((0.5, 0.5, 0.5, 0.5))
    length, axis = height - 2 * radius, shape.geometry.matrix[:, 2]
    assert shape.volume == pytest.approx(math.pi * radius**2 * length + 4 / 3 * math.pi * radius**3, rel=1e-14)
    assert shape.surface_area == pytest.approx(2 * math.pi * radius * height, rel=1e-14)
    assert shape.bounding_radius == pytest.approx(height / 2)
    assert principal_extents(shape) == pytest.approx([height, 2 * radius, 2 * radius])
    assert principal_lengths(shape) == pytest.approx([height, 2 * radius, 2 * radius])
    # second moments of the disks of which it is a stack
    t, weight = np.polynomial.legendre.leggauss(20)
    cap = length / 2 + radius * (t + 1) / 2, radius * weight
    barrel = t * length / 2, length / 2 * weight
    z, weight = (np.concatenate(parts) for parts in zip(cap, barrel, strict=True))
    area = math.pi * (radius**2 - np.maximum(z - length / 2, 0) ** 2)
    along, across = (weight * area * z**2).sum(), (weight * area**2 / (4 * math.pi)).sum()
    moments = np.diag([along + across] * 3) + (across - along) * np.outer(axis, axis)
    assert shape.inertia == pytest.approx(moments, rel=1e-12, abs=1e-14)
    # the tessellation is inscribed and as far away as it says
    assert np.abs(inner_distance(shape.geometry)(shape.vertices)).max() < 1e-14
    middles = inner_distance(shape.geometry)(shape.vertices[shape.faces].mean(axis=1))
    assert 0 < middles.max() < shape.tessellation_error < 0.003 * radius
    assert ConvexHull(shape.vertices).volume == pytest.approx(shape.geometry.volume, rel=4e-3)
    refuse_dirty(shape.vertices, shape.faces, "spherocylinder")


def test_spherocylinders_of_a_ratio():
    shape = vg.make_shape("spherocylinder", aspect=4)
    assert shape.diameter == pytest.approx(1, rel=1e-15)
    assert np.ptp(shape.vertices, axis=0)[2] / np.ptp(shape.vertices, axis=0)[0] == pytest.approx(4)
    for round_one in (vg.make_shape("spherocylinder", aspect=1), vg.make_shape("spherocylinder", radius=0.5, height=1)):
        assert round_one.is_sphere
        assert round_one.bounding_radius == pytest.approx(0.5)


@pytest.mark.parametrize(("major", "minor"), [(1.0, 0.4), (2.0, 0.1), (1.0, 0.99)])
def test_tori(major, minor):
    volume, area = 2 * math.pi**2 * major * minor**2, 4 * math.pi**2 * major * minor
    misses = []
    for tolerance in (0.01, 0.0025):
        shape = vg.make_shape("torus", major_radius=major, minor_radius=minor, tolerance=tolerance)
        x, y, z = shape.vertices.T
        assert np.hypot(np.hypot(x, y) - major, z) == pytest.approx(minor, rel=1e-13)
        x, y, z = shape.vertices[shape.faces].mean(axis=1).T
        inside = np.hypot(np.hypot(x, y) - major, z)
        assert np.abs(inside - minor).max() < tolerance * shape.diameter
        # a ring of n sides whose section is a polygon of m sides, exactly
        m = np.count_nonzero(np.abs(np.arctan2(shape.vertices[:, 1], shape.vertices[:, 0])) < 1e-12)
        n = len(shape.vertices) // m
        section = m / 2 * minor**2 * math.sin(2 * math.pi / m)
        assert shape.volume == pytest.approx(n * math.sin(2 * math.pi / n) * major * section, rel=1e-12)
        misses.append([1 - shape.volume / volume, 1 - shape.surface_area / area])
    assert (np.array(misses) > 0).all()
    assert (np.array(misses[1]) < 0.4 * np.array(misses[0])).all()
    # one closed surface with one hole
    edges = len(shape.faces) * 3 // 2
    assert len(shape.vertices) - edges + len(shape.faces) == 0
    assert diagnose(shape).ok
    assert not shape.contains([[0.0, 0.0, 0.0]])[0]
    assert shape.contains([[major, 0.0, 0.0]])[0]


def hollow(radius, height, hole, holes):
    """Return the area, volume and moments about x, y and z of a cylinder with holes, in closed form."""
    sine = math.sin(math.pi / holes)
    away = 0.0 if holes == 1 else (radius + hole) / (1 + 2 * sine)
    full, one = math.pi * radius**2 * height, math.pi * hole**2 * height
    x, y = (away * f(2 * np.pi * np.arange(holes) / holes) for f in (np.cos, np.sin))
    solid = np.array([(3 * radius**2 + height**2) / 12] * 2 + [radius**2 / 2]) * full
    lost = np.array([(3 * hole**2 + height**2) / 12] * 2 + [hole**2 / 2]) * one * holes
    lost += one * np.array([(y**2).sum(), (x**2).sum(), holes * away**2])
    area = 2 * math.pi * (height * (radius + holes * hole) + radius**2 - holes * hole**2)
    return np.array([area, full - holes * one, *(solid - lost)])


@pytest.mark.parametrize(("holes", "hole"), [(1, 0.4), (1, 1.9), (2, 0.5), (4, 0.7), (7, 0.3), (19, 0.1)])
def test_hollow_cylinders(holes, hole):
    family, more = ("ring", {}) if holes == 1 else ("hollow_cylinder", {"holes": holes})
    true, misses = hollow(2.0, 3.0, hole, holes), []
    for tolerance in (0.01, 0.0025):
        shape = vg.make_shape(family, radius=2.0, height=3.0, hole_radius=hole, tolerance=tolerance, **more)
        refuse_dirty(shape.vertices, shape.faces, family)
        found = np.array([shape.surface_area, shape.volume, *np.diag(shape.inertia)])
        misses.append(np.abs(found / true - 1).max())
        x, y, z = shape.vertices.T
        assert np.abs(z) == pytest.approx(1.5)
        outer = np.hypot(x, y) > 2.0 - 1e-9
        assert np.hypot(x[outer], y[outer]) == pytest.approx(2.0, rel=1e-13)
        assert shape.centroid == pytest.approx(0, abs=1e-12)
        assert shape.inertia == pytest.approx(np.diag(np.diag(shape.inertia)), abs=1e-2)
        # a closed surface with as many holes
        assert len(shape.vertices) - len(shape.faces) // 2 == 2 - 2 * holes
    assert misses[0] < 0.06
    assert misses[1] < 0.6 * misses[0]


@pytest.mark.parametrize("holes", [1, 2, 3, 5, 30])
def test_walls_of_hollow_cylinders_have_equal_widths(holes):
    shape = vg.make_shape("hollow_cylinder", holes=holes, diameter=1.0)
    x, y = np.unique(shape.vertices[:, :2].round(12), axis=0).T
    outer = np.hypot(x, y)
    radius = outer.max()
    inner = outer < radius * (1 - 1e-9)
    angle = np.round(np.arctan2(y[inner], x[inner]) * holes / (2 * np.pi)).astype(int) % holes
    if holes == 1:
        assert outer[inner] == pytest.approx(0.6 * radius)
        return
    centers = [np.array([x[inner][angle == k].mean(), y[inner][angle == k].mean()]) for k in range(holes)]
    hole = np.hypot(*(np.array([x[inner][0], y[inner][0]]) - centers[angle[0]]))
    between = np.linalg.norm(centers[1] - centers[0]) - 2 * hole
    assert between == pytest.approx(radius - np.linalg.norm(centers[0]) - hole, rel=1e-6)
    assert shape.volume == pytest.approx(math.pi / 6)


@pytest.mark.parametrize(("height", "cap"), [(3.0, 0.5), (4.0, 2.0), (1.0, 0.5), (5.0, 0.01), (6.0, 2.0)])
def test_tablets(height, cap):
    radius, curvature = 2.0, (4.0 + cap**2) / (2 * cap)
    area = 2 * math.pi * (radius * (height - 2 * cap) + radius**2 + cap**2)
    volume = math.pi * (radius**2 * (height - 2 * cap) + cap * (3 * radius**2 + cap**2) / 3)
    # second moments of the disks of which it is a stack
    t, weight = np.polynomial.legendre.leggauss(20)
    high, low = height / 2 - cap, cap / 2
    z, weight = np.concatenate([high + low * (t + 1), high * (t + 1) / 2]), np.outer([low, high / 2], weight).ravel()
    disk = math.pi * (curvature**2 - (np.maximum(z, high) - height / 2 + curvature) ** 2)
    along, across = 2 * (weight * disk * z**2).sum(), 2 * (weight * disk**2 / (4 * math.pi)).sum()
    assert 2 * (weight * disk).sum() == pytest.approx(volume)
    true, misses = np.array([area, volume, along + across, along + across, 2 * across]), []
    for tolerance in (0.01, 0.0025):
        shape = vg.make_shape("tablet", radius=radius, height=height, cap_height=cap, tolerance=tolerance)
        refuse_dirty(shape.vertices, shape.faces, "tablet")
        found = np.array([shape.surface_area, shape.volume, *np.diag(shape.inertia)])
        assert (found < true * (1 + 1e-9)).all()
        assert ConvexHull(shape.vertices).volume == pytest.approx(shape.volume, rel=1e-12)
        across_axis, up = np.hypot(*shape.vertices.T[:2]), np.abs(shape.vertices[:, 2])
        on_cap = np.hypot(across_axis, up - height / 2 + curvature) - curvature
        assert np.minimum(np.abs(on_cap), np.abs(across_axis - radius)).max() < 1e-12
        misses.append(np.abs(found / true - 1).max())
    assert misses[0] < 0.06
    assert misses[1] < 0.4 * misses[0]
