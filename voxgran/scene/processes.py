"""Other processes of this Python: started with a function and a connection to it, and ended with this one.

They are started as plain Python programs, and not by `multiprocessing`, so that scripts need no ``__main__`` guard.
Each has a session of its own, so that Ctrl-C in a terminal does not reach it, and ends itself when nobody listens.
"""

import contextlib
import importlib
import os
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, Pipe
from typing import Any, Self, TypeVar

from voxgran._base.errors import Interrupted, MissingLibraryError, TooLargeError
from voxgran._base.stopping import NUMBERS, heed, undone_at_end

_START = (
    "import sys; number = int(sys.argv[1]); module, name = sys.argv[2:4]; sys.path[:] = sys.argv[4:]; "
    "from voxgran.scene.processes import serve; serve(number, module, name)"
)

#: seconds between looks while an answer is waited for
TICK = 0.2


class Channel:
    """What a process that was started has of the one that started it: messages come in their order, and what is sent
    back arrives there. When nobody listens any more the process ends at once, whatever it computes.
    """

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._came: queue.SimpleQueue[Any] = queue.SimpleQueue()
        threading.Thread(target=self._receive, daemon=True).start()

    def receive(self) -> Any:
        """Return the next message, and wait for it."""
        return self._came.get()

    def send(self, what: Any) -> None:
        """Send a message."""
        try:
            self._connection.send(what)
        except OSError:
            os.kill(os.getpid(), signal.SIGKILL)

    def _receive(self) -> None:
        """Queue what comes."""
        while True:
            try:
                self._came.put(self._connection.recv())
            except (EOFError, OSError):
                os.kill(os.getpid(), signal.SIGKILL)


def serve(descriptor: int, module: str, name: str) -> None:
    """Call a function of a module with the channel of a socket.

    Parameters
    ----------
    descriptor : int
        Number of the open socket.
    module, name : str
        Where the function is.
    """
    channel = Channel(Connection(descriptor))
    try:
        getattr(importlib.import_module(module), name)(channel)
    except Interrupted as stop:
        # ended at once, as where no signal is noted: Python would wait for the threads of libraries
        signal.signal(stop.signal_number, signal.SIG_DFL)
        os.kill(os.getpid(), stop.signal_number)


def compute(channel: Channel) -> None:
    """Call functions that come without arguments, one after another, and send back what they return or raise."""
    while True:
        function = channel.receive()
        try:
            answer = function()
        except Exception as error:  # noqa: BLE001  (it is raised where it is received)
            answer = error
        channel.send(answer)


@dataclass(slots=True, eq=False)
class Process:
    """A process that was started, and the connection to it (context manager, which ends it)."""

    process: subprocess.Popen[bytes]
    connection: Connection
    ending: contextlib.ExitStack = field(default_factory=contextlib.ExitStack)

    def receive(self) -> Any:
        """Return what a function has returned that this process computes, or raise what it has raised; signals are
        heeded.

        Raises
        ------
        TooLargeError
            If the process has ended.
        Interrupted
            If a signal has ended it that asks to stop.
        """
        while not self.connection.poll(TICK):
            heed()
        try:
            answer = self.connection.recv()
        except (EOFError, OSError):
            heed()
            code = self.process.wait()
            if -code in NUMBERS:
                raise Interrupted(f"stopped by {signal.Signals(-code).name}", -code) from None
            raise TooLargeError(
                f"a process of this program {ending_of(code)}: memory may have run out; free some, and try again"
            ) from None
        if isinstance(answer, Exception):
            raise answer
        return answer

    def end(self) -> None:
        """End it at once."""
        self.process.kill()
        self.process.wait()
        self.connection.close()
        self.ending.close()

    def __enter__(self) -> Self:
        """Return it."""
        return self

    def __exit__(self, *_: object) -> None:
        """End it at once."""
        self.end()


T = TypeVar("T", bound=Process)


def ending_of(code: int) -> str:
    """Return how a process has ended."""
    return f"ended by {signal.Signals(-code).name}" if code < 0 else f"ended with code {code}"


def start(function: Callable[[Channel], None], kind: type[T], environment: Mapping[str, str] | None = None) -> T:
    """Start a process that calls a public function of a module with its channel.

    Raises
    ------
    MissingLibraryError
        If it cannot be started.
    """
    here, there = Pipe()
    words = [str(there.fileno()), function.__module__, function.__qualname__, *map(str, sys.path)]
    try:
        process = subprocess.Popen(
            [sys.executable, "-P", "-c", _START, *words],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            pass_fds=[there.fileno()],
            env={**os.environ, **(environment or {})},
            start_new_session=True,
        )
    except OSError as error:
        here.close()
        raise MissingLibraryError(
            f"{sys.executable or 'Python'} cannot be started as a second process ({error.strerror or error}): this is "
            "computed in such processes; free processes and memory"
        ) from error
    finally:
        there.close()
    made = kind(process, here)
    made.ending.enter_context(undone_at_end(process.kill))
    return made
