"""Convex polyhedra rounded by a sphere: their Minkowski sum with it, as a mesh of stated error.

The flat faces are shifted by the radius, edges become parts of cylinders and corners parts of spheres. All vertices of
the mesh lie on the true surface, so that it is inscribed. The volume of the true sum is
``V + A r + M r^2 + 4/3 pi r^3``
with the volume V, the area A and the integrated mean curvature M of the polyhedron, half the sum over its edges of
length times exterior angle (Steiner's formula; Schneider & Weil 2008, Stochastic and Integral Geometry,
doi:10.1007/978-3-540-78859-1).
"""

import math
from typing import NamedTuple

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.lazy import load
from voxgran.shapes.generating.hulls import hull_of_corners
from voxgran.shapes.mesh import Mesh, hull_of
from voxgran.shapes.tessellate import sphere_points

#: distance of normals of triangles up to which they are one face
COPLANAR = 1e-9
#: directions inside the cone of a corner keep this distance from its edges, in spacings of directions
CLEARANCE = 0.4
#: largest angle from a point of the sphere to the nearest of n points of a spiral is at most COVERING / sqrt(n)
COVERING = 2.74


class Edges(NamedTuple):
    """Edges of a convex polyhedron: corners (e, 2) and outward normals of the two faces, each (e, 3)."""

    ends: Integers
    one: Floats
    two: Floats


def sphere_swept(corners: Floats, radius: float, error: float) -> Mesh:
    """Return the Minkowski sum of the convex hull of (n, 3) corners and a sphere.

    `error` is the largest distance of the mesh from the true surface, above 0. All points must be corners.
    """
    # the farthest direction from all vertices of the mesh, at a corner: sqrt((1 + CLEARANCE)^2 + 1/4) spacings
    angle = min(math.acos(max(1.0 - error / radius, 0.0)), 0.6)
    spacing = angle / math.hypot(1.0 + CLEARANCE, 0.5)
    count = math.ceil((COVERING / spacing) ** 2)
    edges = edges_of_hull(corners)
    points = [corners[ends] + radius * arc for ends, arc in _arcs(edges, spacing)]
    directions = sphere_points(count)
    at = (directions @ corners.T).argmax(axis=1)
    inner = _clear(directions, at, corners, edges, math.sin(CLEARANCE * spacing))
    points.append(corners[at[inner]] + radius * directions[inner])
    return hull_of_corners(np.unique(np.concatenate(points), axis=0))


def edges_of_hull(corners: Floats) -> Edges:
    """Return the edges of the convex hull of corners, without those between triangles of one face."""
    hull = load("scipy.spatial").ConvexHull(corners)
    normals, faces = hull.equations[:, :3], hull.simplices
    here, side = np.nonzero(hull.neighbors > np.arange(len(faces))[:, None])
    there = hull.neighbors[here, side]
    # Qhull gives coplanar triangles the normal of their common face
    sharp = np.linalg.norm(normals[here] - normals[there], axis=1) > COPLANAR
    here, there, side = here[sharp], there[sharp], side[sharp]
    # neighbor k of a triangle lies opposite to its corner k
    ends = np.stack([faces[here, (side + 1) % 3], faces[here, (side + 2) % 3]], axis=1)
    return Edges(ends.astype(np.int64), normals[here], normals[there])


def steiner_volume(corners: Floats, radius: float) -> float:
    """Return the volume of the Minkowski sum of the convex hull of corners and a sphere, in closed form."""
    solid, edges = hull_of(corners), edges_of_hull(corners)
    lengths = np.linalg.norm(corners[edges.ends[:, 0]] - corners[edges.ends[:, 1]], axis=1)
    curvature = float((lengths * _angles(edges)).sum()) / 2
    return solid.volume + radius * (solid.surface_area + radius * (curvature + 4 / 3 * math.pi * radius))


def _angles(edges: Edges) -> Floats:
    """Return the exterior angles at the edges, (e,)."""
    across = np.linalg.norm(np.cross(edges.one, edges.two), axis=1)
    return np.arctan2(across, np.einsum("ei,ei->e", edges.one, edges.two))


def _arcs(edges: Edges, spacing: float) -> list[tuple[Integers, Floats]]:
    """Return the corners and directions of the arcs between the normals at each edge, for both its ends."""
    found = []
    for ends, one, two, angle in zip(edges.ends, edges.one, edges.two, _angles(edges), strict=True):
        steps = max(1, math.ceil(angle / spacing))
        share = np.arange(steps + 1)[:, None] / steps
        arc = (np.sin((1 - share) * angle) * one + np.sin(share * angle) * two) / math.sin(angle)
        arc[0], arc[-1] = one, two
        found += [(np.full(steps + 1, end), arc) for end in ends]
    return found


def _clear(directions: Floats, at: Integers, corners: Floats, edges: Edges, least: float) -> Integers:
    """Return the numbers of the directions that are far enough from the edges of the cone of their corner."""
    near = np.full(len(directions), np.inf)
    for a, b in edges.ends:
        along = (corners[a] - corners[b]) / np.linalg.norm(corners[a] - corners[b])
        for end, sign in ((a, 1.0), (b, -1.0)):
            mine = np.flatnonzero(at == end)
            near[mine] = np.minimum(near[mine], sign * (directions[mine] @ along))
    return np.flatnonzero(near >= least)
