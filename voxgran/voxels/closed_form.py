"""Voxels of shapes in closed form: spheres, unions of spheres, round solids, disks and polygons.

A column of voxel centers meets a convex solid in one interval, whose ends are roots of a quadratic; the bits between
are set word by word. Centers on the surface of a round solid count as inside.

Whether a cube meets an ellipsoid, a cylinder or a cone is decided exactly up to round-off. In the frame in which an
ellipsoid is the unit sphere a cube is a parallelepiped, and its nearest point to the middle lies inside it, in a face,
on an edge or at a corner: each is tried. A cylinder is looked at along its axis and a cone from its apex; both are
disks then, and the part of the cube between the ends of the solid is a convex polygon.
"""

import itertools

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.kernels import kernel
from voxgran.lattice.grid import Grid
from voxgran.lattice.packed import PackedMask
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive
from voxgran.voxels.scanline import centers_inside
from voxgran.voxels.touch import touched_voxels

#: which point of a voxel decides: its center, the one nearest to the middle of a sphere, or the one farthest from it
_REACH = {"center": 0.0, "touch": -0.5, "whole": 0.5}


def spheres_bits(centers: Floats, radii: Floats, grid: Grid, *, cover: str) -> PackedMask:
    """Return the voxels of a union of spheres with centers (n, 3) and radii (n,).

    Of a voxel the center must lie in a closed sphere (`cover` "center"), the closed cube meet one ("touch"), or one
    contain the whole cube ("whole").
    """
    bits = PackedMask.empty(grid.shape)
    inner = (np.asarray(centers) - np.array(grid.origin)) / grid.voxel_size - 0.5
    _fill_spheres(inner, np.asarray(radii) / grid.voxel_size, _REACH[cover], bits.words, grid.shape[2])
    return bits


def round_bits(solid: Primitive, grid: Grid, offset: Floats) -> PackedMask:
    """Return the voxels whose center lies in a primitive other than a box, whose centroid has an offset, (3,)."""
    middle = (offset - np.array(grid.origin)) / grid.voxel_size - 0.5
    return centers_in_round(solid, grid.voxel_size, middle, grid.shape)


def centers_in_round(
    solid: Primitive, edges: float | Floats, middle: Floats, counts: tuple[int, int, int]
) -> PackedMask:
    """Return the voxels, with one edge or three (3,), whose center lies in a primitive other than a box; its centroid
    (3,) is in voxels from the center of the first one.
    """
    bits = PackedMask.empty(counts)
    _fill_round(*round_parts(solid, edges), middle, bits.words, counts[2])
    return bits


def round_parts(solid: Primitive, edges: float | Floats) -> tuple[Floats, Floats, Floats]:
    """Return the k parts of a solid of revolution that lie one upon the other: matrix, profiles and ends.

    The (3, 3) matrix leads from voxels, with one edge or three (3,), to the frame of the axis. The profiles, (k, 3),
    are the coefficients c of r^2 = c0 + c1 t + c2 t^2 at the height t, between the ends, (k, 2). Lengths are voxels
    along x, but for ellipsoids, which become unit spheres.
    """
    d, sizes = solid.dimensions, np.full(3, edges)
    voxel_size = sizes[0]
    if solid.kind in ("sphere", "ellipsoid"):
        axes = np.array(d * 3 if solid.kind == "sphere" else d)
        stretch = np.ascontiguousarray(solid.matrix.T * (sizes / axes[:, None]))
        return stretch, np.array([[1.0, 0.0, -1.0]]), np.array([[-1.0, 1.0]])
    radius, half = d[0] / voxel_size, d[1] / 2 / voxel_size
    curves, ends = [[radius**2, 0.0, 0.0]], [[-half, half]]
    if solid.kind == "cone":
        slope, top = radius / (2 * half), 1.5 * half
        curves, ends = [[slope**2 * top**2, -2 * slope**2 * top, slope**2]], [[-half / 2, top]]
    elif solid.kind == "spherocylinder":
        curves += [[radius**2 - half**2, 2 * half, -1.0], [radius**2 - half**2, -2 * half, -1.0]]
        ends += [[half, half + radius], [-half - radius, -half]]
    return np.ascontiguousarray(solid.matrix.T * (sizes / voxel_size)), np.array(curves), np.array(ends)


def touched_round(solid: Primitive, grid: Grid, offset: Floats) -> PackedMask:
    """Return the voxels whose closed cube meets a primitive other than a box.

    Cubes that an outer tessellation touches and an inner one does not are asked one by one.
    """
    if solid.kind == "spherocylinder":
        radius, length = solid.dimensions
        ends = offset + np.outer([-length / 2, length / 2], solid.matrix[:, 2])
        touched = touched_round(Primitive("cylinder", solid.dimensions, solid.rotation), grid, offset)
        touched.words[...] |= spheres_bits(ends, np.full(2, radius), grid, cover="touch").words
        return touched
    inner, faces, _ = solid.tessellation()
    outer, _ = solid.circumscribed()
    sure = touched_voxels(inner + offset, faces, grid)
    maybe = touched_voxels(outer + offset, faces, grid)
    inside = round_bits(solid, grid, offset)
    sure.words[...] |= inside.words
    maybe.words[...] &= ~sure.words
    doubtful = np.argwhere(maybe.unpacked())
    if len(doubtful):
        stretch, (curve,), (ends,) = round_parts(solid, grid.voxel_size)
        middles = doubtful + 0.5 - (offset - np.array(grid.origin)) / grid.voxel_size
        meets = doubtful[meets_cubes(middles, stretch, curve, ends, solid.kind)]
        found = np.zeros(grid.shape, dtype=np.bool_)
        found[tuple(meets.T)] = True
        sure.words[...] |= PackedMask.from_mask(found).words
    return sure


def outline_mask(outline: Outline, grid: Grid, *, cover: str) -> Booleans:
    """Return the pixels of an outline, (nx, ny, 1), whatever the z of the lattice."""
    if outline.kind == "disk":
        flat = Grid((grid.origin[0], grid.origin[1], -grid.voxel_size / 2), grid.voxel_size, (*grid.shape[:2], 1))
        center, radius = np.array([[*outline.center, 0.0]]), np.array([outline.radius])
        if cover == "surface":
            # without the z of the cube, the corner farthest from the middle lies outside
            return spheres_bits(center, radius, flat, cover="touch").unpacked() & ~_whole_pixels(outline, flat)
        return spheres_bits(center, radius, flat, cover=cover).unpacked()
    if cover == "surface":
        return _touched_pixels(outline, grid)
    # upright faces around a plane of pixels, seen by columns along y: the rules of meshes for centers on the sides
    vertices, faces = upright_faces(outline.vertices, -1.0, 2.0)
    vertices[:, :2] = (vertices[:, :2] - np.array(grid.origin[:2])) / grid.voxel_size
    columns = centers_inside(np.ascontiguousarray(vertices[:, [2, 0, 1]]), faces, (1, *grid.shape[:2]))[0]
    inside = columns.unpacked().reshape(*grid.shape[:2], 1)
    return inside | _touched_pixels(outline, grid) if cover == "touch" else inside


def upright_faces(rim: Floats, low: float, high: float) -> tuple[Floats, Integers]:
    """Return the vertices of a polygon's rim (n, 2) at two heights and the upright triangles between them."""
    n = len(rim)
    k = np.arange(n)
    after = (k + 1) % n
    vertices = np.concatenate([np.column_stack([rim, np.full(n, z)]) for z in (low, high)])
    return vertices, np.concatenate([np.column_stack([k, after, n + k]), np.column_stack([after, n + after, n + k])])


def _whole_pixels(outline: Outline, grid: Grid) -> Booleans:
    """Return the pixels that a disk holds without touching their corners from inside."""
    half = grid.voxel_size / 2
    x, y = (np.abs(grid.centers(axis) - outline.center[axis]) + half for axis in range(2))
    return np.asarray((x[:, None] ** 2 + y[None, :] ** 2 < outline.radius**2)[:, :, None])


def _touched_pixels(outline: Outline, grid: Grid) -> Booleans:
    """Return the pixels that the sides of a polygon touch: upright faces through one layer of voxels."""
    low, high = (grid.origin[2] + part * grid.voxel_size for part in (0.25, 0.75))
    return touched_voxels(*upright_faces(outline.vertices, low, high), grid).unpacked()


@kernel
def _fill_run(words, i, j, first, last):  # type: ignore[no-untyped-def]
    """Set the bits of a column from one level to another."""
    full = np.uint64(0xFFFFFFFFFFFFFFFF)
    for q in range(first >> 6, (last >> 6) + 1):
        bits = full
        if q == first >> 6:
            bits &= full << np.uint64(first & 63)
        if q == last >> 6:
            bits &= full >> np.uint64(63 - (last & 63))
        words[i, j, q] |= bits


@kernel
def _range(low, high, count):  # type: ignore[no-untyped-def]
    """Return the first and last whole number of 0 ... count - 1 in a closed interval."""
    return int(min(max(np.ceil(low), 0.0), count)), int(max(min(np.floor(high), count - 1.0), -1.0))


@kernel
def _fill_spheres(centers, radii, reach, words, nz):  # type: ignore[no-untyped-def]
    """Set the voxels of spheres; voxel centers at whole numbers."""
    nx, ny = words.shape[0], words.shape[1]
    for b in range(len(centers)):
        x, y, z = centers[b, 0], centers[b, 1], centers[b, 2]
        # a little more than the radius, as a sum of squares may round below it
        radius = radii[b] * (1.0 + 1e-12)
        first_i, last_i = _range(x - radius + reach, x + radius - reach, nx)
        first_j, last_j = _range(y - radius + reach, y + radius - reach, ny)
        for i in range(first_i, last_i + 1):
            dx = max(abs(i - x) + reach, 0.0)
            for j in range(first_j, last_j + 1):
                dy = max(abs(j - y) + reach, 0.0)
                rest = radius * radius - dx * dx - dy * dy
                if rest < 0.0:
                    continue
                half = np.sqrt(rest) - reach
                first, last = _range(z - half, z + half, nz)
                if half >= 0.0 and first <= last:
                    _fill_run(words, i, j, first, last)


@kernel
def chord_in_round(stretch: Floats, curves: Floats, ends: Floats, u: float, v: float) -> tuple[float, float]:
    """Return where the line at (u, v) enters and leaves a solid of revolution; the first is larger where it does not.

    The solid is convex; its parts are those of :func:`round_parts`.
    """
    low, high = np.inf, -np.inf
    for k in range(len(curves)):
        begin, end = _chord_in_part(stretch, curves[k], ends[k], u, v)
        if begin <= end:
            low, high = min(low, begin), max(high, end)
    return low, high


@kernel
def _chord_in_part(stretch, curve, ends, u, v):  # type: ignore[no-untyped-def]
    """Return where the line at (u, v) enters and leaves a part of a solid of revolution.

    Along the line the point is p + z d in the frame of the axis; inside, the squared distance from the axis is at most
    c0 + c1 t + c2 t^2, where t is the height.
    """
    dx, dy, dt = stretch[0, 2], stretch[1, 2], stretch[2, 2]
    square = dx * dx + dy * dy - curve[2] * dt * dt
    px = stretch[0, 0] * u + stretch[0, 1] * v
    py = stretch[1, 0] * u + stretch[1, 1] * v
    pt = stretch[2, 0] * u + stretch[2, 1] * v
    half = px * dx + py * dy - dt * (curve[2] * pt + 0.5 * curve[1])
    rest = px * px + py * py - (curve[0] + pt * (curve[1] + curve[2] * pt))
    low, high = _below_zero(square, half, rest, pt, dt, curve)
    if dt != 0.0:
        a, b = (ends[0] - pt) / dt, (ends[1] - pt) / dt
        return max(low, min(a, b)), min(high, max(a, b))
    if pt < ends[0] or pt > ends[1]:
        return np.inf, -np.inf
    return low, high


@kernel
def _fill_round(stretch, curves, ends, middle, words, nz):  # type: ignore[no-untyped-def]
    """Set the voxels of a solid of revolution; voxel centers at whole numbers."""
    for i in range(words.shape[0]):
        for j in range(words.shape[1]):
            low, high = chord_in_round(stretch, curves, ends, i - middle[0], j - middle[1])
            first, last = _range(low + middle[2], high + middle[2], nz)
            if first <= last:
                _fill_run(words, i, j, first, last)


@kernel
def _below_zero(square, half, rest, height, rise, curve):  # type: ignore[no-untyped-def]
    """Return the interval of z where square z^2 + 2 half z + rest <= 0, of a cone on the side of its base."""
    inf = np.inf
    scale = abs(square) + abs(half) + 1e-300
    if abs(square) <= 1e-15 * scale or square == 0.0:
        if half == 0.0:
            return (-inf, inf) if rest <= 0.0 else (inf, -inf)
        return (-inf, -rest / (2.0 * half)) if half > 0.0 else (-rest / (2.0 * half), inf)
    inside = half * half - square * rest
    if square > 0.0:
        if inside < 0.0:
            return inf, -inf
        # the root without cancellation first
        large = -(half + np.sqrt(inside)) if half >= 0.0 else -half + np.sqrt(inside)
        a = large / square
        b = rest / large if large != 0.0 else a
        return min(a, b), max(a, b)
    # a column steeper than the cone: it is inside from the base up to the first root
    root = np.sqrt(max(inside, 0.0))
    a, b = (-half + root) / square, (-half - root) / square
    return (-inf, min(a, b)) if rise > 0.0 else (max(a, b), inf)


#: widening of closed comparisons, relative to the size of the solid in voxels
CLOSED = 1e-9
#: corners of the unit cube about the origin, and its edges as pairs of them
_CORNERS = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
_EDGES = np.array([(a, b) for a, b in itertools.combinations(range(8), 2) if bin(a ^ b).count("1") == 1])


def meets_cubes(middles: Floats, stretch: Floats, curve: Floats, ends: Floats, kind: str) -> Booleans:
    """Return whether unit cubes with centers (n, 3), from the centroid in voxels, meet a solid of revolution, (n,).

    Arguments are as for :func:`voxgran.voxels.round_shares.round_shares`.
    """
    if kind in ("sphere", "ellipsoid"):
        return _nearest_square(linear.matmul(middles, stretch.T), stretch) <= (1.0 + CLOSED) ** 2
    corners = linear.matmul(middles[:, None] + _CORNERS, stretch.T)
    top = ends[1] if kind == "cylinder" else ends[1] - 1e-9 * (ends[1] - ends[0])
    points = _between(corners, ends[0] - CLOSED, top + (CLOSED if kind == "cylinder" else 0.0))
    flat, radius = points[:, :, :2], np.sqrt(curve[0])
    if kind == "cone":
        flat, radius = flat / (ends[1] - points[:, :, 2:]), np.sqrt(curve[2])
    return _hull_distance(flat) <= radius * (1.0 + CLOSED)


def _nearest_square(middle: Floats, edges: Floats) -> Floats:
    """Return the least squared distance from the origin of parallelepipeds with edges in the columns of a matrix."""
    best = np.full(len(middle), np.inf)
    for fixed in itertools.product((None, -0.5, 0.5), repeat=3):
        free = [axis for axis in range(3) if fixed[axis] is None]
        start = middle + linear.matmul(edges, np.array([0.0 if value is None else value for value in fixed]))
        place = -linear.matmul(start, linear.pseudoinverse(edges[:, free]).T) if free else np.zeros((len(middle), 0))
        valid = (np.abs(place) <= 0.5 + 1e-12).all(axis=1)
        square = ((start + linear.matmul(place, edges[:, free].T)) ** 2).sum(axis=1)
        best = np.where(valid, np.minimum(best, square), best)
    return best


def _between(corners: Floats, low: float, high: float) -> Floats:
    """Return the corners (n, 32, 3) of cubes cut by two levels of t; NaN if there is none."""
    a, b = corners[:, _EDGES[:, 0]], corners[:, _EDGES[:, 1]]
    found = [np.where(((corners[:, :, 2] >= low) & (corners[:, :, 2] <= high))[:, :, None], corners, np.nan)]
    for level in (low, high):
        rise = b[:, :, 2] - a[:, :, 2]
        share = (level - a[:, :, 2]) / np.where(rise == 0, np.inf, rise)
        crosses = (np.minimum(a[:, :, 2], b[:, :, 2]) < level) & (np.maximum(a[:, :, 2], b[:, :, 2]) > level)
        found.append(np.where(crosses[:, :, None], a + share[:, :, None] * (b - a), np.nan))
    return np.concatenate(found, axis=1)


def _hull_distance(points: Floats) -> Floats:
    """Return the distance of the origin from the convex hulls of (n, m, 2) points; NaN points do not count."""
    first, second = np.triu_indices(points.shape[1], k=0)
    a, b = points[:, first], points[:, second]
    along = b - a
    length = (along**2).sum(axis=2)
    share = np.clip(-(a * along).sum(axis=2) / np.where(length > 0, length, 1.0), 0.0, 1.0)
    nearest = np.sqrt(((a + share[:, :, None] * along) ** 2).sum(axis=2))
    # the origin lies inside where no angle between neighbours is half a turn or more
    angle = np.sort(libm.arctan2(points[:, :, 1], points[:, :, 0]), axis=1)
    gap = np.diff(np.concatenate([angle, angle[:, :1] + 2 * np.pi], axis=1), axis=1)
    count = np.isfinite(angle).sum(axis=1)
    wrap = angle[:, 0] + 2 * np.pi - np.take_along_axis(angle, np.maximum(count - 1, 0)[:, None], axis=1)[:, 0]
    widest = np.maximum(np.nanmax(np.where(np.isfinite(gap), gap, 0.0), axis=1), wrap)
    distance = np.min(np.where(np.isfinite(nearest), nearest, np.inf), axis=1)
    return np.where((count > 0) & (widest < np.pi), 0.0, distance)
