"""Spheres in VTK files that another program wrote: points with their radii or diameters."""

from pathlib import Path
from typing import Any

import numpy as np

from voxgran._base.errors import FileFormatError
from voxgran.io.particles import Particles, refuse_bad_spheres
from voxgran.io.vtk_data import detach, numpy_support, read_data

#: reader of each suffix
READERS = {".vtp": "vtkXMLPolyDataReader", ".vtu": "vtkXMLUnstructuredGridReader"}
#: names of arrays, in lower case, and the factor that makes them radii
SIZES = {"radius": 1.0, "radii": 1.0, "rad": 1.0, "r": 1.0, "diameter": 0.5, "diameters": 0.5, "d": 0.5}


def read_vtk_points(path: Path) -> Particles:
    """Read spheres from the points of a VTK file.

    Parameters
    ----------
    path : Path
        ``.vtp`` or ``.vtu`` whose points carry an array ``radius`` (or radii, rad, r) or ``diameter``.

    Returns
    -------
    Particles

    Raises
    ------
    FileFormatError
        If VTK cannot read it, the points carry no sizes, or a sphere is not finite or has no size.
    """
    with path.open("rb") as file:
        head = file.read(1024)
        file.seek(max(path.stat().st_size - 1024, 0))
        tail = file.read()
    # the readers of VTK end the process on some files that are cut off
    if b"<VTKFile" not in head or b"</VTKFile>" not in tail:
        raise FileFormatError(f"{path} is no whole VTK file: it is cut off or damaged; write it again")
    return particles_of(read_data(READERS[path.suffix.lower()], path), path)


def particles_of(data: Any, path: Path) -> Particles:
    """Return the spheres at the points of a VTK data set.

    Parameters
    ----------
    data : vtkPointSet
        What was read.
    path : Path
        The file, for messages.

    Raises
    ------
    FileFormatError
        If the points carry no sizes, or a sphere is not finite or has no size.
    """
    arrays, _ = detach(data.GetPointData())
    known = {name.lower(): name for name in arrays}
    chosen = next((name for name in SIZES if name in known), None)
    if chosen is None:
        names = ", ".join(sorted(str(name) for name in arrays)) or "nothing"
        raise FileFormatError(
            f"{path} has points with {names}: spheres need an array radius or diameter; write it too, or give a mesh "
            "to 'load_shape'"
        )
    points = np.zeros((0, 3))
    if data.GetNumberOfPoints():
        points = np.array(numpy_support().vtk_to_numpy(data.GetPoints().GetData()), dtype=np.float64)
    sizes = np.asarray(arrays[known[chosen]], dtype=np.float64)
    if sizes.shape != (len(points),):
        raise FileFormatError(f"{path}: {known[chosen]} has the shape {sizes.shape}: one number a point is needed")
    radii = SIZES[chosen] * sizes
    refuse_bad_spheres(points, radii, path, row="point")
    return Particles(
        centers=points, radii=radii, assumed={"sizes": f"the array {known[chosen]!r} holds {_word(chosen)}"}
    )


def _word(name: str) -> str:
    """Say what an array holds."""
    return "radii" if SIZES[name] == 1.0 else "diameters"
