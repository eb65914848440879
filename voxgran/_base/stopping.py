"""Stopping long work: signals are noted, and the work looks for them where its state is consistent.

An exception that a handler raises appears between any two instructions, also within a library that is called back from
C: it may then be lost, turned into another error, or end the process. Here a handler only notes the signal, and looks
(`heed`, `stop_if_asked`) raise: before each kernel, library and file, and within what takes long.
"""

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from contextvars import ContextVar, Token
from types import FrameType

from voxgran._base.errors import Interrupted

_asked: ContextVar[Callable[[], bool]] = ContextVar("asked", default=lambda: False)
_innermost: ContextVar["Signals | None"] = ContextVar("innermost", default=None)

#: signals that ask to stop: Ctrl-C, the system, and a terminal that is closed
NUMBERS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Stopped(BaseException):
    """Work was stopped on request; caught by the caller that requested it."""


def stop_if_asked() -> None:
    """Raise `Stopped` if :func:`stopping_when` requests it; the check takes less than a microsecond. Signals are
    heeded as by :func:`heed`.

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
    heed()


@contextlib.contextmanager
def stopping_when(asked: Callable[[], bool]) -> Iterator[None]:
    """Let the work of this thread stop as soon as a function returns true (context manager)."""
    token = _asked.set(asked)
    try:
        yield
    finally:
        _asked.reset(token)


def heed() -> None:
    """End the work of this thread if a signal has been noted, unless whoever notes it is patient; the check takes less
    than a microsecond.

    Raises
    ------
    Interrupted
        If so.
    """
    signals = _innermost.get()
    if signals is not None and signals.number and not (signals.patient or signals.heeded):
        signals.heeded = True
        raise Interrupted(signals.reason, signals.number)


@contextlib.contextmanager
def undone_at_end(undo: Callable[[], object]) -> Iterator[None]:
    """Have a function called if a program is ended within this block without leaving it (context manager)."""
    signals = _innermost.get()
    if signals is None:
        yield
        return
    signals.undo[key := object()] = undo
    try:
        yield
    finally:
        del signals.undo[key]


class Signals:
    """Note SIGINT, SIGTERM and SIGHUP instead of ending at once (context manager); in the main thread only.

    `number` is the first signal received, 0 for none. The first look after it ends the work unless `patient`; a second
    signal always ends it at once. What is noted and not heeded until the block ends is noted by the one around it.
    """

    def __init__(self) -> None:
        self.number = 0
        self.patient = False
        self.heeded = False
        #: what a program that is ended does first; shared with those within
        self.undo: dict[object, Callable[[], object]] = {}
        self.within: Signals | None = None
        self._around: Signals | None = None
        self._token: Token[Signals | None] | None = None
        self._before: dict[int, Callable[[int, FrameType | None], object] | int | None] = {}

    def __enter__(self) -> "Signals":
        """Install the handlers."""
        if threading.current_thread() is threading.main_thread():
            self._around = _innermost.get()
            if self._around is not None:
                self._around.within, self.undo = self, self._around.undo
                if not (self._around.heeded or self._around.patient):
                    # a signal that came before this block, with no look since
                    self.number = self.number or self._around.number
            self._token = _innermost.set(self)
            for number in NUMBERS:
                if number == signal.SIGHUP and signal.getsignal(number) is signal.SIG_IGN:
                    # started by nohup
                    continue
                self._before[number] = signal.signal(number, self._note)
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Restore the former handlers."""
        for number, handler in self._before.items():
            # None: the former handler was not installed by Python and cannot be restored
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
        if self._token is not None:
            _innermost.reset(self._token)
        if self._around is not None:
            self._around.number = self._around.number or self.number
            self._around.heeded = self.heeded or (kind is not None and issubclass(kind, Interrupted))
            self._around.within = None
        self._before, self._token, self._around = {}, None, None

    def ends(self) -> None:
        """Take note that the work ends by itself: no look stops that."""
        self.patient = True

    @property
    def reason(self) -> str:
        """What is said where the work ends at a look."""
        return "stopped before the next attempt"

    def _note(self, number: int, frame: FrameType | None) -> None:
        """Note a signal, or end the work."""
        del frame
        first, self.number = not self.number, self.number or number
        if not first:
            self._end_at_once(number)

    def _end_at_once(self, number: int) -> None:
        """End the work at a second signal.

        Raises
        ------
        Interrupted
            Always, but in a program, which is ended as a whole.
        """
        if self._around is not None:
            self._around._end_at_once(number)
            return
        raise Interrupted("stopped at once: what came after the last checkpoint is lost", number)
