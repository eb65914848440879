"""Spheres as text, one ``x y z r`` a line: the form that every program for spheres reads."""

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.errors import FileFormatError, InputError
from voxgran._base.files import existing_file, written_whole
from voxgran.containers.box import Box
from voxgran.containers.make import make_container
from voxgran.containers.model import Container
from voxgran.packing.model import Packing
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.spheres import Spheres

_CONTAINER, _UNIT = "# container ", "# unit "
_ROWS_AT_ONCE = 100_000


def save_spheres(packing: Packing, path: str | os.PathLike[str], *, overwrite: bool = True) -> None:
    """Write spheres as text.

    Parameters
    ----------
    packing : Packing
        Grains that are balls, or clumps of spheres; a clump is written as its spheres.
    path : path-like
        File to write; with the suffix ``.csv`` values are parted by commas, else by blanks.
    overwrite : bool
        Whether a file that is there may be replaced.

    Raises
    ------
    InputError
        If a grain is neither a ball nor a clump of spheres.
    OutputExistsError
        If the file is there and `overwrite` is false.
    OutputError
        If it cannot be written; what was there before is untouched.

    Notes
    -----
    Numbers have as many digits as read back to the same bits. Unit and container stand in comments at the top,
    where :func:`load_spheres` finds them.
    """
    rows = np.column_stack(spheres_of(packing))
    mark = "," if os.fspath(path).lower().endswith(".csv") else " "
    head = f"# x y z r of {len(rows)} spheres\n{_UNIT}{packing.unit}\n"
    head += f"{_CONTAINER}{json.dumps(packing.container.to_mapping())}\n"
    with written_whole(path, overwrite=overwrite) as draft, draft.open("w", encoding="utf-8") as file:
        file.write(head)
        for start in range(0, len(rows), _ROWS_AT_ONCE):
            block = rows[start : start + _ROWS_AT_ONCE]
            line = mark.join(["%r"] * 4) + "\n"
            file.write(line * len(block) % tuple(block.ravel().tolist()))


def load_spheres(
    path: str | os.PathLike[str], *, container: Container | None = None, unit: str | None = None
) -> Packing:
    """Read spheres from text.

    Parameters
    ----------
    path : path-like
        One sphere a line: x, y, z, r, parted by blanks, tabs or commas; what follows on the line is ignored. Blank
        lines and what follows a ``#`` are skipped, and so is one line of column names ``x y z r`` at the top.
    container : Container, optional
        What holds the spheres. Left out, it is the one in the comments that :func:`save_spheres` writes, or else the
        box around the spheres; the provenance says so under ``"assumed"``.
    unit : str, optional
        Unit of the lengths; left out, the one in the comments, or else ``"1"``.

    Returns
    -------
    Packing
        Grain k is the k-th sphere.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If a line is not a sphere; the message gives its number.
    InputError
        If there is neither a container nor a sphere to put a box around.
    """
    found = existing_file(path)
    try:
        rows = _rows(found)
        given, noted = _comments(found)
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{found} is no text ({error.reason}): give spheres as lines of x y z r") from error
    provenance: dict[str, Any] = {"method": "file", "parameters": {"path": str(found)}}
    held = container or given
    if held is None:
        if not len(rows):
            raise InputError(f"{found} holds no sphere and names no container: give the container")
        lower = (rows[:, :3] - rows[:, 3:]).min(axis=0)
        x, y, z = ((rows[:, :3] + rows[:, 3:]).max(axis=0) - lower).tolist()
        held = Box((x, y, z), origin=tuple(lower.tolist()))
        provenance["assumed"] = {"container": "the box around the spheres"}
    return Packing.of(
        (Shape.of(Primitive("sphere", (0.5,)), name="sphere"),),
        held,
        position=rows[:, :3],
        scale=2 * rows[:, 3],
        provenance=provenance,
        unit=unit or noted or "1",
    )


def spheres_of(packing: Packing) -> tuple[Floats, Floats]:
    """Return centers (n, 3) and radii (n,) of all spheres of a packing, in the order of the grains.

    Parameters
    ----------
    packing : Packing
        Grains that are balls, or clumps of spheres.

    Returns
    -------
    centers : (n, 3) ndarray of float
    radii : (n,) ndarray of float

    Raises
    ------
    InputError
        If a grain is neither.
    """
    centers, radii, owner = [np.zeros((0, 3))], [np.zeros(0)], [np.zeros(0, np.int64)]
    for index in np.unique(packing.shape_id):
        members = np.flatnonzero(packing.shape_id == index)
        body_centers, body_radii = _spheres_of_shape(packing.shapes[index], int(members[0]))
        scale = packing.scale[members]
        turned = np.einsum("gij,sj->gsi", packing.matrices[members], body_centers)
        placed = turned * scale[:, None, None] + packing.position[members, None, :]
        centers.append(placed.reshape(-1, 3))
        radii.append((scale[:, None] * body_radii).ravel())
        owner.append(np.repeat(members, len(body_radii)))
    order = np.argsort(np.concatenate(owner), kind="stable")
    return np.concatenate(centers)[order], np.concatenate(radii)[order]


def _spheres_of_shape(shape: Shape, grain: int) -> tuple[Floats, Floats]:
    """Return centers and radii of the spheres of one shape in its body frame."""
    geometry = shape.geometry
    if isinstance(geometry, Spheres):
        return geometry.centers, geometry.radii
    if isinstance(geometry, Primitive) and geometry.kind == "sphere":
        return np.zeros((1, 3)), np.array(geometry.dimensions)
    kind = geometry.kind if isinstance(geometry, Primitive) else type(geometry).__name__.lower()
    raise InputError(
        f"grain {grain} is a {kind}: x y z r holds only spheres; save as .vtp, or pack the clumps of fit_clump instead"
    )


def _lines(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Yield number and words of each line that holds something."""
    with path.open(encoding="utf-8") as file:
        for number, line in enumerate(file, 1):
            words = line.partition("#")[0].replace(",", " ").split()
            if words:
                yield number, words


def _rows(path: Path) -> Floats:
    """Return the (n, 4) numbers; the fast way first, line by line where that fails, to name the line."""
    lines = _lines(path)
    number, words = next(lines, (0, []))
    names = [word.lower() for word in words[:4]]
    skipped = number if names[:3] == ["x", "y", "z"] else 0
    if skipped and names[3:] not in (["r"], ["radius"]):
        raise FileFormatError(f"{path}, line {skipped}: the columns are {' '.join(names)}; they must be x y z r")
    if skipped:
        number, words = next(lines, (0, []))
    if not words:
        return np.zeros((0, 4))
    with path.open(encoding="utf-8") as file:
        for _ in range(number):
            first = file.readline()
    mark = "," if "," in first.partition("#")[0] else None
    try:
        rows: Floats = np.loadtxt(
            path, comments="#", delimiter=mark, usecols=(0, 1, 2, 3), ndmin=2, skiprows=skipped, encoding="utf-8"
        )
    except ValueError:
        return _slow_rows(path, skipped)
    if np.isfinite(rows).all() and (rows[:, 3] > 0).all():
        return rows
    return _slow_rows(path, skipped)


def _slow_rows(path: Path, skipped: int) -> Floats:
    """Read line by line and refuse the first bad one."""
    rows = []
    for number, words in _lines(path):
        if number <= skipped:
            continue
        try:
            x, y, z, r = (float(word) for word in words[:4])
        except ValueError:
            shown = " ".join(words)[:60]
            raise FileFormatError(f"{path}, line {number}: {shown!r} is not x y z r; mend or remove the line") from None
        if not (np.isfinite([x, y, z, r]).all() and r > 0):
            raise FileFormatError(
                f"{path}, line {number}: x y z r is {x} {y} {z} {r}; all must be finite and r above 0; "
                "mend or remove the line"
            )
        rows.append((x, y, z, r))
    return np.array(rows, dtype=np.float64).reshape(-1, 4)


def _comments(path: Path) -> tuple[Container | None, str | None]:
    """Return container and unit from the comments at the top."""
    container, unit = None, None
    with path.open(encoding="utf-8") as file:
        for number, line in enumerate(file, 1):
            if not line.startswith("#"):
                break
            if line.startswith(_UNIT):
                unit = line.removeprefix(_UNIT).strip()
            elif line.startswith(_CONTAINER):
                try:
                    container = make_container(json.loads(line.removeprefix(_CONTAINER)))
                except (ValueError, KeyError, TypeError) as error:
                    raise FileFormatError(
                        f"{path}, line {number}: the container cannot be read ({error}); mend or remove the line"
                    ) from error
    return container, unit
