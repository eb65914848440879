"""Compressor: what brings overlapping grains of given relative sizes to a solid fraction, or to where they jam.

There is one for spheres and disks (:mod:`voxgran.packing.jamming.spheres`) and one for true shapes
(:mod:`voxgran.packing.jamming.solids`). The methods ``expand`` and ``jam`` drive either in steps, between which a run
may be stopped, kept and resumed.
"""

from collections.abc import Mapping
from typing import Any, Protocol

from numpy.typing import NDArray

from voxgran._base.arrays import Floats
from voxgran.contacts.assembly import Assembly


class Compressor(Protocol):
    """Grains that are relaxed at growing sizes until they meet their sizes or jam.

    A class that keeps this is made as ``X(assembly, *, jam, seed)``, with parameters of its own after these. The grains
    of the assembly have their final sizes where `jam` is false, and sizes up to a common factor where it is true; they
    may overlap each other and the walls.
    With ``jam=False`` the grains are to stand free of overlap at the factor 1, or at the largest factor that was found;
    with ``jam=True`` at the largest factor without overlap, the jamming point.

    Attributes
    ----------
    assembly : Assembly
        The grains as they were given.
    ended : bool
        Whether there is no step left.
    done_steps, most_steps : int
        Steps made, and the largest number of steps.
    arrays : mapping of str to ndarray
        Arrays of which the state consists, as a checkpoint holds them.
    counters : mapping of str to int
        Whole numbers of which the state consists.
    factor : float
        Common factor on the sizes of the assembly at which the grains overlap neither each other nor a wall; it is
        final once the run has ended.
    report : dict of str to any
        What a user may want to know of the run, for the provenance.
    """

    assembly: Assembly
    most_steps: int

    @property
    def ended(self) -> bool:
        """Whether there is no step left."""

    @property
    def done_steps(self) -> int:
        """Steps made."""

    @property
    def arrays(self) -> Mapping[str, NDArray[Any]]:
        """Arrays of the state."""

    @property
    def counters(self) -> Mapping[str, int]:
        """Whole numbers of the state."""

    @property
    def factor(self) -> float:
        """Common factor on the sizes of the assembly."""

    @property
    def report(self) -> dict[str, Any]:
        """Numbers for the provenance."""

    def step(self) -> None:
        """Make one step, of at most about 0.3 s.

        Raises
        ------
        Stopped
            If the run is asked to stop; the state is then that before the step.
        """

    def restore(self, arrays: Mapping[str, NDArray[Any]], counters: Mapping[str, int]) -> None:
        """Take over the state of a checkpoint."""

    def poses(self) -> tuple[Floats, Floats]:
        """Return positions (n, 3) and unit quaternions (n, 4) of the grains."""
