"""Shapes from mesh files and back."""

import logging
import os
from pathlib import Path

from voxgran._base.arrays import check_type
from voxgran._base.errors import FileFormatError, InputError, shown
from voxgran._base.files import as_path, written_whole
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.mesh_files import WRITERS, read_surface
from voxgran.shapes.model import Shape
from voxgran.shapes.repairing.diagnose import Remedies, merged, refuse_dirty
from voxgran.shapes.repairing.repair import repaired
from voxgran.shapes.surface import Surface, refuse_unfit

#: of `load_shape`
LOADING = Remedies(
    mend="give repair=True or use vg.repair",
    keep_open="give surface=True",
    hole="use vg.repair with a larger largest_hole",
)
log = logging.getLogger(__name__)


def load_shape(
    path: str | os.PathLike[str], *, unit: str | None = None, repair: bool = False, surface: bool = False
) -> Shape:
    """Make a shape from a file that holds a closed surface, or an open one where that is asked for.

    Parameters
    ----------
    path : path-like
        File in STL, OBJ, PLY, OFF, VTP, VTU, VTK or MSH format, by its suffix. Polygons are cut into triangles;
        coordinates keep all digits that the format has.
    unit : str, optional
        Unit of its lengths; it is recorded and nothing is converted.
    repair : bool
        Whether a surface that is almost closed is mended first, as :func:`voxgran.repair` does with its defaults;
        what was done is logged.
    surface : bool
        Whether the file holds an open surface, a sheet or shell without thickness, as :meth:`Shape.from_surface` takes
        it.

    Returns
    -------
    Shape
        Named as the file without its suffix.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If the suffix is not known, or the file is empty, cut, or damaged.
    DirtyMeshError
        If its surface does not bound exactly one solid, or cannot be mended with certainty; or is no open surface.
    InputError
        If `repair` or `surface` is neither True nor False, or it is to be mended and to stay open.
    """
    return shape_of_file(path, unit=unit, repair=repair, surface=surface, remedies=LOADING)


def shape_of_file(
    path: str | os.PathLike[str],
    *,
    remedies: Remedies,
    unit: str | None = None,
    repair: bool = False,
    surface: bool = False,
) -> Shape:
    """Make a shape from a file, as :func:`load_shape` does, with the remedies of a caller in the messages.

    Parameters
    ----------
    path, unit, repair, surface
        As :func:`load_shape`.
    remedies : Remedies
        What the reader of a message can do.

    Returns
    -------
    Shape

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If the suffix is not known, or the file is empty, cut, or damaged.
    DirtyMeshError
        If the surface is not what was asked for.
    InputError
        If `repair` or `surface` is neither True nor False, or both are true.
    """
    for key, value in (("repair", repair), ("surface", surface)):
        if not isinstance(value, bool):
            raise InputError(f"{key} is {shown(value)}: it must be True or False")
    if repair and surface:
        raise InputError(
            "repair and surface are both true: repair closes a surface, and surface keeps it open; use one"
        )
    points, faces = read_surface(path)
    found = Path(path)
    if repair:
        return repaired(points, faces, name=found.stem, unit=unit, remedies=remedies).shape
    corners, triangles = merged(points, faces)
    if surface:
        refuse_unfit(corners, triangles, found.name)
    else:
        refuse_dirty(corners, triangles, found.name, remedies=remedies)
    log.info("%s: %d triangles", found, len(triangles))
    return Shape.of((Surface if surface else Mesh)(corners, triangles), name=found.stem, unit=unit)


def save_shape(shape: Shape, path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
    """Write the tessellation of a shape, in its body frame.

    Parameters
    ----------
    shape : Shape
        What to write.
    path : path-like
        STL (binary, float32), OBJ, PLY, OFF or VTP file, by its suffix; all but STL keep every digit.
    overwrite : bool
        Whether a file that is there may be replaced.

    Raises
    ------
    InputError
        If it is no shape, or the path no path.
    FileFormatError
        If the suffix is not known.
    OutputExistsError
        If it is there and `overwrite` is false.
    OutputError
        If it cannot be written.
    """
    check_type(shape, Shape, "shape", "a Shape; make_shape and load_shape make one")
    target = as_path(path)
    writer = WRITERS.get(target.suffix.lower())
    if writer is None:
        raise FileFormatError(
            f"{target} has the suffix {target.suffix!r}: known are {', '.join(sorted(WRITERS))}; choose one"
        )
    with written_whole(target, overwrite=overwrite) as draft:
        writer(shape.vertices, shape.faces, draft)
