"""A bed from random seeds: grains grow from them in a column, with contacts, fall, and come to rest.

Seeds lie at random in a column above the floor, or above the grains of a start; each grain begins so small that none
overlap and grows to its size while its contacts hold it, so that grains of all sizes and shapes stay mixed. Then all
grains settle (:mod:`voxgran.settling.stages`), those of a start with them.

Grains may also arrive one after the other upon a bed, through an inlet or over the whole container.

References
----------
Moreau 1988, Unilateral contact and dry friction in finite freedom dynamics, doi:10.1007/978-3-7091-2624-0_1.
"""

import math
from collections.abc import Callable
from dataclasses import fields, replace
from typing import Literal

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran._base.config import parameter, parameter_class, to_mapping
from voxgran._base.errors import InputError, PackingWarning, warn
from voxgran._base.seeds import stream
from voxgran.contacts.assembly import Assembly
from voxgran.containers.gravity import gravity_text, gravity_vector
from voxgran.packing.beds.expected import surface_level
from voxgran.packing.beds.filling import highest_surface, in_column, usual_solid_fraction, volume_at_rest
from voxgran.packing.beds.inlet import Inlet, column_below
from voxgran.packing.beds.met import MetBed
from voxgran.packing.beds.reachable import reachable
from voxgran.packing.beds.seeds import LOOSE, RADIUS, column_top, container_levels, random_seeds
from voxgran.packing.method import Cost, PackingMethod
from voxgran.packing.model import Packing
from voxgran.packing.problem import Problem, spheres_of_start
from voxgran.packing.settling_run import (
    GRAIN_BYTES,
    Moving,
    SettleState,
    advance_settling,
    begin_settling,
    contact_forces,
    lid_of,
    with_lid,
)
from voxgran.settling.examination import TOUCHING
from voxgran.settling.parameters import Settling, with_friction
from voxgran.settling.rain import Rain, speed_of_fall
from voxgran.settling.stages import Settler

#: largest solid fraction of the column, and the largest one in that of the bed
FULLEST, LOOSER = 0.52, 0.87
#: share of a height, and distance in median diameters, up to which a surface is met
CLOSE, CLOSER = 0.035, 0.2
#: why grains are left out, and what helps
NO_ROOM = (
    "no more are expected to come to rest below the top of the container, or below the height that is asked for, or to "
    "have room in the column of the inlet; ask for less, or take smaller grains or a higher or wider container"
)
#: largest size of a grain at the beginning, in sizes at which its bounding sphere is its seed
APART = 0.98


@parameter_class
class Gravity(Settling):
    """Parameters of beds that grow from seeds.

    Parameters
    ----------
    gravity
        direction of gravity, as an axis or as a vector of any length; if omitted, '-z', and '-y' in two dimensions.
    fill
        solid fraction of the column in which the grains grow, at most 0.87 of that of the bed; lower ones fall farther;
        of grains that grow together only, not beside a fall height or a rate of the inlet.
    height
        height of the surface of the bed above the lowest point of the container, in units of length, to 3.5 percent or
        0.2 median diameters: about 95 percent of all grains have their tops below it; as many grains grow as usually
        fill it, and where the surface is elsewhere the bed is made again, at most twice, with a number of grains
        corrected by that; if omitted, count and solid_fraction alone decide, or the container.
    inlet
        disk or rectangle below which the grains begin to fall; if omitted, the whole container.
    fall_height
        height, in units of length, from which grains have fallen when they meet the bed, one after the other, at the
        rate of the inlet or such that the bed rises by 0.3 d in sqrt(d / g): the higher, the denser; if omitted, they
        grow together and fall no faster than sqrt(g d).

    Raises
    ------
    InputError
        If a number is out of its range, gravity is ``"none"``, or there is a solid fraction of the column, in which
        grains grow together, where they arrive one after the other.

    Examples
    --------
    >>> import voxgran as vg
    >>> bed = vg.pack(vg.shapes.sphere(), vg.Box((3, 3, 6)), vg.methods.Gravity(friction=0.3), count=20)
    >>> bed.stop_reason
    'settled'
    """

    gravity: Literal["-x", "+x", "-y", "+y", "-z", "+z"] | tuple[float, float, float] | None = parameter(None)
    fill: float = parameter(LOOSE, above=0.0, at_most=FULLEST)
    height: float | None = parameter(None, above=0.0)
    inlet: Inlet | None = parameter(None)
    fall_height: float | None = parameter(None, at_least=0.0)

    def __post_init__(self) -> None:
        """Check the ranges, and that grains either grow together or arrive one after the other."""
        Settling.__post_init__(self)
        if self.fill != LOOSE and self.arrive_singly:
            raise InputError(
                f"fill is {self.fill:g}, and with a fall_height or a rate of the inlet grains arrive one after the "
                "other: no column of them has a solid fraction; leave fill out, or let them grow together"
            )

    @property
    def arrive_singly(self) -> bool:
        """Whether grains arrive one after the other."""
        return self.fall_height is not None or (self.inlet is not None and self.inlet.rate is not None)


def prepare(problem: Problem) -> SettleState:
    """Return the state in which all grains are seeds.

    Raises
    ------
    InputError
        If gravity points along a periodic axis, a shape is an open surface, seeds find no place, or a grain of the
        start overlaps another or reaches beyond a wall.
    """
    gravity, how = gravity_vector(problem), settling_of(problem.parameters)
    started = reachable(problem)
    rain = rain_of(started, -gravity)

    def beginning(count: int) -> Callable[[Settling], Settler]:
        """Return what begins to settle the first grains, with those of the start before the others."""
        assembly, small = _start(started, count) if rain is None else _unplaced(started, count)
        held = 0 if rain is None else assembly.count - started.started
        assembly, small = _beside_fixed(problem, assembly, small)
        lidded = with_lid(assembly, how, gravity)
        return lambda tried: Settler(lidded, tried, gravity, seed=problem.seed, small=small, rain=rain, held=held)

    count = max((_with_room if rain is None else _as_many)(started, -gravity), started.started)
    settler: Moving
    if problem.parameters.height is not None and how.solid_fraction is None:
        settler = MetBed(
            count,
            len(started.volumes),
            begin=lambda many: beginning(many)(how),
            corrected=lambda bed: _corrected(problem, started, bed),
        )
    else:
        sought = how if count else replace(how, solid_fraction=None)
        settler = begin_settling(sought, beginning(count), lambda tried: _packing(problem, tried, ""))
    movable, total = settler.bed.assembly.movable.any(), settler.most_steps * settler.bed.assembly.count
    return SettleState(settler, total=total, stop_reason="" if movable else "count")


def _corrected(problem: Problem, started: Problem, met: MetBed) -> int:
    """Return the number of grains whose bed has its surface at the height that is asked for, by that of a bed."""
    up, unit, count = -gravity_vector(problem), problem.unit_length, met.count
    wanted = min(problem.length(problem.parameters.height), highest_surface(started, up))
    surface = surface_level(_packing(problem, met, "")) / unit
    if met.bed.count < count + problem.fixed or abs(surface - wanted) <= max(CLOSE * wanted, CLOSER):
        return count
    asked, found = (volume_at_rest(started, up, level, stream(problem.seed, "height")) for level in (wanted, surface))
    volume = np.cumsum(started.volumes)
    count = max(int(np.searchsorted(volume, volume[count - 1] * asked / found, side="right")), 1)
    return max(in_column(started, up, count, wanted, stream(problem.seed, "column")), started.started)


def settling_of(parameters: Gravity) -> Settling:
    """Return the parameters of the settling alone."""
    return with_friction(Settling(**{item.name: getattr(parameters, item.name) for item in fields(Settling)}))


def _as_many(problem: Problem, up: Floats) -> int:
    """Return how many grains there is room for, in the order in which they were drawn."""
    return int(np.searchsorted(np.cumsum(problem.volumes), _most_volume(problem, up), side="right"))


def _with_room(problem: Problem, up: Floats) -> int:
    """Return how many grains come to rest in the container, or below the height that is asked, narrow columns too."""
    return in_column(problem, up, _as_many(problem, up), _height(problem, up), stream(problem.seed, "column"))


def _unplaced(problem: Problem, n: int) -> tuple[Assembly, Floats]:
    """Return the first n grains, those of a start before all others, which will arrive one by one, and no growth."""
    m = problem.started
    centers = np.zeros((n, 3))
    centers[:m] = spheres_of_start(problem)[:, :3] + problem.container.bounds[0]
    return _assembly(problem, centers, stream(problem.seed, "seeds")), np.ones(n)


def _assembly(problem: Problem, centers: Floats, generator: np.random.Generator) -> Assembly:
    """Return the first grains at centers (n, 3), at full size, turned at random where nothing else is asked."""
    n, m = len(centers), problem.started
    turns = generator.normal(size=(n, 4))
    if problem.dimension == 2:
        turns[:, 1:3] = 0.0
    turns /= linear.norm(turns, axis=1)[:, None]
    if problem.orientation is not None:
        turns = problem.orientation[:n].copy()
    elif problem.start is not None:
        turns[:m] = problem.start.orientation
    arrays = {"position": centers, "scale": problem.diameter[:n], "shape_id": problem.shape_id[:n]}
    return Assembly.of(problem.shapes, problem.container, orientation=turns, density=problem.density, **arrays)


def _start(problem: Problem, n: int) -> tuple[Assembly, Floats]:
    """Return the first n grains at their seeds, at full size, and the factors on their sizes."""
    container, dimension = problem.container, problem.dimension
    up, settings = -gravity_vector(problem), problem.parameters
    generator = stream(problem.seed, "seeds")
    volume, spheres, m = np.cumsum(problem.volumes), spheres_of_start(problem), problem.started
    centers = spheres[:, :3] + container.bounds[0]
    base = float((linear.matmul(centers, up) + spheres[:, 3]).max(initial=-math.inf))
    if settings.inlet is not None:
        container, base = column_below(settings.inlet, problem, up, np.column_stack([centers, spheres[:, 3]]))
        # those that grow in the column together
        room = column_top(container, up, 0.0, stream(problem.seed, "inlet"), base)[1]
        volume = np.cumsum(problem.volumes[m:n]) / min(settings.fill, LOOSER * usual_solid_fraction(problem))
        n = m + int(np.searchsorted(volume, room, side="right"))
    total = float(problem.volumes[m:n].sum()) if m else float(volume[n - 1]) if n else 0.0
    fill = min(settings.fill, LOOSER * usual_solid_fraction(problem)) if n else settings.fill
    layer = float(problem.diameter[m:n].max(initial=0.0))
    top, room = column_top(container, up, total / fill, generator, base, layer=layer) if n else (0.0, container.volume)
    fill = max(fill, total / max(room, 1e-300))
    radii = RADIUS * (LOOSE / fill) ** (1.0 / dimension) * problem.diameter[m:n]
    seeds, radii = random_seeds(container, radii, up=up, top=top, generator=generator, base=base)
    assembly = _assembly(problem, np.vstack([centers, seeds]), generator)
    small = np.minimum(1.0, APART * radii / np.maximum(assembly.bounding_radii[m:], 1e-300))
    return assembly, np.concatenate([np.ones(m), small])


def _beside_fixed(problem: Problem, grains: Assembly, small: Floats) -> tuple[Assembly, Floats]:
    """Return the fixed grains of a problem at full size before others, and the factors on the sizes."""
    start, k, n = problem.start, problem.fixed, problem.fixed + grains.count
    if start is None or not k:
        return grains, small
    both = Assembly.of(
        problem.shapes,
        problem.container,
        position=np.concatenate([start.position[:k], grains.position]),
        scale=problem.diameter[:n],
        shape_id=problem.shape_id[:n],
        orientation=np.concatenate([start.orientation[:k], grains.orientation]),
        density=problem.density,
    )
    return replace(both, fixed=np.arange(n) < k), np.concatenate([np.ones(k), small])


def _most_volume(problem: Problem, up: Floats) -> float:
    """Return the largest volume of the grains: what settles in the container, or up to the height that is asked."""
    if not problem.count:
        return 0.0
    wanted, highest = _height(problem, up), highest_surface(problem, up)
    if wanted is not None and wanted > highest:
        unit = problem.unit_length
        warn(
            f"height is {wanted * unit:g}, and grains are filled to {highest * unit:.4g} only, so that the bed has "
            "room below the top of the container: ask for less, or give a higher container",
            PackingWarning,
        )
    height = highest if wanted is None else min(wanted, highest)
    return volume_at_rest(problem, up, height, stream(problem.seed, "height"))


def _height(problem: Problem, up: Floats) -> float | None:
    """Return the height that is asked, in median diameters; None where there is none.

    Raises
    ------
    InputError
        If it is above that of the container, or below the median diameter.
    """
    asked, unit = problem.parameters.height, problem.unit_length
    if asked is None:
        return None
    floor, top = container_levels(problem.container, up)
    height = problem.length(asked)
    if height > top - floor:
        raise InputError(
            f"height is {asked:g}, and the container is {(top - floor) * unit:g} high along gravity: give a height "
            "within it, or a higher container"
        )
    if height < 1.0:
        raise InputError(
            f"height is {asked:g}, and the median diameter of the grains is {unit:g}: a bed is at least as high as a "
            "grain; give a larger height, or smaller grains"
        )
    return height


def finish(problem: Problem, state: SettleState) -> Packing:
    """Return the packing of the grains."""
    settler, reason = state.settler, state.stop_reason
    if problem.target and settler.bed.count < problem.count and reason in ("settled", "steps", "count"):
        reason = "full"
    return contact_forces(_packing(problem, settler, reason), settler)


def _packing(problem: Problem, settler: Moving, reason: str) -> Packing:
    """Return the packing of the grains of a settler, without forces."""
    position, orientation = settler.bed.poses()
    n = len(position)
    packing = problem.packing(
        np.arange(n),
        position=position,
        orientation=orientation,
        stop_reason=reason,
        gravity=gravity_vector(problem),
        contact_gap=TOUCHING,
        provenance={
            "parameters": {"gravity": gravity_text(problem)},
            "settling": {"parameters": to_mapping(settler.how), **settler.report},
        },
    )
    return replace(packing, lid=lid_of(settler, problem.unit_length))


def cost(problem: Problem) -> Cost:
    """Return the cost: memory by the number of grains.

    Raises
    ------
    InputError
        If a height is asked that no bed in the container can have, or no grain has room below the inlet.
    """
    up = -gravity_vector(problem)
    _height(problem, up)
    if problem.parameters.inlet is not None:
        column_below(problem.parameters.inlet, problem, up, np.zeros((0, 4)))
    n = max(_with_room(problem, up), problem.started)
    return Cost(memory=GRAIN_BYTES * n, attempts=n, grains=n)


registration = PackingMethod(
    summary="grains grow from random seeds in a column and settle until they rest",
    source="contact dynamics: Moreau 1988, doi:10.1007/978-3-7091-2624-0_1",
    parameters=Gravity,
    prepare=prepare,
    advance=advance_settling,
    finish=finish,
    cost=cost,
    tilted=True,
    any_walls=True,
    dimensions=(2, 3),
    no_room=NO_ROOM,
    start="moved",
    obstacles="placed",
)


#: places that are tried for a grain
PLACES = 8
#: how fast the bed below rises where no rate is given, in sqrt(g d)
RISING = 0.3


def rain_of(problem: Problem, up: Floats) -> Rain | None:
    """Return how the grains of a problem arrive; None where they grow from seeds together.

    Raises
    ------
    InputError
        If there is a lid, or :func:`column_below` refuses the inlet.
    """
    settings, container, base = problem.parameters, problem.container, -math.inf
    inlet, column = settings.inlet, None
    if not settings.arrive_singly:
        return None
    if settings.lid is not None:
        raise InputError(
            "lid is given with a fall_height or a rate: grains arrive on a bed without a lid; leave it out, and settle "
            "the bed under a lid then"
        )
    lower, upper = (np.array(corner, dtype=np.float64) for corner in container.bounds)
    if inlet is not None:
        column, base = column_below(inlet, problem, up, np.zeros((0, 4)))
        lower, upper = column.bounds
    flat = np.arange(3) < problem.dimension

    def places(step: int, number: int, radius: float) -> Floats:
        points = lower + (upper - lower) * stream(problem.seed, "rain", number, step).random((4 * PLACES, 3)) * flat
        if column is not None:
            points = points[column.across(points) <= -radius]
        return points[:PLACES]

    rate = None if inlet is None else inlet.rate
    if rate is None:
        floor, top = container_levels(problem.container, up)
        solid = usual_solid_fraction(problem) * (column or container).volume / (top - floor)
        rate = RISING * solid / float(problem.volumes[problem.started :].mean())
    height = 0.0 if settings.fall_height is None else problem.length(settings.fall_height)
    return Rain(speed_of_fall(height), rate, places, base)
