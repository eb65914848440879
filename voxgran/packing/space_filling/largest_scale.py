"""The largest scale at which a true shape, in a given pose, touches no other grain and no wall.

The grain grows about its centroid, from a point, until it touches another grain or a wall. At all smaller scales it is
free too.

Two convex parts that are apart are separated by a plane across n. As the part of the new grain, of the support function
h, grows, it reaches that plane at the scale (distance of the plane from the centroid) / h(-n), and the largest of these
ratios over all n is the scale of contact. From a scale at which the bounding spheres are apart, the n of the shortest
distance at one scale gives the next scale (Dinkelbach 1967, doi:10.1287/mnsc.13.7.492): the scales rise, and at each of
them a plane separates the two parts. Shapes of many parts, such as clumps and meshes that are not convex, are compared
by trees of bounding spheres, whose scales of contact are roots of quadratic equations.

The scale at a flat or a round wall, and that at which a convex grain touches its own periodic image, are bisected.
Other grains do not grow larger than their bounding spheres beside their images.
"""

import math
from typing import NamedTuple

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel
from voxgran.contacts.manifolds.convex_distance import core_support, distance_along, tables_of
from voxgran.contacts.overlap.true_pairs import (
    CLOSE,
    MOST_WAITING,
    holds,
    in_frame,
    meets_itself,
    place_part,
    placed,
    shapes_meet,
)
from voxgran.contacts.overlap.true_shapes import TrueShapes
from voxgran.contacts.overlap.true_walls import is_within_walls
from voxgran.containers.kernel_container import MESH, KernelContainer, clearance, mesh_distance
from voxgran.geometry.rotation import write_matrix
from voxgran.packing.space_filling.reach_cells import ReachCells, cell_of, gap_at, near, ring_range

#: most steps to the contact of two convex shapes, and the relative rise of the scale at which they end
STEPS, RISE = 60, 1e-13
#: share of a scale that is left out for rounding, and relative difference of bounds at which a bisection ends
SMALLER, FINE = 1e-12, 1e-12
HALVINGS = 120
#: share of a scale by which a grain stays open from walls that are bisected, and below which the distance of parts that
#: nearly touch is not trusted
OPEN = 1e-9
#: way, in scales, over which the direction from a wall is found
DIFFERENCE = 1e-6


class Surroundings(NamedTuple):
    """The container and the grains that are placed in it, with coordinates from its lower corner.

    spheres: (n, 4) bounding spheres, which the cells list.  cores: (n, 4) spheres about the centroids inside the
    grains, of radius 0 where there is none.  core: (s,) radii of these of the shapes at scale 1.
    longest: (s,) largest scales: at which the shapes have the volume of the container or, where they are not convex,
    may meet their images.  seen: (n,) search in which a grain was found last; searches: (1,) their number.
    away: (3,) direction away from what the last grain touches, 0 where that is its own image.
    """

    walls: KernelContainer
    cells: ReachCells
    shapes: TrueShapes
    spheres: Floats
    cores: Floats
    core: Floats
    longest: Floats
    seen: Integers
    searches: Integers
    away: Floats


@bare_kernel
def largest_scale(around: Surroundings, s: int, x: float, y: float, z: float, least: float, most: float) -> float:
    """Return the largest scale, up to `most`, at which shape s, rotated by `work.turn`, fits at a point.

    It is 0 if the scale is below `least` or the point is taken. The direction away from the contact is written.
    """
    away, core = around.away, around.core[s]
    away[0] = away[1] = away[2] = 0.0
    f = min(most, around.longest[s])
    room = clearance(around.walls, x, y, z)
    if room <= 0.0:
        return 0.0
    gap = gap_at(around.cells, around.cores, x, y, z, room)[0]
    if gap <= 0.0:
        return 0.0
    if core > 0.0:
        f = min(f, gap / core)
    f = _beside_others(around, s, x, y, z, f, least, False)
    if f < least or f <= 0.0:
        return 0.0
    if around.walls.kind == MESH:
        f = _within_mesh(around, s, x, y, z, f, least)
    elif not _is_alone(around, s, x, y, z, f):
        f = _within(around, s, x, y, z, f)
    return f if f >= least else 0.0


@bare_kernel
def fits(
    around: Surroundings, s: int, x: float, y: float, z: float, f: float
) -> bool:  # fmt: skip
    """Return whether shape s at scale f, rotated by `work.turn`, meets no grain, no wall and no image of itself."""
    if clearance(around.walls, x, y, z) <= f * around.core[s] * (1.0 - 4.0 * SMALLER):
        return False
    if _beside_others(around, s, x, y, z, f, 0.0, True) == 0.0:
        return False
    return _is_alone(around, s, x, y, z, f)


@bare_kernel
def _is_alone(around, s, x, y, z, f):  # type: ignore[no-untyped-def]
    """Return whether a grain meets no wall and no image of itself."""
    if not is_within_walls(around.walls, around.shapes, s, f, x, y, z):
        return False
    return not meets_itself(around.walls.periods, around.shapes, s, f, f * around.shapes.bounding[s])


@bare_kernel
def _within(around, s, x, y, z, most):  # type: ignore[no-untyped-def]
    """Return the scale, below one that is too large, at which a grain touches a wall or its own image."""
    low, high = 0.0, most
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if _is_alone(around, s, x, y, z, middle):
            low = middle
        else:
            high = middle
        if high - low <= FINE * low:
            break
    away, step, walls = around.away, DIFFERENCE * low, around.walls
    away[0] = clearance(walls, x + step, y, z) - clearance(walls, x - step, y, z)
    away[1] = clearance(walls, x, y + step, z) - clearance(walls, x, y - step, z)
    away[2] = 0.0
    if walls.dimension == 3:
        away[2] = clearance(walls, x, y, z + step) - clearance(walls, x, y, z - step)
    return low * (1.0 - OPEN)


@bare_kernel
def _within_mesh(around, s, x, y, z, most, least):  # type: ignore[no-untyped-def]
    """Return the scale, up to `most`, at which a grain touches a wall of a closed mesh, the last shape.

    A scale below `least` may be too large, here and below.
    """
    shapes, away, shift = around.shapes, around.away, around.walls.mesh.shift
    if -mesh_distance(around.walls.mesh, x, y, z) >= most * shapes.bounding[s]:
        return most
    for i in range(3):
        for j in range(3):
            shapes.work.relative[i, j] = shapes.work.turn[i, j]
    px, py, pz = x + shift[0], y + shift[1], z + shift[2]
    found, nx, ny, nz = _surfaces_touch(shapes, len(shapes.first) - 2, s, px, py, pz, least, most)
    if found >= most:
        return most
    away[0], away[1], away[2] = nx, ny, nz
    return found * (1.0 - SMALLER)


@bare_kernel
def _beside_others(around, s, x, y, z, f, least, only):  # type: ignore[no-untyped-def]
    """Return the scale, up to f, at which a grain meets no other; 0 if it is below `least` or, with `only`, below f."""
    cells, seen, bound = around.cells, around.seen, around.shapes.bounding[s]
    around.searches[0] += 1
    search, ring = around.searches[0], 0
    # a ring leads as far from any point of its middle cell as it is wide
    step = cells.width[0] if cells.count[2] == 1 else min(cells.width[0], cells.width[2])
    step = min(step, cells.width[1])
    at_x, at_y, at_z = near(cells, 0, x, 0.0)[0], near(cells, 1, y, 0.0)[0], near(cells, 2, z, 0.0)[0]
    while f * bound > (ring - 1) * step:
        inside = False
        low_x, high_x = ring_range(cells, 0, at_x, ring)
        low_y, high_y = ring_range(cells, 1, at_y, ring)
        low_z, high_z = ring_range(cells, 2, at_z, ring)
        for i in range(low_x, high_x + 1):
            for j in range(low_y, high_y + 1):
                for k in range(low_z, high_z + 1):
                    if max(abs(i - at_x), abs(j - at_y), abs(k - at_z)) < ring:
                        continue
                    inside = True
                    entry = cells.head[cell_of(cells, i, j, k)]
                    while entry >= 0:
                        g = cells.item[entry]
                        if seen[g] != search:
                            seen[g] = search
                            f = _beside(around, s, g, x, y, z, f, least, only)
                            if f <= 0.0 or f < least:
                                return 0.0
                        entry = cells.after[entry]
        if not inside:
            break
        ring += 1
    return f


@bare_kernel
def _beside(around, s, g, x, y, z, f, least, only):  # type: ignore[no-untyped-def]
    """Return the scale, up to f, at which a grain meets no image of grain g; 0 with `only` if it is below f."""
    spheres, shapes = around.spheres, around.shapes
    bound, core = shapes.bounding[s], around.core[s]
    reach = f * bound + spheres[g, 3]
    dx, dy, dz = spheres[g, 0] - x, spheres[g, 1] - y, spheres[g, 2] - z
    low_x, high_x = _images(around.cells, 0, dx, reach)
    low_y, high_y = _images(around.cells, 1, dy, reach)
    low_z, high_z = _images(around.cells, 2, dz, reach)
    span = around.cells.span
    for kx in range(low_x, high_x + 1):
        for ky in range(low_y, high_y + 1):
            for kz in range(low_z, high_z + 1):
                ex, ey, ez = dx + kx * span[0], dy + ky * span[1], dz + kz * span[2]
                square, reach = ex * ex + ey * ey + ez * ez, f * bound + spheres[g, 3]
                if square >= reach * reach:
                    continue
                inner = f * core + around.cores[g, 3]
                if square < inner * inner * (1.0 - 4.0 * SMALLER):
                    if only or core == 0.0:
                        return 0.0
                    f = (math.sqrt(square) - around.cores[g, 3]) / core
                    if f <= 0.0:
                        return 0.0
                f = _beside_image(around, s, g, ex, ey, ez, f, least, only)
                if f <= 0.0:
                    return 0.0
    return f


@bare_kernel
def _images(cells, axis, step, reach):  # type: ignore[no-untyped-def]
    """Return the first and the last image that is within reach along an axis."""
    span = cells.span[axis]
    if span == 0.0:
        return 0, 0
    return math.ceil((-reach - step) / span), math.floor((reach - step) / span)


@bare_kernel
def _beside_image(around, s, g, ex, ey, ez, f, least, only):  # type: ignore[no-untyped-def]
    """Return the scale, up to f, at which a grain does not meet another, whose centroid lies at e from its own."""
    shapes, away = around.shapes, around.away
    turn, other, relative = shapes.work.turn, shapes.work.other, shapes.work.relative
    own, b = shapes.scale[g], shapes.shape[g]
    write_matrix(shapes.orientation[g], other)
    for i in range(3):
        for j in range(3):
            relative[i, j] = other[0, i] * turn[0, j] + other[1, i] * turn[1, j] + other[2, i] * turn[2, j]
    x, y, z = in_frame(other, own, -ex, -ey, -ez)
    single = shapes.first[b + 1, 0] - shapes.first[b, 0] == 1 and shapes.first[s + 1, 0] - shapes.first[s, 0] == 1
    # at a larger scale, so that what is a little apart by rounding is not taken for free
    if (only or single) and not shapes_meet(shapes, b, s, x, y, z, f / own * (1.0 + OPEN)):
        return f
    if only:
        return 0.0
    if single:
        found, nx, ny, nz = _parts_touch(shapes, b, s, shapes.hull[b], shapes.hull[s], x, y, z, f / own)
    elif shapes.closed[b] and holds(shapes, b, x, y, z):
        return 0.0
    else:
        found, nx, ny, nz = _surfaces_touch(shapes, b, s, x, y, z, least / own, f / own)
    if found >= f / own:
        return f
    for c in range(3):
        away[c] = other[c, 0] * nx + other[c, 1] * ny + other[c, 2] * nz
    return found * own * (1.0 - SMALLER)


@bare_kernel
def _surfaces_touch(shapes, a, b, x, y, z, least, most):  # type: ignore[no-untyped-def]
    """Return the scale, up to `most`, at which a part of b first touches one of a as b grows, and the normal there.

    x, y, z: centroid of b in the frame of a. The scale is 0 if the point is taken; the search ends below `least`.
    """
    turn, stack = shapes.work.relative, shapes.work.stack
    best, mx, my, mz = most, 0.0, 0.0, 0.0
    box, other_box = shapes.first[a, 1], shapes.first[b, 1]
    leaves, other_leaves = (shapes.first[a + 1, 1] - box) // 2, (shapes.first[b + 1, 1] - other_box) // 2
    stack[0, 0], stack[0, 1], depth = 0, 0, 1
    while depth > 0 and best > least:
        depth -= 1
        i, j = stack[depth, 0], stack[depth, 1]
        mine, other = shapes.sphere[box + i], shapes.sphere[other_box + j]
        if _spheres_touch(turn, mine, other, x, y, z) >= best:
            continue
        if i >= leaves and j >= other_leaves:
            for p in range(shapes.rows[box + i, 0], shapes.rows[box + i, 1]):
                for q in range(shapes.rows[other_box + j, 0], shapes.rows[other_box + j, 1]):
                    t, nx, ny, nz = _parts_touch(shapes, a, b, p, q, x, y, z, best)
                    if t < best:
                        best, mx, my, mz = t, nx, ny, nz
            continue
        if depth >= MOST_WAITING:
            # not reached by trees of up to 2**60 parts
            return 0.0, mx, my, mz
        split = i < leaves and (j >= other_leaves or mine[3] >= best * other[3])
        stack[depth, 0], stack[depth, 1] = 2 * i + 1 if split else i, j if split else 2 * j + 1
        stack[depth + 1, 0], stack[depth + 1, 1] = 2 * i + 2 if split else i, j if split else 2 * j + 2
        depth += 2
    return best, mx, my, mz


@bare_kernel
def _spheres_touch(turn, mine, other, x, y, z):  # type: ignore[no-untyped-def]
    """Return the scale at which a sphere of the frame of b, which grows about (x, y, z), first touches one of a.

    It is the least t >= 0 at which the distance of the centers, |u + t w|, is no more than the sum of the radii.
    """
    wx, wy, wz = placed(turn, 1.0, 0.0, 0.0, 0.0, other[0], other[1], other[2])
    ux, uy, uz = x - mine[0], y - mine[1], z - mine[2]
    apart = ux * ux + uy * uy + uz * uz - mine[3] * mine[3]
    if apart <= 0.0:
        return 0.0
    slope = ux * wx + uy * wy + uz * wz - mine[3] * other[3]
    square = slope * slope - (wx * wx + wy * wy + wz * wz - other[3] * other[3]) * apart
    if square < 0.0:
        return math.inf
    speed = math.sqrt(square) - slope
    return apart / speed if speed > 0.0 else math.inf


@bare_kernel
def _parts_touch(shapes, a, b, p, q, x, y, z, most):  # type: ignore[no-untyped-def]
    """Return the scale, if it is below `most`, at which part q of b first touches part p of a, and the normal there.

    x, y, z: centroid of b in the frame of a.
    """
    work, bodies = shapes.work, shapes.bodies
    near, corner, row, tables = work.simplex.near, work.corner, work.row, tables_of(bodies, work)
    mine = shapes.part_sphere[p]
    t, mx, my, mz = _spheres_touch(work.relative, mine, shapes.part_sphere[q], x, y, z), 0.0, 0.0, 0.0
    if t >= most:
        return t, mx, my, mz
    dx, dy, dz = _toward(work.relative, mine, shapes.part_sphere[q], x, y, z, t)
    if shapes.part[p, 0] == 0 and shapes.part[q, 0] == 0:
        return t, dx, dy, dz
    # up to here, their bounding spheres are apart
    t *= 1.0 - SMALLER
    one, room = (shapes.part[p, 0], a, shapes.part[p, 1], shapes.part[p, 2], shapes.part[p, 3], 0.0), len(corner) - 1
    for _ in range(STEPS):
        if t == 0.0:
            # b is its centroid
            corner[room, 0] = corner[room, 1] = corner[room, 2] = 0.0
            two = (0, len(row) - 1, room, room + 1, shapes.part[q, 3], 0.0)
        else:
            two = place_part(shapes, b, q, t)
        margin = shapes.margin[p] + t * shapes.margin[q]
        start = (dx, dy, dz)
        if not distance_along(tables, one, two, (x, y, z), start, 1e150, CLOSE, work.simplex) > margin:
            break
        length = math.sqrt(near[0] ** 2 + near[1] ** 2 + near[2] ** 2)
        nx, ny, nz = near[0] / length, near[1] / length, near[2] / length
        ax, ay, az, _ = core_support((tables, one), 0, nx, ny, nz)
        if t == 0.0:
            two = place_part(shapes, b, q, 1.0)
        bx, by, bz, _ = core_support((tables, two), 0, -nx, -ny, -nz)
        reach = -(bx * nx + by * ny + bz * nz) / (t if t > 0.0 else 1.0) + shapes.margin[q]
        level = (x - ax) * nx + (y - ay) * ny + (z - az) * nz - shapes.margin[p]
        if reach <= 0.0 and level > t * reach:
            # the plane across n separates the two at all larger scales
            return math.inf, nx, ny, nz
        if reach <= 0.0 or not level > t * reach * (1.0 + RISE):
            break
        t, mx, my, mz = level / reach, nx, ny, nz
        dx, dy, dz = nx, ny, nz
        if t >= most:
            break
    return t, mx, my, mz


@bare_kernel
def _toward(turn, mine, other, x, y, z, t):  # type: ignore[no-untyped-def]
    """Return the vector from the center of one sphere to that of the other at scale t; (1, 0, 0) where it is 0."""
    px, py, pz = placed(turn, t, x, y, z, other[0], other[1], other[2])
    px, py, pz = px - mine[0], py - mine[1], pz - mine[2]
    if px == 0.0 and py == 0.0 and pz == 0.0:
        px = 1.0
    return px, py, pz
