"""Closed triangle meshes as containers."""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base import ExplainedAttributes
from voxgran._base.arrays import Floats, Integers, as_faces, as_points, as_vector, check_type
from voxgran._base.calls import explained_methods
from voxgran._base.errors import InputError, with_article
from voxgran.containers.enclosed import wall_around
from voxgran.containers.model import Boundary, ContainerKind, Surface
from voxgran.shapes.files import shape_of_file
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.repairing.diagnose import Remedies

#: remedies for a file that is not one closed solid, for messages
MENDING = Remedies(
    mend="use vg.repair, or 'voxgran repair' at the prompt",
    keep_open="",
    choose="choose with vg.repair, or 'voxgran repair', and its bodies",
)


@explained_methods
@dataclass(frozen=True, eq=False)
class ClosedMesh(ExplainedAttributes):
    """The interior of a closed triangle mesh, in the coordinates that the shape was made from.

    For the space that a wall of some thickness encloses see :func:`voxgran.Vessel`.

    Attributes
    ----------
    shape : Shape
        A shape of triangles.

    Raises
    ------
    InputError
        If `shape` is not a Shape, or not a mesh.

    Examples
    --------
    >>> import voxgran as vg
    >>> hopper = vg.shapes.cone(radius=2.0, height=3.0)
    >>> round(vg.ClosedMesh(vg.Shape.from_mesh(hopper.vertices, hopper.faces)).volume, 1)
    12.6
    """

    shape: Shape
    kind: ClassVar[str] = "mesh"
    dimension: ClassVar[int] = 3
    periodic: ClassVar[tuple[bool, bool, bool]] = (False, False, False)

    def __post_init__(self) -> None:
        """Check that the shape is a mesh."""
        check_type(self.shape, Shape, "shape", "a Shape; for a mesh file use ClosedMesh.from_file")
        if not isinstance(self.shape.geometry, Mesh):
            kind, error = type(self.shape.geometry).__name__.lower(), self.shape.tessellation_error
            solid = self.shape.dimension == 3 and not self.shape.is_open
            remedy = (
                "write ClosedMesh(Shape.from_mesh(shape.vertices, shape.faces)), whose walls are within "
                f"{error:.2g} of its surface"
                if solid
                else "take a solid"
            )
            raise InputError(
                f"shape {self.shape.name!r} is {with_article(kind)}: a closed-mesh container is made of triangles that "
                f"bound a solid; {remedy}"
            )

    @classmethod
    def from_file(cls, path: str | os.PathLike[str], *, unit: str | None = None) -> "ClosedMesh":
        """Make a container from a mesh file.

        Parameters
        ----------
        path : path-like
            File of any format that :func:`voxgran.load_shape` reads.
        unit : str, optional
            Unit of its lengths.

        Raises
        ------
        MissingFileError
            If there is no such file.
        FileFormatError
            If the file cannot be read.
        DirtyMeshError
            If the surface does not bound exactly one solid.
        InputError
            If `path` is not a path.

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.save_shape(vg.shapes.box(lengths=(2, 2, 2)), "vessel.stl")
        >>> round(vg.ClosedMesh.from_file("vessel.stl", unit="m").volume, 6)
        8.0
        """
        return cls(shape_of_file(path, unit=unit, remedies=MENDING))

    @property
    def volume(self) -> float:
        """Volume."""
        return self.shape.volume

    @property
    def bounds(self) -> Floats:
        """Lower and upper corner, (2, 3)."""
        vertices = self.mesh()[0]
        return np.array([vertices.min(axis=0), vertices.max(axis=0)])

    @property
    def boundary(self) -> Boundary:
        """The wall in closed form."""
        return Boundary((Surface(self.shape),))

    def signed_distance(self, points: "ArrayLike") -> Floats:
        """Return the distance of (n, 3) points from the surface, negative inside.

        Raises
        ------
        InputError
            If the points are not an (n, 3) array of finite numbers.

        Examples
        --------
        >>> import voxgran as vg
        >>> cube = vg.shapes.box(lengths=(2, 2, 2))
        >>> vessel = vg.ClosedMesh(vg.Shape.from_mesh(cube.vertices, cube.faces))
        >>> vessel.signed_distance([(0, 0, 0), (0, 0, 1.5)]).round(6).tolist()
        [-1.0, 0.5]
        """
        return self._geometry.tree.signed_distance(as_points(points) - np.array(self.shape.offset))

    def doubt(self, diameter: float) -> str:
        """Return what speaks against packing grains of a median diameter, as a sentence; ``""`` if nothing does.

        Examples
        --------
        >>> import voxgran as vg
        >>> cube = vg.shapes.box(lengths=(2, 2, 2))
        >>> vg.ClosedMesh(vg.Shape.from_mesh(cube.vertices, cube.faces)).doubt(0.1)
        ''
        """
        space = wall_around(self.shape)
        if not space:
            return ""
        return (
            f"container is a mesh of volume {self.volume:.4g} around a space of {space:.4g}: grains are packed within "
            "the mesh, which looks like a wall; give Vessel(shape), in a scene kind = 'vessel', for the space that it "
            "encloses"
        )

    @property
    def _geometry(self) -> Mesh:
        """The mesh relative to its centroid."""
        assert isinstance(self.shape.geometry, Mesh)
        return self.shape.geometry

    def mesh(self) -> tuple[Floats, Integers]:
        """Return vertices and triangles of the boundary.

        Examples
        --------
        >>> import voxgran as vg
        >>> cube = vg.shapes.box(lengths=(2, 2, 2))
        >>> vertices, faces = vg.ClosedMesh(vg.Shape.from_mesh(cube.vertices, cube.faces)).mesh()
        >>> vertices.shape, faces.shape
        ((8, 3), (12, 3))
        """
        return self.shape.vertices + np.array(self.shape.offset), self.shape.faces

    def scaled(self, factor: float) -> "ClosedMesh":
        """Return the container with all lengths multiplied.

        Examples
        --------
        >>> import voxgran as vg
        >>> cube = vg.shapes.box(lengths=(2, 2, 2))
        >>> vessel = vg.ClosedMesh(vg.Shape.from_mesh(cube.vertices, cube.faces))
        >>> round(vessel.scaled(0.5).volume, 6)
        1.0
        """
        return ClosedMesh(self.shape.scaled(factor))

    def to_unit(self, unit: str) -> "ClosedMesh":
        """Return the container with its lengths in another unit; lengths without a unit are not converted.

        Raises
        ------
        UnknownNameError
            If the unit is unknown; the message gives the nearest one.
        InputError
            If the unit is not a string, or is ``"1"`` although the unit of the mesh is known.

        Examples
        --------
        >>> import voxgran as vg
        >>> cube = vg.shapes.box(lengths=(2, 2, 2))
        >>> vessel = vg.ClosedMesh(vg.Shape.from_mesh(cube.vertices, cube.faces, unit="m"))
        >>> vessel.to_unit("mm").bounds[1].round(6).tolist()
        [1000.0, 1000.0, 1000.0]
        """
        return ClosedMesh(self.shape.to_unit(unit))

    def to_mapping(self) -> dict[str, Any]:
        """Return kind, vertices (relative to the centroid), faces and centroid as JSON-able values.

        Examples
        --------
        >>> import voxgran as vg
        >>> cube = vg.shapes.box(lengths=(2, 2, 2))
        >>> vessel = vg.ClosedMesh(vg.Shape.from_mesh(cube.vertices, cube.faces))
        >>> vg.make_container(vessel.to_mapping()).kind
        'mesh'
        """
        return {
            "kind": self.kind,
            "name": self.shape.name,
            "vertices": self._geometry.vertices.tolist(),
            "faces": self._geometry.faces.tolist(),
            "offset": list(self.shape.offset),
        }


def _make(rest: Mapping[str, Any], where: str) -> ClosedMesh:
    """Return a closed mesh from a file or from arrays.

    Parameters
    ----------
    file : optional
        Closed mesh, relative to the scene file.
    vertices : optional
        Points of a mesh without file, shape (n, 3).
    faces : optional
        Triangles of a mesh without file, shape (m, 3), as indices of vertices.
    name : optional
        Name of a mesh without file.
    offset : optional
        What is added to the vertices of a mesh without file.
    """
    if "file" in rest:
        return ClosedMesh.from_file(rest["file"])
    if "vertices" not in rest or "faces" not in rest:
        raise InputError(f"{where} file is missing: a mesh container needs a file, or vertices and faces; add it")
    name = str(rest.get("name", "container"))
    if "offset" not in rest:
        return ClosedMesh(Shape.from_mesh(rest["vertices"], rest["faces"], name=name))
    # vertices written by a container are relative to the centroid already and are restored bit for bit
    vertices = as_points(rest["vertices"], "vertices")
    x, y, z = (float(value) for value in as_vector(rest["offset"], "offset"))
    return ClosedMesh(Shape(Mesh(vertices, as_faces(rest["faces"], len(vertices))), name, (x, y, z)))


registration = ContainerKind(container=ClosedMesh, taken=("file", "vertices", "faces", "name", "offset"), make=_make)
