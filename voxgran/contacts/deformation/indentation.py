"""How one grain gives way: its dents, and the bulges that take up their volume.

Where vertices lie within a partner they move inward along the normal of their contact, until the depths in both grains
are as their shares: that is the common surface. The volume that is lost comes back as bulges around the contacts. A
vertex moves outward by a part of its distance from the surfaces of all other grains, as they were, and from walls.
Where that part is below a half, every place in the bulge of a grain is nearer to this grain than to any other, so that
no two bulges can meet.
"""

from dataclasses import dataclass

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.errors import InputError
from voxgran._base.lazy import load
from voxgran.contacts.deformation.refined_surface import EXACT, FineSurface, SoftGrain, crossing
from voxgran.geometry.triangles import enclosed_volume, normals_of
from voxgran.lattice.label import components
from voxgran.shapes.finer import edges_of, vertex_normals

#: largest part of the free distance that a bulge takes, below a half
STEEPEST = 0.45
#: how far bulges reach at the most, in diameters
FARTHEST = 0.5
#: length over which the directions of bulges are evened out, in radii of the contacts
EVENED = 0.3
#: doublings of a way in search of the common surface
DOUBLINGS = 40


@dataclass(frozen=True, slots=True)
class Patch:
    """The common surface of a grain and one partner."""

    contact: int  # number of the contact
    faces: Integers  # triangles of the common surface, (k,)
    radius: float  # radius of the disk with the area of the surface that lay within the partner


@dataclass(frozen=True, slots=True)
class SoftBody:
    """A deformed grain, relative to its original centroid, in the unit of lengths."""

    vertices: Floats  # displaced vertices, (n, 3)
    faces: Integers  # triangles, (m, 3)
    patches: tuple[Patch, ...]  # one for each contact
    before: float  # volume of the fine surface before the deformation
    after: float  # volume after it
    steepness: float  # part of the free distance that the bulges take
    reach: float  # how far bulges extend from the contacts, in radii of the contacts


def give_way(grain: SoftGrain, surface: FineSurface, spacing: float, reach: float) -> SoftBody:
    """Return a grain with its dents, and its volume kept by bulges.

    `spacing` are the longest edges at a contact and `reach` is how far bulges extend from a contact, in radii of the
    contact; the reach is doubled where there is too little room for the volume.

    Raises
    ------
    InputError
        If partners lie so deep in the grain that there is no common surface, or there is no room for its volume.
    """
    dented = _dented(grain, surface)
    patches = _patches(grain, surface, dented)
    before = enclosed_volume(surface.vertices, surface.faces)
    if enclosed_volume(dented, surface.faces) >= before * (1 - 1e-15):
        return SoftBody(dented, surface.faces, patches, before, enclosed_volume(dented, surface.faces), 0.0, 0.0)
    normals = _even(vertex_normals(surface.vertices, surface.faces), surface.faces, spacing)
    widest = max(patch.radius for patch in patches)
    farthest = FARTHEST * grain.diameter / widest
    reach = min(reach, farthest)
    while True:
        outward = _fading(surface, patches, reach)[:, None] * normals
        swells = outward.any(axis=1)
        outward[swells] *= _free_distance(grain, surface.vertices[swells], reach * widest)[:, None]

        def missing(steepness: float, outward: Floats = outward) -> float:
            return before - enclosed_volume(dented + steepness * outward, surface.faces)

        if missing(STEEPEST) <= 0:
            steepness = load("scipy.optimize").brentq(missing, 0.0, STEEPEST, xtol=1e-300, rtol=1e-15, maxiter=1000)
            bulged = dented + steepness * outward
            return SoftBody(bulged, surface.faces, patches, before, before - missing(steepness), steepness, reach)
        if reach == farthest:
            raise InputError(
                f"grain {grain.number} lost {missing(0.0) / before:.3g} of its volume where it gave way and has no "
                "room to bulge by as much: make the overlap smaller"
            )
        reach = min(2 * reach, farthest)


def _within(surface: FineSurface, k: int) -> Booleans:
    """Tell which triangles of the common surfaces lie within partner k, or in part where there are several."""
    common = (surface.level[surface.faces] >= 0).all(axis=1)
    return np.asarray(common & (surface.excess[surface.faces, k] > 0).any(axis=1))


def _patches(grain: SoftGrain, surface: FineSurface, dented: Floats) -> tuple[Patch, ...]:
    """Return what is common with each partner; of several each takes where it lies deepest in the end."""
    level = surface.level[surface.faces]
    common = np.flatnonzero((level >= 0).all(axis=1) & (level > 0).any(axis=1))
    owner = grain.excess(dented[surface.faces[common]].mean(axis=1)).argmax(axis=1)
    patches = []
    for k, partner in enumerate(grain.touching):
        areas = normals_of(surface.vertices[surface.faces[_within(surface, k)]]) / 2
        radius = float(np.sqrt(linear.norm(areas, axis=1).sum() / np.pi))
        patches.append(Patch(partner.contact, common[owner == k], radius))
    return tuple(patches)


def _dented(grain: SoftGrain, surface: FineSurface) -> Floats:
    """Return the vertices after those within partners have moved to the common surfaces."""
    soft = [partner.share > 0 for partner in grain.touching]
    moving = np.flatnonzero(surface.level > 0)
    if not any(soft) or not len(moving):
        return surface.vertices
    inward = -_directions(grain, surface)[moving]
    start = surface.vertices[moving]

    def beyond(way: Floats) -> Floats:
        return np.asarray(grain.excess(start + way[:, None] * inward).max(axis=1))

    far = 2 * surface.level[moving]
    for _ in range(DOUBLINGS):
        still = beyond(far) > 0
        if not still.any():
            break
        far[still] *= 2
    if far.max() > grain.diameter:
        raise InputError(
            f"grain {grain.number} and another one lie {surface.level.max():.3g} too deep in each other for a common "
            "surface: make the overlap smaller"
        )
    way = crossing(beyond, far, EXACT * grain.diameter)
    dented = surface.vertices.copy()
    dented[moving] = start + way[:, None] * inward
    return dented


def _directions(grain: SoftGrain, surface: FineSurface) -> Floats:
    """Return outward normals of the contacts at the vertices within them, (n, 3), each region its own.

    The vector area of a region depends on its rim only, which both grains have in common. Where a vertex lies within
    several partners, each counts by how deep it lies there.
    """
    count = len(surface.vertices)
    total = np.zeros((count, 3))
    for k in range(len(grain.touching)):
        corners = surface.faces[_within(surface, k)]
        region = components(count, corners.ravel(), np.roll(corners, 1, axis=1).ravel())
        area = np.zeros((count, 3))
        np.add.at(area, region[corners[:, 0]], normals_of(surface.vertices[corners]) / 2)
        normal = area[region] / np.maximum(linear.norm(area[region], axis=1, keepdims=True), 1e-300)
        total += np.maximum(surface.excess[:, k], 0.0)[:, None] * normal
    return total / np.maximum(linear.norm(total, axis=1, keepdims=True), 1e-300)


def _even(normals: Floats, faces: Integers, spacing: float) -> Floats:
    """Return the means of normals over the vertices around: in creases, shorter ones that do not cross."""
    sparse, ends = load("scipy.sparse"), edges_of(faces)[0]
    ends = np.concatenate([ends, ends[:, ::-1], np.repeat(np.arange(len(normals))[:, None], 2, axis=1)])
    joined = sparse.csr_matrix((np.ones(len(ends)), ends.T), shape=(len(normals),) * 2)
    share = 1 / np.asarray(joined.sum(axis=1))
    for _ in range(int(np.ceil((EVENED / spacing) ** 2))):
        normals = share * (joined @ normals)  # bits: sparse
    return normals


def _fading(surface: FineSurface, patches: tuple[Patch, ...], reach: float) -> Floats:
    """Return weights of the bulges at the vertices, (n,): 1 at the rims, 0 beyond their reach and within contacts."""
    rest = np.ones(len(surface.vertices))
    free = np.flatnonzero(surface.level < 0)
    for patch in patches:
        if not len(patch.faces):
            continue
        corners = surface.vertices[np.unique(surface.faces[patch.faces])]
        limit = reach * patch.radius
        away, _ = load("scipy.spatial").cKDTree(corners).query(surface.vertices[free], distance_upper_bound=limit)
        rest[free] *= 1 - (1 - np.minimum(away / limit, 1.0) ** 2) ** 2
    weight = 1 - rest
    weight[surface.level >= 0] = 0.0
    return weight


def _free_distance(grain: SoftGrain, points: Floats, reach: float) -> Floats:
    """Return a smooth bound below the distance of points from other grains and walls that are within reach."""
    told = [grain.room(points)]
    close = [linear.norm(points - other.center, axis=1).min() < other.radius + reach for other in grain.near]
    told += [-other.inner(points) for other, is_close in zip(grain.near, close, strict=True) if is_close]
    with np.errstate(divide="ignore"):
        return np.asarray(1 / sum(1 / np.maximum(distance, 0.0) for distance in told))
