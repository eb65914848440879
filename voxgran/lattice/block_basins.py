"""Bodies, distances and basins of images in blocks, for :func:`voxgran.segment`.

Each block is flooded with what lies around it, as wide as the largest grain. Seeds have the numbers of the whole image,
so that the basins of blocks fit together; a voxel may belong to another basin than in memory only where two basins
reach it at the same level, or where a plateau of the distance is wider than these surroundings.
"""

import itertools
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Floats, Integers
from voxgran._base.lazy import load
from voxgran.lattice.blocks import kept, of_blocks, windowed
from voxgran.lattice.distance import distance_transform
from voxgran.lattice.image import Edges
from voxgran.lattice.label import connected_components
from voxgran.lattice.necks import Basins, Pairs, basins_from, pairs_of, tally, widest


def without_small(mask: Any, least: int) -> Any:
    """Return a mask without bodies of few voxels."""
    bodies: Any
    bodies, count = connected_components(mask)
    large = sizes_of(bodies, count) >= least
    large[0] = False
    return kept(bodies.map_blocks(lambda block: large[block], dtype=np.bool_))


def distance_to_void(solid: Any, edges: Edges | None) -> Any:
    """Return the distance to the void within an image; of an image without void, that to its border."""
    width = int(bool(solid.all()))
    found = distance_transform(np.pad(solid, width), voxel_size=edges)
    return found[tuple(slice(width, width + n) for n in solid.shape)]


def sizes_of(labels: Any, count: int) -> Integers:
    """Return the numbers of voxels, (count + 1,), of the labels from 0 on."""
    sizes = np.zeros(count + 1, dtype=np.int64)
    for found, many in of_blocks(labels, lambda block, _: np.unique(block, return_counts=True)):
        sizes[found] += many
    return sizes


def border_of(labels: Any, solid: Any, edges: Edges | None, smooth: float) -> Iterator[tuple[Any, Any]]:
    """Yield the labels and the smoothed distances to the void within each of the six planes of the border."""
    for axis, side in itertools.product(range(3), (slice(1), slice(-1, None))):
        plane, mask = (np.asarray(each[(slice(None),) * axis + (side,)]) for each in (labels, solid))
        yield plane, load("scipy.ndimage").gaussian_filter(distance_to_void(mask, edges), smooth) * mask


def basins_of(solid: Any, edges: Edges | None, smooth: float) -> tuple[Any, Basins]:
    """Return the labels of the basins of the distance to the void, and the basins.

    `smooth` is the standard deviation, in voxels, over which the distance is smoothed.
    """
    ndimage, step = load("scipy.ndimage"), edges or (1.0, 1.0, 1.0)
    maxima = load("skimage.morphology").local_maxima
    sharp: Any = kept(distance_to_void(solid, edges).rechunk(solid.chunks))

    def smoothed(far: NDArray[Any], mask: NDArray[Any]) -> NDArray[Any]:
        return np.asarray(ndimage.gaussian_filter(far, smooth) * mask)

    # the reach of the Gaussian of SciPy, which reflects at the border of the image as here at its own
    distance = kept(windowed([sharp, solid], smoothed, (int(4 * smooth + 0.5),) * 3, np.float32))
    del sharp
    width = 2 * float(distance.max()) + 3 * max(step)
    near = [min(math.ceil(width / 2 / edge), n) for edge, n in zip(step, solid.shape, strict=True)]
    tops = windowed([distance, solid], lambda far, mask: maxima(far) & mask, near, np.bool_)
    seeds, count = connected_components(tops, connectivity=26)
    seeds = kept(seeds)

    def flood(far: NDArray[Any], seed: NDArray[Any], mask: NDArray[Any]) -> NDArray[Any]:
        return np.asarray(load("skimage.segmentation").watershed(-far, seed, mask=mask))

    while True:
        depth = tuple(min(math.ceil(width / edge), n) for edge, n in zip(step, solid.shape, strict=True))
        basins = kept(windowed([distance, seeds, solid], flood, depth, np.int32))
        if depth == solid.shape or not ((basins == 0) & solid).any().compute():
            break
        # a grain so long that its middle lies beyond the surroundings
        width *= 2
    peak, moments = np.zeros(count + 1), np.zeros((count + 1, 10), dtype=np.int64)
    pairs = []
    for some, sums, tallest, within in of_blocks([basins, distance], _tallied, count):
        peak[some] = np.maximum(peak[some], tallest)
        moments[some] += sums
        pairs.append(within)
    for axis, sizes in enumerate(basins.chunks):
        for end in itertools.accumulate(sizes[:-1]):
            across = (slice(None),) * axis + (slice(end - 1, end + 1),)
            pairs.append(pairs_of(np.asarray(basins[across]), np.asarray(distance[across])))
    every = widest(*(np.concatenate([getattr(part, name) for part in pairs]) for name in ("one", "other", "neck")))
    return basins, basins_from(peak, moments, every, border_of(basins, solid, edges, smooth))


def _tallied(labels: Any, start: Integers, distance: Any, count: int) -> tuple[Integers, Integers, Floats, Pairs]:
    """Return the labels of a block, their moments, the largest distance in each, and the pairs that touch there."""
    moments, peak = tally(labels, distance, start, count)
    some = np.flatnonzero(moments[:, 0])
    return some, moments[some], peak[some], pairs_of(labels, distance)
