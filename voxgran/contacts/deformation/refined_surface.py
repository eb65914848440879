"""The surface of one grain near its contacts, before it gives way: fine there, with vertices where it enters others.

Control points are the vertices of the tessellation. Edges near a contact are cut until they are as short as asked,
with lengths that grow with the distance from it, and new vertices are put on the true surface. Then the edges that
lead into another grain are cut where they enter it, so that the rim of each contact is made of vertices.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.errors import TooLargeError
from voxgran._base.lazy import load
from voxgran.contacts.search import Inner
from voxgran.geometry.triangles import areas_of
from voxgran.shapes.finer import cut_edges, edges_of

#: how much longer edges may be at a distance from a contact, as a ratio to it
GRADING = 0.3
#: rounds of cutting at the most; each halves what is too long
ROUNDS = 60
#: edges are not cut below this part of a diameter in search of a contact
SMALLEST = 1e-8
#: where bodies may touch in several places, edges near the other one are at most this part of a diameter
SEARCHED = 1 / 64
#: vertices of one grain at the most
MOST_VERTICES = 2_000_000
#: steps of false position at the most
STEPS = 60
#: farther outside of partners than this part of a diameter the depth in the grain itself does not matter
NEAR = 0.1
#: distances of this part of a diameter are taken as 0
EXACT = 1e-14
#: levels of vertices up to this part of a diameter are taken as on the rim
ROUNDED = 1e-12


@dataclass(frozen=True, slots=True)
class Partner:
    """Another grain near this one; all is relative to the centroid of this one."""

    contact: int  # number of the contact with it; -1 where it is only near
    side: int  # 1 where the contact leads from this grain to it, -1 where it leads back
    inner: Inner  # distance of points to its surface, positive inside
    center: Floats  # its centroid, (3,)
    radius: float  # radius of its bounding sphere
    share: float  # share of the depth by which this grain is deformed: 0 where it is rigid, 1 where the other one is
    deepest: Floats  # where the overlap is deepest, (3,)
    single: bool  # whether both are convex, so that they overlap in one place only

    def depth(self, points: Floats) -> Floats:
        """Return how deep (n, 3) points lie in it; below 0 outside, where far away only a bound."""
        told = self.radius - linear.norm(points - self.center, axis=1)
        near = told > 0
        told[near] = self.inner(points[near])
        return told


@dataclass(frozen=True, slots=True)
class SoftGrain:
    """A grain that may be deformed; all is relative to its centroid, in the unit of lengths."""

    number: int  # index of the grain
    vertices: Floats  # its tessellation, (n, 3)
    faces: Integers  # triangles, (m, 3)
    inner: Inner  # distance of points to its own surface, positive inside
    onto: Callable[[Floats], Floats]  # projects points of triangles onto the true surface
    diameter: float  # equivalent diameter
    touching: tuple[Partner, ...]  # grains that it overlaps
    near: tuple[Partner, ...]  # those and other grains that its bulges may come near
    room: Callable[[Floats], Floats]  # distance of points to the nearest wall

    def excess(self, points: Floats) -> Floats:
        """Return by how much (n, 3) points lie beyond the common surface with each partner, (n, partners).

        It is 0 where the depths in both grains are as the shares; of a rigid grain 0 is the surface of the partner.
        """
        told = np.stack([partner.depth(points) for partner in self.touching], axis=1)
        share = np.array([partner.share for partner in self.touching])
        soft = (share > 0) & (share < 1)
        if soft.any():
            near = (told[:, soft] > -NEAR * self.diameter).any(axis=1)
            own = np.zeros(len(points))
            own[near] = self.inner(points[near])
            told[:, soft] = share[soft] * told[:, soft] - (1 - share[soft]) * own[:, None]
        return told


@dataclass(frozen=True, slots=True)
class FineSurface:
    """A surface that is fine near contacts."""

    vertices: Floats  # on the original surface of the grain, (n, 3)
    faces: Integers  # triangles, (m, 3)
    excess: Floats  # as of :meth:`SoftGrain.excess`, (n, partners)
    level: Floats  # largest excess, (n,): above 0 within a partner, 0 on the rim, below 0 where the surface is free


def fine_surface(grain: SoftGrain, spacing: float) -> FineSurface:
    """Return the surface of a grain with at least one partner, with vertices dense near contacts and along their rims.

    `spacing` are the longest edges at a contact, in radii of the disk that has its area.

    Raises
    ------
    TooLargeError
        If this needs more than two million vertices.
    """
    vertices, faces, excess = grain.vertices, grain.faces, grain.excess(grain.vertices)
    for _ in range(ROUNDS):
        ends, index = edges_of(faces)
        long = _too_long(grain, vertices, faces, excess, ends, spacing)
        if not long.any():
            break
        if len(vertices) + int(long.sum()) > MOST_VERTICES:
            raise TooLargeError(
                f"spacing is {spacing:g}: it needs more than {MOST_VERTICES} vertices on one grain; make it larger"
            )
        more = grain.onto(vertices[ends[long]].mean(axis=1))
        vertices, faces = _with_vertices(vertices, faces, index, long, more)
        excess = np.concatenate([excess, grain.excess(more)])
    return _with_rims(grain, vertices, faces, excess)


def _patch_radius(vertices: Floats, faces: Integers, inside: Booleans) -> float:
    """Return the radius of the disk that has the area of the triangles inside; those across the rim count in part."""
    part = inside[faces].mean(axis=1)
    used = part > 0
    areas = areas_of(vertices[faces[used]])
    return float(np.sqrt((areas * part[used]).sum() / np.pi))


def _too_long(
    grain: SoftGrain, vertices: Floats, faces: Integers, excess: Floats, ends: Integers, spacing: float
) -> Booleans:
    """Tell which edges are longer than they may be at their distance from the contacts.

    Limits change along a way by less than lengths do, so that no part of an edge is too long where the edge is not.
    """
    middle = vertices[ends].mean(axis=1)
    length = linear.norm(vertices[ends[:, 0]] - vertices[ends[:, 1]], axis=1)
    long = np.zeros(len(ends), dtype=np.bool_)
    for k, partner in enumerate(grain.touching):
        inside = excess[:, k] > 0
        if inside.any():
            wanted = spacing * _patch_radius(vertices, faces, inside)
            patch = vertices[inside]
            center = patch.mean(axis=0)
            around = linear.norm(patch - center, axis=1).max()
            nearest = linear.norm(middle - center, axis=1) - around
            rest = np.flatnonzero((length > np.maximum(wanted, GRADING * nearest)) & ~long)
            away, _ = load("scipy.spatial").cKDTree(patch).query(middle[rest])
            long[rest[length[rest] > GRADING * away]] = True
        else:
            holds = linear.norm(middle - partner.deepest, axis=1) < length
            long |= holds & (length > SMALLEST * grain.diameter)
        if not partner.single:
            around = linear.norm(middle - partner.center, axis=1) - partner.radius < length / 2
            rest = np.flatnonzero(around & (length > SEARCHED * grain.diameter) & ~long)
            long[rest[partner.inner(middle[rest]) > -length[rest] / 2]] = True
    return long


def _with_vertices(
    vertices: Floats, faces: Integers, index: Integers, chosen: Booleans, more: Floats
) -> tuple[Floats, Integers]:
    """Put one more vertex on each chosen edge."""
    new = np.full(len(chosen), -1)
    new[chosen] = len(vertices) + np.arange(len(more))
    vertices = np.concatenate([vertices, more])
    return vertices, cut_edges(vertices, faces, index, new)


def _with_rims(grain: SoftGrain, vertices: Floats, faces: Integers, excess: Floats) -> FineSurface:
    """Cut the edges that lead into partners where they enter."""
    level = excess.max(axis=1)
    level[np.abs(level) < ROUNDED * grain.diameter] = 0.0
    ends, index = edges_of(faces)
    crosses = level[ends[:, 0]] * level[ends[:, 1]] < 0
    inward = np.where((level[ends[:, 0]] > 0)[:, None], ends, ends[:, ::-1])[crosses]
    start, way = vertices[inward[:, 0]], vertices[inward[:, 1]] - vertices[inward[:, 0]]

    def place(share: Floats) -> Floats:
        return grain.onto(start + share[:, None] * way)

    def beyond(share: Floats) -> Floats:
        return np.asarray(grain.excess(place(share)).max(axis=1))

    rim = place(crossing(beyond, np.ones(len(start)), EXACT * grain.diameter))
    vertices, faces = _with_vertices(vertices, faces, index, crosses, rim)
    level = np.concatenate([level, np.zeros(len(rim))])
    return FineSurface(vertices, faces, np.concatenate([excess, grain.excess(rim)]), level)


def crossing(value: Callable[[Floats], Floats], high: Floats, exact: float) -> Floats:
    """Return where a value that is above 0 at 0 and not at `high` passes through 0, (n,); values up to `exact` are 0.

    By false position; where one end stays, its value is halved (Dowell & Jarratt 1971, doi:10.1007/BF01934364).
    """
    low, place = np.zeros(len(high)), high
    if not len(high):
        return place
    at_low, at_high, before = value(low), value(high), np.zeros(len(high), dtype=np.bool_)
    for step in range(STEPS):
        place = (at_low * high - at_high * low) / np.where(at_low > at_high, at_low - at_high, 1.0)
        told = value(place)
        still = told > 0
        if np.abs(told).max() <= exact:
            break
        again = (still == before) & (step > 0)
        at_high = np.where(still, np.where(again, at_high / 2, at_high), told)
        at_low = np.where(still, told, np.where(again, at_low / 2, at_low))
        low, high, before = np.where(still, place, low), np.where(still, high, place), still
    return place
