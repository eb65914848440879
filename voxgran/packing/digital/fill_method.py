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
from typing import Any, ClassVar, Literal, TypeAlias

import numpy as np

from voxgran._base.arrays import Booleans, Floats, Integers, Words
from voxgran._base.checkpoint import Rule, check_held
from voxgran._base.config import check_bounds, parameter, parameter_class
from voxgran._base.errors import InputError
from voxgran._base.seeds import below, philox_block, philox_key, stream
from voxgran._base.stopping import stop_if_asked
from voxgran.containers.gravity import axis_of, gravity_text
from voxgran.packing.digital.bit_columns import Canvas
from voxgran.packing.digital.container_lattice import ContainerLattice, container_lattice, free_voxels
from voxgran.packing.digital.expected_time import filling_seconds, maps_and_masks
from voxgran.packing.digital.feasible_places import (
    Room,
    Table,
    add_table,
    blocked_map,
    blocked_sides,
    count_contacts,
    free_among,
    nth_of_contacts,
    overlap_table,
    places_with,
    wall_shells,
)
from voxgran.packing.digital.oriented_voxels import (
    OrientedVoxels,
    declared_sites,
    enter_start,
    kinds_of,
    orient,
    packing_of_sites,
    places_of,
    poses_to_voxelize,
    stand_within,
)
from voxgran.packing.digital.parameters import LatticeSearch
from voxgran.packing.method import NO_ROOM_ON_LATTICE, Cost, PackingMethod, State
from voxgran.packing.model import Packing
from voxgran.packing.problem import Problem

#: a score, smaller is better, and how many places have it
Ranked: TypeAlias = tuple[tuple[int, int], int]

#: what is counted
TALLY = ("placed", "skipped", "map_updates")
#: words of a map that are looked at between two looks whether to stop
SLAB_WORDS = 2**18


@parameter_class
class DigitalFill(LatticeSearch):
    """Parameters of digital filling.

    Parameters
    ----------
    voxel_size
        edge of a voxel; default: 1/20 of the median diameter, up to 1/10 where the search would take long.
    place
        choice among the feasible places: the lowest (of several, the one blocked on most sides), the one blocked on
        most sides, or the one nearest to a wall.
    gravity
        direction of gravity; default: -z, in two dimensions -y.
    order
        order of insertion: random, or the largest first.

    Raises
    ------
    InputError
        If a number is out of its range, or the lowest place is asked without gravity.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), vg.methods.DigitalFill(voxel_size=0.1), count=20).count
    20
    """

    usual_voxel_size: ClassVar[float] = 1 / 20
    expected_seconds: ClassVar[Any] = staticmethod(filling_seconds)

    voxel_size: float | None = parameter(None, unit="length", above=0.0)
    place: Literal["lowest", "contact", "wall"] = parameter("lowest")
    gravity: Literal["-x", "+x", "-y", "+y", "-z", "+z", "none"] | None = parameter(None)
    order: Literal["random", "largest"] = parameter("random")

    def __post_init__(self) -> None:
        """Check the ranges, and that the lowest place has a direction."""
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
        waiting = problem.largest_first(waiting)
    arrays = {
        "site": np.zeros((problem.count, 3), dtype=np.int64),
        "member": np.full(problem.count, -1, dtype=np.int64),
        "order": np.concatenate([np.arange(n), waiting]).astype(np.int64),
    }
    state = State(arrays, dict.fromkeys(TALLY, 0), 0, problem.count - n)
    state.rule = _fits(problem, state)
    _enter_start(problem, state)
    if problem.count == n:
        state.stop_reason = "count"
    return state


def _fits(problem: Problem, state: State) -> Rule:
    """Return the rule for a checkpoint: each grain had its turn once, and stands within the walls."""

    def fits(arrays: Any, counters: Any) -> bool:
        setting = _setting(problem, state)
        check_held((arrays, {}), arrays, {}, declared_sites(setting.room.places, setting.oriented))
        placed, done, total = counters["placed"], state.done, problem.count - problem.started
        return bool(
            np.array_equal(np.sort(arrays["order"]), np.arange(problem.count)) and done <= total
            and state.total == total and (done < total or state.stop_reason)
            and placed + counters["skipped"] == done and counters["map_updates"] >= 0
            and stand_within(setting.lattice, problem.container.periodic, setting.oriented, arrays)
        )  # fmt: skip

    return fits


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
        _drop_maps(state, setting, grain)
        if state.done == state.total:
            state.stop_reason = "full" if state.counters["skipped"] else "count"
            break
    return state


def finish(problem: Problem, state: State) -> Packing:
    """Return the packing of the grains that found a place."""
    setting = _setting(problem, state)
    return packing_of_sites(
        problem,
        state,
        setting.lattice,
        setting.oriented,
        provenance={"parameters": {"gravity": gravity_text(problem)}},
        gravity=_gravity(problem),
    )


def cost(problem: Problem) -> Cost:
    """Return what a run takes."""
    lattice = container_lattice(problem)
    voxels = float(np.prod(lattice.shape))
    starting = 0 if problem.start is None else problem.start.count
    shells = 9 * voxels if problem.parameters.place == "wall" else 0
    maps, masks = maps_and_masks(problem, lattice.voxel_size)
    return Cost(
        memory=int(voxels / 8 * maps * 1.3 + masks + shells + 3 * voxels + problem.cache.limit),
        seconds=filling_seconds(problem, lattice.voxel_size),
        attempts=problem.count - starting,
        voxelized_shapes=poses_to_voxelize(problem) + starting,
    )


@dataclass(slots=True)
class _Setting:
    """What follows from the problem and the placed grains: lattice, orientations, maps and how far they are.

    taken: voxels that the container does not leave free.  maps: of the orientations of the present kind.  joined: how
    many of the order have been joined to each.  level: up to where each is known to be full.
    """

    lattice: ContainerLattice
    kind: Integers
    oriented: OrientedVoxels
    first: Integers
    room: Room
    taken: Booleans | None
    maps: dict[int, Words]
    joined: Integers
    level: Integers
    shells: tuple[Integers, Integers]


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
    lattice, (kind, grains) = container_lattice(problem), kinds_of(problem)
    oriented, places = orient(problem, grains, lattice), places_of(problem, lattice)
    room = Room(places, int(-(-places[2] // 64)), np.array(problem.container.periodic, dtype=np.int64))
    free = free_voxels(problem.container, lattice)
    taken = None if free is None else ~free
    first = np.searchsorted(oriented.kind, np.arange(len(grains) + 1)).astype(np.int64)
    level = np.zeros(int(first[-1]) if len(first) else 0, dtype=np.int64)
    gravity = _gravity(problem)
    if gravity.max() > 0:
        level[:] = places[int(np.argmax(gravity))] - 1
    shells = _shells(problem, lattice, room) if problem.parameters.place == "wall" else (level[:0], level[:0])
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
            low, mask = oriented.record.low[other], oriented.masks[other]
            setting.maps[other] = blocked_map(room, setting.taken, low, mask, setting.lattice.shape)
        for grain in came[setting.joined[other] :].tolist():
            member = int(arrays["member"][grain])
            if member >= 0:
                stop_if_asked()
                table = problem.cache.keep(("overlap", member, other), lambda: _table(oriented, member, other))  # noqa: B023
                add_table(setting.maps[other], room, table, arrays["site"][grain])
            setting.joined[other] += 1
    turns = np.flatnonzero(setting.kind[came[n:]] == kind)
    since = came[n + (int(turns[-1]) if len(turns) else 0) :]
    return len(members) * int(np.count_nonzero(arrays["member"][since] >= 0))


def _drop_maps(state: State, setting: _Setting, grain: int) -> None:
    """Drop the maps of the kind of a grain where no grain that waits is of the kind."""
    kind = int(setting.kind[grain])
    waiting = state.arrays["order"][-1 : state.done - state.total - 1 : -1]
    if not (setting.kind[waiting] == kind).any():
        for member in range(int(setting.first[kind]), int(setting.first[kind + 1])):
            del setting.maps[member]


def _table(oriented: OrientedVoxels, here: int, there: int) -> Table:
    """Return the table of two oriented grains."""
    masks, low = oriented.masks, oriented.record.low
    return overlap_table(masks[here], low[here], masks[there], low[there])


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
    member = members[chosen]
    words, room = setting.maps[member], setting.room
    if rule == "contact":
        place = np.zeros(3, dtype=np.int64)
        for first, last in _slabs(words):
            rank = int(nth_of_contacts(words, room.periodic, room.places, -best[0], rank, place, first, last))
            if rank < 0:
                break
        return member, place
    if rule == "wall":
        return member, _free_in_shell(setting, member)[rank]
    level, axis = int(setting.level[member]), _axis(problem)
    return member, places_with(blocked_sides(words, level, axis, room), -best[1], level, axis)[rank]


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
        sides = blocked_sides(words, int(setting.level[member]), axis, setting.room)
        best = int(sides.max())
        if best >= 0:
            return (-down * int(setting.level[member]), -best), int(np.count_nonzero(sides == best))
        setting.level[member] -= down
    return (0, 0), 0


def _nearest_to_wall(problem: Problem, setting: _Setting, member: int) -> Ranked:
    """Return distance and number of the free places nearest to a wall."""
    while setting.level[member] < len(setting.shells[1]) - 1:
        stop_if_asked()
        count = len(_free_in_shell(setting, member))
        if count:
            return (int(setting.level[member]), 0), count
        setting.level[member] += 1
    return (0, 0), 0


def _free_in_shell(setting: _Setting, member: int) -> Integers:
    """Return the free places (k, 3) at the distance from the walls that a map has come to."""
    (sites, begin), level = setting.shells, int(setting.level[member])
    return free_among(setting.maps[member], sites[begin[level] : begin[level + 1]], setting.room.places)


def _most_contacts(problem: Problem, setting: _Setting, member: int) -> Ranked:
    """Return the largest number of blocked sides, negative, and the number of free places with it."""
    words, histogram = setting.maps[member], np.zeros(7, dtype=np.int64)
    for first, last in _slabs(words):
        count_contacts(words, setting.room.periodic, setting.room.places, histogram, first, last)
    filled = np.flatnonzero(histogram)
    return ((-int(filled[-1]), 0), int(histogram[filled[-1]])) if len(filled) else ((0, 0), 0)


def _enter_start(problem: Problem, state: State) -> None:
    """Put the grains of the start on the lattice, each as near to its place as there is room."""
    if problem.start is None:
        return
    setting = _make_setting(problem)
    lattice, record = setting.lattice, setting.oriented.record
    canvas = Canvas.for_grains(lattice.shape, problem.container.periodic, record.size)
    field = canvas.field(canvas.words(free_voxels(problem.container, lattice)))
    enter_start(problem, state, lattice, record, field=field, gravity=_gravity(problem))


registration = PackingMethod(
    summary="each grain takes the best of all feasible places on a lattice, found exactly",
    source="no-fit places by morphological dilation; Burke et al. 2006, doi:10.1287/opre.1060.0293",
    parameters=DigitalFill,
    prepare=prepare,
    advance=advance,
    finish=finish,
    cost=cost,
    dimensions=(2, 3),
    any_container=True,
    start="placed",
    obstacles="apart",
    no_room=NO_ROOM_ON_LATTICE,
)
