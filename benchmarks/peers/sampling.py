"""Open3D's Poisson disks on a mesh: sample elimination (Yuksel 2015, doi:10.1111/cgf.12538)."""

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.lazy import load


def open3d_points(vertices: Floats, faces: Integers, count: int, *, seed: int) -> Floats:
    """Return points (count, 3) on a mesh of a size of the order of 1 that keep apart."""
    open3d = load("open3d")
    corners, triangles = np.array(vertices, dtype=np.float64), faces.astype(np.int32)
    mesh = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(corners), open3d.utility.Vector3iVector(triangles)
    )
    open3d.utility.random.seed(seed)
    return np.asarray(mesh.sample_points_poisson_disk(count).points, dtype=np.float64)
