"""Vectors of three numbers in kernels: tuples, whose functions are compiled into the kernel that calls them."""

from typing import TypeAlias

from voxgran._base.arrays import Floats
from voxgran._base.kernels import inlined_kernel

Vector: TypeAlias = tuple[float, float, float]


@inlined_kernel
def corner_of(corners: Floats, k: int, c: int) -> Vector:
    """Return corner c of triangle k, or any row of an array with three axes."""
    return corners[k, c, 0], corners[k, c, 1], corners[k, c, 2]


@inlined_kernel
def row_of(rows: Floats, k: int) -> Vector:
    """Return the first three numbers of row k."""
    return rows[k, 0], rows[k, 1], rows[k, 2]


@inlined_kernel
def dot(a: Vector, b: Vector) -> float:
    """Return the scalar product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined_kernel
def cross(a: Vector, b: Vector) -> Vector:
    """Return the vector product of two vectors."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined_kernel
def sub(a: Vector, b: Vector) -> Vector:
    """Return the vector from b to a."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inlined_kernel
def along(a: Vector, t: float, b: Vector) -> Vector:
    """Return the point a + t b."""
    return a[0] + t * b[0], a[1] + t * b[1], a[2] + t * b[2]
