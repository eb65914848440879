"""Shares of voxels of any shape: exact for meshes, regular solids and outlines, nearly so for unions of spheres."""

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran.lattice.grid import Grid
from voxgran.lattice.packed import PackedMask
from voxgran.shapes.describing.body import Geometry
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.spheres import Spheres
from voxgran.voxels.closed_form import body_frame, profile, round_bits, spheres_bits, touched_round
from voxgran.voxels.round_shares import disk_shares, round_shares, union_shares
from voxgran.voxels.shares import ERROR, Shares, mesh_shares

#: root mean square error of the shares of voxels that several spheres touch (measured)
UNION_ERROR = 5e-4


def voxel_shares(geometry: Geometry, grid: Grid, offset: Floats) -> Shares:
    """Return the share of each voxel that is solid, for a geometry (no open surface) with its origin at an offset,
    (3,).
    """
    start = np.array(grid.origin)
    if isinstance(geometry, Mesh):
        return mesh_shares((geometry.vertices + offset - start) / grid.voxel_size, geometry.faces, grid.shape)
    if isinstance(geometry, Outline):
        return _outline_shares(geometry.moved(offset), grid)
    if isinstance(geometry, Spheres):
        return _sphere_shares(geometry.centers + offset, geometry.radii, grid)
    assert isinstance(geometry, Primitive)
    if geometry.kind == "box":
        vertices, faces, _ = geometry.tessellation()
        return mesh_shares((vertices + offset - start) / grid.voxel_size, faces, grid.shape)
    touched = touched_round(geometry, grid, offset)
    inside = round_bits(geometry, grid, offset)
    cut = np.argwhere(PackedMask(touched.words & ~_whole(geometry, grid, offset).words, grid.shape).unpacked())
    stretch, curve, ends = body_frame(geometry, *profile(geometry), grid.voxel_size)
    middles = cut + 0.5 - (offset - start) / grid.voxel_size
    return Shares.joined(inside, cut, _settled(round_shares(middles, stretch, curve, ends)), ERROR)


def _whole(solid: Primitive, grid: Grid, offset: Floats) -> PackedMask:
    """Return voxels that a convex solid holds whole: those whose eight corners it holds."""
    half = grid.voxel_size / 2
    x, y, z = (value - half for value in grid.origin)
    nx, ny, nz = grid.shape
    words = round_bits(solid, Grid((x, y, z), grid.voxel_size, (nx + 1, ny + 1, nz + 1)), offset).words
    both = words[:-1] & words[1:]
    both = both[:, :-1] & both[:, 1:]
    above = both >> np.uint64(1)
    above[:, :, :-1] |= both[:, :, 1:] << np.uint64(63)
    return PackedMask(np.ascontiguousarray((both & above)[:, :, : -(-nz // 64)]), grid.shape)


def _settled(part: Floats) -> Floats:
    """Return parts without the round-off of voxels that are empty or whole, however small the body is."""
    noise = ERROR / 10
    return np.where(part < noise * min(1.0, float(part.sum())), 0.0, np.where(part > 1 - noise, 1.0, part))


def _outline_shares(outline: Outline, grid: Grid) -> Shares:
    """Return the share of each pixel of an outline: as the shadow of its triangles, or of a disk in closed form."""
    start = np.array(grid.origin)
    if outline.kind == "polygon":
        vertices, faces, _ = outline.tessellation()
        flat = (vertices - start) / grid.voxel_size
        flat[:, 2] = grid.shape[2] + 1.0
        return mesh_shares(flat, faces, grid.shape)
    middle = (np.array(outline.center) - start[:2]) / grid.voxel_size
    pixels = np.argwhere(np.ones(grid.shape[:2], dtype=np.bool_))
    share = disk_shares(pixels + 0.5 - middle, outline.radius / grid.voxel_size).reshape(grid.shape)
    return Shares.from_array(_settled(share), ERROR)


def _sphere_shares(centers: Floats, radii: Floats, grid: Grid) -> Shares:
    """Return the shares of a union of spheres: exact where one sphere cuts a voxel, from columns where several do."""
    whole = spheres_bits(centers, radii, grid, cover="whole")
    inside = spheres_bits(centers, radii, grid, cover="center")
    inner, sizes = (centers - np.array(grid.origin)) / grid.voxel_size, radii / grid.voxel_size
    place, sphere = _cut_by(inner, sizes, grid, whole)
    order = np.argsort(place, kind="stable")
    place, sphere = place[order], sphere[order]
    voxels, start = np.unique(place, return_index=True)
    bounds = np.append(start, len(place))
    middles = np.column_stack(np.unravel_index(voxels, grid.shape)).astype(np.float64) + 0.5
    share = np.zeros(len(voxels))
    single = np.diff(bounds) == 1
    for b in np.unique(sphere):
        own = np.flatnonzero(single)[sphere[start[single]] == b]
        frame = np.eye(3) / sizes[b]
        share[own] = round_shares(middles[own] - inner[b], frame, np.array([1.0, 0.0, -1.0]), np.array([-1.0, 1.0]))
    several = np.flatnonzero(~single)
    if len(several):
        counts = np.diff(bounds)[several]
        members = np.concatenate([sphere[bounds[v] : bounds[v + 1]] for v in several])
        ends = np.concatenate([[0], np.cumsum(counts)])
        share[several] = union_shares(middles[several], ends, inner[members], sizes[members])
    cut = np.column_stack(np.unravel_index(voxels, grid.shape))
    return Shares.joined(inside, cut, _settled(share), UNION_ERROR if len(several) else ERROR)


def _cut_by(inner: Floats, sizes: Floats, grid: Grid, whole: PackedMask) -> tuple[Integers, Integers]:
    """Return flat voxel indices and spheres, one pair for each voxel that a sphere touches and none holds."""
    taken, places, spheres = whole.unpacked(), [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    for b, (middle, size) in enumerate(zip(inner, sizes, strict=True)):
        low = np.clip(np.floor(middle - size).astype(np.int64) - 1, 0, grid.shape)
        high = np.clip(np.ceil(middle + size).astype(np.int64) + 1, low, grid.shape)
        window = Grid((0.0, 0.0, 0.0), 1.0, (int(high[0] - low[0]), int(high[1] - low[1]), int(high[2] - low[2])))
        if not window.voxel_count:
            continue
        touched = spheres_bits((middle - low)[None], size[None], window, cover="touch").unpacked()
        touched &= ~taken[tuple(slice(a, z) for a, z in zip(low, high, strict=True))]
        found = np.argwhere(touched) + low
        places.append(np.ravel_multi_index(tuple(found.T), grid.shape))
        spheres.append(np.full(len(found), b))
    return np.concatenate(places), np.concatenate(spheres)
