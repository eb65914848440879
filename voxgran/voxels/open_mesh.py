"""Voxels of triangles that do not bound one clean solid: parts that overlap, small holes, faces wound against the rest.

Where every edge has as many faces one way as the other, the winding number is whole, and a center is inside where it is
above 0: overlapping parts count once. Where edges are open, columns count along six directions and vote; where they
disagree the generalized winding number decides (Jacobson, Kavan & Sorkine-Hornung 2013, doi:10.1145/2461912.2461916).
It is found without adding up all faces: the open edges are the boundary of a fan of few triangles, the surface with
the fan is closed and has whole winding numbers by columns, and those of the fan are subtracted.
"""

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import Booleans, Floats, Integers, as_faces, as_length, as_points
from voxgran._base.calls import explained
from voxgran._base.errors import DirtyMeshWarning, InputError, TooLargeError, warn
from voxgran.lattice.grid import Grid
from voxgran.lattice.label import components
from voxgran.lattice.packed import PackedMask
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.repairing.bodies import outward
from voxgran.shapes.repairing.diagnose import merged
from voxgran.shapes.repairing.patches import one_sided
from voxgran.shapes.shells import turned_faces
from voxgran.shapes.winding import winding_numbers
from voxgran.voxels.model import Voxels
from voxgran.voxels.scanline import winding_slabs

#: most voxels of one image
MOST_VOXELS = 2**31


@explained(hint="voxelize_mesh(vertices, faces, voxel_size=0.1)")
def voxelize_mesh(
    vertices: "ArrayLike", faces: "ArrayLike", *, voxel_size: float | None = None, grid: Grid | None = None
) -> Voxels:
    """Return the voxels whose center lies in what triangles enclose, clean or not.

    Parameters
    ----------
    vertices : (n, 3) array_like of float
        Corner points, in the unit of lengths; coincident ones are merged.
    faces : (m, 3) array_like of int
        Triangles, counterclockwise seen from outside. Closed parts may overlap: their union is taken. Small holes are
        settled by the generalized winding number, with a warning that states how many voxels were in doubt.
    voxel_size : float, optional
        Edge of a voxel, in the unit of lengths, for a lattice with a corner at the coordinates' origin.
    grid : Grid, optional
        A lattice instead; what lies beyond it is left out.

    Returns
    -------
    Voxels
        `open_columns` and `doubtful_voxels` tell of holes.

    Raises
    ------
    InputError
        If an array has the wrong shape or holds what is not finite, there are no faces, the voxel size is not above 0,
        or not exactly one of voxel size and lattice is given.
    TooLargeError
        If there would be more than 2**31 voxels.

    Warns
    -----
    DirtyMeshWarning
        If edges are open, or wound against their neighbours, or a surface has two sides.

    Examples
    --------
    >>> import voxgran as vg
    >>> cube = vg.make_shape("box", aspect=(1, 1, 1))
    >>> edge = cube.volume ** (1 / 3)
    >>> import numpy as np
    >>> both = np.concatenate([cube.vertices, cube.vertices + [edge / 2, 0, 0]])
    >>> faces = np.concatenate([cube.faces, cube.faces + len(cube.vertices)])
    >>> voxels = vg.voxelize_mesh(both, faces, voxel_size=edge / 8)
    >>> int(voxels.mask.sum()) == 8 * 8 * 12
    True
    """
    points = as_points(vertices, "vertices")
    triangles = as_faces(faces, len(points))
    if not len(triangles):
        raise InputError("faces has no rows: a solid needs at least four triangles; check the mesh")
    if (voxel_size is None) == (grid is None):
        raise InputError("voxel_size and grid: give exactly one of them")
    corners, triangles = merged(points, triangles)
    triangles, second = one_sided(triangles, len(corners))
    if second:
        warn(
            f"the mesh has {second} faces both ways round, whose second side was left out: mend it with voxgran.repair",
            DirtyMeshWarning,
        )
    if grid is None:
        size = as_length(voxel_size, "voxel_size") if voxel_size is not None else 1.0
        low, high = corners.min(axis=0), corners.max(axis=0)
        if not float(libm.log2(np.maximum((high - low) / size, 1.0)).sum()) < libm.log2(MOST_VOXELS):
            raise TooLargeError(
                f"voxel_size is {size}: there would be more than {MOST_VOXELS} voxels; make them larger"
            )
        grid = Grid.around(low, high, size)
    triangles, turned = _wound_alike(corners, triangles)
    inner = (corners - np.array(grid.origin)) / grid.voxel_size
    rim = open_edges(triangles)
    bits, columns = _wound(inner, triangles, grid.shape)
    doubtful = 0
    if turned and not len(rim):
        warn(
            f"the mesh had {turned} faces wound against their neighbours, which were turned over: mend it with "
            "voxgran.repair",
            DirtyMeshWarning,
        )
    if len(rim):
        bits, doubtful = _voted(inner, triangles, rim, grid.shape)
        warn(
            f"the mesh has {len(rim)} open or oppositely wound edges, and {columns} columns of voxels end inside: "
            f"{doubtful} voxels in doubt were settled by the generalized winding number; mend it with voxgran.repair "
            "where that matters",
            DirtyMeshWarning,
        )
    return Voxels(
        bits, np.array(grid.origin), grid.voxel_size, open_columns=columns, doubtful_voxels=doubtful,
    )  # fmt: skip


def _wound_alike(corners: Floats, faces: Integers) -> tuple[Integers, int]:
    """Return faces that are wound as their neighbours are, outward, and how many were not."""
    turned = turned_faces(faces, len(corners)) if len(open_edges(faces)) else None
    many = 0
    if turned is not None:
        many = int(np.count_nonzero(turned))
        faces = np.ascontiguousarray(np.where(turned[:, None], faces[:, ::-1], faces))
        if many and not len(open_edges(faces)):
            faces = outward(corners, faces)[0]
    if Mesh(corners.copy(), faces.copy()).volume < 0:
        faces = np.ascontiguousarray(faces[:, ::-1])
    return faces, many


def open_edges(faces: Integers) -> Integers:
    """Return the edges (n, 2) that faces run along more often one way than the other, as often as that is."""
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    ends = ends[ends[:, 0] != ends[:, 1]]
    low, high = ends.min(axis=1), ends.max(axis=1)
    edges, which = np.unique(np.column_stack([low, high]), axis=0, return_inverse=True)
    net = np.bincount(which.reshape(-1), weights=np.where(ends[:, 0] == low, 1, -1), minlength=len(edges))
    excess = net.astype(np.int64)
    directed = np.where((excess > 0)[:, None], edges, edges[:, ::-1])
    return np.repeat(directed, np.abs(excess), axis=0)


def _wound(inner: Floats, faces: Integers, counts: tuple[int, int, int]) -> tuple[PackedMask, int]:
    """Return the voxels whose winding number, counted from below, is above 0, and the number of open columns."""
    bits, columns = PackedMask.empty(counts), 0
    for begin, numbers, total in winding_slabs(inner, faces, counts):
        bits.words[begin : begin + len(numbers)] = PackedMask.from_mask(numbers > 0).words
        columns += int(np.count_nonzero(total))
    return bits, columns


def _voted(inner: Floats, faces: Integers, rim: Integers, counts: tuple[int, int, int]) -> tuple[PackedMask, int]:
    """Return the voxels by the vote of six directions, and how many the generalized winding number had to settle."""
    votes = np.zeros(counts, dtype=np.uint8)
    for axis in range(3):
        turn = [(axis + 1) % 3, (axis + 2) % 3, axis]
        turned = votes.transpose(turn)
        corners = np.ascontiguousarray(inner[:, turn])
        for begin, numbers, total in winding_slabs(corners, faces, (turned.shape[0], turned.shape[1], turned.shape[2])):
            slab = turned[begin : begin + len(numbers)]
            slab += numbers > 0
            slab += numbers > total[:, :, None]
    inside: Booleans = votes >= 3
    doubtful = np.argwhere((votes > 0) & (votes < 6))
    if len(doubtful):
        inside[tuple(doubtful.T)] = _winding_about(inner, faces, rim, counts, doubtful) > 0.5
    return PackedMask.from_mask(inside), len(doubtful)


def _winding_about(
    inner: Floats, faces: Integers, rim: Integers, counts: tuple[int, int, int], voxels: Integers
) -> Floats:
    """Return the generalized winding numbers of an open surface about voxel centers: of the closed one less the fan."""
    corners, fan = _fan(inner, rim)
    whole = np.zeros(len(voxels))
    order = np.argsort(voxels[:, 0], kind="stable")
    planes = voxels[order, 0]
    for begin, numbers, _ in winding_slabs(corners, np.concatenate([faces, fan]), counts):
        part = order[np.searchsorted(planes, begin) : np.searchsorted(planes, begin + len(numbers))]
        i, j, k = voxels[part].T
        whole[part] = numbers[i - begin, j, k]
    return whole - winding_numbers(corners[fan], voxels.astype(np.float64) + 0.5)


def _fan(inner: Floats, rim: Integers) -> tuple[Floats, Integers]:
    """Return corners and triangles that close a surface: of each connected rim to the mean of its corners."""
    label = components(len(inner), *rim.T)
    names, body = np.unique(label[rim[:, 0]], return_inverse=True)
    count = np.bincount(body, minlength=len(names))
    tips = np.stack([np.bincount(body, weights=inner[rim[:, 0], k], minlength=len(names)) / count for k in range(3)], 1)
    fan = np.column_stack([rim[:, 1], rim[:, 0], len(inner) + body])
    return np.concatenate([inner, tips]), fan.astype(np.int64)
