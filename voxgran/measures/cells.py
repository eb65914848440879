"""Volumes of Voronoi and Laguerre cells, cut by the true walls of any container.

Cells are made by :mod:`voxgran.packing.tessellation.voronoi_cells` in the bounds of the container. There round walls
and walls of triangles cut convex cells with little error; here the volume of each cell within the walls is exact. At a
cylinder or a disk it is the sum over the faces of the cell of integrals over their projection, a polygon cut by a
circle; at a sphere it is that of the sphere cut by the planes of the cell. A closed mesh is the signed sum of the
tetrahedra between its triangles and one point, and a polygon that of triangles: the volume of a cell within it is the
signed sum of what each of them cuts out of the cell, also where the container is not convex. Then a cell may consist of
several parts, because distances are measured through walls.
"""

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel, kernel
from voxgran.containers.kernel_container import FLAT, kernel_container
from voxgran.containers.model import Boundary, Container, boundary_of, refuse_tilt
from voxgran.geometry.halfspaces import unit_sphere
from voxgran.geometry.polyhedron import (
    CROWDED,
    CUT,
    EMPTY,
    FAILED,
    clip,
    copy_polyhedron,
    empty_polyhedron,
    reach_of,
    volume_and_center,
)
from voxgran.packing.tessellation.voronoi_cells import FACES, Cells, build_cell, seeds_of
from voxgran.shapes.mesh import Mesh

#: kinds of walls: those of the bounds, of a closed mesh or a polygon, of a cylinder or a disk, of a sphere
BOUNDS, PIECES, UPRIGHT, ROUND = 0, 1, 2, 3
#: component of a normal along the axis of a cylinder below which a face counts as upright
UPRIGHT_FACE = 1e-9
#: shift of a plane, in sizes of a cell, where rounding prevents a cut, and tries
SHIFT, TRIES = 1e-14, 6


class Walls(NamedTuple):
    """Walls beside the bounds, in coordinates from their lower corner.

    middle: (3,) of a round wall.  planes: (m, 4, 4) outward normals and offsets of the planes around each piece of a
    closed mesh.  sign: (m,) 1.0 or -1.0.  work: (k, 9) work space.
    """

    kind: int
    middle: Floats
    radius: float
    planes: Floats
    sign: Floats
    work: Floats


def cell_volumes(seeds: Floats, weights: Floats, container: Container) -> Floats:
    """Return the volume (n,), in 2D the area, of the Laguerre cell of each seed (n, 3) in a container.

    A point of the container belongs to the seed of the smallest ``|x - seed|**2 - weight``. The volumes add up to that
    of the container. Of seeds at one place the heaviest share the cell.
    """
    count, d = len(seeds), container.dimension
    if not count:
        return np.zeros(0)
    lower, lengths = container.bounds[0], container.bounds[1] - container.bounds[0]
    longest = float(lengths.max())
    # cells have a width of about 1, and a power of two leaves the digits as they are
    unit = 2.0 ** math.floor(math.log2(longest * float(np.prod(lengths[:d] / longest) / count) ** (1 / d)))
    room = lengths / unit
    place = (np.asarray(seeds, dtype=np.float64) - lower) / unit
    around = np.array(container.periodic) & (np.arange(3) < d)
    place[:, around] -= np.floor(place[:, around] / room[around]) * room[around]
    place, weight, index, share = _distinct(place, np.asarray(weights, dtype=np.float64) / unit**2)
    walls = walls_of(container, unit)
    cells = Cells(kernel_container(container, from_corner=True)._replace(kind=FLAT, lengths=room))
    depth = np.full(len(place), -np.inf)
    if walls.kind == PIECES:
        depth = -container.signed_distance(place * unit + lower) / unit
    volume, spare, first = np.zeros(len(place)), empty_polyhedron(FACES), 0
    found = seeds_of(place, weight, cells.walls)
    while first < len(place):
        first = int(_fill(cells.around(found), spare, walls, depth, first, volume))
        if first < len(place):
            cells.grow()
            spare = empty_polyhedron(len(cells.work.size))
            walls = walls._replace(work=np.zeros((len(spare.size), 9)))
    return volume[index] * share * unit**d


def walls_of(container: Container, unit: float) -> Walls:
    """Return the walls beside the bounds, with lengths over a unit.

    Raises
    ------
    InputError
        If the container is tilted.
    """
    refuse_tilt(container, "a Voronoi cell", "measure them in an upright one")
    boundary, d = boundary_of(container), container.dimension
    lower, work = container.bounds[0], np.zeros((FACES, 9))
    pieces = np.zeros((0, 4, 4)), np.zeros(0)
    if wall := boundary.cylinder or boundary.sphere:
        return Walls(wall.axes, (np.array(wall.center) - lower) / unit, wall.radius / unit, *pieces, work)
    kind = BOUNDS if boundary.is_flat else PIECES
    if kind == PIECES:
        pieces = _pieces(*_surface(container, boundary, lower, unit), flat=d == 2)
    return Walls(kind, np.zeros(3), 0.0, *pieces, work)


def _distinct(place: Floats, weight: Floats) -> tuple[Floats, Floats, Integers, Floats]:
    """Return places and weights of which no two are at one place, and for each seed its index and share in them."""
    order = np.lexsort((-weight, place[:, 2], place[:, 1], place[:, 0]))
    ahead = order[:-1], order[1:]
    same = (place[ahead[0]] == place[ahead[1]]).all(axis=1)
    first = np.concatenate([[True], ~same])
    index = np.empty(len(place), dtype=np.int64)
    index[order] = np.cumsum(first) - 1
    kept = order[first]
    heaviest = weight == weight[kept][index]
    number = np.bincount(index, weights=heaviest)
    return place[kept], weight[kept], index, heaviest / number[index]


def _surface(container: Container, boundary: Boundary, lower: Floats, unit: float) -> tuple[Floats, Integers]:
    """Return vertices and triangles of the walls, in 2D edges, from the lower corner of the bounds over a unit."""
    if boundary.loops:
        sizes = [len(loop) for loop in boundary.loops]
        ends = np.concatenate([[0], np.cumsum(sizes)])
        corners = np.column_stack([np.concatenate(boundary.loops), np.zeros(ends[-1])])
        edges = [np.column_stack([np.arange(a, b), np.roll(np.arange(a, b), -1)]) for a, b in pairwise(ends)]
        return (corners - lower) / unit, np.concatenate(edges)
    if boundary.solid is not None and isinstance(boundary.solid.geometry, Mesh):
        geometry = boundary.solid.geometry
        return (geometry.vertices + np.array(boundary.solid.offset) - lower) / unit, geometry.faces
    vertices, faces = container.mesh()
    return (vertices - lower) / unit, faces


def _pieces(vertices: Floats, faces: Integers, *, flat: bool) -> tuple[Floats, Floats]:
    """Return planes (m, 4, 4) and signs (m,) of the tetrahedra between triangles, in 2D the triangles between edges,
    and the mean of the vertices.
    """
    middle = vertices.mean(axis=0)
    corners = vertices[faces] - middle
    a, b = corners[:, 0], corners[:, 1]
    normals, offsets = np.zeros((len(faces), 4, 3)), np.zeros((len(faces), 4))
    if flat:
        turned = np.array([1.0, -1.0, 0.0])
        normals[:, 0] = (b - a)[:, [1, 0, 2]] * turned
        normals[:, 1], normals[:, 2] = a[:, [1, 0, 2]] * turned, -b[:, [1, 0, 2]] * turned
        sign = np.sign(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
        offsets[:, 3] = 1.0
    else:
        c = corners[:, 2]
        normals[:, 0] = np.cross(b - a, c - a)
        normals[:, 1], normals[:, 2], normals[:, 3] = -np.cross(a, b), -np.cross(b, c), -np.cross(c, a)
        sign = np.sign((normals[:, 0] * a).sum(axis=1))
    normals *= sign[:, None, None]
    length = linear.norm(normals, axis=2)
    thick = (sign != 0) & (length[:, : 3 if flat else 4] > 0).all(axis=1)
    normals /= np.where(length > 0, length, 1.0)[..., None]
    offsets[:, 0] = (normals[:, 0] * a).sum(axis=1)
    offsets[:, : 3 if flat else 4] += linear.matmul(normals, middle)[:, : 3 if flat else 4]
    return np.concatenate([normals, offsets[..., None]], axis=2)[thick], sign[thick]


@kernel
def _fill(tessellation, spare, walls, depth, first, volume):  # type: ignore[no-untyped-def]
    """Write the volumes of cells from the first one on; return the number of the one for which there is no room, or
    that of all cells.
    """
    middle, seeds, cell = np.zeros(3), tessellation.seeds, tessellation.cell
    for i in range(first, len(volume)):
        state = build_cell(tessellation, i, False)
        if state == CROWDED:
            return i
        volume[i] = 0.0
        if state == EMPTY:
            continue
        mx, my = walls.middle[0] - seeds.place[i, 0], walls.middle[1] - seeds.place[i, 1]
        mz = walls.middle[2] - seeds.place[i, 2]
        if walls.kind == PIECES:
            if reach_of(cell, tessellation.walls.dimension == 2) > depth[i]:
                volume[i] = _in_pieces(cell, spare, walls, seeds.place, i, middle)
                if volume[i] == -math.inf:
                    return i
                continue
        elif walls.kind in (UPRIGHT, ROUND) and _protrudes(cell, walls, mx, my, mz):
            if walls.kind == UPRIGHT:
                volume[i] = max(0.0, _in_cylinder(cell, walls.radius, mx, my))
            else:
                volume[i] = _in_sphere(cell, walls, mx, my, mz)
            continue
        volume[i] = volume_and_center(cell, middle)
    return len(volume)


@bare_kernel
def _protrudes(cell, walls, mx, my, mz):  # type: ignore[no-untyped-def]
    """Return whether a corner lies beyond the round wall."""
    for v in range(cell.count[0]):
        x, y, z = cell.corner[v, 0] - mx, cell.corner[v, 1] - my, cell.corner[v, 2] - mz
        if x * x + y * y + (z * z if walls.kind == ROUND else 0.0) > walls.radius * walls.radius:
            return True
    return False


@bare_kernel
def _in_sphere(cell, walls, mx, my, mz):  # type: ignore[no-untyped-def]
    """Return the volume of a cell in a sphere with its center at (mx, my, mz)."""
    work, many = walls.work, 0
    for f in range(cell.count[1]):
        x, y, z = cell.plane[f, 0], cell.plane[f, 1], cell.plane[f, 2]
        height = (cell.plane[f, 3] - x * mx - y * my - z * mz) / walls.radius
        if height <= -1.0:
            return 0.0
        if height < 1.0:
            work[many, 0], work[many, 1], work[many, 2], work[many, 3] = x, y, z, height
            many += 1
    return walls.radius**3 * unit_sphere(work, many)


@bare_kernel
def _in_cylinder(cell, radius, mx, my):  # type: ignore[no-untyped-def]
    """Return the volume of a cell in an upright cylinder with its axis at (mx, my): the sum over the faces of the
    integral of their height over their projection within the circle, positive on upper faces.
    """
    total = 0.0
    for f in range(cell.count[1]):
        nz = cell.plane[f, 2]
        if abs(nz) < UPRIGHT_FACE:
            continue
        area = sx = sy = 0.0
        for k in range(cell.size[f]):
            a, b = cell.loop[f, k], cell.loop[f, k + 1 if k + 1 < cell.size[f] else 0]
            part = _under_edge(
                cell.corner[a, 0] - mx, cell.corner[a, 1] - my, cell.corner[b, 0] - mx, cell.corner[b, 1] - my, radius
            )
            area, sx, sy = area + part[0], sx + part[1], sy + part[2]
        nx, ny = cell.plane[f, 0], cell.plane[f, 1]
        total += ((cell.plane[f, 3] - nx * mx - ny * my) * area - nx * sx - ny * sy) / nz
    return total


@bare_kernel
def _under_edge(ax, ay, bx, by, radius):  # type: ignore[no-untyped-def]
    """Return area and first moments of the circle within the triangle of its center and an edge, signed."""
    dx, dy = bx - ax, by - ay
    square = dx * dx + dy * dy
    middle = -(ax * dx + ay * dy) / square if square > 0.0 else 0.0
    px, py = ax + middle * dx, ay + middle * dy
    half = radius * radius - px * px - py * py
    if half <= 0.0 or square == 0.0:
        return _sector(ax, ay, bx, by, radius)
    half = math.sqrt(half / square)
    start, end = max(0.0, middle - half), min(1.0, middle + half)
    if start >= end:
        return _sector(ax, ay, bx, by, radius)
    px, py = ax + start * dx, ay + start * dy
    qx, qy = ax + end * dx, ay + end * dy
    area = 0.5 * (px * qy - py * qx)
    sx, sy = area * (px + qx) / 3.0, area * (py + qy) / 3.0
    if start > 0.0:
        part = _sector(ax, ay, px, py, radius)
        area, sx, sy = area + part[0], sx + part[1], sy + part[2]
    if end < 1.0:
        part = _sector(qx, qy, bx, by, radius)
        area, sx, sy = area + part[0], sx + part[1], sy + part[2]
    return area, sx, sy


@bare_kernel
def _sector(ax, ay, bx, by, radius):  # type: ignore[no-untyped-def]
    """Return area and first moments of the sector of a circle between two directions, signed."""
    p, q = math.sqrt(ax * ax + ay * ay), math.sqrt(bx * bx + by * by)
    if p == 0.0 or q == 0.0:
        return 0.0, 0.0, 0.0
    turn = math.atan2(ax * by - ay * bx, ax * bx + ay * by)
    third = radius**3 / 3.0
    return 0.5 * radius * radius * turn, third * (by / q - ay / p), third * (ax / p - bx / q)


@bare_kernel
def _in_pieces(cell, spare, walls, place, i, middle):  # type: ignore[no-untyped-def]
    """Return the signed sum of the volumes of a cell in all pieces; minus infinity where there is no room."""
    total, reach = 0.0, 0.0
    for v in range(cell.count[0]):
        x, y, z = cell.corner[v, 0], cell.corner[v, 1], cell.corner[v, 2]
        reach = max(reach, x * x + y * y + z * z)
    reach = math.sqrt(reach)
    for m in range(len(walls.sign)):
        far = False
        for k in range(4):
            far = far or _offset(walls, m, k, place, i) < -reach
        if far:
            continue
        state = FAILED
        for attempt in range(TRIES):
            copy_polyhedron(cell, spare)
            state = CUT
            for k in range(4):
                nx, ny, nz = walls.planes[m, k, 0], walls.planes[m, k, 1], walls.planes[m, k, 2]
                shift = SHIFT * attempt * 10.0**attempt * reach
                state = max(CUT, clip(spare, nx, ny, nz, _offset(walls, m, k, place, i) - shift, -9, 0.0))
                if state > CUT:
                    break
            if state != FAILED:
                break
        if state == CROWDED:
            return -math.inf
        if state == CUT:
            total += walls.sign[m] * volume_and_center(spare, middle)
    return total


@bare_kernel
def _offset(walls, m, k, place, i):  # type: ignore[no-untyped-def]
    """Return the offset of plane k of piece m from seed i."""
    plane = walls.planes[m, k]
    return plane[3] - plane[0] * place[i, 0] - plane[1] * place[i, 1] - plane[2] * place[i, 2]
