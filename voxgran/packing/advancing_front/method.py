"""Advancing front: each sphere touches three that are there, on the outer side of the face that they span.

Three spheres that touch each other begin; the face between them, seen from both sides, is the first front. A face is
chosen, a sphere is put where it touches the three, and the face makes way for the three new ones. Where no sphere fits
the face is closed. Nothing is moved and nothing is tried at random: seconds for millions of spheres, about twice as
many for sizes that range over a factor of three. In slabs and tubes so narrow that no three spheres find room that
touch each other, walls stand in for spheres.

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

from voxgran._base.arrays import Floats, Integers, as_count, as_number
from voxgran._base.config import parameter
from voxgran._base.errors import InputError, TooLargeError
from voxgran._base.rotation import normalized
from voxgran._base.seeds import philox_key, stream
from voxgran._base.stopping import stop_if_asked
from voxgran.contacts.parts import is_one_sphere
from voxgran.contacts.verify import verify
from voxgran.containers.sphere import Sphere
from voxgran.packing.advancing_front.container import FrontRoom, front_room_of
from voxgran.packing.advancing_front.front import LAST, LOWEST, MISSING, NEAREST, RANDOM, Bed, Front, Rules
from voxgran.packing.advancing_front.level_grid import BITS, SphereCells, lay_cells, link_all
from voxgran.packing.advancing_front.pockets import FOUND_SHORT, FRONT_SHORT, NEAR_SHORT, Scratch, advance_front
from voxgran.packing.down import as_down
from voxgran.packing.draw import size_distance
from voxgran.packing.hand_over import packing_of_poses
from voxgran.packing.method import Cost, PackingMethod, State
from voxgran.packing.model import Packing
from voxgran.packing.problem import Problem
from voxgran.packing.start import Start, refuse_start
from voxgran.packing.transform.grow import grow

#: what the kernels count, in their order
TALLY = ("front", "placed", "ranked", "closed", "begun", "missed_in_a_row")
#: beginnings in a row without room after which the container is full
PATIENCE = 1000
#: share of the spheres that are smaller than the one that pockets are looked for with
POCKET = 0.5
#: how far what is near is measured from beside the first sphere, in radii of that one: places around it are no ties
ASIDE = (0.013, 0.029, 0.007)
ORDERS = {"random": RANDOM, "nearest": NEAREST, "lowest": LOWEST}
#: a sphere and its image share 31 bits
MOST = 2 ** (31 - BITS)
#: places of the front, neighbours and pockets of a sphere for which there is room at first
FIRST, FEW = 128, 128


@dataclass(frozen=True, kw_only=True, slots=True)
class AdvancingFront:
    """Parameters of the advancing front.

    Raises
    ------
    InputError
        If a number is out of its range, or dense packing is asked to take any place.
    """

    mode: Literal["loose", "dense"] = parameter(
        "loose",
        doc="where a sphere may come: on three that touch each other, or wherever it touches three spheres or walls",
    )
    order: Literal["random", "nearest", "lowest"] = parameter(
        "nearest", doc="which place is next: any, the nearest to where the container is widest, or the lowest"
    )
    tries: int = parameter(
        5, doc="waiting grains that are tried at a place, in their order; so many may be overtaken, at most"
    )
    grow: float = parameter(
        1.0,
        doc="largest factor by which all grains grow at the end, about their centroids, until each touches; 1: not",
    )

    def __post_init__(self) -> None:
        """Check the ranges."""
        as_count(self.tries, "tries", at_least=1)
        as_number(self.grow, "grow", at_least=1.0)
        if self.mode == "dense" and self.order == "random":
            raise InputError(
                "order is 'random': dense packing takes the best place; choose nearest or lowest, or loose"
            )


def prepare(problem: Problem) -> State:
    """Return the state in which all grains wait, but those of the start.

    Raises
    ------
    InputError
        If a grain of the start overlaps another or reaches through a wall.
    TooLargeError
        If there are 2**26 grains or more.
    """
    if problem.count >= MOST:
        raise TooLargeError(f"count is {problem.count}: the front takes fewer than {MOST} grains; pack in parts")
    n = 0 if problem.start is None else problem.start.count
    order = stream(problem.seed, "order").permutation(np.arange(n, problem.count, dtype=np.int64))
    arrays = {
        "spheres": _spheres(problem),
        "order": np.concatenate([np.arange(n, dtype=np.int64), order]),
        "key": np.zeros(FIRST),
        "touched": np.zeros((FIRST, 3), dtype=np.int32),
    }
    most = _most_attempts(problem, dense=problem.parameters.mode == "dense")
    state = State(arrays, dict.fromkeys((*TALLY, "narrow"), 0), 0, most)
    if problem.start is not None:
        _enter_start(problem, state, problem.start)
    _look(problem, state)
    return state


def _spheres(problem: Problem) -> Floats:
    """Return room for the spheres, and in the last row the wall of a sphere, where the container is one."""
    spheres = np.zeros((problem.count + 1, 4))
    if isinstance(problem.container, Sphere):
        spheres[-1] = np.array([1.0, 1.0, 1.0, -1.0]) * problem.container.radius
    return spheres


def advance(problem: Problem, state: State, attempts: int) -> State:
    """Visit up to `attempts` places of the front."""
    if state.stop_reason:
        return state
    setting, last = _setting(problem, state), state.done + attempts
    key = philox_key(problem.seed, "advancing_front")
    tally = np.zeros(LAST + 3, dtype=np.int64)
    tally[:MISSING] = [state.counters[name] for name in TALLY]
    while True:
        bed = Bed(state.arrays["spheres"], state.arrays["order"], setting.radius)
        front, scratch = Front(state.arrays["key"], state.arrays["touched"]), Scratch(*state.derived["scratch"])
        world = (bed, front, setting.cells, setting.room, setting.rules, scratch)
        state.done = int(advance_front(*world, tally, key, state.done, last))
        state.counters.update(zip(TALLY, tally.tolist(), strict=False))
        if _look(problem, state):
            # cells and radii are as large as the spheres, and nobody asks for them any more
            state.derived.clear()
            return state
        if not tally[MISSING]:
            return state
        _make_room(state, int(tally[MISSING]))
        stop_if_asked()


def finish(problem: Problem, state: State) -> Packing:
    """Return the packing of the spheres, in the order in which they came."""
    placed = state.counters["placed"]
    grains, spheres = state.arrays["order"][:placed], state.arrays["spheres"][:placed]
    packing = packing_of_poses(
        problem,
        grains,
        position=spheres[:, :3] + problem.container.bounds[0],
        orientation=_orientations(problem, grains),
        provenance={},
        stop_reason=state.stop_reason,
        # where the lowest place comes first, what lies above is a free surface
        gravity=as_down("down", problem.container) if _order(problem, state) == LOWEST else None,
        contact_gap=0.0,
    )
    # a run that was cut short goes on from where it is, with the sizes that were asked
    return packing if state.stop_reason in ("", "interrupted") else _grown(problem, packing)


def _grown(problem: Problem, packing: Packing) -> Packing:
    """Return the packing with its grains grown, and how far their sizes had been from those asked before they were."""
    asked: AdvancingFront = problem.parameters
    if asked.grow == 1.0:
        return packing
    here = 0 if problem.start is None else problem.start.count
    drawn = problem.diameter[here:] * problem.unit_length
    missed = size_distance(drawn, packing.diameters[here:])
    grown = grow(packing, max_factor=asked.grow)
    growth = {**grown.provenance["growth"], "gradation_missed_before": missed}
    return replace(grown, provenance={**grown.provenance, "growth": growth})


def cost(problem: Problem) -> Cost:
    """Return what a run takes."""
    return Cost(memory=300 * problem.count + 2**22, attempts=_most_attempts(problem, dense=True) + PATIENCE)


@dataclass(frozen=True, slots=True)
class _Setting:
    """What follows from the problem: radii of the grains, walls, cells and how the front advances."""

    radius: Floats
    room: FrontRoom
    cells: SphereCells
    rules: Rules


def _setting(problem: Problem, state: State) -> _Setting:
    """Return the setting, with all spheres in their cells, made again where the state was read from a checkpoint."""
    if "setting" not in state.derived:
        radius = np.array([shape.bounding_radius for shape in problem.shapes])[problem.shape_id] * problem.diameter
        room = front_room_of(problem.container, float(radius.min(initial=np.inf)))
        cells = lay_cells(room.lengths, room.periodic, radius, problem.dimension)
        link_all(cells, state.arrays["spheres"], state.counters["placed"])
        asked: AdvancingFront = problem.parameters
        pocket = float(np.quantile(radius, POCKET)) if len(radius) else 1.0
        goal = room.center + np.array(ASIDE) * pocket
        first = room.center if problem.start is None else np.zeros(0)
        rules = Rules(_is_dense(problem, state), _order(problem, state), asked.tries, goal, PATIENCE, first, pocket)
        state.derived["setting"] = _Setting(radius, room, cells, rules)
        numbers, points = np.zeros(FEW, dtype=np.int64), np.zeros((FEW, 5))
        state.derived["scratch"] = numbers, points, np.zeros(FEW), np.zeros((FEW, 3), dtype=np.int64)
    made: _Setting = state.derived["setting"]
    return made


def _is_dense(problem: Problem, state: State) -> bool:
    """Return whether a sphere may come wherever it touches three; in a narrow container it always may."""
    return problem.parameters.mode == "dense" or state.counters["narrow"] == 1


def _order(problem: Problem, state: State) -> int:
    """Return which place is next; dense packing takes the lowest where any was asked for."""
    asked: AdvancingFront = problem.parameters
    return LOWEST if _is_dense(problem, state) and asked.order == "random" else ORDERS[asked.order]


def _enter_start(problem: Problem, state: State, start: Start) -> None:
    """Put the grains of the start where they are, if they are free there."""
    first = np.arange(start.count)
    grains = Packing.of(
        problem.shapes,
        problem.container,
        position=start.position,
        scale=problem.diameter[first],
        shape_id=problem.shape_id[first],
        orientation=start.orientation,
    )
    proof = verify(grains)
    if not proof.ok:
        wrong = [item.grain for item in proof.escapes] or [max(pair.i, pair.j) for pair in proof.pairs]
        refuse_start(wrong[0])
    lower, upper = problem.container.bounds
    place = start.position - lower
    wraps = np.flatnonzero(problem.container.periodic)
    place[:, wraps] %= (upper - lower)[wraps]
    spheres = state.arrays["spheres"]
    spheres[: start.count, :3], spheres[: start.count, 3] = place, grains.bounding_radii
    state.counters["placed"] = start.count


def _look(problem: Problem, state: State) -> bool:
    """Stop when all grains are in, or nothing can begin any more; return whether that is so."""
    if state.counters["placed"] == problem.count:
        state.stop_reason = "count"
    elif state.counters["missed_in_a_row"] >= PATIENCE:
        if _is_narrow(problem, state):
            # all spheres are looked at again, and walls with them
            state.counters.update(narrow=1, missed_in_a_row=0, ranked=0)
            state.total = state.done + _most_attempts(problem, dense=True)
            state.derived.clear()
        else:
            state.stop_reason = "full"
    return bool(state.stop_reason)


def _is_narrow(problem: Problem, state: State) -> bool:
    """Return whether a loose front never began: in such a slab or tube walls have to stand in for spheres."""
    if problem.parameters.mode == "dense" or state.counters["narrow"]:
        return False
    n = 0 if problem.start is None else problem.start.count
    return state.counters["placed"] - n < problem.dimension


def _make_room(state: State, missing: int) -> None:
    """Make half as much room again for what was missing."""
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
    """Return an array with half as many rows again."""
    new = np.zeros((len(array) + len(array) // 2, *array.shape[1:]), dtype=array.dtype)
    new[: len(array)] = array
    return new


def _most_attempts(problem: Problem, *, dense: bool) -> int:
    """Return how many places are visited at the most, beginnings apart from the last aside."""
    return (12 if dense else 4) * problem.count + PATIENCE


def _orientations(problem: Problem, grains: Integers) -> Floats | None:
    """Return orientations: those of the start, and random ones of all that are no spheres."""
    n = 0 if problem.start is None else problem.start.count
    if all(is_one_sphere(shape.geometry) for shape in problem.shapes) and not n:
        return None
    turns = stream(problem.seed, "turns").normal(size=(problem.count, 4))
    if problem.dimension == 2:
        turns[:, 1:3] = 0.0
    if problem.start is not None:
        turns[:n] = problem.start.orientation
    return normalized(turns[grains])


registration = PackingMethod(
    name="advancing_front",
    summary="each sphere touches three others, on the outer side of the front; other shapes inside their spheres",
    source="J. Dalian Univ. Technol. 2011, 51(2), 236-243; Feng, Han & Owen 2003, doi:10.1002/nme.583; Bennett 1972, "
    "doi:10.1063/1.1661585",
    parameters=AdvancingFront,
    prepare=prepare,
    advance=advance,
    finish=finish,
    cost=cost,
    dimensions=(2, 3),
)
