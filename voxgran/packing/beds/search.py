"""Beds of a solid fraction that is asked for: tries from one state, with the friction and the shaking of a search.

Every try begins with the same grains at the same places and with the same random numbers, so that friction and shaking
alone decide (:mod:`voxgran.settling.search` says which come next). A :class:`SoughtBed` takes the place of the
:class:`Settler` in a run: its state is that of the present try, the table of all tries, and the best bed up to now.

The solid fraction is that of the bulk, away from walls and surface, where the first bed has enough grains there;
otherwise that of the container below the height that holds 85 % of the volume of the grains. Both are measures of
:mod:`voxgran.measures.registered.density`.
"""

import math
import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, cast

import numpy as np

from voxgran._base.checkpoint import Declared, Held
from voxgran._base.config import to_mapping
from voxgran.packing.model import Packing
from voxgran.settling.bed import Bed
from voxgran.settling.progress import COUNTS
from voxgran.settling.search import MET, MOST_TRIES, SLIPPERY, Search

#: grains of the bulk from which on its solid fraction counts: a half more than it must hold to be measured
ENOUGH = 75
#: what the solid fraction is measured in, by how much that is known
REGIONS = ("bed_solid_fraction", "bulk_solid_fraction", "solid_fraction")
#: the place of the whole container there
WHOLE = 2
#: prefix of what a checkpoint holds of the best bed
PREFIX = "tried_"


class SoughtBed:
    """Settles grains again and again until their bed has the solid fraction that is sought.

    Parameters
    ----------
    how : Settling or Compression
        Parameters, with a solid fraction.
    begin : callable
        Parameters to a Settler or a Compressor of the grains as they are at first.
    packing_of : callable
        Settler or Compressor to the packing of its grains.
    shakes : bool
        Whether grains may be shaken.
    whole : bool
        Whether the solid fraction is that of the container.
    """

    def __init__(
        self,
        how: Any,
        begin: Callable[[Any], Any],
        packing_of: Callable[[Any], Packing],
        *,
        shakes: bool = True,
        whole: bool = False,
    ) -> None:
        self._begin, self._packing_of = begin, packing_of
        self.settler = begin(how)
        self.search = Search(how, 0.0 if self.settler.slides else SLIPPERY, np.zeros((0, 3)), shakes)
        self.by_bulk, self.former_steps, self._over = WHOLE if whole else -1, 0, False
        # arrays and counters of the best bed
        self._best: tuple[dict[str, Any], dict[str, int]] = {}, {}
        self._place = math.nan
        self._start_next()

    @property
    def reason(self) -> str:
        """Stop reason of the present try, at the end of the best one."""
        return str(self.settler.reason)

    @property
    def told(self) -> str:
        """How far the present try is, in words."""
        return f"try {min(len(self.search.tries) + 1, MOST_TRIES)}, {self.settler.told}"

    @property
    def unit(self) -> float:
        """Unit of the forces of a compression."""
        return float(self.settler.unit)

    @property
    def how(self) -> Any:
        """Parameters of the present try, at the end of the best one."""
        return self.settler.how

    @property
    def bed(self) -> Bed:
        """Bed of the present try, at the end of the best one."""
        return cast(Bed, self.settler.bed)

    @property
    def progress(self) -> Any:
        """How far the present try is."""
        return self.settler.progress

    @property
    def ended(self) -> bool:
        """Whether the search has ended."""
        return self._over

    @property
    def most_steps(self) -> int:
        """Largest number of steps up to the end of the present try."""
        return self.former_steps + (0 if self._over else self.settler.most_steps)

    @property
    def report(self) -> dict[str, Any]:
        """How the bed was left, and what was found under the name ``sought``."""
        return {**self.settler.report, "sought": self._sought()} if len(self.search.tries) else self.settler.report

    @property
    def arrays(self) -> dict[str, Any]:
        """All arrays and floats that the next step depends on."""
        best = {PREFIX + name: array for name, array in self._best[0].items()}
        return {"tries": self.search.tries, "place": np.asarray(self._place), **self.settler.arrays, **best}

    @property
    def counters(self) -> dict[str, int]:
        """All counters that the next step depends on; the number of tries comes first."""
        own = {"made": len(self.search.tries), "former_steps": self.former_steps}
        own |= {"by_bulk": self.by_bulk, "over": int(self._over)}
        return {**own, **self.settler.counters, **{PREFIX + name: count for name, count in self._best[1].items()}}

    def step(self) -> None:
        """Make the next step of the present try; when it has ended, measure its bed and begin the next one."""
        if not self.settler.ended:
            self.settler.step()
        if self.settler.ended:
            self._judge()

    @property
    def declared(self) -> Declared:
        """What a checkpoint may hold: of the best bed all that it holds of the present one."""
        settler, one = self.settler, self.settler.declared
        best = {
            PREFIX + name: replace(held, rows=held.rows and PREFIX + held.rows, like=settler.arrays.get(name))
            for name, held in {**dict.fromkeys((*settler.arrays, *settler.counters), Held()), **one}.items()
        }
        own = {"tries": Held(rows="tries"), "place": Held(-1e6, 1e6), "made": COUNTS, "former_steps": COUNTS}
        return {**one, **best, **own, "by_bulk": Held(-1, WHOLE), "over": Held(0, 1)}

    def rule(self, arrays: Mapping[str, Any], counters: Mapping[str, Any]) -> bool:
        """Return whether what a checkpoint holds goes together: of the best bed all, or nothing before there is one."""
        best = {name.removeprefix(PREFIX): arrays[name] for name in arrays if name.startswith(PREFIX)}
        known = {name.removeprefix(PREFIX) for name in counters if name.startswith(PREFIX)}
        whole = best.keys() == self.settler.arrays.keys() and known == self.settler.counters.keys()
        none = not best and not known and not len(arrays["tries"])
        return (none or (whole and self.settler.rule(best, counters))) and self.settler.rule(arrays, counters)

    def restore(self, arrays: Mapping[str, Any], counters: Mapping[str, Any]) -> None:
        """Take over arrays and counters."""
        arrays, counters = dict(arrays), dict(counters)
        self.search = replace(self.search, tries=np.array(arrays.pop("tries")))
        self._place = float(arrays.pop("place"))
        self.former_steps, self.by_bulk = int(counters["former_steps"]), int(counters["by_bulk"])
        self._over = bool(counters["over"])
        best = [{name: held.pop(name) for name in list(held) if name.startswith(PREFIX)} for held in (arrays, counters)]
        self._best = tuple({name.removeprefix(PREFIX): part[name] for name in part} for part in best)  # type: ignore[assignment]
        self.settler = self._begin(self.search.settling_at(self._place))
        self.settler.restore(arrays, counters)

    def _judge(self) -> None:
        """Measure the bed of a try that has ended, keep it if it is the best one, and begin the next try."""
        settler = self.settler
        fraction = self._fraction()
        row = [self._place, fraction, float(settler.progress.proven)]
        search = self.search = replace(self.search, tries=np.vstack([self.search.tries, row]))
        if search.best == len(search.tries) - 1:
            held = {name: np.array(array) for name, array in settler.arrays.items()}
            self._best = held, dict(settler.counters)
        self.former_steps += settler.progress.step
        self._start_next()

    def _start_next(self) -> None:
        """Begin the next try, or go back to the best one."""
        search = self.search
        place = search.next()
        if place is not None:
            self._place = place
            self.settler = self._begin(search.settling_at(place))
            return
        self._over, best = True, search.best
        if best != len(search.tries) - 1:
            self._place = float(search.tries[best, 0])
            self.settler = self._begin(search.settling_at(self._place))
            self.settler.restore(*self._best)
        self._best = {}, {}

    def _fraction(self) -> float:
        """Return the solid fraction of the bed of the present try."""
        if self.by_bulk == WHOLE:
            return self._packing_of(self.settler).solid_fraction
        with warnings.catch_warnings(action="ignore"):
            found = self._packing_of(self.settler).measure("density")
        if self.by_bulk < 0:
            # without gravity there is no surface, and the bed fills its container
            other = 0 if "bed_solid_fraction" in found else WHOLE
            self.by_bulk = 1 if float(found["bulk_count"]) >= ENOUGH else other
        bulk = float(found["bulk_solid_fraction"])
        below = found["bed_solid_fraction" if "bed_solid_fraction" in found else "solid_fraction"]
        return bulk if self.by_bulk and math.isfinite(bulk) else float(below)

    def _sought(self) -> dict[str, Any]:
        """Return what was sought and found."""
        search = self.search
        best = search.best
        loosest, densest = (_point(search, number) for number in search.reached)
        return {
            "solid_fraction": search.how.solid_fraction,
            "measure": REGIONS[self.by_bulk],
            **_point(search, best),
            "met": search.met,
            "tolerance": MET,
            "tries": len(search.tries),
            "beyond_range": search.beyond_range,
            "loosest": loosest,
            "densest": densest,
        }


def _point(search: Search, number: int) -> dict[str, Any]:
    """Return the solid fraction that a try reached, its friction, and its shaking or None."""
    place, fraction, _ = search.tries[number].tolist()
    how = search.settling_at(place)
    shaking = None if how.shaking is None else to_mapping(how.shaking)
    return {"reached": fraction, "friction": how.friction, "shaking": shaking}


def sentence_of(sought: Mapping[str, Any], what: str = "the bed", reach: str = "come to rest at") -> str:
    """Return the sentence that says by how much a solid fraction was missed, and what can be reached."""
    asked, reached = sought["solid_fraction"], sought["reached"]
    head = f"the solid fraction of {what} is {reached:.4g} instead of {asked:.4g}: "
    if not sought["beyond_range"]:
        return (
            f"{head}the nearest of {sought['tries']} tries, which differ by chance; take more grains, or another seed"
        )
    low, high = (f"{sought[name]['reached']:.4g} ({_in_words(sought[name])})" for name in ("loosest", "densest"))
    return f"{head}these grains {reach} {low} to {high}; ask for one between, or take other sizes or shapes"


def _in_words(point: Mapping[str, Any]) -> str:
    """Return in words how a bed came to rest."""
    shaking = point["shaking"]
    text = f"friction {point['friction']:.3g}"
    return text if shaking is None else f"{text}, shaking {shaking['acceleration']:.3g}"
