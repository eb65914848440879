"""Closed surfaces around occupied voxels and at levels of a field, with the volume of the voxels.

Level surfaces are computed by flying edges (Schroeder, Maynard & Geveci 2015, doi:10.1109/LDAV.2015.7348069). The level
is chosen so that the surface encloses the required volume; the remaining difference is removed by a uniform scaling of
less than a ten-thousandth.
"""

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arrays import Booleans, Floats, Integers, as_array, as_floats, as_number, as_positive
from voxgran._base.calls import explained
from voxgran._base.errors import InputError
from voxgran._base.lazy import load
from voxgran.geometry.triangles import enclosed_volume

#: relative difference of volumes at which the search for the level ends
LEVEL_ACCURACY = 1e-4
MOST_LEVELS = 30


@explained(hint="iso_surface(field, level=0.5)")
def iso_surface(
    field: "ArrayLike", *, level: float | None = None, volume: float | None = None
) -> tuple[Floats, Integers]:
    """Return the closed level surface of a field on voxel centers, for a level or an enclosed volume.

    Parameters
    ----------
    field : (nx, ny, nz) array_like of float
        Field with larger values inside: volume fractions, a smoothed mask, or a distance that is positive inside.
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

    Notes
    -----
    Memory beside the field: 24 bytes per voxel, and about 100 bytes per triangle.

    Examples
    --------
    >>> import voxgran as vg
    >>> voxels = vg.voxelize(vg.make_shape("sphere"), voxel_size=0.1, fraction=True)
    >>> vertices, faces = vg.iso_surface(voxels.fraction)
    >>> body = vg.Shape.from_mesh(vertices * 0.1, faces)
    >>> bool(abs(body.volume / voxels.volume - 1) < 1e-9)
    True
    """
    given = as_array(field, "field")
    given = given.astype(np.float64) if given.dtype == np.bool_ else given
    values = as_floats(given, "field", shape=(None, None, None))
    if not values.size:
        raise InputError(f"field has shape {values.shape}: there must be voxels")
    if level is not None and volume is not None:
        raise InputError("level and volume: give one of them at most")
    low, high = float(values.min()), float(values.max())
    # an additional layer below all levels closes bodies at the border
    around = np.pad(values, 1, constant_values=low - (high - low) - 1.0 if high > low else low)
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


def smooth_surface(mask: Booleans, *, smoothing: float = 1.0) -> tuple[Floats, Integers]:
    """Return vertices (n, 3) and triangles (m, 3) of a smooth closed surface around occupied voxels, at least one.

    `smoothing` is the standard deviation of the Gaussian that rounds the steps, in voxels, above 0. Vertices are in
    voxels; voxel (i, j, k) is the cube from (i, j, k) to (i + 1, j + 1, k + 1). Triangles are outward, those of
    cavities inward. The enclosed volume is the number of voxels.
    """
    ring = int(np.ceil(3 * smoothing)) + 1
    field = load("scipy.ndimage").gaussian_filter(np.pad(mask, ring).astype(np.float64), smoothing, truncate=3.0)
    vertices, faces = _surface_of_volume(field, float(mask.sum()))
    return vertices - ring, faces


def _surface_of_volume(field: Floats, wanted: float) -> tuple[Floats, Integers]:
    """Return the level surface of a field that encloses a volume; the field is lowest at the border."""
    low, high = float(field.min()), float(field.max())
    # the volume decreases with the level; the ends of the search are (level, relative excess)
    above, below = (low, np.inf), (high, -1.0)
    rank = min(max(int(wanted), 1), field.size)
    level = float(np.partition(field.ravel(), -rank)[-rank])
    for _ in range(MOST_LEVELS):
        vertices, faces = _level_surface(field, level)
        excess = enclosed_volume(vertices - vertices.mean(axis=0), faces) / wanted - 1.0
        if abs(excess) <= LEVEL_ACCURACY:
            break
        above, below = ((level, excess), below) if excess > 0 else (above, (level, excess))
        share = above[1] / (above[1] - below[1]) if np.isfinite(above[1]) else 0.5
        level = above[0] + min(max(share, 0.05), 0.95) * (below[0] - above[0])
    middle = vertices.mean(axis=0)
    stretch = np.cbrt(wanted / enclosed_volume(vertices - vertices.mean(axis=0), faces))
    return (vertices - middle) * stretch + middle, faces


def _level_surface(field: Floats, level: float) -> tuple[Floats, Integers]:
    """Return the level surface of a field on voxel centers."""
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
        return np.zeros((1, 3)), np.zeros((0, 3), dtype=np.int64)
    vertices = support.vtk_to_numpy(surface.GetPoints().GetData()).astype(np.float64)
    corners = support.vtk_to_numpy(surface.GetPolys().GetConnectivityArray()).astype(np.int64)
    return vertices, corners.reshape(-1, 3)
