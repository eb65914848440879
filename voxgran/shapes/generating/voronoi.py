"""Voronoi cells of seeds in a box, one by one, as convex polyhedra."""

import itertools
from typing import Literal

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.lazy import load
from voxgran.shapes.generating.hulls import hull_of_corners
from voxgran.shapes.mesh import Mesh

#: corners of a cell that are nearer to each other, in bounding radii of the cell, are one
SAME = 1e-9


def voronoi_cell(seeds: Floats, k: int, lengths: Floats, boundary: Literal["periodic", "reflected"]) -> Mesh:
    """Return the Voronoi cell of seed k of (n, 3) seeds in a box from the origin to (3,) lengths.

    The box is periodic, or its faces bound the cells, as images reflected by them do.
    """
    others = np.concatenate([np.delete(seeds, k, axis=0), _images(seeds, lengths, boundary)]) - seeds[k]
    if boundary == "periodic":
        # a cell is no longer than the period along any axis, so that another image is nearer to all of its points
        others = others[(np.abs(others) <= lengths * (1 + SAME)).all(axis=1)]
    # planes n x = 1 of a convex solid about the origin are the corners of its dual, and faces of the dual its corners
    normals = 2 * others / np.einsum("ni,ni->n", others, others)[:, None]
    dual = load("scipy.spatial").ConvexHull(normals)
    corners = -dual.equations[:, :3] / dual.equations[:, 3:]
    # more than three planes may meet at a point, and the dual then has several triangles in one face
    near = SAME * float(np.abs(corners).max())
    corners = corners[np.unique(np.round(corners / near), axis=0, return_index=True)[1]]
    return hull_of_corners(corners + seeds[k])


def _images(seeds: Floats, lengths: Floats, boundary: Literal["periodic", "reflected"]) -> Floats:
    """Return the images of the seeds around a box: 26 periodic ones, or 6 reflected by its faces."""
    if boundary == "periodic":
        shifts = np.array([shift for shift in itertools.product((-1, 0, 1), repeat=3) if any(shift)])
        return (seeds + (shifts * lengths)[:, None]).reshape(-1, 3)
    images = []
    for axis in range(3):
        for face in (0.0, lengths[axis]):
            image = seeds.copy()
            image[:, axis] = 2 * face - image[:, axis]
            images.append(image)
    return np.concatenate(images)
