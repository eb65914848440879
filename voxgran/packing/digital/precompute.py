"""What follows from a problem for digital packing: lattice, canvas, bank of orientations, directions."""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from voxgran._base.arrays import Booleans, Floats, Integers, Words
from voxgran._base.rotation import lattice_rotations, random_rotations
from voxgran._base.seeds import philox_key, stream
from voxgran.containers.model import boundary_of
from voxgran.packing.digital.attempts import put
from voxgran.packing.digital.bit_columns import (
    Bank,
    Canvas,
    Field,
    aligned_words,
    empty_bank,
    grain_words,
    make_bank,
    row_length,
    write_turned,
)
from voxgran.packing.digital.container_lattice import ContainerLattice, container_lattice, free_voxels
from voxgran.packing.digital.no_fit_tables import make_tables, no_tables, table_bytes
from voxgran.packing.digital.records import Grains, Members
from voxgran.packing.digital.stamping import close_layer
from voxgran.packing.digital.state import DigitalState
from voxgran.packing.gravity import gravity_vector, main_axis
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
    """What follows from the problem.

    Attributes
    ----------
    lattice : ContainerLattice
        Where voxels lie.
    canvas : Canvas
        Where the packed occupancy lies.
    kind : (n,) ndarray of int
        Kind of each grain: grains of one shape and one diameter share their voxels; those of a start have their own.
    bank : Bank
        Voxels of all members: each kind in each of its base orientations.
    mask_of : callable
        Voxels of a member.
    zeros : int
        Words before the bits of the first grain.
    base : (kinds * bases, 4) ndarray of float
        Base orientations.
    bases : int
        How many each kind has.
    rotations : (r, 3, 3) ndarray of int
        Rotations of the lattice.
    turns : (r, 3) ndarray of int
        The same as signed permutations of the axes.
    directions, classes : ndarray of int
        Steps sorted downward, level, upward, and where these begin.
    gravity : (3,) ndarray of float
        Direction, 0 for none.
    down : (3,) ndarray of int
        The axis along which it is strongest, as a lattice vector.
    own : (n + 1,) ndarray of int
        Where the bits of each grain begin, where each has its own.
    shared : tuple of ndarray
        Bits of all members in all turns and where each begins; empty where they would take too much memory.
    key : ndarray of uint64
        Key of the random numbers.
    """

    lattice: ContainerLattice
    canvas: Canvas
    kind: Integers
    bank: Bank
    mask_of: Callable[[int], Booleans]
    zeros: int
    base: Floats
    bases: int
    rotations: Integers
    turns: Integers
    directions: Integers
    classes: Integers
    gravity: Floats
    down: Integers
    own: Integers
    shared: tuple[Words, Integers]
    key: Any

    @property
    def axis(self) -> int:
        """The axis along which gravity is strongest."""
        return int(np.argmax(np.abs(self.down)))


def precomputed_of(problem: Problem, state: DigitalState) -> Precomputed:
    """Return what follows from the problem, made again where the state is new or was read from a checkpoint.

    The canvas, with grains and lid, and the bits of the grains are then made again too.
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
        for member in np.unique(state.member[there]).tolist():
            need_member(known, member)
        field, members, grains = records(state, known)
        for grain in there.tolist():
            put(field, members, grains, derived["pairs"], grain)
        for lowered in range(state.lid_layers):
            close_layer(field, known.axis, layer_of_lid(known, lowered))
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
    guided moves, or a start. On a periodic axis no two images of a grain may come near the same neighbour.

    Parameters
    ----------
    problem : Problem
        What is asked for.
    shape : (3,) ndarray of int
        Voxels of the container.
    size, low : (m, 3) ndarray of int
        Extents and lowest voxels of all members.
    voxels : float
        Voxels of a member, on average.
    turns : int
        Rotations of the lattice that a member takes.
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


def records(state: DigitalState, known: Precomputed) -> tuple[Field, Members, Grains]:
    """Return canvas, bank and grains as the kernels take them."""
    _, words, deep = known.canvas.word_shape
    canvas, bank, derived = known.canvas, known.bank, state.derived
    field = Field(derived["words"], words * deep, deep, canvas.shape, canvas.margin, canvas.periodic)
    own = known.turns, known.bases, known.kind, known.shared[1]
    members = Members(bank.words, bank.start, bank.low, bank.size, *own)
    bits = (derived["bits"], derived["at"], known.own, derived["scratch"])
    return field, members, Grains(state.site, state.member, state.turn, *bits)


def voxel_size_of(problem: Problem) -> float:
    """Return the voxel size that is asked for, in median diameters."""
    asked = problem.parameters.voxel_size
    return 1 / 32 if asked is None else problem.length(asked)


def bases_of(problem: Problem) -> int:
    """Return how many base orientations each kind has."""
    whole = 24 if problem.dimension == 3 else 4
    return max(1, math.ceil(problem.parameters.orientations / whole))


def digital_kinds(problem: Problem) -> tuple[Integers, Integers]:
    """Return the kind of each grain, and a grain of each kind; grains of a start are kinds of their own.

    So that many grains of one kind do not all lie in few orientations, up to 16 kinds are made of one shape and size.
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
    several = np.where(sphere[problem.shape_id[n:]], 0, rank % 16)
    pairs = np.column_stack([same, several])
    _, first, inverse = np.unique(pairs, axis=0, return_index=True, return_inverse=True)
    return np.concatenate([np.arange(n), n + inverse.reshape(-1)]), np.concatenate([np.arange(n), n + first])


def mean_width(shape: Shape) -> float:
    """Return the width of a shape, averaged over directions, in its unit of lengths."""
    ways = np.array([way for way in itertools.product((-1, 0, 1), repeat=3) if way > (0, 0, 0)], dtype=np.float64)
    if shape.dimension == 2:
        ways = ways[ways[:, 2] == 0]
    along = shape.vertices @ (ways / np.linalg.norm(ways, axis=1, keepdims=True)).T
    return float(np.ptp(along, axis=0).mean())


def _make(problem: Problem) -> Precomputed:
    """Voxelize the grains and lay out the canvas."""
    lattice = container_lattice(problem, voxel_size_of(problem))
    rotations = lattice_rotations()
    if problem.dimension == 2:
        rotations = rotations[(rotations[:, 2, 2] == 1)]
    if problem.parameters.orientations == 1:
        rotations = rotations[:1]
    bases = bases_of(problem)
    kind, grains = digital_kinds(problem)
    base = _base_orientations(problem, len(grains) * bases)
    if problem.start is not None:
        # the first member of each grain is the pose that it starts in
        base[: problem.start.count * bases : bases] = problem.start.orientation

    def mask_of(member: int) -> Booleans:
        grain = int(grains[member // bases])
        return problem.voxels(grain, base[member], lattice.voxel_size, cover=problem.parameters.cover)

    lazy = bases >= LAZY
    bank = empty_bank(len(grains) * bases) if lazy else make_bank(len(grains) * bases, mask_of)
    most = _largest_sizes(problem, grains, lattice.voxel_size) if lazy else bank.size
    turns = np.array([[int(np.flatnonzero(row)[0]) + (3 if row.sum() < 0 else 0) for row in m] for m in rotations])
    periodic = np.array(problem.container.periodic, dtype=np.int64)
    margin = np.where(periodic, int(most.max(initial=1)) + 1, 1).astype(np.int64)
    directions, classes, gravity = _directions(problem)
    members = 1 if lazy else bases
    rows = np.array([_most_words(most[k * members : (k + 1) * members]) for k in range(len(grains))], dtype=np.int64)
    first = 16 + int(row_length.plain(int(most.max(initial=1))))  # zeros that missing words point to
    nothing = np.zeros(0, dtype=np.uint64), np.zeros(0, dtype=np.int64)
    shared = nothing if lazy else _shared_bits(bank, turns, first)
    alone = rows[kind] if not len(shared[1]) else np.zeros(problem.count, dtype=np.int64)
    own = first + np.concatenate([[0], np.cumsum(alone)]).astype(np.int64)
    canvas, key = Canvas(lattice.shape, margin, periodic), philox_key(problem.seed, "digital")
    return Precomputed(
        lattice, canvas, kind, bank, mask_of, first, base, bases, rotations, turns, directions, classes, gravity,
        main_axis(gravity), own, shared, key,
    )  # fmt: skip


def _largest_sizes(problem: Problem, grains: Integers, voxel_size: float) -> Integers:
    """Return extents (k, 3) that no orientation of a grain goes beyond."""
    radius = np.array([shape.bounding_radius for shape in problem.shapes])[problem.shape_id] * problem.diameter
    wide = 2 * np.ceil(radius[grains] / voxel_size).astype(np.int64) + 2
    tall = wide if problem.dimension == 3 else np.ones_like(wide)
    return np.column_stack([wide, wide, tall])


def _shared_bits(bank: Bank, turns: Integers, first: int) -> tuple[Words, Integers]:
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


def _base_orientations(problem: Problem, many: int) -> Floats:
    """Return the random base orientations of all members; in 2D about z."""
    generator = stream(problem.seed, "orientations")
    if problem.dimension == 3:
        return random_rotations(generator, many)
    half = np.pi * generator.random(many)
    return np.column_stack([np.cos(half), np.zeros((len(half), 2)), np.sin(half)])


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
    along = np.round(steps @ gravity, 12)
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
