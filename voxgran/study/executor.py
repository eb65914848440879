"""What computes the runs of a study elsewhere: processes of this machine, or the workers of a cluster."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from typing import Self

from voxgran.study.runs import Record, Run

#: how often a run is begun that ends with its process each time
TRIES = 2


class Executor(ABC):
    """Computes runs (context manager): it begins on entry, and leaves what is not finished on exit."""

    @property
    @abstractmethod
    def running(self) -> int:
        """How many runs are computed now, as far as it is known."""

    @property
    def compiling(self) -> bool:
        """Whether kernels are compiled now, as far as it is known."""
        return False

    @property
    def loading(self) -> bool:
        """Whether libraries are loaded now, as far as it is known."""
        return False

    @property
    @abstractmethod
    def under_way(self) -> list[tuple[Run, float]]:
        """The runs that are computed now, and for how many seconds each has been."""

    @abstractmethod
    def __enter__(self) -> Self:
        """Make ready what computes."""

    @abstractmethod
    def __exit__(self, *_: object) -> None:
        """Leave what is not finished."""

    @abstractmethod
    def results(self, runs: Sequence[Run]) -> Iterator[tuple[Run, Record, bytes] | None]:
        """Yield each run with its record when it is finished, in any order, and None when some time has passed.

        A packing in bytes comes with it where the files of this machine were out of reach; a run that ends several
        times with its process has a record that says so.

        Parameters
        ----------
        runs : sequence of Run
            What is to be computed; the first ones are the most urgent.
        """
