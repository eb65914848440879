"""What ``expand`` and ``jam`` share: first points, a compressor, its steps as a run, and the packing at the end.

A compressor brings overlapping grains of given relative sizes to a solid fraction, or to where they jam. There is one
for spheres and disks (:mod:`voxgran.packing.jamming.spheres`) and one for true shapes
(:mod:`voxgran.packing.jamming.solids`). The methods drive either in steps, between which a run may be stopped, kept and
resumed.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Floats
from voxgran._base.checkpoint import Declared, Rule, check_held
from voxgran._base.config import parameter, parameter_class
from voxgran._base.seeds import stream
from voxgran._base.stopping import stop_if_asked
from voxgran.contacts.assembly import Assembly
from voxgran.contacts.inside import Occupied
from voxgran.containers.gravity import Down
from voxgran.packing.jamming.expected import reachable
from voxgran.packing.jamming.solids import GrowingSolids
from voxgran.packing.jamming.spheres import SoftSpheres
from voxgran.packing.method import Array, Cost
from voxgran.packing.model import Packing
from voxgran.packing.problem import Problem, random_points, turns_of


class Compressor(Protocol):
    """Grains that are relaxed at growing sizes until they meet their sizes or jam.

    A class that keeps this is made as ``X(assembly, *, jam, seed)``, with parameters of its own after these. The grains
    of the assembly have their final sizes where `jam` is false, and sizes up to a common factor where it is true; they
    may overlap each other and the walls.
    With ``jam=False`` the grains are to stand free of overlap at the factor 1, or at the largest factor that was found;
    with ``jam=True`` at the largest factor without overlap, the jamming point.

    Attributes
    ----------
    assembly : Assembly
        The grains as they were given.
    ended : bool
        Whether there is no step left.
    done_steps, most_steps : int
        Steps made, and the largest number of steps.
    arrays : mapping of str to ndarray
        Arrays of which the state consists, as a checkpoint holds them.
    counters : mapping of str to int
        Whole numbers of which the state consists.
    factor : float
        Common factor on the sizes of the assembly at which the grains overlap neither each other nor a wall; it is
        final once the run has ended.
    report : dict of str to any
        What a user may want to know of the run, for the provenance.
    """

    assembly: Assembly
    most_steps: int

    @property
    def ended(self) -> bool:
        """Whether there is no step left."""

    @property
    def done_steps(self) -> int:
        """Steps made."""

    @property
    def arrays(self) -> Mapping[str, NDArray[Any]]:
        """Arrays of the state."""

    @property
    def counters(self) -> Mapping[str, int]:
        """Whole numbers of the state."""

    @property
    def factor(self) -> float:
        """Common factor on the sizes of the assembly."""

    @property
    def report(self) -> dict[str, Any]:
        """Numbers for the provenance."""

    def step(self) -> None:
        """Make one step, of at most about 0.3 s.

        Raises
        ------
        Stopped
            If the run is asked to stop; the state is then that before the step.
        """

    @property
    def declared(self) -> Declared:
        """What a checkpoint may hold."""

    @property
    def rule(self) -> Rule | None:
        """Return whether what a checkpoint holds goes together."""

    def restore(self, arrays: Mapping[str, NDArray[Any]], counters: Mapping[str, int]) -> None:
        """Take over the state of a checkpoint."""

    def poses(self) -> tuple[Floats, Floats]:
        """Return positions (n, 3) and unit quaternions (n, 4) of the grains."""


#: bytes of a grain (measured), and estimate of the largest number of steps
GRAIN_BYTES, STEPS = 700, 400


@parameter_class
class GrowthRate:
    """Parameters of grains that grow.

    Parameters
    ----------
    growth_rate
        of all shapes but spheres and disks, and of these around fixed grains: relative growth of the sizes in the time
        in which a grain moves by its diameter at thermal speed; the smaller, the denser and more ordered the grains
        jam, the longer it takes.
    """

    growth_rate: float = parameter(0.01, at_least=1e-4, at_most=1.0)


@dataclass(slots=True)
class CompressState:
    """State of a run: see :class:`voxgran.packing.method.State`. Arrays and counters are those of the compressor."""

    compressor: Compressor
    done: int = 0
    total: int = 0
    stop_reason: str = ""
    derived: dict[str, Any] = field(default_factory=dict)

    @property
    def arrays(self) -> Mapping[str, Array]:
        """Arrays that a checkpoint holds."""
        return self.compressor.arrays

    @property
    def counters(self) -> Mapping[str, int]:
        """Counters that a checkpoint holds."""
        return self.compressor.counters

    def restore(self, arrays: dict[str, Array], counters: dict[str, Any]) -> None:
        """Take over the arrays and counters of a checkpoint."""
        compressor = self.compressor
        check_held((compressor.arrays, compressor.counters), arrays, counters, compressor.declared, compressor.rule)
        compressor.restore(arrays, counters)


def first_state(problem: Problem, *, jam: bool) -> CompressState:
    """Return the state in which all grains are at random points, those of a start at their own.

    Raises
    ------
    InputError
        If a shape is an open surface.
    """
    rate = problem.parameters.growth_rate
    compressor = compressor_of(problem, first_assembly(problem), jam=jam, growth_rate=rate)
    reason = "count" if compressor.ended else ""
    return CompressState(compressor, total=compressor.most_steps, stop_reason=reason)


def first_assembly(problem: Problem) -> Assembly:
    """Return the grains at random points, those of a start at their own.

    Where neither a count nor a solid fraction is asked for and there is no start, these are as many of the drawn grains
    as the container is expected to hold.
    """
    return grains_at_random(problem, _with_room(problem))


def _with_room(problem: Problem) -> int:
    """Return how many grains there are: a count, or as many as are expected to have room."""
    if problem.target or problem.start is not None or not problem.count:
        return problem.count
    return as_many(problem, reachable(problem.diameter, problem.dimension) * problem.container.volume)


def as_many(problem: Problem, room: float) -> int:
    """Return how many grains have at most a volume together, in the order in which they were drawn, at least one."""
    return max(1, int(np.searchsorted(np.cumsum(problem.volumes), room, side="right")))


def grains_at_random(problem: Problem, n: int) -> Assembly:
    """Return the first n grains at random points and turned at random, those of a start at their own places."""
    generator = stream(problem.seed, "points")
    position = random_points(problem.container, n - problem.started, generator)
    turns = turns_of(problem, n, generator)
    if all(shape.is_sphere for shape in problem.shapes):
        turns[problem.started :] = [1.0, 0.0, 0.0, 0.0]
    if problem.start is not None:
        position = np.vstack([problem.start.wrapped(problem.container), position])
    scale, shape_id = problem.diameter[:n], problem.shape_id[:n]
    return Assembly.of(
        problem.shapes, problem.container, position=position, scale=scale, shape_id=shape_id, orientation=turns
    )


def compressor_of(problem: Problem, assembly: Assembly, *, jam: bool, growth_rate: float) -> Compressor:
    """Return the compressor of the grains, which grow at a rate where they, or fixed ones, are not all spheres.

    Where there are fixed ones, all are taken as true shapes.

    Raises
    ------
    InputError
        If a shape is an open surface, or no sphere where the walls of the container are not known.
    """
    if all(shape.is_sphere for shape in problem.shapes) and not isinstance(assembly.container, Occupied):
        return SoftSpheres(assembly, jam=jam, seed=problem.seed)
    return GrowingSolids(assembly, jam=jam, seed=problem.seed, growth_rate=growth_rate)


def advance(problem: Problem, state: CompressState, attempts: int) -> CompressState:
    """Make up to `attempts` steps."""
    if state.stop_reason:
        return state
    if "ready" not in state.derived:
        state.compressor.restore(state.compressor.arrays, state.compressor.counters)
        state.derived["ready"] = True
    last = state.done + attempts
    while state.done < last and not state.compressor.ended:
        stop_if_asked()
        state.compressor.step()
        state.done += 1
    if state.compressor.ended:
        state.stop_reason = _reason(problem, state.compressor)
    return state


def _reason(problem: Problem, compressor: Compressor) -> str:
    """Return why a run has ended."""
    if compressor.factor == 1.0 and problem.asked_fraction is not None:
        return "solid_fraction"
    met = problem.asked_fraction is None and (problem.asked_count is not None or problem.start is not None)
    return "count" if met else "full"


def packing_of_run(
    problem: Problem, state: CompressState, factor: float, *, stretch: float = 1.0, gravity: Down | None = None
) -> Packing:
    """Return the packing of a run, with a factor on the drawn sizes and another on all places and gaps."""
    compressor = state.compressor
    position, orientation = compressor.poses()
    n, report = len(position), compressor.report
    return problem.packing(
        np.arange(n),
        position=position * stretch,
        orientation=orientation,
        diameter=problem.diameter[:n] * factor,
        stop_reason=state.stop_reason,
        contact_gap=report.get("contact_gap", 0.0) * stretch,
        provenance={"compression": {"factor": compressor.factor, "isostatic": 2 * problem.dimension, **report}},
        gravity=gravity,
    )


def cost(problem: Problem) -> Cost:
    """Return the cost: memory by the number of grains, and the largest number of steps as an estimate."""
    return cost_of(_with_room(problem))


def cost_of(grains: int) -> Cost:
    """Return the cost of a number of grains."""
    return Cost(memory=GRAIN_BYTES * grains + 2**22, attempts=STEPS if grains else 0, grains=grains)
