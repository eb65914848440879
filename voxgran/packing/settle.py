"""`settle`: from a packing to a bed at rest, as a step of its own or after a packing method.

The work is that of :mod:`voxgran.settling`; here it becomes a run like that of a packing method, with checkpoints,
signals and progress.
"""

import os
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arrays import Floats, Integers, as_count
from voxgran._base.calls import explained
from voxgran._base.config import from_mapping, to_mapping
from voxgran._base.errors import InputError, PackingWarning, shown
from voxgran._base.progress import OnStep
from voxgran.contacts.assembly import Assembly
from voxgran.contacts.assembly import Lid as LidPlane
from voxgran.contacts.forces import LID, WALL, ContactForces
from voxgran.containers.model import Container, check_container
from voxgran.containers.one_unit import in_one_unit
from voxgran.packing.driver import Drive, check_drive, drive
from voxgran.packing.gravity import as_down, main_axis
from voxgran.packing.method import Array, Cost, PackingMethod, RunState
from voxgran.packing.model import STOP_REASONS, Packing, check_packing
from voxgran.packing.problem import Problem
from voxgran.packing.start import Start
from voxgran.settling.contact_rows import ARM_I, GAP, NORMAL
from voxgran.settling.equilibrium import carried_by
from voxgran.settling.parameters import Lid, Settling, Shaking
from voxgran.settling.stages import RESIDUAL, TOUCHING, Settler

#: bytes of a grain while it settles: pairs, contacts and their copies (measured)
GRAIN_BYTES = 8000
#: reasons of a method that hold on when its bed has settled
KEPT_REASONS = ("full", "saturated", "interrupted")
#: depth of an overlap that can be parted, in diameters of the smaller grain
DEEPEST = 0.5
#: grains that a message names
NAMED = 5


@explained(hint="settle(packing, friction=0.5)")
def settle(
    packing: Packing,
    *,
    friction: float = 0.5,
    restitution: float = 0.0,
    shaking: Shaking | Mapping[str, Any] | None = None,
    lid: Lid | Mapping[str, Any] | None = None,
    container: Container | None = None,
    gravity: ArrayLike | None = None,
    seed: int = 0,
    fall_time: float | None = None,
    rest: float = 0.95,
    parts: Literal["exact", "hulls"] = "exact",
    checkpoint: str | os.PathLike[str] | None = None,
    resume: bool = False,
    on_step: OnStep | None = None,
) -> Packing:
    """Let the grains of a packing come to rest under gravity, by their true shapes.

    Grains fall with inertia and friction until they hardly sink, then move in quasi-static steps until forces at their
    contacts balance their weights. No grains overlap at the end. A bed that rests already stays as it is.

    Parameters
    ----------
    packing : Packing
        The grains, made by any method, loaded or put together by hand. They may overlap.
    friction : float
        Coulomb coefficient of friction between grains and at walls, at least 0.
    restitution : float
        Ratio of the velocities after and before an impact, along the normal, from 0 to 1.
    shaking : Shaking or mapping, optional
        Random accelerations after the fall, which make the bed denser; default: none.
    lid : Lid or mapping, optional
        Plate that lies on the bed; default: none.
    container : Container, optional
        Container in which the grains settle, if it is not that of the packing; all centroids lie in it.
    gravity : str or (3,) array_like of float, optional
        Direction in which gravity acts, an axis such as ``"-z"`` or any vector; default: that of the packing.
    seed : int
        Seed of the random accelerations of shaking.
    fall_time : float, optional
        Longest time of the fall with inertia, in sqrt(d / g) with the median diameter d; default: until the mean grain
        sinks by less than 0.05 d in that time unit. Beds that move for longer become denser.
    rest : float
        Share of the grains that must be proven to rest so that the bed counts as settled.
    parts : {"exact", "hulls"}
        Shapes that settle: the true ones, or the convex hulls of meshes that are not convex, which is faster.
    checkpoint : path-like, optional
        File for checkpoints, written every ten seconds, when the run is asked to stop, and at the end.
    resume : bool
        Whether to go on from that file where it is there.
    on_step : callable, optional
        Called with each :class:`Step` of the work.

    Returns
    -------
    Packing
        The same grains, in the same order. Its stop reason is ``"settled"`` where at least the share `rest` of the
        grains is proven to rest, else ``"steps"``; ``"full"`` and ``"saturated"`` stay. Its `forces` are those that
        balance the grains.

    Raises
    ------
    InputError
        If a value breaks a rule, there is no gravity, grains are outside of the container or overlap so deep that they
        cannot be parted, or a shape is an open surface.
    CheckpointError
        If the checkpoint is damaged or belongs to another run.
    OutputError
        If the checkpoint cannot be written.
    InUseError
        If another process writes that checkpoint.
    Interrupted
        On SIGINT or SIGTERM, after a checkpoint was written; on a second signal, at once.

    Warns
    -----
    PackingWarning
        If fewer grains than asked for are proven to rest, or some could not be parted.

    See Also
    --------
    voxgran.equilibrium : proves that a bed rests.
    voxgran.verify : proves that nothing overlaps.

    Notes
    -----
    The fall is contact dynamics with small substeps (Moreau 1988, doi:10.1007/978-3-7091-2624-0_1; Macklin et al.
    2019, doi:10.1145/3309486.3340247); grains fall no faster than sqrt(g d). The quasi-static steps solve for contact
    forces with Coulomb friction by Gauss-Seidel sweeps with momentum.

    Examples
    --------
    >>> import voxgran as vg
    >>> box = vg.Box((4, 4, 8), periodic="xy")
    >>> loose = vg.pack(vg.make_shape("sphere"), box, method="rsa", count=50)
    >>> vg.settle(loose, gravity="-z").stop_reason
    'settled'
    """
    check_packing(packing, "packing")
    given = {
        "friction": friction,
        "restitution": restitution,
        "shaking": shaking,
        "lid": lid,
        "fall_time": fall_time,
        "rest": rest,
        "parts": parts,
    }
    how = from_mapping(Settling, given, "settle")
    packing = _prepared(packing, container, gravity)
    check_drive(checkpoint, resume, on_step, None)
    seed = as_count(seed, "seed", at_most=None)
    if not packing.count:
        return replace(packing, stop_reason="settled")
    problem = _problem_of(packing, how, seed)
    method = PackingMethod(
        name="settle",
        summary="",
        source="",
        parameters=Settling,
        prepare=lambda _: begun(packing, how, problem.seed),
        advance=advance_settling,
        finish=lambda _, state: finished(packing, state, how),
        cost=lambda _: Cost(memory=GRAIN_BYTES * packing.count, attempts=0),
    )
    state = drive(method, problem, Drive(checkpoint, resume, on_step))
    settled = method.finish(problem, state)
    warn_of_unrest(settled)
    return settled


def _prepared(packing: Packing, container: Container | None, gravity: ArrayLike | None) -> Packing:
    """Return the packing in another container and under another gravity, where they are given.

    Raises
    ------
    InputError
        If there is no gravity, or the centroid of a grain is outside of the container.
    """
    if container is not None:
        check_container(container)
        shapes, container, _ = in_one_unit(packing.shapes, container, packing.unit)
        packing = replace(packing, container=container, shapes=shapes)
    if gravity is not None:
        packing = replace(packing, gravity=as_down(gravity, packing.container))
    if packing.gravity is None:
        raise InputError(
            "packing.gravity is None: grains settle under gravity only; give gravity='-z' along an axis that has walls"
        )
    if packing.count:
        beyond = packing.container.signed_distance(packing.position)
        outside = np.flatnonzero(beyond > 0.0)
        if len(outside):
            raise InputError(
                f"{named_grains(outside)} of the packing: centroids must lie in the container; move them, or give a "
                "larger container"
            )
    return packing


def named_grains(grains: Integers) -> str:
    """Return grains by their numbers, at most five of them."""
    names = ", ".join(str(grain) for grain in grains[:NAMED])
    more = f" and {len(grains) - NAMED} more" if len(grains) > NAMED else ""
    return f"{'grain' if len(grains) == 1 else 'grains'} {names}{more}"


def _problem_of(packing: Packing, how: Settling, seed: int) -> Problem:
    """Return the task of settling a packing, from which the fingerprint of its checkpoints is made."""
    assembly, unit = normalized_assembly(packing)
    return Problem(
        shapes=packing.shapes,
        shape_id=packing.shape_id,
        diameter=assembly.diameters,
        container=assembly.container,
        parameters=how,
        seed=seed,
        unit_length=unit,
        original=packing.shapes,
        # gravity is a part of the task
        start=Start(np.vstack([assembly.position, np.array(packing.gravity)]), assembly.orientation),
        unit=packing.unit,
        density=packing.density,
    )


def warn_of_unrest(packing: Packing) -> None:
    """Warn where fewer grains than asked for are proven to rest, or some still overlap."""
    record = packing.provenance.get("settling")
    if record is None or packing.stop_reason == "interrupted":
        return
    asked = record["parameters"]["rest"]
    if record["smallest_gap"] < 0.0:
        text = f"grains still overlap by up to {-record['smallest_gap']:.2g} median diameters: settle them once more"
        warnings.warn(text, PackingWarning, stacklevel=3)
    elif record["resting"] < asked:
        text = (
            f"{record['resting']:.1%} of the grains are proven to rest, where {asked:.1%} are asked for: settle them "
            "once more, or take a larger friction"
        )
        warnings.warn(text, PackingWarning, stacklevel=3)


def as_settling(asked: Any) -> Settling | None:
    """Return the parameters of settling that True, False, a mapping or an object of them stand for; None for none.

    Raises
    ------
    InputError
        If it is something else, or a value breaks a rule.
    UnknownNameError
        If a key is unknown.
    """
    if isinstance(asked, Settling):
        return asked
    if isinstance(asked, Mapping):
        return from_mapping(Settling, asked, "settle")
    if isinstance(asked, bool | np.bool_):
        return Settling() if asked else None
    raise InputError(f"settle is {shown(asked)}: it must be True, False or parameters such as dict(friction=0.5)")


def with_settling(method: PackingMethod, how: Settling) -> PackingMethod:
    """Return a packing method whose packings settle: its attempts, and then steps of one attempt a grain each."""

    def prepare(problem: Problem) -> RunState:
        inner = method.prepare(problem)
        return SettledState(inner, done=inner.done, total=inner.total)

    def advance(problem: Problem, state: SettledState, attempts: int) -> RunState:
        if not state.inner.stop_reason:
            state.inner = method.advance(problem, state.inner, attempts)
            state.done, state.total = state.inner.done, state.inner.total
            return state
        if state.outer is None:
            packed = method.finish(problem, state.inner)
            if packed.gravity is None or not packed.count:
                state.stop_reason = state.inner.stop_reason
                return state
            state.begin(begun(packed, how, problem.seed))
        advance_settling(problem, state.outer, attempts)
        state.done, state.total = state.inner.done + state.outer.done, state.inner.total + state.outer.total
        state.stop_reason = state.outer.stop_reason
        return state

    def finish(problem: Problem, state: SettledState) -> Packing:
        packed = method.finish(problem, state.inner)
        if state.held is not None:
            # a checkpoint of a run that had ended: nothing was advanced since
            state.begin(begun(packed, how, problem.seed))
        return packed if state.outer is None else finished(packed, state.outer, how)

    def cost(problem: Problem) -> Cost:
        inner = method.cost(problem)
        return replace(inner, memory=max(inner.memory, GRAIN_BYTES * problem.count))

    return replace(method, prepare=prepare, advance=advance, finish=finish, cost=cost)


@dataclass(slots=True)
class SettleState:
    """State of a bed that settles, as the driver takes it."""

    settler: Settler
    done: int = 0
    total: int = 0
    stop_reason: str = ""
    derived: dict[str, Any] = field(default_factory=dict)

    @property
    def stage(self) -> str:
        """What is being done, for progress."""
        return "settling"

    @property
    def arrays(self) -> dict[str, Array]:
        """Arrays that a checkpoint holds."""
        return self.settler.arrays

    @property
    def counters(self) -> dict[str, int | None]:
        """Counters that a checkpoint holds."""
        return dict(self.settler.counters)

    def restore(self, arrays: dict[str, Array], counters: dict[str, Any]) -> None:
        """Take over the arrays and counters of a checkpoint."""
        self.settler.restore(arrays, counters)


#: prefix of what a checkpoint holds of the settling
PREFIX = "settling_"


@dataclass(slots=True)
class SettledState:
    """State of a packing method and of the settling that follows it."""

    inner: RunState
    outer: SettleState | None = None
    done: int = 0
    total: int = 0
    stop_reason: str = ""
    # what a checkpoint held of the settling, until its state is made
    held: tuple[dict[str, Array], dict[str, Any]] | None = None

    @property
    def stage(self) -> str:
        """What is being done, for progress."""
        return "packing" if self.outer is None else "settling"

    @property
    def derived(self) -> dict[str, Any]:
        """Data that follow from the other fields."""
        return self.inner.derived

    @derived.setter
    def derived(self, value: dict[str, Any]) -> None:
        self.inner.derived = value

    @property
    def arrays(self) -> dict[str, Array]:
        """Arrays that a checkpoint holds."""
        outer = {} if self.outer is None else self.outer.arrays
        return {**self.inner.arrays, **{PREFIX + name: array for name, array in outer.items()}}

    @property
    def counters(self) -> dict[str, int | None]:
        """Counters that a checkpoint holds; those of the settling begin with its prefix."""
        inner = self.inner
        ended = (*STOP_REASONS, "").index(inner.stop_reason)
        made = {"packing_done": inner.done, "packing_total": inner.total, "packing_ended": ended}
        if self.outer is None:
            return {**inner.counters, **made}
        outer = {**self.outer.counters, "done": self.outer.done, "total": self.outer.total}
        return {**inner.counters, **made, **{PREFIX + name: count for name, count in outer.items()}}

    def restore(self, arrays: dict[str, Array], counters: dict[str, Any]) -> None:
        """Take over the arrays and counters of a checkpoint; those of the settling when its state is made."""
        outer = [
            {name.removeprefix(PREFIX): held[name] for name in held if name.startswith(PREFIX)}
            for held in (arrays, counters)
        ]
        made = {name: counters[name] for name in counters if not name.startswith(PREFIX)}
        self.inner.done, self.inner.total = int(made.pop("packing_done")), int(made.pop("packing_total"))
        self.inner.stop_reason = (*STOP_REASONS, "")[int(made.pop("packing_ended"))]
        self.inner.restore({name: arrays[name] for name in arrays if not name.startswith(PREFIX)}, made)
        self.outer, self.held = None, (outer[0], outer[1]) if outer[0] else None

    def begin(self, outer: SettleState) -> None:
        """Begin to settle, or go on where a checkpoint left off."""
        self.outer = outer
        if self.held is not None:
            arrays, counters = self.held
            outer.done, outer.total = int(counters.pop("done")), int(counters.pop("total"))
            outer.restore(arrays, counters)
            outer.stop_reason = self.stop_reason
            self.held = None


def begun(packing: Packing, how: Settling, seed: int) -> SettleState:
    """Return the first state of the settling of a packing, which has grains and gravity.

    Raises
    ------
    InputError
        If grains overlap so deep that they cannot be parted, a shape is an open surface, or the walls of the container
        are not known.
    """
    assembly, _ = normalized_assembly(packing)
    gravity = np.array(packing.gravity, dtype=np.float64)
    settler = Settler(with_lid(assembly, how, gravity), how, gravity, seed=seed)
    _refuse_deep(settler)
    return SettleState(settler, total=settler.most_steps * packing.count)


def _refuse_deep(settler: Settler) -> None:
    """Refuse grains that overlap so deep that they cannot be parted.

    Raises
    ------
    InputError
        If a pair overlaps by more than half the diameter of the smaller grain.
    """
    i, j, depth = settler.bed.deep_overlaps(DEEPEST)
    if len(i):
        pairs = ", ".join(f"{a} and {b}" for a, b in zip(i[:NAMED], j[:NAMED], strict=True))
        more = f" and {len(i) - NAMED} more pairs" if len(i) > NAMED else ""
        raise InputError(
            f"grains {pairs}{more} overlap by {depth.max():.2g} of their diameter: at most {DEEPEST:g} can be parted; "
            "move them apart"
        )


def with_lid(assembly: Assembly, how: Settling, gravity: Floats) -> Assembly:
    """Return the assembly with a lid above its grains, if there is to be one."""
    if how.lid is None or not assembly.count:
        return assembly
    up = -main_axis(gravity).astype(np.float64)
    return replace(assembly, lid=LidPlane(up, float((assembly.position @ up + assembly.bounding_radii).max())))


def normalized_assembly(packing: Packing) -> tuple[Assembly, float]:
    """Return the grains of a packing with lengths in median diameters, without lid, and the median diameter."""
    unit = float(np.median(packing.diameters))
    arrays = (packing.shapes, packing.shape_id, packing.scale / unit, packing.position / unit, packing.orientation)
    return Assembly(*arrays, packing.container.scaled(1.0 / unit)), unit


def advance_settling(problem: Problem, state: SettleState, attempts: int) -> SettleState:
    """Make a step if it is due within the attempts: one attempt a grain."""
    del problem
    settler = state.settler
    many = max(settler.bed.count, 1)
    due = (settler.progress.step + 1) * many
    if state.done + attempts < due:
        state.done += attempts
        return state
    # a step takes about as long as a chunk of attempts of other methods
    state.done = due
    settler.step()
    state.total = max(state.done, settler.most_steps * many)
    if settler.ended:
        state.stop_reason = "settled" if settler.progress.proven else "steps"
    return state


def finished(packing: Packing, state: SettleState, how: Settling) -> Packing:
    """Return the packing with its grains where they settled to."""
    settler, unit = state.settler, float(np.median(packing.diameters))
    position, orientation = settler.bed.poses()
    position *= unit
    if settler.ended and settler.progress.step == 1:
        # it rested already: not even the last bits change
        position, orientation = packing.position, packing.orientation
    lid = settler.bed.moved_assembly().lid
    reason = state.stop_reason or "interrupted"
    moved = replace(
        packing,
        position=position,
        orientation=orientation,
        lid=None if lid is None else LidPlane(lid.normal, lid.level * unit),
        stop_reason=packing.stop_reason if packing.stop_reason in KEPT_REASONS else reason,
        contact_gap=TOUCHING * unit,
        forces=None,
        provenance={**packing.provenance, "settling": {"parameters": to_mapping(how), **settler.report}},
    )
    return contact_forces(moved, settler)


def contact_forces(packing: Packing, settler: Settler) -> Packing:
    """Return the packing, whose grains are those of a settler, with the forces at their contacts once it has ended."""
    bed = settler.bed
    if not settler.ended or not packing.count:
        return packing
    unit, forces, row = float(np.median(packing.diameters)), bed.forces(), bed.rows.row[: bed.m]
    i, j = bed.contact_grains(wall=WALL, lid=LID)
    residual = bed.in_order(settler.progress.residual)
    known = ContactForces(
        i=i,
        j=j,
        point=packing.position[i] + row[:, ARM_I : ARM_I + 3] * unit,
        normal=row[:, NORMAL : NORMAL + 3],
        force=forces,
        gap=row[:, GAP] * unit,
        residual=residual,
        rattler=(residual <= RESIDUAL) & (bed.in_order(carried_by(bed, forces)) <= RESIDUAL),
        friction=settler.how.friction,
    )
    return replace(packing, forces=known)
