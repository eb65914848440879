"""The friction and the shaking with which a bed comes to rest at a solid fraction, found by secants.

Beds are the denser the less their grains rub, and above that the more they are shaken. Both are one coordinate here,
the compaction: ``exp(-friction / 0.2)``, in which the solid fraction of a bed is about a straight line, up to that of
the least friction, and from there on the acceleration of the shaking. Two compactions whose beds are on both sides of
the solid fraction that is sought are brought together by the Illinois algorithm (Dowell & Jarratt 1971,
doi:10.1007/BF01934364). The next compaction depends on the tries that were made and on nothing else.

A bed of few grains is a random sample: beds of nearly the same friction differ by more than the friction explains.
Where the two compactions are so near each other that this decides, or after ten tries, compactions are tried around
the one at which a line through the last tries crosses the solid fraction.
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from voxgran._base.arrays import Floats
from voxgran.settling.materials import ROUGH, USUAL_FRICTION
from voxgran.settling.parameters import Shaking

#: difference of the solid fraction up to which the one that is sought is met
MET = 0.002
#: friction over which the solid fraction falls by a factor of e from that without friction to that of rough grains
USUAL = 0.2
#: least friction of grains that come to rest only with some
SLIPPERY = 0.05
#: strongest shaking, in gravitational accelerations, and how long grains are shaken, in sqrt(d / g): spheres that are
#: shaken for longer become hardly denser, and those that are shaken stronger begin to crystallize
STRONGEST, LASTING = 2.0, 50.0
#: most tries
MOST_TRIES = 40
#: usual increase of the solid fraction with the compaction, and by how much more than that the next one is away
SLOPE, BEYOND = 0.07, 1.3
#: difference of compactions below which chance decides, and how far around them others are tried
NARROW, AROUND = 2e-3, 0.05
#: tries from which on chance decides too, and from how many of them the next one follows then
FEW_TRIES, LAST = 10, 8
#: share of the room between two compactions that a try keeps from both
INSIDE = 0.05
#: share of an interval of which the multiples, without their whole parts, fill it evenly
GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0


@dataclass(frozen=True, slots=True)
class Search:
    """What is sought, and the tries up to now.

    how: the settling or the compression, with the solid fraction that is sought; its friction, if it has one, is that
    of all tries.  least: the least friction otherwise.  tries: (n, 3) compaction, solid fraction and 1 where the bed
    rests, else 0.  shakes: whether grains may be shaken.
    """

    how: Any
    least: float
    tries: Floats
    shakes: bool = True

    @property
    def ends(self) -> tuple[float, float, float]:
        """Compactions of the largest friction, of the least one without added shaking, and of the strongest shaking."""
        least, largest = self.range
        slippery = math.exp(-least / USUAL)
        given = self.how.shaking
        more = self.shakes and (given is None or given.acceleration < STRONGEST)
        return math.exp(-largest / USUAL), slippery, slippery + 1.0 if more else slippery

    @property
    def range(self) -> tuple[float, float]:
        """The least and the largest friction."""
        given = self.how.friction
        return (self.least, ROUGH) if given is None else (given, given)

    @property
    def misses(self) -> Floats:
        """Differences (n,) from the solid fraction that is sought, above 0 where beds are too dense."""
        assert self.how.solid_fraction is not None
        misses: Floats = self.tries[:, 1] - self.how.solid_fraction
        return misses

    @property
    def best(self) -> int:
        """Number of the best try: of the beds that rest, or else of all, the one that misses least."""
        return int(np.lexsort((np.abs(self.misses), -self.tries[:, 2]))[0])

    @property
    def met(self) -> bool:
        """Whether the solid fraction is met by a bed that rests."""
        rests = self.tries[:, 2] > 0.0
        return bool((np.abs(self.misses[rests]) <= MET).any())

    @property
    def beyond_range(self) -> bool:
        """Whether all beds are looser than what is sought, or all of them denser, up to both ends."""
        ends = [bool((self.tries[:, 0] == end).any()) for end in (self.ends[0], self.ends[2])]
        return all(ends) and (bool((self.misses < 0.0).all()) or bool((self.misses > 0.0).all()))

    @property
    def reached(self) -> tuple[int, int]:
        """Numbers of the tries that gave the loosest and the densest bed: of those that rest, or else of all."""
        rests = self.tries[:, 2] > 0.0
        those = np.flatnonzero(rests if rests.any() else ~rests)
        found = self.tries[those, 1]
        return int(those[np.argmin(found)]), int(those[np.argmax(found)])

    def settling_at(self, compaction: float) -> Any:
        """Return how the bed settles, or is compressed, at a compaction."""
        (least, largest), (_, slippery, _) = self.range, self.ends
        if compaction <= slippery:
            friction = min(-USUAL * math.log(compaction), largest)
            return replace(self.how, friction=max(least, friction))
        given = self.how.shaking
        weakest, duration = (0.0, LASTING) if given is None else (given.acceleration, given.duration)
        shaking = Shaking(weakest + (STRONGEST - weakest) * min(compaction - slippery, 1.0), duration)
        return replace(self.how, friction=least, shaking=shaking)

    def next(self) -> float | None:
        """Return the compaction of the next try, or None where the search has ended."""
        loosest, slippery, densest = self.ends
        if not len(self.tries):
            return float(np.clip(math.exp(-USUAL_FRICTION / USUAL), loosest, slippery))
        if self.met or len(self.tries) >= MOST_TRIES:
            return None
        place, misses = self.tries[:, 0], self.misses
        loose, dense = misses < 0.0, misses >= 0.0
        if loose.all():
            return self._outward(float(place.max()), float(-misses.max()), (slippery, densest), other=loosest)
        if dense.all():
            return self._outward(float(place.min()), float(-misses.min()), (loosest,), other=densest)
        low, high = self._bracket()
        # by chance the friction hardly matters: then there is nothing to be found between
        return self._between(*low, *high) if low[0] < high[0] else None

    def _outward(self, place: float, miss: float, ends: tuple[float, ...], *, other: float) -> float | None:
        """Return a compaction on the side that is not reached yet; where there is none, the other end of the range."""
        for end in ends:
            if abs(end - place) > 0.0 and (end > place) == (miss > 0.0):
                step = BEYOND * miss / SLOPE
                # the second part of the range, which differs from the first one, is known by its end
                near = abs(step) < abs(end - place) and place != self.ends[1]
                return place + step if near else end
        return None if (self.tries[:, 0] == other).any() else other

    def _bracket(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return compaction and miss of a looser and of a denser bed; the miss of one that stayed twice is halved."""
        loose = dense = (math.nan, math.nan)
        stayed = 0  # how often only the looser bed (below 0) or only the denser one was replaced at last
        for place, miss in zip(self.tries[:, 0].tolist(), self.misses.tolist(), strict=True):
            both = not math.isnan(loose[0] + dense[0])
            if both and not loose[0] < place < dense[0]:
                # chance decided already: tries around do not count
                continue
            if miss < 0.0:
                loose, stayed = (place, miss), min(stayed, 0) - 1 if both else 0
                dense = (dense[0], dense[1] / 2.0) if stayed < -1 else dense
            else:
                dense, stayed = (place, miss), max(stayed, 0) + 1 if both else 0
                loose = (loose[0], loose[1] / 2.0) if stayed > 1 else loose
        return loose, dense

    def _between(self, low: float, low_miss: float, high: float, high_miss: float) -> float:
        """Return a compaction between two with beds on both sides, or near them where chance decides."""
        loosest, _, densest = self.ends
        if high - low < NARROW or len(self.tries) >= FEW_TRIES:
            # the tries of last, as if they lay on a line of the usual slope: it crosses what is sought here
            place = float(self.tries[-LAST:, 0].mean() - self.misses[-LAST:].mean() / SLOPE)
            shift = AROUND * (math.fmod(GOLDEN * len(self.tries), 1.0) - 0.5)
            return float(np.clip(place + shift, loosest, densest))
        room = INSIDE * (high - low)
        place = low + (high - low) * low_miss / (low_miss - high_miss)
        return float(np.clip(place, low + room, high - room))
