"""Kinds of grains and their voxels in each orientation of the lattice: what methods of whole-lattice search work on.

Grains of one shape and one diameter are of one kind and share their voxels. A kind has its given pose, further random
ones if asked, and of each the rotations that map the lattice onto itself; rotations that give the same voxels are one.
"""

from dataclasses import dataclass

import numpy as np

from voxgran._base.arrays import Booleans, Floats, Integers, Words
from voxgran._base.rotation import lattice_rotations, product, quaternions_of, random_rotations
from voxgran._base.seeds import stream
from voxgran.packing.digital.bit_columns import Field, pack_columns, row_length
from voxgran.packing.digital.container_lattice import ContainerLattice
from voxgran.packing.digital.initial_sites import stand_on_lattice
from voxgran.packing.digital.trial_sites import Parts, find_near, stamp_grain
from voxgran.packing.problem import Problem
from voxgran.packing.start import Start


@dataclass(frozen=True, slots=True)
class Oriented:
    """The voxels of all kinds in all their orientations.

    Attributes
    ----------
    words : (w,) ndarray of uint64
        Bit columns of one after the other, ``[x, word of z, y]`` with a ring of empty columns; a row of zeros first.
    at : (m,) ndarray of int
        Where each begins.
    low, size : (m, 3) ndarray of int
        Lowest voxel, counted from the lattice corner at the centroid, and extents.
    voxels : (m,) ndarray of int
        Number of voxels.
    kind : (m,) ndarray of int
        Kind of each; they rise.
    orientation : (m, 4) ndarray of float
        Unit quaternions.
    masks : tuple of ndarray of bool
        The voxels themselves, cut to their boxes.
    """

    words: Words
    at: Integers
    low: Integers
    size: Integers
    voxels: Integers
    kind: Integers
    orientation: Floats
    masks: tuple[Booleans, ...]


def kinds_of(problem: Problem) -> tuple[Integers, Integers]:
    """Return the kind of each grain, in the order of their first grains, and the first grain of each kind."""
    if not problem.count:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    pairs = np.column_stack([problem.shape_id, problem.diameter])
    _, first, inverse = np.unique(pairs, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first, kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return rank[inverse.reshape(-1)], first[order].astype(np.int64)


def base_orientations(problem: Problem, kinds: int, bases: int) -> Floats:
    """Return the poses (kinds, bases, 4) that are voxelized: the given one, then random ones; in 2D about z."""
    base = np.zeros((kinds, bases, 4))
    base[:, :, 0] = 1.0
    if bases > 1:
        generator = stream(problem.seed, "orientations")
        many = kinds * (bases - 1)
        if problem.dimension == 3:
            drawn = random_rotations(generator, many)
        else:
            half = np.pi * generator.random(many)
            drawn = np.column_stack([np.cos(half), np.zeros((many, 2)), np.sin(half)])
        base[:, 1:] = drawn.reshape(kinds, bases - 1, 4)
    return base


def orient(problem: Problem, first: Integers, base: Floats, voxel_size: float, *, turned: bool, cover: str) -> Oriented:
    """Voxelize each kind in each pose and turn the voxels.

    Parameters
    ----------
    problem : Problem
        In the normalized frame.
    first : (k,) ndarray of int
        A grain of each kind.
    base : (k, b, 4) ndarray of float
        Poses that are voxelized.
    voxel_size : float
        Edge of a voxel, in median diameters.
    turned : bool
        Whether the rotations of the lattice are taken too.
    cover : {"touch", "center"}
        Which voxels are taken.

    Returns
    -------
    Oriented
        Grains of a start come last, each in its own pose and as a kind of its own.
    """
    rotations = lattice_rotations()
    if problem.dimension == 2:
        rotations = rotations[rotations[:, 2, 2] == 1]
    if not turned:
        rotations = rotations[(rotations == np.eye(3)).all(axis=(1, 2))]
    quaternions = quaternions_of(rotations.astype(np.float64))
    found: list[tuple[Booleans, Integers, int, Floats]] = []
    for kind, grain in enumerate(first.tolist()):
        seen: set[tuple[bytes, tuple[int, ...], tuple[int, ...]]] = set()
        for pose in base[kind]:
            mask = problem.voxels(grain, pose, voxel_size, cover=cover)
            for matrix, quaternion in zip(rotations, quaternions, strict=True):
                box, low = _cut(_turned(mask, matrix))
                key = (box.tobytes(), box.shape, tuple(low.tolist()))
                if key not in seen:
                    seen.add(key)
                    found.append((box, low, kind, product(quaternion[None], pose[None])[0]))
    if problem.start is not None:
        for grain, pose in enumerate(problem.start.orientation):
            box, low = _cut(problem.voxels(grain, pose, voxel_size, cover=cover))
            found.append((box, low, len(first) + grain, pose))
    largest = max((max(box.shape) for box, *_ in found), default=0)
    offset = 16 + row_length.plain(largest)
    words, at = [np.zeros(offset, dtype=np.uint64)], []
    for box, *_ in found:
        row = row_length.plain(box.shape[1])
        filled = np.pad(box, ((1, 1), (0, row - box.shape[1]), (0, 0)))
        columns = pack_columns(filled).transpose(0, 2, 1)
        words.append(columns.reshape(-1))
        at.append(offset)
        offset += columns.size
    return Oriented(
        np.concatenate(words),
        np.array(at, dtype=np.int64),
        np.array([low for _, low, *_ in found], dtype=np.int64).reshape(-1, 3),
        np.array([box.shape for box, *_ in found], dtype=np.int64).reshape(-1, 3),
        np.array([np.count_nonzero(box) for box, *_ in found], dtype=np.int64),
        np.array([kind for _, _, kind, _ in found], dtype=np.int64),
        np.array([pose for *_, pose in found]).reshape(-1, 4),
        tuple(box for box, *_ in found),
    )


def stand_start(
    problem: Problem, start: Start, lattice: ContainerLattice, oriented: Oriented, *, field: Field, gravity: Integers
) -> Integers:
    """Put the grains of a start on the canvas, each as near to its place as there is room.

    Parameters
    ----------
    problem : Problem
        In the normalized frame.
    start : Start
        Its poses; its grains are the last of `oriented`.
    lattice : ContainerLattice
        Where voxels lie.
    oriented : Oriented
        Voxels of all.
    field : Field
        The canvas.
    gravity : (3,) ndarray of int
        Where down is; zero for none.

    Returns
    -------
    (m, 3) ndarray of int
        Their sites.

    Raises
    ------
    InputError
        If a grain finds no place.
    """
    parts = Parts(oriented.words, oriented.at, oriented.low, oriented.size)
    begin = len(oriented.at) - start.count

    def put_down(order: Integers, sites: Integers, ways: Integers) -> int:
        for k, grain in enumerate(order.tolist()):
            if find_near(field, parts, begin + grain, sites[grain], ways) < 0:
                for stands in order[:k].tolist():
                    # stamped once more it is gone
                    stamp_grain(field, parts, begin + stands, sites[stands])
                return grain
            stamp_grain(field, parts, begin + grain, sites[grain])
        return -1

    return stand_on_lattice(problem, start, lattice, gravity, put_down)


def _turned(mask: Booleans, matrix: Integers) -> Booleans:
    """Return a centered mask turned by a signed permutation of the axes about its middle corner."""
    axes = [int(np.flatnonzero(row)[0]) for row in matrix]
    turned = mask.transpose(axes)
    reversed_axes = tuple(axis for axis, row in enumerate(matrix) if row.sum() < 0)
    return np.flip(turned, reversed_axes) if reversed_axes else turned


def _cut(mask: Booleans) -> tuple[Booleans, Integers]:
    """Return the box of the taken voxels and its lowest voxel, counted from the corner at the middle."""
    filled = [np.flatnonzero(mask.any(axis=tuple(k for k in range(3) if k != axis))) for axis in range(3)]
    if not len(filled[0]):
        return np.zeros((0, 0, 0), dtype=np.bool_), np.zeros(3, dtype=np.int64)
    box = mask[tuple(slice(line[0], line[-1] + 1) for line in filled)]
    return np.ascontiguousarray(box), np.array([line[0] for line in filled]) - np.array(mask.shape) // 2
