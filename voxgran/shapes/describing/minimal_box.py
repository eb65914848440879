"""The smallest box around a shape, whose edges are its principal lengths."""

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.lazy import load
from voxgran._base.seeds import stream
from voxgran.geometry.rotation import normalized, random_rotations, rotation_matrices
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive

#: orientations that are compared at first, best ones that are turned by small angles, and those that end on edges
TRIED, TURNED, IMPROVED = 2000, 12, 3
#: largest of the small angles, in radians, and how often they are halved
ANGLE, HALVED = 0.15, 12
#: largest number of improvements of one orientation
MOST_STEPS = 30
#: orientations compared at once, so that arrays stay small
AT_ONCE = 250


def principal_lengths(shape: Shape) -> Floats:
    """Return the edges (3,) of the smallest box around a shape, largest first; in 2D those of the rectangle and 0.

    The box has the least volume of all orientations (in 2D, and for a flat surface, the least area). It is exact in 2D
    and for solids in closed form. For others it is the best of many orientations, improved by small turns and then by
    turning the box about one of its axes after the other to the best angle until none improves it.

    References
    ----------
    .. [1] Toussaint 1983, rotating calipers: a smallest rectangle has an edge in common with the convex hull
    .. [2] Chang, Gorissen & Melchior 2011, doi:10.1145/2019627.2019641: local minima on the rotation group
    """
    geometry = shape.geometry
    if isinstance(geometry, Primitive) and geometry.kind != "cone":
        d = geometry.dimensions
        edges = {
            "sphere": (2 * d[0],) * 3,
            "ellipsoid": tuple(2 * value for value in d),
            "box": d,
            "cylinder": (2 * d[0], 2 * d[0], d[-1]),
        }[geometry.kind]
        return np.sort(np.array(edges))[::-1]
    if shape.is_sphere:
        return np.where(np.arange(3) < shape.dimension, 2 * shape.bounding_radius, 0.0)
    if shape.dimension == 2:
        return np.array([*sorted(_rectangle(shape.vertices[:, :2])[0], reverse=True), 0.0])
    hull = corners_of_hull(shape.vertices)
    if hull.shape[1] == 2:
        return np.array([*sorted(_rectangle(hull)[0], reverse=True), 0.0])
    turns = rotation_matrices(random_rotations(stream(0, "boxes"), TRIED))
    turns = np.concatenate([np.linalg.svd(hull - hull.mean(axis=0), full_matrices=False)[2][None], turns])
    turns = turns[np.argsort(_volumes(hull, turns), kind="stable")[:TURNED]]
    ways = np.indices((3, 3, 3)).reshape(3, -1).T - 1.0
    for level in range(HALVED):
        small = normalized(np.column_stack([np.ones(len(ways)), ANGLE / 2 ** (level + 1) * ways]))
        near = (rotation_matrices(small)[None] @ turns[:, None]).reshape(-1, 3, 3)
        best = _volumes(hull, near).reshape(len(turns), -1).argmin(axis=1)
        turns = near.reshape(len(turns), -1, 3, 3)[np.arange(len(turns)), best]
    order = np.argsort(_volumes(hull, turns), kind="stable")[:IMPROVED]
    found = [_improved(hull, turns[k]) for k in order]
    return np.sort(min(found, key=lambda edges: float(edges.prod())))[::-1]


def corners_of_hull(points: Floats) -> Floats:
    """Return the points (n, 3) that are corners of the convex hull; of points in a plane, (n, 2) in its coordinates."""
    middle = points.mean(axis=0)
    _, spread, axes = np.linalg.svd(points - middle, full_matrices=False)
    if spread[2] <= 1e-12 * spread[0]:
        return np.asarray((points - middle) @ axes[:2].T)
    return np.asarray(points[load("scipy.spatial").ConvexHull(points).vertices])


def _edges(points: Floats, turns: Floats) -> Floats:
    """Return the edges (m, 3) of the boxes around points along the rows of rotation matrices (m, 3, 3)."""
    along = turns @ points.T
    return np.asarray(along.max(axis=2) - along.min(axis=2))


def _volumes(points: Floats, turns: Floats) -> Floats:
    """Return the volumes (m,) of the boxes around points along the rows of rotation matrices (m, 3, 3)."""
    parts = range(0, len(turns), AT_ONCE)
    return np.concatenate([_edges(points, turns[k : k + AT_ONCE]).prod(axis=1) for k in parts])


def _rectangle(points: Floats) -> tuple[Floats, Floats]:
    """Return the edges (2,) of the smallest rectangle around points in the plane, and the direction of the first."""
    corners = points[load("scipy.spatial").ConvexHull(points).vertices]
    sides = np.roll(corners, -1, axis=0) - corners
    sides /= np.linalg.norm(sides, axis=1, keepdims=True)
    edges = _edges(corners, np.stack([sides, np.column_stack([-sides[:, 1], sides[:, 0]])], axis=1))
    best = int(np.argmin(edges.prod(axis=1)))
    return edges[best], sides[best]


def _improved(points: Floats, turn: Floats) -> Floats:
    """Return the edges of a box after it was turned about its axes until no turn makes it smaller."""
    edges, axis, since = _edges(points, turn[None])[0], 0, 0
    for _ in range(MOST_STEPS):
        one, two = turn[(axis + 1) % 3], turn[(axis + 2) % 3]
        (wide, deep), way = _rectangle(np.column_stack([points @ one, points @ two]))
        smaller = wide * deep < edges[(axis + 1) % 3] * edges[(axis + 2) % 3] * (1 - 1e-12)
        if smaller:
            first = way[0] * one + way[1] * two
            turn = np.roll(np.array([turn[axis], first, np.cross(turn[axis], first)]), axis, axis=0)
            edges = np.roll(np.array([edges[axis], wide, deep]), axis)
        since = 0 if smaller else since + 1
        axis = (axis + 1) % 3
        if since == 2:
            break
    return edges
