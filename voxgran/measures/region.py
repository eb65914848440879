"""Regions of a container at a given distance from the walls and below a height, and the solid volume in them.

In boxes and rectangles a region is a box, and the solid volume is that of :mod:`voxgran.measures.window`. Spheres in a
cylinder are cut by slices. All other cases, in two dimensions all disks and polygons as containers, are sampled: each
grain is represented by random points of equal weight in fine voxels of its shape, and the standard error is given.

The volume of spheres inside an upright cylinder is integrated over slices across its axis. A slice of the sphere and a
slice of the cylinder are disks, whose common area is a closed form. Over the height it is smooth but for half-integer
powers at the ends of the sphere and where the two circles touch; between these heights the substitution ``sin`` makes
it analytic, and Gauss-Legendre quadrature converges exponentially.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.seeds import stream
from voxgran.containers.gravity import main_axis
from voxgran.containers.model import boundary_of
from voxgran.geometry.halfspaces import cut_spheres
from voxgran.measures.window import Estimate, Solids
from voxgran.packing.model import Packing
from voxgran.packing.start import around_fixed, standing_in
from voxgran.voxels.occupy import voxelize

#: share of the solid volume below the height of the region
HELD = 0.85
#: points for all grains together, for one grain, and for the container
POINTS, MOST_POINTS, CONTAINER_POINTS = 60_000, 1000, 60_000
#: voxels of a shape in which the points of its grains lie: they are the smaller the sharper its surface
VOXELS = 30_000
#: distance outside of a face, relative to its coordinate, up to which a centroid lies in it
ON_FACE = 1e-12
#: volume without fixed grains
NOTHING = Estimate(0.0)


class Regions:
    """Regions of a packing, by their distance from the walls."""

    def __init__(self, packing: Packing) -> None:
        self.packing = around_fixed(packing)
        self.solids = Solids(self.packing)
        standing = standing_in(packing)
        self.standing = None if standing is None else Regions(standing)

    @cached_property
    def limits(self) -> Floats:
        """Lowest and highest coordinates (2, 3) allowed by the height, infinite on other sides, found once."""
        if "limits" not in self.packing._found:
            self.packing._found["limits"] = self._limits()
        found: Floats = self.packing._found["limits"]
        return found

    def _limits(self) -> Floats:
        """Return the lowest and highest coordinates that the height allows."""
        limits = np.array([np.full(3, -np.inf), np.full(3, np.inf)])
        gravity = gravity_of(self.packing)
        if gravity is not None and self.packing.count:
            axis, sign = gravity
            limits[1 if sign < 0 else 0, axis] = held_height(self.solids, axis, sign)
        return limits

    @cached_property
    def samples(self) -> "Samples":
        """Sample points of the grains and of the container."""
        return Samples.of(self.packing)

    @property
    def has_walls(self) -> bool:
        """Whether a side of the container is not periodic."""
        return not all(self.packing.container.periodic[: self.packing.dimension])

    def at(self, inset: float) -> "BoxRegion | CylinderRegion | SampledRegion":
        """Return the part that lies at least `inset` from each wall and below the height, between fixed grains."""
        region = self._at(inset)
        if self.standing is None:
            return region
        if isinstance(region, SampledRegion):
            return replace(region, standing=self.standing.samples)
        return replace(region, taken=region.solid(self.standing.solids))

    def _at(self, inset: float) -> "BoxRegion | CylinderRegion | SampledRegion":
        """Return the part that lies at least `inset` from each wall and below the height."""
        container, d = self.packing.container, self.packing.dimension
        boundary = boundary_of(container)
        if (wall := boundary.cylinder) and d == 3 and self.solids.spheres is not None:
            base = max(float(container.bounds[0, 2]) + inset, float(self.limits[0, 2]))
            top = min(float(container.bounds[1, 2]) - inset, float(self.limits[1, 2]))
            return CylinderRegion(wall.center, max(0.0, wall.radius - inset), base, max(base, top))
        if not boundary.is_flat:
            return SampledRegion(self.samples, inset, self.limits)
        walls = ~np.array(container.periodic[:d])
        lower = np.maximum(container.bounds[0, :d] + inset * walls, self.limits[0, :d])
        upper = np.minimum(container.bounds[1, :d] - inset * walls, self.limits[1, :d])
        return BoxRegion(lower, np.maximum(lower, upper), walls)


@dataclass(frozen=True, eq=False)
class BoxRegion:
    """A box along the axes."""

    lower: Floats
    upper: Floats
    walls: Booleans
    taken: Estimate = NOTHING  # volume of fixed grains in it

    @property
    def volume(self) -> Estimate:
        """Volume without that of fixed grains."""
        return Estimate(float(np.prod(self.upper - self.lower)) - self.taken, self.taken.error)

    def grains(self, packing: Packing) -> Booleans:
        """Return the mask of the grains with their centroids in the box; periodic axes do not count."""
        if self.volume <= 0:
            return np.zeros(packing.count, dtype=np.bool_)
        p = packing.position[:, : len(self.lower)]
        return np.asarray((_between(p, self.lower, self.upper) | ~self.walls).all(axis=1))

    def solid(self, solids: Solids) -> Estimate:
        """Return the volume of the grains inside."""
        return solids.volume(self.lower, self.upper)


@dataclass(frozen=True, eq=False)
class CylinderRegion:
    """An upright cylinder within a cylinder, for spheres."""

    center: tuple[float, float, float]
    radius: float
    lower: float
    upper: float
    taken: Estimate = NOTHING  # volume of fixed grains in it

    @property
    def volume(self) -> Estimate:
        """Volume without that of fixed grains."""
        return Estimate(math.pi * self.radius**2 * (self.upper - self.lower) - self.taken, self.taken.error)

    def grains(self, packing: Packing) -> Booleans:
        """Return the mask of the grains with their centroids in the region."""
        p = packing.position - np.array([*self.center[:2], 0.0])
        return _between(p[:, 2], self.lower, self.upper) & _between(np.hypot(p[:, 0], p[:, 1]), -math.inf, self.radius)

    def solid(self, solids: Solids) -> Estimate:
        """Return the volume of the spheres inside.

        The overlapping volume is known for a whole sphere; for a cut sphere it is taken in proportion to the volume,
        and counts as the error.
        """
        if solids.spheres is None:
            return Estimate(math.nan)
        centers, radii, planes = solids.spheres
        moved = centers - np.array([*self.center[:2], 0.0])
        volumes, errors = cut_spheres_by_cylinder(moved, radii, radius=self.radius, lower=self.lower, upper=self.upper)
        if not len(planes[1]):
            return Estimate(float(volumes.sum()), float(errors.sum()))
        full = 4 / 3 * math.pi * libm.power(radii, 3)
        open_box = np.full(3, -np.inf), np.full(3, np.inf)
        twice = full - cut_spheres(centers, radii, lower=open_box[0], upper=open_box[1], planes=planes)
        share = volumes / full
        cut = (share > 0) & (share < 1 - 1e-12)
        return Estimate(float((volumes - share * twice).sum()), float(errors.sum() + twice[cut].sum()))


@dataclass(frozen=True, eq=False)
class Samples:
    """Points of equal weight in each grain and in the container, with their distances from the walls."""

    points: Floats  # (m, 3) points in the grains
    depths: Floats  # (m,) their distances inside the walls
    grain: Integers  # (m,) grain of each point
    volumes: Floats  # (n,) volumes of the grains
    around: Floats  # (k, 3) points in the bounds of the container
    around_depths: Floats  # (k,) their distances inside the walls
    span: float  # volume of the bounds (area in 2D)

    @classmethod
    def of(cls, packing: Packing) -> "Samples":
        """Sample the grains and the container of a packing."""
        d = packing.dimension
        each = int(np.clip(POINTS // max(packing.count, 1), 8, MOST_POINTS))
        points, grain = [np.zeros((0, 3))], [np.zeros(0, np.int64)]
        for k in np.unique(packing.shape_id):
            shape, mine = packing.shapes[k], np.flatnonzero(packing.shape_id == k)
            if shape.is_open:
                continue
            voxels = voxelize(shape, voxel_size=(shape.volume / VOXELS) ** (1 / d))
            body = voxels.grid.coordinates(np.argwhere(voxels.mask))
            draws = stream(0, "samples", int(k)).random((len(mine), each, 4))
            # one voxel of each of as many equal parts of their list, slices of the grain
            chosen = ((np.arange(each) + draws[:, :, 3]) * (len(body) / each)).astype(np.int64)
            # each point has a random position in its voxel, so that no face of a region is aligned with the lattice
            jitter = (draws[:, :, :3] - 0.5) * voxels.voxel_size
            jitter[:, :, d:] = 0.0
            world = linear.einsum("gij,gpj->gpi", packing.matrices[mine], body[chosen] + jitter)
            world *= packing.scale[mine, None, None]
            points.append((world + packing.position[mine, None]).reshape(-1, 3))
            grain.append(np.repeat(mine, each))
        inside = np.concatenate(points)
        low, high = packing.container.bounds
        span = float(np.prod((high - low)[:d]))
        counts = _cells((high - low)[:d])
        counts = np.append(counts, np.ones(3 - d, dtype=int))
        axes = [low[a] + (np.arange(n) + 0.5) * (high[a] - low[a]) / n for a, n in enumerate(counts)]
        around = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        around += (stream(0, "container samples").random(around.shape) - 0.5) * (high - low) / counts
        depths = (-packing.container.signed_distance(p) for p in (inside, around))
        return cls(inside, next(depths), np.concatenate(grain), packing.volumes, around, next(depths), span)


def _cells(lengths: Floats) -> Integers:
    """Return into how many parts the lengths of a container are divided, so that there are about as many equal cells as
    points: a length shorter than half a cell is one part, and the others are divided as if it were not there.
    """
    whole = np.ones(len(lengths), dtype=np.bool_)
    while True:
        step = (float(np.prod(lengths[whole])) / CONTAINER_POINTS) ** (1 / int(whole.sum()))
        if not (short := whole & (lengths < 0.5 * step)).any():
            return np.where(whole, np.maximum(np.round(lengths / step), 1), 1).astype(np.int64)
        whole &= ~short


@dataclass(frozen=True, eq=False)
class SampledRegion:
    """A region sampled by points: the part at distances from `inset` to `until` from the walls."""

    samples: Samples
    inset: float
    limits: Floats
    until: float = math.inf
    standing: Samples | None = None  # fixed grains

    @cached_property
    def volume(self) -> Estimate:
        """Volume without that of fixed grains, from points in the bounds of the container."""
        share = float(self._held(self.samples.around, self.samples.around_depths).mean())
        error = math.sqrt(share * (1 - share) / len(self.samples.around))
        taken = NOTHING if self.standing is None else self._solid_of(self.standing)
        return Estimate(share * self.samples.span - taken, math.hypot(error * self.samples.span, taken.error))

    def grains(self, packing: Packing) -> Booleans:
        """Return the mask of the grains with their centroids in the region."""
        return self._held(packing.position, -packing.container.signed_distance(packing.position))

    def solid(self, solids: Solids) -> Estimate:
        """Return the volume of the grains inside; overlapping volume counts for each grain."""
        del solids
        return self._solid_of(self.samples)

    def _solid_of(self, samples: Samples) -> Estimate:
        """Return the volume of the grains that are sampled inside."""
        n = len(samples.volumes)
        held = self._held(samples.points, samples.depths)
        count = np.maximum(np.bincount(samples.grain, minlength=n), 1)
        share = np.bincount(samples.grain, weights=held, minlength=n) / count
        variance = samples.volumes**2 * share * (1 - share) / count
        return Estimate(float((samples.volumes * share).sum()), math.sqrt(float(variance.sum())))

    def _held(self, points: Floats, depths: Floats) -> Booleans:
        """Return the mask of the sample points in the region."""
        low = _between(points, *self.limits).all(axis=1)
        # both bounds have the same slack, so that no point is in two regions that meet
        slack = ON_FACE * float(np.abs(points).max(initial=0.0))
        return np.asarray(low & (depths >= self.inset - slack) & (depths < self.until - slack))


def _between(values: Floats, lower: "Floats | float", upper: "Floats | float") -> Booleans:
    """Return which coordinates lie between two faces or in one of them, whatever the unit of lengths."""
    bounds = np.abs(np.array([lower, upper]))
    slack = ON_FACE * np.where(np.isfinite(bounds), bounds, 0.0).max(axis=0)
    return np.asarray((values >= lower - slack) & (values <= upper + slack))


def gravity_of(packing: Packing) -> tuple[int, int] | None:
    """Return the axis of the largest component of gravity, and its sign; None without gravity."""
    if packing.gravity is None:
        return None
    down = main_axis(np.array(packing.gravity))
    axis = int(np.flatnonzero(down)[0])
    return axis, int(down[axis])


def held_height(solids: Solids, axis: int, sign: int) -> float:
    """Return the coordinate along gravity below which the share HELD of the volume of the grains, at least one, lies.

    The sign is -1 if gravity points to low coordinates, 1 if to high ones.
    """
    packing = solids.packing
    wanted = HELD * float(packing.volumes.sum())
    height = -sign * packing.position[:, axis]
    bottom, top = height - packing.bounding_radii, height + packing.bounding_radii
    low, high = _around_height(bottom, top, packing.volumes, wanted)
    active, below = np.flatnonzero((top > low) & (bottom < high)), float(packing.volumes[top <= low].sum())
    for _ in range(54):
        middle = (low + high) / 2
        lower, upper = np.full(packing.dimension, -np.inf), np.full(packing.dimension, np.inf)
        if sign < 0:
            upper[axis] = middle
        else:
            lower[axis] = -middle
        held = below + float(solids.cut_grains(active, lower, upper)[0].sum())
        if held < wanted:
            low = middle
            below += float(packing.volumes[active[top[active] <= low]].sum())
            active = active[top[active] > low]
        else:
            high = middle
            active = active[bottom[active] < high]
    return -sign * low


def _around_height(bottom: Floats, top: Floats, volumes: Floats, wanted: float) -> tuple[float, float]:
    """Return two heights between which grains with ends at `bottom` and `top`, (n,), hold a volume below.

    Where all grains that begin below a height hold less, the grains below it hold less too; where those that end below
    it hold as much, they hold as much.
    """
    found = []
    for ends in (bottom, top):
        order = np.argsort(ends, kind="stable")
        enough = int(np.searchsorted(np.cumsum(volumes[order]), wanted))
        found.append(float(ends[order[min(enough, len(order) - 1)]]))
    return found[0], found[1]


#: points of the quadrature between two special heights, and of the coarser one that gives the error
NODES = 40
FEWER = 30


def cut_spheres_by_cylinder(
    centers: Floats, radii: Floats, *, radius: float, lower: float, upper: float
) -> tuple[Floats, Floats]:
    """Return the volume of each sphere inside the cylinder ``x**2 + y**2 <= radius**2``, ``lower <= z <= upper``.

    Centers are (n, 3) and radii (n,). Returned are the volumes (n,) and their differences (n,) from a coarser
    quadrature.
    """
    low, high = np.array([-np.inf, -np.inf, lower]), np.array([np.inf, np.inf, upper])
    volumes, errors = cut_spheres(centers, radii, lower=low, upper=high), np.zeros(len(radii))
    apart = np.hypot(centers[:, 0], centers[:, 1])
    volumes[apart - radii >= radius] = 0.0
    cut = np.flatnonzero((volumes > 0) & (apart + radii > radius))
    if len(cut):
        size = radii[cut]
        ends = np.clip(np.stack([lower - centers[cut, 2], upper - centers[cut, 2]]) / size, -1.0, 1.0)
        scaled = apart[cut] / size, radius / size, ends
        fine, coarse = _quadrature(*scaled, NODES), _quadrature(*scaled, FEWER)
        volumes[cut], errors[cut] = fine * libm.power(size, 3), np.abs(fine - coarse) * libm.power(size, 3)
    return volumes, errors


def _quadrature(apart: Floats, radius: Floats, ends: Floats, points: int) -> Floats:
    """Integrate the common area of the slices of unit spheres and of the cylinder over the height."""
    touch = [np.sqrt(np.maximum(0.0, 1.0 - r**2)) for r in (np.abs(apart - radius), apart + radius)]
    marks = np.stack([ends[0], -touch[0], -touch[1], touch[1], touch[0], ends[1]])
    marks = np.clip(marks, ends[0], ends[1])
    nodes, weights = linear.gauss_legendre(points)
    places, slopes = libm.sin(np.pi / 2 * nodes), np.pi / 2 * libm.cos(np.pi / 2 * nodes) * weights
    half = np.diff(marks, axis=0) / 2
    middle = (marks[1:] + marks[:-1]) / 2
    heights = middle[..., None] + half[..., None] * places
    slice_radius = np.sqrt(np.maximum(0.0, 1.0 - heights**2))
    area = _common_area(slice_radius, radius[:, None], apart[:, None])
    return np.asarray((area * slopes * half[..., None]).sum(axis=(0, 2)))


def _common_area(one: Floats, other: Floats, apart: Floats) -> Floats:
    """Return the common area of two disks."""
    inside, outside = apart <= np.abs(one - other), apart >= one + other
    # any length above 0 where the disks do not cross, for which the result is not used
    distance = np.where(inside | outside, 1.0, apart)
    near = (distance + (one - other) * (one + other) / distance) / 2
    far = distance - near
    chord = np.sqrt(np.maximum(0.0, (one - near) * (one + near)))
    lens = one**2 * libm.arctan2(chord, near) + other**2 * libm.arctan2(chord, far) - distance * chord
    return np.where(inside, np.pi * np.minimum(one, other) ** 2, np.where(outside, 0.0, lens))
