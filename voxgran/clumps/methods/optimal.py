"""Spheres whose union differs least from the solid: medial spheres, refined against the surface by least squares.

The integral of the distance between both surfaces over the surface of the solid is, to first order, the volume in which
they differ. It is minimized over all centers and radii. Spheres are added a third at a time, each the medial sphere
that lowers the integral most, and all are refined in between and at the end. Each point of the surface belongs to the
sphere that is nearest, as points belong to planes in a variational approximation of a surface (Cohen-Steiner, Alliez &
Desbrun 2004, doi:10.1145/1186562.1015817); a step is then one small least-squares problem for each sphere. More spheres
than asked are added, and those that matter least removed. Powers of
the distance below 2 are weights that change from step to step. At the end one change of all radii gives the union the
volume of the solid.

For agglomerates that may break, the spheres lie inside the solid, touch each other and do not overlap.

Spheres of free size: each is the largest for which there is room, as in an Apollonian packing. Spheres of equal size:
the points of a hexagonal close packing that lie deep enough inside the solid, each with up to twelve contacts.
"""

import math
from dataclasses import replace
from typing import Literal

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran._base.config import check_bounds, parameter, parameter_class
from voxgran._base.errors import InputError
from voxgran._base.lazy import load
from voxgran._base.seeds import stream
from voxgran.clumps.covering import covering_growth, enclosed_holes
from voxgran.clumps.method import Body, ClumpMethod, Fitted
from voxgran.clumps.sphere_sets import (
    INSIDE,
    OUTSIDE,
    SURFACE,
    Points,
    Rules,
    SphereSet,
    best_inserts,
    refined,
    union_gaps,
    without_cheapest,
)
from voxgran.shapes.spheres import Spheres

#: number of points on the surface while spheres are added; at the end as many a sphere, within the limits
POINTS, POINTS_A_SPHERE, MOST_POINTS = 8_000, 80, 40_000
#: number of medial spheres to choose from, at least, and for each sphere
CANDIDATES, CANDIDATES_A_SPHERE = 1_500, 4
#: voxels along the equivalent diameter that give points inside and outside, and the number of these in surface points
RESOLUTION, SHARE = 20.0, 1 / 3
#: smallest radius, in equivalent diameters
LEAST = 0.02
#: share of spheres that are added at once, steps between, and share of those asked that are added beyond them
GROWTH, STEPS, BEYOND = 0.33, 8, 0.3
#: power of the distances while spheres are added, and at the end; steps at the end
EARLY, LATE, LAST_STEPS = 1.5, 1.0, 60
#: weight of distances by which an inscribed union protrudes, or a bounding one does not cover
ONE_SIDED = 200.0
#: accuracy of the volume after the change of radii, and steps of Newton before the change is enclosed
VOLUME_ERROR, NEWTON = 1e-6, 6
#: rounds in which spheres that left the solid are replaced, or what is open inside is closed with growing weight
ROUNDS, HEAVIER = 4, 10.0


@parameter_class
class Optimal:
    """Parameters of the refined fit.

    Parameters
    ----------
    mode
        balanced: the least error, of the same volume; inscribed: nothing protrudes; bounding: all is covered.
    overlap
        whether spheres may overlap; if false they touch, for breakable agglomerates.
    uniform
        whether all radii are equal.
    min_radius
        smallest radius.
    max_radius
        largest radius; if omitted, there is no limit.
    match_volume
        whether a balanced union gets exactly the volume of the solid, by one change of all radii.

    Raises
    ------
    InputError
        If a value is out of range, the largest radius is not above the smallest, or tangent spheres are to be bounding.

    Examples
    --------
    >>> import voxgran as vg
    >>> clump = vg.fit_clump(vg.shapes.sphere(radius=2.0), method=vg.clumps.Optimal(), max_spheres=1)
    >>> clump.radii.tolist()
    [2.0]
    """

    mode: Literal["balanced", "inscribed", "bounding"] = parameter("balanced")
    overlap: bool = parameter(True)
    uniform: bool = parameter(False)
    min_radius: float = parameter(LEAST, unit="equivalent diameters", at_least=1e-3)
    max_radius: float | None = parameter(None, unit="equivalent diameters", above=0.0)
    match_volume: bool = parameter(True)

    def __post_init__(self) -> None:
        """Check the ranges."""
        check_bounds(self)
        if self.max_radius is not None and self.max_radius <= self.min_radius:
            raise InputError(
                f"max_radius is {self.max_radius:g}: it must be above min_radius, {self.min_radius:g}; raise it, or "
                "set uniform"
            )
        if self.mode == "bounding" and not self.overlap:
            raise InputError("overlap is false in mode 'bounding': spheres without overlap leave gaps; allow overlap")


def fit(body: Body, count: int, settings: Optimal, seed: int) -> Fitted:
    """Return the spheres of the refined fit."""
    if not settings.overlap:
        return tangent_spheres(body, count, settings.min_radius, settings.max_radius, uniform=settings.uniform)
    return _Fit(body, settings, seed).spheres(count)


registration = ClumpMethod(
    summary="medial spheres, refined against the surface: the least difference in volume",
    source="Cohen-Steiner, Alliez & Desbrun 2004, doi:10.1145/1186562.1015817 (partition); Ma, Bae & Choi 2012, "
    "doi:10.1007/s00371-011-0594-7 (medial spheres)",
    parameters=Optimal,
    fit=fit,
)


class _Fit:
    """The refined fit of one solid."""

    def __init__(self, body: Body, settings: Optimal, seed: int) -> None:
        self.body, self.settings, self.seed = body, settings, seed
        most = math.inf if settings.max_radius is None else settings.max_radius
        self.early = Rules(power=EARLY, least=settings.min_radius, most=most, equal=settings.uniform)
        inside, outside = (ONE_SIDED if settings.mode == mode else 1.0 for mode in ("inscribed", "bounding"))
        self.late = replace(self.early, power=LATE, inside=inside, outside=outside)

    def spheres(self, count: int) -> Fitted:
        """Return the spheres, as many as asked unless further ones would not lower the error."""
        points, pool = self._points(POINTS), self._candidates(CANDIDATES + CANDIDATES_A_SPHERE * count)
        if self.settings.uniform:
            found = refined(points, self._even(count), self.early, LAST_STEPS)
        else:
            found = self._grown(points, pool, count)
        wide = min(POINTS_A_SPHERE * count, MOST_POINTS)
        points = self._points(wide) if wide > POINTS else points
        found = refined(points, found, self.late, LAST_STEPS)
        found = self._kept_inside(points, found, pool)
        found = self._closed(points, found)
        radii = self._sized(found)
        reason = "" if len(found) == count else "no further sphere lowers the error"
        matched = self.settings.mode == "balanced" and self.settings.match_volume
        return Fitted(found.centers, radii, reason, found.radii if matched else None)

    def _points(self, count: int) -> Points:
        """Return points on the surface, and the centers of voxels that lie wholly inside or outside."""
        surface = self.body.surface(count, self.seed)
        volume = self.body.volume
        made = Points(surface.points, np.full(count, SURFACE), np.full(count, surface.area / volume))
        for kind, places in zip((INSIDE, OUTSIDE), self.body.lattice_points(RESOLUTION, self.seed), strict=True):
            few = stream(self.seed, "lattice points", kind).permutation(len(places))[: int(SHARE * count)]
            # a voxel counts as one of the faces that bound it
            weight = 0.6 / RESOLUTION**2 / volume * len(places) / max(1, len(few))
            made = made.joined(places[few], kind, np.full(len(few), weight))
        return made

    def _candidates(self, count: int) -> SphereSet:
        """Return medial spheres, those too large replaced by the largest that touch the surface at the same point."""
        surface = self.body.surface(max(POINTS, 2 * count), self.seed)
        chosen = stream(self.seed, "candidates").permutation(len(surface.points))[:count]
        _, radii = self.body.medial_spheres(surface, chosen)
        if math.isfinite(self.early.most):
            radii = np.minimum(radii, self.early.most)
        centers = surface.points[chosen] - surface.normals[chosen] * radii[:, None]
        if math.isfinite(self.early.most):
            # spheres at the surface alone would leave the middle empty
            deep = self.body.lattice_points(RESOLUTION, self.seed)[0]
            centers = np.concatenate([centers, deep])
            radii = np.concatenate([radii, np.minimum(self.body.depth(deep), self.early.most)])
        centers = np.ascontiguousarray(centers)
        inside = self.body.depth(centers) > 0.0
        large = (radii >= self.early.least) & inside
        if not large.any():
            raise InputError(
                f"min_radius is {self.early.least:g} equivalent diameters: no sphere of that radius fits in "
                f"{self.body.name!r}; the largest has {radii[inside].max(initial=0.0):.3g}"
            )
        return SphereSet(centers[large], radii[large])

    def _grown(self, points: Points, pool: SphereSet, count: int) -> SphereSet:
        """Return the spheres after more than asked are added, some at a time, and the least useful ones removed."""
        found, most = SphereSet(np.zeros((0, 3)), np.zeros(0)), count + int(BEYOND * count)
        while len(found) < most:
            added = best_inserts(points, found, pool, min(most - len(found), max(1, int(GROWTH * len(found)))))
            if not len(added):
                break
            found = refined(points, found.joined(added), self.early, STEPS)
        while len(found) > count:
            fewer = min(len(found) - count, max(1, int(GROWTH * BEYOND * count)))
            found = refined(points, without_cheapest(points, found, fewer), self.early, STEPS)
        return found

    def _even(self, count: int) -> SphereSet:
        """Return equal spheres at the centers of parts of equal size, by k-means of the voxels."""
        places = self.body.inner_points(max(RESOLUTION, 3.0 * count ** (1 / 3)), self.seed)
        centers = places[stream(self.seed, "parts").permutation(len(places))[:count]]
        tree = load("scipy.spatial").cKDTree
        for _ in range(LAST_STEPS):
            owner = tree(centers).query(places)[1]
            number = np.maximum(np.bincount(owner, minlength=len(centers)), 1)
            sums = [np.bincount(owner, places[:, axis], len(centers)) for axis in range(3)]
            centers = np.column_stack(sums) / number[:, None]
        radius = (self.body.volume / count * 3 / (4 * math.pi)) ** (1 / 3)
        return SphereSet(centers, np.full(len(centers), np.clip(radius, self.early.least, self.early.most)))

    def _kept_inside(self, points: Points, found: SphereSet, pool: SphereSet) -> SphereSet:
        """Return the spheres, those centered outside the solid replaced by the best medial ones."""
        for last in (False,) * ROUNDS + (True,):
            good = self.body.depth(found.centers) > 0.0
            if good.all():
                break
            kept = found.taken(good)
            found = kept.joined(best_inserts(points, kept, pool, len(found) - len(kept)))
            if not last:
                found = refined(points, found, self.late, STEPS)
        return found

    def _closed(self, points: Points, found: SphereSet) -> SphereSet:
        """Return the spheres after holes that they enclose are closed, as far as possible."""
        weight = float(points.weight.max())
        for _ in range(ROUNDS):
            places = enclosed_holes(self.body, found)
            if not len(places):
                break
            points = points.joined(places, INSIDE, np.full(len(places), weight))
            tried = refined(points, found, self.late, 2 * STEPS)
            if (self.body.depth(tried.centers) <= 0.0).any():
                break
            found, weight = tried, HEAVIER * weight
        return found

    def _sized(self, found: SphereSet) -> Floats:
        """Return the radii that the mode asks for; only bounding ones may exceed the largest."""
        settings, error = self.settings, self.body.shape.tessellation_error
        if settings.mode == "inscribed":
            # spheres may also grow until they meet the surface
            inner = np.minimum(self.body.depth(found.centers) - error, self.early.most)
            return np.full(len(inner), inner.min()) if settings.uniform else inner
        if settings.mode == "bounding":
            return found.radii + covering_growth(self.body, found) + error
        if not settings.match_volume:
            return found.radii
        growth = growth_to_volume(found, self.body.volume, least=self.early.least, most=self.early.most)
        return np.clip(found.radii + growth, self.early.least, self.early.most)


def growth_to_volume(found: SphereSet, volume: float, *, least: float = 1e-6, most: float = math.inf) -> float:
    """Return the length by which all radii grow, within limits, so that the union has a volume, or comes nearest to."""

    def excess(growth: float) -> tuple[float, float]:
        union = Spheres(found.centers, np.clip(found.radii + growth, least, most))
        return union.volume / volume - 1.0, union.surface_area / volume

    growth = 0.0
    for _ in range(NEWTON):
        # the surface is the derivative of the volume, but for radii at a limit
        missed, slope = excess(growth)
        if abs(missed) <= VOLUME_ERROR / 10:
            return growth
        growth -= missed / slope
    low, high = -float(found.radii.max()), 1.0
    if excess(low)[0] >= 0.0:
        return low
    if excess(high)[0] <= 0.0:
        return high
    return float(load("scipy.optimize").brentq(lambda x: excess(x)[0], low, high, xtol=VOLUME_ERROR / 10, rtol=1e-12))


#: voxels along the equivalent diameter at which room is looked for
FINENESS = 40.0
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
    places = body.inner_points(FINENESS, 0)
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
        room = np.minimum(room, linear.norm(places - center, axis=1) - radius)
    return Fitted(centers, radii)


def _widest(
    body: Body, place: Floats, room: float, centers: Floats, radii: Floats, most: float
) -> tuple[Floats, float]:
    """Return center and radius of the sphere with the most room near a place; it touches what bounds the room."""

    def room_at(points: Floats) -> Floats:
        return np.minimum(body.depth(points), union_gaps(points, centers, radii)[0])

    step = 1.0 / FINENESS
    if room >= most and len(radii):
        # slide to the nearest sphere
        nearest = int((linear.norm(centers - place, axis=1) - radii).argmin())
        way = place - centers[nearest]
        moved = centers[nearest] + way * (radii[nearest] + most) / linear.norm(way)
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
        apart = linear.norm(best[:, None] - best, axis=2)
        contacts = (apart < 2.0 * low * (1 + 1e-9)).sum(axis=1)
        best = np.delete(best, np.lexsort((-linear.norm(best, axis=1), contacts))[0], axis=0)
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
