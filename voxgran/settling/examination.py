"""Examinations: whether a bed, or a copy of it, rests; and what has to be parted for that.

Where some grains move since a step is not solved to the end, a bed may rest long since: copies are examined while beds
still move.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from voxgran._base.arrays import Floats
from voxgran.contacts.manifolds.rows import SURFACE
from voxgran.settling.equilibrium import balance_bed
from voxgran.settling.interior_point import is_direct
from voxgran.settling.materials import FrictionTable
from voxgran.settling.parameters import Settling
from voxgran.settling.parting import part_grains
from voxgran.settling.progress import CLOSING, GROWTH, OF_SETTLING, RAIN, STILL, Progress, Resumable
from voxgran.settling.quasi_static import TRIANGLES, SolverPreset

#: distance up to which surfaces touch
TOUCHING = 1e-3
#: share of grains that do not rest below which a bed does
CALM = 0.015
#: length of steps after overlapping grains were parted, in that of the last ones
AFTER_PARTING = 0.5
#: net force, in weights, and net torque, in weights times radii, up to which a grain rests
RESIDUAL = 0.01
#: share of moving grains below which copies of a bed with friction are examined, and steps from one to the next; depth
#: to which overlaps of a copy whose grains rest otherwise are parted
EARLY, EVERY, SHALLOW = 0.5, 4, 1e-2
#: steps after which spheres of a bed with friction are parted that still overlap by more than that depth
HELD = 24
#: largest gap that contacts which bear forces have when a copy is examined, rounds of parting then, and how far
#: grains move in one
CLOSED, CLOSER_ROUNDS, CLOSER = 8e-4, 8, 5e-3
#: most iterations of an examination of a copy, of others, and of the last one; those by sweeps it begins with where
#: grains rub, those after which it ends where no more rest, and more for all grains; median residual of a hopeless copy
#: after the sweeps, in that of rest
QUICK, USUAL, THOROUGH, SWEPT, PATIENCE, MANY, HOPELESS = 600, 300, 3000, 50, 64, 60_000, 5.0
#: how many times more patience where nothing rubs: forces change slowly then
SLIPPERY = 3
#: distance to which overlapping grains are parted, rounds for it, by triangles and by other contacts, how often it is
#: tried, and depth that is rounding
PARTED, FEW_ROUNDS, ROUNDS, TRIALS, ROUND_OFF = 1e-4, 20, 60, 3, 1e-13

#: how many times more quasi-static steps are made in a bed of fewer grains than these
MORE_STEPS, FEW_GRAINS = 5, 1500


class Examined(Resumable):
    """A bed that is examined while it settles.

    how: its parameters.  friction: of each pair of materials, or of all grains.
    """

    how: Settling
    friction: float | FrictionTable
    progress: Progress
    _frictionless: bool
    small: Floats | None
    rain: Any
    HELD = OF_SETTLING

    def rule(self, arrays: Mapping[str, Any], counters: Mapping[str, Any]) -> bool:
        """Return whether what a checkpoint holds goes together, and its stage is one of these grains."""
        known = {GROWTH: self.small is not None, RAIN: self.rain is not None}
        return known.get(counters["stage"], True) and super().rule(arrays, counters)

    @property
    def slides(self) -> bool:
        """Whether beds without friction come to rest: contacts of shapes that are not convex change too much."""
        return SURFACE not in self.bed.finders.kinds and not self.bed.finders.notched

    @property
    def _more_steps(self) -> int:
        """How many times more steps are made than in a large bed: in a small one they take little time."""
        if self._frictionless and not self.slides:
            # such beds go on creeping
            return 1
        return min(max(FEW_GRAINS // max(self.bed.count, 1), 1), MORE_STEPS)

    @property
    def _more_falls(self) -> int:
        """How often a bed that does not come to rest falls again: once, where steps take little time."""
        return int(self._more_steps > 1 and SURFACE not in self.bed.grains.kind)

    def _examine(self, iterations: int, *, begun: bool = False) -> None:
        """Note how well forces at the contacts balance the grains; `begun` says that those of before nearly do."""
        bed, progress = self.bed, self.progress
        if begun and self._frictionless and is_direct(bed):
            # the forces of before are the best ones
            return
        found = balance_bed(
            bed, self.friction, reach=TOUCHING, tolerance=RESIDUAL, iterations=iterations,
            sweeps=0 if self._frictionless or begun else SWEPT, hopeless=HOPELESS if iterations == QUICK else math.inf,
            patience=(PATIENCE + MANY // max(bed.count, 1)) * (SLIPPERY if self._frictionless else 1),
        )  # fmt: skip
        progress.residual = np.maximum(found.residual, found.residual_torque)
        progress.moving = bed.mean(~found.rests)
        smallest = float(bed.gap.min(initial=TOUCHING))
        progress.smallest = 0.0 if -ROUND_OFF < smallest < 0.0 else smallest
        if bed.finders.crossing(bed.pairs, bed.grains):
            progress.smallest = min(progress.smallest, -TOUCHING)
        if progress.stage == STILL and progress.smallest >= 0.0 and progress.moving < progress.best:
            progress.best, progress.best_lid = progress.moving, bed.lid_level
            progress.best_position, progress.best_orientation = bed.grains.position.copy(), bed.orientation.copy()

    def _rests(self) -> bool:
        """Return whether the bed counts as resting, as last examined, and note it."""
        progress = self.progress
        progress.proven = int(progress.moving <= 1.0 - self.how.rest and progress.smallest >= 0.0)
        return bool(progress.proven)

    def _rests_as_copy(self, preset: SolverPreset) -> bool:
        """Return whether a copy of the bed rests, once small overlaps are parted; then it takes the place of the bed.

        Where some grains move since a step is not solved to the end, the bed may rest long since. Turning grains open
        some of the contacts that bear them, by more than an examination reaches: these are closed. The forces of an
        examination would move the bed.
        """
        progress, own, enough = self.progress, self.bed, min(CALM, 1.0 - self.how.rest)
        for closed in (CLOSED, math.inf):
            self.bed = own.copy()
            part_grains(self.bed, PARTED, CLOSER_ROUNDS, most=CLOSER, margin=CLOSER, closed=closed)
            self._examine(QUICK)
            if progress.moving <= max(enough, progress.moved):
                break
            # the rims of grains of many triangles roll off their contacts where these are closed
        parted = progress.moving < enough and -SHALLOW < progress.smallest < 0.0
        if parted:
            progress.trials += 1
            part_grains(self.bed, PARTED, ROUNDS)
            self._examine(QUICK, begun=True)
        if progress.moving < enough and progress.smallest >= 0.0:
            return True
        if parted and progress.trials % TRIALS == 0:
            # grains that are wedged by forces which gravity does not need come free by those of the examination
            progress.length = min(progress.length, AFTER_PARTING * preset.last)
        else:
            self.bed = own
        return False

    def _part(self) -> bool:
        """Part grains that overlap; return whether they are parted as far as their present contacts can do it."""
        bed = self.bed
        if not self.progress.exact:
            part_grains(bed, PARTED, ROUNDS)
            return True
        smallest = part_grains(bed, PARTED, FEW_ROUNDS, most=TRIANGLES.most, margin=TRIANGLES.margin)
        return smallest >= 0.0 and not bed.finders.crossing(bed.pairs, bed.grains)

    def _part_wedged(self) -> None:
        """Part spheres that walls wedge: to open their contacts, a bed would have to rise against friction.

        The forces for that grow exponentially with the depth in widths of the container (Janssen 1895), so that no
        sweeps find them. Without friction spheres are parted in a few rounds; grains with edges would be wedged anew.
        """
        bed = self.bed
        if bed.spheres and self.progress.still_steps % HELD == 0 and float(bed.gap.min(initial=0.0)) < -SHALLOW:
            part_grains(bed, PARTED, ROUNDS)

    def _part_tightly(self) -> None:
        """Part grains that fit between walls, or in a tube, without the distance that surfaces keep, or with none."""
        if part_grains(self.bed, PARTED, ROUNDS) < 0.0:
            part_grains(self.bed, 0.5 * ROUND_OFF, ROUNDS)

    def _look_closer(self) -> None:
        """Part the true surfaces, once contacts by grids of distances are in balance."""
        self.progress.stage, self.progress.exact, self.bed.finders.exact = CLOSING, 0, False
