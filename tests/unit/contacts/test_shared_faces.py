"""Meshes that share triangles: what is proven to lie side by side has no common volume."""

import numpy as np
import pytest
from kit import slow
from scipy.spatial.transform import Rotation

import voxgran as vg
from voxgran._base.seeds import stream
from voxgran.contacts import meshes
from voxgran.contacts.overlap.shared_faces import shared_by_neighbours
from voxgran.contacts.solid import Solid, combine
from voxgran.geometry.crossing import meet_beyond_corners
from voxgran.geometry.tree import grow_tree
from voxgran.shapes.mesh import Mesh

STRAIGHT, HERE = np.eye(3), np.zeros(3)
MARGIN = 1e-12


def tetrahedron(points):
    """Return the solid with four corners."""
    points = np.array(points, dtype=float)
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    if np.linalg.det(points[1:] - points[0]) < 0:
        faces = faces[:, ::-1]
    return Solid(Mesh(points, faces))


def proven(one, other, *, matrix=STRAIGHT, offset=HERE):
    """Return whether two solids are proven to lie side by side, which must not depend on their order."""
    found = shared_by_neighbours(one, other, matrix=matrix, offset=offset, margin=MARGIN)
    back = shared_by_neighbours(other, one, matrix=matrix.T, offset=-matrix.T @ offset, margin=MARGIN)
    assert (found is None) == (back is None)
    return found is not None


def common_volume(one, other):
    return combine(one, other, matrix=STRAIGHT, offset=HERE, operation="common").volume


BASE = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]


@pytest.mark.parametrize(
    ("corners", "expected"),
    [
        ([*BASE, (0, 0, -1)], True),  # a common face
        ([*BASE, (0, 0, 1)], False),  # itself
        ([*BASE, (0, 0, 0.5)], False),  # within the other one, on the same face
        ([*BASE, (2, 2, 1)], False),  # both on one side of the common face
        ([(0, 0, 0), (1, 0, 0), (0, -1, 0), (0, -1, -1)], True),  # a common edge
        ([(0, 0, 0), (1, 0, 0), (0.2, 0.2, 1), (0.2, 0.3, -1)], False),  # a common edge, and through the other one
        ([(0, 0, 0), (-1, 0, 0), (0, -1, 0), (-1, -1, -1)], True),  # a common corner
        ([(0, 0, 0), (0.2, 0.2, 0.2), (0.3, 0.2, 0.2), (0.2, 0.3, 0.25)], False),  # a common corner, within it
        ([(0, 0, 0), (2, 2, 2), (2, 2, 2.1), (2.1, 2, 2)], False),  # a common corner, and through the opposite face
        ([(0, 0, 1), (1, 0, 1.1), (0, 1, 1.1), (1, 1, 2)], True),  # a common corner at the top
        ([(0, 0, 0), (1, 0, 0), (0.2, 0.5, 0), (0.2, 0.2, -1)], False),  # a common edge, and on a part of the face
        ([(5, 5, 5), (6, 5, 5), (5, 6, 5), (5, 5, 6)], False),  # nothing in common: no matter of this proof
    ],
)
def test_a_pair_of_tetrahedra(corners, expected):
    one, other = tetrahedron([*BASE, (0, 0, 1)]), tetrahedron(corners)
    assert proven(one, other) is expected
    if expected:
        assert common_volume(one, other) < 1e-15


@pytest.mark.parametrize(
    ("corners", "expected"),
    [
        ([(3, 0, -1), (3, 0, 1)], True),  # the edge opposite to the common corner goes through the other triangle
        ([(0.3, 0, -1), (0.3, 0, 1)], True),
        ([(-1, 0, -1), (-1, 0, 1)], False),
        ([(2, 0, 0), (2, 2, 0)], True),  # in one plane, one upon the other
        ([(-1, 2, 0), (1, 2, 0)], False),  # in one plane, side by side
        ([(1, -1, 0), (1, 0, 0)], True),  # a common edge, one upon the other
        ([(1, -1, 0), (1, -2, 0)], False),  # a common edge, side by side
        ([(1, -1, 0), (1, 0, 1e-3)], False),  # a common edge, at a small angle
    ],
)
def test_triangles_with_a_common_corner(corners, expected):
    points = np.array([(0, 0, 0), (1, -1, 0), (1, 1, 0), *corners], dtype=float)
    second = [0, 1, 4] if corners[0] == (1, -1, 0) else [0, 3, 4]
    for one, other in (([0, 1, 2], second), (second, [0, 1, 2])):
        first, counts = np.array([one]), np.ones(1, dtype=bool)
        found = meet_beyond_corners(grow_tree(points, first), first, counts, points, np.array([other]), margin=MARGIN)
        assert found is expected
        assert not meet_beyond_corners(
            grow_tree(points, first), first, ~counts, points, np.array([other]), margin=MARGIN
        )


@pytest.mark.slow
def test_what_is_proven_has_no_common_volume():
    draw, found, clear = stream(0, "shared"), 0, 0
    for _ in range(600):
        pool = draw.integers(0, 4, (8, 3)) if draw.random() < 0.5 else draw.random((6, 3))
        one, other = (pool[draw.permutation(len(pool))[:4]] for _ in range(2))
        if min(abs(np.linalg.det(points[1:] - points[0])) for points in (one, other)) < 1e-3:
            continue
        one, other = tetrahedron(one), tetrahedron(other)
        free = common_volume(one, other) < 1e-12
        clear += free
        if proven(one, other):
            found += 1
            assert free
    # the rest only touches in points that are no corners, or lies on each other
    assert clear > found > 0.4 * clear


def test_a_proof_stands_in_any_pose():
    one, other = tetrahedron([*BASE, (0, 0, 1)]), tetrahedron([*BASE, (0.2, 0.2, -1)])
    turn = Rotation.from_rotvec([0.4, -1.1, 2.0]).as_matrix()
    shift = np.array([0.3, -20.0, 7.0])
    moved = tetrahedron((np.array([*BASE, (0.2, 0.2, -1)], dtype=float) - shift) @ turn)
    assert proven(one, moved, matrix=turn, offset=shift)
    # closer than the margin tells
    for depth, expected in ((1e-14, True), (1e-10, False)):
        assert proven(one, other, offset=np.array([0.0, 0.0, depth])) is expected


@pytest.mark.filterwarnings("ignore:.*several pieces", "ignore:.*labels have fewer than", "ignore:.*cut by the border")
@pytest.mark.parametrize("surface", ["smooth", "voxel"])
@pytest.mark.parametrize("periodic", [slow(""), "xy"])
def test_packings_of_labels_are_proven_without_booleans(surface, periodic, monkeypatch):
    centers = stream(3, "cells").random((12, 3)) * 14
    cells = np.stack(np.meshgrid(*[np.arange(14.0)] * 3, indexing="ij"), axis=-1)[..., None, :] - centers
    if periodic:
        cells[..., :2] -= 14 * np.round(cells[..., :2] / 14)
    image = 1 + (cells**2).sum(axis=-1).argmin(axis=-1)
    packing = vg.packing_of_labels(image, voxel_size=0.5, surface=surface, periodic=periodic, gravity="none")
    calls = []
    monkeypatch.setattr(meshes, "combine", lambda *args, **named: calls.append(1) or combine(*args, **named))
    assert vg.verify(packing).ok
    assert len(calls) == 0
    # a grain that is pushed by a millionth is found
    position = packing.position.copy()
    position[0, 0] += 1e-6
    pushed = vg.Packing.of(packing.shapes, packing.container, position=position, shape_id=packing.shape_id)
    found = vg.verify(pushed)
    assert found.overlapping_pairs > 0
    assert found.deepest * found.mean_diameter == pytest.approx(1e-6, rel=0.2)


@pytest.mark.filterwarnings("ignore:.*cut by the border")
@pytest.mark.parametrize("surface", ["smooth", "voxel"])
def test_normals_of_neighbours_are_those_of_the_surface_that_they_share(surface):
    # one image of cells of points: the faces between two cells lie across the line between their points
    centers = stream(3, "cells").random((12, 3)) * 20
    cells = np.stack(np.meshgrid(*[np.arange(0.5, 20.0)] * 3, indexing="ij"), axis=-1)[..., None, :] - centers
    packing = vg.packing_of_labels(1 + (cells**2).sum(axis=-1).argmin(axis=-1), voxel_size=1.0, surface=surface)
    found = packing.contacts(1e-9)
    label = np.array([int(shape.name.split()[1]) - 1 for shape in packing.shapes])[packing.shape_id]
    between = centers[label[found.j]] - centers[label[found.i]]
    cosines = np.einsum("ki,ki->k", found.normal, between) / np.linalg.norm(between, axis=1)
    assert np.linalg.norm(found.normal, axis=1) == pytest.approx(np.ones(found.count))
    # some cells meet in a few faces of voxels only
    assert np.median(cosines) > 0.995
    assert np.quantile(cosines, 0.1) > 0.9
    # the points lie on both surfaces
    for k in range(found.count):
        for grain in (found.i[k], found.j[k]):
            shape, away = packing.shapes[packing.shape_id[grain]], found.point[k] - packing.position[grain]
            assert abs(shape.signed_distance(away[None])[0]) < 1e-9


def test_the_contact_of_two_blocks_is_the_middle_of_their_face():
    image = np.zeros((14, 14, 14), dtype=int)
    image[2:8, 3:9, 2:7], image[8:13, 3:9, 2:9] = 1, 2
    found = vg.packing_of_labels(image, voxel_size=(0.5, 0.4, 0.7)).contacts(0.0)
    assert found.normal[0] == pytest.approx([1, 0, 0], abs=0.01)
    assert found.point[0] == pytest.approx([4.0, 2.4, 3.15], abs=0.25)


def test_a_grain_inside_another_that_shares_a_corner_with_it_is_not_beside_it():
    """Triangles that meet at the corner alone do not tell on which side the others lie."""
    large = tetrahedron([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)])
    small = tetrahedron([(0, 0, 0), (0.3, 0.1, 0.1), (0.1, 0.3, 0.1), (0.1, 0.1, 0.3)])
    assert common_volume(large, small) == pytest.approx(small.mesh.volume)
    assert not proven(large, small)
    beside = tetrahedron([(0, 0, 0), (-0.3, 0.1, 0.1), (-0.1, 0.3, 0.1), (-0.1, 0.1, 0.3)])
    assert proven(large, beside)
