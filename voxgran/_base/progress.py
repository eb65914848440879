"""Progress of long work, reported through a callback.

Whoever runs it shows it (the command line with rich) or leaves it.
"""

from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """Progress of a piece of work."""

    stage: str  # such as ``"packing"``
    done: int  # units of work done
    total: int  # units of work in all; 0 if not known
    text: str = ""  # short line for a person, such as the solid fraction so far


class OnStep(Protocol):
    """A function that is called at each step."""

    def __call__(self, step: Step, /) -> None:
        """Take note of a step."""
