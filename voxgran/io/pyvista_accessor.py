"""What PyVista users get: ``surface.voxgran`` on every `pyvista.PolyData`.

PyVista imports this file when that name is first used, by the entry point ``pyvista.accessors`` (PyVista 0.48 and
later); nothing of voxgran imports it.
"""

from typing import Any

import numpy as np
import pyvista

from voxgran.shapes.model import Shape
from voxgran.shapes.repairing.diagnose import Diagnosis, diagnose
from voxgran.shapes.repairing.repair import Repair, repair
from voxgran.voxels.model import Voxels
from voxgran.voxels.occupy import voxelize


@pyvista.register_dataset_accessor("voxgran", pyvista.PolyData)
class SurfaceAccessor:
    """A surface as a grain.

    Parameters
    ----------
    surface : pyvista.PolyData
        Polygons; they are cut into triangles.
    """

    def __init__(self, surface: Any) -> None:
        self._surface = surface

    def _triangles(self) -> tuple[Any, Any]:
        """Return points and triangles."""
        cut = self._surface.triangulate()
        return np.asarray(cut.points, dtype=np.float64), np.asarray(cut.regular_faces, dtype=np.int64)

    def diagnose(self) -> Diagnosis:
        """Find out whether the surface bounds one solid."""
        return diagnose(*self._triangles())

    def repair(self, *, max_hole: float = 0.25, bodies: str = "refuse") -> Repair:
        """Mend the surface, as :func:`voxgran.repair` does.

        Raises
        ------
        InputError
            If an option is out of range.
        DirtyMeshError
            If it cannot be mended with certainty.
        """
        return repair(*self._triangles(), max_hole=max_hole, bodies=bodies)

    def to_shape(self, name: str = "surface") -> Shape:
        """Return the solid that the surface bounds.

        Raises
        ------
        DirtyMeshError
            If it does not bound exactly one.
        """
        return Shape.from_mesh(*self._triangles(), name=name)

    def voxelize(self, voxel_size: float, *, cover: str = "center") -> Voxels:
        """Return the voxels of the solid that the surface bounds.

        Raises
        ------
        DirtyMeshError
            If it does not bound exactly one.
        InputError
            If the voxel size is not above 0.
        """
        return voxelize(self.to_shape(), voxel_size=voxel_size, cover=cover)
