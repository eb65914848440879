"""The section [material] of a scene, or its [[material]] entries: one contact law, or several materials by name."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from voxgran._base.arrays import check_type
from voxgran._base.config import from_mapping, parameters_of, to_mapping
from voxgran._base.errors import InputError
from voxgran.scene.keys import NamedMaterial, names_of, refuse_unknown
from voxgran.scene.shape_entries import ShapeEntry
from voxgran.settling.material import Material
from voxgran.settling.materials import Materials


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
