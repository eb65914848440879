"""Connected components of graphs, by SciPy."""

import numpy as np

from voxgran._base.arrays import Integers
from voxgran._base.lazy import load


def components(count: int, one: Integers, two: Integers) -> Integers:
    """Return the connected component of each node of an undirected graph.

    Parameters
    ----------
    count : int
        Number of nodes.
    one, two : (n,) ndarray of int
        The two nodes of each edge.

    Returns
    -------
    (count,) ndarray of int
        Components are numbered from 0 in the order of their first nodes.
    """
    links = load("scipy.sparse").coo_array((np.ones(len(one), dtype=bool), (one, two)), shape=(count, count))
    part: Integers = load("scipy.sparse.csgraph").connected_components(links, directed=False)[1].astype(np.int64)
    return part
