"""Grains and pairs as the rows that the finders of contacts between surfaces take."""

import numpy as np

from voxgran.contacts.assembly import Assembly
from voxgran.contacts.broad import Pairs
from voxgran.contacts.find import surface_trees
from voxgran.contacts.manifolds.rows import CONVEX, ROW, SPHERE, SURFACE, ContactRows, Grains, PairList
from voxgran.contacts.surface_pairs import surface_gaps
from voxgran.geometry.rotation import normalized, rotation_matrices
from voxgran.shapes.mesh import Mesh


def grains_of(shapes, shape, position, turns, scale=None):
    """Return grains in their poses; meshes count as surfaces, whether convex or not."""
    n = len(position)
    scale = np.ones(n) if scale is None else np.array(scale, dtype=float)
    kinds = [SURFACE if isinstance(s.geometry, Mesh) else (SPHERE if s.is_sphere else CONVEX) for s in shapes]
    radius = np.array([s.bounding_radius for s in shapes])[shape] * scale
    place = np.array(position, dtype=float)
    kind = np.array(kinds, dtype=np.int64)[shape]
    return Grains(place, rotation_matrices(turns), scale, radius, np.array(shape), kind, np.zeros(n))


def pairs_of(i, j, shift=None):
    """Return pairs that were never looked at."""
    n = len(i)
    ints, reals = (lambda: np.zeros(n, dtype=np.int64)), (lambda: np.zeros(n))
    moved = np.zeros((n, 3)) if shift is None else np.array(shift, dtype=float)
    bound, normal = np.full(n, -1e9), np.full((n, 3), 2.0)
    return PairList(
        np.array(i), np.array(j), moved, ints(), ints(), bound, reals(), normal, reals(), np.full((n, 6), -1)
    )


def rows_of(cap):
    """Return room for so many contacts."""
    ints = np.zeros(cap, dtype=np.int64)
    return ContactRows(np.zeros((cap, ROW)), ints, ints.copy(), np.zeros((cap, ROW)))


def couples(many, shapes, seed, *, reach=1.3, ratio=1.0):
    """Return grains in couples at random distances, far from other couples, and their pairs."""
    generator = np.random.Generator(np.random.Philox(seed))
    shape = generator.integers(0, len(shapes), 2 * many)
    turns = normalized(generator.normal(size=(2 * many, 4)))
    size = np.array([s.diameter for s in shapes])[shape]
    scale = 1.0 / size
    scale[1::2] *= ratio
    place = np.zeros((2 * many, 3))
    place[:, 0] = 40.0 * np.repeat(np.arange(many), 2)
    way = generator.normal(size=(many, 3))
    far = (0.5 + reach * generator.random(many)) * (0.5 + 0.5 * ratio)
    place[1::2] += way / np.linalg.norm(way, axis=1)[:, None] * far[:, None]
    grains = grains_of(shapes, shape, place, turns, scale)
    return grains, turns, pairs_of(np.arange(0, 2 * many, 2), np.arange(1, 2 * many, 2))


def exact_gaps(shapes, grains, turns, pairs, reach, container):
    """Return gap, normal and proof of pairs of meshes and boxes by the general tests."""
    assembly = Assembly(
        tuple(shapes), grains.shape.copy(), grains.scale.copy(), grains.position.copy(), turns.copy(), container
    )
    offset = grains.position[pairs.j] + pairs.shift - grains.position[pairs.i]
    listed = Pairs(pairs.i, pairs.j, np.zeros((len(pairs.i), 3), dtype=np.int64), offset)
    gap, normal, point, proven = surface_gaps(assembly, listed, reach, tree_of=surface_trees(assembly))
    return gap, normal, point, proven


def bring_near(shapes, grains, turns, pairs, container, generator, *, most=0.01):
    """Move the second grain of couples of meshes, once, along the normal of the pair, to a gap up to `most`."""
    gap, normal, _, proven = exact_gaps(shapes, grains, turns, pairs, 0.5, container)
    some = proven & (gap < 0.5)
    move = most * generator.random(len(gap)) - np.where(some, gap, 0.0)
    grains.position[pairs.j[some]] += (normal * move[:, None])[some]
