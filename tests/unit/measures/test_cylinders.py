"""Spheres in an upright cylinder, against quadrature of another kind and closed formulas."""

import math

import numpy as np
import pytest

from voxgran._base.seeds import stream
from voxgran.measures.region import cut_spheres_by_cylinder


def polar(center, radius, cylinder, ends):
    """Return the volume by midpoints over the floor of the cylinder in polar coordinates, to about 1e-3."""
    n, m = 400, 400
    rho = (np.arange(n) + 0.5) / n * cylinder
    phi = (np.arange(m) + 0.5) / m * 2 * math.pi
    r, p = np.meshgrid(rho, phi)
    apart = (r * np.cos(p) - center[0]) ** 2 + (r * np.sin(p) - center[1]) ** 2
    half = np.sqrt(np.maximum(0.0, radius**2 - apart))
    length = np.minimum(center[2] + half, ends[1]) - np.maximum(center[2] - half, ends[0])
    inside = np.where(apart < radius**2, np.maximum(length, 0.0), 0.0)
    return float((inside * r).sum() * cylinder / n * 2 * math.pi / m)


def test_random_spheres():
    generator = stream(0, "cylinders")
    centers, radii = generator.uniform(-1.5, 1.5, (40, 3)), generator.uniform(0.2, 1.6, 40)
    volumes, errors = cut_spheres_by_cylinder(centers, radii, radius=1.2, lower=-0.6, upper=0.8)
    assert (errors <= 1e-8 * radii**3).all()
    for center, radius, found in zip(centers, radii, volumes, strict=True):
        assert found == pytest.approx(polar(center, radius, 1.2, (-0.6, 0.8)), abs=3e-4)


def test_on_the_axis():
    # the sphere with a hole is the napkin ring: its volume is that of a sphere of its height
    radii = np.array([1.0, 2.0])
    volumes, errors = cut_spheres_by_cylinder(np.zeros((2, 3)), radii, radius=0.8, lower=-9.0, upper=9.0)
    ring = np.array([math.pi / 6 * (2 * math.sqrt(r * r - 0.64)) ** 3 for r in radii])
    assert volumes == pytest.approx(4 / 3 * math.pi * radii**3 - ring, rel=1e-12)
    assert errors.max() < 1e-12


def test_inside_and_outside():
    centers = np.array([[0.0, 0.0, 0.0], [0.0, 0.7, 0.0], [3.0, 0.0, 0.0], [0.0, 0.0, 5.0]])
    volumes, errors = cut_spheres_by_cylinder(centers, np.full(4, 0.3), radius=1.0, lower=-1.0, upper=1.0)
    assert volumes == pytest.approx([0.036 * math.pi, 0.036 * math.pi, 0, 0], abs=1e-15)
    assert errors.tolist() == [0, 0, 0, 0]
    halved, _ = cut_spheres_by_cylinder(centers[:1], np.full(1, 0.3), radius=1.0, lower=0.0, upper=1.0)
    assert halved == pytest.approx(0.018 * math.pi, rel=1e-14)


def test_a_wide_cylinder_is_a_plane():
    wide = 1e5
    center = np.array([[wide + 0.2, 0.0, 0.0]])
    volume, _ = cut_spheres_by_cylinder(center, np.ones(1), radius=wide, lower=-2.0, upper=2.0)
    cap = math.pi * 0.8**2 * (3 - 0.8) / 3
    assert volume[0] == pytest.approx(cap, rel=1e-4)
