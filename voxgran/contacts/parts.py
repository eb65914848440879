"""Grains as convex parts, in the rows of numbers that the kernels of the contact tests use.

A sphere is a point with a margin, a spherocylinder a segment with a margin, a union of spheres consists of several
spheres, and an ellipsoid, box, cylinder or cone is one part. The rows are those of :mod:`voxgran.geometry.support`,
rotated and scaled to the poses of the grains, relative to their centroids.
"""

from typing import NamedTuple

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers
from voxgran.geometry.support import BOX, CONE, CYLINDER, ELLIPSOID, POINT, ROW, SPHEROCYLINDER
from voxgran.shapes.describing.body import Geometry, as_spheres
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.spheres import Spheres

CODES = {"ellipsoid": ELLIPSOID, "box": BOX, "cylinder": CYLINDER, "cone": CONE, "spherocylinder": SPHEROCYLINDER}


class Parts(NamedTuple):
    """Convex parts of several bodies, one body after the other."""

    start: Integers  # first part of each body, (n + 1,)
    row: Floats  # kind, dimensions and rotation of each part, (p, 13)
    margin: Floats  # distance of the surface from the core, (p,): the radius of a sphere or spherocylinder
    center: Floats  # center of each part, relative to the centroid of the body, (p, 3)
    reach: Floats  # radius of the bounding sphere about the center, (p,)

    def placed(self, body: Integers, scale: Floats, matrices: Floats) -> "Parts":
        """Return the parts of grains: body `body[k]`, scaled by `scale[k]` and rotated by `matrices[k]`."""
        counts = np.diff(self.start)[body]
        start = np.concatenate([[0], np.cumsum(counts)])
        grain = np.repeat(np.arange(len(body)), counts)
        part = np.arange(start[-1]) - start[grain] + self.start[body[grain]]
        factor, turn = scale[grain], matrices[grain]
        row = self.row[part]
        row[:, 1:4] *= factor[:, None]
        row[:, 4:] = linear.matmul(turn, row[:, 4:].reshape(-1, 3, 3)).reshape(-1, 9)
        center = linear.einsum("pij,pj->pi", turn, self.center[part]) * factor[:, None]
        return Parts(start, row, self.margin[part] * factor, center, self.reach[part] * factor)


def has_parts(geometry: Geometry) -> bool:
    """Return whether a geometry is made of convex parts."""
    return isinstance(geometry, Primitive | Spheres) or is_disk(geometry)


def is_disk(geometry: Geometry) -> bool:
    """Return whether a geometry is a disk."""
    return isinstance(geometry, Outline) and geometry.kind == "disk"


def parts_of(geometries: list[Geometry]) -> Parts:
    """Return the convex parts of geometries, one per body, in their own frames; other geometries have no parts."""
    rows, margins, centers, reaches, counts = [], [], [], [], []
    for geometry in geometries:
        row, margin, center = _parts_of_one(geometry)
        rows.append(row)
        margins.append(margin)
        centers.append(center)
        reaches.append(margin if len(row) != 1 or row[0, 0] == POINT else np.array([geometry.bounding_radius]))
        counts.append(len(row))
    start = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    return Parts(
        start,
        np.concatenate([np.zeros((0, ROW)), *rows]),
        np.concatenate([np.zeros(0), *margins]),
        np.concatenate([np.zeros((0, 3)), *centers]),
        np.concatenate([np.zeros(0), *reaches]),
    )


def row_of(primitive: Primitive) -> Floats:
    """Return the (13,) row of a primitive other than a sphere in its own frame."""
    row = np.zeros(ROW)
    row[0] = CODES[primitive.kind]
    row[1 : 1 + len(primitive.dimensions)] = primitive.dimensions
    row[4:] = primitive.matrix.ravel()
    return row


def _parts_of_one(geometry: Geometry) -> tuple[Floats, Floats, Floats]:
    """Return rows, margins and centers of one geometry."""
    if isinstance(geometry, Primitive) and geometry.kind != "sphere":
        row, margin = row_of(geometry), np.zeros(1)
        if geometry.kind == "spherocylinder":
            margin[0], row[1] = row[1], 0.0
        return row[None], margin, np.zeros((1, 3))
    centers, margins = as_spheres(geometry) or (np.zeros((0, 3)), np.zeros(0))
    return np.zeros((len(margins), ROW)), margins, centers
