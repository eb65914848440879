"""Type and registry of clump methods."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from voxgran._base.arrays import Floats
from voxgran._base.registry import Registry
from voxgran.voxels.model import Voxels


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """Stopping rules of a fit; it ends when one of them holds."""

    max_spheres: int  # largest number of spheres
    target: float  # intersection over union, by voxel centers
    # largest distance of voxel centers of the solid from the clump, in the unit of lengths; 0: no such rule
    tolerance: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ClumpMethod:
    """One registered clump method."""

    name: str
    summary: str  # one line
    source: str  # reference
    parameters: type  # parameter class
    fit: Callable[[Voxels, Wanted, Any], tuple[Floats, Floats]]  # function that returns centers (n, 3) and radii (n,)


def clump_registry() -> Registry[ClumpMethod]:
    """Return the registry of clump methods."""
    return Registry("clump method", "voxgran.clumps.methods", ClumpMethod, group="voxgran.clump_methods")


def clump_methods() -> tuple[str, ...]:
    """Return the names of all clump methods."""
    return clump_registry().names()
