"""Sections of a scene that are values alone: what holds for all of it, and what is written."""

from voxgran._base.arrays import as_count
from voxgran._base.config import check_bounds, parameter, parameter_class
from voxgran._base.errors import InputError, check_known
from voxgran.decks.engine import engine_registry


@parameter_class
class General:
    """The section [scene].

    Parameters
    ----------
    seed
        seed of all random numbers.
    seeds
        how many packings to make, with this seed and the next ones.
    unit
        unit of every length below that has none of its own.
    density
        density of the material; a [[shape]] may have its own.
    """

    seed: int = parameter(0)
    seeds: int = parameter(1)
    unit: str = parameter("1")
    density: float = parameter(1.0)


@parameter_class
class Output:
    """The section [output].

    Parameters
    ----------
    vtk
        write the scene for ParaView.
    statistics
        write the measures as netCDF.
    report
        write the page with pictures.
    interactive
        give the page a view that can be turned and cut in a browser.
    snapshots
        most snapshots of the run to keep for ParaView; 0 for none.
    dem
        engines to write input for.
    clump
        number of spheres of a clump in that input, for shapes that an engine does not hold.

    Raises
    ------
    UnknownNameError
        If an engine is unknown; the message gives the nearest name.
    InputError
        If the number of snapshots is negative or 1, or that of spheres below 1.
    """

    vtk: bool = parameter(True)
    statistics: bool = parameter(True)
    report: bool = parameter(True)
    interactive: bool = parameter(True)
    snapshots: int = parameter(0)
    dem: tuple[str, ...] = parameter(())
    clump: int | None = parameter(None, at_least=1)

    def __post_init__(self) -> None:
        """Refuse engines that are not there, and a single snapshot."""
        check_bounds(self, of="[output]")
        if as_count(self.snapshots, "[output] snapshots") == 1:
            raise InputError("[output] snapshots is 1: a series has at least 2; give more, or 0 for none")
        # what is installed is looked up only where engines are named: that takes longer than all else of a scene
        known = engine_registry().names() if self.dem else ()
        for name in self.dem:
            check_known("[output] dem engine", name, known)
