"""Solids that overlap, lie in each other or touch face to face become one."""

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers, box_of
from voxgran._base.errors import DirtyMeshError
from voxgran.geometry.crossing import crossing_faces
from voxgran.geometry.triangles import areas_of
from voxgran.lattice.label import components
from voxgran.shapes.boolean import common_volume, united
from voxgran.shapes.finer import vertex_normals
from voxgran.shapes.repairing.bodies import shells_of, split
from voxgran.shapes.shells import without_unused

#: thickness of the part that two solids share, in diagonals of the bounding box, up to which they only touch: files may
#: round coordinates to single precision
TOUCHING = 1e-6
#: share of the surface of a solid from which on what it shares with another one is a face, and no edge
SHARED = 1e-4


def joined(points: Floats, faces: Integers, done: list[str]) -> tuple[Floats, Integers]:
    """Join shells that overlap, or that lie in others and point outward; those that touch stay apart.

    Raises
    ------
    DirtyMeshError
        If some overlap beside cavities.
    """
    shells = shells_of(points, faces)
    inner = (shells.volume > 0) & (shells.level % 2 == 1)
    # faces of one shell that cross have been cut out
    if len(inner) < 2 or (not inner.any() and not crossing_faces(points, faces).any()):
        return points, faces
    solids = [without_unused(points, faces[shells.label == shell]) for shell in range(len(shells.volume))]
    outward = np.flatnonzero(shells.volume > 0)
    outer = [solids[k] for k in outward]
    one, other = _overlapping(outer, outer, TOUCHING * diagonal(np.concatenate([vertices for vertices, _ in outer])))
    body = components(len(solids), outward[one], outward[other])
    many = np.bincount(body)[body] > 1
    if not many.any():
        return points, faces
    if len(outward) < len(solids):
        raise DirtyMeshError(
            f"the mesh has {len(solids) - len(outward)} cavities beside shells that overlap: what is inside is "
            "not certain; save each solid in a file of its own"
        )
    done.append(f"joined {int(many.sum())} shells that overlap or lie in each other, by manifold3d")
    bodies = [united([solids[k] for k in np.flatnonzero(body == one)]) for one in np.unique(body[many])]
    bodies += [solids[k] for k in np.flatnonzero(~many)]
    first = np.cumsum([0, *(len(vertices) for vertices, _ in bodies)])
    return np.concatenate([vertices for vertices, _ in bodies]), np.concatenate(
        [triangles + k for (_, triangles), k in zip(bodies, first[:-1], strict=True)]
    )


def joined_at_faces(solids: list[tuple[Floats, Integers]], done: list[str]) -> list[tuple[Floats, Integers]]:
    """Join solids that share a part of a face, up to rounding; those that touch along edges and at corners stay apart.

    Solids that lie on each other have a common part of the area of that face once one of them is a little thicker.
    """
    if len(solids) < 2:
        return solids
    thick = TOUCHING * diagonal(np.concatenate([vertices for vertices, _ in solids]))
    thicker = [(points + thick * vertex_normals(points, faces), faces) for points, faces in solids]
    one, other = _overlapping(solids, thicker, SHARED * thick)
    body = components(len(solids), one, other)
    found = []
    for members in (np.flatnonzero(body == k) for k in np.unique(body)):
        unions = [united([source[k] for k in members]) for source in (solids, thicker)] if len(members) > 1 else []
        # rounding leaves a slit between some
        whole = [mesh for mesh in unions if len(split(*mesh)) == 1]
        found += whole[:1] or [solids[k] for k in members]
        say(done, len(members) * bool(whole), "joined {} solids that touch face to face, by manifold3d")
    return sorted(found, key=lambda mesh: -signed_volume(mesh[0][mesh[1]]))


def _overlapping(
    solids: list[tuple[Floats, Integers]], others: list[tuple[Floats, Integers]], thickness: float
) -> tuple[Integers, Integers]:
    """Return the pairs of a solid and a later one of others, as many, whose common part is thicker than a length, over
    the surface of the smaller one.
    """
    low, high = np.swapaxes([box_of(vertices) for vertices, _ in others], 0, 1)
    near = (low[:, None] <= high[None]).all(axis=2) & (low[None] <= high[:, None]).all(axis=2)
    one, other = np.nonzero(np.triu(near, 1))
    area = np.array([areas_of(vertices[triangles]).sum() for vertices, triangles in solids])
    least = thickness * np.minimum(area[one], area[other])
    thick = np.array([common_volume(solids[i], others[j]) for i, j in zip(one, other, strict=True)]) > least
    return one[thick], other[thick]


def say(done: list[str], count: int, text: str) -> None:
    """Add a sentence where something was done."""
    if count:
        done.append(text.format(count))


def diagonal(points: Floats) -> float:
    """Return the diagonal of the bounding box."""
    return float(linear.norm(np.subtract(*box_of(points))))


def signed_volume(corners: Floats) -> float:
    """Return the volume of the tetrahedra between triangles and their centroid."""
    local = corners - corners.mean(axis=(0, 1))
    return float(linear.einsum("fi,fi->", local[:, 0], np.cross(local[:, 1], local[:, 2]))) / 6
