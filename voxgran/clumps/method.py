"""Type and registry of clump methods."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from voxgran._base.arrays import Floats
from voxgran._base.calls import explained
from voxgran._base.registry import Registry
from voxgran.clumps.body import Body


class Fitted(NamedTuple):
    """Spheres that a method returns, in the frame and unit of the body."""

    centers: Floats  # (n, 3)
    radii: Floats  # (n,)
    #: why there are fewer than asked, as half a sentence such as "the spheres cover every voxel"; "" if there are not
    reason: str = ""
    #: radii before they were changed so that the union has the volume of the solid; None where they were not
    unmatched: Floats | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ClumpMethod:
    """One registered clump method.

    `fit` takes the body, the number of spheres asked, the parameters and the seed. It returns at most that number.
    """

    name: str = ""  # that of the file or entry point
    summary: str  # one line
    source: str  # reference
    parameters: type  # parameter class
    fit: Callable[[Body, int, Any, int], Fitted]


def clump_registry() -> Registry[ClumpMethod]:
    """Return the registry of clump methods."""
    return Registry("clump method", "voxgran.clumps.methods", ClumpMethod, group="voxgran.clump_methods")


@explained(hint="clump_methods()")
def clump_methods() -> tuple[str, ...]:
    """Return the names of all clump methods.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.clump_methods()
    ('cluster', 'dynamic', 'four_point', 'inner_normal', 'inscribed', 'optimal')
    """
    return clump_registry().names()
