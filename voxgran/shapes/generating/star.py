"""Surfaces of which one point sees the whole, and a fast proof that such a surface bounds one solid.

If the edges of a triangle mesh are used once in each direction, all faces turn their outer side away from a point, and
their solid angles sum to that of one sphere, then the projection onto a sphere about the point is one-to-one: the
surface is closed, in one piece, and does not cross itself. No search for crossing triangles is needed.
"""

import math

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, Integers

#: smallest volume between a point and a face that counts as positive, relative to the cube of the largest distance
POSITIVE = 1e-18


def is_star_shaped(vertices: Floats, faces: Integers, center: Floats) -> bool:
    """Return whether each ray from a (3,) center leaves the closed surface of a triangle mesh exactly once."""
    rays = vertices - center
    a, b, c = np.moveaxis(rays[faces], 1, 0)
    volumes = linear.einsum("fi,fi->f", a, np.cross(b, c))
    if len(faces) < 4 or volumes.min() <= POSITIVE * np.abs(rays).max() ** 3:
        return False
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    forth, back = np.sort(start * len(vertices) + end), np.sort(end * len(vertices) + start)
    if (forth != back).any() or (forth[1:] == forth[:-1]).any():
        return False
    # Van Oosterom & Strackee 1983, doi:10.1109/TBME.1983.325207
    x, y, z = (linear.norm(corner, axis=1) for corner in (a, b, c))
    ab, bc, ca = (linear.einsum("fi,fi->f", p, q) for p, q in ((a, b), (b, c), (c, a)))
    angles = 2 * libm.arctan2(volumes, x * y * z + ab * z + bc * x + ca * y)
    return abs(float(angles.sum()) - 4 * math.pi) < 1e-6
