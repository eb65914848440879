"""Where grains touch each other and walls, or nearly do: the contacts that settling keeps open."""

from dataclasses import dataclass

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran.contacts.assembly import Assembly
from voxgran.contacts.broad import Pairs, grain_pairs
from voxgran.contacts.find import gaps_of_pairs, is_closed_surface, surface_trees
from voxgran.contacts.surface_pairs import surface_gaps
from voxgran.containers.box import Box
from voxgran.containers.rectangle import Rectangle
from voxgran.shapes.mesh import Mesh

#: corners of a mesh up to which they are looked at; a mesh of more is so round that one place does
CORNERS = 512
#: corners of a grain that may touch a flat wall at once
WALL_CORNERS = 8


@dataclass(frozen=True, slots=True)
class Touching:
    """Contacts and near walls of grains; a wall has the partner -1.

    Attributes
    ----------
    i, j : (m,) ndarray of int
        The grains.
    normal : (m, 3) ndarray of float
        From i to j, or to the wall.
    gap : (m,) ndarray of float
        Distance of the surfaces.
    arm_i, arm_j : (m, 3) ndarray of float
        From the centroids to the point of contact.
    """

    i: Integers
    j: Integers
    normal: Floats
    gap: Floats
    arm_i: Floats
    arm_j: Floats


def find_touching(assembly: Assembly, reach: float) -> Touching:
    """Return where grains are within a reach of each other or of walls.

    Where surfaces are nearest is one place; faces and edges touch at several, so that corners near the other grain are
    places too.
    """
    pairs = grain_pairs(assembly, reach)
    gap, normal, point = gaps_of_pairs(assembly, pairs, reach)
    kept = gap <= reach
    nearest = Touching(pairs.i[kept], pairs.j[kept], normal[kept], gap[kept], point[kept], (point - pairs.offset)[kept])
    return joined([nearest, *near_corners(assembly, pairs, reach), near_walls(assembly, reach)])


def near_corners(assembly: Assembly, pairs: Pairs, reach: float) -> list[Touching]:
    """Return where corners of meshes are near the surfaces of others.

    Parameters
    ----------
    assembly : Assembly
        The grains.
    pairs : Pairs
        Which of them may touch.
    reach : float
        How far to look, in the unit of lengths.
    """
    meshes = [shape.geometry if isinstance(shape.geometry, Mesh) else None for shape in assembly.shapes]
    rows = []
    for there, grain, partner in ((True, pairs.i, pairs.j), (False, pairs.j, pairs.i)):
        of, to = assembly.shape_id[grain], assembly.shape_id[partner]
        for a, b in np.unique(np.column_stack([of, to]), axis=0):
            face, corner = meshes[a], meshes[b]
            if face is None or corner is None or len(corner.vertices) > CORNERS:
                continue
            some = np.flatnonzero((of == a) & (to == b))
            offset = pairs.offset[some] if there else -pairs.offset[some]
            rows.append(_corners_near(assembly, face, corner, grain[some], partner[some], offset, reach))
    return rows


def _corners_near(
    assembly: Assembly, face: Mesh, corner: Mesh, grain: Integers, partner: Integers, offset: Floats, reach: float
) -> Touching:
    """Return where corners of one mesh, moved to each partner, are near the surface of another."""
    turn, scale = assembly.matrices, assembly.scale
    arm = np.einsum("kij,vj->kvi", turn[partner], corner.vertices) * scale[partner, None, None]
    place = np.einsum("kji,kvj->kvi", turn[grain], arm + offset[:, None]) / scale[grain, None, None]
    far = (reach / scale[grain])[:, None, None]
    low, high = face.tree.low[0], face.tree.high[0]
    k, v = np.nonzero(((place > low - far) & (place < high + far)).all(axis=2))
    points = place[k, v]
    distance, nearest, _ = face.tree.nearest(points, reach=float(far.max()))
    gap = distance * scale[grain[k]]
    kept = (gap > 0) & (gap <= reach)
    k, v, gap = k[kept], v[kept], gap[kept]
    normal = np.einsum("kij,kj->ki", turn[grain[k]], (points - nearest)[kept]) * (scale[grain[k]] / gap)[:, None]
    arm_j = arm[k, v]
    return Touching(grain[k], partner[k], normal, gap, arm_j + offset[k] - gap[:, None] * normal, arm_j)


def places_of(assembly: Assembly, pairs: Pairs, reach: float) -> Touching:
    """Return where some pairs are nearest, of those that are apart."""
    closed = np.array([is_closed_surface(shape.geometry) for shape in assembly.shapes], dtype=np.bool_)
    surfaces = closed[assembly.shape_id[pairs.i]] & closed[assembly.shape_id[pairs.j]]
    gap, normal, point = np.full(pairs.count, np.inf), np.zeros((pairs.count, 3)), np.zeros((pairs.count, 3))
    if surfaces.any():
        some = pairs.where(surfaces)
        *known, proven = surface_gaps(assembly, some, reach, tree_of=surface_trees(assembly))
        gap[surfaces], normal[surfaces], point[surfaces] = np.where(proven, known[0], np.inf), *known[1:]
    if not surfaces.all():
        gap[~surfaces], normal[~surfaces], point[~surfaces] = gaps_of_pairs(assembly, pairs.where(~surfaces), reach)
    kept = gap <= reach
    return Touching(pairs.i[kept], pairs.j[kept], normal[kept], gap[kept], point[kept], (point - pairs.offset)[kept])


def near_walls(assembly: Assembly, reach: float) -> Touching:
    """Return where grains are near walls.

    Of flat walls each side counts by itself, with the corners that are nearest to it; of other containers the point of
    the tessellation that is nearest.
    """
    container = assembly.container
    rows: list[tuple[int, Floats, float, Floats]] = []
    lower, upper = container.bounds
    plane = isinstance(container, Box | Rectangle)
    for grain in range(assembly.count):
        position, radius = assembly.position[grain], float(assembly.bounding_radii[grain])
        if plane:
            sides = [
                (axis, sign)
                for axis in range(assembly.dimension)
                if not container.periodic[axis]
                for sign, room in ((-1.0, position[axis] - lower[axis]), (1.0, upper[axis] - position[axis]))
                if room - radius <= reach
            ]
            if not sides:
                continue
            corners = assembly.world_vertices(grain)
            for axis, sign in sides:
                wall = upper[axis] if sign > 0 else lower[axis]
                room = sign * (wall - corners[:, axis])
                some = np.argsort(room)[:WALL_CORNERS]
                rows.extend((grain, sign * np.eye(3)[axis], room[k], corners[k] - position) for k in some)
        elif -float(container.signed_distance(position[None])[0]) - radius <= reach:
            corners = assembly.world_vertices(grain)
            distance = container.signed_distance(corners)
            far, delta = corners[int(np.argmax(distance))], 1e-6 * radius
            slope = container.signed_distance(far + delta * np.eye(3)) - container.signed_distance(
                far - delta * np.eye(3)
            )
            length = float(np.linalg.norm(slope))
            if length > 0:
                rows.append((grain, slope / length, -float(distance.max()), far - position))
    rows = [row for row in rows if row[2] <= reach]
    if not rows:
        nothing, none = np.zeros(0, dtype=np.int64), np.zeros((0, 3))
        return Touching(nothing, nothing, none, np.zeros(0), none, none)
    grains, normals, gaps, arms = (np.array(column) for column in zip(*rows, strict=True))
    return Touching(grains, np.full(len(grains), -1), normals, gaps, arms, np.zeros_like(arms))


def closing_of(touching: Touching, slide: Floats, spin: Floats) -> Floats:
    """Return by how much a motion closes the gaps, along their normals."""
    here = slide[touching.i] + np.cross(spin[touching.i], touching.arm_i)
    there = slide[touching.j] + np.cross(spin[touching.j], touching.arm_j)
    there[touching.j < 0] = 0.0
    return np.asarray(((here - there) * touching.normal).sum(axis=1))


def joined(parts: list[Touching]) -> Touching:
    """Return all places of several lists."""
    names = ("i", "j", "normal", "gap", "arm_i", "arm_j")
    return Touching(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))
