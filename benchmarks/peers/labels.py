"""Surfaces of label images by scikit-image and by VTK: the peers of `voxgran.load_labels`."""

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Floats, Integers
from voxgran._base.lazy import load

#: standard deviation of the Gaussian before marching cubes, and void around the box of a label, in voxels
SIGMA, MARGIN = 1.0, 4
#: steps by which VTK smooths, its default
ITERATIONS = 16


def marching_cubes(image: NDArray[np.int32]) -> list[tuple[Floats, Integers]]:
    """Return vertices (v, 3), in voxels, and triangles (m, 3) of each label, smoothed in its box by itself."""
    measure, ndimage, surfaces = load("skimage.measure"), load("scipy.ndimage"), []
    for label, box in enumerate(ndimage.find_objects(image), 1):
        solid = np.pad((image[box] == label).astype(np.float32), MARGIN)
        vertices, faces, *_ = measure.marching_cubes(ndimage.gaussian_filter(solid, SIGMA), 0.5)
        # scikit-image has the values at whole numbers, and turns its triangles inward
        low = np.array([side.start for side in box]) - MARGIN + 0.5
        surfaces.append((vertices.astype(np.float64) + low, faces[:, ::-1].astype(np.int64)))
    return surfaces


def surface_nets(image: NDArray[np.int32]) -> tuple[Floats, Integers, Integers]:
    """Return vertices (v, 3), in voxels, and triangles (m, 3) of one surface between all labels, and their two labels.

    Around the image lies void, where VTK would leave the labels open.
    """
    support, padded = load("vtkmodules.util.numpy_support"), np.pad(image, 1)
    grid = load("vtkmodules.vtkCommonDataModel").vtkImageData()
    grid.SetDimensions(*padded.shape)
    grid.SetOrigin(-0.5, -0.5, -0.5)
    grid.GetPointData().SetScalars(support.numpy_to_vtk(padded.ravel(order="F").astype(np.int32)))
    nets = load("vtkmodules.vtkFiltersCore").vtkSurfaceNets3D()
    nets.SetInputData(grid)
    nets.GenerateLabels(int(image.max()), 1, int(image.max()))
    nets.SetNumberOfIterations(ITERATIONS)
    nets.SetOutputMeshTypeToTriangles()
    nets.Update()
    found = nets.GetOutput()
    faces = support.vtk_to_numpy(found.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    sides = support.vtk_to_numpy(found.GetCellData().GetArray("BoundaryLabels"))
    points = support.vtk_to_numpy(found.GetPoints().GetData())
    return points.astype(np.float64), faces.astype(np.int64), sides.astype(np.int64)
