"""A new grain of a true shape: its orientation, the grains near it, and whether it may be placed.

Grains whose inner spheres overlap certainly meet, and those whose bounding spheres do not are apart. Of the others the
nearest ones, in sums of the bounding radii, are tested first, exactly.
"""

from voxgran._base.arrays import Words
from voxgran._base.kernels import bare_kernel
from voxgran.contacts.overlap.true_pairs import in_frame, meets_itself, place_relative, shapes_meet
from voxgran.contacts.overlap.true_shapes import TrueShapes
from voxgran.contacts.overlap.true_walls import is_within_walls
from voxgran.containers.kernel_container import is_barred
from voxgran.geometry.level_grid import cells_near, first_in_cell, image_shift
from voxgran.geometry.rotation import draw_quaternion, write_matrix
from voxgran.geometry.vectors import Vector, add, dot, row_of, sub
from voxgran.packing.rsa.overlaps import Bed, Grains, enter, from_corner

#: share of a radius by which a sphere is made smaller where rounding must not take it for meeting a grain
SMALLER = 1e-9
#: near grains that are tested in the order of their distances
SORTED = 8


@bare_kernel
def place_true(bed: Bed, shapes: TrueShapes, g: int, place: Vector, key: Words, number: int) -> bool:
    """Place grain g at `place`, if it meets nothing, and return whether it did.

    Its orientation is that of block (number, 1), and the one it has where its shape is not turned.
    """
    s, f, inner, work = shapes.shape[g], shapes.scale[g], shapes.inner[g], shapes.work
    radius, walls = bed.grains.half[g, 0], bed.walls
    if is_barred(walls, *place, 0.0, 0.0, 0.0, inner):
        return False
    many = list_near(bed, shapes, place, radius, inner)
    if many < 0:
        return False
    for c in range(4):
        work.quaternion[c] = shapes.orientation[g, c]
    if shapes.turns[s]:
        draw_quaternion(walls.dimension, key, number, work.quaternion)
    write_matrix(work.quaternion, work.turn)
    if _meets_near(shapes, s, f, many):
        return False
    if not is_within_walls(walls, shapes, s, f, *place):
        return False
    if meets_itself(bed.cells.periods, shapes, s, f, radius):
        return False
    for c in range(4):
        shapes.orientation[g, c] = work.quaternion[c]
    enter(bed, g, place)
    return True


@bare_kernel
def is_taken(grains: Grains, shapes: TrueShapes, many: int, center: Vector, radius: float) -> bool:
    """Return whether a sphere meets one of the listed grains; rounding only makes it smaller.

    center: from the place about which the grains are listed.
    """
    work, f = shapes.work, radius * (1.0 - SMALLER)
    for i in range(3):
        for j in range(3):
            work.turn[i, j] = 1.0 if i == j else 0.0
    for k in range(many):
        g = work.grain[k]
        way = sub(row_of(work.place, k), center)
        square, reach, core = dot(way, way), f + grains.half[g, 0], f + shapes.inner[g]
        if square >= reach * reach:
            continue
        if square < core * core:
            return True
        write_matrix(shapes.orientation[g], work.other)
        place_relative(shapes)
        x, y, z = way[0] / f, way[1] / f, way[2] / f
        if shapes_meet(shapes, len(shapes.turns), shapes.shape[g], x, y, z, shapes.scale[g] / f):
            return True
    return False


@bare_kernel
def list_near(bed: Bed, shapes: TrueShapes, center: Vector, radius: float, inner: float) -> int:
    """List the grains whose bounding spheres overlap a sphere about a center; return their number.

    The number is -1 if the inner sphere of one overlaps that of radius `inner`, which may be negative.
    """
    position, half, cells = bed.grains.position, bed.grains.half, bed.cells
    place, many = shapes.work.place, 0
    for level in range(len(cells.first)):
        if cells.filled[level] == 0:
            continue
        wide = radius + cells.reach[level, 0], radius + cells.reach[level, 1], radius + cells.reach[level, 2]
        low, high = cells_near(cells, level, *from_corner(bed, center), wide)
        for i in range(low[0], high[0]):
            for j in range(low[1], high[1]):
                for k in range(low[2], high[2]):
                    g, ti, tj, tk = first_in_cell(cells, level, i, j, k)
                    while g >= 0:
                        dx, dy, dz = sub(add(row_of(position, g), image_shift(cells, ti, tj, tk)), center)
                        square, reach = dx * dx + dy * dy + dz * dz, radius + half[g, 0]
                        if square < reach * reach:
                            core = inner + shapes.inner[g]
                            if core > 0.0 and square < core * core:
                                return -1
                            place[many, 0], place[many, 1], place[many, 2] = dx, dy, dz
                            place[many, 3] = square / (reach * reach)
                            shapes.work.grain[many] = g
                            many += 1
                        g = cells.after[g]
    return many


@bare_kernel
def _meets_near(shapes, s, f, many):  # type: ignore[no-untyped-def]
    """Return whether the new grain, rotated by `work.turn`, meets one of the listed grains."""
    work = shapes.work
    place, grain = work.place, work.grain
    for left in range(many, 0, -1):
        best = 0
        # the order of the farther ones of many does not matter
        for k in range(1, left if many - left < SORTED else 1):
            if place[k, 3] < place[best, 3]:
                best = k
        g = grain[best]
        write_matrix(shapes.orientation[g], work.other)
        place_relative(shapes)
        x, y, z = in_frame(work.turn, f, place[best, 0], place[best, 1], place[best, 2])
        if shapes_meet(shapes, s, shapes.shape[g], x, y, z, shapes.scale[g] / f):
            return True
        for c in range(4):
            place[best, c] = place[left - 1, c]
        grain[best] = grain[left - 1]
    return False
