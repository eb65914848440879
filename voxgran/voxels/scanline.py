"""Columns of a lattice through a closed surface: inside by parity, and shares of voxels with exact heights.

A plane of columns cuts each triangle in a segment, and each column that the segment spans meets the triangle at one
height. The ends of the segment lie on edges of the triangle and are computed from left to right, whichever triangle
asks; so both triangles of an edge get the same bits, and half-open ranges give every column an even number of
crossings: a closed surface cannot leak. Columns lie along z. A center that lies on the surface counts as if it lay an
infinitesimal step further along x, y and z.
"""

import numpy as np

from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.kernels import kernel


def centers_inside(vertices: Floats, faces: Integers, counts: tuple[int, int, int]) -> Booleans:
    """Return the voxels whose center a closed surface holds, by parity.

    Parameters
    ----------
    vertices : (n, 3) ndarray of float
        Corner points, in voxels from the corner of the lattice.
    faces : (m, 3) ndarray of int
        Triangles.
    counts : tuple of int
        Number of voxels along each axis; what lies beyond is left out.

    Returns
    -------
    (nx, ny, nz) ndarray of bool
    """
    mask = np.zeros(counts, dtype=np.bool_)
    _fill_inside(vertices - 0.5, faces, mask)
    return mask


def column_shares(vertices: Floats, faces: Integers, counts: tuple[int, int, int], columns: int) -> Floats:
    """Return the share of each voxel that a closed surface holds, from columns x columns columns through a voxel.

    Along z the length inside is exact; so the error is that of a rule of midpoints in two dimensions instead of three.

    Parameters
    ----------
    vertices : (n, 3) ndarray of float
        Corner points, in voxels from the corner of the lattice.
    faces : (m, 3) ndarray of int
        Triangles, counterclockwise seen from outside.
    counts : tuple of int
        Number of voxels along each axis; what lies beyond is left out.
    columns : int
        Columns along each edge of a voxel.

    Returns
    -------
    (nx, ny, nz) ndarray of float
    """
    share = np.zeros(counts)
    stretched = vertices * np.array([columns, columns, 1.0]) - np.array([0.5, 0.5, 0.0])
    _add_shares(stretched, faces, columns, share)
    return np.asarray(np.cumsum(share, axis=2, out=share) / columns**2)


@kernel
def _crossing(vertices, left, right, x):  # type: ignore[no-untyped-def]
    """Return y and z where the edge from a vertex at most at x to one beyond it passes x."""
    t = (x - vertices[left, 0]) / (vertices[right, 0] - vertices[left, 0])
    y = vertices[left, 1] + t * (vertices[right, 1] - vertices[left, 1])
    return y, vertices[left, 2] + t * (vertices[right, 2] - vertices[left, 2])


@kernel
def _segment(vertices, a, b, c, x):  # type: ignore[no-untyped-def]
    """Return the lower and upper end (y, z) of a triangle's cut at x, and whether its normal points along +z."""
    left_a, left_b, left_c = vertices[a, 0] <= x, vertices[b, 0] <= x, vertices[c, 0] <= x
    # the vertex that is alone on its side, then the others in the order of the face
    if left_a == left_b:
        alone, after, before, left = c, a, b, left_c
    elif left_a == left_c:
        alone, after, before, left = b, c, a, left_b
    else:
        alone, after, before, left = a, b, c, left_a
    if left:
        y_1, z_1 = _crossing(vertices, alone, after, x)
        y_2, z_2 = _crossing(vertices, alone, before, x)
    else:
        y_1, z_1 = _crossing(vertices, after, alone, x)
        y_2, z_2 = _crossing(vertices, before, alone, x)
    if y_1 <= y_2:
        return y_1, z_1, y_2, z_2, left
    return y_2, z_2, y_1, z_1, not left


@kernel
def _first_last(low, high, count):  # type: ignore[no-untyped-def]
    """Return the first whole number from `low` on, and the last one below `high`, of 0 ... count - 1."""
    return int(min(max(np.ceil(low), 0.0), count)), int(max(min(np.ceil(high) - 1.0, count - 1.0), -1.0))


@kernel
def _height(y_1, z_1, y_2, z_2, y):  # type: ignore[no-untyped-def]
    """Return z on a segment at y, never beyond its ends."""
    z = z_1 + (y - y_1) / (y_2 - y_1) * (z_2 - z_1)
    return min(max(z, min(z_1, z_2)), max(z_1, z_2))


@kernel
def _fill_inside(vertices, faces, mask):  # type: ignore[no-untyped-def]
    """Toggle every column where it crosses a triangle, then carry the parity upward; centers at whole numbers."""
    nx, ny, nz = mask.shape
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        xa, xb, xc = vertices[a, 0], vertices[b, 0], vertices[c, 0]
        first, last = _first_last(min(xa, xb, xc), max(xa, xb, xc), nx)
        for i in range(first, last + 1):
            y_1, z_1, y_2, z_2, _ = _segment(vertices, a, b, c, float(i))
            lowest, highest = _first_last(y_1, y_2, ny)
            for j in range(lowest, highest + 1):
                k = max(np.ceil(_height(y_1, z_1, y_2, z_2, float(j))), 0.0)
                if k < nz:
                    mask[i, j, int(k)] ^= True
    for i in range(nx):
        for j in range(ny):
            inside = False
            for k in range(nz):
                inside ^= mask[i, j, k]
                mask[i, j, k] = inside


@kernel
def _add_shares(vertices, faces, columns, share):  # type: ignore[no-untyped-def]
    """Note at each crossing how the covered length of the voxels from there upward changes."""
    nx, ny, nz = share.shape
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        xa, xb, xc = vertices[a, 0], vertices[b, 0], vertices[c, 0]
        first, last = _first_last(min(xa, xb, xc), max(xa, xb, xc), nx * columns)
        for i in range(first, last + 1):
            y_1, z_1, y_2, z_2, leaving = _segment(vertices, a, b, c, float(i))
            sign = -1.0 if leaving else 1.0
            lowest, highest = _first_last(y_1, y_2, ny * columns)
            for j in range(lowest, highest + 1):
                z = max(_height(y_1, z_1, y_2, z_2, float(j)), 0.0)
                if z < nz:
                    k = int(z)
                    share[i // columns, j // columns, k] += sign * (k + 1.0 - z)
                    if k + 1 < nz:
                        share[i // columns, j // columns, k + 1] += sign * (z - k)
