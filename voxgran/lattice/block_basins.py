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
from voxgran.lattice.blocks import block_library, kept, of_blocks, overlapped
from voxgran.lattice.distance import distance_transform
from voxgran.lattice.image import Edges
from voxgran.lattice.label import connected_components
from voxgran.lattice.necks import Basins, basins_from, pairs_of, tally, widest


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
    array, ndimage, step = block_library("dask.array"), load("scipy.ndimage"), edges or (1.0, 1.0, 1.0)
    flooded, no = load("skimage.segmentation").watershed, (False, False, False)
    distance: Any = distance_to_void(solid, edges).rechunk(solid.chunks)
    # the reach of the Gaussian of SciPy
    how = {"depth": int(4 * smooth + 0.5), "boundary": "reflect", "dtype": np.float32}
    distance = kept(distance.map_overlap(ndimage.gaussian_filter, sigma=smooth, **how) * solid)
    width = 2 * float(distance.max()) + 3 * max(step)
    tops = overlapped(distance, load("skimage.morphology").local_maxima, width / 2, step, no, np.bool_)
    seeds, count = connected_components(tops & solid, connectivity=26)
    seeds = kept(seeds)

    def flood(far: NDArray[Any], seed: NDArray[Any], mask: NDArray[Any]) -> NDArray[Any]:
        return np.asarray(flooded(-far, seed, mask=mask))

    while True:
        depth = tuple(min(math.ceil(width / edge), n) for edge, n in zip(step, solid.shape, strict=True))
        kind = np.empty((0, 0, 0), dtype=np.int32)
        around: dict[str, Any] = {"depth": depth, "boundary": "none", "dtype": kind.dtype, "meta": kind}
        basins = kept(array.map_overlap(flood, distance, seeds, solid, **around).rechunk(distance.chunks))
        if depth == solid.shape or not ((basins == 0) & solid).any().compute():
            break
        # a grain so long that its middle lies beyond the surroundings
        width *= 2
    ahead = dict.fromkeys(range(3), (0, 1))
    with_next = [array.overlap.overlap(each, ahead, "none") for each in (basins, distance)]
    found = of_blocks(with_next, lambda labels, _, far: pairs_of(labels, far))
    pairs = widest(*(np.concatenate([getattr(part, name) for part in found]) for name in ("one", "other", "neck")))
    peak, moments = np.zeros(count + 1), np.zeros((count + 1, 10), dtype=np.int64)
    for some, sums, tallest in of_blocks([basins, distance], _tallied, count):
        peak[some] = np.maximum(peak[some], tallest)
        moments[some] += sums
    return basins, basins_from(peak, moments, pairs, border_of(basins, solid, edges, smooth))


def _tallied(labels: Any, start: Integers, distance: Any, count: int) -> tuple[Integers, Integers, Floats]:
    """Return the labels of a block, their moments, and the largest distance in each."""
    moments, peak = tally(labels, distance, start, count)
    some = np.flatnonzero(moments[:, 0])
    return some, moments[some], peak[some]
