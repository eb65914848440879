"""A closed triangle mesh as the true geometry of a grain, and the convex hull of points as such a mesh.

An open surface of triangles is the true geometry of a sheet, a shell or a skin, without interior. Common bases of
geometries give moments, and triangles of closed and open surfaces.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers, box_of, read_only
from voxgran._base.errors import DirtyMeshError, InputError
from voxgran._base.kernels import kernel
from voxgran._base.lazy import load
from voxgran.geometry.crossing import count_crossings
from voxgran.geometry.tree import TriangleTree, grow_tree
from voxgran.geometry.triangles import areas_of, normals_of
from voxgran.geometry.vectors import cross, dot
from voxgran.lattice.label import components


class Moments:
    """Common base of solids that compute volume, centroid and inertia together, as `_moments`; in 2D of the area."""

    _moments: Any

    @property
    def volume(self) -> float:
        """Volume; of closed triangles by the divergence theorem, negative if the faces point inward."""
        return self._moments[0]

    @property
    def centroid(self) -> Floats:
        """Centroid, (3,)."""
        return self._moments[1]

    @property
    def inertia(self) -> Floats:
        """Inertia tensor about the centroid at unit density, (3, 3)."""
        return self._moments[2]


def corner_type(count: int) -> Any:
    """Return the type of the numbers of some vertices."""
    return np.min_scalar_type(max(count - 1, 0))


class LatticePoints(NamedTuple):
    """Points on a lattice, as surfaces of labels have them: half the bytes of coordinates, from which these follow."""

    steps: NDArray[np.int32]  # (n, 3) whole steps from the first corner
    step: Floats  # (3,) edges of a cell of the lattice
    first: Floats  # (3,) its first corner

    @property
    def nbytes(self) -> int:
        """Bytes that they take."""
        return sum(array.nbytes for array in self)

    @property
    def coordinates(self) -> Floats:
        """The points, (n, 3)."""
        return read_only(np.asarray(self.steps * self.step + self.first, dtype=np.float64))


@dataclass(frozen=True, eq=False, init=False)
class Triangles:
    """Triangles (m, 3) of vertices (n, 3) in space, in the unit of lengths."""

    #: the vertices, or their places on a lattice
    points: Floats | LatticePoints
    #: (m, 3) vertices of the triangles, in as few bytes as their numbers take
    corners: NDArray[np.unsignedinteger[Any]]

    dimension = 3

    def __init__(self, vertices: Floats | LatticePoints, faces: NDArray[Any]) -> None:
        count = len(vertices.steps if isinstance(vertices, LatticePoints) else vertices)
        for array in vertices if isinstance(vertices, LatticePoints) else (vertices,):
            read_only(array)
        object.__setattr__(self, "points", vertices)
        object.__setattr__(self, "corners", read_only(faces.astype(corner_type(count), copy=False)))

    def __reduce__(self) -> tuple[Any, ...]:
        # made anew by its constructor, so that its arrays are read-only again and what was cached stays behind
        return type(self), (self.points, self.corners)

    @property
    def vertices(self) -> Floats:
        """Vertices, (n, 3)."""
        return self.points.coordinates if isinstance(self.points, LatticePoints) else self.points

    @property
    def faces(self) -> Integers:
        """Vertices of the triangles, (m, 3)."""
        return read_only(self.corners.astype(np.int64))

    @property
    def triangles(self) -> Floats:
        """Corner points of the triangles, (m, 3, 3)."""
        return read_only(self.vertices[self.corners])

    @cached_property
    def tree(self) -> TriangleTree:
        """Box tree of the triangles, for nearest points; its signs are valid for closed surfaces only."""
        return grow_tree(self.vertices, self.faces)

    @property
    def bounding_radius(self) -> float:
        """Largest distance of a vertex from the origin of the frame."""
        return float(np.sqrt((self.vertices**2).sum(axis=1).max()))

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper corner."""
        return box_of(self.vertices)

    @cached_property
    def areas(self) -> Floats:
        """Areas of the triangles, (m,)."""
        return read_only(areas_of(self.triangles))

    @property
    def surface_area(self) -> float:
        """Sum of the areas of the triangles; for an open surface that of one side."""
        return float(self.areas.sum())

    def content(self) -> bytes:
        """Return the bytes from which the key of the shape is computed."""
        return type(self).__name__.lower().encode() + self.vertices.tobytes() + self.faces.tobytes()

    def moved(self, offset: Floats) -> Self:
        """Return the triangles shifted by a (3,) offset."""
        if isinstance(self.points, LatticePoints):
            return type(self)(self.points._replace(first=self.points.first + offset), self.corners)
        return type(self)(self.points + offset, self.corners)

    def rotated(self, matrix: Floats) -> Self:
        """Return the triangles rotated about the origin by a (3, 3) rotation matrix."""
        return type(self)(linear.matmul(self.vertices, matrix.T), self.corners)

    def scaled(self, factor: float) -> Self:
        """Return the triangles scaled about the origin."""
        if isinstance(self.points, LatticePoints):
            steps, step, first = self.points
            return type(self)(LatticePoints(steps, step * factor, first * factor), self.corners)
        return type(self)(self.vertices * factor, self.corners)

    def tessellation(self) -> tuple[Floats, Integers, float]:
        """Return vertices, faces and their largest distance from the true surface: 0."""
        return self.vertices, self.faces, 0.0


@dataclass(frozen=True, eq=False, init=False)
class Mesh(Triangles):
    """A closed surface of triangles, counterclockwise seen from outside."""

    def _tetrahedra(self) -> tuple[Floats, list[Floats], Floats]:
        """Return a central point, the three corners of each face seen from it, and the volumes between the two.

        The central point preserves digits if the mesh is far from the origin.
        """
        middle = np.mean(box_of(self.vertices), axis=0)
        points = self.vertices - middle
        a, b, c = corners = [points.take(self.corners[:, k], axis=0) for k in range(3)]
        return middle, corners, linear.einsum("ij,ij->i", a, np.cross(b, c)) / 6

    @cached_property
    def _volume_and_centroid(self) -> tuple[float, Floats]:
        """Both together, without the inertia, which takes longer."""
        if isinstance(self.points, LatticePoints):
            sixth, moment = _sums(self.points.steps, self.corners.astype(np.int32))
            center = moment / (4 * sixth) if sixth else np.zeros(3)
            return float(sixth * self.points.step.prod() / 6), read_only(center * self.points.step + self.points.first)
        middle, (a, b, c), sixth = self._tetrahedra()
        volume = float(sixth.sum())
        if volume == 0.0:
            return 0.0, read_only(middle)
        return volume, read_only(middle + (sixth[:, None] * (a + b + c)).sum(axis=0) / 4 / volume)

    @property
    def volume(self) -> float:
        """Volume by the divergence theorem, negative if the faces point inward."""
        return self._volume_and_centroid[0]

    @property
    def centroid(self) -> Floats:
        """Centroid, (3,)."""
        return self._volume_and_centroid[1]

    @cached_property
    def inertia(self) -> Floats:
        """Inertia tensor about the centroid at unit density, (3, 3).

        The integrals of 1, x and x x^T over a tetrahedron are closed forms of its corners (Tonon 2005,
        doi:10.3844/jmssp.2005.8.11).
        """
        _, (a, b, c), sixth = self._tetrahedra()
        if self.volume == 0.0:
            return read_only(np.zeros((3, 3)))
        total, corners = a + b + c, np.stack([a, b, c], axis=1)
        second = linear.einsum("f,fki,fkj->ij", sixth, corners, corners)
        second = (second + linear.einsum("f,fi,fj->ij", sixth, total, total)) / 20
        offset = (sixth[:, None] * total).sum(axis=0) / 4 / self.volume
        second = second - self.volume * np.outer(offset, offset)
        return read_only(np.trace(second) * np.eye(3) - second)


@kernel
def _sums(steps, corners):  # type: ignore[no-untyped-def]
    """Return six times the volume that triangles of whole numbers enclose, and that times four times the centroid."""
    volume, moment, origin = 0.0, np.zeros(3), steps[0]
    for t in range(len(corners)):
        a, b, c = steps[corners[t, 0]], steps[corners[t, 1]], steps[corners[t, 2]]
        u = (float(a[0] - origin[0]), float(a[1] - origin[1]), float(a[2] - origin[2]))
        v = (float(b[0] - origin[0]), float(b[1] - origin[1]), float(b[2] - origin[2]))
        w = (float(c[0] - origin[0]), float(c[1] - origin[1]), float(c[2] - origin[2]))
        part = dot(u, cross(v, w))
        volume += part
        for k in range(3):
            moment[k] += part * (u[k] + v[k] + w[k])
    for k in range(3):
        moment[k] += 4.0 * volume * origin[k]
    return volume, moment


def hull_of(points: Floats) -> Mesh:
    """Return the convex hull of (n, 3) points, which are all corners, its triangles counterclockwise from outside."""
    hull = load("scipy.spatial").ConvexHull(points)
    faces = hull.simplices.astype(np.int64)
    inward = linear.einsum("fi,fi->f", normals_of(points[faces]), hull.equations[:, :3]) < 0
    faces[inward] = faces[inward][:, ::-1]
    return Mesh(points, faces)


#: least width of a mesh, whose fifth power has to be a number, least volume and area, in powers of its width, and the
#: farthest from the origin, in its width, where its coordinates have digits left; rounding of the sum of its normals
LEAST_WIDE, LEAST_SHARE, FARTHEST, LARGEST_GAP = 1e-60, 1e-15, 1e6, 1e-6
#: area, in squares of the longest edge, up to which a triangle counts as degenerate
NO_AREA = 1e-12


@dataclass(frozen=True, eq=False, init=False)
class Surface(Triangles):
    """A surface of triangles with equivalent sides; the orientation of the faces is irrelevant.

    It is called open, since it has no interior, also where it is closed.
    """

    @property
    def volume(self) -> float:
        """Volume: 0."""
        return 0.0

    @cached_property
    def centroid(self) -> Floats:
        """Centroid of the area, (3,)."""
        middle = (self.vertices.min(axis=0) + self.vertices.max(axis=0)) / 2
        share = self.areas / self.areas.sum()
        return read_only(middle + linear.matmul(share, (self.triangles - middle).mean(axis=1)))

    @property
    def inertia(self) -> Floats:
        """Raise an error, since the inertia at unit density is that of a solid.

        Raises
        ------
        InputError
            Always.
        """
        raise InputError(
            "an open surface has no volume and so no inertia at unit density: use geometry.area_inertia, that at unit "
            "mass per area, or give it thickness"
        )

    @cached_property
    def area_inertia(self) -> Floats:
        """Inertia tensor about the centroid at unit mass per area, (3, 3)."""
        corners = self.triangles - self.centroid
        total = corners.sum(axis=1)
        # the integral of x x^T over a triangle is a closed form of its corners
        second = linear.einsum("f,fki,fkj->ij", self.areas, corners, corners)
        second = (second + linear.einsum("f,fi,fj->ij", self.areas, total, total)) / 12
        return read_only(np.trace(second) * np.eye(3) - second)


def refuse_degenerate(geometry: "Mesh | Surface", name: str) -> None:
    """Refuse triangles of a file that enclose nothing, or have no area.

    Raises
    ------
    DirtyMeshError
        If their volume, or their area, is not above 0, but for rounding, or they are far from the origin or not closed.
    """
    is_open = isinstance(geometry, Surface)
    with np.errstate(all="ignore"):
        wide = np.ptp(geometry.vertices, axis=0).max(initial=0.0)
        far = np.abs(geometry.vertices).max(initial=0.0) / wide
        normals = normals_of(geometry.triangles / wide)
        content = np.abs(normals).sum() if is_open else np.float64(geometry.volume) / wide**3
        # normals of what is closed cancel
        gap = 0.0 if is_open else np.abs(normals.sum(axis=0)).max() / np.abs(normals).sum()
    if not (LEAST_WIDE < wide < 1.0 / LEAST_WIDE and far <= FARTHEST and content > LEAST_SHARE and gap < LARGEST_GAP):
        what = "area" if is_open else "volume"
        raise DirtyMeshError(
            f"{name} has {len(geometry.corners)} faces without {what}: a shape has some; write it again"
        )


def refuse_unfit(vertices: Floats, faces: Integers, name: str) -> None:
    """Raise unless triangles of merged vertices make one surface, which may be closed.

    Raises
    ------
    DirtyMeshError
        If there are no triangles, one is degenerate, they are not connected or intersect.
    """
    if not len(faces):
        raise DirtyMeshError(f"{name} has no faces: a surface must have triangles; check the file")
    triangles = vertices[faces]
    longest = ((triangles - np.roll(triangles, 1, axis=1)) ** 2).sum(axis=2).max(axis=1)
    flat = int((areas_of(triangles) <= NO_AREA * longest).sum())
    start, end = faces.ravel(), np.roll(faces, 1, axis=1).ravel()
    parts = len(np.unique(components(len(vertices), start, end)))
    rules = (
        (flat, f"{flat} faces without area", "each must be a triangle; leave them out"),
        (parts - 1, f"{parts} separate parts", "a grain must be one piece; save each in a file of its own"),
    )
    for wrong, what, rule in rules:
        if wrong:
            raise DirtyMeshError(f"{name} has {what}: {rule}")
    crossings = count_crossings(vertices, faces)
    if crossings:
        raise DirtyMeshError(f"{name} has {crossings} pairs of faces that cut through each other: mend the mesh")
