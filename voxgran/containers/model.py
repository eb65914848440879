"""Container: the region of space of a packing.

Containers are made from plain mappings, as in scene files and saved packings, by the registry of their kinds.
"""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers, check_lengths
from voxgran._base.calls import explained
from voxgran._base.errors import InputError, MissingLibraryError, UnknownNameError, check_known, nearest, shown, unknown
from voxgran._base.registry import Registry
from voxgran.geometry.periods import wrapped
from voxgran.geometry.walls import Plane, Round
from voxgran.shapes.model import Shape

#: attributes that an object must have to be a container
NEEDED = ("kind", "dimension", "periodic", "volume", "bounds", "signed_distance", "mesh", "scaled", "to_mapping")

#: largest distance from the origin in lengths of a container: beyond, less than four digits of coordinates are left
FARTHEST = 1e12


@runtime_checkable
class Container(Protocol):
    """A region of space in which grains are packed.

    Notes
    -----
    A container may also have an attribute ``boundary``, its walls in closed form as a :class:`Boundary`. Without it the
    container is known by its signed distance and its mesh only, which some packing methods refuse. With a method
    ``doubt(diameter)`` it says in a sentence what speaks against packing grains of a median diameter, ``""`` if nothing
    does; :func:`voxgran.pack` warns of it. An attribute ``tilt`` (xy, xz, yz) makes a periodic container repeat by the
    vectors (lx, 0, 0), (xy, ly, 0) and (xz, yz, lz), where lx, ly and lz are the lengths of its bounds.
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
        """Lower and upper corner, (2, 3), in the unit of lengths; z = 0 in 2D; as if a tilted box stood upright."""

    def signed_distance(self, points: "ArrayLike") -> Floats:
        """Return the distance of (n, 3) points from the nearest wall, negative inside; periodic axes have no wall."""

    def mesh(self) -> tuple[Floats, Integers]:
        """Return vertices (n, 3) and triangles (m, 3) of the boundary, for pictures and files."""

    def scaled(self, factor: float) -> "Container":
        """Return the container with all lengths (and its corner) multiplied."""

    def to_mapping(self) -> dict[str, Any]:
        """Return kind and parameters as JSON-able values, from which `make_container` makes it again."""


class Surface(NamedTuple):
    """Triangles as a wall: the surface of a shape in its own frame, which its ``offset`` places.

    In 2D it is a prism upon the region, so high that its ends are never the nearest wall of a point in the plane.
    """

    solid: Shape
    # in 2D the loops (n, 2) that bound that region, the outer one counterclockwise, then its holes clockwise
    loops: tuple[Floats, ...] = ()


@dataclass(frozen=True)
class Boundary:
    """The walls of a container in closed form: what other rooms ask of them.

    walls: planes, all at the bounds, walls of revolution, or one surface alone. The container is what lies within all.
    """

    walls: tuple[Plane | Round | Surface, ...] = ()

    @cached_property
    def planes(self) -> tuple[Plane, ...]:
        """The plane walls."""
        return tuple(wall for wall in self.walls if isinstance(wall, Plane))

    @cached_property
    def round(self) -> tuple[Round, ...]:
        """The walls of revolution."""
        return tuple(wall for wall in self.walls if isinstance(wall, Round))

    @cached_property
    def flat(self) -> tuple[bool, bool, bool]:
        """Across which axes there are two plane walls."""
        across = {plane.axis for plane in self.planes}
        return 0 in across, 1 in across, 2 in across

    @cached_property
    def solid(self) -> Shape | None:
        """Shape of triangles whose surface is the wall; None for other walls."""
        return next((wall.solid for wall in self.walls if isinstance(wall, Surface)), None)

    @cached_property
    def loops(self) -> tuple[Floats, ...]:
        """Loops that bound a polygon; none of other walls."""
        return next((wall.loops for wall in self.walls if isinstance(wall, Surface)), ())

    @property
    def is_flat(self) -> bool:
        """Whether the container is its bounds: a box or a rectangle, walled or periodic along each axis."""
        return self is not UNKNOWN and len(self.planes) == len(self.walls)

    @property
    def cylinder(self) -> Round | None:
        """The upright cylinder, or the circle of a disk, where it is the only wall that is not plane."""
        return self._only("cylinder") if all(plane.axis == 2 for plane in self.planes) else None

    @property
    def sphere(self) -> Round | None:
        """The sphere where it is the only wall."""
        return None if self.planes else self._only("sphere")

    @property
    def is_usual(self) -> bool:
        """Whether all packing methods know the walls: planes, and one cylinder, sphere or surface at most."""
        return self is not UNKNOWN and (not self.round or self.cylinder is not None or self.sphere is not None)

    @property
    def is_upright(self) -> bool:
        """Whether all walls of revolution are about a vertical axis, and none of them is a plane."""
        return all(wall.is_upright and wall.kind != "plane" for wall in self.round)

    def signed_distance(self, points: Floats) -> Floats:
        """Return the distance (n,) of points (n, 3) from the nearest plane or wall of revolution, negative inside.

        Outside, near edges, it is a lower bound of the distance.
        """
        walls: tuple[Plane | Round, ...] = (*self.planes, *self.round)
        return np.asarray(-np.min([wall.distance(points) for wall in walls], axis=0))

    def along(self, points: Floats, axes: tuple[int, int, int]) -> tuple[Floats, Floats]:
        """Return between which distances from points (n, 3), along the last one of the axes, lines are within all walls
        of revolution; NaN for lines that miss.
        """
        ends = np.array([wall.along(points, axes) for wall in self.round])
        low, high = ends[:, 0].max(axis=0), ends[:, 1].min(axis=0)
        return np.where(low < high, low, np.nan), np.where(low < high, high, np.nan)

    def has_flat_ends(self, axis: int) -> bool:
        """Whether a plane, or none, ends the container on both sides along an axis, along which no wall narrows it."""
        return self.is_flat or (self.cylinder is not None and self.flat[axis])

    def longest_line(self, lengths: Floats) -> float:
        """Return an upper bound of the length of lines in the container, by the lengths of its bounds."""
        # axes around which a wall closes share one diameter
        shared = max((wall.axes for wall in self.round), default=1) if self.is_upright else 1
        return float(linear.norm(lengths[shared - 1 :]))

    def _only(self, kind: str) -> Round | None:
        """Return the wall of revolution of a kind if there is no other."""
        return self.round[0] if len(self.round) == 1 and self.is_upright and self.round[0].kind == kind else None


#: the boundary of a container that is known by its signed distance only
UNKNOWN = Boundary()


def boundary_of(container: Container) -> Boundary:
    """Return the walls of a container in closed form; :data:`UNKNOWN` if it gives none."""
    boundary = getattr(container, "boundary", UNKNOWN)
    return boundary if isinstance(boundary, Boundary) else UNKNOWN


def tilt_of(container: Container) -> tuple[float, float, float]:
    """Return the tilts (xy, xz, yz) of a periodic container, 0 of an upright one: see :class:`voxgran.Box`."""
    tilt: tuple[float, ...] = getattr(container, "tilt", ())
    xy, xz, yz, *_ = *tilt, 0.0, 0.0, 0.0
    return xy, xz, yz


def periods_of(container: Container) -> Floats:
    """Return the vectors by which a container repeats, the rows of a (3, 3) array, 0 for axes that are not periodic.

    Row k is at right angles to the axes behind k: what lies in the bounds, repeated by all sums of the vectors, fills
    space.
    """
    lower, upper = container.bounds
    x, y, z = np.where(container.periodic, upper - lower, 0.0).tolist()
    xy, xz, yz = tilt_of(container)
    return np.array([(x, 0.0, 0.0), (xy, y, 0.0), (xz, yz, z)])


def within_periods(points: Floats, container: Container) -> Floats:
    """Return points (n, 3) moved by periods into the cell of a container, along axes that are periodic."""
    return wrapped(points, np.asarray(container.bounds[0], dtype=np.float64), periods_of(container))


def refuse_tilt(container: Container, what: str, remedy: str) -> None:
    """Refuse a tilted container, where what asks for it knows upright ones only.

    Raises
    ------
    InputError
        If the container is tilted.
    """
    if any(tilt := tilt_of(container)):
        raise InputError(f"container has the tilt {shown(tilt)}: {what} takes upright containers only: {remedy}")


def doubt_about(container: Container, diameter: float) -> str:
    """Return what speaks against packing grains of a median diameter in a container, as a sentence; else ``""``."""
    doubt = getattr(container, "doubt", None)
    return "" if doubt is None else str(doubt(diameter))


def check_container(container: Any) -> None:
    """Check that an object is a container.

    Raises
    ------
    InputError
        If it lacks attributes of :class:`Container`, is smaller than 1e-60 or larger than 1e60, or so far from the
        origin that its lengths are lost in rounding.
    """
    if isinstance(container, Shape):
        remedy = "a Rectangle, Disk or Polygon" if container.dimension == 2 else "a Box, or ClosedMesh(shape) of a mesh"
        raise InputError(f"container is {shown(container)}: a Shape is no container; give {remedy}")
    missing = [name for name in NEEDED if not hasattr(container, name)]
    if isinstance(container, type) or "signed_distance" in missing:
        raise InputError(f"container is {shown(container)}: it must be a container; give a Box, or a Rectangle in 2D")
    if missing:
        raise InputError(f"container has no {', '.join(missing)}: a container needs {', '.join(NEEDED)}; add them")
    lengths, far = container.bounds[1] - container.bounds[0], np.abs(container.bounds).max(axis=0)
    check_lengths(lengths, "length of the container")
    if (lost := far > FARTHEST * lengths).any():
        raise InputError(
            f"container is {lengths[lost][0]:g} long and {far[lost][0]:g} away from the origin: it must be at most "
            f"{FARTHEST:g} times its length away; move it to the origin"
        )


#: key of a mapping that names the package of a kind that is not part of voxgran
PACKAGE = "package"


@dataclass(frozen=True, slots=True, kw_only=True)
class ContainerKind:
    """One registered kind of containers.

    Attributes
    ----------
    name : str
        The `kind` of its containers, which is the name of the file or entry point.
    container : type
        Their class, which may be that of another kind.
    make : callable, optional
        ``make(values, where)`` returns the container of a mapping where its keys beside ``kind`` are not the arguments
        of the class; `where` names the mapping in messages. It checks which keys are required.
    taken : tuple of str
        Keys that `make` takes. Their meanings stand under "Parameters" in its docstring; the meanings of arguments
        stand in the docstring of the class.

    Examples
    --------
    >>> from voxgran.containers.model import container_registry
    >>> container_registry().get("cylinder").keys
    {'radius': True, 'height': True, 'origin': False}
    """

    name: str = ""
    container: type
    make: Callable[[Mapping[str, Any], str], Container] | None = None
    taken: tuple[str, ...] = ()

    @property
    def keys(self) -> dict[str, bool]:
        """Keys of a mapping beside ``kind``, and whether each is required: an argument without a default."""
        if self.make is not None:
            return dict.fromkeys(self.taken, False)
        return {one.name: one.default is one.empty for one in inspect.signature(self.container).parameters.values()}


def container_registry() -> Registry[ContainerKind]:
    """Return the registry of the kinds of containers."""
    return Registry("container", "voxgran.containers.kinds", ContainerKind, group="voxgran.containers")


def package_of(container: Container) -> str:
    """Return the package that registers the class of a container; ``""`` for those of voxgran.

    Raises
    ------
    InputError
        If it is not registered.
    """
    registry, kind = container_registry(), container.kind
    if kind not in registry.names() or registry.get(kind).container is not type(container):
        raise InputError(
            f"container is a {type(container).__name__}, a class that is not registered: load could not make it again; "
            f"register it by an entry point {kind!r} of the group {registry.group!r}, or give the packing a container "
            "of voxgran with dataclasses.replace, such as a ClosedMesh of the same walls"
        )
    return registry.package_of(kind)


def saved_mapping(container: Container) -> dict[str, Any]:
    """Return the mapping from which :func:`make_container` makes a container again, with its package if it has one.

    Raises
    ------
    InputError
        If the container is of a class that is not registered.
    """
    package = package_of(container)
    return container.to_mapping() | ({PACKAGE: package} if package else {})


@explained(hint='make_container({"kind": "box", "lengths": [4, 4, 6]})')
def make_container(mapping: Mapping[str, Any], where: str = "[container]") -> Container:
    """Return a container from kind and parameters.

    Parameters
    ----------
    mapping : mapping
        With the key ``kind``; a mesh has a ``file``, or ``vertices`` and ``faces``, a polygon ``corners`` and
        ``holes``, or the ``file`` of a picture with its ``pixel_size``.
    where : str
        Name of the mapping in messages.

    Returns
    -------
    Container

    Raises
    ------
    UnknownNameError
        If the kind or a key is unknown.
    InputError
        If `mapping` is not a mapping, a key is missing or a value is invalid.
    MissingLibraryError
        If the mapping was saved with a kind of another package, which is not installed.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.make_container({"kind": "box", "lengths": [4, 4, 6], "periodic": "xy"}).volume
    96.0
    """
    if not isinstance(mapping, Mapping):
        raise InputError(f"{where} is {shown(mapping)}: it must be a mapping with the key kind; give one")
    rest, registry = dict(mapping), container_registry()
    kind, package = rest.pop("kind", None), rest.pop(PACKAGE, None)
    names = registry.names()
    if kind is None:
        # another key may have been written in its place
        slip = next((key for key in rest if nearest(key, ("kind",))), None)
        meant = "" if slip is None else f", and {slip!r} may stand for it"
        raise InputError(f"{where} kind is missing{meant}: it must be one of {', '.join(names)}; add it")
    if package is not None and kind not in names:
        raise MissingLibraryError(
            f"{where} kind {kind!r} is of the package {package!r}, which is not installed: install it, such as with "
            f"'pip install {package}'"
        )
    check_known(f"{where} kind", kind, names)
    entry = registry.get(kind)
    for key in rest:
        if key == "unit" and key not in entry.keys:
            raise UnknownNameError(f"{unknown(f'{where} key', key, entry.keys)}; a scene states its unit in [scene]")
        check_known(f"{where} key", key, entry.keys)
    for key, required in entry.keys.items():
        if required and key not in rest:
            raise InputError(f"{where} {key} is missing: kind {kind!r} needs it; add it")
    container: Container = entry.container(**rest) if entry.make is None else entry.make(rest, where)
    return container
