"""The part of a container in which the pairs of centroids are counted, and the volume that pairs have in it.

Two points at the distance r lie in a window W together for a share of all places and directions that is the isotropized
set covariance, the mean over directions u of the volume of W and of W moved by r u (Ohser 1983,
doi:10.1080/02331888308801687; Stoyan & Stoyan 1994). Divided by it, the number of pairs is unbiased up to every
wall. In boxes and rectangles, walled or periodic along each axis, it is a polynomial of r up to the shortest walled
edge; in all other containers it comes from the autocorrelation of a lattice with the share of each voxel in W.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from voxgran._base.arrays import Booleans, Floats
from voxgran._base.lazy import load
from voxgran.containers.model import boundary_of
from voxgran.measures.region import Regions
from voxgran.packing.model import Packing

#: voxels of the lattice, in 3D and 2D, and the fewest along an edge
VOXELS, FEWEST = {3: 64**3, 2: 256**2}, 24
#: distance, in voxels, up to which the covariance is fitted
FIT = 16.0


@dataclass(frozen=True, eq=False)
class PairWindow:
    """A window: the points at least `inset` inside all walls and, with gravity, below the height of the bed."""

    packing: Packing
    inset: float
    lower: Floats  # (d,) corners of the bounds; those of the container on periodic axes
    upper: Floats

    @classmethod
    def of(cls, packing: Packing, inset: float) -> "PairWindow":
        """Return the window of a packing; it is empty where `upper` is not above `lower`."""
        container, d = packing.container, packing.dimension
        walls = ~np.array(container.periodic[:d])
        limits = np.where(walls, Regions(packing).limits[:, :d], [[-np.inf], [np.inf]])
        lower = np.maximum(container.bounds[0, :d] + inset * walls, limits[0])
        return cls(packing, inset, lower, np.minimum(container.bounds[1, :d] - inset * walls, limits[1]))

    @property
    def edges(self) -> Floats:
        """Edges of the bounds, (d,)."""
        return np.asarray(np.maximum(self.upper - self.lower, 0.0))

    @property
    def periodic(self) -> Booleans:
        """Which of the d axes are periodic."""
        return np.array(self.packing.container.periodic[: len(self.lower)])

    @property
    def reach(self) -> float:
        """Largest distance at which pairs are counted: half the shortest edge."""
        return float(self.edges.min()) / 2

    @cached_property
    def held(self) -> Booleans:
        """Which grains have their centroids in the window, (n,)."""
        place = self.packing.position[:, : len(self.lower)]
        held: Booleans = np.asarray(((place >= self.lower) & (place <= self.upper) | self.periodic).all(axis=1))
        if not self._is_flat:
            held &= self.packing.container.signed_distance(self.packing.position) <= -self.inset
        return np.asarray(held & (self.edges > 0).all())

    @property
    def volume(self) -> float:
        """Volume (in 2D area)."""
        share = 1.0 if self._is_flat else float(self._lattice.mean())
        return share * float(np.prod(self.edges))

    def covariance(self, distance: Floats) -> Floats:
        """Return the isotropized set covariance over the volume, of distances (k,) up to the reach."""
        if not self._is_flat:
            return np.asarray(np.interp(distance, *self._curve))
        span = self.edges[~self.periodic]
        t = distance[:, None] / span
        one, two, three = t.sum(axis=1), np.zeros(len(t)), t.prod(axis=1) if len(span) == 3 else 0.0
        for a in range(len(span)):
            two += t[:, a] * t[:, a + 1 :].sum(axis=1)
        # means over all directions of |u_x|, |u_x u_y| and |u_x u_y u_z|
        if len(self.lower) == 2:
            return np.asarray(1 - 2 / np.pi * one + two / np.pi)
        return np.asarray(1 - one / 2 + 2 / (3 * np.pi) * two - three / (4 * np.pi))

    def pair_shares(self, edges: Floats) -> Floats:
        """Return the share of all pairs of independent points of the window with a distance in each bin, (k,)."""
        nodes, weights = np.polynomial.legendre.leggauss(4)
        half = np.diff(edges) / 2
        distance = (edges[:-1] + half)[:, None] + half[:, None] * nodes
        d = len(self.lower)
        shell = 4 * np.pi * (distance / edges[-1]) ** 2 if d == 3 else 2 * np.pi * distance / edges[-1]
        covariance = self.covariance(distance.reshape(-1)).reshape(distance.shape)
        return np.asarray((shell * covariance) @ weights * (half / edges[-1]) * (edges[-1] ** d / self.volume))

    @property
    def _is_flat(self) -> bool:
        """Whether the window is a box."""
        return boundary_of(self.packing.container).is_flat

    @cached_property
    def _lattice(self) -> Floats:
        """Share of each voxel of a lattice over the bounds that lies in the window."""
        d, edges = len(self.lower), self.edges
        counts = edges / float(np.prod(edges / edges.max()) / VOXELS[d]) ** (1 / d) / edges.max()
        counts = np.maximum(np.ceil(counts), FEWEST).astype(np.int64)
        axes = [low + (np.arange(n) + 0.5) * edge / n for low, edge, n in zip(self.lower, edges, counts, strict=True)]
        places = np.zeros((int(np.prod(counts)), 3))
        places[:, :d] = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, d)
        depth = -self.packing.container.signed_distance(places) - self.inset
        # exact at flat walls across an axis, and to second order at round ones
        share = np.clip(0.5 + depth / float((edges / counts).max()), 0.0, 1.0)
        return np.asarray(share.reshape(tuple(counts)))

    @cached_property
    def _curve(self) -> tuple[Floats, Floats]:
        """Distances, and the covariance over the volume at them."""
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
        return _smoothed(place, value, np.sqrt(many[kept]), step)


def _smoothed(place: Floats, value: Floats, weight: Floats, step: float) -> tuple[Floats, Floats]:
    """Return the covariance over the volume without the error of its lattice, from 1 at the distance 0.

    Lags along a wall lose what its cut voxels lack in squares; their share of all directions, and so the loss, is as
    one over the distance. It is fitted with a polynomial at distances of some voxels, where rings have few lags too.
    """
    x = place / step
    used = (x > 1.5) & (x <= FIT)
    basis = np.stack([1 / x, x, x**2, x**3], axis=1)
    rows = basis[used] * weight[used, None]
    loss, *rest = np.linalg.lstsq(rows, (value[used] - 1) * weight[used])[0]
    smooth = 1 + basis[:, 1:] @ np.array(rest)
    share = np.clip(2 * x / FIT - 0.5, 0.0, 1.0)
    value = (1 - share) * smooth + share * (value - loss / x)
    return np.append(0.0, place), np.append(1.0, value)
