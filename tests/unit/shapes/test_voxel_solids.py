"""Shapes of equal cubes on a lattice: one manifold, the exact volume, files."""

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import DirtyMeshError, InputError
from voxgran._base.seeds import stream
from voxgran.lattice.grid import Grid
from voxgran.lattice.label import connected_components
from voxgran.shapes.generating.voxel_solid import largest_piece, mask_of_cubes, voxel_solid
from voxgran.shapes.repairing.diagnose import refuse_dirty
from voxgran.shapes.shells import edge_faults

#: parameters of small shapes, and the number of cubes where it is known
SMALL = {
    "random_growth": ({"cubes": 80, "power": -1.0}, 80),
    "voxel_rain": ({"cubes": 80, "width": (5, 4)}, 100),
    "sierpinski_sponge": ({"removed": 9}, None),
}


def pairs(mask):
    """Return the number of pairs of cubes with a common face."""
    return sum(
        int((np.diff(mask.astype(int), axis=k) == 0)[np.take(mask, range(1, mask.shape[k]), k)].sum()) for k in range(3)
    )


def random_solid(seed, share=0.5, edge=6):
    """Return the largest piece of random voxels, full of contacts by edges and corners."""
    return largest_piece(stream(seed, "voxels").random((edge,) * 3) < share)


def check(family, seed):
    parameters, cubes = SMALL[family]
    shape = vg.make_shape(family, seed=seed, edge=0.1, **parameters)
    refuse_dirty(shape.vertices, shape.faces, f"{family} {seed}")
    assert np.isfinite(shape.vertices).all()
    cubes = shape.record["cubes"] if cubes is None else cubes
    assert shape.volume == pytest.approx(cubes * 0.1**3, rel=1e-12)
    # all faces are squares of the lattice: the area is a whole number of them
    assert shape.surface_area / 0.1**2 == pytest.approx(round(shape.surface_area / 0.1**2), rel=1e-12)


@pytest.mark.parametrize("family", SMALL)
def test_shapes_of_cubes_are_one_manifold_of_exact_volume(family):
    for seed in range(20):
        check(family, seed)


@pytest.mark.slow
@pytest.mark.parametrize("family", SMALL)
def test_many_shapes_of_cubes_are_one_manifold_of_exact_volume(family):
    for seed in range(1000):
        check(family, seed)


@pytest.mark.parametrize("seed", range(6))
def test_volume_and_area_are_those_of_the_voxels(seed):
    mask = random_solid(seed)
    shape = voxel_solid(mask, name="voxels", edge=2.0)
    cubes = int(mask.sum())
    assert shape.volume == pytest.approx(8.0 * cubes, rel=1e-13)
    assert shape.surface_area == pytest.approx(4.0 * (6 * cubes - 2 * pairs(mask)), rel=1e-13)
    assert len(shape.faces) >= 2 * (6 * cubes - 2 * pairs(mask))
    assert edge_faults(shape.faces, len(shape.vertices)).tolist() == [0, 0, 0]
    assert vg.diagnose(shape).ok
    # vertices are doubled, none is moved
    assert len(np.unique(shape.vertices.round(9), axis=0)) < len(shape.vertices)


def test_points_inside_are_those_of_the_voxels():
    mask = random_solid(3)
    shape = voxel_solid(mask, name="voxels", edge=1.0)
    points = stream(1, "points").uniform(-0.5, 6.5, (2000, 3))
    inside = {tuple(place) for place in np.argwhere(mask).tolist()}
    expected = np.array([tuple(place) in inside for place in np.floor(points).astype(int).tolist()])
    body = points - np.argwhere(mask).min(axis=0) - shape.offset
    assert (shape.contains(body) == expected).all()
    distance = shape.signed_distance(body)
    assert ((distance < 0) == expected).all()


def test_voxels_of_a_voxel_shape_are_its_own():
    shape = vg.make_shape("random_growth", seed=2, cubes=150, edge=1.0)
    lower = shape.bounds[0]
    size = np.round(np.ptp(shape.bounds, axis=0)).astype(int)
    grid = Grid(tuple(lower), 1.0, tuple(int(n) for n in size))
    found = vg.voxelize(shape, grid=grid).mask
    assert int(found.sum()) == 150
    assert voxel_solid(found, name="again", edge=1.0).volume == pytest.approx(shape.volume, rel=1e-13)
    assert vg.voxelize(shape, grid=Grid(tuple(lower), 0.5, tuple(int(2 * n) for n in size))).mask.sum() == 8 * 150


@pytest.mark.parametrize("suffix", ["obj", "ply", "off", "vtp", "stl"])
def test_files_keep_the_contacts_of_edges_apart(tmp_path, suffix):
    shape = voxel_solid(random_solid(1), name="voxels")
    vg.save_shape(shape, tmp_path / f"grain.{suffix}")
    if suffix == "stl":
        # it has no vertices that faces share, so that what touches cannot be told from what is joined
        with pytest.raises(DirtyMeshError, match="give repair=True"):
            vg.load_shape(tmp_path / "grain.stl")
    again = vg.load_shape(tmp_path / f"grain.{suffix}", repair=suffix == "stl")
    tolerance = 1e-6 if suffix == "stl" else 1e-14
    assert again.volume == pytest.approx(shape.volume, rel=tolerance)
    assert again.surface_area == pytest.approx(shape.surface_area, rel=tolerance)
    assert edge_faults(again.faces, len(again.vertices)).tolist() == [0, 0, 0]


@pytest.mark.filterwarnings("ignore:the bulk holds")
def test_clumps_packings_and_measures_of_shapes_of_cubes():
    shape = vg.make_shape("random_growth", seed=1, cubes=60)
    assert vg.fit_clump(shape, max_spheres=6, method="inscribed", resolution=32).count <= 6
    box = vg.Box((3.0, 3.0, 3.0))
    packing = vg.pack([shape], box, method="digital", count=3, voxel_size=0.1, settle=False, seed=0)
    assert packing.count == 3
    assert vg.verify(packing).ok
    assert float(vg.measure(packing)["solid_fraction"]) == pytest.approx(3 * np.pi / 6 / 27, rel=1e-9)


def test_pieces_and_masks():
    mask = mask_of_cubes(np.array([[-1, 0, 0], [0, 0, 0], [0, 1, 1], [3, 0, 0]]))
    assert mask.shape == (5, 2, 2)
    assert mask.sum() == 4
    assert np.argwhere(largest_piece(mask)).tolist() == [[0, 0, 0], [1, 0, 0]]
    assert connected_components(largest_piece(mask))[1] == 1
    with pytest.raises(InputError, match="each makes the size; leave one out"):
        voxel_solid(mask, name="voxels", diameter=1.0, edge=1.0)
    with pytest.raises(InputError, match="edge is -1"):
        voxel_solid(mask, name="voxels", edge=-1.0)
