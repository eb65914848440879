"""How long work tells how far it is: a callback, nothing else.

Whoever runs it shows it (the command line with rich) or leaves it.
"""

from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """How far a piece of work is.

    Attributes
    ----------
    stage : str
        What is being done, such as ``"packing"``.
    done, total : int
        Units of work done and in all; `total` is 0 where it is not known.
    text : str
        One short line for a person, such as the solid fraction so far.
    """

    stage: str
    done: int
    total: int
    text: str = ""


class OnStep(Protocol):
    """A function that is told of each step."""

    def __call__(self, step: Step, /) -> None:
        """Take note of a step."""
