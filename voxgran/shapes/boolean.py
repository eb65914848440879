"""Unions of closed meshes by manifold3d, in double precision."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.errors import DirtyMeshError
from voxgran._base.lazy import load


def united(meshes: Iterable[tuple[Floats, Integers]]) -> tuple[Floats, Integers]:
    """Return vertices (n, 3) and faces (m, 3) of the union of closed surfaces, counterclockwise seen from outside.

    Raises
    ------
    DirtyMeshError
        If one of the surfaces is not closed.
    """
    library = load("manifold3d")
    solids: list[Any] = []
    for vertices, faces in meshes:
        mesh = library.Mesh64(np.ascontiguousarray(vertices), np.ascontiguousarray(faces, dtype=np.uint64))
        solid = library.Manifold(mesh)
        if solid.status() != library.Error.NoError:
            raise DirtyMeshError(
                f"solid {len(solids)} is no closed surface ({solid.status().name}): a union needs closed "
                "surfaces; mend it"
            )
        solids.append(solid)
    result = library.Manifold.batch_boolean(solids, library.OpType.Add).to_mesh64()
    vertices = np.array(result.vert_properties[:, :3], dtype=np.float64)
    return vertices, np.array(result.tri_verts, dtype=np.int64)
