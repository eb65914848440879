"""Exact partition of a solid into convex parts, for engines of convex blocks.

A mesh is cut along planes of faces at its reflex edges, where two faces meet at more than 180 degrees inside, until
there are none (Chazelle 1984). Of these planes that is taken which ends the most reflex edges and crosses the fewest;
it ends all that lie in it, so that a union of convex solids has far fewer parts than reflex edges. A union of spheres
is cut along the planes of equal power distance, which gives one part for each sphere (Aurenhammer 1987).

References
----------
Chazelle 1984 (doi:10.1137/0213031); Aurenhammer 1987 (doi:10.1137/0216006).
"""

import math
from typing import Any

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.errors import InputError
from voxgran._base.lazy import load
from voxgran.shapes.mesh import Mesh, hull_of
from voxgran.shapes.model import Shape
from voxgran.shapes.sphere_union import contained
from voxgran.shapes.spheres import MOST_TRIANGLES, Spheres
from voxgran.shapes.tessellate import sphere

#: most parts of one solid
MOST_PARTS = 300
#: most that a corner of a part may lie outside of one of its faces, in lengths of the solid
FLAT = 1e-9
#: most reflex edges of a solid that is cut
MOST_EDGES = 600
#: most by which the volumes of the parts may differ from that of the solid, in its volume; and that of one cut
EXACT, CUT_EXACT = 1e-9, 1e-11
#: volume of what a cut leaves by rounding alone, in volumes of the solid
NOTHING = 1e-12
#: height of a triangle below which rounding turns its normal too far, in lengths of the solid
THIN = 1e-6


def convex_parts(shape: Shape) -> list[Mesh]:
    """Return the convex parts of a solid in its body frame; they touch, do not overlap and fill the solid.

    Parameters
    ----------
    shape : Shape
        A solid; of a smooth one the parts are those of its tessellation.

    Raises
    ------
    InputError
        If the shape is flat or an open surface, has too many parts, or cannot be cut without error.
    """
    shape.refuse_open("convex parts")
    if shape.dimension == 2:
        raise InputError(f"shape {shape.name!r} is flat: convex parts are those of solids; give grains='mesh'")
    if isinstance(shape.geometry, Spheres):
        return _of_spheres(shape.geometry)
    return _Partition(shape).parts()


def _of_spheres(union: Spheres) -> list[Mesh]:
    """Return the cells of a union of spheres, as fine as its tessellation."""
    library = load("manifold3d")
    bare = ~contained(union.centers, union.radii)
    centers, radii = union.centers[bare], union.radii[bare]
    unit, faces, _ = sphere(int(np.clip(math.log(MOST_TRIANGLES / (20 * len(radii)), 4), 1, 4)))
    squares = linear.einsum("si,si->s", centers, centers) - radii**2
    found = []
    for k, (center, radius) in enumerate(zip(centers, radii, strict=True)):
        cell = library.Manifold(library.Mesh64(center + radius * unit, faces.astype(np.uint64)))
        for other in np.flatnonzero(np.arange(len(radii)) != k):
            normal = center - centers[other]
            length = float(linear.norm(normal))
            level = float(squares[k] - squares[other]) / (2 * length)
            # the plane may pass outside of the sphere
            if level > float(linear.matmul(center, normal)) / length - radius:
                cell = cell.trim_by_plane(tuple(normal.tolist()), level)
        if cell.volume() > NOTHING * float(union.volume):
            found.append(Mesh(*_arrays(cell.hull())))
    return found


class _Partition:
    """Cuts of one mesh."""

    def __init__(self, shape: Shape) -> None:
        """Take the mesh of a shape."""
        library = load("manifold3d")
        self.name = shape.name
        self.mesh = Mesh(shape.vertices, shape.faces)
        self.size = float(np.ptp(shape.vertices, axis=0).max())
        self.solid = library.Manifold(library.Mesh64(self.mesh.vertices.copy(), self.mesh.faces.astype(np.uint64)))

    def parts(self) -> list[Mesh]:
        """Return the parts.

        Raises
        ------
        InputError
            If there are too many, or they do not fill the solid.
        """
        volume = float(self.mesh.volume)
        ahead, done = [self.solid], []
        edges = len(self._reflex(self.mesh.vertices, self.mesh.faces)[0])
        if edges > MOST_EDGES:
            raise self._too_many(edges)
        while ahead:
            piece = ahead.pop()
            pieces = self._cut(piece)
            if len(pieces) == 1 and pieces[0] is piece:
                done.append(self._part(piece))
            ahead += [one for one in pieces if one is not piece]
            if len(ahead) + len(done) > MOST_PARTS:
                raise self._too_many(edges)
        if abs(sum(part.volume for part in done) - volume) > EXACT * volume:
            raise InputError(
                f"shape {self.name!r} has triangles so thin that no cut into convex parts is exact: give grains='mesh'"
            )
        return done

    def _part(self, piece: Any) -> Mesh:
        """Return a convex piece without corners within its faces; thin triangles mislead one hull or the other."""
        points = _arrays(piece)[0]
        hull = Mesh(*_arrays(piece.hull()))
        if abs(hull.volume - piece.volume()) > CUT_EXACT * float(self.mesh.volume):
            hull = hull_of(np.ascontiguousarray(points[np.sort(load("scipy.spatial").ConvexHull(points).vertices)]))
        return hull

    def _too_many(self, edges: int) -> InputError:
        """Return the error for a solid with too many parts."""
        return InputError(
            f"shape {self.name!r} has {edges} reflex edges and more than {MOST_PARTS} convex parts: that is too many; "
            "give grains='mesh', or a shape of fewer triangles"
        )

    def _cut(self, solid: Any) -> list[Any]:
        """Return the pieces of a solid after one cut; the solid itself where it is convex."""
        vertices, faces = _arrays(solid)
        ends, planes, levels = self._reflex(vertices, faces)
        allowed = FLAT * self.size
        if len(ends):
            heights = linear.matmul(planes, ends.reshape(-1, 3).T) - levels[:, None]
            low, high = np.sort(heights.reshape(len(planes), -1, 2), axis=2).transpose(2, 0, 1)
            ended = (high < allowed) & (low > -allowed)
            crossed = (high > allowed) & (low < -allowed)
            order = np.argsort(crossed.sum(axis=1) - ended.sum(axis=1), kind="stable")
        else:
            # what a cut left of a face in its own plane may stand out as a blade without thickness
            normals, good = self._normals(vertices, faces)
            planes = normals[good]
            levels = linear.einsum("pi,pi->p", planes, vertices[faces[good, 0]])
            beyond = linear.matmul(vertices, planes.T).max(axis=0) - levels
            order = np.argsort(-beyond, kind="stable")[: int((beyond > allowed).sum())]
        for plane in order.tolist():
            pieces = self._split(solid, planes[plane], float(levels[plane]))
            if len(pieces) > 1 or (pieces and self._lost_blade(vertices, pieces[0], planes[plane], levels[plane])):
                return pieces
        return [solid]

    def _split(self, solid: Any, normal: Floats, level: float) -> list[Any]:
        """Return the connected pieces on both sides of a plane; none if the cut changes the volume."""
        halves = solid.split_by_plane(tuple(normal.tolist()), level)
        least = NOTHING * float(self.mesh.volume)
        pieces = [piece for half in halves for piece in half.decompose() if piece.volume() > least]
        error = abs(sum(piece.volume() for piece in pieces) - solid.volume())
        return pieces if error < CUT_EXACT * float(self.mesh.volume) else []

    def _lost_blade(self, before: Floats, piece: Any, normal: Floats, level: float) -> bool:
        """Return whether a cut that left one piece took something without volume from it."""
        allowed = FLAT * self.size
        old, new = linear.matmul(before, normal) - level, linear.matmul(_arrays(piece)[0], normal) - level
        return bool((old.max() > allowed >= new.max()) or (old.min() < -allowed <= new.min()))

    def _reflex(self, vertices: Floats, faces: Integers) -> tuple[Floats, Floats, Floats]:
        """Return the ends (e, 2, 3) of the reflex edges of a mesh, and the planes of the faces beside them.

        Planes are unit normals (p, 3) and levels (p,); faces that are too thin to have a plane are left out.
        """
        normals, good = self._normals(vertices, faces)
        start, end, opposite = (np.roll(faces, -shift, axis=1).ravel() for shift in range(3))
        face = np.repeat(np.arange(len(faces)), 3)
        count = len(vertices)
        there, back = np.argsort(start * count + end, kind="stable"), np.argsort(end * count + start, kind="stable")
        twin = np.empty_like(there)
        twin[there] = back
        height = linear.einsum("ei,ei->e", vertices[opposite[twin]] - vertices[start], normals[face])
        # each edge is seen from the faces on both of its sides
        reflex = good[face] & (height > FLAT * self.size)
        seen = reflex | (reflex[twin] & good[face])
        once = (reflex | reflex[twin]) & (start < end)
        planes = normals[face[seen]]
        levels = linear.einsum("pi,pi->p", planes, vertices[start[seen]])
        return vertices[np.stack([start, end], axis=1)[once]], planes, levels

    def _normals(self, vertices: Floats, faces: Integers) -> tuple[Floats, Booleans]:
        """Return unit normals (f, 3) of triangles, and which (f,) are not too thin for one."""
        corners = vertices[faces]
        sides = np.roll(corners, -1, axis=1) - corners
        normals = np.cross(sides[:, 0], -sides[:, 2])
        sizes = linear.norm(normals, axis=1)
        longest = linear.norm(sides, axis=2).max(axis=1)
        good = sizes > THIN * self.size * longest
        return normals / np.where(sizes > 0, sizes, 1.0)[:, None], good


def _arrays(solid: Any) -> tuple[Floats, Integers]:
    """Return vertices and faces of a solid of manifold3d."""
    mesh = solid.to_mesh64()
    return np.array(mesh.vert_properties[:, :3], dtype=np.float64), np.array(mesh.tri_verts, dtype=np.int64)
