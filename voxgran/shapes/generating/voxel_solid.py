"""Solids of equal cubes on a lattice, with the exact volume of the cubes.

Cubes that share only an edge or a corner are not joined: the vertices there are doubled, so that each edge of the
surface has two faces and no vertex is moved.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from voxgran._base.arrays import Booleans, Integers, as_positive
from voxgran.lattice.cuberille import voxel_surface
from voxgran.lattice.label import connected_components
from voxgran.shapes.family import refuse_both, sized
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape


def voxel_solid(
    mask: Booleans,
    *,
    name: str,
    diameter: float | None = None,
    edge: float | None = None,
    record: Mapping[str, Any] | None = None,
) -> Shape:
    """Return the solid of the cubes of an (nx, ny, nz) mask, which are connected by faces.

    The equivalent diameter is 1 unless it or the edge of a cube is given.

    Raises
    ------
    InputError
        If the diameter and the edge are both given, or one is not above 0.
    """
    refuse_both(diameter, (("edge", edge),))
    vertices, faces = voxel_surface(_cut(mask))
    if edge is not None:
        return Shape.of(Mesh(vertices * as_positive(edge, "edge"), faces), name=name, record=record)
    return sized(Mesh(vertices, faces), diameter, name=name, record=record)


def mask_of_cubes(places: Integers) -> Booleans:
    """Return the smallest mask that holds cubes at the given lattice places, (n, 3) whole numbers of any sign."""
    low = places.min(axis=0)
    mask = np.zeros(places.max(axis=0) - low + 1, dtype=np.bool_)
    mask[tuple((places - low).T)] = True
    return mask


def largest_piece(mask: Booleans) -> Booleans:
    """Return the largest of the pieces that are connected by faces; of equal ones the first."""
    labels, count = connected_components(mask)
    return mask if count == 1 else np.asarray(labels == 1 + np.argmax(np.bincount(labels.ravel())[1:]))


def _cut(mask: Booleans) -> Booleans:
    """Return the part of a mask that holds all its cubes."""
    places = np.nonzero(mask)
    return mask[tuple(slice(int(place.min()), int(place.max()) + 1) for place in places)]
