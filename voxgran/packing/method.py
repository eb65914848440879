"""What a packing method is: three functions over plain arrays, and the registry that finds them.

A method never sees checkpoints, signals, clocks or progress; :mod:`voxgran.packing.driver` does these for all.
Therefore its state is arrays and counters and nothing else (:class:`State`, or a dataclass whose fields are these,
:class:`TypedState`), and what attempt number k does depends on the state and k alone, so that results do not depend on
how many attempts are computed in one call. A call with none makes what follows from the problem and changes nothing.
Where an attempt may take more than half a second the method calls :func:`voxgran._base.stopping.stop_if_asked` in
between, with arrays and counters as after the last attempt.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from voxgran._base.registry import Registry
from voxgran.packing.model import Packing
from voxgran.packing.problem import Problem

Array: TypeAlias = NDArray[Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """What a run takes, known before anything is made.

    Attributes
    ----------
    memory : int
        Bytes at the peak, without the libraries; an estimate.
    attempts : int
        Attempts at the most.
    voxelized_shapes, sampled_shapes : int
        How many solids are turned into voxels and into points: exactly what the run counts.
    """

    memory: int
    attempts: int
    voxelized_shapes: int = 0
    sampled_shapes: int = 0


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
    """Where a run stands, with arrays and counters by name.

    Attributes
    ----------
    arrays : dict of str to ndarray
        All that changes and must survive a kill; a checkpoint holds these.
    counters : dict of str to int
        Attempts, acceptances and what else the method counts; a checkpoint holds these.
    done, total : int
        Attempts made, and attempts after which the method stops at the latest.
    stop_reason : str
        Empty while there is more to do.
    derived : dict of str to ndarray
        What follows from the problem and the rest and is made again when it is missing; never saved.
    """

    arrays: dict[str, Array]
    counters: dict[str, int]
    done: int = 0
    total: int = 0
    stop_reason: str = ""
    derived: dict[str, Any] = field(default_factory=dict)

    def restore(self, arrays: dict[str, Array], counters: dict[str, Any]) -> None:
        """Take over the arrays and counters of a checkpoint."""
        self.arrays, self.counters = arrays, counters


@dataclass(slots=True, kw_only=True)
class TypedState:
    """Where a run stands, with typed fields, from which its arrays and counters derive.

    The fields that a subclass adds are arrays, floats, integers, or None for a number that is not known yet. A
    checkpoint holds arrays and floats as arrays, and the rest as counters.

    Attributes
    ----------
    done, total : int
        Attempts made, and attempts after which the method stops at the latest.
    stop_reason : str
        Empty while there is more to do.
    derived : dict of str to object
        What follows from the problem and the rest and is made again when it is missing; never saved.
    """

    done: int = 0
    total: int = 0
    stop_reason: str = ""
    derived: dict[str, Any] = field(default_factory=dict)

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
        Name, one line, and the paper with its DOI.
    parameters : type
        Parameter class; it alone yields TOML keys, flags, help and provenance.
    prepare : callable
        Problem to the first State.
    advance : callable
        Problem, State and a number of attempts to the State after at most as many.
    finish : callable
        Problem and State to the Packing.
    cost : callable
        Problem to its Cost, before anything is made, without numba, Open3D or VTK.
    dimensions : tuple of int
        In which dimensions it works.
    tolerance : float
        Largest overlap of true shapes that the method may leave, in mean diameters; 0 where it leaves none.
    libraries : tuple of str
        Libraries that it loads.
    selects : bool
        Whether it takes grains as candidates, of which there may be more than the container has room for.
    open_surfaces : bool
        Whether it packs open surfaces, which have no inside.
    any_container : bool
        Whether it packs into any object with the attributes of a :class:`Container`, by its signed distance; otherwise
        into those of voxgran.
    """

    name: str
    summary: str
    source: str
    parameters: type
    prepare: Callable[[Problem], RunState]
    advance: Callable[[Problem, Any, int], RunState]
    finish: Callable[[Problem, Any], Packing]
    cost: Callable[[Problem], Cost]
    dimensions: tuple[int, ...] = (3,)
    tolerance: Callable[[Any], float] = field(default=lambda parameters: 0.0)
    libraries: tuple[str, ...] = ("numba",)
    selects: bool = False
    open_surfaces: bool = False
    any_container: bool = False


def method_registry() -> Registry[PackingMethod]:
    """Return the registry of packing methods."""
    return Registry("packing method", "voxgran.packing.methods", PackingMethod, group="voxgran.packing_methods")


def packing_methods() -> tuple[str, ...]:
    """Return the names of all packing methods."""
    return method_registry().names()
