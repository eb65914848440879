"""Connected bodies on a lattice."""

import numpy as np

from voxgran._base.arrays import Booleans, Integers, as_choice
from voxgran._base.lazy import load

#: how many neighbours a voxel has: by faces, by faces and edges, by corners too
_RANKS = {"6": 1, "18": 2, "26": 3}


def connected_components(mask: Booleans, *, connectivity: int = 6) -> tuple[Integers, int]:
    """Return numbers for the connected bodies of taken voxels.

    Parameters
    ----------
    mask : (nx, ny, nz) ndarray of bool
        Taken voxels.
    connectivity : {6, 18, 26}
        Number of neighbours that a voxel is connected to.

    Returns
    -------
    labels : (nx, ny, nz) ndarray of int
        1 ... count, in the order of the lattice; 0 where nothing is taken.
    count : int
        Number of bodies.

    Raises
    ------
    InputError
        If the connectivity is none of the three.
    """
    rank = _RANKS[as_choice(str(connectivity), "connectivity", tuple(_RANKS))]
    ndimage = load("scipy.ndimage")
    labels, count = ndimage.label(mask, ndimage.generate_binary_structure(3, rank))
    return labels.astype(np.int64), int(count)
