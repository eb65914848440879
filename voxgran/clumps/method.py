"""Type and registry of clump methods."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from voxgran._base.arrays import Floats
from voxgran._base.registry import Registry
from voxgran.voxels.model import Voxels


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """Stopping rules of a fit; it ends when one of them holds.

    Attributes
    ----------
    max_spheres : int
        Number of spheres that is not exceeded.
    target : float
        Intersection over union, by voxel centers, that is reached.
    tolerance : float
        Distance from the clump, in the unit of lengths, within which all voxel centers of the solid lie; 0 disables
        the rule.
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
        Name, summary in one line, and reference.
    parameters : type
        Parameter class.
    fit : callable
        Function of voxels, stopping rules and parameters that returns centers (n, 3) and radii (n,).
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
