"""Triangulations made finer stay closed and lie on the true surface."""

import numpy as np
import pytest

import voxgran as vg
from voxgran.contacts.inside import inner_distance
from voxgran.geometry.triangles import areas_of, enclosed_volume
from voxgran.shapes.finer import cut_edges, edges_of, onto_surface, vertex_normals
from voxgran.shapes.spheres import Spheres


def test_any_edges_may_be_cut():
    """However edges are chosen, the surface stays closed and keeps its volume and its area."""
    shape = vg.make_shape("platonic", solid="dodecahedron")
    generator = np.random.Generator(np.random.PCG64(3))
    vertices, faces = shape.vertices, shape.faces
    area = areas_of(vertices[faces]).sum()
    for share in (0.3, 0.5, 0.7, 1.0):
        ends, index = edges_of(faces)
        assert len(ends) == 3 * len(faces) // 2
        assert (ends[index] == np.sort(np.stack([faces, np.roll(faces, -1, 1)], axis=-1), axis=-1)).all()
        chosen = generator.random(len(ends)) < share
        new = np.full(len(ends), -1)
        new[chosen] = len(vertices) + np.arange(chosen.sum())
        count = len(faces) + 2 * chosen.sum()
        vertices = np.concatenate([vertices, vertices[ends[chosen]].mean(axis=1)])
        faces = cut_edges(vertices, faces, index, new)
        assert len(faces) == count
        assert set(faces.ravel().tolist()) == set(range(len(vertices)))
    assert enclosed_volume(vertices, faces) == pytest.approx(shape.volume, rel=1e-14)
    assert areas_of(vertices[faces]).sum() == pytest.approx(area, rel=1e-13)
    assert vg.diagnose(vertices, faces).ok


@pytest.mark.parametrize("kind", ["sphere", "ellipsoid", "box", "cylinder", "cone", "spherocylinder", "clump"])
def test_new_vertices_lie_on_the_true_surface(kind):
    if kind == "clump":
        spheres = Spheres(np.array([[-0.3, 0, 0], [0.3, 0, 0]]), np.array([0.4, 0.4]))
        shape = vg.Shape.of(spheres, name="clump")
    else:
        shape = vg.make_shape(kind).rotated([0.5, 0.5, -0.5, 0.5])
    ends, _ = edges_of(shape.faces)
    middle = shape.vertices[ends].mean(axis=1)
    moved = onto_surface(shape.geometry, middle)
    inner = inner_distance(shape.geometry)
    assert np.abs(inner(moved)).max() <= shape.tessellation_error + 1e-15
    assert np.linalg.norm(moved - middle, axis=1).max() <= 1.2 * shape.tessellation_error + 1e-15
    if kind in ("sphere", "ellipsoid"):
        level = np.linalg.norm(moved @ shape.geometry.matrix / np.array(shape.geometry.dimensions), axis=1)
        assert np.abs(level - 1).max() < 1e-15
    if kind == "spherocylinder":
        assert np.abs(inner(moved)).max() < 1e-15
    if kind == "box":
        assert moved.tobytes() == middle.tobytes()


def test_normals_point_outward():
    shape = vg.make_shape("sphere")
    normals = vertex_normals(shape.vertices, shape.faces)
    assert np.abs(normals - 2 * shape.vertices).max() < 0.01
