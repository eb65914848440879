"""Unions of closed meshes."""

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import DirtyMeshError
from voxgran._base.lazy import load
from voxgran._base.seeds import stream
from voxgran.shapes.boolean import united
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.repairing.diagnose import bounds_solid
from voxgran.shapes.tessellate import geodesic


def boxes(count):
    """Boxes about the origin; their union is known from points."""
    draws = stream(3, "boxes").uniform(0.2, 1.0, (count, 3))
    return [vg.Box(tuple(edges), origin=tuple(-edges / 2)).mesh() for edges in draws], draws


@pytest.mark.parametrize("count", [1, 2, 7])
def test_a_union_of_boxes_has_its_volume(count):
    meshes, edges = boxes(count)
    vertices, faces = united(meshes)
    # exactly: the cells between all planes, in one octant, that lie in a box
    planes = [np.unique(np.concatenate([[0.0], edges[:, k] / 2])) for k in range(3)]
    middles = np.stack(np.meshgrid(*((p[1:] + p[:-1]) / 2 for p in planes), indexing="ij"), axis=-1)
    inside = (middles[..., None, :] < edges / 2).all(axis=-1).any(axis=-1)
    volume = 8 * np.einsum("ijk,i,j,k->", inside, *(np.diff(p) for p in planes))
    assert Mesh(vertices, faces).volume == pytest.approx(volume, rel=1e-12)
    assert bounds_solid(vertices, faces)


def test_the_order_of_solids_changes_no_more_than_triangles():
    meshes, _ = boxes(5)
    meshes += [(geodesic(3)[0] * 0.3 + [0.2, 0.1, 0.0], geodesic(3)[1])]
    library = load("manifold3d")
    solids = [library.Manifold(library.Mesh64(np.array(v), np.array(f, dtype=np.uint64))) for v, f in meshes]
    whole = library.Manifold.batch_boolean(solids, library.OpType.Add).volume()
    for order in (meshes, meshes[::-1]):
        assert Mesh(*united(order)).volume == pytest.approx(whole, rel=1e-12)


def test_an_open_surface_is_named():
    meshes, _ = boxes(3)
    with pytest.raises(DirtyMeshError, match="solid 1 is no closed surface"):
        united([meshes[0], (meshes[1][0], meshes[1][1][1:]), meshes[2]])


def test_geodesic_polyhedra_are_shared_and_cannot_be_written():
    vertices, faces = geodesic(4)
    assert geodesic(4)[0] is vertices
    with pytest.raises(ValueError, match="read-only"):
        vertices[0] = 0.0
    with pytest.raises(ValueError, match="read-only"):
        faces[0] = 0
