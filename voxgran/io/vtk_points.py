"""Spheres in VTK files that another program wrote: points with their radii or diameters."""

from pathlib import Path

import numpy as np

from voxgran._base.errors import FileFormatError
from voxgran._base.guarded import read_guarded
from voxgran._base.vtk_readers import vtk_points
from voxgran.io.particles import Particles, order_by_id, refuse_bad_spheres

#: suffixes of such files
SUFFIXES = (".vtp", ".vtu", ".vtk")
#: names of arrays, in lower case, and the factor that makes them radii
SIZES = {"radius": 1.0, "radii": 1.0, "rad": 1.0, "r": 1.0, "diameter": 0.5, "diameters": 0.5, "d": 0.5}


def read_vtk_points(path: Path) -> Particles:
    """Read spheres from a ``.vtp``, ``.vtu`` or legacy ``.vtk`` file whose points carry an array ``radius`` (or radii,
    rad, r) or ``diameter``.

    Raises
    ------
    FileFormatError
        If VTK cannot read it, the points carry no sizes, or a sphere is not finite or has no size.
    MissingLibraryError
        If the process that reads it cannot be started.
    """
    _, found = read_guarded(vtk_points, path)
    points = found["points"]
    arrays = {key.removeprefix("point/"): array for key, array in found.items() if key.startswith("point/")}
    known = {name.lower(): name for name in arrays}
    chosen = next((name for name in SIZES if name in known), None)
    if chosen is None:
        names = ", ".join(sorted(str(name) for name in arrays)) or "nothing"
        raise FileFormatError(
            f"{path} has points with {names}: spheres need an array radius or diameter; write it too, or give a mesh "
            "to 'load_shape'"
        )
    sizes = np.asarray(arrays[known[chosen]], dtype=np.float64)
    if sizes.shape != (len(points),):
        raise FileFormatError(f"{path}: {known[chosen]} has the shape {sizes.shape}: one number a point is needed")
    ids = np.asarray(arrays.get(known.get("id", ""), []))
    if ids.shape == sizes.shape:
        order_by_id(ids, range(len(ids)), path, row="point")
    radii = SIZES[chosen] * sizes
    refuse_bad_spheres(points, radii, path, row="point")
    word = "radii" if SIZES[chosen] == 1.0 else "diameters"
    return Particles(centers=points, radii=radii, assumed={"sizes": f"the array {known[chosen]!r} holds {word}"})
