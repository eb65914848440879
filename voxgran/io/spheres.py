"""Spheres as text, one ``x y z r`` a line, and disks as ``x y r``: the form that every program for spheres reads."""

import json
import os

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.errors import InputError, with_article
from voxgran._base.files import written_whole
from voxgran.containers.model import saved_mapping, tilt_of
from voxgran.io.tables import CONTAINER, FIELDS, UNIT
from voxgran.measures.crossings import spheres_of
from voxgran.packing.model import Packing
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive

_ROWS_AT_ONCE = 100_000


def save_spheres(packing: Packing, path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
    """Write spheres, or disks in two dimensions, as text.

    Where there are clumps, a fifth column tells the clump of each sphere, -1 for none, as YADE reads it. With the
    suffix ``.csv`` the file is a table with the names of the columns in its first line and values separated by commas,
    as pandas and spreadsheets read it; else values are separated by blanks. Container, unit, gravity and contact gap
    stand in comments at the top, where :func:`voxgran.load` finds them; in a table only if the container is tilted,
    since no box around the spheres shows that. Numbers have as many digits as read back to the same bits. Mass
    properties of clumps that are not those of their spheres are not kept: a ``.vtp`` holds them.

    Raises
    ------
    InputError
        If a grain is neither a sphere, nor a clump of spheres, nor a disk, or the container that is kept is of a class
        that is not registered.
    OutputExistsError
        If the file is there and `overwrite` is false.
    OutputError
        If it cannot be written; what was there before is untouched.
    """
    centers, radii, owner = owned_spheres(packing)
    names = ["x", "y", "z", "r"] if packing.dimension == 3 else ["x", "y", "r"]
    rows, form = np.column_stack([centers[:, : len(names) - 1], radii]), ["%r"] * len(names)
    clump = np.where(np.bincount(owner, minlength=packing.count)[owner] > 1, owner, -1)
    if (clump >= 0).any():
        rows, names, form = np.column_stack([rows, clump]), [*names, "clumpId"], [*form, "%d"]
    is_table = os.fspath(path).lower().endswith(".csv")
    mark = "," if is_table else " "
    head = f"{mark.join(names)}\n"
    if not is_table or any(tilt_of(packing.container)):
        held = json.dumps(saved_mapping(packing.container))
        told = f"{UNIT}{packing.unit}\n{CONTAINER}{held}\n"
        told += "".join(f"# {name} {json.dumps(getattr(packing, name))}\n" for name in FIELDS)
        # names in a comment come first, as YADE writes them
        head = told + head if is_table else f"# {head}{told}"
    with written_whole(path, overwrite=overwrite) as draft, draft.open("w", encoding="utf-8") as file:
        file.write(head)
        for start in range(0, len(rows), _ROWS_AT_ONCE):
            block = rows[start : start + _ROWS_AT_ONCE]
            line = mark.join(form) + "\n"
            file.write(line * len(block) % tuple(block.ravel().tolist()))


def owned_spheres(packing: Packing) -> tuple[Floats, Floats, Integers]:
    """Return centers, radii and grain of all spheres.

    Raises
    ------
    InputError
        If a grain is neither a sphere nor a clump of spheres nor a disk.
    """
    centers, radii, owner = [np.zeros((0, 3))], [np.zeros(0)], [np.zeros(0, np.int64)]
    for index in np.unique(packing.shape_id).tolist():
        members, found = np.flatnonzero(packing.shape_id == index), spheres_of(packing, index)
        if found is None:
            geometry = packing.shapes[index].geometry
            kind = geometry.kind if isinstance(geometry, Primitive | Outline) else type(geometry).__name__.lower()
            raise InputError(
                f"grain {members[0]} is {with_article(kind)}: text holds only spheres, clumps of them and disks; save "
                "as .vtp, or pack the clumps of fit_clump instead, or take packing.with_clumps()"
            )
        centers.append(found[0])
        radii.append(found[1])
        owner.append(np.repeat(members, len(found[1]) // len(members)))
    order = np.argsort(np.concatenate(owner), kind="stable")
    return np.concatenate(centers)[order], np.concatenate(radii)[order], np.concatenate(owner)[order]
