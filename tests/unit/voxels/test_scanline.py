"""Parity and winding numbers of columns, against sums of solid angles; partitions of space."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull, Delaunay

import voxgran as vg
from voxgran._base.seeds import stream
from voxgran.shapes.tessellate import unit_box
from voxgran.shapes.winding import winding_numbers
from voxgran.voxels.scanline import centers_inside, winding_slabs


def inside(vertices, faces, counts):
    """Return the mask of a closed surface."""
    bits, odd = centers_inside(vertices, faces, counts)
    assert odd == 0
    return bits.unpacked()


def test_parity_is_the_winding_number_rule(data_dir):
    shape = vg.load_shape(data_dir / "itokawa_lp.obj")
    turned = shape.rotated([0.5, 0.5, -0.5, 0.5]).rotated([0.8, 0.6, 0, 0])
    counts = (20, 15, 14)
    vertices = (turned.vertices / shape.bounding_radius + 1) * 7.3
    mask = inside(vertices, turned.faces, counts)
    centers = np.argwhere(np.ones(counts)) + 0.5
    expected = winding_numbers(vertices[turned.faces], centers) > 0.5
    assert 0 < expected.sum() < expected.size
    assert np.array_equal(mask.ravel(), expected)


def test_boxes_that_share_faces_on_centers_share_no_voxel():
    # 27 boxes of 3 x 3 x 3 voxels whose faces lie on voxel centers: half-open, each center belongs to one
    box, faces, _ = unit_box()
    total = np.zeros((12, 12, 12), dtype=int)
    for place in np.ndindex(3, 3, 3):
        total += inside((box + 0.5 + np.array(place)) * 3 + 1.5, faces, total.shape)
    assert total[1:10, 1:10, 1:10].min() == total.max() == 1
    assert total.sum() == 9**3


def test_tetrahedra_on_lattice_points_share_no_voxel_and_miss_none():
    points = stream(6, "lattice points").integers(0, 7, (40, 3)).astype(float) + 0.5
    points = np.unique(points, axis=0)
    total = np.zeros((8, 8, 8), dtype=int)
    for cell in Delaunay(points, qhull_options="QJ Pp").simplices:
        a, b, c, d = cell
        faces = np.array([[a, b, c], [a, c, d], [a, d, b], [b, d, c]])
        total += inside(points, faces, total.shape)
    assert total.max() == 1
    centers = np.argwhere(np.ones(total.shape)) + 0.5
    equations = ConvexHull(points).equations
    held = (centers @ equations[:, :3].T + equations[:, 3] < -1e-9).all(axis=1)
    assert (total.ravel()[held] == 1).all()


def test_a_cavity_counts_as_empty():
    box, faces, _ = unit_box()
    both = np.concatenate([faces, faces[:, ::-1] + len(box)])
    assert inside(np.concatenate([box * 8 + 5, box * 4 + 5]), both, (10, 10, 10)).sum() == 8**3 - 4**3


def test_what_lies_beyond_the_lattice_is_left_out():
    box, faces, _ = unit_box()
    assert inside(box * 100.0, faces, (3, 4, 5)).all()
    for place in ([0, 0, -5], [0.5, 0.5, 9], [0.5, 0.5, -3], [-9, 0, 0], [0, 9, 0]):
        assert not inside(box + np.array(place), faces, (3, 4, 5)).any()


@pytest.mark.parametrize("counts", [(1, 1, 1), (1, 1, 4096), (3, 2, 63), (2, 3, 64), (2, 2, 65), (2, 2, 200)])
def test_columns_of_any_height(counts):
    box, faces, _ = unit_box()
    for low, high in ((-3.0, counts[2] + 3.0), (0.0, counts[2] / 2), (counts[2] / 3, counts[2]), (0.2, 0.4)):
        vertices = (box + 0.5) * [9.0, 9.0, high - low] + [-3.0, -3.0, low]
        mask = inside(vertices, faces, counts)
        levels = np.arange(counts[2]) + 0.5
        assert (mask == ((levels >= low) & (levels < high))).all()


def test_open_columns_are_counted():
    box, faces, _ = unit_box()
    vertices = box * 6 + 4.0
    # without one half of the top: the columns under it are open; a side is missed by no column along z
    top = (vertices[faces][:, :, 2] == 7).all(axis=1)
    first = np.flatnonzero(top)[0]
    odd = centers_inside(vertices, np.delete(faces, first, axis=0), (8, 8, 8))[1]
    assert odd in (15, 21)
    side = np.flatnonzero((vertices[faces][:, :, 0] == 1).all(axis=1))[0]
    assert centers_inside(vertices, np.delete(faces, side, axis=0), (8, 8, 8))[1] == 0


@pytest.mark.parametrize("slab", [1, 2**22])
def test_winding_numbers_count_overlaps(slab, monkeypatch, data_dir):
    monkeypatch.setattr("voxgran.voxels.scanline.SLAB", slab)
    shape = vg.load_shape(data_dir / "bennu_lp.obj")
    body = shape.vertices / shape.bounding_radius * 5 + 6.01
    vertices = np.concatenate([body, body + np.array([2.3, 1.1, 0.7])])
    faces = np.concatenate([shape.faces, shape.faces + len(body)])
    counts = (15, 14, 13)
    numbers = np.concatenate([part for _, part, _ in winding_slabs(vertices, faces, counts)])
    total = np.concatenate([part for _, _, part in winding_slabs(vertices, faces, counts)])
    assert not total.any()
    centers = np.argwhere(np.ones(counts)) + 0.5
    assert np.array_equal(numbers.ravel(), np.round(winding_numbers(vertices[faces], centers)))
    assert numbers.max() == 2
    mirrored = np.concatenate([part for _, part, _ in winding_slabs(vertices, faces[:, ::-1], counts)])
    assert np.array_equal(mirrored, -numbers)
