"""Stopping long work: signals are recorded, and the work checks for them where its state is consistent."""

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from types import FrameType

from voxgran._base.errors import Interrupted

_asked: ContextVar[Callable[[], bool]] = ContextVar("asked", default=lambda: False)


class Stopped(BaseException):
    """Work was stopped on request; caught by the caller that requested it."""


def stop_if_asked() -> None:
    """Raise `Stopped` if :func:`stopping_when` requests it; the check takes less than a microsecond.

    Raises
    ------
    Stopped
        If so.

    Examples
    --------
    >>> from voxgran._base.stopping import Stopped, stop_if_asked, stopping_when
    >>> try:
    ...     with stopping_when(lambda: True):
    ...         stop_if_asked()
    ... except Stopped:
    ...     print("stopped")
    stopped
    """
    if _asked.get()():
        raise Stopped


@contextlib.contextmanager
def stopping_when(asked: Callable[[], bool]) -> Iterator[None]:
    """Let the work of this thread stop as soon as a function returns true (context manager)."""
    token = _asked.set(asked)
    try:
        yield
    finally:
        _asked.reset(token)


class Signals:
    """Record SIGINT and SIGTERM instead of ending at once (context manager); in the main thread only.

    `number` is the first signal received, 0 for none. The first one is only recorded if `patient`; a second one always
    ends the work at once.
    """

    def __init__(self) -> None:
        self.number = 0
        self.patient = False
        self._before: dict[int, Callable[[int, FrameType | None], object] | int | None] = {}

    def __enter__(self) -> "Signals":
        """Install the handlers."""
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                self._before[number] = signal.signal(number, self._note)
        return self

    def __exit__(self, *_: object) -> None:
        """Restore the former handlers."""
        for number, handler in self._before.items():
            # None: the former handler was not installed by Python and cannot be restored
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
        self._before = {}

    def _note(self, number: int, frame: FrameType | None) -> None:
        """Record a signal, or end the work."""
        del frame
        first, self.number = not self.number, self.number or number
        if not (first and self.patient):
            lost = "what came after the last checkpoint is lost"
            raise Interrupted("stopped before the next attempt" if first else f"stopped at once: {lost}", number)
