"""Random moves of control points as others would write them: the peers that the tests of contact are a ratio to.

Both move and turn one grain by a random small step and refuse it where one of its points would be nearer than a
distance to a point of another grain, or lie beyond a wall. One asks SciPy's trees, a tree per shape in
its own frame and all points of a grain in one query for each neighbour; the other keeps the points of all grains in
cells as wide as the distance, with loops that numba compiles.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import kernel
from voxgran._base.lazy import load
from voxgran.geometry.rotation import product, rotation_matrices
from voxgran.packing.control_point.attempts import DECAY, GROWTH
from voxgran.packing.control_point.parameters import SHORTEST_STEP

#: grain, way, axis and half the angle of each attempt, for steps of 1, to the number of accepted ones
Moves = Callable[[Integers, Floats, Floats, Floats], int]


class Grains:
    """Equal grains in a box, as the peers keep them.

    Parameters
    ----------
    points : (m, 3) ndarray of float
        Control points in the frame of the shape.
    position, orientation : (n, 3) and (n, 4) ndarray of float
        Where the grains are; changed by the moves.
    step : (n,) ndarray of float
        Longest way of each grain; it grows and shrinks as in voxgran's walk.
    lower, upper : (3,) ndarray of float
        Corners of the box.
    distance : float
        How near points may come.
    longest : float
        Longest step.
    """

    def __init__(
        self, points: Floats, position: Floats, orientation: Floats, step: Floats, *, lower: Floats, upper: Floats,
        distance: float, longest: float,
    ) -> None:  # fmt: skip
        self.points, self.position, self.orientation = np.asarray(points), position.copy(), orientation.copy()
        self.step, self.longest = step.copy(), longest
        self.lower, self.upper, self.distance = lower, upper, distance
        self.radius = float(np.linalg.norm(self.points, axis=1).max())


def tree_moves(grains: Grains) -> Moves:
    """Return the program that asks SciPy's trees."""
    tree = load("scipy.spatial").cKDTree(grains.points)
    turns = rotation_matrices(grains.orientation)

    def moves(picks: Integers, ways: Floats, axes: Floats, halves: Floats) -> int:
        accepted = 0
        for g, way, axis, unit in zip(picks.tolist(), ways, axes, halves, strict=True):
            step, half = grains.step[g], unit * grains.step[g]
            grains.step[g] = max(step * DECAY, SHORTEST_STEP)
            spin = np.array([np.cos(half), *(np.sin(half) * axis)])
            place, turned = grains.position[g] + step * way, product(spin, grains.orientation[g])
            matrix = rotation_matrices(turned[None])[0]
            world = grains.points @ matrix.T + place
            if (world.min(axis=0) < grains.lower).any() or (world.max(axis=0) > grains.upper).any():
                continue
            far = np.linalg.norm(grains.position - place, axis=1)
            near = np.flatnonzero(far < 2 * grains.radius + grains.distance)
            for j in near[near != g]:
                inner = (world - grains.position[j]) @ turns[j]
                if np.isfinite(tree.query(inner, distance_upper_bound=grains.distance)[0]).any():
                    break
            else:
                grains.position[g], grains.orientation[g], turns[g] = place, turned, matrix
                grains.step[g] = min(step * GROWTH, grains.longest)
                accepted += 1
        return accepted

    return moves


def grid_moves(grains: Grains) -> Moves:
    """Return the program that keeps the points of all grains in cells."""
    matrices = rotation_matrices(grains.orientation)
    many = len(grains.points)
    world = np.einsum("nij,mj->nmi", matrices, grains.points) + grains.position[:, None]
    world = np.ascontiguousarray(world.reshape(-1, 3))
    count = np.floor((grains.upper - grains.lower) / grains.distance).astype(np.int64) + 1
    head, after = np.full(int(count.prod()), -1, dtype=np.int64), np.full(len(world), -1, dtype=np.int64)
    cell = np.clip(np.floor((world - grains.lower) / grains.distance).astype(np.int64), 0, count - 1)
    flat = np.ravel_multi_index(tuple(cell.T), tuple(count))
    for k, where in enumerate(flat.tolist()):
        after[k], head[where] = head[where], k
    kept: tuple[Any, ...] = (grains.points, grains.position, world, flat, head, after, count)
    orientation = grains.orientation

    def moves(picks: Integers, ways: Floats, axes: Floats, halves: Floats) -> int:
        fresh, limits = np.empty((many, 3)), (grains.lower, grains.upper, grains.distance, grains.longest)
        return int(_grid_moves(*kept, orientation, grains.step, fresh, picks, ways, axes, halves, *limits))

    return moves


@kernel
def _grid_moves(  # type: ignore[no-untyped-def]
    points, position, world, flat, head, after, count, orientation, steps, fresh, picks, ways, axes, halves, lower,
    upper, distance, longest,
):  # fmt: skip
    """Make the moves; return how many were accepted."""
    many, accepted = len(points), 0
    for a in range(len(picks)):
        g, step, half = picks[a], steps[picks[a]], halves[a] * steps[picks[a]]
        place = position[g] + step * ways[a]
        steps[g] = max(step * DECAY, SHORTEST_STEP)
        q, sine = orientation[g], np.sin(half)
        s = (np.cos(half), sine * axes[a, 0], sine * axes[a, 1], sine * axes[a, 2])
        w = s[0] * q[0] - s[1] * q[1] - s[2] * q[2] - s[3] * q[3]
        x = s[0] * q[1] + s[1] * q[0] + s[2] * q[3] - s[3] * q[2]
        y = s[0] * q[2] - s[1] * q[3] + s[2] * q[0] + s[3] * q[1]
        z = s[0] * q[3] + s[1] * q[2] - s[2] * q[1] + s[3] * q[0]
        free = True
        for i in range(many):
            p = points[i]
            tx, ty, tz = 2 * (y * p[2] - z * p[1]), 2 * (z * p[0] - x * p[2]), 2 * (x * p[1] - y * p[0])
            fresh[i, 0] = p[0] + w * tx + y * tz - z * ty + place[0]
            fresh[i, 1] = p[1] + w * ty + z * tx - x * tz + place[1]
            fresh[i, 2] = p[2] + w * tz + x * ty - y * tx + place[2]
            for c in range(3):
                free = free and lower[c] <= fresh[i, c] <= upper[c]
            if not free or not _is_free(fresh[i], world, head, after, count, lower, distance, g * many, many):
                free = False
                break
        if free:
            accepted += 1
            position[g], steps[g] = place, min(step * GROWTH, longest)
            orientation[g, 0], orientation[g, 1], orientation[g, 2], orientation[g, 3] = w, x, y, z
            _link_again(world, flat, head, after, count, fresh, lower, distance, g * many)
    return accepted


@kernel
def _is_free(p, world, head, after, count, lower, distance, own, many):  # type: ignore[no-untyped-def]
    """Return whether no point of another grain is near a place."""
    cx, cy, cz = (
        int((p[0] - lower[0]) / distance),
        int((p[1] - lower[1]) / distance),
        int((p[2] - lower[2]) / distance),
    )
    for ix in range(max(cx - 1, 0), min(cx + 2, count[0])):
        for iy in range(max(cy - 1, 0), min(cy + 2, count[1])):
            for iz in range(max(cz - 1, 0), min(cz + 2, count[2])):
                j = head[(ix * count[1] + iy) * count[2] + iz]
                while j >= 0:
                    if j < own or j >= own + many:
                        dx, dy, dz = p[0] - world[j, 0], p[1] - world[j, 1], p[2] - world[j, 2]
                        if dx * dx + dy * dy + dz * dz < distance * distance:
                            return False
                    j = after[j]
    return True


@kernel
def _link_again(world, flat, head, after, count, fresh, lower, distance, own):  # type: ignore[no-untyped-def]
    """Move the points of a grain to their new cells."""
    for i in range(len(fresh)):
        k = own + i
        j = head[flat[k]]
        if j == k:
            head[flat[k]] = after[k]
        else:
            while after[j] != k:
                j = after[j]
            after[j] = after[k]
        cell = 0
        for c in range(3):
            world[k, c] = fresh[i, c]
            cell = cell * count[c] + min(int((fresh[i, c] - lower[c]) / distance), count[c] - 1)
        flat[k] = cell
        after[k] = head[cell]
        head[cell] = k
