"""Polyhedra, sharp or rounded: hulls of random points on a sphere or ellipsoid, Platonic and Archimedean solids.

Rounded ones are Minkowski sums with a sphere: the sphere is swept over the polyhedron. They are meshes whose vertices
lie on the true surface, closed and convex.

The mesh of a rounded polyhedron has a stated error. The flat faces are shifted by the radius, edges become parts of
cylinders and corners parts of spheres. All vertices of the mesh lie on the true surface, so that it is inscribed. The
volume of the true sum is
``V + A r + M r^2 + 4/3 pi r^3``
with the volume V, the area A and the integrated mean curvature M of the polyhedron, half the sum over its edges of
length times exterior angle (Steiner's formula; Schneider & Weil 2008, Stochastic and Integral Geometry,
doi:10.1007/978-3-540-78859-1).

References
----------
Schneider & Weil 2008, Stochastic and Integral Geometry, doi:10.1007/978-3-540-78859-1: hulls of random points on a
sphere, and the volume of Minkowski sums with spheres
"""

import math
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, Integers, as_count
from voxgran._base.config import check_bounds, parameter, parameter_class
from voxgran._base.errors import InputError
from voxgran._base.lazy import load
from voxgran._base.scalars import cube_root
from voxgran.shapes.family import ShapeFamily, Sized, sized
from voxgran.shapes.generating.hulls import MOST_POINTS, hull_of_corners, points_on_sphere
from voxgran.shapes.generating.regular_solids import ArchimedeanSolid, PlatonicSolid, corners_of
from voxgran.shapes.mesh import Mesh, hull_of
from voxgran.shapes.model import Shape
from voxgran.shapes.tessellate import sphere_points

Solid: TypeAlias = Literal["random", PlatonicSolid, ArchimedeanSolid]


@parameter_class
class Polyhedron(Sized):
    """Parameters of a polyhedron.

    Parameters
    ----------
    solid
        hull of random points, or the name of a Platonic or Archimedean solid.
    points
        number of random points, or a range to draw it from; from 4 to 100 000; default: (8, 20).
    aspect
        factors by which the corners are stretched along x, y and z.
    mirror
        whether to take the mirror image, such as the other form of a snub solid.
    rounding
        radius of the sphere that is swept over the polyhedron, as a fraction of the equivalent diameter of the sharp
        polyhedron; 0: sharp edges.
    tolerance
        largest distance of the mesh from the true rounded surface, in equivalent diameters.

    Raises
    ------
    InputError
        If a number is out of range, or points are given for a regular solid.

    Examples
    --------
    >>> import voxgran as vg
    >>> len(vg.shapes.polyhedron(solid="cube").vertices)
    8
    """

    solid: Solid = parameter("random")
    points: int | tuple[int, int] | None = parameter(None)
    aspect: tuple[float, float, float] = parameter((1.0, 1.0, 1.0), above=0.0)
    mirror: bool = parameter(False)
    rounding: float = parameter(0.0, at_least=0.0, at_most=10.0)
    tolerance: float = parameter(0.002, at_least=1e-4, at_most=0.1)

    def __post_init__(self) -> None:
        """Check the values."""
        check_bounds(self)
        if self.points is not None:
            if self.solid != "random":
                raise InputError(f"points is given for solid {self.solid!r}, which has its own corners; leave it out")
            low, high = self.points if isinstance(self.points, tuple) else (self.points, self.points)
            least = as_count(low, "points", at_least=4, at_most=MOST_POINTS)
            as_count(high, "points", at_least=least, at_most=MOST_POINTS)


def make(parameters: Polyhedron, generator: np.random.Generator) -> Shape:
    """Return a polyhedron."""
    corners = _corners(parameters, generator) * np.array(parameters.aspect)
    if parameters.mirror:
        corners = -corners
    solid = hull_of(corners)
    if parameters.rounding:
        corners = corners / Shape.of(solid, name="polyhedron").diameter
        size = cube_root(6 / math.pi * steiner_volume(corners, parameters.rounding))
        solid = sphere_swept(corners, parameters.rounding, parameters.tolerance * size)
    return sized(solid, parameters.diameter, name="polyhedron")


def _corners(parameters: Polyhedron, generator: np.random.Generator) -> Floats:
    """Return the corners before they are stretched."""
    if parameters.solid != "random":
        return corners_of(parameters.solid)
    points = parameters.points or (8, 20)
    low, high = points if isinstance(points, tuple) else (points, points)
    return points_on_sphere(int(generator.integers(low, high, endpoint=True)), generator)


registration = ShapeFamily(
    summary="hull of random points, Platonic or Archimedean solid; sharp or rounded by a sphere",
    parameters=Polyhedron,
    make=make,
    source="Schneider & Weil 2008, Stochastic and Integral Geometry, doi:10.1007/978-3-540-78859-1",
    random=True,
)


#: distance of normals of triangles up to which they are one face
COPLANAR = 1e-9
#: directions inside the cone of a corner keep this distance from its edges, in spacings of directions
CLEARANCE = 0.4
#: largest angle from a point of the sphere to the nearest of n points of a spiral is at most COVERING / sqrt(n)
COVERING = 2.74


class Edges(NamedTuple):
    """Edges of a convex polyhedron: corners (e, 2) and outward normals of the two faces, each (e, 3)."""

    ends: Integers
    one: Floats
    two: Floats


def sphere_swept(corners: Floats, radius: float, error: float) -> Mesh:
    """Return the Minkowski sum of the convex hull of (n, 3) corners and a sphere.

    `error` is the largest distance of the mesh from the true surface, above 0. All points must be corners.
    """
    # the farthest direction from all vertices of the mesh, at a corner: sqrt((1 + CLEARANCE)^2 + 1/4) spacings
    angle = min(math.acos(max(1.0 - error / radius, 0.0)), 0.6)
    spacing = angle / math.hypot(1.0 + CLEARANCE, 0.5)
    count = math.ceil((COVERING / spacing) ** 2)
    edges = edges_of_hull(corners)
    points = [corners[ends] + radius * arc for ends, arc in _arcs(edges, spacing)]
    directions = sphere_points(count)
    at = linear.matmul(directions, corners.T).argmax(axis=1)
    inner = _clear(directions, at, corners, edges, math.sin(CLEARANCE * spacing))
    points.append(corners[at[inner]] + radius * directions[inner])
    return hull_of_corners(np.unique(np.concatenate(points), axis=0))


def edges_of_hull(corners: Floats) -> Edges:
    """Return the edges of the convex hull of corners, without those between triangles of one face."""
    hull = load("scipy.spatial").ConvexHull(corners)
    normals, faces = hull.equations[:, :3], hull.simplices
    here, side = np.nonzero(hull.neighbors > np.arange(len(faces))[:, None])
    there = hull.neighbors[here, side]
    # Qhull gives coplanar triangles the normal of their common face
    sharp = linear.norm(normals[here] - normals[there], axis=1) > COPLANAR
    here, there, side = here[sharp], there[sharp], side[sharp]
    # neighbor k of a triangle lies opposite to its corner k
    ends = np.stack([faces[here, (side + 1) % 3], faces[here, (side + 2) % 3]], axis=1)
    return Edges(ends.astype(np.int64), normals[here], normals[there])


def steiner_volume(corners: Floats, radius: float) -> float:
    """Return the volume of the Minkowski sum of the convex hull of corners and a sphere, in closed form."""
    solid, edges = hull_of(corners), edges_of_hull(corners)
    lengths = linear.norm(corners[edges.ends[:, 0]] - corners[edges.ends[:, 1]], axis=1)
    curvature = float((lengths * _angles(edges)).sum()) / 2
    return solid.volume + radius * (solid.surface_area + radius * (curvature + 4 / 3 * math.pi * radius))


def _angles(edges: Edges) -> Floats:
    """Return the exterior angles at the edges, (e,)."""
    across = linear.norm(np.cross(edges.one, edges.two), axis=1)
    return libm.arctan2(across, linear.einsum("ei,ei->e", edges.one, edges.two))


def _arcs(edges: Edges, spacing: float) -> list[tuple[Integers, Floats]]:
    """Return the corners and directions of the arcs between the normals at each edge, for both its ends."""
    found = []
    for ends, one, two, angle in zip(edges.ends, edges.one, edges.two, _angles(edges), strict=True):
        steps = max(1, math.ceil(angle / spacing))
        share = np.arange(steps + 1)[:, None] / steps
        arc = (libm.sin((1 - share) * angle) * one + libm.sin(share * angle) * two) / math.sin(angle)
        arc[0], arc[-1] = one, two
        found += [(np.full(steps + 1, end), arc) for end in ends]
    return found


def _clear(directions: Floats, at: Integers, corners: Floats, edges: Edges, least: float) -> Integers:
    """Return the numbers of the directions that are far enough from the edges of the cone of their corner."""
    near = np.full(len(directions), np.inf)
    for a, b in edges.ends:
        along = (corners[a] - corners[b]) / linear.norm(corners[a] - corners[b])
        for end, sign in ((a, 1.0), (b, -1.0)):
            mine = np.flatnonzero(at == end)
            near[mine] = np.minimum(near[mine], sign * linear.matmul(directions[mine], along))
    return np.flatnonzero(near >= least)
