"""Where straight lines along an axis pass through grains, and where they leave the container, in closed form.

Spheres, clumps of spheres, ellipsoids, cylinders, cones and disks are met in the roots of a quadratic, closed meshes
and polygons in crossings with their triangles and sides. Containers that are known by their signed distance only are
met by bisection between points at the spacing of the lines.
"""

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import kernel
from voxgran.containers.model import Container, boundary_of
from voxgran.measures.painting import with_images
from voxgran.packing.model import Packing
from voxgran.shapes.describing.body import as_spheres
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive
from voxgran.voxels.closed_form import chord_in_round, round_parts, upright_faces
from voxgran.voxels.scanline import FINEST, _first_last, _ordered, _segment, _sides

#: halvings of an interval that holds a wall known by its signed distance
HALVINGS = 40
#: points of lines whose signed distances are in memory at a time
POINTS = 2**20
#: rows of lines in a spacing, and spacings between the lines of a row
ROWS = 6
#: shift of the lines from row to row, in lines of a row: the golden section, which spreads them best
GOLDEN = (5**0.5 - 1) / 2
#: place of the first row in its part of the box, and of the first line in its part of the row, so that no plane of
#: symmetry of an ordered packing makes parts of the lines equal
FIRST_ROW, FIRST_LINE = 0.618, 0.276

#: intervals: the line (n,) of each, its start (n,) and its end (n,) along the line
Intervals: TypeAlias = tuple[Integers, Floats, Floats]


@dataclass(frozen=True, eq=False)
class Lines:
    """Rows of lines along an axis through a box; the line j of row i has the index i * counts[1] + j.

    Rows are closer than the lines in them, and each is shifted against the one before, so that faces of grains along
    the axes lie at many places between lines, also where all grains are aligned (Kronecker lattice).
    """

    axes: tuple[int, int, int]  # that across the rows, that along them, and that along the lines
    first: Floats  # (2,) coordinates of the first row, and of the start of all rows
    step: Floats  # (2,) distance of rows, and of the lines in a row
    counts: tuple[int, int]  # rows, and lines in a row
    turn: float  # shift from row to row, in distances of lines
    low: float  # where the lines start
    high: float  # where they end

    @property
    def lattice(self) -> tuple[Floats, tuple[int, int], float]:
        """Distances, numbers and shift of the lines, as kernels take them."""
        return self.step, self.counts, self.turn

    @classmethod
    def through(cls, axis: int, lower: Floats, upper: Floats, spacing: float, *, dimension: int) -> "Lines":
        """Return lines through a box of which each stands for an area of about the square of a spacing, or in 2D, at
        z = 0, for a spacing.
        """
        axes = ((axis + 1) % 3, (axis + 2) % 3, axis) if dimension == 3 else (1 - axis, 2, axis)
        low, lengths = lower[list(axes)], (upper - lower)[list(axes)]
        many = max(1, round(float(lengths[1] / (ROWS * spacing)))) if dimension == 3 else 1
        aside = float(lengths[1] / spacing) / many if dimension == 3 else 1.0
        rows = _prime(round(float(lengths[0] / spacing) * aside))
        step = np.array([lengths[0] / rows, lengths[1] / many if dimension == 3 else 1.0])
        first = np.array([low[0] + FIRST_ROW * step[0], low[1] if dimension == 3 else -FIRST_LINE])
        turn = GOLDEN if dimension == 3 else 0.0
        return cls(axes, first, step, (rows, many), turn, float(lower[axis]), float(upper[axis]))

    @property
    def count(self) -> int:
        """Number of lines."""
        return self.counts[0] * self.counts[1]

    @property
    def across(self) -> tuple[Floats, Floats]:
        """Coordinates of each line across the rows and along them, (count,) each."""
        row, place = np.divmod(np.arange(self.count), self.counts[1])
        shift = _shift_of(row, self.turn)
        return self.first[0] + row * self.step[0], self.first[1] + (place + shift) * self.step[1]


def _prime(least: int) -> int:
    """Return the smallest prime from a number on; 1 for numbers below 2."""
    number = max(least, 1)
    while any(number % k == 0 for k in range(2, math.isqrt(number) + 1)):
        number += 1
    return number


def grain_intervals(packing: Packing, lines: Lines) -> Intervals:
    """Return where lines are in grains and their periodic images; starts and ends are measured from the lower end.

    Raises
    ------
    InputError
        If a grain is an open surface.
    """
    found = [_nothing()]
    if packing.count:
        packing, shifts = with_images(packing)
        for index in np.unique(packing.shape_id):
            packing.shapes[index].refuse_open("voids")
            found += _of_shape(packing, int(index), shifts, lines)
    return _joined(found)


def outside_intervals(container: Container, lines: Lines) -> Intervals:
    """Return where lines are outside of a container whose walls are not its bounds; none if they are.

    The intervals extend to infinity at both ends of each line.
    """
    boundary = boundary_of(container)
    if boundary.is_flat:
        return _nothing()
    if boundary.solid is not None and isinstance(boundary.solid.geometry, Mesh):
        mesh = boundary.solid.geometry
        at, place = _Crossings(lines).of(mesh.vertices + np.array(boundary.solid.offset), mesh.faces)
    elif boundary.round:
        points = np.full((lines.count, 3), lines.low)
        points[:, lines.axes[0]], points[:, lines.axes[1]] = lines.across
        ends = np.array(boundary.along(points, lines.axes))
        at = np.flatnonzero(~np.isnan(ends[0]))
        at, place = np.concatenate([at, at]), ends[:, at].ravel()
    else:
        at, place = _by_distance(container, lines)
    every = np.arange(lines.count)
    ends = np.full(lines.count, np.inf)
    return _paired(np.concatenate([every, at, every]), np.concatenate([-ends, place, ends]))


def _nothing() -> Intervals:
    """Return no intervals."""
    return np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0)


def _joined(parts: list[Intervals]) -> Intervals:
    """Return intervals in one."""
    line, low, high = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    return line, low, high


def _paired(line: Integers, place: Floats) -> Intervals:
    """Return the intervals between every other crossing of each line."""
    order = np.lexsort((place, line))
    ends = place[order].reshape(-1, 2)
    return line[order][::2], ends[:, 0], ends[:, 1]


def _of_shape(packing: Packing, index: int, shifts: Floats, lines: Lines) -> list[Intervals]:
    """Return the intervals in all grains of a shape."""
    geometry, axes = packing.shapes[index].geometry, list(lines.axes)
    spheres = spheres_of(packing, index)
    if spheres is not None:
        centers = (spheres[0][None] + shifts[:, None]).reshape(-1, 3)[:, axes]
        return [_in_spheres(centers, np.tile(spheres[1], len(shifts)), lines)]
    grains = np.flatnonzero(packing.shape_id == index)
    scale, matrices = packing.scale[grains], packing.matrices[grains]
    places = packing.position[grains]
    crossings, found = _Crossings(lines), []
    for place, factor, matrix, reach in zip(places, scale, matrices, packing.bounding_radii[grains], strict=True):
        body = geometry.scaled(factor).rotated(matrix)
        for middle in place + shifts:
            if not crossings.reaches(middle[axes], float(reach)):
                continue
            if isinstance(body, Primitive) and body.kind != "box":
                found.append(_in_round(body, middle[axes], float(reach), lines))
            else:
                vertices, faces = _triangles_of(body)
                found.append(_paired(*crossings.of(vertices + middle, faces)))
    return found


def spheres_of(packing: Packing, index: int) -> tuple[Floats, Floats] | None:
    """Return centers (n, 3) and radii (n,) of the spheres or disks of all grains of a shape; None for other shapes."""
    spheres = as_spheres(packing.shapes[index].geometry)
    if spheres is None:
        return None
    grains = np.flatnonzero(packing.shape_id == index)
    scale = packing.scale[grains]
    centers = linear.einsum("gij,sj->gsi", packing.matrices[grains], spheres[0]) * scale[:, None, None]
    return (centers + packing.position[grains][:, None]).reshape(-1, 3), (scale[:, None] * spheres[1]).ravel()


def _triangles_of(body: object) -> tuple[Floats, Integers]:
    """Return vertices and triangles of a mesh, of a box, or of the upright sides of a polygon."""
    if isinstance(body, Outline):
        return upright_faces(body.vertices, -1.0, 1.0)
    if isinstance(body, Mesh):
        return body.vertices, body.faces
    assert isinstance(body, Primitive)
    return body.tessellation()[:2]


def _in_spheres(centers: Floats, radii: Floats, lines: Lines) -> Intervals:
    """Return the intervals in spheres with centers (n, 3) in the order of the axes of the lines."""
    centers = np.ascontiguousarray(centers - [*lines.first, lines.low])
    no_line, no_place = np.zeros(0, dtype=np.int64), np.zeros(0)
    count = _cross_spheres(centers, radii, lines.lattice, no_line, no_place, no_place)
    line, low, high = np.empty(count, dtype=np.int64), np.empty(count), np.empty(count)
    _cross_spheres(centers, radii, lines.lattice, line, low, high)
    return line, low, high


def _in_round(solid: Primitive, middle: Floats, reach: float, lines: Lines) -> Intervals:
    """Return the intervals in a primitive other than a box."""
    stretch, curves, ends = round_parts(solid, 1.0)
    start = middle - [*lines.first, lines.low]
    # a line is shifted by less than the distance of lines
    first = np.maximum(np.ceil((start[:2] - reach) / lines.step) - [0, 1], 0).astype(int)
    last = np.minimum(np.floor((start[:2] + reach) / lines.step), np.array(lines.counts) - 1).astype(int)
    many = int(np.prod(np.maximum(last - first + 1, 0)))
    line, low, high = np.empty(many, dtype=np.int64), np.empty(many), np.empty(many)
    frame = np.ascontiguousarray(stretch[:, list(lines.axes)])
    window = np.concatenate([first, last])
    count = _cross_round(frame, start, curves, ends, lines.lattice, window, line, low, high)
    return line[:count], low[:count], high[:count]


class _Crossings:
    """Crossings of lines and triangles, with room that is used again."""

    def __init__(self, lines: Lines) -> None:
        self._lines = lines
        self._line, self._place = np.empty(1024, dtype=np.int64), np.empty(1024)
        self._lower = np.array([*lines.first, lines.low])
        self._upper = np.array([*(lines.first + lines.step * np.array(lines.counts)), lines.high])

    def reaches(self, middle: Floats, reach: float) -> bool:
        """Return whether a sphere may meet the lines."""
        return bool(((middle + reach >= self._lower) & (middle - reach <= self._upper)).all())

    def of(self, vertices: Floats, faces: Integers) -> tuple[Integers, Floats]:
        """Return line and place, from the lower end, of each crossing; of a closed surface, an even number a line."""
        lines = self._lines
        inner = (vertices[:, list(lines.axes)] - self._lower) / [*lines.step, 1.0]
        # lines pass corners and edges at an infinitesimal distance on the same side, despite round-off
        inner[:, :2] = np.rint(inner[:, :2] * FINEST) / FINEST
        count = _cross_triangles(inner, faces, lines.lattice, self._line, self._place)
        if count > len(self._line):
            self._line, self._place = np.empty(2 * count, dtype=np.int64), np.empty(2 * count)
            _cross_triangles(inner, faces, lines.lattice, self._line, self._place)
        return self._line[:count].copy(), self._place[:count].copy()


def _by_distance(container: Container, lines: Lines) -> tuple[Integers, Floats]:
    """Return the crossings with walls known by their signed distance, an even number on each line."""
    steps = max(2, round((lines.high - lines.low) / math.sqrt(float(lines.step[0]) * float(lines.step[1]))))
    along = np.linspace(lines.low, lines.high, steps + 1)
    points = np.zeros((lines.count, 3))
    points[:, lines.axes[0]], points[:, lines.axes[1]] = lines.across

    def inside(line: Integers, place: Floats) -> Floats:
        here = points[line]
        here[:, lines.axes[2]] = place
        return np.asarray(container.signed_distance(here) < 0)

    found_line, found_place = [], []
    block = max(1, POINTS // len(along))
    for begin in range(0, lines.count, block):
        line = np.arange(begin, min(begin + block, lines.count))
        state = inside(np.repeat(line, len(along)), np.tile(along, len(line))).reshape(len(line), -1)
        # the ends of the lines lie at the bounds: a point there is in the container if the one beside it is
        at, left = np.nonzero(state[:, 1:] != state[:, :-1])
        low, high, first = along[left], along[left + 1], state[at, left]
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            same = inside(line[at], middle) == first
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        starts, ends = line[state[:, 0]], line[state[:, -1]]
        found_line += [line[at], starts, ends]
        found_place += [low - lines.low, np.full(len(starts), -np.inf), np.full(len(ends), np.inf)]
    return np.concatenate(found_line), np.concatenate(found_place)


def _shift_of(row: Integers, turn: float) -> Floats:
    """Return the shift of the lines of rows, in distances of lines."""
    return np.asarray((FIRST_LINE + row * turn) % 1.0)


_shift = kernel(_shift_of)


@kernel
def _cross_spheres(centers, radii, lattice, line, low, high):  # type: ignore[no-untyped-def]
    """Write the intervals of lines in spheres as long as there is room; return their number."""
    step, counts, turn = lattice
    count, room = 0, len(line)
    for s in range(len(radii)):
        x, y, z, r = centers[s, 0], centers[s, 1], centers[s, 2], radii[s]
        for i in range(
            max(0, int(np.ceil((x - r) / step[0]))), min(counts[0] - 1, int(np.floor((x + r) / step[0]))) + 1
        ):
            dx = i * step[0] - x
            rest = r * r - dx * dx
            if rest <= 0.0:
                continue
            half, shift = np.sqrt(rest), _shift(i, turn)
            first = max(0, int(np.ceil((y - half) / step[1] - shift)))
            last = min(counts[1] - 1, int(np.floor((y + half) / step[1] - shift)))
            for j in range(first, last + 1):
                dy = (j + shift) * step[1] - y
                square = rest - dy * dy
                if square <= 0.0:
                    continue
                if count < room:
                    root = np.sqrt(square)
                    line[count], low[count], high[count] = i * counts[1] + j, z - root, z + root
                count += 1
    return count


@kernel
def _cross_round(stretch, middle, curves, ends, lattice, window, line, low, high):  # type: ignore[no-untyped-def]
    """Write the intervals of lines in a solid of revolution; return their number."""
    (step, counts, turn), count = lattice, 0
    for i in range(window[0], window[2] + 1):
        shift = _shift(i, turn)
        for j in range(window[1], window[3] + 1):
            x, y = i * step[0] - middle[0], (j + shift) * step[1] - middle[1]
            begin, end = chord_in_round(stretch, curves, ends, x, y)
            if begin < end:
                line[count], low[count], high[count] = i * counts[1] + j, begin + middle[2], end + middle[2]
                count += 1
    return count


@kernel
def _cross_triangles(vertices, faces, lattice, line, place):  # type: ignore[no-untyped-def]
    """Write the crossings of lines with triangles as long as there is room; return their number.

    Lines are at whole numbers, along the rows with their shift. The ranges are half-open, so that a closed surface
    gives each line an even number.
    """
    (_, counts, turn), count, room = lattice, 0, len(line)
    for f in range(len(faces)):
        a, b, c, _ = _ordered(vertices, faces[f, 0], faces[f, 1], faces[f, 2])
        begin, end = _first_last(vertices[a, 0], vertices[c, 0], counts[0])
        ya, yb, yc = vertices[a, 1], vertices[b, 1], vertices[c, 1]
        lowest, highest = _first_last(min(ya, yb, yc) - 1.0, max(ya, yb, yc), counts[1])
        if begin > end or lowest > highest:
            continue
        long, first, second = _sides(vertices, a, b, c)
        for i in range(begin, end + 1):
            y_1, z_1, y_2, z_2, _ = _segment(long, first, second, float(i))
            shift = _shift(i, turn)
            lowest, highest = _first_last(y_1 - shift, y_2 - shift, counts[1])
            for j in range(lowest, highest + 1):
                if count < room:
                    height = z_1 + (j + shift - y_1) * (z_2 - z_1) / (y_2 - y_1)
                    place[count] = max(min(height, max(z_1, z_2)), min(z_1, z_2))
                    line[count] = i * counts[1] + j
                count += 1
    return count
