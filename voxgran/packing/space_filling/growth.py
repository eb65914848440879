"""Growth: spheres grow from random nuclei at constant rates, and stop when they touch.

The nuclei are all there from the beginning (packing-limited growth), or keep arriving at a constant rate and are lost
where the point is taken (Andrienko, Brilliantov & Krapivsky 1994); the faster the growth is against the arrivals, the
nearer is the result to a random Apollonian packing. Contacts are found event by event in closed form, so that spheres
touch to rounding and never overlap. With a solid fraction the growth ends at the time at which it is met exactly.

Shapes that are no spheres are represented by their bounding spheres, in random orientations.

References
----------
Andrienko, Brilliantov & Krapivsky 1994, Pattern formation by growing droplets: the touch-and-stop model of growth,
Journal of Statistical Physics 75, 507-523, doi:10.1007/BF02186870.
Dodds & Weitz 2002, Packing-limited growth, Physical Review E 65, 056108, doi:10.1103/PhysRevE.65.056108.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import Floats
from voxgran._base.checkpoint import MOST, Held
from voxgran._base.config import parameter, parameter_class
from voxgran._base.seeds import philox_key
from voxgran.containers.kernel_container import KernelContainer, kernel_container
from voxgran.packing.method import Cost, PackingMethod, State, spheres_within
from voxgran.packing.model import Packing
from voxgran.packing.problem import Problem, packing_of_spheres, spheres_of_start
from voxgran.packing.space_filling.growing import (
    GROWING,
    LOST,
    NO_ROOM,
    NUCLEI,
    PATIENCE,
    REACHED,
    Arrivals,
    Heap,
    Spheres,
    enter_all,
    run_events,
)
from voxgran.packing.space_filling.reach_cells import ReachCells, list_sphere, reach_cells, with_room

#: bytes of a grain (measured), and estimate of the largest number of events per grain
GRAIN_BYTES, EVENTS = 500, 10_000
#: cells per sphere, and reach of a nucleus in edges of a cell
CELLS, FIRST_REACH = 1.0, 0.4
#: arrays of a state with a row for each sphere
GROWN = ("spheres", "born", "rate", "room", "reach")


@parameter_class
class Growth:
    """Parameters of the growth.

    Parameters
    ----------
    arrival
        whether all nuclei are there from the beginning, or keep arriving while others grow.
    slowest
        smallest rate of growth, in largest rates, between which all are uniformly distributed; 1: all are equal.
    speed
        for continuous arrival: growth of the radius at the largest rate while as many nuclei arrive as grains are asked
        for, in diameters of as many equal grains that fill the container.

    Raises
    ------
    InputError
        If a number is out of its range.

    Examples
    --------
    >>> import voxgran as vg
    >>> packing = vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), vg.methods.Growth(), count=20)
    >>> packing.count, packing.verify().ok
    (20, True)
    """

    arrival: Literal["together", "continuous"] = parameter("together")
    slowest: float = parameter(1.0, above=0.0, at_most=1.0)
    speed: float = parameter(5.0, above=0.0)


def prepare(problem: Problem) -> State:
    """Return the state in which only the grains of the start are there, which do not grow.

    Raises
    ------
    InputError
        If a grain of the start overlaps another or reaches beyond a wall.
    """
    n, started = problem.count, problem.started
    arrays = {name: np.zeros(n) for name in GROWN} | {"spheres": np.zeros((n, 4))}
    arrays["spheres"][:started] = spheres_of_start(problem)
    arrays["reach"][:started] = arrays["spheres"][:started, 3]
    arrays |= {"powers": np.zeros(5), "tally": np.array([started, 0, 0, 0], dtype=np.int64), "clock": np.zeros(1)}
    far = float(np.ptp(problem.container.bounds, axis=0).max())
    declared = {
        "spheres": spheres_within(problem), "tally": Held(0, [n, MOST, MOST, n]), "clock": Held(0.0),
        **dict.fromkeys(("born", "rate"), Held(0.0)), **dict.fromkeys(("room", "reach"), Held(0.0, far)),
    }  # fmt: skip
    state = State(arrays, {}, 0, EVENTS * (n - started) + PATIENCE, declared=declared, rule=_fits)
    if n == started:
        state.stop_reason = "count"
    return state


def _fits(arrays: Mapping[str, Any], counters: Mapping[str, Any]) -> bool:
    """Return whether what a checkpoint holds goes together: what has no reach would be listed again without end."""
    del counters
    return bool((arrays["reach"][: arrays["tally"][NUCLEI]] > 0.0).all())


@dataclass(slots=True)
class Precomputed:
    """What follows from the problem and the spheres."""

    walls: KernelContainer
    cells: ReachCells
    growth: Spheres
    heap: Heap
    arrivals: Arrivals
    asked: float  # volume that is asked for


def advance(problem: Problem, state: State, attempts: int) -> State:
    """Let up to `attempts` nuclei arrive or spheres touch."""
    if state.stop_reason:
        return state
    if "precomputed" not in state.derived:
        state.derived["precomputed"] = _precomputed(problem, state)
    made: Precomputed = state.derived["precomputed"]
    last, end = min(state.done + attempts, state.total), NO_ROOM
    while end == NO_ROOM:
        done, end = run_events(
            made.walls, made.cells, made.growth, made.heap, made.arrivals, made.asked, state.done, last
        )
        state.done = int(done)
        if end == NO_ROOM:
            made.cells = with_room(made.cells)
    _look(problem, state, int(end))
    return state


def _precomputed(problem: Problem, state: State) -> Precomputed:
    """Return cells and a heap with the spheres in them, and how nuclei arrive."""
    settings: Growth = problem.parameters
    walls = kernel_container(problem.container, from_corner=True)
    arrays, n = state.arrays, problem.count
    rows = {name: arrays[name] for name in (*GROWN, "powers", "tally", "clock")}
    growth = Spheres(**rows, volume=problem.unit_volumes)
    cells = reach_cells(walls, n, CELLS)
    for sphere in range(int(growth.tally[NUCLEI])):
        place = growth.spheres[sphere, :3].tolist()
        while not list_sphere(cells, sphere, *place, float(growth.reach[sphere]), -1.0):
            cells = with_room(cells)
    heap = Heap(np.zeros(n, np.int64), np.full(n, -1), np.zeros(n), np.zeros(n, np.int64))
    growth.tally[GROWING] = 0
    enter_all(cells, growth, heap)
    # the unit of time is that in which as many nuclei arrive as are asked for, if they do not come together
    together = settings.arrival == "together"
    arrivals = Arrivals(
        every=0.0 if together else 1.0 / (n - problem.started),
        slowest=settings.slowest,
        speed=1.0 if together else settings.speed,
        first_reach=FIRST_REACH * float(cells.width[: problem.dimension].min()),
        key=philox_key(problem.seed, "growth"),
    )
    asked = math.inf if problem.asked_fraction is None else problem.asked_fraction * problem.container.volume
    return Precomputed(walls, cells, growth, heap, arrivals, asked)


def _look(problem: Problem, state: State, end: int) -> None:
    """Set the stop reason, and the time at which the solid fraction is met."""
    tally = state.arrays["tally"]
    if end == REACHED:
        _set_clock(problem, state)
        state.stop_reason = "solid_fraction"
    elif tally[LOST] >= PATIENCE and tally[GROWING] == 0:
        state.stop_reason = "full"
    elif tally[NUCLEI] == problem.count and tally[GROWING] == 0:
        state.stop_reason = "count" if problem.asked_fraction is None or problem.asked_count is not None else "full"
    elif state.done >= state.total:
        state.stop_reason = "steps"
    if state.stop_reason:
        state.derived.clear()


def _set_clock(problem: Problem, state: State) -> None:
    """Set the clock to the time at which the solid fraction is met, between the last event and the next one."""
    made: Precomputed = state.derived["precomputed"]
    clock, new = state.arrays["clock"], slice(problem.started, int(state.arrays["tally"][NUCLEI]))
    low, high = float(clock[0]), float(clock[0]) + 1.0

    def volume(time: float) -> float:
        return float((made.growth.volume[new] * libm.power(_radii(state, time)[new], problem.dimension)).sum())

    while volume(high) < made.asked:
        high += high - low
    while high - low > 4.0 * np.spacing(high):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if volume(middle) < made.asked else (low, middle)
    clock[0] = low


def _radii(state: State, time: float) -> Floats:
    """Return the radii of all spheres at a time."""
    arrays = state.arrays
    rate = arrays["rate"]
    return np.where(rate > 0.0, rate * (time - arrays["born"]), arrays["spheres"][:, 3])


def finish(problem: Problem, state: State) -> Packing:
    """Return the packing of the grains with the radii that they have reached."""
    spheres = state.arrays["spheres"].copy()
    spheres[:, 3] = _radii(state, float(state.arrays["clock"][0]))
    many = int(state.arrays["tally"][NUCLEI])
    grown = np.flatnonzero(spheres[:many, 3] > 0.0)
    return packing_of_spheres(problem, grown, spheres[grown], state.stop_reason, sized=True)


def cost(problem: Problem) -> Cost:
    """Return the cost of a run."""
    return Cost(memory=GRAIN_BYTES * problem.count + 2**22, attempts=EVENTS * problem.count + PATIENCE)


registration = PackingMethod(
    summary="spheres grow from random nuclei, which are all there or keep arriving, until they touch",
    source="Andrienko et al. 1994, doi:10.1007/BF02186870; Dodds & Weitz 2002, doi:10.1103/PhysRevE.65.056108",
    parameters=Growth,
    prepare=prepare,
    advance=advance,
    finish=finish,
    cost=cost,
    dimensions=(2, 3),
    sizing="made",
    start="placed",
)
