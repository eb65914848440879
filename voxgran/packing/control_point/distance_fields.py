"""What kernels read of shapes: how far a place is from the surface, and how far a shape reaches in each direction.

Unions of spheres and convex bodies with flat faces are kept as spheres and planes, which tell inside from outside
exactly. Any other shape is sampled on a lattice of nodes, between which values are interpolated linearly along each
axis: the error is of second order in the edge of a cell where the surface is smooth. A place beyond the lattice takes
the nearest place on it and the way there, which is never more than its distance. All is in the frame of a shape of unit
diameter.

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

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel, inlined_kernel
from voxgran._base.lazy import load
from voxgran.contacts.inside import inner_distance
from voxgran.geometry.vectors import Vector, row_of
from voxgran.shapes.describing.body import Geometry, as_spheres
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive

#: kinds of fields
BALLS, PLANES, GRID = 0, 1, 2
#: columns of the head: kind, first row and the one after the last; of a lattice its first node (3 columns), the edge of
#: a cell, and the nodes along y, z and x; the Lipschitz constant of the interpolant above the queried depth; and eps2
#: such that |f(p) - f(q)| <= sqrt(|p - q|^2 + eps2) outside the solid
KIND, BEGIN, END, NODE, CELL, NODES_Y, NODES_Z, NODES_X, STEEP, ROUGH = 0, 1, 2, 3, 6, 7, 8, 9, 10, 11
#: spheres and planes at most; more of them are sampled
MOST_BALLS, MOST_PLANES = 24, 64
#: cells along the longest side of a lattice, at most
MOST_CELLS = 128
#: cells around a shape
MARGIN = 2
#: more than single precision loses of a distance, in diameters
SINGLE = 1e-6


class Fields(NamedTuple):
    """Signed distances of several shapes, below 0 inside.

    head: (shapes, 12), by the columns above.  rows: (n, 4), center and radius of each sphere, outward normal and offset
    of each plane, or of a lattice one row, with where its values begin.  values: distances at the nodes of all
    lattices, the last axis fastest.  error: (shapes,), largest distance that a field reports of points on the surface;
    exact fields have 0.
    """

    head: Floats
    rows: Floats
    values: NDArray[np.float32]
    error: Floats

    @property
    def nbytes(self) -> int:
        """Bytes that are held."""
        return sum(int(array.nbytes) for array in self)


def make_fields(
    shapes: list[Shape], points: list[Floats], *, cell: float, reach: float = 0.0, depth: float = 0.0,
    margin: float = 0.0,
) -> Fields:  # fmt: skip
    """Return the fields of shapes at unit diameter; `points` (n, 3) on the surface of each serve to measure the error.

    `cell` is the wanted edge of the cells of a lattice; distances are to be told up to `reach` outside (0: the sign is
    enough) and `depth` inside; lattices extend by at least another `margin` around the shapes.
    """
    heads, rows, values, row, value = [], [], [], 0, 0
    for shape in shapes:
        kind, own = _rows_of(shape.geometry, exact=reach > 0.0)
        first, edge, nodes = np.zeros(3), 1.0, np.zeros((0, 0, 0), dtype=np.float32)
        if kind == GRID:
            first, edge, nodes = _sampled(shape, cell, reach, margin)
            own = np.array([[value, 0.0, 0.0, 0.0]])
        steep = _steepest(nodes, edge, -depth) if kind == GRID else 1.0
        rough = _roughness(shape.geometry, edge) if kind == GRID else 0.0
        heads.append([kind, row, row + len(own), *first, edge, *nodes.shape[1:], nodes.shape[0], steep, rough])
        rows.append(own)
        values.append(nodes.ravel())
        row, value = row + len(own), value + nodes.size
    fields = Fields(
        np.array(heads, dtype=np.float64).reshape(-1, 12),
        np.concatenate([np.zeros((0, 4)), *rows]),
        np.concatenate([np.zeros(0, dtype=np.float32), *values]),
        np.zeros(len(shapes)),
    )
    for k, places in enumerate(points[: len(shapes)]):
        if fields.head[k, KIND] == GRID:
            fields.error[k] = np.abs(distances(fields, k, places)).max()
    return fields


def distances(fields: Fields, shape: int, points: Floats) -> Floats:
    """Return what a field tells of (n, 3) points in the frame of its shape, (n,)."""
    distance = np.zeros(len(points))
    _tell(fields, shape, np.ascontiguousarray(points, dtype=np.float64), distance)
    return distance


def _rows_of(geometry: Geometry, *, exact: bool) -> tuple[int, Floats]:
    """Return spheres or planes of a geometry, or that it has to be sampled; planes tell exact distances only inside."""
    spheres = as_spheres(geometry)
    if spheres is not None and len(spheres[1]) <= MOST_BALLS:
        return BALLS, np.column_stack(spheres)
    planes = None if exact else _planes_of(geometry)
    return (GRID, np.zeros((0, 4))) if planes is None else (PLANES, planes)


def _planes_of(geometry: Geometry) -> Floats | None:
    """Return the planes of the faces of a convex body, or None where it is none or has too many."""
    if isinstance(geometry, Outline):
        a, b = geometry.vertices, np.roll(geometry.vertices, -1, axis=0)
        along = (b - a) / linear.norm(b - a, axis=1, keepdims=True)
        normal = np.column_stack([along[:, 1], -along[:, 0]])
        offset = (normal * a).sum(axis=1)
        if len(a) > MOST_PLANES or (linear.matmul(geometry.vertices, normal.T) > offset + 1e-12).any():
            return None
        return np.column_stack([normal, np.zeros(len(a)), offset])
    if isinstance(geometry, Primitive) and geometry.kind != "box":
        return None
    corners = geometry.tessellation()[0]
    hull = load("scipy.spatial").ConvexHull(corners)
    if len(hull.vertices) > 2 * MOST_PLANES or not np.isclose(hull.volume, geometry.volume, rtol=1e-9):
        return None
    # the planes of triangles in one face agree but for rounding
    order = np.unique(hull.equations.round(9), axis=0, return_index=True)[1]
    if len(order) > MOST_PLANES:
        return None
    normal = hull.equations[order, :3]
    return np.column_stack([normal, linear.matmul(corners, normal.T).max(axis=0)])


def _sampled(shape: Shape, cell: float, reach: float, margin: float) -> tuple[Floats, float, NDArray[np.float32]]:
    """Return the first node, the edge of a cell and the distances at the nodes of a lattice around a shape."""
    low, high = shape.vertices.min(axis=0), shape.vertices.max(axis=0)
    cell = max(cell, float((high - low).max() + 2 * (reach + margin)) / MOST_CELLS)
    around = reach + max(MARGIN * cell, margin)
    nodes = np.ceil((high - low + 2 * around) / cell).astype(np.int64) + 1
    first = (low + high) / 2 - (nodes - 1) / 2 * cell
    if shape.dimension == 2:
        # two layers that are the same, with the plane of the shape between them
        nodes[2], first[2] = 2, -cell / 2
    axes = [first[k] + cell * np.arange(nodes[k]) for k in range(3)]
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    if shape.dimension == 2:
        places[:, 2] = 0.0
    distance = _exact_distances(shape.geometry, places, outside=reach > 0.0)
    return first, cell, distance.reshape(nodes).astype(np.float32)


def _exact_distances(geometry: Geometry, places: Floats, *, outside: bool) -> Floats:
    """Return signed distances of (n, 3) places; near edges of regular solids, those outside may be less than true."""
    if isinstance(geometry, Mesh):
        return geometry.tree.signed_distance(places)
    if outside and isinstance(geometry, Primitive) and geometry.kind == "box":
        vertices, faces, _ = geometry.tessellation()
        return Mesh(vertices, faces).tree.signed_distance(places)
    return -inner_distance(geometry)(places)


def _steepest(nodes: NDArray[np.float32], edge: float, least: float) -> float:
    """Return how fast interpolated values change along a way at the most, in cells that reach above a value.

    Along each axis the slopes across it are linear, so that the steepest place of a cell is one of its corners.
    """
    cells = tuple(n - 1 for n in nodes.shape)
    high = np.full(cells, -np.inf)
    for corner in np.ndindex(2, 2, 2):
        high = np.maximum(high, nodes[tuple(slice(c, c + n) for c, n in zip(corner, cells, strict=True))])
    slopes = [np.diff(nodes.astype(np.float64), axis=axis) / edge for axis in range(3)]
    steepest = 1.0
    for corner in np.ndindex(2, 2, 2):
        squares = np.zeros(cells)
        for axis, slope in enumerate(slopes):
            start = [0 if k == axis else c for k, c in enumerate(corner)]
            squares += slope[tuple(slice(c, c + n) for c, n in zip(start, cells, strict=True))] ** 2
        steepest = max(steepest, float(np.sqrt(squares[high > least].max(initial=1.0))))
    # single precision; and beyond the lattice values change as fast as distances
    return steepest * (1.0 + 1e-5)


def _roughness(geometry: Geometry, edge: float) -> float:
    """Return what is to be added to the square of a way so that interpolated distances change by no more than the root.

    Interpolation is the mean over nodes drawn along each axis on its own, so that the mean is the place. Two places
    can draw theirs so that along each axis the difference varies by a quarter of a cell's square at the most, and at
    nodes distances differ by no more than these are apart. It is infinite where nodes do not hold distances.
    """
    return 0.75 * edge**2 if isinstance(geometry, Mesh) else np.inf


@bare_kernel
def _tell(fields, shape, points, distance):  # type: ignore[no-untyped-def]
    """Fill in the signed distances of points by a field."""
    for k in range(len(points)):
        distance[k] = field_at(fields, shape, row_of(points, k))


@inlined_kernel
def field_at(fields: Fields, shape: int, place: Vector) -> float:
    """Return the signed distance of a place from a shape; outside it is that or less, but for the interpolation."""
    head, rows, (x, y, z) = fields.head, fields.rows, place
    kind, begin, end = head[shape, KIND], np.int64(head[shape, BEGIN]), np.int64(head[shape, END])
    if kind == GRID:
        return _between_nodes(head, fields.values, shape, np.int64(rows[begin, 0]), place)
    if kind == PLANES:
        most = -np.inf
        for k in range(begin, end):
            most = max(most, rows[k, 0] * x + rows[k, 1] * y + rows[k, 2] * z - rows[k, 3])
        return most
    least = np.inf
    for k in range(begin, end):
        dx, dy, dz = x - rows[k, 0], y - rows[k, 1], z - rows[k, 2]
        least = min(least, np.sqrt(dx * dx + dy * dy + dz * dz) - rows[k, 3])
    return least


@inlined_kernel
def _between_nodes(head, values, s, begin, place):  # type: ignore[no-untyped-def]
    """Return the value between eight nodes, and beyond the lattice what a place is from it at least."""
    x, y, z = place
    cell, nx = head[s, CELL], np.int64(head[s, NODES_X])
    ny, nz = np.int64(head[s, NODES_Y]), np.int64(head[s, NODES_Z])
    u, v, w = (x - head[s, NODE]) / cell, (y - head[s, NODE + 1]) / cell, (z - head[s, NODE + 2]) / cell
    a, b, c = min(max(u, 0.0), nx - 1.0), min(max(v, 0.0), ny - 1.0), min(max(w, 0.0), nz - 1.0)
    i, j, k = min(np.int64(a), nx - 2), min(np.int64(b), ny - 2), min(np.int64(c), nz - 2)
    p, q, r = a - i, b - j, c - k
    at = begin + (i * ny + j) * nz + k
    low = (1.0 - r) * values[at] + r * values[at + 1]
    low += q * ((1.0 - r) * values[at + nz] + r * values[at + nz + 1] - low)
    at += ny * nz
    high = (1.0 - r) * values[at] + r * values[at + 1]
    high += q * ((1.0 - r) * values[at + nz] + r * values[at + nz + 1] - high)
    distance = low + p * (high - low)
    if a == u and b == v and c == w:
        return distance
    du, dv, dw = cell * (u - a), cell * (v - b), cell * (w - c)
    distance = max(distance, 0.0)
    return np.sqrt(du * du + dv * dv + dw * dw + distance * distance)


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
    length, reach = linear.norm(ways, axis=1), np.full(len(ways), -np.inf)
    for sphere in spheres:
        reach = np.maximum(reach, linear.matmul(ways, sphere[:3]) + sphere[3] * length)
    many = max(1, PRODUCTS // len(places))
    for k in range(0, len(ways), many):
        reach[k : k + many] = np.maximum(reach[k : k + many], linear.matmul(ways[k : k + many], places.T).max(axis=1))
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
