"""Curvature of the surface of a shape: its largest value, and roundness, which compares corners with the inside."""

import math
from typing import NamedTuple

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, Integers
from voxgran.shapes.describing.body import Geometry
from voxgran.shapes.describing.inscribed import inscribed_radius
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.sphere_union import exposed_areas
from voxgran.shapes.spheres import Spheres

#: angle between neighbouring faces (in 2D edges) above which their edge is sharp, in degrees
SHARP = 30.0
#: radius of curvature, in radii of the inscribed sphere, below which the surface belongs to a corner
CORNER = 0.98
#: vertices of a mesh are coarse where their edges, those of more than STEEP degrees left out, turn through more than so
#: many degrees together, and corners of a polygon where they and their neighbours do; it is too coarse for a curvature
#: if they have more than this share of the angle through which its corners turn
COARSE, COARSE_OUTLINE, STEEP, MOST_COARSE = 90.0, 60.0, 60.0, 0.75
#: the same for vertices such as the apex of a cone, whose smooth edges alone turn through more than so many degrees
POINTED, MOST_POINTED = 180.0, 0.1
#: triangles of a mesh, and corners of a polygon, up to which all edges may well be sharp
POLYHEDRON, POLYGON = 50, 8
#: points in an octant of an ellipsoid
RINGS, AROUND = 4_000, 64


def largest_curvature(geometry: Geometry) -> float | None:
    """Return the largest curvature with which a surface bulges outward, or None where it has sharp edges.

    A union of several spheres has creases and counts as having edges.
    """
    if isinstance(geometry, Spheres) and len(geometry.radii) == 1:
        return 1.0 / float(geometry.radii[0])
    if isinstance(geometry, Outline) and geometry.kind == "disk":
        return 1.0 / geometry.radius
    if isinstance(geometry, Primitive) and geometry.kind in ("sphere", "spherocylinder"):
        return 1.0 / geometry.dimensions[0]
    if isinstance(geometry, Primitive) and geometry.kind == "ellipsoid":
        return max(geometry.dimensions) / min(geometry.dimensions) ** 2
    return None


class Bends(NamedTuple):
    """Parts of a surface, (n,) each, or in 2D of a line."""

    size: Floats  # area, in 2D length
    angle: Floats  # size times curvature; where the surface turns inward 0
    curvature: Floats  # the larger principal one
    coarse: Floats  # from 0 to 1: how far sharp edges and a smooth surface look alike


def roundness(shape: Shape) -> float:
    """Return the roundness of a shape: the mean radius of curvature of its corners over that of its inscribed sphere.

    Corners are where the surface bulges with a radius of curvature below that of the largest inscribed sphere (in 2D,
    the inscribed circle). The mean weights each part of them by the angle through which the surface turns there: a
    shape whose corners all have the radius r gets r over the inscribed radius, one with sharp edges only gets 0, and
    one without corners 1. Regular solids and unions of spheres have their own curvature. Of meshes and polygons, edges
    of more than 30 degrees are sharp; smaller ones are taken for a smooth surface. NaN for an open surface, and for a
    mesh or polygon so coarse that sharp edges and a smooth surface look alike.

    References
    ----------
    .. [1] Wadell 1932, doi:10.1086/623964: mean radius of corners over the radius of the inscribed circle
    .. [2] Zheng & Hryciw 2015, doi:10.1680/geot.14.P.192: corners and inscribed circles by computational geometry
    .. [3] Cohen-Steiner & Morvan 2003, doi:10.1145/777792.777839: curvature tensors of triangle meshes
    """
    geometry = shape.geometry
    if shape.is_open:
        return float("nan")
    if shape.is_sphere or (isinstance(geometry, Outline) and geometry.kind == "disk"):
        return 1.0
    inside = inscribed_radius(shape)
    least = 1 / (CORNER * inside)
    if isinstance(geometry, Primitive) and geometry.kind != "ellipsoid":
        # no sphere in a cylinder is wider than its barrel, which is therefore no corner; rounded ends are none either
        flat = float(geometry.kind == "spherocylinder")
        return _of_cone(geometry, inside, least) if geometry.kind == "cone" else flat
    if isinstance(geometry, Primitive):
        bends = _bends_of_ellipsoid(geometry.dimensions)
    elif isinstance(geometry, Spheres):
        size = exposed_areas(geometry.centers, geometry.radii)
        bends = Bends(size, size / geometry.radii, 1 / geometry.radii, np.zeros(len(size)))
    elif isinstance(geometry, Outline):
        bends = _bends_of_outline(geometry.vertices)
    else:
        bends = bends_of_mesh(shape.vertices, shape.faces)
    corner = bends.curvature > least
    if (bends.coarse * bends.angle)[corner].sum() > MOST_COARSE * bends.angle[corner].sum():
        return float("nan")
    return mean_of_corners(bends, inside)


def mean_of_corners(bends: Bends, inside: float) -> float:
    """Return the mean radius of curvature of corners over that of a sphere inside; 1 where there are none."""
    corner = bends.curvature > 1 / (CORNER * inside)
    total = float(bends.angle[corner].sum())
    return float(bends.size[corner].sum() / (inside * total)) if total > 0 else 1.0


def _of_cone(cone: Primitive, inside: float, least: float) -> float:
    """Return the roundness of a cone, of which the rim and the mantle near the apex are corners."""
    radius, height = cone.dimensions
    slant = math.hypot(radius, height)
    # the curvature of the mantle is that of its section times the cosine of half the opening angle
    widest = height / slant / least
    size = math.pi * widest**2 * slant / radius
    angle = 2 * math.pi * (widest * height / radius + radius * math.acos(-radius / slant))
    return size / (inside * angle)


def _bends_of_ellipsoid(semi_axes: tuple[float, ...]) -> Bends:
    """Return the parts of an octant of an ellipsoid."""
    longest = max(semi_axes)
    c, b, a = sorted(value / longest for value in semi_axes)
    # rings are dense at the edge of a flat ellipsoid
    step = math.asinh(1 / c) / RINGS
    turn = (np.arange(RINGS)[:, None] + 0.5) * step
    around = (np.arange(AROUND) + 0.5) * (math.pi / 2 / AROUND)
    z = c * libm.sinh(turn)
    flat = np.sqrt(1 - z**2)
    x, y = flat * libm.cos(around), flat * libm.sin(around)
    # distance of the tangent plane from the center; mean and Gaussian curvature
    plane = 1 / np.sqrt((x / a) ** 2 + (y / b) ** 2 + (z / c) ** 2)
    squares = a**2 + b**2 + c**2 - (a * x) ** 2 - (b * y) ** 2 - (c * z) ** 2
    mean, gauss = libm.power(plane, 3) * squares / (2 * (a * b * c) ** 2), libm.power(plane, 4) / (a * b * c) ** 2
    curvature = (mean + np.sqrt(np.maximum(mean**2 - gauss, 0.0))).ravel()
    area = (a * b * c / plane * c * libm.cosh(turn) * step * (math.pi / 2 / AROUND)).ravel()
    return Bends(area * longest**2, area * curvature * longest, curvature / longest, np.zeros(len(area)))


def _bends_of_outline(corners: Floats) -> Bends:
    """Return the surroundings of the corners of a polygon; sharp ones have no length."""
    edges = np.roll(corners, -1, axis=0) - corners
    before = np.roll(edges, 1, axis=0)
    angle = libm.arctan2(before[:, 0] * edges[:, 1] - before[:, 1] * edges[:, 0], (before * edges).sum(axis=1))
    lengths = linear.norm(edges, axis=1)
    length = (lengths + np.roll(lengths, 1)) / 2
    sharp = angle > np.radians(SHARP)
    curvature = np.where(sharp, np.inf, angle / length)
    # each corner with its two neighbours
    turned = np.where(np.abs(angle) < np.radians(STEEP), np.abs(angle), 0.0)
    total = np.roll(turned, -1) + turned + np.roll(turned, 1)
    coarse = (total > np.radians(COARSE_OUTLINE)) & (len(corners) > POLYGON)
    return Bends(np.where(sharp, 0.0, length), np.maximum(angle, 0.0), curvature, coarse.astype(np.float64))


class Edges(NamedTuple):
    """Edges (m,) of a closed mesh of f triangles, each once."""

    begin: Integers  # vertices (3 f,) at which the edges of the triangles begin, three for each
    end: Integers  # and end
    one: Integers  # of those, the place of each edge in one of its triangles
    two: Integers  # and in the other, of the opposite direction
    along: Floats  # unit vectors (m, 3)
    length: Floats
    angle: Floats  # by which the surface turns, positive where it bulges
    first: Floats  # normals (m, 3) of the one triangle
    second: Floats  # and of the other
    doubled: Floats  # twice the areas (f,) of the triangles


def edges_of_mesh(vertices: Floats, faces: Integers) -> Edges:
    """Return the edges of a closed mesh, and the angles between its triangles."""
    triangles = vertices[faces]
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    doubled = linear.norm(normals, axis=1)
    normals /= np.maximum(doubled, 1e-300)[:, None]
    begin, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    key = np.minimum(begin, end) * len(vertices) + np.maximum(begin, end)
    order = np.argsort(key, kind="stable")
    one, two = order[0::2], order[1::2]
    along = vertices[end[one]] - vertices[begin[one]]
    length = linear.norm(along, axis=1)
    along /= np.maximum(length, 1e-300)[:, None]
    first, second = normals[one // 3], normals[two // 3]
    # an edge bulges where the normals turn away from each other along it
    angle = libm.arctan2((np.cross(first, second) * along).sum(axis=1), (first * second).sum(axis=1))
    return Edges(begin, end, one, two, along, length, angle, first, second, doubled)


def bends_of_mesh(vertices: Floats, faces: Integers) -> Bends:
    """Return the parts of a closed mesh.

    They are the sharp edges, which have no area and infinite curvature, and the surroundings of the vertices with their
    larger principal curvature.
    """
    edges = edges_of_mesh(vertices, faces)
    begin, end, one, along, length, angle = edges.begin, edges.end, edges.one, edges.along, edges.length, edges.angle
    sharp = angle > np.radians(SHARP)
    smooth = np.abs(angle) <= np.radians(SHARP)
    area = np.zeros(len(vertices))
    np.add.at(area, faces, edges.doubled[:, None] / 6)
    tensor = np.zeros((len(vertices), 3, 3))
    part = (angle * length)[smooth, None, None] / 2 * along[smooth, :, None] * along[smooth, None, :]
    for ends in (begin[one[smooth]], end[one[smooth]]):
        np.add.at(tensor, ends, part)
    # the mean over the neighbours evens out the lengths of edges
    around, room = tensor.copy(), area.copy()
    for a, b in ((begin[one], end[one]), (end[one], begin[one])):
        np.add.at(around, a, tensor[b])
        np.add.at(room, a, area[b])
    curvature = linear.eigh(around)[0][:, 2] / np.maximum(room, 1e-300)
    coarse = _coarse(np.stack([begin[one], end[one]], axis=1), angle, length, len(vertices))
    if len(faces) <= POLYHEDRON:
        coarse[:] = 0.0
    kept = np.flatnonzero(sharp)
    return Bends(
        size=np.concatenate([area, np.zeros(len(kept))]),
        angle=np.concatenate([area * np.maximum(curvature, 0.0), (angle * length)[kept]]),
        curvature=np.concatenate([curvature, np.full(len(kept), np.inf)]),
        coarse=np.concatenate([coarse, coarse[np.stack([begin[one], end[one]])[:, kept]].mean(axis=0)]),
    )


def _coarse(ends: Integers, angle: Floats, length: Floats, count: int) -> Floats:
    """Return which of the vertices (count,) are coarse, 0 or 1; all of them, where pointed ones have much of the angle.

    `ends` (m, 2), `angle` in radians and `length` are those of the edges.
    """

    def around(values: Floats) -> Floats:
        return np.asarray(np.bincount(ends.ravel(), np.repeat(values, 2), count), dtype=np.float64)

    turn, part = np.abs(angle), around(np.maximum(angle, 0.0) * length)
    pointed = around(np.where(turn <= np.radians(SHARP), turn, 0.0)) > np.radians(POINTED)
    if part[pointed].sum() > MOST_POINTED * part.sum():
        return np.ones(count)
    return np.asarray(around(np.where(turn < np.radians(STEEP), turn, 0.0)) > np.radians(COARSE), dtype=np.float64)
