"""Unions of closed meshes by manifold3d, in double precision."""

import heapq
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
    solids = [(len(mesh[1]), place, _solid(mesh, place)) for place, mesh in enumerate(meshes)]
    result = _pairwise(solids).to_mesh64()
    vertices = np.array(result.vert_properties[:, :3], dtype=np.float64)
    return vertices, np.array(result.tri_verts, dtype=np.int64)


def common_volume(one: tuple[Floats, Integers], other: tuple[Floats, Integers]) -> float:
    """Return the volume that two closed surfaces have in common.

    Raises
    ------
    DirtyMeshError
        If one of the surfaces is not closed.
    """
    return float((_solid(one, 0) ^ _solid(other, 1)).volume())


def _solid(mesh: tuple[Floats, Integers], place: int) -> Any:
    """Return a closed surface, the one of a place in the order, as a solid of manifold3d."""
    library, (vertices, faces) = load("manifold3d"), mesh
    arrays = library.Mesh64(np.array(vertices, order="C"), np.array(faces, dtype=np.uint64, order="C"))
    solid = library.Manifold(arrays)
    if solid.status() != library.Error.NoError:
        raise DirtyMeshError(
            f"solid {place} is no closed surface ({solid.status().name}): a union needs closed surfaces; mend it"
        )
    return solid


def _pairwise(solids: list[tuple[int, int, Any]]) -> Any:
    """Return the union of solids, each with its number of faces and its place in the order.

    The two of fewest faces are united first, and so on: the time of each step grows with the number of faces.
    """
    heapq.heapify(solids)
    made = len(solids)
    while len(solids) > 1:
        one, other = heapq.heappop(solids)[2], heapq.heappop(solids)[2]
        both = one + other
        heapq.heappush(solids, (both.num_tri(), made, both))
        made += 1
    return solids[0][2]
