"""Points at which grains touch, or nearly touch, each other and walls."""

from dataclasses import dataclass

import numpy as np

from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.stopping import stop_if_asked
from voxgran.contacts.assembly import Assembly
from voxgran.contacts.broad import Pairs, grain_pairs
from voxgran.contacts.find import gaps_of_pairs, is_closed_surface, surface_trees
from voxgran.contacts.surface_pairs import surface_gaps
from voxgran.containers.model import boundary_of
from voxgran.shapes.mesh import Mesh

#: largest number of corners of a mesh that are tested; for a mesh of more, which is round, one point suffices
CORNERS = 512
#: corners of a grain that may touch a flat wall at once
WALL_CORNERS = 8


@dataclass(frozen=True, slots=True)
class ContactPoints:
    """Contact points of grains; the partner at a wall is -1."""

    i: Integers  # (m,): the grains
    j: Integers  # (m,)
    normal: Floats  # (m, 3): from i to j, or to the wall
    gap: Floats  # (m,): distance of the surfaces
    arm_i: Floats  # (m, 3): from the centroids to the point of contact
    arm_j: Floats  # (m, 3)


def find_contact_points(assembly: Assembly, reach: float) -> ContactPoints:
    """Return where grains are within a reach of each other or of walls.

    The nearest points of two surfaces are one contact point; faces and edges touch at several, so that corners near the
    other grain are contact points too.
    """
    pairs = grain_pairs(assembly, reach)
    nearest = _of_pairs(pairs, *gaps_of_pairs(assembly, pairs, reach), reach)
    return joined([nearest, *near_corners(assembly, pairs, reach), near_walls(assembly, reach)])


def near_corners(assembly: Assembly, pairs: Pairs, reach: float) -> list[ContactPoints]:
    """Return where corners of meshes, of the pairs that may touch, are within reach of the surfaces of others."""
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
) -> ContactPoints:
    """Return where corners of one mesh, moved to each partner, are near the surface of another."""
    stop_if_asked()
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
    return ContactPoints(grain[k], partner[k], normal, gap, arm_j + offset[k] - gap[:, None] * normal, arm_j)


def places_of(assembly: Assembly, pairs: Pairs, reach: float) -> ContactPoints:
    """Return where some pairs are nearest, of those that are apart."""
    closed = np.array([is_closed_surface(shape.geometry) for shape in assembly.shapes], dtype=np.bool_)
    surfaces = closed[assembly.shape_id[pairs.i]] & closed[assembly.shape_id[pairs.j]]
    gap, normal, point = np.full(pairs.count, np.inf), np.zeros((pairs.count, 3)), np.zeros((pairs.count, 3))
    if surfaces.any():
        some = pairs.where(surfaces)
        *known, proven = surface_gaps(assembly, some, reach, tree_of=surface_trees(assembly))
        gap[surfaces], normal[surfaces], point[surfaces] = np.where(proven, known[0], np.inf), *known[1:]
    if not surfaces.all():
        gap[~surfaces], normal[~surfaces], point[~surfaces] = gaps_of_pairs(
            assembly, pairs.where(~surfaces), reach, deepest=False
        )
    return _of_pairs(pairs, gap, normal, point, reach)


def _of_pairs(pairs: Pairs, gap: Floats, normal: Floats, point: Floats, reach: float) -> ContactPoints:
    """Return the contact points of the pairs whose surfaces are within reach."""
    k = gap <= reach
    return ContactPoints(pairs.i[k], pairs.j[k], normal[k], gap[k], point[k], (point - pairs.offset)[k])


def near_walls(assembly: Assembly, reach: float) -> ContactPoints:
    """Return where grains are near walls, and near a lid.

    Spheres touch at one place. Of other grains each side of flat walls counts by itself, with the corners that are
    nearest to it; at other containers the point of the tessellation that is nearest.
    """
    sphere = np.array([shape.is_sphere for shape in assembly.shapes], dtype=np.bool_)[assembly.shape_id]
    found, lid = _near_container(assembly, sphere, reach), assembly.lid
    if lid is None:
        return found
    return joined([found, _near_side(assembly, sphere, lid.normal, lid.level - assembly.position @ lid.normal, reach)])


def _near_container(assembly: Assembly, sphere: Booleans, reach: float) -> ContactPoints:
    """Return where grains are near the walls of their container."""
    container = assembly.container
    if boundary_of(container).is_flat:
        lower, upper = container.bounds
        found = []
        for axis in range(assembly.dimension):
            if not container.periodic[axis]:
                height = assembly.position[:, axis]
                for sign, room in ((-1.0, height - lower[axis]), (1.0, upper[axis] - height)):
                    found.append(_near_side(assembly, sphere, sign * np.eye(3)[axis], room, reach))
        return joined([_no_places(), *found])
    room = -container.signed_distance(assembly.position) if assembly.count else np.zeros(0)
    near = np.flatnonzero(room - assembly.bounding_radii <= reach)
    found = [_near_round(assembly, grain, reach, sphere=bool(sphere[grain])) for grain in near.tolist()]
    return joined([_no_places(), *found])


def _near_side(assembly: Assembly, sphere: Booleans, normal: Floats, room: Floats, reach: float) -> ContactPoints:
    """Return where grains are near a flat side, which lies so far from their centroids along a normal."""
    radius = assembly.bounding_radii
    near = room - radius <= reach
    spheres = np.flatnonzero(near & sphere)
    parts = [
        _at_wall(spheres, np.tile(normal, (len(spheres), 1)), (room - radius)[spheres], radius[spheres, None] * normal)
    ]
    for grain in np.flatnonzero(near & ~sphere).tolist():
        stop_if_asked()
        arms = assembly.world_vertices(grain) - assembly.position[grain]
        gaps = room[grain] - arms @ normal
        if len(gaps) > WALL_CORNERS:
            some = np.sort(np.argpartition(gaps, WALL_CORNERS)[:WALL_CORNERS])
            arms, gaps = arms[some], gaps[some]
        kept = gaps <= reach
        many = int(kept.sum())
        parts.append(_at_wall(np.full(many, grain), np.tile(normal, (many, 1)), gaps[kept], arms[kept]))
    return joined(parts)


def _near_round(assembly: Assembly, grain: int, reach: float, *, sphere: bool) -> ContactPoints:
    """Return where a grain is nearest to walls that are not flat."""
    stop_if_asked()
    container, position = assembly.container, assembly.position[grain]
    radius = float(assembly.bounding_radii[grain])
    corners = position[None] if sphere else assembly.world_vertices(grain)
    distance = container.signed_distance(corners)
    far, delta = corners[int(np.argmax(distance))], 1e-6 * radius
    slope = container.signed_distance(far + delta * np.eye(3)) - container.signed_distance(far - delta * np.eye(3))
    length = float(np.linalg.norm(slope))
    gap = -float(distance.max()) - (radius if sphere else 0.0)
    if length == 0.0 or gap > reach:
        return _no_places()
    normal = slope / length
    arm = radius * normal if sphere else far - position
    return _at_wall(np.array([grain]), normal[None], np.array([gap]), arm[None])


def _at_wall(grain: Integers, normal: Floats, gap: Floats, arm: Floats) -> ContactPoints:
    """Return places at walls, which have no partner."""
    return ContactPoints(grain, np.full(len(grain), -1), normal, gap, arm, np.zeros_like(arm))


def _no_places() -> ContactPoints:
    """Return no places."""
    return _at_wall(np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros(0), np.zeros((0, 3)))


def closing_of(contacts: ContactPoints, translation: Floats, rotation: Floats) -> Floats:
    """Return by how much a motion closes the gaps, along their normals."""
    here = translation[contacts.i] + np.cross(rotation[contacts.i], contacts.arm_i)
    there = translation[contacts.j] + np.cross(rotation[contacts.j], contacts.arm_j)
    there[contacts.j < 0] = 0.0
    return np.asarray(((here - there) * contacts.normal).sum(axis=1))


def joined(parts: list[ContactPoints]) -> ContactPoints:
    """Return all places of several lists."""
    names = ("i", "j", "normal", "gap", "arm_i", "arm_j")
    return ContactPoints(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))
