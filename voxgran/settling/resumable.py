"""Work on a bed that may stop between any two steps, or within one, and goes on with the same bits."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from voxgran.settling.bed import Bed


class Resumable:
    """Work of which all that a step depends on is in a bed and in a dataclass of its progress.

    Fields of the progress that are whole numbers are counters, all others are arrays or floats. One of them is
    ``exact``: whether contacts of meshes that are not convex come from their triangles.
    """

    bed: Bed
    progress: Any

    @property
    def arrays(self) -> dict[str, Any]:
        """All arrays and floats that the next step depends on."""
        return {
            **self.bed.arrays,
            **{name: np.asarray(getattr(self.progress, name)) for name in self._names(whole=False)},
        }

    @property
    def counters(self) -> dict[str, int]:
        """All counters that the next step depends on."""
        return {name: getattr(self.progress, name) for name in self._names(whole=True)}

    def restore(self, arrays: Mapping[str, Any], counters: Mapping[str, Any]) -> None:
        """Take over arrays and counters."""
        own = self._names(whole=False)
        for name in own:
            value = np.array(arrays[name])
            setattr(self.progress, name, value if value.ndim else float(value))
        for name in self._names(whole=True):
            setattr(self.progress, name, int(counters[name]))
        self.bed.finders.exact = bool(self.progress.exact)
        self.bed.restore({name: array for name, array in arrays.items() if name not in own})

    def kept(self) -> tuple[dict[str, Any], dict[str, int]]:
        """Return copies of all arrays and counters."""
        return {name: np.array(array) for name, array in self.arrays.items()}, self.counters

    def _names(self, *, whole: bool) -> tuple[str, ...]:
        """Return the names of the counters, or of the other fields."""
        return tuple(item.name for item in fields(self.progress) if (item.type is int) == whole)
