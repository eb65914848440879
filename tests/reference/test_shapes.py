"""Published and exact values of shapes, with their sources."""

import itertools
import math

import numpy as np
import pytest

from voxgran._base.errors import DirtyMeshError
from voxgran._base.seeds import stream
from voxgran.shapes.family import make_shape
from voxgran.shapes.files import load_shape
from voxgran.shapes.model import Shape
from voxgran.shapes.sizes import lognormal
from voxgran.shapes.spheres import Spheres


def test_two_spheres_have_the_lens_of_mathworld():
    # Weisstein, Sphere-Sphere Intersection, mathworld.wolfram.com, eq. 15 and 16
    for large, small, d in [(1.0, 1.0, 1.0), (1.0, 0.5, 0.8), (2.0, 1.0, 2.9), (1.0, 0.3, 0.71)]:
        lens = math.pi * (large + small - d) ** 2 / (12 * d)
        lens *= d * d + 2 * d * (small + large) - 3 * (small**2 + large**2) + 6 * small * large
        union = Spheres(np.array([[0, 0, 0], [0, d, 0]]), np.array([large, small]))
        assert union.volume == pytest.approx(4 / 3 * math.pi * (large**3 + small**3) - lens, rel=1e-13)
    equal = Spheres(np.array([[0.0, 0, 0], [1, 0, 0]]), np.ones(2))
    assert 8 / 3 * math.pi - equal.volume == pytest.approx(5 * math.pi / 12, rel=1e-13)


def test_three_spheres_by_inclusion_and_exclusion():
    # the common part of three unit spheres whose centers form an equilateral triangle of side 1:
    # slices parallel to the plane of the centers are Reuleaux-like triangles of three disks
    nodes, weights = np.polynomial.legendre.leggauss(60)
    top = math.sqrt(1 - 1 / 3)
    z = top / 2 * (1 + np.sin(math.pi / 2 * nodes))
    h = weights * top / 2 * math.pi / 2 * np.cos(math.pi / 2 * nodes)
    r = np.sqrt(1 - z * z)
    inner = -0.5 / math.sqrt(3) + np.sqrt(r * r - 0.25)  # from the middle to a corner
    chord = math.sqrt(3) * inner
    area = math.sqrt(3) / 4 * chord**2 + 3 * (
        r * r * np.arcsin(chord / (2 * r)) - chord / 2 * np.sqrt(r * r - chord**2 / 4)
    )
    common = 2 * (h * area).sum()
    centers = np.array([[0, 0, 0], [1, 0, 0], [0.5, math.sqrt(3) / 2, 0]])
    union = Spheres(centers, np.ones(3)).volume
    assert union == pytest.approx(4 * math.pi - 3 * 5 * math.pi / 12 + common, rel=1e-12)


def test_touching_spheres_on_an_fcc_lattice():
    points = np.array([p for p in itertools.product(range(4), repeat=3) if sum(p) % 2 == 0], dtype=float)
    radius = math.sqrt(0.5)
    cluster = Spheres(points, np.full(len(points), radius))
    assert cluster.volume == pytest.approx(len(points) * 4 / 3 * math.pi * radius**3, rel=1e-14)
    # four spheres per cube of edge 2: pi / sqrt(18) of space (Kepler)
    assert 4 * cluster.volume / len(points) / 8 == pytest.approx(math.pi / math.sqrt(18), rel=1e-14)


def test_spheres_that_cover_a_lattice():
    # spheres of radius sqrt(3) / 2 on the unit lattice cover space: in the bulk each fills a cube and has no surface
    def union(n):
        points = np.array(list(itertools.product(range(n), repeat=3)), dtype=float)
        return Spheres(points, np.full(n**3, math.sqrt(3) / 2))

    sizes = [union(n) for n in (2, 3, 4, 5)]
    # the third difference of the volume is that of n cubes' 6, the third difference of the surface is 0
    assert np.diff([s.volume for s in sizes], 3) == pytest.approx([6.0], rel=1e-11)
    assert np.diff([s.surface_area for s in sizes], 3) == pytest.approx([0.0], abs=1e-10)


@pytest.mark.parametrize(
    ("name", "volume", "faces"),
    [("eros.obj", 0.291331, 14744), ("itokawa_lp.obj", 0.411427, 1622), ("bennu_lp.obj", 1.407590, 1474)],
)
def test_scans_have_the_numbers_of_their_source_page(name, volume, faces, data_dir):
    shape = load_shape(data_dir / name)
    assert shape.volume == pytest.approx(volume, abs=5e-7)
    assert len(shape.faces) == faces
    assert len(shape.vertices) == faces // 2 + 2  # Euler number 2


@pytest.mark.parametrize(("aspect", "area"), [((1, 1, 1), 1.0), ((2, 1, 1), 1.0768), ((1, 1, 0.5), 1.0953)])
def test_surface_of_spheroids(aspect, area):
    # in units of the surface of the sphere of equal volume: elementary formulas with the excentricity
    a, _, c = sorted(aspect, reverse=True)
    if aspect[0] > aspect[1]:
        e = math.sqrt(1 - (c / a) ** 2)
        exact = 2 * math.pi * c * c * (1 + a / c / e * math.asin(e))
    elif a > c:
        e = math.sqrt(1 - (c / a) ** 2)
        exact = 2 * math.pi * a * a * (1 + (1 - e * e) / e * math.atanh(e))
    else:
        exact = 4 * math.pi
    ratio = exact / (4 * math.pi * (aspect[0] * aspect[1] * aspect[2]) ** (2 / 3))
    shape = make_shape("ellipsoid", aspect=aspect)
    assert shape.surface_area / math.pi == pytest.approx(ratio, rel=1e-12)
    assert ratio == pytest.approx(area, abs=5e-4)


def test_hatch_and_choate():
    # Hatch & Choate 1929: ln of the median by volume = ln of the median by number + 3 ln(sigma_g)**2
    law = lognormal(10.0, math.log(1.8))
    assert law.quantile(0.5, basis="volume") == pytest.approx(10 * math.exp(3 * math.log(1.8) ** 2), rel=1e-14)
    assert law.quantile(0.8413447460685429) == pytest.approx(18.0, rel=1e-14)


def test_a_soup_of_triangles_is_no_grain():
    triangles = np.arange(9).reshape(3, 3)
    with pytest.raises(DirtyMeshError, match="9 open edges"):
        Shape.from_mesh(stream(1, "soup").random((9, 3)), triangles)
