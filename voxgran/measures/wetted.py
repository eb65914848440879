"""Specific surface: of the grains, and of what the pores wet of them, with and without what lies in walls.

A part of a surface is wetted where it lies neither in nor on another grain. What of it lies in a wall, as the faces at
which the border of an image cuts grains, faces no pore either, and is given apart. Surfaces are known in closed form.
What is covered is zero between grains that touch in points, in closed form for unions of spheres, and a sum over small
parts of faces otherwise. Where neighbours share triangles, as those of label images do, a part is a triangle, and the
sum is exact.
"""

from typing import Any, TypeAlias

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.lazy import load
from voxgran.contacts.inside import inner_distance
from voxgran.contacts.model import Contacts
from voxgran.containers.model import periods_of
from voxgran.geometry.triangles import areas_of, normals_of
from voxgran.measures.model import length_unit, variable
from voxgran.measures.window import ON, Estimate, Solids, images
from voxgran.packing.model import Packing
from voxgran.packing.start import free_volume
from voxgran.shapes.describing.body import as_spheres
from voxgran.shapes.mesh import Mesh, Surface
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.sphere_union import exposed_areas

#: least number of parts of the surface of a grain
PARTS = 2000

#: distance, in mean diameters, up to which triangles of two grains are the same: more than rounding parts them
SAME = 1e-9

#: middles (m, 3), normals (m, 3) and areas (m,) of parts of a surface, and the face (m,) that each is of
Parts: TypeAlias = tuple[Floats, Floats, Floats, Integers]
#: a grain, the (3,) centroid of its image, and whether it overlaps the grain that it covers
Partner: TypeAlias = tuple[int, Floats, bool]


def specific_surfaces(packing: Packing, bed: Estimate | None = None) -> dict[str, Any]:
    """Return the variables of the surfaces over the volume of the container, in 2D of outlines over its area.

    With the solid fraction of a bed, they are over the volume of the bed: that of the grains over this fraction.
    """
    unit = length_unit(packing, power=-1)
    kind = "volume" if packing.dimension == 3 else "area"
    texts = {
        "specific_surface": "wetted surface, neither on other grains nor in walls,",
        "specific_surface_with_walls": "wetted surface, with what lies in walls,",
        "grain_specific_surface": "surface of the grains without what lies in walls",
        "grain_specific_surface_with_walls": "surface of the grains",
    }
    if "surfaces" not in packing._found:
        packing._found["surfaces"] = _surfaces(packing)
    room, where = Estimate(free_volume(packing)), "container"
    if bed is not None and bed > 0:
        held = float(packing.volumes.sum())
        room, where = Estimate(held / bed, held * bed.error / bed**2), "bed"

    def error(found: Estimate) -> float:
        """Return the error of a surface over the volume."""
        return (found.error + found / room * room.error) / room

    return {
        name: variable((), found / room, unit, f"{text} over {kind} of the {where}", error=error(found))
        for (name, text), found in zip(texts.items(), packing._found["surfaces"], strict=True)
    }


def _surfaces(packing: Packing) -> tuple[Estimate, Estimate, Estimate, Estimate]:
    """Return the areas of the wetted surface and of that of the grains, each without and with what lies in walls."""
    whole = float(packing.surface_areas.sum())
    diameter = float(packing.diameters.mean()) if packing.count else 0.0
    spheres = Solids(packing).spheres if packing.dimension == 3 else None
    if spheres is not None:
        centers, radii, planes = spheres
        # planes are where spheres overlap, those of one clump too
        wetted = Estimate(_of_union(packing, centers, radii) if len(planes[1]) else whole)
        return wetted, wetted, Estimate(whole), Estimate(whole)
    contacts = packing.contacts(ON * diameter)
    partners, areas, variances = _partners(packing, contacts, ON * diameter), np.zeros(3), np.zeros(3)
    for kind in np.unique(packing.shape_id[list(partners)]):
        parts = _parts_of(packing.shapes[kind])
        for grain in np.flatnonzero(packing.shape_id == kind).tolist():
            if grain in partners:
                found = _covered(packing, grain, partners[grain], parts, ON * diameter)
                areas, variances = areas + found[0], variances + found[1]
    either, on_grains, in_walls = map(Estimate, whole - areas, np.sqrt(variances))
    return either, on_grains, in_walls, Estimate(whole)


def shared_areas(packing: Packing, contacts: Contacts) -> Floats:
    """Return the area (n,) of the triangles that both grains of each contact have, as neighbours of label images do."""
    periods, reach = periods_of(packing.container), SAME * packing.diameters.mean()
    meshes = np.array([isinstance(shape.geometry, Mesh) for shape in packing.shapes], dtype=np.bool_)[packing.shape_id]
    found = np.zeros(contacts.count)
    for k in np.flatnonzero(meshes[contacts.i] & meshes[contacts.j] & (np.abs(contacts.gap) <= reach)).tolist():
        pair = int(contacts.i[k]), int(contacts.j[k])
        mine, theirs = (packing.world_vertices(grain) for grain in pair)
        theirs = theirs + linear.matmul(contacts.image[k], periods)
        low = np.maximum(mine.min(axis=0), theirs.min(axis=0)) - reach
        high = np.minimum(mine.max(axis=0), theirs.max(axis=0)) + reach
        one, two = (_within(packing, *of, low, high) for of in zip(pair, (mine, theirs), strict=True))
        if len(one) and len(two):
            middles = two.mean(axis=1)
            apart, nearest = load("scipy.spatial").cKDTree(middles).query(one.mean(axis=1), distance_upper_bound=reach)
            same = np.flatnonzero(np.isfinite(apart))
            against = linear.einsum("fi,fi->f", normals_of(one[same]), normals_of(two[nearest[same]])) < 0
            found[k] = areas_of(one[same[against]]).sum()
    return found


def _within(packing: Packing, grain: int, vertices: Floats, low: Floats, high: Floats) -> Floats:
    """Return the corners (m, 3, 3) of the triangles of a mesh, with its vertices where it lies, that lie in a box."""
    geometry = packing.shapes[packing.shape_id[grain]].geometry
    assert isinstance(geometry, Mesh)
    inside = np.asarray(((vertices >= low) & (vertices <= high)).all(axis=1))[geometry.corners]
    return vertices[geometry.corners[inside[:, 0] & inside[:, 1] & inside[:, 2]]]


def _of_union(packing: Packing, centers: Floats, radii: Floats) -> float:
    """Return the surface of the union of spheres and their periodic images."""
    around = np.where(packing.container.periodic, 2.0 * float(packing.bounding_radii.max()), np.inf)
    lower, upper = packing.container.bounds
    sphere, shift = images(centers, radii, lower - around, upper + around, packing.container)
    exposed = exposed_areas(centers[sphere] + shift, radii[sphere])
    return float(exposed[(shift == 0.0).all(axis=1)].sum())


def _partners(packing: Packing, contacts: Contacts, reach: float) -> dict[int, list[Partner]]:
    """Return what may cover each grain; nothing for one at a wall, and no entry for one that touches in points only."""
    periods = periods_of(packing.container)
    bent, hollow = (
        np.array([of(shape) for shape in packing.shapes], dtype=np.bool_)[packing.shape_id]
        for of in (_is_bent, lambda shape: shape.is_open)
    )
    outside = packing.container.signed_distance(packing.position) + packing.bounding_radii
    found: dict[int, list[Partner]] = {grain: [] for grain in np.flatnonzero((outside >= -reach) & ~bent).tolist()}
    for k in np.flatnonzero((contacts.gap < -reach) | ~(bent[contacts.i] | bent[contacts.j])):
        i, j, shift = int(contacts.i[k]), int(contacts.j[k]), linear.matmul(contacts.image[k], periods)
        for grain, other, way in ((i, j, shift), (j, i, -shift)):
            if not hollow[other]:
                center = packing.position[other] + way
                found.setdefault(grain, []).append((other, center, bool(contacts.gap[k] < -reach)))
    return found


def _is_bent(shape: Shape) -> bool:
    """Return whether no part of a surface is plane, so that it touches others and walls in points or lines."""
    geometry, kinds = shape.geometry, ("ellipsoid", "spherocylinder")
    return as_spheres(geometry) is not None or (isinstance(geometry, Primitive) and geometry.kind in kinds)


def _parts_of(shape: Shape) -> Parts:
    """Return the parts of the surface of a shape in its frame."""
    geometry = shape.geometry
    if isinstance(geometry, Outline):
        ring = geometry.vertices if geometry.kind == "polygon" else shape.vertices[:, :2]
        ends = np.column_stack([ring, np.zeros(len(ring))])
        corners = np.stack([ends, np.roll(ends, -1, axis=0)], axis=1)
        normals = np.cross(corners[:, 1] - corners[:, 0], (0.0, 0.0, 1.0))
    else:
        corners = shape.vertices[shape.faces]
        normals = normals_of(corners)
    size = linear.norm(normals, axis=1)
    normals = normals / np.maximum(size, 1e-300)[:, None]
    # the area is that of the true surface
    size = size * (shape.surface_area / size.sum())
    share = PARTS * size / size.sum()
    many = np.maximum(np.ceil(share if corners.shape[1] == 2 else np.sqrt(share)), 1).astype(np.int64)
    middles, faces = [], []
    for n in np.unique(many):
        some, weights = np.flatnonzero(many == n), _middles(int(n), corners.shape[1])
        middles.append(linear.einsum("pc,fck->fpk", weights, corners[some]).reshape(-1, 3))
        faces.append(np.repeat(some, len(weights)))
    face = np.concatenate(faces)
    return np.concatenate(middles), normals[face], (size / np.bincount(face))[face], face


def _middles(n: int, corners: int) -> Floats:
    """Return the barycentric coordinates of the middles of the parts of a line or triangle, n of them along an edge."""
    if corners == 2:
        place = (np.arange(n) + 0.5) / n
        return np.column_stack([1.0 - place, place])
    a, b = (index.ravel() for index in np.meshgrid(np.arange(n), np.arange(n), indexing="ij"))
    upright = np.column_stack([a, b])[a + b < n] + 1.0 / 3.0
    turned = np.column_stack([a, b])[a + b < n - 1] + 2.0 / 3.0
    place = np.concatenate([upright, turned]) / n
    return np.column_stack([1.0 - place.sum(axis=1), place])


def _covered(
    packing: Packing, grain: int, partners: list[Partner], parts: Parts, reach: float
) -> tuple[Floats, Floats]:
    """Return what of the surface of a grain is on other grains or in walls, on other grains, and in walls, with the
    variances (3,) of these areas.

    It is where a point that is a little further outwards lies in another grain or beyond a wall.
    """
    middles, normals, areas, face = parts
    scale, turn, container = float(packing.scale[grain]), packing.matrices[grain], packing.container
    points, outwards = linear.matmul(middles * scale, turn.T) + packing.position[grain], linear.matmul(normals, turn.T)
    on_grains, in_walls = np.zeros((2, len(points)), dtype=np.bool_)
    for other, center, deep in partners:
        away = points - center
        near = np.flatnonzero(~on_grains & ((away**2).sum(axis=1) <= (packing.bounding_radii[other] + reach) ** 2))
        on_grains[near] = _holds(packing, other, away[near] + reach * outwards[near], deep, reach)
    if container.signed_distance(packing.position[[grain]])[0] + packing.bounding_radii[grain] >= -reach:
        in_walls = container.signed_distance(points + reach * outwards) >= 0
    factor, whole, many = libm.power(scale, packing.dimension - 1), np.bincount(face, areas), np.bincount(face)
    shares = [np.bincount(face, mask) / many for mask in (on_grains | in_walls, on_grains, in_walls)]
    # the variance is as of random parts of faces that are covered in part
    variances = [float((whole**2 * share * (1.0 - share) / many).sum()) for share in shares]
    return factor * np.array([float(linear.matmul(whole, share)) for share in shares]), factor**2 * np.array(variances)


def _holds(packing: Packing, grain: int, away: Floats, deep: bool, reach: float) -> Booleans:
    """Return whether points (n, 3), from the centroid of a grain, lie in it; unless `deep`, at most at a depth."""
    geometry, scale = packing.shapes[packing.shape_id[grain]].geometry, float(packing.scale[grain])
    body = linear.matmul(away, packing.matrices[grain]) / scale
    if isinstance(geometry, Mesh) and not deep:
        return geometry.tree.nearest(body, reach=1.01 * reach / scale)[0] <= 0.0
    assert not isinstance(geometry, Surface)
    return np.asarray(inner_distance(geometry)(body) >= 0.0)
