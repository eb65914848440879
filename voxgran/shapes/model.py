"""Shape: the true geometry of a grain in its body frame."""

import hashlib
import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arrays import Floats, Integers, as_faces, as_points, as_positive, as_quaternions, read_only
from voxgran._base.errors import InputError
from voxgran._base.lazy import load
from voxgran._base.rotation import rotation_matrices
from voxgran._base.units import as_unit, stated_unit, unit_factor
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.repairing.diagnose import merged, refuse_dirty
from voxgran.shapes.spheres import Spheres
from voxgran.shapes.surface import Surface, refuse_unfit

Geometry: TypeAlias = Mesh | Primitive | Spheres | Outline | Surface


@dataclass(frozen=True, eq=False)
class Shape:
    """Immutable solid or open surface with its centroid at the origin of its body frame.

    Attributes
    ----------
    geometry : Mesh or Primitive or Spheres or Outline or Surface
        True geometry, which all measures use.
    name : str
        Name in reports.
    offset : tuple of float
        Centroid in the coordinates that the shape was made from.
    unit : str or None
        Unit of lengths, if known.

    Raises
    ------
    UnknownNameError
        If the unit is unknown; the message gives the nearest one.
    """

    geometry: Geometry
    name: str = "shape"
    offset: tuple[float, float, float] = field(default=(0.0, 0.0, 0.0))
    unit: str | None = None

    def __post_init__(self) -> None:
        """Normalize the unit."""
        object.__setattr__(self, "unit", stated_unit(self.unit))

    @classmethod
    def of(cls, geometry: Geometry, *, name: str, unit: str | None = None) -> "Shape":
        """Return the shape of a geometry in any frame, translated to its centroid.

        Parameters
        ----------
        geometry : Mesh or Primitive or Spheres or Outline or Surface
            True geometry.
        name : str
            Name in reports.
        unit : str, optional
            Unit of lengths.
        """
        center = np.asarray(geometry.centroid, dtype=np.float64)
        if not isinstance(geometry, Primitive) and center.any():
            geometry = geometry.moved(-center)
        x, y, z = (float(value) for value in center)
        return cls(geometry, name, (x, y, z), unit)

    @classmethod
    def from_mesh(
        cls, vertices: ArrayLike, faces: ArrayLike, *, name: str = "mesh", unit: str | None = None
    ) -> "Shape":
        """Make a shape from a closed triangle mesh.

        Parameters
        ----------
        vertices : (n, 3) array_like of float
            Corner points, in the unit of lengths; coincident ones are merged.
        faces : (m, 3) array_like of int
            Triangles, counterclockwise seen from outside.
        name : str
            Name in reports.
        unit : str, optional
            Unit of lengths.

        Returns
        -------
        Shape

        Raises
        ------
        InputError
            If an array has the wrong shape, an index is out of range or a coordinate is not finite.
        DirtyMeshError
            If the surface does not bound exactly one solid; the message says where and why.
        """
        points = as_points(vertices, "vertices")
        corners, triangles = merged(points, as_faces(faces, len(points)))
        refuse_dirty(corners, triangles, name)
        return cls.of(Mesh(corners, triangles), name=name, unit=unit)

    @classmethod
    def from_surface(
        cls, vertices: ArrayLike, faces: ArrayLike, *, name: str = "surface", unit: str | None = None
    ) -> "Shape":
        """Make a shape from an open triangle mesh, a sheet or shell without thickness.

        It has an area but no volume; the centroid is that of the area, and the equivalent diameter is that of the disk
        of equal area. Functions that need an interior refuse it.

        Parameters
        ----------
        vertices : (n, 3) array_like of float
            Corner points, in the unit of lengths; coincident ones are merged.
        faces : (m, 3) array_like of int
            Triangles of any orientation; more than two may share an edge.
        name : str
            Name in reports.
        unit : str, optional
            Unit of lengths.

        Returns
        -------
        Shape

        Raises
        ------
        InputError
            If an array has the wrong shape, an index is out of range or a coordinate is not finite.
        DirtyMeshError
            If the triangles are not one open surface without self-intersections.
        """
        points = as_points(vertices, "vertices")
        corners, triangles = merged(points, as_faces(faces, len(points)))
        refuse_unfit(corners, triangles, name)
        return cls.of(Surface(corners, triangles), name=name, unit=unit)

    @cached_property
    def key(self) -> str:
        """Hash of the content: two shapes with the same key are equal."""
        return hashlib.sha256(self.geometry.content()).hexdigest()

    def __eq__(self, other: object) -> bool:
        """Compare by content."""
        return isinstance(other, Shape) and self.key == other.key

    def __hash__(self) -> int:
        """Hash by content."""
        return hash(self.key)

    def __repr__(self) -> str:
        """Name, kind of geometry and size."""
        kind = type(self.geometry).__name__.lower()
        return f"Shape({self.name!r}, {kind}, diameter={self.diameter:.6g})"

    def _repr_html_(self) -> str:
        """Return a small picture and numbers, for notebooks."""
        from voxgran.shapes.thumbnail import shape_card

        return shape_card(self)

    @property
    def dimension(self) -> int:
        """2 for an outline, else 3."""
        return self.geometry.dimension

    @property
    def is_open(self) -> bool:
        """Whether the shape is an open surface, without thickness and interior."""
        return isinstance(self.geometry, Surface)

    def refuse_open(self, what: str) -> None:
        """Raise an error if the shape is an open surface.

        Parameters
        ----------
        what : str
            Operation that needs an interior, such as ``"voxels"``, for the message.

        Raises
        ------
        InputError
            If the shape is an open surface.
        """
        if self.is_open:
            raise InputError(
                f"shape {self.name!r} is an open surface: {what} need a solid, with an inside; use it with "
                "control_point and contact 'points', or give it thickness"
            )

    @property
    def volume(self) -> float:
        """True volume (area in 2D); 0 for an open surface."""
        return self.geometry.volume

    @property
    def surface_area(self) -> float:
        """True surface area (perimeter in 2D); for an open surface that of one side."""
        return self.geometry.surface_area

    @property
    def inertia(self) -> Floats:
        """Inertia tensor about the centroid at unit density, (3, 3); an error for an open surface, which has none."""
        return self.geometry.inertia

    @cached_property
    def diameter(self) -> float:
        """Diameter of the sphere of equal volume (in 2D, and of open surfaces, of the disk of equal area)."""
        if self.is_open:
            return 2 * math.sqrt(self.surface_area / math.pi)
        if self.dimension == 2:
            return 2 * math.sqrt(self.volume / math.pi)
        return float(np.cbrt(6 * self.volume / math.pi))

    @cached_property
    def bounding_radius(self) -> float:
        """Radius of the bounding sphere about the centroid."""
        return self.geometry.bounding_radius

    @cached_property
    def _tessellation(self) -> tuple[Floats, Integers, float]:
        """Vertices, faces and error, computed on first use."""
        vertices, faces, error = self.geometry.tessellation()
        return read_only(vertices), read_only(faces), error

    @property
    def vertices(self) -> Floats:
        """Vertices of the tessellation, (n, 3); in 2D in the plane z = 0."""
        return self._tessellation[0]

    @property
    def faces(self) -> Integers:
        """Triangles of the tessellation, (m, 3)."""
        return self._tessellation[1]

    @property
    def tessellation_error(self) -> float:
        """Largest distance of the tessellation from the true surface, in the unit of lengths."""
        return self._tessellation[2]

    def rotated(self, quaternion: ArrayLike) -> "Shape":
        """Return the shape rotated about its centroid.

        Parameters
        ----------
        quaternion : (4,) array_like of float
            Unit quaternion (w, x, y, z).

        Raises
        ------
        InputError
            If `quaternion` is not a unit quaternion.
        """
        matrix = rotation_matrices(as_quaternions(np.asarray(quaternion)[None], "quaternion"))[0]
        return Shape(self.geometry.rotated(matrix), self.name, self.offset, self.unit)

    def scaled(self, factor: float) -> "Shape":
        """Return the shape with all lengths multiplied by a factor above 0.

        Raises
        ------
        InputError
            If the factor is not a finite number above 0.
        """
        return Shape(self.geometry.scaled(as_positive(factor, "factor")), self.name, self.offset, self.unit)

    def to_unit(self, unit: str) -> "Shape":
        """Return the same shape with its lengths in another unit; lengths without a unit are not converted.

        Parameters
        ----------
        unit : str
            Unit of length, such as ``"mm"``.

        Raises
        ------
        UnknownNameError
            If the unit is unknown; the message gives the nearest one.
        InputError
            If the unit is not a string, or is ``"1"`` although the unit of the shape is known.
        """
        target = as_unit(unit)
        factor = 1.0 if self.unit is None else unit_factor(self.unit, target)
        geometry = self.geometry if factor == 1.0 else self.geometry.scaled(factor)
        x, y, z = (value * factor for value in self.offset)
        return Shape(geometry, self.name, (x, y, z), target)

    def to_pyvista(self) -> Any:
        """Return the tessellation as a `pyvista.PolyData`.

        Raises
        ------
        MissingLibraryError
            If PyVista cannot be loaded.
        """
        faces = np.column_stack([np.full(len(self.faces), 3), self.faces])
        return load("pyvista").PolyData(self.vertices.copy(), faces)

    def to_open3d(self) -> Any:
        """Return the tessellation as an `open3d.geometry.TriangleMesh`.

        Raises
        ------
        MissingLibraryError
            If Open3D cannot be loaded.
        """
        open3d = load("open3d")
        vertices = open3d.utility.Vector3dVector(self.vertices)
        return open3d.geometry.TriangleMesh(vertices, open3d.utility.Vector3iVector(self.faces.astype(np.int32)))
