"""The part of a container in which the pairs of centroids are counted, and the volume that pairs have in it.

Each centroid has a weight, which rises from 0 to 1 over a mean diameter away from the walls: a sharp edge would lie
between two of the layers along a wall or in one of them, and so change the density by a tenth and more. Pairs of
independent points have, at the distance r, the mean weight that the autocorrelation of the weights, averaged over all
directions, gives: without the rise it is the isotropized set covariance (Ohser 1983, doi:10.1080/02331888308801687).
Divided by it, the sum of the weights of pairs is unbiased up to every wall. In boxes and rectangles, walled or
periodic along each axis, it is known in closed form but for the mean over directions, which is a quadrature; in other
containers it comes from a lattice with the weight of each voxel.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Booleans, Floats
from voxgran._base.lazy import load
from voxgran.containers.model import boundary_of, periods_of
from voxgran.geometry.periods import face_distances
from voxgran.measures.region import Regions
from voxgran.packing.model import Packing

#: voxels of the lattice, in 3D and 2D, and the fewest along an edge
VOXELS, FEWEST = {3: 64**3, 2: 256**2}, 24
#: distance, in voxels, up to which the covariance is fitted
FIT = 16.0
#: voxels in the rise of the weights from which on a lattice of them is smooth
SMOOTH = 2.0
#: points of the quadrature over directions, along each of their two angles
ANGLES = 24


@dataclass(frozen=True, eq=False)
class PairWindow:
    """Weights of points: they rise from the distance `inset` inside all walls and, with gravity, below the height of
    the bed.
    """

    packing: Packing
    inset: float
    lower: Floats  # (d,) corners of the bounds; those of the container on periodic axes
    upper: Floats
    rise: float  # length over which the weights rise from 0 to 1: at most a quarter of the shortest edge

    @classmethod
    def of(cls, packing: Packing, inset: float, rise: float = 0.0) -> "PairWindow":
        """Return the window of a packing; it is empty where `upper` is not above `lower`."""
        container, d = packing.container, packing.dimension
        walls = ~np.array(container.periodic[:d])
        limits = np.where(walls, Regions(packing).limits[:, :d], [[-np.inf], [np.inf]])
        lower = np.maximum(container.bounds[0, :d] + inset * walls, limits[0])
        upper = np.minimum(container.bounds[1, :d] - inset * walls, limits[1])
        return cls(packing, inset, lower, upper, min(rise, max(float((upper - lower).min()), 0.0) / 4))

    @property
    def edges(self) -> Floats:
        """Edges of the bounds, (d,)."""
        return np.asarray(np.maximum(self.upper - self.lower, 0.0))

    @property
    def periodic(self) -> Booleans:
        """Which of the d axes are periodic."""
        return np.array(self.packing.container.periodic[: len(self.lower)])

    @property
    def is_flat(self) -> bool:
        """Whether the window is a box."""
        return boundary_of(self.packing.container).is_flat

    @property
    def reach(self) -> float:
        """Largest distance at which pairs are counted: half the shortest edge, or distance of periodic faces."""
        faces = face_distances(periods_of(self.packing.container))[: len(self.lower)]
        return float(np.minimum(self.edges, faces).min()) / 2

    def weights(self, points: Floats, rise: float | None = None) -> Floats:
        """Return the weights (n,) of points (n, 3)."""
        d, rise = len(self.lower), self.rise if rise is None else rise
        if not (self.edges > 0).all():
            return np.zeros(len(points))
        place = points[:, :d]
        depths = np.minimum(place - self.lower, self.upper - place)
        depths[:, self.periodic] = np.inf
        weights: Floats = _risen(depths, rise).prod(axis=1)
        if not self.is_flat:
            weights *= _risen(-self.packing.container.signed_distance(points) - self.inset, rise)
        return weights

    @property
    def volume(self) -> float:
        """Integral of the weights over the container."""
        if not self.is_flat:
            return float(self._lattice.mean()) * float(np.prod(self.edges))
        return float(np.prod(self.edges - self.rise * ~self.periodic))

    def covariance(self, distance: Floats) -> Floats:
        """Return the autocorrelation of the weights over their integral, the mean over directions, of distances (k,) up
        to the reach.
        """
        if not self.is_flat:
            return np.asarray(np.interp(distance, *self._curve))
        directions, shares = _directions(len(self.lower))
        product = np.ones((len(distance), len(shares)))
        for a, edge in enumerate(self.edges):
            if not self.periodic[a]:
                t = distance[:, None] * directions[:, a]
                # of two boxes with this edge, each convolved with one as long as the rise
                near = libm.power(np.maximum(1 - t / self.rise, 0.0), 3) * (self.rise / 3) if self.rise else 0.0
                product *= 1 - (t + near) / (edge - self.rise)
        return np.asarray(linear.matmul(product, shares))

    def pair_shares(self, edges: Floats) -> Floats:
        """Return the share of the weight of all pairs of independent points that have a distance in each bin, (k,)."""
        nodes, weights = linear.gauss_legendre(4)
        half = np.diff(edges) / 2
        distance = (edges[:-1] + half)[:, None] + half[:, None] * nodes
        d = len(self.lower)
        shell = 4 * np.pi * (distance / edges[-1]) ** 2 if d == 3 else 2 * np.pi * distance / edges[-1]
        covariance = self.covariance(distance.reshape(-1)).reshape(distance.shape)
        return np.asarray(
            linear.matmul(shell * covariance, weights) * (half / edges[-1]) * (edges[-1] ** d / self.volume)
        )

    @cached_property
    def _lattice(self) -> Floats:
        """Weight of each voxel of a lattice over the bounds."""
        d, edges = len(self.lower), self.edges
        counts = edges / float(np.prod(edges / edges.max()) / VOXELS[d]) ** (1 / d) / edges.max()
        counts = np.maximum(np.ceil(counts), FEWEST).astype(np.int64)
        voxel = edges / counts
        axes = [low + (np.arange(n) + 0.5) * edge for low, edge, n in zip(self.lower, voxel, counts, strict=True)]
        places = np.zeros((int(np.prod(counts)), 3))
        places[:, :d] = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, d)
        if self.rise >= SMOOTH * voxel.max():
            return np.asarray(self.weights(places).reshape(tuple(counts)))
        # a wall cuts voxels: exact where it is flat and across an axis, and to second order where it is round
        depth = -self.packing.container.signed_distance(places) - self.inset - self.rise / 2
        return np.asarray(np.clip(0.5 + depth / float(voxel.max()), 0.0, 1.0).reshape(tuple(counts)))

    @cached_property
    def _curve(self) -> tuple[Floats, Floats]:
        """Distances, and the covariance over the integral at them."""
        fft, lattice = load("scipy.fft"), self._lattice
        counts = np.array(lattice.shape)
        size = [
            int(n) if wraps else fft.next_fast_len(2 * int(n)) for n, wraps in zip(counts, self.periodic, strict=True)
        ]
        found = fft.irfftn(np.abs(fft.rfftn(lattice, s=size)) ** 2, s=size)
        voxel = self.edges / counts
        lags = [step * np.abs(n * fft.fftfreq(n)) for step, n in zip(voxel, size, strict=True)]
        squares = sum(np.ix_(*[lag**2 for lag in lags]))
        distance, step = np.sqrt(squares).reshape(-1), float(voxel.max())
        near = (distance > 0) & (distance <= max(self.reach, FIT * step) + 2 * step)
        ring = np.round(distance[near] / step).astype(np.int64)
        many = np.bincount(ring)
        kept = many > 0
        place = np.bincount(ring, weights=distance[near])[kept] / many[kept]
        value = np.bincount(ring, weights=found.reshape(-1)[near])[kept] / many[kept] / lattice.sum()
        if self.rise >= SMOOTH * step:
            return np.append(0.0, place), np.append(float(found.reshape(-1)[0] / lattice.sum()), value)
        return _smoothed(place, value, np.sqrt(many[kept]), step)


def _risen(depth: Floats, rise: float) -> Floats:
    """Return weights by the depth inside a wall."""
    if not rise:
        return np.asarray((depth >= 0) * 1.0)
    return np.asarray(np.clip(depth / rise, 0.0, 1.0))


def _directions(dimension: int) -> tuple[Floats, Floats]:
    """Return directions (m, d) of all signs above 0, and their shares (m,) of all of these."""
    nodes, shares = linear.gauss_legendre(ANGLES)
    nodes, shares = (nodes + 1) / 2, shares / 2
    flat = np.stack([libm.cos(np.pi / 2 * nodes), libm.sin(np.pi / 2 * nodes)], axis=1)
    if dimension == 2:
        return flat, shares
    upright, side = libm.sin(np.pi / 2 * nodes), libm.cos(np.pi / 2 * nodes)
    heights = np.broadcast_to(upright[:, None, None], (ANGLES, ANGLES, 1))
    every = np.concatenate([side[:, None, None] * flat, heights], axis=2)
    return every.reshape(-1, 3), np.outer(np.pi / 2 * side * shares, shares).reshape(-1)


def _smoothed(place: Floats, value: Floats, weight: Floats, step: float) -> tuple[Floats, Floats]:
    """Return the covariance over the volume without the error of its lattice, from 1 at the distance 0.

    Lags along a wall lose what its cut voxels lack in squares; their share of all directions, and so the loss, is as
    one over the distance. It is fitted with a polynomial at distances of some voxels, where rings have few lags too.
    """
    x = place / step
    used = (x > 1.5) & (x <= FIT)
    basis = np.stack([1 / x, x, x**2, libm.power(x, 3)], axis=1)
    rows = basis[used] * weight[used, None]
    loss, *rest = linear.matmul(linear.pseudoinverse(rows), (value[used] - 1) * weight[used])
    smooth = 1 + linear.matmul(basis[:, 1:], np.array(rest))
    share = np.clip(2 * x / FIT - 0.5, 0.0, 1.0)
    value = (1 - share) * smooth + share * (value - loss / x)
    return np.append(0.0, place), np.append(1.0, value)
