"""Control-point packing: grains are points on their surfaces, and move by small random steps.

An attempt selects a grain, moves it by a random unit vector times a step, and rotates it by a small random angle. It is
refused if the grain would penetrate a wall or come too near to another grain by one of two contact tests. With contact
"sdf" the control points of each grain are looked up in the signed-distance field of the other, so that grains touch;
with "kdtree" points are compared with points, by trees, and grains stay apart by up to the spacing. Gravity biases the
steps downward; during vibration a fraction of the steps is not biased, or a fraction of the collisions is followed by a
few steps that lean upward; this fraction decreases within each cycle. The step length of a grain grows after each
accepted move and shrinks after each refused one.

Grains are inserted as rain, in layers, or at random places. A lid is a wall opposite to gravity: after each sweep it is
lowered by 1/32 of the median diameter or to the nearest grain, and the walk does not end before it rests on the grains.

Control points cover the surface and, optionally, the interior. When points are compared with points, surfaces cannot
cross between them. With signed distances, a smooth surface can bulge between its points by no more than its curvature
allows, which is added to the distance, so that spheres and ellipsoids never overlap; sharp edges may overlap between
points, by less than half the spacing. Steps are so short, and thin grains are kept so far apart, that no grain can pass
through another. No voxels are used, so grains may have any position and orientation; the cost of a move depends on the
points near a contact only.

Open surfaces have no interior: they are packed with point tests only, and may not overlap. In a packing that contains
open surfaces all points keep a distance that is five percent larger, and steps are so short that no point can pass
through a surface.

Before a run, lengths and shapes are checked against what the method asks for.

References
----------
Sajjadi & Khalili 2015, Generating, Reproducing and Packaging of Random Volumes for Discrete Element Analysis of
Discontinuous Materials, section 5-2: surfaces as control points, moved at random under gravity and compared by nearest
neighbours
"""

from functools import partial

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran._base.checkpoint import MOST, Held
from voxgran._base.errors import InputError
from voxgran.containers.gravity import gravity_vector, main_axis, upward
from voxgran.packing.control_point.attempts import enter_raised, make_attempts
from voxgran.packing.control_point.parameters import SHORTEST_STEP, ControlPoint
from voxgran.packing.control_point.precompute import memory_needed, pairs_of, precomputed_of, put_lid
from voxgran.packing.control_point.records import HALF_SPACING, HALF_THICKNESS, WalkRules, World
from voxgran.packing.control_point.state import ControlState
from voxgran.packing.control_point.walls import room_of_lid
from voxgran.packing.method import Cost, PackingMethod
from voxgran.packing.model import Packing
from voxgran.packing.problem import Problem, stands_free
from voxgran.packing.start import Start, refuse_start
from voxgran.packing.walking.entering import enters_in_turn, falls_at_entry, moving_grains
from voxgran.packing.walking.feeding import SETTLE_SWEEPS, entry_of, feed_share, planned_attempts, usual_seconds
from voxgran.packing.walking.vibration import vibration_schedule
from voxgran.packing.walking.walk import advance, begin, finished

#: CPU time of an attempt on a usual core, in seconds, and of one in a container that is nearly full (measured)
ATTEMPT = 4e-5, 1e-5
#: mean sinking per grain between two examinations, in median diameters, below which the bed is settled
SETTLE_DEPTH = 0.001
#: upward moves after a collision: the paper speaks of a few
LIFTS = 3
#: largest distance by which the lid is lowered after a sweep, in median diameters: a voxel of digital packing
LID_STEP = 1 / 32


class ControlWalker:
    """What the walk has to know of control-point packing: see :class:`voxgran.packing.walking.walk.Walker`."""

    def enter_start(self, problem: Problem, state: ControlState, start: Start) -> None:
        """Insert the grains of the start as they are where their true shapes do not overlap.

        Else, or where they have to keep a distance, each is raised as little as the points need.

        Raises
        ------
        InputError
            If a grain finds no place.
        """
        n = start.count
        if not problem.parameters.distance and stands_free(problem, start):
            state.position[:n], state.orientation[:n] = start.wrapped(problem.container), start.orientation
            state.entered[:n] = 1
            # links the grains that have entered
            extent = precomputed_of(problem, state).extent[:n]
            state.step[:n] = np.minimum(problem.parameters.step * problem.diameter[:n], 0.5 * extent[:, HALF_THICKNESS])
            return
        world, down = _world(problem, state), main_axis(gravity_vector(problem))
        up = upward(down, problem.dimension).astype(np.float64)
        for grain in start.rising(down).tolist():
            world.pairs.scratch.quaternion[:] = start.orientation[grain]
            fine = 0.25 * (float(world.pairs.grains.extent[grain, HALF_SPACING]) + world.pairs.gap)
            if not enter_raised(world, grain, start.position[grain], up, fine):
                refuse_start(start, grain, problem.container)

    def make_attempts(self, problem: Problem, state: ControlState, last: int) -> None:
        """Run the kernel up to attempt `last`, or until no grain is waiting or too many were refused."""
        tally, key = state.tally(), precomputed_of(problem, state).key
        state.done = make_attempts(_world(problem, state), state.waiting, tally, key, state.done, last)
        state.count(tally)

    def between_sweeps(self, problem: Problem, state: ControlState) -> None:
        """Lower the lid by a small step, no farther than to the nearest grain."""
        if not problem.parameters.lid or state.done == state.feeding_ended_at:
            return
        setting, down = precomputed_of(problem, state), main_axis(gravity_vector(problem))
        room = float(room_of_lid(pairs_of(problem, state, setting), setting.walls, down))
        state.lid_lowered += min(LID_STEP, room)
        put_lid(problem, setting.walls, state.lid_lowered)

    def event_sweeps(self, problem: Problem) -> int:
        """Return the number of sweeps after which the lid is lowered."""
        return 1 if problem.parameters.lid else SETTLE_SWEEPS

    def poses(self, problem: Problem, state: ControlState) -> tuple[Floats, Floats]:
        """Return centroids and orientations of the grains that have entered."""
        return state.position[state.grains], state.orientation[state.grains]

    def has_settled(self, problem: Problem, state: ControlState) -> bool:
        """Return whether neither the bed nor the lid has sunk since the last call, beyond small limits."""
        before, lid_before = state.height, state.lid_before
        state.height = -float(linear.matmul(state.position[state.grains], gravity_vector(problem)).sum())
        state.lid_before = state.lid_lowered
        lid_rests = state.lid_lowered - lid_before <= LID_STEP
        return lid_rests and abs(before - state.height) <= SETTLE_DEPTH * state.placed


WALKER = ControlWalker()


def prepare(problem: Problem) -> ControlState:
    """Return the first state.

    Raises
    ------
    InputError
        If gravity points along a periodic axis, a grain of the start finds no place, the distance leaves no room for
        two grains, the overlap is deeper than a grain is thick, or open surfaces are to be compared by signed
        distances.
    """
    check_surfaces(problem)
    check_distance(problem)
    check_overlap(problem)
    n = problem.count
    upright = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
    state = ControlState(
        position=np.zeros((n, 3)),
        orientation=upright if problem.orientation is None else problem.orientation.copy(),
        entered=np.zeros(n, dtype=np.int64),
        step=np.zeros(n),
        lifted=np.zeros(n, dtype=np.int64),
    )
    bounds = np.array(problem.container.bounds)
    state.declared = {
        "position": Held(bounds[0], bounds[1], where="entered"), "orientation": Held(-1.0 - 1e-9, 1.0 + 1e-9),
        "entered": Held(0, 1), "step": Held(0.0, float(np.ptp(bounds, axis=0).max())), "lifted": Held(0, MOST),
    }  # fmt: skip
    return begin(WALKER, problem, state)


def finish(problem: Problem, state: ControlState) -> Packing:
    """Return the packing of the grains that have entered."""
    return finished(WALKER, problem, state, contact_gap=problem.parameters.spacing)


def cost(problem: Problem) -> Cost:
    """Return what a run takes.

    Raises
    ------
    InputError
        If open surfaces are to be compared by signed distances.
    """
    check_surfaces(problem)
    return Cost(
        memory=memory_needed(problem),
        seconds=usual_seconds(problem, *ATTEMPT),
        attempts=planned_attempts(problem),
        sampled_shapes=len(problem.shapes) if problem.count else 0,
    )


def _world(problem: Problem, state: ControlState) -> World:
    """Return what attempts read and write at this stage of the run."""
    setting = precomputed_of(problem, state)
    pairs = pairs_of(problem, state, setting)
    return World(pairs, setting.cells, setting.lists, setting.walls, _rules(problem, state))


def _rules(problem: Problem, state: ControlState) -> WalkRules:
    """Return how grains move at this stage of the run."""
    settings: ControlPoint = problem.parameters
    gravity, decay = gravity_vector(problem), -1.0 if settings.decay is None else settings.decay
    return WalkRules(
        gravity,
        float(settings.gravity_bias),
        entry_of(problem, gravity),
        enters_in_turn(problem),
        falls_at_entry(problem),
        moving_grains(problem, state),
        np.array([settings.vibration_up, decay, settings.rotation_share, feed_share(problem, state)]),
        vibration_schedule(problem, state),
        float(settings.step),
        SHORTEST_STEP,
        problem.dimension,
        problem.orientation is not None,
        LIFTS if settings.vibration == "collision" else 0,
    )


registration = PackingMethod(
    summary="grains as control points on their surfaces, moved and rotated by small random steps under gravity",
    source="Sajjadi & Khalili 2015, Generating, Reproducing and Packaging of Random Volumes for Discrete Element "
    "Analysis of Discontinuous Materials, section 5-2",
    parameters=ControlPoint,
    prepare=prepare,
    advance=partial(advance, WALKER),
    finish=finish,
    cost=cost,
    dimensions=(2, 3),
    libraries=("numba",),
    open_surfaces=True,
    builds_bed=True,
    start="moved",
)


#: least spacing of open surfaces, in diameters of the grain
FINEST = 0.02


def check_distance(problem: Problem) -> None:
    """Refuse a distance that no two grains can keep in the container.

    Raises
    ------
    InputError
        If it is too large.
    """
    distance, (lower, upper) = problem.length(problem.parameters.distance), problem.container.bounds
    if distance == 0.0 or problem.count < 2:
        return
    # two smallest grains in opposite corners; a grain reaches half its volume over its surface at least
    inner = [shape.volume / shape.surface_area for shape in problem.shapes]
    least = float(np.partition(np.array(inner)[problem.shape_id] * problem.diameter, 1)[:2].sum())
    room = float(linear.norm((upper - lower)[: problem.dimension])) - least
    if distance >= room:
        raise InputError(
            f"distance is {distance * problem.unit_length:g}: the container has room for less than "
            f"{room * problem.unit_length:g} between two grains; make it smaller or the container larger"
        )


def check_surfaces(problem: Problem) -> None:
    """Refuse open surfaces where signed distances are asked for.

    Raises
    ------
    InputError
        If grains are compared by signed distances, or the spacing is so fine that the shortest step is too long.
    """
    names = [shape.name for shape in problem.original if shape.is_open]
    settings = problem.parameters
    if names and settings.contact == "sdf":
        raise InputError(
            f"shape {names[0]!r} is an open surface and contact 'sdf': it has no inside and so no signed distance; use "
            "contact 'kdtree'"
        )
    if names and settings.spacing < FINEST:
        raise InputError(
            f"spacing is {settings.spacing:g} and shape {names[0]!r} an open surface: it must be at least {FINEST:g}, "
            "since no step may be longer than points are apart; make it larger"
        )


def check_overlap(problem: Problem) -> None:
    """Refuse an overlap that is as deep as a grain: such grains would no longer be in each other's way.

    Raises
    ------
    InputError
        If it is too deep.
    """
    inner = np.array([shape.volume / shape.surface_area for shape in problem.shapes])
    room = float((inner[problem.shape_id] * problem.diameter).min(initial=np.inf))
    overlap = problem.length(problem.parameters.overlap)
    if overlap > room:
        raise InputError(
            f"overlap is {overlap * problem.unit_length:g}: it must be at most {room * problem.unit_length:g}, the "
            "volume of the thinnest grain over its surface; make it smaller"
        )
