"""Sample points on the surface of a shape with a given spacing.

The spacing of a set of points is twice its covering radius: every point of the surface has a sample within half the
spacing. Therefore, if two surfaces cross, two of their samples are closer than the larger of the two spacings.
"""

import math
from functools import lru_cache
from typing import Any

import numpy as np

from voxgran._base import ExplainedAttributes
from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, as_choice, as_count, as_length, check_type
from voxgran._base.calls import explained
from voxgran._base.errors import InputError
from voxgran.points.blue_noise import random_points, spread_points
from voxgran.points.covering import covering_radius
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive

#: largest number of attempts with an increasing number of points
ROUNDS = 8
MOST_POINTS = 500_000
#: sets of points that are kept between calls: the walls and shapes of a method that is called again
KEPT = 8
#: the number of points in units of the area over the squared covering radius increases by the logarithm of that ratio:
#: its value at 1 and its slope, by method (0.38 for a hexagonal arrangement of any number)
NUMBERS = {"poisson": (0.47, 0.055), "uniform": (0.1, 0.4)}


class SurfacePoints(ExplainedAttributes, np.ndarray[Any, np.dtype[np.float64]]):
    """(n, 3) points with their spacing.

    Attributes
    ----------
    spacing : float
        Twice the covering radius, in the unit of lengths: every point of the surface has a sample within half of it.
    """

    spacing: float

    @classmethod
    def from_points(cls, points: Floats, spacing: float) -> "SurfacePoints":
        """Return points with their spacing."""
        made = np.asarray(points, dtype=np.float64).view(cls)
        made.spacing = spacing
        return made

    def __array_finalize__(self, source: Any) -> None:
        """Pass the spacing to views and slices."""
        self.spacing = getattr(source, "spacing", float("nan"))


@explained(hint="sample_surface(shape, spacing=0.1)")
def sample_surface(shape: Shape, *, spacing: float, seed: int = 0, method: str = "poisson") -> SurfacePoints:
    """Sample points on the surface of a shape with at most the given spacing.

    The body is sampled at unit equivalent diameter and scaled back. The number of points increases until the covering
    radius, computed to one percent, is small enough. The points of the last calls are kept.

    Parameters
    ----------
    shape : Shape
        Any shape. Points and spacing refer to the true surface of a sphere, and to the tessellation of other curved
        shapes.
    spacing : float
        Largest spacing, in the unit of lengths: every point of the surface has a sample within half of it.
    seed : int
        Random seed.
    method : {"poisson", "uniform"}
        "poisson": points with a mutual distance. "uniform": random points, each anywhere in a share of its own of the
        area; many more for the same spacing.

    Returns
    -------
    SurfacePoints
        (n, 3) points; their `spacing` is an upper bound of the actual one. Points on an outline are equally spaced.

    Raises
    ------
    InputError
        If the spacing is not above 0, the method is unknown, or the spacing needs more than half a million points.
    MissingLibraryError
        If numba cannot be loaded.

    References
    ----------
    McCool & Fiume 1992, Hierarchical Poisson disk sampling distributions.

    Examples
    --------
    >>> import voxgran as vg
    >>> cube = vg.shapes.box(lengths=(1, 1, 1))
    >>> points = vg.sample_surface(cube, spacing=0.3)
    >>> points.shape[1], points.spacing <= 0.3
    (3, True)
    """
    check_type(shape, Shape, "shape", "a Shape; make_shape and load_shape make one")
    wanted = as_length(spacing, "spacing")
    as_choice(method, "method", ("poisson", "uniform"))
    return _sampled(shape, wanted, as_count(seed, "seed", at_most=None), method).copy()


@lru_cache(maxsize=KEPT)
def _sampled(shape: Shape, spacing: float, seed: int, method: str) -> SurfacePoints:
    """Return the points of :func:`sample_surface`.

    Raises
    ------
    InputError
        If the spacing needs more than half a million points.
    """
    wanted = spacing / shape.diameter
    if isinstance(shape.geometry, Outline):
        points, reached = _along_outline(shape.geometry.scaled(1 / shape.diameter), wanted)
        return SurfacePoints.from_points(points * shape.diameter, reached * shape.diameter)
    vertices = shape.vertices / shape.diameter
    area = shape.surface_area / shape.diameter**2
    sampled = spread_points if method == "poisson" else random_points
    (least, slope), size = NUMBERS[method], area / (wanted / 2) ** 2
    estimate = max(12.0, size * (least + slope * math.log(max(size, 1.0))))
    for _ in range(ROUNDS):
        if estimate > MOST_POINTS:
            break
        count = int(estimate)
        points, slack = _on_sphere(shape, sampled(vertices, shape.faces, count, seed=seed))
        reached = 2 * (covering_radius(points, vertices, shape.faces) + slack)
        if reached <= wanted:
            return SurfacePoints.from_points(points * shape.diameter, reached * shape.diameter)
        estimate = count * max(1.05, 1.03 * (reached / wanted) ** 2) + 1
    raise InputError(
        f"spacing is {spacing}: it needs more than {int(min(estimate, MOST_POINTS))} points on {shape.name!r}; "
        "make it larger"
    )


def _on_sphere(shape: Shape, points: Floats) -> tuple[Floats, float]:
    """Return the points, projected for a sphere, and the largest distance of the covered triangles from the sphere."""
    if isinstance(shape.geometry, Primitive) and shape.geometry.kind == "sphere":
        pushed = points / linear.norm(points, axis=1, keepdims=True) / 2
        return pushed, shape.tessellation_error / shape.diameter
    return points, 0.0


def _along_outline(outline: Outline, wanted: float) -> tuple[Floats, float]:
    """Return equally spaced points along the outline, including the corners of a polygon, and their spacing."""
    if outline.kind == "disk":
        count = max(6, int(np.ceil(outline.surface_area / wanted)))
        angles = 2 * np.pi * np.arange(count) / count
        rim = outline.radius * np.column_stack([libm.cos(angles), libm.sin(angles), np.zeros(count)])
        return rim, outline.surface_area / count
    parts, reached = [], 0.0
    for a, b in zip(outline.vertices, np.roll(outline.vertices, -1, axis=0), strict=True):
        length = float(linear.norm(b - a))
        count = max(1, int(np.ceil(length / wanted)))
        reached = max(reached, length / count)
        parts.append(a + (b - a) * (np.arange(count) / count)[:, None])
    flat = np.concatenate(parts)
    return np.column_stack([flat, np.zeros(len(flat))]), reached
