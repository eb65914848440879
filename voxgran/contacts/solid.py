"""Boolean operations on closed meshes by manifold3d, in double precision; they decide whether meshes overlap."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from voxgran._base.arrays import Floats, read_only
from voxgran._base.errors import DirtyMeshError
from voxgran._base.lazy import load
from voxgran.geometry.tree import TriangleTree
from voxgran.shapes.mesh import Mesh


@dataclass(frozen=True, eq=False)
class Solid:
    """A closed mesh with derived data for the contact tests, computed on first use.

    If `inside_out` is true, the solid is the exterior of the mesh, as for the walls of a container.
    """

    mesh: Mesh
    inside_out: bool = False

    @cached_property
    def tree(self) -> TriangleTree:
        """Box tree of the triangles."""
        tree = self.mesh.tree
        return replace(tree, normals=read_only(-tree.normals)) if self.inside_out else tree

    def inner_distance(self, points: Floats) -> Floats:
        """Return the distance of (n, 3) points to the surface, positive inside."""
        return -self.tree.signed_distance(points)

    @cached_property
    def manifold(self) -> Any:
        """The mesh as an object of manifold3d.

        Raises
        ------
        DirtyMeshError
            If manifold3d does not accept the surface as closed.
        """
        library = load("manifold3d")
        mesh = library.Mesh64(np.array(self.mesh.vertices), np.array(self.mesh.faces, dtype=np.uint64))
        solid = library.Manifold(mesh)
        if solid.status() != library.Error.NoError:
            raise DirtyMeshError(
                f"mesh is no closed surface ({solid.status().name}): overlaps need one; repair the shape"
            )
        return solid


@dataclass(frozen=True, eq=False)
class Body:
    """Result of a boolean operation: its surface as (m, 3, 3) triangles, and its volume."""

    triangles: Floats
    volume: float


def combine(one: Solid, other: Solid, *, matrix: Floats, offset: Floats, operation: Literal["common", "rest"]) -> Body:
    """Return the intersection of two solids, or the part of `one` outside of `other`, in the frame of `one`."""
    partner = other.manifold.transform(np.column_stack([matrix, offset]))
    result = one.manifold ^ partner if operation == "common" else one.manifold - partner
    mesh = result.to_mesh64()
    vertices = np.asarray(mesh.vert_properties, dtype=np.float64)[:, :3]
    triangles = vertices[np.asarray(mesh.tri_verts, dtype=np.int64).reshape(-1, 3)]
    return Body(np.ascontiguousarray(triangles.reshape(-1, 3, 3)), max(float(result.volume()), 0.0))
