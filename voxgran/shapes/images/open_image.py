"""Images that stay in their files: opened as dask arrays, whose blocks are read when they are computed."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from voxgran._base.calls import explained
from voxgran._base.cluster import connected
from voxgran._base.errors import InputError, shown
from voxgran._base.files import as_path
from voxgran._base.guarded import refused
from voxgran.lattice.image import Image, as_block, lazily, lazy_of
from voxgran.shapes.images.image_files import load_image, with_lattice
from voxgran.shapes.images.sliced import Mapped, raw_image, sliced_image


@explained(hint='open_image("scan.zarr", voxel_size=0.1, unit="mm")')
def open_image(
    source: Any,
    *,
    key: str | None = None,
    voxel_size: Any = None,
    unit: str | None = None,
    block: Any = None,
    dask: Any = None,
    shape: Sequence[int] | None = None,
    dtype: Any = None,
) -> Image:
    """Open an image that may be larger than the memory.

    Parameters
    ----------
    source : path-like, dask array or array_like
        A zarr array or group (folder), an HDF5 file (``.h5``, ``.hdf5``, ``.hdf``, ``.nxs``), whose axes are x, y, z;
        a folder of TIFF or PNG files, one for each slice across z, in the order of the numbers in their names, or one
        ``.tif`` of several pages; ``.npy``; raw values with a header (``.nrrd``, ``.nhdr``, ``.mha``, ``.mhd``), in
        the same file or in one beside it, or without one (``.raw``), whose `shape` and `dtype` are given; ``.mat`` of
        MATLAB 7.3; or an array with axes x, y, z, such as a dask array. Whatever else :func:`load_image`
        reads, and raw values that are compressed, is read into memory.
    key : str, optional
        Which array of an HDF5 file or of a group of zarr; default: the only one, and of OME-Zarr the finest scale.
    voxel_size : float or (3,) array_like of float, optional
        Edges of a voxel; default: as the file says.
    unit : str, optional
        Unit of the voxel size; default: as the file says, where its voxel size is taken.
    block : int or (3,) array_like of int, optional
        Voxels along each edge of a block; default: about 8 million in all, in whole parts of the file.
    dask : str, cluster or client, optional
        Address of the scheduler of a Dask cluster, such as ``"tcp://HOST:8786"``, or an object of a cluster. This
        process is connected to it, as by ``distributed.Client(address)``: from then on its workers compute all blocks,
        also of other images. They need voxgran of the same version, and files under the same paths.
    shape, dtype : optional
        Voxels along x, y and z, and type of the numbers, of a file without a header, as of :func:`load_image`.

    Returns
    -------
    Image
        Its values are a dask array: nothing is read before it is computed. Functions of images take it block by block,
        on the threads of the machine, or on a cluster.

    Raises
    ------
    MissingFileError
        If there is no such file or folder.
    FileFormatError
        If it is no image, is cut, has slices of several shapes, or holds several arrays or none and no key is given.
    MissingLibraryError
        If the library that reads the format, or distributed for a cluster, is not installed.
    ClusterError
        If there is no scheduler.
    TooLargeError
        If it must be read as a whole or in parts, and these are too large for the memory.
    InputError
        If it has not three axes, an edge of a voxel is not a length, or a block has no whole number of voxels.
    UnknownNameError
        If the unit is unknown.

    Examples
    --------
    >>> import numpy as np
    >>> import voxgran as vg
    >>> np.save("large.npy", np.zeros((40, 50, 60), dtype=np.uint8))
    >>> image = vg.open_image("large.npy", voxel_size=0.1, block=20)
    >>> image.values.numblocks
    (2, 3, 3)
    """
    edges = None if block is None else as_block(block)
    if dask is not None:
        connected(dask, default=True)
    if isinstance(source, str | os.PathLike):
        # workers of a cluster may run in another folder
        path = as_path(source).absolute()
        with refused(path):
            image = _opened(path, key, shape, dtype)
        name = str(path)
    else:
        image, name = source if isinstance(source, Image) else Image(source), "the array"
    values: Any = image.values
    if getattr(values, "ndim", None) != 3 or not all(values.shape) or values.dtype.kind not in "biuf":
        told = f"the shape {values.shape} and {values.dtype}" if hasattr(values, "dtype") else shown(values)
        raise InputError(f"{name} has {told}: numbers along three axes are needed; choose a channel, or stack slices")
    lazy = (
        lazily(values, name, edges) if lazy_of(values) is None else values if edges is None else values.rechunk(edges)
    )
    return with_lattice(Image(lazy, image.voxel_size, image.origin, image.unit), voxel_size, unit)


def _opened(path: Path, key: str | None, shape: Any, dtype: Any) -> Image:
    """Return the image in a file or folder, with values that are sliced when they are read, or are in memory."""
    if shape is not None or dtype is not None:
        return raw_image(path, shape, dtype)
    image = sliced_image(path, key) or load_image(path, key=key)
    if isinstance(image.values, np.memmap):
        found = image.values
        order = "C" if found.flags.c_contiguous else "F"
        return Image(Mapped(path, found.offset, found.dtype, found.shape, order, found.ndim))  # type: ignore[arg-type]
    return image
