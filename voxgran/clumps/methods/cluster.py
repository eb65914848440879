"""Equal spheres at the points of a lattice that lie inside the solid.

Points count as inside at a least depth, a share `inside` of the radius: 0 keeps all centers inside, 1 whole spheres. A
simple cubic lattice leaves no hole inside the solid if its spacing is at most 2 / sqrt(3) radii, a hexagonal one if it
is at most sqrt(2) radii.

If the radius is omitted, many radii and positions of the lattice are tried. Of each, clusters of the deepest points are
formed, of at most as many as asked; points of one depth, as those that are alike by symmetry, are in a cluster all or
none. The cluster of largest intersection over union with the solid is taken, counted in voxels: it may have fewer
spheres than asked, but at least eight, two along each axis, if so many are asked. The radii do not depend on the
number, so that all clusters of fewer spheres are among those of more, and from eight on the intersection over union
never falls with the number. If the radius is given, all points inside are kept.

The surface of such a cluster is rough: between neighbouring spheres of radius r at spacing s there are grooves of depth
r - sqrt(r^2 - s^2 / 4), that is 0.08 r at the spacing 0.8 r. Roughness is that depth. It falls with the radius and, for
a given number of spheres too, with the spacing.

With `merge`, groups of small spheres are replaced by larger ones. A sphere about a lattice point, larger than the small
ones by the depth of the point beyond the least one, replaces all spheres that it contains wholly, if these are two or
more; the sphere that replaces most comes first. The union only grows. The radius is then chosen so that the merged
cluster has the number asked; spheres in excess that matter least are dropped.

References
----------
Sajjadi & Khalili 2015, Generating, Reproducing and Packaging of Random Volumes for Discrete Element Analysis of
Discontinuous Materials, section 4-2; Lu & McDowell 2007; Wang et al. 2007 (merged spheres)
"""

import math
from typing import Literal

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.config import parameter, parameter_class
from voxgran._base.errors import InputError
from voxgran._base.kernels import kernel
from voxgran._base.lazy import load
from voxgran._base.seeds import stream
from voxgran.clumps.method import Body, ClumpMethod, Fitted
from voxgran.clumps.sphere_sets import INSIDE, SURFACE, Points, SphereSet, without_cheapest
from voxgran.lattice.grid import Grid
from voxgran.lattice.packed import PackedMask
from voxgran.voxels.closed_form import spheres_bits
from voxgran.voxels.occupy import occupied

#: spacing of the lattices in radii, at which spheres overlap and leave no hole
SPACING = {"cubic": 0.8, "hexagonal": 1.1}
#: volume of a lattice point at unit spacing
CELL = {"cubic": 1.0, "hexagonal": math.sqrt(0.5)}
#: number of nearest neighbours of a point
NEIGHBOURS = {"cubic": 6, "hexagonal": 12}
#: number of positions of the lattice that are tried
PLACES = 12
#: fewest spheres of a cluster, where so many are asked: one sphere is often nearer to a round solid, and no cluster
FEWEST = 8
#: smallest and largest radius, relative to that of spheres whose cells have the volume of the solid
SMALL, LARGE = 0.45, 1.1
#: largest radius of a cluster of equal spheres, in equivalent diameters, ratio of one to the next smaller one, and
#: factors on those of the best clusters
WIDEST, RATIO, FINER = 0.6, 1.07, (0.98, 0.99, 1.01, 1.02, 1.03, 1.04)
#: voxels along the equivalent diameter by which clusters are judged
JUDGED = 48
#: least depth of a center
SHALLOW = 1e-3
#: smallest radius
LEAST = 0.01
#: least depths of a center in radii that are tried if it is not given
INSIDE_TRIED = (0.4, 0.6, 0.8)
#: smallest radius of spheres to be merged, as SMALL, and bisections to their number
THIN, HALVINGS = 0.25, 8
#: number of points on the surface, and voxels along the equivalent diameter, by which merged spheres are dropped
JUDGING, RESOLUTION = 2_000, 20.0
#: no spheres
NONE = SphereSet(np.zeros((0, 3)), np.zeros(0))


@parameter_class
class Cluster:
    """Parameters of equal spheres on a lattice.

    Parameters
    ----------
    radius
        radius of the spheres, of the small ones with merge; if omitted, it follows from the number asked.
    lattice
        cubic: simple cubic; hexagonal: hexagonal close packing, which has thicker layers.
    spacing
        distance of neighbours; if omitted 0.8 (cubic) or 1.1 (hexagonal), which leaves no hole.
    inside
        least depth of a center: 0 if only centers must lie inside, 1 if whole spheres; if omitted, the best one.
    merge
        whether groups of small spheres are replaced by larger ones.

    Raises
    ------
    InputError
        If a value is out of range.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.fit_clump(vg.shapes.box(lengths=(1, 1, 1)), method=vg.clumps.Cluster(), max_spheres=50).count
    27
    """

    radius: float | None = parameter(None, unit="equivalent diameters", at_least=LEAST, at_most=0.5)
    lattice: Literal["cubic", "hexagonal"] = parameter("cubic")
    spacing: float | None = parameter(None, unit="radii", at_least=0.2, at_most=4.0)
    inside: float | None = parameter(None, unit="radii", at_least=0.0, at_most=1.0)
    merge: bool = parameter(False)


def fit(body: Body, count: int, settings: Cluster, seed: int) -> Fitted:
    """Return the spheres of the best lattice."""
    cluster = _Cluster(body, count, settings, seed)
    if settings.radius is not None:
        best = cluster.of_radius(settings.radius)
    else:
        best = cluster.merged_to_count() if settings.merge else cluster.of_count()
    reason = "larger spheres replace all others" if settings.merge else "no further point of the lattice lies inside"
    enough = len(best) == count or (len(best) and settings.radius is None and not settings.merge)
    return Fitted(best.centers, best.radii, "" if enough else reason)


registration = ClumpMethod(
    summary="equal spheres at the points of a lattice, or groups of them merged to larger ones",
    source="Sajjadi & Khalili 2015, Generating, Reproducing and Packaging of Random Volumes for Discrete Element "
    "Analysis of Discontinuous Materials; Lu & McDowell 2007; Wang et al. 2007 (merged spheres)",
    parameters=Cluster,
    fit=fit,
)


class _Cluster:
    """Clusters of one solid."""

    def __init__(self, body: Body, count: int, settings: Cluster, seed: int) -> None:
        self.body, self.count, self.settings, self.seed = body, count, settings, seed
        self.spacing = settings.spacing or SPACING[settings.lattice]
        self.insides = INSIDE_TRIED if settings.inside is None else (settings.inside,)
        # the first lattice has a point at the centroid, the second the middle of a cell
        self.shifts = stream(seed, "lattice").random((PLACES, 3))
        self.shifts[:2] = [[0.0], [0.5]]
        self.nominal = (body.volume / count / CELL[settings.lattice]) ** (1 / 3) / self.spacing
        # spheres protrude by at most their radius
        largest = LARGE * self.nominal if settings.merge else max(FINER) * WIDEST
        reach = body.shape.bounding_radius + (settings.radius or largest)
        self.grid = Grid.around(-reach * np.ones(3), reach * np.ones(3), 1.0 / JUDGED)
        self.solid = occupied(body.shape, self.grid)
        self.mask = self.solid.unpacked()
        self.voxels = int(self.mask.sum())

    def error(self, found: SphereSet) -> float:
        """Return the number of voxels in only one of the solid and the spheres, relative to the sum of both."""
        union = spheres_bits(found.centers, found.radii, self.grid, cover="center")
        apart = PackedMask(union.words ^ self.solid.words, self.grid.shape).count()
        return apart / (union.count() + self.solid.count())

    def of_count(self) -> SphereSet:
        """Return the best cluster of at most the number asked."""
        # of each number of spheres the least error, and the radius and the position of the lattice that have it
        best = np.full((self.count + 1, 3), [np.inf, 0.0, 0.0])
        radius = WIDEST
        while radius > LEAST and (radius > SMALL * self.nominal or not np.isfinite(best).all(axis=1).any()):
            for k in range(PLACES):
                self._try(radius, k, best)
            radius /= RATIO
        # clusters that are better than all of fewer spheres, so that those of more are refined near the same ones
        records = best[1:][best[1:, 0] < np.minimum.accumulate(best[:-1, 0])]
        for radius, k in dict.fromkeys((float(row[1]), int(row[2])) for row in records):
            for factor in FINER:
                self._try(factor * radius, k, best)
        many = int(best[:, 0].argmin())
        if not np.isfinite(best[many, 0]):
            return NONE
        points, order = self._deepest(float(best[many, 1]), int(best[many, 2]))[:2]
        return SphereSet(points[np.sort(order[:many])], np.full(many, best[many, 1]))

    def of_radius(self, radius: float) -> SphereSet:
        """Return the best cluster of a radius.

        Raises
        ------
        InputError
            If all have more spheres than asked.
        """
        tried = []
        for shift in self.shifts:
            points, depth = self._lattice(radius, shift)
            tried += [self._spheres(points, depth, radius, inside) for inside in self.insides]
        few = [found for found in tried if 0 < len(found) <= self.count]
        least = min(len(found) for found in tried)
        if few:
            return min(few, key=self.error)
        if least > self.count:
            raise InputError(
                f"radius is {radius:g} equivalent diameters: {least} spheres stand for {self.body.name!r}, and "
                f"{self.count} are asked; raise max_spheres to {least}, or the radius"
            )
        return NONE

    def merged_to_count(self) -> SphereSet:
        """Return the best of the clusters of merged spheres, of the number asked."""
        tried = [self._merged_with(inside) for inside in self.insides]
        full = [found for found in tried if len(found) == self.count] or [found for found in tried if len(found)]
        return min(full, key=self.error) if full else NONE

    def _deepest(self, radius: float, k: int) -> tuple[Floats, Integers, Floats]:
        """Return the points of a lattice, their order from the deepest on, and their depths in it, rounded."""
        points, depth = self._lattice(radius, self.shifts[k])
        depth = np.round(depth, 9)
        order = np.argsort(-depth, kind="stable")
        return points, order, depth[order]

    def _try(self, radius: float, k: int, best: Floats) -> None:
        """Note where clusters of the deepest points of a lattice have the least error of those of their numbers."""
        points, order, depth = self._deepest(radius, k)
        ends = np.flatnonzero(np.diff(depth, append=-np.inf)) + 1
        ends = ends[(ends >= (FEWEST if self.count >= FEWEST else 1)) & (ends <= self.count)]
        ends = ends[depth[ends - 1] >= (self.settings.inside or 0.0) * radius]
        if not len(ends):
            return
        added, covered = np.zeros((int(ends[-1]), 2), dtype=np.int64), np.zeros_like(self.mask)
        lower, step = np.array(self.grid.origin), self.grid.voxel_size
        _cover(points[order[: len(added)]], radius, lower, step, self.mask, covered, added)
        within, beyond = np.cumsum(added, axis=0)[ends - 1].T
        error = 1.0 - within / (self.voxels + beyond)
        better = error < best[ends, 0]
        best[ends[better]] = np.column_stack([error, np.full_like(error, radius), np.full_like(error, k)])[better]

    def _merged_with(self, inside: float) -> SphereSet:
        """Return merged spheres of the largest radius that gives the number asked."""
        low, high = THIN * self.nominal, LARGE * self.nominal
        best = NONE
        for _ in range(HALVINGS):
            radius = math.sqrt(low * high)
            found = self._spheres(*self._lattice(radius, self.shifts[0]), radius, inside)
            if len(found) < self.count:
                high = radius
            else:
                low = radius
            if len(found) >= self.count or len(best) < self.count:
                best = found
        if len(best) <= self.count:
            return best
        surface = self.body.surface(JUDGING, self.seed)
        deep = self.body.lattice_points(RESOLUTION, self.seed)[0]
        points = Points(surface.points, np.full(JUDGING, SURFACE), np.full(JUDGING, surface.area))
        points = points.joined(deep, INSIDE, np.full(len(deep), 1.0 / RESOLUTION**2))
        return without_cheapest(points, best, len(best) - self.count)

    def _lattice(self, radius: float, shift: Floats) -> tuple[Floats, Floats]:
        """Return the points of a lattice inside the solid, and their depths.

        A point whose neighbours are all deeper counts as as deep as the shallowest of them; without it they would
        enclose a hole.
        """
        step = self.spacing * radius
        points = _lattice_points(self.settings.lattice, step, shift, self.body.shape.bounds)
        points = points[self.mask[tuple(self.grid.indices(points).T)]]
        depth = self.body.depth(points)
        points, depth = points[depth > SHALLOW], depth[depth > SHALLOW]
        if not len(points):
            return points, depth
        number = NEIGHBOURS[self.settings.lattice]
        near = load("scipy.spatial").cKDTree(points).query(points, number + 1, distance_upper_bound=1.01 * step)[1]
        return points, np.maximum(depth, np.append(depth, 0.0)[near[:, 1:]].min(axis=1))

    def _spheres(self, points: Floats, depth: Floats, radius: float, inside: float) -> SphereSet:
        """Return the spheres at the points that are deep enough, merged if so asked."""
        reach = (depth - inside * radius)[depth >= inside * radius]
        places = points[depth >= inside * radius]
        small = SphereSet(places, np.full(len(places), radius))
        if not self.settings.merge or not len(small):
            return small
        left, chosen = np.ones(len(small), dtype=np.bool_), np.full(len(small), -1)
        # the cells of the points reached fit in a sphere larger by a cell
        cells = (reach / (self.spacing * radius) + 1.0) ** 3 / CELL[self.settings.lattice]
        _choose_merged(places, reach * (1.0 + 1e-9), np.floor(4.2 * cells), left, chosen)
        large = chosen[chosen >= 0]
        return SphereSet(places[large], radius + reach[large]).joined(small.taken(left))


def _lattice_points(lattice: str, spacing: float, shift: Floats, bounds: Floats) -> Floats:
    """Return the points of a lattice in a box, (n, 3)."""
    layer = spacing * (np.ones(3) if lattice == "cubic" else np.array([1.0, math.sqrt(3 / 4), math.sqrt(2 / 3)]))
    low = np.floor(bounds[0] / layer).astype(int) - 2
    high = np.ceil(bounds[1] / layer).astype(int) + 2
    i, j, k = np.meshgrid(*(np.arange(a, b) for a, b in zip(low, high, strict=True)), indexing="ij")
    index = np.stack([i, j, k], axis=-1).reshape(-1, 3).astype(np.float64)
    if lattice == "hexagonal":
        odd = index[:, 2] % 2
        index[:, 0] += 0.5 * ((index[:, 1] + odd) % 2)
        index[:, 1] += odd / 3
    points = (index + shift) * layer
    return points[((points > bounds[0]) & (points < bounds[1])).all(axis=1)]


@kernel
def _cover(centers, radius, lower, step, solid, covered, added):  # type: ignore[no-untyped-def]
    """Count the voxels of a solid, and those beyond it, that each sphere covers and none before it does."""
    for s in range(len(centers)):
        low, high = np.empty(3, np.int64), np.empty(3, np.int64)
        for a in range(3):
            low[a] = max(0, math.floor((centers[s, a] - radius - lower[a]) / step))
            high[a] = min(solid.shape[a], math.floor((centers[s, a] + radius - lower[a]) / step) + 1)
        for i in range(low[0], high[0]):
            x = lower[0] + (i + 0.5) * step - centers[s, 0]
            for j in range(low[1], high[1]):
                y = lower[1] + (j + 0.5) * step - centers[s, 1]
                for k in range(low[2], high[2]):
                    z = lower[2] + (k + 0.5) * step - centers[s, 2]
                    if x * x + y * y + z * z <= radius * radius and not covered[i, j, k]:
                        covered[i, j, k] = True
                        added[s, 0 if solid[i, j, k] else 1] += 1


@kernel
def _contained(places, center, reach, left, clear):  # type: ignore[no-untyped-def]
    """Count the points left within reach of a center, and remove them if `clear`."""
    count = 0
    for p in range(len(places)):
        if left[p]:
            dx, dy, dz = places[p, 0] - center[0], places[p, 1] - center[1], places[p, 2] - center[2]
            if dx * dx + dy * dy + dz * dz <= reach * reach:
                count += 1
                if clear:
                    left[p] = False
    return count


@kernel
def _choose_merged(places, reach, bound, left, chosen):  # type: ignore[no-untyped-def]
    """Fill `chosen` with the points that reach most of those left, and remove those, until none reaches two."""
    for n in range(len(chosen)):
        best = bound.argmax()
        gain = _contained(places, places[best], reach[best], left, False)
        while gain < bound[best]:
            bound[best] = gain
            best = bound.argmax()
            gain = _contained(places, places[best], reach[best], left, False)
        if gain < 2:
            break
        _contained(places, places[best], reach[best], left, True)
        bound[best] = 0.0
        chosen[n] = best
