"""Outlines from pictures: the closed boundary of each particle in a 2D image becomes a polygon."""

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, as_array, as_choice, as_length, as_number
from voxgran._base.calls import explained
from voxgran._base.errors import InputError
from voxgran._base.lazy import load
from voxgran.shapes.images.image_files import load_image
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline

#: corners of a triangle on a line count as none below this part of the lengths of its sides
STRAIGHT = 1e-9
#: difference from the level, in the range of the values, below which pixels count as a little darker
LEVEL = 1e-6


@explained(hint='load_outlines("grains.png", pixel_size=0.1)')
def load_outlines(
    source: str | os.PathLike[str] | NDArray[Any],
    *,
    level: float | None = None,
    pixel_size: float = 1.0,
    min_area: float = 9.0,
    border: str = "drop",
    key: str | None = None,
) -> list[Shape]:
    """Make a polygon of each particle in a 2D image.

    The boundary is traced where the values, linear between the middles of pixels, pass through the level (marching
    squares, contourpy). Holes are filled.

    Parameters
    ----------
    source : path-like or (nx, ny) ndarray
        A file as :func:`voxgran.load_image` takes it, ``.png`` and ``.tif`` pictures with y upward; or values,
        particles brighter than the level; of bool, or of labels (integers, 0 for void), each of which is traced by
        itself.
    level : float, optional
        Value at the boundary; default: halfway between the smallest and the largest. Labels have none.
    pixel_size : float
        Edge of a pixel, in the unit of lengths.
    min_area : float
        Particles of less area, in pixels, are left out as noise.
    border : {"drop", "keep"}
        What becomes of particles that touch the border of the image, where they are cut.
    key : str, optional
        Which array of an ``.npz`` or ``.vti`` file.

    Returns
    -------
    list of Shape
        Polygons named ``outline K``, from left to right; their centroids are the origins of their body frames.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If it is of no known format, or damaged.
    InputError
        If the image has not two axes, holds values that are not finite, no particle is found, or an option is out of
        range.

    Examples
    --------
    >>> import numpy as np
    >>> import voxgran as vg
    >>> x, y = np.indices((40, 40))
    >>> picture = ((x - 20) ** 2 + (y - 20) ** 2 < 100).astype(float)
    >>> [(shape.name, round(shape.volume)) for shape in vg.load_outlines(picture)]
    [('outline 0', 304)]
    """
    size = as_length(pixel_size, "pixel_size")
    least = as_number(min_area, "min_area", at_least=0.0)
    as_choice(border, "border", ("drop", "keep"))
    values = _image_of(source, key)
    found = [
        ring * size
        for layer, cut in _layers(values, level)
        for ring in _rings(layer, cut, border)
        if _area(ring) >= least
    ]
    if not found:
        raise InputError(
            f"image of shape {values.shape} shows no closed particle of {least:g} pixels or more: lower min_area, "
            "change level, or keep those at the border"
        )
    found.sort(key=lambda ring: (float(ring[:, 0].min()), float(ring[:, 1].min())))
    return [Shape.of(Outline("polygon", vertices=ring), name=f"outline {k}") for k, ring in enumerate(found)]


def region_loops(
    source: str | os.PathLike[str] | NDArray[Any],
    *,
    level: float | None,
    pixel_size: float,
    min_area: float,
    key: str | None,
) -> tuple[Floats, list[Floats]]:
    """Return the outer loop of the one bright region of a 2D image, (n, 2), and its holes.

    The arguments are those of :func:`load_outlines`; regions and holes of less than `min_area` are left out.

    Raises
    ------
    InputError
        If the image has not two axes or holds values that are not finite, no region or several are found, or an option
        is out of range.
    """
    size = as_length(pixel_size, "pixel_size")
    least = as_number(min_area, "min_area", at_least=0.0)
    values = _image_of(source, key).astype(np.float64)
    low, high = float(values.min()), float(values.max())
    cut = (low + high) / 2 if level is None else as_number(level, "level")
    loops = _loops(values, cut) if low < cut < high else []
    areas = [_area(loop) for loop in loops]
    regions = [k for k, area in enumerate(areas) if area > 0 and area >= least]
    if len(regions) != 1:
        found = f"{len(regions)} regions of {least:g} pixels or more, brighter than {cut:g}"
        ways = "raise min_area above all but the largest, or join them" if regions else "lower min_area or the level"
        raise InputError(f"image of shape {values.shape} shows {found}: a container is one region; {ways}")
    holes = [loop * size for loop, area in zip(loops, areas, strict=True) if area < 0 and -area >= least]
    # a hole is smaller than the region around it: all of these are of the one region
    return loops[regions[0]] * size, holes


def _image_of(source: str | os.PathLike[str] | NDArray[Any], key: str | None) -> NDArray[Any]:
    """Return the values (nx, ny) of an image, checked."""
    values = source if isinstance(source, np.ndarray) else load_image(source, key=key).values
    values = as_array(values, "image")
    if values.ndim == 3 and values.shape[2] == 1:
        values = values[:, :, 0]
    if values.ndim != 2 or min(values.shape) < 2:
        raise InputError(
            f"image has the shape {values.shape}: outlines need two axes of 2 pixels or more; choose one slice"
        )
    if not np.isfinite(values).all():
        raise InputError("image holds values that are not finite: a boundary between them has no place; replace them")
    return values


def _layers(values: NDArray[Any], level: float | None) -> list[tuple[Floats, float]]:
    """Return what is traced, and at which level: each label by itself, or the values."""
    if values.dtype == np.bool_ or (values.dtype.kind in "iu" and level is None):
        labels = np.unique(values)
        return [((values == label).astype(np.float64), 0.5) for label in labels[labels != 0]]
    grey = values.astype(np.float64)
    low, high = float(grey.min()), float(grey.max())
    cut = (low + high) / 2 if level is None else as_number(level, "level")
    return [(grey, cut)] if low < cut < high else []


def _rings(values: Floats, level: float, border: str) -> list[Floats]:
    """Return the closed outer boundaries, counterclockwise, in pixels from the lower corner of the image."""
    rings = []
    for ring in _loops(values, level):
        cut = (ring.min(axis=0) < 0.5).any() or (ring.max(axis=0) > np.array(values.shape) - 0.5).any()
        if _area(ring) > 0 and (border == "keep" or not cut):
            rings.append(ring)
    return rings


def _loops(values: Floats, level: float) -> list[Floats]:
    """Return all boundaries, in pixels from the lower corner: outer ones counterclockwise, those of holes clockwise."""
    # boundaries through the middles of pixels would touch each other there
    least = LEVEL * float(np.ptp(values))
    apart = np.where(np.abs(values - level) < least, level - least, values)
    padded = np.pad(apart, 1, mode="edge")
    frame = np.ones(padded.shape, dtype=np.bool_)
    frame[1:-1, 1:-1] = False
    # so dark that a particle which is cut ends where the image does
    padded[frame] = np.minimum(padded, 2 * level - padded)[frame]
    lines = load("contourpy").contour_generator(z=padded.T, name="serial").lines(level)
    # the padding moves the image by a pixel; the middle of the first lies at 0.5
    loops = [_corners(np.asarray(line[:-1], dtype=np.float64) - 0.5) for line in lines]
    return [loop for loop in loops if len(loop) >= 3]


def _corners(ring: Floats) -> Floats:
    """Return a ring without points on straight sides."""
    before, after = ring - np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0) - ring
    bend = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    length = linear.norm(before, axis=1) * linear.norm(after, axis=1)
    return ring[np.abs(bend) > STRAIGHT * length]


def _area(ring: Floats) -> float:
    """Return the area inside a ring, negative where it runs clockwise."""
    x, y = ring.T
    return float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum()) / 2
