"""Container: the region of space of a packing."""

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from numpy.typing import ArrayLike

from voxgran._base.arrays import Floats, Integers, check_lengths
from voxgran._base.errors import InputError, shown
from voxgran.shapes.model import Shape

#: attributes that an object must have to be a container
NEEDED = ("kind", "dimension", "periodic", "volume", "bounds", "signed_distance", "mesh", "scaled", "to_mapping")


@runtime_checkable
class Container(Protocol):
    """A region of space in which grains are packed.

    Notes
    -----
    A container may also have an attribute ``boundary``, its walls in closed form as a :class:`Boundary`. Without it the
    container is known by its signed distance and its mesh only, which some packing methods refuse.
    """

    @property
    def kind(self) -> str:
        """Name in scene files and packings, such as ``"box"``."""

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

    def signed_distance(self, points: "ArrayLike") -> Floats:
        """Return the distance of (n, 3) points from the nearest wall, negative inside; periodic axes have no wall."""

    def mesh(self) -> tuple[Floats, Integers]:
        """Return vertices (n, 3) and triangles (m, 3) of the boundary, for pictures and files."""

    def scaled(self, factor: float) -> "Container":
        """Return the container with all lengths (and its corner) multiplied."""

    def to_mapping(self) -> dict[str, Any]:
        """Return kind and parameters as JSON-able values, from which `make_container` makes it again."""


@dataclass(frozen=True, kw_only=True)
class Boundary:
    """The walls of a container in closed form."""

    flat: tuple[bool, bool, bool] = (False, False, False)  # across which axes there are two plane walls, at the bounds
    # 2: a wall around the line along z through `center`, in 2D that of a disk; 3: a wall around the point `center`
    round_axes: int = 0
    radius: float = 0.0  # of the round wall; 0 without one
    center: tuple[float, float, float] = (0.0, 0.0, 0.0)  # of a sphere, or a point of the axis of a cylinder
    # shape of triangles whose surface is the wall, in its own frame; its ``offset`` places it; in 2D a prism upon the
    # region, so high that its ends are never the nearest wall of a point in the plane
    solid: Shape | None = None
    # in 2D the loops (n, 2) that bound that region, the outer one counterclockwise, then its holes clockwise
    loops: tuple[Floats, ...] = ()

    @property
    def is_flat(self) -> bool:
        """Whether the container is its bounds: a box or a rectangle, walled or periodic along each axis."""
        return self.round_axes == 0 and self.solid is None


#: the boundary of a container that is known by its signed distance only
UNKNOWN = Boundary(round_axes=-1)


def boundary_of(container: Container) -> Boundary:
    """Return the walls of a container in closed form; :data:`UNKNOWN` if it gives none."""
    boundary = getattr(container, "boundary", UNKNOWN)
    return boundary if isinstance(boundary, Boundary) else UNKNOWN


def check_container(container: Any) -> None:
    """Check that an object is a container.

    Raises
    ------
    InputError
        If it lacks attributes of :class:`Container`, or is smaller than 1e-60 or larger than 1e60.
    """
    if isinstance(container, Shape):
        remedy = "a Rectangle, Disk or Polygon" if container.dimension == 2 else "a Box, or ClosedMesh(shape) of a mesh"
        raise InputError(f"container is {shown(container)}: a Shape is no container; give {remedy}")
    missing = [name for name in NEEDED if not hasattr(container, name)]
    if isinstance(container, type) or "signed_distance" in missing:
        raise InputError(f"container is {shown(container)}: it must be a container; give a Box, or a Rectangle in 2D")
    if missing:
        raise InputError(f"container has no {', '.join(missing)}: a container needs {', '.join(NEEDED)}; add them")
    check_lengths(container.bounds[1] - container.bounds[0], "length of the container")
