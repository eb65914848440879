"""Signed distances against the exact tree and closed formulas."""

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran._base.seeds import stream
from voxgran.geometry.rotation import random_rotations
from voxgran.lattice.grid import Grid
from voxgran.shapes.winding import winding_numbers
from voxgran.voxels.signed_distance import distance_from_shares

TURN = random_rotations(stream(4, "turn"), 1)[0]


def centers_of(field):
    grid = Grid(tuple(field.origin), field.voxel_size, field.values.shape)
    return grid.coordinates(np.argwhere(np.ones(field.values.shape)))


def brute_distance(triangles, points):
    """Return distances from triangles by projection on each plane, edge and corner: the plain twin."""
    a, b, c = np.moveaxis(triangles[None], 2, 0)
    p = points[:, None]
    best = np.full(len(points), np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        edge = end - start
        t = np.clip(((p - start) * edge).sum(-1) / (edge**2).sum(-1), 0, 1)
        best = np.minimum(best, np.linalg.norm(p - start - t[..., None] * edge, axis=-1).min(axis=1))
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    height = ((p - a) * normal).sum(-1)
    foot = p - height[..., None] * normal
    within = np.ones(height.shape, dtype=bool)
    for start, end in ((a, b), (b, c), (c, a)):
        within &= (np.cross(end - start, foot - start) * normal).sum(-1) >= 0
    return np.minimum(best, np.where(within, np.abs(height), np.inf).min(axis=1))


@pytest.mark.parametrize("band", [0.7, pytest.param(2.5, marks=pytest.mark.slow)])
def test_the_narrow_band_is_exact(data_dir, band):
    scan = vg.load_shape(data_dir / "itokawa_lp.obj").rotated(TURN)
    field = vg.signed_distance(scan, voxel_size=scan.diameter / 8, band=band)
    points = centers_of(field)
    triangles = scan.vertices[scan.faces]
    distance = brute_distance(triangles, points)
    inside = winding_numbers(triangles, points) > 0.5
    expected = np.where(inside, -1, 1) * np.minimum(distance, field.band)
    assert np.abs(field.values.ravel() - expected).max() < 1e-5 * field.voxel_size
    assert field.band == pytest.approx(band * field.voxel_size)
    assert field.error < 1e-5 * field.voxel_size


def test_a_box_in_closed_form():
    box = vg.make_shape("box", aspect=(1, 2, 3)).rotated(TURN)
    field = vg.signed_distance(box, voxel_size=box.diameter / 20, band=3)
    p = np.abs(centers_of(field) @ box.geometry.matrix) - np.array(box.geometry.dimensions) / 2
    exact = np.linalg.norm(np.maximum(p, 0), axis=1) + np.minimum(p.max(axis=1), 0)
    assert np.abs(field.values.ravel() - np.clip(exact, -field.band, field.band)).max() < 1e-5 * field.voxel_size


@pytest.mark.parametrize("cells", [6, 11, 22])
def test_distances_from_shares_of_a_sphere(cells):
    sphere = vg.make_shape("sphere")
    size = 0.5 / cells
    grid = Grid(tuple(-(cells + 6.3) * size for _ in range(3)), size, (2 * cells + 13,) * 3)
    field = vg.signed_distance(sphere, grid=grid, source="fraction")
    exact = np.linalg.norm(centers_of(field), axis=1) - 0.5
    near = np.abs(exact) < 2 * size
    error = (field.values.ravel() - exact)[near] / size
    assert np.sqrt(np.mean(error**2)) < 0.012
    assert field.error == 0.02 * size
    # the binary mask alone is wrong by a quarter of a voxel
    mask = vg.voxelize(sphere, grid=grid).mask
    binary = np.where(mask, 0.5 - vg.distance_transform(mask), vg.distance_transform(~mask) - 0.5).ravel()
    assert np.sqrt(np.mean((binary[near] - exact[near] / size) ** 2)) > 0.2


def test_both_sources_agree_on_a_scan(data_dir):
    scan = vg.load_shape(data_dir / "bennu_lp.obj").rotated(TURN)
    mesh = vg.signed_distance(scan, voxel_size=scan.diameter / 40)
    grid = Grid(tuple(mesh.origin), mesh.voxel_size, mesh.values.shape)
    shares = vg.signed_distance(scan, grid=grid, source="fraction", out=np.empty(grid.shape))
    near = np.abs(mesh.values) < 2 * mesh.voxel_size
    # its facets have edges: a little more than round bodies have
    assert np.sqrt(np.mean((mesh.values - shares.values)[near] ** 2)) < 0.03 * mesh.voxel_size
    assert np.array_equal(mesh.values < 0, vg.voxelize(scan, grid=grid).mask)


def test_nothing_cut_and_bad_input():
    sphere = vg.make_shape("sphere")
    assert (distance_from_shares(np.zeros((3, 3, 3)), band=2.0) == 2.0).all()
    assert (distance_from_shares(np.ones((3, 3, 3)), band=2.0) == -2.0).all()
    grid = Grid((0.0, 0.0, 0.0), 0.1, (3, 3, 3))
    for arguments, text in (
        ({"grid": grid, "voxel_size": 0.1}, "exactly one"),
        ({}, "voxel_size"),
        ({"grid": grid, "band": 0.0}, "band"),
        ({"grid": grid, "source": "mask"}, "source"),
        ({"grid": grid, "out": np.zeros((3, 3, 4))}, "out"),
        ({"grid": grid, "out": np.zeros((3, 3, 3), dtype=int)}, "out"),
    ):
        with pytest.raises(InputError, match=text):
            vg.signed_distance(sphere, **arguments)
    with pytest.raises(InputError, match="flat"):
        vg.signed_distance(vg.make_shape("disk"), voxel_size=0.1)
    with pytest.raises(InputError, match="shares"):
        distance_from_shares(np.full((2, 2, 2), 1.5))
