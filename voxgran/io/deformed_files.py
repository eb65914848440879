"""Deformed grains as one VTK file."""

import os

import numpy as np

from voxgran._base.arrays import check_type
from voxgran._base.calls import explained
from voxgran._base.files import as_path, output_suffix, written_whole
from voxgran._base.vtk_data import attach, poly_data, write_data
from voxgran.contacts.deformation.deform import Deformed


@explained(hint='save_deformed(deformed, "deformed.vtu")')
def save_deformed(deformed: Deformed, path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
    """Write the surfaces of deformed grains to one ``.vtp`` file.

    Parameters
    ----------
    deformed : Deformed
        What :func:`voxgran.deform` returned.
    path : path-like
        File to write.
    overwrite : bool
        Whether a file that is there may be replaced.

    Raises
    ------
    InputError
        If `deformed` is not what :func:`voxgran.deform` returns.
    FileFormatError
        If the suffix is not ``.vtp``.
    OutputExistsError
        If the file is there and `overwrite` is false.
    OutputError
        If it cannot be written; what was there before is untouched.

    Notes
    -----
    Triangles have the array `grain`; contacts are field data, `contact_i`, `contact_j`, `contact_area` and so on.

    Examples
    --------
    >>> import voxgran as vg
    >>> pair = vg.Packing.of(vg.shapes.sphere(), vg.Box((4, 2, 2)), position=[(1, 1, 1), (1.96, 1, 1)])
    >>> vg.save_deformed(vg.deform(pair), "deformed.vtp")
    """
    target = as_path(path)
    output_suffix(target, [".vtp"], "surfaces of deformed grains are kept")
    check_type(deformed, Deformed, "deformed", "what deform(packing) returns; call deform")
    start = np.cumsum([0, *(len(vertices) for vertices in deformed.vertices)])
    corners = [faces + base for faces, base in zip(deformed.faces, start[:-1].tolist(), strict=True)]
    data = poly_data(
        np.concatenate([np.zeros((0, 3)), *deformed.vertices]),
        "Polys",
        np.concatenate([np.zeros((0, 3), np.int64), *corners]),
    )
    counts = [len(faces) for faces in deformed.faces]
    attach(data.GetCellData(), {"grain": np.repeat(np.arange(deformed.count), counts)})
    names = ("i", "j", "image", "depth", "area", "force", "normal")
    attach(data.GetFieldData(), {f"contact_{name}": getattr(deformed, name) for name in names})
    with written_whole(target, overwrite=overwrite) as draft:
        write_data("vtkXMLPolyDataWriter", data, draft)
