"""Segmentation of grey images: threshold, removal of noise and watershed, by scikit-image."""

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Integers, as_array, as_count, as_number, as_positive
from voxgran._base.calls import explained, renamed
from voxgran._base.errors import InputError, MissingLibraryError, shown
from voxgran._base.lazy import load
from voxgran.lattice.distance import distance_transform


@explained(hint="segment(image, min_size=50); sizes are in voxels")
@renamed(smallest="min_size")
def segment(
    image: NDArray[Any],
    *,
    threshold: float | str = "otsu",
    dark_grains: bool = False,
    min_size: int = 64,
    separation: float = 2.0,
) -> Integers:
    """Segment a grey image into labelled grains.

    Parameters
    ----------
    image : (nx, ny, nz) ndarray or Image
        Grey values; what :func:`voxgran.load_image` returns is one.
    threshold : float or "otsu"
        Grey value above which a voxel is solid; ``"otsu"`` determines it from the histogram.
    dark_grains : bool
        Whether grains are darker than the void.
    min_size : int
        Smallest number of voxels of solid bodies, holes and separated grains; smaller ones are removed as noise.
    separation : float
        Decrease, in voxels, of the distance to the void between two centers from which they are separate grains; larger
        values separate fewer grains.

    Returns
    -------
    (nx, ny, nz) ndarray of int
        Consecutive labels 1, 2, ..., and 0 for void.

    Raises
    ------
    InputError
        If the image has not three axes, holds a number that is not finite, or an option is out of range.
    MissingLibraryError
        If scikit-image is not installed.

    References
    ----------
    Otsu 1979, A threshold selection method from gray-level histograms, doi:10.1109/TSMC.1979.4310076. Watershed of the
    distance with h-maxima as seeds: Soille 2004, Morphological image analysis, doi:10.1007/978-3-662-05088-0.

    Examples
    --------
    >>> import voxgran as vg
    >>> spheres = vg.Packing.of(vg.shapes.sphere(), vg.Box((4, 2, 2)), position=[(1, 1, 1), (1.95, 1, 1)])
    >>> grey = vg.to_image(spheres, voxel_size=0.05, labels=False).astype(float)
    >>> int(vg.segment(grey, threshold=0.5).max())
    2
    """
    if isinstance(image, str | os.PathLike):
        raise InputError(f"image is the path {str(image)!r}: grey values are needed; write segment(load_image(path))")
    grey = as_array(image, "image")
    if grey.ndim != 3 or not grey.size:
        raise InputError(f"image has the shape {grey.shape}: three axes are needed; stack slices, or choose a channel")
    if grey.dtype.kind not in "buif" or not np.isfinite(grey).all():
        raise InputError(f"image holds {grey.dtype} with numbers that are not finite: grey values are needed; clean it")
    least = as_count(min_size, "min_size", at_least=1)
    # no distance within the image exceeds the sum of its edges
    height = min(as_positive(separation, "separation"), sum(grey.shape))
    filters, morphology, segmentation = (_skimage(name) for name in ("filters", "morphology", "segmentation"))
    if isinstance(threshold, str) and threshold == "otsu":
        level = float(filters.threshold_otsu(grey)) if grey.min() < grey.max() else float(grey.max())
    elif isinstance(threshold, str):
        raise InputError(f"threshold is {shown(threshold)}: give a grey value or 'otsu'")
    else:
        level = as_number(threshold, "threshold")
    solid = grey < level if dark_grains else grey > level
    ndimage = load("scipy.ndimage")
    solid = _without_small(solid, least, ndimage)
    solid = ~_without_small(~solid, least, ndimage)
    distance = distance_transform(np.pad(solid, 1))[1:-1, 1:-1, 1:-1]
    seeds, _ = ndimage.label(morphology.h_maxima(distance, height), np.ones((3, 3, 3)))
    # a body flatter than the separation has no maximum of its own
    bodies, count = ndimage.label(solid, np.ones((3, 3, 3)))
    lone = np.setdiff1d(np.arange(1, count + 1), bodies[seeds > 0])
    labels = segmentation.watershed(-distance, seeds, mask=solid).astype(np.int64)
    missing = np.isin(bodies, lone)
    labels[missing] = bodies[missing] + labels.max()
    sizes = np.bincount(labels.ravel())
    labels[sizes[labels] < least] = 0
    relabelled: Integers = np.unique(labels, return_inverse=True)[1].reshape(labels.shape).astype(np.int64)
    return relabelled if (labels == 0).any() else relabelled + 1


def _without_small(mask: Any, least: int, ndimage: Any) -> Any:
    """Return a mask without bodies of few voxels."""
    bodies, _ = ndimage.label(mask)
    sizes = np.bincount(bodies.ravel())
    sizes[0] = 0
    return sizes[bodies] >= least


def _skimage(name: str) -> Any:
    """Load a part of scikit-image."""
    try:
        return load(f"skimage.{name}")
    except MissingLibraryError as error:
        raise MissingLibraryError(
            "scikit-image is not installed: segmenting grey images needs it; install it with "
            "pip install 'voxgran[images]'"
        ) from error
