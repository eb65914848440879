"""Greedy selection of inscribed spheres from the distance transform of the voxels.

The candidates are the largest inscribed spheres centered at the voxels of the solid. Only those contained in no other
candidate are kept; their centers lie along the medial surface. Each step adds the candidate that covers the largest
number of uncovered voxels. Coverage is submodular, so the greedy choice covers at least 1 - 1/e of what the best choice
of as many spheres covers (Nemhauser, Wolsey & Fisher 1978, doi:10.1007/BF01588971). A gain computed earlier is an upper
bound of the present one, so few candidates are evaluated again (Minoux 1978, doi:10.1007/BFb0006528). Radii are
distances to the nearest voxel outside; the clump therefore lies within the solid up to one voxel, and is smaller.

References
----------
Inscribed spheres from a distance transform, chosen by radius instead: Angelidakis et al. 2021, CLUMP, SoftwareX 15,
100735, doi:10.1016/j.softx.2021.100735
"""

from dataclasses import dataclass

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.config import check_bounds, parameter
from voxgran._base.kernels import kernel
from voxgran.clumps.method import ClumpMethod, Wanted
from voxgran.lattice.distance import inside_distance
from voxgran.voxels.model import Voxels

#: largest protrusion, in voxels, of a sphere from that of a neighbour for which the sphere is dropped: away from the
#: medial surface radii grow as fast as positions change, and the nearest of the 26 directions deviates by 0.2
SLACK = 0.25


@dataclass(frozen=True, kw_only=True, slots=True)
class Inscribed:
    """Parameters of the greedy fit.

    Raises
    ------
    InputError
        If the smallest radius is negative.
    """

    min_radius: float = parameter(
        0.0, doc="smallest radius of a sphere", unit="voxels", former="smallest", at_least=0.0
    )

    def __post_init__(self) -> None:
        """Check the range."""
        check_bounds(self)


def fit(voxels: Voxels, wanted: Wanted, parameters: Inscribed) -> tuple[Floats, Floats]:
    """Return centers (n, 3) and radii (n,) of the greedy choice."""
    room = inside_distance(voxels.mask, 1.0)
    places = np.argwhere(_maximal(np.pad(room, 1)) & (room >= parameters.min_radius))
    radii = room[tuple(places.T)]
    # largest first; ties in the order of the lattice, so that the result repeats
    order = np.argsort(-radii, kind="stable")
    places, radii = places[order], radii[order]
    taken = np.zeros(min(wanted.max_spheres, len(radii)), dtype=np.int64)
    enough = int(np.ceil(wanted.target * voxels.mask.sum() - 1e-9))
    far = wanted.tolerance / voxels.voxel_size
    count = _choose(places, radii, voxels.mask.copy(), enough, far, taken)
    chosen = taken[:count]
    return voxels.grid.coordinates(places[chosen]), radii[chosen] * voxels.voxel_size


registration = ClumpMethod(
    name="inscribed",
    summary="inscribed spheres chosen greedily by the volume they cover, from the distance transform",
    source="Nemhauser, Wolsey & Fisher 1978, doi:10.1007/BF01588971",
    parameters=Inscribed,
    fit=fit,
)


@kernel
def _maximal(room):  # type: ignore[no-untyped-def]
    """Return the mask of the voxels whose sphere lies in no neighbour's sphere; `room` has a border of zeros."""
    nx, ny, nz = room.shape
    keep = np.zeros((nx - 2, ny - 2, nz - 2), dtype=np.bool_)
    for i in range(1, nx - 1):
        for j in range(1, ny - 1):
            for k in range(1, nz - 1):
                good = room[i, j, k] > 0.0
                for n in range(27):
                    a, b, c = n // 9 - 1, n // 3 % 3 - 1, n % 3 - 1
                    apart = np.sqrt(float(a * a + b * b + c * c))
                    if n != 13 and room[i + a, j + b, k + c] >= room[i, j, k] + apart - SLACK:
                        good = False
                keep[i - 1, j - 1, k - 1] = good
    return keep


@kernel
def _visit(place, radius, left, clear):  # type: ignore[no-untyped-def]
    """Count the uncovered voxels of a sphere, and mark them as covered if `clear`."""
    count = 0
    square = radius * radius * (1.0 + 1e-12)
    reach = int(radius) + 1
    x, y, z = place[0], place[1], place[2]
    for i in range(max(x - reach, 0), min(x + reach + 1, left.shape[0])):
        for j in range(max(y - reach, 0), min(y + reach + 1, left.shape[1])):
            rest = square - (i - x) ** 2 - (j - y) ** 2
            if rest < 0.0:
                continue
            half = int(np.sqrt(rest))
            for k in range(max(z - half, 0), min(z + half + 1, left.shape[2])):
                count += left[i, j, k]
                if clear:
                    left[i, j, k] = False
    return count


@kernel
def _farthest(gap, left, place, radius):  # type: ignore[no-untyped-def]
    """Update the distances of the uncovered voxels for a new sphere and return the largest one."""
    most = 0.0
    for i in range(left.shape[0]):
        for j in range(left.shape[1]):
            for k in range(left.shape[2]):
                if left[i, j, k]:
                    square = float((i - place[0]) ** 2 + (j - place[1]) ** 2 + (k - place[2]) ** 2)
                    gap[i, j, k] = min(gap[i, j, k], np.sqrt(square) - radius)
                    most = max(most, gap[i, j, k])
    return most


@kernel
def _choose(places, radii, left, enough, far, taken):  # type: ignore[no-untyped-def]
    """Add the sphere of largest gain until `enough` voxels are covered, or all others lie within `far` of the clump."""
    bound = 4.2 * (radii + 1.0) ** 3
    gap = np.full(left.shape, np.inf)
    covered, count = 0, 0
    while count < len(taken) and covered < enough:
        best = bound.argmax()
        gain = _visit(places[best], radii[best], left, False)
        while gain < bound[best]:
            bound[best] = gain
            best = bound.argmax()
            gain = _visit(places[best], radii[best], left, False)
        if gain == 0:
            break
        covered += _visit(places[best], radii[best], left, True)
        bound[best] = 0.0
        taken[count] = best
        count += 1
        if far > 0.0 and _farthest(gap, left, places[best], radii[best]) <= far:
            break
    return count
