"""How a program ends that is asked to: at its next look, or by a thread that watches where it comes to none."""

import contextlib
import os
import signal
import sys
import threading
import time

from voxgran._base.stopping import Signals

#: seconds after which a program is ended that has not come to a look, or whose work has not ended after one, and
#: between two glances at it
PATIENCE, LONGEST_END, GLANCE = 0.5, 5.0, 0.02


class Program(Signals):
    """The signals of a whole program (context manager).

    A kernel, a compiler or a library may compute for long without a look, and while the main thread is in it no handler
    of Python runs. A thread therefore reads the numbers of the signals from a pipe, into which the handler in C writes
    them. It ends the program where that has not come to a look in time, and at a second signal.
    """

    def __init__(self) -> None:
        super().__init__()
        self._ends = threading.Event()

    def __enter__(self) -> "Program":
        """Install the handlers and start the thread."""
        super().__enter__()
        self._read, self._write = os.pipe()
        os.set_blocking(self._write, False)
        signal.set_wakeup_fd(self._write, warn_on_full_buffer=False)
        threading.Thread(target=self._watch, name="voxgran signals", daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        """Leave the handlers, which from now on note what comes too late."""
        self.ends()

    @property
    def reason(self) -> str:
        """What is said where the work ends at a look."""
        return "stopped" if self.number == signal.SIGINT else f"stopped by {signal.Signals(self.number).name}"

    def ends(self) -> None:
        """Take note that the program ends by itself: no look stops that, and the thread ends."""
        super().ends()
        self._ends.set()

    def _end_at_once(self, number: int) -> None:
        """Leave a second signal to the thread."""

    def _watch(self) -> None:
        """Wait for a signal; end the program if it has not come to a look in time, and at a second signal."""
        number = os.read(self._read, 1)[0]
        os.set_blocking(self._read, False)
        began, lost = time.monotonic(), ""
        while time.monotonic() - began < (LONGEST_END if self.heeded else PATIENCE):
            if self._ends.wait(GLANCE):
                return
            with contextlib.suppress(BlockingIOError):
                if os.read(self._read, 1):
                    lost = " at once: what came after the last checkpoint is lost" if self._is_patient else lost
                    break
            began = time.monotonic() if self._is_patient else began
        for undo in list(self.undo.values()):
            with contextlib.suppress(Exception):
                undo()
        # rich hides the cursor while it shows a bar
        shown = "\r\x1b[K\x1b[?25h" if os.isatty(2) else ""
        with contextlib.suppress(OSError):
            os.write(2, f"{shown}voxgran: stopped{lost}\n".encode())
        os._exit(128 + number)

    @property
    def _is_patient(self) -> bool:
        """Whether who notes signals now comes to a good place to stop by itself."""
        innermost: Signals = self
        while innermost.within is not None:
            innermost = innermost.within
        return innermost.patient


def leave(status: int) -> int:
    """End this process, which was interrupted: libraries whose work was cut short may crash when they are unloaded."""
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError, AttributeError):
            stream.flush()
    os._exit(status)
