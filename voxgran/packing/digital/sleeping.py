"""Grains of a walk that sleep once they no longer sink, and wake when something near them does."""

from voxgran._base.kernels import bare_kernel
from voxgran.packing.digital.bit_columns import Bed, turned_box
from voxgran.packing.digital.periodic_images import shifted
from voxgran.packing.digital.proposals import MoveRules, Schedule


@bare_kernel
def _cells_around(bed, schedule, g):  # type: ignore[no-untyped-def]
    """Return the first cell and the one after the last, along each axis, of a grain one voxel wider on each side."""
    field, members, grains = bed
    m, t = grains.member[g], grains.turn[g]
    low, size = turned_box(members.low[m], members.size[m], members.turns[t])
    edge, (x, y, z) = schedule.cells[3], shifted(field, grains.site[g], low)
    first = ((x - 1) // edge, (y - 1) // edge, (z - 1) // edge)
    return first, ((x + size[0]) // edge + 1, (y + size[1]) // edge + 1, (z + size[2]) // edge + 1)


@bare_kernel
def sleeps(bed: Bed, schedule: Schedule, g: int, cycle: int) -> bool:
    """Return whether a grain sleeps on; it wakes with a new cycle, and when something near it has sunk since."""
    since = schedule.slept[g]
    if since < 0:
        return False
    quiet = since >= cycle
    if quiet:
        low, high = _cells_around(bed, schedule, g)
        for i in range(low[0], high[0]):
            for j in range(low[1], high[1]):
                for k in range(low[2], high[2]):
                    quiet = quiet and schedule.stirred[_cell(schedule, i, j, k)] <= since
    if not quiet:
        schedule.slept[g], schedule.calm[g], schedule.depth[g] = -1, 0, -(2**40)
    return quiet


@bare_kernel
def _cell(schedule, i, j, k):  # type: ignore[no-untyped-def]
    """Return the number of a cell, wrapped."""
    nx, ny, nz = schedule.cells[0], schedule.cells[1], schedule.cells[2]
    return ((i - i // nx * nx) * ny + (j - j // ny * ny)) * nz + k - k // nz * nz


@bare_kernel
def note_rest(bed: Bed, rules: MoveRules, schedule: Schedule, g: int, attempt: int) -> None:
    """Stir the cells of a grain that came lower; put one to sleep that did not in 128 attempts."""
    site = bed.grains.site[g]
    depth = site[0] * rules.gravity[0] + site[1] * rules.gravity[1] + site[2] * rules.gravity[2]
    if depth <= schedule.depth[g]:
        schedule.calm[g] += 1
        if schedule.calm[g] >= 128:
            schedule.slept[g] = attempt
        return
    first = schedule.depth[g] == -(2**40)
    schedule.depth[g], schedule.calm[g] = depth, 0
    if first:
        return
    low, high = _cells_around(bed, schedule, g)
    for i in range(low[0], high[0]):
        for j in range(low[1], high[1]):
            for k in range(low[2], high[2]):
                schedule.stirred[_cell(schedule, i, j, k)] = attempt
