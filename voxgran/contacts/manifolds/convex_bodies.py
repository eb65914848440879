"""Grains made of convex parts as tables of numbers: unions of spheres, primitives and convex meshes.

Boxes and convex meshes are hulls of corners with flat faces, of which coplanar triangles make one. Spheres are corners
with a radius, and spherocylinders hulls of two such corners. Ellipsoids, cylinders and cones are the rows of
:mod:`voxgran.geometry.support`.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers
from voxgran._base.lazy import load
from voxgran.contacts.manifolds.blocks import Blocks
from voxgran.contacts.manifolds.rows import Grains
from voxgran.contacts.parts import CODES, is_disk, row_of
from voxgran.geometry.gjk import Simplex, new_simplex
from voxgran.geometry.support import BOX, ELLIPSOID, ROW, erosion_limit
from voxgran.shapes.describing.body import Geometry
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.spheres import Spheres
from voxgran.shapes.tessellate import unit_box

#: kinds of shapes: those of `geometry.support`, where a union of spheres is a POINT and a hull of corners a BOX
SPHERES, HULL, NONE = 0, BOX, -1
#: volume that a convex mesh may differ from that of its hull by, relative to it
DENT = 1e-6
#: 1 minus the cosine of the angle at which neighboring triangles are one face
COPLANAR = 1e-9
#: smallest share of the surface that the square of the length of a face has which touches others at several points
LEAST_FACE = 4e-3
#: corners of the intersection of two faces
MOST_CORNERS = 64


class ConvexBodies(NamedTuple):
    """Shapes made of convex parts, in their own units about their centroids.

    kind: (s,), `NONE` for a shape that is not made of convex parts.  first: (s + 1,) first corner of each shape.
    corner: (k, 3) corners of hulls, or centers of spheres.  radius: (k,), 0 for corners of solids with flat faces.
    link_first, link: neighbors of each corner of a hull, (k + 1,) and (l,), counted from its first corner.
    row: (s, 13) rows of ellipsoids, cylinders and cones.  thick: (s,) radii of spheres inside the shapes, of a union
    that of its largest sphere.  face_first: (s + 1,).  face: (f, 4) outward normals and levels.
    ring_first: (f + 1,) and ring: (r,) corners of each face, counterclockwise seen from outside, counted from the first
    corner of the shape.
    """

    kind: Integers
    first: Integers
    corner: Floats
    radius: Floats
    link_first: Integers
    link: Integers
    row: Floats
    thick: Floats
    face_first: Integers
    face: Floats
    ring_first: Integers
    ring: Integers


class ConvexWork(NamedTuple):
    """Tables of the shapes, and arrays that the kernels work with.

    first: (n + 1,) first corner of each grain.  corner: (k, 3) relative to its centroid, rotated and scaled, and
    radius: (k,).  row: (n, 13) rotated and scaled rows.  form: (n, 6) matrices of quadratic forms of ellipsoids: xx,
    yy, zz, xy, xz, yz.  window, ring, other: polygons.  one, two: corners of two grains that are near each other.
    """

    bodies: ConvexBodies
    first: Integers
    corner: Floats
    radius: Floats
    row: Floats
    form: Floats
    simplex: Simplex
    window: Floats
    ring: Floats
    other: Floats
    one: Integers
    two: Integers


#: arrays of the work that each thread has for itself
SCRATCH = ("simplex", "window", "ring", "other", "one", "two")


class _Hull(NamedTuple):
    """Corners of a convex solid, neighbors of each of them, and its faces."""

    corners: Floats
    links: list[list[int]]
    faces: list[Floats]
    rings: list[list[int]]


def is_convex(geometry: Geometry) -> bool:
    """Return whether a geometry is one convex solid; a mesh may differ from its hull by a millionth of the volume.

    Parameters
    ----------
    geometry : Mesh or Primitive or Spheres or Outline or Surface
        Any geometry.
    """
    if isinstance(geometry, Primitive):
        return True
    if isinstance(geometry, Spheres):
        return len(geometry.radii) == 1
    if not isinstance(geometry, Mesh) or len(geometry.faces) < 4:
        return False
    used = geometry.vertices[np.unique(geometry.faces)]
    try:
        hull = load("scipy.spatial").ConvexHull(used)
    except load("scipy.spatial").QhullError:
        # without volume
        return False
    return bool(hull.volume - geometry.volume <= DENT * hull.volume)


def has_convex_parts(geometry: Geometry) -> bool:
    """Return whether a geometry is convex, or a union of spheres.

    Parameters
    ----------
    geometry : Mesh or Primitive or Spheres or Outline or Surface
        Any geometry.
    """
    return isinstance(geometry, Spheres) or is_convex(geometry)


def convex_bodies(shapes: Sequence[Shape], *, hulls: bool = False, faces: bool = True) -> ConvexBodies:
    """Return the tables of shapes; those that are not made of convex parts have none.

    Parameters
    ----------
    shapes : sequence of Shape
        Shapes, with their centroids at the origin.
    hulls : bool
        Whether meshes that are not convex are represented by their convex hulls.
    faces : bool
        Whether the tables hold the faces; without, hulls represent outlines, too.
    """
    kinds, thick, rows = [], [], np.zeros((len(shapes), ROW))
    solids: list[_Hull] = []
    radii: list[Floats] = []
    for s, shape in enumerate(shapes):
        geometry = shape.geometry
        if not has_convex_parts(geometry) and not (hulls and (isinstance(geometry, Mesh) or not faces)):
            kinds.append(NONE)
            solids.append(_bare(np.zeros((0, 3))))
            radii.append(np.zeros(0))
            thick.append(1.0)
            continue
        kind, hull, radius, inner = _body(geometry, rows[s], faces)
        kinds.append(kind)
        solids.append(hull)
        radii.append(radius)
        thick.append(inner)
    flat = [face for hull in solids for face in hull.faces]
    rings = [ring for hull in solids for ring in hull.rings]
    links = [link for hull in solids for link in hull.links]
    return ConvexBodies(
        kind=np.array(kinds, dtype=np.int64),
        first=_starts([len(hull.corners) for hull in solids]),
        corner=np.concatenate([np.zeros((0, 3)), *(hull.corners for hull in solids)]),
        radius=np.concatenate([np.zeros(0), *radii]),
        link_first=_starts([len(link) for link in links]),
        link=np.array([k for link in links for k in link], dtype=np.int64),
        row=rows,
        thick=np.array(thick, dtype=np.float64),
        face_first=_starts([len(hull.faces) for hull in solids]),
        face=np.array(flat, dtype=np.float64).reshape(-1, 4),
        ring_first=_starts([len(ring) for ring in rings]),
        ring=np.array([k for ring in rings for k in ring], dtype=np.int64),
    )


def convex_work(bodies: ConvexBodies, grains: Grains) -> Blocks[ConvexWork]:
    """Return what the kernels work with, for the shapes of some grains.

    Parameters
    ----------
    bodies : ConvexBodies
        Tables of the shapes.
    grains : Grains
        Grains; their number and shapes count.
    """
    counts = np.diff(bodies.first)[grains.shape]
    first = _starts(counts.tolist())
    total, n = int(first[-1]), len(grains.shape)
    most = int(counts.max()) if n else 0
    work = ConvexWork(
        bodies=bodies,
        first=first,
        corner=np.zeros((total, 3)),
        radius=np.zeros(total),
        row=np.zeros((n, ROW)),
        form=np.zeros((n, 6)),
        simplex=new_simplex(),
        window=np.zeros((MOST_CORNERS, 3)),
        ring=np.zeros((MOST_CORNERS, 3)),
        other=np.zeros((MOST_CORNERS, 3)),
        one=np.zeros(most, dtype=np.int64),
        two=np.zeros(most, dtype=np.int64),
    )
    return Blocks(work, SCRATCH)


def _body(geometry: Geometry, row: Floats, faces: bool) -> tuple[int, _Hull, Floats, float]:
    """Return kind, hull, radii and inner radius of a geometry; write the row of a primitive."""
    if isinstance(geometry, Spheres):
        return SPHERES, _bare(geometry.centers), geometry.radii, float(geometry.radii.max())
    if isinstance(geometry, Primitive):
        d = geometry.dimensions
        if geometry.kind == "sphere":
            return SPHERES, _bare(np.zeros((1, 3))), np.array(d), d[0]
        if geometry.kind == "box":
            hull = _hull_of(linear.matmul(unit_box()[0] * np.array(d), geometry.matrix.T), faces)
            return HULL, hull, np.zeros(len(hull.corners)), min(d) / 2
        if geometry.kind == "spherocylinder":
            half = d[1] / 2 * geometry.matrix[:, 2]
            return HULL, _Hull(np.array([-half, half]), [[1], [0]], [], []), np.full(2, d[0]), d[0]
        row[:] = row_of(geometry)
        kind = CODES[geometry.kind]
        inner = min(d) if kind == ELLIPSOID else float(erosion_limit(row))
        return kind, _bare(np.zeros((0, 3))), np.zeros(0), inner
    if is_disk(geometry):
        assert isinstance(geometry, Outline)
        return SPHERES, _bare(np.array([[*geometry.center, 0.0]])), np.array([geometry.radius]), geometry.radius
    if isinstance(geometry, Outline):
        corners = np.column_stack([geometry.vertices, np.zeros(len(geometry.vertices))])
        kept = np.sort(load("scipy.spatial").ConvexHull(geometry.vertices).vertices)
        return HULL, _bare(corners[kept]), np.zeros(len(kept)), 0.0
    hull = _hull_of(geometry.vertices[np.unique(geometry.faces)], faces)
    if not faces:
        return HULL, hull, np.zeros(len(hull.corners)), 0.0
    qhull = load("scipy.spatial").ConvexHull(hull.corners)
    return HULL, hull, np.zeros(len(hull.corners)), float(-qhull.equations[:, 3].max())


def _bare(corners: Floats) -> _Hull:
    """Return corners without neighbors and faces."""
    return _Hull(corners, [[] for _ in corners], [], [])


def _hull_of(points: Floats, with_faces: bool) -> _Hull:
    """Return the corners, neighbors and, if asked, flat faces of the convex hull of (n, 3) points."""
    hull = load("scipy.spatial").ConvexHull(points)
    place = np.full(len(points), -1, dtype=np.int64)
    place[hull.vertices] = np.arange(len(hull.vertices))
    corners = np.ascontiguousarray(points[hull.vertices], dtype=np.float64)
    triangles = place[hull.simplices]
    links: list[set[int]] = [set() for _ in corners]
    for a, b, c in triangles.tolist():
        links[a] |= {b, c}
        links[b] |= {a, c}
        links[c] |= {a, b}
    normals = np.asarray(hull.equations[:, :3])
    own = _faces_of(corners, triangles, normals, _groups_of(normals, hull.neighbors)) if with_faces else ([], [])
    return _Hull(corners, [sorted(link) for link in links], *own)


def _groups_of(normals: Floats, neighbors: Any) -> Integers:
    """Return the number of the face that each triangle belongs to."""
    count = len(normals)
    one = np.repeat(np.arange(count), neighbors.shape[1])
    other = np.asarray(neighbors, dtype=np.int64).ravel()
    flat = linear.einsum("ki,ki->k", normals[one], normals[other]) > 1 - COPLANAR
    graph = load("scipy.sparse").coo_matrix((np.ones(int(flat.sum())), (one[flat], other[flat])), shape=(count, count))
    return load("scipy.sparse.csgraph").connected_components(graph, directed=False)[1]


def _faces_of(
    corners: Floats, triangles: Integers, normals: Floats, group: Integers
) -> tuple[list[Floats], list[list[int]]]:
    """Return normals with levels, and rings of corners, of the faces that are not small."""
    sides = np.cross(
        corners[triangles[:, 1]] - corners[triangles[:, 0]], corners[triangles[:, 2]] - corners[triangles[:, 0]]
    )
    areas = linear.norm(sides, axis=1) / 2
    least = LEAST_FACE * areas.sum()
    faces, rings = [], []
    order = np.argsort(group, kind="stable")
    for members in np.split(order, np.flatnonzero(np.diff(group[order])) + 1):
        some = np.unique(triangles[members])
        if (np.ptp(corners[some], axis=0) ** 2).sum() < least:
            continue
        normal = normals[members[np.argmax(areas[members])]]
        flat = linear.matmul(corners[some], linear.across(normal).T)
        # the ring of a face is convex also where rounding left a corner inside it
        ring = some[load("scipy.spatial").ConvexHull(flat).vertices]
        if len(ring) > MOST_CORNERS // 2:
            ring = ring[np.linspace(0, len(ring), MOST_CORNERS // 2, endpoint=False).astype(int)]
        faces.append(np.array([*normal, linear.matmul(corners, normal).max()]))
        rings.append(ring.tolist())
    return faces, rings


def _starts(counts: Sequence[int]) -> Integers:
    """Return where each of several runs starts, and where the last ends."""
    return np.concatenate([[0], np.cumsum(np.array(counts, dtype=np.int64))]).astype(np.int64)
