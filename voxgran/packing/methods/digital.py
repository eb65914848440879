"""Digital packing: grains and container are voxels, and grains walk over the lattice one voxel at a time.

Each attempt picks a grain and moves it one voxel in one of 26 directions (8 in two dimensions) or turns it to another
orientation of its bank; the attempt is refused where a voxel would be occupied twice. Directions are equally likely,
or biased downward by gravity, with cycles of vibration in which upward moves are allowed and die away. Only voxels
that a move newly covers are tested, 64 at a time (:mod:`voxgran.packing.bits`). The cost of a move does not depend on
how complicated the shape is. With ``cover="touch"`` each grain is voxelized so that its voxels hold the whole grain:
grains that share no voxel then do not overlap, and the packing is free of overlaps between the true solids.

Orientations: each grain has its own random base orientations, and of each the 24 rotations that map the lattice onto
itself, which cost no voxelization.

References
----------
Jia & Williams 2001, A packing algorithm for particles of arbitrary shapes, Powder Technology 120(3), 175-186,
doi:10.1016/S0032-5910(01)00268-6
"""

import itertools
import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from voxgran._base.arrays import Booleans, Floats, Integers, as_count, as_number, as_positive
from voxgran._base.config import parameter
from voxgran._base.errors import InputError
from voxgran._base.rotation import lattice_rotations, product, quaternions_of, random_rotations
from voxgran._base.seeds import philox_key, stream
from voxgran.containers.box import Box
from voxgran.containers.rectangle import Rectangle
from voxgran.packing.bits import UNPACKED, Bank, Canvas, Field, make_bank
from voxgran.packing.lattice import (
    ContainerLattice,
    axis_of,
    container_lattice,
    free_voxels,
    packing_on_lattice,
)
from voxgran.packing.method import Cost, PackingMethod, State
from voxgran.packing.model import Packing
from voxgran.packing.problem import Problem
from voxgran.packing.start import Start, refuse_start, upward
from voxgran.packing.walk import Grains, Members, Rules, enter_raised, make_attempts, put
from voxgran.shapes.model import Shape

#: sweeps between two looks at whether the bed still sinks
SETTLE_SWEEPS = 200
#: mean sinking in voxels per grain over such a look, below which the bed is settled
SETTLE_VOXELS = 0.02
#: share of attempts that let a grain enter while some wait
FEED_SHARE = 0.05
#: what the kernel counts, in its order
TALLY = (
    "placed",
    "moves_accepted",
    "moves_tried",
    "turns_accepted",
    "turns_tried",
    "feeds_tried",
    "feeds_refused_in_a_row",
)


@dataclass(frozen=True, kw_only=True, slots=True)
class Digital:
    """Parameters of digital packing.

    Raises
    ------
    InputError
        If a number is out of its range, or `down` and `up` exceed 1 together.
    """

    voxel_size: float | None = parameter(
        None, doc="edge of a voxel; left out: 1/32 of the median diameter", unit="length"
    )
    cover: Literal["touch", "center"] = parameter(
        "touch", doc="voxels that a grain takes: all that it touches, or those whose center it holds"
    )
    gravity: Literal["-x", "+x", "-y", "+y", "-z", "+z", "none"] | None = parameter(
        None, doc="where down is; left out: -z, in two dimensions -y"
    )
    feed: Literal["rain", "at_once"] = parameter(
        "rain", doc="how grains enter: at the top while there is room, or anywhere at once"
    )
    sweeps: int = parameter(12000, doc="attempts per grain after all have entered", unit="attempts per grain")
    cycles: int = parameter(24, doc="cycles of vibration within the sweeps")
    down: float = parameter(0.42, doc="share of moves that go downward where there is gravity")
    up: float = parameter(0.42, doc="share of moves that go upward at the start of the first cycle")
    turns: float = parameter(0.15, doc="share of attempts that turn a grain")
    orientations: int = parameter(
        96, doc="orientations in the bank of a grain, rounded up to whole sets of lattice rotations; 1: never turned"
    )

    def __post_init__(self) -> None:
        """Check the ranges."""
        if self.voxel_size is not None:
            as_positive(self.voxel_size, "voxel_size")
        as_count(self.sweeps, "sweeps")
        as_count(self.cycles, "cycles", at_least=1)
        as_count(self.orientations, "orientations", at_least=1)
        as_number(self.turns, "turns", at_least=0.0, at_most=1.0)
        as_number(self.down, "down", at_least=0.0, at_most=1.0)
        as_number(self.up, "up", at_least=0.0, at_most=1.0)
        if self.down + self.up > 1.0:
            raise InputError(f"down + up is {self.down + self.up:g}: shares must not exceed 1; lower one of them")


def prepare(problem: Problem) -> State:
    """Return the state in which all grains wait outside.

    Raises
    ------
    InputError
        If gravity points along a periodic axis, no voxel size fits the periodic lengths, or a grain of the start finds
        no place.
    """
    settings: Digital = problem.parameters
    _gravity(problem)
    n = problem.count
    arrays = {
        "site": np.zeros((n, 3), dtype=np.int64),
        "member": np.full(n, -1, dtype=np.int64),
        "turn": np.zeros(n, dtype=np.int64),
        "queue": np.arange(n, dtype=np.int64),
        "height": np.full(1, np.iinfo(np.int64).max),
    }
    counters = {**dict.fromkeys(TALLY, 0), "fed_at": -1}
    total = n * (settings.sweeps + 40 * SETTLE_SWEEPS)
    state = State(arrays, counters, 0, total)
    if n == 0:
        state.stop_reason = "count"
    if problem.start is not None and problem.start.count:
        _enter_start(problem, state, problem.start)
    return state


def _enter_start(problem: Problem, state: State, start: Start) -> None:
    """Put the grains of the start on the lattice, each as little above its place as it needs to be."""
    setting, gravity = _setting(problem, state), _gravity(problem)
    lattice, up = setting.lattice, upward(gravity, problem.dimension)
    upright = int(np.flatnonzero((setting.rotations == np.eye(3, dtype=np.int64)).all(axis=(1, 2)))[0])
    sites = np.rint((start.position - lattice.corner) / lattice.voxel_size).astype(np.int64)
    records = _records(state, setting)
    for grain in start.rising(gravity).tolist():
        if enter_raised(*records, grain, grain * setting.bases, upright, sites[grain], up) < 0:
            refuse_start(grain)
    state.arrays["queue"] = start.queue(problem.count)
    state.counters["placed"] = start.count
    if start.count == problem.count:
        _look_at_queue(problem, state)


def advance(problem: Problem, state: State, attempts: int) -> State:
    """Make up to `attempts` attempts, first feeding, then shaking and settling."""
    if state.stop_reason:
        return state
    setting = _setting(problem, state)
    last = state.done + attempts
    while state.done < last and not state.stop_reason:
        if state.counters["fed_at"] < 0:
            _walk(problem, state, setting, last)
            _look_at_queue(problem, state)
        else:
            into = state.done - state.counters["fed_at"]
            period = SETTLE_SWEEPS * max(state.counters["placed"], 1)
            look = state.counters["fed_at"] + (into // period + 1) * period
            _walk(problem, state, setting, min(last, look))
            if state.done == look:
                _look_at_bed(problem, state)
    return state


def finish(problem: Problem, state: State) -> Packing:
    """Return the packing of the grains that entered."""
    setting = _setting(problem, state)
    placed = np.flatnonzero(state.arrays["member"] >= 0)
    lattice = setting.lattice
    turns = quaternions_of(setting.rotations[state.arrays["turn"][placed]].astype(np.float64))
    return packing_on_lattice(
        problem,
        lattice,
        placed,
        site=state.arrays["site"][placed],
        orientation=product(turns, setting.base[state.arrays["member"][placed]]),
        provenance={"parameters": {"gravity": problem.parameters.gravity or _default_gravity(problem)}},
        stop_reason=state.stop_reason,
    )


def cost(problem: Problem) -> Cost:
    """Return what a run takes."""
    settings: Digital = problem.parameters
    lattice = container_lattice(problem, _voxel_size(problem))
    width = np.array([_mean_width(shape) for shape in problem.shapes])[problem.shape_id] * problem.diameter
    radius = np.array([shape.bounding_radius for shape in problem.shapes])[problem.shape_id] * problem.diameter
    wide, half = width / lattice.voxel_size + 2, np.ceil(radius / lattice.voxel_size) + 1
    tall = wide if problem.dimension == 3 else np.ones_like(wide)
    members = _bases(problem)
    # each member along each axis, in pieces and then joined; and the bits of each grain where it lies
    bank = (2 * 3 * members + 1) * 8 * float((wide * wide * (tall / 64 + 0.5)).sum())
    masks = float(((2 * half) ** problem.dimension).mean()) if problem.count else 0.0
    kept = min(problem.byte_limit, problem.different_voxels(members) * masks)
    largest = 2 * float(radius.max(initial=0.0)) / lattice.voxel_size + 4
    margin = np.where(np.array(problem.container.periodic), largest, 1.0)
    canvas = float(np.prod(lattice.shape + 2 * margin + np.array([0, 0, 64]))) / 8
    # what is free is found voxel by voxel where the walls are not those of the lattice
    even = isinstance(problem.container, Box | Rectangle)
    unpacked = 4 * UNPACKED + (0.0 if even else 2.5 * float(np.prod(lattice.shape)))
    return Cost(
        memory=int(canvas + unpacked + bank + kept),
        attempts=problem.count * (settings.sweeps + 40 * SETTLE_SWEEPS),
        voxelized_shapes=problem.different_voxels(members),
    )


def _mean_width(shape: Shape) -> float:
    """Return the width of a shape, averaged over directions, in its unit of lengths."""
    ways = np.array([way for way in itertools.product((-1, 0, 1), repeat=3) if way > (0, 0, 0)], dtype=np.float64)
    if shape.dimension == 2:
        ways = ways[ways[:, 2] == 0]
    along = shape.vertices @ (ways / np.linalg.norm(ways, axis=1, keepdims=True)).T
    return float(np.ptp(along, axis=0).mean())


@dataclass(frozen=True, slots=True)
class _Setting:
    """What follows from the problem: the lattice, the bank, the directions."""

    lattice: ContainerLattice
    canvas: Canvas
    bank: Bank
    base: Floats
    bases: int
    rotations: Integers
    turns: Integers
    directions: Integers
    classes: Integers
    gravity: Integers
    capacity: Integers
    key: Any


def _setting(problem: Problem, state: State) -> _Setting:
    """Return the setting, made again with canvas and bits where the state was just made or read from a checkpoint."""
    if "setting" not in state.derived:
        setting = _make_setting(problem)
        state.derived["setting"] = setting
        state.derived["words"] = setting.canvas.words(free_voxels(problem.container, setting.lattice))
        largest = int(setting.bank.size.max(initial=1)) + 2
        state.derived["bits"] = np.zeros(max(int(setting.capacity[-1]), largest), dtype=np.uint64)
        state.derived["scratch"] = np.zeros(largest + _most_words(setting.bank.size), dtype=np.uint64)
        _stamp_all(state, setting)
    made: _Setting = state.derived["setting"]
    return made


def _make_setting(problem: Problem) -> _Setting:
    """Voxelize the grains and lay out the canvas."""
    settings: Digital = problem.parameters
    lattice = container_lattice(problem, _voxel_size(problem))
    rotations = lattice_rotations()
    if problem.dimension == 2:
        rotations = rotations[(rotations[:, 2, 2] == 1)]
    if settings.orientations == 1:
        rotations = rotations[:1]
    bases = _bases(problem)
    base = _base_orientations(problem, bases)
    if problem.start is not None:
        # the first member of each grain is the pose that it starts in
        base[: problem.start.count * bases : bases] = problem.start.orientation

    def mask_of(member: int) -> Booleans:
        return problem.voxels(member // bases, base[member], lattice.voxel_size, cover=settings.cover)

    bank = make_bank(problem.count * bases, mask_of)
    turns = np.array([[int(np.flatnonzero(row)[0]) + (3 if row.sum() < 0 else 0) for row in m] for m in rotations])
    periodic = np.array(problem.container.periodic, dtype=np.int64)
    margin = np.where(periodic, int(bank.size.max(initial=1)) + 1, 1).astype(np.int64)
    directions, classes, gravity = _directions(problem)
    rows = np.array([_most_words(bank.size[g * bases : (g + 1) * bases]) for g in range(problem.count)], dtype=np.int64)
    first = int(bank.size.max(initial=1)) + 2  # a row of zeros that missing words point to
    capacity = first + np.concatenate([[0], np.cumsum(rows)])
    canvas = Canvas(lattice.shape, margin, periodic)
    key = philox_key(problem.seed, "digital")
    return _Setting(lattice, canvas, bank, base, bases, rotations, turns, directions, classes, gravity, capacity, key)


def _voxel_size(problem: Problem) -> float:
    """Return the voxel size that is asked for, in median diameters."""
    asked = problem.parameters.voxel_size
    return 1 / 32 if asked is None else problem.length(asked)


def _bases(problem: Problem) -> int:
    """Return how many base orientations each grain has."""
    whole = 24 if problem.dimension == 3 else 4
    return max(1, math.ceil(problem.parameters.orientations / whole))


def _base_orientations(problem: Problem, bases: int) -> Floats:
    """Return the random base orientations of all members, (n * bases, 4); in 2D about z."""
    generator = stream(problem.seed, "orientations")
    if problem.dimension == 3:
        return random_rotations(generator, problem.count * bases)
    half = np.pi * generator.random(problem.count * bases)
    return np.column_stack([np.cos(half), np.zeros((len(half), 2)), np.sin(half)])


def _most_words(size: Integers) -> int:
    """Return the words that the largest rotation of these members takes, ring included."""
    most = 0
    for a, b, c in itertools.permutations(range(3)):
        need = (size[:, a] + 2) * (size[:, b] + 2) * -(-size[:, c] // 64)
        most = max(most, int(need.max(initial=0)))
    return most


def _default_gravity(problem: Problem) -> str:
    """Return where down is when nothing is said."""
    return "-z" if problem.dimension == 3 else "-y"


def _gravity(problem: Problem) -> Integers:
    """Return the direction of gravity as a lattice vector; zero where there is none."""
    return axis_of(problem.parameters.gravity or _default_gravity(problem), problem.container)


def _directions(problem: Problem) -> tuple[Integers, Integers, Integers]:
    """Return the directions sorted downward, level, upward; where the classes begin; the gravity vector."""
    steps = np.array([d for d in itertools.product((-1, 0, 1), repeat=3) if any(d)], dtype=np.int64)
    if problem.dimension == 2:
        steps = steps[steps[:, 2] == 0]
    gravity = _gravity(problem)
    order = np.argsort(-(steps @ gravity), kind="stable")
    along = (steps @ gravity)[order]
    bounds = np.array([0, int((along > 0).sum()), int((along >= 0).sum()), len(steps)], dtype=np.int64)
    return steps[order], bounds, gravity


def _stamp_all(state: State, setting: _Setting) -> None:
    """Put the grains that have entered onto an empty canvas."""
    field, members, grains = _records(state, setting)
    for grain in np.flatnonzero(state.arrays["member"] >= 0):
        put(field, members, grains, int(grain))


def _records(state: State, setting: _Setting) -> tuple[Field, Members, Grains]:
    """Return canvas, bank and grains as the kernels take them."""
    _, words, deep = setting.canvas.word_shape
    canvas, bank, arrays = setting.canvas, setting.bank, state.arrays
    field = Field(state.derived["words"], words * deep, deep, canvas.shape, canvas.margin, canvas.periodic)
    members = Members(bank.words, bank.start, bank.low, bank.size, setting.turns, setting.bases)
    where = (arrays["site"], arrays["member"], arrays["turn"])
    return field, members, Grains(*where, state.derived["bits"], setting.capacity, state.derived["scratch"])


def _walk(problem: Problem, state: State, setting: _Setting, last: int) -> None:
    """Run the kernel up to attempt `last`, or until the queue is empty or gives up."""
    settings: Digital = problem.parameters
    counters = state.counters
    attempts = max(settings.sweeps, 1) * max(counters["placed"], 1)
    turns = settings.turns if len(setting.turns) * setting.bases > 1 else 0.0
    rules = Rules(
        setting.directions,
        setting.classes,
        setting.gravity,
        settings.feed == "at_once" or not setting.gravity.any(),
        np.array([settings.down, settings.up, turns, FEED_SHARE]),
        np.array([counters["fed_at"], attempts, settings.cycles, _patience(problem)], dtype=np.int64),
    )
    tally = np.array([counters[name] for name in TALLY], dtype=np.int64)
    records = _records(state, setting)
    state.done = int(make_attempts(*records, rules, state.arrays["queue"], tally, setting.key, state.done, last))
    counters.update(zip(TALLY, tally.tolist(), strict=True))


def _patience(problem: Problem) -> int:
    """Return after how many refusals in a row the container counts as full."""
    return max(2000, 20 * problem.count)


def _look_at_queue(problem: Problem, state: State) -> None:
    """End feeding when all have entered, or when nothing enters any more."""
    counters = state.counters
    full = counters["feeds_refused_in_a_row"] >= _patience(problem)
    if counters["placed"] == problem.count or full:
        counters["fed_at"] = state.done
        state.total = state.done + counters["placed"] * (problem.parameters.sweeps + 40 * SETTLE_SWEEPS)
        if counters["placed"] == 0:
            state.stop_reason = "full"


def _look_at_bed(problem: Problem, state: State) -> None:
    """Stop when the bed no longer sinks after the last cycle, or when the attempts are used up."""
    placed = state.arrays["member"] >= 0
    height = int(-(state.arrays["site"][placed] @ _gravity(problem)).sum())
    before = int(state.arrays["height"][0])
    state.arrays["height"] = np.array([height])
    shaken = state.done - state.counters["fed_at"] >= problem.parameters.sweeps * state.counters["placed"]
    calm = before - height <= SETTLE_VOXELS * state.counters["placed"] and before >= height
    entered = state.counters["placed"] == problem.count
    if shaken and (calm or not _gravity(problem).any()):
        state.stop_reason = "settled" if entered else "full"
    elif state.done >= state.total:
        state.stop_reason = "steps" if entered else "full"


registration = PackingMethod(
    name="digital",
    summary="grains as voxels walk over a lattice, one voxel at a time, under gravity and vibration",
    source="Jia & Williams 2001, doi:10.1016/S0032-5910(01)00268-6",
    parameters=Digital,
    prepare=prepare,
    advance=advance,
    finish=finish,
    cost=cost,
    dimensions=(2, 3),
)
