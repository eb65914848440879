"""Spheres through four random points of the surface, moved and scaled to fit inside.

The first of four points is random. The other three are random among its nearest 16, 64 or 256 neighbours or among all
points, so that spheres of all sizes occur. The sphere through the four points is kept if its center lies inside the
solid. Where it protrudes by more than a tolerance, it moves away from the surface and shrinks, each by half the excess;
where it does not reach the surface, it grows. Of many such spheres each step adds the one that lowers the distance of
the surface from the clump most.

References
----------
Price, Murariu & Morrison 2007, Sphere clump generation and trajectory comparison for real particles
"""

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran._base.config import parameter, parameter_class
from voxgran._base.lazy import load
from voxgran._base.seeds import stream
from voxgran.clumps.method import Body, ClumpMethod, Fitted
from voxgran.clumps.sphere_sets import INSIDE, SURFACE, Points, SphereSet, best_inserts

#: number of points on the surface
POINTS = 4_000
#: voxels along the equivalent diameter, the centers of which are to be covered
RESOLUTION = 20.0
#: least number of quadruples of points that are drawn
TRIALS = 2_000
#: number of times that a sphere moves and scales
MOVES = 12
#: numbers of neighbours among which the other points are drawn, in equal shares; all points for a last share
NEIGHBOURS = (16, 64, 256)
#: protrusion of the spheres, if omitted, times the cube root of their number
TOLERANCE = 0.07
#: largest radius of a sphere through four points
MOST = 5.0


@parameter_class
class FourPoint:
    """Parameters of the spheres through four points.

    Parameters
    ----------
    tolerance
        largest protrusion of a sphere; if omitted, 0.07 divided by the cube root of the number asked.
    trials
        number of quadruples of points drawn for each sphere.
    min_radius
        smallest radius of a sphere.

    Raises
    ------
    InputError
        If a value is out of range.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.fit_clump(vg.shapes.box(lengths=(1, 1, 2)), method=vg.clumps.FourPoint(), max_spheres=4).count
    4
    """

    tolerance: float | None = parameter(None, unit="equivalent diameters", at_least=0.0, at_most=0.5)
    trials: int = parameter(50, at_least=1, at_most=100_000)
    min_radius: float = parameter(0.02, unit="equivalent diameters", at_least=1e-3, at_most=0.5)


def fit(body: Body, count: int, settings: FourPoint, seed: int) -> Fitted:
    """Return the spheres of the greedy choice."""
    surface = body.surface(POINTS, seed)
    points = Points(surface.points, np.full(POINTS, SURFACE), np.full(POINTS, surface.area))
    deep = body.lattice_points(RESOLUTION, seed)[0]
    points = points.joined(deep, INSIDE, np.full(len(deep), 1.0 / RESOLUTION**2))
    tolerance = TOLERANCE / count ** (1 / 3) if settings.tolerance is None else settings.tolerance
    drawn = _through_four(surface.points, max(TRIALS, settings.trials * count), seed)
    fitted = _fitted(body, surface.points, drawn, tolerance)
    pool = fitted.taken(fitted.radii >= settings.min_radius)
    found = best_inserts(points, SphereSet(np.zeros((0, 3)), np.zeros(0)), pool, count)
    reason = "" if len(found) == count else "no further sphere through four points reduces the distance of the surface"
    return Fitted(found.centers, found.radii, reason)


registration = ClumpMethod(
    summary="spheres through four random points of the surface, moved and scaled to fit inside",
    source="Price, Murariu & Morrison 2007, Sphere clump generation and trajectory comparison for real particles",
    parameters=FourPoint,
    fit=fit,
)


def _through_four(points: Floats, trials: int, seed: int) -> SphereSet:
    """Return the spheres through four points of which three are neighbours of the first."""
    generator = stream(seed, "four points")
    tree = load("scipy.spatial").cKDTree(points)
    first = generator.integers(len(points), size=trials)
    other = generator.integers(len(points), size=(trials, 3))
    for part, number in enumerate(NEIGHBOURS):
        some = slice(part, None, len(NEIGHBOURS) + 1)
        near = tree.query(points[first[some]], number)[1]
        other[some] = np.take_along_axis(near, generator.integers(1, number, size=(len(near), 3)), axis=1)
    base = points[first]
    edges = points[other] - base[:, None]
    volume = linear.determinant(edges)
    good = np.abs(volume) > 1e-9
    offset = linear.solve(2.0 * edges[good], (edges[good] ** 2).sum(axis=2)[:, :, None])[:, :, 0]
    radii = linear.norm(offset, axis=1)
    small = radii < MOST
    return SphereSet(base[good][small] + offset[small], radii[small])


def _fitted(body: Body, points: Floats, spheres: SphereSet, tolerance: float) -> SphereSet:
    """Return the spheres with centers inside after they are moved and scaled until they fit.

    Those that protrude by half their radius are dropped.
    """
    tree = load("scipy.spatial").cKDTree(points)
    inside = spheres.taken(body.depth(spheres.centers) > 0.0)
    centers, radii = inside.centers, inside.radii
    for _ in range(MOVES):
        near, foot = tree.query(centers)
        excess = radii - np.clip(radii, near, near + tolerance)
        away = (centers - points[foot]) / np.maximum(near, 1e-300)[:, None]
        centers = centers + 0.5 * np.maximum(excess, 0.0)[:, None] * away
        radii = radii - 0.5 * excess
    # the surface between the points may be nearer
    depth = body.depth(centers)
    radii = np.minimum(radii, depth + tolerance)
    return SphereSet(centers, radii).taken(depth > 0.5 * radii)
