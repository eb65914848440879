"""Errors of a clump relative to its solid."""

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Booleans, Floats
from voxgran._base.lazy import load
from voxgran._base.scalars import cube_root
from voxgran.clumps.method import Body
from voxgran.clumps.model import ClumpErrors
from voxgran.clumps.sphere_sets import union_gaps
from voxgran.geometry.rotation import normalized, rotation_matrices
from voxgran.lattice.grid import Grid
from voxgran.lattice.packed import PackedMask
from voxgran.shapes.model import Shape
from voxgran.shapes.spheres import Spheres
from voxgran.shapes.tessellate import sphere_points
from voxgran.voxels.closed_form import spheres_bits
from voxgran.voxels.occupy import occupied

#: voxels along the equivalent diameter in which the overlap is counted
RESOLUTION = 160
#: largest number of these voxels
MOST_VOXELS = 1_000_000_000
#: number of points on the solid at which distances are taken, and largest number on all spheres, hidden ones included
SURFACE_POINTS, MOST_POINTS = 10_000, 100_000
#: quaternion by which both solids are turned before voxels are counted, and shift in voxels
TURN, SHIFT = np.array([0.682, 0.473, 0.134, 0.543]), np.array([0.31, 0.17, 0.43])


def clump_errors(body: Body, spheres: Spheres) -> ClumpErrors:
    """Return the errors of a clump against its solid, both in the frame and unit of the body.

    Volume, centroid and inertia are from exact integrals. Of the overlap only the symmetric difference is counted, in
    voxels: with the exact volumes A and B and that difference D it is (A + B - D) / (A + B + D).
    """
    shape = body.shape
    both = shape.volume + spheres.volume
    apart, uncertain = _difference(shape, spheres)
    inertia = linear.norm(spheres.inertia - shape.inertia) / linear.norm(shape.inertia)
    near = _surface_gaps(body, spheres)
    return ClumpErrors(
        iou=(both - apart) / (both + apart),
        iou_uncertainty=2 * both * uncertain / (both + apart) ** 2,
        volume=spheres.volume / shape.volume - 1,
        centroid=float(linear.norm(spheres.centroid)),
        inertia=float(inertia),
        surface_mean=float(near.mean()),
        surface_max=float(near.max()),
    )


def _difference(shape: Shape, spheres: Spheres) -> tuple[float, float]:
    """Return the volume that lies in only one of a solid and a union of spheres, and its standard error.

    Both are turned and shifted, so that no plane face lies along the lattice and no symmetry is that of the lattice. A
    voxel at one of the surfaces is then in or out independently of the others: the error is half the root of their
    number.
    """
    turn = normalized(TURN[None])
    matrix = rotation_matrices(turn)[0]
    corners = linear.matmul(shape.vertices, matrix.T)
    centers, error = linear.matmul(spheres.centers, matrix.T), shape.tessellation_error
    low = np.minimum(corners.min(axis=0) - error, (centers - spheres.radii[:, None]).min(axis=0))
    high = np.maximum(corners.max(axis=0) + error, (centers + spheres.radii[:, None]).max(axis=0))
    # long solids get coarser voxels
    size = max(1.0 / RESOLUTION, cube_root(float(np.prod(high - low) / MOST_VOXELS)))
    grid, shift = Grid.around(low, high, size, margin=2), SHIFT * size
    union = Spheres(centers + shift, spheres.radii)
    solid = occupied(shape, grid, rotation=turn[0], offset=shift).words
    words = solid ^ spheres_bits(union.centers, union.radii, grid, cover="center").words
    rim = (shape.surface_area + spheres.surface_area) / size**2
    return PackedMask(words, grid.shape).count() * size**3, float(np.sqrt(rim)) / 2 * size**3


def _surface_gaps(body: Body, spheres: Spheres) -> Floats:
    """Return the distances of points on each surface from the other, with equally many points on both."""
    points = body.surface(SURFACE_POINTS, seed=0).points
    there = _distances_from_union(points, spheres)
    back = np.abs(body.depth(_exposed_points(spheres)))
    many = min(len(there), len(back))
    return np.concatenate([_thinned(there, many), _thinned(back, many)])


def _distances_from_union(points: Floats, spheres: Spheres) -> Floats:
    """Return the distances of points near the surface of a union of spheres from that surface.

    Outside the union the distance from the nearest sphere is exact. Inside, the shortest exit from the sphere that
    contains the point most deeply is a lower bound, which is exact if it ends outside all other spheres; otherwise the
    distance from the nearest of the other exits is used.
    """
    gap, owner = union_gaps(points, spheres.centers, spheres.radii)
    ray = points - spheres.centers[owner]
    length = linear.norm(ray, axis=1, keepdims=True)
    exits = spheres.centers[owner] + ray * (spheres.radii[owner, None] / np.maximum(length, 1e-300))
    bare = _bare(exits, spheres)
    distance, hidden = np.abs(gap), (gap < 0) & ~bare
    if hidden.any():
        rim = np.concatenate([exits[bare], _exposed_points(spheres)])
        distance[hidden] = load("scipy.spatial").cKDTree(rim).query(points[hidden])[0]
    return distance


def _thinned(values: Floats, count: int) -> Floats:
    """Return `count` of the values, evenly chosen and including the largest."""
    chosen = values[np.linspace(0, len(values) - 1, count).astype(np.int64)]
    chosen[0] = values.max()
    return chosen


def _exposed_points(spheres: Spheres) -> Floats:
    """Return points on the spheres, at equal density, that lie in no other sphere."""
    areas = 4 * np.pi * spheres.radii**2
    # so many that about as many remain as there are on the solid
    count = min(SURFACE_POINTS * float(areas.sum()) / spheres.surface_area, MOST_POINTS)
    counts = np.ceil(count * areas / areas.sum()).astype(np.int64)
    each = zip(spheres.centers, spheres.radii, counts, strict=True)
    rim = np.concatenate([center + radius * sphere_points(number) for center, radius, number in each])
    return rim[_bare(rim, spheres)]


def _bare(points: Floats, spheres: Spheres) -> Booleans:
    """Return which points on the spheres lie in no other sphere."""
    return union_gaps(points, spheres.centers, spheres.radii)[0] >= -1e-9 * float(spheres.radii.max())
