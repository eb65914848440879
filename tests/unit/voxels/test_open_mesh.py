"""Surfaces that are not clean: overlaps, holes, flipped faces; against sums over all faces."""

import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran._base.errors import DirtyMeshError, DirtyMeshWarning, InputError, TooLargeError
from voxgran._base.seeds import stream
from voxgran.lattice.grid import Grid
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.winding import winding_numbers
from voxgran.voxels.occupy import voxelize
from voxgran.voxels.open_mesh import _fan, open_edges, voxelize_mesh

GRID, FINE = (Grid((-1.25,) * 3, 2.5 / n, (n, n, n)) for n in (24, 32))


@pytest.fixture(scope="module")
def sphere():
    shape = vg.make_shape("sphere")
    return shape.vertices * 2, shape.faces


@pytest.fixture(scope="module")
def truth(sphere):
    centers = GRID.coordinates(np.argwhere(np.ones(GRID.shape)))
    return (winding_numbers(sphere[0][sphere[1]], centers) > 0.5).reshape(GRID.shape)


@pytest.mark.slow
def test_clean_meshes_are_as_ever(sphere, truth):
    voxels = voxelize_mesh(*sphere, grid=GRID)
    assert np.array_equal(voxels.mask, truth)
    assert (voxels.open_columns, voxels.doubtful_voxels) == (0, 0)
    # inside out is turned
    assert np.array_equal(voxelize_mesh(sphere[0], sphere[1][:, ::-1], grid=GRID).mask, truth)


def test_unions_of_overlapping_parts(sphere):
    generator = stream(1, "places")
    places = generator.uniform(-0.5, 0.5, (6, 3))
    vertices = np.concatenate([sphere[0] * 0.5 + place for place in places])
    faces = np.concatenate([sphere[1] + k * len(sphere[0]) for k in range(6)])
    voxels = voxelize_mesh(vertices, faces, grid=GRID)
    parts = [voxelize_mesh(sphere[0] * 0.5 + place, sphere[1], grid=GRID).mask for place in places]
    assert np.array_equal(voxels.mask, np.any(parts, axis=0))
    assert np.sum(parts, axis=0).max() > 2
    assert voxels.open_columns == 0


@pytest.mark.parametrize("share", [slow(0.002), 0.01, slow(0.05)])
def test_small_holes_are_settled_and_reported(sphere, truth, share):
    keep = stream(2, "holes").random(len(sphere[1])) > share
    with pytest.warns(DirtyMeshWarning, match="voxels in doubt"):
        voxels = voxelize_mesh(sphere[0], sphere[1][keep], grid=GRID)
    assert voxels.open_columns > 0
    assert voxels.doubtful_voxels > 0
    wrong = np.count_nonzero(voxels.mask != truth)
    assert wrong <= 0.001 * truth.sum()
    # where in doubt it is the generalized winding number, summed over all faces
    centers = GRID.coordinates(np.argwhere(np.ones(GRID.shape)))
    generalized = (winding_numbers(sphere[0][sphere[1][keep]], centers) > 0.5).reshape(GRID.shape)
    assert np.count_nonzero(voxels.mask != generalized) <= 4


def test_the_fan_gives_the_generalized_winding_number(sphere):
    vertices, faces = sphere[0] * 10 + 16, sphere[1][stream(3, "holes").random(len(sphere[1])) > 0.1]
    corners, fan = _fan(vertices, open_edges(faces))
    assert len(open_edges(np.concatenate([faces, fan]))) == 0
    points = stream(4, "points").uniform(4, 28, (50, 3))
    both = winding_numbers(corners[np.concatenate([faces, fan])], points)
    assert np.allclose(both, np.round(both), atol=1e-9)
    open_part = both - winding_numbers(corners[fan], points)
    assert np.allclose(open_part, winding_numbers(vertices[faces], points), atol=1e-9)


def test_a_flipped_face_and_a_soup(sphere, truth):
    faces = sphere[1].copy()
    faces[100] = faces[100, ::-1]
    with pytest.warns(DirtyMeshWarning, match="wound against"):
        assert np.array_equal(voxelize_mesh(sphere[0], faces, grid=GRID).mask, truth)
    # every third face turned over, in two bodies
    wild = np.where((np.arange(len(sphere[1])) % 3 == 0)[:, None], sphere[1][:, ::-1], sphere[1])
    both = np.concatenate([sphere[0] * 0.4 - 0.5, sphere[0] * 0.4 + 0.5])
    with pytest.warns(DirtyMeshWarning, match="wound against"):
        found = voxelize_mesh(both, np.concatenate([wild, wild + len(sphere[0])]), grid=GRID).mask
    parts = [voxelize_mesh(sphere[0] * 0.4 + shift, sphere[1], grid=GRID).mask for shift in (-0.5, 0.5)]
    assert np.array_equal(found, parts[0] | parts[1])
    # corners of its own for each triangle: merged, and nothing is open
    soup = sphere[0][sphere[1]].reshape(-1, 3)
    assert np.array_equal(voxelize_mesh(soup, np.arange(len(soup)).reshape(-1, 3), grid=GRID).mask, truth)


def test_a_hole_in_a_shape_is_never_silent(sphere):
    # a shape that got past the checks: the columns notice
    broken = Shape(Mesh(sphere[0].copy(), sphere[1][30:].copy()), "broken")
    with pytest.raises(DirtyMeshError, match="open"):
        voxelize(broken, grid=FINE)


def test_a_surface_with_two_sides_is_told_and_filled(sphere, truth):
    points, faces = sphere
    many, reverse = len(points), faces[:, ::-1]
    told = f"{len(faces)} faces both ways round, whose second side was left out"
    with pytest.warns(DirtyMeshWarning, match=told):
        assert np.array_equal(voxelize_mesh(points, np.concatenate([faces, reverse]), grid=GRID).mask, truth)
    # as two surfaces, and within one with a single side
    twice = np.concatenate([points, points]), np.concatenate([faces, reverse + many])
    with pytest.warns(DirtyMeshWarning, match=told):
        assert np.array_equal(voxelize_mesh(*twice, grid=GRID).mask, truth)
    around = np.concatenate([points, points / 2]), np.concatenate([faces, faces + many, reverse + many])
    with pytest.warns(DirtyMeshWarning, match=told):
        assert np.array_equal(voxelize_mesh(*around, grid=GRID).mask, truth)


def test_bad_input_is_refused(sphere):
    vertices, faces = sphere
    with pytest.raises(InputError, match="exactly one"):
        voxelize_mesh(vertices, faces)
    with pytest.raises(InputError, match="exactly one"):
        voxelize_mesh(vertices, faces, voxel_size=1.0, grid=GRID)
    with pytest.raises(InputError, match="voxel_size"):
        voxelize_mesh(vertices, faces, voxel_size=-1.0)
    with pytest.raises(InputError, match="no rows"):
        voxelize_mesh(vertices, faces[:0], voxel_size=1.0)
    with pytest.raises(InputError, match="nan"):
        voxelize_mesh(vertices * np.nan, faces, voxel_size=1.0)
    with pytest.raises(InputError, match="names vertex"):
        voxelize_mesh(vertices[:5], faces, voxel_size=1.0)
    with pytest.raises(TooLargeError, match="voxel_size"):
        voxelize_mesh(vertices, faces, voxel_size=1e-6)
