"""Parity against winding numbers; shares against exact lengths in convex bodies; partitions of space."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull, Delaunay

import voxgran as vg
from voxgran._base.seeds import stream
from voxgran.shapes.tessellate import unit_box
from voxgran.shapes.winding import winding_numbers
from voxgran.voxels.scanline import centers_inside, column_shares


def hull(points):
    """Return vertices, outward faces and half-spaces of a convex hull."""
    found = ConvexHull(points)
    corners = points[found.simplices]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("fi,fi->f", normals, found.equations[:, :3]) < 0
    faces = np.where(inward[:, None], found.simplices[:, ::-1], found.simplices)
    return points, faces.astype(np.int64), found.equations


def test_parity_is_the_winding_number_rule(data_dir):
    shape = vg.load_shape(data_dir / "itokawa_lp.obj")
    turned = shape.rotated([0.5, 0.5, -0.5, 0.5]).rotated([0.8, 0.6, 0, 0])
    counts = (20, 15, 14)
    vertices = (turned.vertices / shape.bounding_radius + 1) * 7.3
    mask = centers_inside(vertices, turned.faces, counts)
    centers = np.argwhere(np.ones(counts)) + 0.5
    expected = winding_numbers(vertices[turned.faces], centers) > 0.5
    assert 0 < expected.sum() < expected.size
    assert np.array_equal(mask.ravel(), expected)


def test_boxes_that_share_faces_on_centers_share_no_voxel():
    # 27 boxes of 3 x 3 x 3 voxels whose faces lie on voxel centers: half-open, each center belongs to one
    box, faces, _ = unit_box()
    total = np.zeros((12, 12, 12), dtype=int)
    for place in np.ndindex(3, 3, 3):
        total += centers_inside((box + 0.5 + np.array(place)) * 3 + 1.5, faces, total.shape)
    assert total[1:10, 1:10, 1:10].min() == total.max() == 1
    assert total.sum() == 9**3


def test_tetrahedra_on_lattice_points_share_no_voxel_and_miss_none():
    points = stream(6, "lattice points").integers(0, 7, (40, 3)).astype(float) + 0.5
    points = np.unique(points, axis=0)
    total = np.zeros((8, 8, 8), dtype=int)
    for cell in Delaunay(points, qhull_options="QJ Pp").simplices:
        a, b, c, d = cell
        faces = np.array([[a, b, c], [a, c, d], [a, d, b], [b, d, c]])
        total += centers_inside(points, faces, total.shape)
    assert total.max() == 1
    centers = np.argwhere(np.ones(total.shape)) + 0.5
    equations = ConvexHull(points).equations
    inside = (centers @ equations[:, :3].T + equations[:, 3] < -1e-9).all(axis=1)
    assert (total.ravel()[inside] == 1).all()


def exact_shares(equations, counts, columns):
    """Return shares from the exact length of each column in a convex body."""
    share = np.zeros(counts)
    levels = np.arange(counts[2] + 1)
    for i, j in np.ndindex(counts[0] * columns, counts[1] * columns):
        x, y = (i + 0.5) / columns, (j + 0.5) / columns
        rest = -(equations[:, 0] * x + equations[:, 1] * y + equations[:, 3])
        slope = equations[:, 2]
        upper = np.min(rest[slope > 0] / slope[slope > 0])
        lower = np.max(rest[slope < 0] / slope[slope < 0])
        if upper > lower:
            length = np.diff(np.clip(levels, lower, upper))
            share[i // columns, j // columns] += length / columns**2
    return share


@pytest.mark.parametrize("columns", [1, 3])
def test_shares_are_exact_along_the_columns(columns):
    vertices, faces, equations = hull(stream(7, "hull").uniform(-0.7, 5.4, (14, 3)))
    counts = (5, 4, 5)
    shares = column_shares(vertices, faces, counts, columns)
    assert np.allclose(shares, exact_shares(equations, counts, columns), rtol=0, atol=1e-12)


def test_a_cavity_counts_as_empty():
    box, faces, _ = unit_box()
    outer, inner = box * 8 + 5, box * 4 + 5
    both = np.concatenate([faces, faces[:, ::-1] + len(box)])
    vertices = np.concatenate([outer, inner])
    assert centers_inside(vertices, both, (10, 10, 10)).sum() == 8**3 - 4**3
    assert column_shares(vertices, both, (10, 10, 10), 2).sum() == pytest.approx(8**3 - 4**3, abs=1e-9)


def test_what_lies_beyond_the_lattice_is_left_out():
    box, faces, _ = unit_box()
    vertices = box * 100.0
    assert centers_inside(vertices, faces, (3, 4, 5)).all()
    assert np.allclose(column_shares(vertices, faces, (3, 4, 5), 4), 1.0, rtol=0, atol=1e-12)
    assert not centers_inside(box - 5, faces, (3, 4, 5)).any()
    above, below = box + np.array([0.5, 0.5, 9]), box + np.array([0.5, 0.5, -3])
    assert not centers_inside(above, faces, (3, 4, 5)).any()
    assert np.abs(column_shares(below, faces, (3, 4, 5), 4)).max() < 1e-12
