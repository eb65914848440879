"""Covering radius of points on a surface: the largest distance of a surface point from the nearest sample.

A triangle whose corners lie within a given distance of the same sample lies within that distance of it, since spheres
are convex. Triangles with too large a margin are bisected, so that the covering radius is bounded from above and from
below to any accuracy: branch and bound (Land & Doig 1960, doi:10.2307/1910129).
"""

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers
from voxgran._base.lazy import load

#: number of triangles processed at once, which bounds the memory
TRIANGLES = 200_000


def covering_radius(points: Floats, vertices: Floats, faces: Integers, *, accuracy: float = 0.01) -> float:
    """Return an upper bound of the covering radius of points on a surface of triangles, to a relative accuracy."""
    tree = load("scipy.spatial").cKDTree(points)
    least = float(tree.query(vertices)[0].max())
    waiting = [vertices[faces]]
    while waiting:
        triangles = waiting.pop()
        if len(triangles) > TRIANGLES:
            waiting += [triangles[TRIANGLES:], triangles[:TRIANGLES]]
            continue
        distance, nearest = tree.query(triangles.mean(axis=1))
        least = max(least, float(distance.max()))
        most = linear.norm(triangles - points[nearest][:, None], axis=2).max(axis=1)
        wide = most > least * (1 + accuracy)
        if wide.any():
            waiting.append(_halved(triangles[wide]))
    return least * (1 + accuracy)


def _halved(triangles: Floats) -> Floats:
    """Bisect each triangle at the midpoint of its longest edge, so that slivers become less slender."""
    edges = linear.norm(triangles - np.roll(triangles, -1, axis=1), axis=2)
    turn = (edges.argmax(axis=1)[:, None] + np.arange(3)) % 3
    a, b, c = np.moveaxis(np.take_along_axis(triangles, turn[:, :, None], axis=1), 1, 0)
    middle = (a + b) / 2
    return np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
