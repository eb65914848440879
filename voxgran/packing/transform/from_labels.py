"""The packing that a scanned sample is: every label of an image a grain where it lies."""

import os
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from voxgran._base.arrays import as_number
from voxgran._base.axes import Periodic, as_periodic, axis_names
from voxgran._base.calls import explained
from voxgran._base.errors import PackingWarning, warn
from voxgran._base.progress import OnStep
from voxgran._base.scalars import cube_root
from voxgran.containers.kinds.box import Box
from voxgran.lattice.census import census
from voxgran.packing.model import Packing
from voxgran.shapes.images.image_files import Image, voxel_sizes, voxel_unit
from voxgran.shapes.images.labels import LabelledGrain, image_of, labelled_grains


@explained(hint='packing_of_labels("scan.tif", voxel_size=0.1)')
def packing_of_labels(
    source: str | os.PathLike[str] | NDArray[Any] | Image,
    *,
    voxel_size: Any = None,
    border: str = "keep",
    surface: str = "smooth",
    smoothing: float = 1.0,
    periodic: Periodic = False,
    gravity: "ArrayLike | None" = None,
    min_size: int = 1,
    unit: str | None = None,
    key: str | None = None,
    on_step: OnStep | None = None,
) -> Packing:
    """Make a packing of a label image, so that it can be verified, measured, shown and packed on as any other.

    Parameters
    ----------
    source : path-like, Image or (nx, ny, nz) ndarray of int
        As :func:`voxgran.load_labels`.
    voxel_size : float or (3,) array_like of float, optional
        Edges of a voxel; default: as the file says.
    border : {"keep", "drop"}
        What becomes of grains that touch the border of the image, where they are cut: they are kept, and end in the
        wall, as the sample does; or they are left out.
    surface : {"smooth", "voxel"}
        Smooth surfaces, or the faces of the voxels. Either way neighbours share the triangles between them and do not
        overlap, and each grain has the volume of its voxels; ``largest_volume_error`` of the provenance says by how
        much the volumes differ, above all where a label has several pieces.
    smoothing : float
        Over how many voxels the steps of the voxels are rounded; at most 5.
    periodic : str, bool or sequence
        Axes along which the image repeats, such as ``"xy"``, as of :class:`voxgran.Box`:
        grains go on across these faces.
    gravity : str or (3,) array_like of float, optional
        Where gravity acts in the sample, an axis such as ``"-z"`` or any vector; default: nowhere. With it measures
        leave out the room above the grains, as of any bed.
    min_size : int
        Voxels of the smallest labels; smaller ones, such as specks of noise, are left out and count as void.
    unit : str, optional
        Unit of the voxel size; default: as the file says, where its voxel size is taken.
    key : str, optional
        Which array of an ``.npz`` or ``.vti`` file.
    on_step : callable, optional
        Told of each grain; default: at a terminal and in a notebook, a line on the error stream every ten seconds,
        elsewhere a record of the logger ``voxgran`` of the level INFO.

    Returns
    -------
    Packing
        In the box of the image; each grain has a shape of its own. The contact gap is the edge of a voxel, or of the
        cube of its volume. Where grains that the border cuts were left out, the container is the box around the
        others, along axes that do not repeat: beyond it the sample is not known. Grains that were left out count as
        void in this box, so that solid fractions are correct with ``"keep"`` only.

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
        If the image holds no label or what is no label, no grain is left, or an option is out of range.

    Warns
    -----
    PackingWarning
        If no gravity is given and the grains leave just one side of the image empty by more than their mean diameter,
        or labels have several pieces or are specks, as of :func:`voxgran.load_labels`.

    Examples
    --------
    >>> import numpy as np
    >>> import voxgran as vg
    >>> image = np.zeros((16, 16, 16), dtype=int)
    >>> image[2:6, 2:6, 2:6], image[8:14, 8:14, 8:14] = 1, 2
    >>> packing = vg.packing_of_labels(image, voxel_size=0.5)
    >>> packing.count, packing.position.round(3).tolist()
    (2, [[2.0, 2.0, 2.0], [5.5, 5.5, 5.5]])
    """
    turns = as_periodic(periodic)
    image = image_of(source, key)
    unit = voxel_unit(unit, voxel_size, image)
    how: dict[str, Any] = {"border": border, "surface": surface, "periodic": turns, "min_size": min_size}
    how["smoothing"] = as_number(smoothing, "smoothing")
    grains = labelled_grains(image, voxel_size=voxel_size, unit=unit, on_step=on_step, **how)
    size = np.array(voxel_sizes(voxel_size, image))
    box = Box(np.array(image.values.shape) * size, turns, origin=image.origin)
    if border == "drop" and len(grains) < (census(image.values).count >= min_size).sum():
        box = _around(grains, box)
    errors = np.abs([grain.shape.volume / grain.volume - 1 for grain in grains])
    record = {
        "method": "labels",
        "parameters": {
            "source": str(source) if isinstance(source, str | os.PathLike) else "array",
            "voxel_size": size.tolist(),
            **how,
            "periodic": axis_names(turns),
        },
        "labels": [grain.label for grain in grains],
        "largest_volume_error": float(errors.max()),
    }
    packing = Packing.of(
        tuple(grain.shape for grain in grains),
        box,
        position=np.array([grain.position for grain in grains]),
        shape_id=np.arange(len(grains)),
        provenance=record,
        unit=unit,
        gravity=gravity,
        # a larger gap, as by the longest edge, would count pairs that are open across the shorter ones
        contact_gap=cube_root(float(size.prod())),
    )
    if packing.gravity is None and gravity is None:
        _warn_of_room(packing)
    return packing


def _warn_of_room(packing: Packing) -> None:
    """Warn if just one side of the container is empty by more than a mean diameter, as the upper one of a bed is."""
    lower, upper = packing.container.bounds
    vertices = [packing.world_vertices(grain) for grain in range(packing.count)]
    below = np.min([corners.min(axis=0) for corners in vertices], axis=0) - lower
    above = upper - np.max([corners.max(axis=0) for corners in vertices], axis=0)
    room = np.where(packing.container.periodic, 0.0, [below, above])
    wide = np.argwhere(room > packing.diameters.mean())
    if len(wide) == 1:
        end, axis = wide[0]
        side, name = ("lower", "upper")[end], "xyz"[axis]
        warn(
            f"the grains leave {room[end, axis]:.3g} of {upper[axis] - lower[axis]:.3g} empty at the {side} side of "
            f"{name}, which measures count as voids: of a bed that gravity holds, give gravity='{'+-'[end]}{name}', "
            "of another sample gravity='none'",
            PackingWarning,
        )


def _around(grains: list[LabelledGrain], box: Box) -> Box:
    """Return the box around grains, along its periodic axes as long as it was."""
    low = np.min([grain.position + grain.shape.vertices.min(axis=0) for grain in grains], axis=0)
    high = np.max([grain.position + grain.shape.vertices.max(axis=0) for grain in grains], axis=0)
    lower, upper = box.bounds
    low, high = np.where(box.periodic, lower, low), np.where(box.periodic, upper, high)
    return Box(high - low, box.periodic, origin=low)
