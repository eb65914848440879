"""Depth of deep overlaps by a search, with a relative error of about 0.001.

The deepest point of a shallow overlap lies on a surface and is found exactly elsewhere. That of a deep overlap may lie
in the interior, where a grain is thickest; the search starts from a lattice of points and improves the best of them.
"""

from collections.abc import Callable
from itertools import product
from typing import TypeAlias

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, Integers
from voxgran.geometry.rotation import rotation_matrices

#: signed distance of points to the surface of a grain, positive inside
Inner: TypeAlias = Callable[[Floats], Floats]

LATTICE = 9
STARTS = 2
#: step at which the search ends, as a fraction of the extent
SMALL = 2e-4


def deepest_point(one: Inner, other: Inner, low: Floats, high: Floats) -> tuple[float, Floats, bool]:
    """Return depth, (3,) point and whether the depth is that in `one`, for the deepest common point of two grains.

    The box from `low` to `high` contains the overlap; it is flat in z in two dimensions. The depth is 0 if no common
    point is found.
    """
    best, where, in_one = 0.0, (low + high) / 2, True
    extent = high - low
    if not (extent >= 0).all() or not extent.any():
        return best, where, in_one
    counts = np.where(extent > 0, LATTICE, 1)
    ticks = [a + (np.arange(n) + 0.5) / n * (b - a) for a, b, n in zip(low, high, counts, strict=True)]
    lattice = np.array(list(product(*ticks)))
    stencils = [stencil * extent / LATTICE for stencil in _stencils(counts)]
    for deep, bound in ((one, other), (other, one)):
        values = _common(deep, bound, lattice)
        for start in np.argsort(-values, kind="stable")[:STARTS]:
            if values[start] < 0:
                break
            point, depth = _climb(deep, bound, lattice[start], values[start], stencils)
            if depth > best:
                best, where, in_one = depth, point, deep is one
    return best, where, in_one


def _common(deep: Inner, bound: Inner, points: Floats) -> Floats:
    """Return the signed distances in a grain of points that lie in the other; minus infinity elsewhere."""
    values = np.full(len(points), -np.inf)
    inside = bound(points) >= 0
    values[inside] = deep(points[inside])
    return values


def _stencils(counts: Integers) -> list[Floats]:
    """Return two sets of steps in many directions, one rotated relative to the other."""
    steps = [(-1.0, -0.5, 0.0, 0.5, 1.0) if n > 1 else (0.0,) for n in counts]
    stencil = np.array([step for step in product(*steps) if any(step)])
    half = 0.4
    about = np.array([0.48, 0.6, 0.64]) if counts[2] > 1 else np.array([0.0, 0.0, 1.0])
    turn = rotation_matrices(np.array([[libm.cos(half), *(libm.sin(half) * about)]]))[0]
    return [stencil, linear.matmul(stencil, turn.T)]


def _climb(deep: Inner, bound: Inner, point: Floats, depth: float, stencils: list[Floats]) -> tuple[Floats, float]:
    """Move to the deepest neighbour inside the other grain, with decreasing steps."""
    size, failed = 1.0, 0
    while size > SMALL * LATTICE:
        around = point + size * stencils[failed]
        values = _common(deep, bound, around)
        best = int(values.argmax())
        if values[best] > depth:
            point, depth, failed = around[best], float(values[best]), 0
        elif failed + 1 < len(stencils):
            failed += 1
        else:
            size, failed = size / 2, 0
    return point, depth
