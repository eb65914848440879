"""Shares of voxels: which part of each voxel is solid, kept for cut voxels and whole runs only.

Of a closed mesh the shares are exact to round-off. Each triangle is cut along the faces of the voxels; below a piece
lies, by the divergence theorem, its shadow times its height in its own voxel and its shadow in each voxel beneath.
Summed over all pieces of a column, with the sign of their normals, that is the solid volume of each voxel.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import kernel
from voxgran.lattice.packed import PackedMask

#: pieces of triangles that are in memory at a time: bounds the memory beside the result
PIECES = 2**18
#: voxels that are unpacked at a time in the search for runs
SLAB = 2**20
#: error of the shares of a mesh, from round-off
ERROR = 1e-12


@dataclass(frozen=True, eq=False, slots=True)
class Shares:
    """The solid part of each voxel, sparse."""

    shape: tuple[int, int, int]  # number of voxels along x, y, z
    cut: NDArray[np.int32]  # (n, 3) partly solid voxels, along z in each column, columns in the order of the lattice
    share: Floats  # (n,) their solid part, above 0 and below 1
    # (m, 4) whole voxels: indices x and y of a column, first index z and the one behind the last
    runs: NDArray[np.int32]
    error: float  # root mean square error of the shares of cut voxels

    @property
    def total(self) -> float:
        """Solid volume in voxels."""
        return float(self.share.sum() + (self.runs[:, 3] - self.runs[:, 2]).sum(dtype=np.int64))

    def dense(self, out: NDArray[Any] | None = None) -> Any:
        """Return the (nx, ny, nz) shares, float64, or written to `out` where that is given."""
        image = np.zeros(self.shape) if out is None else out
        if out is not None:
            out[...] = 0
        for i, j, first, behind in self.runs.tolist():
            image[i, j, first:behind] = 1
        image[tuple(self.cut.T)] = self.share
        return image

    @classmethod
    def from_array(cls, share: Floats, error: float) -> "Shares":
        """Return the sparse form of dense shares."""
        cut = (share > 0) & (share < 1)
        nx, ny, nz = share.shape
        whole = PackedMask.from_mask(share >= 1)
        return cls((nx, ny, nz), np.argwhere(cut).astype(np.int32), share[cut], runs_of(whole), error)

    @classmethod
    def joined(cls, inside: PackedMask, cut: Integers, part: Floats, error: float) -> "Shares":
        """Return shares from the voxels with centers inside and the parts (n,), 0 and 1 included, of voxels that may be
        cut.

        `cut` (n, 3) increases in the order of the lattice, and `error` is the root mean square error of the parts.
        """
        whole = PackedMask(inside.words.copy(), inside.shape)
        set_bits(whole.words, cut, part >= 1)
        some = (part > 0) & (part < 1)
        return cls(inside.shape, cut[some].astype(np.int32), part[some], runs_of(whole), error)


def runs_of(bits: PackedMask) -> NDArray[np.int32]:
    """Return the runs of taken voxels along z: indices x and y, first index z and the one behind the last, (m, 4)."""
    found, thick = [np.zeros((0, 4), dtype=np.int32)], max(1, SLAB // max(1, bits.shape[1] * bits.shape[2]))
    for begin in range(0, bits.shape[0], thick):
        words = np.ascontiguousarray(bits.words[begin : begin + thick])
        mask = np.unpackbits(words.view(np.uint8), axis=2, count=bits.shape[2], bitorder="little").view(np.int8)
        edges = np.diff(mask, axis=2, prepend=np.int8(0), append=np.int8(0))
        start, end = np.argwhere(edges == 1), np.argwhere(edges == -1)
        found.append(np.column_stack([start[:, 0] + begin, start[:, 1:], end[:, 2]]).astype(np.int32))
    return np.concatenate(found)


def mesh_shares(vertices: Floats, faces: Integers, counts: tuple[int, int, int]) -> Shares:
    """Return the shares of a closed mesh, accurate to about 1e-13 on lattices of up to 1000 voxels along an edge.

    Vertices are in voxels from the corner of a lattice of `counts` voxels; triangles are outward.
    """
    column, level, shadow, below = _all_pieces(vertices, faces, counts)
    order = np.argsort(column, kind="stable")
    bounds = np.searchsorted(column[order], np.arange(counts[0] * counts[1] + 1))
    arguments = level[order], shadow[order], below[order], bounds, counts[1], counts[2]
    sizes = _sum_columns(*arguments, np.zeros((0, 3), np.int32), np.zeros(0), np.zeros((0, 4), np.int32))
    cut, share = np.zeros((sizes[0], 3), np.int32), np.zeros(sizes[0])
    runs = np.zeros((sizes[1], 4), np.int32)
    _sum_columns(*arguments, cut, share, runs)
    return Shares(counts, cut, share, runs, ERROR)


def _all_pieces(
    vertices: Floats, faces: Integers, counts: tuple[int, int, int]
) -> tuple[Integers, NDArray[np.int32], Floats, Floats]:
    """Return column, level, shadow and volume below, within its voxel, of each piece of a triangle in a voxel."""
    found: list[tuple[Integers, NDArray[np.int32], Floats, Floats]] = []
    face = skip = 0
    limit = np.array(counts)
    column, level = np.empty(PIECES, np.int64), np.empty(PIECES, np.int32)
    shadow, below = np.empty(PIECES), np.empty(PIECES)
    while not found or face < len(faces):
        # a triangle with more pieces than fit is divided again, without the pieces that are recorded
        face, skip, many = _cut_triangles(vertices, faces, limit, face, skip, column, level, shadow, below)
        found.append((column[:many].copy(), level[:many].copy(), shadow[:many].copy(), below[:many].copy()))
    columns, levels, shadows, belows = zip(*found, strict=True)
    return np.concatenate(columns), np.concatenate(levels), np.concatenate(shadows), np.concatenate(belows)


@kernel
def set_bits(words: NDArray[np.uint64], voxels: Integers, values: NDArray[np.bool_]) -> None:
    """Set or clear the bits of some voxels."""
    for v in range(len(voxels)):
        i, j, k = voxels[v, 0], voxels[v, 1], voxels[v, 2]
        bit = np.uint64(1) << np.uint64(k & 63)
        words[i, j, k >> 6] = words[i, j, k >> 6] | bit if values[v] else words[i, j, k >> 6] & ~bit


@kernel
def _divide(points, many, axis, level, low, high):  # type: ignore[no-untyped-def]
    """Divide a convex polygon by the plane where a coordinate has a value; return how many corners each part has."""
    below, above = 0, 0
    for p in range(many):
        q = p + 1 if p + 1 < many else 0
        here, there = points[p, axis] - level, points[q, axis] - level
        if here <= 0.0:
            low[below, 0], low[below, 1], low[below, 2] = points[p, 0], points[p, 1], points[p, 2]
            below += 1
        if here >= 0.0:
            high[above, 0], high[above, 1], high[above, 2] = points[p, 0], points[p, 1], points[p, 2]
            above += 1
        if (here < 0.0 and there > 0.0) or (here > 0.0 and there < 0.0):
            # from below to above, so that both triangles of an edge are cut at the same bits
            a, b = (p, q) if here < there else (q, p)
            t = (level - points[a, axis]) / (points[b, axis] - points[a, axis])
            for k in range(3):
                low[below, k] = points[a, k] + t * (points[b, k] - points[a, k])
            low[below, axis] = level
            high[above, 0], high[above, 1], high[above, 2] = low[below, 0], low[below, 1], low[below, 2]
            below += 1
            above += 1
    return below, above


@kernel
def _copy(points, many, other):  # type: ignore[no-untyped-def]
    """Copy the corners of a polygon."""
    for p in range(many):
        other[p, 0], other[p, 1], other[p, 2] = points[p, 0], points[p, 1], points[p, 2]


@kernel
def _span(points, many, axis):  # type: ignore[no-untyped-def]
    """Return the least and largest coordinate of a polygon along an axis."""
    low, high = points[0, axis], points[0, axis]
    for p in range(1, many):
        low, high = min(low, points[p, axis]), max(high, points[p, axis])
    return low, high


@kernel
def _take_layer(points, many, axis, layer, low, high):  # type: ignore[no-untyped-def]
    """Part a polygon at the upper face of a layer; what lies below goes to `low`, the rest to `high`."""
    if _span(points, many, axis)[1] > layer + 1.0:
        return _divide(points, many, axis, layer + 1.0, low, high)
    _copy(points, many, low)
    return many, 0


@kernel
def _enter(points, many, axis, spare):  # type: ignore[no-untyped-def]
    """Cut away what lies below 0 along an axis; return the corners left and the first layer."""
    low = _span(points, many, axis)[0]
    if low < 0.0:
        many = _divide(points, many, axis, 0.0, spare[0], spare[1])[1]
        _copy(spare[1], many, points)
        return many, 0
    return many, int(min(np.floor(low), 9.0e15))


@kernel
def _shadow(points, many, level):  # type: ignore[no-untyped-def]
    """Return the area of a polygon seen along z, above 0 for an upward face, and that times its height over a level."""
    area, moment = 0.0, 0.0
    x, y, z = points[0, 0], points[0, 1], points[0, 2] - level
    for p in range(1, many - 1):
        part = (points[p, 0] - x) * (points[p + 1, 1] - y) - (points[p + 1, 0] - x) * (points[p, 1] - y)
        area += 0.5 * part
        moment += part / 6.0 * (z + points[p, 2] - level + points[p + 1, 2] - level)
    return area, moment


@kernel
def _cut_triangles(vertices, faces, counts, face, skip, column, level, shadow, below):  # type: ignore[no-untyped-def]
    """Note the pieces of triangles from one on, as long as there is room; return where to go on and how many."""
    nx, ny, nz = counts[0], counts[1], counts[2]
    spare = np.empty((2, 12, 3))
    work = np.empty((7, 12, 3))
    rest, plane, plane_rest = work[0], work[1], work[2]
    row, row_rest, piece, piece_rest = work[3], work[4], work[5], work[6]
    noted = 0
    for f in range(face, len(faces)):
        seen = 0
        for p in range(3):
            for k in range(3):
                rest[p, k] = vertices[faces[f, p], k]
        many, i = _enter(rest, 3, 0, spare)
        while many >= 3 and i < nx:
            in_plane, many = _take_layer(rest, many, 0, float(i), plane, plane_rest)
            _copy(plane_rest, many, rest)
            j = 0
            if in_plane >= 3:
                in_plane, j = _enter(plane, in_plane, 1, spare)
            while in_plane >= 3 and j < ny:
                in_row, in_plane = _take_layer(plane, in_plane, 1, float(j), row, row_rest)
                _copy(row_rest, in_plane, plane)
                k = 0
                if in_row >= 3:
                    in_row, k = _enter(row, in_row, 2, spare)
                while in_row >= 3:
                    if k < nz:
                        corners, in_row = _take_layer(row, in_row, 2, float(k), piece, piece_rest)
                    else:
                        # above the lattice only the shadow counts
                        k, corners, in_row = nz, in_row, 0
                        _copy(row, corners, piece)
                    _copy(piece_rest, in_row, row)
                    area, moment = _shadow(piece, corners, float(k)) if corners >= 3 else (0.0, 0.0)
                    if area != 0.0 or moment != 0.0:
                        seen += 1
                        if seen > skip:
                            if noted == len(column):
                                return f, seen - 1, noted
                            column[noted], level[noted] = i * ny + j, k
                            shadow[noted], below[noted] = area, moment
                            noted += 1
                    k += 1
                j += 1
            i += 1
        skip = 0
    return len(faces), 0, noted


@kernel
def _sum_columns(level, shadow, below, bounds, ny, nz, cut, share, runs):  # type: ignore[no-untyped-def]
    """Sum the pieces of each column from the top; count cut voxels and runs, and record those that fit."""
    area, moment = np.zeros(nz + 1), np.zeros(nz + 1)
    cuts, whole = 0, 0
    for column in range(len(bounds) - 1):
        first, last, size = nz + 1, -1, 0.0
        for p in range(bounds[column], bounds[column + 1]):
            k = level[p]
            area[k] += shadow[p]
            moment[k] += below[p]
            first, last, size = min(first, k), max(last, k), size + abs(shadow[p])
        noise = 4e-16 * size * (4.0 + bounds[column + 1] - bounds[column])
        # beneath the lowest piece nothing changes: a surface that is closed leaves nothing there, or it fills it
        covered, end, begun, lowest = 0.0, 0, cuts, 0
        for k in range(last, -1, -1):
            if k < first and covered <= noise:
                lowest = k + 1
                break
            part = covered + moment[k] if k < nz else 0.0
            covered += area[k]
            area[k], moment[k] = 0.0, 0.0
            if part >= 1.0 - noise:
                if not end:
                    end = k + 1
                continue
            if end:
                if whole < len(runs):
                    runs[whole, 0], runs[whole, 1] = column // ny, column % ny
                    runs[whole, 2], runs[whole, 3] = k + 1, end
                whole += 1
                end = 0
            if part > noise:
                if cuts < len(cut):
                    cut[cuts, 0], cut[cuts, 1], cut[cuts, 2] = column // ny, column % ny, k
                    share[cuts] = part
                cuts += 1
        if end:
            if whole < len(runs):
                runs[whole, 0], runs[whole, 1] = column // ny, column % ny
                runs[whole, 2], runs[whole, 3] = lowest, end
            whole += 1
        _turn(cut, share, begun, min(cuts, len(cut)))
    return cuts, whole


@kernel
def _turn(cut, share, begin, end):  # type: ignore[no-untyped-def]
    """Reverse the order of some rows, so that they rise along z."""
    for p in range((end - begin) // 2):
        a, b = begin + p, end - 1 - p
        cut[a, 2], cut[b, 2] = cut[b, 2], cut[a, 2]
        share[a], share[b] = share[b], share[a]
