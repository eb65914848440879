"""Advancing front: each new sphere touches three placed ones, on the outer side of the face that they span.

The front starts with three spheres that touch each other; the face between them, from both sides, is the first front. A
face is chosen, a sphere is placed where it touches its three spheres, and three new faces replace the face. If no
sphere fits, the face is closed. No sphere is moved and no position is drawn at random: millions of spheres take
seconds, about twice as many for sizes that range over a factor of three. In slabs and tubes in which no three mutually
touching spheres fit, walls replace spheres.

References
----------
Loose: Journal of Dalian University of Technology 2011, 51(2), 236-243; in the plane Feng, Han & Owen 2003, Filling
domains with disks: an advancing front approach, International Journal for Numerical Methods in Engineering 56(5),
699-713, doi:10.1002/nme.583. Dense: Bennett 1972, Serially deposited amorphous aggregates of hard spheres, Journal of
Applied Physics 43(6), 2727-2734, doi:10.1063/1.1661585.
"""

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.checkpoint import Held, Rule
from voxgran._base.config import check_bounds, parameter, parameter_class
from voxgran._base.errors import InputError, TooLargeError
from voxgran._base.seeds import philox_key, stream
from voxgran._base.stopping import stop_if_asked
from voxgran.containers.gravity import as_down
from voxgran.containers.kernel_container import KernelContainer
from voxgran.containers.model import boundary_of
from voxgran.geometry.level_grid import LevelGrid
from voxgran.packing.advancing_front.container import front_container
from voxgran.packing.advancing_front.front import LAST, LOWEST, MISSING, NEAREST, RANDOM, Front, FrontRules, Spheres
from voxgran.packing.advancing_front.pockets import FOUND_SHORT, FRONT_SHORT, NEAR_SHORT, Scratch, advance_front
from voxgran.packing.advancing_front.sphere_cells import BITS, IMAGES, lay_cells, link_all
from voxgran.packing.method import Cost, PackingMethod, State, spheres_within
from voxgran.packing.model import Packing
from voxgran.packing.obstacles import refuse_no_spheres
from voxgran.packing.problem import Problem, packing_of_spheres, spheres_of_start
from voxgran.packing.transform.grow import grow
from voxgran.shapes.sizes import size_distance

#: what the kernels count, in their order
TALLY = ("front", "placed", "ranked", "closed", "begun", "missed_in_a_row")
#: failed seeds of the front in a row after which the container is full
PATIENCE = 1000
#: quantile of the radii that is the radius of the sphere by which pockets are found
POCKET = 0.5
#: offset of the goal from the first sphere, in its radii, so that positions around it are not equally near
ASIDE = (0.013, 0.029, 0.007)
ORDERS = {"random": RANDOM, "nearest": NEAREST, "lowest": LOWEST}
#: largest number of spheres: a sphere and its image share 31 bits
MOST = 2 ** (31 - BITS)
#: initial capacity for faces of the front, and for neighbours and pockets of a sphere
FIRST, FEW = 128, 128


@parameter_class
class AdvancingFront:
    """Parameters of the advancing front.

    Parameters
    ----------
    mode
        where spheres are placed: on three that touch each other, or wherever they touch three spheres or walls.
    order
        next position: random, the nearest to the widest point of the container, or the lowest.
    tries
        number of grains, in their order, that are tried at a position.
    grow
        largest factor by which grains grow about their centroids at the end, until each touches another; 1: none.

    Raises
    ------
    InputError
        If a number is out of its range, or dense packing is requested in random order.

    Examples
    --------
    >>> import voxgran as vg
    >>> packing = vg.pack(vg.shapes.sphere(), vg.Box((5, 5, 5)), vg.methods.AdvancingFront())
    >>> packing.stop_reason, packing.verify().ok
    ('full', True)
    """

    mode: Literal["loose", "dense"] = parameter("loose")
    order: Literal["random", "nearest", "lowest"] = parameter("nearest")
    tries: int = parameter(5, at_least=1)
    grow: float = parameter(1.0, at_least=1.0)

    def __post_init__(self) -> None:
        """Check the ranges."""
        check_bounds(self)
        if self.mode == "dense" and self.order == "random":
            raise InputError(
                "order is 'random': dense packing takes the best position; choose nearest or lowest, or loose"
            )


def prepare(problem: Problem) -> State:
    """Return the initial state, in which only the grains of the start are placed.

    Raises
    ------
    InputError
        If a grain of the start overlaps another or reaches through a wall, or an obstacle is no sphere.
    TooLargeError
        If there are 2**26 grains or more.
    """
    if problem.count >= MOST:
        raise TooLargeError(f"count is {problem.count}: the front takes fewer than {MOST} grains; pack in parts")
    refuse_no_spheres(problem, "advancing_front")
    n = problem.started
    order = stream(problem.seed, "order").permutation(np.arange(n, problem.count, dtype=np.int64))
    arrays = {
        "spheres": _spheres(problem),
        "order": np.concatenate([np.arange(n, dtype=np.int64), order]),
        "key": np.zeros(FIRST),
        "touched": np.zeros((FIRST, 3), dtype=np.int32),
    }
    most = _most_attempts(problem, dense=problem.parameters.mode == "dense")
    spheres, grain = spheres_within(problem), Held(0, problem.count)
    last = np.abs(np.array(_spheres(problem)[-1]))
    declared = {
        "spheres": Held(np.minimum(spheres.low, -last), np.maximum(spheres.high, last)), "narrow": Held(0, 1),
        "order": Held(0, problem.count - 1), "key": Held(rows="front"),
        "touched": Held(-IMAGES, problem.count * IMAGES + IMAGES - 1, "front"),
        **dict.fromkeys(("placed", "ranked"), grain), **dict.fromkeys(("front", "closed", "begun"), Held(0)),
        "missed_in_a_row": Held(0, PATIENCE),
    }  # fmt: skip
    state = State(arrays, dict.fromkeys((*TALLY, "narrow"), 0), 0, most, declared=declared, rule=_fits(problem))
    if problem.start is not None:
        state.arrays["spheres"][:n] = spheres_of_start(problem)
        state.counters["placed"] = n
    _look(problem, state)
    return state


def _fits(problem: Problem) -> Rule:
    """Return the rule for a checkpoint: the spheres are those of the grains, and the front is within its array."""

    def fits(arrays: Any, counters: Any) -> bool:
        placed, order = counters["placed"], arrays["order"]
        own = problem.bounding_radii[order[:placed]]
        return bool(
            len(np.unique(order)) == problem.count and counters["front"] <= len(arrays["key"]) > 0
            and counters["ranked"] <= placed and np.allclose(arrays["spheres"][:placed, 3], own, rtol=1e-9, atol=0.0)
            and np.array_equal(arrays["spheres"][-1], _spheres(problem)[-1])
        )  # fmt: skip

    return fits


def _spheres(problem: Problem) -> Floats:
    """Return an array for the spheres; its last row is the wall of a spherical container."""
    spheres = np.zeros((problem.count + 1, 4))
    if wall := boundary_of(problem.container).sphere:
        spheres[-1] = np.array([1.0, 1.0, 1.0, -1.0]) * wall.radius
    return spheres


def advance(problem: Problem, state: State, attempts: int) -> State:
    """Visit up to `attempts` positions of the front."""
    if state.stop_reason:
        return state
    made, last = _precomputed(problem, state), state.done + attempts
    key = philox_key(problem.seed, "advancing_front")
    tally = np.zeros(LAST + 3, dtype=np.int64)
    tally[:MISSING] = [state.counters[name] for name in TALLY]
    while True:
        packed = Spheres(state.arrays["spheres"], state.arrays["order"], made.radius)
        front, scratch = Front(state.arrays["key"], state.arrays["touched"]), Scratch(*state.derived["scratch"])
        world = (packed, front, made.cells, made.walls, made.rules, scratch)
        state.done = int(advance_front(*world, tally, key, state.done, last))
        state.counters.update(zip(TALLY, tally.tolist(), strict=False))
        if _look(problem, state):
            # cells and radii take as much memory as the spheres and are not needed any more
            state.derived.clear()
            return state
        if not tally[MISSING]:
            return state
        _make_room(state, int(tally[MISSING]))
        stop_if_asked()


def finish(problem: Problem, state: State) -> Packing:
    """Return the packing of the spheres, in the order of their placement."""
    placed = state.counters["placed"]
    grains, spheres = state.arrays["order"][:placed], state.arrays["spheres"][:placed]
    # if the lowest position is next, the spheres on top are a free surface
    gravity = as_down("down", problem.container) if _order(problem, state) == LOWEST else None
    packing = packing_of_spheres(problem, grains, spheres, state.stop_reason, gravity=gravity)
    # a run that was interrupted is resumed with the requested sizes
    return packing if state.stop_reason in ("", "interrupted") else _grown(problem, packing)


def _grown(problem: Problem, packing: Packing) -> Packing:
    """Return the packing with its grains grown, and the distance of their sizes from those requested before."""
    asked: AdvancingFront = problem.parameters
    if asked.grow == 1.0:
        return packing
    drawn = problem.diameter[problem.started :] * problem.unit_length
    missed = size_distance(drawn, packing.diameters[problem.started :])
    grown = grow(packing, max_factor=asked.grow)
    growth = {**grown.provenance["growth"], "gradation_missed_before": missed}
    return replace(grown, provenance={**grown.provenance, "growth": growth})


def cost(problem: Problem) -> Cost:
    """Return the cost of a run."""
    return Cost(memory=300 * problem.count + 2**22, attempts=_most_attempts(problem, dense=True) + PATIENCE)


@dataclass(frozen=True, slots=True)
class Precomputed:
    """Data that follow from the problem: radii of the grains, walls, cells and rules of the front."""

    radius: Floats
    walls: KernelContainer
    cells: LevelGrid
    rules: FrontRules


def _precomputed(problem: Problem, state: State) -> Precomputed:
    """Return the precomputed data with all spheres linked, computed again after a checkpoint was read."""
    if "precomputed" not in state.derived:
        radius = problem.bounding_radii
        walls, widest = front_container(problem.container, float(radius.min(initial=np.inf)))
        cells = lay_cells(walls.lengths, walls.periods, radius, problem.dimension)
        link_all(cells, state.arrays["spheres"], state.counters["placed"])
        asked: AdvancingFront = problem.parameters
        pocket = float(np.quantile(radius, POCKET)) if len(radius) else 1.0
        goal = widest + np.array(ASIDE) * pocket
        first = widest if problem.start is None else np.zeros(0)
        rules = FrontRules(
            _is_dense(problem, state), _order(problem, state), asked.tries, goal, PATIENCE, first, pocket
        )
        state.derived["precomputed"] = Precomputed(radius, walls, cells, rules)
        numbers, points = np.zeros(FEW, dtype=np.int64), np.zeros((FEW, 5))
        state.derived["scratch"] = numbers, points, np.zeros(FEW), np.zeros((FEW, 3), dtype=np.int64)
    made: Precomputed = state.derived["precomputed"]
    return made


def _is_dense(problem: Problem, state: State) -> bool:
    """Return whether spheres are placed wherever they touch three others; in a narrow container they always are."""
    return problem.parameters.mode == "dense" or state.counters["narrow"] == 1


def _order(problem: Problem, state: State) -> int:
    """Return the order of positions; dense packing takes the lowest if the order is random."""
    asked: AdvancingFront = problem.parameters
    return LOWEST if _is_dense(problem, state) and asked.order == "random" else ORDERS[asked.order]


def _look(problem: Problem, state: State) -> bool:
    """Set the stop reason when all grains are placed or no seed of the front fits; return whether it is set."""
    if state.counters["placed"] == problem.count:
        state.stop_reason = "count"
    elif state.counters["missed_in_a_row"] >= PATIENCE:
        if _is_narrow(problem, state):
            # the pockets of all spheres are listed again, with those at walls
            state.counters.update(narrow=1, missed_in_a_row=0, ranked=0)
            state.total = state.done + _most_attempts(problem, dense=True)
            state.derived.clear()
        else:
            state.stop_reason = "full"
    return bool(state.stop_reason)


def _is_narrow(problem: Problem, state: State) -> bool:
    """Return whether no loose front was started: in such a slab or tube walls must replace spheres."""
    if problem.parameters.mode == "dense" or state.counters["narrow"]:
        return False
    return state.counters["placed"] - problem.started < problem.dimension


def _make_room(state: State, missing: int) -> None:
    """Enlarge the arrays that were too short by half."""
    if missing == FRONT_SHORT:
        for name in ("key", "touched"):
            state.arrays[name] = _longer(state.arrays[name])
    ref, near, key, touched = state.derived["scratch"]
    if missing == NEAR_SHORT:
        ref, near = _longer(ref), _longer(near)
    if missing == FOUND_SHORT:
        key, touched = _longer(key), _longer(touched)
    state.derived["scratch"] = ref, near, key, touched


def _longer(array: Any) -> Any:
    """Return an array with half as many further rows."""
    new = np.zeros((len(array) + len(array) // 2, *array.shape[1:]), dtype=array.dtype)
    new[: len(array)] = array
    return new


def _most_attempts(problem: Problem, *, dense: bool) -> int:
    """Return the largest number of visited positions, without the seeds of the front before the last."""
    return (12 if dense else 4) * problem.count + PATIENCE


registration = PackingMethod(
    summary="each new sphere touches three others, on the outer side of the front; other shapes by bounding spheres",
    source="J. Dalian Univ. Technol. 2011, 51(2), 236-243; Feng, Han & Owen 2003, doi:10.1002/nme.583; Bennett 1972, "
    "doi:10.1063/1.1661585",
    parameters=AdvancingFront,
    prepare=prepare,
    advance=advance,
    finish=finish,
    cost=cost,
    tilted=True,
    dimensions=(2, 3),
    start="placed",
    obstacles="placed",
)
