"""An image with what is known of its lattice, and the edges of voxels that functions of images take."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from voxgran._base import ExplainedAttributes
from voxgran._base.arrays import check_lengths, float_array
from voxgran._base.errors import InputError, shown

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
