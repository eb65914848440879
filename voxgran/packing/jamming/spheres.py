"""Spheres and disks that grow until they meet their sizes or jam: soft repulsion, relaxed by FIRE.

Spheres at random points are given the sizes at which they slightly overlap however they lie, and the energy of their
overlaps is minimized. At sizes that leave room it falls until no sphere overlaps another at its wanted size. Where it
does not, the spheres are jammed: sizes are reduced by a common factor to the point at which the square root of the
energy, extrapolated from the last two sizes, would vanish, and relaxed again, until overlaps are a few ten-thousandths
of the sizes. A last common factor parts the deepest pair exactly.

References
----------
O'Hern, Silbert, Liu & Nagel 2003, Jamming at zero temperature and zero applied stress: the epitome of disorder,
Physical Review E 68, 011306, doi:10.1103/PhysRevE.68.011306.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, Integers
from voxgran._base.checkpoint import Declared, Held
from voxgran.contacts.assembly import Assembly
from voxgran.containers.kernel_container import kernel_container
from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.rectangle import Rectangle
from voxgran.containers.model import Container, boundary_of, tilt_of, within_periods
from voxgran.geometry.level_grid import level_cells
from voxgran.packing.jamming.coordination import NearPairs
from voxgran.packing.jamming.expected import reachable
from voxgran.packing.jamming.soft_kernels import (
    DEPTH,
    ENERGY,
    FIRST_MIXING,
    FIRST_STEP,
    MIXING,
    NUMBERS,
    RESIDUAL,
    STEP,
    UPHILL_FREE,
    PairList,
    Relaxation,
    image_shifts,
    list_pairs,
    push_spheres,
    relax_spheres,
)
from voxgran.shapes.mesh import Mesh

#: share of its radius by which a sphere may move before pairs are listed again
FREE = 0.25
#: largest factor on the sizes in a checkpoint
LARGEST = 100.0
#: largest relative depth of overlaps at the end of a compression
DEEPEST = 1e-4
#: residual force, in mean contact forces, at which MANY spheres and more are at rest, and at which few are; and the
#: most iterations at one size
CALM, CALMEST, MANY, ROUND = 0.03, 3e-3, 10_000, 3000
#: solid fraction by which spheres begin beyond where they are expected to jam, and relative growth of those with room
BEYOND, ROOMIER = 0.1, 0.02
#: first reduction of the sizes, the largest one, and the share of the distance from jamming that is kept
FIRST_LESS, MOST_LESS, KEPT = 0.005, 0.01, 0.1
#: growth of spheres that are not jammed, and depth below which those that do not come to rest count as such
MORE, LOOSE = 0.004, 1e-3
#: iterations of all spheres together in a step, at most so many of each, and rounds of a run
WORK, MOST_ITERATIONS, ROUNDS = 1_000_000, 50, 40
#: gaps, in mean diameters, at which coordination numbers are reported
GAPS = (1e-4, 1e-3, 1e-2, 1e-1)
#: share of the diameter over which the direction of a wall is found from distances
NUDGE = 1e-6


class SoftSpheres:
    """Compressor of spheres and disks: see :class:`voxgran.packing.jamming.method.Compressor`.

    Attributes
    ----------
    size : float
        Factor on the sizes of the assembly at which the spheres are relaxed.
    """

    def __init__(self, assembly: Assembly, *, jam: bool, seed: int) -> None:
        del seed
        self.assembly, self.jam = assembly, jam
        self.dimension, self.container = assembly.dimension, assembly.container
        radii = assembly.bounding_radii
        self.order = _near_order(assembly.position, radii, self.container.bounds)
        self.radii: Floats = np.ascontiguousarray(radii[self.order])
        self.known = _is_known(self.container)
        self.walls = kernel_container(self.container if self.known else _bounds_of(self.container))
        n = assembly.count
        # large spheres touch many small ones: with masses by surface, all have vibrations of one period
        self.lightness: Floats = np.ones(n)
        if n:
            self.lightness = 1.0 / np.maximum(libm.power(self.radii / self.radii.mean(), self.dimension - 1), 1.0)
        self.ended, self.done_steps, self.jams = n == 0, 0, False
        self.iterations = max(1, min(MOST_ITERATIONS, WORK // max(n, 1)))
        self.most_steps = ROUNDS * -(-ROUND // self.iterations)
        self.in_round, self.calm = 0, max(CALMEST, CALM * min(1.0, n / MANY))
        self.size = self._first_size() if n else 1.0
        self.strict = 1.0
        # the last size at which spheres were jammed and the root of the energy there; 0 before
        self.earlier = np.zeros(2)
        self.spheres: Floats = np.column_stack([assembly.position[self.order], self.radii * self.size])
        self.velocity, self.force = np.zeros((n, 3)), np.zeros((n, 3))
        self.numbers = np.zeros(NUMBERS)
        self.listed = self.spheres.copy()
        self._pairs: PairList | None = None
        self._beyond: Floats | None = None
        if n:
            self._calm_down()
            self._list()
            self._push()

    def _first_size(self) -> float:
        """Return the factor on the sizes at which the spheres are relaxed first."""
        filled = float(self.assembly.volumes.sum()) / self.container.volume
        dense = reachable(2.0 * self.radii, self.dimension) + BEYOND
        factor = (dense / filled) ** (1.0 / self.dimension)
        return float(factor if self.jam else min(factor, 1.0 + ROOMIER))

    @property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """Arrays of the state."""
        own = {"spheres": self.spheres, "velocity": self.velocity, "force": self.force, "listed": self.listed}
        return {**own, "numbers": self.numbers, "earlier": self.earlier, "size": np.array([self.size, self.strict])}

    @property
    def counters(self) -> dict[str, int]:
        """Whole numbers of the state."""
        return {"steps": self.done_steps, "in_round": self.in_round, "ended": int(self.ended), "jammed": int(self.jams)}

    @property
    def declared(self) -> Declared:
        """What a checkpoint may hold."""
        bounds = np.array(self.container.bounds)
        far = 3.0 * np.abs(bounds).max(initial=1.0)
        spheres = Held([-far, -far, -far, 0.0], [far, far, far, LARGEST * float(self.radii.max(initial=1.0))])
        counts = dict.fromkeys(("steps", "in_round"), Held(0, ROUND * ROUNDS))
        own = {"spheres": spheres, "listed": spheres, "numbers": Held(high=math.inf), "size": Held(1e-9, LARGEST)}
        return {**own, **counts, **dict.fromkeys(("ended", "jammed"), Held(0, 1))}

    rule = None

    def restore(self, arrays: Mapping[str, NDArray[Any]], counters: Mapping[str, int]) -> None:
        """Take over the state of a checkpoint."""
        for name in ("spheres", "velocity", "force", "listed", "numbers", "earlier"):
            setattr(self, name, np.array(arrays[name], dtype=np.float64))
        self.size, self.strict = (float(value) for value in arrays["size"])
        self.done_steps, self.in_round = int(counters["steps"]), int(counters["in_round"])
        self.ended, self.jams = bool(counters["ended"]), bool(counters["jammed"])
        # pairs are listed as they were, from where the spheres were then
        self._pairs = self._beyond = None

    @property
    def factor(self) -> float:
        """Common factor on the sizes at which nothing overlaps."""
        return self.strict

    @property
    def report(self) -> dict[str, Any]:
        """Numbers of the run, and contacts of the spheres that are jammed."""
        iterations = self.done_steps * self.iterations
        found: dict[str, Any] = {
            "iterations": iterations,
            "overlap": float(self.numbers[DEPTH]),
            "jammed": float(self.jams),
        }
        if not self.jams:
            return found
        near = self._near()
        gaps = [gap * 2.0 * self.strict * float(self.radii.mean()) for gap in GAPS]
        # pairs that overlapped before the last factor have gaps up to their overlap
        own = max(gaps[0], 2.0 * self.strict * float(self.radii.max() * self.numbers[DEPTH]))
        mean, rattlers = near.held(own)
        return {
            **found,
            "contact_gap": own,
            "coordination_without_rattlers": mean,
            "rattlers": rattlers,
            "gaps": list(GAPS),
            "coordination": [float(near.numbers(gap).mean()) for gap in gaps],
        }

    def _near(self) -> NearPairs:
        """Return pairs of spheres, and spheres at walls, that are near each other, at the final sizes."""
        self._list()
        assert self._pairs is not None
        pairs, at = self._pairs, self.spheres[:, :3]
        i = np.repeat(np.arange(len(at)), np.diff(pairs.first))
        j, image = (values[: len(i)].astype(np.int64) for values in (pairs.other, pairs.image))
        radii = self.radii * self.strict
        gap = linear.norm(at[j] + pairs.shift[image] - at[i], axis=1) - radii[i] - radii[j]
        wall = pairs.near_wall
        wall_gap = -np.asarray(self.container.signed_distance(at[wall])) - radii[wall]
        return NearPairs(len(at), self.dimension, i, j, gap, wall, wall_gap)

    def poses(self) -> tuple[Floats, Floats]:
        """Return positions (n, 3), within the periodic lengths, and orientations (n, 4), as given."""
        position = np.empty((len(self.order), 3))
        position[self.order] = self._wrapped()
        return position, self.assembly.orientation

    def step(self) -> None:
        """Make some iterations of FIRE, and change the sizes where the spheres are at rest."""
        goal = 1.0 - 1.0 / self.size if not self.jam and self.size > 1.0 else 0.0
        left = min(self.iterations, ROUND - self.in_round)
        while left > 0:
            if self._pairs is None:
                self._pairs = self._listing()
            beyond, many = self._walls_near(), left if self.known else 1
            soft = Relaxation(self.spheres, self.velocity, self.force, self.lightness, self.listed, self.numbers)
            made = relax_spheres(soft, self._pairs, self.walls, beyond, FREE, many, goal, self.calm)
            left -= made
            self.in_round += made
            if self.numbers[RESIDUAL] < 0.0:
                self._list()
            if self.numbers[RESIDUAL] < 0.0 or not self.known:
                self._push()
            rest = 0.0 <= self.numbers[RESIDUAL] < self.calm
            if rest or self.numbers[DEPTH] <= goal:
                break
        self.done_steps += 1
        self._look(goal)

    def _look(self, goal: float) -> None:
        """End the run where its aim is reached, or change the sizes where the spheres are at rest."""
        depth, root = float(self.numbers[DEPTH]), math.sqrt(float(self.numbers[ENERGY]))
        self.strict = self.size * (1.0 - min(depth, 1.0))
        if not self.jam and depth <= goal and self.size >= 1.0:
            self.strict, self.ended = 1.0, True
            return
        rest, jammed_at = 0.0 <= self.numbers[RESIDUAL] < self.calm, self.earlier[0] if self.earlier[1] > 0.0 else 0.0
        late = self.in_round >= ROUND
        if self.done_steps >= self.most_steps:
            self.ended = True
        elif root == 0.0 or (late and not rest and not jammed_at and depth < LOOSE):
            self.ended = 0.0 < jammed_at <= self.size * (1.0 + DEEPEST)
            if not self.ended:
                self._resize(0.5 * (self.size + jammed_at) if jammed_at > self.size else self.size * (1.0 + MORE))
        elif (rest or late) and jammed_at and depth < DEEPEST:
            self.ended = True
        elif rest or late:
            self._resize(self._next_size(root))
        self.jams = self.ended and depth < 10 * DEEPEST

    def _next_size(self, root: float) -> float:
        """Return the next size, from where the root of the energy would vanish, and keep the present one."""
        size, (last_size, last_root) = self.size, self.earlier
        new = size * (1.0 - FIRST_LESS)
        if last_root > root:
            jammed = size - root * (last_size - size) / (last_root - root)
            new = max(jammed + KEPT * (size - jammed), size * (1.0 - MOST_LESS))
        self.earlier = np.array([size, root])
        return new

    def _resize(self, size: float) -> None:
        """Give the spheres another size and let them rest there."""
        grown = size > self.size
        self.size = size
        self.spheres[:, 3] = self.radii * size
        self.velocity[:] = 0.0
        self.in_round = 0
        self._calm_down()
        if grown:
            self._list()
        self._push()

    def _calm_down(self) -> None:
        """Begin the relaxation anew."""
        self.numbers[STEP], self.numbers[MIXING], self.numbers[UPHILL_FREE] = FIRST_STEP, FIRST_MIXING, 0.0

    def _push(self) -> None:
        """Compute the forces at the present positions."""
        if self._pairs is None:
            self._pairs = self._listing()
        self._beyond = None
        push_spheres(self.spheres, self._pairs, self.walls, self._walls_near(), self.force, self.numbers)
        self.numbers[RESIDUAL] = np.inf

    def _list(self) -> None:
        """List the pairs at the present positions."""
        self.spheres[:, :3] = self._wrapped()
        self.listed = self.spheres.copy()
        self._pairs = self._listing()

    def _wrapped(self) -> Floats:
        """Return the positions within the periodic lengths."""
        return within_periods(self.spheres[:, :3], self.container)

    def _listing(self) -> PairList:
        """Return the pairs that may touch before a sphere has moved too far from where it was listed."""
        reach, walls = 1.0 + FREE, self.walls
        cells, level = level_cells(walls.lengths, walls.periods, reach * self.listed[:, 3], self.dimension)
        n, many = len(self.listed), 10 * len(self.listed) + 64
        first = np.zeros(n + 1, dtype=np.int64)
        while True:
            other, image = np.zeros(many, dtype=np.int32), np.zeros(many, dtype=np.uint8)
            found = int(list_pairs(cells, level, self.listed, walls.lower, reach, first, other, image))
            if found < many:
                break
            many = found + 1
            cells.head[:] = -1
        depth = -np.asarray(self.container.signed_distance(self.listed[:, :3]))
        near = np.flatnonzero(depth < reach * self.listed[:, 3]).astype(np.int64)
        return PairList(first, other, image, image_shifts(walls.periods), near)

    def _walls_near(self) -> Floats:
        """Return distance and inward normal of walls that are known by their distance only, for spheres near them.

        They are kept until the next call of `_push`, which follows each move of spheres near such walls.
        """
        if self._beyond is None:
            self._beyond = np.zeros((0, 4)) if self.known else self._measured_walls()
        return self._beyond

    def _measured_walls(self) -> Floats:
        """Return what `_walls_near` returns, by finite differences of the distance."""
        assert self._pairs is not None
        points = self.spheres[self._pairs.near_wall, :3]
        shifts = NUDGE * np.eye(3)[: self.dimension]
        # one call for all points: small ones cost more than what they compute
        asked = np.concatenate([np.zeros((1, 3)), shifts, -shifts])[:, None] + points
        away = -np.asarray(self.container.signed_distance(asked.reshape(-1, 3))).reshape(len(asked), len(points))
        normal = np.zeros((len(points), 3))
        normal[:, : self.dimension] = (away[1 : self.dimension + 1] - away[self.dimension + 1 :]).T
        normal /= np.maximum(linear.norm(normal, axis=1), 1e-300)[:, None]
        return np.column_stack([away[0], normal])


def _is_known(container: Container) -> bool:
    """Return whether kernels know the walls of a container."""
    boundary = boundary_of(container)
    return boundary.is_usual and (boundary.solid is None or isinstance(boundary.solid.geometry, Mesh))


def _bounds_of(container: Container) -> Container:
    """Return the bounds of a container, without walls along its periodic axes, as a container."""
    lower, upper = container.bounds
    n = container.dimension
    axes = "".join(axis for axis, wraps in zip("xyz", container.periodic, strict=True) if wraps)
    make = Box if n == 3 else Rectangle
    return make((upper - lower)[:n], axes, origin=lower[:n], tilt=tilt_of(container)[: 2 * n - 3])


def _near_order(position: Floats, radii: Floats, bounds: Floats) -> Integers:
    """Return an order of the spheres in which neighbours are near each other in memory."""
    n = len(position)
    if not n:
        return np.zeros(0, dtype=np.int64)
    lower, lengths = bounds[0], np.maximum(bounds[1] - bounds[0], 1e-300)
    cells = max(1.0, (n / 8) ** (1 / 3))
    index = np.floor((position - lower) / lengths * cells).astype(np.int64)
    order: Integers = np.lexsort((index[:, 2], index[:, 1], index[:, 0])).astype(np.int64)
    return order
