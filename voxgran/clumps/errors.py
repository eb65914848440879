"""Errors of a clump relative to its solid."""

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import kernel
from voxgran._base.lazy import load
from voxgran._base.tree import grow_tree
from voxgran.clumps.model import ClumpErrors
from voxgran.points.sample import sample_surface
from voxgran.shapes.model import Shape
from voxgran.shapes.spheres import Spheres
from voxgran.voxels.closed_form import spheres_bits
from voxgran.voxels.model import Voxels

#: spacing of the points at which distances are taken, in equivalent diameters
SPACING = 0.05
#: number of points on all spheres together, before those inside other spheres are removed
SPHERE_POINTS = 20_000


def clump_errors(voxels: Voxels, shape: Shape, spheres: Spheres) -> ClumpErrors:
    """Return the errors of a clump against a solid, given by voxel centers and continuous, in the same frame.

    Volume, centroid and inertia are from exact integrals; the overlap is from voxels; the distances are from points.
    """
    mask = spheres_bits(spheres.centers, spheres.radii, voxels.grid, cover="center").unpacked()
    both, either = int((mask & voxels.mask).sum()), int((mask | voxels.mask).sum())
    # the errors of the voxels at the surface are independent: their sum grows with the root of their number
    rim = voxels.mask ^ load("scipy.ndimage").binary_erosion(voxels.mask)
    inertia = np.linalg.norm(spheres.inertia - shape.inertia) / np.linalg.norm(shape.inertia)
    near = _surface_gaps(shape, spheres)
    return ClumpErrors(
        iou=both / either,
        iou_uncertainty=float(np.sqrt(rim.sum()) / 2 / either),
        volume=spheres.volume / shape.volume - 1,
        centroid=float(np.linalg.norm(spheres.centroid)) / shape.diameter,
        inertia=float(inertia),
        surface_mean=float(near.mean()) / shape.diameter,
        surface_max=float(near.max()) / shape.diameter,
    )


def _surface_gaps(shape: Shape, spheres: Spheres) -> Floats:
    """Return the distances of points on each surface from the other, with equally many points on both."""
    body = np.array(sample_surface(shape, spacing=SPACING * shape.diameter, method="uniform"))
    rim = _exposed_points(spheres)
    there = _distances_from_union(body, spheres, rim)
    back = np.abs(grow_tree(shape.vertices, shape.faces).nearest(rim)[0])
    many = min(len(there), len(back))
    return np.concatenate([_thinned(there, many), _thinned(back, many)])


def _distances_from_union(points: Floats, spheres: Spheres, rim: Floats) -> Floats:
    """Return the distances of points from the surface of a union of spheres.

    Outside the union the distance from the nearest sphere is exact. Inside, the shortest exit from the sphere that
    contains the point most deeply is a lower bound, which is exact if it ends outside all other spheres; otherwise the
    distance from the nearest point of `rim` is used.
    """
    gap, owner = _gaps(points, spheres)
    inside = np.flatnonzero(gap < 0)
    middle = spheres.centers[owner[inside]]
    ray = points[inside] - middle
    length = np.linalg.norm(ray, axis=1, keepdims=True)
    exit_point = middle + ray * (spheres.radii[owner[inside], None] / np.maximum(length, 1e-300))
    hidden = inside[_gaps(exit_point, spheres)[0] < -1e-9 * float(spheres.radii.max())]
    distance = np.abs(gap)
    if len(hidden):
        distance[hidden] = load("scipy.spatial").cKDTree(rim).query(points[hidden])[0]
    return distance


def _thinned(values: Floats, count: int) -> Floats:
    """Return `count` of the values, evenly chosen and including the largest."""
    chosen = values[np.linspace(0, len(values) - 1, count).astype(np.int64)]
    chosen[0] = values.max()
    return chosen


def _exposed_points(spheres: Spheres) -> Floats:
    """Return points on the spheres, at equal density, that lie in no other sphere."""
    areas = spheres.radii**2
    counts = np.ceil(SPHERE_POINTS * areas / areas.sum()).astype(np.int64)
    rim = np.concatenate([c + r * _spiral(n) for c, r, n in zip(spheres.centers, spheres.radii, counts, strict=True)])
    return rim[_gaps(rim, spheres)[0] >= -1e-9 * float(spheres.radii.max())]


def _gaps(points: Floats, spheres: Spheres) -> tuple[Floats, Integers]:
    """Return the signed distance of each point from the union (negative inside) and the index of the sphere."""
    gap, owner = np.full(len(points), np.inf), np.zeros(len(points), dtype=np.int64)
    _find_gaps(np.ascontiguousarray(points), spheres.centers, spheres.radii, gap, owner)
    return gap, owner


def _spiral(count: int) -> Floats:
    """Return points spread evenly over the unit sphere along a Fibonacci spiral."""
    k = np.arange(count) + 0.5
    z, angle = 1 - 2 * k / count, np.pi * (1 + np.sqrt(5)) * k
    flat = np.sqrt(1 - z * z)
    return np.column_stack([flat * np.cos(angle), flat * np.sin(angle), z])


@kernel
def _find_gaps(points, centers, radii, gap, owner):  # type: ignore[no-untyped-def]
    """Fill `gap` with the smallest signed distance from a sphere and `owner` with the sphere's index."""
    for p in range(len(points)):
        for s in range(len(radii)):
            dx, dy, dz = points[p, 0] - centers[s, 0], points[p, 1] - centers[s, 1], points[p, 2] - centers[s, 2]
            found = np.sqrt(dx * dx + dy * dy + dz * dz) - radii[s]
            if found < gap[p]:
                gap[p], owner[p] = found, s
