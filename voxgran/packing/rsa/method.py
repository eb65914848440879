"""Random sequential addition: each grain takes a random place and stays there; what overlaps is refused.

Grains are spheres, in the plane disks. A shape that is no sphere is treated as its bounding sphere about the centroid,
in a random orientation; `aligned` boxes and rectangles stand along the axes and meet as what they are.

Candidates come in the ways of Chu 2011. ``classic``: one that overlaps is dropped. ``1``: it is moved away from the
grain that it overlaps most, along the line of centres by the overlap, up to `corrections` times, then dropped. ``2``:
only the place is dropped, the radius is kept for another place. ``3``: both. ``4a`` to ``4d``: coordinates are sorted
along an axis first, then as ``classic``, ``1``, ``2``, ``3``.

Words and numbers of the paper disagree on how a kept radius goes on. ``retain="next"`` are the words, the next
coordinate; but then all radii go in, in the shares that were asked, and the paper counts other shares. With
``retain="scan"`` each radius scans the coordinates that are not used yet, one that failed at a radius is not tried with
the same radius again: the nearest reading of the numbers that was found.

With ``until="saturated"`` the room that is left is tracked by cells that shrink
(:mod:`voxgran.packing.rsa.available_cells`) until there is none: proof, not patience. Where a count or a solid fraction
is asked for, scheme ``classic`` does the same from the first grain on that has made all its tries in vain, unless
``until="tries"`` is given.

References
----------
Chu 2011, Rock and Soil Mechanics: generation of granular samples by sorted coordinates
Zhang & Torquato 2013, Precise algorithm to generate random sequential addition of hard hyperspheres at saturation,
Physical Review E 88, 053312, doi:10.1103/PhysRevE.88.053312
Feder 1980, Random sequential adsorption, Journal of Theoretical Biology 87(2), 237-254,
doi:10.1016/0022-5193(80)90358-6
"""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Integers, Words, as_count
from voxgran._base.config import parameter
from voxgran._base.errors import InputError
from voxgran._base.seeds import philox_key
from voxgran.contacts.assembly import Assembly
from voxgran.contacts.verify import verify
from voxgran.packing.method import Cost, PackingMethod, State
from voxgran.packing.model import Packing
from voxgran.packing.problem import Problem
from voxgran.packing.rsa.available_cells import (
    PUT_OFF,
    UNPROVEN,
    Open,
    all_edges,
    cut_cells,
    deepest_cut,
    first_cells,
    throw_into_cells,
    volumes_up_to,
)
from voxgran.packing.rsa.candidates import DROP, NEXT, SCAN, TRIED, TURN, Coordinates, add_candidates
from voxgran.packing.rsa.deferred_grains import aim, left_out, open_late
from voxgran.packing.rsa.level_grid import Bed, link_all
from voxgran.packing.rsa.precompute import Setting, coordinate_count, make_setting, newcomers, orientations, searches
from voxgran.packing.start import Start

#: what the kernels count, in their order
TALLY = ("turn", "tried", "placed", "moved", "refused", "unproven", "put_off", "late")
#: where it counts how many of those that were put off had their turn
LATE = 7
#: which scheme follows after sorting
UNSORTED = {"4a": "classic", "4b": "1", "4c": "2", "4d": "3"}
#: throws per grain that a saturated run is thought to take at the most: no bound is known, the mean is below 40
THROWS = 200
#: bytes of a grain, and of its open cells (measured)
BYTES_PER_GRAIN, BYTES_OF_CELLS = 250, 50


@dataclass(frozen=True, kw_only=True, slots=True)
class Rsa:
    """Parameters of random sequential addition.

    Raises
    ------
    InputError
        If a number is out of its range, or parameters contradict each other.
    """

    scheme: Literal["classic", "1", "2", "3", "4a", "4b", "4c", "4d"] = parameter(
        "classic", doc="what becomes of a candidate that overlaps, after Chu 2011; 4a to 4d sort first"
    )
    until: Literal["tries", "saturated"] | None = parameter(
        None,
        doc="when to stop: after so many tries, or when it is proven that no grain fits any more; left out: after the "
        "tries, but where a count or a solid fraction is asked for, in the scheme classic, when it is met or proven to "
        "have no room",
    )
    tries: int = parameter(
        1000,
        doc="coordinates that are drawn; where open places are searched: throws in vain after which a grain is put "
        "off, where there are more than 32 sizes",
        unit="per grain",
    )
    retain: Literal["scan", "next"] = parameter(
        "scan", doc="how a kept radius goes on: over all unused coordinates (once for each size), or with the next one"
    )
    corrections: int = parameter(2, doc="how often a candidate is moved away, in schemes 1, 3, 4b and 4d")
    order: Literal["given", "largest", "random"] = parameter(
        "given", doc="whose turn it is: as drawn, largest first, or random"
    )
    along: Literal["x", "y", "z"] = parameter("x", doc="axis along which coordinates are sorted")
    numbers: Literal["philox", "lcg"] = parameter(
        "philox",
        doc="coordinates; the linear congruential sequence of Chu is for replays only: its axes are shifts of one "
        "cycle of 65536 numbers",
    )
    aligned: bool = parameter(False, doc="whether boxes and rectangles stand along the axes and meet as such")

    def __post_init__(self) -> None:
        """Check the ranges."""
        as_count(self.tries, "tries", at_least=1)
        as_count(self.corrections, "corrections", at_least=1)
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
        """Whether a candidate is moved away from a grain."""
        return UNSORTED.get(self.scheme, self.scheme) in ("1", "3")

    @property
    def retaining(self) -> int:
        """What becomes of the radius of a refused candidate."""
        if UNSORTED.get(self.scheme, self.scheme) not in ("2", "3"):
            return DROP
        return SCAN if self.retain == "scan" else NEXT

    @property
    def tabled(self) -> bool:
        """Whether all coordinates are made beforehand."""
        return self.scheme in UNSORTED or self.numbers == "lcg"


def prepare(problem: Problem) -> State:
    """Return the state in which only the grains of the start are in.

    Raises
    ------
    InputError
        If a grain of the start overlaps another or reaches beyond a wall, or shapes are asked to stand aligned that
        are no boxes.
    TooLargeError
        If there are more than 2**31 coordinates, and they must be kept.
    """
    n, many = problem.count, problem.parameters.tries * newcomers(problem)
    arrays: dict[str, Any] = {"position": np.zeros((n, 3)), "entered": np.zeros(n, dtype=np.int8)}
    state = State(arrays, dict.fromkeys(TALLY, 0), 0, _most_attempts(problem))
    state.counters["search_from"] = 0 if problem.parameters.until == "saturated" else -1
    if problem.start is not None and problem.start.count:
        _enter_start(problem, state, problem.start)
    setting = make_setting(problem, state.counters["search_from"])
    if setting.classes is not None:
        _open_cells(state, setting)
    else:
        arrays["used"] = np.zeros(many if problem.parameters.retaining == SCAN else 0, dtype=np.int8)
        arrays["pointer"] = np.zeros(int(setting.kind.max(initial=-1)) + 1, dtype=np.int64)
    _keep(problem, state, setting)
    _look(problem, state, setting)
    return state


def advance(problem: Problem, state: State, attempts: int) -> State:
    """Make up to `attempts` attempts: a candidate each, or a throw into the open cells."""
    if state.stop_reason:
        return state
    if "setting" not in state.derived:
        _keep(problem, state, make_setting(problem, state.counters["search_from"]))
    setting: Setting = state.derived["setting"]
    bed = _bed_of(state, setting)
    tally = np.array([state.counters[name] for name in TALLY], dtype=np.int64)
    last = state.done + attempts
    try:
        if setting.classes is None:
            known = Coordinates(setting.table, state.arrays["used"], state.arrays["pointer"], setting.kind)
            run = (setting.queue, tally, philox_key(problem.seed, "rsa"), state.done, last)
            state.done = int(add_candidates(bed, setting.cells, setting.room, setting.rules, known, *run))
            if state.done < last and setting.rules.ends and tally[TURN] < len(setting.queue):
                state.counters["search_from"], tally[TRIED] = int(tally[TURN]), 0
                setting = make_setting(problem, int(tally[TURN]))
                _open_cells(state, setting)
                _keep(problem, state, setting)
            elif state.done < last:
                tally[TURN] = len(setting.queue)
        if setting.classes is not None:
            # what was drawn as coordinates is not drawn again
            stage = "rsa" if problem.parameters.until == "saturated" else "rsa, search"
            _throw(state, setting, bed, tally, philox_key(problem.seed, stage), last)
    finally:
        state.counters.update(zip(TALLY, tally.tolist(), strict=True))
    _look(problem, state, setting)
    return state


def finish(problem: Problem, state: State) -> Packing:
    """Return the packing of the grains that found a place."""
    placed = np.flatnonzero(state.arrays["entered"])
    return problem.packing(
        placed,
        position=state.arrays["position"][placed],
        orientation=orientations(problem, placed),
        provenance={"saturation": _proof(problem, state)} if "cell" in state.arrays else {},
        stop_reason=state.stop_reason,
    )


def cost(problem: Problem) -> Cost:
    """Return what a run takes; of a saturated one the attempts are an estimate.

    Raises
    ------
    TooLargeError
        If there are more than 2**31 coordinates, and they must be kept.
    """
    settings: Rsa = problem.parameters
    n, many = problem.count, coordinate_count(problem)
    memory = n * BYTES_PER_GRAIN
    if settings.until == "saturated" or searches(problem):
        memory += n * BYTES_OF_CELLS
    else:
        memory += many * (24 * settings.tabled + (settings.retaining == SCAN))
    return Cost(memory=memory, attempts=_most_attempts(problem))


def _most_attempts(problem: Problem) -> int:
    """Return how many attempts a run makes at the most."""
    settings: Rsa = problem.parameters
    m = newcomers(problem)
    if settings.until == "saturated":
        return THROWS * m
    if settings.retaining == SCAN:
        sizes = len(np.unique(np.column_stack([problem.shape_id, problem.diameter]), axis=0))
        return sizes * settings.tries * m
    return (settings.tries + THROWS * searches(problem)) * m


def _enter_start(problem: Problem, state: State, start: Start) -> None:
    """Let the grains of the start in where they are: what touches, touches.

    Raises
    ------
    InputError
        If the true shape of one overlaps that of another, or reaches beyond a wall.
    """
    n, container = start.count, problem.container
    assembly = Assembly.of(
        problem.shapes,
        container,
        position=start.position,
        scale=problem.diameter[:n],
        shape_id=problem.shape_id[:n],
        orientation=start.orientation,
    )
    proof = verify(assembly)
    if not proof.ok:
        wrong = [escape.grain for escape in proof.escapes] + [pair.j for pair in proof.pairs]
        raise InputError(
            f"grain {min(wrong)} of start finds no place: its true shape reaches beyond a wall or overlaps another; "
            "give a larger container or a looser start"
        )
    lower, upper = container.bounds
    lengths = np.where(container.periodic, upper - lower, 1.0)
    turns = np.where(container.periodic, np.floor((start.position - lower) / lengths), 0.0)
    state.arrays["position"][:n] = start.position - turns * lengths
    state.arrays["entered"][:n] = 1
    state.counters["placed"] = n


def _keep(problem: Problem, state: State, setting: Setting) -> None:
    """Keep a setting, with the grains that are in linked into its cells, in the order in which they entered."""
    late = state.arrays.get("late", setting.queue[:0])
    first = np.arange(problem.count - newcomers(problem), dtype=np.int32)
    entering = np.concatenate([first, setting.queue[~np.isin(setting.queue, late)], late])
    link_all(_bed_of(state, setting), setting.cells, setting.room, entering)
    state.derived["setting"] = setting


def _open_cells(state: State, setting: Setting) -> None:
    """Open the first cells of all grains that are to be thrown."""
    assert setting.classes is not None
    cells = first_cells(setting.classes, setting.boxes)
    state.arrays.update(cells._asdict(), late=setting.queue[:0].copy())


def _bed_of(state: State, setting: Setting) -> Bed:
    """Return the grains as kernels take them."""
    arrays = state.arrays
    return Bed(arrays["position"], setting.half, setting.level, arrays["entered"], setting.boxes)


def _throw(state: State, setting: Setting, bed: Bed, tally: Integers, key: Words, last: int) -> None:
    """Throw grains into the open cells up to attempt `last`; those that were put off come after all others."""
    classes, room = setting.classes, setting.room
    assert classes is not None
    _turns(state, setting, bed, setting.queue, tally, key, last, late=False)
    if tally[TURN] == len(setting.queue) and tally[PUT_OFF] and not len(state.arrays["late"]):
        late = left_out(bed, setting.queue)
        if tally[UNPROVEN] or not len(late):
            tally[UNPROVEN] += tally[PUT_OFF]
            tally[PUT_OFF] = 0
        else:
            state.arrays["late"] = late
            aim(bed, room, classes, late, 0)
            state.arrays.update(open_late(bed, room, classes, _open_of(state), late, 0)._asdict())
    late, done = state.arrays["late"], True
    while done and tally[LATE] < len(late):
        turn, own = int(tally[LATE]), tally.copy()
        aim(bed, room, classes, late, turn)
        own[TURN] = turn
        try:
            _turns(state, setting, bed, late[: turn + 1], own, key, last, late=True)
        finally:
            tally[TURN + 1 :] = own[TURN + 1 :]
        done = own[TURN] > turn
        if done and not bed.entered[late[turn]]:
            # a place was not found before cells came to their finest; or there is none, for no larger grain either
            tally[UNPROVEN] += tally[UNPROVEN] and len(late) - turn - 1
            tally[LATE] = len(late)
        elif done:
            tally[LATE] = turn + 1
            if turn + 1 < len(late):
                aim(bed, room, classes, late, turn + 1)
                state.arrays.update(open_late(bed, room, classes, _open_of(state), late, turn + 1)._asdict())


def _turns(
    state: State,
    setting: Setting,
    bed: Bed,
    queue: NDArray[np.int32],
    tally: Integers,
    key: Words,
    last: int,
    *,
    late: bool,
) -> None:
    """Throw the grains of a queue, and cut cells when it is time."""
    classes = setting.classes
    assert classes is not None
    where, own = (bed, setting.cells, setting.room, classes), len(classes.base) - 1 if late else -1
    while True:
        known = _open_of(state)
        sizes = all_edges(classes, known), volumes_up_to(classes, known), deepest_cut(classes, setting.boxes)
        state.done, kind = throw_into_cells(*where, known, *sizes, own, queue, tally, key, state.done, last)
        if kind < 0:
            return
        # kept at once, so that the cells before are not kept too
        state.arrays.update(cut_cells(*where, known, kind)._asdict())


def _open_of(state: State) -> Open:
    """Return the open cells as kernels take them."""
    return Open(*(state.arrays[name] for name in Open._fields))


def _look(problem: Problem, state: State, setting: Setting) -> None:
    """Stop when all grains are in, or have been tried."""
    counters = state.counters
    if counters["placed"] == problem.count:
        state.stop_reason = "count"
    elif counters["turn"] == len(setting.queue) and (
        not counters["put_off"] or 0 < len(state.arrays["late"]) == counters["late"]
    ):
        # where all are wider than the container nothing was tried, and nothing can be
        closed = not len(setting.queue) or (setting.classes is not None and counters["unproven"] == 0)
        # that there is no room for bounding spheres does not prove that there is none for the true shapes
        reason = "saturated" if _treated_as(problem) != "bounding spheres" else "full"
        state.stop_reason = reason if closed else "steps"
    if state.stop_reason:
        # cells and extents are as large as the grains, and nobody asks for them any more
        state.derived.clear()


def _treated_as(problem: Problem) -> str:
    """Return as what grains meet."""
    if problem.parameters.aligned:
        return "boxes"
    return "spheres" if all(shape.is_sphere for shape in problem.shapes) else "bounding spheres"


def _proof(problem: Problem, state: State) -> dict[str, Any]:
    """Return what is known of the room that is left."""
    # the last class is that of grains which were put off
    many = np.diff(state.arrays["bounds"])[:-1]
    return {
        "of": _treated_as(problem),
        "proven": state.stop_reason == "saturated",
        "not_proven": state.counters["unproven"],
        "classes": len(many),
        "classes_closed": int(np.count_nonzero(many == 0)),
        "open_cells": int(many.sum()),
        "cuts": int(state.arrays["depth"].max(initial=0)),
    }


registration = PackingMethod(
    name="rsa",
    summary="grains as spheres are added at random places and stay there: schemes of Chu 2011, or to proven saturation",
    source="Chu 2011, Rock and Soil Mechanics; Zhang & Torquato 2013, doi:10.1103/PhysRevE.88.053312",
    parameters=Rsa,
    prepare=prepare,
    advance=advance,
    finish=finish,
    cost=cost,
    dimensions=(2, 3),
    selects=True,
)
