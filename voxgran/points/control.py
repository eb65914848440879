"""Control points of a solid: on its surface, along its convex edges, at its corners, and optionally inside.

Edges and corners make contact first, and surface points alone would miss them by up to half their spacing. An open
surface has control points on its border, too.
"""

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, Integers, as_length
from voxgran._base.errors import InputError
from voxgran.points.sample import MOST_POINTS, SurfacePoints, sample_surface
from voxgran.shapes.finer import onto_surface
from voxgran.shapes.mesh import Mesh, Surface
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive

#: smallest angle between the normals of two triangles, in radians, at a sharp edge
SHARP = np.deg2rad(25.0)
#: smallest angular defect of a vertex, in radians, at a corner
POINTED = 0.3


def sample_controls(shape: Shape, *, spacing: float, seed: int = 0) -> SurfacePoints:
    """Return control points: those of :func:`voxgran.sample_surface`, and points along edges and at corners.

    They have at most the given spacing on the surface and along edges. Points of a sphere, ellipsoid, spherocylinder or
    disk lie on its surface, those of other curved shapes on the tessellation.
    """
    wanted = as_length(spacing, "spacing")
    points = sample_surface(shape, spacing=wanted, seed=seed)
    if shape.dimension == 2:
        return points
    sharp = edge_points(shape.vertices, shape.faces, wanted)
    places = np.concatenate([sharp, np.asarray(points)])
    if isinstance(shape.geometry, Primitive) and shape.geometry.kind in ("ellipsoid", "spherocylinder"):
        # from the tessellation onto the true surface; the displacement is within the error of the tessellation
        places = onto_surface(shape.geometry, places)
    return SurfacePoints.from_points(places, points.spacing)


def inner_points(shape: Shape, *, spacing: float) -> Floats:
    """Return points (n, 3) inside a shape on a body-centered lattice (in two dimensions, a triangular one).

    Every point of the shape is within half the spacing of a lattice point or of the surface. There are none if the
    shape is thin or an open surface.

    Raises
    ------
    InputError
        If the spacing is not above 0 or needs more than half a million points.
    """
    wanted = as_length(spacing, "spacing")
    if isinstance(shape.geometry, Surface):
        return np.zeros((0, 3))
    if inner_count(shape, spacing=wanted) > MOST_POINTS:
        raise InputError(
            f"spacing is {spacing}: it needs more than {MOST_POINTS} points in {shape.name!r}; make it larger"
        )
    low, high = shape.vertices.min(axis=0), shape.vertices.max(axis=0)
    if shape.dimension == 2:
        across = np.sqrt(0.75) * wanted
        edges, nodes = np.array([across, np.sqrt(3.0) * across, 1.0]), [[0.0, 0.0, 0.0], [0.5, 0.5, 0.0]]
    else:
        edges, nodes = np.full(3, 2.0 / np.sqrt(5.0) * wanted), [[0.0, 0.0, 0.0], [0.5, 0.5, 0.5]]
    first, last = np.floor(low / edges), np.ceil(high / edges)
    cells = np.stack(np.meshgrid(*(np.arange(a, b + 1) for a, b in zip(first, last, strict=True)), indexing="ij"), -1)
    places = np.concatenate([(cells.reshape(-1, 3) + node) * edges for node in nodes])
    solid = shape.geometry
    inside = solid.tree.signed_distance(places) < 0.0 if isinstance(solid, Mesh) else solid.contains(places)
    return np.asarray(places[inside])


def inner_count(shape: Shape, *, spacing: float) -> float:
    """Return the approximate number of :func:`inner_points`, from the volume."""
    dense = 1.25 * np.sqrt(5.0) if shape.dimension == 3 else 8.0 / np.sqrt(27.0)
    return float(dense * shape.volume / spacing**shape.dimension)


def edge_points(vertices: Floats, faces: Integers, spacing: float) -> Floats:
    """Return points (k, 3) along the convex edges of a closed mesh, or all sharp edges and the border of an open one.

    Corners come first. Neighbours along an edge are at most the spacing apart; on shorter edges points closer to each
    other than a quarter of it are dropped.
    """
    a, b = _sharp_edges(vertices, faces)
    parts = [vertices[_pointed(vertices, faces)], vertices[a], vertices[b]]
    way = vertices[b] - vertices[a]
    cuts = np.ceil(linear.norm(way, axis=1) / spacing).astype(np.int64)
    for cut in range(1, int(cuts.max(initial=1))):
        some = cuts > cut
        parts.append(vertices[a[some]] + (cut / cuts[some])[:, None] * way[some])
    places = np.concatenate(parts)
    cell = np.floor(places / (spacing / 4)).astype(np.int64)
    first = np.unique(cell, axis=0, return_index=True)[1] if len(places) else np.zeros(0, dtype=np.int64)
    return np.asarray(places[np.sort(first)])


def _sharp_edges(vertices: Floats, faces: Integers) -> tuple[Integers, Integers]:
    """Return the ends of the sharp convex edges; for an open surface, those of border edges and of all sharp edges."""
    corners = vertices[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(linear.norm(normal, axis=1, keepdims=True), 1e-300)
    ends = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    opposite = np.concatenate([faces[:, 2], faces[:, 0], faces[:, 1]])
    face = np.tile(np.arange(len(faces)), 3)
    order = np.lexsort((ends[:, 1], ends[:, 0]))
    ends, opposite, face = ends[order], opposite[order], face[order]
    # in a closed mesh each edge comes twice
    again = (ends[1:] == ends[:-1]).all(axis=1)
    twice, alone = np.flatnonzero(again), ends[~(np.append(again, False) | np.insert(again, 0, False))]
    one, other = face[twice], face[twice + 1]
    turned = (normal[one] * normal[other]).sum(axis=1) < libm.cos(SHARP)
    below = ((vertices[opposite[twice + 1]] - vertices[ends[twice, 0]]) * normal[one]).sum(axis=1) < 0.0
    sharp = np.concatenate([ends[twice[turned & (below | bool(len(alone)))]], alone])
    return sharp[:, 0], sharp[:, 1]


def _pointed(vertices: Floats, faces: Integers) -> Integers:
    """Return the vertices with a large angular defect."""
    corners = vertices[faces]
    left = 2 * np.pi * np.ones(len(vertices))
    for k in range(3):
        u, v = corners[:, (k + 1) % 3] - corners[:, k], corners[:, (k + 2) % 3] - corners[:, k]
        across = linear.norm(np.cross(u, v), axis=1)
        np.subtract.at(left, faces[:, k], libm.arctan2(across, (u * v).sum(axis=1)))
    used = np.zeros(len(vertices), dtype=np.bool_)
    used[faces] = True
    return np.flatnonzero(used & (left > POINTED))
