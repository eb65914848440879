"""Which voxels of a lattice a solid takes, and which share of each.

A voxel is taken when its center is inside; a center on the surface of a mesh counts as if it lay an infinitesimal step
further along x, y and z, so that solids that touch share no voxel. Open3D, which has no such rule and computes in
single precision, decides only the centers that are not near the surface. Both backends therefore give the same voxels.

Shares are exact for meshes, regular solids and outlines, nearly so for unions of spheres.
"""

import os
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import (
    Booleans,
    Floats,
    Integers,
    as_choice,
    as_length,
    as_positive,
    as_quaternions,
    as_vector,
    check_type,
)
from voxgran._base.calls import explained
from voxgran._base.compiling.threads import using_threads
from voxgran._base.errors import InputError, TooLargeError, UnknownNameError, unknown
from voxgran._base.files import as_path, refuse_to_replace, written_whole
from voxgran.geometry.rotation import rotation_matrices
from voxgran.lattice.grid import Grid
from voxgran.lattice.packed import PackedMask
from voxgran.shapes.describing.body import Geometry
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.spheres import Spheres
from voxgran.voxels.backend_open3d import ROUND_OFF, open3d_inside
from voxgran.voxels.closed_form import (
    centers_in_round,
    outline_mask,
    round_bits,
    round_parts,
    spheres_bits,
    touched_round,
)
from voxgran.voxels.model import Voxels
from voxgran.voxels.round_shares import disk_shares, round_shares, union_shares
from voxgran.voxels.scanline import scanline_inside
from voxgran.voxels.shares import ERROR, Shares, mesh_shares
from voxgran.voxels.touch import BAND, near_centers, touched_voxels

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
    middles = cut + 0.5 - (offset - start) / grid.voxel_size
    stretch, curves, ends = round_parts(geometry, grid.voxel_size)
    parts = [round_shares(middles, stretch, *part) for part in zip(curves, ends, strict=True)]
    return Shares.joined(inside, cut, _settled(np.sum(parts, axis=0)), ERROR)


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


COVERS = ("center", "touch", "surface")
#: the algorithms for meshes: the first is Open3D's and serves as a cross-check of the other, which is exact and faster
BACKENDS = ("open3d", "scanline")
#: most voxels of one shape
MOST_VOXELS = 2**34


@explained(hint="voxelize(shape, voxel_size=0.1)")
def voxelize(
    shape: Shape,
    *,
    voxel_size: float | None = None,
    grid: Grid | None = None,
    backend: str | None = None,
    cover: str = "center",
    fraction: bool = False,
    out: Booleans | str | os.PathLike[str] | None = None,
    overwrite: bool = False,
    threads: int | None = None,
) -> Voxels:
    """Return the voxels of a solid.

    Parameters
    ----------
    shape : Shape
        What is voxelized.
    voxel_size : float, optional
        Edge of a voxel, in the unit of lengths, for a lattice with a voxel corner at the centroid and one empty layer
        around.
    grid : Grid, optional
        A lattice instead; what lies beyond it is left out.
    backend : {"scanline", "open3d"}, optional
        The algorithm for meshes and regular solids; both give the same voxels of a mesh. If omitted, meshes are
        voxelized by scanline and round solids in closed form instead of by their tessellation, as unions of spheres
        and outlines always are.
    cover : {"center", "touch"}
        ``"center"`` takes the voxels whose center lies in the solid, ``"touch"`` those whose closed cube meets it.
        Centers on the surface: of flat faces those on the lower side (towards -x, then -y, then -z) are in, so that
        solids that touch share no voxel; of round solids all.
    fraction : bool
        Whether the share of each voxel that is solid is wanted too: exact to some 1e-13, but for voxels in which
        several spheres overlap (`fraction_error`).
    out : (nx, ny, nz) ndarray of bool or path, optional
        Where the mask is written: an array, or a ``.npy`` file, which becomes the mask as a memory map. Left out, the
        voxels stay bits, an eighth of a byte each, until their `mask` is asked for.
    overwrite : bool
        Whether a file that is there may be replaced.
    threads : int, optional
        Number of threads, by default that of the processors or of ``OMP_NUM_THREADS``; the result is the same.

    Returns
    -------
    Voxels

    Raises
    ------
    InputError
        If not exactly one of voxel size and lattice is given, the voxel size is not above 0, the cover is unknown,
        `out` has another shape or type than the mask or does not end in ``.npy``, the shape is an open surface, or
        `threads` is no whole number above 0.
    UnknownNameError
        If the backend is unknown.
    MissingLibraryError
        If the library of the backend cannot be loaded.
    TooLargeError
        If there would be more than 2**34 voxels.
    OutputExistsError
        If the file is there and `overwrite` is false.
    OutputError
        If the file cannot be written.

    Notes
    -----
    Memory at the peak: bits (1/8 byte a voxel) and 40 bytes a vertex; another such set of bits for ``"touch"``, one
    byte a voxel for a mask, 60 bytes a voxel that the surface cuts for shares of meshes. The backend open3d
    takes some 100 MB. The volume of voxels by their centers differs from that of the solid by at most the
    volume of the voxels that the surface touches; in random poses by far less, with order 2 in the voxel size, while
    flat faces along the lattice give order 1. With shares it is exact to some 1e-13 at any voxel size.

    Examples
    --------
    >>> import voxgran as vg
    >>> sphere = vg.make_shape("sphere")
    >>> voxels = vg.voxelize(sphere, voxel_size=0.1, fraction=True)
    >>> voxels.mask.shape
    (14, 14, 14)
    >>> abs(voxels.volume / sphere.volume - 1) < 1e-12
    True
    """
    as_choice(cover, "cover", COVERS[:2])
    check_type(shape, Shape, "shape", "a Shape; make_shape and load_shape make one")
    shape.refuse_open("voxels")
    if out is not None and not isinstance(out, np.ndarray):
        _check_file(out, overwrite=overwrite)
    lattice = lattice_of(shape, voxel_size, grid)
    with using_threads(threads):
        bits = occupied(shape, lattice, backend=backend, cover=cover)
    shares = voxel_shares(shape.geometry, lattice, np.zeros(3)) if fraction else None
    taken = bits if out is None else _written(bits, out, overwrite=overwrite)
    origin = np.array(lattice.origin)
    return Voxels(taken, origin, lattice.voxel_size, cover, shares, dimension=shape.dimension)


def occupy(shape: Shape, grid: Grid, **options: Any) -> Booleans:
    """Return what :func:`occupied` does as an (nx, ny, nz) mask."""
    return occupied(shape, grid, **options).unpacked()


def centers_in(
    shape: Shape,
    corner: Floats,
    edges: Floats,
    counts: tuple[int, int, int],
    *,
    scale: float = 1.0,
    rotation: "ArrayLike | None" = None,
) -> Booleans:
    """Return as an (nx, ny, nz) mask the voxels of three edges (3,), from a corner (3,) on, whose center is in a shape
    about the origin, at a given scale and rotation (a unit quaternion): of what is no union of spheres.
    """
    geometry, lattice = _posed(shape.geometry, scale, rotation), Grid((0.0, 0.0, 0.0), 1.0, counts)
    if isinstance(geometry, Outline) and geometry.kind == "disk":
        x, y = (corner[k] + (np.arange(counts[k]) + 0.5) * edges[k] - geometry.center[k] for k in range(2))
        return np.asarray((x[:, None] ** 2 + y**2 <= geometry.radius**2)[:, :, None])
    if isinstance(geometry, Outline):
        stretched = Outline("polygon", vertices=(geometry.vertices - corner[:2]) / edges[:2])
        return outline_mask(stretched, lattice, cover="center")
    if isinstance(geometry, Primitive) and geometry.kind != "box":
        return centers_in_round(geometry, edges, -corner / edges - 0.5, counts).unpacked()
    assert not isinstance(geometry, Spheres)
    vertices, faces = (
        geometry.tessellation()[:2] if isinstance(geometry, Primitive) else (geometry.vertices, geometry.faces)
    )
    return scanline_inside((vertices - corner) / edges, faces, lattice).unpacked()


def occupied(
    shape: Shape,
    grid: Grid,
    *,
    scale: float = 1.0,
    rotation: "ArrayLike | None" = None,
    offset: "ArrayLike | None" = None,
    backend: str | None = None,
    cover: str = "center",
) -> PackedMask:
    """Return the voxels of a lattice that are in a shape at a given scale and pose.

    Rotation is a unit quaternion (w, x, y, z), offset the position (3,) of the centroid. Backend and cover are those of
    :func:`voxelize`; the cover "surface" takes the voxels that the surface of a mesh touches.

    Raises
    ------
    UnknownNameError
        If the backend is unknown.
    """
    as_choice(cover, "cover", COVERS)
    check_type(backend, (str, type(None)), "backend", f"one of {', '.join(BACKENDS)}")
    if backend not in (None, *BACKENDS):
        raise UnknownNameError(unknown("voxelization backend", backend, BACKENDS))
    shape.refuse_open("voxels")
    place = np.zeros(3) if offset is None else as_vector(offset, "offset")
    geometry = _posed(shape.geometry, as_positive(scale, "scale"), rotation)
    filled = "center" if cover == "center" else "touch"
    if isinstance(geometry, Outline):
        return PackedMask.from_mask(outline_mask(geometry.moved(place), grid, cover=filled))
    if isinstance(geometry, Spheres):
        return spheres_bits(geometry.centers + place, geometry.radii, grid, cover=filled)
    if isinstance(geometry, Mesh):
        return _occupy_mesh(geometry.vertices + place, geometry.faces, grid, backend, cover)
    assert isinstance(geometry, Primitive)
    if geometry.kind == "sphere" and backend is None:
        return spheres_bits(place[None], np.array(geometry.dimensions), grid, cover=filled)
    if geometry.kind != "box" and backend is None:
        return (round_bits if cover == "center" else touched_round)(geometry, grid, place)
    vertices, faces = geometry.tessellation()[:2] if cover == "center" else geometry.circumscribed()
    return _occupy_mesh(vertices + place, faces, grid, backend, cover)


def lattice_of(shape: Shape, voxel_size: float | None, grid: Grid | None, *, margin: int = 1) -> Grid:
    """Return the given lattice, or one around the shape with some empty layers.

    Raises
    ------
    InputError
        If not exactly one of voxel size and lattice is given, or the voxel size is not above 0.
    TooLargeError
        If there would be more than 2**34 voxels.
    """
    if grid is not None:
        if voxel_size is not None:
            raise InputError("voxel_size and grid: give exactly one of them; a lattice has a voxel size of its own")
        return grid
    if voxel_size is None:
        raise InputError("voxel_size is missing: give it, or a grid")
    size = as_length(voxel_size, "voxel_size")
    low, high = _bounds(shape)
    extents = np.maximum((high - low)[: shape.dimension] / size, 1.0) + 2.0 * (margin - 1)
    if not float(libm.log2(extents).sum()) < libm.log2(MOST_VOXELS):
        raise TooLargeError(
            f"voxel_size is {size}: {shape.name!r} would take more than {MOST_VOXELS} voxels; make them larger"
        )
    around = Grid.around(low, high, size, margin=margin)
    if shape.dimension == 3:
        return around
    return Grid((*around.origin[:2], -size / 2), size, (*around.shape[:2], 1))


def _check_file(out: str | os.PathLike[str], *, overwrite: bool) -> None:
    """Refuse a file that is of another format, or there already."""
    path = as_path(out)
    if path.suffix != ".npy":
        raise InputError(f"out is {str(path)!r}: a mask is written as .npy; name the file so, or give an array")
    if not overwrite:
        refuse_to_replace(path)


def _written(bits: PackedMask, out: Booleans | str | os.PathLike[str], *, overwrite: bool) -> Booleans:
    """Return the mask, written to an array or to a file, as a memory map of it."""
    if isinstance(out, np.ndarray):
        if out.shape != bits.shape or out.dtype != np.bool_:
            raise InputError(
                f"out has shape {out.shape} and type {out.dtype}: the mask has shape {bits.shape} and type bool"
            )
        return bits.unpacked(out)
    path = as_path(out)
    with written_whole(path, overwrite=overwrite) as draft:
        image = np.lib.format.open_memmap(draft, mode="w+", dtype=np.bool_, shape=bits.shape)
        with draft.open("rb+") as file:
            # a page of a map for which the disk has no room would end the process
            os.posix_fallocate(file.fileno(), 0, draft.stat().st_size)
        bits.unpacked(image)
        image.flush()
        del image
    mapped: Booleans = np.load(path, mmap_mode="r", allow_pickle=False)
    return mapped


def _posed(geometry: Geometry, scale: float, rotation: "ArrayLike | None") -> Geometry:
    """Return the geometry stretched and turned."""
    if scale != 1.0:
        geometry = geometry.scaled(scale)
    if rotation is not None:
        turn = as_quaternions(np.asarray(rotation, dtype=np.float64)[None], "rotation")
        geometry = geometry.rotated(rotation_matrices(turn)[0])
    return geometry


def _bounds(shape: Shape) -> tuple[Floats, Floats]:
    """Return the corners of a box that holds the true shape."""
    if isinstance(shape.geometry, Spheres):
        centers, radii = shape.geometry.centers, shape.geometry.radii[:, None]
        return (centers - radii).min(axis=0), (centers + radii).max(axis=0)
    error = shape.tessellation_error
    return shape.vertices.min(axis=0) - error, shape.vertices.max(axis=0) + error


def _occupy_mesh(vertices: Floats, faces: Integers, grid: Grid, backend: str | None, cover: str) -> PackedMask:
    """Return the voxels of a closed mesh."""
    if cover == "surface":
        return touched_voxels(vertices, faces, grid)
    inside = (open3d_inside if backend == "open3d" else scanline_inside)(vertices, faces, grid)
    if cover == "touch":
        # a center so near to the surface that a backend may err lies in a voxel that is touched
        inside.words[...] |= touched_voxels(vertices, faces, grid).words
        return inside
    if backend != "open3d":
        return inside
    size = float((vertices.max(axis=0) - vertices.min(axis=0)).max()) / grid.voxel_size
    doubtful = near_centers(vertices, faces, grid, max(BAND, ROUND_OFF * size))[0]
    if not len(doubtful):
        return inside
    mask, sure, where = inside.unpacked(), scanline_inside(vertices, faces, grid), tuple(doubtful.T)
    mask[where] = sure.unpacked()[where]
    return PackedMask.from_mask(mask)
