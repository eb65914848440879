"""Vessels: the space that a wall of triangles encloses, as a closed mesh."""

import os
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arrays import Floats, Integers, as_number, as_vector, check_type
from voxgran._base.calls import explained
from voxgran._base.errors import InputError, shown
from voxgran._base.files import as_path, unpacked
from voxgran.containers.enclosed import Shell, enclosed, placed
from voxgran.containers.kinds.mesh import ClosedMesh
from voxgran.containers.kinds.walls import direction
from voxgran.containers.model import ContainerKind
from voxgran.shapes.formats.mesh_files import read_surface
from voxgran.shapes.formats.sphere_files import is_spheres
from voxgran.shapes.mesh import refuse_unfit
from voxgran.shapes.model import Shape
from voxgran.shapes.repairing.diagnose import merged
from voxgran.shapes.repairing.patches import wound_alike
from voxgran.shapes.repairing.repair import parted
from voxgran.shapes.shells import edge_faults, shell_labels, without_unused


@explained(hint='Vessel("silo.stl")')
def Vessel(  # noqa: N802  (named as the containers are)
    wall: Shape | str | os.PathLike[str],
    *,
    lid: float | None = None,
    floor: float | None = None,
    point: "ArrayLike | None" = None,
    gravity: "str | ArrayLike" = "-z",
    unit: str | None = None,
) -> ClosedMesh:
    """Make a container of the space that a wall encloses.

    The mesh of a :class:`ClosedMesh` bounds the space of the grains itself; that of a vessel is a wall around it: a
    solid with a thickness, as of a silo, an hourglass or a reactor, which may be open at the top, or a shell without
    thickness whose rims are open.

    Parameters
    ----------
    wall : Shape or path-like
        A mesh, closed or open (:func:`voxgran.load_shape` with ``surface=True``), or a file of either, which may hold
        several bodies: parts of the wall, and what stands in the space.
    lid : float, optional
        Level against gravity, in the unit of lengths, at which a plane closes the space. By default a wall with a
        thickness is filled as far as it holds grains as a liquid, up to its rim; of a shell without thickness the lid
        lies at the lowest point of its highest rim, unless that rim is flat.
    floor : float, optional
        Level at which a plane closes the space below, as an outlet. By default it is the lowest level of the wall.
        Other rims of a shell are closed by triangles of least area.
    point : (3,) sequence of float, optional
        A point in the space; by default the largest space is taken.
    gravity : str or (3,) sequence of float
        Direction of gravity, such as ``"-z"``.
    unit : str, optional
        Unit of the lengths in a file.

    Returns
    -------
    ClosedMesh
        The space, which grains are packed in, verified and measured against; its mesh is exact, with the lid.

    Raises
    ------
    CallError
        If there are other arguments than these.
    MissingFileError
        If there is no such file.
    FileFormatError
        If the file cannot be read.
    DirtyMeshError
        If a shell of the surface has faces that cut through each other, or is not closed once its rims are.
    InputError
        If the wall is no mesh, it encloses no space that holds the point, or a level, the point or the direction is
        invalid.

    Notes
    -----
    What is left of a block without the wall, cut by lid and floor, falls into the outside and the spaces that they
    close; solids are subtracted exactly, by manifold3d.

    Examples
    --------
    >>> import voxgran as vg
    >>> outer, hollow = vg.shapes.box(lengths=(4, 4, 4)), vg.shapes.box(lengths=(3, 3, 3))
    >>> corners, faces = vg.shapes.box(lengths=(4, 4, 4)).vertices, outer.faces
    >>> tank = vg.Shape.from_mesh([*corners, *hollow.vertices], [*faces, *(hollow.faces[:, ::-1] + len(corners))])
    >>> round(tank.volume, 6), round(vg.Vessel(tank).volume, 6)
    (37.0, 27.0)
    """
    if isinstance(wall, str | os.PathLike):
        name, shells = _shells_of_file(wall)
    else:
        check_type(wall, Shape, "wall", "a Shape or the file of a mesh; make_shape and load_shape make one")
        if wall.dimension != 3 or not hasattr(wall.geometry, "faces"):
            raise InputError(f"wall {wall.name!r} is no mesh: a vessel is made of the triangles of a wall; give a mesh")
        name, unit = wall.name, unit or wall.unit
        shells = _parted(*placed(wall), is_open=wall.is_open)
    up = -np.array(direction(gravity, "gravity"))
    levels = {key: None if value is None else as_number(value, key) for key, value in (("lid", lid), ("floor", floor))}
    inner = None if point is None else as_vector(point, "point")
    found = enclosed(shells, up, **levels, point=inner)
    if found is None:
        holding = "" if inner is None else f" that holds the point {shown(inner.tolist())}"
        raise InputError(
            f"wall {name!r} encloses no space{holding}{_between(**levels)}: lid and floor must close it; give levels "
            "at which the wall is closed all around, or ClosedMesh(shape) where the mesh itself bounds the grains"
        )
    return ClosedMesh(Shape.from_mesh(*found, name=f"inside of {name}", unit=unit))


def _shells_of_file(path: str | os.PathLike[str]) -> tuple[str, list[Shell]]:
    """Return the name of a wall, as of its file, and the shells of its surface."""
    with unpacked(as_path(path)) as found:
        if is_spheres(found):
            raise InputError(f"wall {found} holds spheres: a vessel is made of the triangles of a wall; give a mesh")
        points, faces = merged(*read_surface(found))
    if edge_faults(faces, len(points))[1]:
        # bodies that touch each other
        points, faces = parted(points, faces) or (points, faces)
    shells = _parted(points, wound_alike(faces, len(points))[0])
    for corners, triangles, _ in shells:
        refuse_unfit(corners, triangles, found.name)
    return found.stem, shells


def _parted(points: Floats, faces: Integers, *, is_open: bool = False) -> list[Shell]:
    """Return the shells of a surface; `is_open` says that a closed one counts as open."""
    label = shell_labels(points, faces)
    parts = [without_unused(points, faces[label == k]) for k in range(int(label.max(initial=-1)) + 1)]
    return [(*part, is_open or edge_faults(part[1], len(part[0]))[0] > 0) for part in parts]


def _between(lid: float | None, floor: float | None) -> str:
    """Return between which levels a space was looked for, in words."""
    return "".join(
        f" {side} the {name} at {level:g}"
        for name, side, level in (("lid", "below", lid), ("floor", "above", floor))
        if level is not None
    )


def _make(rest: Mapping[str, Any], where: str) -> ClosedMesh:
    """Return the space that a wall of a file encloses.

    Parameters
    ----------
    file : path-like
        Mesh of the wall, relative to the scene file.
    lid : optional
        Level against gravity of a plane that closes the space.
    floor : optional
        Level of a plane that closes the space below.
    point : optional
        A point in the space, shape (3,).
    gravity : optional
        Direction of gravity, such as "-z".
    """
    if "file" not in rest:
        raise InputError(f"{where} file is missing: a vessel needs it; add it")
    return Vessel(rest["file"], **{key: value for key, value in rest.items() if key != "file"})


registration = ContainerKind(container=ClosedMesh, taken=("file", "lid", "floor", "point", "gravity"), make=_make)
