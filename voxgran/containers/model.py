"""Container: the region of space of a packing."""

from typing import Any, Protocol, runtime_checkable

from numpy.typing import ArrayLike

from voxgran._base.arrays import Floats, Integers


@runtime_checkable
class Container(Protocol):
    """A region of space in which grains are packed.

    Attributes
    ----------
    kind : str
        Name in scene files and packings, such as ``"box"``.
    dimension : int
        2 or 3.
    periodic : tuple of bool
        Whether each of the three axes is periodic.
    """

    @property
    def kind(self) -> str:
        """Name in scene files and packings."""

    @property
    def dimension(self) -> int:
        """2 or 3."""

    @property
    def periodic(self) -> tuple[bool, bool, bool]:
        """Whether each of the three axes is periodic."""

    @property
    def volume(self) -> float:
        """Volume (area in 2D)."""

    @property
    def bounds(self) -> Floats:
        """Lower and upper corner, (2, 3), in the unit of lengths; z = 0 in 2D."""

    def signed_distance(self, points: ArrayLike) -> Floats:
        """Return the distance of (n, 3) points from the nearest wall, negative inside; periodic axes have no wall."""

    def mesh(self) -> tuple[Floats, Integers]:
        """Return vertices (n, 3) and triangles (m, 3) of the boundary, for pictures and files."""

    def scaled(self, factor: float) -> "Container":
        """Return the container with all lengths (and its corner) multiplied."""

    def to_mapping(self) -> dict[str, Any]:
        """Return kind and parameters as JSON-able values, from which `make_container` restores the container."""
