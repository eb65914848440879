"""Closed surfaces around occupied voxels and at levels of a field, with the volume of the voxels.

Level surfaces are computed by flying edges (Schroeder, Maynard & Geveci 2015, doi:10.1109/LDAV.2015.7348069). The level
is chosen so that the surface encloses the required volume; the remaining difference is removed by a uniform scaling of
less than a ten-thousandth.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arrays import Booleans, Floats, Integers, as_array, as_floats, as_number, as_positive
from voxgran._base.calls import explained
from voxgran._base.errors import InputError
from voxgran._base.lazy import load
from voxgran._base.scalars import cube_root
from voxgran.geometry.triangles import enclosed_volume
from voxgran.lattice.image import block_library, histogram_of, lazy_of, not_finite, of_blocks
from voxgran.lattice.smoothing import smoothed

#: relative difference of volumes at which the search for the level ends
LEVEL_ACCURACY = 1e-4
MOST_LEVELS = 30
#: voxels of blocks below which several are taken as one: joining them takes longer than their triangles
LEAST_BLOCK = 2**21


@explained(hint="iso_surface(field, level=0.5)")
def iso_surface(
    field: "ArrayLike", *, level: float | None = None, volume: float | None = None
) -> tuple[Floats, Integers]:
    """Return the closed level surface of a field on voxel centers, for a level or an enclosed volume.

    Parameters
    ----------
    field : (nx, ny, nz) array_like of float
        Field with larger values inside: volume fractions, a smoothed mask, or a distance that is positive inside. A
        dask array is read block by block.
    level : float, optional
        Value on the surface. Default: the value whose surface encloses `volume`.
    volume : float, optional
        Enclosed volume, in voxels, above 0. Default, without `level`: the sum of the field, which for volume fractions
        is the solid volume.

    Returns
    -------
    vertices : (n, 3) ndarray of float
        Vertices in voxels; voxel (i, j, k) is the cube from (i, j, k) to (i + 1, j + 1, k + 1). Bodies are closed at
        the border of the image.
    faces : (m, 3) ndarray of int
        Triangles, outward; those of cavities inward.

    Raises
    ------
    InputError
        If the field does not have three axes or is not finite, both level and volume are given, the level is below or
        above all values, or the volume is not above 0 or larger than the image.
    MissingLibraryError
        If the field is a dask array and a part of dask is not installed.

    Notes
    -----
    Memory beside the field: 24 bytes per voxel, and about 100 bytes per triangle. Of a dask array only the triangles
    are in memory. Its surface at a level is that in memory but for the order of its triangles and round-off (vertices
    in memory have single precision); the level of a volume is sought from another value on, to the same accuracy.

    Examples
    --------
    >>> import voxgran as vg
    >>> voxels = vg.voxelize(vg.make_shape("sphere"), voxel_size=0.1, fraction=True)
    >>> vertices, faces = vg.iso_surface(voxels.fraction)
    >>> body = vg.Shape.from_mesh(vertices * 0.1, faces)
    >>> bool(abs(body.volume / voxels.volume - 1) < 1e-9)
    True
    """
    values = _values_of(field)
    if not values.size:
        raise InputError(f"field has shape {values.shape}: there must be voxels")
    if level is not None and volume is not None:
        raise InputError("level and volume: give one of them at most")
    low, high = float(values.min()), float(values.max())
    # an additional layer below all levels closes bodies at the border
    around: Any = np.pad(values, 1, constant_values=low - (high - low) - 1.0 if high > low else low)
    if lazy_of(values) is not None:
        small = math.prod(values.chunksize) < LEAST_BLOCK
        around = around.rechunk("auto", block_size_limit=8 * LEAST_BLOCK) if small else around.rechunk(values.chunksize)
    if level is not None:
        chosen = as_number(level, "level")
        if not low <= chosen < high and not chosen < low:
            raise InputError(f"level is {chosen}: the field is at most {high}; choose a level below that")
        if chosen < low:
            raise InputError(f"level is {chosen}: the field is at least {low}; choose a level above that")
        vertices, faces = _level_surface(around, chosen)
        return vertices - 1.0, faces
    wanted = as_positive(float(values.sum()) if volume is None else volume, "volume")
    if wanted >= values.size or not high > low:
        raise InputError(f"volume is {wanted}: the image has {values.size} voxels and must have some that are free")
    vertices, faces = _surface_of_volume(around, wanted)
    return vertices - 1.0, faces


def _values_of(field: Any) -> Any:
    """Return the checked values of a field, an array or a dask array."""
    lazy = lazy_of(field)
    if lazy is None:
        given = as_array(field, "field")
        return as_floats(given.astype(np.float64) if given.dtype == np.bool_ else given, "field", shape=(None,) * 3)
    if lazy.ndim != 3 or lazy.dtype.kind not in "buif":
        raise InputError(
            f"field has shape {lazy.shape} and holds {lazy.dtype}: it must have three axes and finite numbers; clean it"
        )
    if (bad := not_finite(lazy)) is not None:
        raise InputError(f"field is {float(lazy[bad])} at voxel {bad}: it must hold finite numbers; clean it")
    return lazy.astype(np.float64)


def smooth_surface(mask: Booleans, *, smoothing: float = 1.0) -> tuple[Floats, Integers]:
    """Return vertices (n, 3) and triangles (m, 3) of a smooth closed surface around occupied voxels, at least one.

    `smoothing` is the standard deviation of the Gaussian that rounds the steps, in voxels, above 0. Vertices are in
    voxels; voxel (i, j, k) is the cube from (i, j, k) to (i + 1, j + 1, k + 1). Triangles are outward, those of
    cavities inward. The enclosed volume is the number of voxels.
    """
    ring = int(np.ceil(3 * smoothing)) + 1
    field = smoothed(np.pad(mask, ring).astype(np.float64), smoothing, truncate=3.0)
    vertices, faces = _surface_of_volume(field, float(mask.sum()))
    return vertices - ring, faces


def _surface_of_volume(field: Any, wanted: float) -> tuple[Floats, Integers]:
    """Return the level surface of a field that encloses a volume; the field is lowest at the border."""
    low, high = float(field.min()), float(field.max())
    # the volume decreases with the level; the ends of the search are (level, relative excess)
    above, below = (low, np.inf), (high, -1.0)
    rank = min(max(int(wanted), 1), field.size)
    if lazy_of(field) is None:
        level = float(np.partition(field.ravel(), -rank)[-rank])
    else:
        counts, middles = histogram_of(field, low, high)
        level = float(middles[np.flatnonzero(np.cumsum(counts[::-1])[::-1] >= rank)[-1]])
    for _ in range(MOST_LEVELS):
        vertices, faces = _level_surface(field, level)
        excess = enclosed_volume(vertices - vertices.mean(axis=0), faces) / wanted - 1.0
        if abs(excess) <= LEVEL_ACCURACY:
            break
        above, below = ((level, excess), below) if excess > 0 else (above, (level, excess))
        share = above[1] / (above[1] - below[1]) if np.isfinite(above[1]) else 0.5
        level = above[0] + min(max(share, 0.05), 0.95) * (below[0] - above[0])
    middle = vertices.mean(axis=0)
    stretch = cube_root(wanted / enclosed_volume(vertices - vertices.mean(axis=0), faces))
    return (vertices - middle) * stretch + middle, faces


def _level_surface(field: Any, level: float) -> tuple[Floats, Integers]:
    """Return the level surface of a field on voxel centers, an array or a dask array."""
    if lazy_of(field) is None:
        return _surface_in_block(field, level)
    overlap = block_library("dask.array").overlap.overlap
    ahead = overlap(field, dict.fromkeys(range(3), (0, 1)), "none")
    starts = [np.cumsum((0, *along)) for along in ahead.chunks]

    def found(block: Floats, start: Integers) -> tuple[Floats, Integers]:
        vertices, faces = _surface_in_block(np.ascontiguousarray(block), level)
        # each block before has a voxel more along each axis
        earlier = [np.searchsorted(along, place) for along, place in zip(starts, start, strict=True)]
        return vertices + (start - earlier), faces

    pieces = of_blocks(ahead, found)
    many = np.cumsum([0] + [len(vertices) for vertices, _ in pieces[:-1]])
    vertices = np.concatenate([each for each, _ in pieces])
    faces = np.concatenate([each + before for (_, each), before in zip(pieces, many, strict=True)])
    return _joined(vertices, faces, [np.cumsum(along)[:-1] + 0.5 for along in field.chunks])


def _joined(vertices: Floats, faces: Integers, planes: list[Floats]) -> tuple[Floats, Integers]:
    """Return a surface whose vertices of the same place are one, where they lie in planes across x, y and z.

    Blocks interpolate along an edge of the lattice between the same values, so that their vertices there are equal.
    """
    within = np.any([np.isin(vertices[:, axis], along) for axis, along in enumerate(planes)], axis=0)
    places, index = np.unique(vertices[within], axis=0, return_inverse=True)
    numbers = np.empty(len(vertices), dtype=np.int64)
    numbers[~within] = np.arange(len(vertices) - within.sum())
    numbers[within] = len(vertices) - within.sum() + index.reshape(-1)
    faces = numbers[faces]
    flat = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    return np.concatenate([vertices[~within], places]), faces[~flat]


def _surface_in_block(field: Floats, level: float) -> tuple[Floats, Integers]:
    """Return the level surface of a field on voxel centers, which may be open at its border."""
    if min(field.shape) < 2:
        return np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)
    support, model = load("vtkmodules.util.numpy_support"), load("vtkmodules.vtkCommonDataModel")
    image = model.vtkImageData()
    image.SetDimensions(*field.shape)
    image.SetOrigin(0.5, 0.5, 0.5)
    image.GetPointData().SetScalars(support.numpy_to_vtk(field.ravel(order="F"), deep=True))
    edges = load("vtkmodules.vtkFiltersCore").vtkFlyingEdges3D()
    edges.SetInputData(image)
    edges.SetValue(0, level)
    edges.ComputeNormalsOff()
    edges.ComputeScalarsOff()
    edges.Update()
    surface = edges.GetOutput()
    if not surface.GetNumberOfPolys():
        return np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)
    vertices = support.vtk_to_numpy(surface.GetPoints().GetData()).astype(np.float64)
    corners = support.vtk_to_numpy(surface.GetPolys().GetConnectivityArray()).astype(np.int64)
    return vertices, corners.reshape(-1, 3)
