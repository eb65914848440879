"""Shape: the true geometry of a grain in its body frame."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base import ExplainedAttributes, public
from voxgran._base.arithmetic import linear
from voxgran._base.arrays import (
    Booleans,
    Floats,
    as_faces,
    as_points,
    as_positive,
    as_quaternions,
    as_vector,
    check_type,
)
from voxgran._base.calls import explained_methods
from voxgran._base.errors import InputError
from voxgran._base.lazy import load
from voxgran._base.scalars import plain_text
from voxgran._base.units import as_unit, stated_unit, unit_factor
from voxgran.geometry.rotation import rotation_matrices
from voxgran.shapes.describing.body import Body, Geometry
from voxgran.shapes.generating.record import Record
from voxgran.shapes.mesh import Mesh, Surface, refuse_unfit
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.repairing.diagnose import as_solid, merged


@explained_methods
@dataclass(frozen=True, eq=False, repr=False)
class Shape(ExplainedAttributes, Body):
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
    record : mapping
        What the generator notes about the shape, such as the dimension of a sponge: plain values and arrays by name. It
        is no part of equality and `key`, and shapes that are rotated or scaled keep it as it is. Files of packings keep
        it too, but for arrays of more than 4 MiB.

    Raises
    ------
    UnknownNameError
        If the unit is unknown; the message gives the nearest one.
    InputError
        If the name is no text, or the record holds something else.

    Examples
    --------
    >>> import voxgran as vg
    >>> cube = vg.shapes.box(lengths=(2, 2, 2))
    >>> cube.volume, cube.surface_area, cube.bounds.tolist()
    (8.0, 24.0, [[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])
    """

    geometry: Geometry
    name: str = "shape"
    offset: tuple[float, float, float] = field(default=(0.0, 0.0, 0.0))
    unit: str | None = None
    record: Mapping[str, Any] = field(default_factory=Record, kw_only=True)

    def __post_init__(self) -> None:
        """Check the name, normalize the unit and copy the record."""
        check_type(self.name, str, "name", "a text")
        object.__setattr__(self, "name", plain_text(self.name))
        object.__setattr__(self, "unit", stated_unit(self.unit))
        object.__setattr__(self, "record", Record(self.record))

    @classmethod
    def of(
        cls, geometry: Geometry, *, name: str, unit: str | None = None, record: Mapping[str, Any] | None = None
    ) -> "Shape":
        """Return the shape of a geometry in any frame, translated to its centroid.

        Parameters
        ----------
        geometry : Mesh or Primitive or Spheres or Outline or Surface
            True geometry.
        name : str
            Name in reports.
        unit : str, optional
            Unit of lengths.
        record : mapping, optional
            What its generator notes about it.

        Examples
        --------
        >>> import numpy as np
        >>> import voxgran as vg
        >>> from voxgran.shapes.spheres import Spheres
        >>> pair = vg.Shape.of(Spheres(np.array([[0.0, 0, 0], [2, 0, 0]]), np.ones(2)), name="pair")
        >>> pair.offset
        (1.0, 0.0, 0.0)
        """
        center = np.asarray(geometry.centroid, dtype=np.float64)
        if not isinstance(geometry, Primitive) and center.any():
            geometry = geometry.moved(-center)
        x, y, z = (float(value) for value in center)
        return cls(geometry, name, (x, y, z), unit, record=record or {})

    @classmethod
    def from_mesh(
        cls, vertices: "ArrayLike", faces: "ArrayLike", *, name: str = "mesh", unit: str | None = None
    ) -> "Shape":
        """Make a shape from a closed triangle mesh.

        Parameters
        ----------
        vertices : (n, 3) array_like of float
            Corner points, in the unit of lengths; coincident ones are merged, unless they keep parts of the surface
            apart that touch along an edge.
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

        Examples
        --------
        >>> import voxgran as vg
        >>> corners = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
        >>> solid = vg.Shape.from_mesh(corners, [(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)])
        >>> round(solid.volume, 4), solid.offset
        (0.1667, (0.25, 0.25, 0.25))
        """
        points = as_points(vertices, "vertices")
        return cls.of(Mesh(*as_solid(points, as_faces(faces, len(points)), name)), name=name, unit=unit)

    @classmethod
    def from_surface(
        cls, vertices: "ArrayLike", faces: "ArrayLike", *, name: str = "surface", unit: str | None = None
    ) -> "Shape":
        """Make a shape from an open triangle mesh, a sheet or shell without thickness, or from the skin of a solid.

        Closed or not, it has an area and no volume; the centroid is that of the area, the equivalent diameter that of
        the disk of equal area. Functions that need an interior refuse it.

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
            If the triangles are not one surface without self-intersections.

        Examples
        --------
        >>> import voxgran as vg
        >>> sheet = vg.Shape.from_surface([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [(0, 1, 2), (0, 2, 3)])
        >>> sheet.surface_area, sheet.volume
        (1.0, 0.0)
        """
        points = as_points(vertices, "vertices")
        corners, triangles = merged(points, as_faces(faces, len(points)))
        refuse_unfit(corners, triangles, name)
        return cls.of(Surface(corners, triangles), name=name, unit=unit)

    def refuse_open(self, what: str) -> None:
        """Raise an error if the shape is open; `what` names the operation that needs an interior, such as ``"voxels"``.

        Raises
        ------
        InputError
            If the shape is an open surface.

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.shapes.sphere().refuse_open("voxels")  # a solid
        """
        if self.is_open:
            raise InputError(
                f"shape {self.name!r} is an open surface: {what} need a solid, with an inside; use it with "
                "control_point and contact 'kdtree', or give it thickness"
            )

    def contains(self, points: "ArrayLike") -> Booleans:
        """Return whether points lie in the solid.

        Parameters
        ----------
        points : (n, 3) array_like of float
            In the body frame; z = 0 in 2D.

        Returns
        -------
        (n,) ndarray of bool

        Raises
        ------
        InputError
            If the points are not an (n, 3) array of finite numbers, or the shape is an open surface.

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.shapes.box(lengths=(2, 2, 2)).contains([(0, 0, 0), (1.5, 0, 0)]).tolist()
        [True, False]
        """
        self.refuse_open("points inside")
        if isinstance(self.geometry, Mesh):
            return np.asarray(self._tree.signed_distance(as_points(points)) <= 0)
        assert not isinstance(self.geometry, Surface)
        return self.geometry.contains(as_points(points))

    def signed_distance(self, points: "ArrayLike") -> Floats:
        """Return the distance of points from the surface, negative inside.

        It is exact for meshes, boxes, spheres and outlines. For other shapes it is the distance from the tessellation,
        with an error of at most `tessellation_error` and the sign of the true shape.

        Parameters
        ----------
        points : (n, 3) array_like of float
            In the body frame; z = 0 in 2D.

        Returns
        -------
        (n,) ndarray of float
            In the unit of lengths.

        Raises
        ------
        InputError
            If the points are not an (n, 3) array of finite numbers, or the shape is an open surface.

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.shapes.sphere(radius=1.0).signed_distance([(0, 0, 0), (1.5, 0, 0)]).tolist()
        [-1.0, 0.5]
        """
        self.refuse_open("signed distances")
        places = as_points(points)
        if isinstance(self.geometry, Outline):
            return self.geometry.signed_distance(places)
        if isinstance(self.geometry, Primitive) and self.geometry.kind == "sphere":
            return np.asarray(linear.norm(places, axis=1) - self.bounding_radius)
        distance = self._tree.signed_distance(places)
        if isinstance(self.geometry, Mesh):
            return distance
        return np.where(self.contains(places), -np.abs(distance), np.abs(distance))

    def voxelize(self, voxel_size: float, **options: Any) -> Any:
        """Return the voxels of the solid, as :func:`voxgran.voxelize`, which takes the same options.

        Examples
        --------
        >>> import voxgran as vg
        >>> int(vg.shapes.box(lengths=(2, 2, 2)).voxelize(0.5).mask.sum())
        64
        """
        return public("voxelize")(self, voxel_size=voxel_size, **options)

    def plot(self) -> Any:
        """Show the shape in a window, or return a picture of it, as :func:`voxgran.plot`.

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.shapes.torus().plot()  # doctest: +SKIP
        """
        return public("plot")(self)

    def skin(self) -> "Shape":
        """Return the tessellated surface of the solid as a shape of its own, a closed skin without interior.

        Raises
        ------
        InputError
            If the shape is flat.

        Examples
        --------
        >>> import voxgran as vg
        >>> skin = vg.shapes.box(lengths=(1, 1, 1)).skin()
        >>> skin.is_open, round(skin.surface_area, 12)
        (True, 6.0)
        """
        if self.dimension == 2:
            raise InputError(f"shape {self.name!r} is flat: skins are surfaces of solids; take a solid")
        if self.is_open:
            return self
        surface = Surface(self.vertices.copy(), self.faces.copy())
        return Shape.of(surface, name=self.name, unit=self.unit, record=self.record)

    def rotated(self, quaternion: "ArrayLike") -> "Shape":
        """Return the shape rotated about its centroid.

        Parameters
        ----------
        quaternion : (4,) array_like of float
            Unit quaternion (w, x, y, z).

        Raises
        ------
        InputError
            If `quaternion` is not a unit quaternion.

        Examples
        --------
        >>> import voxgran as vg
        >>> brick = vg.shapes.box(lengths=(3, 1, 1))
        >>> brick.rotated((0.5**0.5, 0, 0, 0.5**0.5)).bounds[1].round(6).tolist()  # by 90 degrees about z
        [0.5, 1.5, 0.5]
        """
        matrix = rotation_matrices(as_quaternions(as_vector(quaternion, "quaternion", length=4)[None], "quaternion"))[0]
        return replace(self, geometry=self.geometry.rotated(matrix))

    def scaled(self, factor: float) -> "Shape":
        """Return the shape with all lengths, those of its offset too, multiplied by a factor above 0.

        Raises
        ------
        InputError
            If the factor is not a finite number above 0.

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.shapes.sphere(radius=1.0).scaled(2.0).diameter
        4.0
        """
        factor = as_positive(factor, "factor")
        x, y, z = (value * factor for value in self.offset)
        return replace(self, geometry=self.geometry.scaled(factor), offset=(x, y, z))

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

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.save_shape(vg.shapes.box(lengths=(1, 2, 3)), "brick.stl")
        >>> vg.load_shape("brick.stl", unit="mm").to_unit("m").bounds[1].round(6).tolist()
        [0.0005, 0.001, 0.0015]
        """
        target = as_unit(unit)
        factor = 1.0 if self.unit is None else unit_factor(self.unit, target)
        return replace(self if factor == 1.0 else self.scaled(factor), unit=target)

    def to_pyvista(self) -> Any:
        """Return the tessellation as a `pyvista.PolyData`.

        Raises
        ------
        MissingLibraryError
            If PyVista cannot be loaded.

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.shapes.box(lengths=(1, 1, 1)).to_pyvista().n_cells
        12
        """
        faces = np.column_stack([np.full(len(self.faces), 3), self.faces])
        return load("pyvista").PolyData(self.vertices.copy(), faces)

    def to_open3d(self) -> Any:
        """Return the tessellation as an `open3d.geometry.TriangleMesh`.

        Raises
        ------
        MissingLibraryError
            If Open3D cannot be loaded.

        Examples
        --------
        >>> import voxgran as vg
        >>> len(vg.shapes.box(lengths=(1, 1, 1)).to_open3d().triangles)
        12
        """
        open3d = load("open3d")
        vertices = open3d.utility.Vector3dVector(self.vertices.copy())  # it takes no read-only array
        return open3d.geometry.TriangleMesh(vertices, open3d.utility.Vector3iVector(self.faces.astype(np.int32)))


def check_shapes(shapes: Any) -> tuple[Shape, ...]:
    """Return one shape, or several, as a tuple.

    Raises
    ------
    InputError
        If it is something else.
    """
    several = isinstance(shapes, Sequence) and not isinstance(shapes, str)
    entries = tuple(shapes) if several else (shapes,)
    for k, entry in enumerate(entries):
        rule = "a Shape or a list of them; make_shape and load_shape make one"
        check_type(entry, Shape, f"shapes[{k}]" if several else "shapes", rule)
    return entries
