"""Deposition: one grain after the other falls from a random place, and sticks or rolls to where it rests.

A sphere falls until it touches another or the floor. With the probability `sticking` it stays there (ballistic
deposition, Vold 1959); otherwise it rolls down on one and then on two others to a place on three (on two in two
dimensions), from which no way leads down (Visscher & Bolsterli 1972). No grain moves after it has come to rest. Toward
the center, spheres arrive along random lines at a cluster around the first one.

Shapes that are no spheres are represented by their bounding spheres, in random orientations.

References
----------
Vold 1959, A numerical approach to the problem of sediment volume, Journal of Colloid Science 14, 168-174,
doi:10.1016/0095-8522(59)90041-8.
Visscher & Bolsterli 1972, Random packing of equal and unequal spheres in two and three dimensions, Nature 239, 504-507,
doi:10.1038/239504a0.
"""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.checkpoint import MOST, Held
from voxgran._base.config import parameter, parameter_class
from voxgran._base.errors import InputError
from voxgran._base.seeds import philox_key
from voxgran.containers.gravity import as_down, usual_axis
from voxgran.containers.kernel_container import KernelContainer, kernel_container
from voxgran.containers.model import boundary_of
from voxgran.geometry.level_grid import level_cells
from voxgran.packing.beds.inlet import Inlet, column_below
from voxgran.packing.deposition.facets import standing_out
from voxgran.packing.deposition.field import ROWS, WIDTH, Field
from voxgran.packing.deposition.rain import LOST, MISSED, PATIENCE, PLACED, TALLIES, Tops, drop_spheres, put_again
from voxgran.packing.method import Cost, PackingMethod, State, spheres_within
from voxgran.packing.model import Packing
from voxgran.packing.obstacles import refuse_no_spheres
from voxgran.packing.problem import Problem, packing_of_spheres, spheres_of_start

#: bytes of a grain (measured), and attempts per grain, of which most find a place
GRAIN_BYTES, ATTEMPTS = 200, 20
#: length up to which a grain may reach beyond a wall, in lengths of the container
ROUNDING = 1e-13
#: places along each axis among which the target is found
LATTICE = 20


@parameter_class
class Deposition:
    """Parameters of deposition.

    Parameters
    ----------
    sticking
        probability that a grain stays where it first touches something; 0: all roll to a stable place, 1: none.
    toward
        where grains fall: down, or from all sides toward the place farthest from all walls.
    drops
        drops of each grain, of which the lowest place is taken, or that nearest to the center.
    inlet
        disk or rectangle below which grains fall to the floor; if omitted, the whole container.

    Raises
    ------
    InputError
        If a number is out of its range.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.pack(vg.shapes.sphere(), vg.Box((5, 5, 10)), vg.methods.Deposition(sticking=1.0), count=20).count
    20
    """

    sticking: float = parameter(0.0, at_least=0.0, at_most=1.0)
    toward: Literal["floor", "center"] = parameter("floor")
    drops: int = parameter(1, at_least=1)
    inlet: Inlet | None = parameter(None)


def prepare(problem: Problem) -> State:
    """Return the state in which only the grains of the start are placed.

    Raises
    ------
    InputError
        If grains fall along a periodic axis, or toward the center of a container with periodic axes, the inlet is
        refused, an obstacle is no sphere, or a grain of the start overlaps another or reaches beyond a wall.
    """
    settings: Deposition = problem.parameters
    container, central = problem.container, settings.toward == "center"
    if not central and container.periodic[problem.dimension - 1]:
        axis = "xyz"[problem.dimension - 1]
        raise InputError(
            f"periodic is {_axes(container.periodic)}: grains fall along {axis}, to a floor; give a container with "
            f"walls along {axis}, or toward='center'"
        )
    if central and any(container.periodic):
        raise InputError(
            f"periodic is {_axes(container.periodic)}: grains that fall toward the center have no periodic images; "
            "give a container with walls"
        )
    refuse_no_spheres(problem, "deposition")
    _inlet(problem, problem.dimension - 1)
    spheres = np.zeros((problem.count, 4))
    spheres[: problem.started] = spheres_of_start(problem)
    arrays = {"spheres": spheres, "tally": np.array([problem.started, *[0] * (TALLIES - 1)])}
    most = ATTEMPTS * (problem.count - problem.started) + PATIENCE
    declared = {"spheres": spheres_within(problem), "tally": Held(0, [problem.count, *[MOST] * (TALLIES - 1)])}
    state = State(arrays, {}, 0, most, declared=declared)
    _look(problem, state)
    return state


def _axes(periodic: tuple[bool, ...]) -> str:
    """Return periodic axes as text."""
    return "".join(axis for axis, wraps in zip("xyz", periodic, strict=False) if wraps) or "none"


@dataclass(frozen=True, slots=True)
class Precomputed:
    """What follows from the problem and the placed spheres."""

    field: Field
    radius: Floats
    level: Any
    tops: Tops


def advance(problem: Problem, state: State, attempts: int) -> State:
    """Make up to `attempts` attempts, each of which drops one grain."""
    if state.stop_reason:
        return state
    if "precomputed" not in state.derived:
        state.derived["precomputed"] = _precomputed(problem, state)
    made: Precomputed = state.derived["precomputed"]
    settings: Deposition = problem.parameters
    last = min(state.done + attempts, state.total)
    state.done = int(
        drop_spheres(
            *(made.field, made.tops, made.radius, made.level),
            *(settings.drops, settings.sticking, philox_key(problem.seed, "deposition")),
            *(state.arrays["tally"], state.done, last),
        )
    )
    _look(problem, state)
    return state


def _precomputed(problem: Problem, state: State) -> Precomputed:
    """Return cells, columns and work space, with the placed spheres in them."""
    walls = _walls(problem)
    radius = problem.bounding_radii
    reach = radius if len(radius) else np.ones(1)
    cells, level = level_cells(walls.lengths, walls.periods, reach, problem.dimension)
    up, lengths = problem.dimension - 1, np.where(np.arange(3) < problem.dimension, walls.lengths, 0.0)
    across = np.array([lengths[0], lengths[3 - up]])
    count = np.maximum(across / (2.0 * reach.max()), 1.0).astype(np.int64)
    width = np.where(across > 0.0, across / count, 1.0)
    tops = Tops(count, width, np.zeros(int(count.prod())), np.zeros(1))
    work = np.zeros((3, WIDTH)), np.zeros((ROWS, 3))
    central = problem.parameters.toward == "center"
    flat = np.array(boundary_of(problem.container).flat, dtype=np.int64)
    field = Field(
        state.arrays["spheres"],
        cells,
        lengths,
        flat,
        up,
        central,
        _widest(problem),
        *work,
        walls,
        standing_out(walls.mesh),
        _inlet(problem, up),
    )
    made = Precomputed(field, radius, level, tops)
    put_again(field, tops, level, int(state.arrays["tally"][PLACED]))
    return made


def _inlet(problem: Problem, up: int) -> Floats:
    """Return the inlet, from the lower corner, as :class:`Field` describes it.

    Raises
    ------
    InputError
        If it has a height or a rate, grains fall toward the center, or :func:`column_below` refuses it.
    """
    settings: Deposition = problem.parameters
    if settings.inlet is None:
        return np.array([0.0, 0.0, np.inf, np.inf, 0.0])
    if settings.toward == "center":
        raise InputError("inlet is given with toward='center': grains fall below an inlet to the floor; leave one out")
    for name in ("height", "rate"):
        if (value := getattr(settings.inlet, name)) is not None:
            raise InputError(
                f"{name} of inlet is {value:g}: by deposition grains come one by one from above all others; leave it "
                "out, or take the method 'gravity'"
            )
    column, _ = column_below(settings.inlet, problem, np.eye(3)[up], np.zeros((0, 4)))
    center, half = column.center - problem.container.bounds[0], column.half
    return np.array([center[0], center[3 - up], half[0], half[-1], float(len(half) == 1)])


def _walls(problem: Problem) -> KernelContainer:
    """Return the walls, from the lower corner."""
    lower, upper = problem.container.bounds
    return kernel_container(problem.container, from_corner=True, slack=ROUNDING * float((upper - lower).max()))


def _widest(problem: Problem) -> Floats:
    """Return the place farthest from all walls, among the middle of the bounds and a lattice, from the lower corner."""
    container, (lower, upper) = problem.container, problem.container.bounds
    axes = np.arange(3) < problem.dimension
    share = np.indices(np.where(axes, LATTICE, 1).tolist()).reshape(3, -1).T / (LATTICE - 1.0)
    points = np.vstack([0.5 * (lower + upper), lower + share * (upper - lower)])
    return np.asarray(points[np.argmin(container.signed_distance(points))] - lower)


def _look(problem: Problem, state: State) -> None:
    """Set the stop reason."""
    tally = state.arrays["tally"]
    state.end_if(placed=bool(tally[PLACED] == problem.count), full=bool(tally[MISSED] >= PATIENCE))


def finish(problem: Problem, state: State) -> Packing:
    """Return the packing of the grains that were placed."""
    tally = state.arrays["tally"]
    many, down = int(tally[PLACED]), problem.parameters.toward == "floor"
    gravity = as_down(usual_axis(problem.container), problem.container) if down else None
    told: dict[str, Any] = {"provenance": {"lost": int(tally[LOST])}, "gravity": gravity}
    return packing_of_spheres(problem, np.arange(many), state.arrays["spheres"][:many], state.stop_reason, **told)


def cost(problem: Problem) -> Cost:
    """Return the cost of a run."""
    return Cost(memory=GRAIN_BYTES * problem.count + 2**22, attempts=ATTEMPTS * problem.count + PATIENCE)


registration = PackingMethod(
    summary="grains fall one after the other and stick where they touch, or roll to a place on three others",
    source="Vold 1959, doi:10.1016/0095-8522(59)90041-8; Visscher & Bolsterli 1972, doi:10.1038/239504a0",
    parameters=Deposition,
    prepare=prepare,
    advance=advance,
    finish=finish,
    cost=cost,
    dimensions=(2, 3),
    start="placed",
    obstacles="placed",
)
