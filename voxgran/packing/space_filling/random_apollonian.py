"""Random Apollonian packing: a random point that is free gets the largest sphere, or true shape, that fits there.

Each sphere touches the nearest surface, of another sphere or a wall. The number of spheres larger than a diameter falls
as a power of it. With `shift` the sphere then moves away from that surface as it grows, until another is equally near,
so many times: the spheres touch two others, become larger, and fill more of the container. With `shrink` each is made
smaller than fits, so that gaps stay between the spheres.

Shapes that are no spheres have random orientations, and grow until they touch a grain or a wall with their true
surfaces (:mod:`voxgran.packing.space_filling.largest_scale`). With `rotate`, each grain is rotated to where it can grow
further, in so many tries: the rotational random Apollonian packing.

References
----------
Manna 1992, Space filling tiling by random packing of discs, Physica A 187, 373-377, doi:10.1016/0378-4371(92)90001-7.
Delaney, Hutzler & Aste 2008, Relation between grain shape and fractal properties in random Apollonian packing with
grain rotation, Physical Review Letters 101, 120602, doi:10.1103/PhysRevLett.101.120602.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from voxgran._base.arrays import Floats, Integers, Words
from voxgran._base.checkpoint import MOST, Held
from voxgran._base.config import check_bounds, parameter, parameter_class
from voxgran._base.errors import InputError, LongRunWarning, warn
from voxgran._base.kernels import bare_kernel, kernel
from voxgran._base.seeds import philox_block, philox_key, unit_float
from voxgran.containers.kernel_container import KernelContainer, clearance, kernel_container
from voxgran.packing.method import Cost, PackingMethod, State, long_run, method_registry, spheres_within
from voxgran.packing.model import Packing
from voxgran.packing.problem import Problem, packing_of_spheres, spheres_of_start
from voxgran.packing.space_filling.reach_cells import (
    ReachCells,
    cells_with,
    gap_at,
    is_covered,
    list_sphere,
    with_room,
    wrapped,
)
from voxgran.packing.space_filling.true_apollonian import (
    LOOKED,
    MADE,
    MISSED,
    NO_ROOM,
    PATIENCE,
    PLACED,
    REACHED,
    GrowthRules,
    PrecomputedShapes,
    advance_shapes,
    expected_seconds,
    precompute_shapes,
    seconds_of_fraction,
)

#: bytes of a grain (measured), and estimate of the largest number of attempts per grain
GRAIN_BYTES, ATTEMPTS = 400, 10_000
#: shares of the shortest edge of the container: the smallest diameter if neither count nor solid fraction is asked for,
#: and the largest one. A square could fill a periodic square otherwise, and a sphere that shifts a spherical container
SMALLEST, LARGEST = 0.02, 0.25
#: largest smallest diameter that is a default, in largest ones
BELOW = 0.1
#: orientation of a grain that is not rotated
UPRIGHT = (1.0, 0.0, 0.0, 0.0)
#: steps by which the place of a shifted sphere is found, distances in radii that count as equal, and the way over which
#: the direction from a wall is found
HALVINGS, ROUNDING, DIFFERENCE = 60, 1e-10, 1e-6


@parameter_class
class RandomApollonian:
    """Parameters of the random Apollonian packing.

    Parameters
    ----------
    smallest
        smallest diameter; default: none if a count or a solid fraction is asked for, otherwise 2 % of the shortest edge
        of the container, and at most a tenth of the largest diameter.
    largest
        largest diameter; default: a quarter of the shortest edge of the container.
    shift
        how often a grain moves away from the nearest surface until another is equally near.
    rotate
        rotations that are tried for each grain that is not a sphere, of which those are kept that let it grow further;
        0: random orientations.
    shrink
        share of the diameter by which each sphere is smaller than fits.

    Raises
    ------
    InputError
        If a number is out of its range, or the largest diameter is below the smallest.

    Examples
    --------
    >>> import voxgran as vg
    >>> method = vg.methods.RandomApollonian(smallest=0.5, largest=2.0)
    >>> vg.pack(vg.shapes.sphere(), vg.Box((5, 5, 5)), method, count=20).count
    20
    """

    smallest: float | None = parameter(None, unit="length", at_least=0.0)
    largest: float | None = parameter(None, unit="length", above=0.0)
    shift: int = parameter(0, at_least=0)
    rotate: int = parameter(0, at_least=0)
    shrink: float = parameter(0.0, at_least=0.0, at_most=0.99)

    def __post_init__(self) -> None:
        """Check the ranges, and that one of the diameters is not below the other."""
        check_bounds(self)
        if self.smallest is not None and self.largest is not None and self.smallest > self.largest:
            raise InputError(
                f"smallest is {self.smallest:g} and largest is {self.largest:g}: no diameter is between; change one"
            )

    @property
    def against_orientations(self) -> str:
        """What orientations that are asked for do not go together with."""
        return f"rotate is {self.rotate}" if self.rotate else ""


def prepare(problem: Problem) -> State:
    """Return the state in which only the grains of the start are placed.

    Raises
    ------
    InputError
        If a grain of the start overlaps another or reaches beyond a wall.
    """
    spheres = np.zeros((problem.count, 4))
    spheres[: problem.started] = spheres_of_start(problem)
    arrays = {"spheres": spheres, "tally": np.array([problem.started, 0], dtype=np.int64), "volume": np.zeros(1)}
    if not all_spheres(problem):
        turns = np.tile(UPRIGHT, (problem.count, 1)) if problem.orientation is None else problem.orientation.copy()
        arrays["diameter"], arrays["orientation"] = np.zeros(problem.count), turns
    if problem.start is not None and not all_spheres(problem):
        arrays["diameter"][: problem.started] = problem.diameter[: problem.started]
        arrays["orientation"][: problem.started] = problem.start.orientation
    declared = {"spheres": spheres_within(problem), "tally": Held(0, [problem.count, MOST])}
    state = State(arrays, {}, 0, ATTEMPTS * (problem.count - problem.started) + PATIENCE, declared=declared)
    _look(problem, state, MADE)
    return state


class PackedSpheres(NamedTuple):
    """Spheres that are placed, (n, 4) centers and radii, with the cells and the walls around them."""

    walls: KernelContainer
    cells: ReachCells
    spheres: Floats


@dataclass(slots=True)
class Precomputed:
    """What follows from the problem and the placed spheres."""

    packed: PackedSpheres
    rules: GrowthRules  # the volume is that of each grain in its bounding sphere of radius 1, the limits are of radii


def advance(problem: Problem, state: State, attempts: int) -> State:
    """Make up to `attempts` attempts, each of which draws one point.

    Warns
    -----
    LongRunWarning
        If the first grains show that the solid fraction is expected to take more than half a minute.
    """
    if state.stop_reason:
        return state
    if "precomputed" not in state.derived:
        limits = _limits(problem)
        make = _precomputed if all_spheres(problem) else precompute_shapes
        state.derived["precomputed"] = make(problem, state, limits)
    made: Precomputed | PrecomputedShapes = state.derived["precomputed"]
    key, last = philox_key(problem.seed, "apollonian"), min(state.done + attempts, state.total)
    if isinstance(made, PrecomputedShapes):
        seen, tally = int(state.arrays["tally"][PLACED]) - problem.started, state.arrays["tally"]
        _look(problem, state, advance_shapes(problem, state, made, key, last))
        if seen < LOOKED <= tally[PLACED] - problem.started and problem.asked_fraction and not state.stop_reason:
            first = state.arrays["diameter"][: problem.started + LOOKED]
            seconds = seconds_of_fraction(problem, first, made.rules.limits[3])
            if text := long_run(method_registry().get("random_apollonian"), problem, seconds):
                warn(text, LongRunWarning)
        return state
    end = NO_ROOM
    while end == NO_ROOM:
        run = (key, state.arrays["tally"], state.arrays["volume"], state.done, last)
        done, end = put_spheres(made.packed, made.rules, *run)
        state.done = int(done)
        if end == NO_ROOM:
            made.packed = made.packed._replace(cells=with_room(made.packed.cells))
    _look(problem, state, int(end))
    return state


def all_spheres(problem: Problem) -> bool:
    """Return whether all shapes are spheres."""
    return all(shape.is_sphere for shape in problem.shapes)


def _limits(problem: Problem) -> Floats:
    """Return the smallest and the largest diameter, the factor on the largest that fits, and the asked volume.

    Raises
    ------
    InputError
        If the smallest diameter is above the largest one by default.
    """
    settings: RandomApollonian = problem.parameters
    edges = (problem.container.bounds[1] - problem.container.bounds[0])[: problem.dimension]
    largest = LARGEST * float(edges.min()) if settings.largest is None else problem.length(settings.largest)
    smallest = 0.0
    if settings.smallest is not None:
        smallest = problem.length(settings.smallest)
    elif not problem.target:
        smallest = min(SMALLEST * float(edges.min()), BELOW * largest)
    if smallest > largest:
        unit = problem.unit_length
        raise InputError(
            f"smallest is {smallest * unit:g}, and largest is by default {largest * unit:g}, a quarter of the shortest "
            "edge of the container: no diameter is between; give largest"
        )
    asked = math.inf if problem.asked_fraction is None else problem.asked_fraction * problem.container.volume
    return np.array([smallest, largest, 1.0 - settings.shrink, asked])


def _precomputed(problem: Problem, state: State, limits: Floats) -> Precomputed:
    """Return cells with the placed spheres in them, volumes and limits."""
    walls = kernel_container(problem.container, from_corner=True)
    cells = cells_with(walls, problem.count, state.arrays["spheres"][: state.arrays["tally"][PLACED]])
    limits, shift = limits * np.array([0.5, 0.5, 1.0, 1.0]), problem.parameters.shift
    packed = PackedSpheres(walls, cells, state.arrays["spheres"])
    return Precomputed(packed, GrowthRules(problem.unit_volumes, limits, shift, 0))


def _look(problem: Problem, state: State, end: int) -> None:
    """Set the stop reason."""
    tally = state.arrays["tally"]
    if end == REACHED:
        state.stop_reason = "solid_fraction"
    state.end_if(placed=bool(tally[PLACED] == problem.count), full=bool(tally[MISSED] >= PATIENCE))


def finish(problem: Problem, state: State) -> Packing:
    """Return the packing of the grains that were placed."""
    arrays, many = state.arrays, int(state.arrays["tally"][PLACED])
    if all_spheres(problem):
        return packing_of_spheres(problem, np.arange(many), arrays["spheres"][:many], state.stop_reason, sized=True)
    return problem.packing(
        np.arange(many),
        position=arrays["spheres"][:many, :3] + problem.container.bounds[0],
        orientation=arrays["orientation"][:many],
        diameter=arrays["diameter"][:many],
        stop_reason=state.stop_reason,
    )


def cost(problem: Problem) -> Cost:
    """Return the cost of a run.

    Raises
    ------
    InputError
        If the smallest diameter is above the largest one by default.
    """
    smallest, seconds = _limits(problem)[0], 0.0
    if problem.asked_fraction is None and not all_spheres(problem):
        seconds = expected_seconds(problem, smallest)
    memory, attempts = GRAIN_BYTES * problem.count + 2**22, ATTEMPTS * problem.count + PATIENCE
    return Cost(memory=memory, attempts=attempts, seconds=seconds)


registration = PackingMethod(
    summary="random free points get the largest grain that fits there: a power law of sizes that fills the gaps",
    source="Manna 1992, doi:10.1016/0378-4371(92)90001-7; Delaney et al. 2008, doi:10.1103/PhysRevLett.101.120602",
    parameters=RandomApollonian,
    prepare=prepare,
    advance=advance,
    finish=finish,
    cost=cost,
    any_walls=True,
    dimensions=(2, 3),
    sizing="made",
    start="placed",
)


@kernel
def put_spheres(
    packed: PackedSpheres, rules: GrowthRules, key: Words, tally: Integers, filled: Floats, done: int, last: int
) -> tuple[int, int]:
    """Make attempts up to number `last`; return the number after the last that was made, and how this part ends.

    filled: (1,) volume of the spheres that were placed.
    """
    (walls, cells, spheres), limits, volume, place = packed, rules.limits, rules.volume, np.zeros(4)
    while done < last and tally[PLACED] < len(spheres) and tally[MISSED] < PATIENCE:
        words = philox_block(key[0], key[1], np.uint64(done), np.uint64(0))
        place[0] = unit_float(words[0]) * walls.lengths[0]
        place[1] = unit_float(words[1]) * walls.lengths[1]
        place[2] = unit_float(words[2]) * walls.lengths[2] if walls.dimension == 3 else 0.0
        _grow_at(packed, place, rules.shift, limits[1])
        radius, n = place[3] * limits[2], tally[PLACED]
        if radius <= 0.0 or radius < limits[0]:
            tally[MISSED] += 1
            done += 1
            continue
        added, reached = volume[n] * radius**walls.dimension, False
        if filled[0] + added >= limits[3]:
            # the last sphere is made smaller, so that the solid fraction is met exactly
            added, reached = limits[3] - filled[0], True
            radius = (added / volume[n]) ** (1.0 / walls.dimension)
        if not list_sphere(cells, n, place[0], place[1], place[2], radius, -1.0):
            return done, NO_ROOM
        spheres[n, 0], spheres[n, 1], spheres[n, 2], spheres[n, 3] = place[0], place[1], place[2], radius
        filled[0] += added
        tally[PLACED] += 1
        tally[MISSED] = 0
        done += 1
        if reached:
            return done, REACHED
    return done, MADE


@bare_kernel
def _grow_at(packed, place, shift, largest):  # type: ignore[no-untyped-def]
    """Write the radius of the largest sphere at a place, which moves if spheres shift; none where a point is taken."""
    place[3] = _radius_at(packed, place[0], place[1], place[2], largest)
    for _ in range(shift):
        if place[3] <= 0.0 or place[3] >= largest or not _shifted(packed, place, largest):
            return


@bare_kernel
def _radius_at(packed, x, y, z, largest):  # type: ignore[no-untyped-def]
    """Return the radius of the largest sphere about a point, which is negative where the point is taken."""
    room = clearance(packed.walls, x, y, z)
    if room <= 0.0 or is_covered(packed.cells, packed.spheres, x, y, z):
        return -1.0
    return gap_at(packed.cells, packed.spheres, x, y, z, min(room, largest))[0]


@bare_kernel
def _shifted(packed, place, largest):  # type: ignore[no-untyped-def]
    """Move a sphere away from the nearest surface, which it goes on to touch, until another is equally near.

    Returns whether it has become larger.
    """
    x, y, z, radius, cells = place[0], place[1], place[2], place[3], packed.cells
    ux, uy, uz = _away(packed, x, y, z, radius)
    low, high, step = 0.0, math.inf, 0.5 * radius
    for _ in range(HALVINGS):
        px, py, pz = (
            wrapped(cells, 0, x + step * ux),
            wrapped(cells, 1, y + step * uy),
            wrapped(cells, 2, z + step * uz),
        )
        grown = _radius_at(packed, px, py, pz, largest)
        # while the first surface is the nearest, the radius grows as the sphere moves
        if grown < (radius + step) * (1.0 - ROUNDING):
            high = step
        else:
            low = step
            place[0], place[1], place[2], place[3] = px, py, pz, grown
        step = 2.0 * step if high == math.inf else 0.5 * (low + high)
        if high - low < ROUNDING * radius:
            break
    return place[3] > radius * (1.0 + ROUNDING)


@bare_kernel
def _away(packed, x, y, z, radius):  # type: ignore[no-untyped-def]
    """Return the direction away from the surface that is nearest to a point, at the distance `radius`."""
    walls, cells, spheres = packed
    sphere = gap_at(cells, spheres, x, y, z, radius * (1.0 + ROUNDING))[1]
    if sphere >= 0:
        ux = _nearest_image(cells, 0, x - spheres[sphere, 0])
        uy = _nearest_image(cells, 1, y - spheres[sphere, 1])
        uz = _nearest_image(cells, 2, z - spheres[sphere, 2])
    else:
        step = DIFFERENCE * radius
        ux = clearance(walls, x + step, y, z) - clearance(walls, x - step, y, z)
        uy = clearance(walls, x, y + step, z) - clearance(walls, x, y - step, z)
        uz = 0.0
        if walls.dimension == 3:
            uz = clearance(walls, x, y, z + step) - clearance(walls, x, y, z - step)
    length = math.sqrt(ux * ux + uy * uy + uz * uz)
    if length == 0.0:
        return 0.0, 0.0, 0.0
    return ux / length, uy / length, uz / length


@bare_kernel
def _nearest_image(cells, axis, step):  # type: ignore[no-untyped-def]
    """Return a difference of coordinates between nearest images."""
    span = cells.span[axis]
    return step - math.floor(step / span + 0.5) * span if span > 0.0 else step
