"""Containers from plain mappings, as in scene files and saved packings."""

from collections.abc import Callable, Mapping
from typing import Any

from voxgran._base.arrays import as_faces, as_points, as_vector
from voxgran._base.calls import explained
from voxgran._base.errors import InputError, UnknownNameError, shown, with_article
from voxgran._base.names import nearest, unknown
from voxgran.containers.box import Box
from voxgran.containers.closed_mesh import ClosedMesh
from voxgran.containers.cylinder import Cylinder
from voxgran.containers.disk import Disk
from voxgran.containers.model import Container
from voxgran.containers.polygon import Polygon
from voxgran.containers.rectangle import Rectangle
from voxgran.containers.sphere import Sphere
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape

#: the class of each kind, the keys that it needs, and those that it takes beside them
KINDS: dict[str, tuple[type, tuple[str, ...], tuple[str, ...]]] = {
    "box": (Box, ("lengths",), ("periodic", "origin")),
    "cylinder": (Cylinder, ("radius", "height"), ("origin",)),
    "disk": (Disk, ("radius",), ("origin",)),
    "mesh": (ClosedMesh, (), ("file", "vertices", "faces", "name", "offset")),
    "polygon": (Polygon, (), ("file", "pixel_size", "level", "min_area", "origin", "corners", "holes")),
    "rectangle": (Rectangle, ("lengths",), ("periodic", "origin")),
    "sphere": (Sphere, ("radius",), ("origin",)),
}
#: meaning of the keys, for the reference of the scene file
KEYS: dict[str, str] = {
    "lengths": "edges of a box (3 lengths) or rectangle (2)",
    "periodic": 'axes along which a box or rectangle repeats, such as `"xy"`; default: none',
    "radius": "radius of a cylinder, disk or sphere, a length above 0",
    "height": "height of a cylinder along z, a length above 0",
    "origin": "lower corner of a box, rectangle or picture, center of a disk, sphere or base of a cylinder; default: 0",
    "file": "closed mesh, or picture of the inside of a polygon, relative to the scene file",
    "vertices": "points of a mesh without file, shape (n, 3)",
    "faces": "triangles of a mesh without file, shape (m, 3), as indices of vertices",
    "name": "name of a mesh without file",
    "offset": "what is added to the vertices of a mesh without file",
    "pixel_size": "edge of a pixel of a picture, a length above 0",
    "level": "value at the boundary of a picture; default: halfway between its smallest and its largest",
    "min_area": "regions and holes of a picture of less area, in pixels, are left out as noise",
    "corners": "corners of a polygon in order, shape (n, 2), in place of a file",
    "holes": "corners of each hole of a polygon",
}


def container_classes() -> str:
    """Return the names of the classes of containers, as messages list them."""
    return ", ".join(sorted(made.__name__ for made, _, _ in KINDS.values()))


def refuse_own(container: Container) -> None:
    """Refuse to write a container of a class that :func:`make_container` does not make again.

    Raises
    ------
    InputError
        If it is of such a class.
    """
    if type(container) not in [made for made, _, _ in KINDS.values()]:
        raise InputError(
            f"container is a {type(container).__name__}, a class of your own: load could not make it again; give the "
            f"packing one of {container_classes()} with dataclasses.replace, such as a ClosedMesh of the same walls"
        )


@explained(hint='make_container({"kind": "box", "lengths": [4, 4, 6]})')
def make_container(mapping: Mapping[str, Any], where: str = "[container]") -> Container:
    """Return a container from kind and parameters.

    Parameters
    ----------
    mapping : mapping
        With the key ``kind``; a mesh has a ``file``, or ``vertices`` and ``faces``, a polygon ``corners`` and
        ``holes``, or the ``file`` of a picture with its ``pixel_size``.
    where : str
        Name of the mapping in messages.

    Returns
    -------
    Container

    Raises
    ------
    UnknownNameError
        If the kind or a key is unknown.
    InputError
        If `mapping` is not a mapping, a key is missing or a value is invalid.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.make_container({"kind": "box", "lengths": [4, 4, 6], "periodic": "xy"}).volume
    96.0
    """
    if not isinstance(mapping, Mapping):
        raise InputError(f"{where} is {shown(mapping)}: it must be a mapping with the key kind; give one")
    rest = dict(mapping)
    kind = rest.pop("kind", None)
    if kind is None:
        # another key may have been written in its place
        slip = next((key for key in rest if nearest(key, ("kind",))), None)
        meant = "" if slip is None else f", and {slip!r} may stand for it"
        raise InputError(f"{where} kind is missing{meant}: it must be one of {', '.join(KINDS)}; add it")
    if not isinstance(kind, str) or kind not in KINDS:
        raise UnknownNameError(unknown(f"{where} kind", kind, KINDS))
    made, needed, optional = KINDS[kind]
    for key in rest:
        if key not in needed + optional:
            raise UnknownNameError(unknown(f"{where} key", key, needed + optional))
    for key in needed:
        if key not in rest:
            raise InputError(f"{where} {key} is missing: {with_article(kind)} needs it; add it")
    makers: dict[type, Callable[[Mapping[str, Any], str], Container]] = {ClosedMesh: _make_mesh, Polygon: _make_polygon}
    container: Container = makers[made](rest, where) if made in makers else made(**rest)
    return container


def _make_polygon(rest: Mapping[str, Any], where: str) -> Polygon:
    """Return a polygon from its corners or from a picture."""
    if ("file" in rest) == ("corners" in rest):
        told = "both given" if "file" in rest else "both missing"
        raise InputError(f"{where} corners and file are {told}: a polygon has either; give one of them")
    own = ("corners", "holes") if "corners" in rest else ("file", "pixel_size", "level", "min_area", "origin")
    for key in rest:
        if key not in own:
            raise InputError(
                f"{where} {key} is given with {own[0]}: beside it there may be {', '.join(own[1:])} only; leave it out"
            )
    if "corners" in rest:
        return Polygon(rest["corners"], holes=rest.get("holes", ()))
    if "pixel_size" not in rest:
        raise InputError(f"{where} pixel_size is missing: it gives a picture its lengths; add it")
    return Polygon.from_image(rest["file"], **{key: value for key, value in rest.items() if key != "file"})


def _make_mesh(rest: Mapping[str, Any], where: str) -> ClosedMesh:
    """Return a closed mesh from a file or from arrays."""
    if "file" in rest:
        return ClosedMesh.from_file(rest["file"])
    if "vertices" not in rest or "faces" not in rest:
        raise InputError(f"{where} file is missing: a mesh container needs a file, or vertices and faces; add it")
    name = str(rest.get("name", "container"))
    if "offset" not in rest:
        return ClosedMesh(Shape.from_mesh(rest["vertices"], rest["faces"], name=name))
    # vertices written by a container are relative to the centroid already and are restored bit for bit
    vertices = as_points(rest["vertices"], "vertices")
    x, y, z = (float(value) for value in as_vector(rest["offset"], "offset"))
    return ClosedMesh(Shape(Mesh(vertices, as_faces(rest["faces"], len(vertices))), name, (x, y, z)))
