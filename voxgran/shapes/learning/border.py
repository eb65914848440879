"""Grains of a scan that its border does not cut, and for how many of the material each of them stands.

A whole grain of the extents w lies whole within a window of the edges L for a share ``prod(1 - w / L)`` of all places
where its centroid may be: large grains are cut more often than small ones. Weighted by the inverse of that share
(Miles 1974; Lantuejoul 1980; Serra 1982, Image Analysis and Mathematical Morphology), the whole grains are an unbiased
sample by number.
"""

from collections.abc import Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Booleans, Floats

#: how near to a wall, in contact gaps, a grain ends in it
NEAR = 0.5


@runtime_checkable
class Grains(Protocol):
    """What is asked of a packing: its grains where they lie, and the box that may cut them."""

    @property
    def shapes(self) -> Sequence[Any]:
        """Shapes of the grains."""

    @property
    def shape_id(self) -> NDArray[Any]:
        """Index of the shape of each grain, (n,)."""

    @property
    def scale(self) -> Floats:
        """Factor on the lengths of the shape of each grain, (n,)."""

    @property
    def orientation(self) -> Floats:
        """Unit quaternions (n, 4)."""

    @property
    def container(self) -> Any:
        """What holds the grains."""

    @property
    def contact_gap(self) -> float:
        """Gap up to which grains touch: of a scan its voxel."""

    def world_vertices(self, grain: int) -> Floats:
        """Return the vertices of a grain where it lies."""


def border_weights(packing: Grains) -> Floats:
    """Return for how many grains of the material each grain (n,) of a scan stands, 0 for one that its border cuts.

    Along periodic axes, and along those on neither side of which a grain ends, none is cut. Containers are boxes, as
    those of images are; of another one all weights are 1.
    """
    weights = np.ones(len(packing.shape_id))
    if not is_scan(packing):
        return weights
    low, high = _extents(packing)
    lower, upper = packing.container.bounds
    near = NEAR * packing.contact_gap + 1e-9 * float((upper - lower).max())
    for axis in np.flatnonzero(~np.asarray(packing.container.periodic)):
        ends = low[:, axis] <= lower[axis] + near, high[:, axis] >= upper[axis] - near
        # on a side where no grain ends, as above a bed, the grains end the sample and not the image
        first = lower[axis] if ends[0].any() else low[:, axis].min()
        last = upper[axis] if ends[1].any() else high[:, axis].max()
        if ends[0].any() or ends[1].any():
            share = 1.0 - (high[:, axis] - low[:, axis]) / (last - first)
            cut = ends[0] | ends[1] | (share <= 0.0)
            weights = np.where(cut, 0.0, weights / np.where(cut, 1.0, share))
    return weights


def is_scan(packing: Grains) -> bool:
    """Return whether the border of a packing cuts grains: each has a shape of its own at its own size, as the labels of
    an image have, and the container is a box with a side that does not repeat, beyond which flat faces of them lie.
    """
    n = len(packing.shape_id)
    own = n == len(np.unique(packing.shape_id)) and bool((packing.scale == 1.0).all())
    walls = not all(packing.container.periodic)
    return own and walls and bool(_flattened(packing).any())


def _extents(packing: Grains) -> tuple[Floats, Floats]:
    """Return the lowest and the highest coordinates (n, 3) of the grains."""
    found = [(p.min(axis=0), p.max(axis=0)) for p in map(packing.world_vertices, range(len(packing.shape_id)))]
    low, high = np.array(found).reshape(-1, 2, 3).transpose(1, 0, 2)
    return low, high


def _flattened(packing: Grains) -> Booleans:
    """Return which grains (n,) have three vertices or more in one wall, without turning: labels are as they lie."""
    lower, upper = packing.container.bounds
    walls = ~np.asarray(packing.container.periodic)
    slack = 1e-6 * float((upper - lower).max())
    unturned = np.abs(packing.orientation[:, 0]) > 1.0 - 1e-12
    found = np.zeros(len(packing.shape_id), dtype=np.bool_)
    for grain in np.flatnonzero(unturned).tolist():
        points = packing.world_vertices(grain)
        at = np.stack([points <= lower + slack, points >= upper - slack]).sum(axis=1) >= 3
        found[grain] = bool((at & walls).any())
    return found
