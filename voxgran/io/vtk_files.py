"""VTK files: packings (.vtp) that reload bit for bit, and scenes (.vtm) for ParaView.

A packing file ends with a seal, an XML comment that holds the SHA-256 of all bytes before it. All are read in processes
of their own, because the readers of VTK print, or worse, on damaged input: that of files with a right seal is kept.
"""

import hashlib
import os
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import as_number
from voxgran._base.calls import explained
from voxgran._base.errors import FileFormatError
from voxgran._base.files import as_path, existing_file, output_suffix, refuse_to_replace, written_whole
from voxgran._base.guarded import MEMORY_PER_BYTE, MEMORY_PER_PART, read_guarded, read_part, reason_of
from voxgran._base.vtk_data import attach, attach_texts, poly_data, write_data
from voxgran._base.vtk_readers import vtk_points
from voxgran.contacts.forces import chain_ends
from voxgran.contacts.surfaces import merged_surfaces
from voxgran.containers.model import periods_of
from voxgran.io.record import Record, from_record, to_record
from voxgran.packing.model import Packing, check_packing

#: a scene with more spheres than this draws them as points with a radius, not as surfaces
BALL_SURFACE_LIMIT = 1000

#: names of the parts of a scene
PARTS = ("grains", "spheres", "container", "contacts", "forces")

_SEAL = b"<!-- voxgran seal %s -->\n"
_SEAL_LENGTH = len(_SEAL) - 2 + 64
#: bytes within which the names of all arrays stand
_NAMES_WITHIN = 2**20


def save_packing(packing: Packing, path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
    """Write a packing to one ``.vtp`` file that alone reloads it bit for bit.

    Points are centroids with the values of the grains; shapes, container and provenance are field data.

    Raises
    ------
    InputError
        If the provenance holds something that JSON cannot.
    OutputExistsError
        If the file is there and `overwrite` is false.
    OutputError
        If it cannot be written; what was there before is untouched.
    """
    record = to_record(packing)
    data = poly_data(record.position, "Verts", np.arange(packing.count)[:, None])
    attach(data.GetPointData(), record.per_grain)
    # the record lives as long as the data
    attach(data.GetFieldData(), record.arrays, deep=False)
    attach_texts(data.GetFieldData(), record.texts)
    with written_whole(path, overwrite=overwrite) as draft:
        write_data("vtkXMLPolyDataWriter", data, draft)
        with draft.open("ab") as file:
            file.write(_SEAL % _hash(draft, draft.stat().st_size).encode())


def load_packing(path: str | os.PathLike[str]) -> Packing:
    """Read a packing from a ``.vtp`` file that :func:`save_packing` wrote, with the same bits; from a file that
    ParaView saved again, with the same shapes, and poses as they stand there, which the provenance says.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If it is damaged, cut off, or no packing.
    """
    found = existing_file(path)
    sealed = not _is_rewritten(found)
    if sealed:
        _check_seal(found)
    if sealed:
        # of one that is not damaged a process can be kept; a seal says nothing of who has made it
        size = found.stat().st_size * MEMORY_PER_BYTE // MEMORY_PER_PART
        facts, arrays = read_part(vtk_points, found, size=size)
    else:
        facts, arrays = read_guarded(vtk_points, found)
    per_grain = {key.removeprefix("point/"): array for key, array in arrays.items() if key.startswith("point/")}
    whole = {key.removeprefix("field/"): array for key, array in arrays.items() if key.startswith("field/")}
    try:
        packing = from_record(Record(arrays["points"], per_grain, whole, facts["texts"]))
    except FileFormatError as error:
        raise FileFormatError(f"{found}: {reason_of(error, most=300)}") from error
    if sealed:
        return packing
    assumed = {
        **packing.provenance.get("assumed", {}),
        "poses": "as another program wrote them: the seal is gone, the shapes are proven by their keys",
    }
    return replace(packing, provenance={**packing.provenance, "assumed": assumed})


def is_own(path: Path) -> bool:
    """Return whether a ``.vtp`` file holds a packing of voxgran, or is cut off or damaged so that it may."""
    return not _ends_whole(path) or _sealed(path) or _is_rewritten(path)


def has_seal(path: Path) -> bool:
    """Return whether a file ends with the seal of :func:`save_packing`, right or wrong."""
    return _SEAL.partition(b"%s")[0] in _tail(path)


def _is_rewritten(path: Path) -> bool:
    """Return whether another program wrote the packing again: a whole file that names our arrays and has no seal."""
    if _sealed(path) or not _ends_whole(path):
        return False
    with path.open("rb") as file:
        head = file.read(_NAMES_WITHIN)
    return all(f'Name="{name}"'.encode() in head for name in ("stop_reason", "provenance", "shapes", "container"))


def _sealed(path: Path) -> bool:
    """Return whether a file ends with a seal, right or wrong or cut off."""
    return bool(_tail(path).rpartition(b"</VTKFile>")[2].strip())


def _ends_whole(path: Path) -> bool:
    """Return whether a file ends as XML of VTK does."""
    return b"</VTKFile>" in _tail(path)


def _tail(path: Path) -> bytes:
    """Return the last bytes of a file."""
    with path.open("rb") as file:
        file.seek(max(path.stat().st_size - 2 * _SEAL_LENGTH, 0))
        return file.read()


@explained(hint='save_scene(packing, "scene.vtm")')
def save_scene(packing: Packing, path: str | os.PathLike[str], *, gap: float = 0.0, overwrite: bool = False) -> None:
    """Write the surfaces of the grains, the container and the contacts of a packing for ParaView.

    Parameters
    ----------
    packing : Packing
        Any packing.
    path : path-like
        The ``.vtm`` file; its parts go to the folder of the same name beside it.
    gap : float
        Grains nearer than this are in contact, in the unit of lengths.
    overwrite : bool
        Whether what is there may be replaced.

    Raises
    ------
    FileFormatError
        If the suffix is not ``.vtm``.
    InputError
        If the gap is negative or not finite.
    TooLargeError
        If the surfaces have more triangles than fit.
    OutputExistsError
        If it is there and `overwrite` is false, or the folder holds files that are no parts of a scene.
    OutputError
        If it cannot be written; what was there before is untouched.

    Notes
    -----
    Where there are more than BALL_SURFACE_LIMIT spheres, they are points with a radius (show them as Point Gaussian
    or glyphs); all other grains are one mesh with the grain, its shape and its diameter at each triangle. Contacts
    are lines between the centroids, with gap, normal and contact point. Where forces are known, the block `forces` has
    the contacts that carry one as such lines, at walls and the lid to the contact point; `magnitude` at their points is
    the force in the unit of the forces of the packing (for force chains apply the filter Tube, with its radius varied).

    Examples
    --------
    >>> import voxgran as vg
    >>> bed = vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), "rsa", count=10)
    >>> vg.save_scene(bed, "scene.vtm", gap=0.05)
    """
    check_packing(packing, "packing")
    target = as_path(path)
    output_suffix(target, [".vtm"], "scenes are kept")
    reach = as_number(gap, "gap", at_least=0.0)
    if not overwrite:
        refuse_to_replace(target, target.with_suffix(""))
    made = (
        _grain_surfaces(packing),
        _sphere_points(packing),
        poly_data(packing.container.mesh()[0], "Polys", packing.container.mesh()[1]),
        _contact_lines(packing, reach),
        _force_lines(packing),
    )
    parts = {name: data for name, data in zip(PARTS, made, strict=True) if data.GetNumberOfPoints()}
    beside = written_whole(target.with_suffix(""), overwrite=overwrite, is_own=_is_part)
    with written_whole(target, overwrite=overwrite) as draft, beside as folder:
        draft.write_text(_multi_block(target.stem, list(parts)), encoding="utf-8")
        folder.mkdir()
        for name, data in parts.items():
            write_data("vtkXMLPolyDataWriter", data, folder / f"{name}.vtp")


def _is_part(path: Path) -> bool:
    """Return whether a file of the folder of a scene is one of its parts, by its name and its first bytes."""
    with path.open("rb") as file:
        return path.suffix == ".vtp" and path.stem in PARTS and b'<VTKFile type="PolyData"' in file.read(100)


def _hash(path: Path, length: int) -> str:
    """Return the SHA-256 of the first bytes of a file."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while length > 0 and (block := file.read(min(length, 2**20))):
            digest.update(block)
            length -= len(block)
    return digest.hexdigest()


def _check_seal(path: Path) -> None:
    """Refuse a file that is not, byte for byte, what was written."""
    body = path.stat().st_size - _SEAL_LENGTH
    with path.open("rb") as file:
        file.seek(max(body, 0))
        seal = file.read()
    start, end = _SEAL.split(b"%s")
    if body < 0 or not (seal.startswith(start) and seal.endswith(end)):
        raise FileFormatError(
            f"{path} does not end with the seal of voxgran: it is cut off, damaged or was written by another program; "
            "save the packing again"
        )
    if seal != _SEAL % _hash(path, body).encode():
        raise FileFormatError(f"{path} is damaged (its hash is not the one in its seal): save the packing again")


def _spheres_as_points(packing: Packing) -> Any:
    """Return the grains that are drawn as points: all spheres, if there are many."""
    is_sphere = np.array([*(shape.is_sphere and shape.dimension == 3 for shape in packing.shapes), False])
    spheres = np.flatnonzero(is_sphere[packing.shape_id])
    return spheres if len(spheres) > BALL_SURFACE_LIMIT else spheres[:0]


def _per_grain(packing: Packing, grains: Any) -> dict[str, Any]:
    """Return the arrays by which triangles and points are coloured."""
    more = {"density": packing.densities[grains]} if isinstance(packing.density, tuple) else {}
    if packing.grain_id is not None:
        more["grain_id"] = packing.grain_id[grains]
    if packing.fixed is not None:
        more["fixed"] = packing.fixed[grains].astype(np.int64)
    return {"grain": grains, "shape_id": packing.shape_id[grains], "diameter": packing.diameters[grains], **more}


def _grain_surfaces(packing: Packing) -> Any:
    """Return the surfaces of the grains, except of many spheres."""
    others = np.setdiff1d(np.arange(packing.count), _spheres_as_points(packing))
    surfaces = merged_surfaces(packing, grains=others)
    data = poly_data(surfaces.vertices, "Polys", surfaces.faces)
    attach(data.GetCellData(), _per_grain(packing, surfaces.grain))
    return data


def _sphere_points(packing: Packing) -> Any:
    """Return many spheres as points."""
    spheres = _spheres_as_points(packing)
    data = poly_data(packing.position[spheres], "Verts", np.arange(len(spheres))[:, None])
    attach(data.GetPointData(), {**_per_grain(packing, spheres), "radius": packing.bounding_radii[spheres]})
    return data


def _contact_lines(packing: Packing, gap: float) -> Any:
    """Return contacts as lines between centroids; across a periodic face the line leaves the container."""
    contacts = packing.contacts(gap)
    partner = packing.position[contacts.j] + linear.matmul(contacts.image, periods_of(packing.container))
    ends = np.stack([packing.position[contacts.i], partner], axis=1).reshape(-1, 3)
    data = poly_data(ends, "Lines", np.arange(len(ends)).reshape(-1, 2))
    values = {name: getattr(contacts, name) for name in ("i", "j", "gap", "normal", "point")}
    attach(data.GetCellData(), values)
    return data


def _force_lines(packing: Packing) -> Any:
    """Return the contacts that carry a force as lines; none where the forces are not known."""
    forces = packing.forces
    if forces is None:
        return poly_data(np.zeros((0, 3)), "Lines", np.zeros((0, 2), np.int64))
    kept = forces.carries
    ends = np.stack(chain_ends(packing, forces), axis=1)[kept].reshape(-1, 3)
    data = poly_data(ends, "Lines", np.arange(len(ends)).reshape(-1, 2))
    values = {name: getattr(forces, name)[kept] for name in ("i", "j", "gap", "normal", "point", "force")}
    shares = {"normal_force": forces.normal_force[kept], "tangential_force": forces.tangential_force[kept]}
    attach(data.GetCellData(), {**values, **shares})
    # the filter Tube varies its radius by an array of the points
    attach(data.GetPointData(), {"magnitude": np.repeat(forces.magnitude[kept], 2)})
    return data


def _multi_block(folder: str, names: list[str]) -> str:
    """Return the text of a .vtm file."""
    blocks = [
        f'    <DataSet index="{index}" name="{name}" file={quoteattr(f"{folder}/{name}.vtp")}/>'
        for index, name in enumerate(names)
    ]
    head = '<VTKFile type="vtkMultiBlockDataSet" version="1.0" byte_order="LittleEndian">'
    lines = ['<?xml version="1.0"?>', head, "  <vtkMultiBlockDataSet>", *blocks]
    return "\n".join([*lines, "  </vtkMultiBlockDataSet>", "</VTKFile>", ""])
