"""How much volume of grains comes to rest below a level: by their friction, sizes and shapes, and the walls.

The numbers were fitted to beds of 60 to 900 grains that grew from seeds: spheres, disks, polygons, Platonic solids,
boxes of up to 1 : 1 : 8 and 1 : 8 : 8, ellipsoids, cylinders, cones and unions of solids, with friction from 0 to 2, in
periodic boxes, between walls and in cylinders. They reproduce the heights of these beds to about 7 %; and those of
rings, tori, cylinders of several holes, assemblies of spheres and grains of random growth.
"""

import math
from collections.abc import Iterator

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Booleans, Floats
from voxgran._base.lazy import load
from voxgran._base.scalars import cube_root
from voxgran.containers.model import Container
from voxgran.packing.beds.seeds import container_levels, points_inside
from voxgran.packing.problem import Problem
from voxgran.settling.materials import Materials, mean_friction
from voxgran.shapes.describing.ratios import Form, sphericity
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive

#: solid fractions of round grains of one size far from walls, by dimension: with much friction, and without
RUBBING, FREE = {2: 0.78, 3: 0.575}, {2: 0.89, 3: 0.63}
#: friction at which beds are between both by a factor of e
USUAL = 0.2
#: increase of the solid fraction by the logarithm of the ratio of the mean diameter by volume to the median one
GRADED = 0.12
#: sphericity (in two dimensions circularity) below which grains pack looser, and the power by which they do
ROUND, POWER = 0.88, {2: 0.4, 3: 1.1}
#: power of the share of its hull that a grain fills, below 1 since others enter a part of the rest
ENTERED = 0.85
#: layer at walls that counts as empty, in mean diameters by volume, and the one at the surface, in median ones
AT_WALLS, AT_SURFACE = 0.12, 0.17
#: room that is left between the surface of a bed and the top of the container, in mean diameters by volume; and largest
#: share of the height of the container
ROOM, SHARE = 0.8, 0.16
#: shares of the width of a narrow column by which spheres at rest alternate: at the most, and certainly
ALTERNATING, SURE = 0.9, 0.7
#: diameters of the largest grains from the walls to the farthest point, from which on a container is no narrow column
WIDE = 1.5
#: distance of grains that stand on a square lattice in a thin layer, in diameters; from seeds they find room for more
LATTICE = 1.05
#: gap of grains at rest, in their diameters, and rounding of distances from walls
APART, ROUNDING = 1e-3, 1e-12
#: points above each one at which walls are looked for
LOOKS = 4


def usual_solid_fraction(problem: Problem, friction: float | Materials | None = None) -> float:
    """Return the solid fraction far from walls in which beds of the grains come to rest.

    The friction is that of the method, unless it is given.
    """
    dimension, friction = problem.dimension, problem.parameters.friction if friction is None else friction
    friction = mean_friction(friction, problem.shape_id, len(problem.shapes))
    found = RUBBING[dimension] + (FREE[dimension] - RUBBING[dimension]) * math.exp(-friction / USUAL)
    looser = problem.cache.keep(("looser",), lambda: np.array([_looser(shape) for shape in problem.shapes]))
    graded = 1.0 + GRADED * math.log(max(mean_diameter(problem), 1.0))
    return min(found * graded * float(np.average(looser[problem.shape_id], weights=problem.volumes)), 1.0)


def _looser(shape: Shape) -> float:
    """Return the solid fraction of grains of a shape over that of round ones.

    It follows from the sphericity of the shape or, where that gives more, from the one of its hull and the share of the
    hull that is solid: grains hardly enter bores and pores, whose surface makes the shape less spherical.
    """
    d, form = shape.dimension, Form(shape)
    own = float(libm.power(min(sphericity(form) / ROUND, 1.0), POWER[d]))
    if own == 1.0 or isinstance(shape.geometry, Primitive):
        return own
    hull = load("scipy.spatial").ConvexHull(shape.vertices[:, :d])
    sphere = math.sqrt(4 * math.pi * hull.volume) if d == 2 else math.pi * cube_root(6 * hull.volume / math.pi) ** 2
    share = min(shape.volume / hull.volume, 1.0)
    return max(
        own, float(libm.power(share, ENTERED)) * float(libm.power(min(sphere / hull.area / ROUND, 1.0), POWER[d]))
    )


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
    within &= linear.matmul(points, up) < container_levels(container, up)[0] + height - AT_SURFACE
    # several points above each, so that thin walls are seen
    for part in range(1, LOOKS + 1):
        above = points + part / LOOKS * (_room(problem, up) + AT_SURFACE) * up
        within &= np.asarray(container.signed_distance(above)) < 0.0
    fraction, asked = usual_solid_fraction(problem), problem.parameters.solid_fraction
    if asked is not None:
        # beds are no denser than without friction
        fraction = min(asked, usual_solid_fraction(problem, 0.0))
    return fraction * container.volume * float(within.mean())


def in_column(problem: Problem, up: Floats, count: int, height: float | None, generator: np.random.Generator) -> int:
    """Return how many grains come to rest in a column so narrow that no two spheres lie side by side, or in a layer so
    thin that none lie on each other; else `count`.

    A column may stand, lean or lie: it is looked for along the axes and along gravity. Centers that are no farther
    apart across it than w are sqrt(d^2 - w^2) apart along it at least, from one sphere of diameter d to the next:
    spheres at rest are hardly closer, and never farther where w is less than the whole width. In a layer as many find
    room as stand on a square lattice of `LATTICE` diameters. `height` is that of the bed, if one is asked for.
    """
    container = problem.container
    if not problem.count:
        return count
    points = with_middles(points_inside(container, generator), container)
    room = -np.asarray(container.signed_distance(points))
    least = float(problem.diameter.min())
    bounding = problem.bounding_radii
    largest = (1.0 + APART) * 2.0 * float(bounding.max())
    if room.max() > WIDE * largest:
        return count
    spheres, lowest = all(shape.is_sphere for shape in problem.shapes), container_levels(container, up)[0]

    def held(places: Floats) -> Booleans:
        """Return where the largest grains are within the container, and below the height."""
        within: Booleans = np.asarray(container.signed_distance(places)) <= ROUNDING - 0.5 * largest
        return within if height is None else within & (linear.matmul(places, up) <= lowest + height - 0.5 * largest)

    most, sure = count, 0
    for axis in (up, *np.eye(3)[: problem.dimension]):
        if np.any(np.array(container.periodic) & (np.abs(axis) < 1.0)):
            continue
        # from the lower end on
        along = -axis if linear.matmul(axis, up) < 0.0 else axis
        start, end = container_levels(container, along)
        length = end - start if height is None or linear.matmul(along, up) < 1.0 else height
        across = points - linear.matmul(points, along)[:, None] * along
        rise = _zigzag(across[room >= 0.5 * least], least, ALTERNATING)[0]
        if rise > 0.0 and spheres:
            most = min(most, 1 + int((length - least) / rise))
        rise, middle, away = _zigzag(across[room >= 0.5 * largest], largest, SURE)
        if rise > 0.0:
            levels = np.arange(0.5 * largest, length - 0.5 * largest, rise)
            side = np.where(np.arange(len(levels)) % 2, 1.0, -1.0)
            places = middle + (start + levels)[:, None] * along + side[:, None] * away
            sure = max(sure, int(np.argmin(np.append(held(places), False))))
    for places in _thin_layers(container, points[room >= 0.5 * largest], largest):
        sure = max(sure, int(held(places).sum()))
    return min(max(most, sure), problem.count)


def with_middles(points: Floats, container: Container) -> Floats:
    """Return points (n, 3) and their projections on the middle of the bounding box along each axis and each two axes:
    the centers in a container hardly wider than a grain, which random points miss.
    """
    middle = np.mean(container.bounds, axis=0)
    axes = np.eye(3, dtype=bool)[: container.dimension]
    flat = [one | other for k, one in enumerate(axes) for other in axes[k:]]
    return np.concatenate([points, *(np.where(mask, middle, points) for mask in flat)])


def _thin_layers(container: Container, centers: Floats, diameter: float) -> Iterator[Floats]:
    """Yield the places (n, 3) of a square lattice in the middle of a container, across each axis along which the
    centers of spheres are closer than a diameter.
    """
    if container.dimension < 3 or not len(centers):
        return
    inset = 0.5 * diameter
    ends = [
        np.arange(low + inset, high - inset, LATTICE * diameter) for low, high in zip(*container.bounds, strict=True)
    ]
    for axis in np.flatnonzero(np.ptp(centers, axis=0) < diameter):
        rows = [centers.mean(axis=0)[[k]] if k == axis else ends[k] for k in range(3)]
        yield np.stack(np.meshgrid(*rows, indexing="ij"), axis=-1).reshape(-1, 3)


def _zigzag(centers: Floats, diameter: float, share: float) -> tuple[float, Floats, Floats]:
    """Return how far spheres that alternate are apart along a column, 0 side by side, its middle and the way from it.

    The centers are places across the column at which a sphere is within.
    """
    if not len(centers):
        return diameter, np.zeros(3), np.zeros(3)
    middle = centers.mean(axis=0)
    ways = centers - middle
    away = share * ways[np.argmax(linear.einsum("ij,ij->i", ways, ways))]
    return math.sqrt(max(diameter**2 - 4.0 * float(linear.matmul(away, away)), 0.0)), middle, away


def highest_surface(problem: Problem, up: Floats) -> float:
    """Return the greatest height to which grains are filled, above the lowest point of the container."""
    floor, top = container_levels(problem.container, up)
    return top - floor - _room(problem, up)


def _room(problem: Problem, up: Floats) -> float:
    """Return the room that is left above a bed; little in a low container, which would be empty otherwise."""
    floor, top = container_levels(problem.container, up)
    return min(ROOM * mean_diameter(problem), SHARE * (top - floor))
