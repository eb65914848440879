"""Largest distance of the points of grains from a given point, in closed form for all shapes but ellipsoids."""

import math

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel
from voxgran.contacts.assembly import Assembly
from voxgran.contacts.parts import has_parts, parts_of
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.surface import Surface

#: number of bisections after which the bracket of a root has the width of one bit
HALVINGS = 200


def farthest_reach(assembly: Assembly, origin: Floats) -> Floats:
    """Return the largest distance (n,) of any point of each grain, in three dimensions, from a (3,) point."""
    reach = np.zeros(assembly.count)
    for shape, item in enumerate(assembly.shapes):
        grains = np.flatnonzero(assembly.shape_id == shape)
        # the point in the body frame of each grain, at unit scale
        away = np.einsum("gji,gj->gi", assembly.matrices[grains], assembly.position[grains] - origin)
        away /= assembly.scale[grains, None]
        geometry = item.geometry
        if isinstance(geometry, Primitive) and geometry.kind != "sphere":
            reach[grains] = _of_primitive(geometry, away @ geometry.matrix) * assembly.scale[grains]
        elif has_parts(geometry):
            reach[grains] = _of_spheres(assembly, grains, away)
        else:
            assert isinstance(geometry, Mesh | Surface)
            reach[grains] = [np.linalg.norm(geometry.vertices + p, axis=1).max() for p in away]
            reach[grains] *= assembly.scale[grains]
    return reach


def _of_spheres(assembly: Assembly, grains: Integers, away: Floats) -> Floats:
    """Return the largest distance of the points of one sphere or of several."""
    parts = parts_of([assembly.shapes[assembly.shape_id[grains[0]]].geometry]) if len(grains) else None
    found = np.zeros(len(grains))
    if parts is not None:
        for center, margin in zip(parts.center, parts.margin, strict=True):
            found = np.maximum(found, np.linalg.norm(away + center, axis=1) + margin)
    return found * assembly.scale[grains]


def _of_primitive(solid: Primitive, away: Floats) -> Floats:
    """Return the largest distance for a convex solid whose centroid is at (n, 3) positions, in its body axes."""
    d = solid.dimensions
    if solid.kind == "ellipsoid":
        return _of_ellipsoid(np.array(d), np.abs(away))
    if solid.kind == "box":
        return np.asarray(np.linalg.norm(np.abs(away) + np.array(d) / 2, axis=1))
    # the farthest point of a ring lies on the side away from the point
    flat = np.hypot(away[:, 0], away[:, 1])
    if solid.kind == "cylinder":
        return np.asarray(np.hypot(flat + d[0], np.abs(away[:, 2]) + d[1] / 2))
    return np.maximum(np.hypot(flat + d[0], away[:, 2] - d[1] / 4), np.hypot(flat, away[:, 2] + 0.75 * d[1]))


def _of_ellipsoid(axes: Floats, away: Floats) -> Floats:
    r"""Return the largest \|away + axes * u\| over unit vectors u, for places without negative coordinates.

    With a multiplier m the farthest u is axes * away / (m - axes ** 2), where m is the root above the largest
    axes ** 2 at which u has length 1; if there is none, the remainder of u points along the longest axis.
    """
    squares, lever = axes**2, axes * away
    top = squares.max()
    low = np.full(len(away), top)
    high = top + np.linalg.norm(lever, axis=1) + 1e-300
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        short = _length(lever, middle, squares) <= 1.0
        low, high = np.where(short, low, middle), np.where(short, middle, high)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = np.where(lever > 0, lever / (high[:, None] - squares), 0.0)
    longest = int(squares.argmax())
    rest = 1.0 - (u**2).sum(axis=1) + u[:, longest] ** 2
    u[:, longest] = np.sqrt(np.maximum(rest, 0.0))
    return np.asarray(np.linalg.norm(away + axes * u, axis=1))


def _length(lever: Floats, multiplier: Floats, squares: Floats) -> Floats:
    """Return the length of the vector for a multiplier; infinite at a pole."""
    with np.errstate(divide="ignore", invalid="ignore"):
        parts = np.where(lever > 0, lever / (multiplier[:, None] - squares), 0.0)
    return np.asarray(np.linalg.norm(parts, axis=1))


@bare_kernel
def farthest_of_row(row: Floats, x: float, y: float, z: float) -> float:
    """Return the largest distance from the origin of an ellipsoid, cylinder or cone centered at (x, y, z).

    row: of :mod:`voxgran.geometry.support`. The formulas are those of :func:`farthest_reach`.
    """
    a, b, c = row[1], row[2], row[3]
    u = row[4] * x + row[7] * y + row[10] * z
    v = row[5] * x + row[8] * y + row[11] * z
    w = row[6] * x + row[9] * y + row[12] * z
    flat = math.sqrt(u * u + v * v) + a
    if row[0] == 3.0:
        tall = abs(w) + 0.5 * b
        return math.sqrt(flat * flat + tall * tall)
    if row[0] == 4.0:
        base, apex = w - 0.25 * b, w + 0.75 * b
        return math.sqrt(max(flat * flat + base * base, (flat - a) ** 2 + apex * apex))
    top = max(a, b, c) ** 2
    p, q, r = a * abs(u), b * abs(v), c * abs(w)
    low, high = top, top + math.sqrt(p * p + q * q + r * r) + 1e-300
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if _square_for(p, middle - a * a) + _square_for(q, middle - b * b) + _square_for(r, middle - c * c) <= 1.0:
            high = middle
        else:
            low = middle
    p, q, r = math.sqrt(_square_for(p, high - a * a)), math.sqrt(_square_for(q, high - b * b)), 0.0
    r = math.sqrt(_square_for(c * abs(w), high - c * c))
    # what is left of the unit vector points along the longest axis
    rest = max(1.0 - p * p - q * q - r * r, 0.0)
    if a * a == top:
        p = math.sqrt(p * p + rest)
    elif b * b == top:
        q = math.sqrt(q * q + rest)
    else:
        r = math.sqrt(r * r + rest)
    return math.sqrt((abs(u) + a * p) ** 2 + (abs(v) + b * q) ** 2 + (abs(w) + c * r) ** 2)


@bare_kernel
def _square_for(lever, distance):  # type: ignore[no-untyped-def]
    """Return the square of a component of the vector for a multiplier; infinite at a pole."""
    return (lever / distance) ** 2 if lever > 0.0 else 0.0
