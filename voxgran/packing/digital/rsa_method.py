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
from typing import Literal

import numpy as np

from voxgran._base.arrays import Integers
from voxgran._base.config import check_bounds, parameter
from voxgran._base.errors import TooLargeError
from voxgran._base.seeds import philox_key, stream
from voxgran.packing.digital.bit_columns import Canvas, Field
from voxgran.packing.digital.container_lattice import (
    MOST_ORIENTATIONS,
    ContainerLattice,
    container_lattice,
    free_voxels,
    positions_on,
)
from voxgran.packing.digital.oriented_voxels import Oriented, base_orientations, kinds_of, orient, stand_start
from voxgran.packing.digital.trial_sites import Lists, Parts, add_at_random, stamp_grain
from voxgran.packing.method import Cost, PackingMethod, State
from voxgran.packing.model import Packing
from voxgran.packing.problem import Problem
from voxgran.packing.start import Start

#: most candidates, places times orientations times kinds
MOST_CANDIDATES = 2**40
#: what the kernel counts, in its order
TALLY = ("placed", "skipped", "refused")


@dataclass(frozen=True, kw_only=True, slots=True)
class DigitalRsa:
    """Parameters of random sequential addition on a lattice.

    Raises
    ------
    InputError
        If a number is out of its range.
    """

    voxel_size: float | None = parameter(
        None, doc="edge of a voxel; left out: 1/16 of the median diameter", unit="length", above=0.0
    )
    cover: Literal["touch", "center"] = parameter(
        "touch", doc="voxels that a grain takes: all that it touches, or those whose center it holds"
    )
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


def prepare(problem: Problem) -> State:
    """Return the state in which every place in every orientation is a candidate.

    Raises
    ------
    TooLargeError
        If there are more than 2**40 candidates.
    InputError
        If no voxel size fits the periodic lengths, or a grain of the start finds no place.
    """
    lattice = container_lattice(problem, _voxel_size(problem))
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
    state = State(arrays, {**dict.fromkeys(TALLY, 0)}, 0, int(setting.bounds[-1]) + problem.count)
    state.derived["setting"] = setting
    if problem.start is not None:
        _enter_start(problem, state, problem.start)
    _look(problem, state)
    return state


def advance(problem: Problem, state: State, attempts: int) -> State:
    """Try up to `attempts` candidates."""
    if state.stop_reason:
        return state
    setting, arrays = _setting(problem, state), state.arrays
    tally = np.array([state.counters[name] for name in TALLY], dtype=np.int64)
    lists = Lists(arrays["order"], setting.kind, setting.bounds, arrays["tried"], setting.places)
    where = _field(state, setting), _parts(setting), arrays["site"], arrays["member"]
    key = philox_key(problem.seed, "digital_rsa")
    state.done = int(add_at_random(*where, lists, tally, key, state.done, state.done + attempts))
    state.counters.update(zip(TALLY, tally.tolist(), strict=True))
    _look(problem, state)
    return state


def finish(problem: Problem, state: State) -> Packing:
    """Return the packing of the grains that found a place."""
    setting = _setting(problem, state)
    placed = np.flatnonzero(state.arrays["member"] >= 0)
    member = state.arrays["member"][placed]
    free = free_voxels(problem.container, setting.lattice)
    room = int(np.prod(setting.lattice.shape)) if free is None else int(np.count_nonzero(free))
    return problem.packing(
        placed,
        position=positions_on(setting.lattice, state.arrays["site"][placed], problem.dimension),
        voxel_size=setting.lattice.voxel_size,
        contact_gap=setting.lattice.voxel_size,
        orientation=setting.oriented.orientation[member],
        provenance={
            "candidates": int(setting.bounds[-1]),
            "candidates_left": int(setting.bounds[-1] - state.arrays["tried"].sum()),
            "voxel_solid_fraction": float(setting.oriented.voxels[member].sum() / max(room, 1)),
        },
        stop_reason=state.stop_reason,
    )


def cost(problem: Problem) -> Cost:
    """Return what a run takes."""
    lattice = container_lattice(problem, _voxel_size(problem))
    candidates = min(_most_candidates(problem, lattice), MOST_CANDIDATES)
    starting = 0 if problem.start is None else problem.start.count
    return Cost(
        memory=int(np.prod(lattice.shape) / 2 + 2**23),
        attempts=candidates + problem.count,
        voxelized_shapes=len(kinds_of(problem)[1]) * problem.parameters.orientations + starting,
    )


@dataclass(frozen=True, slots=True)
class _Setting:
    """What follows from the problem: lattice, canvas, kinds, orientations, places along each axis, first candidates."""

    lattice: ContainerLattice
    canvas: Canvas
    kind: Integers
    oriented: Oriented
    places: Integers
    first: Integers
    bounds: Integers


def _voxel_size(problem: Problem) -> float:
    """Return the voxel size that is asked for, in median diameters."""
    asked = problem.parameters.voxel_size
    return 1 / 16 if asked is None else problem.length(asked)


def _places(problem: Problem, lattice: ContainerLattice) -> Integers:
    """Return at how many corners of voxels a centroid may lie, along each axis."""
    places = lattice.shape + (1 - np.array(problem.container.periodic, dtype=np.int64))
    if problem.dimension == 2:
        places[2] = 1
    return np.asarray(places, dtype=np.int64)


def _most_candidates(problem: Problem, lattice: ContainerLattice) -> int:
    """Return the number of candidates before orientations that look alike are counted once."""
    turns = (24 if problem.dimension == 3 else 4) if problem.parameters.turned else 1
    poses = len(kinds_of(problem)[1]) * problem.parameters.orientations
    return int(np.prod(_places(problem, lattice))) * poses * turns


def _make_setting(problem: Problem) -> _Setting:
    """Voxelize the kinds and lay out the canvas."""
    settings: DigitalRsa = problem.parameters
    lattice = container_lattice(problem, _voxel_size(problem))
    kind, grains = kinds_of(problem)
    base = base_orientations(problem, len(grains), settings.orientations)
    oriented = orient(problem, grains, base, lattice.voxel_size, turned=settings.turned, cover=settings.cover)
    periodic = np.array(problem.container.periodic, dtype=np.int64)
    margin = np.where(periodic, int(oriented.size.max(initial=1)) + 1, 1).astype(np.int64)
    canvas, places = Canvas(lattice.shape, margin, periodic), _places(problem, lattice)
    first = np.searchsorted(oriented.kind, np.arange(len(grains) + 1)).astype(np.int64)
    return _Setting(lattice, canvas, kind, oriented, places, first, (first - first[:1]) * int(np.prod(places)))


def _setting(problem: Problem, state: State) -> _Setting:
    """Return the setting, with the canvas, made again where the state was read from a checkpoint."""
    if "setting" not in state.derived:
        state.derived["setting"] = _make_setting(problem)
    made: _Setting = state.derived["setting"]
    if "words" not in state.derived:
        state.derived["words"] = made.canvas.words(free_voxels(problem.container, made.lattice))
        field, parts = _field(state, made), _parts(made)
        for grain in np.flatnonzero(state.arrays["member"] >= 0).tolist():
            stamp_grain(field, parts, int(state.arrays["member"][grain]), state.arrays["site"][grain])
    return made


def _field(state: State, setting: _Setting) -> Field:
    """Return the canvas as kernels take it."""
    _, words, deep = setting.canvas.word_shape
    canvas = setting.canvas
    return Field(state.derived["words"], words * deep, deep, canvas.shape, canvas.margin, canvas.periodic)


def _parts(setting: _Setting) -> Parts:
    """Return the oriented voxels as kernels take them."""
    oriented = setting.oriented
    return Parts(oriented.words, oriented.at, oriented.low, oriented.size)


def _enter_start(problem: Problem, state: State, start: Start) -> None:
    """Put the grains of the start on the lattice, each as near to its place as there is room."""
    setting = _setting(problem, state)
    gravity = np.zeros(3, dtype=np.int64)
    gravity[problem.dimension - 1] = -1
    gravity *= not problem.container.periodic[problem.dimension - 1]
    oriented, field = setting.oriented, _field(state, setting)
    sites = stand_start(problem, start, setting.lattice, oriented, field=field, gravity=gravity)
    state.arrays["site"][: start.count] = sites
    state.arrays["member"][: start.count] = np.arange(len(oriented.at) - start.count, len(oriented.at))
    state.counters["placed"] = start.count


def _look(problem: Problem, state: State) -> None:
    """Stop when all grains are in, or when those that are left have no candidate."""
    done = state.counters["placed"] + state.counters["skipped"]
    if done < problem.count:
        return
    state.stop_reason = "saturated" if state.counters["skipped"] else "count"


registration = PackingMethod(
    name="digital_rsa",
    summary="grains as voxels are added at random places of a lattice and stay there, to exact saturation",
    source="Evans 1993, doi:10.1103/RevModPhys.65.1281",
    parameters=DigitalRsa,
    prepare=prepare,
    advance=advance,
    finish=finish,
    cost=cost,
    dimensions=(2, 3),
    any_container=True,
)
