"""Faces, edges and vertices exactly on voxel centers: no voxel wrong, none twice, none missed."""

import numpy as np
import pytest
from kit import fixed_shape, hull, slow
from scipy.spatial import Delaunay

from voxgran._base.seeds import stream
from voxgran.geometry.rotation import lattice_rotations
from voxgran.lattice.grid import Grid
from voxgran.shapes.tessellate import unit_box
from voxgran.voxels.occupy import BACKENDS, voxelize

N = 32
GRID = Grid((0.0, 0.0, 0.0), 1.0, (N, N, N))
CENTERS = GRID.coordinates(np.argwhere(np.ones(GRID.shape)))


def wrong_voxels(mask, equations, tolerance=1e-9):
    """Count the voxels strictly inside or outside of half-spaces that are on the wrong side."""
    # faces of the same plane are one
    planes = np.unique(equations.round(12), axis=0)
    height = (planes[:, :3] @ CENTERS.T + planes[:, 3:]).max(axis=0)
    taken = mask.ravel()
    return int(np.count_nonzero((height < -tolerance) & ~taken) + np.count_nonzero((height > tolerance) & taken))


def uv_sphere(radius, rings, sides):
    """Return points of a sphere with poles along z."""
    polar, azimuth = np.linspace(0, np.pi, rings + 1)[1:-1], 2 * np.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    body = [np.column_stack([np.sin(a) * ring, np.full(sides, np.cos(a))]) for a in polar]
    return radius * np.concatenate([*body, [[0, 0, 1], [0, 0, -1]]])


def cone(radius, height, sides):
    """Return points of a cone with its axis along z."""
    azimuth = 2 * np.pi * np.arange(sides) / sides
    ring = np.column_stack([radius * np.cos(azimuth), radius * np.sin(azimuth), np.zeros(sides)])
    return np.concatenate([ring, [[0.0, 0.0, height]]])


BODIES = {
    "box": np.array(list(np.ndindex(2, 2, 2))) * [10.0, 8.0, 12.0] - [5.0, 4.0, 6.0],
    "octahedron": np.concatenate([np.eye(3), -np.eye(3)]) * 9,
    "long octahedron": np.concatenate([np.eye(3), -np.eye(3)]) * [[6.0], [9.0], [11.0], [6.0], [9.0], [11.0]],
    "cone": cone(9.0, 13.0, 24),
    "sphere": uv_sphere(10.0, 12, 16),
    "fine sphere": uv_sphere(11.0, 40, 64),
    "tetrahedron": np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) * 9,
}


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", [slow(name) if name == "fine sphere" else name for name in BODIES])
@pytest.mark.parametrize("place", [(16.0, 16.5, 16.0), slow((16.5, 16.5, 16.5)), slow((16.5, 16.0, 16.25))])
def test_no_voxel_is_wrong(backend, name, place):
    turns = lattice_rotations()[:: 7 if backend != "scanline" or name == "fine sphere" else 1]
    for turn in turns:
        vertices, faces, equations = hull(BODIES[name] @ turn.T + place)
        mask = voxelize(fixed_shape(vertices, faces), grid=GRID, backend=backend).mask
        assert wrong_voxels(mask, equations) == 0


def torus(center, turn):
    """Return a torus of facets and a function that tells on which side of the true torus a point lies."""
    sides = 48
    u, v = np.meshgrid(2 * np.pi * np.arange(sides) / sides, 2 * np.pi * np.arange(24) / 24, indexing="ij")
    x, y, z = (8 + 4 * np.cos(v)) * np.cos(u), (8 + 4 * np.cos(v)) * np.sin(u), 4 * np.sin(v)
    k = np.arange(sides * 24).reshape(sides, 24)
    a, b, c, d = k, np.roll(k, -1, 0), np.roll(np.roll(k, -1, 0), -1, 1), np.roll(k, -1, 1)
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    points = np.stack([x, y, z], -1).reshape(-1, 3) @ turn.T + center

    def height(centers):
        p = (centers - center) @ turn
        return np.hypot(np.hypot(p[:, 0], p[:, 1]) - 8, p[:, 2]) - 4

    return points, faces, height


@pytest.mark.slow
def test_tori_in_all_poses_along_the_lattice():
    for turn in lattice_rotations():
        for center in (np.full(3, 16.5), np.array([16.0, 16.5, 16.0])):
            vertices, faces, height = torus(center, turn)
            mask = voxelize(fixed_shape(vertices, faces), grid=GRID).mask
            gap = height(CENTERS)
            # facets lie up to 0.06 below the true torus
            assert mask.ravel()[gap < -0.1].all()
            assert not mask.ravel()[gap > 1e-9].any()
            # and exactly: another backend, which shares no code
            other = voxelize(fixed_shape(vertices, faces), grid=GRID, backend="open3d").mask
            assert np.array_equal(mask, other)


@pytest.mark.parametrize("backend", BACKENDS)
def test_27_boxes_share_no_voxel(backend):
    box, faces, _ = unit_box()
    total = np.zeros(GRID.shape, dtype=int)
    for place in np.ndindex(3, 3, 3):
        vertices = (box + 0.5 + np.array(place)) * 9 + 2.5
        total += voxelize(fixed_shape(vertices, faces), grid=GRID, backend=backend).mask
    assert total.max() == 1
    assert total.sum() == 27**3
    assert total[2:29, 2:29, 2:29].min() == 1


def test_tetrahedra_with_all_vertices_on_centers_partition_space():
    points = stream(6, "lattice points").integers(0, N, (300, 3)).astype(float) + 0.5
    corners = np.array(list(np.ndindex(2, 2, 2))) * (N - 1.0) + 0.5
    points = np.unique(np.concatenate([points, corners]), axis=0)
    total = np.zeros(GRID.shape, dtype=np.int8)
    cells = Delaunay(points, qhull_options="QJ Pp").simplices
    for a, b, c, d in cells:
        six = np.linalg.det(points[[b, c, d]] - points[a])
        if abs(six) < 1e-9:
            continue
        faces = np.array([[a, c, b], [a, b, d], [a, d, c], [b, c, d]])
        own, local = np.unique(faces, return_inverse=True)
        local = local.reshape(4, 3) if six > 0 else local.reshape(4, 3)[:, ::-1]
        total += voxelize(fixed_shape(points[own], local), grid=GRID).mask
    # the hull goes from center to center: the last layer on the upper side is out
    assert total[:-1, :-1, :-1].min() == total.max() == 1
    assert total.sum() == (N - 1) ** 3
