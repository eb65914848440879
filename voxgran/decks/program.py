"""Programs of engines: found, started in a folder, and ended with all that they started."""

import contextlib
import functools
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from voxgran._base.errors import EngineError, InputError
from voxgran._base.stopping import undone_at_end

#: lines of the end of a failed run that a message shows
LAST_LINES = 3
#: seconds that a program has to end by itself when it is stopped
PATIENCE = 0.3


def program_of(names: Sequence[str], variable: str, *, title: str, install: str) -> str:
    """Return the path of a program: as the environment variable says, beside this Python, or on the path.

    Parameters
    ----------
    names : sequence of str
        Names of the program, the first that is found is taken.
    variable : str
        Environment variable with its path.
    title : str
        Name of the engine in messages.
    install : str
        Command line that installs it.

    Raises
    ------
    InputError
        If the variable names no program.
    EngineError
        If there is none; the message says how to install it.
    """
    told = os.environ.get(variable)
    if told:
        found = shutil.which(told)
        if found is None:
            raise InputError(f"{variable} is {told!r}, which is no program: give the path of {names[0]}, or unset it")
        return found
    folders = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", os.defpath)])
    for name in names:
        found = shutil.which(name, path=folders)
        if found is not None:
            return found
    raise EngineError(
        f"{title} is not installed: there is no program {' or '.join(names)}; install it by {install}, or give its "
        f"path in {variable}"
    )


@contextlib.contextmanager
def running(command: Sequence[str], folder: Path, log: str) -> Iterator[subprocess.Popen[bytes]]:
    """Start a program in a folder, with all that it says in the file `log` there, and end it (context manager).

    Raises
    ------
    EngineError
        If it cannot be started.
    """
    environment = {"OMP_NUM_THREADS": "1", **os.environ}
    with (folder / log).open("wb") as out:
        try:
            process = subprocess.Popen(
                list(command),
                cwd=folder,
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=subprocess.STDOUT,
                env=environment,
                start_new_session=True,
            )
        except OSError as error:
            raise EngineError(f"{command[0]} cannot be started ({error.strerror}): reinstall it") from error
    try:
        with undone_at_end(functools.partial(os.killpg, process.pid, signal.SIGKILL)):
            yield process
    finally:
        _end(process)


def _end(process: subprocess.Popen[bytes]) -> None:
    """End a program and what it has started."""
    for number in (signal.SIGTERM, signal.SIGKILL):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, number)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(PATIENCE)


def refuse_failure(process: subprocess.Popen[bytes], folder: Path, log: str, title: str) -> None:
    """Raise an error with the last lines of a program that has ended with an error.

    Raises
    ------
    EngineError
        If it has.
    """
    if process.poll() in (None, 0):
        return
    said = (folder / log).read_text(encoding="utf-8", errors="replace").splitlines()
    lines = [line.strip() for line in said if line.strip()]
    wrong = [line for line in lines if "ERROR" in line] or lines[-LAST_LINES:]
    shown = " | ".join(wrong[:LAST_LINES]) or "it said nothing"
    raise EngineError(
        f"{title} ended with exit status {process.returncode}: {shown}; all of its output is in {folder / log}"
    )


class Tail:
    """What is appended to a text file while a program writes it."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._at = 0
        self._kept = ""

    def text(self) -> str:
        """Return what was kept, and what was written since; nothing while there is no file."""
        if not self._path.is_file():
            return self._kept
        with self._path.open("rb") as file:
            file.seek(self._at)
            new = file.read()
        self._at += len(new)
        text, self._kept = self._kept + new.decode("ascii", errors="replace"), ""
        return text

    def keep(self, text: str) -> None:
        """Return an incomplete end at the next call too."""
        self._kept = text

    def lines(self) -> list[str]:
        """Return the lines that are complete and not empty."""
        *whole, rest = self.text().split("\n")
        self.keep(rest)
        return [line for line in whole if line.strip()]
