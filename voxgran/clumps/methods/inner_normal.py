"""Tangent spheres that grow along the inner normals of the surface.

At a point of the surface, a sphere tangent to it grows along the inner normal until it meets the surface again. Points
are visited in the order of these spheres, the largest first, or in random order as by the authors. A sphere is added
where the point is farther than a distance from the spheres there are, unless it is smaller than the smallest radius.
The clump lies within the solid. It follows the surface everywhere to within that distance, except where only smaller
spheres fit.

The number of spheres falls with the distance. If the distance is omitted, it is the largest one for which the number of
spheres asked is reached.

References
----------
Ferellec & McDowell 2010, A method to model realistic particle shape and inertia in DEM, Granular Matter 12, 459-467,
doi:10.1007/s10035-010-0205-8
"""

from typing import Literal

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.config import parameter, parameter_class
from voxgran._base.seeds import stream
from voxgran.clumps.method import Body, ClumpMethod, Fitted

#: number of points on the surface, at least and for each sphere asked
POINTS, POINTS_A_SPHERE = 4_000, 20
#: smallest radius, if omitted, times the cube root of the number of spheres
LEAST = 0.2
#: largest and smallest distance that is tried, and number of bisections between
FAR, NEAR, HALVINGS = 1.0, 1e-3, 16


@parameter_class
class InnerNormal:
    """Parameters of the spheres along inner normals.

    Parameters
    ----------
    min_radius
        smallest radius of a sphere; if omitted, 0.2 divided by the cube root of the number asked, at most half the
        largest radius.
    distance
        distance of the surface from the spheres above which a sphere is added; if omitted, the largest with which the
        number asked is reached.
    order
        order in which points of the surface are visited: the largest sphere first, or random.

    Raises
    ------
    InputError
        If a value is out of range.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.fit_clump(vg.shapes.box(lengths=(1, 1, 2)), method=vg.clumps.InnerNormal(), max_spheres=4).count
    4
    """

    min_radius: float | None = parameter(None, unit="equivalent diameters", at_least=1e-3, at_most=0.5)
    distance: float | None = parameter(None, unit="equivalent diameters", above=0.0, at_most=1.0)
    order: Literal["largest", "random"] = parameter("largest")


def fit(body: Body, count: int, settings: InnerNormal, seed: int) -> Fitted:
    """Return the spheres along inner normals."""
    surface = body.surface(max(POINTS, POINTS_A_SPHERE * count), seed)
    order = stream(seed, "inner normals").permutation(len(surface.points))
    centers, radii = body.medial_spheres(surface, order)
    # the surface between the points may be nearer
    radii = np.minimum(radii, body.depth(centers))
    if settings.order == "largest":
        large = np.argsort(-radii, kind="stable")
        order, centers, radii = order[large], centers[large], radii[large]
    feet = surface.points[order]
    least = settings.min_radius
    if least is None:
        least = max(1e-3, min(LEAST / count ** (1 / 3), 0.5 * float(radii.max())))
    good = radii >= least
    if settings.distance is not None:
        chosen = _chosen(feet, centers, radii, good, settings.distance, count)
    else:
        low, high = NEAR, FAR
        chosen = _chosen(feet, centers, radii, good, low, count)
        for _ in range(HALVINGS if len(chosen) == count else 0):
            middle = np.sqrt(low * high)
            found = _chosen(feet, centers, radii, good, middle, count)
            if len(found) == count:
                low, chosen = middle, found
            else:
                high = middle
    reason = "" if len(chosen) == count else "no sphere of at least min_radius touches the surface that is left"
    return Fitted(centers[chosen], radii[chosen], reason)


registration = ClumpMethod(
    summary="spheres that touch the surface and grow along its inner normals",
    source="Ferellec & McDowell 2010, doi:10.1007/s10035-010-0205-8",
    parameters=InnerNormal,
    fit=fit,
)


def _chosen(feet: Floats, centers: Floats, radii: Floats, good: Booleans, far: float, most: int) -> Integers:
    """Return the spheres at points that are farther than a distance from all spheres before, `most` at the most."""
    gap = np.where(good, np.inf, -np.inf)
    chosen: list[int] = []
    k = 0
    while len(chosen) < most:
        left = np.flatnonzero(gap[k:] > far)
        if not len(left):
            break
        k += int(left[0])
        chosen.append(k)
        gap[k] = -np.inf
        np.minimum(gap, linear.norm(feet - centers[k], axis=1) - radii[k], out=gap)
    return np.array(chosen, dtype=np.int64)
