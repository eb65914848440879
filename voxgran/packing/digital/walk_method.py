"""Digital packing: grains and container are voxels, and grains walk over the lattice one voxel at a time.

Each attempt picks a grain and moves it one voxel in one of 26 directions (8 in two dimensions) or turns it to another
orientation of its bank; the attempt is refused where a voxel would be occupied twice. Directions are equally likely, or
biased downward by gravity, with cycles of vibration in which upward moves are allowed and die away. Only voxels that a
move newly covers are tested, 64 at a time (:mod:`voxgran.packing.digital.stamping`), or pairs by tables where grains
are large and alike (:mod:`voxgran.packing.digital.no_fit_tables`). The cost of a move does not depend on how
complicated the shape is. With ``cover="touch"`` each grain is voxelized so that its voxels hold the whole grain: grains
that share no voxel then do not overlap, and the packing is free of overlaps between the true solids.

Orientations: each grain has its own random base orientations, and of each the 24 rotations that map the lattice onto
itself, which cost no voxelization. All turn about the centroid, which lies at a corner of the lattice and stays there.

Schedules: ``random`` picks any grain. ``sorted`` picks 256 times among 64 grains that lie near each other along a
curve through space (Morton 1966), then among the next 64, so that their voxels stay in the cache of the processor.
``sleeping`` passes over a grain that has not come lower in 128 attempts, until something near it has or a new cycle of
vibration begins. Each is a Markov chain of its own.

References
----------
Caulkin et al. 2008 (moves guided by collisions; known by author and year only).
Jia & Williams 2001, A packing algorithm for particles of arbitrary shapes, Powder Technology 120(3), 175-186,
doi:10.1016/S0032-5910(01)00268-6
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from voxgran._base.arrays import Floats, Integers, as_count, as_length, as_number
from voxgran._base.config import parameter
from voxgran._base.errors import InputError
from voxgran._base.rotation import product, quaternions_of
from voxgran._base.stopping import stop_if_asked
from voxgran.contacts.assembly import Assembly
from voxgran.packing.digital.attempts import enter_near, make_attempts, put
from voxgran.packing.digital.container_lattice import MOST_ORIENTATIONS, positions_on
from voxgran.packing.digital.cost import digital_cost
from voxgran.packing.digital.initial_sites import stand_on_lattice
from voxgran.packing.digital.precompute import (
    Setting,
    need_member,
    records,
    setting_of,
)
from voxgran.packing.digital.proposals import Rules, Turn
from voxgran.packing.digital.schedule import SORT_SWEEPS, look_at_turns, lower_lid_again, sort_grains, turn_arrays
from voxgran.packing.gravity import gravity_text, gravity_vector
from voxgran.packing.method import Cost, PackingMethod, State
from voxgran.packing.model import Packing
from voxgran.packing.problem import Problem
from voxgran.packing.start import Start
from voxgran.packing.walking.feeding import (
    MOST_SWEEPS,
    SETTLE_SWEEPS,
    check_cycles,
    cycles_of,
    entry_of,
    feed_share,
    look_at_queue,
    most_attempts,
    patience,
)
from voxgran.packing.walking.finishing import COUNTERS, Finishing, end_walk, finish_some, finishing_report

#: mean sinking in voxels per grain over such a look, below which the bed is settled
SETTLE_VOXELS = 0.02
#: cycles of vibration where neither their number nor their period is given
CYCLES = 24
#: what the kernel counts, in its order
TALLY = (
    "placed",
    "moves_accepted",
    "moves_tried",
    "turns_accepted",
    "turns_tried",
    "feeds_tried",
    "feeds_refused_in_a_row",
    "slept_through",
    "rows_read",
    "pairs_read",
)


@dataclass(frozen=True, kw_only=True, slots=True)
class Digital:
    """Parameters of digital packing.

    Raises
    ------
    InputError
        If a number is out of its range, `down` and `up` exceed 1 together, or options do not go together.
    """

    voxel_size: float | None = parameter(
        None, doc="edge of a voxel; left out: 1/32 of the median diameter", unit="length"
    )
    cover: Literal["touch", "center"] = parameter(
        "touch", doc="voxels that a grain takes: all that it touches, or those whose center it holds"
    )
    gravity: Literal["-x", "+x", "-y", "+y", "-z", "+z", "none"] | tuple[float, float, float] | None = parameter(
        None, doc="where down is, an axis or any vector; left out: -z, in two dimensions -y"
    )
    feed: Literal["rain", "layers", "at_once"] = parameter(
        "rain", doc="how grains enter: at the top while others walk, layer by layer, or anywhere at once"
    )
    rate: float = parameter(0.05, doc="share of attempts that let a grain enter, of rain")
    layer_sweeps: int = parameter(40, doc="sweeps in which a layer sinks before the next enters")
    sweeps: int = parameter(12000, doc="attempts per grain after all have entered", unit="attempts per grain")
    cycles: int | None = parameter(None, doc="cycles of vibration within the sweeps; left out: 24")
    period: int | None = parameter(None, doc="sweeps of a cycle, in place of their number", unit="attempts per grain")
    decay: float | None = parameter(
        None, doc="what a cycle keeps of the upward share of the one before; left out: it dies away evenly"
    )
    down: float = parameter(0.42, doc="share of moves that go downward where there is gravity")
    up: float = parameter(0.42, doc="share of moves that go upward at the start of the first cycle")
    turns: float = parameter(0.15, doc="share of attempts that turn a grain")
    orientations: int = parameter(
        96, doc="orientations in the bank of a grain, rounded up to whole sets of lattice rotations; 1: never turned"
    )
    guided: float = parameter(
        0.0, doc="share of moves after a refused one that go away from the contact that refused it"
    )
    schedule: Literal["random", "sorted", "sleeping"] = parameter("random", doc="whose turn it is")
    settling: int = parameter(
        0, doc="most sweeps in which the true shapes settle after the walk and close the gaps that voxels left"
    )
    friction: float = parameter(0.0, doc="coefficient of friction between grains, and at walls, while they settle")
    shaking: int = parameter(
        0, doc="sweeps in which each true shape is pulled and turned its own way before all settle; they come on top"
    )
    acceleration: float = parameter(0.8, doc="strength of the shaking at its start, in gravities; it dies away evenly")
    lid: bool = parameter(False, doc="whether a lid comes down on the bed, a voxel at a time where it finds room")

    def __post_init__(self) -> None:
        """Check the ranges."""
        if self.voxel_size is not None:
            as_length(self.voxel_size, "voxel_size")
        as_count(self.sweeps, "sweeps", at_most=MOST_SWEEPS)
        as_count(self.orientations, "orientations", at_least=1, at_most=MOST_ORIENTATIONS)
        as_number(self.turns, "turns", at_least=0.0, at_most=1.0)
        as_number(self.down, "down", at_least=0.0, at_most=1.0)
        as_number(self.up, "up", at_least=0.0, at_most=1.0)
        as_number(self.rate, "rate", above=0.0, at_most=1.0)
        as_count(self.layer_sweeps, "layer_sweeps", at_least=1, at_most=MOST_SWEEPS)
        as_number(self.guided, "guided", at_least=0.0, at_most=1.0)
        check_cycles(self.cycles, self.period)
        if self.decay is not None:
            as_number(self.decay, "decay", at_least=0.0, at_most=1.0)
        as_count(self.settling, "settling", at_most=MOST_SWEEPS)
        as_number(self.friction, "friction", at_least=0.0)
        as_count(self.shaking, "shaking", at_most=MOST_SWEEPS)
        as_number(self.acceleration, "acceleration", above=0.0)
        if self.friction and not self.settling:
            raise InputError(
                f"friction is {self.friction:g} and settling 0: it acts while grains settle; set settling, such as 200"
            )
        if self.shaking and not self.settling:
            raise InputError(
                f"shaking is {self.shaking} and settling 0: shaken grains have to settle; set settling, such as 200"
            )
        needs = {
            "lid is true": self.lid,
            "schedule is 'sleeping'": self.schedule == "sleeping",
            f"settling is {self.settling}": self.settling > 0,
        }
        for name, asked in needs.items():
            if asked and self.gravity == "none":
                raise InputError(f"{name} and gravity 'none': it needs to know where down is; choose a direction")
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
    gravity_vector(problem)
    n = problem.count
    arrays = {
        "site": np.zeros((n, 3), dtype=np.int64),
        "member": np.full(n, -1, dtype=np.int64),
        "turn": np.zeros(n, dtype=np.int64),
        "queue": np.arange(n, dtype=np.int64),
        "height": np.full(1, np.inf),
        "brim": np.zeros(2),
        "lid": np.zeros(1),
        **turn_arrays(problem),
    }
    counters = {**dict.fromkeys(TALLY, 0), "fed_at": -1, "layer_ends": -1, "layer_placed": 0, "lid_lowered": 0}
    counters |= COUNTERS
    state = State(arrays, counters, 0, most_attempts(problem, n))
    if n == 0:
        state.stop_reason = "count"
    if problem.start is not None and problem.start.count:
        _enter_start(problem, state, problem.start)
    return state


def _enter_start(problem: Problem, state: State, start: Start) -> None:
    """Put the grains of the start on the lattice, each as near to its place as there is room."""
    setting = setting_of(problem, state)
    upright = int(np.flatnonzero((setting.rotations == np.eye(3, dtype=np.int64)).all(axis=(1, 2)))[0])
    known = records(state, setting)

    def put_down(order: Integers, sites: Integers, ways: Integers) -> int:
        for k, grain in enumerate(order.tolist()):
            if enter_near(*known, grain, grain * setting.bases, upright, sites[grain], ways) < 0:
                for stands in order[:k].tolist():
                    # stamped once more it is gone
                    put(*known, state.derived["pairs"], stands)
                state.arrays["member"][order[:k]] = -1
                return grain
        return -1

    stand_on_lattice(problem, start, setting.lattice, setting.down, put_down)
    state.arrays["queue"] = start.queue(problem.count)
    state.counters["placed"] = start.count
    if start.count == problem.count:
        _look_at_queue(problem, state, setting, -1)


def advance(problem: Problem, state: State, attempts: int) -> State:
    """Make up to `attempts` attempts, first feeding, then shaking and settling."""
    if state.stop_reason:
        return state
    setting = setting_of(problem, state)
    if state.counters["lid_lowered"] and "lid" not in state.derived:
        lower_lid_again(problem, state, setting)
    last = state.done + attempts
    while state.done < last and not state.stop_reason:
        if state.counters["ended"] >= 0:
            entered = state.counters["placed"] == problem.count
            assembly = _assembly(problem, state, setting)
            finish_some(state, _finishing(problem, setting), assembly, last=last, entered=entered)
            # a sweep takes longer than any chunk of the walk
            return state
        due = _next_event(problem, state)
        _walk(problem, state, setting, min(last, due))
        if state.counters["fed_at"] < 0:
            _look_at_queue(problem, state, setting, due)
        elif state.done == due:
            look_at_turns(problem, state, setting)
            if (state.done - state.counters["fed_at"]) % _look_every(state) == 0:
                _look_at_bed(problem, state, setting)
    return state


def finish(problem: Problem, state: State) -> Packing:
    """Return the packing of the grains that entered."""
    setting = setting_of(problem, state)
    assembly = _assembly(problem, state, setting)
    provenance = {
        "parameters": {"gravity": gravity_text(problem)},
        "lid_lowered": _way_of_lid(problem, state, setting) * problem.unit_length,
        **finishing_report(state, assembly, setting.gravity),
    }
    placed = np.flatnonzero(state.arrays["member"] >= 0)
    return problem.packing(
        placed,
        position=assembly.position,
        orientation=assembly.orientation,
        provenance=provenance,
        voxel_size=setting.lattice.voxel_size,
        stop_reason=state.stop_reason,
        gravity=setting.gravity,
        contact_gap=setting.lattice.voxel_size,
    )


def _centroids(problem: Problem, state: State, setting: Setting) -> Floats:
    """Return where the grains that have entered are on the lattice, in the normalized frame."""
    return positions_on(setting.lattice, state.arrays["site"][state.arrays["member"] >= 0], problem.dimension)


def _assembly(problem: Problem, state: State, setting: Setting) -> Assembly:
    """Return the grains that have entered, in the normalized frame: where they settled, or on the lattice."""
    placed = np.flatnonzero(state.arrays["member"] >= 0)
    if state.counters["ended"] >= 0:
        position, orientation = state.arrays["position"], state.arrays["orientation"]
    else:
        turns = quaternions_of(setting.rotations[state.arrays["turn"][placed]].astype(np.float64))
        orientation = product(turns, setting.base[state.arrays["member"][placed]])
        position = _centroids(problem, state, setting)
    return Assembly(
        problem.shapes,
        problem.shape_id[placed],
        problem.diameter[placed],
        position.copy(),
        orientation.copy(),
        problem.container,
    )


def _finishing(problem: Problem, setting: Setting) -> Finishing:
    """Return what is asked for after the walk; voxels about their centers leave grains that overlap."""
    settings: Digital = problem.parameters
    return Finishing(
        parts=settings.settling > 0 and settings.cover != "touch",
        distance=0.0,
        settling=settings.settling,
        shaking=settings.shaking,
        acceleration=settings.acceleration,
        friction=settings.friction,
        step=setting.lattice.voxel_size / 2,
        gravity=setting.gravity,
        seed=problem.seed,
    )


def _way_of_lid(problem: Problem, state: State, setting: Setting) -> float:
    """Return how far the lid has come down, in median diameters."""
    if state.counters["ended"] >= 0:
        return float(state.arrays["lid"][0])
    lattice, lowered = setting.lattice, state.counters["lid_lowered"]
    if not lowered:
        return 0.0
    axis = int(np.argmax(np.abs(setting.down)))
    lower, upper = problem.container.bounds
    low = lattice.corner[axis] + lowered * lattice.voxel_size
    high = lattice.corner[axis] + (lattice.shape[axis] - lowered) * lattice.voxel_size
    return max(0.0, float(upper[axis] - high if setting.down[axis] < 0 else low - lower[axis]))


def _walk(problem: Problem, state: State, setting: Setting, last: int) -> None:
    """Run the kernel up to attempt `last`, or until the queue is empty or gives up."""
    settings: Digital = problem.parameters
    counters, arrays = state.counters, state.arrays
    attempts = max(settings.sweeps, 1) * max(counters["placed"], 1)
    turns = settings.turns if len(setting.turns) * setting.bases > 1 else 0.0
    decay = -1.0 if settings.decay is None else settings.decay
    rules = Rules(
        setting.directions,
        setting.classes,
        setting.down,
        entry_of(problem, setting.gravity),
        settings.feed == "at_once" or not setting.down.any(),
        np.array([settings.down, settings.up, turns, feed_share(problem, state), settings.guided, decay]),
        np.array([counters["fed_at"], attempts, cycles_of(problem, CYCLES), patience(problem)], dtype=np.int64),
    )
    names = ("order", "hint", "calm", "depth", "slept", "stirred", "cells")
    wanted = np.full(1, -1, dtype=np.int64)
    turn = Turn(**{name: arrays[name] for name in names}, wanted=wanted)
    tally = np.array([counters[name] for name in TALLY], dtype=np.int64)
    try:
        while True:
            known = *records(state, setting), state.derived["pairs"]
            state.done = int(make_attempts(*known, rules, turn, arrays["queue"], tally, setting.key, state.done, last))
            if wanted[0] < 0:
                break
            stop_if_asked()
            need_member(setting, int(wanted[0]))
            wanted[0] = -1
    finally:
        counters.update(zip(TALLY, tally.tolist(), strict=True))


def _look_every(state: State) -> int:
    """Return the attempts between two looks at the bed."""
    return SETTLE_SWEEPS * max(state.counters["placed"], 1)


def _next_event(problem: Problem, state: State) -> int:
    """Return the attempt at which something other than an attempt is due."""
    counters = state.counters
    if counters["fed_at"] < 0:
        return counters["layer_ends"] if counters["layer_ends"] >= 0 else np.iinfo(np.int64).max
    every = _look_every(state)
    if problem.parameters.lid:
        every = max(counters["placed"], 1)
    elif problem.parameters.schedule == "sorted":
        every = SORT_SWEEPS * max(counters["placed"], 1)
    into = state.done - counters["fed_at"]
    looks = _look_every(state)
    return counters["fed_at"] + min((into // every + 1) * every, (into // looks + 1) * looks)


def _look_at_queue(problem: Problem, state: State, setting: Setting, due: int) -> None:
    """End feeding when it is time, and then put the grains in order."""
    look_at_queue(problem, state, due, lambda: _centroids(problem, state, setting))
    if state.counters["fed_at"] >= 0:
        sort_grains(problem, state)


def _look_at_bed(problem: Problem, state: State, setting: Setting) -> None:
    """Stop when the bed no longer sinks after the last cycle, or when the attempts are used up."""
    placed = state.arrays["member"] >= 0
    height = -float((state.arrays["site"][placed] @ setting.gravity).sum())
    before = float(state.arrays["height"][0])
    state.arrays["height"] = np.array([height])
    shaken = state.done - state.counters["fed_at"] >= problem.parameters.sweeps * state.counters["placed"]
    calm = before - height <= SETTLE_VOXELS * state.counters["placed"] and before >= height
    entered = state.counters["placed"] == problem.count
    if shaken and (calm or not setting.gravity.any()):
        _end(problem, state, setting, "settled" if entered else "full")
    elif state.done >= state.total:
        _end(problem, state, setting, "steps" if entered else "full")


def _end(problem: Problem, state: State, setting: Setting, reason: str) -> None:
    """End the walk, and go on with the true shapes where that is asked for."""
    state.arrays["lid"][0] = _way_of_lid(problem, state, setting)
    placed = np.flatnonzero(state.arrays["member"] >= 0)
    end_walk(state, _finishing(problem, setting), _assembly(problem, state, setting), placed=placed, reason=reason)


def cost(problem: Problem) -> Cost:
    """Return what a run takes."""
    return digital_cost(problem)


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
    any_container=True,
)
