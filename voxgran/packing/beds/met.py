"""Beds of a height that is asked for: made again with another number of grains where their surface is elsewhere.

How many grains fill a height is estimated from their form (:mod:`voxgran.packing.beds.filling`). A bed whose surface is
elsewhere at the end tells it better: the next bed begins with the grains of the same draw, fewer or more of them, and
with the same random numbers. A :class:`MetBed` takes the place of the :class:`Settler` in a run: its state is that of
the present bed, the number of its grains, and how many beds were made before.
"""

from collections.abc import Callable, Mapping
from typing import Any

from voxgran._base.checkpoint import Declared, Held
from voxgran._base.errors import CheckpointError
from voxgran.settling.progress import COUNTS
from voxgran.settling.stages import Settler

#: how often a bed is made at the most
MOST_BEDS = 3


class MetBed:
    """Settles beds until one has its surface at the height that is asked for.

    Parameters
    ----------
    count, most : int
        Number of grains of the first bed, and of those that were drawn.
    begin : callable
        Number of grains to a Settler of them.
    corrected : callable
        This bed, of which the present one has ended, to the number of grains that meets the height.
    """

    def __init__(
        self, count: int, most: int, begin: Callable[[int], Settler], corrected: Callable[["MetBed"], int]
    ) -> None:
        self._most, self._begin, self._corrected = most, begin, corrected
        self.count, self.beds, self.former_steps = count, 1, 0
        self.settler = begin(count)

    def __getattr__(self, name: str) -> Any:
        if name == "settler":
            raise AttributeError(name)
        return getattr(self.settler, name)

    @property
    def told(self) -> str:
        """What the grains are doing, in words."""
        return self.settler.told if self.beds == 1 else f"bed {self.beds}, {self.settler.told}"

    @property
    def most_steps(self) -> int:
        """Largest number of steps up to the end of the present bed."""
        return self.former_steps + self.settler.most_steps

    @property
    def counters(self) -> dict[str, int]:
        """All counters that the next step depends on."""
        own = {"count": self.count, "beds": self.beds, "former_steps": self.former_steps}
        return {**{f"met_{name}": value for name, value in own.items()}, **self.settler.counters}

    @property
    def declared(self) -> Declared:
        """What a checkpoint may hold."""
        own = {"count": Held(self.count, self.count), "beds": Held(1, MOST_BEDS), "former_steps": COUNTS}
        return {**self.settler.declared, **{f"met_{name}": held for name, held in own.items()}}

    def step(self) -> None:
        """Make the next step; where a bed has ended that misses the height, begin the next one."""
        self.settler.step()
        if not self.settler.ended or self.beds == MOST_BEDS:
            return
        count = self._corrected(self)
        if count != self.count:
            self.former_steps += self.settler.progress.step
            self.count, self.beds = count, self.beds + 1
            self.settler = self._begin(count)

    def begin_as(self, counters: Mapping[str, Any]) -> None:
        """Begin the bed of a checkpoint, which may have another number of grains.

        Raises
        ------
        CheckpointError
            If it has more grains than were drawn.
        """
        count = counters.get("met_count")
        if not isinstance(count, int) or not 0 <= count <= self._most:
            raise CheckpointError(
                f"the checkpoint has a bed of {count!r} grains and {self._most} were drawn: start anew without it"
            )
        if count != self.count:
            self.count, self.settler = count, self._begin(count)

    def restore(self, arrays: Mapping[str, Any], counters: Mapping[str, Any]) -> None:
        """Take over arrays and counters of a bed with this number of grains."""
        counters = {name: count for name, count in counters.items() if name != "met_count"}
        self.beds, self.former_steps = (int(counters.pop(f"met_{name}")) for name in ("beds", "former_steps"))
        self.settler.restore(arrays, counters)
