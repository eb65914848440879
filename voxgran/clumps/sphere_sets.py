"""Spheres refined against points: the union's signed distance, one damped least-squares step per sphere, best inserts.

The signed distance of a point from a union of spheres is taken as the smallest distance from a sphere, which one sphere
alone, the owner of the point, decides. Residuals of points therefore belong to one sphere each, the normal equations
fall apart into one of four unknowns a sphere, and a step costs no more than the distances.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.kernels import kernel
from voxgran._base.lazy import load

#: kinds of points: on the surface (distance 0), inside (at most 0) and outside (at least 0)
SURFACE, INSIDE, OUTSIDE = 0, 1, 2
#: Levenberg-Marquardt: first damping, its least and largest value, and factors after success and failure
DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-2, 1e-4, 10.0
CALMER, STIFFER = 0.7, 2.0
#: longest first step, and its factor after a failure
STEP, SHORTER = 0.15, 0.8
#: relative gain below which a step counts as idle, and the number of idle steps that end a refinement
LEAST_GAIN, IDLE = 1e-4, 4
#: number of points at the most by which spheres to add are chosen
CHOOSING = 4_000
#: relative loss at which the best spheres so far are taken up again
LOSS = 0.02
#: number of points that share a list of near spheres, and part of a distance by which lists are longer than needed
TOGETHER, ROUNDING = 16, 1e-9


class Groups(NamedTuple):
    """Points that lie together.

    order: (n,) points, one group after the other.  first: (m + 1,) where each begins.  places: (n, 3) in this order.
    middle: (m, 3) and reach: (m,) spheres that hold them.
    """

    order: Integers
    first: Integers
    places: Floats
    middle: Floats
    reach: Floats

    @classmethod
    def of(cls, places: Floats) -> "Groups":
        """Divide points (n, 3) into groups of nearly equal numbers that lie together."""
        tree = load("scipy.spatial").cKDTree(places, leafsize=TOGETHER)
        # halves of halves are the leaves of the tree
        parts = 2 ** max(0, int(np.ceil(libm.log2(max(1, len(places)) / TOGETHER))))
        first = np.linspace(0, len(places), parts + 1).astype(np.int64)
        inside = places[tree.indices]
        low, high = (ufunc.reduceat(inside, first[:-1], axis=0) for ufunc in (np.minimum, np.maximum))
        middle = (low + high) / 2
        away = linear.norm(inside - np.repeat(middle, np.diff(first), axis=0), axis=1)
        return cls(tree.indices.astype(np.int64), first, inside, middle, np.maximum.reduceat(away, first[:-1]))


@dataclass(frozen=True, eq=False)
class Points:
    """Points that a union of spheres is fitted to."""

    places: Floats  # (n, 3)
    kind: Integers  # (n,) SURFACE, INSIDE or OUTSIDE
    weight: Floats  # (n,)

    def joined(self, places: Floats, kind: int, weight: Floats) -> "Points":
        """Return the points with others of one kind added."""
        return Points(
            np.concatenate([self.places, places]),
            np.concatenate([self.kind, np.full(len(places), kind)]),
            np.concatenate([self.weight, weight]),
        )

    @cached_property
    def groups(self) -> Groups:
        """The points as groups of those that lie together, for which near spheres are listed together."""
        return Groups.of(self.places)

    def gaps(self, spheres: "SphereSet") -> tuple[Floats, Integers]:
        """Return the distance of each point from the nearest sphere, negative inside, and that sphere."""
        gap, owner = np.full(len(self.places), np.inf), np.zeros(len(self.places), dtype=np.int64)
        if len(self.places):
            _find_gaps_of_groups(self.groups, *_contiguous(spheres.centers, spheres.radii), gap, owner)
        return gap, owner


@dataclass(frozen=True, eq=False)
class SphereSet:
    """Spheres while they are fitted; any number, also none."""

    centers: Floats  # (n, 3)
    radii: Floats  # (n,)

    def __len__(self) -> int:
        return len(self.radii)

    def taken(self, chosen: Integers | Booleans) -> "SphereSet":
        """Return some of the spheres, by index or mask."""
        return SphereSet(np.ascontiguousarray(self.centers[chosen]), self.radii[chosen])

    def joined(self, other: "SphereSet") -> "SphereSet":
        """Return the spheres of both."""
        return SphereSet(np.concatenate([self.centers, other.centers]), np.concatenate([self.radii, other.radii]))


@dataclass(frozen=True, kw_only=True)
class Rules:
    """What a refinement minimizes, the sum of weight times (r^2 + width^2)^(power / 2), and what it keeps to."""

    power: float = 1.0
    width: float = 0.003
    outside: float = 1.0  # factor of residuals of the surface where it lies outside of the union (not covered)
    inside: float = 1.0  # and where it lies inside (the union protrudes)
    least: float = 0.0  # smallest radius
    most: float = np.inf  # largest radius
    equal: bool = False  # all radii are equal


def union_gaps(places: Floats, centers: Floats, radii: Floats) -> tuple[Floats, Integers]:
    """Return the distance of (n, 3) points from the nearest of the spheres, negative inside, and that sphere."""
    gap, owner = np.full(len(places), np.inf), np.zeros(len(places), dtype=np.int64)
    _find_gaps(*_contiguous(places, centers, radii), np.full(len(places), -1), gap, owner)
    return gap, owner


def _contiguous(*arrays: Floats) -> tuple[Floats, ...]:
    """Return arrays as kernels take them."""
    return tuple(np.array(array, order="C") for array in arrays)


def refined(points: Points, spheres: SphereSet, rules: Rules, steps: int) -> SphereSet:
    """Return the spheres after at most so many Levenberg-Marquardt steps with weights for the power of the residuals.

    The best spheres found are returned; they are never worse than those given.
    """
    if not len(spheres):
        return spheres
    gap, owner = points.gaps(spheres)
    best, least = spheres, _cost(points, gap, rules)
    damping, step, idle = DAMPING, STEP, 0
    for _ in range(steps):
        spheres = _stepped(points, spheres, gap, owner, rules, damping, step)
        gap, owner = points.gaps(spheres)
        cost = _cost(points, gap, rules)
        idle = idle + 1 if cost > (1.0 - LEAST_GAIN) * least else 0
        if cost < least:
            best, least = spheres, cost
            damping = max(damping * CALMER, LEAST_DAMPING)
        else:
            damping, step = min(damping * STIFFER, MOST_DAMPING), step * SHORTER
            if cost > (1.0 + LOSS) * least:
                spheres = best
                gap, owner = points.gaps(best)
        if idle > IDLE:
            break
    return best


def best_inserts(points: Points, spheres: SphereSet, pool: SphereSet, count: int) -> SphereSet:
    """Return the candidates that lower the sum of weighted distances most, one after the other; fewer if none does.

    Some of the points stand for all of them.
    """
    if not len(pool):
        return pool
    some = np.flatnonzero(points.kind != OUTSIDE)
    some = some[:: max(1, len(some) // CHOOSING)]
    places, kind, weight = np.ascontiguousarray(points.places[some]), points.kind[some], points.weight[some]
    # without spheres a point is as far as the body is wide
    gap = np.minimum(union_gaps(places, spheres.centers, spheres.radii)[0], 1.0)
    chosen = np.full(count, -1)
    _choose_inserts(places, kind, weight, gap, pool.centers, pool.radii, chosen)
    return pool.taken(chosen[chosen >= 0])


def without_cheapest(points: Points, spheres: SphereSet, count: int) -> SphereSet:
    """Return the spheres without so many whose points are nearly as near to others."""
    gap, owner = points.gaps(spheres)
    second = np.full(len(gap), np.inf)
    _find_gaps(points.places, spheres.centers, spheres.radii, owner, second, np.zeros_like(owner))
    rules = Rules()
    loss = points.weight * (np.abs(_residuals(points, second, rules)[0]) - np.abs(_residuals(points, gap, rules)[0]))
    total = np.bincount(owner, loss, len(spheres))
    return spheres.taken(np.sort(np.argsort(total, kind="stable")[count:]))


def _residuals(points: Points, gap: Floats, rules: Rules) -> tuple[Floats, Floats]:
    """Return the residuals of the points and the weights with which they count."""
    residual = np.where(points.kind == INSIDE, np.maximum(gap, 0.0), gap)
    residual = np.where(points.kind == OUTSIDE, np.minimum(gap, 0.0), residual)
    on = points.kind == SURFACE
    return residual, points.weight * np.where(on & (gap > 0), rules.outside, np.where(on, rules.inside, 1.0))


def _cost(points: Points, gap: Floats, rules: Rules) -> float:
    """Return what a refinement minimizes."""
    residual, weight = _residuals(points, gap, rules)
    costs = libm.power(residual**2 + rules.width**2, rules.power / 2) - rules.width**rules.power
    return float((weight * costs).sum())


def _stepped(
    points: Points, spheres: SphereSet, gap: Floats, owner: Integers, rules: Rules, damping: float, step: float
) -> SphereSet:
    """Return the spheres after one damped step of each."""
    residual, weight = _residuals(points, gap, rules)
    weight = weight * libm.power(residual**2 + rules.width**2, rules.power / 2 - 1)
    matrix, slope = np.zeros((len(spheres), 4, 4)), np.zeros((len(spheres), 4))
    _add_normal_equations(points.places, residual, weight, owner, spheres.centers, matrix, slope)
    size = matrix[:, 3, 3] + 1e-300
    matrix += (damping * size)[:, None, None] * np.eye(4)
    if rules.equal:
        # the radius is common to all: its own equation, and those of the centers for that radius
        common = -slope[:, 3].sum() / matrix[:, 3, 3].sum()
        slope = slope + matrix[:, :, 3] * common
        move = np.zeros((len(spheres), 4))
        move[:, :3] = linear.solve(matrix[:, :3, :3], -slope[:, :3, None])[:, :, 0]
        move[:, 3] = common
    else:
        move = np.asarray(linear.solve(matrix, -slope[:, :, None])[:, :, 0])
    length = linear.norm(move, axis=1, keepdims=True)
    move *= np.minimum(1.0, step / np.maximum(length, 1e-300))
    if rules.equal:
        move[:, 3] = move[:, 3].mean()
    return SphereSet(spheres.centers + move[:, :3], np.clip(spheres.radii + move[:, 3], rules.least, rules.most))


@kernel
def _find_gaps(places, centers, radii, other, gap, owner):  # type: ignore[no-untyped-def]
    """Fill `gap` with the smallest signed distance from a sphere but `other`, and `owner` with the sphere's index."""
    for p in range(len(places)):
        for s in range(len(radii)):
            dx, dy, dz = places[p, 0] - centers[s, 0], places[p, 1] - centers[s, 1], places[p, 2] - centers[s, 2]
            square, reach = dx * dx + dy * dy + dz * dz, gap[p] + radii[s]
            # the root is taken only where the sphere is nearer than all before
            if s != other[p] and reach > 0.0 and square < reach * reach:
                gap[p], owner[p] = np.sqrt(square) - radii[s], s


@kernel
def _find_gaps_of_groups(groups, centers, radii, gap, owner):  # type: ignore[no-untyped-def]
    """Fill `gap` and `owner` as `_find_gaps` does, with the spheres that may be nearest to points of each group.

    The distance from a sphere changes by no more than the way to another point. A sphere that is farther from the
    middle than the nearest one by the diameter of the group is therefore nearest to none of its points.
    """
    away, near = np.empty(len(radii)), np.empty(len(radii), dtype=np.int64)
    for g in range(len(groups.reach)):
        least, x, y, z = np.inf, groups.middle[g, 0], groups.middle[g, 1], groups.middle[g, 2]
        for s in range(len(radii)):
            dx, dy, dz = x - centers[s, 0], y - centers[s, 1], z - centers[s, 2]
            away[s] = np.sqrt(dx * dx + dy * dy + dz * dz) - radii[s]
            least = min(least, away[s])
        most = least + 2.0 * groups.reach[g] + ROUNDING * (1.0 + abs(least))
        many = 0
        for s in range(len(radii)):
            near[many] = s
            many += away[s] <= most
        for p in range(groups.first[g], groups.first[g + 1]):
            x, y, z = groups.places[p, 0], groups.places[p, 1], groups.places[p, 2]
            best, nearest = np.inf, 0
            for k in range(many):
                s = near[k]
                dx, dy, dz = x - centers[s, 0], y - centers[s, 1], z - centers[s, 2]
                square, reach = dx * dx + dy * dy + dz * dz, best + radii[s]
                if reach > 0.0 and square < reach * reach:
                    best, nearest = np.sqrt(square) - radii[s], s
            gap[groups.order[p]], owner[groups.order[p]] = best, nearest


@kernel
def _gain(places, kind, weight, gap, center, radius, clear):  # type: ignore[no-untyped-def]
    """Return what a sphere takes from the sum of weighted distances; if `clear`, they change to those with it."""
    total = 0.0
    for p in range(len(places)):
        reach = gap[p] + radius
        if reach <= 0.0:
            continue
        dx, dy, dz = places[p, 0] - center[0], places[p, 1] - center[1], places[p, 2] - center[2]
        square = dx * dx + dy * dy + dz * dz
        if square >= reach * reach:
            continue
        after = np.sqrt(square) - radius
        if kind[p] == 0:
            total += weight[p] * (abs(gap[p]) - abs(after))
        else:
            total += weight[p] * (max(gap[p], 0.0) - max(after, 0.0))
        if clear:
            gap[p] = after
    return total


@kernel
def _choose_inserts(places, kind, weight, gap, centers, radii, chosen):  # type: ignore[no-untyped-def]
    """Fill `chosen` with the spheres of largest gain, one after the other; a former gain is a bound of the present."""
    bound = np.empty(len(radii))
    for s in range(len(radii)):
        bound[s] = _gain(places, kind, weight, gap, centers[s], radii[s], False)
    for k in range(len(chosen)):
        best = bound.argmax()
        gain = _gain(places, kind, weight, gap, centers[best], radii[best], False)
        while gain < bound[best]:
            bound[best] = gain
            best = bound.argmax()
            gain = _gain(places, kind, weight, gap, centers[best], radii[best], False)
        if gain <= 0.0:
            break
        chosen[k] = best
        bound[best] = 0.0
        _gain(places, kind, weight, gap, centers[best], radii[best], True)


@kernel
def _add_normal_equations(places, residual, weight, owner, centers, matrix, slope):  # type: ignore[no-untyped-def]
    """Add to matrix (n, 4, 4) and slope (n, 4) the normal equations of each sphere's residuals."""
    for p in range(len(places)):
        if residual[p] == 0.0:
            continue
        s, w = owner[p], weight[p]
        dx, dy, dz = centers[s, 0] - places[p, 0], centers[s, 1] - places[p, 1], centers[s, 2] - places[p, 2]
        length = np.sqrt(dx * dx + dy * dy + dz * dz) + 1e-300
        row = (dx / length, dy / length, dz / length, -1.0)
        for a in range(4):
            slope[s, a] += w * row[a] * residual[p]
            for b in range(4):
                matrix[s, a, b] += w * row[a] * row[b]
