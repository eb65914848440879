"""Spheres inside a solid that touch and do not overlap, for agglomerates that may break.

Spheres of free size: each is the largest for which there is room, as in an Apollonian packing. Spheres of equal size:
the points of a hexagonal close packing that lie deep enough inside the solid, each with up to twelve contacts.
"""

import math

import numpy as np

from voxgran._base.arrays import Floats
from voxgran.clumps.body import Body
from voxgran.clumps.method import Fitted
from voxgran.clumps.sphere_sets import union_gaps

#: voxels along the equivalent diameter at which room is looked for
RESOLUTION = 40.0
#: accuracy of centers and radii, in equivalent diameters: far below the gap up to which spheres are bonded
ACCURACY = 1e-9
#: directions in which more room is looked for
WAYS = np.array([w for w in np.ndindex(3, 3, 3) if w != (1, 1, 1)]) - 1.0
#: halvings of the interval in which the radius of equal spheres lies, and places of their lattice that are tried
HALVINGS, PLACES = 24, 8


def tangent_spheres(body: Body, count: int, least: float, most: float | None, *, uniform: bool) -> Fitted:
    """Return at most so many spheres inside a solid that do not overlap, with radii in [least, most]."""
    largest = math.inf if most is None else most
    return _equal(body, count, least, largest) if uniform else _greedy(body, count, least, largest)


def _greedy(body: Body, count: int, least: float, most: float) -> Fitted:
    """Return spheres of free size, the largest for which there is room first."""
    places = body.inner_points(RESOLUTION, 0)
    depth = body.depth(places)
    room = depth.copy()
    centers, radii = np.zeros((0, 3)), np.zeros(0)
    while len(radii) < count:
        if most < room.max(initial=0.0) and len(radii):
            # a sphere of the largest size has a choice: as near to the others as it can be
            apart = union_gaps(places, centers, radii)[0]
            start = int(np.where(room >= most, apart, np.inf).argmin())
        else:
            start = int(room.argmax())
        center, radius = _widest(body, places[start], room[start], centers, radii, most)
        if radius < least:
            return Fitted(centers, radii, f"no further sphere of radius {least:g} equivalent diameters fits in between")
        centers, radii = np.vstack([centers, center]), np.append(radii, radius)
        room = np.minimum(room, np.linalg.norm(places - center, axis=1) - radius)
    return Fitted(centers, radii)


def _widest(
    body: Body, place: Floats, room: float, centers: Floats, radii: Floats, most: float
) -> tuple[Floats, float]:
    """Return center and radius of the sphere with the most room near a place; it touches what bounds the room."""

    def room_at(points: Floats) -> Floats:
        return np.minimum(body.depth(points), union_gaps(points, centers, radii)[0])

    step = 1.0 / RESOLUTION
    if room >= most and len(radii):
        # slide to the nearest sphere
        nearest = int((np.linalg.norm(centers - place, axis=1) - radii).argmin())
        way = place - centers[nearest]
        moved = centers[nearest] + way * (radii[nearest] + most) / np.linalg.norm(way)
        free = room_at(moved[None])[0] >= most - ACCURACY
        return (moved, most - ACCURACY) if free else (place, most)
    while step > ACCURACY and room < most:
        tries = place + step * WAYS
        found = room_at(tries)
        best = int(found.argmax())
        if found[best] > room:
            place, room = tries[best], float(found[best])
        else:
            step /= 2
    return place, min(room, most)


def _equal(body: Body, count: int, least: float, most: float) -> Fitted:
    """Return equal spheres at points of a hexagonal close packing, as large as their number allows."""
    best = max((_lattice(body, least, place) for place in range(PLACES)), key=len)
    if len(best) < count:
        reason = f"no more equal spheres of radius {least:g} equivalent diameters fit without overlap"
        return Fitted(best, np.full(len(best), least), reason)
    # no inner sphere is larger than that of the same volume
    low, high = least, min(most, 0.5)
    for _ in range(HALVINGS):
        radius = (low + high) / 2
        found = max((_lattice(body, radius, place) for place in range(PLACES)), key=len)
        if len(found) >= count:
            low, best = radius, found
        else:
            high = radius
    while len(best) > count:
        # the sphere with the fewest contacts, and of these the one farthest out
        apart = np.linalg.norm(best[:, None] - best, axis=2)
        contacts = (apart < 2.0 * low * (1 + 1e-9)).sum(axis=1)
        best = np.delete(best, np.lexsort((-np.linalg.norm(best, axis=1), contacts))[0], axis=0)
    return Fitted(best, np.full(len(best), low))


def _lattice(body: Body, radius: float, place: int) -> Floats:
    """Return the points of a hexagonal close packing of spheres that lie inside; `place` shifts the lattice."""
    reach = np.abs(body.shape.bounds).max(axis=0)
    number = np.ceil(reach / radius * np.array([1.0, 1.2, 1.3])).astype(int) + 2
    i, j, k = np.meshgrid(*(np.arange(-n, n + 1) for n in number), indexing="ij")
    x = 2 * i + (j + k) % 2
    y = math.sqrt(3) * (j + (k % 2) / 3)
    z = 2 * math.sqrt(6) / 3 * k
    points = radius * np.stack([x, y, z], axis=-1).reshape(-1, 3)
    points += radius * 2.0 * np.array([place % 2, place // 2 % 2, place // 4]) / 2.0
    points = points[(np.abs(points) <= reach).all(axis=1)]
    return points[body.depth(points) >= radius]
