"""What follows from a problem for digital packing: lattice, canvas, bank of orientations, directions."""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Booleans, Floats, Integers, Words
from voxgran._base.errors import CheckpointError
from voxgran._base.seeds import philox_key
from voxgran.containers.gravity import gravity_vector, main_axis
from voxgran.containers.model import boundary_of
from voxgran.packing.digital.attempts import put
from voxgran.packing.digital.bit_columns import (
    BankRecord,
    Bed,
    Canvas,
    Grains,
    VoxelBank,
    aligned_words,
    grain_words,
    row_length,
    signed_axes,
    turned_box,
    write_turned,
)
from voxgran.packing.digital.container_lattice import ContainerLattice, container_lattice, free_voxels
from voxgran.packing.digital.no_fit_tables import make_tables, no_tables, table_bytes
from voxgran.packing.digital.oriented_voxels import lattice_turns, random_poses
from voxgran.packing.digital.stamping import close_layer
from voxgran.packing.digital.state import DigitalState
from voxgran.packing.problem import Problem
from voxgran.shapes.model import Shape

#: voxels of a grain from which on tables of pairs are faster than columns, and the memory that they may take
TABLE_VOXELS, TABLE_BYTES = 30_000, 2**26
#: base orientations of a kind from which on they are voxelized when they are needed
LAZY = 32
#: words that the bits of all members in all turns may take together, for all grains to share them
SHARED = 2**21


@dataclass(frozen=True, slots=True)
class Precomputed:
    """What follows from the problem."""

    lattice: ContainerLattice
    canvas: Canvas
    kind: Integers  # (n,): grains of one shape and one diameter share their voxels; those of a start have their own
    bank: VoxelBank  # each kind in each of its base orientations
    mask_of: Callable[[int], Booleans]  # voxels of a member
    zeros: int  # words before the bits of the first grain
    base: Floats  # (kinds * bases, 4): base orientations
    bases: int  # how many each kind has
    rotations: Integers  # (r, 3, 3): rotations of the lattice
    turns: Integers  # (r, 3): the same as signed permutations of the axes
    directions: Integers  # steps sorted downward, level, upward
    classes: Integers  # where these begin
    gravity: Floats  # (3,): direction, 0 for none
    down: Integers  # (3,): the axis along which it is strongest, as a lattice vector
    own: Integers  # (n + 1,): where the bits of each grain begin, where each has its own
    shared: tuple[Words, Integers]  # bits of all members in all turns, where each begins; empty if they are too many
    key: Any  # of the random numbers

    @property
    def axis(self) -> int:
        """The axis along which gravity is strongest."""
        return int(np.argmax(np.abs(self.down)))


def precomputed_of(problem: Problem, state: DigitalState) -> Precomputed:
    """Return what follows from the problem, made again where the state is new or was read from a checkpoint.

    The canvas, with grains and lid, and the bits of the grains are then made again too.

    Raises
    ------
    CheckpointError
        If a checkpoint has grains of other shapes, or beyond a wall.
    """
    if "precomputed" not in state.derived:
        known = _make(problem)
        derived, bank, shape = state.derived, known.bank, known.lattice.shape
        full = len(bank.size) > 0 and not (bank.start < 0).any()
        tables = full and tables_pay(
            problem, shape, size=bank.size, low=bank.low, voxels=float(bank.voxels.mean()), turns=len(known.turns)
        )
        walls = None if tables else free_voxels(problem.container, known.lattice)
        bits, alone = known.shared[0], not len(known.shared[1])
        longest = int(np.diff(known.own).max(initial=0)) if alone else _most_words(bank.size)
        derived |= {
            "precomputed": known,
            "pairs": make_tables(bank, known.rotations, known.turns, shape, problem.count) if tables else no_tables(),
            "words": np.zeros(0, dtype=np.uint64) if tables else known.canvas.words(walls),
            "bits": aligned_words(max(int(known.own[-1]), known.zeros)) if alone else bits,
            "scratch": aligned_words(known.zeros + longest),
            "at": known.own[:-1].copy(),
        }
        there = np.flatnonzero(state.member >= 0)
        if (state.member[there] // known.bases != known.kind[there]).any():
            raise CheckpointError("'member' of the checkpoint has grains of other shapes: start anew without it")
        for member in np.unique(state.member[there]).tolist():
            need_member(known, member)
        bed = records(state, known)
        for grain in there.tolist():
            member, turn = int(state.member[grain]), known.turns[int(state.turn[grain])]
            low, size = (np.array(side) for side in turned_box(bank.low[member], bank.size[member], turn))
            low += state.site[grain]
            if not (((low >= 0) & (low + size <= shape)) | np.array(problem.container.periodic)).all():
                raise CheckpointError("'site' of the checkpoint has grains beyond a wall: start anew without it")
            put(bed, derived["pairs"], grain)
        for lowered in range(state.lid_layers):
            close_layer(bed.field, known.axis, layer_of_lid(known, lowered))
    made: Precomputed = state.derived["precomputed"]
    return made


def need_member(known: Precomputed, member: int) -> None:
    """Voxelize a member of the bank where that was not yet done."""
    if known.bank.start[member, 0] < 0:
        known.bank.add(member, known.mask_of(member))


def tables_pay(problem: Problem, shape: Integers, *, size: Integers, low: Integers, voxels: float, turns: int) -> bool:
    """Return whether pairs get tables in place of the occupancy.

    They do where grains have as many voxels as a test by columns costs more than some neighbours by bits, the tables
    take little memory, and nothing is asked for that looks at the occupancy itself: walls that are not flat, a lid,
    guided moves, or a start. On a periodic axis no two images of a grain may come near the same neighbour. `shape` are
    the voxels of the container, `size` and `low` (m, 3) extents and lowest voxels of all members, `voxels` the mean
    number of voxels of one, `turns` the number of its rotations.
    """
    settings = problem.parameters
    if settings.lid or settings.guided > 0 or problem.start is not None:
        return False
    if not boundary_of(problem.container).is_flat or voxels < TABLE_VOXELS:
        return False
    # a table has a word at the least; many members are not even multiplied out
    if 8 * turns * len(size) ** 2 > TABLE_BYTES or table_bytes(size, turns) > TABLE_BYTES:
        return False
    around = 2 * (int(size.max()) + int(np.abs(low).max()))
    return bool((shape >= around)[np.array(problem.container.periodic)].all())


def records(state: DigitalState, known: Precomputed) -> Bed:
    """Return canvas, bank and grains as the kernels take them."""
    bank, derived = known.bank, state.derived
    own = known.turns, known.bases, known.kind, known.shared[1]
    members = BankRecord(bank.words, bank.start, bank.low, bank.size, *own)
    bits = (derived["bits"], derived["at"], known.own, derived["scratch"])
    return Bed(known.canvas.field(derived["words"]), members, Grains(state.site, state.member, state.turn, *bits))


def bases_of(problem: Problem) -> int:
    """Return how many base orientations each kind has."""
    if problem.orientation is not None:
        return 1
    whole = 24 if problem.dimension == 3 else 4
    return max(1, math.ceil(problem.parameters.orientations / whole))


def digital_kinds(problem: Problem) -> tuple[Integers, Integers]:
    """Return the kind of each grain, and a grain of each kind; grains of a start are kinds of their own.

    So that many grains of one kind do not all lie in few orientations, up to 16 kinds are made of one shape and size,
    and one for each grain where orientations are asked for.
    """
    n = 0 if problem.start is None else problem.start.count
    rest = np.column_stack([problem.shape_id[n:], problem.diameter[n:]])
    if not len(rest):
        return np.arange(n, dtype=np.int64), np.arange(n, dtype=np.int64)
    sphere = np.array([shape.is_sphere for shape in problem.shapes], dtype=np.bool_)
    _, same = np.unique(rest, axis=0, return_inverse=True)
    same = same.reshape(-1)
    order = np.argsort(same, kind="stable")
    rank = np.empty_like(order)
    begin = np.searchsorted(same[order], same[order])
    rank[order] = np.arange(len(order)) - begin
    several = np.where(sphere[problem.shape_id[n:]], 0, rank if problem.orientation is not None else rank % 16)
    pairs = np.column_stack([same, several])
    _, first, inverse = np.unique(pairs, axis=0, return_index=True, return_inverse=True)
    return np.concatenate([np.arange(n), n + inverse.reshape(-1)]), np.concatenate([np.arange(n), n + first])


def mean_width(shape: Shape) -> float:
    """Return the width of a shape, averaged over directions, in its unit of lengths."""
    ways = np.array([way for way in itertools.product((-1, 0, 1), repeat=3) if way > (0, 0, 0)], dtype=np.float64)
    if shape.dimension == 2:
        ways = ways[ways[:, 2] == 0]
    along = linear.matmul(shape.vertices, (ways / linear.norm(ways, axis=1, keepdims=True)).T)
    return float(np.ptp(along, axis=0).mean())


def _make(problem: Problem) -> Precomputed:
    """Voxelize the grains and lay out the canvas."""
    lattice = container_lattice(problem)
    rotations = lattice_turns(problem)
    if problem.parameters.orientations == 1:
        rotations = rotations[:1]
    bases = bases_of(problem)
    kind, grains = digital_kinds(problem)
    base = random_poses(problem, len(grains) * bases)
    if problem.orientation is not None:
        base = problem.orientation[grains]
    elif problem.start is not None:
        # the first member of each grain is the pose that it starts in
        base[: problem.start.count * bases : bases] = problem.start.orientation

    def mask_of(member: int) -> Booleans:
        grain = int(grains[member // bases])
        return problem.voxels(grain, base[member], lattice.voxel_size, cover=problem.parameters.cover)

    lazy = bases >= LAZY
    bank = VoxelBank.empty(len(grains) * bases) if lazy else VoxelBank.from_masks(len(grains) * bases, mask_of)
    most = _largest_sizes(problem, grains, lattice.voxel_size) if lazy else bank.size
    turns, canvas = signed_axes(rotations), Canvas.for_grains(lattice.shape, problem.container.periodic, most)
    directions, classes, gravity = _directions(problem)
    members = 1 if lazy else bases
    rows = np.array([_most_words(most[k * members : (k + 1) * members]) for k in range(len(grains))], dtype=np.int64)
    first = 16 + int(row_length.plain(int(most.max(initial=1))))  # zeros that missing words point to
    nothing = np.zeros(0, dtype=np.uint64), np.zeros(0, dtype=np.int64)
    shared = nothing if lazy else _shared_bits(bank, turns, first)
    alone = rows[kind] if not len(shared[1]) else np.zeros(problem.count, dtype=np.int64)
    own = first + np.concatenate([[0], np.cumsum(alone)]).astype(np.int64)
    return Precomputed(
        lattice, canvas, kind, bank, mask_of, first, base, bases, rotations, turns, directions, classes, gravity,
        main_axis(gravity), own, shared, philox_key(problem.seed, "digital"),
    )  # fmt: skip


def _largest_sizes(problem: Problem, grains: Integers, voxel_size: float) -> Integers:
    """Return extents (k, 3) that no orientation of a grain goes beyond."""
    radius = problem.bounding_radii
    wide = 2 * np.ceil(radius[grains] / voxel_size).astype(np.int64) + 2
    tall = wide if problem.dimension == 3 else np.ones_like(wide)
    return np.column_stack([wide, wide, tall])


def _shared_bits(bank: VoxelBank, turns: Integers, first: int) -> tuple[Words, Integers]:
    """Return the bits of all members in all turns after some zeros, and where they begin; nothing where it is much."""
    size = bank.size + 2
    volume = size.prod(axis=1) // 64 + size.max(axis=1, initial=0) ** 2
    if int(volume.sum()) * len(turns) > SHARED:
        return np.zeros(0, dtype=np.uint64), np.zeros(0, dtype=np.int64)
    at, begin = np.zeros(len(bank.size) * len(turns), dtype=np.int64), first
    for member, extent in enumerate(bank.size):
        for t, turn in enumerate(turns % 3):
            wide, deep, tall = extent[turn]
            at[member * len(turns) + t] = begin
            begin += int(grain_words((wide, deep, tall)))
    words = aligned_words(max(begin, first))
    for k, place in enumerate(at):
        member, t = divmod(k, len(turns))
        write_turned(bank.words, bank.start[member], bank.size[member], turns[t], words, int(place))
    return words, at


def _most_words(size: Integers) -> int:
    """Return the words that the largest rotation of these members takes, ring included."""
    most = 0
    for a, b, c in itertools.permutations(range(3)):
        need = (size[:, a] + 2) * row_length.plain(size[:, b]) * -(-size[:, c] // 64)
        most = max(most, int(need.max(initial=0)))
    return most


def _directions(problem: Problem) -> tuple[Integers, Integers, Floats]:
    """Return the directions sorted downward, level, upward; where the classes begin; the gravity vector."""
    steps = np.array([d for d in itertools.product((-1, 0, 1), repeat=3) if any(d)], dtype=np.int64)
    if problem.dimension == 2:
        steps = steps[steps[:, 2] == 0]
    gravity = gravity_vector(problem)
    along = np.round(linear.matmul(steps, gravity), 12)
    order = np.argsort(-np.sign(along), kind="stable")
    bounds = np.array([0, int((along > 0).sum()), int((along >= 0).sum()), len(steps)], dtype=np.int64)
    return steps[order], bounds, gravity


def layer_of_lid(known: Precomputed, lowered: int) -> int:
    """Return the layer of voxels that the lid takes next, after it has taken some."""
    return int(known.lattice.shape[known.axis]) - 1 - lowered if known.down[known.axis] < 0 else lowered


def walls_of_layers(problem: Problem, known: Precomputed) -> Integers:
    """Return how many voxels of each layer across gravity are taken by the walls alone."""
    taken = known.canvas.occupied(known.canvas.words(free_voxels(problem.container, known.lattice)))
    return np.asarray(taken.sum(axis=tuple(k for k in range(3) if k != known.axis)), dtype=np.int64)
