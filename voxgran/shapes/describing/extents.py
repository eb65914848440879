"""Extents of a shape along its principal axes of inertia."""

import numpy as np

from voxgran._base.arrays import Floats
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.spheres import Spheres
from voxgran.shapes.surface import Surface


def principal_extents(shape: Shape) -> Floats:
    """Return the extents (3,) of a shape along its principal axes of inertia, largest first; in 2D the third is 0.

    The second is the intermediate axis, by which a grain passes a sieve. The axes of an open surface are those of its
    area.
    """
    geometry = shape.geometry
    inertia = geometry.area_inertia if isinstance(geometry, Surface) else shape.inertia
    axes = np.linalg.eigh(inertia)[1].T
    if shape.dimension == 2:
        # the polar axis is the largest moment; the extents lie in the plane
        axes = np.array([[*axis[:2], 0.0] for axis in np.linalg.eigh(inertia[:2, :2])[1].T])
    if isinstance(geometry, Primitive):
        high = np.einsum("ij,ij->i", geometry.support(axes), axes)
        low = np.einsum("ij,ij->i", geometry.support(-axes), axes)
    elif isinstance(geometry, Spheres):
        along = geometry.centers @ axes.T
        high = (along + geometry.radii[:, None]).max(axis=0)
        low = (along - geometry.radii[:, None]).min(axis=0)
    else:
        along = shape.vertices @ axes.T
        high, low = along.max(axis=0), along.min(axis=0)
    extents = np.zeros(3)
    extents[: len(axes)] = np.sort(high - low)[::-1]
    return extents
