"""Label images: any packing on a lattice, for LBM, FFT and pore-network computations."""

import math
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from voxgran._base.arrays import Floats, as_array, as_vector
from voxgran._base.calls import explained
from voxgran._base.errors import InputError, PackingWarning, TooLargeError, shown, warn
from voxgran._base.files import output_suffix, written_whole
from voxgran._base.units import stated_unit
from voxgran._base.vtk_data import attach_texts, image_data, write_data
from voxgran.containers.model import tilt_of
from voxgran.lattice.grid import check_voxel_size
from voxgran.lattice.image import as_block, as_edges, in_parts, lazy_of, stored
from voxgran.measures.painting import labels_on
from voxgran.packing.model import Packing, check_packing
from voxgran.shapes.images.tiff_files import image_library

#: most voxels of an image (int32 labels of 16 GB)
VOXEL_LIMIT = 4 * 10**9
#: what images are kept as
SUFFIXES = (".vti", ".tif", ".tiff", ".zarr")
#: bytes from which on a TIFF file needs offsets of 64 bits, with room for its tags
LARGE = 2**32 - 2**25


@explained(hint="to_image(packing, 0.1)")
def to_image(
    packing: Packing, voxel_size: "ArrayLike", *, labels: "bool | ArrayLike" = True, block: Any = None
) -> NDArray[Any]:
    """Put a packing on a lattice over the bounds of its container.

    Parameters
    ----------
    packing : Packing
        Any packing.
    voxel_size : float or (3,) array_like of float
        Edges of a voxel, in the unit of lengths.
    labels : bool or (n,) array_like of int
        Whether voxels tell which grain they belong to, or only whether they are solid; or the label of each grain,
        above 0, such as ``packing.provenance["labels"]`` of a packing that was made of a label image.
    block : int or (3,) array_like of int, optional
        Voxels along each edge of a block of a dask array, whose blocks are painted when they are computed, with the
        same result. Default: an array in memory.

    Returns
    -------
    (nx, ny, nz) ndarray of int32, int64 or bool
        Axes x, y, z; in 2D nz = 1. With labels 0 is void and k + 1 is grain k, unless they were given (int64, where one
        is beyond int32); otherwise True is solid (``~image`` is the pore space). Voxel (0, 0, 0) has its corner at
        ``packing.container.bounds[0]``; of a tilted container it is the upright box of its bounds, which repeats by the
        same edges. A dask array if a block is given.

    Raises
    ------
    InputError
        If an edge of a voxel is not a finite number above 0 or larger than the container is wide, a grain is an open
        surface, the labels are not one whole number above 0 for each grain, or a block has no whole number of voxels.
    TooLargeError
        If there are more than VOXEL_LIMIT voxels, and no block is given.
    MissingLibraryError
        If a block is given and dask is not installed.

    Warns
    -----
    PackingWarning
        If a periodic length or a tilt is not a whole number of voxels: the image then does not repeat seamlessly.

    Notes
    -----
    A voxel belongs to a grain that holds its center; where several do, to the first of them. Grains continue across
    periodic faces. Outside of a container that is no box the image is void.

    Examples
    --------
    >>> import voxgran as vg
    >>> bed = vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), "rsa", count=10)
    >>> image = vg.to_image(bed, voxel_size=0.1)
    >>> image.shape, int(image.max())
    ((40, 40, 40), 10)
    """
    check_packing(packing, "packing")
    known = None if isinstance(labels, bool | np.bool_) else _checked(labels, packing.count)
    most = VOXEL_LIMIT if block is None else math.inf
    edges, counts = lattice_over(packing, voxel_size, most)

    def painted(part: Any = None) -> NDArray[Any]:
        image = labels_on(packing, packing.container.bounds[0], edges, counts, part)
        if known is not None:
            return known[image]
        return image if labels else image > 0

    if block is None:
        return painted()
    kind = np.dtype(np.bool_ if known is None and not labels else np.int32 if known is None else known.dtype)
    return in_parts(painted, counts, as_block(block), kind)


def _checked(labels: "ArrayLike", count: int) -> NDArray[Any]:
    """Return 0 for void and the label of each grain."""
    given = as_array(labels, "labels")
    whole = given.shape == (count,) and (given.dtype.kind in "iu" or not count)
    if not whole or (count and not 0 < int(given.min()) <= int(given.max()) < 2**63):
        raise InputError(f"labels is {shown(labels)}: give one whole number above 0 for each of the {count} grains")
    small = int(given.max(initial=0)) < 2**31
    return np.concatenate([[0], given]).astype(np.int32 if small else np.int64)


def lattice_over(
    packing: Packing, voxel_size: "ArrayLike", most: float = VOXEL_LIMIT
) -> tuple[Floats, tuple[int, int, int]]:
    """Return the edges of a voxel, (3,), and the numbers of voxels of :func:`to_image`, from the lower corner of the
    container's bounds; the last voxels may extend beyond the upper one.

    Raises
    ------
    InputError
        If there are neither one nor three edges, one is not a finite number above 0, or larger than the container is
        wide.
    TooLargeError
        If there are more than `most` voxels.
    """
    edges = np.array(as_edges(voxel_size))
    lower, upper = packing.container.bounds
    for edge, extent in list(zip(edges, upper - lower, strict=True))[: packing.dimension]:
        check_voxel_size(float(edge), float(extent), "the container")
    exact = (upper - lower) / edges
    counts = np.where(np.abs(exact - np.rint(exact)) < 1e-9 * np.maximum(exact, 1), np.rint(exact), np.ceil(exact))
    nx, ny, nz = (max(int(n), 1) for n in counts)
    if nx * ny * nz > most:
        raise TooLargeError(
            f"the image has {nx} x {ny} x {nz} voxels: at most {most} fit; take larger voxels, or give a block"
        )
    for axis in np.flatnonzero(np.array(packing.container.periodic) & (counts != exact)):
        if abs(exact[axis] - counts[axis]) > 1e-9 * counts[axis]:
            warn(
                f"voxel_size is {edges[axis]:g}: the period along {'xyz'[axis]} is {exact[axis]:.6g} voxels and the "
                f"image does not repeat seamlessly; take {(upper - lower)[axis] / counts[axis]:.10g}",
                PackingWarning,
            )
    for name, along, tilt in zip(("xy", "xz", "yz"), (0, 0, 1), tilt_of(packing.container), strict=True):
        if abs(tilt / edges[along] - np.rint(tilt / edges[along])) > 1e-9 * counts[along]:
            warn(
                f"voxel_size is {edges[along]:g}: the tilt {name} is {tilt / edges[along]:.6g} voxels and the image "
                "does not repeat seamlessly; take one that divides the tilt, too",
                PackingWarning,
            )
    return edges, (nx, ny, nz)


@explained(hint='save_image(image, "bed.vti", voxel_size=0.1)')
def save_image(
    image: NDArray[Any],
    path: str | os.PathLike[str],
    *,
    voxel_size: "ArrayLike",
    origin: "ArrayLike" = (0.0, 0.0, 0.0),
    unit: str | None = None,
    overwrite: bool = False,
) -> None:
    """Write an image as a ``.vti`` file, for ParaView, as a stack of pages, for ImageJ and scikit-image, or by blocks.

    Parameters
    ----------
    image : (nx, ny, nz) ndarray of int, float or bool
        One value a voxel, such as :func:`to_image` returns; kept as the cell data ``image``. A dask array may be larger
        than the memory where it is kept as ``.zarr``.
    path : path-like
        What to write: ``.zarr``, a folder as :func:`voxgran.open_image` opens it; ``.vti``; or ``.tif`` or ``.tiff``,
        whose pages are z, rows y and columns x, as :func:`load_image` reads them. Such a stack does not hold the
        origin, and has whole numbers of at most 32 bits, where the values allow it; the edges of a voxel are kept as by
        ImageJ.
    voxel_size : float or (3,) array_like of float
        Edges of a voxel, in the unit of lengths.
    origin : (3,) array_like of float
        Corner of voxel (0, 0, 0).
    unit : str, optional
        Unit of lengths, which the file keeps.
    overwrite : bool
        Whether a file that is there may be replaced.

    Raises
    ------
    FileFormatError
        If the suffix is none of these.
    MissingLibraryError
        If the library that writes TIFF or zarr is not installed.
    InputError
        If the image has not three axes or holds no numbers, or a value breaks a rule.
    UnknownNameError
        If the unit is unknown.
    OutputExistsError
        If the file is there and `overwrite` is false.
    OutputError
        If it cannot be written; what was there before is untouched.

    Examples
    --------
    >>> import voxgran as vg
    >>> bed = vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), "rsa", count=10)
    >>> vg.save_image(vg.to_image(bed, voxel_size=0.1), "grains.vti", voxel_size=0.1)
    >>> vg.load_image("grains.vti").values.shape
    (40, 40, 40)
    """
    suffix = output_suffix(path, SUFFIXES, "images are kept")
    lazy = lazy_of(image) if suffix == ".zarr" else None
    array = as_array(image, "image") if lazy is None else lazy
    if array.ndim != 3 or array.dtype.kind not in "biuf":
        raise InputError(f"image has shape {array.shape} and type {array.dtype}: give numbers along x, y and z")
    edges, (x, y, z) = as_edges(voxel_size), (float(value) for value in as_vector(origin, "origin"))
    if suffix == ".zarr":
        told = {"voxel_size": edges, "origin": (x, y, z), "unit": stated_unit(unit)}
        with written_whole(path, overwrite=overwrite, is_own=_is_of_zarr) as draft:
            stored(array, draft, {name: value for name, value in told.items() if value is not None})
        return
    name = stated_unit(unit)
    data: Any = image_data(array, "image", voxel_size=edges, origin=(x, y, z)) if suffix == ".vti" else _pages(array)
    lattice = _imagej_lattice(edges, name)
    with written_whole(path, overwrite=overwrite) as draft:
        if suffix == ".vti":
            attach_texts(data.GetFieldData(), {"unit": name} if name else {})
            write_data("vtkXMLImageDataWriter", data, draft)
        else:
            # earlier versions of tifffile take pages of one column for the rows of a single page
            with image_library("tifffile").TiffWriter(draft, bigtiff=data.nbytes > LARGE) as file:
                for part in data if data.ndim == 3 and data.shape[2] == 1 else [data]:
                    file.write(part, photometric="minisblack", metadata=None, contiguous=True, **lattice)


def _is_of_zarr(path: Path) -> bool:
    """Return whether a file has a name that zarr gives."""
    return path.name == "zarr.json" or path.name.isdigit()


def _imagej_lattice(edges: tuple[float, float, float], unit: str | None) -> dict[str, Any]:
    """Return the tags by which ImageJ keeps the edges of a voxel, for any type of numbers."""
    kept = f"ImageJ=1.11a\nspacing={edges[2]!r}\n" + (f"unit={unit}\n" if unit else "")
    return {"resolution": (1 / edges[0], 1 / edges[1]), "resolutionunit": 1, "description": kept}


def _pages(array: NDArray[Any]) -> NDArray[Any]:
    """Return the pages of an image in a type that other programs read; one page is a picture, whose rows go down."""
    low, high = array.min(initial=0), array.max(initial=0)
    small = next((kind for kind in (np.uint8, np.uint16, np.int32) if _holds(kind, low, high)), array.dtype)
    kept = array if array.dtype.kind == "f" else array.astype(small)
    return kept[:, ::-1, 0].T if kept.shape[2] == 1 else kept.transpose(2, 1, 0)


def _holds(kind: Any, low: Any, high: Any) -> bool:
    """Return whether a type of whole numbers holds a range."""
    return bool(np.iinfo(kind).min <= low and high <= np.iinfo(kind).max)
