"""Relative poses of two grains, and where a table remembers a pair."""

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel, inlined_kernel


@bare_kernel
def write_matrix(q: Floats, matrix: Floats) -> None:
    """Write the rotation matrix of a unit quaternion."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    matrix[0, 0], matrix[0, 1], matrix[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    matrix[1, 0], matrix[1, 1], matrix[1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    matrix[2, 0], matrix[2, 1], matrix[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)


@inlined_kernel
def relate(
    orientation: Floats,
    diameter: Floats,
    turn: Floats,
    relative: Floats,
    shift: Floats,
    g: int,
    j: int,
    dx: float,
    dy: float,
    dz: float,
) -> None:
    """Write the pose of the grain of lower number in the frame of the other, whose diameter is the unit."""
    w, x, y, z = orientation[j, 0], orientation[j, 1], orientation[j, 2], orientation[j, 3]
    r0, r1, r2 = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    r3, r4, r5 = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    r6, r7, r8 = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    if j == g:
        # an image of its own goes along with the pose that is tried
        r0, r1, r2 = turn[0, 0], turn[0, 1], turn[0, 2]
        r3, r4, r5 = turn[1, 0], turn[1, 1], turn[1, 2]
        r6, r7, r8 = turn[2, 0], turn[2, 1], turn[2, 2]
    unit = diameter[max(g, j)]
    scale = diameter[min(g, j)] / unit
    for k in range(3):
        t, u, v = turn[0, k], turn[1, k], turn[2, k]
        p, q, r = (
            scale * (t * r0 + u * r3 + v * r6),
            scale * (t * r1 + u * r4 + v * r7),
            scale * (t * r2 + u * r5 + v * r8),
        )
        if g > j:
            relative[k, 0], relative[k, 1], relative[k, 2] = p, q, r
            shift[k] = -(t * dx + u * dy + v * dz) / unit
        else:
            relative[0, k], relative[1, k], relative[2, k] = p, q, r
    if g <= j:
        shift[0] = (r0 * dx + r3 * dy + r6 * dz) / unit
        shift[1] = (r1 * dx + r4 * dy + r7 * dz) / unit
        shift[2] = (r2 * dx + r5 * dy + r8 * dz) / unit


@bare_kernel
def invert(relative: Floats, shift: Floats, scale: float) -> None:
    """Turn the relative pose around: the pose of the second grain in the frame of the first."""
    x, y, z = shift[0], shift[1], shift[2]
    for k in range(3):
        shift[k] = -(relative[0, k] * x + relative[1, k] * y + relative[2, k] * z) / (scale * scale)
    for k in range(3):
        relative[k, k] /= scale * scale
        for m in range(k):
            relative[k, m], relative[m, k] = relative[m, k] / (scale * scale), relative[k, m] / (scale * scale)


@inlined_kernel
def moved_since(poses: Floats, row: int, relative: Floats, shift: Floats, radius: float) -> float:
    """Return how far points within a radius have moved at the most since a relative pose was remembered."""
    way, spin = 0.0, 0.0
    for m in range(3):
        way += (shift[m] - poses[row, 9 + m]) ** 2
        for n in range(3):
            spin += (relative[m, n] - poses[row, 3 * m + n]) ** 2
    # two rotations differ by a matrix with two equal singular values and a zero
    return float(np.sqrt(way) + np.sqrt(0.5 * spin) * radius)


@bare_kernel
def row_of_pair(room: int, pair: int) -> int:
    """Return the entry of a pair in a table whose length is a power of two."""
    return (pair * 2654435761 >> 7) & (room - 1)


@bare_kernel
def take_row(pairs: Integers, poses: Floats, pair: int) -> int:
    """Return the entry of a pair, with nothing in it where another pair had it."""
    row = row_of_pair(len(pairs), pair)
    if pairs[row, 0] != pair:
        pairs[row, 0], pairs[row, 1], pairs[row, 3], poses[row, 12] = pair, -1, 0, -1.0
        poses[row, 13], poses[row, 14], poses[row, 15] = 0.0, 0.0, 0.0
    return row
