"""A new grain of a true shape: its random orientation, the grains near it, and whether it may be placed.

Grains whose inner spheres overlap certainly meet, and those whose bounding spheres do not are apart. Of the others the
nearest ones, in sums of the bounding radii, are tested first, exactly.
"""

from voxgran._base.arrays import Words
from voxgran._base.kernels import bare_kernel
from voxgran.contacts.overlap.true_pairs import in_frame, meets_itself, place_relative, shapes_meet
from voxgran.contacts.overlap.true_shapes import TrueShapes
from voxgran.contacts.overlap.true_walls import is_within_walls
from voxgran.containers.kernel_container import KernelContainer, is_barred
from voxgran.geometry.level_grid import LevelGrid, cells_near, first_in_cell
from voxgran.geometry.rotation import draw_quaternion, write_matrix
from voxgran.packing.rsa.overlaps import Grains, enter

#: share of a radius by which a sphere is made smaller where rounding must not take it for meeting a grain
SMALLER = 1e-9
#: near grains that are tested in the order of their distances
SORTED = 8


@bare_kernel
def place_true(
    grains: Grains,
    cells: LevelGrid,
    walls: KernelContainer,
    shapes: TrueShapes,
    g: int,
    x: float,
    y: float,
    z: float,
    key: Words,
    number: int,
    rows: object,
) -> bool:
    """Place grain g at (x, y, z), in the orientation of block (number, 1), if it meets nothing; return whether it did.

    rows: as in :mod:`voxgran.contacts.overlap.true_pairs`.
    """
    s, f, inner, work = shapes.shape[g], shapes.scale[g], shapes.inner[g], shapes.work
    if is_barred(walls, x, y, z, 0.0, 0.0, 0.0, inner):
        return False
    many = list_near(grains, cells, walls, shapes, x, y, z, grains.half[g, 0], inner)
    if many < 0:
        return False
    work.quaternion[0], work.quaternion[1], work.quaternion[2], work.quaternion[3] = 1.0, 0.0, 0.0, 0.0
    if shapes.turns[s]:
        draw_quaternion(walls.dimension, key, number, work.quaternion)
    write_matrix(work.quaternion, work.turn)
    if _meets_near(shapes, s, f, many, rows):
        return False
    if not is_within_walls(walls, shapes, s, f, x, y, z, rows):
        return False
    if meets_itself(cells.span, shapes, s, f, grains.half[g, 0], rows):
        return False
    for c in range(4):
        shapes.orientation[g, c] = work.quaternion[c]
    enter(grains, cells, walls, g, x, y, z)
    return True


@bare_kernel
def is_taken(
    grains: Grains, shapes: TrueShapes, many: int, x: float, y: float, z: float, radius: float, rows: object,
) -> bool:  # fmt: skip
    """Return whether a sphere meets one of the listed grains; rounding only makes it smaller.

    x, y, z: its center, from the place about which the grains are listed.
    """
    work, f = shapes.work, radius * (1.0 - SMALLER)
    for i in range(3):
        for j in range(3):
            work.turn[i, j] = 1.0 if i == j else 0.0
    for k in range(many):
        g = work.grain[k]
        dx, dy, dz = work.place[k, 0] - x, work.place[k, 1] - y, work.place[k, 2] - z
        square, reach, core = dx * dx + dy * dy + dz * dz, f + grains.half[g, 0], f + shapes.inner[g]
        if square >= reach * reach:
            continue
        if square < core * core:
            return True
        write_matrix(shapes.orientation[g], work.other)
        place_relative(shapes)
        if shapes_meet(shapes, len(shapes.turns), shapes.shape[g], dx / f, dy / f, dz / f, shapes.scale[g] / f, rows):
            return True
    return False


@bare_kernel
def list_near(
    grains: Grains,
    cells: LevelGrid,
    walls: KernelContainer,
    shapes: TrueShapes,
    x: float,
    y: float,
    z: float,
    radius: float,
    inner: float,
) -> int:
    """List the grains whose bounding spheres overlap a sphere about (x, y, z); return their number.

    The number is -1 if the inner sphere of one overlaps that of radius `inner`, which may be negative.
    """
    position, half, lower = grains.position, grains.half, walls.lower
    span, after = cells.span, cells.after
    place, many = shapes.work.place, 0
    for level in range(len(cells.first)):
        if cells.filled[level] == 0:
            continue
        wide = radius + cells.reach[level, 0], radius + cells.reach[level, 1], radius + cells.reach[level, 2]
        low, high = cells_near(cells, level, x - lower[0], y - lower[1], z - lower[2], wide)
        for i in range(low[0], high[0]):
            for j in range(low[1], high[1]):
                for k in range(low[2], high[2]):
                    g, ti, tj, tk = first_in_cell(cells, level, i, j, k)
                    while g >= 0:
                        dx = position[g, 0] + ti * span[0] - x
                        dy = position[g, 1] + tj * span[1] - y
                        dz = position[g, 2] + tk * span[2] - z
                        square, reach = dx * dx + dy * dy + dz * dz, radius + half[g, 0]
                        if square < reach * reach:
                            core = inner + shapes.inner[g]
                            if core > 0.0 and square < core * core:
                                return -1
                            place[many, 0], place[many, 1], place[many, 2] = dx, dy, dz
                            place[many, 3] = square / (reach * reach)
                            shapes.work.grain[many] = g
                            many += 1
                        g = after[g]
    return many


@bare_kernel
def _meets_near(shapes, s, f, many, rows):  # type: ignore[no-untyped-def]
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
        if shapes_meet(shapes, s, shapes.shape[g], x, y, z, shapes.scale[g] / f, rows):
            return True
        for c in range(4):
            place[best, c] = place[left - 1, c]
        grain[best] = grain[left - 1]
    return False
