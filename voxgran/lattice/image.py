"""An image with what is known of its lattice, and the edges of voxels that functions of images take.

Images in blocks are dask arrays, which may be larger than the memory. Work on blocks is left to dask, which runs it by
its scheduler: threads, or the cluster that a client of `distributed` has connected. What is needed several times, such
as numbers of bodies, is kept in a temporary folder.
"""

import math
import mmap
import shutil
import sys
import tempfile
import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from voxgran._base import ExplainedAttributes
from voxgran._base.arrays import Integers, as_count, check_lengths, float_array
from voxgran._base.errors import FileFormatError, InputError, TooLargeError, shown
from voxgran._base.lazy import load_extra
from voxgran._base.machine import memory_limit

#: edges of a voxel along x, y and z
Edges = tuple[float, float, float]
#: relative difference of edges, due to rounding in files, up to which they are equal
EQUAL = 1e-6


@dataclass(frozen=True, slots=True)
class Image(ExplainedAttributes):
    """An image and what its file says of its lattice.

    Attributes
    ----------
    values : ndarray
        Axes x, y, z; not read into memory where the file allows that.
    voxel_size : (3,) tuple of float or None
        Edges of a voxel, where the file tells.
    origin : (3,) tuple of float
        Lower corner of voxel (0, 0, 0).
    unit : str or None
        Unit of these lengths, where the file tells, as a ``.nrrd`` file may.
    """

    values: NDArray[Any]
    voxel_size: Edges | None = None
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    unit: str | None = None

    def __repr__(self) -> str:
        known = "" if self.voxel_size is None else f", voxel_size={self.voxel_size}"
        return f"Image(shape={self.values.shape}, {self.values.dtype}{known})"

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """Return the values, so that functions of arrays take an image."""
        return np.array(self.values, dtype=dtype) if copy else np.asarray(self.values, dtype=dtype)


def as_edges(value: Any) -> Edges:
    """Return the three edges of a voxel, of which one may be given for all.

    Raises
    ------
    InputError
        If there are neither one nor three, or a length is not between 1e-60 and 1e60.
    """
    sizes = float_array(value)
    if sizes is None or sizes.shape not in ((), (3,)) or not (np.isfinite(sizes).all() and (sizes > 0).all()):
        raise InputError(f"voxel_size is {shown(value)}: every edge must be a finite number above 0; give one or three")
    check_lengths(sizes, "voxel_size")
    x, y, z = np.broadcast_to(sizes, (3,)).tolist()
    return x, y, z


def known_edges(value: Any, image: Any) -> Edges | None:
    """Return the edges of a voxel: those given, or else those that an Image tells; None where neither tells."""
    if value is None:
        value = image.voxel_size if isinstance(image, Image) else None
    return None if value is None else as_edges(value)


def are_equal(edges: Edges) -> bool:
    """Return whether the edges of a voxel are equal but for rounding."""
    return max(edges) - min(edges) <= EQUAL * min(edges)


def voxel_sizes(value: Any, image: Image) -> Edges:
    """Return the edges of a voxel: those given, or else those of the file.

    Raises
    ------
    InputError
        If neither tells, or a length is not between 1e-60 and 1e60.
    """
    edges = known_edges(value, image)
    if edges is None:
        raise InputError("voxel_size is None: the image does not tell it; give the edge of a voxel")
    return edges


#: voxels of a block, where the file does not ask for more
BLOCK = 2**23
#: share of the memory that a block of a file may take, and most parts of a file, and of a block, each of which takes
#: about 30 us to open
SHARE, PARTS, PARTS_OF_BLOCK = 0.25, 10**8, 4096
#: bytes of a file that small arrays share
SHARED = 2**25


def lazy_of(image: Any) -> Any:
    """Return the dask array that an image is, or that an Image holds; None for others.

    Raises
    ------
    InputError
        If its blocks are of unknown sizes.
    """
    values = image.values if isinstance(image, Image) else image
    # whoever has a dask array has loaded dask
    array = getattr(sys.modules.get("dask.array"), "Array", None)
    if array is None or not isinstance(values, array):
        return None
    if any(map(math.isnan, values.shape)):
        raise InputError(f"the image has the shape {values.shape}: call its compute_chunk_sizes(), which finds them")
    return values


def block_library(name: str) -> Any:
    """Load a library of the extra `blocks`, which images in blocks need."""
    return load_extra(name, "blocks", "images in blocks need it")


def lazily(source: Any, name: str, edges: Sequence[int] | None = None) -> Any:
    """Return what slices like an array as a dask array, in blocks of whole parts of the file if it has `chunks`.

    Raises
    ------
    FileFormatError
        If a part of the file is empty.
    TooLargeError
        If a part of the file is larger than a quarter of the memory, or there are more than a hundred million parts.
    """
    array, size = block_library("dask.array"), np.dtype(source.dtype).itemsize
    parts = getattr(source, "chunks", None)
    if parts is not None and min(parts) < 1:
        raise FileFormatError(f"{name} is kept in parts of {' x '.join(map(str, parts))} voxels: write it again")
    if parts is not None and math.prod(parts) * size > SHARE * memory_limit():
        raise TooLargeError(
            f"{name} is kept in parts of {' x '.join(map(str, parts))} voxels, which are read as a whole: one is more "
            "than a quarter of the memory; write it in smaller parts"
        )
    if (
        parts is not None
        and math.prod(math.ceil(n / part) for n, part in zip(source.shape, parts, strict=True)) > PARTS
    ):
        raise TooLargeError(
            f"{name} has {' x '.join(map(str, source.shape))} voxels in parts of {' x '.join(map(str, parts))}: these "
            f"are more than {PARTS:.0e} parts; write it in larger parts, or again if it is damaged"
        )
    voxels = BLOCK if parts is None else min(BLOCK, PARTS_OF_BLOCK * math.prod(parts))
    most = {"limit": voxels * size, "dtype": source.dtype, "previous_chunks": parts}
    chunks = array.core.normalize_chunks("auto" if edges is None else tuple(edges), source.shape, **most)
    return array.from_array(source, chunks=chunks, name=False)


def of_blocks(values: Any, function: Callable[..., Any], *arguments: Any) -> list[Any]:
    """Return function(block, start, *arguments) of each block, in the order of the blocks; start (3,) is its corner.

    Of several arrays in the same blocks, function(block, start, block of the next array, ..., *arguments).
    """
    arrays = values if isinstance(values, list) else [values]

    def found(block: NDArray[Any], *more: NDArray[Any], block_info: Any) -> NDArray[Any]:
        start = np.array([low for low, _ in block_info[0]["array-location"]])
        result = np.empty((1, 1, 1), dtype=object)
        result[0, 0, 0] = function(block, start, *more, *arguments)
        return result

    how = {"dtype": object, "chunks": (1, 1, 1), "meta": np.empty((0, 0, 0), dtype=object)}
    return list(block_library("dask.array").map_blocks(found, *arrays, **how).compute().ravel())


def not_finite(values: Any) -> tuple[int, ...] | None:
    """Return the first voxel, in the order of the lattice, whose number is not finite; None if all are."""

    def first(block: NDArray[Any], start: Any) -> tuple[int, ...] | None:
        bad = ~np.isfinite(block)
        at = np.unravel_index(bad.argmax(), block.shape) if bad.any() else None
        return None if at is None else tuple((np.array(at) + start).tolist())

    if values.dtype.kind != "f":
        return None
    found = [first(values, 0)] if lazy_of(values) is None else of_blocks(values, first)
    return min((place for place in found if place is not None), default=None)


def histogram_of(grey: Any, least: Any, greatest: Any) -> tuple[Integers, NDArray[Any]]:
    """Return the numbers of voxels and the middles of the classes of an image, as scikit-image counts them."""
    if grey.dtype.kind == "f":
        edges = np.histogram_bin_edges(np.array([least, greatest]), 256)
        parts = of_blocks(grey, lambda block, _: np.histogram(block, 256, (least, greatest))[0])
        return np.sum(parts, axis=0), (edges[:-1] + edges[1:]) / 2
    many = int(greatest) - int(least) + 1
    parts = of_blocks(grey, lambda block, _: np.bincount(block.ravel() - int(least), minlength=many))
    return np.sum(parts, axis=0), np.arange(int(least), int(greatest) + 1)


def overlapped(
    values: Any, function: Callable[..., Any], reach: float, edges: Edges, turns: Sequence[bool], dtype: Any
) -> Any:
    """Return function of each block with what lies around it up to a distance, as `windowed` does.

    `edges` of a voxel are in the unit of `reach`. Along axes that repeat the other side of the image lies around it.
    """
    depth = [min(math.ceil(reach / edge), n) for edge, n in zip(edges, values.shape, strict=True)]
    return windowed([values], function, depth, dtype, turns)


class Shelf:
    """Arrays in files of the temporary folder, which take memory only as long as there is some to spare.

    A file has no name, and ends with the last array in it. Where the disk is full, arrays stay in memory.
    """

    def __init__(self) -> None:
        self._file: Any = bytearray()
        self._used = 0

    def put(self, array: NDArray[Any]) -> NDArray[Any]:
        """Return an array as it is read from a file."""
        # numbers begin at a multiple of their bytes
        size = -(-array.nbytes // 16) * 16
        if self._used + size > len(self._file):
            try:
                with tempfile.TemporaryFile(dir=_temporary()) as file:
                    # the disk has the bytes before they are mapped: a process ends where it writes to others
                    file.write(bytes(max(size, SHARED)))
                    file.flush()
                    self._file, self._used = mmap.mmap(file.fileno(), 0), 0
            except OSError:
                return array
        copy: NDArray[Any] = np.ndarray(array.shape, array.dtype, self._file, self._used)
        copy[...] = array
        self._used += size
        return copy


def _temporary() -> Any:
    """Return the setting of dask for the folder of temporary files; None for that of the system."""
    return block_library("dask").config.get("temporary_directory", None)


def kept(values: Any) -> Any:
    """Compute an array block by block into a temporary folder, and return it as it is read from there.

    The folder is that of the setting ``temporary_directory`` of dask, or of the system; it is removed with the array.
    """
    folder = Path(tempfile.mkdtemp(prefix="voxgran-", dir=_temporary()))
    store = stored(values, folder, {})
    weakref.finalize(store, shutil.rmtree, folder, ignore_errors=True)
    return block_library("dask.array").from_array(store, chunks=store.chunks, name=False)


def stored(values: Any, folder: Path, told: dict[str, Any]) -> Any:
    """Write an array block by block as an array of zarr with attributes, and return that."""
    if lazy_of(values) is None:
        values = lazily(values, "the array")
    even = values.rechunk(values.chunksize)
    store = block_library("zarr").create_array(
        store=folder.absolute(), shape=even.shape, chunks=even.chunksize, dtype=even.dtype, attributes=told
    )
    even.store(store, lock=False)
    return store


def as_block(block: Any) -> tuple[int, ...]:
    """Return the voxels along the three edges of a block, of which one may be given for all."""
    block = block.tolist() if isinstance(block, np.ndarray) else block
    given = list(block) if isinstance(block, list | tuple) and len(block) == 3 else [block] * 3
    return tuple(as_count(n, "block", at_least=1) for n in given)


def windowed(
    arrays: Sequence[Any],
    function: Callable[..., Any],
    depth: Sequence[int],
    dtype: Any,
    turns: Sequence[bool] = (False, False, False),
) -> Any:
    """Return function of each block of some arrays with what lies around it, without the surroundings; lazily.

    The arrays are read for each block anew, so that no more of them is in memory, where dask alone would hold planes of
    blocks; it takes long unless they are kept.
    """
    shape, wide, around = np.array(arrays[0].shape), np.array(depth), np.array(turns)

    def found(ends: tuple[Integers, Integers]) -> NDArray[Any]:
        lower = np.where(around, ends[0] - wide, np.maximum(ends[0] - wide, 0))
        upper = np.where(around, ends[1] + wide, np.minimum(ends[1] + wide, shape))
        # a block is a task itself, on one thread
        read = [np.asarray(_box(each, lower, upper).compute(scheduler="synchronous")) for each in arrays]
        inner = np.stack([ends[0] - lower, ends[1] - lower], axis=1).tolist()
        return np.ascontiguousarray(function(*read)[tuple(slice(*along) for along in inner)], dtype=dtype)

    return in_parts(found, arrays[0].shape, arrays[0].chunks, dtype)


def _box(values: Any, lower: Integers, upper: Integers) -> Any:
    """Return the part of a dask array from a voxel to before another one; beyond its ends it repeats."""
    for axis, (low, high, n) in enumerate(zip(lower.tolist(), upper.tolist(), values.shape, strict=True)):
        inside = low >= 0 and high <= n
        values = values[(slice(None),) * axis + (slice(low, high) if inside else np.arange(low, high) % n,)]
    return values


def in_parts(function: Callable[..., Any], shape: Sequence[int], block: Sequence[Any], dtype: Any) -> Any:
    """Return a dask array of what a function returns for the first voxel of each block and that after the last one."""
    array = block_library("dask.array")

    def part(block_info: Any) -> NDArray[Any]:
        ends = np.array(block_info[None]["array-location"])
        return np.asarray(function((ends[:, 0], ends[:, 1])))

    chunks = array.core.normalize_chunks(tuple(block), tuple(shape), dtype=dtype)
    return array.map_blocks(part, chunks=chunks, dtype=dtype, meta=np.empty((0, 0, 0), dtype=dtype))


def window(values: Any, lower: NDArray[Any], upper: NDArray[Any], purpose: str) -> NDArray[Any]:
    """Return the part of an image in a box, in memory; across the ends of an axis the image repeats.

    Raises
    ------
    TooLargeError
        If it is larger than the memory.
    """
    if math.prod((upper - lower).tolist()) * values.dtype.itemsize > memory_limit():
        raise TooLargeError(
            f"{purpose} spans {' x '.join(map(str, (upper - lower).tolist()))} voxels: they are more than the memory; "
            "take larger voxels"
        )
    return np.asarray(_box(values, lower, upper))
