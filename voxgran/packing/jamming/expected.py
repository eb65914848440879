"""The solid fraction that spheres of a gradation reach when they are packed closely at random, without packing them.

A straight line through a packing cuts the spheres in rods. Rods with the lengths of these cuts are laid on a line, the
longest first, each into the largest gap that is left; two rods keep a gap of a given share of the shorter one. The
share of the line that the rods take is the solid fraction. It takes milliseconds and holds for any gradation.

References
----------
Farr & Groot 2009, Close packing density of polydisperse hard spheres, Journal of Chemical Physics 131, 244104,
doi:10.1063/1.3276799, arXiv:0912.0852.
"""

import heapq
import math
from functools import lru_cache

import numpy as np

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import Floats
from voxgran._base.calls import explained
from voxgran._base.errors import InputError, shown
from voxgran.shapes.sizes import SizeDistribution

#: smallest gap of two rods, in lengths of the shorter one: in three dimensions that of the paper; in the plane that at
#: which as many disks of the diameters 1 and 1.4 have the solid fraction 0.842 (O'Hern et al. 2003)
GAP = {2: 0.2536, 3: 0.7654}
#: number of rods, which gives the solid fraction to about 1e-4, and of sizes from which they are cut
RODS, SIZES = 2**17, 2**17
#: share of 1 by which the cuts of rods follow each other: the golden section, which leaves no gaps
GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0


@explained(hint="expected_solid_fraction(sizes)")
def expected_solid_fraction(sizes: SizeDistribution, *, dimension: int = 3) -> float:
    """Return the solid fraction at which spheres, or disks, of a gradation are expected to be jammed at random.

    Parameters
    ----------
    sizes : SizeDistribution
        Distribution of the diameters; only their ratios count.
    dimension : int
        3 for spheres, 2 for disks.

    Returns
    -------
    float
        Solid fraction far from walls.

    Raises
    ------
    InputError
        If `sizes` is no size distribution, or the dimension is not 2 or 3.

    See Also
    --------
    pack : Pack grains; ``method="jam"`` finds that solid fraction.

    Notes
    -----
    The theory of Farr & Groot has one constant, which is fitted to 0.6435 for equal spheres; for lognormal,
    bidisperse and tridisperse spheres it agrees with simulations. It is that of grains that grow until they jam:
    ``method="jam"`` reaches 0.645, as many spheres of the diameters 1 and 1.4 have 0.653 (theory 0.652), lognormal
    ones with a sigma of 0.3 have 0.670 (0.671), 1,000 grains and three seeds each. Spheres without friction that are
    compressed to a stress jam earlier, at 0.636, 0.644 and 0.661, and LAMMPS compresses the first two to 0.636 and
    0.645. Two sizes of a ratio of 1000 reach 0.86; small spheres in the gaps of large ones, each packed as equal
    spheres are, would reach 0.873. In the plane the same rule is used with a constant for which as many disks of the
    diameters 1 and 1.4 have their published 0.842; there is no published theory to compare with. Walls make a packing
    looser.

    References
    ----------
    Farr & Groot 2009, Close packing density of polydisperse hard spheres, Journal of Chemical Physics 131, 244104,
    doi:10.1063/1.3276799, arXiv:0912.0852.

    Examples
    --------
    >>> import voxgran as vg
    >>> round(vg.expected_solid_fraction(vg.sizes.fixed()), 3)
    0.643
    >>> round(vg.expected_solid_fraction(vg.sizes.lognormal(median=1.0, sigma=0.6)), 2)
    0.73
    """
    if not isinstance(sizes, SizeDistribution):
        raise InputError(f"sizes is {shown(sizes)}: it must be a size distribution; for one size give sizes.fixed")
    shares = (np.arange(SIZES) + 0.5) / SIZES
    diameters = np.asarray(sizes.quantile(shares, basis="volume", dimension=dimension), dtype=np.float64)
    return _of_rods(diameters.tobytes(), (1.0 / diameters).tobytes(), dimension)


def reachable(diameters: Floats, dimension: int) -> float:
    """Return the solid fraction at which given spheres or disks, by their diameters (n,), are expected to jam."""
    ordered = np.sort(diameters)
    return _of_rods(ordered.tobytes(), libm.power(ordered, dimension - 1).tobytes(), dimension)


@lru_cache(maxsize=8)
def _of_rods(bytes_of_diameters: bytes, bytes_of_weights: bytes, dimension: int) -> float:
    """Return the share of a line that rods take, cut from increasing diameters with the numbers of lines they meet.

    It takes some hundredths of a second, and is asked again for each packing of the same grains.
    """
    diameters, weights = np.frombuffer(bytes_of_diameters), np.frombuffer(bytes_of_weights)
    cumulative = np.cumsum(weights)
    place = (np.arange(RODS) + 0.5) / RODS
    cut = diameters[np.searchsorted(cumulative, place * cumulative[-1], side="left").clip(max=len(diameters) - 1)]
    part = (np.arange(1, RODS + 1) * GOLDEN) % 1.0
    # distances of lines from the center are uniform over the disk, or over the diameter in the plane
    rods = np.sort(cut * np.sqrt(part if dimension == 3 else 1.0 - part**2))[::-1].tolist()
    share = GAP[dimension]
    # the gaps beside rods are made in decreasing order; the heap holds what is left of others, with signs reversed
    beside, first = [share * rods[0]], 0
    others: list[float] = []
    for rod in rods[1:]:
        if others and -others[0] > beside[first]:
            left = -heapq.heappop(others) - (1.0 + share) * rod
        else:
            left = beside[first] - (1.0 + share) * rod
            first += 1
        beside.append(share * rod)
        if left > share * rod:
            heapq.heappush(others, -left)
        else:
            beside.append(share * rod)
    total = math.fsum(rods)
    return total / (total + math.fsum([*beside[first:], *(-gap for gap in others)]))
