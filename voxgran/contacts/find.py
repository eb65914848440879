"""Contacts of all grains of an assembly: one broad phase, then the exact test for each pair of geometries.

The depth is defined alike for all solids: the largest distance, to the surface of one grain, of a point of the other
inside it. It is correct to first order for shallow overlaps; for overlaps deeper than the smallest radius of curvature
or larger than a thousandth of a grain's volume its relative error is about 0.001. The depth of an open surface in a
solid is defined in the same way; that of two crossing open surfaces is the shortest translation that separates them.
"""

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, as_number
from voxgran._base.compiling.threads import using_threads
from voxgran._base.progress import OnStep, Step, silent
from voxgran._base.stopping import stop_if_asked
from voxgran.contacts.assembly import Assembly
from voxgran.contacts.broad import Pairs, grain_pairs
from voxgran.contacts.convex import part_contacts, sphere_contacts
from voxgran.contacts.inside import inner_distance, placed
from voxgran.contacts.mesh_parts import touch_convex, touch_spheres
from voxgran.contacts.meshes import touch_meshes
from voxgran.contacts.model import Contacts, Touch
from voxgran.contacts.open_surfaces import open_touch
from voxgran.contacts.outlines import touch_disk, touch_polygons
from voxgran.contacts.parts import has_parts, is_disk, parts_of
from voxgran.contacts.search import deepest_point
from voxgran.contacts.solid import Solid
from voxgran.contacts.surface_pairs import surface_gaps
from voxgran.geometry.tree import TriangleTree
from voxgran.shapes.describing.body import Geometry
from voxgran.shapes.mesh import Mesh, Surface
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive

TouchPair = Callable[..., Touch]
#: two grains and the periodic image of the second
PairKey = tuple[int, int, int, int, int]


def find_contacts(assembly: Assembly, gap: float = 0.0) -> Contacts:
    """Return all pairs of grains whose surfaces are within a gap, periodic images included.

    There is one contact per pair and image: the nearest points, or the deepest points of an overlap. The gap is in the
    unit of lengths; a negative value is a smallest depth of overlap.

    Raises
    ------
    InputError
        If the gap is not finite.
    """
    reach = as_number(gap, "gap")
    with using_threads(None):
        return contacts_of_pairs(assembly, grain_pairs(assembly, reach), reach)


def overlaps(assembly: Assembly, *, at_least: float = 0.0) -> Contacts:
    """Return all pairs of grains that overlap deeper than `at_least`, in the unit of lengths.

    Raises
    ------
    InputError
        If the limit is negative or not finite.
    """
    limit = as_number(at_least, "at_least", at_least=0.0)
    found = contacts_of_pairs(assembly, grain_pairs(assembly, -limit), -limit)
    return found.where(found.gap < -limit)


def surface_trees(assembly: Assembly) -> Callable[[int], TriangleTree]:
    """Return a function that gives the box tree of a shape that is a mesh or a box."""
    return _PairTests(assembly).tree


def pair_keys(pairs: Pairs) -> list[PairKey]:
    """Return one key per pair, from its grains and image."""
    rows = np.column_stack([pairs.i, pairs.j, pairs.image]).tolist()
    return [(i, j, x, y, z) for i, j, x, y, z in rows]


def contacts_of_pairs(assembly: Assembly, pairs: Pairs, gap: float, *, on_step: OnStep = silent) -> Contacts:
    """Return the exact contacts within a gap, in the unit of lengths, of the pairs of the broad phase."""
    distance, normal, point = gaps_of_pairs(assembly, pairs, gap, on_step=on_step)
    point += assembly.position[pairs.i]
    contacts = Contacts(pairs.i, pairs.j, pairs.image, distance, normal, point)
    return contacts.where(distance <= gap)


def gaps_of_pairs(
    assembly: Assembly, pairs: Pairs, gap: float, *, deepest: bool = True, on_step: OnStep = silent
) -> tuple[Floats, Floats, Floats]:
    """Return gaps (m,), normals (m, 3) and points (m, 3) from centroid i of all pairs; gaps beyond `gap` are infinite.

    If `deepest` is false, the deepest point of an overlap is not searched; depths are then positive lower bounds.
    """
    if all(shape.is_sphere for shape in assembly.shapes):
        return sphere_contacts(pairs, assembly.bounding_radii)
    return _test_mixed(assembly, pairs, gap, deepest=deepest, on_step=on_step)


def _test_mixed(
    assembly: Assembly, pairs: Pairs, gap: float, *, deepest: bool, on_step: OnStep
) -> tuple[Floats, Floats, Floats]:
    """Return gap, normal and point (from centroid i) of pairs of any geometries."""
    distance = np.full(pairs.count, np.inf)
    normal, point = np.zeros((pairs.count, 3)), np.zeros((pairs.count, 3))
    geometries = [shape.geometry for shape in assembly.shapes]
    made = np.array([has_parts(geometry) for geometry in geometries], dtype=np.bool_)
    made = made[assembly.shape_id]
    simple = made[pairs.i] & made[pairs.j]
    if simple.any():
        parts = parts_of(geometries).placed(assembly.shape_id, assembly.scale, assembly.matrices)
        some = pairs.where(simple)
        distance[simple], normal[simple], point[simple], deep = part_contacts(some, parts, gap)
        for k in np.flatnonzero(simple)[deep] if deepest else ():
            _search(assembly, pairs, int(k), distance, point)
    tests = _PairTests(assembly, deepest=deepest)
    closed = np.array([is_closed_surface(geometry) for geometry in geometries], dtype=np.bool_)[assembly.shape_id]
    rest = ~simple
    surfaces = np.flatnonzero(rest & closed[pairs.i] & closed[pairs.j])
    if len(surfaces):
        *known, proven = surface_gaps(assembly, pairs.where(surfaces), gap, tree_of=tests.tree, on_step=on_step)
        proven_pairs = surfaces[proven]
        distance[proven_pairs], normal[proven_pairs], point[proven_pairs] = (part[proven] for part in known)
        rest[proven_pairs] = False
    total = int(rest.sum())
    for done, k in enumerate(np.flatnonzero(rest)):
        stop_if_asked()
        on_step(Step(stage="overlaps", done=done, total=total, text=f"{done} of {total} near pairs"))
        i, j = int(pairs.i[k]), int(pairs.j[k])
        touch = tests.touch(i, j, pairs.offset[k], gap)
        distance[k], normal[k], point[k] = touch.gap, touch.normal, touch.point
    return distance, normal, point


def is_closed_surface(geometry: Geometry) -> bool:
    """Return whether the contact tests use the triangles of a geometry: a mesh or a box."""
    return isinstance(geometry, Mesh) or (isinstance(geometry, Primitive) and geometry.kind == "box")


def relative_pose(assembly: Assembly, i: int, j: int, offset: Floats) -> tuple[Floats, Floats]:
    """Return matrix and offset of the map from the body frame of grain j to that of grain i, at scale 1 of shape i.

    `offset` is the (3,) vector from the centroid of grain i to that of its partner.
    """
    back = assembly.matrices[i].T
    ratio = assembly.scale[j] / assembly.scale[i]
    return linear.matmul(back, assembly.matrices[j]) * ratio, linear.matmul(back, offset) / assembly.scale[i]


def _search(assembly: Assembly, pairs: Pairs, k: int, distance: Floats, point: Floats) -> None:
    """Replace the depth of a pair that is too deep for a closed form if a search finds a larger one."""
    stop_if_asked()
    i, j = int(pairs.i[k]), int(pairs.j[k])
    inner = [
        placed(
            inner_distance(assembly.shapes[assembly.shape_id[grain]].geometry),
            matrix=assembly.matrices[grain] * assembly.scale[grain],
            offset=offset,
        )
        for grain, offset in ((i, np.zeros(3)), (j, pairs.offset[k]))
    ]
    one, other = assembly.bounding_radii[i], assembly.bounding_radii[j]
    low = np.maximum(-one, pairs.offset[k] - other) * np.ones(3)
    high = np.minimum(one, pairs.offset[k] + other) * np.ones(3)
    depth, where, _ = deepest_point(inner[0], inner[1], low, high)
    if -depth < distance[k]:
        distance[k], point[k] = -depth, where


class _PairTests:
    """Exact tests of pairs that need a mesh or a polygon; precomputed data of each shape are cached."""

    def __init__(self, assembly: Assembly, *, deepest: bool = True) -> None:
        self.assembly, self.deepest = assembly, deepest
        self.geometries = [shape.geometry for shape in assembly.shapes]
        self.solids: dict[int, Solid] = {}
        self.kept: dict[tuple[int, int], tuple[TouchPair, bool]] = {}

    def touch(self, i: int, j: int, offset: Floats, gap: float) -> Touch:
        """Test one pair; the point is relative to the centroid of grain i; all values are in the unit of lengths."""
        assembly = self.assembly
        a, b = int(assembly.shape_id[i]), int(assembly.shape_id[j])
        if (a, b) not in self.kept:
            self.kept[a, b] = self._choose(a, b)
        test, flip = self.kept[a, b]
        one, other, way = (j, i, -offset) if flip else (i, j, offset)
        matrix, shift = relative_pose(assembly, one, other, way)
        scale = float(assembly.scale[one])
        touch = test(matrix=matrix, offset=shift, reach=max(gap, 0.0) / scale)
        if not math.isfinite(touch.gap):
            return touch
        base = offset if flip else np.zeros(3)
        touch = touch.moved(matrix=assembly.matrices[one] * scale, offset=base, factor=scale)
        return touch.flipped() if flip else touch

    def _choose(self, a: int, b: int) -> tuple[TouchPair, bool]:
        """Return the test for two shapes, and whether it expects them in reverse order."""
        one, other = self.geometries[a], self.geometries[b]
        if isinstance(one, Surface):
            return open_touch(one, other, partial(self._solid, b)), False
        if isinstance(other, Surface):
            return self._choose(b, a)[0], True
        if isinstance(one, Outline) and isinstance(other, Outline):
            if is_disk(one):
                return partial(touch_disk, other, one, deepest=self.deepest), True
            if is_disk(other):
                return partial(touch_disk, one, other, deepest=self.deepest), False
            return partial(touch_polygons, one, other, deepest=self.deepest), False
        if not isinstance(one, Mesh) and isinstance(other, Mesh):
            test, _ = self._choose(b, a)
            return test, True
        if isinstance(other, Mesh) or (isinstance(other, Primitive) and other.kind == "box"):
            return partial(touch_meshes, self._solid(a), self._solid(b)), False
        if isinstance(other, Primitive) and other.kind != "sphere":
            return partial(touch_convex, self._solid(a), other), False
        return partial(touch_spheres, self._solid(a), other, parts_of([other])), False

    def tree(self, shape: int) -> TriangleTree:
        """Return the box tree of a shape that is a mesh or a box."""
        return self._solid(shape).tree

    def _solid(self, shape: int) -> Solid:
        """Return the mesh of a shape that is a mesh or a box."""
        if shape not in self.solids:
            geometry = self.geometries[shape]
            if not isinstance(geometry, Mesh):
                vertices, faces, _ = geometry.tessellation()
                geometry = Mesh(vertices, faces)
            self.solids[shape] = Solid(geometry)
        return self.solids[shape]
