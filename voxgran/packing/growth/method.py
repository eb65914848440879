"""A bed from random seeds: grains grow from them in a column, with contacts, fall, and come to rest.

Seeds lie at random in a column above the floor; each grain begins so small that none overlap and grows to its size
while its contacts hold it, so that grains of all sizes and shapes stay mixed. Then the bed settles
(:mod:`voxgran.settling.stages`).

References
----------
Moreau 1988, Unilateral contact and dry friction in finite freedom dynamics, doi:10.1007/978-3-7091-2624-0_1.
"""

from dataclasses import dataclass, fields, replace
from typing import Literal

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.config import check_bounds, parameter, to_mapping
from voxgran._base.errors import InputError
from voxgran._base.seeds import stream
from voxgran.contacts.assembly import Assembly
from voxgran.packing.gravity import gravity_text, gravity_vector
from voxgran.packing.growth.seeds import LOOSE, RADIUS, column_top, container_levels, random_seeds, volume_below
from voxgran.packing.method import Cost, PackingMethod
from voxgran.packing.model import Packing
from voxgran.packing.problem import Problem
from voxgran.packing.settling_run import GRAIN_BYTES, SettleState, advance_settling, contact_forces, lid_of, with_lid
from voxgran.settling.parameters import Settling
from voxgran.settling.stages import TOUCHING, Settler

#: share of the container that grains fill at the most: those of a bed with friction, walls included
FULLEST = 0.52
#: solid fraction by which the grains of a bed of a given height are counted: walls included, with friction and without
USUAL, FRICTIONLESS = 0.57, 0.63
#: largest size of a grain at the beginning, in sizes at which its bounding sphere is its seed
APART = 0.98


@dataclass(frozen=True, kw_only=True, slots=True)
class Gravity(Settling):
    """Parameters of beds that grow from seeds.

    Raises
    ------
    InputError
        If a number is out of its range, or gravity is ``"none"``.
    """

    gravity: Literal["-x", "+x", "-y", "+y", "-z", "+z"] | tuple[float, float, float] | None = parameter(
        None,
        doc="direction of gravity, as an axis or as a vector of any length; if omitted, '-z', and '-y' in two "
        "dimensions",
    )
    fill: float = parameter(
        LOOSE, doc="solid fraction of the column in which the grains grow; lower ones fall farther", above=0.0,
        at_most=FULLEST,
    )  # fmt: skip
    height: float | None = parameter(
        None,
        doc="height of the tops of the uppermost grains above the lowest point of the container, in units of length, "
        "to several percent: as many grains grow as fill it at the usual solid fraction; if omitted, count and "
        "solid_fraction alone decide",
        above=0.0,
    )

    def __post_init__(self) -> None:
        """Check the ranges."""
        check_bounds(self)


def prepare(problem: Problem) -> SettleState:
    """Return the state in which all grains are seeds.

    Raises
    ------
    InputError
        If gravity points along a periodic axis, a shape is an open surface, seeds find no place, or there is a start.
    """
    if problem.start is not None:
        raise InputError(
            f"start has {len(problem.start.position)} grains: method 'gravity' grows all grains from seeds; give "
            "method='digital' or 'control_point', which pack around a start"
        )
    assembly, small, gravity = _start(problem)
    how = settling_of(problem.parameters)
    settler = Settler(with_lid(assembly, how, gravity), how, gravity, seed=problem.seed, small=small)
    reason = "" if assembly.count else "count"
    return SettleState(settler, total=settler.most_steps * assembly.count, stop_reason=reason)


def settling_of(parameters: Gravity) -> Settling:
    """Return the parameters of the settling alone."""
    return Settling(**{item.name: getattr(parameters, item.name) for item in fields(Settling)})


def _start(problem: Problem) -> tuple[Assembly, Floats, Floats]:
    """Return the grains at their seeds, at full size, the factors on their sizes, and gravity."""
    container, dimension = problem.container, problem.dimension
    gravity, settings = gravity_vector(problem), problem.parameters
    up = -gravity
    generator = stream(problem.seed, "seeds")
    # as many grains, in the order in which they were drawn, as there is room for
    volume = np.cumsum(problem.volumes)
    n = int(np.searchsorted(volume, _most_volume(problem, up), side="right"))
    total = float(volume[n - 1]) if n else 0.0
    top = column_top(container, up, total / settings.fill, generator) if n else 0.0
    fill = max(settings.fill, total / container.volume)
    radii = RADIUS * (LOOSE / fill) ** (1.0 / dimension) * problem.diameter[:n]
    centers, radii = random_seeds(container, radii, up=up, top=top, generator=generator)
    turns = generator.normal(size=(n, 4))
    if dimension == 2:
        turns[:, 1:3] = 0.0
    turns /= np.linalg.norm(turns, axis=1)[:, None]
    arrays = {"position": centers, "scale": problem.diameter[:n], "shape_id": problem.shape_id[:n]}
    assembly = Assembly.of(problem.shapes, container, orientation=turns, **arrays)
    small = np.minimum(1.0, APART * radii / np.maximum(assembly.bounding_radii, 1e-300))
    return assembly, small, gravity


def _most_volume(problem: Problem, up: Floats) -> float:
    """Return the largest volume of the grains: what settles in the container, or up to the height that is asked.

    Raises
    ------
    InputError
        If the height is above that of the container.
    """
    container, settings = problem.container, problem.parameters
    most = FULLEST * container.volume
    if settings.height is None:
        return most
    floor, top = container_levels(container, up)
    height = problem.length(settings.height)
    if height > top - floor:
        raise InputError(
            f"height is {settings.height:g}, and the container is {(top - floor) * problem.unit_length:g} high along "
            "gravity: give a height within it, or a higher container"
        )
    solid_fraction = FRICTIONLESS if settings.friction == 0.0 else USUAL
    return min(most, solid_fraction * volume_below(container, up, floor + height, stream(problem.seed, "height")))


def finish(problem: Problem, state: SettleState) -> Packing:
    """Return the packing of the grains."""
    settler = state.settler
    position, orientation = settler.bed.poses()
    n = len(position)
    reason = state.stop_reason
    if problem.target and n < problem.count and reason in ("settled", "steps", "count"):
        reason = "full"
    packing = problem.packing(
        np.arange(n),
        position=position,
        orientation=orientation,
        stop_reason=reason,
        gravity=gravity_vector(problem),
        contact_gap=TOUCHING,
        provenance={
            "parameters": {"gravity": gravity_text(problem)},
            "settling": {"parameters": to_mapping(settling_of(problem.parameters)), **settler.report},
        },
    )
    return contact_forces(replace(packing, lid=lid_of(settler, problem.unit_length)), settler)


def cost(problem: Problem) -> Cost:
    """Return the cost: memory by the number of grains."""
    return Cost(memory=GRAIN_BYTES * problem.count, attempts=problem.count)


registration = PackingMethod(
    name="gravity",
    summary="grains grow from random seeds in a column and settle until they rest",
    source="contact dynamics: Moreau 1988, doi:10.1007/978-3-7091-2624-0_1",
    parameters=Gravity,
    prepare=prepare,
    advance=advance_settling,
    finish=finish,
    cost=cost,
    dimensions=(2, 3),
)
