"""Open3D's samplers of a triangle mesh (uniform and Poisson-disk), the seed of its generator, and silenced output."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.lazy import load


def seed_open3d(seed: int) -> None:
    """Seed the generator of Open3D, which is global to the process."""
    open3d = load("open3d")
    open3d.utility.random.seed(seed % 2**31)


def sample_triangles(vertices: Floats, faces: Integers, count: int, *, seed: int, poisson: bool) -> Floats:
    """Return points (count, 3) on a mesh of a size of the order of 1; the generator of Open3D is seeded on each call.

    Points keep a mutual distance if `poisson` (sample elimination, Yuksel 2015, doi:10.1111/cgf.12538), or are uniform.
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
    """Suppress what compiled code, such as the Poisson reconstruction, writes to the standard error without logging."""
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
