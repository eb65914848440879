"""Exact shares: against half-spaces, closed formulas, fine voxels and brute quadrature."""

import numpy as np
import pytest
from kit import hull, slow
from scipy.spatial import ConvexHull, HalfspaceIntersection

import voxgran as vg
from voxgran._base.seeds import stream
from voxgran.geometry.rotation import random_rotations, rotation_matrices
from voxgran.lattice.grid import Grid
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.spheres import Spheres
from voxgran.shapes.tessellate import unit_box
from voxgran.voxels import shares as module
from voxgran.voxels.occupy import occupy, voxelize
from voxgran.voxels.shares import Shares, mesh_shares

TURNS = random_rotations(stream(8, "turns"), 4)
SIZES = {
    "sphere": (0.8,),
    "ellipsoid": (1.0, 0.7, 0.5),
    "box": (1.0, 1.4, 0.8),
    "cylinder": (0.6, 1.3),
    "cone": (0.9, 1.2),
    "spherocylinder": (0.6, 1.1),
}


def halfspace_share(equations, low):
    """Return the volume of a convex body within the unit cube at a corner: qhull's intersection of half-spaces."""
    cube = np.concatenate([np.column_stack([np.eye(3), -(low + 1)]), np.column_stack([-np.eye(3), low])])
    both = np.concatenate([equations, cube])
    corners = (low + np.indices((2, 2, 2)).reshape(3, -1).T) @ equations[:, :3].T + equations[:, 3]
    if (corners <= 0).all():
        return 1.0
    inner = chebyshev(both)
    if inner is None:
        return 0.0
    return ConvexHull(HalfspaceIntersection(both, inner).intersections).volume


def chebyshev(equations):
    """Return the middle of the largest sphere in half-spaces, or None where it is tiny."""
    from scipy.optimize import linprog

    norm = np.linalg.norm(equations[:, :3], axis=1)
    found = linprog(
        [0, 0, 0, -1],
        A_ub=np.column_stack([equations[:, :3], norm]),
        b_ub=-equations[:, 3],
        bounds=[(None, None)] * 3 + [(0, None)],
    )
    return found.x[:3] if found.success and found.x[3] > 1e-7 else None


@pytest.mark.parametrize("index", range(4))
def test_every_voxel_is_right_to_1e_12_against_half_spaces(index):
    vertices, faces, equations = hull(stream(7, "hull", index).uniform(-0.7, 5.4, (14, 3)))
    counts = (5, 4, 6)
    share = mesh_shares(vertices, faces, counts).dense()
    for voxel in np.ndindex(counts):
        assert abs(share[voxel] - halfspace_share(equations, np.array(voxel, dtype=float))) < 1e-12


@pytest.mark.parametrize("resolution", [0.01, 0.3, 1, 3, 16, slow(50)])
@pytest.mark.parametrize("name", ["eros.obj", "itokawa_lp.obj", "bennu_lp.obj", "solid_union", *SIZES])
def test_the_total_is_right_to_1e_12_at_any_resolution(name, resolution, data_dir):
    if name.endswith(".obj"):
        shape = vg.load_shape(data_dir / name)
    else:
        shape = vg.make_shape(name) if name == "solid_union" else Shape.of(Primitive(name, SIZES[name]), name=name)
    for turn in (None, *TURNS[:2]):
        body = shape if turn is None else shape.rotated(turn)
        voxels = voxelize(body, voxel_size=shape.diameter / resolution, fraction=True)
        assert voxels.volume == pytest.approx(shape.volume, rel=1e-12)
        assert voxels.fraction_error <= 1e-12


def test_shares_of_a_scan_are_those_of_fine_voxels(data_dir):
    scan = vg.load_shape(data_dir / "itokawa_lp.obj")
    voxels = voxelize(scan, voxel_size=scan.diameter / 7, fraction=True)
    share = voxels.fraction
    x, y, z = share.shape
    fine = occupy(scan, Grid(tuple(voxels.origin), voxels.voxel_size / 40, (40 * x, 40 * y, 40 * z)))
    exact = fine.reshape(x, 40, y, 40, z, 40).mean(axis=(1, 3, 5))
    assert np.abs(share - exact).max() < 5e-3
    assert (share[~occupy(scan, voxels.grid, cover="touch")] == 0).all()


@pytest.mark.parametrize("kind", sorted(SIZES))
@pytest.mark.parametrize("turn", [None, 1])
def test_shares_of_regular_solids_against_midpoints(kind, turn):
    shape = Shape.of(Primitive(kind, SIZES[kind]), name=kind)
    shape = shape if turn is None else shape.rotated(TURNS[turn])
    voxels = voxelize(shape, voxel_size=shape.diameter / 4.3, fraction=True)
    steps = ((np.arange(48) + 0.5) / 48 - 0.5) * voxels.voxel_size
    inner = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    for voxel in np.argwhere((voxels.fraction > 0) & (voxels.fraction < 1))[::3]:
        points = voxels.grid.coordinates(voxel[None]) + inner
        assert voxels.fraction[tuple(voxel)] == pytest.approx(
            shape.geometry.contains(points).mean(), abs=0.003 if turn else 0.011
        )


def test_a_half_sphere_and_an_eighth_in_closed_form():
    sphere = Shape.of(Primitive("sphere", (0.4,)), name="sphere")
    volume = sphere.volume
    whole = voxelize(sphere, grid=Grid((-0.5,) * 3, 1.0, (1, 1, 1)), fraction=True)
    half = voxelize(sphere, grid=Grid((-0.5, -0.5, 0.0), 1.0, (1, 1, 1)), fraction=True)
    eighth = voxelize(sphere, voxel_size=1.0, fraction=True)
    assert whole.volume == pytest.approx(volume, rel=1e-13)
    assert half.volume == pytest.approx(volume / 2, rel=1e-13)
    assert np.allclose(eighth.fraction[eighth.fraction > 0], volume / 8, rtol=1e-13)
    # the cap of height h: pi h^2 (3 r - h) / 3
    cap = voxelize(sphere, grid=Grid((-0.5, -0.5, 0.3), 1.0, (1, 1, 1)), fraction=True)
    assert cap.volume == pytest.approx(np.pi * 0.1**2 * (3 * 0.4 - 0.1) / 3, rel=1e-12)


@pytest.mark.slow
def test_unions_of_spheres_state_their_error():
    generator = stream(3, "spheres")
    centers, radii = generator.uniform(-0.6, 0.6, (6, 3)), generator.uniform(0.2, 0.6, 6)
    shape = Shape.of(Spheres(centers, radii), name="clump")
    for resolution in (3.3, 12.7):
        voxels = voxelize(shape, voxel_size=shape.diameter / resolution, fraction=True)
        assert 1e-12 < voxels.fraction_error < 1e-3
        assert voxels.volume == pytest.approx(shape.volume, rel=1e-4)
        steps = ((np.arange(40) + 0.5) / 40 - 0.5) * voxels.voxel_size
        inner = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
        for voxel in np.argwhere((voxels.fraction > 0) & (voxels.fraction < 1))[::29]:
            points = voxels.grid.coordinates(voxel[None]) + inner
            assert voxels.fraction[tuple(voxel)] == pytest.approx(shape.geometry.contains(points).mean(), abs=3e-3)


def test_pixels_of_outlines_are_exact():
    disk = Shape.of(Outline("disk", radius=0.7), name="disk")
    corners = np.array([[0, 0], [2, 0.1], [1.9, 1], [0.8, 1], [1, 2], [0.1, 2.0]])
    bend = Shape.of(Outline("polygon", vertices=corners), name="L")
    for shape in (disk, bend):
        for resolution in (0.3, 3.3, 40):
            voxels = voxelize(shape, voxel_size=shape.diameter / resolution, fraction=True)
            assert voxels.volume == pytest.approx(shape.volume, rel=1e-12)
    quarter = voxelize(disk, voxel_size=1.0, fraction=True)
    assert np.allclose(quarter.fraction[quarter.fraction > 0], np.pi * 0.49 / 4, rtol=1e-13)


def test_parts_beyond_the_lattice_are_left_out():
    vertices, faces, _ = unit_box()
    turn = rotation_matrices(TURNS[:1])[0]
    body = Shape.of(Mesh(vertices @ turn.T * 3, faces.copy()), name="box")
    # windows that share faces: their volumes add up
    total = 0.0
    for low in np.ndindex(2, 2, 2):
        corner = tuple(float(value) for value in -3.1 + 3.1 * np.array(low))
        total += voxelize(body, grid=Grid(corner, 0.31, (10, 10, 10)), fraction=True).volume
    assert total == pytest.approx(27, rel=1e-12)
    assert voxelize(body, grid=Grid((-0.1,) * 3, 0.1, (2, 2, 2)), fraction=True).shares.runs[:, 3].tolist() == [2] * 4


def test_faces_between_voxels_cut_none():
    vertices, faces, _ = unit_box()
    found = mesh_shares(vertices * 4 + 4, faces, (8, 8, 8))
    assert len(found.cut) == 0
    assert found.total == 64
    assert found.runs.tolist() == [[i, j, 2, 6] for i in range(2, 6) for j in range(2, 6)]


def test_few_pieces_at_a_time_give_the_same(monkeypatch, data_dir):
    scan = vg.load_shape(data_dir / "bennu_lp.obj")
    vertices, counts = scan.vertices / scan.bounding_radius * 3 + 4, (8, 8, 8)
    whole = mesh_shares(vertices, scan.faces, counts)
    monkeypatch.setattr(module, "PIECES", 7)
    parts = mesh_shares(vertices, scan.faces[:600], counts)
    monkeypatch.setattr(module, "PIECES", 2**18)
    assert np.array_equal(parts.dense(), mesh_shares(vertices, scan.faces[:600], counts).dense())
    assert whole.total == pytest.approx(scan.volume * (3 / scan.bounding_radius) ** 3, rel=1e-12)


def test_sparse_and_dense_are_the_same():
    share = np.round(stream(2, "share").random((4, 5, 9)) * 3) / 3
    sparse = Shares.from_array(share, 0.0)
    assert np.array_equal(sparse.dense(), share)
    out = np.full(share.shape, 7, dtype=np.float32)
    assert sparse.dense(out) is out
    assert np.allclose(out, share)
    assert sparse.total == pytest.approx(share.sum())
