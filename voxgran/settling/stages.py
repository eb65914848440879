"""The stages of settling: growth, fall, shaking, quasi-static steps to rest, parting, and the proof.

Each stage is made of steps; all that a step depends on is in the bed and in its progress, so that a run may stop
between any two steps and go on with the same bits. Lengths are in median diameters, times in sqrt(d / g).
"""

import copy
import math
from typing import Any

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.errors import InputError
from voxgran._base.stopping import Stopped
from voxgran.contacts.assembly import Assembly
from voxgran.contacts.manifolds.rows import SURFACE
from voxgran.settling.bed import Bed
from voxgran.settling.examination import AFTER_PARTING, CALM, EARLY, EVERY, RESIDUAL, THOROUGH, TRIALS, USUAL, Examined
from voxgran.settling.fall import fall_step, is_slow, let_fall, random_pull, stop_falling
from voxgran.settling.impulses import Fall
from voxgran.settling.materials import friction_of, friction_range
from voxgran.settling.parameters import Settling
from voxgran.settling.parting import close_round
from voxgran.settling.progress import (
    AGAIN,
    CLOSING,
    ENDED,
    FALL,
    GROWTH,
    LOOK,
    RAIN,
    SHAKING,
    STAGES,
    START,
    STILL,
    Progress,
)
from voxgran.settling.quasi_static import (
    FRICTIONAL,
    FRICTIONLESS,
    GRIDS,
    ROOMED,
    SOFT,
    TRIANGLES,
    SolverPreset,
    quasi_static_step,
)
from voxgran.settling.rain import Rain, let_arrive, steps_of_rain
from voxgran.settling.soft_contacts import soft_step

#: change of the height in a unit of time below which the fall ends, without friction, and for each layer with friction,
#: for so many at least; units of time that it lasts at least
SINKING, BOUNCE, FEW_LAYERS, SHORTEST = 0.05, 0.004, 10.0, 4.0
#: units of time that the fall lasts at least without friction, where beds creep; greatest height of a container in
#: which grains fall until they rest, in median diameters
CREEPING, HIGHEST = 30.0, 10_000.0
#: surfaces move at most so far in a step of growth, which lasts at least so many steps
GROWTH_STEP, GROWTH_STEPS = 0.03, 40
#: iterations in a quasi-static step, twice as many in beds of more layers, four times with more load, and how steps
#: shrink and grow (with some hundred iterations forces at sliding contacts drift, and beds that could rest go on so)
ITERATIONS, DEEP, HEAVY, SHRINK, LENGTHEN = 30, 40.0, 3.0, 0.9, 1.3
#: largest number of quasi-static steps in all, with the examinations between them
STILL_STEPS = 300
#: what is different in the fall of single spheres that have grown, whose contacts stay where they are while they turn:
#: they come to rest in a bed, while heaps that slide would spread farther
SPHERE_FALL: dict[str, Any] = {"step": 0.0625, "most": 0.0625}
#: what is different in the fall of meshes that are not convex, and of such meshes that have grown: gaps are less exact
SURFACE_FALL: tuple[dict[str, Any], ...] = {"rest": 2e-3, "margin": 0.05}, {"rest": 2e-3, "margin": 0.05, "most": 0.03}
#: most rounds in which surfaces are parted, and pairs that are not proven to be separate, for each grain, with which
#: parting may end: exact contacts part them
CLOSING_ROUNDS, LEFT_OPEN = 12, 0.2
#: share of moving grains with which steps by grids end, and how often it is measured by how much their gaps are wrong,
#: with steps after it: the bed sinks by that before its exact contacts, which take longer, are found
NEARLY, ROOM_ROUNDS = 0.2, 3
UNIT = {2: math.pi / 4, 3: math.pi / 6}  # volume of a grain of unit diameter by dimension, whose mass is 1
#: shares of moving grains below which steps become shorter, and of grains that do not rest with which steps end that
#: are examined every few ones: their contact points change
SLOW, ENOUGH = 0.03, 0.025
#: soft contacts: rounds of a step, share of grains that need not rest, how much contacts become harder at most, and the
#: share of the distance that surfaces keep by which they may be compressed; the ratio of the largest force to the mean
#: one from which on contacts are not compressed by gravity
SINKING_ROUNDS, UNPROVEN, HARDER, COMPRESSED, WEDGED = 2000, 0.005, 0.25, 0.9, 100.0
#: from how many grains on a bed is left at the first examination that proves enough of them to rest, and steps after
#: which contacts become harder then; examinations without gain after which a bed is left that rests as asked
NUMEROUS, SOON, UNCHANGED = 5000, 10, 12


class Settler(Examined):
    """Settles a bed, step by step.

    Parameters
    ----------
    assembly : Assembly
        The grains, with lengths in median diameters; they may overlap.
    how : Settling
        Parameters.
    gravity : (3,) ndarray of float
        Unit vector in which gravity acts.
    seed : int
        Of the random accelerations of shaking.
    small : (n,) ndarray of float, optional
        Factors on the sizes from which the grains grow to their own ones, with contacts.
    rain : Rain, optional
        How grains arrive that are held back, in place of growth.
    held : int
        How many of the last grains are held back.

    Raises
    ------
    InputError
        If a shape is an open surface, the walls of the container are not known, or it is so high that the fall would
        not end.
    """

    def __init__(
        self, assembly: Assembly, how: Settling, gravity: Floats, *, seed: int = 0, small: Floats | None = None,
        rain: Rain | None = None, held: int = 0,
    ) -> None:  # fmt: skip
        self.how, self.seed = how, seed
        weight = how.lid.weight * float(assembly.volumes.sum()) / UNIT[assembly.dimension] if how.lid else 1.0
        self.bed = Bed(assembly, gravity, lid_weight=weight, hulls=how.parts == "hulls", held=held)
        self.small, self.rain = small if rain is None else None, rain
        self.progress = Progress(stage=RAIN if rain is not None else START if small is None else GROWTH)
        if self.small is not None:
            self.bed.resize(self.small[self.bed.order])
        self.friction = friction_of(how.friction, assembly)
        least, largest = friction_range(self.friction)
        # some grains slip without friction, or all of them
        self._slips, self._frictionless = least == 0.0, largest == 0.0
        grown, surfaces = self.small is not None, SURFACE in self.bed.finders.kinds
        self._fall = Fall(self.friction, how.restitution, **(SURFACE_FALL[int(grown)] if surfaces else {}))
        self._falling = self._fall._replace(**SPHERE_FALL) if grown and self.bed.spheres else self._fall
        if how.fall_time is None and assembly.count and self._height() > HIGHEST:
            raise InputError(
                f"the container is {self._height():.3g} median diameters high along gravity: grains fall through at "
                f"most {HIGHEST:.0f} until they rest; correct their sizes, or give fall_time"
            )
        self.progress.iterations = self._sweeps()
        if not assembly.movable.any():
            self.progress.stage, self.progress.proven, self.progress.moving = ENDED, 1, 0.0
            self.progress.residual = np.zeros(assembly.count)

    @property
    def ended(self) -> bool:
        """Whether all stages have ended."""
        return self.progress.stage == ENDED

    @property
    def reason(self) -> str:
        """Stop reason of a bed that has ended."""
        return "settled" if self.progress.proven else "steps"

    @property
    def most_steps(self) -> int:
        """Largest number of steps, those that were made included."""
        growth = 0 if self.small is None else self._growth_steps()
        rain = 0 if self.rain is None else steps_of_rain(self.rain, self.bed.assembly.count, self._fall)
        shaking = 0 if self.how.shaking is None else math.ceil(self.how.shaking.duration / self._fall.step)
        falls, rounds = 2 + self._more_falls, (TRIALS + 2) * CLOSING_ROUNDS
        still = (falls - 1) * self._more_steps * STILL_STEPS
        return growth + rain + 1 + shaking + falls * self._fall_steps() + still + rounds

    @property
    def told(self) -> str:
        """What the grains are doing, in words."""
        return STAGES[self.progress.stage]

    def step(self) -> None:
        """Make the next step."""
        progress = self.progress
        stage = progress.stage
        bed, before = self.bed, copy.copy(progress)
        if stage in _LONG and not (stage == STILL and self._preset is FRICTIONAL):
            self.bed = bed.copy()
        try:
            _STEPS[stage](self)
        except Stopped:
            # what the step has done is lost: the next one begins where it began
            self.bed, self.progress, bed.finders.exact = bed, before, bool(before.exact)
            raise
        progress.step += 1
        progress.stage_step = progress.stage_step + 1 if progress.stage == stage else 0

    @property
    def report(self) -> dict[str, float]:
        """How the bed was left: steps, share of the grains proven to rest, largest residual, smallest gap."""
        progress = self.progress
        return {
            "steps": progress.step,
            "resting": 1.0 - progress.moving,
            "largest_residual": float(progress.residual.max(initial=0.0)),
            "smallest_gap": progress.smallest,
        }

    def _grow(self) -> None:
        """Make a step of growth."""
        assert self.small is not None
        small, part = self.small[self.bed.order], (self.progress.stage_step + 1) / self._growth_steps()
        self.bed.resize(small + (1.0 - small) * part)
        # with friction grains would be wedged between fixed ones and walls, and a lid would sink to where they overlap
        lid, self.bed.bodies[-1, 6] = self.bed.bodies[-1, 6], 0.0
        self._advance(None, self._fall if self.bed.fixed is None else self._fall._replace(friction=0.0))
        self.bed.bodies[-1, 6] = lid
        if part >= 1.0:
            self.progress.stage = FALL

    def _growth_steps(self) -> int:
        """Return the number of steps of growth."""
        assert self.small is not None
        far = float((self.bed.assembly.bounding_radii * (1.0 - self.small)).max(initial=0.0))
        return max(GROWTH_STEPS, math.ceil(far / GROWTH_STEP))

    def _begin(self) -> None:
        """Examine the grains before any of them moves: a bed that rests stays as it is."""
        self.progress.stage = FALL
        if self.how.shaking is None:
            self.bed.finders.exact = True
            self._examine(THOROUGH)
            self.progress.first = self.progress.smallest
            if self._rests():
                self.progress.stage, self.progress.exact = ENDED, 1
                return
            self.bed.finders.exact = False
        self.bed.rows.row[:, 10:14] = 0.0

    def _rain(self) -> None:
        """Make a step in which grains arrive, or in which those that have arrived are still fast."""
        assert self.rain is not None
        progress, bed = self.progress, self.bed
        how, ended = let_arrive(bed, self.rain, self._fall, progress)
        if bed.count:
            self._advance(None, how)
        if ended:
            progress.stage, progress.iterations = FALL if bed.count else ENDED, self._sweeps()

    def _sweeps(self) -> int:
        """Return the number of iterations of a quasi-static step, by the layers of the bed and its load."""
        return ITERATIONS * (1 if self._layers() <= DEEP else 2) * (1 if self.bed.load <= HEAVY else 4)

    def _layers(self) -> float:
        """Return the height of the bed, in median diameters."""
        return float(np.ptp((self.bed.grains.position * self.bed.gravity).sum(axis=1))) if self.bed.count else 0.0

    def _drop(self) -> None:
        """Make a step of the fall."""
        progress, fall = self.progress, self._falling
        unit = round(1.0 / fall.step)
        self._advance(None, fall)
        progress.heights = np.append(progress.heights, self.bed.height)[-unit - 1 :]
        lasted = progress.stage_step + 1 >= (CREEPING if self._slips else SHORTEST) * unit
        if self._slips:
            # without friction grains go on trembling
            calm = abs(progress.heights[0] - progress.heights[-1]) < SINKING
        else:
            # where deep beds that bounce turn, their height is that of before, too
            calm = np.ptp(progress.heights) < BOUNCE * max(self._layers(), FEW_LAYERS) and is_slow(self.bed)
        if not (lasted and calm) and progress.stage_step + 1 < self._fall_steps():
            return
        if progress.stage == FALL and self.how.shaking is not None:
            progress.stage = SHAKING
            return
        stop_falling(self.bed, fall.step / fall.substeps)
        progress.stage, progress.length, progress.substep = STILL, self._preset.first, 0.0

    def _fall_steps(self) -> int:
        """Return the largest number of steps of a fall."""
        fall = self._falling
        if self.how.fall_time is not None:
            return max(1, round(self.how.fall_time / fall.step))
        # as fast as grains may fall, and then some time to come to rest
        return round((Settling.usual_fall + self._height() / (fall.most / fall.step)) / fall.step)

    def _height(self) -> float:
        """Return the height of the container along gravity, in median diameters."""
        lower, upper = self.bed.assembly.container.bounds
        return float(((upper - lower) * np.abs(self.bed.gravity)).sum())

    def _shake(self) -> None:
        """Make a step in which each grain is accelerated in a direction of its own."""
        shaking, progress, bed = self.how.shaking, self.progress, self.bed
        assert shaking is not None
        steps = math.ceil(shaking.duration / self._fall.step)
        strength = shaking.acceleration * (1.0 - progress.stage_step / steps)
        self._advance(strength * random_pull(bed, self.seed, progress.stage_step))
        if progress.stage_step + 1 >= steps:
            progress.stage, progress.heights = AGAIN, np.zeros(0)

    def _advance(self, pull: Floats | None, how: Fall | None = None) -> None:
        """Advance the bed by a step with inertia, as in the fall where nothing else is given."""
        how = how or self._fall
        fall_step(self.bed, how, self.progress.substep, pull)
        self.progress.substep = how.step / how.substeps

    def _rest(self) -> None:
        """Make a quasi-static step, and examine the bed when it hardly moves."""
        progress, bed, preset = self.progress, self.bed, self._preset
        if preset in SOFT:
            self._sink(preset)
            return
        # a heavy lid would overlap grains that turn anew in each step; those that bear none of it still fall
        turning = preset is FRICTIONAL and bed.grains.kind.any()
        length = progress.length / bed.load**0.25 if turning else progress.length
        progress.moved = moving = quasi_static_step(
            bed, self.friction, length, rest=preset.kept, iterations=progress.iterations,
            margin=preset.margin, most=preset.most, reuse=preset.reuse,
        )  # fmt: skip
        if preset.last > preset.first:
            progress.length = min(preset.last, LENGTHEN * progress.length)
        elif progress.still_steps >= preset.late and (moving < SLOW or preset.late):
            progress.length = max(preset.last, SHRINK * progress.length)
        progress.still_steps += 1
        last = progress.still_steps >= (1 if preset is ROOMED else self._more_steps) * preset.steps
        if preset is FRICTIONAL:
            self._part_wedged()
            if last or (moving < EARLY and progress.still_steps % EVERY == 0):
                progress.stage = LOOK
            return
        calm = moving < (NEARLY if preset is GRIDS else CALM) and preset.last <= preset.first
        if not last and not calm and (not preset.examined or progress.still_steps % preset.examined):
            return
        if preset in (GRIDS, ROOMED):
            self._look_closer()
            return
        self._judge(preset, last)

    def _look(self) -> None:
        """Examine a copy of a bed with friction, which moves on if that does not rest; the bed after its last step."""
        progress, preset = self.progress, self._preset
        progress.stage = STILL
        if progress.still_steps >= self._more_steps * preset.steps:
            self.bed = self.bed.copy()
            self._judge(preset, last=True)
        elif self._rests_as_copy(preset):
            self._end(begun=True)

    def _judge(self, preset: SolverPreset, last: bool) -> None:
        """Examine the bed and part its grains; end where it rests, or after the last step."""
        progress, bed = self.progress, self.bed
        if preset is TRIANGLES:
            # the forces of an examination, which has no contacts beyond its reach, would move the bed
            self.bed = bed.copy()
        self._examine(USUAL)
        enough = ENOUGH if preset.examined else CALM
        if preset.examined and progress.moving >= enough and not last:
            self.bed = let_fall(bed, progress.residual, self._fall)
            return
        if progress.smallest < 0.0 and (progress.trials < TRIALS or (last and progress.exact)):
            progress.trials += 1
            if not self._part():
                self._look_closer()
                return
            if not progress.exact:
                progress.length = min(progress.length, AFTER_PARTING * preset.last)
            self._examine(USUAL)
        if last or (progress.moving < enough and progress.smallest >= 0.0):
            if progress.smallest < 0.0 and not progress.exact:
                self._part_tightly()
            self._end()

    def _end(self, *, begun: bool = False) -> None:
        """Examine the bed for the last time; let it fall again, or go back to a former one that was better."""
        progress, bed = self.progress, self.bed
        self._examine(THOROUGH, begun=begun)
        if not self._rests() and progress.best > 1.0 - self.how.rest and progress.falls < self._more_falls:
            progress.stage, progress.heights, progress.substep = AGAIN, np.zeros(0), 0.0
            progress.falls, progress.still_steps, progress.trials = progress.falls + 1, 0, 0
            return
        back, better = None, progress.smallest < 0.0 or progress.best < progress.moving
        if better and len(progress.best_position):
            back = progress.best_position, progress.best_orientation, progress.best_lid
        elif progress.smallest < min(progress.first, 0.0):
            # the grains cannot be parted: they overlapped less where they were
            assembly, order = bed.assembly, bed.order
            level = math.inf if assembly.lid is None else assembly.lid.level
            back = assembly.position[order], assembly.orientation[order], level
        if back is not None:
            bed.put(*back)
            self._examine(THOROUGH)
            self._rests()
        progress.stage, progress.best_position, progress.best_orientation = ENDED, np.zeros((0, 3)), np.zeros((0, 4))

    def _sink(self, preset: SolverPreset) -> None:
        """Let grains sink on soft contacts, which become harder as they rest, and examine them once none overlap."""
        progress, bed = self.progress, self.bed
        progress.moved, progress.velocity, deepest = soft_step(
            bed, progress.length, progress.velocity, rest=preset.kept, tolerance=RESIDUAL, enough=UNPROVEN,
            iterations=SINKING_ROUNDS,
        )  # fmt: skip
        progress.still_steps += 1
        last, calm = progress.still_steps >= self._more_steps * preset.steps, progress.moved <= UNPROVEN
        many, enough, best = bed.count >= NUMEROUS, min(ENOUGH, 1.0 - self.how.rest), progress.best
        overlap, late = deepest > preset.kept, min(SOON, preset.late) if many else preset.late
        long = progress.still_steps % late == 0
        wedged = overlap and (last or ((calm or long) and deepest > WEDGED * progress.length))
        if wedged:
            self._part_tightly()
        if wedged or (not overlap and (calm or last or progress.still_steps % preset.examined == 0)):
            # grains tremble on springs when a large bed rests long since: a short examination does not see it
            self._examine(THOROUGH if many else USUAL)
            if progress.smallest < 0.0 and progress.moving <= enough and not wedged:
                # a wall that is as round as the grains
                self._part_tightly()
                self._examine(THOROUGH if many else USUAL)
            # most of the last grains come to rest a little later
            progress.trials += int(progress.moving <= enough and progress.smallest >= 0.0)
            progress.unchanged = progress.unchanged + 1 if progress.best == best <= 1.0 - self.how.rest else 0
            few = 0 if progress.moving <= UNPROVEN or many else TRIALS
            last |= progress.trials > few or progress.unchanged >= UNCHANGED
        elif calm or long:
            progress.length *= max(min(1.0, COMPRESSED * preset.kept / deepest), HARDER)
            progress.velocity = np.zeros((0, 6))
        if last:
            self._end(begun=True)

    def _close(self) -> None:
        """Part surfaces that are not proven to be separate; then go on with the contacts of their triangles."""
        progress = self.progress
        wrong = close_round(self.bed, first=progress.stage_step == 0 and not progress.trials)
        if progress.roomed < ROOM_ROUNDS and not progress.trials:
            progress.roomed, progress.still_steps = progress.roomed + 1, 0
            progress.stage, progress.length = STILL, ROOMED.first
            return
        if wrong > LEFT_OPEN * self.bed.count and progress.stage_step + 1 < CLOSING_ROUNDS:
            return
        progress.still_steps = progress.still_steps if progress.trials else 0
        progress.exact, self.bed.finders.exact = 1, True
        if progress.still_steps >= self._more_steps * TRIANGLES.steps:
            self._end()
            return
        progress.stage, progress.length = STILL, TRIANGLES.first

    @property
    def _preset(self) -> SolverPreset:
        """The solver preset of quasi-static steps."""
        if SURFACE not in self.bed.grains.kind:
            if self._frictionless:
                return SOFT[int(self.bed.grains.kind.any())] if self.slides else FRICTIONLESS
            return FRICTIONAL
        if self.progress.exact:
            return TRIANGLES
        return ROOMED if self.progress.roomed else GRIDS


_STEPS = {
    GROWTH: Settler._grow, START: Settler._begin, FALL: Settler._drop, SHAKING: Settler._shake, AGAIN: Settler._drop,
    STILL: Settler._rest, CLOSING: Settler._close, RAIN: Settler._rain, LOOK: Settler._look,
}  # fmt: skip
#: stages whose steps may be stopped in their midst
_LONG = (START, STILL, CLOSING)
