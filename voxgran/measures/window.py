"""Solid volume of a packing inside a box along the axes, exact except for cylinders and cones.

If all grains are spheres or unions of spheres, the solid is one union of spheres. The planes of equal power divide it
into parts of single spheres between half-spaces (the power diagram: Aurenhammer 1987, doi:10.1137/0216006), whose
volumes are exact. An ellipsoid is mapped linearly to a sphere; a mesh is cut triangle by triangle. Cylinders and cones
are cut as inscribed prisms and pyramids of FINE sides; the error is at most the volume between the two and is given.
The union of overlapping grains other than spheres is computed from triangles (:mod:`voxgran.measures.overlap`).

The spheres near a box are found from their order along each axis, so that thin slices do not visit all spheres.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import kernel
from voxgran.containers.model import Container, periods_of, tilt_of
from voxgran.geometry.halfspaces import cut_disks, cut_spheres
from voxgran.geometry.periods import OPEN, nearest_turns
from voxgran.geometry.sphere_pairs import near_pairs
from voxgran.measures.overlap import overlap_volume
from voxgran.measures.slices import cut_mesh, cut_polygon
from voxgran.packing.model import Packing
from voxgran.shapes.describing.body import as_spheres
from voxgran.shapes.mesh import Mesh, Surface
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.spheres import Spheres
from voxgran.shapes.tessellate import revolved

#: number of sides of the prism that replaces a cylinder or cone
FINE = 720
#: depth of overlap, in mean diameters (in mean radii of spheres), below which its volume is negligible
NO_DEPTH = 1e-9
#: distance, in mean diameters, up to which a face lies on another one: more than neighbours of a label image are apart
ON = 1e-4

Planes: TypeAlias = tuple[Integers, Floats, Floats]


@dataclass(frozen=True, eq=False)
class Ordered:
    """Coordinates of centers along one axis in ascending order; on a periodic axis they are folded into one period."""

    places: Floats  # (n,)
    order: Integers  # (n,) indices of the spheres
    low: float  # lower end of the period
    period: float  # 0 on an axis that is not periodic

    @classmethod
    def of(cls, centers: Floats, container: Container, axis: int) -> "Ordered":
        """Return the spheres with centers (n, 3) in their order along an axis."""
        low, high = container.bounds[:, axis]
        period = float(high - low) if container.periodic[axis] else 0.0
        places = np.mod(centers[:, axis] - low, period) if period else centers[:, axis]
        order = np.argsort(places, kind="stable")
        return cls(places[order], order, float(low), period)

    def between(self, start: float, end: float) -> list[tuple[int, int]]:
        """Return the ranges of `order` with the spheres whose centers, or periodic images of them, are in an interval.

        On a periodic axis one end of a range may hold centers just outside.
        """
        if not self.period:
            return [self._range(start, end)]
        if end - start >= self.period:
            return [(0, len(self.order))]
        begin = float(np.mod(start - self.low, self.period))
        beyond = begin + (end - start) - self.period
        if beyond < 0.0:
            return [self._range(begin, begin + (end - start))]
        return [self._range(0.0, beyond), self._range(begin, self.period)]

    def _range(self, start: float, end: float) -> tuple[int, int]:
        """Return the range of places in a closed interval."""
        return int(np.searchsorted(self.places, start, "left")), int(np.searchsorted(self.places, end, "right"))


class Estimate(float):
    """A number with its error.

    Attributes
    ----------
    error : float
        Bound of the error, or its standard deviation if the number comes from sampling; 0 if it is exact.
    """

    error: float

    def __new__(cls, value: float, error: float = 0.0) -> "Estimate":
        """Return a number with an error."""
        number = super().__new__(cls, value)
        number.error = float(error)
        return number


@dataclass(frozen=True, eq=False)
class Solids:
    """The grains of a packing as solids for cutting; intermediate results are cached."""

    packing: Packing

    def volume(self, lower: Floats, upper: Floats) -> Estimate:
        """Return the volume (in 2D area) of the union of all grains and their periodic images inside a box.

        The box is infinite on open sides; on an open periodic axis each grain is counted once. Overlapping grains that
        are not closed surfaces are refused.
        """
        if self.spheres is not None:
            return Estimate(self._sphere_volume(self.spheres, lower, upper))
        if self.overlaps[0].size:
            lower, upper = _closed(self.packing.container, lower, upper)
        grain, shift = images(self.packing.position, self.packing.bounding_radii, lower, upper, self.packing.container)
        volumes, errors = self.cut_grains(grain, lower, upper, shift=shift)
        present = grain, nearest_turns(shift, periods_of(self.packing.container))
        twice = overlap_volume(self.packing, self.overlaps, present, lower=lower, upper=upper)
        doubt = twice if self._curved else 0.0
        return Estimate(float(volumes.sum()) - twice, float(errors.sum()) + doubt)

    def cut_grains(
        self, grain: Integers, lower: Floats, upper: Floats, *, shift: Floats | None = None
    ) -> tuple[Floats, Floats]:
        """Return the volumes (k,) of given grains, each with a translation in `shift` (k, 3), inside a box, and error
        bounds (k,).
        """
        packing, d = self.packing, self.packing.dimension
        centers = packing.position[grain] + (0.0 if shift is None else shift)
        reach = packing.bounding_radii[grain, None]
        low, high = (centers - reach)[:, :d], (centers + reach)[:, :d]
        whole = (low >= lower).all(axis=1) & (high <= upper).all(axis=1)
        volumes, errors = np.where(whole, packing.volumes[grain], 0.0), np.zeros(len(grain))
        cut = np.flatnonzero(~whole)
        for k in np.unique(packing.shape_id[grain[cut]]):
            mine = cut[packing.shape_id[grain[cut]] == k]
            maps = packing.matrices[grain[mine]] * packing.scale[grain[mine], None, None]
            parts, doubt = _cut_shape(packing.shapes[k], maps, centers[mine], lower, upper)
            volumes[mine] = parts
            errors[mine] = doubt * packing.scale[grain[mine]] ** d
        return volumes, errors

    @property
    def spheres(self) -> tuple[Floats, Floats, Planes] | None:
        """Centers, radii and planes of equal power of all spheres of all grains; None unless all grains are spheres.

        It is None too where clumps have the volume of the solids that they stand for. They are found once for all
        measures of a packing.
        """
        found = self.packing._found
        if "spheres" not in found:
            found["spheres"] = self._find_spheres()
        spheres: tuple[Floats, Floats, Planes] | None = found["spheres"]
        return spheres

    def _find_spheres(self) -> tuple[Floats, Floats, Planes] | None:
        """Return centers, radii and planes of equal power of all spheres, where all grains are spheres."""
        used = [self.packing.shapes[k] for k in np.unique(self.packing.shape_id)]
        if any(as_spheres(shape.geometry) is None for shape in used):
            return None
        if any(isinstance(shape.geometry, Spheres) and shape.geometry.mass is not None for shape in used):
            return None
        centers, radii = flat_spheres(self.packing)
        known = self.packing._contacts
        if known and len(radii) and all(shape.is_sphere for shape in self.packing.shapes):
            # contacts of single spheres are found already, and overlaps are among them
            found = known[max(known)]
            deep = found.gap <= -NO_DEPTH * float(radii.mean())
            pairs = found.i[deep], found.j[deep], found.image[deep]
            return centers, radii, _planes_of(pairs, centers, radii, periods_of(self.packing.container))
        return centers, radii, power_planes(centers, radii, self.packing.container)

    @property
    def _ordered(self) -> list[Ordered]:
        """The centers of all spheres along each axis, sorted once for all measures of a packing."""
        found = self.packing._found
        if "ordered" not in found:
            assert self.spheres is not None
            packing, centers = self.packing, self.spheres[0]
            found["ordered"] = [Ordered.of(centers, packing.container, axis) for axis in range(packing.dimension)]
        ordered: list[Ordered] = found["ordered"]
        return ordered

    @cached_property
    def overlaps(self) -> tuple[Integers, Integers, Integers]:
        """Pairs (i, j, image) of grains that overlap."""
        packing = self.packing
        mean = float(packing.diameters.mean()) if packing.count else 1.0
        # the wetted surface asks for these pairs too, which are found once
        found = packing.contacts(ON * mean)
        deep = found.gap < -NO_DEPTH * mean
        # open surfaces have no volume
        deep &= (packing.volumes[found.i] > 0.0) & (packing.volumes[found.j] > 0.0)
        return found.i[deep], found.j[deep], found.image[deep]

    @cached_property
    def _curved(self) -> bool:
        """Whether a tessellation is not the true shape."""
        return any(self.packing.shapes[k].tessellation_error > 0 for k in np.unique(self.packing.shape_id))

    def _sphere_volume(self, spheres: tuple[Floats, Floats, Planes], lower: Floats, upper: Floats) -> float:
        """Return the volume of a union of spheres inside a box."""
        centers, radii, planes = spheres
        upright = not any(tilt_of(self.packing.container))
        near = near_box(self._ordered, float(radii.max(initial=0.0)), lower, upper) if upright else None
        some = slice(None) if near is None else near
        sphere, shift = images(centers[some], radii[some], lower, upper, self.packing.container)
        sphere = sphere if near is None else near[sphere]
        chosen = chosen_planes(planes, sphere) if len(planes[1]) else None
        moved = centers[sphere] + shift
        if self.packing.dimension == 3:
            return float(cut_spheres(moved, radii[sphere], lower=lower, upper=upper, planes=chosen).sum())
        flat = chosen and (chosen[0], np.ascontiguousarray(chosen[1][:, :2]), chosen[2])
        corners = np.ascontiguousarray(moved[:, :2])
        return float(cut_disks(corners, radii[sphere], lower=lower, upper=upper, planes=flat).sum())


def images(
    centers: Floats, radii: Floats, lower: Floats, upper: Floats, container: Container
) -> tuple[Integers, Floats]:
    """Return the indices (m,) of the spheres that reach into a box, once per periodic image, and their translations (m,
    3).

    An open periodic axis gives no images.
    """
    d, periods = len(lower), periods_of(container)
    periods[:d][~(np.isfinite(lower) & np.isfinite(upper))] = 0.0
    box = np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)
    found = len(centers)
    while True:
        index, shift = np.empty(found, dtype=np.int64), np.zeros((found, 3))
        found = int(_find_images(centers, radii, *box, periods, index, shift))
        if found <= len(index):
            return index[:found], shift[:found]


@kernel
def _find_images(centers, radii, lower, upper, periods, index, shift):  # type: ignore[no-untyped-def]
    """Write the spheres that reach into a box and their translations as far as there is room; return their number."""
    found, d, p = 0, len(lower), periods
    for i in range(len(radii)):
        r = radii[i]
        first_c, last_c = 0, 0
        if d == 3:
            first_c, last_c = _images_along(lower[2], upper[2], centers[i, 2], r, p[2, 2])
        for c in range(first_c, last_c + 1):
            first_b, last_b = _images_along(lower[1], upper[1], centers[i, 1] + c * p[2, 1], r, p[1, 1])
            for b in range(first_b, last_b + 1):
                x = c * p[2, 0] + b * p[1, 0]
                first_a, last_a = _images_along(lower[0], upper[0], centers[i, 0] + x, r, p[0, 0])
                for a in range(first_a, last_a + 1):
                    if found < len(index):
                        index[found] = i
                        shift[found, 0], shift[found, 1] = a * p[0, 0] + x, b * p[1, 1] + c * p[2, 1]
                        shift[found, 2] = c * p[2, 2]
                    found += 1
    return found


@kernel
def _images_along(low, high, place, r, length):  # type: ignore[no-untyped-def]
    """Return the first and the last image of a sphere that reaches between two ends, of an axis with a length or, where
    that is 0, without images.
    """
    if length == 0.0:
        return 0, 0 if place + r > low and place - r < high else -1
    return math.floor((low - r - place) / length) + 1, math.ceil((high + r - place) / length) - 1


def flat_spheres(packing: Packing) -> tuple[Floats, Floats]:
    """Return centers (m, 3) and radii (m,) of all spheres of all grains; all shapes in use must be spheres."""
    centers, radii, owner = [np.zeros((0, 3))], [np.zeros(0)], [np.zeros(0, np.int64)]
    for k in np.unique(packing.shape_id):
        grain = np.flatnonzero(packing.shape_id == k)
        found = as_spheres(packing.shapes[k].geometry)
        assert found is not None
        body, sizes = found
        stretched = body[None] * packing.scale[grain, None, None]
        turned = linear.einsum("gij,gbj->gbi", packing.matrices[grain], stretched) if body.any() else stretched
        centers.append((turned + packing.position[grain, None]).reshape(-1, 3))
        radii.append(np.outer(packing.scale[grain], sizes).reshape(-1))
        owner.append(np.repeat(grain, len(sizes)))
    order = np.argsort(np.concatenate(owner), kind="stable")
    return np.concatenate(centers)[order], np.concatenate(radii)[order]


def power_planes(centers: Floats, radii: Floats, container: Container | None = None) -> Planes:
    """Return (start, normals, offsets) of the planes of equal power of each sphere with the spheres that it overlaps.

    The planes of sphere i have the indices from ``start[i]`` to ``start[i + 1]``; offsets are relative to its center.
    """
    slack = -NO_DEPTH * float(radii.mean()) if len(radii) else 0.0
    lower, periods = np.zeros(3), OPEN
    if container is not None:
        lower, periods = np.array(container.bounds[0]), periods_of(container)
    pairs = near_pairs(centers, radii, slack, lower=lower, periods=periods)
    return _planes_of(pairs, centers, radii, periods)


def _planes_of(pairs: tuple[Integers, Integers, Integers], centers: Floats, radii: Floats, periods: Floats) -> Planes:
    """Return the planes of equal power of pairs (i, j, image) of overlapping spheres, as :func:`power_planes`."""
    i, j, image = pairs
    apart = centers[j] + linear.matmul(image, periods) - centers[i]
    distance = np.sqrt((apart**2).sum(axis=1))
    same = distance == 0.0
    # among concentric spheres the largest one is kept, among equal ones the first
    first = np.where((radii[i] > radii[j]) | ((radii[i] == radii[j]) & (i < j)), 2.0, -2.0) * (radii[i] + radii[j])
    span = np.where(same, 1.0, distance)
    normal = np.where(same[:, None], [1.0, 0.0, 0.0], apart / span[:, None])
    difference = (radii[i] - radii[j]) * (radii[i] + radii[j]) / span
    ahead = np.where(same, first, (distance + difference) / 2)
    behind = np.where(same, -first, (distance - difference) / 2)
    owner = np.concatenate([i, j])
    order = np.argsort(owner, kind="stable")
    start = np.searchsorted(owner[order], np.arange(len(radii) + 1))
    normals = np.concatenate([normal, -normal])[order]
    return start, normals, np.concatenate([ahead, behind])[order]


def chosen_planes(planes: Planes, sphere: Integers) -> Planes:
    """Return the planes of the given spheres, in their order."""
    start, normals, offsets = planes
    counts = (start[1:] - start[:-1])[sphere]
    ends = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    index = np.arange(ends[-1]) + np.repeat(start[sphere] - ends[:-1], counts)
    return ends, normals[index], offsets[index]


def _closed(container: Container, lower: Floats, upper: Floats) -> tuple[Floats, Floats]:
    """Return the box with one period on each open periodic axis."""
    d = len(lower)
    free = np.array(container.periodic[:d]) & ~(np.isfinite(lower) & np.isfinite(upper))
    return np.where(free, container.bounds[0, :d], lower), np.where(free, container.bounds[1, :d], upper)


def _cut_shape(shape: Shape, maps: Floats, centers: Floats, lower: Floats, upper: Floats) -> tuple[Floats, float]:
    """Return the volumes of copies of a shape inside a box, and a bound of the error at scale 1."""
    geometry = shape.geometry
    if isinstance(geometry, Surface):
        return np.zeros(len(maps)), 0.0
    if isinstance(geometry, Outline):
        return _cut_outline(geometry, maps, centers, lower, upper), 0.0
    if isinstance(geometry, Spheres):
        # a clump has the volume of the solid that it stands for, spread evenly over its spheres
        share = 1.0 if geometry.mass is None else geometry.volume / geometry.union.volume
        return _cut_clumps(geometry, maps, centers, lower, upper) * share, 0.0
    if isinstance(geometry, Mesh):
        return cut_mesh(geometry.vertices, geometry.faces, maps, centers, lower=lower, upper=upper), 0.0
    size = geometry.dimensions
    if geometry.kind == "sphere":
        radii = size[0] * linear.norm(maps[:, :, 0], axis=1)
        return cut_spheres(centers, radii, lower=lower, upper=upper), 0.0
    if geometry.kind == "ellipsoid":
        return _cut_ellipsoids(linear.matmul(maps, geometry.matrix) * np.array(size), centers, lower, upper), 0.0
    if geometry.kind == "box":
        vertices, faces, _ = geometry.tessellation()
        return cut_mesh(vertices, faces, maps, centers, lower=lower, upper=upper), 0.0
    sides = FINE // 6 if geometry.kind == "spherocylinder" else FINE
    vertices, faces, _ = revolved(geometry.profile(sides), sides=sides)
    solid = Mesh(linear.matmul(vertices, geometry.matrix.T), faces)
    parts = cut_mesh(solid.vertices, solid.faces, maps, centers, lower=lower, upper=upper)
    return parts * (shape.volume / solid.volume), shape.volume - solid.volume


def _cut_outline(outline: Outline, maps: Floats, centers: Floats, lower: Floats, upper: Floats) -> Floats:
    """Return the areas of copies of an outline inside a rectangle."""
    flat, places = maps[:, :2, :2], np.ascontiguousarray(centers[:, :2])
    if outline.kind == "polygon":
        return cut_polygon(outline.vertices, flat, places, lower=lower, upper=upper)
    middles = places + linear.matmul(flat, np.array(outline.center))
    radii = outline.radius * linear.norm(flat[:, :, 0], axis=1)
    return cut_disks(middles, radii, lower=lower, upper=upper)


def _cut_clumps(spheres: Spheres, maps: Floats, centers: Floats, lower: Floats, upper: Floats) -> Floats:
    """Return the volumes of copies of a union of spheres inside a box."""
    start, normals, offsets = power_planes(spheres.centers, spheres.radii)
    scales = linear.norm(maps[:, :, 0], axis=1)
    volumes = np.zeros(len(centers))
    for copy, scale in enumerate(scales):
        places = linear.matmul(spheres.centers, maps[copy].T) + centers[copy]
        planes = start, linear.matmul(normals, maps[copy].T) / scale, offsets * scale
        parts = cut_spheres(places, spheres.radii * scale, lower=lower, upper=upper, planes=planes)
        volumes[copy] = parts.sum()
    return volumes


def _cut_ellipsoids(maps: Floats, centers: Floats, lower: Floats, upper: Floats) -> Floats:
    """Return the volumes of ellipsoids inside a box, by linear maps to the unit sphere between mapped planes."""
    count = len(centers)
    stretch = linear.norm(maps, axis=2)
    above = (upper - centers) / stretch
    below = (centers - lower) / stretch
    rows = maps / stretch[..., None]
    normals = np.concatenate([rows, -rows], axis=1).reshape(-1, 3)
    offsets = np.concatenate([above, below], axis=1).reshape(-1)
    open_box = np.full(3, -np.inf), np.full(3, np.inf)
    planes = np.arange(count + 1) * 6, normals, offsets
    parts = cut_spheres(np.zeros((count, 3)), np.ones(count), lower=open_box[0], upper=open_box[1], planes=planes)
    # the triple product of the rows; `numpy.linalg.det` loses digits
    factor = (np.cross(maps[:, 0], maps[:, 1]) * maps[:, 2]).sum(axis=1)
    return np.asarray(parts * np.abs(factor))


#: share of the spheres above which all are visited
MOST = 0.5
#: relative widening of a slab against rounding
SLACK = 1e-12


def near_box(ordered: list[Ordered], reach: float, lower: Floats, upper: Floats) -> Integers | None:
    """Return, in ascending order, the spheres that may reach into a box, or None where these are most of all.

    It is the axis along which fewest spheres are near that selects them; none is left out, and others may be included.

    Parameters
    ----------
    ordered : list of Ordered
        The spheres along each of the d axes.
    reach : float
        Largest radius.
    lower, upper : (d,) ndarray of float
        Corners of the box, infinite on open sides.
    """
    fewest, chosen = MOST * len(ordered[0].order), None
    for axis, along in enumerate(ordered):
        if not (np.isfinite(lower[axis]) and np.isfinite(upper[axis])):
            continue
        wide = reach + SLACK * (reach + abs(lower[axis]) + abs(upper[axis]))
        ranges = along.between(lower[axis] - wide, upper[axis] + wide)
        count = sum(end - start for start, end in ranges)
        if count < fewest:
            fewest, chosen = count, np.concatenate([along.order[start:end] for start, end in ranges])
    return None if chosen is None else np.sort(chosen)
