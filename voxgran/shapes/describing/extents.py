"""Extents of a shape along its principal axes of inertia.

Orientations are distributed about axes of the shapes: the principal axes, or the ones that are given.
"""

from collections.abc import Sequence

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran.geometry.orientation_laws.law import OrientationLaw, axis_in
from voxgran.shapes.mesh import Surface
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.spheres import Spheres


def principal_extents(shape: Shape) -> Floats:
    """Return the extents (3,) of a shape along its principal axes of inertia, largest first; in 2D the third is 0.

    The second is the intermediate axis, by which a grain passes a sieve. The axes of an open surface are those of its
    area.
    """
    geometry = shape.geometry
    inertia = geometry.area_inertia if isinstance(geometry, Surface) else shape.inertia
    axes = linear.eigh(inertia)[1].T
    if shape.dimension == 2:
        # the polar axis is the largest moment; the extents lie in the plane
        axes = np.array([[*axis[:2], 0.0] for axis in linear.eigh(inertia[:2, :2])[1].T])
    if isinstance(geometry, Primitive):
        high = linear.einsum("ij,ij->i", geometry.support(axes), axes)
        low = linear.einsum("ij,ij->i", geometry.support(-axes), axes)
    elif isinstance(geometry, Spheres):
        along = linear.matmul(geometry.centers, axes.T)
        high = (along + geometry.radii[:, None]).max(axis=0)
        low = (along - geometry.radii[:, None]).min(axis=0)
    else:
        along = linear.matmul(shape.vertices, axes.T)
        high, low = along.max(axis=0), along.min(axis=0)
    extents = np.zeros(3)
    extents[: len(axes)] = np.sort(high - low)[::-1]
    return extents


#: relative difference of two moments of inertia from which on their axes are distinct
DISTINCT = 1e-3


def principal_axis(shape: Shape, which: str = "long") -> Floats | None:
    """Return a principal axis of a shape in its frame, a unit vector (3,); None where it has no distinct one.

    The long axis has the smallest moment of inertia, the short one the largest, in 2D both in the plane; spheres and
    cubes have neither. Those of an open surface are those of its area. The largest component is positive.
    """
    geometry = shape.geometry
    inertia = geometry.area_inertia if isinstance(geometry, Surface) else shape.inertia
    d = shape.dimension
    moments, axes = linear.eigh(inertia[:d, :d])
    one, next_to_it = (0, 1) if which == "long" else (-1, -2)
    if abs(moments[one] - moments[next_to_it]) <= DISTINCT * moments[-1]:
        return None
    axis = np.zeros(3)
    axis[:d] = axes[:, one] * np.sign(axes[np.abs(axes[:, one]).argmax(), one])
    return axis


def body_axes(shapes: Sequence[Shape], law: OrientationLaw) -> Floats:
    """Return the axis of each shape that a distribution of orientations is of, in its frame, (s, 3); 0 without one.

    Raises
    ------
    InputError
        If it is given as a vector that leads out of the plane of shapes in two dimensions.
    """
    which = law.body_axis
    if isinstance(which, str):
        found = [principal_axis(shape, which) for shape in shapes]
    else:
        found = [axis_in(which, "body_axis", shape.dimension) for shape in shapes]
    return np.array([np.zeros(3) if axis is None else axis for axis in found]).reshape(-1, 3)
