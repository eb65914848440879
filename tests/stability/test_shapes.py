"""Shapes where numbers run out: tiny, huge, far away, nearly equal, many."""

import math

import numpy as np
import pytest

from voxgran._base.seeds import stream
from voxgran.shapes import sizes
from voxgran.shapes.family import make_shape
from voxgran.shapes.model import Shape
from voxgran.shapes.repairing.diagnose import diagnose, merged
from voxgran.shapes.spheres import Spheres


@pytest.mark.parametrize("factor", [1e-12, 1e-6, 1e6, 1e12])
def test_grains_of_any_size_are_read_and_measured(factor):
    grain = make_shape("solid_union", seed=1)
    scaled = Shape.from_mesh(grain.vertices * factor, grain.faces)
    assert len(scaled.faces) == len(grain.faces)
    assert scaled.volume == pytest.approx(grain.volume * factor**3, rel=1e-12)


@pytest.mark.parametrize("shift", [1e3, 1e6, 1e9])
def test_grains_far_away_keep_what_float64_leaves_them(shift):
    grain = make_shape("convex_polyhedron", seed=1)
    far = Shape.from_mesh(grain.vertices + np.array([shift, -shift, shift]), grain.faces)
    assert far.volume == pytest.approx(grain.volume, rel=20 * shift * 2.3e-16 + 1e-13)
    assert far.offset == pytest.approx((shift, -shift, shift), rel=1e-12)


def test_coordinates_of_files_in_single_precision_are_no_fault():
    for seed in range(6):
        grain = make_shape("solid_union", seed=seed)
        rounded = grain.vertices.astype(np.float32).astype(np.float64)
        corners, faces = merged(rounded, grain.faces)
        assert diagnose(corners, faces).ok


def test_two_hundred_spheres_in_all_states():
    generator = stream(0, "spheres")
    for spread, radius in [(0.01, 1.0), (0.3, 1.0), (1.0, 0.5), (3.0, 0.5), (30.0, 0.5)]:
        centers = spread * generator.standard_normal((200, 3))
        union = Spheres(centers, radius * (0.8 + 0.4 * generator.random(200)))
        spheres = 4 / 3 * math.pi * union.radii**3
        assert spheres.max() <= union.volume <= spheres.sum() * (1 + 1e-12)
        area = union.surface_area
        assert area >= (36 * math.pi * union.volume**2) ** (1 / 3) * (1 - 1e-12)
        # volume by the surface: growing all spheres by a little adds surface times that little
        step = 1e-6
        grown = Spheres(centers, union.radii + step).volume - union.volume
        assert grown == pytest.approx(area * step, rel=1e-3)


@pytest.mark.parametrize("distance", [1e-14, 1e-12, 1e-9, 1e-6, 1e-3])
def test_spheres_nearly_in_one_place(distance):
    generator = stream(1, "near")
    centers = distance * generator.standard_normal((10, 3))
    union = Spheres(centers, np.ones(10))
    sphere = 4 / 3 * math.pi
    # equal spheres: to first order the union is that of their shifts, the mean of the largest shift in each direction
    reach = np.linalg.norm(centers, axis=1).max()
    assert -1e-12 <= union.volume / sphere - 1 <= (1 + reach) ** 3 - 1 + 1e-12
    directions = generator.standard_normal((40000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    grown = 4 * math.pi * (directions @ centers.T).max(axis=1).mean()
    assert union.volume - sphere == pytest.approx(grown, rel=0.05, abs=2e-12)


@pytest.mark.parametrize("gap", [-1e-6, -1e-10, -1e-15, 0.0, 1e-15, 1e-10])
def test_spheres_that_nearly_touch(gap):
    union = Spheres(np.array([[0, 0, 0], [2 + gap, 0, 0]]), np.ones(2))
    lens = math.pi / 2 * gap**2 * (1 + gap / 6) if gap < 0 else 0.0
    assert union.volume == pytest.approx(8 / 3 * math.pi - lens, rel=1e-14)


def test_a_grain_of_dust_on_a_boulder():
    union = Spheres(np.array([[0, 0, 0], [1.0, 0, 0]]), np.array([1.0, 1e-6]))
    half = 2 / 3 * math.pi * 1e-18
    alone = Spheres(np.zeros((1, 3)), np.ones(1)).volume
    assert abs(union.volume - alone - half) < 1e-15
    area = union.surface_area - 4 * math.pi
    assert area == pytest.approx(2 * math.pi * 1e-12 - math.pi * 1e-12, abs=1e-14)


@pytest.mark.parametrize("sigma", [1e-9, 1e-3, 2.0])
def test_narrow_and_wide_gradations(sigma):
    law = sizes.lognormal(3.0, sigma, basis="volume")
    drawn = law.sample(1000, stream(0, "narrow"))
    assert np.isfinite(drawn).all()
    assert drawn.min() > 0
    assert law.cumulative(law.quantile(0.25)) == pytest.approx(0.25, abs=1e-7)
