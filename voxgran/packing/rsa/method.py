"""Random sequential addition: grains are placed one by one at random positions; those that overlap are rejected.

Grains are spheres, in two dimensions disks, or true shapes in random orientations, of which the overlap is decided
exactly (:mod:`voxgran.contacts.overlap.true_pairs`): ellipsoids, boxes, cylinders, cones, polyhedra, meshes, unions of
spheres and outlines. With `aligned`, boxes and rectangles stand along the axes.

Candidates are made by the schemes of Chu 2011. ``classic``: a candidate that overlaps is rejected. ``1``: it is moved
away from the grain that it overlaps most, along the line of centers by the overlap, up to `corrections` times, and then
rejected. ``2``: only its position is rejected, its radius is tried elsewhere. ``3``: both. ``4a`` to ``4d``:
coordinates are sorted along an axis first, then as ``classic``, ``1``, ``2``, ``3``. True shapes and aligned boxes are
not moved: for them the schemes are ``classic``, ``2``, ``4a`` and ``4c``; each candidate has an orientation of its own.

The text and the tables of Chu 2011 disagree about a retained radius. ``retry="next"`` follows the text: it is tried at
the next coordinate; this reproduces the requested size fractions, which the tables do not. ``retry="scan"`` comes
closest to the tables: each size is tried once at every unused coordinate.

With ``until="saturated"`` the available space is tracked by cells that are subdivided until none is left
(:mod:`voxgran.packing.rsa.available_cells`), which proves saturation. If a count or a solid fraction is requested,
scheme ``classic`` does the same from the first grain on for which all tries failed, unless ``until="tries"`` is given.

Of true shapes the cells are closed where the sphere inside the new grain meets a grain in any case, so that throws into
the others are uniform over all places. Some places stay open in which no orientation fits: saturation is proven only if
all are closed. Otherwise the grains left are tried in rounds of `tries` throws each, until as many throws in a row have
failed as one round of all grains has; the run is then not proven to be saturated.

References
----------
Chu 2011, Rock and Soil Mechanics: generation of granular samples by sorted coordinates
Zhang & Torquato 2013, Precise algorithm to generate random sequential addition of hard hyperspheres at saturation,
Physical Review E 88, 053312, doi:10.1103/PhysRevE.88.053312
Feder 1980, Random sequential adsorption, Journal of Theoretical Biology 87(2), 237-254,
doi:10.1016/0022-5193(80)90358-6
"""

from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import Integers, Words
from voxgran._base.config import check_bounds, parameter, parameter_class
from voxgran._base.errors import InputError
from voxgran._base.seeds import philox_key
from voxgran.contacts.manifolds.convex_bodies import is_convex
from voxgran.contacts.overlap.true_shapes import TrueShapes
from voxgran.contacts.verify import verify
from voxgran.packing.method import Cost, PackingMethod, State
from voxgran.packing.model import Packing
from voxgran.packing.problem import Problem
from voxgran.packing.rsa.available_cells import (
    PUT_OFF,
    UNPROVEN,
    Open,
    Throws,
    all_edges,
    cut_cells,
    deepest_cut,
    first_cells,
    throw_into_cells,
    volumes_up_to,
)
from voxgran.packing.rsa.candidates import DROP, NEXT, SCAN, TRIED, TURN, Coordinates, add_candidates
from voxgran.packing.rsa.deferred_grains import aim, left_out, open_late
from voxgran.packing.rsa.held import fits, held_of
from voxgran.packing.rsa.overlaps import Bed, Grains, link_all
from voxgran.packing.rsa.precompute import (
    Precomputed,
    coordinate_count,
    has_true_shapes,
    order_of,
    precompute,
    refuse_moves,
    searches,
)
from voxgran.packing.rsa.saturation import goes_on, proof_of, warn_if_not_proven
from voxgran.packing.start import Start, refuse_outside

#: what the kernels count, in their order
TALLY = ("turn", "tried", "placed", "moved", "refused", "unproven", "put_off", "late", "refused_in_row")
#: where it counts the deferred grains that were tried again
LATE = 7
#: scheme that follows after sorting
UNSORTED = {"4a": "classic", "4b": "1", "4c": "2", "4d": "3"}
#: CPU seconds of a grain that is not convex in an empty container, their growth with the solid fraction, the solid
#: fraction beyond which few find room (measured within a factor of 2, unions of some 300 triangles), and shapes of
#: which one may be such a grain
GRAIN_SECONDS, GROWTH, DENSEST, LOOKED = 5e-5, 23.0, 0.35, 20
#: estimate of the largest number of throws per grain of a saturated run: no bound is known, the mean is below 40
THROWS = 200
#: bytes of a grain, and of its open cells (measured)
BYTES_PER_GRAIN, BYTES_OF_CELLS = 250, 50


@parameter_class
class Rsa:
    """Parameters of random sequential addition.

    Parameters
    ----------
    scheme
        scheme of Chu 2011 for candidates that overlap; 4a to 4d sort the coordinates first.
    until
        when to stop: after `tries`, or when saturation is proven; if omitted, after `tries`, except that scheme classic
        continues to a requested count or solid fraction until it is met or proven to be impossible.
    tries
        coordinates drawn; while the available space is searched, the failed throws after which a grain is deferred if
        there are more than 32 sizes, or true shapes.
    retry
        where a rejected radius is tried next: at every unused coordinate (once per size), or at the next coordinate
        only.
    corrections
        largest number of moves of a candidate, in schemes 1, 3, 4b and 4d.
    order
        order of insertion: as drawn, largest first, or random; if omitted, as drawn, except that scheme classic puts
        the largest first if a solid fraction is requested, since more then find room.
    along
        axis along which coordinates are sorted.
    numbers
        random numbers of the coordinates; the linear congruential sequence of Chu 2011 is for replication only: its
        axes are shifts of one cycle of 65536 numbers.
    aligned
        whether boxes and rectangles stand along the axes instead of in random orientations.

    Raises
    ------
    InputError
        If a number is out of its range, or parameters contradict each other.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), vg.methods.Rsa(tries=100), count=10).count
    10
    """

    scheme: Literal["classic", "1", "2", "3", "4a", "4b", "4c", "4d"] = parameter("classic")
    until: Literal["tries", "saturated"] | None = parameter(None)
    tries: int = parameter(1000, unit="per grain", at_least=1)
    retry: Literal["scan", "next"] = parameter("scan")
    corrections: int = parameter(2, at_least=1)
    order: Literal["given", "largest", "random"] | None = parameter(None)
    along: Literal["x", "y", "z"] = parameter("x")
    numbers: Literal["philox", "lcg"] = parameter("philox")
    aligned: bool = parameter(False)

    def __post_init__(self) -> None:
        """Check the ranges."""
        check_bounds(self)
        if self.until == "saturated" and (self.scheme != "classic" or self.numbers != "philox"):
            raise InputError(
                f"scheme {self.scheme!r} with {self.numbers} numbers is asked for until saturated: the proof needs "
                "'classic' and 'philox'; leave them out"
            )
        if self.aligned and self.correcting:
            raise InputError(
                f"aligned is asked for in scheme {self.scheme!r}: boxes have no line of centres to be moved along; use "
                "'classic', '2', '4a' or '4c'"
            )

    @property
    def correcting(self) -> bool:
        """Whether candidates that overlap are moved."""
        return UNSORTED.get(self.scheme, self.scheme) in ("1", "3")

    @property
    def against_orientations(self) -> str:
        """What orientations that are asked for do not go together with."""
        return "aligned is True" if self.aligned else ""

    @property
    def retaining(self) -> int:
        """Where the radius of a rejected candidate is tried next: DROP, NEXT or SCAN."""
        if UNSORTED.get(self.scheme, self.scheme) not in ("2", "3"):
            return DROP
        return SCAN if self.retry == "scan" else NEXT

    @property
    def tabled(self) -> bool:
        """Whether all coordinates are computed beforehand."""
        return self.scheme in UNSORTED or self.numbers == "lcg"


def prepare(problem: Problem) -> State:
    """Return the initial state, in which only the grains of the start are placed.

    Raises
    ------
    InputError
        If a grain of the start overlaps another or reaches beyond a wall, `aligned` is set and a shape is not a box, or
        the scheme moves candidates and a shape is not a sphere.
    TooLargeError
        If more than 2**31 coordinates would have to be stored.
    """
    n, many = problem.count, problem.parameters.tries * (problem.count - problem.started)
    arrays: dict[str, Any] = {"position": np.zeros((n, 3)), "entered": np.zeros(n, dtype=np.int8)}
    state = State(arrays, dict.fromkeys(TALLY, 0), 0, _most_attempts(problem))
    state.counters["search_from"] = 0 if problem.parameters.until == "saturated" else -1
    refuse_moves(problem)
    if problem.start is not None or has_true_shapes(problem):
        turns = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
        arrays["orientation"] = turns if problem.orientation is None else problem.orientation.copy()
    if problem.start is not None and problem.start.count:
        _enter_start(problem, state, problem.start)
    made = precompute(problem, state.counters["search_from"])
    if made.classes is not None:
        _open_cells(state, made)
    else:
        arrays["used"] = np.zeros(many if problem.parameters.retaining == SCAN else 0, dtype=np.int8)
        arrays["pointer"] = np.zeros(int(made.kind.max(initial=-1)) + 1, dtype=np.int64)
    _keep(problem, state, made)
    state.declared, state.rule = held_of(problem, made), partial(fits, problem)
    _look(problem, state, made)
    return state


def advance(problem: Problem, state: State, attempts: int) -> State:
    """Make up to `attempts` attempts, each one candidate or one throw into the open cells."""
    if state.stop_reason:
        return state
    if "precomputed" not in state.derived:
        _keep(problem, state, precompute(problem, state.counters["search_from"]))
    made: Precomputed = state.derived["precomputed"]
    bed = _bed_of(state, made)
    tally = np.array([state.counters[name] for name in TALLY], dtype=np.int64)
    last = state.done + attempts
    try:
        if made.classes is None:
            coordinates = Coordinates(made.table, state.arrays["used"], state.arrays["pointer"], made.kind)
            run = (made.queue, tally, philox_key(problem.seed, "rsa"), state.done, last, _true_shapes(state, made))
            state.done = int(add_candidates(bed, made.rules, coordinates, *run))
            if state.done < last and made.rules.ends and tally[TURN] < len(made.queue):
                state.counters["search_from"], tally[TRIED] = int(tally[TURN]), 0
                made = precompute(problem, int(tally[TURN]))
                _open_cells(state, made)
                _keep(problem, state, made)
            elif state.done < last:
                tally[TURN] = len(made.queue)
        if made.classes is not None:
            # the search has a random stream of its own
            stage = "rsa" if problem.parameters.until == "saturated" else "rsa, search"
            _throw(state, made, bed.grains, tally, philox_key(problem.seed, stage), last)
    finally:
        state.counters.update(zip(TALLY, tally.tolist(), strict=True))
    _look(problem, state, made)
    return state


def finish(problem: Problem, state: State) -> Packing:
    """Return the packing of the grains that were placed."""
    placed, arrays = np.flatnonzero(state.arrays["entered"]), state.arrays
    # positions of a million grains are not copied where all were placed
    position = arrays["position"] if len(placed) == len(arrays["entered"]) else arrays["position"][placed]
    proof = "cell" in arrays or has_true_shapes(problem)
    warn_if_not_proven(problem, state)
    return problem.packing(
        placed,
        position=position,
        orientation=arrays["orientation"][placed] if "orientation" in arrays else None,
        provenance={
            "parameters": {"order": order_of(problem)},
            **({"saturation": proof_of(problem, state)} if proof else {}),
        },
        stop_reason=state.stop_reason,
    )


def cost(problem: Problem) -> Cost:
    """Return the cost of a run; the number of attempts of a saturated one is an estimate.

    Raises
    ------
    TooLargeError
        If more than 2**31 coordinates would have to be stored.
    """
    settings: Rsa = problem.parameters
    n, many = problem.count, coordinate_count(problem)
    memory = n * BYTES_PER_GRAIN
    if settings.until == "saturated" or searches(problem):
        memory += n * BYTES_OF_CELLS
    else:
        memory += many * (24 * settings.tabled + (settings.retaining == SCAN))
    return Cost(memory=memory, attempts=_most_attempts(problem), seconds=_expected_seconds(problem))


def _expected_seconds(problem: Problem) -> float:
    """Return the expected CPU time of shapes of which one is not convex; 0 where all are, which take little."""
    if problem.dimension == 2 or all(shape.is_sphere or is_convex(shape.geometry) for shape in problem.shapes[:LOOKED]):
        return 0.0
    share = min(float(problem.volumes.sum() / problem.container.volume), DENSEST)
    return problem.count * GRAIN_SECONDS * float(libm.exp(GROWTH * share))


def _most_attempts(problem: Problem) -> int:
    """Return the largest number of attempts of a run."""
    settings: Rsa = problem.parameters
    m = problem.count - problem.started
    if settings.until == "saturated":
        return (settings.tries if has_true_shapes(problem) else THROWS) * m
    if settings.retaining == SCAN:
        sizes = len(np.unique(np.column_stack([problem.shape_id, problem.diameter]), axis=0))
        return sizes * settings.tries * m
    return (settings.tries + THROWS * searches(problem)) * m


def _enter_start(problem: Problem, state: State, start: Start) -> None:
    """Place the grains of the start at their positions; they may touch.

    Raises
    ------
    InputError
        If the true shape of one overlaps that of another, or reaches beyond a wall.
    """
    n, proof = start.count, verify(problem.start_assembly(start))
    if not proof.ok:
        refuse_outside(start, problem.container)
        wrong = [escape.grain for escape in proof.escapes] + [pair.j for pair in proof.pairs]
        raise InputError(
            f"grain {min(wrong)} of start finds no place: its true shape reaches beyond a wall or overlaps another; "
            "give a larger container or a looser start"
        )
    state.arrays["position"][:n] = start.wrapped(problem.container)
    state.arrays["orientation"][:n] = start.orientation
    state.arrays["entered"][:n] = 1
    state.counters["placed"] = n


def _keep(problem: Problem, state: State, made: Precomputed) -> None:
    """Store the precomputed data, with the placed grains linked into its cells in the order of their insertion."""
    late = state.arrays.get("late", made.queue[:0])
    first = np.arange(problem.started, dtype=np.int32)
    entering = np.concatenate([first, made.queue[~np.isin(made.queue, late)], late])
    link_all(_bed_of(state, made), entering)
    state.derived["precomputed"] = made


def _open_cells(state: State, made: Precomputed) -> None:
    """Create the initial open cells of all grains that are not placed."""
    assert made.classes is not None
    cells = first_cells(made.classes, made.boxes)
    state.arrays.update(cells._asdict(), late=made.queue[:0].copy())


def _bed_of(state: State, made: Precomputed) -> Bed:
    """Return the grains, their cells and the walls as kernels take them."""
    grains = Grains(state.arrays["position"], made.half, made.level, state.arrays["entered"], made.boxes)
    return Bed(grains, made.cells, made.walls)


def _true_shapes(state: State, made: Precomputed) -> TrueShapes | None:
    """Return true shapes as kernels take them; None without."""
    return None if made.shapes is None else made.shapes._replace(orientation=state.arrays["orientation"])


def _throw(state: State, made: Precomputed, grains: Grains, tally: Integers, key: Words, last: int) -> None:
    """Throw grains into the open cells up to attempt `last`, deferred grains after all others."""
    classes, walls = made.classes, made.walls
    assert classes is not None
    _turns(state, made, made.queue, tally, key, last, late=False)
    if made.shapes is not None:
        while goes_on(state, made, tally):
            # also at the end of a chunk, so that the run does not end there
            tally[TURN] = tally[PUT_OFF] = 0
            if state.done == last:
                return
            _turns(state, made, made.queue, tally, key, last, late=False)
        return
    if tally[TURN] == len(made.queue) and tally[PUT_OFF] and not len(state.arrays["late"]):
        late = left_out(grains, made.queue)
        if tally[UNPROVEN] or not len(late):
            tally[UNPROVEN] += tally[PUT_OFF]
            tally[PUT_OFF] = 0
        else:
            state.arrays["late"] = late
            state.arrays.update(open_late(grains, walls, classes, _open_of(state), late, 0)._asdict())
    late, done = state.arrays["late"], True
    while done and tally[LATE] < len(late):
        turn, own = int(tally[LATE]), tally.copy()
        aim(grains, walls, classes, late, turn)
        own[TURN] = turn
        try:
            _turns(state, made, late[: turn + 1], own, key, last, late=True)
        finally:
            tally[TURN + 1 :] = own[TURN + 1 :]
        done = own[TURN] > turn
        if done and not grains.entered[late[turn]]:
            # cells became too fine without proof; or there is proof, which holds for all larger grains too
            tally[UNPROVEN] += tally[UNPROVEN] and len(late) - turn - 1
            tally[LATE] = len(late)
        elif done:
            tally[LATE] = turn + 1
            if turn + 1 < len(late):
                state.arrays.update(open_late(grains, walls, classes, _open_of(state), late, turn + 1)._asdict())


def _turns(
    state: State, made: Precomputed, queue: NDArray[np.int32], tally: Integers, key: Words, last: int, *, late: bool
) -> None:
    """Throw the grains of a queue, and subdivide cells when too many throws have failed."""
    classes = made.classes
    assert classes is not None
    bed, own = _bed_of(state, made), len(classes.base) - 1 if late else -1
    shapes = _true_shapes(state, made)
    while True:
        cells = _open_of(state)
        sizes = all_edges(classes, cells), volumes_up_to(classes, cells), deepest_cut(classes, made.boxes)
        throws = Throws(queue, own, classes, cells, *sizes, key)
        state.done, kind = throw_into_cells(bed, throws, tally, state.done, last, shapes)
        if kind < 0:
            return
        # stored at once, so that the previous cells can be freed
        state.arrays.update(cut_cells(bed, classes, cells, kind, shapes)._asdict())


def _open_of(state: State) -> Open:
    """Return the open cells as kernels take them."""
    return Open(*(state.arrays[name] for name in Open._fields))


def _look(problem: Problem, state: State, made: Precomputed) -> None:
    """Set the stop reason when all grains are placed or have been tried."""
    if (counters := state.counters)["placed"] == problem.count:
        state.stop_reason = "count"
    elif counters["turn"] == len(made.queue) and (
        not counters["put_off"] or made.shapes is not None or 0 < len(state.arrays["late"]) == counters["late"]
    ):
        # if all grains are wider than the container, none was tried
        closed = not len(made.queue) or (made.classes is not None and counters["unproven"] == 0)
        state.stop_reason = "saturated" if closed else "steps"
    if state.stop_reason:
        # cells and extents take as much memory as the grains and are not needed any more
        state.derived.clear()


registration = PackingMethod(
    summary="random sequential addition of spheres and true shapes: schemes of Chu 2011, or to proven saturation",
    source="Chu 2011, Rock and Soil Mechanics; Zhang & Torquato 2013, doi:10.1103/PhysRevE.88.053312",
    parameters=Rsa,
    prepare=prepare,
    advance=advance,
    finish=finish,
    cost=cost,
    tilted=True,
    any_walls=True,
    dimensions=(2, 3),
    selects=True,
    start="placed",
    obstacles="placed",
)
