"""Diffusion through pores: slabs, channels, lattices of spheres, a plain SciPy twin, and what is not connected."""

import math
import tracemalloc

import numpy as np
import pytest
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve

import voxgran as vg
from benchmarks.images.transport import by_poles
from voxgran._base.errors import InputError, PackingWarning
from voxgran._base.seeds import stream
from voxgran.lattice.diffusion import thin_share
from voxgran.measures.model import measure
from voxgran.measures.registered.transport import transport


def cubic_lattice(fraction, voxels, shift=0.0):
    """Return the pores of a period of spheres on a simple cubic lattice of a solid fraction."""
    x = (np.arange(voxels) + 0.5) / voxels - 0.5 + shift / voxels
    return x[:, None, None] ** 2 + x[:, None] ** 2 + x**2 > (3 * fraction / (4 * np.pi)) ** (2 / 3)


def by_scipy(pores, axis, edges, periodic):
    """Return the relative diffusivity by a direct solver, each voxel a cell."""
    number, count = -np.ones(pores.shape, int), int(pores.sum())
    number[pores] = np.arange(count)
    rows, columns, weights, right = [], [], [], np.zeros(count)
    volume = np.prod(edges)
    diagonal = np.zeros(count)
    for k in range(3):
        g = volume / edges[k] ** 2
        one, other = np.moveaxis(number, k, 0), np.roll(np.moveaxis(number, k, 0), -1, axis=0)
        if not (periodic[k] and k != axis):
            one, other = one[:-1], other[:-1]
        both = (one >= 0) & (other >= 0)
        one, other = one[both], other[both]
        rows += [one, other]
        columns += [other, one]
        weights.append(np.full(2 * len(one), -g))
        np.add.at(diagonal, np.concatenate([one, other]), g)
    g = 2 * volume / edges[axis] ** 2
    ends = [np.moveaxis(number, axis, 0)[end] for end in (0, -1)]
    ends = [end[end >= 0] for end in ends]
    diagonal[ends[0]] += g
    diagonal[ends[1]] += g
    right[ends[0]] = g
    rows, columns = np.concatenate([*rows, np.arange(count)]), np.concatenate([*columns, np.arange(count)])
    matrix = coo_array((np.concatenate([*weights, diagonal]), (rows, columns))).tocsr()
    flow = (g * (1 - spsolve(matrix, right)[ends[0]])).sum()
    n = pores.shape[axis]
    return flow * (n * edges[axis]) / (volume / edges[axis] * pores[..., 0].size * pores.shape[2] / n)


def test_a_slab_and_channels():
    slab = np.zeros((17, 20, 13), bool)
    slab[:, 3:12] = True
    found = vg.effective_diffusivity(slab, voxel_size=(1, 2, 3))
    assert found.relative == pytest.approx([9 / 20, 0, 9 / 20], rel=1e-6)
    assert found.effective_porosity == pytest.approx([9 / 20, 0, 9 / 20])
    assert found.tortuosity_factor.tolist() == pytest.approx([1, math.inf, 1])
    channels = np.zeros((9, 16, 16), bool)
    for corner in ((1, 2), (7, 3), (10, 11)):
        channels[:, corner[0] : corner[0] + 3, corner[1] : corner[1] + 2] = True
    # a dead end beside them and a closed pore
    channels[:4, 14, 14] = channels[4, 0, 9] = True
    for block in (1, 2, 3, 4):
        found = vg.effective_diffusivity(channels, block=block, periodic="yz")
        assert found.relative == pytest.approx([18 / 256, 0, 0], rel=1e-6)
        assert found.effective_porosity[0] == 18 / 256
        assert found.porosity == channels.mean()


def test_the_flow_is_that_of_a_direct_solver():
    pores = np.random.default_rng(0).random((7, 6, 5)) < 0.7
    edges = (1.0, 0.7, 1.9)
    for axis in range(3):
        for periodic in ((False,) * 3, (True,) * 3):
            sides = [around and k != axis for k, around in enumerate(periodic)]
            labels, _ = vg.connected_components(pores, periodic=sides)
            low, high = (np.moveaxis(labels, axis, 0)[end] for end in (0, -1))
            through = np.isin(labels, np.intersect1d(low, high)[1:]) & pores
            expected = by_scipy(through, axis, edges, periodic)
            found = vg.effective_diffusivity(pores, voxel_size=edges, periodic=list(periodic), block=1)
            assert found.relative[axis] == pytest.approx(expected, rel=1e-4)


@pytest.mark.filterwarnings("ignore::voxgran._base.errors.PackingWarning")
def test_spheres_on_a_cubic_lattice():
    # 1 % at 32 voxels, with errors that fall at least linearly over several positions of the lattice
    for fraction in (0.1, 0.2, 0.3, 0.4):
        errors = []
        for voxels in (8, 16, 32):
            found = [
                vg.effective_diffusivity(cubic_lattice(fraction, voxels, shift), periodic="xyz", block=2).relative[0]
                for shift in (0.0, 0.21, 0.5, 0.74)
            ]
            errors.append(np.sqrt(np.mean((np.array(found) / by_poles(fraction) - 1) ** 2)))
        assert errors[-1] < 0.01
        assert errors[-1] < errors[0] / 3
    stepped = vg.effective_diffusivity(cubic_lattice(0.4, 32), periodic="xyz", block=1).relative
    assert by_poles(0.4) / stepped == pytest.approx([1.03] * 3, abs=0.01)


def test_cells_are_single_voxels_where_walls_are_thin():
    # walls between chambers of 7 voxels, each with a hole: as in a foam
    pores = np.ones((32, 32, 32), bool)
    for axis in range(3):
        np.moveaxis(pores, axis, 0)[::8] = False
    for axis in range(3):
        np.moveaxis(pores, axis, 0)[::8, 4::8, 4::8] = True
    with pytest.warns(PackingWarning, match="100 % of the solid is one voxel thick.*block is 1"):
        found = vg.effective_diffusivity(pores, periodic="xyz")
    assert found.block == 1
    exact = vg.effective_diffusivity(pores, periodic="xyz", block=1)
    assert np.array_equal(found.relative, exact.relative)
    with pytest.warns(PackingWarning, match="block is 2, not 1"):
        coarse = vg.effective_diffusivity(pores, periodic="xyz", block=2)
    assert found.error == pytest.approx(np.abs(coarse.relative - exact.relative))


@pytest.mark.filterwarnings("ignore::voxgran._base.errors.PackingWarning")
@pytest.mark.parametrize("fraction", [0.1, 0.3, 0.4])
def test_the_error_that_is_estimated_is_about_the_true_one(fraction):
    share = []
    for voxels in (10, 16, 24):
        for shift in (0.0, 0.21, 0.5, 0.74):
            found = vg.effective_diffusivity(cubic_lattice(fraction, voxels, shift), periodic="xyz", block=2)
            share.append(abs(found.relative[0] - by_poles(fraction)) < 2 * found.error[0] + 3e-3)
    assert np.mean(share) > 0.8


@pytest.mark.parametrize("periodic", [(False, False, False), (True, False, True)])
def test_thin_walls_are_those_that_an_opening_by_cubes_takes_away(periodic):
    solid = ndimage.gaussian_filter(np.random.default_rng(3).normal(size=(14, 15, 16)), 1.0) > 0.1
    wide = solid
    for axis, around in enumerate(periodic):
        wide = np.pad(wide, [(4 * (k == axis),) * 2 for k in range(3)], mode="wrap" if around else "edge")
    opened = ndimage.binary_opening(wide, np.ones((2, 2, 2)))[4:-4, 4:-4, 4:-4]
    assert thin_share(solid, periodic) == pytest.approx(1 - opened.sum() / solid.sum())
    assert thin_share(np.zeros((3, 3, 3), bool), periodic) == 0.0
    # a picture of one layer goes on beyond it
    assert thin_share(np.ones((4, 4, 1), bool), periodic) == 0.0


@pytest.mark.filterwarnings("ignore::voxgran._base.errors.PackingWarning")
def test_a_periodic_image_may_begin_anywhere():
    # moved by whole cells, so that what is near a face lies across the border
    pores = np.random.default_rng(2).random((12, 12, 12)) < 0.7
    for block in (1, 2, 3):
        found = vg.effective_diffusivity(pores, periodic="xyz", block=block).relative[0]
        moved = np.roll(pores, (6, 6), axis=(1, 2))
        again = vg.effective_diffusivity(moved, periodic="xyz", block=block).relative[0]
        assert again == pytest.approx(found, rel=1e-4)


@pytest.mark.filterwarnings("ignore::voxgran._base.errors.PackingWarning")
@pytest.mark.parametrize("block", [1, 2])
def test_a_wall_with_a_hole_leaks_only_there(block):
    # a wall of one voxel on either side of the faces between cells
    for place in (4, 5):
        pores = np.ones((10, 12, 12), bool)
        pores[place] = False
        assert vg.effective_diffusivity(pores, block=block).relative[0] == 0.0
        pores[place, 5, 5] = True
        assert vg.effective_diffusivity(pores, block=block).relative[0] < 0.25


def test_a_region_and_what_is_not_there():
    x = np.arange(20) - 9.5
    region = np.repeat((x[:, None] ** 2 + x**2 < 80)[..., None], 9, axis=2)
    found = vg.effective_diffusivity(np.ones(region.shape, bool), region=region)
    assert found.relative[2] == pytest.approx(1.0)
    assert np.isnan(found.relative[:2]).all()
    assert found.porosity == 1.0
    solid = vg.effective_diffusivity(np.zeros((1, 3, 2), bool))
    assert solid.relative.tolist() == [0.0] * 3
    assert solid.tortuosity_factor.tolist() == [math.inf] * 3
    for wrong in ({"region": region[1:]}, {"region": np.zeros((2, 2, 2), bool)}, {"block": 5}, {"periodic": "w"}):
        with pytest.raises(InputError):
            vg.effective_diffusivity(np.ones((2, 2, 2), bool), **wrong)
    with pytest.raises(InputError, match="no voxel"):
        vg.effective_diffusivity(np.zeros((0, 3, 3), bool))


def test_the_measure_of_packings():
    place = np.indices((2, 2, 2)).reshape(3, -1).T + 0.5
    lattice = vg.Packing.of([vg.make_shape("sphere", diameter=0.9)], vg.Box((2, 2, 2), periodic="xyz"), position=place)
    tree = measure(lattice, "transport")
    for axis in "xyz":
        value = tree[f"effective_diffusivity_{axis}"]
        assert float(value) == pytest.approx(by_poles(lattice.solid_fraction), rel=0.01)
        assert float(tree[f"tortuosity_factor_{axis}"]) == pytest.approx(lattice.porosity / float(value), rel=0.01)
        assert 0 < value.error < 0.03
    cylinder = vg.Packing.of([vg.make_shape("sphere")], vg.Cylinder(2, 5), position=np.zeros((0, 3)))
    assert transport(cylinder, voxel_size=0.2).relative == pytest.approx([np.nan, np.nan, 1.0], nan_ok=True)
    disks = vg.Packing.of([vg.make_shape("disk")], vg.Rectangle((4, 4), periodic="xy"), position=[[1, 2, 0]])
    # Maxwell's formula in the plane, up to the fourth power of the area fraction
    share = disks.solid_fraction
    assert transport(disks).relative == pytest.approx([(1 - share) / (1 + share)] * 2, rel=3e-3)


def test_cells_of_single_voxels_take_fifty_bytes_each():
    """Memory of arrays, not of the process; in double precision it was 110."""
    pores = stream(5, "pores").random((64, 64, 64)) < 0.7
    vg.effective_diffusivity(pores[:8, :8, :8], block=1)
    tracemalloc.start()
    try:
        vg.effective_diffusivity(pores, block=1)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 50 * pores.size


def test_single_precision_costs_no_digit_that_the_solver_has():
    """In long images flows are small differences of potentials near to each other."""
    pores = np.zeros((3000, 8, 8), dtype=bool)
    pores[:, 2:6, 2:6] = True
    pores[1000:1010, 3, :] = pores[2000, :4, :] = False
    whole = vg.effective_diffusivity(pores, block=1).relative[0]
    half = (
        vg.effective_diffusivity(pores[:1500], block=1).relative[0],
        vg.effective_diffusivity(pores[1500:], block=1).relative[0],
    )
    assert whole == pytest.approx(2 / (1 / half[0] + 1 / half[1]), rel=2e-5)
