"""Grains of a label image: one shape per label, and a table of what is there.

The surfaces of all labels are made at once (:mod:`voxgran.lattice.label_surfaces`).
"""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from voxgran._base import ExplainedAttributes
from voxgran._base.arrays import Booleans, Floats, Integers, as_array, as_choice, as_count, as_number
from voxgran._base.axes import Periodic, as_periodic
from voxgran._base.calls import explained
from voxgran._base.errors import InputError, PackingWarning, warn
from voxgran._base.files import as_path
from voxgran._base.lazy import Dataset, load
from voxgran._base.progress import OnStep, Step, reported, silent
from voxgran._base.units import NO_UNIT
from voxgran.lattice.block_surfaces import block_surfaces
from voxgran.lattice.census import Census, census
from voxgran.lattice.image import Shelf, lazy_of
from voxgran.lattice.label_surfaces import label_surfaces
from voxgran.lattice.label_volumes import PARTS
from voxgran.shapes.images.image_files import Image, load_image, voxel_sizes, voxel_unit
from voxgran.shapes.images.open_image import open_image
from voxgran.shapes.images.sliced import is_kept_in_parts
from voxgran.shapes.mesh import LatticePoints, Mesh, corner_type
from voxgran.shapes.model import Shape

BORDER, SURFACES = ("drop", "keep"), ("smooth", "voxel")
#: widest smoothing, in voxels: its time grows with the square
WIDEST = 5.0
#: voxels of labels that are told to be specks, where the others have ten times as many
SPECK = 27
#: least number of values of a grey image, and how many planes are looked at to recognize one
LEAST_GREY, GREY_PLANES = 100, 16
#: share of the voxels in the middle of three in a row up to which voxels lie apart; of voxels at random, the square of
#: their share of the image
APART = 0.1


@dataclass(frozen=True, slots=True)
class LabelledGrain(ExplainedAttributes):
    """One grain of a label image."""

    label: int  # its label
    shape: Shape  # the solid, in the unit of the voxel size
    position: Floats  # centroid in the image, (3,)
    volume: float  # volume of its voxels
    cut: bool  # whether it touches the border of the image along an axis that does not repeat


@explained(hint='load_labels("scan.tif", voxel_size=0.1)')
def load_labels(
    source: str | os.PathLike[str] | NDArray[Any] | Image,
    *,
    voxel_size: Any = None,
    border: str = "keep",
    surface: str = "smooth",
    smoothing: float = 1.0,
    periodic: Periodic = False,
    min_size: int = 1,
    unit: str | None = None,
    key: str | None = None,
    on_step: OnStep | None = None,
) -> list[Shape]:
    """Make a shape of each label of an image.

    Parameters
    ----------
    source : path-like, Image or (nx, ny, nz) ndarray of int
        A file as :func:`voxgran.load_image` or :func:`voxgran.open_image` takes it, or labels with 0 for void. A dask
        array may be larger than the memory: surfaces are made group by group, and lie in temporary files.
    voxel_size : float or (3,) array_like of float, optional
        Edges of a voxel; default: as the file says.
    border : {"keep", "drop"}
        What becomes of grains that touch the border of the image, where they are cut: they are kept as they are, with a
        warning, or left out. As in :func:`voxgran.packing_of_labels` no grain is left out unasked.
    surface : {"smooth", "voxel"}
        The smooth surface that keeps the volume, or the faces of the voxels. Voxels that share no face are not joined.
    smoothing : float
        Over how many voxels the steps of the voxels are rounded; at most 5.
    periodic : str, bool or sequence
        Axes along which the image repeats, such as ``"xy"``, as of :class:`voxgran.Box`:
        grains go on across these faces, which cut none.
    min_size : int
        Voxels of the smallest labels; smaller ones, such as specks of noise, are left out.
    unit : str, optional
        Unit of the voxel size; recorded. Default: as the file says, where its voxel size is taken.
    key : str, optional
        Which array of an ``.npz`` or ``.vti`` file.
    on_step : callable, optional
        Told of each grain; default: at a terminal and in a notebook, a line on the error stream every ten seconds,
        elsewhere a record of the logger ``voxgran`` of the level INFO.

    Returns
    -------
    list of Shape
        Named ``label K``, rising. Each has the volume of its voxels, smooth ones within a millionth and a
        hundred-thousandth of a voxel, unless it has several pieces, of which the largest is kept. Of a dask array
        corners of triangles differ by some thousandths of a voxel, and few by up to half of one, where triangles that
        cross are repaired.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If it is of no known format, or damaged.
    MissingLibraryError
        If the library that reads the format is not installed.
    TooLargeError
        If a label of a dask array spans more voxels than fit in memory.
    InputError
        If the image has not three axes, holds no label or what is no label, no grain is left, or an option is out of
        range.

    Warns
    -----
    PackingWarning
        If labels have several pieces, the border of the image cuts grains that are kept, or labels are specks. Specks
        are whole labels with fewer than 27 voxels and less than a tenth of the voxels of the median grain by volume.
        They are reported only if they outnumber the labels with up to ten times as many voxels, as noise does and the
        fine grains of a wide distribution do not.

    Examples
    --------
    >>> import numpy as np
    >>> import voxgran as vg
    >>> image = np.zeros((16, 16, 16), dtype=int)
    >>> image[2:6, 2:6, 2:6], image[8:14, 8:14, 8:14] = 1, 2
    >>> [round(shape.volume, 3) for shape in vg.load_labels(image, voxel_size=0.5)]
    [8.0, 27.0]
    """
    image = image_of(source, key)
    unit = voxel_unit(unit, voxel_size, image)
    how: dict[str, Any] = {"border": border, "surface": surface, "smoothing": smoothing, "periodic": periodic}
    how["min_size"] = min_size
    grains = labelled_grains(image, voxel_size=voxel_size, unit=unit, on_step=on_step, **how)
    cut = [grain.label for grain in grains if grain.cut]
    if cut:
        warn(
            f"{len(cut)} of {len(grains)} labels are cut by the border of the image (label {cut[0]} first): their "
            "shapes are what is left of them; leave them out with border='drop'",
            PackingWarning,
        )
    return [grain.shape for grain in grains]


@explained(hint='label_table("scan.tif", voxel_size=0.1)')
def label_table(
    source: str | os.PathLike[str] | NDArray[Any] | Image, *, voxel_size: Any = None, key: str | None = None
) -> "Dataset":
    """Say what labels an image has.

    Parameters
    ----------
    source : path-like, Image or (nx, ny, nz) ndarray of int
        As :func:`load_labels`.
    voxel_size : float or (3,) array_like of float, optional
        Edges of a voxel; default: as the file says.
    key : str, optional
        Which array of an ``.npz`` or ``.vti`` file.

    Returns
    -------
    xarray.Dataset
        Along ``label``: voxels, volume, lower and upper corner of the box, centroid, and whether it touches the border.
        ``attrs["units"]`` of each is that of the file, such as ``"mm^3"``; ``"1"`` where none is known.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If it is of no known format, or damaged.
    InputError
        If it holds no label or what is no label, or the voxel size is out of range.

    Examples
    --------
    >>> import numpy as np
    >>> import voxgran as vg
    >>> image = np.zeros((8, 8, 8), dtype=int)
    >>> image[1:3, 1:3, 1:3], image[4:7, 4:7, 4:7] = 1, 2
    >>> vg.label_table(image, voxel_size=0.5).volume.values.tolist()
    [1.0, 3.375]
    """
    image = image_of(source, key)
    size, found = np.array(voxel_sizes(voxel_size, image)), _counted(image)
    origin = np.array(image.origin)
    unit = voxel_unit(None, voxel_size, image) or NO_UNIT
    length, volume = {"units": unit}, {"units": unit if unit == NO_UNIT else f"{unit}^3"}
    rows, corners = ("label",), ("label", "axis")
    dataset: Dataset = load("xarray").Dataset(
        {
            "voxels": (rows, found.count, {"units": "1", "long_name": "number of voxels"}),
            "volume": (rows, found.count * size.prod(), {**volume, "long_name": "volume of the voxels"}),
            "lower": (corners, origin + found.lower * size, {**length, "long_name": "lower corner of the box"}),
            "upper": (corners, origin + found.upper * size, {**length, "long_name": "upper corner of the box"}),
            "centroid": (corners, origin + found.middle * size, {**length, "long_name": "mean of the voxel centers"}),
            "touches_border": (rows, found.at_border, {"units": "1", "long_name": "whether the image cuts the grain"}),
        },
        coords={"label": found.label, "axis": ["x", "y", "z"]},
    )
    return dataset


def image_of(source: str | os.PathLike[str] | NDArray[Any] | Image, key: str | None = None, **header: Any) -> Image:
    """Return an image that is given as a file, as an array or as it is; the shape and the dtype are those of a file
    without a header.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If it is of no known format, or damaged.
    InputError
        If it is neither a file, an array nor an image.
    """
    if isinstance(source, str | os.PathLike):
        path = as_path(source)
        return (open_image if is_kept_in_parts(path) else load_image)(path, key=key, **header)
    if isinstance(source, Image):
        return source
    return Image(as_array(source, "image") if lazy_of(source) is None else source)


def labelled_grains(
    image: Image,
    *,
    voxel_size: Any,
    border: str,
    surface: str,
    smoothing: float,
    periodic: Periodic,
    min_size: int,
    unit: str | None,
    on_step: OnStep | None = None,
) -> list[LabelledGrain]:
    """Return the grains of a label image, rising by label; neighbours share the triangles between them.

    Raises
    ------
    InputError
        As :func:`load_labels`.
    """
    as_choice(border, "border", BORDER)
    as_count(min_size, "min_size", at_least=1)
    width = as_number(smoothing, "smoothing", above=0.0, at_most=WIDEST)
    width = 0.0 if as_choice(surface, "surface", SURFACES) == "voxel" else width
    size, wraps, found = np.array(voxel_sizes(voxel_size, image)), np.array(as_periodic(periodic)), _counted(image)
    cut = ((found.lower == 0) | (found.upper == np.array(image.values.shape)))[:, ~wraps].any(axis=1)
    large = found.count >= min_size
    if not large.any():
        raise InputError(
            f"min_size is {min_size} and the largest label has {found.count.max()} voxels: take a smaller one"
        )
    kept = np.flatnonzero(large & ~cut if border == "drop" else large)
    if not len(kept):
        raise InputError(
            f"all {large.sum()} labels touch the border of the image: they are left out unless border is 'keep'"
        )
    _warn_of_specks(found, kept, cut)
    told = reported(on_step) or silent
    told(Step(stage="grains", done=0, total=len(kept), text=f"surfaces of {len(found.label)} labels"))
    several: list[int] = []
    grains = []
    made = _surfaces(image.values, found, kept, wraps, width, size, several)
    shelf = Shelf() if lazy_of(image.values) is not None else None
    for done, (k, bounds) in enumerate(made):
        if done:
            told(Step(stage="grains", done=done, total=len(kept), text=f"{done} of {len(kept)} labels"))
        label = int(found.label[k])
        shape = _solid(*bounds, size, f"label {label}", unit, shelf)
        position = np.array(shape.offset) + np.array(image.origin)
        grains.append(LabelledGrain(label, shape, position, float(found.count[k] * size.prod()), bool(cut[k])))
    if several:
        lost = 1.0 - sum(grain.shape.volume for grain in grains) / sum(grain.volume for grain in grains)
        warn(
            f"{len(several)} of {len(kept)} labels have several pieces (label {found.label[min(several)]} first): "
            f"the largest piece of each is kept, without {100 * lost:.2g} % of the volume of all; label connected "
            "bodies, or clean the image",
            PackingWarning,
        )
    return sorted(grains, key=lambda grain: grain.label)


def _warn_of_specks(found: Census, kept: Integers, cut: Booleans) -> None:
    """Warn if labels that no border cuts are so small beside the others that they are noise: each would be a grain of a
    twin.
    """
    size, whole = found.count[kept], ~cut[kept]
    rising = np.sort(size)
    half = int(rising[np.searchsorted(rising.cumsum(), rising.sum() / 2)])
    least = min(SPECK, -(-half // 10))
    specks = kept[whole & (size < least)]
    # grains of wide distributions become fewer towards the smallest, noise more
    if len(specks) > (whole & (size >= least) & (size < min(10 * least, half / 2))).sum():
        warn(
            f"{len(specks)} of {len(kept)} labels have fewer than {least} voxels (label {found.label[specks[0]]} "
            f"first), others {half}: their form is not known; if they are noise, leave them out with min_size={least}",
            PackingWarning,
        )


def _surfaces(
    values: Any, found: Census, kept: Integers, wraps: Booleans, smoothing: float, spacing: Floats, several: list[int]
) -> Iterator[tuple[int, tuple[Floats, NDArray[np.int32]]]]:
    """Yield the rows of a census that are kept, each with the surface of its label, as `block_surfaces`."""
    how: dict[str, Any] = {"wraps": wraps, "smoothing": smoothing, "spacing": spacing}
    if lazy_of(values) is not None:
        yield from block_surfaces(values, found, kept, several=several, **how)
        return
    surfaces = label_surfaces(found.numbered(values), len(found.label), **how)
    several += np.intersect1d(np.array(surfaces.several, dtype=np.int64) - 1, kept).tolist()
    for k in kept.tolist():
        yield k, surfaces.of(k + 1)


def _counted(image: Image) -> Census:
    """Return the labels of an image that has some."""
    found = census(image.values)
    if not len(found.label):
        raise InputError(f"the image of shape {image.values.shape} holds 0 labels: all is void; segment it first")
    if len(found.label) >= LEAST_GREY and is_grey(image.values):
        raise InputError(
            f"the image of shape {image.values.shape} has {len(found.label)} values, which rise and fall from voxel "
            "to voxel: these are grey values and no labels; make labels with segment(load_image(file)), at the prompt "
            "--segment"
        )
    return found


def is_grey(values: NDArray[Any]) -> bool:
    """Return whether values rise or fall over three voxels in a row at many of their changes.

    They do in 1 of 3 changes of noise and in more than half of those of smooth images, whose steps are wider than a
    voxel. Where two grains meet, a label changes once. Labels of single voxels here and there, of which few meet two
    others in a row, are no grey values.
    """
    planes = range(0, len(values), max(1, len(values) // GREY_PLANES))
    slopes = changes = rows_of_three = voxels = 0
    for k in planes:
        plane = np.asarray(values[k])
        for rows in (plane, plane.T):
            before, here, after = rows[:-2], rows[1:-1], rows[2:]
            solid = (before != 0) & (here != 0) & (after != 0)
            rising, falling = (before < here) & (here < after), (before > here) & (here > after)
            slopes += int((solid & (rising | falling)).sum())
            changes += int((solid & ((before != here) | (here != after))).sum())
            rows_of_three, voxels = rows_of_three + int(solid.sum()), voxels + int((rows != 0).sum())
    return 4 * slopes > changes and rows_of_three > APART * voxels


def _solid(
    points: Floats, faces: NDArray[Any], size: Floats, name: str, unit: str | None, shelf: Shelf | None
) -> Shape:
    """Return the solid that the surface of a label bounds, which is closed and free of crossings as it is made; its
    numbers lie on a shelf, if there is one.
    """
    faces = faces.astype(corner_type(len(points)))
    # axis by axis: NumPy takes several times as long for rows of three
    low = np.floor([along.min() for along in points.T])
    if max(along.max() - start for along, start in zip(points.T, low, strict=True)) * PARTS < 2**31:
        steps = np.rint((points - low) * PARTS).astype(np.int32)
        steps, faces = (steps, faces) if shelf is None else (shelf.put(steps), shelf.put(faces))
        return Shape.of(Mesh(LatticePoints(steps, size / PARTS, low * size), faces), name=name, unit=unit)
    return Shape.of(Mesh(points * size, faces), name=name, unit=unit)
