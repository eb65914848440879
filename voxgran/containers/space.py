"""The space within walls: of revolution about one axis, or within planes, cylinders, cones and spheres."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.errors import InputError
from voxgran._base.lazy import load
from voxgran.containers.model import Boundary, Surface
from voxgran.geometry.walls import Round, cone, planes_across
from voxgran.shapes.mesh import hull_of
from voxgran.shapes.model import Shape
from voxgran.shapes.tessellate import revolved, sphere

#: tangent planes of a cylinder or cone, subdivisions of a sphere
SIDES, SUBDIVISIONS = 96, 3
#: corners nearer to each other, in lengths of the space, are one; the shift keeps round numbers away from the rounding
ONE_CORNER, SHIFT = 1e-9, 0.3183
#: lines in each of two directions by which a volume is found, several times
LINES = (320, 288, 256)
#: halvings of the way from the middle to the walls
HALVINGS = 60


class Space(NamedTuple):
    """What lies within walls: its boundary, bounds (2, 3), volume and its relative error, and a mesh for pictures."""

    boundary: Boundary
    bounds: Floats
    volume: float
    error: float
    vertices: Floats
    faces: Integers


def revolved_space(profile: Sequence[tuple[float, float]], origin: Sequence[float], axis: int = 2) -> Space:
    """Return what lies within a convex profile of heights and radii, from below, about an axis through a point."""
    away = np.eye(3)[axis]
    way = _place(away)
    walls, volume = [], 0.0
    for (z, r), (above, wide) in pairwise(profile):
        center = _place(np.array(origin) + z * away)
        wall = Round(center, r) if r == wide else cone(center, r, math.atan2(above - z, wide - r))
        walls.append(wall._replace(axis=way))
        volume += math.pi / 3 * (above - z) * (r * r + r * wide + wide * wide)
    vertices, faces, _ = revolved(profile)
    vertices = vertices @ walls[0].frame + np.array(origin)
    reach = max(r for _, r in profile) * (1.0 - away)
    bounds = np.array(origin) + np.array([profile[0][0] * away - reach, profile[-1][0] * away + reach])
    return Space(Boundary((*planes_across(bounds, "xyz"[axis]), *walls)), bounds, volume, 0.0, vertices, faces)


def space_within(walls: Sequence[Round], where: str) -> Space:
    """Return what lies within all walls.

    What planes alone bound is a polyhedron, whose volume is exact; else the volume is the sum of the lengths of lines,
    and its error twice the largest difference of sums over lines of different distances.

    Raises
    ------
    InputError
        If nothing lies within all walls, or what does is not bounded.
    """
    # a power of two as the unit: containers that are scaled by one have the same bits
    numbers = [*(abs(x) for wall in walls for x in wall.center), *(wall.radius for wall in walls)]
    unit = 2.0 ** math.floor(math.log2(max(numbers, default=1.0) or 1.0))
    scaled = [w._replace(center=_place(np.array(w.center) / unit), radius=w.radius / unit) for w in walls]
    vertices, faces, middle = tangent_mesh(scaled, where)
    bounds = np.array([vertices.min(axis=0), vertices.max(axis=0)])
    if all(wall.kind == "plane" for wall in walls):
        shape = Shape.from_mesh(vertices * unit, faces, name="container")
        made = shape.vertices + np.array(shape.offset)
        return Space(Boundary((Surface(shape),)), bounds * unit, shape.volume, 0.0, made, shape.faces)
    boundary = Boundary(tuple(scaled))
    volumes = [_volume(boundary, bounds, count) for count in LINES]
    # corners of the tangent planes, moved to the walls
    low, high = np.zeros(len(vertices)), np.ones(len(vertices))
    for _ in range(HALVINGS):
        half = (low + high) / 2
        inside = boundary.signed_distance(middle + half[:, None] * (vertices - middle)) < 0
        low, high = np.where(inside, half, low), np.where(inside, high, half)
    hull = hull_of(_distinct(middle + low[:, None] * (vertices - middle)))
    volume, error = volumes[0] * unit**3, 2 * float(np.ptp(volumes)) / volumes[0]
    return Space(Boundary(tuple(walls)), bounds * unit, volume, error, hull.vertices * unit, hull.faces)


def tangent_mesh(walls: Sequence[Round], where: str, sides: int = SIDES) -> tuple[Floats, Integers, Floats]:
    """Return vertices and triangles of the polyhedron of planes that touch walls from outside, and a point within.

    Raises
    ------
    InputError
        If nothing lies within all walls, or what does is not bounded.
    """
    tangents = [_tangents(wall, sides) for wall in walls]
    normals, levels = (np.concatenate(rows) for rows in zip(*tangents, strict=True))
    optimize, spatial = load("scipy.optimize"), load("scipy.spatial")
    free = [(None, None)] * 3
    room = np.ones((len(normals), 1))
    found = optimize.linprog([0, 0, 0, -1], A_ub=np.hstack([normals, room]), b_ub=levels, bounds=[*free, (None, 1.0)])
    if not found.success or found.x[3] <= ONE_CORNER:
        raise InputError(f"{where}: nothing lies within all of its {len(walls)} walls; turn or move them")
    middle = np.asarray(found.x[:3])
    for axis in range(3):
        for sign, side in ((1.0, "high"), (-1.0, "low")):
            cost = -sign * np.eye(3)[axis]
            if not optimize.linprog(cost, A_ub=normals, b_ub=levels, bounds=free).success:
                raise InputError(
                    f"{where}: what lies within its {len(walls)} walls has no end at the {side} end of "
                    f"{'xyz'[axis]}; add a wall there"
                )
    cut = spatial.HalfspaceIntersection(np.column_stack([normals, -levels]), middle)
    mesh = hull_of(_distinct(cut.intersections))
    return mesh.vertices, mesh.faces, middle


def _place(vector: Floats) -> tuple[float, float, float]:
    """Return a vector as a tuple."""
    x, y, z = vector.tolist()
    return x, y, z


def _tangents(wall: Round, sides: int) -> tuple[Floats, Floats]:
    """Return normals (k, 3) and levels (k,) of planes that touch a wall from outside."""
    if wall.kind == "sphere":
        normals = np.concatenate([sphere(SUBDIVISIONS)[0], np.eye(3), -np.eye(3)])
    elif wall.kind == "plane":
        normals = np.array([wall.axis])
    else:
        angle = 2 * math.pi * np.arange(sides) / sides
        around = np.stack([np.cos(angle), np.sin(angle)], axis=1) * wall.cosine
        normals = np.column_stack([around, np.full(sides, wall.sine)]) @ wall.frame
    return normals, normals @ np.array(wall.center) + wall.radius


def _distinct(points: Floats) -> Floats:
    """Return the points (n, 3) that are corners of their convex hull, each once."""
    _, first = np.unique(np.round(points / ONE_CORNER + SHIFT), axis=0, return_index=True)
    points = points[np.sort(first)]
    return np.asarray(points[np.sort(load("scipy.spatial").ConvexHull(points).vertices)])


def _volume(boundary: Boundary, bounds: Floats, count: int) -> float:
    """Return the volume within walls of revolution by so many lines along z in each of two directions."""
    low, step = bounds[0], (bounds[1] - bounds[0]) / count
    x, y = (low[k] + (np.arange(count) + 0.5) * step[k] for k in range(2))
    points = np.stack([*np.meshgrid(x, y, indexing="ij"), np.full((count, count), low[2])], axis=-1).reshape(-1, 3)
    start, end = boundary.along(points, (0, 1, 2))
    return float(np.nansum(end - start) * step[0] * step[1])
