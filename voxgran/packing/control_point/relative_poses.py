"""Relative poses of two grains."""

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel, inlined_kernel
from voxgran.geometry.rotation import matrix_of
from voxgran.geometry.vectors import Vector
from voxgran.packing.control_point.records import GrainPoses, Scratch


@inlined_kernel
def relate(grains: GrainPoses, scratch: Scratch, g: int, j: int, way: Vector) -> None:
    """Write the pose of the grain of lower number in the frame of the other, whose diameter is the unit.

    `way` leads from the center of j to that of g, whose rotation is `scratch.turn`.
    """
    (dx, dy, dz), turn, relative, shift = way, scratch.turn, scratch.relative, scratch.shift
    r0, r1, r2, r3, r4, r5, r6, r7, r8 = matrix_of(grains.orientation[j])
    if j == g:
        # an image of its own goes along with the pose that is tried
        r0, r1, r2 = turn[0, 0], turn[0, 1], turn[0, 2]
        r3, r4, r5 = turn[1, 0], turn[1, 1], turn[1, 2]
        r6, r7, r8 = turn[2, 0], turn[2, 1], turn[2, 2]
    unit = grains.diameter[max(g, j)]
    scale = grains.diameter[min(g, j)] / unit
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
