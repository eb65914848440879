"""A packing as named arrays and texts, and back, bit for bit: what a packing file holds, whatever its format.

Arrays carry what must be exact and may be long: poses, mesh vertices and faces, centers and radii. Texts are JSON,
whose numbers Python writes so that they read back to the same bits: primitives, container, provenance. A container that
is a closed mesh is kept as one shape more, after those of the grains.

Files of earlier versions have some fields of a packing in their provenance; nothing else reads them there.
"""

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import (
    Floats,
    as_faces,
    as_floats,
    as_number,
    as_place,
    as_points,
    as_quaternions,
    check_lengths,
)
from voxgran._base.errors import FileFormatError, InputError, MissingLibraryError, VoxgranError, with_article
from voxgran._base.guarded import reason_of
from voxgran._base.scalars import check_types, values_of_json
from voxgran._base.units import known_unit
from voxgran.contacts.assembly import Lid
from voxgran.contacts.forces import ContactForces
from voxgran.containers.gravity import Down, as_down
from voxgran.containers.kinds.mesh import ClosedMesh
from voxgran.containers.model import Container, package_of, saved_mapping
from voxgran.containers.one_unit import shape_of
from voxgran.io.kept import PROVENANCE, SHAPE, kept_container, kept_sizes
from voxgran.io.shape_record import planes_of, record_as_json, record_of_json, rows_of
from voxgran.packing.model import Packing
from voxgran.settling.relaxation import Relaxation
from voxgran.shapes.describing.body import Geometry
from voxgran.shapes.mesh import LatticePoints, Mesh, Surface, refuse_degenerate
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.sizes import KINDS, SizeDistribution
from voxgran.shapes.spheres import MassProperties, Spheres

#: version of the layout; a reader refuses a higher one. Only packings of several densities need the second, and only
#: those with meshes whose vertices lie on lattices the third
FORMAT = 3
#: arrays of the forces with one row a contact, and a grain; in files they stand behind this word
_OF_CONTACTS, _OF_GRAINS = ("i", "j", "point", "normal", "force", "gap"), ("residual", "rattler")
_FORCES = "forces_"


@dataclass(frozen=True, slots=True)
class Record:
    """Arrays and texts of a packing."""

    #: (n, 3) centroids of the grains
    position: Floats
    #: one row a grain; the coordination number is among them where contacts were already found
    per_grain: dict[str, NDArray[Any]]
    #: what belongs to the packing as a whole
    arrays: dict[str, NDArray[Any]]
    #: the same, as texts
    texts: dict[str, str]


def to_record(packing: Packing) -> Record:
    """Return the arrays and texts of a packing.

    Raises
    ------
    InputError
        If the provenance or the container holds something that JSON cannot, or the container or the distribution of
        sizes is of a class that is not registered, which cannot be made again.
    """
    container = packing.container
    package_of(container)
    if type(packing.asked_sizes) not in (type(None), *KINDS.values()):
        raise InputError(
            f"asked_sizes is a {type(packing.asked_sizes).__name__}, a class of your own: load could not make it "
            "again; leave it out with dataclasses.replace(packing, asked_sizes=None)"
        )
    per_grain = {
        "grain": np.arange(packing.count),
        "shape_id": packing.shape_id,
        "scale": packing.scale,
        "orientation": packing.orientation,
        "diameter": packing.diameters,
        "radius": packing.diameters / 2,
        "volume": packing.volumes,
    }
    # a closed mesh is kept as its arrays
    solid = shape_of(container)
    shapes, arrays = _shapes_apart(packing.shapes if solid is None else (*packing.shapes, solid))
    if packing._contacts:
        gap, contacts = min(packing._contacts.items())
        partners = np.concatenate([contacts.i, contacts.j])
        per_grain["coordination_number"] = np.bincount(partners, minlength=packing.count)
        arrays["coordination_gap"] = np.array([gap])
    if packing.grain_id is not None:
        per_grain["grain_id"] = packing.grain_id
    if packing.fixed is not None:
        per_grain["fixed"] = packing.fixed.astype(np.int64)
    several = isinstance(packing.density, tuple)
    if several:
        per_grain["density"] = packing.densities
    arrays["format"] = np.array([3 if "shape_steps" in arrays else 2 if several else 1])
    arrays["density"] = np.array(packing.density).reshape(-1)
    arrays["solid_fraction"] = np.array([packing.solid_fraction])
    arrays["contact_gap"] = np.array([packing.contact_gap])
    arrays["gravity"] = np.zeros(3) if packing.gravity is None else np.array(packing.gravity)
    if packing.lid is not None:
        arrays["lid"] = np.append(packing.lid.normal, packing.lid.level)
    _add_forces(packing.forces, per_grain, arrays)
    texts = {
        "unit": packing.unit,
        "stop_reason": packing.stop_reason,
        "method": str(packing.provenance.get("method", "")),
        "seed": str(packing.provenance.get("seed", "")),
        "shapes": _json(shapes, "shapes"),
        "container": _json(saved_mapping(container) if solid is None else {"kind": container.kind}, "container"),
        "provenance": _json(packing.provenance, "provenance"),
        "asked_sizes": _json(None if packing.asked_sizes is None else packing.asked_sizes.to_mapping(), "asked_sizes"),
    }
    if packing.relaxation is not None:
        texts["relaxation"] = _json(packing.relaxation.to_mapping(), "relaxation")
    return Record(packing.position, per_grain, arrays, texts)


def from_record(record: Record) -> Packing:
    """Return the packing of a record, checked like one that a user makes, with the same bits.

    Raises
    ------
    FileFormatError
        If something is missing or breaks a rule.
    MissingLibraryError
        If its container is of a package that is not installed.
    """
    try:
        version = int(record.arrays["format"][0])
        if version > FORMAT:
            raise FileFormatError(
                f"the layout has version {version}: this voxgran reads up to {FORMAT}; install a newer one"
            )
        packing = _packing(record)
    except (FileFormatError, MissingLibraryError):
        raise
    except (VoxgranError, KeyError, IndexError, TypeError, ValueError, ArithmeticError, RuntimeError) as error:
        raise FileFormatError(
            f"it holds no packing of voxgran ({reason_of(error, most=300)}): write it again"
        ) from error
    # what was checked is normalized to round-off; what was read is what was saved
    return dataclasses.replace(packing, orientation=np.array(record.per_grain["orientation"]).reshape(-1, 4))


def _packing(record: Record) -> Packing:
    """Return the packing of a record, checked."""
    entries, unit = values_of_json(record.texts["shapes"]), known_unit(record.texts["unit"])
    if unit is None:
        # before units were checked it was not taken from the shapes: it is theirs, if they agree
        units = {known_unit(entry["unit"]) for entry in entries} - {None}
        unit = units.pop() if len(units) == 1 else None
    arrays = dict(record.arrays)
    for name in {"shape_steps", "shape_corners"} & arrays.keys():
        arrays[name] = rows_of(arrays[name])
    shapes = tuple(_shape(entry, arrays, unit) for entry in entries)
    provenance = values_of_json(record.texts["provenance"])
    check_types({name: provenance[name] for name in PROVENANCE if name in provenance}, PROVENANCE, "provenance")
    kind, densities = values_of_json(record.texts["container"]), record.arrays["density"]
    solid = kind["kind"] == ClosedMesh.kind
    packing = Packing.of(
        shapes[:-1] if solid else shapes,
        ClosedMesh(shapes[-1]) if solid else kept_container(kind),
        position=record.position,
        scale=record.per_grain["scale"],
        shape_id=record.per_grain["shape_id"],
        orientation=record.per_grain["orientation"],
        density=float(densities[0]) if len(densities) == 1 else densities.tolist(),
        provenance=provenance,
        stop_reason=record.texts["stop_reason"],
        unit=unit,
    )
    return dataclasses.replace(packing, **_later_fields(record, packing))


def _later_fields(record: Record, packing: Packing) -> dict[str, Any]:
    """Return gravity, contact gap, asked sizes, lid and forces; files of before have the first three in the
    provenance.
    """
    if "gravity" not in record.arrays:
        return fields_of(packing.provenance, packing.container, packing.diameters)
    down, sizes = np.array(record.arrays["gravity"], dtype=np.float64), values_of_json(record.texts["asked_sizes"])
    return {
        "gravity": as_down(down, packing.container) if down.any() else None,
        "contact_gap": as_number(float(record.arrays["contact_gap"][0]), "contact_gap", at_least=0.0),
        "asked_sizes": None if sizes is None else kept_sizes(sizes),
        "lid": _lid(record),
        "forces": _forces(record),
        "relaxation": _relaxation(record),
        "grain_id": record.per_grain.get("grain_id"),
        "fixed": None if "fixed" not in record.per_grain else np.asarray(record.per_grain["fixed"]) != 0,
    }


def _relaxation(record: Record) -> Relaxation | None:
    """Return what an engine has changed; None where none has."""
    told = values_of_json(record.texts.get("relaxation", "null"))
    if told is None:
        return None
    check_types(told, {field.name: field.type for field in dataclasses.fields(Relaxation)}, "relaxation")
    return Relaxation(**told)


def _lid(record: Record) -> Lid | None:
    """Return the lid of a record; None where there is none."""
    if "lid" not in record.arrays:
        return None
    values = as_floats(record.arrays["lid"], "lid", shape=(4,))
    if abs(linear.norm(values[:3]) - 1.0) > 1e-9:
        raise FileFormatError(
            f"the normal of the lid is {values[:3].tolist()}: it must be a unit vector; write it again"
        )
    return Lid(values[:3].copy(), float(values[3]))


def _add_forces(
    forces: ContactForces | None, per_grain: dict[str, NDArray[Any]], arrays: dict[str, NDArray[Any]]
) -> None:
    """Add the arrays of forces, where they are known, to those of a record; friction that is not known is NaN."""
    if forces is None:
        return
    arrays[_FORCES + "friction"] = np.atleast_1d(np.nan if forces.friction is None else forces.friction)
    if forces.stress is not None:
        arrays[_FORCES + "stress"] = np.array(forces.stress)
    for names, place in ((_OF_CONTACTS, arrays), (_OF_GRAINS, per_grain)):
        for name in names:
            values = getattr(forces, name)
            # VTK has no flags
            place[_FORCES + name] = values.astype(np.uint8) if values.dtype == bool else values


def _forces(record: Record) -> ContactForces | None:
    """Return the forces of a record; None where there are none."""
    if _FORCES + "friction" not in record.arrays:
        return None
    friction = np.asarray(record.arrays[_FORCES + "friction"], dtype=np.float64)
    values = {name: record.arrays[_FORCES + name] for name in _OF_CONTACTS}
    values |= {name: record.per_grain[_FORCES + name] for name in _OF_GRAINS}
    values["rattler"] = np.asarray(values["rattler"]) != 0
    stress = record.arrays.get(_FORCES + "stress")
    one = float(friction[0]) if len(friction) == 1 else friction
    return ContactForces(**values, friction=None if np.isnan(friction).any() else one, stress=stress)


def _json(value: Any, name: str) -> str:
    """Write a value as JSON; numbers and arrays of NumPy as those of Python."""
    try:
        return json.dumps(dict(value) if isinstance(value, Mapping) else value, default=_plain)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"{name} cannot be written as JSON ({error}): keep to numbers, texts, lists and mappings"
        ) from error


def _plain(value: Any) -> Any:
    """Return what JSON knows in place of a value that it does not."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    raise TypeError(f"{with_article(type(value).__name__)} is no JSON")


def _shapes_apart(shapes: tuple[Shape, ...]) -> tuple[list[dict[str, Any]], dict[str, NDArray[Any]]]:
    """Return one entry a shape, and the arrays of all shapes joined end to end."""
    points: list[Floats] = [np.zeros((0, 3))]
    faces: list[NDArray[Any]] = [np.zeros((0, 3), np.int64)]
    radii: list[Floats] = [np.zeros(0)]
    steps: list[NDArray[Any]] = []
    corners: list[NDArray[Any]] = []
    entries, ends = [], {"points": 0, "faces": 0, "radii": 0, "steps": 0, "corners": 0}
    for shape in shapes:
        geometry = shape.geometry
        parts: dict[str, tuple[list[Any], NDArray[Any]]] = {}
        entry: dict[str, Any] = {"name": shape.name, "unit": shape.unit, "offset": shape.offset, "key": shape.key}
        entry["geometry"] = type(geometry).__name__
        if shape.record:
            entry["record"] = record_as_json(shape.record)
        if isinstance(geometry, Mesh | Surface) and isinstance(geometry.points, LatticePoints):
            entry |= {"step": geometry.points.step, "first": geometry.points.first}
            parts = {"steps": (steps, geometry.points.steps), "corners": (corners, geometry.corners)}
        elif isinstance(geometry, Mesh | Surface):
            parts = {"points": (points, geometry.vertices), "faces": (faces, geometry.faces)}
        elif isinstance(geometry, Spheres):
            parts = {"points": (points, geometry.centers), "radii": (radii, geometry.radii)}
            if geometry.mass is not None:
                entry["mass"] = {name: getattr(geometry.mass, name) for name in ("volume", "centroid", "inertia")}
        elif isinstance(geometry, Primitive):
            entry |= {"kind": geometry.kind, "dimensions": geometry.dimensions, "rotation": geometry.rotation}
        else:
            ring = geometry.vertices
            parts = {"points": (points, np.column_stack([ring, np.zeros(len(ring))]))}
            entry |= {"kind": geometry.kind, "radius": geometry.radius, "center": geometry.center}
        for name, (joined, array) in parts.items():
            joined.append(array)
            entry[name] = (ends[name], ends[name] + len(array))
            ends[name] += len(array)
        entries.append(entry)
    arrays = {"shape_points": np.concatenate(points), "shape_faces": np.concatenate(faces)}
    if steps:
        # coordinates and numbers of vertices are near those before them
        arrays |= {"shape_steps": planes_of(steps), "shape_corners": planes_of(corners)}
    return entries, {**arrays, "shape_radii": np.concatenate(radii)}


def _shape(entry: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]], unit: str | None) -> Shape:
    """Return the shape of an entry; its key proves that it is the same solid.

    Its lengths were always taken as those of the packing: another unit, of before units were checked, is left out.
    """
    check_types(entry, SHAPE, "shape")
    x, y, z = as_place(entry["offset"], "offset").tolist()
    own = unit if known_unit(entry["unit"]) == unit else None
    record = record_of_json(entry.get("record", {}))
    geometry = _geometry(entry, arrays)
    if isinstance(geometry, Mesh | Surface):
        refuse_degenerate(geometry, str(entry["name"]))
    shape = Shape(geometry, entry["name"], (x, y, z), own, record=record)
    if shape.key != entry["key"]:
        raise FileFormatError(f"shape {shape.name!r} is not the one that was saved: write the file again")
    return shape


def _geometry(entry: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Geometry:
    """Return the geometry of an entry."""
    part = {
        name: np.array(arrays[f"shape_{name}"][slice(*entry[name])])
        for name in ("points", "faces", "radii", "steps", "corners")
        if name in entry
    }
    kind = entry["geometry"]
    if "steps" in part:
        step, first = (as_floats(entry[name], name, shape=(3,)) for name in ("step", "first"))
        faces = as_faces(part["corners"].astype(np.int64), len(part["steps"]))
        check_lengths(step, "step")
        return (Mesh if kind == "Mesh" else Surface)(LatticePoints(part["steps"], step, first), faces)
    if kind in ("Mesh", "Surface"):
        vertices = as_points(part["points"], "vertices")
        return (Mesh if kind == "Mesh" else Surface)(vertices, as_faces(part["faces"], len(vertices)))
    if kind == "Spheres":
        mass = MassProperties(**entry["mass"]) if "mass" in entry else None
        return Spheres(as_points(part["points"], "centers"), as_floats(part["radii"], "radii", shape=(None,)), mass)
    if kind == "Primitive":
        w, x, y, z = entry["rotation"]
        as_quaternions([entry["rotation"]], "rotation")
        return Primitive(entry["kind"], tuple(entry["dimensions"]), (w, x, y, z))
    if kind != "Outline":
        raise FileFormatError(f"geometry is {kind!r}: this voxgran does not know it; install a newer one")
    corners = as_points(part["points"][:, :2], "vertices", dimension=2)
    x, y = entry["center"]
    return Outline(entry["kind"], float(entry["radius"]), corners, (x, y))


def fields_of(provenance: Mapping[str, Any], container: Container, diameters: np.ndarray[Any, Any]) -> dict[str, Any]:
    """Return gravity, contact gap and asked sizes as keyword arguments of :meth:`voxgran.Packing.of`, from provenance,
    container and equivalent diameters (n,) of the grains, as measures took them.
    """
    stated = _mapping(provenance.get("parameters"))
    voxel, spacing = stated.get("voxel_size"), stated.get("spacing")
    gaps = [float(voxel)] if isinstance(voxel, int | float) else []
    if isinstance(spacing, int | float) and len(diameters):
        gaps.append(float(spacing) * float(provenance.get("median_diameter", np.median(diameters))))
    sizes = provenance.get("sizes") or _mapping(provenance.get("asked")).get("sizes")
    return {
        "gravity": _gravity(stated.get("gravity"), container),
        "contact_gap": max([0.0, *gaps]),
        "asked_sizes": _sizes(sizes),
    }


def _mapping(value: Any) -> Mapping[str, Any]:
    """Return a mapping, empty in place of anything else."""
    return value if isinstance(value, Mapping) else {}


def _sizes(stated: Any) -> SizeDistribution | None:
    """Return the distribution of a record, None where it is none."""
    try:
        return kept_sizes(stated) if isinstance(stated, Mapping) else None
    except InputError:
        return None


def _gravity(stated: Any, container: Container) -> Down | None:
    """Return the direction of gravity, the usual one where nothing was stated, None where it cannot be."""
    try:
        return as_down("down" if stated is None else stated, container)
    except InputError:
        return None
