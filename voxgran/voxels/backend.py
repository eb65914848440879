"""What a voxelization backend is, and the registry that finds them."""

from collections.abc import Callable
from dataclasses import dataclass

from voxgran._base.arrays import Floats, Integers
from voxgran._base.registry import Registry
from voxgran.lattice.grid import Grid
from voxgran.lattice.packed import PackedMask


@dataclass(frozen=True, slots=True, kw_only=True)
class Backend:
    """One registered backend.

    Attributes
    ----------
    name, summary : str
        Name and one line.
    occupy : callable
        Vertices, faces and grid to the voxels whose center lies inside; it may err within `band`.
    band : float
        Distance from the surface, relative to the size of the body, within which it may err by round-off; 0 where it
        has a rule of its own for centers on the surface that lets touching solids share no voxel.
    """

    name: str
    summary: str
    occupy: Callable[[Floats, Integers, Grid], PackedMask]
    band: float


def backend_registry() -> Registry[Backend]:
    """Return the registry of backends."""
    return Registry("voxelization backend", "voxgran.voxels.backends", Backend, group="voxgran.voxel_backends")


def backends() -> tuple[str, ...]:
    """Return the names of all backends."""
    return backend_registry().names()
