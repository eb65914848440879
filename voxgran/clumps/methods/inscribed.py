"""Greedy selection of inscribed spheres from the distance transform of the voxels.

The candidates are the largest inscribed spheres centered at voxels of the solid. Only those contained in no other
candidate are kept; their centers lie along the medial surface. Each step adds the candidate that covers the largest
number of uncovered voxels. Coverage is submodular, so the greedy choice covers at least 1 - 1/e of what the best choice
of as many spheres covers (Nemhauser, Wolsey & Fisher 1978, doi:10.1007/BF01588971). A gain computed earlier is an upper
bound of the present one, so few candidates are evaluated again (Minoux 1978, doi:10.1007/BFb0006528).

Radii are distances from the surface, not from voxels. Three times as many candidates as asked are first chosen and
moved by up to about a voxel to where the surface is farther; the spheres are then chosen from these and the others.

References
----------
Inscribed spheres from a distance transform, chosen by radius instead: Angelidakis et al. 2021, CLUMP, SoftwareX 15,
100735, doi:10.1016/j.softx.2021.100735
"""

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.config import parameter, parameter_class
from voxgran._base.kernels import kernel
from voxgran._base.lazy import load
from voxgran.clumps.method import Body, ClumpMethod, Fitted
from voxgran.lattice.distance import inside_distance

#: largest protrusion, in voxels, of a sphere from that of a neighbour for which the sphere is dropped: away from the
#: medial surface radii grow as fast as positions change, and the nearest of the 26 directions deviates by 0.2
SLACK = 0.25
#: number of candidates that are refined for each sphere asked
REFINED = 3
#: steps of the refinement, in voxels
STEPS = tuple(0.5 * 0.7**k for k in range(12))


@parameter_class
class Inscribed:
    """Parameters of the greedy fit.

    Parameters
    ----------
    min_radius
        smallest radius of a sphere.
    resolution
        number of voxels along the equivalent diameter.

    Raises
    ------
    InputError
        If a value is out of range.

    Examples
    --------
    >>> import voxgran as vg
    >>> sphere = vg.shapes.sphere(radius=2.0)
    >>> vg.fit_clump(sphere, method=vg.clumps.Inscribed(), max_spheres=1).radii.round(2).tolist()
    [2.0]
    """

    min_radius: float = parameter(0.02, unit="equivalent diameters", at_least=0.0, at_most=0.5)
    resolution: float = parameter(64.0, at_least=8.0, at_most=512.0)


def fit(body: Body, count: int, settings: Inscribed, seed: int) -> Fitted:
    """Return the spheres of the greedy choice."""
    voxels = body.voxels(settings.resolution)
    room = inside_distance(voxels.mask, 1.0)
    # the distance from voxels is known within a voxel
    deep = room >= settings.min_radius * settings.resolution - 1.0
    places = np.argwhere(_maximal(room) & deep)
    centers = voxels.grid.coordinates(places)
    radii = body.depth(centers)
    # largest first; ties up to rounding in the order of the lattice, so that the result repeats
    order = np.argsort(-np.round(radii, 9), kind="stable")
    order = order[radii[order] >= max(settings.min_radius, 1e-6)]
    centers, radii = centers[order], radii[order]
    index = (centers - np.asarray(voxels.origin)) * settings.resolution - 0.5
    some = _chosen(index, radii * settings.resolution, voxels.mask, REFINED * count)
    centers[some], radii[some] = _refined(body, centers[some], radii[some], 1.0 / settings.resolution)
    index = (centers - np.asarray(voxels.origin)) * settings.resolution - 0.5
    last = _chosen(index, radii * settings.resolution, voxels.mask, count)
    reason = "" if len(last) == count else "no inscribed sphere of at least min_radius covers a further voxel"
    return Fitted(centers[last], radii[last], reason)


registration = ClumpMethod(
    summary="inscribed spheres chosen greedily by the volume they cover, from the distance transform",
    source="Nemhauser, Wolsey & Fisher 1978, doi:10.1007/BF01588971",
    parameters=Inscribed,
    fit=fit,
)


def _chosen(places: Floats, radii: Floats, mask: Booleans, most: int) -> Integers:
    """Return the greedy choice of at most so many spheres, in voxels."""
    taken = np.full(min(most, len(radii)), -1)
    _choose(places, radii, mask.copy(), taken)
    return taken[taken >= 0]


def _refined(body: Body, centers: Floats, radii: Floats, voxel: float) -> tuple[Floats, Floats]:
    """Return centers and radii of inscribed spheres after ascent of the distance from the surface.

    The slope is taken over the length of a step. On the medial surface, where the distance has a kink, it thus points
    along that surface.
    """
    for step in STEPS:
        length = step * voxel
        slope = np.column_stack(
            [body.depth(centers + side) - body.depth(centers - side) for side in length * np.eye(3)]
        )
        slope /= np.maximum(linear.norm(slope, axis=1, keepdims=True), 1e-300)
        moved = centers + length * slope
        depth = body.depth(moved)
        better = depth > radii
        centers, radii = np.where(better[:, None], moved, centers), np.where(better, depth, radii)
    return centers, radii


def _maximal(room: Floats) -> Booleans:
    """Return the mask of the voxels whose sphere lies in no neighbour's sphere; 0 lies around the image."""
    apart = linear.norm(np.indices((3, 3, 3)) - 1.0, axis=0)
    apart[1, 1, 1] = np.inf
    reached = load("scipy.ndimage").grey_dilation(room, structure=-apart, mode="constant")
    return np.asarray((room > 0.0) & (reached < room - SLACK))


@kernel
def _visit(place, radius, left, clear):  # type: ignore[no-untyped-def]
    """Count the uncovered voxels whose centers lie in a sphere, and mark them as covered if `clear`."""
    count = 0
    x, y, z = place[0], place[1], place[2]
    for i in range(max(int(np.ceil(x - radius)), 0), min(int(np.floor(x + radius)) + 1, left.shape[0])):
        for j in range(max(int(np.ceil(y - radius)), 0), min(int(np.floor(y + radius)) + 1, left.shape[1])):
            rest = radius * radius - (i - x) ** 2 - (j - y) ** 2
            if rest < 0.0:
                continue
            half = np.sqrt(rest)
            for k in range(max(int(np.ceil(z - half)), 0), min(int(np.floor(z + half)) + 1, left.shape[2])):
                count += left[i, j, k]
                if clear:
                    left[i, j, k] = False
    return count


@kernel
def _choose(places, radii, left, taken):  # type: ignore[no-untyped-def]
    """Fill `taken` with the spheres of largest gain until none covers a further voxel."""
    bound = 4.2 * (radii + 1.0) ** 3
    for n in range(len(taken)):
        best = bound.argmax()
        gain = _visit(places[best], radii[best], left, False)
        while gain < bound[best]:
            bound[best] = gain
            best = bound.argmax()
            gain = _visit(places[best], radii[best], left, False)
        if gain == 0:
            break
        _visit(places[best], radii[best], left, True)
        bound[best] = 0.0
        taken[n] = best
