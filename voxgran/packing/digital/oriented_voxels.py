"""Kinds of grains and their voxels in each orientation of the lattice: what methods of whole-lattice search work on.

Grains of one shape and one diameter are of one kind and share their voxels. A kind has its given pose, further random
ones if asked, and of each the rotations that map the lattice onto itself; rotations that give the same voxels are one.
Where orientations are asked for, each grain is a kind with that one.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.checkpoint import Declared, Held
from voxgran._base.seeds import stream
from voxgran.geometry.rotation import lattice_rotations, product, quaternions_of, random_rotations
from voxgran.packing.digital.bit_columns import (
    Field,
    column_words,
    cut_to_box,
    row_length,
    signed_axes,
    turned_box,
    turned_mask,
)
from voxgran.packing.digital.container_lattice import ContainerLattice, positions_on
from voxgran.packing.digital.initial_sites import stand_on_lattice
from voxgran.packing.digital.trial_sites import OrientedRecord, find_site, stamp_grain
from voxgran.packing.method import State
from voxgran.packing.model import Packing
from voxgran.packing.problem import Problem


@dataclass(frozen=True, slots=True)
class OrientedVoxels:
    """The voxels of all kinds in all their orientations."""

    record: OrientedRecord  # bit columns, lowest voxels and extents, as kernels take them
    voxels: Integers  # (m,): number of voxels
    kind: Integers  # (m,): kind of each, ascending
    orientation: Floats  # (m, 4): unit quaternions
    masks: tuple[Booleans, ...]  # the voxels themselves, cut to their boxes


def kinds_of(problem: Problem) -> tuple[Integers, Integers]:
    """Return the kind of each grain, in the order of their first grains, and the first grain of each kind."""
    if not problem.count:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    columns = [problem.shape_id, problem.diameter]
    if problem.orientation is not None:
        sphere = np.array([shape.is_sphere for shape in problem.shapes])[problem.shape_id]
        columns.append(np.where(sphere[:, None], 0.0, problem.orientation))
    pairs = np.column_stack(columns)
    _, first, inverse = np.unique(pairs, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first, kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return rank[inverse.reshape(-1)], first[order].astype(np.int64)


def lattice_turns(problem: Problem) -> Integers:
    """Return the rotations (r, 3, 3) that map the lattice onto itself, in 2D about z; the first is the identity.

    Grains of which the orientations are asked for have that alone.
    """
    rotations = lattice_rotations()
    if problem.orientation is not None:
        return rotations[:1]
    return rotations if problem.dimension == 3 else rotations[rotations[:, 2, 2] == 1]


def places_of(problem: Problem, lattice: ContainerLattice) -> Integers:
    """Return at how many corners of voxels a centroid may lie, along each axis, (3,)."""
    places = lattice.shape + (1 - np.array(problem.container.periodic, dtype=np.int64))
    if problem.dimension == 2:
        places[2] = 1
    return np.asarray(places, dtype=np.int64)


def declared_sites(places: Integers, oriented: OrientedVoxels) -> Declared:
    """Return what a checkpoint may hold of sites and members of grains, on a lattice of these places along its axes."""
    return {"site": Held(-places, 2 * places), "member": Held(-1, len(oriented.kind) - 1)}


def stand_within(lattice: ContainerLattice, periodic: Any, oriented: OrientedVoxels, arrays: Any) -> bool:
    """Return whether the voxels of grains that are placed lie within the walls, on axes that are not periodic."""
    there = np.flatnonzero(arrays["member"] >= 0)
    member = arrays["member"][there]
    low = arrays["site"][there] + oriented.record.low[member]
    high = low + oriented.record.size[member]
    return bool((((low >= 0) & (high <= lattice.shape)) | np.array(periodic)).all())


def number_of_poses(problem: Problem) -> int:
    """Return the number of poses of all kinds, in all turns, before those that look alike are counted once."""
    turns = len(lattice_turns(problem)) if problem.parameters.turned else 1
    return poses_to_voxelize(problem) * turns


def poses_to_voxelize(problem: Problem) -> int:
    """Return the number of poses of all kinds: one of each where orientations are asked for."""
    bases = problem.parameters.orientations if problem.orientation is None else 1
    return len(kinds_of(problem)[1]) * bases


def random_poses(problem: Problem, count: int) -> Floats:
    """Return random orientations (count, 4); in 2D about z."""
    generator = stream(problem.seed, "orientations")
    if problem.dimension == 3:
        return random_rotations(generator, count)
    half = np.pi * generator.random(count)
    return np.column_stack([libm.cos(half), np.zeros((count, 2)), libm.sin(half)])


def base_orientations(problem: Problem, first: Integers, bases: int) -> Floats:
    """Return the poses (kinds, bases, 4) that are voxelized: the given one, then random ones, of kinds of which these
    are grains; or the one that is asked for.
    """
    kinds = len(first)
    if problem.orientation is not None:
        return problem.orientation[first, None]
    base = np.zeros((kinds, bases, 4))
    base[:, :, 0] = 1.0
    base[:, 1:] = random_poses(problem, kinds * (bases - 1)).reshape(kinds, bases - 1, 4)
    return base


def orient(problem: Problem, first: Integers, lattice: ContainerLattice) -> OrientedVoxels:
    """Voxelize each kind, of which `first` (k,) are grains, in each of its poses, and turn the voxels.

    Grains of a start come last, each in its own pose and as a kind of its own.
    """
    settings, rotations = problem.parameters, lattice_turns(problem)
    if not settings.turned:
        rotations = rotations[:1]
    turns, quaternions = signed_axes(rotations), quaternions_of(rotations.astype(np.float64))
    found: list[tuple[Booleans, Integers, int, Floats]] = []
    for kind, poses in enumerate(base_orientations(problem, first, settings.orientations)):
        seen: set[tuple[bytes, tuple[int, ...], tuple[int, ...]]] = set()
        for pose in poses:
            box, low = cut_to_box(problem.voxels(int(first[kind]), pose, lattice.voxel_size, cover=settings.cover))
            for turn, quaternion in zip(turns, product(quaternions, pose), strict=True):
                turned, corner = turned_mask(box, turn), np.array(turned_box.plain(low, box.shape, turn)[0])
                key = (turned.tobytes(), turned.shape, tuple(corner.tolist()))
                if key not in seen:
                    seen.add(key)
                    found.append((turned, corner, kind, quaternion))
    for grain, pose in enumerate(() if problem.start is None else problem.start.orientation):
        box, low = cut_to_box(problem.voxels(grain, pose, lattice.voxel_size, cover=settings.cover))
        found.append((box, low, len(first) + grain, pose))
    return OrientedVoxels(
        _record_of([box for box, *_ in found], [low for _, low, *_ in found]),
        np.array([np.count_nonzero(box) for box, *_ in found], dtype=np.int64),
        np.array([kind for _, _, kind, _ in found], dtype=np.int64),
        np.array([pose for *_, pose in found]).reshape(-1, 4),
        tuple(box for box, *_ in found),
    )


def _record_of(boxes: list[Booleans], low: list[Integers]) -> OrientedRecord:
    """Return boxes of voxels and their lowest voxels as kernels take them; a row of zeros comes first."""
    offset = 16 + row_length.plain(max((max(box.shape) for box in boxes), default=0))
    words, at = [np.zeros(offset, dtype=np.uint64)], []
    for box in boxes:
        empty = row_length.plain(box.shape[1]) - box.shape[1]
        words.append(column_words(np.pad(box, ((1, 1), (0, empty), (0, 0)))).reshape(-1))
        at.append(offset)
        offset += words[-1].size
    sizes = np.array([box.shape for box in boxes], dtype=np.int64).reshape(-1, 3)
    lowest = np.array(low, dtype=np.int64).reshape(-1, 3)
    return OrientedRecord(np.concatenate(words), np.array(at, dtype=np.int64), lowest, sizes)


def enter_start(
    problem: Problem, state: State, lattice: ContainerLattice, record: OrientedRecord, *, field: Field,
    gravity: Integers,
) -> None:  # fmt: skip
    """Put the grains of a start, the last ones of the record, on the canvas near their positions, and note their sites.

    `gravity` is a lattice vector, zero for none.

    Raises
    ------
    InputError
        If a grain finds no place.
    """
    start = problem.start
    if start is None:
        return
    begin = len(record.at) - start.count

    def put(grain: int, site: Integers, ways: Integers) -> bool:
        free = find_site(field, record, begin + grain, site, ways) >= 0
        if free:
            stamp_grain(field, record, begin + grain, site)
        return free

    def remove(grain: int, site: Integers) -> None:
        # stamping it once more removes it
        stamp_grain(field, record, begin + grain, site)

    sites = stand_on_lattice(problem, start, lattice, gravity, put=put, remove=remove)
    state.arrays["site"][: start.count] = sites
    state.arrays["member"][: start.count] = np.arange(begin, len(record.at))
    state.counters["placed"] = start.count


def packing_of_sites(
    problem: Problem, state: State, lattice: ContainerLattice, oriented: OrientedVoxels, **more: Any
) -> Packing:
    """Return the packing of the grains that found a place; `more` goes to :meth:`Problem.packing`."""
    placed = np.flatnonzero(state.arrays["member"] >= 0)
    return problem.packing(
        placed,
        position=positions_on(lattice, state.arrays["site"][placed], problem.dimension),
        orientation=oriented.orientation[state.arrays["member"][placed]],
        voxel_size=lattice.voxel_size,
        contact_gap=lattice.voxel_size,
        stop_reason=state.stop_reason,
        **more,
    )
