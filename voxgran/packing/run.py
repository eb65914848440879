"""Driving a packing method: chunks, checkpoints, resume, signals and progress, once for all methods."""

import contextlib
import hashlib
import json
import logging
import math
import os
import signal
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any, Protocol

import numpy as np

from voxgran._base.checkpoint import load_checkpoint, save_checkpoint
from voxgran._base.config import to_mapping
from voxgran._base.errors import CheckpointError, Interrupted, OutputError
from voxgran._base.files import remove_drafts
from voxgran._base.progress import OnStep, Step
from voxgran.packing.method import PackingMethod, State
from voxgran.packing.model import Packing
from voxgran.packing.problem import Problem

log = logging.getLogger(__name__)

#: a chunk is as many attempts as take about this long; no result depends on it
CHUNK_SECONDS = 0.5
CHECKPOINT_SECONDS = 10.0
#: a checkpoint is written at most so often that it takes this share of the time
CHECKPOINT_SHARE = 0.05


class Recorder(Protocol):
    """Takes snapshots of a run."""

    def due(self, done: int) -> int:
        """Return after how many attempts the next snapshot is due."""

    def record(self, packing: Packing, done: int) -> None:
        """Take a snapshot after so many attempts."""


@dataclass(slots=True)
class Drive:
    """How a run is driven; none of it changes the result.

    Attributes
    ----------
    checkpoint : path-like or None
        File that is written every ten seconds, when the run is asked to stop, and at the end; a large one less often,
        so that it takes no more than a twentieth of the time.
    resume : bool
        Whether to go on from that file where it is there.
    on_step : callable or None
        Told of each chunk.
    chunk : int or None
        Attempts per chunk; None adapts it to the clock.
    time_limit : float or None
        Seconds after which the run stops at the end of a chunk.
    recorder : Recorder or None
        Given the packing whenever a snapshot is due.
    """

    checkpoint: str | os.PathLike[str] | None = None
    resume: bool = False
    on_step: OnStep | None = None
    chunk: int | None = None
    time_limit: float | None = None
    recorder: Recorder | None = None
    started: float = field(default_factory=time.monotonic)


def drive(method: PackingMethod, problem: Problem, how: Drive) -> State:
    """Run a method until it stops.

    Parameters
    ----------
    method : PackingMethod
        The method.
    problem : Problem
        What to pack.
    how : Drive
        Checkpoint, progress and limits.

    Returns
    -------
    State
        With `stop_reason` set.

    Raises
    ------
    CheckpointError
        If the checkpoint is damaged or belongs to another run.
    OutputError
        If the checkpoint cannot be written; the one before is then still good.
    Interrupted
        On SIGINT or SIGTERM, after a checkpoint was written.
    """
    state = method.prepare(problem)
    mark = fingerprint(method, problem)
    if how.resume and how.checkpoint is not None and Path(how.checkpoint).exists():
        _restore(problem, state, how.checkpoint, mark)
    keeper = _Keeper(problem, how.checkpoint, mark)
    chunk = how.chunk or 1000
    with _signals() as asked:
        while not state.stop_reason:
            began, due = time.monotonic(), math.inf if how.recorder is None else how.recorder.due(state.done)
            taken = int(min(chunk, due - state.done))
            state = method.advance(problem, state, taken)
            now = time.monotonic()
            if how.chunk is None:
                chunk = int(np.clip(taken * CHUNK_SECONDS / max(now - began, 1e-4), chunk / 4 + 1, chunk * 4))
            _tell(how, state)
            if how.recorder is not None and (state.done >= due or state.stop_reason):
                how.recorder.record(method.finish(problem, state), state.done)
            stop = bool(asked) and not state.stop_reason
            late = how.time_limit is not None and not state.stop_reason and now - how.started > how.time_limit
            keeper.keep(state, at_once=stop or late or bool(state.stop_reason))
            if stop:
                raise Interrupted(_farewell(how, state), asked[0])
            if late:
                state.stop_reason = "interrupted"
    return state


class _Keeper:
    """Writes checkpoints, not too often."""

    def __init__(self, problem: Problem, path: str | os.PathLike[str] | None, mark: str) -> None:
        self.problem, self.path, self.mark = problem, path, mark
        self.done, self.next = -1, time.monotonic() + CHECKPOINT_SECONDS
        if path is not None:
            remove_drafts(path)

    def keep(self, state: State, *, at_once: bool) -> None:
        """Write a checkpoint where it is time."""
        began = time.monotonic()
        if self.path is None or not (at_once or began > self.next):
            return
        try:
            _save(self.problem, state, self.path, self.mark)
        except OutputError as error:
            last = f"that after {self.done} attempts is still good" if self.done >= 0 else "there is none"
            raise OutputError(f"{error} (the checkpoint after {state.done} attempts; {last})") from error
        now = time.monotonic()
        self.done, self.next = state.done, now + max(CHECKPOINT_SECONDS, (now - began) / CHECKPOINT_SHARE)


def fingerprint(method: PackingMethod, problem: Problem) -> str:
    """Return the hash that a checkpoint must carry to be resumed: all that the result depends on."""
    digest = hashlib.sha256()
    head = {
        "method": method.name,
        "parameters": to_mapping(problem.parameters),
        "container": problem.container.to_mapping(),
        "seed": problem.seed,
        "target": problem.target,
        "shapes": [shape.key for shape in problem.shapes],
    }
    digest.update(json.dumps(head, sort_keys=True, default=str).encode())
    arrays = [problem.shape_id, problem.diameter]
    if problem.start is not None:
        arrays += [problem.start.position, problem.start.orientation]
    for array in arrays:
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()


def _save(problem: Problem, state: State, path: str | os.PathLike[str], mark: str) -> None:
    """Write what a checkpoint holds."""
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


def _restore(problem: Problem, state: State, path: str | os.PathLike[str], mark: str) -> None:
    """Put a checkpoint into a freshly prepared state, and what was made before it into the problem."""
    header, arrays = load_checkpoint(path)
    if header.get("fingerprint") != mark:
        raise CheckpointError(
            f"{path} belongs to another run (other shapes, sizes, parameters, seed or version): resume with the scene "
            "that wrote it, or start anew without it"
        )
    for name in problem.made:
        problem.made[name] |= set(arrays.pop(name).tolist())
    state.arrays = arrays
    state.counters = dict(header["counters"])
    state.done, state.total = int(header["done"]), int(header["total"])
    state.stop_reason = str(header["stop_reason"])
    state.derived = {}
    log.info("resumed after %d attempts from %s", state.done, path)


def _tell(how: Drive, state: State) -> None:
    """Report progress."""
    if how.on_step is not None:
        text = ", ".join(f"{name} {value}" for name, value in list(state.counters.items())[:2])
        how.on_step(Step(stage="packing", done=state.done, total=state.total, text=text))


def _farewell(how: Drive, state: State) -> str:
    """Say where the run stopped and how to go on."""
    if how.checkpoint is None:
        return (
            f"stopped after {state.done} of {state.total} attempts without a checkpoint: give one to be able to resume"
        )
    return f"stopped after {state.done} of {state.total} attempts; to go on, resume from {how.checkpoint}"


@contextlib.contextmanager
def _signals() -> Iterator[list[int]]:
    """Note SIGINT and SIGTERM in a list instead of dying, while in the main thread."""
    asked: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield asked
        return

    def note(number: int, frame: FrameType | None) -> None:
        del frame
        asked.append(number)

    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield asked
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
