"""What a clump method is, and the registry that finds them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from voxgran._base.arrays import Floats
from voxgran._base.registry import Registry
from voxgran.voxels.model import Voxels


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """When a fit stops.

    Attributes
    ----------
    max_spheres : int
        At so many spheres.
    target : float
        When the volume of the intersection over that of the union, by voxel centers, is as large.
    tolerance : float
        When no voxel center of the solid is farther from the clump, in the unit of lengths; 0: not looked at.
    """

    max_spheres: int
    target: float
    tolerance: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ClumpMethod:
    """One registered clump method.

    Attributes
    ----------
    name, summary, source : str
        Name, one line, and where it comes from.
    parameters : type
        Parameter class.
    fit : callable
        Voxels, what is wanted, and parameters to centers and radii.
    """

    name: str
    summary: str
    source: str
    parameters: type
    fit: Callable[[Voxels, Wanted, Any], tuple[Floats, Floats]]


def clump_registry() -> Registry[ClumpMethod]:
    """Return the registry of clump methods."""
    return Registry("clump method", "voxgran.clumps.methods", ClumpMethod, group="voxgran.clump_methods")


def clump_methods() -> tuple[str, ...]:
    """Return the names of all clump methods."""
    return clump_registry().names()
