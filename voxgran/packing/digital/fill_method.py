"""Digital filling: each grain takes the best of all feasible places on a lattice, found exactly.

For every orientation of every kind a map tells, a bit a place, where the grain would meet nothing. The maps are made by
morphological dilation once and, when it is the turn of their kind, updated for each grain placed since with the table
of differences at which two oriented grains overlap (:mod:`voxgran.packing.digital.feasible_places`); so the choice is
among all places there are, not among some that were tried. Where several are equally good one is drawn at random, so
that beds do not become crystals.

References
----------
Morphological dilation as the set of overlapping places: Serra 1982, Image analysis and mathematical morphology. The
lowest feasible place of all orientations: Burke et al. 2006, A new bottom-left-fill heuristic algorithm for the
two-dimensional irregular packing problem, doi:10.1287/opre.1060.0293.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from voxgran._base.arrays import Booleans, Floats, Integers, Words
from voxgran._base.config import check_bounds, parameter
from voxgran._base.errors import InputError
from voxgran._base.seeds import below, philox_block, philox_key, stream
from voxgran._base.stopping import stop_if_asked
from voxgran.packing.digital.bit_columns import Canvas, Field
from voxgran.packing.digital.container_lattice import (
    MOST_ORIENTATIONS,
    ContainerLattice,
    container_lattice,
    free_voxels,
    positions_on,
)
from voxgran.packing.digital.feasible_places import (
    Room,
    Table,
    add_table,
    best_at,
    blocked_map,
    count_contacts,
    free_among,
    nth_best_at,
    nth_free_among,
    nth_of_contacts,
    overlap_table,
    wall_shells,
)
from voxgran.packing.digital.oriented_voxels import Oriented, base_orientations, kinds_of, orient, stand_start
from voxgran.packing.gravity import axis_of, gravity_text
from voxgran.packing.method import Cost, PackingMethod, State
from voxgran.packing.model import Packing
from voxgran.packing.problem import Problem
from voxgran.packing.start import Start

#: a score, smaller is better, and how many places have it
Ranked: TypeAlias = tuple[tuple[int, int], int]

#: what is counted
TALLY = ("placed", "skipped", "map_updates")
#: words of a map that are looked at between two looks whether to stop
SLAB_WORDS = 2**18


@dataclass(frozen=True, kw_only=True, slots=True)
class DigitalFill:
    """Parameters of digital filling.

    Raises
    ------
    InputError
        If a number is out of its range, or the lowest place is asked without gravity.
    """

    voxel_size: float | None = parameter(
        None, doc="edge of a voxel; left out: 1/20 of the median diameter", unit="length", above=0.0
    )
    cover: Literal["touch", "center"] = parameter(
        "touch", doc="voxels that a grain takes: all that it touches, or those whose center it holds"
    )
    place: Literal["lowest", "contact", "wall"] = parameter(
        "lowest",
        doc="which feasible place: the lowest, of several the one blocked on most sides; the one blocked on most sides "
        "anywhere; or the one nearest to a wall",
    )
    gravity: Literal["-x", "+x", "-y", "+y", "-z", "+z", "none"] | None = parameter(
        None, doc="where down is; left out: -z, in two dimensions -y"
    )
    order: Literal["random", "largest"] = parameter("random", doc="which grain comes next: any, or the largest left")
    turned: bool = parameter(True, doc="whether grains also lie in the other rotations of the lattice")
    orientations: int = parameter(
        1,
        doc="poses of each kind that are voxelized: the given one, then random ones; each with its lattice rotations",
        at_least=1,
        at_most=MOST_ORIENTATIONS,
    )

    def __post_init__(self) -> None:
        """Check the ranges."""
        check_bounds(self)
        if self.place == "lowest" and self.gravity == "none":
            raise InputError("gravity is 'none': the lowest place needs a direction; choose one, or another place")


def prepare(problem: Problem) -> State:
    """Return the state in which all grains wait.

    Raises
    ------
    InputError
        If no voxel size fits the periodic lengths, gravity points along a periodic axis, the container has no wall and
        the place nearest to one is asked, or a grain of the start finds no place.
    """
    _gravity(problem)
    n = 0 if problem.start is None else problem.start.count
    waiting = n + stream(problem.seed, "order").permutation(problem.count - n)
    if problem.parameters.order == "largest":
        waiting = waiting[np.argsort(-problem.volumes[waiting], kind="stable")]
    arrays = {
        "site": np.zeros((problem.count, 3), dtype=np.int64),
        "member": np.full(problem.count, -1, dtype=np.int64),
        "order": np.concatenate([np.arange(n), waiting]).astype(np.int64),
    }
    state = State(arrays, dict.fromkeys(TALLY, 0), 0, problem.count - n)
    if problem.start is not None:
        _enter_start(problem, state, problem.start)
    if problem.count == n:
        state.stop_reason = "count"
    return state


def advance(problem: Problem, state: State, attempts: int) -> State:
    """Place up to `attempts` grains, or find that they have no place."""
    if state.stop_reason:
        return state
    setting = _setting(problem, state)
    n = 0 if problem.start is None else problem.start.count
    key = philox_key(problem.seed, "digital_fill")
    for _ in range(attempts):
        grain = int(state.arrays["order"][n + state.done])
        word = philox_block(key[0], key[1], np.uint64(state.done), np.uint64(0))[0]
        updates = _update_maps(problem, state, setting, int(setting.kind[grain]))
        found = _best_place(problem, setting, int(setting.kind[grain]), word)
        state.done += 1
        state.counters["map_updates"] += updates
        if found is None:
            state.counters["skipped"] += 1
        else:
            state.arrays["member"][grain], state.arrays["site"][grain] = found
            state.counters["placed"] += 1
        if state.done == state.total:
            state.stop_reason = "full" if state.counters["skipped"] else "count"
            break
    return state


def finish(problem: Problem, state: State) -> Packing:
    """Return the packing of the grains that found a place."""
    setting = _setting(problem, state)
    placed = np.flatnonzero(state.arrays["member"] >= 0)
    member = state.arrays["member"][placed]
    return problem.packing(
        placed,
        position=positions_on(setting.lattice, state.arrays["site"][placed], problem.dimension),
        voxel_size=setting.lattice.voxel_size,
        contact_gap=setting.lattice.voxel_size,
        orientation=setting.oriented.orientation[member],
        provenance={"parameters": {"gravity": gravity_text(problem)}},
        stop_reason=state.stop_reason,
        gravity=_gravity(problem),
    )


def cost(problem: Problem) -> Cost:
    """Return what a run takes."""
    lattice = container_lattice(problem, _voxel_size(problem))
    kinds, poses = len(kinds_of(problem)[1]), problem.parameters.orientations
    turns = (24 if problem.dimension == 3 else 4) if problem.parameters.turned else 1
    voxels = float(np.prod(lattice.shape))
    starting = 0 if problem.start is None else problem.start.count
    shells = 9 * voxels if problem.parameters.place == "wall" else 0
    return Cost(
        memory=int(voxels / 8 * kinds * poses * turns * 1.3 + shells + 3 * voxels + problem.byte_limit),
        attempts=problem.count - starting,
        voxelized_shapes=kinds * poses + starting,
    )


@dataclass(slots=True)
class _Setting:
    """What follows from the problem and the placed grains: lattice, orientations, maps and how far they are.

    taken: voxels that the container does not leave free.  maps: of the orientations whose turn has come.  joined: how
    many of the order have been joined to each.  level: up to where each is known to be full.
    """

    lattice: ContainerLattice
    kind: Integers
    oriented: Oriented
    first: Integers
    room: Room
    taken: Booleans | None
    maps: dict[int, Words]
    joined: Integers
    level: Integers
    shells: tuple[Integers, Integers]


def _voxel_size(problem: Problem) -> float:
    """Return the voxel size that is asked for, in median diameters."""
    asked = problem.parameters.voxel_size
    return 1 / 20 if asked is None else problem.length(asked)


def _gravity(problem: Problem) -> Integers:
    """Return the direction of gravity as a lattice vector; zero where it does not matter."""
    if problem.parameters.place != "lowest":
        return np.zeros(3, dtype=np.int64)
    return axis_of(problem.parameters.gravity, problem.container)


def _setting(problem: Problem, state: State) -> _Setting:
    """Return the setting, made again where the state was just made or read from a checkpoint."""
    if "setting" not in state.derived:
        state.derived["setting"] = _make_setting(problem)
    made: _Setting = state.derived["setting"]
    return made


def _make_setting(problem: Problem) -> _Setting:
    """Voxelize the kinds."""
    settings: DigitalFill = problem.parameters
    lattice = container_lattice(problem, _voxel_size(problem))
    kind, grains = kinds_of(problem)
    base = base_orientations(problem, len(grains), settings.orientations)
    oriented = orient(problem, grains, base, lattice.voxel_size, turned=settings.turned, cover=settings.cover)
    periodic = np.array(problem.container.periodic, dtype=np.int64)
    places = lattice.shape + 1 - periodic
    if problem.dimension == 2:
        places[2] = 1
    room = Room(places, int(-(-places[2] // 64)), periodic)
    free = free_voxels(problem.container, lattice)
    taken = None if free is None else ~free
    first = np.searchsorted(oriented.kind, np.arange(len(grains) + 1)).astype(np.int64)
    level = np.zeros(int(first[-1]) if len(first) else 0, dtype=np.int64)
    gravity = _gravity(problem)
    if gravity.max() > 0:
        level[:] = places[int(np.argmax(gravity))] - 1
    shells = _shells(problem, lattice, room) if settings.place == "wall" else (level[:0], level[:0])
    return _Setting(lattice, kind, oriented, first, room, taken, {}, np.zeros_like(level), level, shells)


def _shells(problem: Problem, lattice: ContainerLattice, room: Room) -> tuple[Integers, Integers]:
    """Return the places by their distance from the walls, in whole voxels."""
    distance = np.empty(room.places.tolist())
    axes = [lattice.corner[k] + np.arange(n) * lattice.voxel_size for k, n in enumerate(room.places)]
    for i, x in enumerate(axes[0]):
        points: Floats = np.stack(np.broadcast_arrays(x, axes[1][:, None], axes[2][None, :]), axis=-1).reshape(-1, 3)
        distance[i] = -problem.container.signed_distance(points).reshape(distance.shape[1:])
    if not np.isfinite(distance).all():
        raise InputError("place is 'wall': the container is periodic along all axes and has none; choose another place")
    return wall_shells(distance / lattice.voxel_size)


def _update_maps(problem: Problem, state: State, setting: _Setting, kind: int) -> int:
    """Block the places that all grains placed so far take in the maps of a kind.

    Return how many updates that is after those of the last turn of the kind; more are made where the state was read
    from a checkpoint.
    """
    arrays, oriented, room = state.arrays, setting.oriented, setting.room
    n = 0 if problem.start is None else problem.start.count
    came = arrays["order"][: n + state.done]
    members = range(int(setting.first[kind]), int(setting.first[kind + 1]))
    for other in members:
        if other not in setting.maps:
            stop_if_asked()
            low, mask = oriented.low[other], oriented.masks[other]
            setting.maps[other] = blocked_map(room, setting.taken, low, mask, setting.lattice.shape)
        for grain in came[setting.joined[other] :].tolist():
            member = int(arrays["member"][grain])
            if member >= 0:
                stop_if_asked()
                table = problem.keep(("overlap", member, other), lambda: _table(oriented, member, other))  # noqa: B023
                add_table(setting.maps[other], room, table, arrays["site"][grain])
            setting.joined[other] += 1
    turns = np.flatnonzero(setting.kind[came[n:]] == kind)
    since = came[n + (int(turns[-1]) if len(turns) else 0) :]
    return len(members) * int(np.count_nonzero(arrays["member"][since] >= 0))


def _table(oriented: Oriented, here: int, there: int) -> Table:
    """Return the table of two oriented grains."""
    return overlap_table(oriented.masks[here], oriented.low[here], oriented.masks[there], oriented.low[there])


def _best_place(problem: Problem, setting: _Setting, kind: int, word: int) -> tuple[int, Integers] | None:
    """Return orientation and place of the best feasible places, drawn where there are several; None where none is."""
    members = range(int(setting.first[kind]), int(setting.first[kind + 1]))
    rule = problem.parameters.place
    choose = {"lowest": _lowest, "wall": _nearest_to_wall, "contact": _most_contacts}[rule]
    ranked = [choose(problem, setting, member) for member in members]
    best = min((score for score, count in ranked if count), default=None)
    if best is None:
        return None
    counts = np.array([count if score == best else 0 for score, count in ranked])
    rank = int(below(np.uint64(word), int(counts.sum())))
    chosen = int(np.searchsorted(np.cumsum(counts), rank, side="right"))
    rank -= int(counts[:chosen].sum())
    member, place = members[chosen], np.zeros(3, dtype=np.int64)
    words, room = setting.maps[member], setting.room
    if rule == "lowest":
        level, axis = int(setting.level[member]), _axis(problem)
        nth_best_at(words, level, axis, room.periodic, room.places, -best[1], rank, place)
    elif rule == "wall":
        sites, begin = setting.shells
        level = int(setting.level[member])
        part = sites[begin[level] : begin[level + 1]]
        nth_free_among(words, part, int(room.places[1]), int(room.places[2]), rank, place)
    else:
        for first, last in _slabs(words):
            rank = int(nth_of_contacts(words, room.periodic, room.places, -best[0], rank, place, first, last))
            if rank < 0:
                break
    return member, place


def _slabs(words: Words) -> Iterator[tuple[int, int]]:
    """Yield slabs of a map along x, begin and end, that are looked at between two looks whether to stop."""
    step = max(1, SLAB_WORDS // words[0].size)
    for first in range(0, len(words), step):
        stop_if_asked()
        yield first, min(first + step, len(words))


def _axis(problem: Problem) -> int:
    """Return the axis along which gravity points."""
    return int(np.argmax(np.abs(_gravity(problem))))


def _lowest(problem: Problem, setting: _Setting, member: int) -> Ranked:
    """Return height, blocked sides and number of the lowest free places that are blocked on most sides.

    Places only get fewer, so the search goes on upward from where it was.
    """
    axis, words = _axis(problem), setting.maps[member]
    down = int(_gravity(problem)[axis])
    end = -1 if down > 0 else int(setting.room.places[axis])
    while setting.level[member] != end:
        stop_if_asked()
        sides, count = best_at(words, int(setting.level[member]), axis, setting.room.periodic, setting.room.places)
        if count:
            return (-down * int(setting.level[member]), -int(sides)), int(count)
        setting.level[member] -= down
    return (0, 0), 0


def _nearest_to_wall(problem: Problem, setting: _Setting, member: int) -> Ranked:
    """Return distance and number of the free places nearest to a wall."""
    sites, begin = setting.shells
    while setting.level[member] < len(begin) - 1:
        stop_if_asked()
        level = int(setting.level[member])
        part = sites[begin[level] : begin[level + 1]]
        count = int(free_among(setting.maps[member], part, int(setting.room.places[1]), int(setting.room.places[2])))
        if count:
            return (level, 0), count
        setting.level[member] += 1
    return (0, 0), 0


def _most_contacts(problem: Problem, setting: _Setting, member: int) -> Ranked:
    """Return the largest number of blocked sides, negative, and the number of free places with it."""
    words, histogram = setting.maps[member], np.zeros(7, dtype=np.int64)
    for first, last in _slabs(words):
        count_contacts(words, setting.room.periodic, setting.room.places, histogram, first, last)
    filled = np.flatnonzero(histogram)
    return ((-int(filled[-1]), 0), int(histogram[filled[-1]])) if len(filled) else ((0, 0), 0)


def _enter_start(problem: Problem, state: State, start: Start) -> None:
    """Put the grains of the start on the lattice, each as near to its place as there is room."""
    setting = _make_setting(problem)
    lattice, oriented = setting.lattice, setting.oriented
    margin = np.where(setting.room.periodic, int(oriented.size.max(initial=1)) + 1, 1).astype(np.int64)
    canvas = Canvas(lattice.shape, margin, setting.room.periodic)
    _, words, deep = canvas.word_shape
    empty = canvas.words(free_voxels(problem.container, lattice))
    field = Field(empty, words * deep, deep, canvas.shape, canvas.margin, canvas.periodic)
    sites = stand_start(problem, start, lattice, oriented, field=field, gravity=_gravity(problem))
    state.arrays["site"][: start.count] = sites
    state.arrays["member"][: start.count] = np.arange(len(oriented.at) - start.count, len(oriented.at))
    state.counters["placed"] = start.count


registration = PackingMethod(
    name="digital_fill",
    summary="each grain takes the best of all feasible places on a lattice, found exactly",
    source="no-fit places by morphological dilation; Burke et al. 2006, doi:10.1287/opre.1060.0293",
    parameters=DigitalFill,
    prepare=prepare,
    advance=advance,
    finish=finish,
    cost=cost,
    dimensions=(2, 3),
    any_container=True,
)
