"""Spheres moved and scaled by virtual forces toward points of the surface.

Spheres start at random places inside the solid, each as large as fits there. Every point of the surface attracts the
surface of the sphere that is nearest to it, in proportion to the distance. The resultant moves the center, and the sum
of the forces along the radius changes the radius; both are damped. A sphere has the mass of the points that it owns, so
that a step is stable whatever their number. Spheres that no point attracts stay where they are and fill the inside. A
center that would leave the solid stays, and its velocity is lost. A sphere that has come to lie within another starts
anew where the inside is least covered.

References
----------
Matsushima & Saomoto 2003
"""

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers
from voxgran._base.config import parameter, parameter_class
from voxgran._base.seeds import stream
from voxgran.clumps.method import Body, ClumpMethod, Fitted
from voxgran.clumps.sphere_sets import union_gaps

#: number of points on the surface, at least and for each sphere
POINTS, POINTS_A_SPHERE = 3_000, 40
#: voxels along the equivalent diameter from which places are drawn
RESOLUTION = 24.0
#: number of steps after which spheres within others start anew
ROUND = 40
#: depth, in smallest radii, above which centers stay
NEAR = 0.25
#: square of the step in time, for unit stiffness and mass
STEP = 0.3


@parameter_class
class Dynamic:
    """Parameters of the virtual forces.

    Parameters
    ----------
    steps
        number of steps.
    damping
        share of its velocity that a sphere loses in a step.
    min_radius
        smallest radius of a sphere.

    Raises
    ------
    InputError
        If a value is out of range.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.fit_clump(vg.shapes.box(lengths=(1, 1, 2)), method=vg.clumps.Dynamic(), max_spheres=4).count
    4
    """

    steps: int = parameter(300, at_least=1, at_most=100_000)
    damping: float = parameter(0.3, above=0.0, at_most=1.0)
    min_radius: float = parameter(0.02, unit="equivalent diameters", at_least=1e-3, at_most=0.5)


def fit(body: Body, count: int, settings: Dynamic, seed: int) -> Fitted:
    """Return the spheres after all steps."""
    points = body.surface(max(POINTS, POINTS_A_SPHERE * count), seed).points
    places, depth = _places(body, count, settings.min_radius, seed)
    if not len(places):
        return Fitted(places, depth, "no sphere of min_radius fits")
    centers, radii = places[:count].copy(), depth[:count].copy()
    speed, growth = np.zeros_like(centers), np.zeros_like(radii)
    for step in range(settings.steps):
        if step % ROUND == ROUND - 1 and step < 0.8 * settings.steps:
            for k in _hidden(centers, radii):
                new = int(union_gaps(places, centers, radii)[0].argmax())
                centers[k], radii[k], speed[k], growth[k] = places[new], depth[new], 0.0, 0.0
        pull, push = _forces(points, centers, radii)
        speed = (1.0 - settings.damping) * (speed + STEP * pull)
        growth = (1.0 - settings.damping) * (growth + STEP * push)
        moved = centers + speed
        out = body.depth(moved) <= NEAR * settings.min_radius
        speed[out] = 0.0
        centers = np.where(out[:, None], centers, moved)
        radii = np.maximum(radii + growth, settings.min_radius)
    return Fitted(centers, radii, "" if len(radii) == count else "no further sphere of min_radius fits")


registration = ClumpMethod(
    summary="random spheres moved and scaled by virtual forces toward the surface",
    source="Matsushima & Saomoto 2003",
    parameters=Dynamic,
    fit=fit,
)


def _places(body: Body, count: int, least: float, seed: int) -> tuple[Floats, Floats]:
    """Return random places inside the solid where the smallest sphere fits, and their depths."""
    resolution = max(RESOLUTION, 3.0 * count ** (1 / 3))
    places = body.lattice_points(resolution, seed)[0]
    places = places[stream(seed, "dynamic").permutation(len(places))]
    depth = body.depth(places)
    return places[depth >= least], depth[depth >= least]


def _hidden(centers: Floats, radii: Floats) -> Integers:
    """Return the spheres that lie within another; of two that are equal, the second."""
    apart = linear.norm(centers[:, None] - centers, axis=2)
    within = apart + radii[:, None] <= radii
    np.fill_diagonal(within, False)
    return np.flatnonzero((within & ~np.triu(within & within.T)).any(axis=1))


def _forces(points: Floats, centers: Floats, radii: Floats) -> tuple[Floats, Floats]:
    """Return the accelerations of centers (n, 3) and radii (n,) by the points nearest to each sphere."""
    gap, owner = union_gaps(points, centers, radii)
    away = points - centers[owner]
    away *= (gap / np.maximum(linear.norm(away, axis=1), 1e-300))[:, None]
    mass = np.maximum(np.bincount(owner, minlength=len(radii)), 1)
    pull = np.column_stack([np.bincount(owner, away[:, axis], len(radii)) for axis in range(3)])
    return pull / mass[:, None], np.bincount(owner, gap, len(radii)) / mass
