"""Grains like those of a sample: one of its grains, mirrored and mapped so that planes stay planes.

The principal ratios and the size of a new grain come from a kernel density of the sample, mapped onto its marginals;
the surface is that of one grain under a projective map, which keeps convex solids convex and any topology.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, Integers
from voxgran._base.seeds import stream
from voxgran.shapes.mesh import Mesh

#: neighbours of a grain among which the kernel takes two, and how many rows of it give the marginals
NEIGHBOURS, TABLE = 10, 4000
#: strengths between which the kernel is as wide as the differences of neighbours
WIDE = (0.02, 0.08)
#: least denominator of a projective map, so that no part of a grain becomes many times as large as another
LEAST = 0.4


def frame_of(mesh: Mesh) -> tuple[float, Floats, Floats, Floats]:
    """Return equivalent radius, centroid, square roots of the second moments (largest first), and axes in columns."""
    moments = np.trace(mesh.inertia) / 2 * np.eye(3) - mesh.inertia
    squares, axes = linear.eigh(moments / mesh.volume)
    radius = (3 * mesh.volume / (4 * np.pi)) ** (1 / 3)
    return radius, mesh.centroid, np.sqrt(np.maximum(squares[::-1], 1e-300)), axes[:, ::-1]


def affine(matrix: Floats, shift: Floats | None = None, taper: Floats | None = None) -> Floats:
    """Return the homogeneous matrix (4, 4) of a projective map: linear part, translation, row of the denominator."""
    made = np.eye(4)
    made[:3, :3] = matrix
    if shift is not None:
        made[:3, 3] = shift
    if taper is not None:
        made[3, :3] = taper
    return made


def mapped(points: Floats, matrix: Floats) -> Floats:
    """Return points (n, 3) under a projective map, a homogeneous matrix (4, 4)."""
    return np.asarray(
        (linear.matmul(points, matrix[:3, :3].T) + matrix[:3, 3])
        / (linear.matmul(points, matrix[3, :3]) + matrix[3, 3])[:, None]
    )


def width_of(strength: float) -> float:
    """Return the width of the kernel for a strength, in that of the neighbours: in proportion to it below the first and
    above the second of `WIDE`.

    Each stretch of a round bar makes it oval, which only a narrow kernel avoids; grains that the maps take to their own
    kind, as ellipsoids, are new by their ratios alone, for which the kernel must be wide.
    """
    return min(1.0, strength / WIDE[0]) * max(1.0, strength / WIDE[1])


@dataclass(frozen=True, eq=False)
class Kernel:
    """Kernel density of rows (n, k) with weights (n,) of sum 1, whose marginals are mapped onto those of the rows.

    A row is that of one grain, drawn by the weights of donors (n,), plus the difference of two of its nearest
    neighbours times the square root of 2 and a width: as the rows lie along lines or in groups, so do the new ones.
    """

    rows: Floats
    weights: Floats
    donors: Floats
    width: float = 1.0

    @cached_property
    def _near(self) -> Integers:
        """Nearest neighbours (n, m) of each row, in units of the standard deviations."""
        spread = self.rows.std(axis=0)
        rows = self.rows / np.where(spread > 1e-9, spread, np.inf)
        far = ((rows[:, None] - rows) ** 2).sum(axis=2)
        np.fill_diagonal(far, np.inf)
        return np.argsort(far, axis=1, kind="stable")[:, : min(NEIGHBOURS, len(rows) - 1)]

    def _raw(self, grains: Integers, generator: np.random.Generator) -> Floats:
        """Draw rows (m, k) about those of some grains (m,)."""
        near = self._near[grains]
        # the two least of exponential times are two draws by weight without replacement (Efraimidis & Spirakis 2006)
        times = generator.exponential(size=near.shape) / self.weights[near]
        two = np.take_along_axis(near, np.argsort(times, axis=1, kind="stable")[:, :2], axis=1)
        return np.asarray(self.rows[grains] + self.width * np.sqrt(2) * (self.rows[two[:, 0]] - self.rows[two[:, 1]]))

    @cached_property
    def _table(self) -> Floats:
        """Sorted values (TABLE, k) that the kernel draws, which give its marginals."""
        generator = stream(0, "marginals of learned grains")
        return np.sort(self._raw(self.grains(TABLE, generator), generator), axis=0)

    def grains(self, count: int, generator: np.random.Generator) -> Integers:
        """Draw grains (count,) in random order, each as often as its weight as donor says, to one."""
        places = (generator.random() + np.arange(count)) / max(count, 1)
        drawn = np.searchsorted(np.cumsum(self.donors) / self.donors.sum(), places)
        return generator.permutation(np.minimum(drawn, len(self.rows) - 1))

    def draw(self, grain: int, generator: np.random.Generator) -> Floats:
        """Draw a row (k,) about that of one grain, within the range of the rows."""
        raw, places = self._raw(np.array([grain]), generator)[0], (np.arange(TABLE) + 0.5) / TABLE
        shares = [np.interp(value, column, places) for value, column in zip(raw, self._table.T, strict=True)]
        return np.array([self._quantile(k, share) for k, share in enumerate(shares)])

    def _quantile(self, column: int, share: float) -> float:
        """Return the value of a column below which a share of the weights lies, linear between the grains."""
        order = np.argsort(self.rows[:, column], kind="stable")
        weights = self.weights[order]
        places = (np.cumsum(weights) - weights / 2) / weights.sum()
        return float(np.interp(share, places, self.rows[order, column]))


def warped(mesh: Mesh, wanted: Floats, strength: float, generator: np.random.Generator) -> tuple[Mesh, Floats]:
    """Return a grain made of another, and the map (4, 4) of its points.

    `wanted` are the logarithms of the two principal ratios (second over first and third over second) and of the
    equivalent diameter; `strength` is the standard deviation of the shears and of the taper.
    """
    radius, center, _, axes = frame_of(mesh)
    sides = np.where(generator.random(3) < 0.5, -1.0, 1.0)
    shears = generator.normal(0.0, strength, 3)
    squares, turn = linear.eigh(np.array([[0, *shears[:2]], [shears[0], 0, shears[2]], [*shears[1:], 0]]))
    into = sides[:, None] * axes.T / radius
    stretch = linear.matmul(linear.matmul(turn * libm.exp(squares), turn.T), into)
    matrix = affine(stretch, linear.matmul(-stretch, center))
    taper = generator.normal(0.0, strength, 3)
    deepest = -float(linear.matmul(mapped(mesh.vertices, matrix), taper).min())
    matrix = linear.matmul(affine(np.eye(3), taper=taper * min(1.0, (1 - LEAST) / max(deepest, 1e-300))), matrix)
    faces = mesh.corners[:, ::-1] if linear.determinant(matrix[:3, :3]) < 0 else mesh.corners
    body = Mesh(mapped(mesh.vertices, matrix), faces)
    roots = frame_of(body)[2]
    ratios = libm.exp([0.0, wanted[0], wanted[0] + wanted[1]]) / roots
    matrix = linear.matmul(_upright(body, ratios / ratios.prod() ** (1 / 3), float(wanted[2])), matrix)
    return Mesh(mapped(mesh.vertices, matrix), faces), matrix


def placed(mesh: Mesh, size: float, generator: np.random.Generator) -> tuple[Mesh, Floats]:
    """Return a grain in its principal axes, mirrored at random, with the logarithm of its equivalent diameter, and the
    map (4, 4) of its points.
    """
    sides = np.where(generator.random(3) < 0.5, -1.0, 1.0)
    matrix = linear.matmul(affine(np.diag(sides)), _upright(mesh, np.ones(3), size))
    faces = mesh.corners[:, ::-1] if sides.prod() < 0 else mesh.corners
    return Mesh(mapped(mesh.vertices, matrix), faces), matrix


def _upright(mesh: Mesh, stretch: Floats, size: float) -> Floats:
    """Return the map (4, 4) into the principal axes of a grain, stretched along them to the logarithm of a diameter."""
    radius, center, _, axes = frame_of(mesh)
    if linear.determinant(axes) < 0:
        axes[:, 2] *= -1
    factors = stretch * libm.exp(size) / (2 * radius)
    return affine(factors[:, None] * axes.T, -factors * linear.matmul(axes.T, center))
