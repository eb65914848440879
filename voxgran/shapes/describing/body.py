"""What follows from the geometry of a shape alone: its size, extents, tessellation and hash."""

import hashlib
import math
from functools import cached_property
from typing import TypeAlias

import numpy as np

from voxgran._base.arrays import Floats, Integers, read_only
from voxgran._base.scalars import cube_root
from voxgran.geometry.tree import TriangleTree, grow_tree
from voxgran.shapes.describing.thumbnail import card, portrait
from voxgran.shapes.mesh import Mesh, Surface
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.spheres import Spheres

Geometry: TypeAlias = Mesh | Primitive | Spheres | Outline | Surface


def as_spheres(geometry: Geometry) -> tuple[Floats, Floats] | None:
    """Return centers (k, 3) and radii of a sphere, a union of spheres or a disk; None of other geometries."""
    if isinstance(geometry, Spheres):
        return geometry.centers, geometry.radii
    if isinstance(geometry, Outline) and geometry.kind == "disk":
        return np.array([[*geometry.center, 0.0]]), np.array([geometry.radius])
    if isinstance(geometry, Primitive) and geometry.kind == "sphere":
        return np.zeros((1, 3)), np.array([geometry.dimensions[0]])
    return None


class Body:
    """Properties of a shape that its geometry, name and unit give; :class:`Shape` derives from it."""

    geometry: Geometry
    name: str
    unit: str | None

    @cached_property
    def key(self) -> str:
        """Hash of the content: two shapes with the same key are equal."""
        return hashlib.sha256(self.geometry.content()).hexdigest()

    def __eq__(self, other: object) -> bool:
        """Compare by content."""
        return isinstance(other, Body) and self.key == other.key

    def __hash__(self) -> int:
        """Hash by content."""
        return hash(self.key)

    def __repr__(self) -> str:
        """Name, kind of geometry and size."""
        kind = type(self.geometry).__name__.lower()
        return f"Shape({self.name!r}, {kind}, diameter={self.diameter:.6g})"

    def _repr_html_(self) -> str:
        """Small picture and numbers, for notebooks."""
        kind = str(getattr(self.geometry, "kind", type(self.geometry).__name__.lower()))
        flat, unit = self.dimension == 2, f" {self.unit}" if self.unit else ""
        rows = {
            "shape": f"{self.name} ({kind})",
            "equivalent diameter": f"{self.diameter:.6g}{unit}",
            "area" if flat else "volume": f"{self.volume:.6g}",
            "perimeter" if flat else "surface area": f"{self.surface_area:.6g}",
            "faces": f"{len(self.faces)}, at most {self.tessellation_error:.2g} from the true surface",
        }
        return card(portrait(self.vertices[self.faces], self.bounding_radius, flat=flat), rows)

    @property
    def dimension(self) -> int:
        """2 for an outline, else 3."""
        return self.geometry.dimension

    @property
    def is_open(self) -> bool:
        """Whether the shape is a surface without thickness and interior: a sheet, a shell or a skin."""
        return isinstance(self.geometry, Surface)

    @property
    def is_sphere(self) -> bool:
        """Whether it is a single sphere (in 2D a disk) about its centroid, however it is described."""
        geometry = self.geometry
        if isinstance(geometry, Spheres):
            return len(geometry.radii) == 1 and not geometry.centers.any() and geometry.mass is None
        if isinstance(geometry, Primitive):
            return geometry.kind == "sphere"
        return isinstance(geometry, Outline) and geometry.kind == "disk" and geometry.center == (0.0, 0.0)

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
        return cube_root(6 * self.volume / math.pi)

    @property
    def centroid(self) -> Floats:
        """Centroid in the body frame, (3,): the origin; `offset` is its place in the original coordinates."""
        return np.zeros(3)

    @cached_property
    def bounds(self) -> Floats:
        """Lower and upper corner of the true shape in its body frame, (2, 3)."""
        return read_only(np.array(self.geometry.bounds))

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

    @cached_property
    def _tree(self) -> TriangleTree:
        """Box tree of the tessellation."""
        return self.geometry.tree if isinstance(self.geometry, Mesh) else grow_tree(self.vertices, self.faces)
