"""Grains of a label image: one shape per label, and a table of what is there.

Each label is cut out. Its surface is the smooth one that keeps its volume (:mod:`voxgran.lattice.surface`), that of its
voxels (:mod:`voxgran.lattice.cuberille`), or one that its neighbours share (:mod:`voxgran.lattice.interfaces`).
"""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from voxgran._base import ExplainedAttributes
from voxgran._base.arrays import Booleans, Floats, Integers, as_array, as_choice, as_number
from voxgran._base.axes import Periodic, as_periodic
from voxgran._base.calls import explained
from voxgran._base.errors import DirtyMeshError, InputError, PackingWarning
from voxgran._base.lazy import load
from voxgran._base.progress import OnStep, Step, reported, silent
from voxgran._base.warning import warn
from voxgran.lattice.census import Census, census
from voxgran.lattice.cuberille import voxel_surface
from voxgran.lattice.interfaces import fitted_surface
from voxgran.lattice.surface import smooth_surface
from voxgran.shapes.images.image_files import Image, load_image, voxel_sizes, voxel_unit
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.repairing.bodies import split
from voxgran.shapes.repairing.diagnose import as_solid
from voxgran.shapes.repairing.repair import repair

if TYPE_CHECKING:
    from xarray import Dataset

BORDER, SURFACES = ("drop", "keep"), ("smooth", "voxel")
#: widest Gaussian, in voxels: it takes six times that around each grain
WIDEST = 20.0
#: least number of values of a grey image, and how many planes are looked at to recognize one
LEAST_GREY, GREY_PLANES = 100, 16


@dataclass(frozen=True, slots=True)
class LabelledGrain(ExplainedAttributes):
    """One grain of a label image."""

    label: int  # its label
    shape: Shape  # the solid, in the unit of the voxel size
    position: Floats  # centroid in the image, (3,)
    pieces: int  # number of separate pieces of the label; the largest one is the shape
    volume_error: float  # relative difference of the volumes of the shape and of the voxels
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
    unit: str | None = None,
    key: str | None = None,
    on_step: OnStep | None = None,
) -> list[Shape]:
    """Make a shape of each label of an image.

    Parameters
    ----------
    source : path-like, Image or (nx, ny, nz) ndarray of int
        A file as :func:`voxgran.load_image` takes it, or labels with 0 for void; a memory map may be larger than the
        memory.
    voxel_size : float or (3,) array_like of float, optional
        Edges of a voxel; default: as the file says.
    border : {"keep", "drop"}
        What becomes of grains that touch the border of the image, where they are cut: they are kept as they are, with a
        warning, or left out. As in :func:`voxgran.packing_of_labels` no grain is left out unasked.
    surface : {"smooth", "voxel"}
        The smooth surface that keeps the volume, or the faces of the voxels. Voxels that share no face are not joined.
    smoothing : float
        Standard deviation of the Gaussian that rounds the steps of the voxels, in voxels; at most 20.
    periodic : str, bool or sequence
        Axes along which the image repeats, such as ``"xy"``, as of :class:`voxgran.Box`:
        grains go on across these faces, which cut none.
    unit : str, optional
        Unit of the voxel size; recorded. Default: as the file says, where its voxel size is taken.
    key : str, optional
        Which array of an ``.npz`` or ``.vti`` file.
    on_step : callable, optional
        Told of each grain; default: at a terminal and in a notebook, a line on the error stream every ten seconds.

    Returns
    -------
    list of Shape
        Named ``label K``, rising. Each has the volume of its voxels to round-off, unless it has several pieces, of
        which the largest is kept.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If it is of no known format, or damaged.
    MissingLibraryError
        If the library that reads the format is not installed.
    InputError
        If the image has not three axes, holds no label or what is no label, no grain is left, or an option is out of
        range.

    Warns
    -----
    PackingWarning
        If labels have several pieces, or grains that are kept are cut by the border of the image.

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
    grains = list(labelled_grains(image, voxel_size=voxel_size, unit=unit, fitted=False, on_step=on_step, **how))
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
    length = {"units": "unit of the voxel size"}
    rows, corners = ("label",), ("label", "axis")
    dataset: Dataset = load("xarray").Dataset(
        {
            "voxels": (rows, found.count, {"units": "1", "long_name": "number of voxels"}),
            "volume": (rows, found.count * size.prod(), {"units": "volume", "long_name": "volume of the voxels"}),
            "lower": (corners, origin + found.lower * size, {**length, "long_name": "lower corner of the box"}),
            "upper": (corners, origin + found.upper * size, {**length, "long_name": "upper corner of the box"}),
            "centroid": (corners, origin + found.middle * size, {**length, "long_name": "mean of the voxel centers"}),
            "touches_border": (rows, found.at_border, {"units": "1", "long_name": "whether the image cuts the grain"}),
        },
        coords={"label": found.label, "axis": ["x", "y", "z"]},
    )
    return dataset


def image_of(source: str | os.PathLike[str] | NDArray[Any] | Image, key: str | None = None) -> Image:
    """Return an image that is given as a file, as an array or as it is.

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
        return load_image(source, key=key)
    if isinstance(source, Image):
        return source
    return Image(as_array(source, "image"))


def labelled_grains(
    image: Image,
    *,
    voxel_size: Any,
    border: str,
    surface: str,
    smoothing: float,
    periodic: Periodic,
    unit: str | None,
    fitted: bool,
    on_step: OnStep | None = None,
) -> Iterator[LabelledGrain]:
    """Yield the grains of a label image, rising by label.

    Where they are to be fitted, smooth surfaces of neighbours do not overlap but are one, and none bulges through the
    border of the image.

    Raises
    ------
    InputError
        As :func:`load_labels`.
    """
    as_choice(border, "border", BORDER)
    exact = as_choice(surface, "surface", SURFACES) == "voxel"
    sigma, size = as_number(smoothing, "smoothing", above=0.0, at_most=WIDEST), np.array(voxel_sizes(voxel_size, image))
    wraps, found = np.array(as_periodic(periodic)), _counted(image)
    cut = ((found.lower == 0) | (found.upper == np.array(image.values.shape)))[:, ~wraps].any(axis=1)
    kept = np.flatnonzero(~cut) if border == "drop" else np.arange(len(found.label))
    if not len(kept):
        raise InputError(
            f"all {len(found.label)} labels touch the border of the image: they are left out unless border is 'keep'"
        )
    several, told = [], reported(on_step) or silent
    for done, k in enumerate(kept):
        told(Step(stage="grains", done=done, total=len(kept), text=f"{done} of {len(kept)} labels"))
        label, upper = int(found.label[k]), found.upper[k]
        mask = np.asarray(image.values[tuple(slice(a, b) for a, b in zip(found.lower[k], upper, strict=True))]) == label
        mask, lower = _unwrapped(mask, found.lower[k], wraps & (mask.shape == np.array(image.values.shape)))
        if exact:
            bodies = split(*voxel_surface(mask))
        elif fitted:
            bodies = _fitted(image.values, mask, lower, wraps, sigma)
        else:
            bodies = _smooth(mask, sigma)
        if len(bodies) > 1:
            several.append(label)
        shape = _solid(*bodies[0], size, f"label {label}", unit, uncrossed=exact or fitted)
        position = np.array(shape.offset) + np.array(image.origin) + lower * size
        error = shape.volume / (found.count[k] * size.prod()) - 1
        yield LabelledGrain(label, shape, position, len(bodies), float(error), bool(cut[k]))
    if several:
        warn(
            f"{len(several)} of {len(kept)} labels have several pieces (label {several[0]} first): the largest piece "
            "of each is kept; label connected bodies, or clean the image",
            PackingWarning,
        )


def _unwrapped(mask: Any, lower: Integers, wraps: Booleans) -> tuple[Any, Integers]:
    """Put a grain that goes on across a periodic face together again: its widest gap is where it begins and ends."""
    start = lower.copy()
    for axis in np.flatnonzero(wraps):
        taken = np.flatnonzero(mask.any(axis=tuple(other for other in range(3) if other != axis)))
        gaps = np.diff(np.append(taken, taken[0] + mask.shape[axis]))
        first = int(taken[(int(gaps.argmax()) + 1) % len(taken)])
        extent = mask.shape[axis] - int(gaps.max()) + 1
        mask = np.take(mask, (first + np.arange(extent)) % mask.shape[axis], axis=axis)
        start[axis] = first
    return mask, start


def _counted(image: Image) -> Census:
    """Return the labels of an image that has some."""
    found = census(image.values)
    if not len(found.label):
        raise InputError(f"the image of shape {image.values.shape} holds 0 labels: all is void; segment it first")
    if len(found.label) >= LEAST_GREY and _is_grey(image.values):
        raise InputError(
            f"the image of shape {image.values.shape} has {len(found.label)} values, which rise and fall from voxel "
            "to voxel: these are grey values and no labels; make labels with segment(load_image(file)), at the prompt "
            "--segment"
        )
    return found


def _is_grey(values: NDArray[Any]) -> bool:
    """Return whether values rise or fall over three voxels in a row at many of their changes.

    They do in 1 of 3 changes of noise and in more than half of those of smooth images, whose steps are wider than a
    voxel. Where two grains meet, a label changes once.
    """
    planes = range(0, len(values), max(1, len(values) // GREY_PLANES))
    slopes = changes = 0
    for k in planes:
        plane = np.asarray(values[k])
        for rows in (plane, plane.T):
            before, here, after = rows[:-2], rows[1:-1], rows[2:]
            solid = (before != 0) & (here != 0) & (after != 0)
            rising, falling = (before < here) & (here < after), (before > here) & (here > after)
            slopes += int((solid & (rising | falling)).sum())
            changes += int((solid & ((before != here) | (here != after))).sum())
    return 4 * slopes > changes


def _smooth(mask: Booleans, smoothing: float) -> list[tuple[Floats, Integers]]:
    """Return the bodies of the smooth surface of a mask; smoothing is less where it would tear it apart."""
    while True:
        bodies = split(*smooth_surface(mask, smoothing=smoothing))
        if len(bodies) == 1 or smoothing < 0.3:
            return bodies
        smoothing /= 2


def _fitted(
    values: NDArray[Any], mask: Booleans, lower: Integers, wraps: Booleans, smoothing: float
) -> list[tuple[Floats, Integers]]:
    """Return the bodies of a grain with a surface that its neighbours share, in voxels from its lower corner."""
    ring = int(np.ceil(3 * smoothing)) + 2
    places, beyond = [], np.zeros(np.array(mask.shape) + 2 * ring, dtype=np.bool_)
    for axis, many in enumerate(values.shape):
        place = lower[axis] - ring + np.arange(beyond.shape[axis])
        if not wraps[axis]:
            outside = (place < 0) | (place >= many)
            beyond |= outside.reshape([-1 if k == axis else 1 for k in range(3)])
            # the image is mirrored at its border
            place = np.minimum(place % (2 * many), 2 * many - 1 - place % (2 * many))
        places.append(place % many)
    around, own = np.asarray(values[np.ix_(*places)]), np.pad(mask, ring)
    if not beyond.any() and not around[~own].any():
        # nothing is near
        return _smooth(mask, smoothing)
    vertices, faces = fitted_surface(around.astype(np.int64), own, beyond, smoothing=smoothing)
    return split(vertices - ring, faces)


def _solid(points: Floats, faces: Integers, size: Floats, name: str, unit: str | None, *, uncrossed: bool) -> Shape:
    """Return the solid that a surface in voxels bounds."""
    try:
        mesh = Mesh(*as_solid(points * size, faces, name, uncrossed=uncrossed))
    except DirtyMeshError:
        return repair(points * size, faces, name=name, unit=unit, bodies="largest").shape
    return Shape.of(mesh, name=name, unit=unit)
