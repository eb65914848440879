"""Packing method ``cubic``: grains on the sites of a simple cubic lattice, each in a random orientation."""

from dataclasses import dataclass

import numpy as np

from voxgran._base.config import check_bounds, parameter
from voxgran._base.seeds import stream
from voxgran.geometry.rotation import random_rotations
from voxgran.packing.method import Cost, PackingMethod, State


@dataclass(frozen=True, kw_only=True, slots=True)
class Cubic:
    """Parameters of the cubic lattice.

    Parameters
    ----------
    gap
        least distance of bounding spheres, in diameters of the largest.
    """

    gap: float = parameter(0.0, at_least=0.0)

    def __post_init__(self):
        check_bounds(self)


def sites_of(problem):
    """Return the sites at which the largest grain touches no wall, (m, 3), in median diameters."""
    radius = np.array([shape.bounding_radius for shape in problem.shapes])[problem.shape_id] * problem.diameter
    edge = 2.0 * radius.max(initial=0.5) * (1.0 + problem.parameters.gap)
    lower, upper = problem.container.bounds
    number = np.maximum(((upper - lower) / edge).astype(int), 1)
    sites = lower + (np.indices(number).reshape(3, -1).T + 0.5) * (upper - lower) / number
    return sites[problem.container.signed_distance(sites) <= -edge / 2]


def prepare(problem):
    """Return the state before the first attempt: one grain on each site, in a random order."""
    order = stream(problem.seed, "order").permutation(problem.count)
    return State({"order": order}, {}, total=problem.count, stop_reason="" if problem.count else "count")


def advance(problem, state, attempts):
    """Make so many attempts; each places one grain, as long as there are sites, which follow from the problem."""
    if "sites" not in state.derived:
        state.derived["sites"] = sites_of(problem)
    most = min(state.total, len(state.derived["sites"]))
    state.done = min(state.done + attempts, most)
    if attempts and state.done == most:
        state.stop_reason = "count" if most == state.total else "full"
    return state


def finish(problem, state):
    """Return the packing of the grains that have a site."""
    placed = state.arrays["order"][: state.done]
    turns = random_rotations(stream(problem.seed, "turns"), problem.count)[placed]
    sites = sites_of(problem)[: state.done]
    return problem.packing(placed, position=sites, orientation=turns, stop_reason=state.stop_reason)


registration = PackingMethod(
    name="cubic",
    summary="grains on the sites of a simple cubic lattice",
    source="",
    parameters=Cubic,
    prepare=prepare,
    advance=advance,
    finish=finish,
    cost=lambda problem: Cost(memory=10**6 + 200 * problem.count, attempts=problem.count),
    libraries=(),
    any_container=True,
)
