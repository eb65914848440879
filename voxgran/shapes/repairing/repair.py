"""Repair: mend what is certain in a triangle mesh, say what was done, and give up with the reason where it is not.

The steps, in this order: vertices that coincide become one; the second side of a surface that has each face both ways
round goes; a surface that only touches itself, or solids that touch each other, are parted there, which is all; faces
without area, faces that stand twice and patches that hang on edges with too many faces go; faces are wound alike; small
holes are closed; shells without volume go and outer shells are turned outward; faces that cut through each other are
cut out and the hole is closed; shells that overlap are joined by manifold3d; and one body is kept, or all, of which
those that share a face are joined, or several are refused. Every step that did something is one sentence with its
numbers, and the result has passed the same check as any other shape.

Surfaces that touch themselves along edges, as surfaces of voxels do, are parted there by doubled vertices.
"""

import logging
import os
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base import ExplainedAttributes
from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, Integers, as_choice, as_faces, as_number, as_points, box_of
from voxgran._base.calls import explained
from voxgran._base.errors import DirtyMeshError, InputError
from voxgran.geometry.crossing import crossing_faces
from voxgran.lattice.cuberille import fans, with_middles
from voxgran.shapes.formats.mesh_files import read_surface
from voxgran.shapes.model import Shape
from voxgran.shapes.repairing.bodies import outward, shells_of, split, without_flat
from voxgran.shapes.repairing.diagnose import IN_PYTHON, Remedies, bounds_solid, merged
from voxgran.shapes.repairing.holes import closed_loop, extent, hole_loops
from voxgran.shapes.repairing.joining import diagonal, joined, joined_at_faces, say, signed_volume
from voxgran.shapes.repairing.patches import one_sided, without_doubles, without_flaps, without_pinches, wound_alike
from voxgran.shapes.shells import edge_faults, half_edges, shell_labels

log = logging.getLogger(__name__)

#: vertices nearer than this many diagonals of the bounding box become one
WELD = 1e-7
#: rings of faces around a crossing that are cut out at the most
MOST_RINGS = 5

#: widest hole that is closed where nothing is said, in diagonals of the bounding box
LARGEST_HOLE = 0.25
BODIES = ("refuse", "largest", "all")


@dataclass(frozen=True, slots=True, kw_only=True)
class Repair(ExplainedAttributes):
    """What came of a repair.

    Attributes
    ----------
    shapes : tuple of Shape
        Closed solids, the largest first; more than one only where all bodies were asked for.
    sentences : tuple of str
        What was done, in order; empty where nothing was wrong.
    volume_before : float
        What the faces enclosed once they were wound alike, each hole closed by a cone to the centroid of its shell.
    volume : float
        Volume of all shapes together.
    """

    shapes: tuple[Shape, ...]
    sentences: tuple[str, ...]
    volume_before: float
    volume: float

    @property
    def shape(self) -> Shape:
        """The largest solid."""
        return self.shapes[0]

    @property
    def volume_change(self) -> float:
        """Relative change of the volume."""
        return self.volume / self.volume_before - 1 if self.volume_before else float("inf")


@explained(hint="repair(vertices, faces)")
def repair(
    vertices: "ArrayLike | Any",
    faces: "ArrayLike | None" = None,
    *,
    max_hole: float = LARGEST_HOLE,
    bodies: str = "refuse",
    name: str = "mesh",
    unit: str | None = None,
) -> Repair:
    """Make closed solids of a triangle mesh that is almost one.

    Parameters
    ----------
    vertices : (n, 3) array_like of float, path-like, or an object with `vertices` and `faces`
        Corner points, in the unit of lengths, or a mesh file as :func:`voxgran.load_shape` reads it. A shape is closed
        as it is and comes back unchanged.
    faces : (m, 3) array_like of int, optional
        Triangles; left out where the first argument is an object that has them.
    max_hole : float
        How wide a hole may be to be closed, in diagonals of the bounding box.
    bodies : {"refuse", "largest", "all"}
        What becomes of a mesh that holds several solids. Of all, those that share a part of a face, up to the rounding
        of files to single precision, are joined into one; those that touch along an edge or at a corner stay apart.
    name : str
        What reports call the shape; several get a number each.
    unit : str, optional
        Unit of its lengths.

    Returns
    -------
    Repair
        Closed shapes and what was done.

    Raises
    ------
    InputError
        If an array has the wrong shape, an index is out of range, a coordinate is not finite, there are no faces, or
        a parameter is out of range.
    MissingFileError
        If there is no such file.
    FileFormatError
        If the file is of no known format, or damaged.
    DirtyMeshError
        If the mesh cannot be mended with certainty; the message names the reason.

    Examples
    --------
    >>> import voxgran as vg
    >>> cube = vg.make_shape("box", lengths=(1, 1, 1))
    >>> mended = vg.repair(cube.vertices, cube.faces[1:], max_hole=1.0)
    >>> mended.sentences
    ('closed 1 holes with 1 faces, the widest 0.82 of the size',)
    >>> round(mended.shape.volume, 12)
    1.0
    """
    source: Any = vertices
    as_choice(bodies, "bodies", BODIES)
    as_number(max_hole, "max_hole", at_least=0.0)
    if isinstance(source, Shape) and not source.is_open:
        return Repair(shapes=(source,), sentences=(), volume_before=source.volume, volume=source.volume)
    if isinstance(source, str | os.PathLike):
        source, faces = read_surface(source)
    if faces is None:
        if not hasattr(source, "vertices") or not hasattr(source, "faces"):
            raise InputError(f"faces is None and {type(source).__name__} has none: give vertices and faces, or a shape")
        source, faces = source.vertices, source.faces
    return repaired(source, faces, max_hole=max_hole, bodies=bodies, name=name, unit=unit)


def repaired(
    vertices: "ArrayLike",
    faces: "ArrayLike",
    *,
    name: str,
    unit: str | None = None,
    max_hole: float = LARGEST_HOLE,
    bodies: str = "refuse",
    remedies: Remedies = IN_PYTHON,
) -> Repair:
    """Make closed solids of arrays, as :func:`repair` does, with the remedies of a caller in the messages.

    Raises
    ------
    InputError
        If an array or a parameter breaks a rule.
    DirtyMeshError
        If the mesh cannot be mended with certainty.
    """
    as_choice(bodies, "bodies", BODIES)
    limit = as_number(max_hole, "max_hole", at_least=0.0)
    given = as_points(vertices, "vertices")
    triangles = as_faces(faces, len(given))
    if not len(triangles):
        raise InputError(f"{name} has 0 faces: a solid needs a closed surface; check the file")
    if bounds_solid(given, triangles):
        whole = Shape.from_mesh(given, triangles, name=name, unit=unit)
        return Repair(shapes=(whole,), sentences=(), volume_before=whole.volume, volume=whole.volume)
    done: list[str] = []
    used = len(np.unique(triangles))
    corners, triangles = merged(given, triangles, weld=WELD)
    say(done, used - len(corners), "merged {} vertices that coincide")
    single, second = one_sided(triangles, len(corners))
    # sheets that hang beside a solid are left out with both sides
    if second == len(single) or not edge_faults(single, len(corners))[0]:
        triangles = single
        say(done, second, "left out {} faces, the second side of a surface with two")
    touching = int(edge_faults(triangles, len(corners))[1])
    apart = parted(corners, triangles) if touching else None
    rules = _Rules(name, limit, remedies)
    if apart is not None and all(bounds_solid(*solid) for solid in split(*apart)):
        say(done, touching, "parted the surface at {} edges along which it touches itself")
        before, surface = _enclosed(*apart), apart
    else:
        triangles = _cleared(corners, triangles, done)
        before, surface = _enclosed(corners, triangles), _mended(corners, triangles, rules, done)
    solids = _chosen(surface, bodies, rules, done)
    names = [name] if len(solids) == 1 else [f"{name}_{k}" for k in range(len(solids))]
    shapes = tuple(Shape.from_mesh(*solid, name=one, unit=unit) for solid, one in zip(solids, names, strict=True))
    for sentence in done:
        log.info("%s: %s", name, sentence)
    volume = sum(shape.volume for shape in shapes)
    return Repair(shapes=shapes, sentences=tuple(done), volume_before=before, volume=volume)


@dataclass(frozen=True, slots=True)
class _Rules:
    """Name of the mesh, the widest hole that is closed, in diagonals, and what the reader of a message can do."""

    name: str
    max_hole: float
    remedies: Remedies


def _mended(points: Floats, faces: Integers, rules: _Rules, done: list[str]) -> tuple[Floats, Integers]:
    """Return a closed surface of faces that are wound alike; say what was done."""
    corners, triangles = points, faces
    if len(triangles):
        corners, triangles = _closed(points, faces, rules, done)
        triangles, flat = without_flat(corners, triangles)
        say(done, flat, "left out {} shells that enclose nothing")
    if not len(triangles):
        raise DirtyMeshError(f"{rules.name} encloses no volume: a grain must be a solid; check the file")
    triangles, turned = outward(corners, triangles)
    say(done, turned, "turned {} shells inside out, so that outer faces point outward")
    corners, triangles = _uncrossed(corners, triangles, rules, done)
    return joined(corners, triangles, done)


def _cleared(points: Floats, faces: Integers, done: list[str]) -> Integers:
    """Leave out faces that are no part of the surface of a solid, and wind the others alike."""
    line = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    say(done, int(line.sum()), "left out {} faces without area")
    faces, doubles, empty = without_doubles(faces[~line], len(points))
    say(done, doubles, "left out {} faces that stand twice")
    say(done, empty, "left out {} faces that lie on their own reverse")
    faces, patches, hanging = without_flaps(points, faces)
    say(done, patches, f"left out {{}} patches with {hanging} faces that hang on edges with more than two faces")
    faces, pinched = without_pinches(points, faces)
    say(done, pinched, "cut out {} faces at edges with more than two faces")
    faces, turned = wound_alike(faces, len(points))
    say(done, turned, "turned over {} faces that were wound against their neighbours")
    return faces


def _closed(points: Floats, faces: Integers, rules: _Rules, done: list[str]) -> tuple[Floats, Integers]:
    """Close the holes."""
    size = diagonal(points)
    loops = hole_loops(faces, len(points))
    wide = np.array([extent(points, loop) for loop in loops]) / size
    if len(wide) and wide.max() > rules.max_hole:
        raise DirtyMeshError(
            f"{rules.name} has {len(wide)} holes, the widest {wide.max():.3g} of its size: holes are closed up to "
            f"{rules.max_hole:g}; {rules.remedies.of_opening(rules.remedies.hole)}"
        )
    before = len(faces)
    for loop in loops:
        added, triangles = closed_loop(points, faces, loop)
        points, faces = np.concatenate([points, added]), np.concatenate([faces, triangles])
    widest = f", the widest {wide.max():.2g} of the size" if len(wide) else ""
    say(done, len(loops), f"closed {{}} holes with {len(faces) - before} faces{widest}")
    open_edges, crowded, unlike = edge_faults(faces, len(points)).tolist()
    if open_edges or crowded or unlike:
        raise DirtyMeshError(
            f"{rules.name} still has {open_edges} open edges and {crowded} edges without exactly two faces: what "
            "belongs to the solid there is not certain; mend it by hand"
        )
    return points, faces


def _uncrossed(points: Floats, faces: Integers, rules: _Rules, done: list[str]) -> tuple[Floats, Integers]:
    """Cut out faces of one shell that cut through each other, with ever more around them, and close the hole."""
    crossing = _self_crossing(points, faces)
    cut, rings = 0, 0
    while crossing.any() and rings <= MOST_RINGS:
        out = _grown(faces, crossing, len(points), rings)
        cut, rings = cut + int(out.sum()), rings + 1
        silent: list[str] = []
        left = _cleared(points, faces[~out], silent)
        points, faces = _closed(points, left, rules, silent)
        faces, _ = outward(points, without_flat(points, faces)[0])
        crossing = _self_crossing(points, faces)
    if crossing.any():
        raise DirtyMeshError(
            f"{rules.name} has {int(crossing.sum())} faces that cut through others of the same shell after {cut} were "
            "cut out: what is inside is not certain there; mend it by hand"
        )
    say(done, cut, "cut out {} faces at places where the surface cut through itself, and closed it again")
    return points, faces


def _self_crossing(points: Floats, faces: Integers) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Tell which faces are cut through by another one of their own shell."""
    crossing = crossing_faces(points, faces)
    if crossing.any():
        label = shells_of(points, faces).label
        for shell in np.unique(label[crossing]):
            own = np.flatnonzero(label == shell)
            crossing[own] = crossing_faces(points, faces[own])
    return crossing


def _grown(faces: Integers, chosen: Any, vertex_count: int, rings: int) -> Any:
    """Return chosen faces with so many rings of neighbours."""
    for _ in range(rings):
        touched = np.zeros(vertex_count, dtype=np.bool_)
        touched[faces[chosen]] = True
        chosen = touched[faces].any(axis=1)
    return chosen


def _chosen(
    mesh: tuple[Floats, Integers], bodies: str, rules: _Rules, done: list[str]
) -> list[tuple[Floats, Integers]]:
    """Return the solids that were asked for."""
    solids = split(*mesh)
    if len(solids) > 1 and bodies == "refuse":
        raise DirtyMeshError(
            f"{rules.name} has {len(solids)} separate bodies: a grain must be one solid; {rules.remedies.choose}"
        )
    if len(solids) > 1 and bodies == "largest":
        volumes = [signed_volume(vertices[faces]) for vertices, faces in solids]
        share = 100 * (1 - volumes[0] / sum(volumes))
        done.append(f"kept the largest of {len(solids)} bodies and left out {share:.2g} % of the volume")
        return solids[:1]
    return joined_at_faces(solids, done)


def _enclosed(points: Floats, faces: Integers) -> float:
    """Return the volume of all shells, open ones closed by cones to their centroids; of inner ones as they point."""
    label = shell_labels(points, faces)
    total, parts = 0.0, [points[faces[label == k]] for k in range(int(label.max(initial=-1)) + 1)]
    signed = [signed_volume(part) for part in parts]
    low, high = np.reshape([box_of(part.reshape(-1, 3)) for part in parts], (-1, 2, 3)).swapaxes(0, 1)
    for k, volume in enumerate(signed):
        around = [t for t in range(len(parts)) if t != k and (low[t] < low[k]).all() and (high[t] > high[k]).all()]
        total += volume * np.sign(signed[around[0]]) if around else abs(volume)
    return float(total)


#: angles that differ by less are one, in radians
ALIKE = 1e-9


def parted(points: Floats, faces: Integers) -> tuple[Floats, Integers] | None:
    """Return a closed surface with the vertices doubled where more than two faces share an edge; None if unclear.

    Around such an edge, the faces that bound one wedge of the solid stay together. An edge gets a vertex in its middle
    for each of its wedges, so that no two edges have the same ends; no vertex is moved.
    """
    points, faces = with_middles(points, faces, np.zeros(len(faces), dtype=np.int64))
    start, end, edge, uses = half_edges(faces, len(points))
    if (uses % 2).any() or (np.bincount(edge, weights=np.sign(end - start)) != 0).any() or (start == end).any():
        return None
    angle, crowded = np.zeros(len(edge)), np.flatnonzero(uses[edge] > 2)
    opposite = faces[crowded // 3, (crowded % 3 + 2) % 3]
    low, high = (f(start, end)[crowded] for f in (np.minimum, np.maximum))
    angle[crowded] = _angles(points[high] - points[low], points[opposite] - points[low])
    # of two faces that lie on each other, those of solids that touch there, the one that closes a solid comes first
    place = np.rint(angle / ALIKE).astype(np.int64) % round(2 * np.pi / ALIKE)
    order = np.lexsort((start > end, place, edge))
    # the solid lies between a face that goes along the edge downward and the next one, which goes upward
    first = np.searchsorted(edge[order], np.arange(len(uses)))
    down = start[order] > end[order]
    place = np.arange(len(order)) - first[edge[order]]
    following = first[edge[order]] + (place + 1) % uses[edge[order]]
    if (down == down[following]).any():
        return None
    vertex = fans(faces, order[down], order[following[down]])
    original = np.zeros(int(vertex.max()) + 1, dtype=np.int64)
    original[vertex] = faces.ravel()
    return points[original], vertex.reshape(-1, 3)


def _angles(along: Floats, away: Floats) -> Floats:
    """Return the angles of vectors (n, 3) about axes (n, 3), from a zero that depends on the axis only."""
    length = linear.norm(along, axis=1, keepdims=True)
    # two vertices may lie at one place
    along = along / np.where(length > 0.0, length, 1.0)
    first = np.cross(along, np.eye(3)[np.abs(along).argmin(axis=1)])
    second = np.cross(along, first)
    return np.asarray(libm.arctan2(linear.einsum("ni,ni->n", away, second), linear.einsum("ni,ni->n", away, first)))
