"""Parameters of digital packing, and those that methods share which search the whole lattice."""

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from voxgran._base.calls import explained_methods
from voxgran._base.config import parameter, parameter_class
from voxgran._base.errors import InputError
from voxgran.packing.digital.container_lattice import MOST_ORIENTATIONS
from voxgran.packing.walking.parameters import Walking


@explained_methods
@dataclass(frozen=True, kw_only=True)
class Digital(Walking):
    """Parameters of digital packing.

    Parameters
    ----------
    voxel_size
        edge length of a voxel; if omitted, 1/16 of the median diameter.
    cover
        voxels that represent a grain: all that it touches, so that grains never overlap, or those whose center lies in
        it.
    rate
        fraction of the attempts that insert a grain, with feed 'rain'.
    downward_share
        fraction of the moves that go downward, with gravity.
    vibration_up
        fraction of the moves that go upward at the beginning of the first vibration cycle.
    rotation_share
        fraction of the attempts that rotate a grain instead of moving it.
    orientations
        number of orientations that a grain can take, rounded up to a multiple of the number of lattice rotations; 1 for
        no rotation.
    guided
        fraction of the moves following a refused move that lead away from the contact that caused the refusal.
    schedule
        order in which grains are moved: at random, in groups that are neighbors in space, which is faster in large
        beds, or at random without the grains that have come to rest.

    Raises
    ------
    InputError
        If a number is out of its range, `downward_share` and `vibration_up` exceed 1 together, or parameters do not go
        together.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), vg.methods.Digital(voxel_size=0.1), count=20).count
    20
    """

    usual_voxel_size: ClassVar[float] = 1 / 16

    voxel_size: float | None = parameter(None, unit="length", above=0.0)
    cover: Literal["touch", "center"] = parameter("touch")
    rate: float = parameter(0.001, above=0.0, at_most=1.0)
    downward_share: float = parameter(0.42, at_least=0.0, at_most=1.0)
    vibration_up: float = parameter(0.42, at_least=0.0, at_most=1.0)
    rotation_share: float = parameter(0.15, at_least=0.0, at_most=1.0)
    orientations: int = parameter(24, at_least=1, at_most=MOST_ORIENTATIONS)
    guided: float = parameter(0.0, at_least=0.0, at_most=1.0)
    schedule: Literal["random", "sorted", "sleeping"] = parameter("random")

    def __post_init__(self) -> None:
        """Check the ranges, and that the parameters go together."""
        super().__post_init__()
        total = self.downward_share + self.vibration_up
        if total > 1.0:
            raise InputError(
                f"downward_share + vibration_up is {total:g}: fractions must not exceed 1; lower one of them"
            )

    def needs_gravity(self) -> dict[str, bool]:
        """Return what needs a direction of gravity, as errors name it, and whether it is set."""
        return {"lid is true": self.lid, "schedule is 'sleeping'": self.schedule == "sleeping"}


@parameter_class
class LatticeSearch:
    """Parameters of methods that put each grain at a site of the lattice, where it stays.

    Parameters
    ----------
    voxel_size
        edge of a voxel.
    cover
        voxels that a grain takes: all that it touches, or those whose center it contains.
    turned
        whether grains may also take the other rotations of the lattice.
    orientations
        voxelized poses of each kind: the given one, then random ones; each with its lattice rotations.

    Raises
    ------
    InputError
        If a number is out of its range.
    """

    usual_voxel_size: ClassVar[float]
    expected_seconds: ClassVar[Any]  # of a problem and a voxel size in median diameters

    voxel_size: float | None = parameter(None, unit="length", above=0.0)
    cover: Literal["touch", "center"] = parameter("touch")
    turned: bool = parameter(True)
    orientations: int = parameter(1, at_least=1, at_most=MOST_ORIENTATIONS)
