"""Regular lattice of cubic voxels: position, and conversion between indices and coordinates."""

from dataclasses import dataclass

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.errors import InputError

#: relative excess, due to rounding, of a voxel over the length that it fills
ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class Grid:
    """A box of cubic voxels."""

    origin: tuple[float, float, float]  # corner of voxel (0, 0, 0), in the unit of lengths
    voxel_size: float  # edge of a voxel, in the unit of lengths
    shape: tuple[int, int, int]  # number of voxels along x, y, z

    @classmethod
    def around(cls, lower: Floats, upper: Floats, voxel_size: float, *, margin: int = 1) -> "Grid":
        """Return the grid that covers the box from `lower` to `upper`, (3,), with `margin` empty voxels on each side.

        The origin of the coordinates is a corner of its voxels.
        """
        low = np.floor(np.asarray(lower) / voxel_size).astype(int) - margin
        high = np.ceil(np.asarray(upper) / voxel_size).astype(int) + margin
        counts = np.maximum(high - low, 1)
        x, y, z = (float(value) for value in low * voxel_size)
        return cls((x, y, z), float(voxel_size), (int(counts[0]), int(counts[1]), int(counts[2])))

    @property
    def voxel_count(self) -> int:
        """Number of voxels."""
        return self.shape[0] * self.shape[1] * self.shape[2]

    @property
    def lengths(self) -> Floats:
        """Edges of the box, (3,), in the unit of lengths."""
        return np.array(self.shape) * self.voxel_size

    def centers(self, axis: int) -> Floats:
        """Return the coordinates of the voxel centers along an axis, (shape[axis],)."""
        return np.asarray(self.origin[axis] + (np.arange(self.shape[axis]) + 0.5) * self.voxel_size, dtype=np.float64)

    def coordinates(self, indices: Integers) -> Floats:
        """Return the (n, 3) centers of voxels from their (n, 3) indices."""
        return np.array(self.origin) + (np.asarray(indices) + 0.5) * self.voxel_size

    def indices(self, points: Floats) -> Integers:
        """Return the (n, 3) indices of the voxels that contain (n, 3) points; out of range for points outside."""
        return np.floor((np.asarray(points) - np.array(self.origin)) / self.voxel_size).astype(np.int64)


def check_voxel_size(voxel_size: float, extent: float, what: str) -> None:
    """Check that a voxel is no larger than the extent of an object, whose name for messages is `what`.

    Raises
    ------
    InputError
        If the voxel is larger.
    """
    if voxel_size > extent * (1 + ROUNDING):
        raise InputError(f"voxel_size is {voxel_size:.6g}: {what} is only {extent:.6g} wide; make the voxels smaller")
