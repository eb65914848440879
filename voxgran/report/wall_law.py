"""Published solid fraction of equal spheres near a wall, for comparison with a profile."""

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arrays import Floats
from voxgran.containers.model import boundary_of
from voxgran.packing.model import Packing

#: range of the diameters, relative to their mean, up to which spheres count as equal
EQUAL = 0.02
#: distance from the wall, in diameters, at which the two parts of the law meet
SEAM = 0.637


def wall_law(distance: "ArrayLike", *, bulk: float) -> Floats:
    """Return the solid fraction (n,) of a bed of equal spheres at distances (n,) from a cylindrical wall, in diameters;
    `bulk` is the solid fraction far from the wall.

    References
    ----------
    de Klerk 2003, Voidage variation in packed beds at small column to particle diameter ratio,
    doi:10.1002/aic.690490812
    """
    x = np.asarray(distance, dtype=np.float64)
    near = 2.14 * x**2 - 2.53 * x + 1.0
    far = 1.0 - bulk + 0.29 * np.exp(-0.6 * x) * np.cos(2.3 * np.pi * (x - 0.16)) + 0.15 * np.exp(-0.9 * x)
    return np.asarray(1.0 - np.where(x <= SEAM, near, far))


def law_applies(packing: Packing) -> bool:
    """Return whether the law is for such a packing: equal spheres, in three dimensions, in an upright cylinder."""
    if packing.dimension == 2 or not boundary_of(packing.container).cylinder or packing.count < 2:
        return False
    size = packing.diameters
    spheres = all(packing.shapes[index].is_sphere for index in np.unique(packing.shape_id))
    return bool(spheres and np.ptp(size) <= EQUAL * size.mean())
