"""Voronoi cells of a given distribution of volumes by inverse Monte Carlo: the peer of cells by weights.

Seeds of ordinary Voronoi cells are moved one by one, by random steps, and a move is kept where the distribution of the
volumes comes nearer to the one that is wanted, as Mollon & Zhao 2012 (doi:10.1007/s10035-012-0356-x) do in the plane.
Only cells that touch the seed before or after its move are computed again, by the kernels of voxgran: what differs from
its own method is the way to the volumes, not the geometry.
"""

import time

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.kernels import kernel
from voxgran._base.seeds import stream
from voxgran.geometry.polyhedron import volume_and_center
from voxgran.packing.tessellation.voronoi_cells import Cells, build_cell, seeds_of

#: moves between two looks at the clock, cells that are computed again at most, and first and last length of a step, in
#: mean distances of seeds
BLOCK, CELLS, STEPS = 500, 400, (1.0, 0.01)


def inverse_monte_carlo(
    cells: Cells, place: Floats, wanted: Floats, moves: int, *, seed: int = 0
) -> tuple[Floats, Floats, float, int]:
    """Move seeds of Voronoi cells in a periodic box until their volumes are distributed as is wanted.

    Parameters
    ----------
    cells : Cells
        Walls and work space.
    place : (n, 3) ndarray of float
        Seeds to begin with, from the lower corner of the box.
    wanted : (n,) ndarray of float
        Volumes, in any order, whose sum is that of the box.
    moves : int
        Number of moves that are tried.
    seed : int
        Seed of the run.

    Returns
    -------
    place : (n, 3) ndarray of float
        The seeds.
    volume : (n,) ndarray of float
        Volumes of their cells.
    seconds : float
        CPU time of the moves, without that of the first diagram.
    kept : int
        Moves that were kept.
    """
    n, dimension = len(place), cells.walls.dimension
    place, wanted = place.copy(), np.sort(wanted)
    volume = cells.measured(seeds_of(place, np.zeros(n), cells.walls), n, lambda: None).volume
    spacing = (wanted.mean()) ** (1.0 / dimension)
    generator, kept, began = stream(seed, "inverse Monte Carlo"), 0, time.process_time()
    for first in range(0, moves, BLOCK):
        many = min(BLOCK, moves - first)
        length = spacing * STEPS[0] * (STEPS[1] / STEPS[0]) ** (first / moves)
        step = length * generator.normal(size=(many, 3))
        step[:, dimension:] = 0.0
        seeds = seeds_of(place, np.zeros(n), cells.walls)
        kept += _move(cells.around(seeds), volume, wanted, generator.integers(n, size=many), step)
        place = seeds.place
    return place, volume, time.process_time() - began, kept


@kernel
def _move(tessellation, volume, wanted, picks, steps):  # type: ignore[no-untyped-def]
    """Try some moves, write seeds and volumes, and return how many were kept."""
    touched, before, here = np.zeros(CELLS, np.int64), np.zeros(CELLS), np.zeros(3)
    seeds, walls, middle, kept = tessellation.seeds, tessellation.walls, np.zeros(3), 0
    error = _distance(volume, wanted)
    for k in range(len(picks)):
        i = picks[k]
        many = _neighbours(tessellation, i, touched, 0)
        for c in range(3):
            here[c] = seeds.place[i, c]
        _put(seeds, walls, i, here[0] + steps[k, 0], here[1] + steps[k, 1], here[2] + steps[k, 2])
        many = _neighbours(tessellation, i, touched, many)
        for j in range(many):
            before[j] = volume[touched[j]]
            volume[touched[j]] = _volume(tessellation, touched[j], middle)
        after = _distance(volume, wanted)
        if after < error:
            error = after
            kept += 1
            continue
        for j in range(many):
            volume[touched[j]] = before[j]
        _put(seeds, walls, i, here[0], here[1], here[2])
    return kept


@kernel
def _distance(volume, wanted):  # type: ignore[no-untyped-def]
    """Return the sum of the squared differences of two distributions, of which one is sorted."""
    total = 0.0
    found = np.sort(volume)
    for k in range(len(found)):
        total += (found[k] - wanted[k]) ** 2
    return total


@kernel
def _volume(tessellation, i, middle):  # type: ignore[no-untyped-def]
    """Make the cell of a seed, and return its volume."""
    build_cell(tessellation, i, False)
    return volume_and_center(tessellation.cell, middle)


@kernel
def _neighbours(tessellation, i, touched, many):  # type: ignore[no-untyped-def]
    """Add a seed and those beyond the faces of its cell to the ones that are touched; return the number of these."""
    cell = tessellation.cell
    _volume(tessellation, i, np.zeros(3))
    for f in range(-1, cell.count[1]):
        owner = i if f < 0 else cell.owner[f]
        known = owner < 0 or many == len(touched)
        for j in range(many):
            known = known or touched[j] == owner
        if not known:
            touched[many] = owner
            many += 1
    return many


@kernel
def _put(seeds, walls, i, x, y, z):  # type: ignore[no-untyped-def]
    """Move a seed to a place, which is brought into the box, and into the list of the cell there."""
    at = _cell_of(seeds, i)
    if seeds.head[at] == i:
        seeds.head[at] = seeds.after[i]
    else:
        other = seeds.head[at]
        while seeds.after[other] != i:
            other = seeds.after[other]
        seeds.after[other] = seeds.after[i]
    seeds.place[i, 0], seeds.place[i, 1], seeds.place[i, 2] = x, y, z
    for c in range(walls.dimension):
        seeds.place[i, c] -= np.floor(seeds.place[i, c] / walls.lengths[c]) * walls.lengths[c]
    at = _cell_of(seeds, i)
    seeds.after[i] = seeds.head[at]
    seeds.head[at] = i


@kernel
def _cell_of(seeds, i):  # type: ignore[no-untyped-def]
    """Return the cell of the lists of seeds in which a seed lies."""
    number = 0
    for c in range(3):
        index = min(max(int(seeds.place[i, c] / seeds.width[c]), 0), seeds.count[c] - 1)
        number = number * seeds.count[c] + index
    return number
