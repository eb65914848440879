"""How far shapes reach in each direction, so that planes between grains show that they are apart.

Two grains are apart where, along some direction, one ends before the other begins. How far a shape reaches along a
direction, its support function, is convex and grows with the length of the direction; so between three directions it
is no more than interpolated. It is tabulated at the nodes of an octahedron with triangles on its faces: what is read
from there is never less than the true reach, and more by the square of the edge of a triangle only.

What the table promises is more than that no point lies beyond: beyond a plane that bounds the shape by its table, the
field of the shape tells at least the distance from the plane. Interpolation keeps this promise, as it keeps planes.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Floats
from voxgran._base.kernels import inlined_kernel
from voxgran.packing.control_point.distance_fields import (
    BALLS,
    BEGIN,
    CELL,
    END,
    GRID,
    KIND,
    NODE,
    NODES_X,
    NODES_Y,
    NODES_Z,
    PLANES,
    Fields,
)
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape

#: triangles along an edge of the octahedron
STEPS = 16
#: relative and absolute room for rounding
ROOM, ROUNDING = 1e-6, 1e-6
#: part of a cell up to which fields that tell less than distances are trusted outside of their shape
TRUSTED = 0.5
#: products of directions and points that are made at once
PRODUCTS = 2**21


class Reaches(NamedTuple):
    """Support functions of several shapes; without any rows where bounding spheres tell as much.

    values: (shapes, 8, STEPS + 1, STEPS + 1), at the nodes of the octahedron ``|x| + |y| + |z| = 1``: octants by the
    signs of x, y and z, then steps along x and along y; beyond the last node the table continues each triangle.
    stretch: factor by which a distance must be enlarged so that the signed-distance field is guaranteed to report at
    least that distance in every direction.  limit: distance up to which this holds.
    """

    values: NDArray[np.float32]
    stretch: Floats
    limit: Floats


def no_reaches() -> Reaches:
    """Return a table without rows."""
    return Reaches(np.zeros((0, 8, STEPS + 1, STEPS + 1), dtype=np.float32), np.zeros(0), np.zeros(0))


def make_reaches(shapes: list[Shape], points: list[Floats], fields: Fields) -> Reaches:
    """Return the reaches of shapes at unit diameter with their control points (n, 3) and fields, if there are any."""
    tables, stretch, limit = [], np.ones(len(shapes)), np.full(len(shapes), np.inf)
    for k, (shape, own) in enumerate(zip(shapes, points, strict=True)):
        pad, kind = ROUNDING, fields.head[k, KIND] if len(fields.head) else -1
        places = np.concatenate([shape.vertices, np.asarray(own)])
        if kind == GRID:
            limit[k], lack = _what_is_lacking(shape, fields, k)
            pad += lack
        if kind == PLANES:
            stretch[k] = max(1.0, shape.bounding_radius / float(_rows(fields, k)[:, 3].min()))
        spheres = _rows(fields, k) if kind == BALLS else np.zeros((0, 4))
        tables.append(_table(places, spheres, pad))
    return Reaches(np.array(tables, dtype=np.float32).reshape(-1, 8, STEPS + 1, STEPS + 1), stretch, limit)


def _rows(fields: Fields, k: int) -> Floats:
    """Return the spheres or planes of a shape."""
    return fields.rows[int(fields.head[k, BEGIN]) : int(fields.head[k, END])]


def _table(places: Floats, spheres: Floats, pad: float) -> Floats:
    """Return the reach of places and spheres, and a pad, at all nodes."""
    i, j = np.indices((STEPS + 1, STEPS + 1))
    signs = np.array([[1 - (o >> 1 & 2), 1 - (o & 2), 1 - (2 * o & 2)] for o in range(8)])
    nodes = np.stack([i, j, STEPS - i - j], axis=-1) / STEPS * signs[:, None, None, :]
    ways = nodes.reshape(-1, 3)
    length, reach = np.linalg.norm(ways, axis=1), np.full(len(ways), -np.inf)
    for sphere in spheres:
        reach = np.maximum(reach, ways @ sphere[:3] + sphere[3] * length)
    many = max(1, PRODUCTS // len(places))
    for k in range(0, len(ways), many):
        reach[k : k + many] = np.maximum(reach[k : k + many], (ways[k : k + many] @ places.T).max(axis=1))
    table = ((reach + pad * length) * (1.0 + ROOM)).reshape(8, STEPS + 1, STEPS + 1)
    # beyond the last node each triangle goes on as a plane
    for total in range(STEPS + 1, 2 * STEPS + 1):
        for a in range(total - STEPS, STEPS + 1):
            b = total - a
            table[:, a, b] = table[:, a - 1, b] + table[:, a, b - 1] - table[:, a - 1, b - 1]
    return np.asarray(table)


def _what_is_lacking(shape: Shape, fields: Fields, k: int) -> tuple[float, float]:
    """Return the distance up to which a sampled field is trusted, and its largest underestimate of the distance from
    the tessellation within that range.
    """
    head, count = fields.head[k], fields.head[k, [NODES_X, NODES_Y, NODES_Z]].astype(np.int64)
    begin = int(fields.rows[int(head[BEGIN]), 0])
    nodes = fields.values[begin : begin + count.prod()].reshape(count).astype(np.float64)
    flat = shape.dimension == 2
    sides = [nodes[0], nodes[-1], nodes[:, 0], nodes[:, -1], *([] if flat else [nodes[:, :, 0], nodes[:, :, -1]])]
    limit = float(min(side.min() for side in sides))
    if isinstance(shape.geometry, Mesh) or flat:
        return limit, shape.tessellation_error
    limit = min(limit, TRUSTED * float(head[CELL]))
    asked = np.zeros(count, dtype=np.bool_)
    low = nodes < limit
    for corner in np.ndindex(2, 2, 2):
        for other in np.ndindex(2, 2, 2):
            into, by = (tuple(slice(c, n - 1 + c) for c, n in zip(at, count, strict=True)) for at in (corner, other))
            asked[into] |= low[by]
    # deep inside, distances are exact or more than exact
    asked &= nodes > -2.0 * head[CELL]
    places = head[NODE : NODE + 3] + head[CELL] * np.argwhere(asked)
    true = Mesh(shape.vertices, shape.faces).tree.signed_distance(places)
    return limit, max(shape.tessellation_error, float((true - nodes[asked]).max(initial=0.0)))


@inlined_kernel
def plane_of(values: NDArray[np.float32], s: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return the vector by which a direction, of any length, is multiplied for the reach along it.

    It is about the point of the shape that lies farthest in this direction.
    """
    octant = (4 if x < 0.0 else 0) + (2 if y < 0.0 else 0) + (1 if z < 0.0 else 0)
    a, b, c = abs(x), abs(y), abs(z)
    share = STEPS / (a + b + c)
    u, v = a * share, b * share
    i = min(int(u), STEPS - 1)
    j = min(int(v), STEPS - 1 - i)
    one, other = np.float64(values[s, octant, i + 1, j]), np.float64(values[s, octant, i, j + 1])
    if (u - i) + (v - j) > 1.0:
        corner = np.float64(values[s, octant, i + 1, j + 1])
        along, across = corner - other, corner - one
        rest = one + other - corner - along * i - across * j
    else:
        corner = np.float64(values[s, octant, i, j])
        along, across = one - corner, other - corner
        rest = corner - along * i - across * j
    px, py, pz = rest + along * STEPS, rest + across * STEPS, rest
    return -px if x < 0.0 else px, -py if y < 0.0 else py, -pz if z < 0.0 else pz
