"""Control-point packing: grains are points on their surfaces, and move through space by small random steps.

Each attempt picks a grain, moves it by a random unit vector times a step, and turns it by a small random rotation. The
attempt is refused where a control point of the grain would be nearer than the spacing of the points (plus a wanted
distance) to one of another grain, found with KD-trees that each shape brings in its own frame, or where it would reach
through a wall. Gravity tilts the steps downward, with cycles of vibration in which upward steps are kept and die away.
Each grain lengthens its steps when it moves freely and shortens them when it is caught.

The points cover the surface, so surfaces cannot cross between them: the packing is free of overlaps between the true
solids, and contacts stay open by up to the spacing. No voxels are made, so grains may have any place and any
orientation; the cost of a move grows with the number of points near a contact only.

References
----------
Sajjadi & Khalili 2015, Control points in packing of particles of arbitrary shape, section 5-2: surfaces as control
points, moved at random under gravity and compared by nearest neighbours
"""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from voxgran._base.arrays import Floats, Integers, as_count, as_number, as_positive
from voxgran._base.config import parameter, to_mapping
from voxgran._base.errors import InputError
from voxgran._base.lazy import load
from voxgran._base.rotation import normalized
from voxgran._base.seeds import philox_key
from voxgran.containers.closed_mesh import ClosedMesh
from voxgran.containers.cylinder import Cylinder
from voxgran.containers.sphere import Sphere
from voxgran.packing.control_points import FLAT, MESH, ROUND, Bed, Bodies, Memory, Scratch, Walls
from voxgran.packing.control_walk import Cells, Rules, enter_raised, link_all, make_attempts
from voxgran.packing.lattice import axis_of
from voxgran.packing.method import Cost, PackingMethod, State
from voxgran.packing.model import Packing
from voxgran.packing.problem import Problem
from voxgran.packing.start import Start, refuse_start, upward
from voxgran.packing.trees import make_trees, stack_room
from voxgran.points.sample import sample_surface
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape

#: sweeps between two looks at whether the bed still sinks
SETTLE_SWEEPS = 200
#: mean sinking in median diameters per grain over such a look, below which the bed is settled
SETTLE_DEPTH = 0.001
#: looks at the most after the last cycle
SETTLE_LOOKS = 40
#: share of attempts that let a grain enter while some wait and it rains
FEED_SHARE = 0.05
#: shortest step, in diameters of the grain
SHORTEST_STEP = 0.002
#: control points that are listed for a pair of near grains, and pairs for which there are lists
LISTED, MOST_PAIRS = 64, 2**17
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
    """Parameters of control-point packing."""

    spacing: float = parameter(
        0.12,
        doc="spacing of the control points on a grain; contacts stay open by up to this",
        unit="diameters of the grain",
    )
    distance: float = parameter(0.0, doc="distance that the surfaces of grains keep at least", unit="length")
    gravity: Literal["-x", "+x", "-y", "+y", "-z", "+z", "none"] | None = parameter(
        None, doc="where down is; left out: -z, in two dimensions -y"
    )
    feed: Literal["rain", "at_once"] = parameter(
        "rain", doc="how grains enter: at the top while there is room, or anywhere at once"
    )
    sweeps: int = parameter(4000, doc="attempts per grain after all have entered", unit="attempts per grain")
    cycles: int = parameter(8, doc="cycles of vibration within the sweeps")
    tilt: float = parameter(0.5, doc="how much of gravity is added to the random unit vector of a step")
    up: float = parameter(0.8, doc="share of upward steps that are kept at the start of the first cycle")
    turns: float = parameter(0.7, doc="share of attempts that also turn the grain")
    step: float = parameter(
        0.1,
        doc="longest step; never more than half the volume of the grain over its surface",
        unit="diameters of the grain",
    )

    def __post_init__(self) -> None:
        """Check the ranges."""
        as_positive(self.spacing, "spacing")
        as_number(self.distance, "distance", at_least=0.0)
        as_count(self.sweeps, "sweeps")
        as_count(self.cycles, "cycles", at_least=1)
        as_number(self.tilt, "tilt", at_least=0.0)
        as_number(self.up, "up", at_least=0.0, at_most=1.0)
        as_number(self.turns, "turns", at_least=0.0, at_most=1.0)
        as_number(self.step, "step", at_least=SHORTEST_STEP)


def prepare(problem: Problem) -> State:
    """Return the state in which all grains wait outside.

    Raises
    ------
    InputError
        If gravity points along a periodic axis, the container is a sphere, or a grain of the start finds no place.
    """
    _gravity(problem)
    if isinstance(problem.container, Sphere):
        raise InputError("container is a sphere: control points know flat walls, cylinders and meshes; give its mesh")
    n = problem.count
    arrays = {
        "position": np.zeros((n, 3)),
        "orientation": np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)),
        "entered": np.zeros(n, dtype=np.int64),
        "step": np.zeros(n),
        "queue": np.arange(n, dtype=np.int64),
        "height": np.full(1, np.inf),
    }
    state = State(arrays, {**dict.fromkeys(TALLY, 0), "fed_at": -1}, 0, _most_attempts(problem, n))
    if n == 0:
        state.stop_reason = "count"
    if problem.start is not None and problem.start.count:
        _enter_start(problem, state, problem.start)
    return state


def _enter_start(problem: Problem, state: State, start: Start) -> None:
    """Put the grains of the start in the container, each as little above its place as the points need to part."""
    setting, gravity = _setting(problem, state), _gravity(problem)
    up = upward(gravity, problem.dimension).astype(np.float64)
    bed, rules = _bed(problem, state, setting), _rules(problem, state)
    world = (setting.bodies, setting.cells, setting.walls, rules, setting.memory, setting.scratch)
    for grain in start.rising(gravity).tolist():
        setting.scratch.quaternion[:] = start.orientation[grain]
        fine = 0.25 * (float(setting.extent[grain, 1]) + rules.gap)
        if not enter_raised(bed, world, grain, start.position[grain], up, fine):
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
    placed = np.flatnonzero(state.arrays["entered"])
    shape_id = problem.shape_id[placed]
    own = np.array([shape.diameter for shape in problem.original])
    resolved = {
        **to_mapping(problem.parameters),
        "gravity": problem.parameters.gravity or _default_gravity(problem),
    }
    return Packing.of(
        problem.original,
        problem.container.scaled(problem.unit_length),
        position=state.arrays["position"][placed] * problem.unit_length,
        scale=problem.diameter[placed] * problem.unit_length / own[shape_id],
        shape_id=shape_id,
        orientation=normalized(state.arrays["orientation"][placed]),
        provenance={"parameters": resolved},
        stop_reason=state.stop_reason or "interrupted",
    )


def cost(problem: Problem) -> Cost:
    """Return what a run takes."""
    container = problem.container
    solids = [*problem.shapes, *([container.shape] if isinstance(container, ClosedMesh) else [])]
    total = 0.0
    for solid in solids:
        power = problem.dimension - 1
        # points that keep apart and cover at this spacing; 24 bytes each, as much in the tree, and their probes
        points = 16 + 5 * solid.surface_area / problem.parameters.spacing**power
        faces = len(solid.geometry.faces) if isinstance(solid.geometry, Mesh) else 5000
        total += points * (24 * 40 + 48) + faces * (72 + 3 * 24)
    return Cost(
        memory=int(total) + _memory_room(problem) * (LISTED * 16 + 136),
        attempts=_most_attempts(problem, problem.count),
        sampled_shapes=len(problem.shapes) if problem.count else 0,
    )


@dataclass(frozen=True, slots=True)
class _Setting:
    """What follows from the problem."""

    bodies: Bodies
    extent: Floats
    walls: Walls
    cells: Cells
    memory: Memory
    scratch: Scratch
    key: Any


def _setting(problem: Problem, state: State) -> _Setting:
    """Return the setting, made again where the state was just made or read from a checkpoint."""
    if "setting" not in state.derived:
        bodies = _bodies(problem)
        key = philox_key(problem.seed, "control_point")
        extent = _extent(problem, bodies)
        cells = _cells(problem, extent)
        scratch = _scratch(problem, bodies, cells)
        made = _Setting(bodies, extent, _walls(problem), cells, _memory(problem), scratch, key)
        link_all(_bed(problem, state, made), made.cells)
        state.derived["setting"] = made
    kept: _Setting = state.derived["setting"]
    return kept


def _memory(problem: Problem) -> Memory:
    """Return an empty memory with room for the neighbours of all grains."""
    room = _memory_room(problem)
    lists = np.zeros((room, LISTED, 2), dtype=np.int64)
    return Memory(np.full((room, 4), -1, dtype=np.int64), np.zeros((room, 13)), lists)


def _memory_room(problem: Problem) -> int:
    """Return for how many pairs there is memory, a power of two."""
    return min(MOST_PAIRS, 1 << int(np.ceil(np.log2(16 * max(problem.count, 1)))))


def _scratch(problem: Problem, bodies: Bodies, cells: Cells) -> Scratch:
    """Return room for what the kernels try: neighbours are all grains in all images within reach, at the most."""
    room = stack_room(bodies.trees)
    lengths = (cells.width * cells.count)[list(problem.container.periodic)]
    images = int(np.prod(2 * np.ceil(2 * cells.reach / lengths) + 1))
    return Scratch(
        *(np.zeros(3), np.zeros(4), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3)),
        *(np.zeros((room, 2), dtype=np.int64), np.zeros((LISTED, 2), dtype=np.int64)),
        np.zeros((images * problem.count, 4), dtype=np.int64),
    )


def _extent(problem: Problem, bodies: Bodies) -> Floats:
    """Return bounding radius, half the spacing and volume over surface of each grain, (n, 3)."""
    inner = [shape.volume / shape.surface_area for shape in problem.shapes]
    known = len(inner)
    unit = np.column_stack([bodies.radius[:known], bodies.spacing[:known] / 2, inner])
    return np.ascontiguousarray(unit[problem.shape_id] * problem.diameter[:, None])


def _bodies(problem: Problem) -> Bodies:
    """Sample the shapes, and the container where it is a mesh, and plant their trees."""
    settings: ControlPoint = problem.parameters
    samples = [problem.points(k, settings.spacing) for k in range(len(problem.shapes))]
    solids = list(problem.shapes)
    if isinstance(problem.container, ClosedMesh):
        solids.append(problem.container.shape)
        samples.append(sample_surface(solids[-1], spacing=settings.spacing, seed=problem.seed))
    # points of a curved shape lie on its tessellation, and that lies near the true surface
    spacing = [points.spacing + 2 * solid.tessellation_error for points, solid in zip(samples, solids, strict=True)]
    hulls = [_hull(shape) for shape in problem.shapes]
    triangles = [solid.vertices[solid.faces] for solid in solids]
    return Bodies(
        make_trees([np.asarray(points) for points in samples]),
        np.array([solid.bounding_radius for solid in solids]),
        np.array(spacing),
        *(np.concatenate(hulls), _starts(hulls)),
        np.array([shape.tessellation_error for shape in problem.shapes]),
        *(np.concatenate(triangles), _starts(triangles)),
    )


def _hull(shape: Shape) -> Floats:
    """Return the corners of the convex hull of the tessellation of a shape, (n, 3)."""
    corners = shape.vertices[:, : shape.dimension]
    return np.ascontiguousarray(shape.vertices[load("scipy.spatial").ConvexHull(corners).vertices])


def _starts(parts: list[Floats]) -> Integers:
    """Return where each part begins when all lie one after another, and where the last one ends."""
    return np.concatenate([[0], np.cumsum([len(part) for part in parts])]).astype(np.int64)


def _walls(problem: Problem) -> Walls:
    """Return the walls of the container."""
    container = problem.container
    lower, upper = (np.array(corner, dtype=np.float64) for corner in container.bounds)
    periodic = np.array(container.periodic, dtype=np.int64)
    walled = np.where(np.arange(3) < problem.dimension, 1 - periodic, 0).astype(np.int64)
    if isinstance(container, ClosedMesh):
        return Walls(MESH, lower, upper, walled, periodic, 0.0, np.array(container.shape.offset))
    if isinstance(container, Cylinder):
        return Walls(ROUND, lower, upper, walled, periodic, float(container.radius), (lower + upper) / 2)
    return Walls(FLAT, lower, upper, walled, periodic, 0.0, np.zeros(3))


def _cells(problem: Problem, extent: Floats) -> Cells:
    """Lay out empty cells, most of which hold no more than one grain."""
    lower, upper = problem.container.bounds
    span = np.where(np.arange(3) < problem.dimension, upper - lower, 1.0)
    least = (np.prod(span) / (64 * problem.count)) ** (1 / problem.dimension)
    count = np.maximum(np.floor(span / max(float(np.median(extent[:, 0])), least)), 1).astype(np.int64)
    reach = float(extent[:, 0].max() + 2 * extent[:, 1].max()) + problem.length(problem.parameters.distance)
    head = np.full(int(np.prod(count)), -1, dtype=np.int64)
    return Cells(lower.copy(), span / count, count, head, np.full(problem.count, -1, dtype=np.int64), reach)


def _bed(problem: Problem, state: State, setting: _Setting) -> Bed:
    """Return the arrays of the state as the kernels take them."""
    arrays = state.arrays
    poses = (arrays["position"], arrays["orientation"], arrays["entered"], arrays["step"])
    return Bed(*poses, problem.shape_id.astype(np.int64), problem.diameter.astype(np.float64), setting.extent)


def _rules(problem: Problem, state: State) -> Rules:
    """Return how grains move at this stage of the run."""
    settings: ControlPoint = problem.parameters
    counters, at_once = state.counters, settings.feed == "at_once"
    length = max(settings.sweeps, 1) * max(counters["placed"], 1)
    return Rules(
        _gravity(problem).astype(np.float64),
        float(settings.tilt),
        # the top of a mesh may have no room for any grain: there grains enter anywhere
        at_once or isinstance(problem.container, ClosedMesh),
        np.array([settings.up, settings.turns, 1.0 if at_once else FEED_SHARE]),
        np.array([counters["fed_at"], length, settings.cycles, _patience(problem)], dtype=np.int64),
        problem.length(settings.distance),
        float(settings.step),
        SHORTEST_STEP,
        problem.dimension,
    )


def _default_gravity(problem: Problem) -> str:
    """Return where down is when nothing is said."""
    return "-z" if problem.dimension == 3 else "-y"


def _gravity(problem: Problem) -> Integers:
    """Return the direction of gravity; zero where there is none."""
    return axis_of(problem.parameters.gravity or _default_gravity(problem), problem.container)


def _walk(problem: Problem, state: State, setting: _Setting, last: int) -> None:
    """Run the kernel up to attempt `last`, or until the queue is empty or gives up."""
    tally = np.array([state.counters[name] for name in TALLY], dtype=np.int64)
    state.done = make_attempts(
        *(_bed(problem, state, setting), setting.bodies, setting.cells, setting.walls, _rules(problem, state)),
        *(setting.memory, setting.scratch),
        *(state.arrays["queue"], tally, setting.key, state.done, last),
    )
    state.counters.update(zip(TALLY, tally.tolist(), strict=True))


def _most_attempts(problem: Problem, grains: int) -> int:
    """Return after how many attempts the bed of so many grains is given up."""
    sweeps: int = problem.parameters.sweeps
    return grains * (sweeps + SETTLE_LOOKS * SETTLE_SWEEPS)


def _patience(problem: Problem) -> int:
    """Return after how many refusals in a row the container counts as full."""
    return max(2000, 20 * problem.count)


def _look_at_queue(problem: Problem, state: State) -> None:
    """End feeding when all have entered, or when nothing enters any more."""
    counters = state.counters
    full = counters["feeds_refused_in_a_row"] >= _patience(problem)
    if counters["placed"] == problem.count or full:
        counters["fed_at"] = state.done
        state.total = state.done + _most_attempts(problem, counters["placed"])
        if counters["placed"] == 0:
            state.stop_reason = "full"


def _look_at_bed(problem: Problem, state: State) -> None:
    """Stop when the bed no longer sinks after the last cycle, or when the attempts are used up."""
    arrays, counters = state.arrays, state.counters
    gravity = _gravity(problem)
    height = -float((arrays["position"][arrays["entered"] == 1] @ gravity).sum())
    sunk = float(arrays["height"][0]) - height
    arrays["height"] = np.array([height])
    entered = counters["placed"] == problem.count
    shaken = state.done - counters["fed_at"] >= problem.parameters.sweeps * counters["placed"]
    calm = abs(sunk) <= SETTLE_DEPTH * counters["placed"]
    if shaken and (calm or not gravity.any()):
        state.stop_reason = "settled" if entered else "full"
    elif state.done >= state.total:
        state.stop_reason = "steps" if entered else "full"


registration = PackingMethod(
    name="control_point",
    summary="grains as control points on their surfaces, moved and turned by small random steps under gravity",
    source="Sajjadi & Khalili 2015, Control points in packing of particles of arbitrary shape, section 5-2",
    parameters=ControlPoint,
    prepare=prepare,
    advance=advance,
    finish=finish,
    cost=cost,
    dimensions=(2, 3),
    libraries=("numba", "open3d"),
)
