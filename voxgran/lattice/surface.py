"""A smooth closed surface around taken voxels that encloses as much volume as they do.

The mask is smoothed, and of its level surfaces (flying edges, Schroeder, Maynard & Geveci 2015,
doi:10.1109/LDAV.2015.7348069) that one is taken that holds the volume of the voxels; what is left of the difference is
made up by a uniform stretch of less than a ten-thousandth.
"""

import numpy as np

from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.lazy import load

#: relative difference of volumes up to which the level is searched
LEVEL_ACCURACY = 1e-4
MOST_LEVELS = 30


def smooth_surface(mask: Booleans, *, smoothing: float = 1.0) -> tuple[Floats, Integers]:
    """Return a closed surface around taken voxels.

    Parameters
    ----------
    mask : (nx, ny, nz) ndarray of bool
        At least one is taken; voxel (i, j, k) is the cube from (i, j, k) to (i + 1, j + 1, k + 1).
    smoothing : float
        Standard deviation of the Gaussian that rounds the steps, in voxels, above 0.

    Returns
    -------
    vertices : (n, 3) ndarray of float
        In voxels.
    faces : (m, 3) ndarray of int
        Outward; cavities inward. The volume enclosed is the number of voxels.
    """
    ring = int(np.ceil(3 * smoothing)) + 1
    field = load("scipy.ndimage").gaussian_filter(np.pad(mask, ring).astype(np.float64), smoothing, truncate=3.0)
    wanted = float(mask.sum())
    low, high = 0.0, float(field.max())
    # volume falls with the level; ends of the search as (level, relative excess)
    above, below = (low, np.inf), (high, -1.0)
    level = float(np.partition(field.ravel(), -int(wanted))[-int(wanted)])
    for _ in range(MOST_LEVELS):
        vertices, faces = _level_surface(field, level)
        excess = _volume(vertices, faces) / wanted - 1.0
        if abs(excess) <= LEVEL_ACCURACY:
            break
        above, below = ((level, excess), below) if excess > 0 else (above, (level, excess))
        share = above[1] / (above[1] - below[1]) if np.isfinite(above[1]) else 0.5
        level = above[0] + min(max(share, 0.05), 0.95) * (below[0] - above[0])
    middle = vertices.mean(axis=0)
    stretch = np.cbrt(wanted / _volume(vertices, faces))
    return (vertices - middle) * stretch + middle - ring, faces


def _level_surface(field: Floats, level: float) -> tuple[Floats, Integers]:
    """Return the surface on which a field on voxel centers has a value."""
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


def _volume(vertices: Floats, faces: Integers) -> float:
    """Return the volume that a surface encloses."""
    a, b, c = np.moveaxis(vertices[faces] - vertices.mean(axis=0), 1, 0)
    return float(np.einsum("fi,fi->", a, np.cross(b, c))) / 6
