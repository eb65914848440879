"""How well points cover a surface: the largest distance of a place on it from the nearest of the points.

A triangle whose corners lie within a distance of one and the same point lies within that distance of it, since spheres
are convex. Triangles for which that leaves too wide a margin are cut in two, so that the covering radius is bounded
from above and from below as tightly as one likes: branch and bound (Land & Doig 1960, doi:10.2307/1910129).
"""

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.lazy import load

#: triangles asked at once: bounds the memory
TRIANGLES = 200_000


def covering_radius(points: Floats, vertices: Floats, faces: Integers, *, accuracy: float = 0.01) -> float:
    """Return an upper bound of the covering radius of points on a surface.

    Parameters
    ----------
    points : (n, 3) ndarray of float
        Points, in the unit of lengths.
    vertices : (k, 3) ndarray of float
        Corner points of the surface.
    faces : (m, 3) ndarray of int
        Triangles.
    accuracy : float
        By which share the bound may be too large.

    Returns
    -------
    float
        In the unit of lengths.
    """
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
        most = np.linalg.norm(triangles - points[nearest][:, None], axis=2).max(axis=1)
        wide = most > least * (1 + accuracy)
        if wide.any():
            waiting.append(_halved(triangles[wide]))
    return least * (1 + accuracy)


def _halved(triangles: Floats) -> Floats:
    """Cut each triangle in two at the middle of its longest edge, so that slivers become less slender."""
    edges = np.linalg.norm(triangles - np.roll(triangles, -1, axis=1), axis=2)
    turn = (edges.argmax(axis=1)[:, None] + np.arange(3)) % 3
    a, b, c = np.moveaxis(np.take_along_axis(triangles, turn[:, :, None], axis=1), 1, 0)
    middle = (a + b) / 2
    return np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
