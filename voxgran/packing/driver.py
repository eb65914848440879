"""Driver of packing methods: chunks of attempts, checkpoints, resume, signals and progress, once for all methods."""

import contextlib
import hashlib
import json
import logging
import math
import os
import time
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from voxgran._base.checkpoint import MOST, load_checkpoint, refuse_other_file, save_checkpoint
from voxgran._base.compiling.threads import using_threads
from voxgran._base.config import to_mapping
from voxgran._base.errors import CheckpointError, InputError, Interrupted, OutputError, shown
from voxgran._base.files import as_path, remove_drafts
from voxgran._base.guarded import reason_of
from voxgran._base.kernels import telling_of_compilation
from voxgran._base.lock import locked_file
from voxgran._base.progress import OnStep, Step, reported
from voxgran._base.stopping import Signals, Stopped, heed, stopping_when
from voxgran.packing.grains import STOP_REASONS
from voxgran.packing.method import PackingMethod, RunState
from voxgran.packing.model import Packing
from voxgran.packing.problem import Problem

log = logging.getLogger(__name__)

#: duration of a chunk, which has at most twice as many attempts as the one before, and attempts of the first chunk; no
#: result depends on them
CHUNK_SECONDS, FIRST_CHUNK = 0.25, 1
CHECKPOINT_SECONDS = 10.0
#: largest share of the time that checkpoints take
CHECKPOINT_SHARE = 0.05


class Recorder(Protocol):
    """Takes snapshots of a run."""

    def due(self, done: int) -> int:
        """Return the number of attempts after which the next snapshot is due."""

    def record(self, packing: Packing, done: int) -> None:
        """Take a snapshot after `done` attempts."""


@dataclass(slots=True)
class Drive:
    """Options of a run that do not change its result."""

    # written every ten seconds, when the run is asked to stop, and at the end; a large one less often, so that it takes
    # no more than a twentieth of the time
    checkpoint: str | os.PathLike[str] | None = None
    resume: bool = False  # whether to resume from the checkpoint if it exists
    on_step: OnStep | None = None  # called after each chunk
    chunk: int | None = None  # attempts per chunk; None adapts it to the clock
    time_limit: float | None = None  # seconds after which the run stops, though not before the first attempt
    recorder: Recorder | None = None  # receives the packing whenever a snapshot is due
    threads: int | None = None  # None: those of the call around it, or as many as processors
    started: float = field(default_factory=time.monotonic)


def drive(method: PackingMethod, problem: Problem, how: Drive) -> RunState:
    """Run a method until it stops; return its state, with `stop_reason` set.

    Raises
    ------
    CheckpointError
        If the checkpoint is damaged, belongs to another run, or is another file, which is not replaced.
    OutputError
        If the checkpoint cannot be written; the previous one is then still valid.
    InUseError
        If another process writes that checkpoint.
    InputError
        If the number of threads is no whole number above 0.
    Interrupted
        On SIGINT, SIGTERM or SIGHUP: after a checkpoint was written; before the first attempt, and on a second signal,
        at once.
    """
    how = replace(how, on_step=reported(how.on_step))
    told = telling_of_compilation(partial(_tell_of_kernels, how))
    if how.checkpoint is not None:
        refuse_other_file(how.checkpoint)
    with locked_file(how.checkpoint), using_threads(how.threads), told, Signals() as signals:
        state = method.prepare(problem)
        heed()
        mark = fingerprint(method, problem)
        if how.resume and how.checkpoint is not None and Path(how.checkpoint).exists():
            _restore(problem, state, how.checkpoint, mark)
        if not state.stop_reason:
            # derived data are computed here: nothing is lost if a signal ends this at once
            state = method.advance(problem, state, 0)
            heed()
            signals.patient = True
            keeper = _Keeper(problem, how.checkpoint, mark)
            state = _make_attempts(method, problem, state, how, keeper, signals)
            keeper.keep(state, at_once=True)
    if signals.number:
        raise Interrupted(_farewell(how, state), signals.number)
    if state.stop_reason and state.done and how.recorder is not None:
        how.recorder.record(method.finish(problem, state), state.done)
    state.stop_reason = state.stop_reason or "interrupted"
    return state


def _make_attempts(
    method: PackingMethod, problem: Problem, state: RunState, how: Drive, keeper: "_Keeper", signals: Signals
) -> RunState:
    """Return the state after all attempts, or those that were made before the run was asked to stop."""
    chunk, begin, moved = how.chunk or FIRST_CHUNK, _made(state), False

    def is_over() -> bool:
        late = how.time_limit is not None and time.monotonic() - how.started > how.time_limit
        # whoever goes on again and again with a short limit still gets to the end
        return signals.number != 0 or (late and moved)

    while not state.stop_reason and not is_over():
        began, before = time.monotonic(), state.done
        due = math.inf if how.recorder is None else how.recorder.due(state.done)
        with contextlib.suppress(Stopped), stopping_when(is_over):
            state = method.advance(problem, state, int(min(chunk, due - state.done)))
        moved = _made(state) > begin
        if how.chunk is None and state.done > before:
            share = CHUNK_SECONDS / max(time.monotonic() - began, 1e-6)
            chunk = int(np.clip((state.done - before) * share, 1, 2 * chunk))
        _tell(how, state)
        if how.recorder is not None and state.done >= due and not state.stop_reason:
            how.recorder.record(method.finish(problem, state), state.done)
        keeper.keep(state, at_once=False)
    return state


def _made(state: RunState) -> int:
    """Return how far a run is: in steps where grains settle, whose attempts only count until the next step is due."""
    made: int = getattr(state, "steps", state.done)
    return made


class _Keeper:
    """Writes checkpoints at limited intervals."""

    def __init__(self, problem: Problem, path: str | os.PathLike[str] | None, mark: str) -> None:
        self.problem, self.path, self.mark = problem, path, mark
        self.done, self.next = -1, time.monotonic() + CHECKPOINT_SECONDS
        if path is not None:
            remove_drafts(path)

    def keep(self, state: RunState, *, at_once: bool) -> None:
        """Write a checkpoint if it is due."""
        began = time.monotonic()
        if self.path is None or not (began > self.next or (at_once and self.done < state.done)):
            return
        try:
            _save(self.problem, state, self.path, self.mark)
        except OutputError as error:
            last = f"that after {self.done} attempts is still good" if self.done >= 0 else "there is none"
            raise OutputError(f"{error} (the checkpoint after {state.done} attempts; {last})") from error
        now = time.monotonic()
        self.done, self.next = state.done, now + max(CHECKPOINT_SECONDS, (now - began) / CHECKPOINT_SHARE)


def fingerprint(method: PackingMethod, problem: Problem) -> str:
    """Return the hash of all that the result depends on, which a checkpoint must have to be resumed."""
    digest = hashlib.sha256()
    head = {
        "method": method.name,
        "parameters": to_mapping(problem.parameters),
        "container": problem.container.to_mapping(),
        "seed": problem.seed,
        "asked": [problem.asked_count, problem.asked_fraction],
        "shapes": [shape.key for shape in problem.shapes],
        "settling": None if problem.settling is None else to_mapping(problem.settling),
        **({"fixed": problem.fixed} if problem.fixed else {}),
        # one density for all is no part of what is computed
        **({"density": problem.density} if isinstance(problem.density, tuple) else {}),
    }
    digest.update(json.dumps(head, sort_keys=True, default=str).encode())
    arrays = [problem.shape_id, problem.diameter]
    if problem.start is not None:
        arrays += [problem.start.position, problem.start.orientation]
    if problem.orientation is not None:
        arrays.append(problem.orientation)
    for array in arrays:
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()


def _save(problem: Problem, state: RunState, path: str | os.PathLike[str], mark: str) -> None:
    """Write a checkpoint."""
    header: dict[str, Any] = {
        "fingerprint": mark,
        "done": state.done,
        "total": state.total,
        "stop_reason": state.stop_reason,
        "counters": state.counters,
    }
    made = {name: np.array(sorted(keys), dtype=np.uint64) for name, keys in problem.made.items()}
    save_checkpoint(path, header, {**state.arrays, **made})
    log.info("checkpoint after %d attempts: %s", state.done, path)


def _restore(problem: Problem, state: RunState, path: str | os.PathLike[str], mark: str) -> None:
    """Load a checkpoint into a newly prepared state, and its counted representations into the problem."""
    header, arrays = load_checkpoint(path)
    if header.get("fingerprint") != mark:
        raise CheckpointError(
            f"{path} belongs to another run (other shapes, sizes, parameters, seed or version): resume with the scene "
            "or the options that wrote it, or start anew: without it, or at the prompt with --overwrite"
        )
    try:
        for name in problem.made:
            keys = arrays.pop(name)
            if keys.dtype != np.uint64 or keys.ndim != 1:
                raise ValueError(f"{name} are no keys")
            problem.made[name] |= set(keys.tolist())
        done, total, reason = (header[name] for name in ("done", "total", "stop_reason"))
        if type(done) is not int or type(total) is not int or not (0 <= done <= MOST and 0 <= total <= MOST):
            raise ValueError(f"done is {done!r} and total {total!r}")
        if reason != "" and reason not in STOP_REASONS:
            raise ValueError(f"stop_reason is {reason!r}")
        state.done, state.total, state.stop_reason = done, total, reason
        state.restore(arrays, _counters(header["counters"]))
    except KeyError as error:
        raise CheckpointError(
            f"{path} has no {error}, which this version of voxgran keeps: resume with the version that wrote it, or "
            "start anew: without it, or at the prompt with --overwrite"
        ) from error
    except CheckpointError as error:
        raise CheckpointError(f"{path}: {error}") from error
    except (TypeError, ValueError, OverflowError, AttributeError, LookupError) as error:
        raise CheckpointError(
            f"{path} is not as a run leaves it ({reason_of(error)}): start anew without it"
        ) from error
    state.derived = {}
    log.info("resumed after %d attempts from %s", state.done, path)


def _counters(told: Any) -> dict[str, int | None]:
    """Return counters as a state has them: whole numbers, or None for one that is not known yet."""
    return {str(name): None if value is None else int(value) for name, value in dict(told).items()}


def _tell(how: Drive, state: RunState) -> None:
    """Report progress."""
    if how.on_step is not None:
        counted = ", ".join(f"{name} {value}" for name, value in list(state.counters.items())[:2])
        # states of grains that settle or are compressed say more than counters
        text = getattr(state, "told", "") or counted
        stage = getattr(state, "stage", "packing")
        how.on_step(Step(stage=stage, done=state.done, total=state.total, text=text))


def _tell_of_kernels(how: Drive) -> None:
    """Report that kernels are compiled, which takes seconds when a method is used for the first time."""
    if how.on_step is not None:
        how.on_step(Step(stage="compiling", done=0, total=0, text="kernels (once per machine)"))


def _farewell(how: Drive, state: RunState) -> str:
    """Return the message of a stopped run, with the way to resume it."""
    ended = bool(state.stop_reason)
    made = f"all {state.done} attempts" if ended else f"{state.done} of {state.total} attempts"
    made = getattr(state, "told", "") or made
    if how.checkpoint is None:
        return f"stopped after {made} without a checkpoint: give one to be able to resume"
    return f"stopped after {made}; to {'finish' if ended else 'go on'}, resume from {how.checkpoint}"


def check_drive(checkpoint: Any, resume: Any, on_step: Any, recorder: Any) -> None:
    """Check the options of a run, as :func:`voxgran.packing.pack.pack` takes them.

    Raises
    ------
    InputError
        If one of them is of another type, or the checkpoint is no path.
    OutputError
        If the checkpoint cannot be reached.
    """
    if checkpoint is not None and not isinstance(checkpoint, str | os.PathLike):
        raise InputError(f"checkpoint is {shown(checkpoint)}: it must be the path of a file; change it")
    if checkpoint is not None:
        as_path(checkpoint)
    if not isinstance(resume, bool | np.bool_):
        raise InputError(f"resume is {shown(resume)}: it must be True or False; give the file as checkpoint")
    if resume and checkpoint is None:
        raise InputError("resume is True and checkpoint is None: give the file to go on from as checkpoint")
    reported(on_step)
    if recorder is not None and not (hasattr(recorder, "due") and hasattr(recorder, "record")):
        raise InputError(f"recorder is {shown(recorder)}: it must have the methods due and record; give a Series")
