"""Grains that bend: one grain of the sample, moved so that it is strained and its surface is curved anew as little as
possible.

A stretch makes round bars oval and sharpens what bulges. A grain of bars that are bent, turned and lengthened against
each other is as new, and each bar stays as round as it was. So the displacement is a polynomial of degree 3, drawn from
the fields of least energy: the squares of the strains, as of an elastic solid whose sections keep their width, and of
the changes of the angles between neighbouring triangles (Grinspun, Hirani, Desbrun & Schroeder 2003, Discrete Shells).
"""

from itertools import product
from typing import NamedTuple

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, Integers
from voxgran.geometry.crossing import count_crossings
from voxgran.shapes.describing.curvature import SHARP, Edges, edges_of_mesh
from voxgran.shapes.learning.warp import frame_of
from voxgran.shapes.mesh import Mesh

#: powers of the monomials of degree 3 at most
POWERS = np.array([powers for powers in product(range(4), repeat=3) if sum(powers) <= 3])
#: weight of the changes of angles beside strains, fields that are kept, power of the energies by which they shrink
ANGLES, KEPT, STIFF = 30.0, 16, 2.5
#: edges flatter than this, in degrees, may not become sharp; rounds in which they are turned
FLAT, ROUNDS = 25.0, 4
#: displacements that are tried, each half of the one before
HALVES = 6


class Soft(NamedTuple):
    """Fields of least energy, softest first: coefficients (m, 20, 3) of unit mean square, and energies (m,)."""

    fields: Floats
    energies: Floats


def monomials(points: Floats) -> tuple[Floats, Floats]:
    """Return the monomials (n, 20) at points (n, 3), and their slopes along the axes (3, n, 20)."""
    raised = np.stack([np.ones_like(points), points, points**2, libm.power(points, 3)], axis=1)
    values = [raised[:, POWERS[:, k], k] for k in range(3)]
    slopes = [POWERS[:, k] * raised[:, np.maximum(POWERS[:, k] - 1, 0), k] for k in range(3)]
    along = [np.prod([slopes[k] if k == axis else values[k] for k in range(3)], axis=0) for axis in range(3)]
    return np.prod(values, axis=0), np.array(along)


def soft_fields(mesh: Mesh) -> Soft:
    """Return the fields in which a grain bends most easily, but for translations and rotations.

    Points are in equivalent radii from the centroid, and the mean square is that over the surface.
    """
    radius, center, _, _ = frame_of(mesh)
    body = (mesh.vertices - center) / radius
    # the corners of small meshes are numbers of a byte, products of which would not fit
    faces = mesh.corners.astype(np.int64)
    corners = body[faces]
    area = linear.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    # a rule of degree 2: a twelfth of each triangle at its corners and the rest at its middle
    at = np.concatenate([body, corners.mean(axis=1)])
    share = np.bincount(faces.ravel(), np.repeat(area, 3), len(body))
    share = np.concatenate([share / 12, 0.75 * area]) / area.sum()
    values, slopes = monomials(at)
    mass = linear.matmul(values.T, share[:, None] * values)
    # of a mesh of few vertices some monomials are equal
    mass += 1e-9 * np.diag(np.diag(mass))
    sizes, axes = linear.eigh(mass)
    even = axes / np.sqrt(np.maximum(sizes, np.finfo(float).tiny))
    slopes = linear.matmul(slopes, even)
    energy = _strains(slopes, share) + ANGLES * _turned(body, faces, linear.matmul(values[: len(body)], even))
    found, fields = linear.eigh(energy)
    kept = slice(6, 6 + KEPT)
    return Soft(linear.matmul(even, fields.T[kept].reshape(-1, 3, len(POWERS)).transpose(0, 2, 1)), found[kept])


def _strains(slopes: Floats, share: Floats) -> Floats:
    """Return the matrix (3 k, 3 k) of the mean square of the strains, for slopes (3, n, k) with shares (n,)."""
    pairs = np.array([[linear.matmul(a.T, share[:, None] * b) for b in slopes] for a in slopes])
    made = pairs.transpose(1, 2, 0, 3).copy()
    for axis in range(3):
        made[axis, :, axis] += np.trace(pairs)
    return np.asarray(made.reshape(3 * slopes.shape[2], -1) / 2)


def _turned(points: Floats, faces: Integers, values: Floats) -> Floats:
    """Return the matrix (3 k, 3 k) of the mean square, by the lengths of edges, of the changes of the angles between
    triangles, for functions with values (n, k) at the vertices.
    """
    edges = edges_of_mesh(points, faces)
    opposite = np.roll(faces, -2, axis=1).ravel()
    turned: Floats = np.zeros(1)
    for side, normal in ((edges.one, edges.first), (edges.two, edges.second)):
        begin, end, apex = edges.begin[side], edges.end[side], opposite[side]
        along, away = points[end] - points[begin], points[apex] - points[begin]
        square = np.maximum((along**2).sum(axis=1), 1e-300)
        foot = ((away * along).sum(axis=1) / square)[:, None]
        height = np.maximum(linear.norm(away - foot * along, axis=1), 1e-6)
        # by how much the apex rises above the edge, over its distance
        rise = (values[apex] - (1 - foot) * values[begin] - foot * values[end]) / height[:, None]
        turned = turned + normal[:, :, None] * rise[:, None]
    rows = np.asarray(turned).reshape(len(edges.length), -1) * np.sqrt(edges.length / edges.length.sum())[:, None]
    return np.asarray(linear.matmul(rows.T, rows))


def bent(mesh: Mesh, soft: Soft, strength: float, generator: np.random.Generator) -> tuple[Mesh, Floats]:
    """Return a grain, bent by a root mean square of `strength` equivalent diameters, and the coefficients (20, 3) of
    the displacement, in equivalent radii from the centroid.

    Where the surface crosses itself, as of thin necks and of parts that move into each other, the displacement is
    halved, and 0 in the end.
    """
    parts = generator.normal(size=len(soft.energies)) * libm.power(soft.energies[0] / soft.energies, STIFF)
    field = linear.einsum("k,kpa->pa", 2 * strength * parts / linear.norm(parts), soft.fields)
    for _ in range(HALVES):
        points = displaced(mesh, field)
        faces = unfolded(points, mesh.corners.astype(np.int64), mesh.vertices)
        if not count_crossings(points, faces):
            return Mesh(points, faces), field
        field = field / 2
    return mesh, 0 * field


def displaced(mesh: Mesh, field: Floats) -> Floats:
    """Return the vertices (n, 3) of a grain under a displacement of coefficients (20, 3)."""
    radius, center, _, _ = frame_of(mesh)
    return np.asarray(mesh.vertices + radius * linear.matmul(monomials((mesh.vertices - center) / radius)[0], field))


def unfolded(points: Floats, faces: Integers, before: Floats) -> Integers:
    """Return triangles (n, 3) whose edges are turned to the other diagonal where flat ones have become sharp: narrow
    triangles, as booleans leave them, fold when what lies about them bends.
    """
    for _ in range(ROUNDS):
        edges = edges_of_mesh(points, faces)
        sharp = np.flatnonzero(np.abs(edges.angle) > np.radians(SHARP))
        if not len(sharp):
            break
        angle = edges_of_mesh(before, faces).angle
        sharp = sharp[np.abs(angle[sharp]) < np.radians(FLAT)]
        sharp = sharp[np.argsort(-np.abs(edges.angle * edges.length)[sharp], kind="stable")]
        known = set(zip(edges.begin.tolist(), edges.end.tolist(), strict=True)) if len(sharp) else set()
        least, taken = _fold(edges), set[int]()
        for one, two in zip(edges.one[sharp].tolist(), edges.two[sharp].tolist(), strict=True):
            pair = {one // 3, two // 3}
            a, b, c = np.roll(faces[one // 3], -(one % 3)).tolist()
            d = int(np.roll(faces[two // 3], -(two % 3))[2])
            # triangles about an edge that is turned have other edges now
            if taken & pair or (c, d) in known:
                continue
            turned = faces.copy()
            turned[one // 3], turned[two // 3] = (c, a, d), (d, b, c)
            fold = _fold(edges_of_mesh(points, turned))
            if fold < least:
                faces, least, taken = turned, fold, taken | pair
        if not taken:
            break
    return faces


def _fold(edges: Edges) -> float:
    """Return by how much the sharp edges turn: the sum of the lengths times the angles."""
    return float((np.abs(edges.angle) * edges.length)[np.abs(edges.angle) > np.radians(SHARP)].sum())
