"""Walls of a periodic cell, and triangles, in the files of YADE."""

import numpy as np

from voxgran._base.arrays import Floats
from voxgran.decks.engine import row_of
from voxgran.decks.facets import facets_of
from voxgran.decks.simulation import Simulation

#: how far a wall of a periodic cell reaches, in cells: grains are not wrapped, and meet it where they are
REACH = 1000
#: lengths of a cell across walls, in distances of the walls: periodic images lie apart
APART = 4


def _period(simulation: Simulation) -> Floats:
    """Return the edges (3,) of the periodic cell: across walls it is so long that images do not meet."""
    walls, bodies = simulation.walls, simulation.bodies
    lengths = np.ptp(walls.bounds, axis=0)
    reach = 4 * float((bodies.assembly.scale * bodies.assembly.bounding_radii).max())
    return np.where(walls.periodic, lengths, APART * (lengths + reach))


def cell_lines(simulation: Simulation) -> list[str]:
    """Return the lines of the periodic cell."""
    edges = np.diag(_period(simulation)) + np.tril(simulation.walls.periods, -1)
    # the vectors of the cell are the columns
    return ["O.periodic = True", f"O.cell.hSize = Matrix3({row_of(edges.T.ravel(), ', ')})"]


def facet_lines(simulation: Simulation) -> tuple[list[str], list[str]]:
    """Return the triangles of walls as lines, and what they leave out.

    Periodic cells have no infinite planes: a triangle that reaches over many cells is in place of each.
    """
    walls, of_walls = simulation.walls, simulation.laws.of_walls
    said: list[str] = []
    found: list[tuple[Floats, int]] = []
    for wall in facets_of(simulation, planes=False):
        found.append((wall.vertices[wall.faces], of_walls[wall.name]))
        said += [f"approximated: {wall.note}"] if wall.note else []
    if any(walls.periodic):
        for plane in walls.planes:
            size = REACH * float(_period(simulation).max())
            first, second = (axis for axis in range(3) if axis != plane.axis)
            triangle = np.tile(walls.bounds.mean(axis=0), (3, 1))
            triangle[:, plane.axis] = plane.level
            triangle[:, first] += size * np.array([0.0, -2.0, 2.0])
            triangle[:, second] += size * np.array([2.0, -1.0, -1.0])
            found.append((triangle[None], of_walls[plane.name]))
    if not found:
        return [], said
    rows = [f"{row_of(row)} {kind}" for corners, kind in found for row in corners.reshape(-1, 9)]
    return ["# corners of triangles: x y z three times, and the material", *rows], said
