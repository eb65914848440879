"""Patches of a triangle mesh that hang on edges with more than two faces, and how faces are wound.

Cut along the edges that have more than two faces, a surface falls into patches. A patch with open edges hangs out like
a flag, and one between edges with an odd number of faces divides a solid that is whole without it: both are no part
of the surface of a solid.
"""

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.errors import DirtyMeshError
from voxgran.geometry.triangles import areas_of
from voxgran.lattice.label import components
from voxgran.shapes.shells import half_edges, shell_labels, turned_faces

#: a patch with more than this share of the surface is not left out
MOST_AREA = 0.1


def one_sided(faces: Integers, vertex_count: int) -> tuple[Integers, int]:
    """Leave out one side of the parts of a surface of which each face is there both ways round; also return the number
    of faces left out.
    """
    first, index, counts = _distinct(faces, vertex_count)
    odd = (faces[:, 0] < faces[:, 1]) ^ (faces[:, 1] < faces[:, 2]) ^ (faces[:, 0] < faces[:, 2])
    even = np.bincount(index, weights=np.where(odd, 1.0, -1.0)) == 0
    label = components(vertex_count, faces[:, [0, 1]].ravel(), faces[:, [1, 2]].ravel())[faces[:, 0]]
    double = np.ones(int(label.max(initial=-1)) + 1, dtype=np.bool_)
    double[label[~(even & (counts == 2))[index]]] = False
    kept = ~double[label]
    kept[first] = True
    return faces[kept], int((~kept).sum())


def _distinct(faces: Integers, vertex_count: int) -> tuple[Integers, Integers, Integers]:
    """Return the first of each set of faces with the same corners, the set of each face, and the sizes of the sets."""
    a, b, c = np.sort(faces, axis=1).T
    pair = np.unique(a * vertex_count + b, return_inverse=True)[1]
    return np.unique(pair * vertex_count + c, return_index=True, return_inverse=True, return_counts=True)[1:]


def without_doubles(faces: Integers, vertex_count: int) -> tuple[Integers, int, int]:
    """Leave out faces that stand twice; two that lie on each other turned over enclose nothing, and both are left out.

    The numbers of faces left out for the first and for the second reason are returned too.
    """
    even = np.array([0, 1, 2])
    turn = np.argsort(faces, axis=1, kind="stable")
    # an odd order of the corners is the reverse of the sorted face
    odd = (turn != (even + turn[:, :1]) % 3).any(axis=1)
    _, index, counts = _distinct(faces, vertex_count)
    reverse = np.bincount(index, weights=odd, minlength=len(counts)).astype(np.int64)
    empty = 2 * reverse == counts
    # of several the first one that is wound as most of them are
    able = np.flatnonzero(odd == (2 * reverse > counts)[index])
    kept = np.zeros(len(faces), dtype=np.bool_)
    kept[able[np.unique(index[able], return_index=True)[1]]] = True
    kept &= ~empty[index]
    return faces[kept], int((~kept & ~empty[index]).sum()), int(empty[index].sum())


def without_flaps(points: Floats, faces: Integers) -> tuple[Integers, int, int]:
    """Leave out patches that hang on edges with more than two faces; also return their number and that of faces."""
    area = areas_of(points[faces])
    most, patches, before = MOST_AREA * float(area.sum()), 0, len(faces)
    while True:
        label = shell_labels(points, faces)
        _, _, edge, uses = half_edges(faces, len(points))
        of = uses[edge].reshape(-1, 3)
        count = int(label.max(initial=-1)) + 1
        crowded = np.bincount(label, weights=(of > 2).any(axis=1), minlength=count) > 0
        hanging = crowded & (np.bincount(label, weights=(of == 1).any(axis=1), minlength=count) > 0)
        even = np.bincount(label, weights=((of > 2) & (of % 2 == 0)).any(axis=1), minlength=count) > 0
        size = np.bincount(label, weights=area, minlength=count)
        able = np.flatnonzero((hanging | (crowded & ~even)) & (size <= most))
        if not len(able):
            return faces, patches, before - len(faces)
        kept = label != able[size[able].argmin()]
        faces, area, patches = faces[kept], area[kept], patches + 1


def without_pinches(points: Floats, faces: Integers) -> tuple[Integers, int]:
    """Cut out the faces at edges that have more than two, where a surface touches itself; also return their number.

    None is cut out where it would be more than a tenth of the surface. The holes are closed later.
    """
    _, _, edge, uses = half_edges(faces, len(points))
    out = (uses[edge].reshape(-1, 3) > 2).any(axis=1)
    area = areas_of(points[faces])
    if area[out].sum() > MOST_AREA * area.sum():
        return faces, 0
    return faces[~out], int(out.sum())


def wound_alike(faces: Integers, vertex_count: int) -> tuple[Integers, int]:
    """Turn over the faces wound against their neighbours, in each shell the fewer ones; also return their number.

    Raises
    ------
    DirtyMeshError
        If no orientation is consistent, as on a Moebius band.
    """
    turned = turned_faces(faces, vertex_count)
    if turned is None:
        raise DirtyMeshError(
            f"the mesh has a surface with one side only among its {len(faces)} faces: a solid has an inside and an "
            "outside; cut it where it crosses over"
        )
    return np.ascontiguousarray(np.where(turned[:, None], faces[:, ::-1], faces)), int(turned.sum())
