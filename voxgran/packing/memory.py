"""Whether a packing fits in memory, known before anything is allocated."""

from voxgran._base.errors import TooLargeError
from voxgran._base.machine import memory_limit
from voxgran.packing.method import PackingMethod
from voxgran.packing.problem import Problem

#: bytes that the interpreter and the libraries take while a method packs (measured)
PACKING_BYTES = 120 * 2**20
#: what Open3D adds where a method samples surfaces (measured)
SAMPLING_BYTES = 310 * 2**20


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
