"""Compression of grains to a mean stress, without gravity: a container whose walls or periodic sides move.

Grains move relative to the mean strain of the container, overdamped: by their mobility times the force on each. The
container strains by a mobility of its own times what the virial of the forces lacks of the stress, so that it stands
still where the stress of Love and Weber is the one that is asked for. In a step forces within their friction cones are
sought with which no gap closes, as in a quasi-static step under gravity. All forces are multiplied from time to time by
the factor that serves best, since the strain of the container is the slowest mode. Once it hardly strains, steps become
shorter until surfaces keep their distance and the forces balance.

Where shear is free, a periodic cell tilts too, until it has no shear stresses. Its first edge stays along x, and its
second one in the plane of x and y, so that it turns with all grains by half of the shear strain.

Fixed grains move with the mean strain, as points of the container, and do not turn. Walls push them inside, and a
container does not become shorter than one of them is long.

Lengths are in median diameters d, forces in the largest stress times d^2 (in 2D times d). The mobility of a grain of
the median diameter is 1 and falls with the square of the diameter (in 2D with the diameter), as its forces grow.

References
----------
Agnolin & Roux 2007, doi:10.1103/PhysRevE.76.061302: packings that are compressed to an isotropic stress
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, Integers
from voxgran._base.errors import InputError, VoxgranError
from voxgran._base.stopping import Stopped
from voxgran.contacts.assembly import Assembly
from voxgran.contacts.forces import ContactForces
from voxgran.contacts.manifolds.rows import SURFACE
from voxgran.contacts.walls import least_lengths, pushed_inside
from voxgran.containers.model import boundary_of
from voxgran.containers.stretch import deformed
from voxgran.settling.bed import Bed
from voxgran.settling.material import Material
from voxgran.settling.materials import USUAL_FRICTION, Materials, friction_of, friction_range
from voxgran.settling.parameters import Compression
from voxgran.settling.parting import close_round, part_grains
from voxgran.settling.progress import OF_COMPRESSION, Resumable
from voxgran.settling.quasi_static import KEPT, TRIANGLES
from voxgran.settling.stress_balance import (
    balance_grains,
    evenly,
    keep_known_forces,
    pressed_forces,
    shear_ratio,
    stress_of,
    without_weight,
)

#: stages: an examination of grains that may be in balance already, steps to the stress, rounds in which the surfaces of
#: meshes are parted, and the end
START, PRESSING, CLOSING, ENDED = range(4)
#: least mobility in a checkpoint
LEAST_MOBILITY = 1e-12
#: iterations of a step of unit mobility, which grow with its square root, and their bounds
ITERATIONS, FEWEST, MANY = 20.0, 40, 100
#: tolerance of a step, and compression of a contact by a unit force in it
TOLERANCE, SOFTNESS = 1e-5, 1e-7
#: strain of a step, in shares of the largest one, below which steps become shorter; mobility of the last ones, and that
#: from which on the grains are examined, every few steps
CALM, LAST, EXAMINED, EVERY = 0.1, 0.1, 0.3, 5
#: overlap beyond which steps are too long for their iterations
DEEP = 0.1
#: rounds of an examination, and of the last one
QUICK, THOROUGH = 3, 12
#: distance up to which surfaces touch, net force and torque in mean normal forces up to which a grain is in balance
TOUCHING, RESIDUAL = 1e-3, 0.01
#: relative difference of the stress up to which it is met
STRESS_MET = 0.01
#: largest friction at walls: with 1 a grain in a right-angled corner of a wall that moves and one that does not bears
#: any load by itself, and all others nothing
AT_WALLS = 0.7
#: most steps, and how many more without friction, where grains creep for long; rounds in which surfaces are parted, and
#: the distance to which they are
STEPS, CREEPING, ROUNDS, PARTED = 400, 1100, 12, 1e-4
#: overlap with which grains are parted that short steps leave deep in each other, as rims and faces of cylinders, how
#: often at most, and then: mobility of the next step, strain of a step in that of before, and iterations of a step
STUCK, PARTINGS, AFRESH, SLOWER, MORE = 0.03, 4, 0.3, 0.3, 400
#: relative change of the volume that counts as none, and shear strain at constant volume from which on grains yield:
#: the fabric follows the strain by then, and with it the stress that they bear; steps over which that is a mean
SAME_VOLUME, SHEARED, WINDOW = 0.01, 0.4, 30
#: ratio of the least to the largest stress, in the one that is asked for, from which on grains yield that have not come
#: to rest within all steps
BORNE = 1.02
#: shear strain at any volume from which on grains yield: what they bear then is what a few layers of them bear
FLOWED = 1.0
#: most strain of a step, in the largest one at the beginning: more only where stresses are missed by several times
LARGEST = 2.0
#: rounds in which a container is widened at the end until grains that have no room are apart, and the share of their
#: overlap by which it is stretched in each
WIDENINGS, WIDENED = 40, 0.25
#: factor on the length of fixed grains below which a container is as long as they are but for rounding
ROUNDED = 1.0 - 1e-9
#: distance up to which contacts are found in a step, and farthest that a grain moves in it, and with exact contacts
MARGIN, FAR, NEAR = 0.1, 0.1, 2e-3


@dataclass(frozen=True, slots=True)
class Pace:
    """How fast a container strains: largest strain of a step, viscous number, and how steps shrink."""

    strain: float
    rate: float
    shrink: float


#: with friction, and with little or none, where grains go on creeping when they are compressed fast
FRICTIONAL, FRICTIONLESS, LITTLE = Pace(0.01, 3e-3, 0.7), Pace(3e-3, 3e-5, 0.9), 0.05


@dataclass(slots=True)
class Progress:
    """How far a compression is."""

    stage: int = START
    step: int = 0  # steps in all
    exact: int = 0  # whether contacts of meshes that are not convex come from their triangles
    rounds: int = 0  # in which surfaces were parted
    proven: int = 0  # whether forces balance the grains and the stress
    mobility: float = 0.0  # of a grain in the next step
    moving: float = 1.0  # share of the grains that bear forces, and are not in balance
    smallest: float = 0.0  # gap, when last examined
    missed: float = 1.0  # relative difference of the stress from the one that is asked for
    gradient: Floats = field(default_factory=lambda: np.eye(3))  # by which the container was deformed
    before: Floats = field(default_factory=lambda: np.ones(3))  # its diagonal when it last had another volume
    partings: int = 0  # how often grains that stayed deep in each other were parted
    yields: int = 0  # whether it goes on shearing without a change of volume
    residual: Floats = field(default_factory=lambda: np.zeros(0))  # in mean normal forces, in the order of the bed
    bearing: Floats = field(default_factory=lambda: np.zeros(0))  # 1 where a grain bears forces
    path: Floats = field(default_factory=lambda: np.zeros((0, 4)))  # by step: solid fraction, and the axial stresses


class Compressor(Resumable):
    """Compresses grains to a stress, step by step.

    Parameters
    ----------
    assembly : Assembly
        The grains, with lengths in median diameters.
    how : Compression
        Parameters. Where a solid fraction is sought, the grains are compressed even if they are in balance.
    start : ContactForces, optional
        Forces that may balance the grains as they are, of which the lengths are in median diameters.

    Raises
    ------
    InputError
        If a shape is an open surface, the walls of the container do not move, or stresses differ along axes that
        stretch together.
    """

    #: whether grains come to rest without friction
    slides = True

    HELD = OF_COMPRESSION

    def __init__(self, assembly: Assembly, how: Compression, start: ContactForces | None = None) -> None:
        self.how, self.container, self._start = how, assembly.container, start
        self.modes = how.modes_of(assembly.container)
        self._moves = np.diag(self.modes)[:3] > 0.0
        stress = np.where(np.append(self._moves, [False] * 3), how.stress_along(assembly.dimension), 0.0)
        # only ratios decide: forces here are in the largest stress along an axis that moves
        self.unit = float(stress.max())
        self.stress = stress / self.unit
        self.bed = Bed(assembly, np.zeros(3))
        without_weight(self.bed)
        self.friction = friction_of(_with_walls(how.friction, assembly), assembly)
        self.pace = FRICTIONAL if friction_range(self.friction)[0] >= LITTLE else FRICTIONLESS
        self._creeping = CREEPING if self.pace is FRICTIONLESS else 0
        self._rate = how.rate or self.pace.rate
        self.progress = Progress(mobility=max(self.pace.strain / self._rate, LAST))
        if how.solid_fraction is not None:
            self.progress.stage = PRESSING
        self._surfaces = bool((self.bed.grains.kind == SURFACE).any())
        self._fixed = np.flatnonzero(~self.bed.movable)
        self._least = least_lengths(_fixed_in(self.bed, self._fixed))
        if not assembly.count:
            self.progress.stage, self.progress.proven, self.progress.moving = ENDED, 1, 0.0

    @property
    def ended(self) -> bool:
        """Whether the compression has ended."""
        return self.progress.stage == ENDED

    @property
    def reason(self) -> str:
        """Stop reason of a compression that has ended."""
        progress = self.progress
        return "compressed" if progress.proven else "yielded" if progress.yields else "steps"

    @property
    def most_steps(self) -> int:
        """Largest number of steps, those that were made included."""
        return 1 + STEPS + self._creeping + (STEPS + ROUNDS if self._surfaces else 0)

    @property
    def told(self) -> str:
        """How far the compression is, in words."""
        return f"solid fraction {self._solid_fraction:.4f}"

    @property
    def _solid_fraction(self) -> float:
        """Volume of the grains that are not fixed, in that of the container without fixed ones."""
        grains = self.bed.assembly
        free = float(grains.volumes[grains.movable].sum())
        return free / (grains.container.volume - float(grains.volumes.sum()) + free)

    @property
    def report(self) -> dict[str, Any]:
        """How the grains were left: steps, share that is in balance, differences, and the path."""
        progress = self.progress
        return {
            "steps": progress.step,
            "balanced": 1.0 - progress.moving,
            "largest_residual": float(progress.residual.max(initial=0.0)),
            "smallest_gap": progress.smallest,
            "stress_error": progress.missed,
            "stress_ratio": self._ratio(),
            "shear_ratio": shear_ratio(stress_of(self.bed, self.bed.forces()), self.bed.assembly.dimension),
            "path": (progress.path * np.array([1.0, self.unit, self.unit, self.unit])).tolist(),
        }

    def step(self) -> None:
        """Make the next step."""
        kept = self.kept()
        try:
            _STEPS[self.progress.stage](self)
        except Stopped:
            # what the step has done is lost: the next one begins where it began
            self.restore(*kept)
            raise
        self.progress.step += 1

    def rule(self, arrays: Mapping[str, Any], counters: Mapping[str, Any]) -> bool:
        """Return whether what a checkpoint holds goes together, and grains that are pressed can move."""
        return (counters["stage"] == START or arrays["mobility"] > LEAST_MOBILITY) and super().rule(arrays, counters)

    def restore(self, arrays: Mapping[str, Any], counters: Mapping[str, Any]) -> None:
        """Take over arrays and counters."""
        super().restore(arrays, counters)
        self.bed.move_walls(deformed(self.container, self.progress.gradient))

    def _begin(self) -> None:
        """Examine the grains before any of them moves: a packing that bears the stress stays as it is."""
        progress, bed = self.progress, self.bed
        bed.finders.exact = True
        if self._start is not None:
            bed.find(TOUCHING, 0.0)
            keep_known_forces(bed, self._start, self.friction, self.unit)
        if self._examine(THOROUGH, known=self._start is not None) and progress.smallest >= 0.0:
            progress.stage, progress.exact = ENDED, 1
            return
        progress.stage, bed.finders.exact = PRESSING, False
        bed.keep_forces(np.zeros((bed.m, 3)))

    def _press(self) -> None:
        """Make a step to the stress, and examine the grains where they hardly move any more."""
        progress, bed = self.progress, self.bed
        size, exact = progress.mobility, bool(progress.exact)
        most = self.pace.strain * SLOWER**progress.partings
        bed.find(TRIANGLES.margin if exact else MARGIN, KEPT)
        deepest = -float(bed.gap.min(initial=0.0))
        load = self.stress * bed.assembly.container.volume
        modes = evenly(self.modes, load)
        free = float(np.abs(linear.matmul(modes, load)).max())
        forces, accelerations = pressed_forces(
            bed, modes * (most / (size * free)), load, openness=bed.gap / size, friction=self.friction,
            skin=SOFTNESS / size, tolerance=TOLERANCE,
            iterations=MORE if progress.partings else int(np.clip(ITERATIONS * math.sqrt(size), FEWEST, MANY)),
        )  # fmt: skip
        bed.keep_forces(forces)
        self._note(forces)
        # gaps of a part of a step are between those before it and after it
        strain = accelerations[-1] * size
        part = min(1.0, LARGEST * most / max(float(np.abs(strain).max()), 1e-300))
        yz, xz, xy = part * strain[3:]
        motion = accelerations * (part * size)
        # the edges of a cell that tilts turn, so that the first one stays along x
        motion[:-1, 3:] += bed.movable[:, None] * (0.5 * np.array([-yz, xz, -xy]))
        bed.move(motion, NEAR if exact else FAR)
        self._deform(np.diag(1.0 + part * strain[:3]) + np.array([[0.0, xy, xz], [0.0, 0.0, yz], [0.0, 0.0, 0.0]]))
        if deepest > DEEP or np.abs(strain).max() < CALM * most or self._goes_around():
            progress.mobility = max(LAST, self.pace.shrink * size)
        stuck = deepest > STUCK and size == LAST and not self._surfaces
        last = progress.step + 1 >= self.most_steps or (stuck and progress.partings == PARTINGS)
        progress.yields = int(self._yields(last=last or progress.step + 1 + self._creeping >= self.most_steps))
        last = last or bool(progress.yields)
        if stuck and not last:
            self._part()
            bed.keep_forces(np.zeros((bed.m, 3)))
            progress.partings, progress.mobility = progress.partings + 1, AFRESH
            return
        if not last and (progress.mobility > EXAMINED or progress.step % EVERY):
            return
        good = self._examine(QUICK)
        if good and self._surfaces and not exact:
            progress.stage = CLOSING
            return
        if progress.smallest < 0.0 and good:
            part_grains(bed, PARTED, ROUNDS)
            good = self._examine(QUICK) and progress.smallest >= 0.0
        moved = last and not good and (progress.smallest < 0.0 or exact < self._surfaces)
        if moved:
            self._part()
        if good or last:
            # where nothing has moved since, the forces are at least as good afterwards
            self._examine(THOROUGH, known=not moved)
            progress.stage = ENDED

    def _deform(self, gradient: Floats) -> None:
        """Deform the container by an upper triangular matrix (3, 3), and move the centroids with it.

        Raises
        ------
        InputError
            If it becomes shorter than a fixed grain is long.
        """
        bed, total = self.bed, linear.matmul(gradient, self.progress.gradient)
        container = deformed(self.container, total)
        short = self._least * ROUNDED - np.ptp(container.bounds, axis=0)
        if (axis := int(short.argmax())) < bed.assembly.dimension and short[axis] > 0.0:
            name = "xyz"[axis]
            raise InputError(
                f"the container has become {self._least[axis]:.3g} median diameters long along {name}, as long as a "
                f"fixed grain is, before the {int(bed.movable.sum())} free grains bear the stress: take more of these, "
                f"leave {name} out of axes, or give smaller fixed grains"
            )
        self.progress.gradient = total
        bed.deform(gradient, container)
        pushed = pushed_inside(_fixed_in(bed, self._fixed))
        bed.grains.way[self._fixed] += linear.norm(pushed - bed.grains.position[self._fixed], axis=1)
        bed.grains.position[self._fixed] = pushed

    def _part(self) -> None:
        """Part grains that are left deep in each other or without balance; if they have no room, widen the container.

        Raises
        ------
        VoxgranError
            If they overlap even so.
        """
        bed = self.bed
        self.progress.exact = int(self._surfaces)
        bed.finders.exact = self._surfaces
        for _ in range(WIDENINGS):
            part_grains(bed, PARTED, ROUNDS)
            if (smallest := self._smallest_gap()) >= 0.0:
                return
            self._deform(np.diag(np.where(self._moves, 1.0 + WIDENED * max(-smallest, PARTED), 1.0)))
        raise VoxgranError(
            f"grains overlap by {-smallest:.2g} median diameters after {self.progress.step + 1} steps, although the "
            "container was widened: begin with grains that are apart, or ask for more equal stresses"
        )

    def _goes_around(self) -> bool:
        """Return whether a cell under an isotropic stress has gone on changing its shape, for long, but not its volume.

        Few grains that are a crystal would do so for ever with long steps.
        """
        fraction, isotropic = self.progress.path[:, 0], not np.ptp(self.stress[:3][self._moves])
        return bool(isotropic and fraction[-2 * WINDOW :].max() <= fraction[: -2 * WINDOW].max(initial=0.0))

    def _yields(self, *, last: bool) -> bool:
        """Return whether the container has sheared for long without a change of volume, or too far with one.

        After the last step, and those after which others end, it is enough that they have borne more equal stresses.
        """
        progress, d = self.progress, self.bed.assembly.dimension
        factors, moves = progress.gradient.diagonal(), self._moves
        strain = libm.log(factors / progress.before)[:d]
        if abs(strain.sum()) > SAME_VOLUME:
            progress.before = factors.copy()
        asked = self.stress[:3][moves]
        less = last and self._ratio() > BORNE * float(asked.min() / asked.max())
        far = np.ptp(asked) and (less or np.ptp(libm.log(factors[moves])) > FLOWED)
        return bool(far) or (abs(strain.sum()) <= SAME_VOLUME and float(np.ptp(strain)) > SHEARED)

    def _ratio(self) -> float:
        """Return the ratio of the least to the largest axial stress, the mean of the last steps; 1 before the first."""
        stress = self.progress.path[-WINDOW:, 1 : 1 + self.bed.assembly.dimension].sum(axis=0)
        return float(stress.min() / stress.max()) if stress.max(initial=0.0) > 0.0 else 1.0

    def _close(self) -> None:
        """Part surfaces that are not proven to be separate; then go on with the contacts of their triangles."""
        progress = self.progress
        wrong = close_round(self.bed, first=progress.rounds == 0)
        progress.rounds += 1
        if not wrong or progress.rounds >= ROUNDS:
            progress.stage, progress.exact, self.bed.finders.exact = PRESSING, 1, True
            progress.mobility = LAST

    def _examine(self, rounds: int, *, known: bool = False) -> bool:
        """Note how well forces at the contacts balance the grains and the stress; return whether well enough.

        Whether the surfaces are apart is noted too.  known: whether nothing has moved since the last examination.
        """
        progress, bed = self.progress, self.bed
        smallest = self._smallest_gap()
        load = self.stress * bed.assembly.container.volume
        found = balance_grains(
            bed, self.modes, load, friction=self.friction, tolerance=RESIDUAL, rounds=rounds, known=known
        )
        progress.residual = np.maximum(found.residual, found.residual_torque)
        progress.bearing = found.bearing.astype(np.float64)
        progress.moving, progress.missed = found.moving, found.missed
        progress.smallest = smallest
        balanced = bool(progress.moving <= 1.0 - self.how.rest and progress.missed <= STRESS_MET)
        progress.proven = int(balanced and smallest >= 0.0)
        return balanced

    def _smallest_gap(self) -> float:
        """Find contacts, and return the smallest gap; grains of which surfaces cross have one below 0."""
        bed = self.bed
        bed.find(TOUCHING, 0.0)
        smallest = float(bed.gap.min(initial=TOUCHING))
        return min(smallest, -TOUCHING) if bed.finders.crossing(bed.pairs, bed.grains) else smallest

    def _note(self, forces: Floats) -> None:
        """Add a row to the path."""
        row = [self._solid_fraction, *np.diag(stress_of(self.bed, forces))]
        self.progress.path = np.vstack([self.progress.path, row])


def _with_walls(friction: float | Materials | None, assembly: Assembly) -> float | Materials:
    """Return the friction, which is less at walls where grains would wedge in their corners with it."""
    friction = USUAL_FRICTION if friction is None else friction
    if isinstance(friction, Materials) or friction <= AT_WALLS or not boundary_of(assembly.container).walls:
        return friction
    grains, walls = Material(friction=friction), Material(friction=AT_WALLS)
    return Materials({"grains": grains, "walls": walls}, shapes="grains", walls="walls")


_STEPS = {START: Compressor._begin, PRESSING: Compressor._press, CLOSING: Compressor._close}


def _fixed_in(bed: Bed, fixed: Integers) -> Assembly:
    """Return the fixed grains (k,) of a bed, where they are now."""
    assembly, rows = bed.assembly, bed.order[fixed]
    return Assembly(
        assembly.shapes, assembly.shape_id[rows], assembly.scale[rows], bed.grains.position[fixed],
        assembly.orientation[rows], assembly.container,
    )  # fmt: skip
