"""How much volume of grains comes to rest below a level: by their friction, sizes and shapes, and the walls.

The numbers were fitted to beds of 60 to 900 grains that grew from seeds: spheres, disks, polygons, Platonic solids,
boxes of up to 1 : 1 : 8 and 1 : 8 : 8, ellipsoids, cylinders, cones and unions of solids, with friction from 0 to 2, in
periodic boxes, between walls and in cylinders. They reproduce the heights of these beds to about 7 %.
"""

import math

import numpy as np

from voxgran._base.arrays import Floats
from voxgran.packing.beds.seeds import container_levels, points_inside
from voxgran.packing.problem import Problem
from voxgran.shapes.model import Shape

#: solid fractions of round grains of one size far from walls, by dimension: with much friction, and without
RUBBING, FREE = {2: 0.78, 3: 0.575}, {2: 0.89, 3: 0.63}
#: friction at which beds are between both by a factor of e
USUAL = 0.2
#: increase of the solid fraction by the logarithm of the ratio of the mean diameter by volume to the median one
GRADED = 0.12
#: sphericity (in two dimensions circularity) below which grains pack looser, and the power by which they do
ROUND, POWER = 0.88, {2: 0.4, 3: 1.1}
#: layer at walls that counts as empty, in mean diameters by volume, and the one at the surface, in median ones
AT_WALLS, AT_SURFACE = 0.12, 0.17
#: room that is left between the surface of a bed and the top of the container, in mean diameters by volume
ROOM = 0.8
#: points above each one at which walls are looked for
LOOKS = 4


def usual_solid_fraction(problem: Problem) -> float:
    """Return the solid fraction far from walls in which beds of the grains come to rest."""
    dimension, friction = problem.dimension, problem.parameters.friction
    found = RUBBING[dimension] + (FREE[dimension] - RUBBING[dimension]) * math.exp(-friction / USUAL)
    roundness = np.array([_roundness(shape) for shape in problem.shapes])[problem.shape_id]
    looser = np.minimum(roundness / ROUND, 1.0) ** POWER[dimension]
    graded = 1.0 + GRADED * math.log(max(mean_diameter(problem), 1.0))
    return min(found * graded * float(np.average(looser, weights=problem.volumes)), 1.0)


def mean_diameter(problem: Problem) -> float:
    """Return the mean diameter by volume, in median diameters."""
    return float(np.average(problem.diameter, weights=problem.volumes))


def volume_at_rest(problem: Problem, up: Floats, height: float, generator: np.random.Generator) -> float:
    """Return the volume of grains whose bed has its surface at a height above the lowest point of the container.

    The part of the container where grains lie is estimated from random points, to about one percent. Below walls that
    hang over, as under a hole of a polygon or the vault of a sphere, there is the same room as below a flat top.
    """
    container, size = problem.container, mean_diameter(problem)
    points = points_inside(container, generator)
    within = np.asarray(container.signed_distance(points)) < -AT_WALLS * size
    within &= points @ up < container_levels(container, up)[0] + height - AT_SURFACE
    # several points above each, so that thin walls are seen
    for part in range(1, LOOKS + 1):
        above = points + part / LOOKS * (ROOM * size + AT_SURFACE) * up
        within &= np.asarray(container.signed_distance(above)) < 0.0
    return usual_solid_fraction(problem) * container.volume * float(within.mean())


def highest_surface(problem: Problem, up: Floats) -> float:
    """Return the greatest height to which grains are filled, above the lowest point of the container."""
    floor, top = container_levels(problem.container, up)
    return top - floor - ROOM * mean_diameter(problem)


def _roundness(shape: Shape) -> float:
    """Return the surface of a sphere (disk) of the same volume over that of the shape: its sphericity (circularity)."""
    return min(math.pi * shape.diameter ** (shape.dimension - 1) / shape.surface_area, 1.0)
