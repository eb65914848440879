"""Pictures of slices of a segmented image, with the outlines of its grains."""

import math
import os
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arrays import Floats, Integers, as_array, check_type
from voxgran._base.calls import explained
from voxgran._base.errors import InputError
from voxgran._base.files import written_whole
from voxgran._base.lazy import load
from voxgran.lattice.image import lazy_of
from voxgran.lattice.segment import Segmentation
from voxgran.report.plots import DISTINCT
from voxgran.report.stage import check_picture_path

#: number of slices, in two rows
SLICES = 6
#: inches of a panel that is as wide as it is high, fewest, which a title takes, and most of one that is not
PANEL, LEAST_PANEL, MOST_PANEL = 4.2, 1.8, 8.4
#: colours of outlines: of grains, of pairs that may be one, of grains that may be several
GRAIN, ONE, SEVERAL = DISTINCT[5], DISTINCT[3], DISTINCT[1]
WORDS = {GRAIN: "grain", ONE: "perhaps one grain with a neighbour", SEVERAL: "perhaps several grains"}


@explained(hint='save_slices(segment(image), "slices.png", image=image)')
def save_slices(
    segmentation: Segmentation,
    path: str | os.PathLike[str],
    *,
    image: "ArrayLike | None" = None,
    overwrite: bool = False,
) -> None:
    """Write a picture of six slices across z with the outlines of the grains, in which suspects are marked.

    Of each sixth of the image the slice is taken that cuts most of the suspects, or else the middle one.

    Parameters
    ----------
    segmentation : Segmentation
        What :func:`voxgran.segment` returned.
    path : path-like
        File to write, ``.png``.
    image : (nx, ny, nz) array_like or Image, optional
        Grey values below the outlines, such as those that were segmented. Default: solid and void.
    overwrite : bool
        Whether an existing file may be replaced.

    Raises
    ------
    InputError
        If it is no segmentation, or the image has another shape.
    FileFormatError
        If the suffix is not ``.png``.
    OutputExistsError
        If the file is there and `overwrite` is false.
    OutputError
        If it cannot be written.

    Examples
    --------
    >>> import voxgran as vg
    >>> bed = vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), "rsa", count=10)
    >>> grey = vg.to_image(bed, voxel_size=0.1, labels=False).astype(float)
    >>> vg.save_slices(vg.segment(grey, threshold=0.5), "slices.png", image=grey)
    """
    check_type(segmentation, Segmentation, "segmentation", "what segment(image) returns")
    check_picture_path(path, overwrite=overwrite)
    labels: Any = segmentation.labels
    given = lazy_of(image)
    grey = (labels > 0) * 1.0 if image is None else as_array(image, "image") if given is None else given
    if grey.shape != labels.shape or grey.dtype.kind not in "buif":
        raise InputError(
            f"image has shape {grey.shape} and type {grey.dtype}: it must have the shape {labels.shape} of the labels "
            "and hold grey values"
        )
    kinds = kinds_of(segmentation)
    low, high = float(grey.min()), float(grey.max())
    edges = segmentation.voxel_size or (1.0, 1.0, 1.0)
    # the panels are as large as usual ones, and as wide or narrow as the slices; titles have room above narrow ones
    ratio = math.sqrt(labels.shape[0] * edges[0] / (labels.shape[1] * edges[1]))
    wide, tall = max(PANEL * ratio, LEAST_PANEL), max(PANEL / ratio, LEAST_PANEL)
    size = (SLICES // 2 * (min(wide, MOST_PANEL) + 0.4), 2 * (min(tall, MOST_PANEL) + 0.6) + 0.5)
    figure = load("matplotlib.figure").Figure(figsize=size, layout="constrained")
    unit = "voxels" if segmentation.voxel_size is None else segmentation.unit or "units of length"
    extent = (0.0, labels.shape[0] * edges[0], 0.0, labels.shape[1] * edges[1])
    is_suspect = kinds > 1
    lazy = lazy_of(labels)
    suspect = is_suspect[labels] if lazy is None else lazy.map_blocks(lambda block: is_suspect[block], dtype=np.bool_)
    chosen = _slices(np.asarray(suspect.sum(axis=(0, 1))))
    for panel, k in zip(figure.subplots(2, SLICES // 2).ravel(), chosen, strict=True):
        shades = (np.asarray(grey[:, :, k], dtype=np.float64) - low) / (high - low or 1.0)
        picture = outlined(shades, np.asarray(labels[:, :, k]), kinds)
        panel.imshow(picture.transpose(1, 0, 2), origin="lower", extent=extent, interpolation="nearest")
        panel.set(title=f"z = {(k + 0.5) * edges[2]:.4g}", xlabel=f"x, {unit}")
    lines = load("matplotlib.lines")
    keys: list[Any] = [lines.Line2D([], [], color=color, linewidth=3, label=word) for color, word in WORDS.items()]
    figure.legend(handles=keys, loc="outside lower center", ncols=3, frameon=False)
    with written_whole(path, overwrite=overwrite) as draft:
        figure.savefig(draft, format="png", dpi=110)


def kinds_of(segmentation: Segmentation) -> Integers:
    """Return what each label is, (n + 1,): 0 void, 1 a grain, 2 one of a pair that may be one, 3 perhaps several."""
    grain, other = (segmentation.suspects[name].values for name in ("grain", "other"))
    kinds = np.zeros(segmentation.grains + 1, dtype=np.int64)
    kinds[1:] = 1
    kinds[np.concatenate([grain[grain != other], other[grain != other]])] = 2
    kinds[grain[grain == other]] = 3
    return kinds


def _slices(suspect: Integers) -> list[int]:
    """Return the slice with most of the voxels of suspects, (nz,), of each sixth along z, or else the middle one."""
    ends = np.linspace(0, len(suspect), SLICES + 1)
    found = []
    for low, high in zip(ends[:-1].astype(int), ends[1:].astype(int), strict=True):
        part = suspect[low : max(high, low + 1)]
        found.append(low + int(part.argmax() if part.any() else len(part) // 2))
    return found


def outlined(shades: Floats, labels: Integers, kinds: Integers) -> Floats:
    """Return a slice (nx, ny, 3) of shades from 0 to 1 with the outermost voxels of each grain in the colour of its
    kind.
    """
    colors = load("matplotlib.colors").to_rgb
    edge = np.zeros(labels.shape, dtype=bool)
    for axis in (0, 1):
        change = np.diff(labels, axis=axis) != 0
        before, after = [(0, 0), (0, 0)], [(0, 0), (0, 0)]
        before[axis], after[axis] = (1, 0), (0, 1)
        edge |= np.pad(change, before) | np.pad(change, after)
    picture = np.repeat(0.15 + 0.7 * shades[:, :, None], 3, axis=2)
    for kind, color in enumerate((GRAIN, ONE, SEVERAL), 1):
        picture[edge & (kinds[labels] == kind)] = colors(color)
    return picture
