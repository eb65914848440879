"""What a user could voxelize a mesh with instead, as plain programs: the peers that a speed is a ratio to."""

from collections.abc import Callable

import numpy as np

from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.lazy import load

Program = Callable[[], Booleans]


def voxel_peers(vertices: Floats, faces: Integers, n: int) -> dict[str, Program]:
    """Return programs that give the (n, n, n) mask of a closed mesh, by name.

    Parameters
    ----------
    vertices : (v, 3) ndarray of float
        Corner points, in voxels from the corner of the lattice.
    faces : (m, 3) ndarray of int
        Triangles.
    n : int
        Voxels along each edge.
    """
    return {
        "PyVista mask": lambda: _pyvista_mask(vertices, faces, n),
        "VTK stencil": lambda: _vtk_stencil(vertices, faces, n),
        "Open3D ray columns": lambda: _open3d_columns(vertices, faces, n),
        "Open3D occupancy": lambda: _open3d_occupancy(vertices, faces, n),
    }


def _pyvista_mask(vertices: Floats, faces: Integers, n: int) -> Booleans:
    """Ask PyVista for the binary mask on a reference volume."""
    pyvista = load("pyvista")
    surface = pyvista.PolyData.from_regular_faces(vertices, faces)
    volume = pyvista.ImageData(dimensions=(n, n, n), origin=(0.5, 0.5, 0.5))
    mask = surface.voxelize_binary_mask(reference_volume=volume)["mask"]
    return np.asarray(mask).reshape(n, n, n).transpose(2, 1, 0).astype(bool)


def _vtk_stencil(vertices: Floats, faces: Integers, n: int) -> Booleans:
    """Ask VTK for the stencil of the surface, and for its image."""
    stencils = load("vtkmodules.vtkImagingStencil")
    cut = stencils.vtkPolyDataToImageStencil()
    cut.SetInputData(load("pyvista").PolyData.from_regular_faces(vertices - 0.5, faces))
    cut.SetOutputSpacing(1.0, 1.0, 1.0)
    cut.SetOutputWholeExtent(0, n - 1, 0, n - 1, 0, n - 1)
    image = stencils.vtkImageStencilToImage()
    image.SetInputConnection(cut.GetOutputPort())
    image.SetOutputScalarTypeToUnsignedChar()
    image.Update()
    flat = load("vtkmodules.util.numpy_support").vtk_to_numpy(image.GetOutput().GetPointData().GetScalars())
    return np.asarray(flat).reshape(n, n, n).transpose(2, 1, 0).astype(bool)


def _scene(vertices: Floats, faces: Integers) -> object:
    """Build Open3D's scene of a mesh."""
    open3d = load("open3d")
    scene = open3d.t.geometry.RaycastingScene(nthreads=1)
    body = open3d.core.Tensor(vertices.astype(np.float32))
    scene.add_triangles(body, open3d.core.Tensor(faces.astype(np.uint32)))
    return scene


def _open3d_columns(vertices: Floats, faces: Integers, n: int) -> Booleans:
    """List the intersections of a ray a column, and fill between them."""
    open3d, scene = load("open3d"), _scene(vertices, faces)
    x, y = np.meshgrid(np.arange(n) + 0.5, np.arange(n) + 0.5, indexing="ij")
    rays = np.zeros((n * n, 6), dtype=np.float32)
    rays[:, 0], rays[:, 1], rays[:, 2], rays[:, 5] = x.ravel(), y.ravel(), -1.0, 1.0
    hits = scene.list_intersections(open3d.core.Tensor(rays), nthreads=1)  # type: ignore[attr-defined]
    column, height = hits["ray_ids"].numpy(), hits["t_hit"].numpy() - 1.0
    level = np.clip(np.ceil(height - 0.5), 0, n).astype(np.int64)
    toggles = np.zeros((n * n, n + 1), dtype=np.uint8)
    np.add.at(toggles, (column, level), 1)
    return (np.add.accumulate(toggles, axis=1, dtype=np.uint8)[:, :n] & 1).astype(bool).reshape(n, n, n)


def _open3d_occupancy(vertices: Floats, faces: Integers, n: int) -> Booleans:
    """Ask for the occupancy of each voxel center, some planes at a time."""
    open3d, scene = load("open3d"), _scene(vertices, faces)
    mask = np.zeros((n, n, n), dtype=bool)
    y, z = np.meshgrid(np.arange(n) + 0.5, np.arange(n) + 0.5, indexing="ij")
    for i in range(n):
        points = np.stack([np.full_like(y, i + 0.5), y, z], axis=-1).astype(np.float32)
        mask[i] = scene.compute_occupancy(open3d.core.Tensor(points), nthreads=1).numpy() > 0.5  # type: ignore[attr-defined]
    return mask
