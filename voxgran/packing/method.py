"""What a packing method is: three functions over plain arrays, and the registry that finds them.

A method never sees checkpoints, signals, clocks or progress; :mod:`voxgran.packing.driver` does these for all.
Therefore its state is arrays and counters and nothing else, and what attempt number k does depends on the state and k
alone, so that results do not depend on how many attempts are computed in one call. A call with none makes what follows
from the problem and changes nothing. Where an attempt may take more than half a second the method calls
:func:`voxgran._base.stopping.stop_if_asked` in between, with arrays and counters as after the last attempt.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from numpy.typing import NDArray

from voxgran._base.errors import TooLargeError
from voxgran._base.machine import memory_limit
from voxgran._base.registry import Registry
from voxgran.packing.model import Packing
from voxgran.packing.problem import Problem

Array: TypeAlias = NDArray[Any]

#: bytes that the interpreter and the libraries take while a method packs (measured)
PACKING_BYTES = 120 * 2**20
#: what Open3D adds where a method samples surfaces (measured)
SAMPLING_BYTES = 310 * 2**20


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


@dataclass(slots=True)
class State:
    """Where a run stands.

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
    prepare: Callable[[Problem], State]
    advance: Callable[[Problem, State, int], State]
    finish: Callable[[Problem, State], Packing]
    cost: Callable[[Problem], Cost]
    dimensions: tuple[int, ...] = (3,)
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


def packing_memory(method: PackingMethod, problem: Problem) -> int:
    """Return how many bytes a packing takes at the peak, with the libraries; an estimate.

    Parameters
    ----------
    method : PackingMethod
        The method.
    problem : Problem
        What it is to pack.

    Raises
    ------
    InputError
        If the lattice of the method does not fit the container.
    TooLargeError
        If the lattice has more voxels than the method can hold.
    """
    sampling = SAMPLING_BYTES if "open3d" in method.libraries else 0
    return PACKING_BYTES + sampling + method.cost(problem).memory


def check_memory(method: PackingMethod, needed: int, what: str) -> None:
    """Check that this machine has as much memory as is needed.

    Parameters
    ----------
    method : PackingMethod
        The method, for what helps.
    needed : int
        Bytes.
    what : str
        What needs them, as the message names it.

    Raises
    ------
    TooLargeError
        If it has less.
    """
    available = memory_limit()
    if needed > available:
        coarser = "the voxels larger or " if hasattr(method.parameters, "voxel_size") else ""
        raise TooLargeError(
            f"{what} needs about {needed / 2**30:.1f} GiB: this machine has {available / 2**30:.1f} GiB; make "
            f"{coarser}the grains fewer"
        )
