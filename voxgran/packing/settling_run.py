"""The run of beds that settle: states with checkpoints, steps as attempts of the driver, and the packing at the end."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran._base.checkpoint import check_held
from voxgran._base.config import to_mapping
from voxgran._base.errors import NAMED, CheckpointError, InputError
from voxgran.contacts.assembly import Assembly
from voxgran.contacts.assembly import Lid as LidPlane
from voxgran.contacts.forces import LID, WALL, ContactForces
from voxgran.contacts.manifolds.rows import ARM_I, GAP, NORMAL
from voxgran.containers.gravity import main_axis
from voxgran.packing.beds.met import MetBed
from voxgran.packing.beds.search import SoughtBed
from voxgran.packing.driver import Drive, drive
from voxgran.packing.grains import STOP_REASONS
from voxgran.packing.method import Array, Cost, PackingMethod, RunState
from voxgran.packing.model import Packing
from voxgran.packing.problem import Problem
from voxgran.packing.start import Start
from voxgran.settling.compression import Compressor
from voxgran.settling.equilibrium import carried_by
from voxgran.settling.examination import RESIDUAL, TOUCHING
from voxgran.settling.materials import Materials, friction_of
from voxgran.settling.parameters import Compression, Settling
from voxgran.settling.stages import Settler

#: what moves the grains of a run, step by step
Moving: TypeAlias = Settler | Compressor | SoughtBed | MetBed
#: bytes of a grain while it settles: pairs, contacts and their copies (measured)
GRAIN_BYTES = 8000
#: reasons of a method that hold on when its bed has settled
KEPT_REASONS = ("full", "saturated", "interrupted")
#: depth of an overlap that can be parted, in diameters of the smaller grain
DEEPEST = 0.5


def with_settling(method: PackingMethod, how: Settling) -> PackingMethod:
    """Return a packing method whose packings settle: its attempts, and then steps of one attempt a grain each."""
    return followed(
        method, lambda problem, packed: None if packed.gravity is None else begun(packed, how, problem.seed), finished
    )


def followed(
    method: PackingMethod,
    begin: Callable[[Problem, Packing], "SettleState | None"],
    end: Callable[[Packing, "SettleState"], Packing],
) -> PackingMethod:
    """Return a packing method after which all grains move.

    begin: first state of that, of a task and its packing; None where the grains stay.  end: the packing at the end.
    """

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
            first = begin(problem, packed) if packed.movable.any() else None
            if first is None:
                state.stop_reason = state.inner.stop_reason
                return state
            state.begin(first)
        outer = state.outer
        assert outer is not None
        advance_settling(problem, outer, attempts)
        state.done, state.total = state.inner.done + outer.done, state.inner.total + outer.total
        state.stop_reason = outer.stop_reason
        return state

    def finish(problem: Problem, state: SettledState) -> Packing:
        packed = method.finish(problem, state.inner)
        if state.held is not None and (first := begin(problem, packed)) is not None:
            # a checkpoint of a run that had ended: nothing was advanced since
            state.begin(first)
        return packed if state.outer is None else end(packed, state.outer)

    def cost(problem: Problem) -> Cost:
        inner = method.cost(problem)
        return replace(inner, memory=max(inner.memory, GRAIN_BYTES * problem.count))

    return replace(method, prepare=prepare, advance=advance, finish=finish, cost=cost)


def moved_alone(
    name: str,
    packing: Packing,
    problem: Problem,
    begin: Callable[[Packing], "SettleState"],
    end: Callable[[Packing, "SettleState"], Packing],
    how: Drive,
) -> Packing:
    """Return a packing whose grains have moved in a run of their own, called by a name; all else as `followed` says."""
    method = PackingMethod(
        name=name,
        summary="",
        source="",
        parameters=type(problem.parameters),
        prepare=lambda _: begin(packing),
        advance=advance_settling,
        finish=lambda _, state: end(packing, state),
        cost=lambda _: Cost(memory=GRAIN_BYTES * packing.count, attempts=0),
    )
    return method.finish(problem, drive(method, problem, how))


def problem_alone(packing: Packing, how: Settling | Compression, seed: int = 0) -> Problem:
    """Return the task of moving the grains of a packing, from which the fingerprint of its checkpoints is made."""
    assembly, unit = normalized_assembly(packing)
    # gravity is a part of the task, and so is which grains are fixed
    pull = () if packing.gravity is None else (np.array(packing.gravity),)
    return Problem(
        shapes=packing.shapes,
        shape_id=packing.shape_id,
        diameter=assembly.diameters,
        container=assembly.container,
        parameters=how,
        seed=seed,
        unit_length=unit,
        original=packing.shapes,
        start=Start(np.vstack([assembly.position, *pull, assembly.position[~assembly.movable]]), assembly.orientation),
        unit=packing.unit,
        density=packing.density,
    )


@dataclass(slots=True)
class SettleState:
    """State of a bed that settles, as the driver takes it."""

    settler: Moving
    done: int = 0
    total: int = 0
    stop_reason: str = ""
    derived: dict[str, Any] = field(default_factory=dict)
    # what is being done, for progress
    stage: str = "settling"

    @property
    def told(self) -> str:
        """How far the work is, in words."""
        return f"step {self.steps}, {self.settler.told}"

    @property
    def steps(self) -> int:
        """Steps that were made, those of former tries included."""
        settler = self.settler
        return settler.progress.step + (settler.former_steps if isinstance(settler, SoughtBed | MetBed) else 0)

    @property
    def arrays(self) -> dict[str, Array]:
        """Arrays that a checkpoint holds."""
        return self.settler.arrays

    @property
    def counters(self) -> dict[str, int | None]:
        """Counters that a checkpoint holds."""
        return dict(self.settler.counters)

    def restore(self, arrays: dict[str, Array], counters: dict[str, Any]) -> None:
        """Take over the arrays and counters of a checkpoint.

        Raises
        ------
        CheckpointError
            If they are not as a run leaves them.
        """
        settler = self.settler
        if isinstance(settler, MetBed):
            settler.begin_as(counters)
        check_held((settler.arrays, settler.counters), arrays, counters, settler.declared, settler.rule)
        settler.restore(arrays, counters)
        if settler.ended and not self.stop_reason:
            raise CheckpointError("the checkpoint tells no reason why the run ended: start anew without it")


#: how methods end whose grains settle, and a run that goes on; checkpoints hold the places in this list
ENDS = (*(reason for reason in STOP_REASONS if reason not in ("compressed", "yielded")), "")
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
        return "packing" if self.outer is None else self.outer.stage

    @property
    def told(self) -> str:
        """How far the settling is, in words; empty before it begins."""
        return "" if self.outer is None else self.outer.told

    @property
    def steps(self) -> int:
        """Attempts of the method and steps of the settling that were made."""
        return self.inner.done + (0 if self.outer is None else self.outer.steps)

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
        ended = ENDS.index(inner.stop_reason)
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
        self.inner.stop_reason = ENDS[int(made.pop("packing_ended"))]
        self.inner.restore({name: arrays[name] for name in arrays if not name.startswith(PREFIX)}, made)
        self.outer, self.held = None, (outer[0], outer[1]) if outer[0] else None

    def begin(self, outer: SettleState) -> None:
        """Begin to settle, or go on where a checkpoint left off."""
        self.outer = outer
        if self.held is not None:
            arrays, counters = self.held
            outer.done, outer.total = (counters.pop(name, None) or 0 for name in ("done", "total"))
            outer.stop_reason = self.stop_reason
            outer.restore(arrays, counters)
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
    lidded = with_lid(assembly, how, gravity)
    settler = begin_settling(
        how, lambda tried: Settler(lidded, tried, gravity, seed=seed), lambda settler: _moved(packing, settler)
    )
    refuse_deep(settler)
    return SettleState(settler, total=settler.most_steps * packing.count)


def begin_settling(
    how: Settling, begin: Callable[[Settling], Settler], packing_of: Callable[[Settler], Packing]
) -> Settler | SoughtBed:
    """Return what settles grains, again and again where a solid fraction is asked for.

    begin: parameters to a Settler of the grains.  packing_of: Settler to the packing of its grains.
    """
    return begin(how) if how.solid_fraction is None else SoughtBed(how, begin, packing_of)


def refuse_deep(settler: Moving) -> None:
    """Refuse grains that overlap so deep that they cannot be parted.

    Raises
    ------
    InputError
        If a pair overlaps by more than half the diameter of the smaller grain.
    """
    i, j, depth = settler.bed.deep_overlaps(DEEPEST)
    if len(i):
        # a pair may have several contacts
        told = [f"{a} and {b}" for a, b in dict.fromkeys(map(tuple, np.sort([i, j], axis=0).T.tolist()))]
        pairs = ", ".join(told[:NAMED])
        more = f" and {len(told) - NAMED} more pairs" if len(told) > NAMED else ""
        raise InputError(
            f"grains {pairs}{more} overlap by {depth.max():.2g} of their diameter: at most {DEEPEST:g} can be parted; "
            "move them apart"
        )


def with_lid(assembly: Assembly, how: Settling, gravity: Floats) -> Assembly:
    """Return the assembly with a lid above its grains, if there is to be one."""
    if how.lid is None or not assembly.count:
        return assembly
    assembly.refuse_fixed("a bed under a lid")
    up = -main_axis(gravity).astype(np.float64)
    return replace(
        assembly, lid=LidPlane(up, float((linear.matmul(assembly.position, up) + assembly.bounding_radii).max()))
    )


def lid_of(settler: Moving, unit: float) -> LidPlane | None:
    """Return the lid where it lies now, in the unit of lengths in which the median diameter is `unit`."""
    lid = settler.bed.assembly.lid
    return None if lid is None else LidPlane(lid.normal, settler.bed.lid_level * unit)


def normalized_assembly(packing: Packing) -> tuple[Assembly, float]:
    """Return the grains of a packing with lengths in median diameters, without lid, and the median diameter."""
    unit = packing.median_diameter
    arrays = (packing.shapes, packing.shape_id, packing.scale / unit, packing.position / unit, packing.orientation)
    return Assembly(*arrays, packing.container.scaled(1.0 / unit), packing.density, fixed=packing.fixed), unit


def advance_settling(problem: Problem, state: SettleState, attempts: int) -> SettleState:
    """Make a step if it is due within the attempts: one attempt a grain."""
    del problem
    settler = state.settler
    many = max(settler.bed.assembly.count, 1)
    due = (state.steps + 1) * many
    if state.done + attempts < due:
        state.done += attempts
        return state
    # a step takes about as long as a chunk of attempts of other methods
    state.done = max(due, state.done)
    settler.step()
    state.total = max(state.done, settler.most_steps * many)
    if settler.ended:
        state.stop_reason = settler.reason
    return state


def finished(packing: Packing, state: SettleState) -> Packing:
    """Return the packing with its grains where they settled to."""
    settler = state.settler
    reason = state.stop_reason or "interrupted"
    moved = replace(
        _moved(packing, settler),
        stop_reason=packing.stop_reason if packing.stop_reason in KEPT_REASONS else reason,
        provenance={**packing.provenance, "settling": {"parameters": to_mapping(settler.how), **settler.report}},
    )
    return contact_forces(moved, settler)


def _moved(packing: Packing, settler: Moving) -> Packing:
    """Return a packing with its grains where they are in the bed of a settler, without forces."""
    unit = packing.median_diameter
    position, orientation = settler.bed.poses()
    position *= unit
    if settler.ended and settler.progress.step == 1:
        # it rested already: not even the last bits change
        position, orientation = packing.position, packing.orientation
    lid = lid_of(settler, unit)
    return replace(
        packing, position=position, orientation=orientation, lid=lid, contact_gap=TOUCHING * unit, forces=None
    )


def no_forces(friction: float | Materials | None) -> ContactForces:
    """Return the forces of a bed without grains."""
    none, nobody, vectors = np.zeros(0), np.zeros(0, dtype=np.int64), np.zeros((0, 3))
    return ContactForces(
        i=nobody, j=nobody, point=vectors, normal=vectors, force=vectors, gap=none, residual=none,
        rattler=np.zeros(0, dtype=bool), friction=none if isinstance(friction, Materials) else friction,
    )  # fmt: skip


def contact_forces(packing: Packing, settler: Moving) -> Packing:
    """Return the packing, whose grains are those of a settler, with the forces at their contacts once it has ended."""
    bed = settler.bed
    if not packing.count:
        return replace(packing, forces=no_forces(settler.how.friction))
    if not settler.ended:
        return packing
    # the bed has the unit of the grains that were asked for, of which some may be left out
    median = float(np.median(bed.diameter))
    unit, forces = packing.median_diameter / median, bed.forces() / median**packing.dimension
    residual = bed.in_order(settler.progress.residual)
    rattler = (residual <= RESIDUAL) & (bed.in_order(carried_by(bed, bed.forces())) <= RESIDUAL) & packing.movable
    return with_known_forces(packing, settler, forces, unit, residual=residual, rattler=rattler)


def with_known_forces(packing: Packing, settler: Any, forces: Floats, unit: float, **known: Any) -> Packing:
    """Return the packing, whose grains are those of a settler that has ended, with forces (m, 3) at its contacts.

    unit: unit of length of the bed, in the unit of the packing.  known: residuals, rattlers and stress.
    """
    bed, row = settler.bed, settler.bed.rows.row[: settler.bed.m]
    i, j = bed.contact_grains(wall=WALL, lid=LID)
    made = ContactForces(
        i=i,
        j=j,
        point=packing.position[i] + row[:, ARM_I : ARM_I + 3] * unit,
        normal=row[:, NORMAL : NORMAL + 3],
        force=forces,
        gap=row[:, GAP] * unit,
        friction=bed.friction_at(friction_of(settler.how.friction, bed.assembly)),
        **known,
    )
    return replace(packing, forces=made)
