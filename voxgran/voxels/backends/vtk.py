"""VTK: the image stencil of a closed surface on a given grid, in double precision.

The grid is given, never refitted, and the tolerance is 0, so that grains share one lattice.
"""

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.lazy import load
from voxgran.lattice.grid import Grid
from voxgran.lattice.packed import PackedMask
from voxgran.voxels.backend import Backend


def occupy(vertices: Floats, faces: Integers, grid: Grid) -> PackedMask:
    """Return the voxels whose center lies inside."""
    stencils = load("vtkmodules.vtkImagingStencil")
    # in voxels from the center of voxel 0, so that the image has spacing 1 and exact whole coordinates
    body = (vertices - np.array(grid.origin)) / grid.voxel_size - 0.5
    surface = load("pyvista").PolyData.from_regular_faces(body, faces)
    cut = stencils.vtkPolyDataToImageStencil()
    cut.SetInputData(surface)
    cut.SetOutputOrigin(0.0, 0.0, 0.0)
    cut.SetOutputSpacing(1.0, 1.0, 1.0)
    cut.SetOutputWholeExtent(0, grid.shape[0] - 1, 0, grid.shape[1] - 1, 0, grid.shape[2] - 1)
    cut.SetTolerance(0.0)
    image = stencils.vtkImageStencilToImage()
    image.SetInputConnection(cut.GetOutputPort())
    image.SetOutsideValue(0)
    image.SetInsideValue(1)
    image.SetOutputScalarTypeToUnsignedChar()
    image.Update()
    scalars = image.GetOutput().GetPointData().GetScalars()
    flat = load("vtkmodules.util.numpy_support").vtk_to_numpy(scalars)
    return PackedMask.of(np.ascontiguousarray(flat.reshape(grid.shape[::-1]).transpose(2, 1, 0)).view(np.bool_))


registration = Backend(name="vtk", summary="VTK's image stencil on the given grid", occupy=occupy, band=1e-9)
