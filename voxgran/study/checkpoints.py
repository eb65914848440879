"""Checkpoints of runs of a study: a run that was ended with its process goes on from its last one."""

import contextlib
import os
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from voxgran._base.checkpoint import remove_checkpoint
from voxgran._base.errors import CheckpointError, InUseError, OutputError
from voxgran._base.files import made_folder, write_text
from voxgran._base.progress import Step
from voxgran.packing.model import Packing
from voxgran.scene.description import SceneDescription
from voxgran.scene.run import pack_scene
from voxgran.shapes.model import Shape

#: file in the folder of checkpoints by which a worker on another machine finds that it sees the same folder
MARK = "study"


@contextlib.contextmanager
def marked(folder: Path) -> Iterator[str]:
    """Yield a text that is in a file of the folder of checkpoints as long as the study runs (context manager).

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    mark = f"{socket.gethostname()} {os.getpid()} {time.time_ns()}"
    write_text(made_folder(folder) / MARK, mark)
    try:
        yield mark
    finally:
        if is_seen(str(folder / "any"), mark):
            with contextlib.suppress(OSError):
                (folder / MARK).unlink()


def is_seen(checkpoint: str, mark: str) -> bool:
    """Return whether this machine sees the folder of a checkpoint that has this mark, and may write there."""
    folder = Path(checkpoint).parent
    try:
        return (folder / MARK).read_text(encoding="utf-8") == mark and os.access(folder, os.W_OK)
    except (OSError, ValueError):
        return False


def seconds_before(checkpoint: str) -> float:
    """Return the CPU time that led to a checkpoint, 0 where there is none."""
    if os.path.exists(checkpoint):
        with contextlib.suppress(OSError, ValueError):
            return float(_clock(checkpoint).read_text(encoding="ascii"))
    return 0.0


def _clock(checkpoint: str) -> Path:
    """Return the file beside a checkpoint that holds the CPU time."""
    return Path(f"{checkpoint}.seconds")


class Checkpoint:
    """The checkpoint of a run, and beside it the CPU time that led to it.

    Parameters
    ----------
    file : str
        Path of the checkpoint; empty where the run is always begun anew.
    seconds : callable
        Returns the CPU time of the run so far, without that before the checkpoint.
    """

    def __init__(self, file: str, seconds: Callable[[], float]) -> None:
        self._file, self._seconds = file, seconds
        self._stamp = self._written()
        #: CPU time that led to the checkpoint from which the run goes on
        self.before = seconds_before(file)

    def pack(self, scene: SceneDescription, shapes: tuple[Shape, ...]) -> Packing:
        """Pack a scene, from its checkpoint where there is one that belongs to it; layers always anew.

        Parameters
        ----------
        scene : SceneDescription
            The scene.
        shapes : tuple of Shape
            Its shapes.
        """
        if not self._file or scene.layers:
            return pack_scene(scene, shapes)
        kept: dict[str, Any] = {"checkpoint": Path(self._file), "resume": True, "on_step": self._note}
        try:
            try:
                return pack_scene(scene, shapes, **kept)
            except CheckpointError:
                # damaged, or of another version
                self.remove()
                self.before = 0.0
                return pack_scene(scene, shapes, **kept)
        except (CheckpointError, InUseError, OutputError):
            # the disk is full, another worker still computes this run, or another file lies there: that stays
            self._file, self.before = "", 0.0
            return pack_scene(scene, shapes)

    def remove(self) -> None:
        """Remove the checkpoint of a finished run."""
        if self._file:
            with contextlib.suppress(OSError, ValueError):
                remove_checkpoint(self._file)
                # what holds no number is another file
                float(_clock(self._file).read_text(encoding="ascii"))
                _clock(self._file).unlink()

    def _note(self, step: Step) -> None:
        """Write the CPU time when a checkpoint has been written since the last step."""
        del step
        stamp = self._written()
        if stamp != self._stamp:
            self._stamp = stamp
            write_text(_clock(self._file), str(self.before + self._seconds()), sync=False)

    def _written(self) -> int:
        """Return when the checkpoint was written, 0 where there is none."""
        with contextlib.suppress(OSError):
            return os.stat(self._file).st_mtime_ns
        return 0
