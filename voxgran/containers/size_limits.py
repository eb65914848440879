"""Grains that are certainly too large for a container in any orientation, and one that is as large as it."""

import itertools
import math
from collections.abc import Sequence

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.errors import GrainTooLargeError
from voxgran._base.lazy import load
from voxgran.containers.model import Container, boundary_of, periods_of
from voxgran.geometry.periods import images_within, shortest_period
from voxgran.geometry.rotation import normalized, rotation_matrices
from voxgran.geometry.sphere_pairs import MOST_IMAGES
from voxgran.shapes.describing.extents import principal_extents
from voxgran.shapes.describing.inscribed import inscribed_radius
from voxgran.shapes.mesh import Surface
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.spheres import Spheres

#: factor that allows for rounding of a length
EXACT = 1 + 1e-12
#: a grain wider than a period by no more than the rounding of files is kept, and its overlap is found
ROUNDED = 1 + 1e-3
#: a grain whose bounding sphere is so many times as wide as the container is long has the wrong unit
MOST_WIDTHS = 1000.0
#: relative difference of the lengths of a grain and a container that are equal but for rounding
EQUAL = 1e-12


def check_grain_sizes(shapes: Sequence[Shape], container: Container, shape_id: Integers, scale: Floats) -> None:
    """Check that no grain is so large that its overlaps with periodic images are beyond counting.

    Raises
    ------
    GrainTooLargeError
        If a grain contains a sphere wider than a period by more than 0.1 %, has more than 10,000 of its periodic
        images within its width, or is more than 1,000 times as wide as the container is long.
    """
    if not len(scale):
        return
    lower, upper = container.bounds
    lengths, radii = upper - lower, np.array([shape.bounding_radius for shape in shapes])[shape_id]
    width = 2.0 * radii * scale
    periods = periods_of(container)
    period = shortest_period(periods)
    known: dict[int, float] = {}
    for grain in np.flatnonzero(width > min(period * ROUNDED, MOST_WIDTHS * lengths.max())).tolist():
        index = int(shape_id[grain])
        if index not in known:
            known[index] = _spheres(shapes[index])[0]
        if known[index] * scale[grain] > period * ROUNDED:
            rule = f"it contains a sphere wider than the period of {period:g} and overlaps its own images"
        elif images_within(width[grain], periods) > MOST_IMAGES:
            rule = f"more than {MOST_IMAGES} of its periodic images lie within its width, from {period:g} on"
        elif width[grain] > MOST_WIDTHS * lengths.max():
            rule = f"it must be at most {MOST_WIDTHS:g} times as wide as the container is long, {lengths.max():g}"
        else:
            continue
        raise GrainTooLargeError(
            f"grain {grain} is {width[grain]:.6g} wide: {rule}; correct its size or unit, or enlarge the container"
        )


def can_fit(shapes: Sequence[Shape], container: Container, shape_id: Integers, diameter: Floats) -> Booleans:
    """Return which grains, (n,), are not certainly too large, by their shapes and equivalent diameters.

    Grains are too large if they have more volume than the container, contain a sphere wider than the container along an
    axis, or are longer than its longest line. A rod may lie along a diagonal, and one that is longer than a period
    beside its own images.
    """
    dimension = container.dimension
    lengths = (container.bounds[1] - container.bounds[0])[:dimension]
    extents = np.sort(np.array([principal_extents(shape)[:dimension] / shape.diameter for shape in shapes]), axis=1)
    # grains that fit along the axes need no further test
    fits = np.all(extents[shape_id] * diameter[:, None] <= np.sort(lengths) * EXACT, axis=1)
    open_axes = np.array(container.periodic[:dimension])
    walled, periodic = lengths[~open_axes].min(initial=math.inf), shortest_period(periods_of(container))
    longest = math.inf if open_axes.any() else boundary_of(container).longest_line(lengths)
    for k in np.unique(shape_id[~fits]).tolist():
        mine = np.flatnonzero(~fits & (shape_id == k))
        shape, size = shapes[k], diameter[mine] / shapes[k].diameter
        core, sphere = _spheres(shape)
        room = (sphere * size <= walled * EXACT) & (core * size <= periodic * EXACT)
        room &= shape.volume * size**dimension <= container.volume * EXACT
        room &= _length(shape) * size <= longest * EXACT
        fits[mine] = room
    return fits


def poses_between_walls(shape: Shape, container: Container) -> tuple[Floats, Floats]:
    """Return positions (m, 3) and orientations (m, 4) in which the bounds of a shape, turned by right angles about the
    axes, are those of a container.
    """
    d, length = container.dimension, np.ptp(container.bounds, axis=0)
    low, high = (np.asarray(corner, dtype=np.float64) for corner in shape.bounds)
    turns = np.array([q for q in itertools.product((0, 1, -1), repeat=4) if sum(map(abs, q)) in (1, 2, 4)], dtype=float)
    matrices = np.rint(rotation_matrices(normalized(turns)))
    extents = linear.matmul(np.abs(matrices), high - low)
    alike = (np.abs(extents - length)[:, :d] <= EQUAL * length[:d]).all(axis=1) & (
        (d == 3) | (matrices[:, 2, 2] == 1.0)
    )
    middle = container.bounds.mean(axis=0) - linear.matmul(matrices[alike], 0.5 * (low + high))
    return middle, normalized(turns)[alike]


def _length(shape: Shape) -> float:
    """Return the distance of two distant points of a shape, a lower bound of its diameter."""
    if shape.is_sphere:
        return shape.diameter
    points = shape.vertices
    far = points[linear.norm(points, axis=1).argmax()]
    return float(linear.norm(points - far, axis=1).max())


def _spheres(shape: Shape) -> tuple[float, float]:
    """Return the diameters of a sphere inside a shape and of one inside its convex hull; 0 where none is known.

    Only the first limits a shape that is longer than a period.
    """
    geometry = shape.geometry
    if isinstance(geometry, Surface):
        return 0.0, 0.0
    if shape.is_sphere:
        return shape.diameter, shape.diameter
    if isinstance(geometry, Primitive):
        sphere = 2.0 * inscribed_radius(shape)
        return sphere, sphere
    # the nearest facet limits the sphere about the centroid
    hull = load("scipy.spatial").ConvexHull(shape.vertices[:, : shape.dimension])
    around = float(-2.0 * hull.equations[:, -1].max())
    if isinstance(geometry, Spheres):
        core = 2.0 * float(geometry.radii.max())
        return core, max(core, around)
    return 0.0, around
