"""Control-point packing: grains are points on their surfaces, and move through space by small random steps.

Each attempt picks a grain, moves it by a random unit vector times a step, and turns it by a small random rotation. The
attempt is refused where it would reach through a wall, or come too near to another grain by one of two tests. With
the contact "sdf" the control points of each grain are looked up in the signed distance of the other, so that grains
touch; with "kdtree" they are compared with the control points of the other in a KD-tree, and contacts stay open by up
to the spacing. Gravity tilts the steps downward, with cycles of vibration in which upward steps are kept and die away.
Each grain lengthens its steps when it moves freely and shortens them when it is caught.

Grains enter as rain at a rate, in layers that each sink before the next, or anywhere at once. A lid is a wall against
gravity: after each attempt per grain it comes down by 1/32 of the median diameter or to the nearest grain, and the walk
ends no sooner than it lies on the bed.

The points cover the surface and, where all are asked for, the inside. Compared with points, surfaces cannot cross
between them. In signed distances a smooth surface can bulge between its points by no more than its curvature allows,
which is added to the distance, so spheres and ellipsoids never overlap; what sharp edges overlap between points, less
than half the spacing, is parted exactly after the walk. Steps are so short, and thin grains kept so far, that none can
pass through another. No voxels are made, so grains may have any place and any orientation; the cost of a move grows
with the points near a contact only.

Open surfaces have no inside: they are packed with points against points only, and neither settle nor overlap. In a bed
with any of them all points keep five percent more, and steps are so short that none leads through a surface.

References
----------
Sajjadi & Khalili 2015, Generating, Reproducing and Packaging of Random Volumes for Discrete Element Analysis of
Discontinuous Materials, section 5-2: surfaces as control points, moved at random under gravity and compared by nearest
neighbours
"""

import warnings
from dataclasses import dataclass
from typing import Literal

import numpy as np

from voxgran._base.arrays import Floats, Integers, as_count, as_number, as_positive
from voxgran._base.config import parameter
from voxgran._base.errors import InputError
from voxgran._base.rotation import normalized
from voxgran.contacts.assembly import Assembly
from voxgran.packing.control_point.attempts import enter_raised, make_attempts
from voxgran.packing.control_point.checks import check_distance, check_overlap, check_surfaces
from voxgran.packing.control_point.precompute import Setting, bed_of, memory_needed, setting_of
from voxgran.packing.control_point.records import Rules
from voxgran.packing.control_point.schedule import lid_rests, lower_lid, next_event
from voxgran.packing.gravity import gravity_text, gravity_vector, main_axis, upward
from voxgran.packing.method import Cost, PackingMethod, State
from voxgran.packing.model import Packing
from voxgran.packing.problem import Problem, stands_free
from voxgran.packing.start import Start, refuse_start
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
from voxgran.shapes.descriptors import largest_curvature

#: mean sinking in median diameters per grain over such a look, below which the bed is settled
SETTLE_DEPTH = 0.001
#: shortest step, in diameters of the grain
SHORTEST_STEP = 0.002
#: cycles of vibration where neither their number nor their period is given
CYCLES = 8
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
class ControlPoint:
    """Parameters of control-point packing.

    Raises
    ------
    InputError
        If a number is out of its range, or parameters do not go together.
    """

    spacing: float = parameter(
        0.12,
        doc="spacing of the control points on a grain; contacts stay open by up to this",
        unit="diameters of the grain",
    )
    contact: Literal["sdf", "points", "kdtree"] = parameter(
        "sdf",
        doc="how grains are compared: control points with the signed distance of the other grain (sdf), or with its "
        "control points in a KD-tree (kdtree; points is its old name)",
    )
    points: Literal["surface", "all"] = parameter(
        "surface", doc="where control points lie: on the surface, its edges and corners, or as densely inside as well"
    )
    ways: Literal["both", "one"] = parameter(
        "both", doc="whether the points of both grains are asked for their signed distance, or the finer ones only"
    )
    distance: float = parameter(0.0, doc="distance that the surfaces of grains keep at least", unit="length")
    overlap: float = parameter(
        0.0,
        doc="depth up to which grains may overlap, a stand-in for grains that give way; with contact sdf",
        unit="length",
    )
    gravity: Literal["-x", "+x", "-y", "+y", "-z", "+z", "none"] | tuple[float, float, float] | None = parameter(
        None, doc="where down is, an axis or any vector; left out: -z, in two dimensions -y"
    )
    feed: Literal["rain", "layers", "at_once"] = parameter(
        "rain", doc="how grains enter: at the top while others walk, layer by layer, or anywhere at once"
    )
    rate: float = parameter(0.05, doc="share of attempts that let a grain enter, of rain")
    layer_sweeps: int = parameter(40, doc="sweeps in which a layer sinks before the next enters")
    sweeps: int = parameter(4000, doc="attempts per grain after all have entered", unit="attempts per grain")
    cycles: int | None = parameter(None, doc="cycles of vibration within the sweeps; left out: 8")
    period: int | None = parameter(None, doc="sweeps of a cycle, in place of their number", unit="attempts per grain")
    decay: float | None = parameter(
        None, doc="what a cycle keeps of the upward share of the one before; left out: it dies away evenly"
    )
    tilt: float = parameter(0.5, doc="how much of gravity is added to the random unit vector of a step")
    up: float = parameter(0.8, doc="share of upward steps that are kept at the start of the first cycle")
    turns: float = parameter(0.7, doc="share of attempts that also turn the grain")
    step: float = parameter(
        0.1,
        doc="longest step; never more than half the volume of the grain over its surface",
        unit="diameters of the grain",
    )
    settling: int = parameter(
        0, doc="most sweeps in which the true shapes settle after the walk and close what is open"
    )
    friction: float = parameter(0.0, doc="coefficient of friction between grains, and at walls, while they settle")
    shaking: int = parameter(
        0, doc="sweeps in which each true shape is pulled and turned its own way before all settle; they come on top"
    )
    acceleration: float = parameter(0.8, doc="strength of the shaking at its start, in gravities; it dies away evenly")
    lid: bool = parameter(False, doc="whether a lid comes down on the bed, a small step at a time where it finds room")

    def __post_init__(self) -> None:
        """Check the ranges, and what does not go together."""
        if self.contact == "points":
            warnings.warn(
                "contact is 'points', the old name of 'kdtree', which gives the same packing: use contact='kdtree'",
                DeprecationWarning,
                stacklevel=3,
            )
            object.__setattr__(self, "contact", "kdtree")
        if as_positive(self.spacing, "spacing") > 1.0:
            raise InputError(
                f"spacing is {self.spacing:g} diameters of a grain: points wider apart than the grain do not tell its "
                "shape; give at most 1, such as 0.12"
            )
        as_number(self.distance, "distance", at_least=0.0)
        as_count(self.sweeps, "sweeps", at_most=MOST_SWEEPS)
        as_number(self.rate, "rate", above=0.0, at_most=1.0)
        as_count(self.layer_sweeps, "layer_sweeps", at_least=1, at_most=MOST_SWEEPS)
        check_cycles(self.cycles, self.period)
        if self.decay is not None:
            as_number(self.decay, "decay", at_least=0.0, at_most=1.0)
        as_number(self.tilt, "tilt", at_least=0.0)
        as_number(self.up, "up", at_least=0.0, at_most=1.0)
        as_number(self.turns, "turns", at_least=0.0, at_most=1.0)
        as_number(self.step, "step", at_least=SHORTEST_STEP)
        as_number(self.overlap, "overlap", at_least=0.0)
        as_count(self.settling, "settling", at_most=MOST_SWEEPS)
        as_number(self.friction, "friction", at_least=0.0)
        as_count(self.shaking, "shaking", at_most=MOST_SWEEPS)
        as_number(self.acceleration, "acceleration", above=0.0)
        if self.distance and self.settling:
            raise InputError(
                f"distance is {self.distance:g} and settling {self.settling}: settling brings true shapes together; "
                "use one of them"
            )
        if self.overlap and (self.contact != "sdf" or self.distance or self.settling):
            raise InputError(
                f"overlap is {self.overlap:g} with contact {self.contact!r}, distance {self.distance:g} and settling "
                f"{self.settling}: grains may overlap with contact 'sdf' only, without distance and settling"
            )
        if self.ways == "one" and self.contact != "sdf":
            raise InputError(
                f"ways is 'one' with contact {self.contact!r}: points are compared with points; use 'both'"
            )
        for name, value in (("friction", self.friction), ("shaking", self.shaking)):
            if value and not self.settling:
                raise InputError(
                    f"{name} is {value:g} and settling 0: it acts while grains settle; set settling, such as 200"
                )
        if self.lid and self.gravity == "none":
            raise InputError("lid is true and gravity 'none': it needs to know where down is; choose a direction")


def prepare(problem: Problem) -> State:
    """Return the state in which all grains wait outside.

    Raises
    ------
    InputError
        If gravity points along a periodic axis, a grain of the start finds no place, the distance leaves no room for
        two grains, the overlap is deeper than a grain is thick, or open surfaces are to be compared by signed distances
        or to settle.
    """
    gravity_vector(problem)
    check_surfaces(problem)
    check_distance(problem)
    check_overlap(problem)
    n = problem.count
    arrays = {
        "position": np.zeros((n, 3)),
        "orientation": np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)),
        "entered": np.zeros(n, dtype=np.int64),
        "step": np.zeros(n),
        "queue": np.arange(n, dtype=np.int64),
        "height": np.full(1, np.inf),
        "brim": np.zeros(2),
        "lid": np.zeros(2),
    }
    counters = {**dict.fromkeys(TALLY, 0), "fed_at": -1, "layer_ends": -1, "layer_placed": 0, **COUNTERS}
    state = State(arrays, counters, 0, most_attempts(problem, n))
    if n == 0:
        state.stop_reason = "count"
    if problem.start is not None and problem.start.count:
        _enter_start(problem, state, problem.start)
    return state


def _enter_start(problem: Problem, state: State, start: Start) -> None:
    """Put the grains of the start in the container: as they are where their true shapes are apart.

    Else, or where they have to keep a distance, each comes as little above its place as the points need to part.
    """
    if problem.parameters.distance or not stands_free(problem, start):
        _raise_start(problem, state, start)
    else:
        n, arrays = start.count, state.arrays
        arrays["position"][:n], arrays["orientation"][:n] = start.wrapped(problem.container), start.orientation
        arrays["entered"][:n] = 1
        extent = setting_of(problem, state).extent[:n]
        arrays["step"][:n] = np.minimum(problem.parameters.step * problem.diameter[:n], 0.5 * extent[:, 2])
    state.arrays["queue"] = start.queue(problem.count)
    state.counters["placed"] = start.count
    if start.count == problem.count:
        look_at_queue(problem, state, -1, lambda: _centroids(state))


def _raise_start(problem: Problem, state: State, start: Start) -> None:
    """Put each grain of the start as little above its place as the points need to part."""
    setting, down = setting_of(problem, state), main_axis(gravity_vector(problem))
    up = upward(down, problem.dimension).astype(np.float64)
    bed, rules = bed_of(problem, state, setting), _rules(problem, state)
    world = (setting.bodies, setting.cells, setting.walls, rules, setting.memory, setting.scratch)
    for grain in start.rising(down).tolist():
        setting.scratch.quaternion[:] = start.orientation[grain]
        fine = 0.25 * (float(setting.extent[grain, 1]) + rules.gap)
        if not enter_raised(bed, world, grain, start.position[grain], up, fine):
            refuse_start(grain)


def advance(problem: Problem, state: State, attempts: int) -> State:
    """Make up to `attempts` attempts, first feeding, then shaking and settling."""
    if state.stop_reason:
        return state
    last = state.done + attempts
    if state.counters["ended"] < 0:
        setting_of(problem, state)
    while state.done < last and not state.stop_reason:
        if state.counters["ended"] >= 0:
            entered = state.counters["placed"] == problem.count
            finish_some(state, _finishing(problem), _assembly(problem, state), last=last, entered=entered)
            # a sweep takes longer than any chunk of the walk
            return state
        setting, due = setting_of(problem, state), next_event(problem, state)
        _walk(problem, state, setting, min(last, due))
        if state.counters["fed_at"] < 0:
            look_at_queue(problem, state, due, lambda: _centroids(state))
        elif state.done == due:
            if problem.parameters.lid:
                lower_lid(problem, state, setting)
            if (state.done - state.counters["fed_at"]) % (SETTLE_SWEEPS * max(state.counters["placed"], 1)) == 0:
                _look_at_bed(problem, state)
    return state


def finish(problem: Problem, state: State) -> Packing:
    """Return the packing of the grains that entered."""
    assembly, gravity = _assembly(problem, state), gravity_vector(problem)
    provenance: dict[str, object] = {
        "parameters": {"gravity": gravity_text(problem)},
        "lid_lowered": float(state.arrays["lid"][0]) * problem.unit_length,
        **finishing_report(state, assembly, gravity),
    }
    return problem.packing(
        _placed(state),
        position=assembly.position,
        orientation=normalized(assembly.orientation),
        provenance=provenance,
        stop_reason=state.stop_reason,
        gravity=gravity,
        contact_gap=problem.parameters.spacing,
    )


def cost(problem: Problem) -> Cost:
    """Return what a run takes.

    Raises
    ------
    InputError
        If open surfaces are to be compared by signed distances or to settle.
    """
    check_surfaces(problem)
    return Cost(
        memory=memory_needed(problem),
        attempts=most_attempts(problem, problem.count) + _finishing(problem).sweeps * problem.count,
        sampled_shapes=len(problem.shapes) if problem.count else 0,
    )


def _rules(problem: Problem, state: State) -> Rules:
    """Return how grains move at this stage of the run."""
    settings: ControlPoint = problem.parameters
    counters, gravity = state.counters, gravity_vector(problem)
    length = max(settings.sweeps, 1) * max(counters["placed"], 1)
    decay = -1.0 if settings.decay is None else settings.decay
    return Rules(
        gravity,
        float(settings.tilt),
        entry_of(problem, gravity),
        np.array([settings.up, settings.turns, feed_share(problem, state), decay]),
        np.array([counters["fed_at"], length, cycles_of(problem, CYCLES), patience(problem)], dtype=np.int64),
        problem.length(settings.distance - settings.overlap),
        float(settings.step),
        SHORTEST_STEP,
        problem.dimension,
    )


def _walk(problem: Problem, state: State, setting: Setting, last: int) -> None:
    """Run the kernel up to attempt `last`, or until the queue is empty or gives up."""
    tally = np.array([state.counters[name] for name in TALLY], dtype=np.int64)
    state.done = make_attempts(
        *(bed_of(problem, state, setting), setting.bodies, setting.cells, setting.walls, _rules(problem, state)),
        *(setting.memory, setting.scratch),
        *(state.arrays["queue"], tally, setting.key, state.done, last),
    )
    state.counters.update(zip(TALLY, tally.tolist(), strict=True))


def _look_at_bed(problem: Problem, state: State) -> None:
    """Stop when the bed no longer sinks after the last cycle, or when the attempts are used up."""
    arrays, counters = state.arrays, state.counters
    gravity = gravity_vector(problem)
    height = -float((_centroids(state) @ gravity).sum())
    sunk = float(arrays["height"][0]) - height
    arrays["height"] = np.array([height])
    entered = counters["placed"] == problem.count
    shaken = state.done - counters["fed_at"] >= problem.parameters.sweeps * counters["placed"]
    calm = lid_rests(state) and abs(sunk) <= SETTLE_DEPTH * counters["placed"]
    if shaken and (calm or not gravity.any()):
        _end(problem, state, "settled" if entered else "full")
    elif state.done >= state.total:
        _end(problem, state, "steps" if entered else "full")


def _finishing(problem: Problem) -> Finishing:
    """Return what is asked for after the walk; between their control points all but smooth grains may overlap."""
    settings: ControlPoint = problem.parameters
    smooth = all(largest_curvature(shape.geometry) is not None for shape in problem.shapes)
    return Finishing(
        parts=settings.contact == "sdf" and not settings.overlap and not smooth,
        distance=problem.length(settings.distance),
        settling=settings.settling,
        shaking=settings.shaking,
        acceleration=settings.acceleration,
        friction=settings.friction,
        step=0.25 * settings.spacing,
        gravity=gravity_vector(problem),
        seed=problem.seed,
    )


def _end(problem: Problem, state: State, reason: str) -> None:
    """End the walk, and go on with the true shapes where that is asked for or needed."""
    end_walk(state, _finishing(problem), _assembly(problem, state), placed=_placed(state), reason=reason)


def _placed(state: State) -> Integers:
    """Return the grains that have entered."""
    if state.counters["ended"] >= 0:
        return state.arrays["grains"]
    return np.flatnonzero(state.arrays["entered"])


def _centroids(state: State) -> Floats:
    """Return where the grains that have entered are, before the walk ends."""
    return state.arrays["position"][state.arrays["entered"] == 1]


def _assembly(problem: Problem, state: State) -> Assembly:
    """Return the grains that have entered, in the normalized frame."""
    placed = _placed(state)
    poses = [state.arrays[name] for name in ("position", "orientation")]
    if state.counters["ended"] < 0:
        poses = [pose[placed] for pose in poses]
    return Assembly(
        *(problem.shapes, problem.shape_id[placed], problem.diameter[placed], poses[0], poses[1], problem.container)
    )


registration = PackingMethod(
    name="control_point",
    summary="grains as control points on their surfaces, moved and turned by small random steps under gravity",
    source="Sajjadi & Khalili 2015, Generating, Reproducing and Packaging of Random Volumes for Discrete Element "
    "Analysis of Discontinuous Materials, section 5-2",
    parameters=ControlPoint,
    prepare=prepare,
    advance=advance,
    finish=finish,
    cost=cost,
    dimensions=(2, 3),
    libraries=("numba", "open3d"),
    open_surfaces=True,
)
