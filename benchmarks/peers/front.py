"""The advancing front as a plain program: arrays of NumPy, and near spheres found by the trees of SciPy."""

import heapq
import time

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.lazy import load

#: number of spheres that are added between two trees
GROVE = 200


def plain_front(count: int) -> tuple[float, Floats]:
    """Advance the front of equal spheres of unit diameter with NumPy and SciPy; return the CPU seconds and
    the centers.

    Parameters
    ----------
    count : int
        How many spheres.
    """
    began, tree_of = time.process_time(), load("scipy.spatial").cKDTree
    places = np.zeros((count, 3))
    places[1, 0], places[2, :2] = 1.0, (0.5, 0.75**0.5)
    middle = places[:3].mean(axis=0)
    faces: list[tuple[float, tuple[int, int, int]]] = [(0.0, (0, 1, 2)), (0.0, (1, 0, 2))]
    placed, planted, tree = 3, 3, tree_of(places[:3])
    while placed < count and faces:
        a, b, c = heapq.heappop(faces)[1]
        p, q, s = places[a], places[b], places[c]
        foot = (p + q + s) / 3
        normal = np.cross(q - p, s - p)
        normal /= np.linalg.norm(normal)
        place = foot + np.sqrt(1.0 - ((foot - p) ** 2).sum()) * normal
        recent = ((places[planted:placed] - place) ** 2).sum(axis=1)
        if tree.query(place)[0] < 1 - 1e-9 or (len(recent) and recent.min() < (1 - 1e-9) ** 2):
            continue
        places[placed] = place
        for face in ((a, b, placed), (b, c, placed), (c, a, placed)):
            center = places[list(face)].mean(axis=0) - middle
            heapq.heappush(faces, (float(center @ center), face))
        placed += 1
        if placed - planted == GROVE:
            planted, tree = placed, tree_of(places[:placed])
    return time.process_time() - began, places
