"""Voxels: a solid on a lattice, the type that the voxels room hands on."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from voxgran._base import ExplainedAttributes
from voxgran._base.arrays import Booleans, Floats
from voxgran.lattice.grid import Grid
from voxgran.lattice.packed import PackedMask
from voxgran.voxels.shares import Shares


@dataclass(frozen=True, eq=False)
class Voxels(ExplainedAttributes):
    """The voxels of one solid.

    Attributes
    ----------
    taken : (nx, ny, nz) ndarray of bool or PackedMask
        Voxels that are taken, axes x, y, z; `mask` and `bits` give either form, made on the first request.
    origin : (3,) ndarray of float
        Corner of voxel (0, 0, 0), in the unit of lengths.
    voxel_size : float
        Edge of a voxel, in the unit of lengths.
    cover : str
        ``"center"``: voxels whose center is in the solid; ``"touch"``: voxels whose closed cube meets the solid.
    shares : Shares or None
        Share of each voxel that is solid, where asked: cut voxels and whole runs only.
    open_columns : int
        Columns that cross the surface into the solid more often than out of it: it has holes. 0 for clean meshes.
    doubtful_voxels : int
        Voxels that such holes left in doubt; they were settled by the generalized winding number.
    dimension : int
        3, or 2 for pixels of an outline.
    """

    taken: Booleans | PackedMask
    origin: Floats
    voxel_size: float
    cover: str = "center"
    shares: Shares | None = None
    open_columns: int = 0
    doubtful_voxels: int = 0
    dimension: int = 3

    @cached_property
    def mask(self) -> Booleans:
        """Voxels that are taken, (nx, ny, nz), a byte each."""
        return self.taken.unpacked() if isinstance(self.taken, PackedMask) else self.taken

    @cached_property
    def bits(self) -> PackedMask:
        """Voxels that are taken, a bit each."""
        return self.taken if isinstance(self.taken, PackedMask) else PackedMask.from_mask(self.taken)

    @cached_property
    def fraction(self) -> Floats | None:
        """Share of each voxel that is solid, (nx, ny, nz), eight bytes each; None if not requested."""
        return None if self.shares is None else self.shares.dense()

    @property
    def fraction_error(self) -> float:
        """Root mean square error of the share of cut voxels; 0 without shares."""
        return 0.0 if self.shares is None else self.shares.error

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of voxels along x, y, z."""
        return self.taken.shape[0], self.taken.shape[1], self.taken.shape[2]

    @property
    def grid(self) -> Grid:
        """The lattice."""
        x, y, z = (float(value) for value in self.origin)
        return Grid((x, y, z), self.voxel_size, self.shape)

    @cached_property
    def volume(self) -> float:
        """Volume of the taken voxels, or of their shares where there are any; in 2D the area."""
        solid = self.bits.count() if self.shares is None else self.shares.total
        return float(solid * self.voxel_size**self.dimension)

    @cached_property
    def centroid(self) -> Floats:
        """Mean center of the taken voxels, (3,), in the unit of lengths; NaN where none is taken."""
        return np.asarray(self.origin) + self.bits.centroid() * self.voxel_size
