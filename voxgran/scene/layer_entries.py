"""The [[layer]] entries of a scene: layers of different materials, which are packed one after the other."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from voxgran._base.arrays import as_count, as_positive, check_type
from voxgran._base.config import parameters_of
from voxgran._base.errors import InputError, shown
from voxgran.geometry.orientation_laws.law import OrientationLaw
from voxgran.geometry.orientations import make_orientations
from voxgran.scene.keys import Layered, refuse_unknown
from voxgran.scene.shape_entries import ShapeEntry, shape_entries
from voxgran.shapes.sizes import SizeDistribution, make_sizes

#: sections and keys of [packing] that each layer has of its own, or that are for one packing alone
ALONE, ALONE_IN_PACKING = ("shape", "sizes", "orientations", "grains"), ("count", "solid_fraction", "start", "height")


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
