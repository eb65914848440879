"""Voxels: a solid on a lattice, the type that the voxels room hands on."""

from dataclasses import dataclass

import numpy as np

from voxgran._base.arrays import Booleans, Floats
from voxgran.lattice.grid import Grid


@dataclass(frozen=True, eq=False)
class Voxels:
    """The voxels of one solid.

    Attributes
    ----------
    mask : (nx, ny, nz) ndarray of bool
        Voxels that are taken, axes x, y, z.
    origin : (3,) ndarray of float
        Corner of voxel (0, 0, 0), in the unit of lengths.
    voxel_size : float
        Edge of a voxel, in the unit of lengths.
    cover : str
        ``"center"``: voxels whose center is in the solid; ``"touch"``: voxels whose closed cube meets the solid.
    fraction : (nx, ny, nz) ndarray of float or None
        Share of each voxel that is solid, where asked.
    fraction_error : float
        Root mean square error of the share in voxels that the surface cuts, for bodies in random poses; where flat
        faces are nearly parallel to the lattice the error of a single voxel goes up to 1/16. 0 without fraction.
    band_voxels : int
        Voxels whose center lies within 1e-6 voxel of the surface of a mesh; they count as inside.
    """

    mask: Booleans
    origin: Floats
    voxel_size: float
    cover: str = "center"
    fraction: Floats | None = None
    fraction_error: float = 0.0
    band_voxels: int = 0

    @property
    def grid(self) -> Grid:
        """The lattice."""
        x, y, z = (float(value) for value in self.origin)
        return Grid((x, y, z), self.voxel_size, (self.mask.shape[0], self.mask.shape[1], self.mask.shape[2]))

    @property
    def volume(self) -> float:
        """Volume of the taken voxels, or of their shares where there are fractions; in 2D the area."""
        solid = np.count_nonzero(self.mask) if self.fraction is None else float(self.fraction.sum())
        dimension = 2 if self.mask.shape[2] == 1 else 3
        return float(solid * self.voxel_size**dimension)
