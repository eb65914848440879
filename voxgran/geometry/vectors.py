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
def vector_at(values: Floats, first: int) -> Vector:
    """Return three numbers of an array with one axis."""
    return values[first], values[first + 1], values[first + 2]


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
def add(a: Vector, b: Vector) -> Vector:
    """Return the sum of two vectors."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@inlined_kernel
def times(a: Vector, t: float) -> Vector:
    """Return the vector a times a number."""
    return a[0] * t, a[1] * t, a[2] * t


@inlined_kernel
def rotate(matrix: Floats, a: Vector) -> Vector:
    """Return the product of a matrix and a vector."""
    return (
        matrix[0, 0] * a[0] + matrix[0, 1] * a[1] + matrix[0, 2] * a[2],
        matrix[1, 0] * a[0] + matrix[1, 1] * a[1] + matrix[1, 2] * a[2],
        matrix[2, 0] * a[0] + matrix[2, 1] * a[1] + matrix[2, 2] * a[2],
    )


@inlined_kernel
def rotate_back(matrix: Floats, a: Vector) -> Vector:
    """Return the product of a transposed matrix and a vector."""
    return (
        matrix[0, 0] * a[0] + matrix[1, 0] * a[1] + matrix[2, 0] * a[2],
        matrix[0, 1] * a[0] + matrix[1, 1] * a[1] + matrix[2, 1] * a[2],
        matrix[0, 2] * a[0] + matrix[1, 2] * a[1] + matrix[2, 2] * a[2],
    )


@inlined_kernel
def along(a: Vector, t: float, b: Vector) -> Vector:
    """Return the point a + t b."""
    return a[0] + t * b[0], a[1] + t * b[1], a[2] + t * b[2]
