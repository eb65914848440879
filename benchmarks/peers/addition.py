"""Random sequential addition as a plain program: the peer that its speed is a ratio to."""

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.lazy import load
from voxgran._base.seeds import stream


def scipy_addition(lengths: Floats, tries: int, *, seed: int = 0) -> tuple[Floats, int]:
    """Add spheres of diameter 1 at random places of a periodic box, with NumPy and the trees of SciPy.

    Places come in batches; those that lie too near to a sphere are refused by a tree over the spheres, and of the rest
    each that lies too near to an earlier one of its batch.

    Parameters
    ----------
    lengths : (2,) or (3,) ndarray of float
        Edges of the box, in diameters.
    tries : int
        Random places in all.
    seed : int
        Seed of the run.

    Returns
    -------
    centers : (n, 2) or (n, 3) ndarray of float
        The spheres.
    refused : int
        Places that were refused.
    """
    tree_of, generator = load("scipy.spatial").cKDTree, stream(seed, "scipy addition")
    centers = np.zeros((0, len(lengths)))
    batch = max(int(np.prod(lengths)) // 4, 100)
    for begin in range(0, tries, batch):
        places = generator.random((min(batch, tries - begin), len(lengths))) * lengths
        if len(centers):
            places = places[tree_of(centers, boxsize=lengths).query(places, distance_upper_bound=1.0)[0] >= 1.0]
        refused = np.zeros(len(places), dtype=bool)
        pairs = tree_of(places, boxsize=lengths).query_pairs(1.0, output_type="ndarray") if len(places) else []
        for i, j in sorted(map(tuple, np.asarray(pairs).tolist())):
            refused[j] |= not refused[i]
        centers = np.concatenate([centers, places[~refused]])
    return centers, tries - len(centers)
