"""`save` and `load`: packings in and out of files, by suffix."""

import logging
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from voxgran._base.arrays import as_flag
from voxgran._base.axes import Periodic
from voxgran._base.calls import explained
from voxgran._base.errors import FileFormatError, InputError
from voxgran._base.files import as_path, existing_file, output_suffix, unpacked
from voxgran.contacts.verify import verify
from voxgran.containers.model import Container, package_of
from voxgran.io.lammps_files import is_data, is_dump, read_lammps_data, read_lammps_dump
from voxgran.io.mercury_files import is_mercury, read_mercury
from voxgran.io.particles import Particles, packing_of
from voxgran.io.sphere_packs import is_shape_pack, read_shape_pack
from voxgran.io.spheres import owned_spheres, save_spheres
from voxgran.io.tables import read_table
from voxgran.io.vtk_files import is_own, load_packing, save_packing
from voxgran.io.vtk_points import SUFFIXES, read_vtk_points
from voxgran.io.xyz_files import is_xyz, read_xyz, read_xyzd
from voxgran.packing.model import Packing, check_packing

log = logging.getLogger(__name__)

#: what is written, for messages
KEPT = "packings are kept"
#: suffixes of meshes that PyVista writes
MESHES = (".stl", ".ply", ".obj", ".vtk")
_WRITERS: dict[str, Callable[..., None]] = {
    ".vtp": save_packing,
    ".txt": save_spheres,
    ".xyzr": save_spheres,
    ".csv": save_spheres,
}
_SHAPE = ("one shape", "vg.load_shape reads it, vg.load_cloud if it has points only")
_IMAGE = ("an image", "vg.packing_of_labels, at the prompt voxgran labels, makes a packing of its grains")
#: what files with these suffixes hold, and what to do with them
_OTHERS = {
    ".toml": ("a scene", "'voxgran run' packs it; give the packing.vtp that it writes"),
    ".nc": ("numbers", "vg.load_statistics or vg.ShapeModel.load reads them; give the packing.vtp beside it"),
    **dict.fromkeys((".stl", ".obj", ".off", ".ply", ".msh"), _SHAPE),
    **dict.fromkeys((".tif", ".tiff", ".png", ".npy", ".npz", ".nrrd", ".vti"), _IMAGE),
}
#: least factor on sizes by which grains that overlap are made smaller
LEAST_FACTOR = 0.9
#: bytes that are looked at to recognize a file
_HEAD = 4096


@explained(hint='save(packing, "bed.vtp")')
def save(packing: Packing, path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
    """Write a packing to a file.

    Parameters
    ----------
    packing : Packing
        Any packing.
    path : path-like
        ``.vtp`` holds all of it, bit for bit, and opens in ParaView; ``.txt``, ``.xyzr`` and ``.csv`` hold spheres as
        ``x y z r``, clumps with a fifth column, and disks as ``x y r``. A ``.csv`` is a table with the names of the
        columns in its first line, as pandas reads it, without unit and container, its periodic axes among it: give
        these to :func:`load`. Where the container is tilted, they stand in comments before that line, which pandas
        reads with ``comment="#"``.
    overwrite : bool
        Whether a file that is there may be replaced.

    Raises
    ------
    FileFormatError
        If the suffix is unknown.
    InputError
        If the packing is none or does not fit the format, its container is of a class that is not registered, which
        :func:`load` could not make again, or the path is no path.
    OutputExistsError
        If the file is there and `overwrite` is false.
    OutputError
        If it cannot be written; what was there before is untouched.

    Examples
    --------
    >>> import voxgran as vg
    >>> bed = vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), "rsa", count=10)
    >>> vg.save(bed, "bed.vtp")
    >>> vg.load("bed.vtp") == bed
    True
    """
    check_packing(packing, "packing")
    _WRITERS[known_suffix(path)](packing, path, overwrite=overwrite)


def known_suffix(path: str | os.PathLike[str]) -> str:
    """Return the suffix of a file, in small letters, that a packing can be written to.

    Raises
    ------
    FileFormatError
        If the suffix is unknown.
    InputError
        If the path is no path.
    """
    try:
        return output_suffix(path, _WRITERS, KEPT)
    except FileFormatError as error:
        if as_path(path).suffix.lower() in MESHES:
            way = f"packing.to_pyvista().save({str(path)!r})"
            raise FileFormatError(f"{error}, or write the surfaces of all grains by {way}") from None
        raise


def check_output(path: str | os.PathLike[str], *, overwrite: bool) -> None:
    """Refuse a file that a packing cannot be written to, before the work.

    Raises
    ------
    FileFormatError
        If the suffix is unknown.
    OutputExistsError
        If the file is there and `overwrite` is false.
    """
    known_suffix(path)
    output_suffix(path, _WRITERS, KEPT, overwrite=overwrite)


def check_savable(packing: Packing, path: str | os.PathLike[str]) -> None:
    """Check, before anything is computed, that a file with this suffix can hold the grains of a packing.

    Raises
    ------
    FileFormatError
        If the suffix is unknown.
    InputError
        If the grains or the container do not fit the format, or the path is no path.
    """
    suffix = known_suffix(path)
    if _WRITERS[suffix] is save_spheres:
        owned_spheres(packing)
    if suffix != ".csv":
        package_of(packing.container)


@explained(hint='load("bed.vtp")')
def load(
    path: str | os.PathLike[str],
    *,
    container: Container | None = None,
    unit: str | None = None,
    periodic: Periodic | None = None,
    frame: int = -1,
    shrink: bool = False,
) -> Packing:
    """Read a packing from a file, of voxgran or of another program.

    Parameters
    ----------
    path : path-like
        Recognized by its content: a ``.vtp`` that :func:`save` wrote; spheres as text (``x y z r``, YADE's
        ``x y z r clumpId``, CSV with a header, each with the line ``##PERIODIC::`` of YADE and Woo, and Woo's
        ``number Sphere x y z r``); a LAMMPS data or dump file; a data file of MercuryDPM; extended XYZ
        with radii; ``.vtp``, ``.vtu`` or ``.vtk`` points with radii; a ``.xyzd`` of PackingGeneration; and a ``.gz`` of
        any of these. The file of one clump is read by :func:`load_shape`.
    container : Container, optional
        What holds the spheres of another program; default: as the file says, or else the box around them.
    unit : str, optional
        Unit of lengths of such a file that states none; default: as it says, or else ``"1"``.
    periodic : str, bool or sequence, optional
        Axes along which their box is periodic, such as ``"xy"``, as of
        :class:`voxgran.Box`; default: as the file says, or else none.
    frame : int
        Which frame of a file with several, as of LAMMPS, MercuryDPM and XYZ, from 0; negative: from the end.
    shrink : bool
        Whether spheres and clumps of another program are made smaller in place, by one factor, until :func:`verify`
        finds no overlap: radii that were rounded, as those of published packings, may overlap by a part in 1e8.

    Returns
    -------
    Packing
        ``provenance["assumed"]`` says what was taken for granted. Files of other programs do not tell where gravity
        acts: it is taken to be downward.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If the content is damaged, no packing, or of no known form.
    InputError
        If a container, unit, axes or `shrink` are given for a file that voxgran wrote, which is read as it is, or do
        not fit, the file states another unit, or grains overlap still at 0.9 of their sizes.
    MissingLibraryError
        If the container is of a package that is not installed; the message names it.

    Warns
    -----
    PackingWarning
        If most spheres of a text without clumps overlap others, as those of one clump do, or centers lie outside of the
        container.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), "rsa", count=10).save("bed.vtp")
    >>> vg.load("bed.vtp").count
    10
    """
    found = existing_file(path)
    as_flag(shrink, "shrink")
    given = {"container": container, "unit": unit, "periodic": periodic, "shrink": shrink or None}
    with unpacked(found) as plain:
        if plain.suffix.lower() == ".vtp" and is_own(plain):
            named = [name for name, value in given.items() if value is not None]
            if named:
                raise InputError(f"{named[0]} is given for {found}, which voxgran wrote: leave it out")
            return load_packing(plain)
        particles = _particles(plain, frame, found if plain == found else found.with_suffix(""))
    packing = packing_of(particles, found, container=container, unit=unit, periodic=periodic)
    packing = _shrunk(packing, found) if shrink else packing
    for subject, sentence in packing.provenance.get("assumed", {}).items():
        log.info("%s: assumed %s: %s", found, subject, sentence)
    return packing


def _shrunk(packing: Packing, path: Path) -> Packing:
    """Return a packing with all grains smaller in place, by the largest factor at which none overlap or escape."""
    factor, proof = 1.0, verify(packing)
    while not proof.ok:
        factor *= proof.touching_at
        if factor < LEAST_FACTOR:
            raise InputError(
                f"shrink is true for {path}, whose grains overlap still at {factor:.3g} of their sizes: down to "
                f"{LEAST_FACTOR:g} is allowed; leave it out"
            )
        proof = verify(smaller := replace(packing, scale=packing.scale * factor))
    if factor == 1.0:
        return packing
    assumed = {
        **packing.provenance.get("assumed", {}),
        "shrinking": f"all sizes are multiplied by 1 - {1.0 - factor:.3g}, so that none overlap",
    }
    return replace(smaller, provenance={**packing.provenance, "assumed": assumed})


def _particles(found: Path, frame: int, place: Path) -> Particles:
    """Return the spheres of a file of another program, or of text, which lay at a place before it was unpacked."""
    with found.open("rb") as file:
        # bytes that are no text become NUL
        head = file.read(_HEAD).decode("utf-8", errors="replace").replace("\ufffd", "\0")
    if found.suffix.lower() in _OTHERS:
        kind, remedy = _OTHERS[found.suffix.lower()]
        raise FileFormatError(f"{found} holds {kind} and no packing: {remedy}")
    if found.suffix.lower() in SUFFIXES:
        return read_vtk_points(found)
    if found.suffix.lower() == ".xyzd":
        return read_xyzd(found, place=place)
    if "\0" in head:
        raise FileFormatError(
            f"{found} has the suffix {found.suffix!r} and no known content: packings are read from .vtp, .vtu, .vtk, "
            ".xyzd, text tables of spheres, files of LAMMPS and MercuryDPM, and extended XYZ; convert it"
        )
    for recognized, read in _WITH_FRAMES:
        if recognized(head):
            return read(found, frame=frame)
    if is_shape_pack(head):
        return read_shape_pack(found)
    return read_lammps_data(found) if is_data(head) else read_table(found)


#: formats of several frames: what recognizes the first characters, and what reads one frame
_WITH_FRAMES: tuple[tuple[Callable[[str], bool], Callable[..., Particles]], ...] = (
    (is_dump, read_lammps_dump),
    (is_mercury, read_mercury),
    (is_xyz, read_xyz),
)
