"""Cells of mesh files, read by meshio in a process of its own."""

from pathlib import Path

import numpy as np

from voxgran._base.arrays import Floats, Integers, check_coordinates
from voxgran._base.errors import FileFormatError, InputError
from voxgran._base.files import existing_file
from voxgran._base.guarded import Content, read_guarded
from voxgran._base.lazy import load

#: names of cells in meshio, by the dimension of the mesh; of those with more nodes the corners come first
KINDS = {2: ("triangle", "triangle6"), 3: ("tetra", "tetra10")}


def read_cells(path: str, dimension: int) -> tuple[Floats, Integers]:
    """Return the nodes (n, 3) and the cells (m, dimension + 1) of a mesh in any format that meshio knows by its suffix.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If the file is damaged, or has no cells of that dimension.
    """
    found = existing_file(path)
    _, arrays = read_guarded(meshio_cells, found, dimension=dimension)
    points, cells = arrays["points"], arrays["cells"].astype(np.int64)
    if not len(cells):
        raise FileFormatError(f"{found} holds no {KINDS[dimension][0]} cells: a mesh needs them; export them too")
    if cells.min() < 0 or cells.max() >= len(points) or not np.isfinite(points).all():
        raise FileFormatError(f"{found} has cells of nodes that it does not hold: it is cut or damaged; write it again")
    try:
        check_coordinates(points, "coordinate")
    except InputError as error:
        raise FileFormatError(f"{found}: {error}") from error
    return points, cells


def meshio_cells(path: Path, *, dimension: int) -> Content:
    """Read the nodes and the cells of a mesh file, to be run by `read_guarded`."""
    mesh = load("meshio").read(str(path))
    blocks = [np.asarray(block.data)[:, : dimension + 1] for block in mesh.cells if block.type in KINDS[dimension]]
    cells = np.concatenate([np.zeros((0, dimension + 1), np.int64), *blocks])
    nodes = np.zeros((len(mesh.points), 3))
    nodes[:, :dimension] = np.asarray(mesh.points)[:, :dimension]
    return {}, {"points": nodes, "cells": cells}
