"""The errors that voxgran raises.

Each subclasses the standard error that people catch, and each message is one sentence that names the
value, the rule and the remedy. `exit_code` is what the command line returns: 2 for bad input, 1 for failure.

Warnings that point at the line of the user, and those about former names, which are accepted for one release.
"""

import sys
import warnings
from collections.abc import Collection
from itertools import islice
from typing import ClassVar

#: how many things of several a message names
NAMED = 5


def shown(value: object) -> str:
    """Return a value as a message shows it: on one line, no longer than 60 characters."""
    try:
        text = repr(value)
    except ValueError:
        # Python writes no whole number of more than 4300 digits
        text = f"<{type(value).__name__} of more than 4300 digits>"
    except RecursionError:
        text = f"<{type(value).__name__} that is nested too deeply to be shown>"
    return shortened(" ".join(text.split()), 60)


def shortened(text: str, most: int = 300) -> str:
    """Return a text that is cut where it has more characters than a message shows."""
    return text if len(text) <= most else f"{text[: most - 3]}..."


def with_article(noun: str) -> str:
    """Return a noun with its article: ``a box``, ``an ellipsoid``."""
    return f"{'an' if noun[:1].lower() in 'aeiou' else 'a'} {noun}"


def numbered(noun: str, numbers: Collection[int]) -> str:
    """Return things by their numbers, at most five of them: ``grain 3``, ``rows 0, 2, 5, 6, 7 and 2 more``."""
    first = ", ".join(str(number) for number in islice(numbers, NAMED))
    more = f" and {len(numbers) - NAMED} more" if len(numbers) > NAMED else ""
    return f"{noun}{'' if len(numbers) == 1 else 's'} {first}{more}"


class VoxgranError(Exception):
    """Base of all errors that voxgran raises on purpose.

    Examples
    --------
    >>> import voxgran as vg
    >>> try:
    ...     vg.Box((4, 4, -1))
    ... except vg.VoxgranError as error:
    ...     print(error)
    length of the box is -1.0: it must be finite and above 0; change it
    """

    exit_code: ClassVar[int] = 1


class InputError(VoxgranError, ValueError):
    """A value that breaks a rule."""

    exit_code: ClassVar[int] = 2


class UnknownNameError(InputError):
    """A name (method, family, key, section) that voxgran does not know."""


class CallError(InputError, TypeError):
    """A call whose arguments do not fit the signature."""


class GrainIndexError(InputError, IndexError):
    """An index, mask or list that chooses no grains of a packing."""


class DirtyMeshError(InputError):
    """A surface that does not bound one solid."""


class GrainTooLargeError(InputError):
    """A grain that cannot fit in its container."""


class FileFormatError(InputError):
    """A file whose content cannot be read as what it claims to be."""


class CheckpointError(FileFormatError):
    """A checkpoint that is damaged or belongs to another run."""


class MissingFileError(VoxgranError, FileNotFoundError):
    """A file that is not there."""

    exit_code: ClassVar[int] = 2


class OutputExistsError(VoxgranError, FileExistsError):
    """An output that is already there and was not to be replaced."""

    exit_code: ClassVar[int] = 2


class InUseError(VoxgranError, BlockingIOError):
    """An output that another process is writing."""

    exit_code: ClassVar[int] = 2


class OutputError(VoxgranError, OSError):
    """An output that could not be written."""


class MissingLibraryError(VoxgranError, ImportError):
    """A library, or a system library under it, that cannot be loaded."""


class EngineError(VoxgranError, RuntimeError):
    """A program of an engine that is not installed, or fails."""


class ClusterError(VoxgranError, ConnectionError):
    """A cluster of computers that is not there, or goes away."""


class TooLargeError(VoxgranError, MemoryError):
    """A request that does not fit in memory."""

    exit_code: ClassVar[int] = 2


class Interrupted(KeyboardInterrupt):
    """A run stopped by SIGINT or SIGTERM; no error, so that ``except Exception`` does not catch it.

    The exit code is 130 or 143.
    """

    def __init__(self, message: str, signal_number: int) -> None:
        super().__init__(message)
        self.signal_number = signal_number
        self.exit_code = 128 + signal_number


class DirtyMeshWarning(UserWarning):
    """Something about a surface that is allowed but worth knowing."""


class PackingWarning(UserWarning):
    """A packing that misses a requested property, or a measure of it that is not meaningful.

    Examples
    --------
    >>> import warnings
    >>> import voxgran as vg
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("ignore", vg.PackingWarning)
    ...     few = vg.pack(vg.shapes.sphere(), vg.Box((2, 2, 2)), "rsa", count=9)
    >>> few.count < 9
    True
    """


class LongRunWarning(PackingWarning):
    """A run that is expected to take long, told before it starts."""


def warn(text: str, category: type[Warning]) -> None:
    """Issue a warning of one sentence that points at the first caller outside of voxgran, and of properties kept."""
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and frame.f_globals.get("__name__", "").split(".")[0] in ("voxgran", "functools"):
        level, frame = level + 1, frame.f_back
    warnings.warn(text, category, stacklevel=level)


def warn_former(text: str) -> None:
    """Issue a DeprecationWarning of one sentence, as :func:`warn`."""
    warn(text, DeprecationWarning)
