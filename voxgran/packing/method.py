"""Packing methods: three functions over plain arrays, their cost, and the registry of methods.

Checkpoints, signals, clocks and progress are handled by :mod:`voxgran.packing.driver` for all methods. The state of a
method is therefore arrays and counters only (:class:`State`, or a dataclass whose fields are these,
:class:`TypedState`), and attempt number k depends on the state and k alone, so that results do not depend on the number
of attempts per call. A call with 0 attempts computes the derived data and changes nothing else. If an attempt may take
more than half a second, the method calls :func:`voxgran._base.stopping.stop_if_asked` in between, with arrays and
counters as after the last attempt.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Literal, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from voxgran._base.calls import explained
from voxgran._base.checkpoint import Declared, Held, Rule, check_held
from voxgran._base.errors import InputError, LongRunWarning, TooLargeError, shown, warn
from voxgran._base.machine import memory_limit
from voxgran._base.registry import Registry
from voxgran.containers.model import UNKNOWN, Container, boundary_of, refuse_tilt
from voxgran.packing.model import Packing
from voxgran.packing.problem import Problem
from voxgran.shapes.model import Shape

Array: TypeAlias = NDArray[Any]

#: the file of each method, which holds its registration
METHODS = {
    "advancing_front": "advancing_front.method",
    "apollonian": "space_filling.apollonian",
    "compress": "jamming.compress",
    "control_point": "control_point.method",
    "deposition": "deposition.method",
    "digital": "digital.walk_method",
    "digital_fill": "digital.fill_method",
    "digital_rsa": "digital.rsa_method",
    "expand": "jamming.expand",
    "gravity": "beds.method",
    "growth": "space_filling.growth",
    "jam": "jamming.jam",
    "multilayer": "jamming.multilayer",
    "random_apollonian": "space_filling.random_apollonian",
    "rsa": "rsa.method",
    "tetrahedral": "tessellation.method",
    "voronoi_fill": "tessellation.voronoi_method",
}
#: share of the width of a container by which rounding may put a center beyond it
ROUND_OFF = 1e-9
#: bytes of the interpreter and the libraries during packing (measured)
PACKING_BYTES = 120 * 2**20
#: what a warning says of a method that has no room for all grains
NO_ROOM = "no grain finds room any more; ask for less, or take smaller grains, a larger container or a denser packing"
NO_ROOM_ON_LATTICE = (
    "no grain finds room between voxels any more; give a smaller voxel_size, ask for less, or take smaller grains or a "
    "larger container"
)
#: expected seconds from which on a run with default voxels says before it starts that it takes long
LONG_RUN = 30.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """Cost of a run, known before it starts.

    Examples
    --------
    >>> from voxgran.packing.method import Cost
    >>> Cost(memory=10**6, attempts=100)
    Cost(memory=1000000, attempts=100, voxelized_shapes=0, sampled_shapes=0, seconds=0.0, grains=None)
    """

    memory: int  # estimated bytes at the peak, without the libraries
    attempts: int  # largest number of attempts
    # number of solids that are voxelized and sampled: exactly what the run counts
    voxelized_shapes: int = 0
    sampled_shapes: int = 0
    # expected CPU time on a usual core; 0 where it is not known
    seconds: float = 0.0
    # grains that are expected to have room, of which the method takes no more; None where it tries all that are drawn
    grains: int | None = None


class RunState(Protocol):
    """What the driver needs of the state of a run: see :class:`State`."""

    done: int
    total: int
    stop_reason: str
    derived: dict[str, Any]

    @property
    def arrays(self) -> Mapping[str, Array]:
        """Arrays that a checkpoint holds."""

    @property
    def counters(self) -> Mapping[str, int | None]:
        """Counters that a checkpoint holds."""

    def restore(self, arrays: dict[str, Array], counters: dict[str, Any]) -> None:
        """Take over the arrays and counters of a checkpoint."""


@dataclass(slots=True)
class State:
    """State of a run, with arrays and counters by name, which a checkpoint holds.

    done, total: attempts made, and largest number of attempts.  stop_reason: empty while the method has not stopped.
    derived: data that follow from the problem and the other fields; computed again when missing, never saved.
    declared, rule: what a checkpoint may hold, beyond arrays as they are in a new state and finite values.

    Examples
    --------
    >>> import numpy as np
    >>> from voxgran.packing.method import State
    >>> state = State({"order": np.arange(5)}, {"placed": 0}, 0, 5)
    >>> state.done, state.total
    (0, 5)
    """

    arrays: dict[str, Array]
    counters: dict[str, int]
    done: int = 0
    total: int = 0
    stop_reason: str = ""
    derived: dict[str, Any] = field(default_factory=dict)
    declared: Declared = field(default_factory=dict)
    rule: Rule | None = None

    def restore(self, arrays: dict[str, Array], counters: dict[str, Any]) -> None:
        """Take over the arrays and counters of a checkpoint."""
        check_held((self.arrays, self.counters), arrays, counters, self.declared, self.rule)
        self.arrays, self.counters = arrays, counters

    def end_if(self, *, placed: bool, full: bool) -> None:
        """Note why the run ends, if it does: all grains are placed, no more have room, or all attempts are made."""
        reasons = {"count": placed, "full": full, "steps": self.done >= self.total}
        self.stop_reason = self.stop_reason or next((reason for reason, holds in reasons.items() if holds), "")
        if self.stop_reason:
            self.derived.clear()


def spheres_within(problem: Problem, rows: str = "") -> Held:
    """Return what a checkpoint may hold of spheres, (n, 4): centers from the lower corner of the container, and radii.

    rows: as in :class:`voxgran._base.checkpoint.Held`.
    """
    wide = np.ptp(problem.container.bounds, axis=0)
    slack = ROUND_OFF * float(wide.max())
    return Held([-slack, -slack, -slack, 0.0], [*(wide + slack), float(wide.max())], rows)


@dataclass(slots=True, kw_only=True)
class TypedState:
    """State of a run with typed fields, from which its arrays and counters derive; the other fields are those of
    `State`.

    The fields that a subclass adds are arrays, floats, integers, or None for a number that is not known yet. A
    checkpoint holds arrays and floats as arrays, and the rest as counters.
    """

    done: int = 0
    total: int = 0
    stop_reason: str = ""
    derived: dict[str, Any] = field(default_factory=dict)
    declared: Declared = field(default_factory=dict)
    rule: Rule | None = None

    @property
    def arrays(self) -> dict[str, Array]:
        """Arrays and floats, which a checkpoint holds."""
        return {name: np.asarray(value) for name, value in self._added() if isinstance(value, np.ndarray | float)}

    @property
    def counters(self) -> dict[str, int | None]:
        """Integers, which a checkpoint holds."""
        return {name: value for name, value in self._added() if not isinstance(value, np.ndarray | float)}

    def restore(self, arrays: dict[str, Array], counters: dict[str, Any]) -> None:
        """Take over the arrays and counters of a checkpoint."""
        check_held((self.arrays, self.counters), arrays, counters, self.declared, self.rule)
        for name, array in arrays.items():
            setattr(self, name, array if array.ndim else float(array))
        for name, count in counters.items():
            setattr(self, name, count)

    def _added(self) -> list[tuple[str, Any]]:
        """Return names and values of the fields that a subclass adds."""
        base = {entry.name for entry in fields(TypedState)}
        return [(entry.name, getattr(self, entry.name)) for entry in fields(self) if entry.name not in base]


@dataclass(frozen=True, slots=True, kw_only=True)
class PackingMethod:
    """One registered packing method.

    Attributes
    ----------
    name, summary, source : str
        Name (from the table of methods, or of the entry point), one line, and the paper with its DOI.
    parameters : type
        Parameter class; it defines TOML keys, flags, help and provenance.
    prepare : callable
        Problem to the initial State.
    advance : callable
        Problem, State and a number of attempts to the State after at most as many.
    finish : callable
        Problem and State to the Packing.
    cost : callable
        Problem to its Cost, without packing and without numba, Open3D or VTK.
    dimensions : tuple of int
        Supported dimensions.
    libraries : tuple of str
        Libraries that it loads.
    selects : bool
        Whether grains are candidates, of which there may be more than fit into the container.
    open_surfaces : bool
        Whether it packs open surfaces.
    any_container : bool
        Whether it packs into any object with the attributes of a :class:`Container`, by its signed distance; other
        methods need the boundary in closed form.
    any_walls : bool
        Whether it knows any walls in closed form, such as cones or several round walls.
    tilted : bool
        Whether it packs into tilted periodic containers.
    stretches : bool
        Whether the container is stretched so that any count of grains has room.
    builds_bed : bool
        Whether it builds beds under gravity, which settle afterwards unless told otherwise.
    sizing : {"drawn", "scaled", "made"}
        How the sizes of the grains come about: as drawn; by a common factor on the drawn ones, which meets the solid
        fraction exactly, also together with a count; or by the method, which then takes no size distribution.
    keeps_sizes : bool
        Whether a method that scales sizes keeps those of a count, so that it places the grains of a list.
    start : {"refused", "placed", "moved", "scaled"}
        What it makes of the grains of a start, which come first in the result: it refuses them; leaves them in place,
        on a lattice as near as voxels have room; moves them as it moves all grains, and keeps their sizes; or
        multiplies the sizes of all grains by one factor.
    no_start : str
        What the message says of a method that refuses a start: why.
    obstacles : {"refused", "placed", "apart"}
        How it packs around fixed grains: not at all; as the first grains of the start, which it leaves in place; or as
        a part of the container, which :func:`voxgran.packing.obstacles.around_obstacles` makes of them.
    no_obstacles : str
        What the message says of a method that does not pack around fixed grains: why.
    no_room : str
        What a warning says where the method stops since no other grain has room: why, and what helps.

    Examples
    --------
    >>> from voxgran.packing.method import method_registry
    >>> method_registry().get("rsa").summary
    'random sequential addition of spheres and true shapes: schemes of Chu 2011, or to proven saturation'
    """

    name: str = ""
    summary: str
    source: str
    parameters: type
    prepare: Callable[[Problem], RunState]
    advance: Callable[[Problem, Any, int], RunState]
    finish: Callable[[Problem, Any], Packing]
    cost: Callable[[Problem], Cost]
    dimensions: tuple[int, ...] = (3,)
    libraries: tuple[str, ...] = ("numba",)
    selects: bool = False
    open_surfaces: bool = False
    any_container: bool = False
    any_walls: bool = False
    tilted: bool = False
    stretches: bool = False
    builds_bed: bool = False
    sizing: Literal["drawn", "scaled", "made"] = "drawn"
    keeps_sizes: bool = False
    start: Literal["refused", "placed", "moved", "scaled"] = "refused"
    no_start: str = "begins with an empty container"
    obstacles: Literal["refused", "placed", "apart"] = "refused"
    no_obstacles: str = "has no place for them"
    no_room: str = NO_ROOM


def method_registry() -> Registry[PackingMethod]:
    """Return the registry of packing methods."""
    return Registry("packing method", "voxgran.packing", PackingMethod, group="voxgran.packing_methods", files=METHODS)


@explained(hint="packing_methods()")
def packing_methods() -> tuple[str, ...]:
    """Return the names of all packing methods.

    Examples
    --------
    >>> import voxgran as vg
    >>> "rsa" in vg.packing_methods()
    True
    """
    return method_registry().names()


def packing_memory(cost: Cost) -> int:
    """Return the estimated peak memory of a packing of a cost in bytes, with the libraries."""
    return PACKING_BYTES + cost.memory


def refuse_unfit(method: PackingMethod, shapes: tuple[Shape, ...], container: Container) -> None:
    """Refuse what the method does not pack: shapes and containers of another dimension or kind, open surfaces.

    Raises
    ------
    InputError
        If it does not pack one of them.
    """
    for shape in shapes:
        if shape.dimension != container.dimension:
            raise InputError(
                f"shape {shape.name!r} has dimension {shape.dimension}: the container has {container.dimension}; "
                "use shapes and container of one dimension"
            )
        if not method.open_surfaces:
            shape.refuse_open(f"grains of method {method.name!r}")
    if container.dimension not in method.dimensions:
        raise InputError(
            f"method {method.name!r} packs in dimension {method.dimensions}: the container has {container.dimension}; "
            "choose another method"
        )
    if not method.tilted:
        registry = method_registry()
        able = ", ".join(name for name in registry.names() if registry.get(name).tilted)
        refuse_tilt(container, f"method {method.name!r}", f"leave the tilt out, or choose another method, of {able}")
    walls = boundary_of(container)
    if not method.any_container and (walls is UNKNOWN or not (walls.is_usual or method.any_walls)):
        known = (
            "known by its signed distance only" if walls is UNKNOWN else "with tilted, conical or several round walls"
        )
        remedy = "make a mesh of it, ClosedMesh(Shape.from_mesh(*container.mesh()))"
        raise InputError(
            f"container is of type {type(container).__name__}, {known}, which method {method.name!r} does not take; "
            f"{remedy if container.dimension == 3 else 'use a Rectangle, Disk or Polygon'}, or choose a digital method"
        )


def refuse_begun(method: PackingMethod, start: Packing) -> None:
    """Refuse a start with grains where the method begins with none.

    Raises
    ------
    InputError
        If it is so.
    """
    many = int(start.movable.sum())
    if method.start == "refused" and many:
        registry = method_registry()
        others = [name for name in registry.names() if registry.get(name).start != "refused"]
        raise InputError(
            f"start has {many} grains, and method {method.name!r} {method.no_start}: leave start out, or give a "
            f"method that begins with grains, one of {', '.join(others)}"
        )


def refuse_list(method: PackingMethod, beside: Mapping[str, Any]) -> None:
    """Refuse a list of grains where the method does not place grains as they are, or where something beside it says
    how many grains there are or how large.

    Raises
    ------
    InputError
        If it is so.
    """
    if method.sizing != "drawn" and not method.keeps_sizes:
        registry = method_registry()
        others = [one for one in map(registry.get, registry.names()) if one.sizing == "drawn" or one.keeps_sizes]
        raise InputError(
            f"grains is given, and method {method.name!r} makes the sizes of grains or scales them: give a method that "
            f"places grains as they are, one of {', '.join(other.name for other in others)}"
        )
    for name, value in beside.items():
        if value is not None:
            raise InputError(
                f"grains is given, and {name} is {shown(value)}: a list says how many grains there are and how large; "
                f"leave {name} out"
            )


def check_cost(method: PackingMethod, problem: Problem) -> None:
    """Check that this machine has the memory of a packing, and warn of a run that takes long.

    Raises
    ------
    InputError
        If the lattice of the method does not fit the container.
    TooLargeError
        If the machine has less memory, or the lattice has more voxels than the method can hold.

    Warns
    -----
    LongRunWarning
        If the packing is expected to take more than half a minute by its defaults.
    """
    cost = method.cost(problem)
    check_memory(method, packing_memory(cost), "the packing")
    if text := long_run(method, problem, cost.seconds):
        warn(text, LongRunWarning)


def long_run(method: PackingMethod, problem: Problem, seconds: float) -> str:
    """Return that a packing takes long, though no voxel size is given, and what shortens it; empty if it does not."""
    settings = problem.parameters
    if seconds <= LONG_RUN or getattr(settings, "voxel_size", None) is not None:
        return ""
    remedy = "a lower solid fraction, fewer or larger grains, or shapes of fewer faces"
    if hasattr(settings, "sweeps"):
        remedy = "fewer sweeps, a higher rate or fewer grains"
    elif hasattr(settings, "voxel_size"):
        remedy = "larger voxels (voxel_size), fewer orientations, turned=False, fewer different sizes or fewer grains"
    return f"method {method.name!r} is expected to take about {math.ceil(seconds / 60)} min: {remedy} take less"


def check_memory(method: PackingMethod, needed: int, what: str) -> None:
    """Check that this machine has the bytes that `what` needs.

    Raises
    ------
    TooLargeError
        If the machine has less.
    """
    available = memory_limit()
    if needed > available:
        coarser = "the voxels larger or " if hasattr(method.parameters, "voxel_size") else ""
        raise TooLargeError(
            f"{what} needs about {needed / 2**30:.1f} GiB: this machine has {available / 2**30:.1f} GiB; make "
            f"{coarser}the grains fewer"
        )
