"""Filling of cells: the container is cut into cells whose volumes follow the sizes, and each cell gets one grain.

The cells are those of a Laguerre tessellation, Voronoi cells of weighted seeds, whose volumes are in proportion to
those of the drawn grains, for any gradation (:mod:`voxgran.packing.tessellation.voronoi_steps`).

With ``fill="shapes"`` each grain gets the largest place in its cell that a search over orientations finds. Then the
planes between neighbours move to the middle of the gaps that are left, and the grains look for larger places in the
room that they have gained. Grains have the drawn sizes where their places allow it. For a solid fraction that is not
met with these, all sizes get one factor, up to the largest that each place allows.

With ``fill="cells"`` the grains are the cells, each a shape of its own, made smaller by one factor: any solid fraction
up to 1 is met. The shapes that are given then tell only the volumes.

A container that is not convex has cells without its corners: see :mod:`voxgran.packing.tessellation.voronoi_cells`.

References
----------
Mollon & Zhao 2012, Fourier-Voronoi-based generation of realistic samples for discrete modelling of granular materials,
Granular Matter 14, 621-638, doi:10.1007/s10035-012-0356-x: filling Voronoi cells of given sizes with shapes, in two
dimensions and with inverse Monte Carlo steps of the seeds instead of weights.
Bourne, Kok, Roper & Spanjer 2020, Laguerre tessellations and polycrystalline microstructures: a fast algorithm for
generating grains of given volumes, Philosophical Magazine 100, 2677-2707, doi:10.1080/14786435.2020.1790053.
"""

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import Floats, Integers
from voxgran._base.checkpoint import MOST, Held
from voxgran._base.config import parameter, parameter_class
from voxgran._base.errors import PackingWarning, warn
from voxgran._base.seeds import philox_key, stream
from voxgran._base.stopping import stop_if_asked
from voxgran.contacts.assembly import by_shape
from voxgran.containers.kernel_container import kernel_container
from voxgran.geometry.rotation import normalized
from voxgran.packing.method import Cost, PackingMethod, State
from voxgran.packing.model import Packing
from voxgran.packing.problem import Problem, random_points
from voxgran.packing.tessellation.voronoi_bodies import Bodies, Poses, bodies_of, poses_of
from voxgran.packing.tessellation.voronoi_cells import FACES, Cells, Seeds, seeds_of
from voxgran.packing.tessellation.voronoi_fit import MARGIN, Places, Programme, empty_programme, fit_shapes
from voxgran.packing.tessellation.voronoi_grains import largest_factor, shapes_of
from voxgran.packing.tessellation.voronoi_steps import TALLY, first_arrays, most_diagrams, step
from voxgran.shapes.sizes import size_distance

#: bytes of a grain (estimated)
GRAIN_BYTES = 1800
#: solid fraction of the drawn grains where neither a count nor a solid fraction is asked for
USUAL = 0.5
#: factor on the largest volumes beyond what is needed, gain of a round that is too little for another, and orientations
#: in a room, as a share of those in a cell
AHEAD, LITTLE, AGAIN = 1.02, 2e-4, 0.3
#: grains fitted between two looks whether to stop
AT_ONCE = 100
#: numbers of grains fitted in the round, of rounds, and whether all is done, after those of the tessellation
FITTED, ROUND, DONE = 3, 4, 5


@parameter_class
class VoronoiFill:
    """Parameters of the filling of cells.

    Parameters
    ----------
    fill
        what fills the cells: the shapes given, or the cells themselves, each as a shape of its own.
    smoothing
        moves of the seeds to the centroids of their cells; 0: cells of random seeds, more: rounder cells.
    orientations
        orientations of a grain that are tried in its cell.
    rounds
        most rounds in which planes move to the middle of gaps and grains look for larger places: first up to the sizes
        that are asked for, and then, for a solid fraction that is not met, as many up to larger ones.

    Raises
    ------
    InputError
        If a number is out of its range.

    Examples
    --------
    >>> import voxgran as vg
    >>> packing = vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), vg.methods.VoronoiFill(fill="cells"), count=10)
    >>> packing.count
    10
    """

    fill: Literal["shapes", "cells"] = parameter("shapes")
    smoothing: int = parameter(30, at_least=0)
    orientations: int = parameter(100, at_least=1)
    rounds: int = parameter(8, at_least=0)

    @property
    def own_shapes(self) -> bool:
        """Whether the grains have shapes of their own, so that those that are given tell the volumes only."""
        return self.fill == "cells"

    @property
    def against_orientations(self) -> str:
        """What orientations that are asked for do not go together with."""
        return "fill is 'cells'" if self.own_shapes else ""


def prepare(problem: Problem) -> State:
    """Return the state in which seeds are at random points."""
    n = _used(problem)
    place = random_points(problem.container, n, stream(problem.seed, "points")) - problem.container.bounds[0]
    arrays: dict[str, Any] = first_arrays(place)
    arrays.update(tally=np.zeros(6, dtype=np.int64), cap=np.ones(1))
    for name in ("", "next_"):
        arrays[f"{name}arm"], arrays[f"{name}size"] = np.zeros((n, 3)), np.zeros(n)
        arrays[f"{name}turn"] = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
    if problem.orientation is not None:
        arrays["turn"], arrays["next_turn"] = problem.orientation[:n].copy(), problem.orientation[:n].copy()
    if not problem.target:
        arrays["cap"][0] = math.inf
    settings: VoronoiFill = problem.parameters
    wide, most = np.ptp(problem.container.bounds, axis=0), most_diagrams(settings.smoothing)
    near, turn, size = Held(-wide, 2.0 * wide), Held(-1.0, 1.0), Held(0.0, float(wide.max()))
    declared = {
        **dict.fromkeys(("place", "known_place"), near), **dict.fromkeys(("turn", "next_turn"), turn),
        **dict.fromkeys(("size", "next_size"), size), "error": Held(high=math.inf), "cap": Held(0.0, math.inf),
        "tally": Held(0, [most, most, 1, MOST, n, 1]),
    }  # fmt: skip
    state = State(arrays, {}, 0, most + (2 * settings.rounds + 1) * n, declared=declared)
    if n == 0:
        arrays["tally"][DONE] = 1
        state.stop_reason = "count"
    return state


def _used(problem: Problem) -> int:
    """Return how many of the drawn grains are placed: where no target is given, those that usually find room."""
    if problem.target or not problem.count:
        return problem.count
    room = problem.container.volume * (USUAL if problem.parameters.fill == "shapes" else 1.0)
    return max(1, int(np.searchsorted(np.cumsum(problem.volumes), room * (1.0 + 1e-12), side="right")))


@dataclass(slots=True)
class Precomputed:
    """What follows from the problem and the state; that of the fit only while grains are fitted."""

    cells: Cells
    share: Floats
    bodies: Bodies | None = None
    seeds: Seeds | None = None
    poses: Poses | None = None
    programme: Programme | None = None


def advance(problem: Problem, state: State, attempts: int) -> State:
    """Make up to `attempts` attempts: each computes all cells once, or fits one grain."""
    if state.stop_reason:
        return state
    if "precomputed" not in state.derived:
        state.derived["precomputed"] = _precomputed(problem, state)
    made: Precomputed = state.derived["precomputed"]
    settings: VoronoiFill = problem.parameters
    tally, last = state.arrays["tally"], state.done + attempts
    while state.done < last and not tally[DONE]:
        if not tally[TALLY.final]:
            step(made.cells, state, made.share, settings.smoothing, stop_if_asked)
            state.done += 1
            if tally[TALLY.final] and settings.fill == "cells":
                tally[DONE] = 1
        else:
            stop_if_asked()
            state.done += _fit(problem, state, made, min(last - state.done, AT_ONCE))
    if tally[DONE]:
        state.stop_reason = _reason(problem, state)
        state.derived.clear()
    return state


def _precomputed(problem: Problem, state: State) -> Precomputed:
    """Return walls, work space and the shares of all grains in the volume."""
    cells = Cells(kernel_container(problem.container, from_corner=True))
    volumes = problem.volumes[: len(state.arrays["place"])]
    return Precomputed(cells, volumes / volumes.sum())


def _fit(problem: Problem, state: State, made: Precomputed, many: int) -> int:
    """Fit some grains, and end the round after the last one; return how many were fitted."""
    arrays, tally = state.arrays, state.arrays["tally"]
    n, settings = len(arrays["place"]), problem.parameters
    shape_id = problem.shape_id[:n]
    if made.bodies is None or made.programme is None or made.seeds is None:
        made.bodies, made.programme = bodies_of(problem.shapes), empty_programme(FACES)
        made.seeds = seeds_of(arrays["known_place"], arrays["known_weight"], made.cells.walls)
    if made.poses is None:
        made.poses = poses_of(problem.shapes, shape_id, arrays["arm"], arrays["turn"], arrays["size"])
    first = int(tally[FITTED])
    last, again = min(first + many, n), bool(tally[ROUND])
    tries = math.ceil(settings.orientations * (AGAIN if again else 1.0)) if problem.orientation is None else 0
    most = arrays["cap"][0] * problem.diameter[:n]
    key = philox_key(problem.seed, f"orientations {tally[ROUND]}")
    places = Places(arrays["next_arm"], arrays["next_turn"], arrays["next_size"])
    done = first
    while done < last:
        cells = made.cells.around(made.seeds, made.bodies, made.poses)
        done = fit_shapes(cells, made.programme, places, again, most, tries, key, done, last)
        if done < last:
            made.cells.grow()
            made.programme = empty_programme(len(made.cells.work.size))
    tally[FITTED] = last
    if last == n:
        _end_round(problem, state)
        made.poses = None
    return last - first


def _end_round(problem: Problem, state: State) -> None:
    """Take over the places that were found, and decide whether there is another round, and up to which sizes."""
    arrays, tally, dimension = state.arrays, state.arrays["tally"], problem.dimension
    before = float(libm.power(arrays["size"], dimension).sum())
    for name in ("arm", "turn", "size"):
        arrays[name] = arrays[f"next_{name}"].copy()
    n = len(arrays["size"])
    each = problem.volumes[:n] / libm.power(problem.diameter[:n], dimension)
    volume, wanted = float((each * libm.power(arrays["size"], dimension)).sum()), float(problem.volumes[:n].sum())
    gain = float(libm.power(arrays["size"], dimension).sum()) - before
    rounds, stuck = problem.parameters.rounds, gain <= LITTLE * before
    first_over = stuck or tally[ROUND] >= rounds
    over = first_over
    if problem.target and volume >= wanted * (1.0 - 1e-12):
        over = True
    elif problem.asked_fraction is not None:
        # places for the sizes as they are come first; what is missing then is made up for by grains that have more room
        ahead = arrays["cap"][0] > 1.0
        over = (ahead and stuck) or tally[ROUND] >= 2 * rounds or not volume > 0.0
        if not over and (ahead or first_over):
            arrays["cap"][0] *= AHEAD * (wanted / volume) ** (1.0 / dimension)
    tally[FITTED] = 0
    tally[ROUND] += 1
    tally[DONE] = int(over)


def _reason(problem: Problem, state: State) -> str:
    """Return why a run has ended."""
    if not problem.target:
        return "full"
    if problem.asked_fraction is None:
        return "count"
    if problem.parameters.fill == "cells":
        return "solid_fraction"
    n = len(state.arrays["size"])
    largest = problem.volumes[:n] * libm.power(state.arrays["size"] / problem.diameter[:n], problem.dimension)
    return "solid_fraction" if largest.sum() >= problem.volumes[:n].sum() * (1.0 - 1e-9) else "full"


def finish(problem: Problem, state: State) -> Packing:
    """Return the packing of the grains that have a place, of sizes that are as drawn, times one factor, if they can be.

    Where only a count is asked for and sizes cannot be kept, a warning says so.
    """
    if problem.parameters.fill == "cells":
        return _finish_cells(problem, state)
    arrays = state.arrays
    placed = np.flatnonzero(arrays["size"] > 0.0)
    drawn, size = problem.diameter[placed], arrays["size"][placed]
    unit = problem.volumes[placed] / libm.power(drawn, problem.dimension)
    factor = _factor(problem, unit * libm.power(size, problem.dimension), problem.volumes[placed])
    kept = np.minimum(size, factor ** (1.0 / problem.dimension) * drawn)
    short = size < drawn * (1.0 - 1e-9)
    if state.stop_reason == "count" and short.any():
        warn(
            f"{short.sum()} of {len(short)} grains have sizes below those that were drawn, by a factor of down to "
            f"{(size / drawn).min():.3g}: their cells have no more room; ask for fewer or smaller grains, or make the "
            "container larger",
            PackingWarning,
        )
    return problem.packing(
        placed,
        position=arrays["known_place"][placed] + arrays["arm"][placed] + problem.container.bounds[0],
        orientation=None if all(shape.is_sphere for shape in problem.shapes) else normalized(arrays["turn"][placed]),
        diameter=kept,
        stop_reason=state.stop_reason,
        provenance=_told(state, factor ** (1.0 / problem.dimension), drawn, kept),
    )


def _factor(problem: Problem, largest: Floats, drawn: Floats) -> float:
    """Return the factor on the drawn volumes at which they have the volume that is asked for, none above its largest.

    It is infinite where all grains are as large as they can be.
    """
    if not problem.target:
        return math.inf
    if problem.asked_fraction is None:
        return 1.0
    wanted = problem.asked_fraction * problem.container.volume
    if largest.sum() <= wanted:
        return math.inf
    order = np.argsort(largest / drawn, kind="stable")
    full = np.concatenate([[0.0], np.cumsum(largest[order])])[:-1]
    rest = np.cumsum(drawn[order][::-1])[::-1]
    factors = (wanted - full) / rest
    # the first grain that keeps its share of the rest
    return float(factors[np.argmax(factors <= (largest / drawn)[order] * (1.0 + 1e-15))])


def _told(state: State, factor: float, drawn: Floats, kept: Floats) -> dict[str, Any]:
    """Return what the provenance says of the cells and of the sizes."""
    arrays, tally = state.arrays, state.arrays["tally"]
    told = {
        "volume_error": float(arrays["error"][0]),
        "diagrams": int(tally[TALLY.diagrams]),
        "rounds": int(tally[ROUND]),
        "factor": factor if math.isfinite(factor) else None,
        "gradation_distance": size_distance(drawn / np.median(drawn), kept / np.median(kept)) if len(drawn) else 0.0,
    }
    return {"tessellation": told}


def _finish_cells(problem: Problem, state: State) -> Packing:
    """Return the packing of the cells."""
    arrays, unit, dimension = state.arrays, problem.unit_length, problem.dimension
    cells = Cells(kernel_container(problem.container, from_corner=True))
    final = bool(arrays["tally"][TALLY.final])
    seeds = seeds_of(arrays["known_place"], arrays["known_weight"], cells.walls)
    found = shapes_of(cells, seeds) if final else []
    placed: Integers = np.array([i for i, shape in enumerate(found) if shape is not None], dtype=np.int64)
    shapes = [shape for shape in found if shape is not None]
    volume = np.array([shape.volume for shape in shapes])
    most = np.array([largest_factor(shape, cells.walls) for shape in shapes]) * (1.0 - MARGIN)
    drawn = problem.volumes[placed]
    factor = _factor(problem, libm.power(most, dimension) * volume, drawn)
    scale = np.minimum(most, libm.power(factor * drawn / volume, 1.0 / dimension))
    center = np.array([shape.offset for shape in shapes]).reshape(-1, 3) + problem.container.bounds[0]
    kept = scale * np.array([shape.diameter for shape in shapes])
    grains = [shape.scaled(unit * float(size)) for shape, size in zip(shapes, scale, strict=True)]
    told = _told(state, factor ** (1.0 / dimension), problem.diameter[placed], kept)
    empty = problem.packing(placed[:0], position=center[:0], stop_reason=state.stop_reason, provenance=told)
    if not grains:
        return empty
    return Packing.of(
        grains,
        empty.container,
        position=center * unit,
        shape_id=np.arange(len(grains)),
        # each cell is a shape of its own, with the density of the grain that it was drawn for
        density=np.array(by_shape(problem.density, len(problem.shapes)))[problem.shape_id[placed]].tolist(),
        provenance=empty.provenance,
        stop_reason=empty.stop_reason,
        unit=empty.unit,
        gravity=None,
    )


def cost(problem: Problem) -> Cost:
    """Return the cost of a run; the attempts are the most, of which a tenth is usually made."""
    settings: VoronoiFill = problem.parameters
    n = _used(problem)
    return Cost(
        memory=GRAIN_BYTES * n + 2**22, attempts=most_diagrams(settings.smoothing) + (2 * settings.rounds + 1) * n
    )


registration = PackingMethod(
    summary="cells whose volumes follow the sizes, each filled by a shape or a grain itself, to any solid fraction",
    source="Mollon & Zhao 2012, doi:10.1007/s10035-012-0356-x; Bourne et al. 2020, doi:10.1080/14786435.2020.1790053",
    parameters=VoronoiFill,
    prepare=prepare,
    advance=advance,
    finish=finish,
    cost=cost,
    dimensions=(2, 3),
    sizing="scaled",
    no_start="fills the whole container with its cells",
)
