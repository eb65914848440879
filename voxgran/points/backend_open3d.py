"""Open3D's samplers of a triangle mesh, uniform and Poisson-disk, its one generator of random numbers, and quiet."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.lazy import load


def seed_open3d(seed: int) -> None:
    """Seed Open3D's generator, which is one for the whole process.

    Parameters
    ----------
    seed : int
        Not negative.
    """
    open3d = load("open3d")
    open3d.utility.random.seed(seed % 2**31)


def sample_triangles(vertices: Floats, faces: Integers, count: int, *, seed: int, poisson: bool) -> Floats:
    """Return points on a mesh.

    Parameters
    ----------
    vertices : (n, 3) ndarray of float
        Corner points, of the order of 1.
    faces : (m, 3) ndarray of int
        Triangles.
    count : int
        How many points.
    seed : int
        Open3D's generator is one for the whole process; it is seeded here each time.
    poisson : bool
        Whether points keep apart (sample elimination after Yuksel 2015, doi:10.1111/cgf.12538) or are uniform.

    Returns
    -------
    (count, 3) ndarray of float
    """
    open3d = load("open3d")
    mesh = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(np.array(vertices)), open3d.utility.Vector3iVector(faces.astype(np.int32))
    )
    seed_open3d(seed)
    sampler = mesh.sample_points_poisson_disk if poisson else mesh.sample_points_uniformly
    return np.asarray(sampler(count).points, dtype=np.float64)


@contextmanager
def without_stderr() -> Iterator[None]:
    """Keep off the standard error what compiled code writes there past all logging, as the Poisson surface does."""
    try:
        kept = os.dup(2)
    except OSError:
        # it is closed
        yield
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
