"""A polygon with holes as a container in two dimensions: from corners, or the bright region of a picture."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from voxgran._base import ExplainedAttributes
from voxgran._base.arrays import Floats, Integers, as_place, as_positive, check_lengths, read_only
from voxgran._base.calls import explained
from voxgran._base.errors import InputError
from voxgran.containers.model import Boundary, ContainerKind, Surface
from voxgran.containers.plane import area_of, as_loops, points_in_plane, prism_of, triangles_of
from voxgran.shapes.images.outline_images import region_loops
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape


@dataclass(frozen=True, init=False, eq=False)
class Polygon(ExplainedAttributes):
    """A region in the plane z = 0 within a loop of straight edges, without holes within others.

    Parameters
    ----------
    corners : (n, 2) array_like of float
        Corners of the outer loop in their order, of either sense, in the unit of lengths.
    holes : sequence of (m, 2) array_like of float
        Corners of each hole.

    Attributes
    ----------
    corners : (n, 2) ndarray of float
        The outer loop, counterclockwise.
    holes : tuple of (m, 2) ndarray of float
        The holes, clockwise.

    Raises
    ------
    CallError
        If there are other arguments than these.
    InputError
        If a loop has fewer than three corners or no area, loops meet themselves or each other, or a hole lies outside
        of the polygon or in another hole.

    Examples
    --------
    >>> import voxgran as vg
    >>> region = vg.Polygon([(0, 0), (6, 0), (6, 4), (0, 4)], holes=[[(2, 1), (3, 1), (3, 2), (2, 2)]])
    >>> region.volume
    23.0
    >>> region.signed_distance([(1, 1.5), (2.5, 1.5)]).tolist()
    [-1.0, 0.5]
    """

    corners: Floats
    holes: tuple[Floats, ...]
    kind: ClassVar[str] = "polygon"
    dimension: ClassVar[int] = 2
    periodic: ClassVar[tuple[bool, bool, bool]] = (False, False, False)

    @explained(hint="Polygon([(0, 0), (6, 0), (3, 5)])")
    def __init__(self, corners: "ArrayLike", *, holes: "Sequence[ArrayLike]" = ()) -> None:
        outer, *inner = as_loops(corners, holes)
        object.__setattr__(self, "corners", outer)
        object.__setattr__(self, "holes", tuple(inner))

    @classmethod
    def from_image(
        cls,
        source: str | os.PathLike[str] | NDArray[Any],
        *,
        pixel_size: float,
        level: float | None = None,
        min_area: float = 9.0,
        origin: "ArrayLike" = (0.0, 0.0),
        key: str | None = None,
    ) -> "Polygon":
        """Make a container of the one bright region of a 2D image, with its holes.

        The loops are traced where the values, linear between the middles of pixels, pass through the level, as
        :func:`voxgran.load_outlines` does it.

        Parameters
        ----------
        source : path-like or (nx, ny) ndarray
            A file as :func:`voxgran.load_image` takes it, ``.png`` and ``.tif`` pictures with y upward; or values, the
            region brighter than the level.
        pixel_size : float
            Edge of a pixel, in the unit of lengths.
        level : float, optional
            Value at the boundary; default: halfway between the smallest and the largest.
        min_area : float
            Regions and holes of less area, in pixels, are left out as noise.
        origin : (2,) sequence of float
            Lower corner of the image.
        key : str, optional
            Which array of an ``.npz`` or ``.vti`` file.

        Returns
        -------
        Polygon

        Raises
        ------
        MissingFileError
            If there is no such file.
        FileFormatError
            If it is of no known format, or damaged.
        InputError
            If the image has not two axes, holds values that are not finite, no region or several are found, or an
            option is out of range.

        Examples
        --------
        >>> import numpy as np
        >>> import voxgran as vg
        >>> picture = np.zeros((20, 20))
        >>> picture[5:15, 5:15] = 1.0
        >>> vg.Polygon.from_image(picture, pixel_size=0.1).volume < 1.0
        True
        """
        corner = as_place(origin, "origin", length=2)
        outer, holes = region_loops(source, level=level, pixel_size=pixel_size, min_area=min_area, key=key)
        return cls(outer + corner, holes=[hole + corner for hole in holes])

    def __eq__(self, other: object) -> bool:
        """Compare the corners."""
        return isinstance(other, Polygon) and self.to_mapping() == other.to_mapping()

    def __hash__(self) -> int:
        """Hash by the corners."""
        return hash(tuple(loop.tobytes() for loop in self._loops))

    def __repr__(self) -> str:
        """Return the number of corners and holes, and the area."""
        return f"Polygon({len(self.corners)} corners, {len(self.holes)} holes, area={self.volume:.6g})"

    @property
    def _loops(self) -> tuple[Floats, ...]:
        """The outer loop and the holes."""
        return self.corners, *self.holes

    @cached_property
    def volume(self) -> float:
        """Area."""
        return sum(area_of(loop) for loop in self._loops)

    @property
    def bounds(self) -> Floats:
        """Lower and upper corner, (2, 3)."""
        corners = np.array([self.corners.min(axis=0), self.corners.max(axis=0)])
        return np.column_stack([corners, np.zeros(2)])

    @cached_property
    def boundary(self) -> Boundary:
        """The walls in closed form: those of a prism whose ends are never the nearest wall of points in the plane."""
        prism = prism_of(self._loops, float(np.ptp(self.corners, axis=0).max()))
        return Boundary((Surface(Shape(prism, "polygon"), self._loops),))

    def signed_distance(self, points: "ArrayLike") -> Floats:
        """Return the distance of (n, 2 or 3) points from the nearest edge, negative inside; z does not count.

        Raises
        ------
        InputError
            If the points are not finite numbers in two or three columns.

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.Polygon([(0, 0), (2, 0), (2, 2), (0, 2)]).signed_distance([(1, 1), (1, 2.5)]).tolist()
        [-1.0, 0.5]
        """
        solid = self.boundary.solid
        assert solid is not None
        assert isinstance(solid.geometry, Mesh)
        return solid.geometry.tree.signed_distance(points_in_plane(points))

    def mesh(self) -> tuple[Floats, Integers]:
        """Return vertices and triangles of the area.

        Examples
        --------
        >>> import voxgran as vg
        >>> vertices, faces = vg.Polygon([(0, 0), (2, 0), (2, 2), (0, 2)]).mesh()
        >>> vertices.shape
        (4, 3)
        """
        flat = np.concatenate(self._loops)
        return np.column_stack([flat, np.zeros(len(flat))]), triangles_of(self._loops)

    def scaled(self, factor: float) -> "Polygon":
        """Return the polygon with all coordinates multiplied.

        Raises
        ------
        InputError
            If the factor is not above 0, or the extent is not between 1e-60 and 1e60 any longer.

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.Polygon([(0, 0), (2, 0), (2, 2), (0, 2)]).scaled(0.5).volume
        1.0
        """
        times = as_positive(factor, "factor")
        check_lengths(np.ptp(self.corners, axis=0) * times, "extent of the polygon")
        other = object.__new__(Polygon)
        object.__setattr__(other, "corners", read_only(self.corners * times))
        object.__setattr__(other, "holes", tuple(read_only(hole * times) for hole in self.holes))
        return other

    def to_mapping(self) -> dict[str, Any]:
        """Return kind and loops as JSON-able values.

        Examples
        --------
        >>> import voxgran as vg
        >>> sorted(vg.Polygon([(0, 0), (2, 0), (2, 2), (0, 2)]).to_mapping())
        ['corners', 'holes', 'kind']
        """
        return {"kind": self.kind, "corners": self.corners.tolist(), "holes": [hole.tolist() for hole in self.holes]}


def _make(rest: Mapping[str, Any], where: str) -> Polygon:
    """Return a polygon from its corners or from a picture.

    Parameters
    ----------
    file : optional
        Picture of its inside, relative to the scene file.
    pixel_size : optional
        Edge of a pixel of a picture, a length above 0.
    level : optional
        Value at the boundary of a picture; default: halfway between its smallest and its largest.
    min_area : optional
        Regions and holes of a picture of less area, in pixels, are left out as noise.
    origin : optional
        Lower corner of a picture; default: 0.
    corners : optional
        Corners in order, shape (n, 2), in place of a file.
    holes : optional
        Corners of each hole.
    """
    if ("file" in rest) == ("corners" in rest):
        told = "both given" if "file" in rest else "both missing"
        raise InputError(f"{where} corners and file are {told}: a polygon has either; give one of them")
    own = ("corners", "holes") if "corners" in rest else ("file", "pixel_size", "level", "min_area", "origin")
    for key in rest:
        if key not in own:
            raise InputError(
                f"{where} {key} is given with {own[0]}: beside it there may be {', '.join(own[1:])} only; leave it out"
            )
    if "corners" in rest:
        return Polygon(rest["corners"], holes=rest.get("holes", ()))
    if "pixel_size" not in rest:
        raise InputError(f"{where} pixel_size is missing: it gives a picture its lengths; add it")
    return Polygon.from_image(rest["file"], **{key: value for key, value in rest.items() if key != "file"})


registration = ContainerKind(
    container=Polygon, taken=("file", "pixel_size", "level", "min_area", "origin", "corners", "holes"), make=_make
)
