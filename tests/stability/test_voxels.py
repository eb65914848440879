"""Voxels at the ends of the scale: one voxel, tiny and huge lengths, lattices far away."""

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.seeds import stream
from voxgran.geometry.rotation import random_rotations
from voxgran.lattice.grid import Grid
from voxgran.voxels.occupy import BACKENDS, occupy, voxelize

TURN = random_rotations(stream(11, "turn"), 1)[0]


@pytest.fixture(scope="module")
def scan(data_dir):
    shape = vg.load_shape(data_dir / "bennu_lp.obj")
    return shape.scaled(1 / shape.diameter)


@pytest.mark.parametrize("cover", ["center", "touch"])
@pytest.mark.parametrize("family", ["scan", "sphere", "cylinder", "solid_union"])
def test_a_power_of_two_gives_the_same_bits(scan, family, cover):
    shape = scan if family == "scan" else vg.make_shape(family)
    grid = Grid((-1.1, -1.2, -1.3), 0.13, (18, 19, 20))
    mask = occupy(shape, grid, rotation=TURN, cover=cover)
    for factor in (2.0**-40, 2.0**40):
        x, y, z = (value * factor for value in grid.origin)
        scaled = Grid((x, y, z), grid.voxel_size * factor, grid.shape)
        assert np.array_equal(occupy(shape.scaled(factor), scaled, rotation=TURN, cover=cover), mask)
        assert np.array_equal(occupy(shape, scaled, scale=factor, rotation=TURN, cover=cover), mask)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("factor", [1e-12, 1e-6, 1e6, 1e12])
def test_any_unit_gives_the_same_voxels(scan, backend, factor):
    small = voxelize(scan, voxel_size=0.11, backend=backend)
    voxels = voxelize(scan.scaled(factor), voxel_size=0.11 * factor, backend=backend)
    assert np.array_equal(voxels.mask, small.mask)
    assert voxels.volume == pytest.approx(small.volume * factor**3)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("cover", ["center", "touch"])
def test_one_voxel(scan, backend, cover):
    inside = Grid((-0.05, -0.05, -0.05), 0.1, (1, 1, 1))
    outside = Grid((5.0, 0.0, 0.0), 0.1, (1, 1, 1))
    around = Grid((-4.0, -4.0, -4.0), 8.0, (1, 1, 1))
    off = Grid((0.0, 0.0, 0.0), 80.0, (1, 1, 1))
    assert occupy(scan, inside, backend=backend, cover=cover).all()
    assert not occupy(scan, outside, backend=backend, cover=cover).any()
    assert occupy(scan, around, backend=backend, cover=cover).all()
    assert occupy(scan, off, backend=backend, cover=cover).all() == (cover == "touch")


def test_a_solid_smaller_than_a_voxel_touches_all_voxels_at_its_corner():
    for shape in (vg.make_shape("sphere"), vg.make_shape("box"), vg.make_shape("cone")):
        voxels = voxelize(shape, voxel_size=10.0, cover="touch")
        assert voxels.mask.sum() == 8
        assert not voxelize(shape, voxel_size=10.0).mask.any()


@pytest.mark.parametrize("backend", BACKENDS)
def test_far_away_the_voxels_are_the_same(scan, backend):
    # offsets and corners that are exact in binary: what is left is the round-off of the body
    grid = Grid((-1.0, -1.0, -1.0), 0.125, (16, 16, 16))
    near = occupy(scan, grid, rotation=TURN, backend=backend)
    place = np.array([2.0**20, -(2.0**21), 2.0**19])
    x, y, z = (float(value) for value in place - 1.0)
    far = Grid((x, y, z), 0.125, grid.shape)
    assert np.array_equal(occupy(scan, far, rotation=TURN, offset=place, backend=backend), near)
    touch = occupy(scan, far, rotation=TURN, offset=place, backend=backend, cover="touch")
    assert np.array_equal(touch, occupy(scan, grid, rotation=TURN, cover="touch"))


def test_a_body_far_larger_than_the_lattice_fills_it(scan):
    grid = Grid((-0.5, -0.5, -0.5), 0.1, (10, 10, 10))
    for backend in BACKENDS:
        assert occupy(scan, grid, scale=1e6, backend=backend).all()
    assert not occupy(scan, grid, scale=1e6, cover="surface").any()
    assert occupy(scan, grid, scale=1e6, cover="touch").all()
