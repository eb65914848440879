"""The surfaces of all grains where they lie, merged into one mesh: for pictures and scene files."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers
from voxgran._base.errors import TooLargeError
from voxgran.contacts.assembly import Assembly

#: most triangles that are merged into one mesh (about 5 GB at the peak)
TRIANGLE_LIMIT = 40_000_000


@dataclass(frozen=True, slots=True)
class Surfaces:
    """Many closed surfaces in one mesh: vertices (n, 3), triangles (m, 3), and the grain (m,) of each triangle."""

    vertices: Floats
    faces: Integers
    grain: Integers


def merged_surfaces(
    assembly: Assembly, *, grains: Integers | None = None, bodies: Sequence[tuple[Floats, Integers]] | None = None
) -> Surfaces:
    """Merge the surfaces of grains, of all by default, in their poses.

    `bodies` are vertices and faces that represent each shape in its body frame; its tessellation by default.

    Raises
    ------
    TooLargeError
        If there are more than TRIANGLE_LIMIT triangles.
    """
    chosen = np.arange(assembly.count) if grains is None else grains
    shape_id = assembly.shape_id[chosen]
    used = np.unique(shape_id)
    meshes = {
        int(s): (assembly.shapes[s].vertices, assembly.shapes[s].faces) if bodies is None else bodies[s] for s in used
    }
    total = sum(len(faces) * int((shape_id == s).sum()) for s, (_, faces) in meshes.items())
    if total > TRIANGLE_LIMIT:
        raise TooLargeError(
            f"the grains have {total} triangles: at most {TRIANGLE_LIMIT} are merged; "
            "choose fewer grains or coarser meshes"
        )
    vertices, faces, owners, start = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], [np.zeros(0, np.int64)], 0
    for s, (body, triangles) in meshes.items():
        members = chosen[shape_id == s]
        turned = linear.einsum("gij,vj->gvi", assembly.matrices[members], body)
        placed = turned * assembly.scale[members, None, None] + assembly.position[members, None, :]
        vertices.append(placed.reshape(-1, 3))
        shifts = start + len(body) * np.arange(len(members))
        faces.append((triangles[None] + shifts[:, None, None]).reshape(-1, 3))
        owners.append(np.repeat(members, len(triangles)))
        start += placed.size // 3
    return Surfaces(np.concatenate(vertices), np.concatenate(faces), np.concatenate(owners))
