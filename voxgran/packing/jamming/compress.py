"""Specimens: grains at random in a loose state, which are compressed to a mean stress, without gravity.

The container has the form of the specimen, and about its size where no count is given. It is stretched first, along the
axes of the compression, so that the grains lie in it loosely; they grow there at random points, as those of ``expand``,
and are compressed then (:mod:`voxgran.settling.compression`).

References
----------
Agnolin & Roux 2007, doi:10.1103/PhysRevE.76.061302: packings that are compressed from a loose state
"""

from dataclasses import fields, replace

import numpy as np

from voxgran._base.config import parameter, parameter_class
from voxgran._base.errors import PackingWarning, warn
from voxgran._base.seeds import stream
from voxgran.contacts.walls import least_lengths, pushed_inside
from voxgran.containers.stretch import stretched
from voxgran.packing.beds.filling import AT_WALLS, mean_diameter, usual_solid_fraction
from voxgran.packing.beds.seeds import points_inside
from voxgran.packing.compress import begun_compression, finished_compression
from voxgran.packing.jamming.method import CompressState, advance, as_many, compressor_of, cost_of, grains_at_random
from voxgran.packing.method import PackingMethod
from voxgran.packing.model import Packing
from voxgran.packing.problem import Problem
from voxgran.packing.settling_run import followed
from voxgran.packing.start import Start
from voxgran.settling.parameters import Compression

#: solid fraction in which grains begin, by dimension
LOOSE = {2: 0.5, 3: 0.3}
#: how much longer a container is at first than fixed grains are, in the largest diameter of the others
AROUND_FIXED = 3.0
#: growth rate of grains that are no spheres, which jam at larger solid fractions only
GROWTH_RATE = 0.1


@parameter_class
class Compress(Compression):
    """Parameters of specimens.

    Parameters
    ----------
    fill
        solid fraction in which the grains begin, below that of the specimen; if omitted, 0.3, and 0.5 in two
        dimensions.

    Raises
    ------
    InputError
        If a number is out of its range, or the axes are none.

    Examples
    --------
    >>> import voxgran as vg
    >>> cube = vg.Box((4, 4, 4), periodic="xyz")
    >>> specimen = vg.pack(vg.shapes.sphere(), cube, vg.methods.Compress(friction=0.3))
    >>> specimen.stop_reason
    'compressed'
    """

    fill: float | None = parameter(None, above=0.0, at_most=0.5)


def prepare(problem: Problem) -> CompressState:
    """Return the state in which the grains are at random points of the stretched container, around fixed ones.

    Raises
    ------
    InputError
        If a shape is an open surface, or no wall of the container moves as it is asked for.
    """
    problem.parameters.refuse_known_friction()
    loose = _loose(problem).apart
    grains = grains_at_random(loose, _many(problem.apart))
    compressor = compressor_of(loose, grains, jam=False, growth_rate=GROWTH_RATE)
    return CompressState(compressor, total=compressor.most_steps, stop_reason="count" if compressor.ended else "")


def _many(problem: Problem) -> int:
    """Return how many grains there are: a count, or as many as have room in the container once they are compressed."""
    if problem.target or not problem.count:
        return problem.count
    container, settings = problem.container, problem.parameters
    points = points_inside(container, stream(problem.seed, "room"))
    away = float((np.asarray(container.signed_distance(points)) < -AT_WALLS * mean_diameter(problem)).mean())
    room = usual_solid_fraction(problem) * container.volume * away
    if settings.solid_fraction is not None:
        room = settings.solid_fraction * container.volume * (away if settings.region == "bulk" else 1.0)
    if settings.height is not None:
        room *= problem.length(settings.height) / float(np.ptp(container.bounds, axis=0)[container.dimension - 1])
    return as_many(problem, room)


def _loose(problem: Problem) -> Problem:
    """Return the task in the container stretched along the axes of the compression, in which its grains lie loosely.

    Fixed grains are where this moves them as points of the container, and where the compression takes them back from.

    Raises
    ------
    InputError
        If no wall of the container moves as it is asked for.
    """
    container, settings, start, free = problem.container, problem.parameters, problem.start, problem.apart
    moves = np.diag(settings.modes_of(container))[:3] > 0.0
    volume, fixed = float(free.volumes[: _many(free)].sum()), container.volume - free.container.volume
    larger = (volume / (settings.fill or LOOSE[container.dimension]) + fixed) / container.volume
    factor = larger ** (1.0 / int(moves.sum())) if volume > 0.0 else 1.0
    factors, k = np.where(moves, factor, 1.0), problem.fixed
    if start is None or not k:
        return replace(problem, container=stretched(container, factors.tolist()))
    standing = problem.start_assembly(Start(start.position[:k], start.orientation[:k]))
    least = least_lengths(standing) + AROUND_FIXED * float(problem.diameter[k:].max(initial=0.0))
    factors[moves] = max(factor, float((least[moves] / np.ptp(container.bounds, axis=0)[moves]).max()))
    container = stretched(container, factors.tolist())
    moved = replace(standing, position=standing.position * factors, container=container)
    return replace(problem, container=container, start=Start(pushed_inside(moved), start.orientation))


def grow(problem: Problem, state: CompressState, attempts: int) -> CompressState:
    """Let the grains grow; where they do not reach their sizes, a warning says so."""
    before, state = state.stop_reason, advance(problem, state, attempts)
    if not before and state.stop_reason and (factor := state.compressor.factor) < 1.0:
        warn(
            f"the grains have {factor:.4g} times the sizes that were drawn, since they have no more room where they "
            "begin: give a smaller fill, smaller grains, or a larger container",
            PackingWarning,
        )
    return state


def finish(problem: Problem, state: CompressState) -> Packing:
    """Return the packing of the grains before they are compressed."""
    compressor, loose = state.compressor, _loose(problem)
    position, orientation = compressor.poses()
    n = len(position)
    packing = loose.apart.packing(
        np.arange(n),
        position=position,
        orientation=orientation,
        diameter=loose.apart.diameter[:n] * compressor.factor,
        stop_reason=state.stop_reason,
    )
    return loose.beside_fixed(packing)


registration = followed(
    PackingMethod(
        summary="grains at random are compressed to a mean stress, and balance it",
        source="Agnolin & Roux 2007, doi:10.1103/PhysRevE.76.061302",
        parameters=Compress,
        prepare=prepare,
        advance=grow,
        finish=finish,
        cost=lambda problem: cost_of(_many(problem.apart)),
        tilted=True,
        dimensions=(2, 3),
        stretches=True,
        no_start="places all grains at random (vg.compress compresses a packing)",
        obstacles="placed",
        any_walls=True,
    ),
    lambda problem, packed: begun_compression(packed, compression_of(problem.parameters)),
    finished_compression,
)


def compression_of(parameters: Compress) -> Compression:
    """Return the parameters of the compression alone."""
    return Compression(**{item.name: getattr(parameters, item.name) for item in fields(Compression)})
