"""Shapes from files of meshes and of clumps, and back."""

import logging
import os

from voxgran._base.arrays import check_type
from voxgran._base.calls import explained
from voxgran._base.errors import InputError, shown
from voxgran._base.files import as_path, output_suffix, unpacked, written_whole
from voxgran.shapes.formats.mesh_files import WRITERS, read_surface
from voxgran.shapes.formats.sphere_files import SUFFIXES, is_spheres, read_spheres, write_spheres
from voxgran.shapes.mesh import Mesh, Surface, refuse_unfit
from voxgran.shapes.model import Shape
from voxgran.shapes.repairing.diagnose import Remedies, as_solid, merged
from voxgran.shapes.repairing.repair import repaired

#: of `load_shape`
LOADING = Remedies(
    mend="give repair=True or use vg.repair", keep_open="give surface=True", hole="use vg.repair with a larger max_hole"
)
log = logging.getLogger(__name__)


@explained(hint='load_shape("rock.stl", unit="mm")')
def load_shape(
    path: str | os.PathLike[str], *, unit: str | None = None, repair: bool = False, surface: bool = False
) -> Shape:
    """Read a shape from a file with a closed surface, or with an open one if `surface` is true, or with the spheres of
    a clump.

    Parameters
    ----------
    path : path-like
        File in STL, OBJ, PLY, OFF, VTP, VTU, VTK or MSH format, by its suffix. Polygons are triangulated; coordinates
        keep all digits of the format. A ``.csv``, ``.txt``, ``.xyzr``, ``.mol`` or ``.molecule`` is a clump: a table
        ``x,y,z,r`` with or without names of the columns, lines ``x y z r clumpId`` as of YADE, or a molecule file of
        LAMMPS with diameters; with another suffix that no mesh has, such as ``.multisphere``, it is recognized by its
        content. Mass properties that such a file states are those of the shape. A file may be packed, with ``.gz``
        behind its suffix.
    unit : str, optional
        Unit of lengths, which is recorded; lengths are not converted. Default: as a clump file says, or else unknown.
    repair : bool
        Whether a surface that is almost closed is repaired first by :func:`voxgran.repair` with its defaults; the
        changes are logged.
    surface : bool
        Whether the file contains an open surface, a sheet or shell without thickness, as in
        :meth:`Shape.from_surface`.

    Returns
    -------
    Shape
        Shape, named as the file without its suffix.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If the suffix is not known, the file is empty, truncated or damaged, or it holds several clumps or a packing.
    DirtyMeshError
        If the surface does not bound exactly one solid, or cannot be repaired with certainty, or is not an open surface
        although `surface` is true.
    InputError
        If `repair` or `surface` is neither True nor False, both are true, or one is true for a clump.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.save_shape(vg.shapes.box(lengths=(1, 2, 3)), "brick.stl")
    >>> brick = vg.load_shape("brick.stl", unit="mm")
    >>> brick.name, brick.unit, round(brick.volume, 6)
    ('brick', 'mm', 6.0)
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
    """Read a shape from a file like :func:`load_shape`, with the remedies of the caller in the messages.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If the suffix is not known, or the file is empty, truncated or damaged.
    DirtyMeshError
        If the surface is not as required.
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
    with unpacked(as_path(path)) as found:
        if is_spheres(found):
            if repair or surface:
                raise InputError(
                    f"{'repair' if repair else 'surface'} is true for {path}, which holds spheres: only surfaces of "
                    "triangles are repaired or open; leave it out"
                )
            return read_spheres(found, unit=unit)
        points, faces = read_surface(found)
    if repair:
        return repaired(points, faces, name=found.stem, unit=unit, remedies=remedies).shape
    if surface:
        corners, triangles = merged(points, faces)
        refuse_unfit(corners, triangles, found.name)
    else:
        corners, triangles = as_solid(points, faces, found.name, remedies=remedies)
    log.info("%s: %d triangles", found, len(triangles))
    return Shape.of((Surface if surface else Mesh)(corners, triangles), name=found.stem, unit=unit)


def check_surface_output(path: str | os.PathLike[str], *, overwrite: bool) -> None:
    """Check, before anything is computed, that a surface can be written to a file.

    Raises
    ------
    FileFormatError
        If the suffix is none of a mesh file.
    OutputExistsError
        If the file is there and `overwrite` is false.
    """
    output_suffix(path, sorted(WRITERS), "surfaces are kept", overwrite=overwrite)


@explained(hint='save_shape(shape, "rock.stl")')
def save_shape(shape: Shape, path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
    """Write the tessellation of a shape, or its spheres, in its body frame.

    Parameters
    ----------
    shape : Shape
        Shape to write.
    path : path-like
        STL (binary, float32), OBJ, PLY, OFF or VTP file, by its suffix; all formats but STL keep all digits. A
        ``.csv``, ``.txt``, ``.xyzr``, ``.mol`` or ``.molecule`` holds the spheres of a clump, as :meth:`Clump.save`
        writes them.
    overwrite : bool
        Whether an existing file may be replaced.

    Raises
    ------
    InputError
        If `shape` is not a shape, or has no spheres for a file of these, or `path` is not a path.
    FileFormatError
        If the suffix is not known.
    OutputExistsError
        If the file exists and `overwrite` is false.
    OutputError
        If the file cannot be written.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.save_shape(vg.shapes.torus(), "ring.ply")
    >>> round(vg.load_shape("ring.ply").diameter, 2)
    1.0
    """
    check_type(shape, Shape, "shape", "a Shape; make_shape and load_shape make one")
    target = as_path(path)
    suffix = output_suffix(target, sorted((*WRITERS, *SUFFIXES)), "shapes are kept")
    if suffix in SUFFIXES:
        write_spheres(shape, target, overwrite=overwrite)
        return
    with written_whole(target, overwrite=overwrite) as draft:
        WRITERS[suffix](shape.vertices, shape.faces, draft)
