"""Walls of a container as triangles, for engines without walls in closed form."""

import math
from typing import NamedTuple

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, Integers
from voxgran.decks.simulation import Simulation
from voxgran.decks.walls import sides_of
from voxgran.geometry.walls import Plane, Round
from voxgran.shapes.shells import without_unused
from voxgran.shapes.tessellate import sphere

#: most that the triangles of a sphere lie outside of it, in median diameters, and its most subdivisions
SPHERE_ERROR, MOST_SUBDIVISIONS = 1e-2, 6
#: how far triangles reach beyond a container of which walls move, in median diameters
BEYOND = 1.0
#: corners of a rectangle as two triangles
RECTANGLE = np.array([[0, 1, 2], [0, 2, 3]])


class Facets(NamedTuple):
    """Triangles of one wall."""

    name: str
    vertices: Floats  # (v, 3)
    faces: Integers  # (f, 3)
    note: str = ""  # what they leave out, as a sentence


def facets_of(simulation: Simulation, *, planes: bool = True) -> list[Facets]:
    """Return the triangles of all walls, or of those that are no planes across an axis.

    They reach beyond the container where walls move.
    """
    walls, bounds = simulation.walls, simulation.walls.bounds
    if simulation.platens:
        bounds = bounds + np.where(walls.periodic, 0.0, BEYOND * simulation.diameter) * np.array([[-1.0], [1.0]])
    found = [_rectangle(plane, bounds) for plane in walls.planes] if planes else []
    if walls.round is not None and walls.round.kind == "cylinder":
        found.append(_cylinder(walls.round, bounds[:, 2], simulation.diameter))
    elif walls.round is not None:
        found.append(_sphere(walls.round, simulation.diameter))
    for name, (vertices, faces) in walls.surfaces.items():
        corners, triangles = without_unused(vertices, faces)
        one = walls.others.get(name)
        note = "" if one is None else _outside(-float(one.distance(corners).min()), len(triangles))
        found.append(Facets(name, corners, triangles, note))
    return found


def _rectangle(plane: Plane, bounds: Floats) -> Facets:
    """Return a plane wall as wide as the container."""
    first, second = (axis for axis in range(3) if axis != plane.axis)
    corners = np.full((4, 3), plane.level)
    corners[:, first] = bounds[[0, 1, 1, 0], first]
    corners[:, second] = bounds[[0, 0, 1, 1], second]
    return Facets(plane.name, corners, RECTANGLE)


def _cylinder(wall: Round, ends: Floats, diameter: float) -> Facets:
    """Return a cylinder along z as rectangles that touch it from outside."""
    sides = sides_of(wall.radius, diameter)
    radius = wall.radius / math.cos(math.pi / sides)
    angles = 2 * math.pi * np.arange(sides) / sides
    ring = wall.center[:2] + radius * np.stack([libm.cos(angles), libm.sin(angles)], axis=1)
    vertices = np.concatenate([np.column_stack([ring, np.full(sides, level)]) for level in ends])
    below, after = np.arange(sides), np.roll(np.arange(sides), -1)
    pairs = [(below, after, after + sides), (below, after + sides, below + sides)]
    faces = np.concatenate([np.stack(corners, axis=1) for corners in pairs])
    return Facets("round", vertices, faces, _outside(radius - wall.radius, len(faces)))


def _sphere(wall: Round, diameter: float) -> Facets:
    """Return a sphere as triangles that touch it from outside."""
    for subdivisions in range(2, MOST_SUBDIVISIONS + 1):
        vertices, faces, _ = sphere(subdivisions)
        corners = vertices[faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= linear.norm(normals, axis=1, keepdims=True)
        nearest = float(linear.einsum("fi,fi->f", normals, corners[:, 0]).min())
        error = wall.radius * (1 / nearest - 1)
        if error <= SPHERE_ERROR * diameter:
            break
    return Facets("round", wall.center + vertices * (wall.radius / nearest), faces, _outside(error, len(faces)))


def _outside(error: float, count: int) -> str:
    """Return how far triangles lie outside of a round wall, in words."""
    return (
        f"{count} triangles outside of the round wall, at most {error:.3g} m away from it; a grain at an edge touches "
        "both triangles"
    )
