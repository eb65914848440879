"""Grains on the canvas with their periodic images: where they are, what they meet, and stamping them."""

from voxgran._base.arrays import Integers, Words
from voxgran._base.kernels import bare_kernel, inlined_kernel
from voxgran.packing.digital.bit_columns import Field, Triple
from voxgran.packing.digital.stamping import look, look_along, look_along_low, stamp, stamp_low_move, stamp_move


@inlined_kernel
def wrapped(x: int, n: int, periodic: int) -> int:
    """Return a voxel index wrapped into [0, n) where the axis is periodic."""
    if not periodic or 0 <= x < n:
        return x
    return x - (x // n) * n


@inlined_kernel
def shifted(field: Field, voxel: Integers | Triple, shift: Triple) -> Triple:
    """Return a voxel after a shift, wrapped into the container."""
    return (
        wrapped(voxel[0] + shift[0], field.shape[0], field.periodic[0]),
        wrapped(voxel[1] + shift[1], field.shape[1], field.periodic[1]),
        wrapped(voxel[2] + shift[2], field.shape[2], field.periodic[2]),
    )


@inlined_kernel
def copies(field: Field, axis: int, x: int, extent: int) -> int:
    """Return 2 where a grain reaches over the end of a periodic axis, else 1."""
    return 2 if field.periodic[axis] and x + extent > field.shape[axis] else 1


@inlined_kernel
def image_of(field: Field, corner: Triple, ix: int, iy: int, iz: int) -> Triple:
    """Return the canvas voxel of an image of a corner."""
    return (
        corner[0] + field.margin[0] - ix * field.shape[0],
        corner[1] + field.margin[1] - iy * field.shape[1],
        corner[2] + field.margin[2] - iz * field.shape[2],
    )


@bare_kernel
def stamp_images(field: Field, bits: Words, at: int, size: Triple, corner: Triple) -> None:
    """Flip a grain at its place and at its periodic images."""
    for ix in range(copies(field, 0, corner[0], size[0])):
        for iy in range(copies(field, 1, corner[1], size[1])):
            for iz in range(copies(field, 2, corner[2], size[2])):
                stamp(field, bits, at, size, image_of(field, corner, ix, iy, iz))


@bare_kernel
def stamp_step(field: Field, bits: Words, at: int, size: Triple, old: Triple, corner: Triple, step: Triple) -> None:
    """Flip what a grain covers anew and what it leaves by a step from one corner to another, images included."""
    for axis in range(3):
        if corner[axis] != old[axis] + step[axis] or copies(field, axis, old[axis], size[axis]) != copies(
            field, axis, corner[axis], size[axis]
        ):
            # it has other images than before
            stamp_images(field, bits, at, size, old)
            stamp_images(field, bits, at, size, corner)
            return
    for ix in range(copies(field, 0, corner[0], size[0])):
        for iy in range(copies(field, 1, corner[1], size[1])):
            for iz in range(copies(field, 2, corner[2], size[2])):
                image = image_of(field, corner, ix, iy, iz)
                if size[2] <= 64:
                    stamp_low_move(field, bits, at, size, image, step)
                else:
                    stamp_move(field, bits, at, size, image, step)


@bare_kernel
def is_outside(field: Field, size: Triple, corner: Triple) -> bool:
    """Return whether a grain reaches through a wall, or on a periodic axis meets its own image."""
    for axis in range(3):
        if field.periodic[axis]:
            if size[axis] >= field.shape[axis]:
                return True
        elif corner[axis] < 0 or corner[axis] + size[axis] > field.shape[axis]:
            return True
    return False


@inlined_kernel
def looked_at(found: int) -> int:
    """Return how much a look took, from its result: that itself, or the complement where something was in the way."""
    return found if found >= 0 else ~found


@bare_kernel
def look_anywhere(field: Field, bits: Words, at: int, size: Triple, corner: Triple) -> int:
    """Look whether a grain that is not on the canvas would meet anything at a place or its images.

    Return the rows of columns that were looked at; where something is in the way, the complement, which is below 0.
    """
    rows = 0
    if is_outside(field, size, corner):
        return ~rows
    for ix in range(copies(field, 0, corner[0], size[0])):
        for iy in range(copies(field, 1, corner[1], size[1])):
            for iz in range(copies(field, 2, corner[2], size[2])):
                found = look(field, bits, at, size, image_of(field, corner, ix, iy, iz))
                rows += looked_at(found)
                if found < 0:
                    return ~rows
    return rows


@bare_kernel
def find_near(field: Field, bits: Words, at: int, low: Triple, size: Triple, site: Integers, ways: Integers) -> int:
    """Move a site, within the walls, by the first of some ways that is free; return which one, -1 for none."""
    for axis in range(3):
        if field.periodic[axis] == 0:
            site[axis] = max(-low[axis], min(site[axis], field.shape[axis] - size[axis] - low[axis]))
    for k in range(len(ways)):
        for axis in range(3):
            site[axis] += ways[k, axis]
        if look_anywhere(field, bits, at, size, shifted(field, site, low)) >= 0:
            return k
        for axis in range(3):
            site[axis] -= ways[k, axis]
    return -1


@bare_kernel
def look_along_step(field: Field, bits: Words, at: int, size: Triple, corner: Triple, step: Triple) -> int:
    """Look whether a grain on the canvas that steps to a corner would newly cover a taken voxel.

    Return what :func:`look_anywhere` returns.
    """
    rows = 0
    for ix in range(copies(field, 0, corner[0], size[0])):
        for iy in range(copies(field, 1, corner[1], size[1])):
            for iz in range(copies(field, 2, corner[2], size[2])):
                image = image_of(field, corner, ix, iy, iz)
                if size[2] <= 64:
                    found = look_along_low(field, bits, at, size, image, step)
                else:
                    found = look_along(field, bits, at, size, image, step)
                rows += looked_at(found)
                if found < 0:
                    return ~rows
    return rows
