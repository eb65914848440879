"""Curvature of the surface of a shape: its largest value, and roundness, which compares corners with the inside."""

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran.shapes.describing.body import Geometry
from voxgran.shapes.describing.inscribed import inscribed_radius
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.spheres import Spheres

#: angle between neighbouring faces (in 2D edges) above which their edge is sharp, in degrees
SHARP = 30.0
#: radius of curvature, in radii of the inscribed sphere, below which the surface belongs to a corner
CORNER = 0.98


def largest_curvature(geometry: Geometry) -> float | None:
    """Return the largest curvature with which a surface bulges outward, or None where it has sharp edges.

    A union of several spheres has creases and counts as having edges.
    """
    if isinstance(geometry, Spheres) and len(geometry.radii) == 1:
        return 1.0 / float(geometry.radii[0])
    if isinstance(geometry, Outline) and geometry.kind == "disk":
        return 1.0 / geometry.radius
    if isinstance(geometry, Primitive) and geometry.kind == "sphere":
        return 1.0 / geometry.dimensions[0]
    if isinstance(geometry, Primitive) and geometry.kind == "ellipsoid":
        return max(geometry.dimensions) / min(geometry.dimensions) ** 2
    return None


def roundness(shape: Shape) -> float:
    """Return the roundness of a shape: the mean radius of curvature of its corners over that of its inscribed sphere.

    Corners are where the surface bulges with a radius of curvature below that of the largest inscribed sphere (in 2D,
    the inscribed circle). The mean weights each part of them by the angle through which the surface turns there: a
    shape whose corners all have the radius r gets r over the inscribed radius, one with sharp edges only gets 0, and
    one without corners 1. Edges of more than 30 degrees are sharp; smaller ones are taken for a smooth surface. NaN for
    an open surface.

    References
    ----------
    .. [1] Wadell 1932, doi:10.1086/623964: mean radius of corners over the radius of the inscribed circle
    .. [2] Zheng & Hryciw 2015, doi:10.1680/geot.14.P.192: corners and inscribed circles by computational geometry
    .. [3] Cohen-Steiner & Morvan 2003, doi:10.1145/777792.777839: curvature tensors of triangle meshes
    """
    if shape.is_open:
        return float("nan")
    if shape.is_sphere:
        return 1.0
    inside = inscribed_radius(shape)
    if isinstance(shape.geometry, Outline):
        size, angle, curvature = _bends_of_outline(shape.geometry.vertices)
    else:
        size, angle, curvature = _bends_of_mesh(shape.vertices, shape.faces)
    corner = curvature * inside * CORNER > 1
    total = float(angle[corner].sum())
    return float(size[corner].sum() / (inside * total)) if total > 0 else 1.0


def _bends_of_outline(corners: Floats) -> tuple[Floats, Floats, Floats]:
    """Return length, angle and curvature of the parts of a polygon that bulge; sharp corners have no length."""
    edges = np.roll(corners, -1, axis=0) - corners
    before = np.roll(edges, 1, axis=0)
    angle = np.arctan2(before[:, 0] * edges[:, 1] - before[:, 1] * edges[:, 0], (before * edges).sum(axis=1))
    lengths = np.linalg.norm(edges, axis=1)
    length = (lengths + np.roll(lengths, 1)) / 2
    sharp = angle > np.radians(SHARP)
    curvature = np.where(sharp, np.inf, angle / length)
    return np.where(sharp, 0.0, length), np.maximum(angle, 0.0), curvature


def _bends_of_mesh(vertices: Floats, faces: Integers) -> tuple[Floats, Floats, Floats]:
    """Return area, area times curvature, and curvature of the parts of a closed mesh that bulge.

    They are the sharp edges, which have no area and infinite curvature, and the surroundings of the vertices with their
    larger principal curvature.
    """
    triangles = vertices[faces]
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    doubled = np.linalg.norm(normals, axis=1)
    normals /= np.maximum(doubled, 1e-300)[:, None]
    begin, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    key = np.minimum(begin, end) * len(vertices) + np.maximum(begin, end)
    order = np.argsort(key, kind="stable")
    one, two = order[0::2], order[1::2]
    along = vertices[end[one]] - vertices[begin[one]]
    length = np.linalg.norm(along, axis=1)
    along /= np.maximum(length, 1e-300)[:, None]
    first, second = normals[one // 3], normals[two // 3]
    # an edge bulges where the normals turn away from each other along it
    angle = np.arctan2((np.cross(first, second) * along).sum(axis=1), (first * second).sum(axis=1))
    sharp = angle > np.radians(SHARP)
    smooth = np.abs(angle) <= np.radians(SHARP)
    area = np.zeros(len(vertices))
    np.add.at(area, faces, doubled[:, None] / 6)
    tensor = np.zeros((len(vertices), 3, 3))
    part = (angle * length)[smooth, None, None] / 2 * along[smooth, :, None] * along[smooth, None, :]
    for ends in (begin[one[smooth]], end[one[smooth]]):
        np.add.at(tensor, ends, part)
    # the mean over the neighbours evens out the lengths of edges
    around, room = tensor.copy(), area.copy()
    for a, b in ((begin[one], end[one]), (end[one], begin[one])):
        np.add.at(around, a, tensor[b])
        np.add.at(room, a, area[b])
    curvature = np.linalg.eigvalsh(around)[:, 2] / np.maximum(room, 1e-300)
    size = np.concatenate([area, np.zeros(int(sharp.sum()))])
    turned = np.concatenate([area * np.maximum(curvature, 0.0), (angle * length)[sharp]])
    return size, turned, np.concatenate([curvature, np.full(int(sharp.sum()), np.inf)])
