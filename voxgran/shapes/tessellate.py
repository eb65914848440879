"""Triangulations of the unit sphere and of bodies of revolution, with their error stated."""

import itertools
import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, Integers, read_only
from voxgran.geometry.triangles import normals_of

#: number of sides of the polygon that represents a circle
SIDES = 96


@lru_cache(maxsize=16)
def sphere(subdivisions: int = 4) -> tuple[Floats, Integers, float]:
    """Return vertices and faces of an icosahedron subdivided onto the unit sphere, and their largest distance from it.

    Four subdivisions of each triangle into four give 2562 vertices and 5120 faces.
    """
    vertices, faces = _icosahedron()
    for _ in range(subdivisions):
        vertices, faces = _split(vertices, faces)
    middles = vertices[faces].mean(axis=1)
    return read_only(vertices), read_only(faces), float(1 - linear.norm(middles, axis=1).min())


@lru_cache(maxsize=16)
def geodesic(frequency: int) -> tuple[Floats, Integers]:
    """Return vertices and faces of an icosahedron whose edges are divided into `frequency` parts, on the unit sphere.

    There are 20 frequency**2 faces. The points on an edge are equally spaced on its great circle; those inside a face
    are interpolated likewise (spherical linear interpolation), which makes the faces nearly equal.
    """
    corners, triangles = _icosahedron()
    i, j = np.nonzero(np.add.outer(np.arange(frequency + 1), np.arange(frequency + 1)) <= frequency)
    weights = np.stack([frequency - i - j, i, j], axis=1)
    angle = math.acos(1 / math.sqrt(5)) / frequency
    points = linear.einsum("pw,fwx->fpx", libm.sin(weights * angle), corners[triangles]).reshape(-1, 3)
    points /= linear.norm(points, axis=1, keepdims=True)
    # a point has the same corners and weights in all faces that share it
    code = np.where(weights > 0, triangles[:, None] * (frequency + 1) + weights, 0)
    code = linear.matmul(
        np.sort(code.reshape(-1, 3), axis=1), np.array([1, 13 * (frequency + 1), (13 * (frequency + 1)) ** 2])
    )
    _, first, index = np.unique(code, return_index=True, return_inverse=True)
    number = np.full((frequency + 2, frequency + 2), -1)
    number[i, j] = np.arange(len(i))
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[:-1, 1:], number[1:, 1:]
    parts = [np.stack(corner, axis=-1).reshape(-1, 3) for corner in ((a, b, c), (b, d, c))]
    local = np.concatenate([part[(part >= 0).all(axis=1)] for part in parts])
    faces = index.reshape(len(triangles), -1)[:, local].reshape(-1, 3)
    return read_only(points[first]), read_only(np.ascontiguousarray(faces, dtype=np.int64))


def _icosahedron() -> tuple[Floats, Integers]:
    """Return vertices (12, 3) and faces (20, 3) of the icosahedron in the unit sphere."""
    golden = (1 + math.sqrt(5)) / 2
    corners = [(-1, golden, 0), (1, golden, 0), (-1, -golden, 0), (1, -golden, 0)]
    vertices = np.array([np.roll(corner, shift) for shift in range(3) for corner in corners], dtype=float)
    vertices /= linear.norm(vertices[0])
    gram = linear.matmul(vertices, vertices.T)
    near = gram > 0.4  # neighbours on the icosahedron have cosine 1 / sqrt(5)
    faces = np.array(
        [(a, b, c) for a in range(12) for b in range(a) for c in range(b) if near[a, b] and near[b, c] and near[a, c]]
    )
    triangles = vertices[faces]
    inward = linear.einsum("fi,fi->f", normals_of(triangles), triangles[:, 0]) < 0
    faces[inward] = faces[inward][:, ::-1]
    return vertices, faces


def sphere_points(count: int) -> Floats:
    """Return points (count, 3) spread evenly over the unit sphere along a Fibonacci spiral."""
    k = np.arange(count) + 0.5
    z, angle = 1 - 2 * k / count, np.pi * (1 + np.sqrt(5)) * k
    flat = np.sqrt(1 - z * z)
    return np.column_stack([flat * libm.cos(angle), flat * libm.sin(angle), z])


def _split(vertices: Floats, faces: Integers) -> tuple[Floats, Integers]:
    """Divide each triangle into four and project the new vertices onto the unit sphere."""
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    unique, inverse = np.unique(edges, axis=0, return_inverse=True)
    middles = vertices[unique].sum(axis=1)
    middles /= linear.norm(middles, axis=1, keepdims=True)
    ab, bc, ca = (inverse.reshape(3, -1) + len(vertices)).astype(np.int64)
    a, b, c = faces.T
    new = np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))])
    return np.concatenate([vertices, middles]), new


def unit_box() -> tuple[Floats, Integers, float]:
    """Return the cube of edge 1 about the origin: (8, 3) vertices, (12, 3) faces and the error 0."""
    vertices = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))]
    return vertices, np.array(faces, dtype=np.int64), 0.0


def sides_of(radius: float, error: float) -> int:
    """Return how many sides of a regular polygon in a circle, at least 8, are within an error of it."""
    return max(8, math.ceil(math.pi / math.acos(max(1 - error / radius, 0.5))))


def revolved(profile: Sequence[tuple[float, float]], *, sides: int = SIDES) -> tuple[Floats, Integers, float]:
    """Return vertices and faces of the surface of revolution of a profile about z, and the error of its polygons.

    The profile is a list of z and radius from bottom to top; radius 0 is a point on the axis.
    """
    angles = 2 * np.pi * np.arange(sides) / sides
    vertices, faces = spherical_product(profile, [(math.cos(angle), math.sin(angle)) for angle in angles])
    return vertices, faces, max(radius for _, radius in profile) * (1 - math.cos(math.pi / sides))


def spherical_product(
    profile: Sequence[tuple[float, float]], section: Sequence[tuple[float, float]]
) -> tuple[Floats, Integers]:
    """Return vertices and faces of the solid whose section at the height z is a polygon about the axis, scaled.

    The profile is a list of z and scale from bottom to top; scale 0 is a point on the axis. All quadrilaterals between
    two levels are plane, and the solid is convex where the polygon and the profile are.
    """
    sides = len(section)
    rings: list[Integers] = []
    vertices: list[tuple[float, float, float]] = []
    for z, radius in profile:
        count = sides if radius > 0 else 1
        rings.append(np.arange(count) + len(vertices))
        vertices += [(radius * x, radius * y, z) for x, y in section[:count]]
    faces: list[tuple[int, int, int]] = []
    for below, above in itertools.pairwise(rings):
        for k in range(sides):
            a, b = below[k % len(below)], below[(k + 1) % len(below)]
            c, d = above[(k + 1) % len(above)], above[k % len(above)]
            faces += [face for face in ((a, b, c), (a, c, d)) if len(set(face)) == 3]
    for ring, upward in ((rings[0], False), (rings[-1], True)):
        for k in range(1, len(ring) - 1):
            faces.append((ring[0], ring[k], ring[k + 1]) if upward else (ring[0], ring[k + 1], ring[k]))
    return np.array(vertices, dtype=float), np.array(faces, dtype=np.int64)
