"""Whether a triangle mesh bounds one solid, and what is wrong where it does not.

A grain is bounded by one outer shell whose faces point outward and any number of inner shells, the cavities, whose
faces point inward; no edge is open or shared by more than two faces, and no face cuts through another.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base import ExplainedAttributes
from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers, as_faces, box_of, float_array
from voxgran._base.calls import explained
from voxgran._base.errors import DirtyMeshError, InputError, shown
from voxgran._base.kernels import kernel
from voxgran._base.lazy import load
from voxgran.geometry.crossing import count_crossings
from voxgran.lattice.label import components
from voxgran.shapes.shells import count_apart, count_flipped, edge_faults, numbered_edges, shell_counts, without_unused

#: vertices nearer than this many diagonals of the bounding box are one
WELD = 1e-12
#: unit vector in which no two corners of a lattice are alike
ALONG = np.sqrt([0.2, 0.3, 0.5])


@dataclass(frozen=True, slots=True, kw_only=True)
class Remedies:
    """What a caller can do about a mesh that is not one closed solid, in words that end a message.

    A message names only what its reader can type: keywords in Python, keys in a scene, flags at the prompt.
    """

    mend: str = "use vg.repair"  # what repairs it
    keep_open: str = "use Shape.from_surface"  # what takes it as an open surface; empty where the caller takes none
    choose: str = "use vg.repair with bodies='largest' or bodies='all'"  # what chooses among several solids
    hole: str = "raise max_hole"  # what closes a wider hole

    def of_opening(self, closing: str) -> str:
        """Return what closes an opening, and what keeps it open where that can be done."""
        return f"{closing}, or {self.keep_open} where it is to stay open" if self.keep_open else closing


#: of functions that take vertices and faces
IN_PYTHON = Remedies()


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagnosis(ExplainedAttributes):
    """What is known about a triangle mesh; all are counts.

    Attributes
    ----------
    faces : int
        Triangles.
    not_finite : int
        Coordinates that are NaN or infinite; where there are any, nothing else is looked at.
    open_edges : int
        Edges with a face on one side only.
    non_manifold_edges : int
        Edges with more than two faces, or of a face that is a line or a point.
    flipped_faces : int
        Faces that are wound against their neighbours.
    self_intersections : int
        Pairs of faces that cut through each other.
    bodies : int
        Separate solids; 0 where edges are open.
    cavities : int
        Inner shells that point inward: empty space in a solid.
    outward_inner_shells : int
        Inner shells that point outward: solid counted twice.
    inside_out : int
        Outer shells that point inward.
    zero_volume : int
        Shells that enclose nothing.
    """

    faces: int
    not_finite: int = 0
    open_edges: int = 0
    non_manifold_edges: int = 0
    flipped_faces: int = 0
    self_intersections: int = 0
    bodies: int = 0
    cavities: int = 0
    outward_inner_shells: int = 0
    inside_out: int = 0
    zero_volume: int = 0

    @property
    def closed(self) -> bool:
        """Whether each edge has two faces that are wound alike."""
        wrong = self.not_finite, self.open_edges, self.non_manifold_edges, self.flipped_faces
        return self.faces > 0 and not any(wrong)

    @property
    def ok(self) -> bool:
        """Whether it bounds one solid."""
        return not self.sentences()

    def sentences(self, name: str = "the mesh", *, remedies: Remedies = IN_PYTHON) -> list[str]:
        """Return what is wrong, one sentence each, the gravest first; empty where it bounds one solid.

        `name` and `remedies` are what the sentences call the mesh, and what the reader can do about it.
        """
        found = [] if self.faces else [f"{name} has no faces: a grain must be a closed surface; check the file"]
        mend, several = remedies.mend, self.bodies if self.bodies > 1 else 0
        rules = [
            (self.not_finite, "coordinates that are not finite", "every one must be a number", "correct them"),
            (self.open_edges, "open edges", "a grain must be a closed surface", remedies.of_opening(mend)),
            (self.non_manifold_edges, "edges without exactly two faces", "each must join two", mend),
            (several, "separate bodies", "a grain must be one solid", remedies.choose),
            (self.flipped_faces, "faces wound against their neighbours", "all must be wound alike", mend),
            (self.zero_volume, "shells without volume", "a grain must enclose space", mend),
            (self.self_intersections, "pairs of faces that cut through each other", "they may touch", mend),
            (self.inside_out, "outer shells with faces that point inward", "they must point outward", mend),
            (self.outward_inner_shells, "inner shells that point outward", "a cavity points inward", mend),
        ]
        found += [f"{name} has {count} {nouns}: {rule}; {remedy}" for count, nouns, rule, remedy in rules if count]
        return found


@explained(hint="diagnose(vertices, faces)")
def diagnose(vertices: "ArrayLike | Any", faces: "ArrayLike | None" = None) -> Diagnosis:
    """Find out whether a triangle mesh bounds one solid.

    Parameters
    ----------
    vertices : (n, 3) array_like of float, or an object with `vertices` and `faces`
        Corner points; those that coincide count as one.
    faces : (m, 3) array_like of int, optional
        Triangles; left out where the first argument is an object that has them.

    Returns
    -------
    Diagnosis

    Raises
    ------
    InputError
        If an array has the wrong shape or an index is out of range.

    Examples
    --------
    >>> import voxgran as vg
    >>> cube = vg.shapes.box(lengths=(1, 1, 1))
    >>> vg.diagnose(cube).closed, vg.diagnose(cube.vertices, cube.faces[1:]).open_edges
    (True, 3)
    """
    if faces is None:
        if not hasattr(vertices, "vertices") or not hasattr(vertices, "faces"):
            raise InputError(
                f"faces is None and {type(vertices).__name__} has none: give vertices and faces, or a shape"
            )
        vertices, faces = vertices.vertices, vertices.faces
    points = float_array(vertices)
    if points is None or points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"vertices is {shown(vertices)}: it must be an array of numbers of shape (n, 3); give one")
    triangles = as_faces(faces, len(points))
    bad = int((~np.isfinite(points)).sum())
    if bad or not len(triangles):
        return Diagnosis(faces=len(triangles), not_finite=bad)
    return _examined(points, triangles, whole=True)[0]


def as_solid(
    vertices: Floats, faces: Integers, name: str, *, remedies: Remedies = IN_PYTHON
) -> tuple[Floats, Integers]:
    """Return a triangle mesh that bounds one solid, with coincident vertices merged.

    A surface that touches itself, so that edges would have more than two faces, keeps its vertices as they are if it
    bounds one solid with them.

    Raises
    ------
    DirtyMeshError
        If it does not; the message names the gravest reason.
    """
    found, points, triangles = _examined(vertices, faces, whole=False)
    wrong = found.sentences(name, remedies=remedies)
    if wrong:
        raise DirtyMeshError(wrong[0])
    return points, triangles


def refuse_dirty(vertices: Floats, faces: Integers, name: str, *, remedies: Remedies = IN_PYTHON) -> None:
    """Raise unless a triangle mesh of merged vertices bounds one solid.

    Raises
    ------
    DirtyMeshError
        If it does not; the message names the gravest reason.
    """
    wrong = _examine(vertices, faces, whole=False).sentences(name, remedies=remedies)
    if wrong:
        raise DirtyMeshError(wrong[0])


def bounds_solid(vertices: Floats, faces: Integers) -> bool:
    """Return whether a triangle mesh of finite coordinates bounds one solid; coincident vertices count as one."""
    return _examined(vertices, faces, whole=False)[0].ok


def refuse_open(vertices: Floats, faces: Integers, name: str, *, remedies: Remedies = IN_PYTHON) -> None:
    """Raise where a triangle mesh has open edges, as :func:`refuse_dirty` does; nothing else is tested.

    Raises
    ------
    DirtyMeshError
        If it has open edges.
    """
    open_edges = int(edge_faults(faces, len(vertices))[0])
    if open_edges:
        raise DirtyMeshError(Diagnosis(faces=len(faces), open_edges=open_edges).sentences(name, remedies=remedies)[0])


def merged(vertices: Floats, faces: Integers, *, weld: float = WELD) -> tuple[Floats, Integers]:
    """Return the mesh with vertices nearer than `weld` diagonals of the bounding box merged and unused ones left out.

    Nothing is repaired: a face that becomes a line is left out only where the surface is closed without it.
    """
    if not len(faces):
        return vertices[:0].copy(), faces.copy()
    points, faces = without_unused(vertices, faces)
    points += 0.0  # no negative zeros
    first, same = _bit_equal(np.ascontiguousarray(points).view(np.uint64))
    corners, group = points[first], same[faces]
    welded = _near(corners, weld)
    if welded is not None:
        corners, group = corners[welded[0]], welded[1][group]
    line = (group == np.roll(group, 1, axis=1)).any(axis=1)
    if line.any() and not edge_faults(group[~line], len(corners)).any():
        group = group[~line]
        corners, group = without_unused(corners, group)
    return np.ascontiguousarray(corners), np.ascontiguousarray(group, dtype=np.int64)


@kernel
def _bit_equal(points):  # type: ignore[no-untyped-def]
    """Return the first of each set of equal points (n, 3), in their order, and the set of each point.

    The points are 64-bit words of their coordinates, which are looked up in a table by their hash.
    """
    room = 64
    while room < 2 * len(points):
        room *= 2
    table, same = np.full(room, -1, dtype=np.int64), np.empty(len(points), dtype=np.int64)
    first, count = np.empty(len(points), dtype=np.int64), 0
    for p in range(len(points)):
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        word = x * np.uint64(0x9E3779B97F4A7C15)
        word = (word ^ (word >> np.uint64(32)) ^ y) * np.uint64(0xC2B2AE3D27D4EB4F)
        word = (word ^ (word >> np.uint64(32)) ^ z) * np.uint64(0x165667B19E3779F9)
        at = np.int64(word >> np.uint64(20)) & (room - 1)
        while table[at] >= 0:
            q = first[table[at]]
            if points[q, 0] == x and points[q, 1] == y and points[q, 2] == z:
                break
            at = (at + 1) & (room - 1)
        if table[at] < 0:
            table[at], first[count] = count, p
            count += 1
        same[p] = table[at]
    return first[:count], same


def _near(points: Floats, weld: float) -> tuple[Integers, Integers] | None:
    """Return the first of each set of points nearer than `weld`, and the set of each; None where all are apart."""
    low, high = box_of(points)
    size = float(linear.norm(high - low))
    # points that are near each other follow each other closely along any direction, apart from rounding
    along = linear.matmul(points - low, ALONG)
    order = np.argsort(along, kind="stable")
    close = np.diff(along[order]) <= weld * size + 1e-15 * size
    some = order[np.append(close, False) | np.append(False, close)]
    pairs = load("scipy.spatial").cKDTree(points[some]).query_pairs(weld * size, output_type="ndarray")
    if not len(pairs):
        return None
    label = components(len(points), some[pairs[:, 0]], some[pairs[:, 1]])
    first = np.unique(label, return_index=True)[1]
    order = np.argsort(first, kind="stable")
    place = np.empty(len(first), dtype=np.int64)
    place[order] = np.arange(len(first))
    return first[order], place[label]


def _examined(vertices: Floats, faces: Integers, *, whole: bool) -> tuple[Diagnosis, Floats, Integers]:
    """Diagnose a mesh of finite coordinates, merged or, where only that bounds one solid, as it is; return the mesh."""
    points, triangles = merged(vertices, faces)
    found = _examine(points, triangles, whole=whole)
    if found.non_manifold_edges and not found.open_edges:
        corners, given = without_unused(vertices + 0.0, faces)
        as_given = _examine(corners, given, whole=False) if len(corners) > len(points) else found
        if as_given.ok:
            return as_given, corners, given
    return found, points, triangles


def _examine(vertices: Floats, faces: Integers, *, whole: bool) -> Diagnosis:
    """Diagnose a merged mesh of finite coordinates; where it is not to be whole, no further than to wrong edges.

    Triangles that lie on each other, as in damaged files, take time with the square of their number.
    """
    if not len(faces):
        return Diagnosis(faces=0)
    low, high = box_of(vertices)
    size = float(linear.norm(high - low)) or 1.0
    points = (vertices - (low + high) / 2) / size
    edges = numbered_edges(faces, len(points))
    open_edges, crowded, unlike = (int(n) for n in edge_faults(faces, len(points), edges))
    if not whole and (open_edges or crowded):
        return Diagnosis(faces=len(faces), open_edges=open_edges, non_manifold_edges=crowded)
    shells: dict[str, int] = {}
    if not (open_edges or crowded):
        shells = {"bodies": count_apart(points, faces)} if unlike else shell_counts(points, faces, edges)
    return Diagnosis(
        faces=len(faces),
        open_edges=open_edges,
        non_manifold_edges=crowded,
        flipped_faces=count_flipped(faces, len(points)) if unlike else 0,
        self_intersections=count_crossings(points, faces),
        **shells,
    )
