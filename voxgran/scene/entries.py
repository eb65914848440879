"""Entries of a scene: [[shape]], its files and families, how many shapes each stands for, and their shares; [[layer]],
layers that are packed one after the other; and [material] or [[material]], one material or several by name.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from voxgran._base.arrays import as_choice, as_count, as_number, as_positive, as_share, check_type
from voxgran._base.config import from_mapping, parameters_of, to_mapping
from voxgran._base.errors import InputError, UnknownNameError, check_known, nearest, shortened, shown, unknown
from voxgran._base.files import existing_file
from voxgran._base.seeds import stream
from voxgran._base.units import as_unit
from voxgran.clumps.fit import TARGETS, fit_clump, record_of
from voxgran.clumps.method import clump_registry
from voxgran.contacts.assembly import NOT_STATED
from voxgran.geometry.orientation_laws.law import OrientationLaw
from voxgran.geometry.orientations import make_orientations
from voxgran.scene.keys import (
    DENSITIES,
    AnyShape,
    ClumpOfShape,
    Layered,
    NamedMaterial,
    ShapeOfFamily,
    ShapeOfFile,
    names_of,
    refuse_unknown,
)
from voxgran.settling.material import Material
from voxgran.settling.materials import Materials
from voxgran.shapes.family import families, make_shape, make_shapes, seeds_of_shapes
from voxgran.shapes.files import shape_of_file
from voxgran.shapes.generating.ranges import drawn
from voxgran.shapes.model import Shape
from voxgran.shapes.repairing.diagnose import Remedies
from voxgran.shapes.repairing.simplify import FEWEST, simplify
from voxgran.shapes.roughness.parameters import Roughness
from voxgran.shapes.roughness.roughen import roughen
from voxgran.shapes.sizes import SizeDistribution, make_sizes

#: keys of a [[shape]] from a file, and of any
FILE_KEYS = names_of(AnyShape, ShapeOfFile)
FAMILY_KEYS = tuple(key for key in names_of(AnyShape, ShapeOfFamily) if key not in ("family", "share"))
SHAPE_KEYS = (*FILE_KEYS, *names_of(ShapeOfFamily))
#: remedies for a mesh that is not one closed solid
REMEDIES = Remedies(
    mend="set repair = true in its [[shape]]",
    keep_open="set surface = true",
    choose="choose with 'voxgran repair --bodies largest'",
    hole="close it with 'voxgran repair' and a larger --max-hole",
)
#: different shapes of a [[shape]] that names a model alone
MANY = 50
#: keys of a clump beside the parameters of its method
CLUMP_KEYS = names_of(ClumpOfShape)


@dataclass(frozen=True, slots=True)
class ShapeEntry:
    """One [[shape]]: a file or a family with parameters, its share, how a clump is fitted that is packed in its
    place (None for the shape itself), how many different shapes of a family it stands for, its roughness, its density
    (None for that of the scene), the largest number of its triangles (None for all), and the name of its material.
    """

    source: Literal["file", "family"]
    name: str
    share: float = 1.0
    parameters: Mapping[str, Any] = field(default_factory=dict)
    clump: Mapping[str, Any] | None = None
    count: int | None = None
    roughness: Mapping[str, Any] | None = None
    density: float | None = None
    faces: int | None = None
    material: str | None = None

    def make(self) -> list[Shape]:
        """Return the shapes, before clumps take their place; each has a roughness of its own."""
        if self.roughness is None:
            return self._reduced()
        rest = {key: value for key, value in self.roughness.items() if key != "seed"}
        shapes = self._reduced()
        seeds = seeds_of_shapes(self.roughness.get("seed", 0), len(shapes))
        return [roughen(shape, **rest, seed=seed) for shape, seed in zip(shapes, seeds, strict=True)]

    def _reduced(self) -> list[Shape]:
        """Return the shapes without roughness, with at most so many triangles."""
        if self.faces is None:
            return self._smooth()
        return [simplify(shape, faces=self.faces).shape for shape in self._smooth()]

    def _smooth(self) -> list[Shape]:
        """Return the shapes without roughness."""
        if self.source == "file":
            return [shape_of_file(self.name, remedies=REMEDIES, **self.parameters)]
        if self.count is not None:
            return make_shapes(self.name, count=self.count, **self.parameters)
        return [make_shape(self.name, **self.parameters)]

    def grains(self) -> list[tuple[Shape, dict[str, Any] | None]]:
        """Return what is packed, and what provenance says of each clump; None where there is none."""
        if self.clump is None:
            return [(shape, None) for shape in self.make()]
        clumps = [fit_clump(shape, **self.clump) for shape in self.make()]
        return [(clump.to_shape(), record_of(clump)) for clump in clumps]

    def shares(self) -> list[float]:
        """Return the share of each shape: equal parts of that of the entry."""
        number = 1 if self.count is None else self.count
        return [self.share / number] * number

    def to_mapping(self) -> dict[str, Any]:
        """Return the entry as nested JSON-able values, as the scene file has it."""
        tables = {"clump": self.clump, "roughen": self.roughness}
        more = {name: getattr(self, name) for name in ("density", "count", "faces", "material")} | {
            key: None if table is None else dict(table) for key, table in tables.items()
        }
        rest = {key: value for key, value in more.items() if value is not None}
        return {self.source: self.name, "share": self.share, **self.parameters, **rest}


def shape_entries(entries: Any, folder: Path) -> tuple[ShapeEntry, ...]:
    """Return the checked [[shape]] entries of a scene; files are relative to the folder.

    Raises
    ------
    UnknownNameError
        If a key or a family is unknown; the message gives the nearest name.
    InputError
        If a value breaks a rule.
    """
    if not isinstance(entries, list) or not entries:
        kind = "one table" if isinstance(entries, Mapping) else shown(entries)
        raise InputError(f"[shape] is {kind}: write [[shape]], once per shape")
    made = []
    for entry in entries:
        check_type(entry, Mapping, "[[shape]]", "a section; write [[shape]] above its keys")
        rest = dict(entry)
        share = as_number(rest.pop("share", 1.0), "[[shape]] share", at_least=0.0)
        density = as_positive(rest.pop("density"), "[[shape]] density") if "density" in rest else None
        faces = as_count(rest.pop("faces"), "[[shape]] faces", at_least=FEWEST) if "faces" in rest else None
        material = rest.pop("material", None)
        check_type(material, (str, type(None)), "[[shape]] material", "the name of a [[material]]")
        clump = _clump(rest.pop("clump")) if "clump" in rest else None
        roughness = _roughness(rest.pop("roughen")) if "roughen" in rest else None
        if "model" in rest and not {"file", "family"} & set(rest):
            rest = {"family": "learned", "count": MANY, **rest}
        if ("file" in rest) == ("family" in rest):
            meant = next((key for key in entry if key not in SHAPE_KEYS and nearest(key, ("file", "family"))), None)
            if meant is not None:
                raise UnknownNameError(unknown("[[shape]] key", meant, SHAPE_KEYS))
            raise InputError(
                f"[[shape]] has the keys {shortened(', '.join(entry))}: give one of file, family and model"
            )
        common = {"share": share, "clump": clump, "roughness": roughness, "density": density, "faces": faces}
        common["material"] = material
        made.append(_of_file(rest, folder, common) if "file" in rest else _of_family(rest, folder, common))
    return tuple(made)


def with_densities(shapes: tuple[ShapeEntry, ...], density: float) -> tuple[ShapeEntry, ...]:
    """Return the entries, refused where some have a density of their own and the others have none.

    Raises
    ------
    InputError
        If one has none, and the scene neither.
    """
    given = [entry.density for entry in shapes]
    if None in given and given != [None] * len(shapes) and density == NOT_STATED:
        raise InputError(
            f"[[shape]] {shapes[given.index(None)].name} has no density, and another [[shape]] has one: the mass of "
            "all grains must be known; give it a density, or give [scene] density"
        )
    return shapes


def _of_file(rest: dict[str, Any], folder: Path, common: Mapping[str, Any]) -> ShapeEntry:
    """Return the checked entry of a file with what all entries have."""
    path = folder / str(rest.pop("file"))
    for key, value in rest.items():
        if key == "count":
            raise InputError("[[shape]] has a file and count: a file is one shape; say in [packing] how many grains")
        check_known("[[shape]] key", key, FILE_KEYS)
        if key == "unit":
            as_unit(value, "[[shape]] unit")
        elif not isinstance(value, bool):
            raise InputError(f"[[shape]] {key} is {shown(value)}: it must be true or false")
    if common["clump"] is not None and rest.get("surface"):
        raise InputError("[[shape]] has surface = true and clump: an open surface has no clump; leave one out")
    return ShapeEntry("file", str(existing_file(path)), parameters=rest, **common)


def _of_family(rest: dict[str, Any], folder: Path, common: Mapping[str, Any]) -> ShapeEntry:
    """Return the checked entry of a family with what all entries have."""
    family = rest.pop("family")
    for key in ("like", "model"):
        given = rest.get(key)
        if isinstance(given, str) and Path(given).suffix:
            # a file, which a scene names relative to itself
            rest[key] = str(existing_file(folder / given))
    entry, where = families().get(family), f"[[shape]] {family}"
    known = {item.name for item in parameters_of(entry.parameters)}
    for key in rest:
        if key not in (*known, *FAMILY_KEYS):
            names = (*(item.name for item in parameters_of(entry.parameters)), "share", *FAMILY_KEYS)
            raise UnknownNameError(unknown(f"{where} key", key, names))
    seed = {key: rest.pop(key) for key in ("seed",) if key in rest}
    count = rest.pop("count") if "count" in rest else None
    # values that are drawn differ between shapes, so that the ranges are kept and one draw is checked
    values = drawn(entry.parameters, rest, stream(0, "check"), where=where)
    settings = given_values(entry.parameters, values, where, beside=FAMILY_KEYS)
    settings |= {key: value for key, value in rest.items() if key in settings and values[key] is not value}
    if count is not None:
        as_count(count, "[[shape]] count", at_least=1)
        if (
            common["roughness"] is None
            and not entry.random
            and count > 1
            and all(values[key] is value for key, value in rest.items())
        ):
            raise InputError(
                f"[[shape]] has count = {count} and family {family!r}: its shapes would all be equal; say in [packing] "
                "how many grains, or give a range in place of a number"
            )
    return ShapeEntry("family", family, parameters=settings | seed, count=count, **common)


def given_values(
    cls: type[Any], mapping: Mapping[str, Any], where: str, *, beside: Iterable[str] = ()
) -> dict[str, Any]:
    """Return checked parameters of a class as given."""
    made: Any = from_mapping(cls, mapping, where, beside=beside)
    return {key: getattr(made, key) if isinstance(value, str) else value for key, value in mapping.items()}


def _clump(given: Any) -> dict[str, Any]:
    """Return the checked keywords of `fit_clump` that the key clump of a [[shape]] holds: a number of spheres, or a
    table.
    """
    where = "[[shape]] clump"
    if not isinstance(given, Mapping):
        return {"max_spheres": as_count(given, where, at_least=1)}
    rest = dict(given)
    beside = {key: rest.pop(key) for key in CLUMP_KEYS if key in rest}
    parameters = clump_registry().get(beside.get("method", "optimal")).parameters
    for key, least in (("max_spheres", 1), ("seed", 0)):
        if key in beside:
            as_count(beside[key], f"{where} {key}", at_least=least)
    if ("target" in beside) != ("value" in beside):
        missing = "value" if "target" in beside else "target"
        raise InputError(f"{where} has no {missing}: target and value belong together; give both, or max_spheres alone")
    if "target" in beside:
        as_choice(beside["target"], f"{where} target", TARGETS)
        as_share(beside["value"], f"{where} value")
    return beside | given_values(parameters, rest, where, beside=CLUMP_KEYS)


def _roughness(given: Any) -> dict[str, Any]:
    """Return the checked keywords of `roughen` that the key roughen of a [[shape]] holds."""
    where = "[[shape]] roughen"
    check_type(given, Mapping, where, "a table, such as { rms = 0.02 }")
    rest = dict(given)
    seed = {"seed": as_count(rest.pop("seed"), f"{where} seed")} if "seed" in rest else {}
    return given_values(Roughness, rest, where, beside=("seed",)) | seed


#: sections and keys of [packing] that each layer has of its own, or that are for one packing alone
ALONE = ("shape", "sizes", "orientations", "grains")
ALONE_IN_PACKING = ("count", *DENSITIES, "start", "height")


@dataclass(frozen=True, slots=True, kw_only=True)
class LayerEntry:
    """One [[layer]]: its shapes, the number of its grains or its thickness, and their sizes and orientations."""

    shapes: tuple[ShapeEntry, ...]
    count: int | None = None
    height: float | None = None
    sizes: SizeDistribution | None = None
    orientations: OrientationLaw | None = None

    def to_mapping(self) -> dict[str, Any]:
        """Return the entry as nested JSON-able values, as the scene file has it."""
        laws = {"sizes": self.sizes, "orientations": self.orientations}
        given = {"count": self.count, "height": self.height} | {
            key: None if law is None else law.to_mapping() for key, law in laws.items()
        }
        kept = {key: value for key, value in given.items() if value is not None}
        return {"shape": [entry.to_mapping() for entry in self.shapes], **kept}


def layer_entries(mapping: Mapping[str, Any], folder: Path, parameters: type) -> tuple[LayerEntry, ...]:
    """Return the checked [[layer]] entries of a scene, of which these are the parameters of the method; none without.

    Raises
    ------
    UnknownNameError
        If a key, a family or a kind is unknown.
    InputError
        If a value breaks a rule, a layer has no shape, or not one of count and height, or another section has what the
        layers have of their own.
    """
    if "layer" not in mapping:
        return ()
    entries, packing = mapping["layer"], mapping["packing"]
    if not isinstance(entries, list) or not entries:
        raise InputError(f"[layer] is {shown(entries)}: write [[layer]], once per layer, the lowest first")
    for name in ALONE:
        if name in mapping:
            raise InputError(f"[{name}] and [[layer]]: each layer has its own; write it as [layer.{name}] of a layer")
    for name in ALONE_IN_PACKING:
        if name in packing:
            raise InputError(f"[packing] {name} and [[layer]]: layers have count or height; leave {name} out here")
    if dict(mapping.get("output", {})).get("snapshots"):
        raise InputError("[output] snapshots and [[layer]]: snapshots are those of one packing; leave them out")
    return tuple(_layer(entry, folder, parameters) for entry in entries)


def _layer(entry: Any, folder: Path, parameters: type) -> LayerEntry:
    """Return a checked [[layer]]."""
    check_type(entry, Mapping, "[[layer]]", "a section; write [[layer]] above its keys")
    refuse_unknown(entry, "[[layer]]", Layered, beside=("shape",))
    if "shape" not in entry:
        raise InputError("[[layer]] has no shape: its grains need one; add [[layer.shape]] below it")
    if ("count" in entry) == ("height" in entry):
        raise InputError(f"[[layer]] has the keys {', '.join(entry)}: give either count or height")
    if "height" in entry and not any(item.name == "height" for item in parameters_of(parameters)):
        raise InputError("[[layer]] height: only method 'gravity' fills to a height; give count")
    return LayerEntry(
        shapes=shape_entries(entry["shape"], folder),
        count=as_count(entry["count"], "[[layer]] count") if "count" in entry else None,
        height=as_positive(entry["height"], "[[layer]] height") if "height" in entry else None,
        sizes=make_sizes(entry["sizes"], "[layer.sizes]") if "sizes" in entry else None,
        orientations=make_orientations(entry["orientations"], "[layer.orientations]")
        if "orientations" in entry
        else None,
    )


def together(
    layers: tuple[LayerEntry, ...], parameters: Mapping[str, Any]
) -> tuple[tuple[ShapeEntry, ...], int | None, dict[str, Any]]:
    """Return the shapes of all layers, the number of their grains, and the parameters of the method with the height of
    all, as far as all layers state it: those of one packing that costs as much.
    """
    counts, heights = [layer.count for layer in layers], [layer.height for layer in layers]
    count = sum(many for many in counts if many is not None) if None not in counts else None
    height = {"height": sum(one for one in heights if one is not None)} if None not in heights else {}
    return tuple(shape for layer in layers for shape in layer.shapes), count, {**parameters, **height}


def material_section(section: Any, shapes: tuple[ShapeEntry, ...], walls: Any) -> Material | Materials:
    """Return what [material] or the [[material]] entries say; walls: the key `material` of [container].

    Raises
    ------
    InputError
        If a value breaks a rule, two materials have one name, or a shape has no material although there are several.
    UnknownNameError
        If a key or a material is unknown; the message gives the nearest name.
    """
    named = [entry.material for entry in shapes if entry.material is not None]
    if isinstance(section, Mapping):
        refuse_unknown(section, "[material]", Material)
        if named or walls is not None:
            raise InputError(
                f"material of a [[shape]] or of [container] is {named[0] if named else walls!r}: one [material] holds "
                "for all; write [[material]] with a name, once for each material"
            )
        return from_mapping(Material, section, "[material]")
    materials: dict[str, Material] = {}
    pairs: dict[str, Any] = {}
    for entry in section:
        check_type(entry, Mapping, "[[material]]", "a section; write [[material]] above its keys")
        refuse_unknown(entry, "[[material]]", Material, beside=names_of(NamedMaterial))
        named_by = {key: entry[key] for key in names_of(NamedMaterial) if key in entry}
        own = from_mapping(NamedMaterial, named_by, "[[material]]")
        if own.name in materials:
            raise InputError(f"[[material]] name {own.name!r} is given twice: names tell materials apart; change one")
        rest = {key: value for key, value in entry.items() if key not in names_of(NamedMaterial)}
        materials[own.name] = from_mapping(Material, rest, f"[[material]] {own.name}")
        pairs[own.name] = own.pair or {}
    missing = [entry.name for entry in shapes if entry.material is None]
    if missing and len(materials) > 1:
        raise InputError(
            f"[[shape]] {missing[0]} has no material, and there are {len(materials)}: each shape needs one; give it "
            f"material = {next(iter(materials))!r}"
        )
    of_shapes = tuple(entry.material or next(iter(materials)) for entry in shapes for _ in entry.shares())
    return Materials(materials, pairs, of_shapes or None, walls)


def material_entries(material: Material | Materials) -> tuple[Any, Any]:
    """Return the section, or the entries and the walls, from which :func:`material_section` makes a material again."""
    if isinstance(material, Material):
        return _given(material), None
    pairs = material.pairs or {}
    entries = [
        {"name": name, **_given(material.materials[name]), **({"pair": pairs[name]} if name in pairs else {})}
        for name in material.names
    ]
    return entries, material.walls


def given_parameters(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters of a method without the friction that follows from [[material]]."""
    return {key: value for key, value in parameters.items() if not isinstance(value, Materials)}


def with_material_densities(shapes: tuple[ShapeEntry, ...], material: Material | Materials) -> tuple[ShapeEntry, ...]:
    """Return the entries of shapes with the densities of their named materials, where they have none of their own."""
    if isinstance(material, Material):
        return shapes
    known, usual = material.materials, material.names[0]
    return tuple(
        entry if entry.density is not None else replace(entry, density=known[entry.material or usual].density)
        for entry in shapes
    )


def _given(material: Material) -> dict[str, Any]:
    """Return the values of a material that are not the usual ones."""
    usual = {item.name: item.default for item in parameters_of(Material)}
    return {key: value for key, value in to_mapping(material).items() if value != usual[key]}
