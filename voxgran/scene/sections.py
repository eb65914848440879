"""Sections of a scene that are values alone: what holds for all of it, and what is written."""

from voxgran._base.arrays import as_count
from voxgran._base.config import check_bounds, parameter, parameter_class
from voxgran._base.errors import InputError, UnknownNameError
from voxgran._base.names import unknown
from voxgran.decks.engine import engine_registry


@parameter_class
class General:
    """The section [scene]."""

    seed: int = parameter(0, doc="seed of all random numbers")
    seeds: int = parameter(1, doc="how many packings to make, with this seed and the next ones")
    unit: str = parameter("1", doc="unit of every length below that has none of its own")
    density: float = parameter(1.0, doc="density of the material; a [[shape]] may have its own")


@parameter_class
class Output:
    """The section [output].

    Raises
    ------
    UnknownNameError
        If an engine is unknown; the message gives the nearest name.
    InputError
        If the number of snapshots is negative or 1, or that of spheres below 1.
    """

    vtk: bool = parameter(True, doc="write the scene for ParaView")
    statistics: bool = parameter(True, doc="write the measures as netCDF")
    report: bool = parameter(True, doc="write the page with pictures")
    interactive: bool = parameter(True, doc="give the page a view that can be turned and cut in a browser")
    snapshots: int = parameter(0, doc="most snapshots of the run to keep for ParaView; 0 for none")
    dem: tuple[str, ...] = parameter((), doc="engines to write input for")
    clump: int | None = parameter(
        None, doc="number of spheres of a clump in that input, for shapes that an engine does not hold", at_least=1
    )

    def __post_init__(self) -> None:
        """Refuse engines that are not there, and a single snapshot."""
        check_bounds(self, of="[output]")
        if as_count(self.snapshots, "[output] snapshots") == 1:
            raise InputError("[output] snapshots is 1: a series has at least 2; give more, or 0 for none")
        # what is installed is looked up only where engines are named: that takes longer than all else of a scene
        known = engine_registry().names() if self.dem else ()
        for name in self.dem:
            if name not in known:
                raise UnknownNameError(unknown("[output] dem engine", name, known))
