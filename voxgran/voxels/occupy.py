"""Which voxels of a lattice a solid takes.

The center of a voxel is inside, outside, or within 1e-6 voxel of the surface; the last count as inside (the solid is
closed), whatever the backend says. Where a backend computes in single precision, centers within its round-off of the
surface are settled in double precision. All backends therefore give the same voxels.
"""

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arrays import (
    Booleans,
    Floats,
    Integers,
    as_choice,
    as_positive,
    as_quaternions,
    as_vector,
)
from voxgran._base.errors import TooLargeError
from voxgran._base.rotation import rotation_matrices
from voxgran.lattice.grid import Grid
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Geometry, Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.spheres import Spheres
from voxgran.voxels.backend import backend_registry, backends
from voxgran.voxels.closed_form import balls_mask, outline_mask, primitive_centers
from voxgran.voxels.fraction import voxel_shares
from voxgran.voxels.model import Voxels
from voxgran.voxels.touch import near_centers, touched_voxels

__all__ = ["backends", "occupy", "voxelize"]

COVERS = ("center", "touch", "surface")
#: centers nearer to the surface than this, in voxels, count as inside
BAND = 1e-6
#: the backend that is fastest, and needs no library but numba
FASTEST = "scanline"
#: root mean square error of the shares of cut voxels (measured: 0.002 to 0.005, bodies round and flat in random poses)
SHARE_ERROR = 5e-3
#: most voxels of one shape
MOST_VOXELS = 2**31


def voxelize(
    shape: Shape, *, voxel_size: float, backend: str | None = None, cover: str = "center", fraction: bool = False
) -> Voxels:
    """Return the voxels of a solid, on a lattice that has a voxel corner at its centroid.

    Parameters
    ----------
    shape : Shape
        What is voxelized.
    voxel_size : float
        Edge of a voxel, in the unit of lengths.
    backend : {"scanline", "vtk", "open3d"}, optional
        Who computes, for meshes and regular solids. All give the same voxels of a mesh. Left out: the fastest; and
        regular solids in closed form instead of their tessellation, as unions of balls and outlines always are.
    cover : {"center", "touch"}
        ``"center"`` takes the voxels whose center lies in the closed solid, ``"touch"`` those whose closed cube meets
        it. Curved regular solids are covered by a circumscribed tessellation, so that no touched voxel is missed.
    fraction : bool
        Whether the share of each voxel that is solid is wanted too.

    Returns
    -------
    Voxels
        With one empty layer around.

    Raises
    ------
    InputError
        If the voxel size is not above 0 or the cover is unknown.
    UnknownNameError
        If the backend is unknown.
    MissingLibraryError
        If the library of the backend cannot be loaded.
    TooLargeError
        If there would be more than 2**31 voxels.
    """
    size = as_positive(voxel_size, "voxel_size")
    as_choice(cover, "cover", COVERS[:2])
    low, high = _bounds(shape)
    extents = np.maximum((high - low)[: shape.dimension] / size, 1.0)
    if not float(np.log2(extents).sum()) < np.log2(MOST_VOXELS):
        raise TooLargeError(
            f"voxel_size is {size}: {shape.name!r} would take more than {MOST_VOXELS} voxels; make them larger"
        )
    grid = Grid.around(low, high, size)
    if shape.dimension == 2:
        grid = Grid((*grid.origin[:2], -size / 2), size, (*grid.shape[:2], 1))
    mask = occupy(shape, grid, backend=backend, cover=cover)
    share = None
    if fraction:
        masks = {cover: mask, **{c: occupy(shape, grid, cover=c) for c in COVERS[:2] if c != cover}}
        share = voxel_shares(shape.geometry, grid, masks["center"], masks["touch"])
    band = 0
    if isinstance(shape.geometry, Mesh):
        band = len(near_centers(shape.vertices, shape.faces, grid, BAND)[0])
    return Voxels(mask, np.array(grid.origin), size, cover, share, SHARE_ERROR if fraction else 0.0, band)


def occupy(
    shape: Shape,
    grid: Grid,
    *,
    scale: float = 1.0,
    rotation: ArrayLike | None = None,
    offset: ArrayLike | None = None,
    backend: str | None = None,
    cover: str = "center",
) -> Booleans:
    """Return the voxels of a given lattice that a solid takes where it lies.

    Parameters
    ----------
    shape : Shape
        What is voxelized.
    grid : Grid
        The lattice; what lies beyond it is left out.
    scale : float
        Factor on the lengths of the shape.
    rotation : (4,) array_like of float, optional
        Unit quaternion (w, x, y, z).
    offset : (3,) array_like of float, optional
        Position of the centroid.
    backend : str, optional
        As :func:`voxelize`.
    cover : {"center", "touch", "surface"}
        As :func:`voxelize`; ``"surface"`` takes the voxels that the surface of a mesh touches.

    Returns
    -------
    (nx, ny, nz) ndarray of bool

    Raises
    ------
    InputError
        If the cover is unknown, the scale is not above 0, the rotation is not a unit quaternion, or a value is
        not finite.
    UnknownNameError
        If the backend is unknown.
    MissingLibraryError
        If the library of the backend cannot be loaded.
    """
    as_choice(cover, "cover", COVERS)
    place = np.zeros(3) if offset is None else as_vector(offset, "offset")
    geometry = _posed(shape.geometry, as_positive(scale, "scale"), rotation)
    filled = "center" if cover == "center" else "touch"
    if isinstance(geometry, Outline):
        return outline_mask(geometry.moved(place), grid, cover=filled)
    if isinstance(geometry, Spheres):
        return balls_mask(geometry.centers + place, geometry.radii, grid, cover=filled)
    if isinstance(geometry, Mesh):
        return _occupy_mesh(geometry.vertices + place, geometry.faces, grid, backend, cover)
    if geometry.kind == "sphere" and backend is None:
        return balls_mask(place[None], np.array(geometry.dimensions), grid, cover=filled)
    if cover == "center" and backend is None:
        return primitive_centers(geometry, grid, place)
    vertices, faces = geometry.tessellation()[:2] if cover == "center" else geometry.circumscribed()
    return _occupy_mesh(vertices + place, faces, grid, backend, cover)


def _posed(geometry: Geometry, scale: float, rotation: ArrayLike | None) -> Geometry:
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


def _occupy_mesh(vertices: Floats, faces: Integers, grid: Grid, backend: str | None, cover: str) -> Booleans:
    """Return the voxels of a closed mesh."""
    if cover == "surface":
        return touched_voxels(vertices, faces, grid)
    chosen = backend_registry().get(backend or FASTEST)
    inside = chosen.occupy(vertices, faces, grid)
    if cover == "touch":
        # a center so near to the surface that a backend may err lies in a voxel that is touched
        return inside | touched_voxels(vertices, faces, grid)
    size = float((vertices.max(axis=0) - vertices.min(axis=0)).max()) / grid.voxel_size
    indices, distance = near_centers(vertices, faces, grid, max(BAND, chosen.band * size))
    doubtful = indices[distance > BAND]
    if len(doubtful):
        where = tuple(doubtful.T)
        inside[where] = backend_registry().get(FASTEST).occupy(vertices, faces, grid)[where]
    inside[tuple(indices[distance <= BAND].T)] = True
    return inside
