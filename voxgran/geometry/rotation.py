"""Rotations as unit quaternions (w, x, y, z), and uniform sets of them."""

import math
from typing import TypeAlias

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, Words
from voxgran._base.kernels import bare_kernel, inlined_kernel
from voxgran._base.seeds import philox_block, unit_float

#: a rotation matrix, row by row
Nine: TypeAlias = tuple[float, float, float, float, float, float, float, float, float]


def rotation_matrices(quaternions: Floats) -> Floats:
    """Return the (n, 3, 3) rotation matrices of (n, 4) unit quaternions.

    The matrix takes body coordinates to the coordinates of the container: ``x = R @ body``.
    """
    w, x, y, z = np.asarray(quaternions, dtype=np.float64).T
    matrix = np.stack(
        [
            *(1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
            *(2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
            *(2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
        ],
        axis=-1,
    )
    return matrix.reshape(-1, 3, 3)


def quaternions_of(matrices: Floats) -> Floats:
    """Return (n, 4) unit quaternions, w >= 0, of (n, 3, 3) rotation matrices.

    Of the four equivalent formulas the one with the largest component is taken (Shepperd 1978,
    doi:10.2514/3.55767b), so that no digits are lost.
    """
    m = np.asarray(matrices, dtype=np.float64).reshape(-1, 3, 3)
    xx, yy, zz = m[:, 0, 0], m[:, 1, 1], m[:, 2, 2]
    squares = np.stack([1 + xx + yy + zz, 1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz], axis=-1)
    wx, wy, wz = m[:, 2, 1] - m[:, 1, 2], m[:, 0, 2] - m[:, 2, 0], m[:, 1, 0] - m[:, 0, 1]
    xy, xz, yz = m[:, 0, 1] + m[:, 1, 0], m[:, 0, 2] + m[:, 2, 0], m[:, 1, 2] + m[:, 2, 1]
    rows = np.stack(
        [
            np.stack([squares[:, 0], wx, wy, wz], axis=-1),
            np.stack([wx, squares[:, 1], xy, xz], axis=-1),
            np.stack([wy, xy, squares[:, 2], yz], axis=-1),
            np.stack([wz, xz, yz, squares[:, 3]], axis=-1),
        ],
        axis=1,
    )
    best = rows[np.arange(len(m)), squares.argmax(axis=1)]
    return normalized(best)


def stretch_of(matrix: Floats) -> float:
    """Return the factor of a (3, 3) matrix that turns and stretches.

    Twice the matrix gives twice the factor to the last bit; `numpy.linalg.det` goes by logarithms and does not.
    """
    return float(np.sqrt((matrix[:, 0] ** 2).sum()))


def normalized(quaternions: Floats) -> Floats:
    """Return quaternions of length 1 with w >= 0."""
    unit = quaternions / linear.norm(quaternions, axis=-1, keepdims=True)
    return np.where(unit[..., :1] < 0, -unit, unit)


def product(a: Floats, b: Floats) -> Floats:
    """Return the Hamilton product: first rotate by `b`, then by `a`; shapes broadcast over (..., 4)."""
    aw, ax, ay, az = np.moveaxis(np.asarray(a), -1, 0)
    bw, bx, by, bz = np.moveaxis(np.asarray(b), -1, 0)
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


def rotations_between(start: Floats, end: Floats) -> Floats:
    """Return (n, 4) quaternions of rotations that take unit vectors `start` (n, 3) to `end`.

    Where the angle is above 90 degrees a half turn about an axis across `start` comes first, so that no digits are lost
    near opposite vectors.
    """
    across = np.cross(start, np.eye(3)[np.abs(start).argmin(axis=1)])
    back = (start * end).sum(axis=1) < 0.0
    first = np.column_stack([np.zeros(len(start)), across / linear.norm(across, axis=1, keepdims=True)])
    first[~back] = [1.0, 0.0, 0.0, 0.0]
    between = np.where(back[:, None], -start, start)
    least = np.column_stack([1.0 + (between * end).sum(axis=1), np.cross(between, end)])
    return normalized(product(normalized(least), first))


def random_rotations(generator: np.random.Generator, count: int) -> Floats:
    """Return (count, 4) quaternions uniform on SO(3) (Shoemake 1992, doi:10.1016/B978-0-08-050755-2.50036-1).

    Examples
    --------
    >>> from voxgran.geometry.rotation import random_rotations
    >>> from voxgran._base.seeds import stream
    >>> random_rotations(stream(1, "turns"), 5).shape
    (5, 4)
    """
    u, v, w = generator.random((3, count))
    inner, outer = np.sqrt(u), np.sqrt(1 - u)
    first, second = 2 * np.pi * v, 2 * np.pi * w
    return normalized(
        np.stack(
            [inner * libm.cos(second), outer * libm.sin(first), outer * libm.cos(first), inner * libm.sin(second)],
            axis=-1,
        )
    )


def lattice_rotations() -> np.ndarray[tuple[int, int, int], np.dtype[np.int64]]:
    """Return the (24, 3, 3) rotation matrices that map a cubic lattice onto itself; the first is the identity."""
    found = []
    for axes in np.array([[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]]):
        for signs in np.array(np.meshgrid([1, -1], [1, -1], [1, -1], indexing="ij")).reshape(3, -1).T:
            matrix = np.zeros((3, 3), dtype=np.int64)
            matrix[np.arange(3), axes] = signs
            if round(float(linear.determinant(matrix))) == 1:
                found.append(matrix)
    return np.array(found)


@inlined_kernel
def matrix_of(q: Floats) -> Nine:
    """Return the rotation matrix of a unit quaternion, row by row."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    return (
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    )  # fmt: skip


@bare_kernel
def write_matrix(q: Floats, matrix: Floats) -> None:
    """Write the rotation matrix of a unit quaternion."""
    r0, r1, r2, r3, r4, r5, r6, r7, r8 = matrix_of(q)
    matrix[0, 0], matrix[0, 1], matrix[0, 2] = r0, r1, r2
    matrix[1, 0], matrix[1, 1], matrix[1, 2] = r3, r4, r5
    matrix[2, 0], matrix[2, 1], matrix[2, 2] = r6, r7, r8


@bare_kernel
def draw_quaternion(dimension: int, key: Words, number: int, quaternion: Floats) -> None:
    """Write the rotation of block (number, 1), uniform over all.

    By the method of Shoemake 1992, doi:10.1016/B978-0-08-050755-2.50036-1.
    """
    a, b, c, _ = philox_block(key[0], key[1], np.uint64(number), np.uint64(1))
    u, first, second = unit_float(a), 2.0 * math.pi * unit_float(b), 2.0 * math.pi * unit_float(c)
    if dimension == 2:
        quaternion[0], quaternion[3] = math.cos(math.pi * u), math.sin(math.pi * u)
        return
    inner, outer = math.sqrt(u), math.sqrt(1.0 - u)
    quaternion[0], quaternion[1] = inner * math.cos(second), outer * math.sin(first)
    quaternion[2], quaternion[3] = outer * math.cos(first), inner * math.sin(second)
