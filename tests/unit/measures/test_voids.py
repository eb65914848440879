"""Pore space on voxels: plates, lattices, cavities, beds, porespy's numbers and rates of convergence."""

import math
from dataclasses import replace

import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran._base.errors import InputError, PackingWarning
from voxgran.measures.model import measure
from voxgran.measures.pores import commensurate, pores_of
from voxgran.measures.registered.voids import voids

SPHERE = vg.make_shape("sphere")
CUBE = vg.make_shape("box", lengths=(1, 1, 1))


def cubic(count=2):
    """Return touching spheres on a simple cubic lattice."""
    place = np.indices((count,) * 3).reshape(3, -1).T + 0.5
    return vg.Packing.of([SPHERE], vg.Box((count,) * 3, periodic="xyz"), position=place)


def plates(**more):
    """Return plates across z of thickness 0.6 at a distance of 1.4."""
    plate = vg.make_shape("box", lengths=(4, 4, 0.6))
    place = [[2, 2, 1], [2, 2, 3]]
    return vg.Packing.of([plate], vg.Box((4, 4, 4), periodic="xyz"), position=place, **more)


def slabs(kind):
    """Return the six walls of a closed cavity of edge 2 in a cube of edge 4, or five of them."""
    wall = [vg.make_shape("box", lengths=tuple(4.0 if k != axis else 1.0 for k in range(3))) for axis in range(3)]
    place = [[0.5 if k == axis else 2.0 for k in range(3)] for axis in range(3)]
    place += [[3.5 if k == axis else 2.0 for k in range(3)] for axis in range(3)]
    number = 6 if kind == "closed" else 5
    index = np.array([0, 1, 2, 0, 1, 2])[:number]
    box = vg.Box((4, 4, 4))
    return vg.Packing.of(wall, box, position=place[:number], shape_id=index, gravity=None)


def test_plates():
    found = voids(plates(), voxel_size=0.1)
    assert found.porosity == pytest.approx(0.7)
    assert found.chords[2].lengths == pytest.approx(1.4)
    assert found.chords[2].mean == pytest.approx(1.4)
    # nothing ends the lines along the plates
    assert means(found)[:2] == (math.inf, math.inf)
    assert len(found.chords[0].lengths) == 0
    assert found.percolating == (1.0, 1.0, 0.0)
    assert found.sizes == pytest.approx(1.4)


def test_walls_end_chords_and_spheres():
    found = voids(vg.Packing.of([SPHERE], vg.Box((3, 2, 2)), position=np.zeros((0, 3))), voxel_size=0.1)
    assert means(found) == pytest.approx((3.0, 2.0, 2.0))
    assert found.sizes.max() == pytest.approx(2.0)
    assert found.percolating == (1.0, 1.0, 1.0)
    # four voxels of a mask of ones are all of one pore, of a diameter of 2
    assert found.sizes.min() >= 0.1


def test_a_closed_cavity_does_not_percolate():
    # the walls of the box outside of the slabs leave no room but the cavity
    closed, opened = (voids(slabs(kind), voxel_size=0.1) for kind in ("closed", "open"))
    assert closed.porosity == pytest.approx(1 / 8)
    assert closed.percolating == (0.0, 0.0, 0.0)
    assert opened.porosity == pytest.approx(12 / 64)
    assert opened.percolating == (0.0, 0.0, 0.0)
    free = voids(slabs("closed")[:5][:2], voxel_size=0.1)
    assert free.percolating == (0.0, 0.0, 1.0)


def test_a_simple_cubic_lattice():
    tree = measure(cubic(), "voids")
    assert float(tree.specific_surface) == pytest.approx(math.pi)
    assert [float(tree[f"percolating_porosity_{axis}"]) for axis in "xyz"] == [1.0, 1.0, 1.0]
    assert float(tree.pore_porosity) == pytest.approx(1 - math.pi / 6, abs=float(tree.pore_porosity.error) + 0.005)
    # the largest sphere touches eight others
    found = voids(cubic(), voxel_size=1 / 40)
    assert found.sizes.max() == pytest.approx(math.sqrt(3) - 1, abs=2 / 40)
    # every line along x between the spheres is a chord of no end or of 1 - 2 sqrt(1/4 - r^2)
    assert found.chords[0].mean == pytest.approx(4 * (1 - math.pi / 6) / math.pi, rel=0.01)


def means(found):
    """Return the mean chords along the axes."""
    return tuple(one.mean for one in found.chords)


def random_spheres():
    """Return spheres at random in a periodic box."""
    box = vg.Box((6, 6, 6), periodic="xyz")
    return vg.pack([SPHERE], box, "rsa", solid_fraction=0.3, seed=1)


def test_the_mean_chord_in_the_plane():
    disk = vg.make_shape("disk")
    packing = vg.pack([disk], vg.Rectangle((20, 20), periodic="xy"), "rsa", solid_fraction=0.4, seed=1)
    surface = packing.surface_areas.sum() / packing.container.volume
    found = voids(packing)
    assert np.mean(means(found)) == pytest.approx(math.pi * packing.porosity / surface, rel=2e-3)
    assert len(found.percolating) == len(found.chords) == 2
    assert found.porosity == pytest.approx(packing.porosity, abs=1e-3)


@pytest.mark.slow
def test_the_error_holds():
    packing = random_spheres()
    tree = measure(packing, "voids")
    assert abs(float(tree.pore_porosity) - packing.porosity) < float(tree.pore_porosity.error) + 1e-3
    finer = voids(packing, voxel_size=0.025)
    for name, errors in (("pore_size_mean", 1.2), ("mean_chord_x", 3.0)):
        assert abs(float(tree[name]) - finer.numbers()[name]) < float(tree[name].error) * errors, name
    assert tree.pore_size_mean.attrs["error"] > 0


@pytest.mark.parametrize(("spacing", "periodic"), [slow(1.2046, ""), (1.0740, "xyz")])
def test_the_error_of_the_porosity_holds_for_lattices(spacing, periodic):
    """All spheres lie alike on the voxels, also on those of twice the size, so that both images may miss by as much."""
    place = np.stack(np.meshgrid(*[np.arange(3)] * 3, indexing="ij"), axis=-1).reshape(-1, 3) * spacing + spacing / 2
    box = vg.Box((3 * spacing,) * 3, periodic=periodic)
    found = measure(vg.Packing.of(vg.make_shape("sphere"), box, position=place, gravity=None), "voids").pore_porosity
    assert abs(float(found) - (1 - math.pi / (6 * spacing**3))) <= float(found.error) * (1 + 1e-9)


@pytest.mark.slow
def test_the_pores_of_a_bed_end_at_its_surface():
    packing = vg.pack([SPHERE], vg.Cylinder(2.5, 12.0), "deposition", count=100, seed=0)
    found = voids(packing)
    with pytest.warns(PackingWarning, match="the bulk holds"):
        bed = measure(packing, "density")
    assert found.porosity == pytest.approx(1 - float(bed.bed_solid_fraction), abs=0.01)
    assert found.sizes.max() < 2.0
    assert found.percolating[2] > 0.99
    upside = vg.Packing.of([SPHERE], vg.Box((5, 5, 12)), position=packing.position * [1, 1, -1] + [2.5, 2.5, 12])
    below = vg.Packing.of([SPHERE], vg.Box((5, 5, 12)), position=packing.position + np.array([2.5, 2.5, 0]))
    turned = voids(replace(upside, gravity=(0.0, 0.0, 1.0)))
    assert means(turned) == pytest.approx(means(voids(below)), rel=0.02)


def test_meshes_as_grains_and_as_container():
    wall = vg.ClosedMesh(vg.make_shape("solid_union", seed=1).scaled(5))
    grains = [vg.make_shape("solid_union", seed=2)]
    packing = vg.pack(grains, wall, "rsa", count=10, seed=0)
    found = voids(packing, voxel_size=0.08)
    assert found.porosity == pytest.approx(packing.porosity, abs=0.01)


def test_no_grains_and_small_lengths():
    none = vg.Packing.of([SPHERE], vg.Box((2, 2, 2), periodic="xyz"), position=np.zeros((0, 3)))
    tree = measure(none, "voids")
    assert math.isnan(float(tree.pore_size_mean))
    assert float(tree.mean_chord_x) == math.inf
    packing = random_spheres()
    usual = voids(packing, voxel_size=0.2)
    for factor in (1e-9, 1e30):
        box = packing.container.scaled(factor)
        small = vg.Packing.of([SPHERE.scaled(factor)], box, position=packing.position * factor, scale=packing.scale)
        found = voids(small, voxel_size=0.2 * factor)
        assert np.array(means(found)) / factor == pytest.approx(means(usual), rel=2e-3)
    with pytest.raises(InputError, match="voxel_size"):
        voids(packing, voxel_size=0.0)


def test_wide_pores_are_found_on_larger_voxels():
    packing = vg.Packing.of([SPHERE], vg.Box((8, 8, 8), periodic="xyz"), position=[[4, 4, 4]])
    found = voids(packing, voxel_size=0.1)
    assert found.size_voxel > 3 * found.voxel_size
    # the largest sphere touches the grain at eight corners
    assert found.sizes.max() == pytest.approx(8 * math.sqrt(3) - 1, rel=0.1)


def test_voxels_divide_periods():
    assert commensurate(0.1, np.array([3.0, 3.0])) == pytest.approx(0.1)
    size = commensurate(0.09, np.array([3.05, 4.27]))
    assert size == pytest.approx(0.61 / 7)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_porespy_gives_the_same():
    porespy = pytest.importorskip("porespy")
    packing = vg.pack([SPHERE], vg.Box((5, 5, 5)), "rsa", solid_fraction=0.3, seed=2)
    packing = replace(packing, gravity=None)
    pores = pores_of(packing, 0.1)
    sizes = porespy.filters.local_thickness(np.pad(pores.mask, 1), method="dt")
    theirs = 2 * sizes[1:-1, 1:-1, 1:-1][pores.mask] * pores.voxel_size
    ours = pores.sizes()
    assert np.mean(ours) == pytest.approx(float(np.mean(theirs)), abs=2 * pores.voxel_size)
