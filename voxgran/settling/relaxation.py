"""What relaxing a packing in an engine has changed."""

from dataclasses import dataclass, fields
from typing import Any


@dataclass(frozen=True, kw_only=True, slots=True)
class Relaxation:
    """How far a packing was from rest in an engine.

    Attributes
    ----------
    engine : str
        Name of the engine.
    sinking : float
        Mean displacement along gravity of the grains of the bulk, of all grains where there is no bulk, in median
        diameters; 0 without gravity.
    largest_displacement, mean_displacement : float
        Largest and mean displacement of a grain, in median diameters; in a cell under a stress relative to its strain.
    coordination_before, coordination_after : float
        Mean number of neighbours at the start and at the end, at the same gap.
    duration : float
        Time that passed in the engine, in sqrt(d / g) with the median diameter d, or under a stress s in
        sqrt(m / (s d)).
    """

    engine: str
    sinking: float
    largest_displacement: float
    coordination_before: float
    coordination_after: float
    duration: float
    mean_displacement: float = 0.0

    def to_mapping(self) -> dict[str, Any]:
        """Return the attributes by name."""
        return {field.name: getattr(self, field.name) for field in fields(self)}
