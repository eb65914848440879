"""Runs of scenes, one after the other, each in a process of its own that can be stopped and goes on."""

import contextlib
import os
import re
import signal
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from subprocess import TimeoutExpired
from typing import Any

from voxgran._base.errors import DirtyMeshWarning, InputError, Interrupted, PackingWarning, VoxgranError
from voxgran._base.files import write_text
from voxgran._base.lazy import load
from voxgran._base.progress import Step
from voxgran._base.stopping import NUMBERS
from voxgran.io.files import save
from voxgran.packing.model import Packing
from voxgran.scene.checked_sections import located, read_toml
from voxgran.scene.processes import Channel, Process, ending_of, start
from voxgran.scene.run import PACKING, is_complete
from voxgran.scene.scene import Scene

#: seconds between two looks at a bed that grows, and how many times as long as one takes
PAUSE, REST = 1.0, 10.0
#: seconds that a run has for its checkpoint when the app ends
LAST = 10.0


@contextlib.contextmanager
def heard(tell: Callable[[str], None]) -> Iterator[None]:
    """Pass the sentences of warnings to a function (context manager)."""

    def show(message: Warning | str, *_: Any, **__: Any) -> None:
        tell(str(message))

    with warnings.catch_warnings():
        for kind in (PackingWarning, DirtyMeshWarning):
            warnings.simplefilter("always", kind)
        warnings.showwarning = show
        yield


@dataclass(slots=True)
class Watcher:
    """A recorder of a run, which writes the grains as they are into one file, for those who watch.

    Attributes
    ----------
    path : Path
        The file.
    told : callable
        Called when it was written.
    due_at : float
        When the next is due; a tenth of the time at most is taken for them.
    """

    path: Path
    told: Callable[[], None]
    due_at: float = 0.0
    began: float = 0.0

    def due(self, done: int) -> int:
        """Return the number of attempts after which the grains are written."""
        self.began = time.monotonic()
        return done + (1 if self.began >= self.due_at else sys.maxsize)

    def record(self, packing: Packing, done: int) -> None:
        """Write the grains after `done` attempts."""
        save(packing, self.path, overwrite=True)
        now = time.monotonic()
        self.due_at = now + max(PAUSE, REST * (now - self.began))
        self.told()


def serve(channel: Channel) -> None:
    """Run the scene of a folder, and send its steps, and at the end a sentence, which is empty where all went well.

    Parameters
    ----------
    channel : Channel
        From which the folder comes, the one of files that the scene names, and whether the run goes on.
    """
    folder, base, resume = channel.receive()

    def tell(step: Step) -> None:
        channel.send(("step", step.stage, step.done, step.total, step.text))

    watcher = Watcher(folder.with_suffix(".vtp"), lambda: channel.send(("grown",)))
    try:
        with heard(lambda text: channel.send(("warning", text))):
            scene = Scene.from_mapping(read_toml(folder.with_suffix(".toml")), folder=base)
            recorder = None if scene.output.snapshots else watcher
            scene.run(folder, resume=resume, on_step=tell, recorder=recorder)
    except Interrupted:
        raise
    except VoxgranError as error:
        channel.send(str(error))
    else:
        channel.send("")


@dataclass(slots=True, eq=False)
class Run:
    """A scene, the folder of its results, and how far it is.

    Attributes
    ----------
    number : int
        Its number in the queue.
    folder : Path
        Where results go; its scene lies beside it.
    state : str
        One of waiting, running, stopped, done, failed.
    stage, text, error : str
        What is done, how it stands, and why the run failed.
    warnings : list of str
        Its warnings.
    share : float
        Done of the stage, from 0 to 1; below 0 where it is not known.
    grown : int
        How often its grains were written while it is computed.
    """

    number: int
    folder: Path
    state: str = "waiting"
    stage: str = ""
    text: str = ""
    error: str = ""
    warnings: list[str] = field(default_factory=list)
    share: float = -1.0
    grown: int = 0
    staged: float = 0.0
    process: Process | None = None

    @property
    def packing(self) -> Path:
        """The file of its packing."""
        return self.folder / PACKING

    @property
    def growing(self) -> Path:
        """The file of its grains while it is computed."""
        return self.folder.with_suffix(".vtp")

    @property
    def left(self) -> float:
        """Seconds that the stage still takes, if it goes on as it did; NaN where that is not known."""
        gone = time.monotonic() - self.staged
        return gone * (1 - self.share) / self.share if self.state == "running" and self.share > 0.02 else float("nan")

    def told(self) -> dict[str, Any]:
        """Return what a page shows of it."""
        left = self.left
        percent = round(100 * self.share) if self.share >= 0 else None
        known = {name: getattr(self, name) for name in ("number", "state", "stage", "text", "error")}
        rest = {"percent": percent, "left": None if left != left else round(left)}
        return {**known, **rest, "warnings": list(self.warnings)}


@dataclass(slots=True, eq=False)
class Queue:
    """Runs in a folder, of which one is computed at a time; scenes name files relative to `base`."""

    folder: Path
    base: Path
    runs: list[Run] = field(default_factory=list)

    def __post_init__(self) -> None:
        """List the runs that another app has left in the folder; those that are not complete were stopped."""
        numbers = [re.fullmatch(r"run_([1-9]\d{0,8})", path.stem) for path in self.folder.glob("run_*.toml")]
        for number in sorted(int(found[1]) for found in numbers if found):
            folder = self.folder / f"run_{number}"
            self.runs.append(Run(number, folder, "done" if is_complete(folder) else "stopped"))

    def add(self, mapping: dict[str, Any]) -> Run:
        """Queue a scene; the run of a folder that is there is left as it is.

        Raises
        ------
        VoxgranError
            If the scene breaks a rule.
        """
        Scene.from_mapping(mapping, folder=self.base)
        return self.take(self.next_folder(), mapping, "waiting")

    def next_folder(self) -> Path:
        """Return the folder of one more run, `run_1` or the next number that is not taken."""
        number = 1 + len(self.runs)
        while (self.folder / f"run_{number}").exists() or (self.folder / f"run_{number}.toml").exists():
            number += 1
        return self.folder / f"run_{number}"

    def take(self, folder: Path, mapping: dict[str, Any], state: str = "done") -> Run:
        """Take a folder, in which there may be results, and its scene as a run."""
        run = Run(number=int(folder.name.removeprefix("run_")), folder=folder, state=state)
        write_text(folder.with_suffix(".toml"), toml_of(located(mapping, self.base)))
        self.runs.append(run)
        return run

    @property
    def current(self) -> Run | None:
        """The run that is computed."""
        return next((run for run in self.runs if run.state == "running"), None)

    def poll(self) -> list[Run]:
        """Take note of what processes have sent, and begin the next run; return the runs that have ended since."""
        ended = []
        run = self.current
        if run is not None and self._listen(run):
            ended.append(run)
        if self.current is None:
            waiting = next((run for run in self.runs if run.state == "waiting"), None)
            if waiting is not None:
                try:
                    _begin(waiting, self.base)
                except VoxgranError as error:
                    waiting.state, waiting.error = "failed", str(error)
        return ended

    def stop(self, run: Run) -> None:
        """Stop a run; it writes a checkpoint, from which it goes on later. One that waits is taken from the queue.

        Raises
        ------
        InputError
            If it has ended.
        """
        if run.state == "waiting":
            run.state = "stopped"
        elif run.process is not None:
            os.kill(run.process.process.pid, signal.SIGTERM)
        else:
            raise InputError(f"run {run.number} has ended: only runs that are computed or wait can be stopped")

    def go_on(self, run: Run) -> None:
        """Put a run that was stopped, or has failed, into the queue again.

        Raises
        ------
        InputError
            If it was not stopped.
        """
        if run.state not in ("stopped", "failed"):
            raise InputError(f"run {run.number} is {run.state}: only runs that were stopped or failed go on")
        run.state, run.error = "waiting", ""

    def close(self) -> None:
        """End the run that is computed, after its checkpoint was written."""
        run = self.current
        if run is not None and run.process is not None:
            self.stop(run)
            with contextlib.suppress(TimeoutExpired):
                run.process.process.wait(LAST)
            self._ended(run)

    def _listen(self, run: Run) -> bool:
        """Take what the process of a run has sent; return whether it has ended."""
        process = run.process
        if process is None:
            return True
        try:
            while process.connection.poll():
                told = process.connection.recv()
                if isinstance(told, str):
                    run.state, run.error = ("failed", told) if told else ("done", "")
                    break
                _note(run, *told)
        except (EOFError, OSError):
            code = process.process.wait()
            stopped = -code in NUMBERS
            run.state = "stopped" if stopped else "failed"
            run.error = "" if stopped else f"its process {ending_of(code)}: memory may have run out"
        if run.state == "running":
            return False
        self._ended(run)
        return True

    def _ended(self, run: Run) -> None:
        """Put away what a run has had while it was computed."""
        if run.process is not None:
            run.process.end()
        run.process = None
        run.growing.unlink(missing_ok=True)


def toml_of(mapping: dict[str, Any]) -> str:
    """Return a scene as the text of a file.

    Raises
    ------
    MissingLibraryError
        If tomli_w is not installed.
    """
    return str(load("tomli_w").dumps(mapping))


def _begin(run: Run, base: Path) -> None:
    """Start the process of a run."""
    run.process = start(serve, Process)
    run.process.connection.send((run.folder, base, run.folder.exists()))
    run.state, run.staged, run.stage, run.share, run.warnings = "running", time.monotonic(), "", -1.0, []


def _note(run: Run, kind: str, *told: Any) -> None:
    """Take note of what the process of a run has sent: a step, a warning, or that its grains were written."""
    if kind == "grown":
        run.grown += 1
    elif kind == "warning":
        run.warnings += [text for text in told if text not in run.warnings]
    else:
        stage, done, total, run.text = told
        if stage != run.stage:
            run.stage, run.staged = stage, time.monotonic()
        run.share = min(1.0, done / total) if total > 0 else -1.0
