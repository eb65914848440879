"""Consistent orientation of normals, outward if the points surround a body.

Open3D orients them along a Delaunay triangulation, for which Qhull fails if the points lie on a common sphere.
"""

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran._base.lazy import load

#: weight of an edge between equal normals; 0 would mean no edge in a sparse matrix
LIGHTEST = 1e-9


def turned_alike(points: Floats, normals: Floats, neighbours: int) -> Floats:
    """Return normals with signs such that neighbours agree and the normal of the outermost point is outward.

    Each point has the given number of neighbours (Hoppe, DeRose, Duchamp, McDonald & Stuetzle 1992, Surface
    reconstruction from unorganized points, doi:10.1145/133994.134011).
    """
    if len(points) < 2:
        return normals
    graphs, sparse, many = load("scipy.sparse.csgraph"), load("scipy.sparse"), len(points)
    partner = load("scipy.spatial").cKDTree(points).query(points, k=min(neighbours + 1, many))[1][:, 1:]
    one, other = np.repeat(np.arange(many), partner.shape[1]), partner.ravel()
    weight = LIGHTEST + np.maximum(0.0, 1.0 - np.abs((normals[one] * normals[other]).sum(axis=1)))
    tree = graphs.minimum_spanning_tree(
        sparse.csr_array((weight, (one.astype(np.int32), other.astype(np.int32))), shape=(many, many))
    )
    count, part = graphs.connected_components(tree, directed=False)
    sign = np.ones(many)
    for k in range(count):
        mine = np.flatnonzero(part == k)
        # the normal of the outermost point is outward
        first = int(mine[points[mine, 0].argmax()])
        sign[first] = -1.0 if normals[first, 0] < 0 else 1.0
        order, before = graphs.breadth_first_order(tree, first, directed=False)
        for node in order[1:].tolist():
            agree = float(linear.matmul(normals[node], normals[before[node]])) >= 0
            sign[node] = sign[before[node]] if agree else -sign[before[node]]
    return np.asarray(normals * sign[:, None])
