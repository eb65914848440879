"""Random sequential addition on a lattice, to exact saturation: each grain takes a random free site and stays there.

A grain of voxels is put at a random site in a random orientation; where it would cover a taken voxel the try is
refused. A refused place stays refused for ever, so each place in each orientation is tried once, in a random order; the
packing is the same as if places were drawn again and again. When all have been tried no grain of that kind fits any
more: that is proof, not patience.

References
----------
Evans 1993, Random and cooperative sequential adsorption, Reviews of Modern Physics 65(4), 1281-1329,
doi:10.1103/RevModPhys.65.1281
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from voxgran._base.arrays import Integers
from voxgran._base.checkpoint import Held, Rule
from voxgran._base.config import parameter, parameter_class
from voxgran._base.errors import TooLargeError
from voxgran._base.seeds import philox_key, stream
from voxgran.packing.digital.bit_columns import Canvas
from voxgran.packing.digital.container_lattice import ContainerLattice, container_lattice, free_voxels
from voxgran.packing.digital.expected_time import addition_seconds
from voxgran.packing.digital.oriented_voxels import (
    OrientedVoxels,
    declared_sites,
    enter_start,
    kinds_of,
    number_of_poses,
    orient,
    packing_of_sites,
    places_of,
    poses_to_voxelize,
    stand_within,
)
from voxgran.packing.digital.parameters import LatticeSearch
from voxgran.packing.digital.trial_sites import TALLY, Lists, add_at_random, stamp_grain
from voxgran.packing.method import NO_ROOM_ON_LATTICE, Cost, PackingMethod, State
from voxgran.packing.model import Packing
from voxgran.packing.problem import Problem

#: most candidates, places times orientations times kinds
MOST_CANDIDATES = 2**40


@parameter_class
class DigitalRsa(LatticeSearch):
    """Parameters of random sequential addition on a lattice.

    Parameters
    ----------
    voxel_size
        edge of a voxel; default: 1/16 of the median diameter, up to 1/10 where the search would take long.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), vg.methods.DigitalRsa(voxel_size=0.1), count=20).count
    20
    """

    usual_voxel_size: ClassVar[float] = 1 / 16
    expected_seconds: ClassVar[Any] = staticmethod(addition_seconds)

    voxel_size: float | None = parameter(None, unit="length", above=0.0)


def prepare(problem: Problem) -> State:
    """Return the state in which every place in every orientation is a candidate.

    Raises
    ------
    TooLargeError
        If there are more than 2**40 candidates.
    InputError
        If no voxel size fits the periodic lengths, or a grain of the start finds no place.
    """
    lattice = container_lattice(problem)
    many = _most_candidates(problem, lattice)
    if many > MOST_CANDIDATES:
        raise TooLargeError(
            f"voxel_size gives {many} candidates (places, orientations and kinds): at most {MOST_CANDIDATES} can be "
            "tried; make voxels larger, or kinds or orientations fewer"
        )
    setting = _make_setting(problem)
    n = 0 if problem.start is None else problem.start.count
    order = stream(problem.seed, "order").permutation(problem.count).astype(np.int64)
    arrays = {
        "site": np.zeros((problem.count, 3), dtype=np.int64),
        "member": np.full(problem.count, -1, dtype=np.int64),
        "order": np.concatenate([np.arange(n), order[order >= n]]),
        "tried": np.zeros(len(setting.bounds) - 1, dtype=np.int64),
    }
    grains = dict.fromkeys(("placed", "skipped"), Held(0, problem.count))
    declared = {
        **declared_sites(setting.places, setting.oriented), **grains, "order": Held(0, problem.count - 1),
        "tried": Held(0, np.diff(setting.bounds)), "refused": Held(0),
    }  # fmt: skip
    rule = _fits(problem, setting)
    total = int(setting.bounds[-1]) + problem.count
    state = State(arrays, dict.fromkeys(TALLY, 0), 0, total, declared=declared, rule=rule)
    state.derived["setting"] = setting
    if problem.start is not None:
        gravity = -np.eye(3, dtype=np.int64)[problem.dimension - 1] * (1 - setting.canvas.periodic)
        field, record = _setting(problem, state).canvas.field(state.derived["words"]), setting.oriented.record
        enter_start(problem, state, setting.lattice, record, field=field, gravity=gravity)
    _look(problem, state)
    return state


def _fits(problem: Problem, setting: "_Setting") -> Rule:
    """Return the rule for a checkpoint: grains are tried once, and those that are placed stand within the walls."""

    def fits(arrays: Any, counters: Any) -> bool:
        placed, done = counters["placed"], counters["placed"] + counters["skipped"]
        there = arrays["member"] >= 0
        return bool(
            len(np.unique(arrays["order"])) == problem.count and done <= problem.count and there.sum() == placed
            and stand_within(setting.lattice, problem.container.periodic, setting.oriented, arrays)
        )  # fmt: skip

    return fits


def advance(problem: Problem, state: State, attempts: int) -> State:
    """Try up to `attempts` candidates."""
    if state.stop_reason:
        return state
    setting, arrays = _setting(problem, state), state.arrays
    tally = np.array([state.counters[name] for name in TALLY], dtype=np.int64)
    lists = Lists(arrays["order"], setting.kind, setting.bounds, arrays["tried"], setting.places)
    field, record = setting.canvas.field(state.derived["words"]), setting.oriented.record
    where = field, record, arrays["site"], arrays["member"]
    key = philox_key(problem.seed, "digital_rsa")
    state.done = int(add_at_random(*where, lists, tally, key, state.done, state.done + attempts))
    state.counters.update(zip(TALLY, tally.tolist(), strict=True))
    _look(problem, state)
    return state


def finish(problem: Problem, state: State) -> Packing:
    """Return the packing of the grains that found a place."""
    setting = _setting(problem, state)
    member = state.arrays["member"][state.arrays["member"] >= 0]
    free = free_voxels(problem.container, setting.lattice)
    room = int(np.prod(setting.lattice.shape)) if free is None else int(np.count_nonzero(free))
    return packing_of_sites(
        problem,
        state,
        setting.lattice,
        setting.oriented,
        provenance={
            "candidates": int(setting.bounds[-1]),
            "candidates_left": int(setting.bounds[-1] - state.arrays["tried"].sum()),
            "voxel_solid_fraction": float(setting.oriented.voxels[member].sum() / max(room, 1)),
        },
    )


def cost(problem: Problem) -> Cost:
    """Return what a run takes."""
    lattice = container_lattice(problem)
    candidates = min(_most_candidates(problem, lattice), MOST_CANDIDATES)
    starting = 0 if problem.start is None else problem.start.count
    return Cost(
        memory=int(np.prod(lattice.shape) / 2 + 2**23),
        seconds=addition_seconds(problem, lattice.voxel_size),
        attempts=candidates + problem.count,
        voxelized_shapes=poses_to_voxelize(problem) + starting,
    )


@dataclass(frozen=True, slots=True)
class _Setting:
    """What follows from the problem: lattice, canvas, kinds, orientations, places along each axis, first candidates."""

    lattice: ContainerLattice
    canvas: Canvas
    kind: Integers
    oriented: OrientedVoxels
    places: Integers
    bounds: Integers


def _most_candidates(problem: Problem, lattice: ContainerLattice) -> int:
    """Return the number of candidates before orientations that look alike are counted once."""
    return int(np.prod(places_of(problem, lattice))) * number_of_poses(problem)


def _make_setting(problem: Problem) -> _Setting:
    """Voxelize the kinds and lay out the canvas."""
    lattice, (kind, grains) = container_lattice(problem), kinds_of(problem)
    oriented, places = orient(problem, grains, lattice), places_of(problem, lattice)
    canvas = Canvas.for_grains(lattice.shape, problem.container.periodic, oriented.record.size)
    first = np.searchsorted(oriented.kind, np.arange(len(grains) + 1)).astype(np.int64)
    return _Setting(lattice, canvas, kind, oriented, places, (first - first[:1]) * int(np.prod(places)))


def _setting(problem: Problem, state: State) -> _Setting:
    """Return the setting, with the canvas, made again where the state was read from a checkpoint."""
    if "setting" not in state.derived:
        state.derived["setting"] = _make_setting(problem)
    made: _Setting = state.derived["setting"]
    if "words" not in state.derived:
        state.derived["words"] = made.canvas.words(free_voxels(problem.container, made.lattice))
        field, record = made.canvas.field(state.derived["words"]), made.oriented.record
        for grain in np.flatnonzero(state.arrays["member"] >= 0).tolist():
            stamp_grain(field, record, int(state.arrays["member"][grain]), state.arrays["site"][grain])
    return made


def _look(problem: Problem, state: State) -> None:
    """Stop when all grains are in, or when those that are left have no candidate."""
    done = state.counters["placed"] + state.counters["skipped"]
    if done < problem.count:
        return
    state.stop_reason = "saturated" if state.counters["skipped"] else "count"


registration = PackingMethod(
    summary="grains as voxels are added at random places of a lattice and stay there, to exact saturation",
    source="Evans 1993, doi:10.1103/RevModPhys.65.1281",
    parameters=DigitalRsa,
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
