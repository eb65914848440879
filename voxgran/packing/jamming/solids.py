"""Grains of any shape that grow until they meet their sizes or jam: parted at first, then in motion, then parted again.

Grains begin small at random points. In each step their sizes grow by a common factor, and the least translations and
rotations, weighted by mass, that open all overlaps to first order are made until no surfaces overlap, by the contacts
of settling (:mod:`voxgran.settling.parting`). Where that does not succeed, the grains go back to where they were and
the step becomes shorter. They are jammed where the step is as short as the last one. A sequence of linear problems of
this kind with inequalities leads spheres to strictly jammed states (Torquato & Jiao 2010); here they are projections.

Least motions alone jam grains with faces at once, in loose states. Between the solid fraction at which grains meet each
other everywhere and the one at which hardly any growth is left, they therefore grow while they move at random
(:mod:`voxgran.packing.jamming.thermal`).

Contacts of meshes that are not convex come from grids of distances, which are wrong by some thousandths of a diameter
and do not see edges that cross. A step has succeeded when their triangles are proven to be separate, too
(:mod:`voxgran.settling.parting`).

References
----------
Torquato & Jiao 2010, Robust algorithm to generate a diverse class of dense disordered and ordered sphere packings via
linear programming, Physical Review E 82, 061302, doi:10.1103/PhysRevE.82.061302.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Floats
from voxgran._base.checkpoint import MOST as MOST_ATTEMPTS
from voxgran._base.checkpoint import Declared, Held
from voxgran._base.seeds import stream
from voxgran._base.stopping import Stopped, stop_if_asked
from voxgran.contacts.assembly import Assembly
from voxgran.contacts.inside import Occupied
from voxgran.contacts.manifolds.rows import SURFACE
from voxgran.contacts.verify import verify
from voxgran.packing.jamming.coordination import NearPairs
from voxgran.packing.jamming.thermal import FIRST_FREE, Motion, stop_moving, thermal_step
from voxgran.settling.bed import Bed
from voxgran.settling.parting import close_round, part_grains
from voxgran.settling.progress import bed_fits, declared_of

#: solid fraction whose sizes are the unit in which grains grow, by dimension, and the one at which they begin
DENSE, FIRST = {2: 0.85, 3: 0.65}, 0.05
#: solid fraction up to which grains are only parted, by dimension
LOOSE = {2: 0.6, 3: 0.4}
#: what a compressor does: part the grains of growing sizes while they are loose, let them move at random, and part them
#: until they jam
LOOSENING, MOVING, JAMMING = range(3)
#: distance that surfaces keep at least in thermal motion
APART = 1e-3
#: steps of thermal motion in a step of a run, and free growth at which it ends
AT_ONCE, CLOSED = 20, 0.01
#: reduction of the sizes of grains that overlap at random points, until they can be parted
SMALLER = 0.8
#: growth of the first step after thermal motion; grains that cannot be parted there are reduced by this share, then by
#: twice as much, and so on up to the largest share
CAREFUL, LARGEST = 2e-3, 0.1
#: growth of a step after one that succeeded at once, and after one that did not succeed
FASTER, SLOWER = 1.5, 0.5
#: rounds of parting in a step of a run, steps for one size, and the share of the overlap that must go in each
ROUNDS, LONGEST, LESS = 8, 6, 0.8
#: sweeps of a round in the first step for a size
SWEEPS = 60
#: share of the kept distance that may be missed, and gap beyond it up to which contacts are looked at
MISSED, MARGIN = 0.5, 0.03
#: farthest that a grain moves in a round, in median diameters
MOST = 0.05
#: steps for one size in which meshes are parted by grids of distances only
ROOMS = 2
#: distance that is kept by triangles, farthest motion in a round, and gap beyond it
BY_TRIANGLES = (3e-4, 2e-3, 5e-3)
#: largest number of steps in which grains are parted, and of those of thermal motion, times the rate of growth
MOST_STEPS, MOST_MOTION = 1000, 14.0
#: most verifications at the end, and the factor by which the distance that surfaces keep grows between them
LOOKS, FARTHER = 6, 4.0
#: gaps, in mean diameters, at which coordination numbers are reported
GAPS = (1e-4, 1e-3, 1e-2, 1e-1)
#: gap up to which jammed grains touch, in median diameters
CONTACT = 1e-3
#: number of forces without friction that hold a grain rigidly, on average, by dimension: twice its ways to move
ISOSTATIC = {2: 6, 3: 12}
#: largest size in a checkpoint, of that at which grains are dense
LARGEST_SIZE = 100.0
#: numbers of the state
SIZE, STEP, TRIED, DEPTH, FREE, SUBSTEP = range(6)


@dataclass(frozen=True, slots=True)
class GrowthPreset:
    """Numbers by which grains grow; lengths are in median diameters of about the final size."""

    kept: float  # distance that surfaces keep
    first: float  # longest relative growth of a step
    last: float  # growth of a step at which grains count as jammed


#: of grains whose contacts are exact, and of those with contacts by grids of distances
TRUE, FIELDS = GrowthPreset(1e-5, 0.02, 1e-4), GrowthPreset(2e-3, 0.01, 5e-4)


class GrowingSolids:
    """Compressor of grains of any shape: see :class:`voxgran.packing.jamming.method.Compressor`.

    Raises
    ------
    InputError
        If a shape is an open surface, or the walls of the container are not known.
    """

    def __init__(self, assembly: Assembly, *, jam: bool, seed: int, growth_rate: float) -> None:
        self.assembly, self.jam, self.dimension = assembly, jam, assembly.dimension
        self.seed, self.growth_rate = seed, growth_rate
        self.stage, self.moves = LOOSENING, 0
        n = assembly.count
        most = MOST_STEPS + math.ceil(MOST_MOTION / (growth_rate * AT_ONCE))
        self.ended, self.done_steps, self.most_steps = n == 0, 0, most if n else 0
        self.jams, self.met, self.turns = False, False, 0
        self.unit = 1.0
        if not n:
            return
        # sizes at which the grains would be dense, and the median one of these as the unit
        filled = float(assembly.volumes.sum()) / assembly.container.volume
        self.dense = (DENSE[self.dimension] / filled) ** (1.0 / self.dimension)
        self.unit = float(np.median(assembly.diameters)) * self.dense
        down = np.eye(3)[self.dimension - 1] * -1.0
        self.bed = Bed(self._scaled(), down, lid_weight=math.inf)
        self.uneven = SURFACE in self.bed.grains.kind
        self.wanted = math.inf if jam else 1.0 / self.dense
        first = min((FIRST / DENSE[self.dimension]) ** (1.0 / self.dimension), self.wanted)
        if self.uneven:
            first = self._part_hulls(first)
        # the size that succeeded last, 0 before one did; growth; the size that is tried; overlap before
        # growth that is left, and the length of a substep, of thermal motion
        self.numbers = np.array([0.0, self._preset.first, first, math.inf, FIRST_FREE, 0.0])
        self._keep()
        self._resize(self.bed, first)

    def _scaled(self) -> Assembly:
        """Return the grains at their dense sizes, and fixed ones after them, in the unit in which they grow."""
        given, room = self.assembly, self.assembly.container.scaled(1.0 / self.unit)
        arrays = (given.shapes, given.shape_id, given.scale * self.dense / self.unit, given.position / self.unit)
        grains = Assembly(*arrays, given.orientation, room)
        return room.filled(grains) if isinstance(room, Occupied) else grains

    @staticmethod
    def _resize(bed: Bed, size: float) -> None:
        """Give the grains a size; those that are fixed keep theirs."""
        bed.resize(np.where(bed.movable, size, 1.0))

    def _part_hulls(self, size: float) -> float:
        """Part the convex hulls at a size, or at a smaller one, which is returned.

        Grids of distances do not part a mesh from another one that it is deep within.
        """
        hulls = Bed(self._scaled(), self.bed.gravity, lid_weight=math.inf, hulls=True)
        while True:
            self._resize(hulls, size)
            if part_grains(hulls, FIELDS.kept, LONGEST * ROUNDS, missed=MISSED, most=MOST, margin=MARGIN) > 0.0:
                break
            size *= SMALLER
        self.bed.put(hulls.grains.position, hulls.orientation, math.inf)
        return size

    @property
    def _loose(self) -> float:
        """Size up to which the grains are only parted."""
        return float((LOOSE[self.dimension] / DENSE[self.dimension]) ** (1.0 / self.dimension))

    @property
    def _preset(self) -> GrowthPreset:
        """How the grains grow."""
        return FIELDS if self.uneven else TRUE

    @property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """Arrays of the state."""
        if not self.assembly.count:
            return {}
        own = {"numbers": self.numbers, "good_position": self.good_position, "good_turns": self.good_orientation}
        return {**self.bed.arrays, **own}

    @property
    def counters(self) -> dict[str, int]:
        """Whole numbers of the state."""
        return {
            "steps": self.done_steps,
            "turns": self.turns,
            "stage": self.stage,
            "moves": self.moves,
            "ended": int(self.ended),
            "jammed": int(self.jams),
            "met": int(self.met),
        }

    @property
    def declared(self) -> Declared:
        """What a checkpoint may hold."""
        counts = {"stage": Held(0, JAMMING), "turns": Held(0, 2 * LONGEST)}
        counts |= dict.fromkeys(("steps", "moves"), Held(0, MOST_ATTEMPTS))
        own = {"numbers": Held(0.0, math.inf), **dict.fromkeys(("good_position", "good_turns"), Held(rows="grains"))}
        bed = declared_of(self.bed) if self.assembly.count else {}
        return {**bed, **counts, **own, **dict.fromkeys(("ended", "jammed", "met"), Held(0, 1))}

    def rule(self, arrays: Mapping[str, Any], counters: Mapping[str, Any]) -> bool:
        """Return whether what a checkpoint holds goes together."""
        del counters
        return not self.assembly.count or (
            bed_fits(self.bed, arrays) and bool((arrays["numbers"][[SIZE, STEP, TRIED]] <= LARGEST_SIZE).all())
        )

    def restore(self, arrays: Mapping[str, NDArray[Any]], counters: Mapping[str, int]) -> None:
        """Take over the state of a checkpoint."""
        self.done_steps, self.turns = int(counters["steps"]), int(counters["turns"])
        self.stage, self.moves = int(counters["stage"]), int(counters["moves"])
        self.ended, self.jams, self.met = (bool(counters[name]) for name in ("ended", "jammed", "met"))
        if not self.assembly.count:
            return
        self.numbers = np.array(arrays["numbers"], dtype=np.float64)
        self.good_position, self.good_orientation = np.array(arrays["good_position"]), np.array(arrays["good_turns"])
        own = ("numbers", "good_position", "good_turns")
        self.bed.finders.exact = False
        self.bed.restore({name: array for name, array in arrays.items() if name not in own})

    @property
    def factor(self) -> float:
        """Common factor on the sizes at which nothing overlaps."""
        if self.met or not self.assembly.count:
            return 1.0
        return float(self.numbers[SIZE]) * self.dense

    @property
    def report(self) -> dict[str, Any]:
        """Numbers of the run, and contacts of the grains that are jammed."""
        all_spheres = all(shape.is_sphere for shape in self.assembly.shapes)
        found: dict[str, Any] = {
            "iterations": (self.done_steps - -(-self.moves // AT_ONCE)) * ROUNDS,
            "thermal_steps": self.moves,
            "overlap": 0.0,
            "jammed": float(self.jams),
            "isostatic": 2 * self.dimension if all_spheres else ISOSTATIC[self.dimension],
        }
        if not self.jams:
            return found
        near, mean = self._near(), float(np.median(self.bed.diameter)) * float(self.numbers[SIZE])
        # where the last growth fails, gaps of contacts are several times as long as it: spheres, which few forces hold,
        # are parted slowly; and grids of distances are wrong by as much
        own = CONTACT * mean
        held, rattlers = near.held(own)
        return {
            **found,
            "contact_gap": own * self.unit,
            "coordination_without_rattlers": held,
            "rattlers": rattlers,
            "gaps": list(GAPS),
            "coordination": [float(near.numbers(gap * mean).mean()) for gap in GAPS],
        }

    def _near(self) -> NearPairs:
        """Return pairs of grains, and grains at walls, with their least gaps, at the final sizes."""
        bed = self.bed
        self._resize(bed, float(self.numbers[SIZE]))
        bed.find(GAPS[-1] * 1.01, 0.0)
        i, j, gap = bed.rows.i[: bed.m], bed.rows.j[: bed.m], bed.gap
        # the rows of a pair, or of a grain at its walls, are next to each other
        new = np.ones(bed.m, dtype=bool)
        new[1:] = (i[1:] != i[:-1]) | (j[1:] != j[:-1]) | (j[1:] < 0)
        first = np.flatnonzero(new)
        least = np.minimum.reduceat(gap, first) if len(first) else gap
        # fixed grains are as walls to the others
        still, at = bed.fixed if bed.fixed is not None else np.zeros(bed.count, dtype=bool), j[first]
        number, first_one, other = np.cumsum(~still) - 1, i[first], np.maximum(at, 0)
        inner = (at >= 0) & ~still[first_one] & ~still[other]
        mine = np.where(still[first_one], other, first_one)
        pairs = number[first_one[inner]], number[other[inner]], least[inner]
        return NearPairs(int((~still).sum()), self.dimension, *pairs, number[mine[~inner]], least[~inner])

    def poses(self) -> tuple[Floats, Floats]:
        """Return positions (n, 3), within the periodic lengths, and orientations (n, 4)."""
        if not self.assembly.count:
            return self.assembly.position, self.assembly.orientation
        position, orientation = self.bed.poses()
        n = self.assembly.count
        return position[:n] * self.unit, orientation[:n]

    def step(self) -> None:
        """Make some rounds of parting at one size, and change the size where they have succeeded or failed."""
        kept = {name: np.array(array) for name, array in self.arrays.items()}, dict(self.counters)
        try:
            if self.stage == MOVING:
                self._move()
            else:
                self._part()
                self._look()
            self.done_steps += 1
        except Stopped:
            # what the step has done is lost: the next one begins where it began
            self.restore(*kept)
            raise

    def _move(self) -> None:
        """Let the grains move at random for some steps, in which they grow; part them where no growth is left."""
        for _ in range(AT_ONCE):
            stop_if_asked()
            grown = 1.0 + self.growth_rate * self._move_once()
            self._try(min(float(self.numbers[TRIED]) * grown, self.wanted))
            if self.numbers[FREE] < CLOSED or self.numbers[TRIED] >= self.wanted:
                stop_moving(self.bed)
                # these grains were not parted at any size
                self.stage, self.numbers[SIZE], self.numbers[STEP] = JAMMING, 0.0, CAREFUL
                break

    def _move_once(self) -> float:
        """Make a step of thermal motion; return the motion at thermal speed."""
        before = Motion(float(self.numbers[FREE]), float(self.numbers[SUBSTEP]))
        generator = stream(self.seed, "motion", self.moves)
        motion, way = thermal_step(self.bed, before, generator, kept=max(self._preset.kept, APART))
        self.moves += 1
        self.numbers[FREE], self.numbers[SUBSTEP] = motion.free, motion.substep
        return way

    def _part(self) -> None:
        """Make some rounds of parting at the size that is tried, and note the overlap."""
        way, sweeps = self._preset.kept, SWEEPS * (1 + self.turns)
        self.smallest = part_grains(self.bed, way, ROUNDS, missed=MISSED, most=MOST, margin=MARGIN, iterations=sweeps)
        # each round leaves pairs that are not proven to be separate more room
        if self.uneven and self.smallest > 0.0 and close_round(self.bed, first=self.turns == 0):
            # most need nothing but that; triangles take long
            self.smallest = self._part_triangles() if self.turns >= ROOMS else -way
        self.turns += 1

    def _part_triangles(self) -> float:
        """Part meshes that are not convex by their triangles, and return the smallest gap."""
        bed, kept, most, margin = self.bed, *BY_TRIANGLES
        bed.finders.exact = True
        smallest = part_grains(bed, kept, ROUNDS, missed=MISSED, most=most, margin=margin)
        crossing = bed.finders.crossing(bed.pairs, bed.grains)
        bed.finders.exact = False
        return -kept if crossing else smallest

    def _look(self) -> None:
        """Try the next size where the grains are parted; go back where that does not succeed."""
        depth, before = max(-self.smallest, 0.0), float(self.numbers[DEPTH])
        self.numbers[DEPTH] = depth
        late = self.done_steps + 1 >= self.most_steps
        if self.smallest > 0.0:
            if self.stage == JAMMING and self.numbers[SIZE] == 0.0:
                self.numbers[STEP] = CAREFUL
            self.numbers[SIZE] = self.numbers[TRIED]
            self._keep()
            if late or self.numbers[SIZE] >= self.wanted:
                self._end()
            elif self.stage == LOOSENING and self.numbers[SIZE] >= self._loose:
                self._begin_to_move()
            else:
                self._grow(FASTER if self.turns == 1 else 1.0)
        elif late or self.turns >= LONGEST or (depth > LESS * before and not self.uneven):
            if self.numbers[SIZE] == 0.0:
                self._retreat()
                return
            self._put_back()
            if self.stage == LOOSENING:
                self._begin_to_move()
            elif late or self.numbers[STEP] * SLOWER < self._preset.last:
                self._end()
            else:
                self._grow(SLOWER)

    def _begin_to_move(self) -> None:
        """Let the grains move at random from the size that succeeded last."""
        self.stage = MOVING
        self._try(float(self.numbers[SIZE]))

    def _retreat(self) -> None:
        """Try a smaller size, where the grains are: they were parted at none yet."""
        if self.stage == LOOSENING:
            self._try(float(self.numbers[TRIED]) * SMALLER)
            return
        self._try(float(self.numbers[TRIED]) * (1.0 - self.numbers[STEP]))
        self.numbers[STEP] = min(2.0 * self.numbers[STEP], LARGEST)

    def _grow(self, factor: float) -> None:
        """Try a larger size, with another growth."""
        preset = self._preset
        self.numbers[STEP] = min(self.numbers[STEP] * factor, preset.first)
        self._try(min(float(self.numbers[SIZE] * (1.0 + self.numbers[STEP])), self.wanted))

    def _try(self, size: float) -> None:
        """Give the grains a size that is tried."""
        self.numbers[TRIED], self.numbers[DEPTH], self.turns = size, math.inf, 0
        self._resize(self.bed, size)

    def _keep(self) -> None:
        """Keep the present poses."""
        self.good_position, self.good_orientation = self.bed.grains.position.copy(), self.bed.orientation.copy()

    def _put_back(self) -> None:
        """Go back to the poses and the size that succeeded last."""
        self.bed.put(self.good_position, self.good_orientation, math.inf)
        self._try(float(self.numbers[SIZE]))

    def _end(self) -> None:
        """End where the true geometry is free of overlap; part grains farther, or reduce them, where it is not."""
        self.met = bool(self.numbers[SIZE] >= self.wanted)
        for look in range(LOOKS):
            found = verify(self._final(), tolerance=0.0)
            if found.ok:
                break
            if look < LOOKS - 1:
                way = self._preset.kept * FARTHER**look
                part_grains(self.bed, way, ROUNDS, missed=MISSED, most=MOST, margin=MARGIN)
            else:
                self.met = False
                self.numbers[SIZE] *= max(1.0 - 2.0 * max(found.deepest, found.largest_escape), 0.5)
        self.ended, self.jams = True, not self.met

    def _final(self) -> Assembly:
        """Return the grains in their present poses and sizes, in the unit of the assembly."""
        position, orientation = self.poses()
        given = self.assembly
        grains = replace(given, position=position, orientation=orientation, scale=given.scale * self.factor)
        return given.container.filled(grains) if isinstance(given.container, Occupied) else grains
