"""Segmentation of grey images: threshold, removal of noise and watershed, by scikit-image; how good it is, by necks.

Of an image in blocks, each block is flooded together with its surroundings, which are as wide as the largest grain.
Seeds have the numbers of the whole image, so that the basins of blocks fit together; a voxel may belong to another
basin than in memory only where two basins reach it at the same level, or where a plateau of the distance is wider than
these surroundings.
"""

import itertools
import math
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin
from numpy.typing import ArrayLike, NDArray

from voxgran._base import Missing
from voxgran._base.arrays import Floats, Integers, as_array, as_count, as_number, as_positive
from voxgran._base.calls import explained
from voxgran._base.errors import InputError, shown
from voxgran._base.lazy import load, load_extra
from voxgran.lattice.distance import distance_transform
from voxgran.lattice.image import (
    Edges,
    Image,
    histogram_of,
    kept,
    known_edges,
    lazy_of,
    not_finite,
    of_blocks,
    windowed,
)
from voxgran.lattice.label import connected_components
from voxgran.lattice.necks import (
    Basins,
    Pairs,
    basins_from,
    doubt,
    merged,
    pairs_of,
    relative_sizes,
    score,
    tally,
    widest,
)
from voxgran.lattice.smoothing import smoothed

#: largest score of two grains, where no separation is given
NECK = 0.9
#: standard deviation, in voxels along each axis, over which the distance is smoothed
SMOOTH = 0.7
#: doubt from which on a neck is suspect
DOUBT = 0.2


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Segmentation(NDArrayOperatorsMixin, Image):
    """Labelled grains, which are taken wherever an image of labels is, and how sure their separation is.

    Operators, indices and attributes of arrays, such as ``> 0``, ``[3, 4, 5]`` and ``.max()``, are those of the labels.

    Attributes
    ----------
    values : (nx, ny, nz) ndarray of int
        Consecutive labels 1, 2, ..., and 0 for void; also called `labels`.
    voxel_size : (3,) tuple of float or None
        Edges of a voxel; None if they are unknown, and lengths are then in voxels.
    origin, unit
        As those of the image.
    threshold : float
        Grey value that separates solid and void.
    separation : float
        Decrease of the distance to the void between two centers from which they are separate grains, as given; where
        none was given, that for a grain of the median size.
    necks : xarray.Dataset
        A row for each pair of touching grains, and for the narrowest neck within each grain that was put together of
        several: labels ``grain`` and ``other`` (equal within a grain), ``diameter`` of the largest sphere that passes
        (twice the largest distance to the void on the common faces), its ``ratio`` to the smaller part (twice the
        largest distance to the void in it), the ``excess`` of the ellipsoid of both over those of the parts as a share
        of the smaller one, the ``score``, ratio less 0.15 of the excess, and the ``doubt``, the probability that the
        pair is one grain, or the grain several. Distances are smoothed over 0.7 voxels.
    grains : int
        Number of grains.
    """

    threshold: float = 0.0
    separation: float = 0.0
    necks: Any = field(default=None)
    grains: int = 0

    def __repr__(self) -> str:
        return (
            f"Segmentation(shape={self.values.shape}, grains={self.grains}, "
            f"separation={self.separation:.4g}, threshold={self.threshold:.4g}, suspects={self.suspects.sizes['neck']})"
        )

    @property
    def labels(self) -> Integers:
        """The labels, (nx, ny, nz)."""
        return self.values

    @property
    def suspects(self) -> Any:
        """The rows of `necks` that may be wrong, with a doubt of at least 0.2, the largest first: pairs of grains that
        may be one, and grains that may be several (``grain`` equals ``other``).
        """
        found = self.necks["doubt"].values
        order = np.argsort(-found, kind="stable")
        return self.necks.isel(neck=order[found[order] >= DOUBT])

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **keywords: Any) -> Any:
        """Apply a function of NumPy to the labels."""
        return getattr(ufunc, method)(
            *(np.asarray(i) if isinstance(i, Segmentation) else i for i in inputs), **keywords
        )

    def __getitem__(self, key: Any) -> Any:
        return self.values[key]

    def __len__(self) -> int:
        return len(self.values)

    def __getattr__(self, name: str) -> Any:
        """Return an attribute of the labels.

        Raises
        ------
        AttributeError
            If arrays have no such attribute.
        """
        if hasattr(np.ndarray, name) and not name.startswith("__"):
            return getattr(self.values, name)
        raise AttributeError(Missing(type(self), name), name=name)


@explained(hint="segment(image, min_size=50); min_size is in voxels, separation in the unit of the voxel size")
def segment(
    image: "ArrayLike | Image",
    *,
    threshold: float | str = "otsu",
    dark_grains: bool = False,
    min_size: int = 64,
    separation: float | None = None,
    voxel_size: "ArrayLike | None" = None,
) -> Segmentation:
    """Segment a grey image into labelled grains.

    Parameters
    ----------
    image : (nx, ny, nz) array_like or Image
        Grey values; what :func:`voxgran.load_image` returns is one. A dask array, as :func:`voxgran.open_image` returns
        it, is segmented block by block.
    threshold : float or "otsu"
        Grey value above which a voxel is solid; ``"otsu"`` determines it from the histogram.
    dark_grains : bool
        Whether grains are darker than the void.
    min_size : int
        Smallest number of voxels of solid bodies, holes and separated grains; smaller ones are removed as noise.
    separation : float, optional
        Decrease of the distance to the void between two centers from which they are separate grains, in the unit of the
        voxel size, or in voxels where that is unknown; larger values separate fewer grains. Default: about a tenth of
        the smaller of the two distances, whatever the size of the grains, by the score of the necks.
    voxel_size : float or (3,) array_like of float, optional
        Edge of a voxel, or its edges along x, y and z. Default: those that an Image tells.

    Returns
    -------
    Segmentation
        Labels, and the necks between grains, of which ``suspects`` are those that may be wrong.

    Raises
    ------
    InputError
        If the image has not three axes, holds a number that is not finite, or an option is out of range.
    MissingLibraryError
        If scikit-image is not installed, or zarr for a dask array.

    Notes
    -----
    The distance is that to the void within the image, so that grains are as wide where the border cuts them. It is
    smoothed over 0.7 voxels (Gaussian), so that steps of the voxels part nothing.

    Two parts are one grain if their score is above 0.9. Its ratio is relative, since a length that parts small grains
    cuts large ones at each bump of their surface. Of a part that the border cuts it is the mean of two, one of them by
    distances within the planes of the border: what is left of a grain may be thin there, and its section wide. The
    excess tells grains that touch with a wide neck from the parts of one: two equal spheres that touch have 0.45, the
    parts of a convex body at most about 0. Spheres, polyhedra and rocks are found within 2 %
    (``python -m benchmarks segmentation``). Grains that share a whole flat face have no neck: nothing parts them.

    The doubt is a logistic function of ratio, excess and the volume of both parts together among those of all grains:
    the parts of a grain that was cut in two make one of usual size, and two grains that were merged are large. Its
    weights are those of images of known grains.

    A dask array is flooded block by block, each with surroundings as wide as the largest grain; only voxels that two
    basins reach at the same level may get another label than in memory. What is needed several times is kept in the
    temporary folder of dask, with about 20 bytes a voxel before compression, and read anew for each block, with about
    40 bytes in memory for each voxel of a block with its surroundings on each thread.

    References
    ----------
    Otsu 1979, A threshold selection method from gray-level histograms, doi:10.1109/TSMC.1979.4310076. Watershed of the
    distance with h-maxima as seeds: Soille 2004, Morphological image analysis, doi:10.1007/978-3-662-05088-0.

    Examples
    --------
    >>> import voxgran as vg
    >>> spheres = vg.Packing.of(vg.shapes.sphere(), vg.Box((4, 2, 2)), position=[(1, 1, 1), (1.95, 1, 1)])
    >>> grey = vg.to_image(spheres, voxel_size=0.05, labels=False).astype(float)
    >>> found = vg.segment(grey, threshold=0.5, voxel_size=0.05)
    >>> int(found.max()), found.necks["ratio"].values.round(1).tolist()
    (2, [0.3])
    """
    if isinstance(image, str | os.PathLike):
        raise InputError(f"image is the path {str(image)!r}: grey values are needed; write segment(load_image(path))")
    lazy = lazy_of(image)
    grey = as_array(image, "image") if lazy is None else lazy
    if grey.ndim != 3 or not grey.size:
        raise InputError(f"image has the shape {grey.shape}: three axes are needed; stack slices, or choose a channel")
    if grey.dtype.kind not in "buif":
        raise InputError(f"image holds {grey.dtype}: grey values are needed; convert it")
    if (bad := not_finite(grey)) is not None:
        raise InputError(f"image is {float(grey[bad])} at voxel {bad}: grey values must be finite numbers; clean it")
    least, edges = as_count(min_size, "min_size", at_least=1), known_edges(voxel_size, image)
    decrease = None if separation is None else as_positive(separation, "separation")
    filters = _skimage("filters")
    if isinstance(threshold, str) and threshold == "otsu":
        low, high = np.asarray(grey.min())[()], np.asarray(grey.max())[()]
        counts = {"image": grey} if lazy is None else {"hist": histogram_of(grey, low, high)}
        level = float(filters.threshold_otsu(**counts)) if low < high else float(high)
    elif isinstance(threshold, str):
        raise InputError(f"threshold is {shown(threshold)}: give a grey value or 'otsu'")
    else:
        level = as_number(threshold, "threshold")
    solid: Any = grey < level if dark_grains else grey > level
    large = _without_small if lazy is None else without_small
    solid = large(solid, least)
    solid = ~large(~solid, least)
    basins, found = _basins(solid, edges) if lazy is None else basins_of(solid, edges, SMOOTH)
    new, separated, necks = _grains(found, least, decrease)
    labels = new[basins] if lazy is None else basins.map_blocks(lambda block: new[block], dtype=new.dtype)
    given = image if isinstance(image, Image) else Image(grey)
    count = int(new.max(initial=0))
    return Segmentation(labels, edges, given.origin, given.unit, level, separated, necks, count)


def _basins(solid: Any, edges: Edges | None) -> tuple[Any, Basins]:
    """Return the labels of the basins of the distance to the void, and the basins."""
    ndimage = load("scipy.ndimage")
    distance = distance_to_void(solid, edges)
    # steps of the voxel surface would otherwise be bumps, and bend the surfaces between grains
    distance = smoothed(distance, SMOOTH) * solid
    seeds, count = ndimage.label(_skimage("morphology").local_maxima(distance) & solid, np.ones((3, 3, 3)))
    labels = _skimage("segmentation").watershed(-distance, seeds, mask=solid)
    moments, peak = tally(labels, distance, np.zeros(3, dtype=np.int64), count)
    planes = border_of(labels, solid, edges, SMOOTH)
    return labels, basins_from(peak, moments, pairs_of(labels, distance), planes)


def _grains(basins: Basins, least: int, decrease: float | None) -> tuple[Integers, float, Any]:
    """Return the label of each basin, the separation for a grain of the median size, and the necks."""
    root, within, ratio, excess = merged(basins, decrease=decrease, share=NECK)
    grains = basins.joined(root)
    kept = np.flatnonzero((grains.moments[:, 0] >= least) & (np.arange(len(root)) > 0))
    new = np.zeros(len(root), dtype=np.int64)
    new[kept] = np.arange(1, len(kept) + 1)
    median = float(np.median(grains.peak[kept, 0])) if len(kept) else 0.0
    separated = (1.0 - NECK) * median if decrease is None else decrease
    one, other, pairs = root[basins.pairs.one], root[basins.pairs.other], basins.pairs
    apart = (one != other) & (new[one] > 0) & (new[other] > 0)
    between = widest(one[apart], other[apart], pairs.neck[apart])
    # the narrowest neck within a grain comes first
    order = np.argsort(score(ratio, excess), kind="stable")
    grain, first = np.unique(new[root[within.one[order]]], return_index=True)
    inner = order[first[grain > 0]]
    grain = grain[grain > 0]
    terms = zip(grains.alike(between), (ratio[inner], excess[inner]), strict=True)
    ratios, excesses = (np.concatenate(each) for each in terms)
    columns = {
        "grain": np.concatenate([np.minimum(new[between.one], new[between.other]), grain]),
        "other": np.concatenate([np.maximum(new[between.one], new[between.other]), grain]),
        "diameter": 2.0 * np.concatenate([between.neck[:, 0], within.neck[inner, 0]]),
        "ratio": ratios,
        "excess": excesses,
        "score": score(ratios, excesses),
    }
    voxels = grains.moments[:, 0].astype(np.float64)
    both = np.concatenate([voxels[between.one] + voxels[between.other], voxels[kept[grain - 1]]])
    sizes = relative_sizes(both, voxels[kept])
    columns["doubt"] = doubt(ratios, excesses, sizes, columns["grain"] == columns["other"])
    necks = load("xarray").Dataset({name: ("neck", values) for name, values in columns.items()})
    return new[root], separated, necks


def _without_small(mask: Any, least: int) -> Any:
    """Return a mask without bodies of few voxels."""
    bodies, _ = load("scipy.ndimage").label(mask)
    sizes = np.bincount(bodies.ravel())
    sizes[0] = 0
    return sizes[bodies] >= least


def _skimage(name: str) -> Any:
    """Load a part of scikit-image."""
    return load_extra(f"skimage.{name}", "images", "segmenting grey images needs it")


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
        yield plane, smoothed(distance_to_void(mask, edges), smooth) * mask


def basins_of(solid: Any, edges: Edges | None, smooth: float) -> tuple[Any, Basins]:
    """Return the labels of the basins of the distance to the void, and the basins.

    `smooth` is the standard deviation, in voxels, over which the distance is smoothed.
    """
    step = edges or (1.0, 1.0, 1.0)
    maxima = load("skimage.morphology").local_maxima
    sharp: Any = kept(distance_to_void(solid, edges).rechunk(solid.chunks))

    def masked(far: NDArray[Any], mask: NDArray[Any]) -> NDArray[Any]:
        return np.asarray(smoothed(far, smooth) * mask)

    # the reach of the Gaussian of SciPy, which reflects at the border of the image as here at its own
    distance = kept(windowed([sharp, solid], masked, (int(4 * smooth + 0.5),) * 3, np.float32))
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
