"""The largest sphere inside of a shape (in 2D, the largest circle)."""

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.lazy import load
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive

#: points along the longest edge of the first lattice, and lattices, each of half the step of the one before
POINTS, LEVELS = 12, 15
#: cells that are kept of each lattice at the most, the deepest ones
KEPT = 60
#: difference of the volumes of a shape and its convex hull, relative, up to which it counts as convex
CONVEX = 1e-9


def inscribed_radius(shape: Shape) -> float:
    """Return the radius of the largest sphere (in 2D, the largest circle) inside of a shape; NaN for an open surface.

    Solids in closed form have closed formulas, convex ones are a linear program. For others cells of a lattice are
    bisected as long as the depth at their center and half of their diagonal exceed the largest depth that is known, to
    a hundred-thousandth of the size.
    """
    if shape.is_open:
        return float("nan")
    geometry = shape.geometry
    if shape.is_sphere:
        return float(shape.bounding_radius)
    if isinstance(geometry, Primitive):
        return _of_primitive(geometry)
    axes = shape.dimension
    hull = load("scipy.spatial").ConvexHull(shape.vertices[:, :axes])
    if hull.volume <= shape.volume * (1 + CONVEX):
        return _of_hull(hull.equations)
    low, high = shape.bounds[0, :axes], shape.bounds[1, :axes]
    counts = np.ceil(POINTS * (high - low) / (high - low).max()).astype(int)
    half = (high - low) / counts / 2
    places = low + (2 * np.indices(counts).reshape(axes, -1).T + 1) * half
    children = 2 * np.indices((2,) * axes).reshape(axes, -1).T - 1
    best = 0.0
    for level in range(LEVELS):
        if level:
            half = half / 2
            places = (places[:, None] + children * half).reshape(-1, axes)
        depth = _depths(shape, places)
        best = max(best, float(depth.max()))
        order = np.argsort(-depth, kind="stable")[:KEPT]
        places = places[order[depth[order] + np.linalg.norm(half) > best]]
    return best


def _of_hull(equations: Floats) -> float:
    """Return the radius of the largest sphere inside of half-spaces n x + d <= 0 with unit normals, rows (n, d)."""
    unknowns = equations.shape[1]
    # the center and the radius r, which is maximized, with n x + r <= -d
    limits = np.column_stack([equations[:, :-1], np.ones(len(equations))])
    bounds = [(None, None)] * (unknowns - 1) + [(0.0, None)]
    found = load("scipy.optimize").linprog(-np.eye(unknowns)[-1], A_ub=limits, b_ub=-equations[:, -1], bounds=bounds)
    return float(found.x[-1])


def _depths(shape: Shape, places: Floats) -> Floats:
    """Return the distances of points from the surface, negative outside."""
    flat = np.zeros((len(places), 3))
    flat[:, : places.shape[1]] = places
    return -shape.signed_distance(flat)


def _of_primitive(geometry: Primitive) -> float:
    """Return the radius of the largest sphere in a solid in closed form."""
    d = geometry.dimensions
    if geometry.kind == "box":
        return min(d) / 2
    if geometry.kind == "cylinder":
        return min(d[0], d[1] / 2)
    if geometry.kind == "cone":
        return d[0] * d[1] / (d[0] + float(np.hypot(d[0], d[1])))
    return min(d)
