"""The canonical form of a scene: values that are written differently and mean the same give the same scene.

Values that equal their defaults are left out, whole numbers are integers, and sections that change no result of a study
are dropped.
"""

from collections.abc import Mapping
from typing import Any

from voxgran._base.config import from_mapping, parameters_of, to_mapping
from voxgran._base.scalars import nested
from voxgran.clumps.method import clump_registry
from voxgran.containers.model import UNKNOWN, boundary_of
from voxgran.packing.method import method_registry
from voxgran.scene.description import SceneDescription
from voxgran.scene.keys import AnyShape, ClumpOfShape, ShapeOfFamily, ShapeOfFile, Twinned
from voxgran.settling.parameters import Settling
from voxgran.shapes.family import families
from voxgran.shapes.roughness.parameters import Roughness

#: sections that change no result of a study: what is written, and the contact law in the input of engines
UNUSED = ("output", "material")
#: keys of [scene] that tell the runs of a cell apart
SEEDS = ("seed", "seeds")


def canonical_scene(scene: SceneDescription) -> dict[str, Any]:
    """Return the canonical form of a scene without its seed, as nested JSON-able values.

    Parameters
    ----------
    scene : SceneDescription
        The scene.
    """
    made = {key: value for key, value in scene.to_mapping().items() if key not in UNUSED}
    made["scene"] = {key: value for key, value in made["scene"].items() if key not in SEEDS}
    for table in made.get("layer", [made]):
        table["shape"] = [_shape(entry) for entry in table.get("shape", ())]
    if scene.twin is not None:
        # by the voxel a run is compared with its sample, and a study compares none
        kept = {key: value for key, value in made["twin"].items() if key != "voxel_size"}
        made["twin"] = _without_defaults(kept, Twinned)
        return dict(_plain(made))
    parameters = method_registry().get(scene.method).parameters
    given = to_mapping(from_mapping(parameters, scene.parameters, "[packing]"))
    beside = {key: value for key, value in made["packing"].items() if key not in scene.parameters}
    made["packing"] = beside | _without_defaults({key: given[key] for key in scene.parameters}, parameters)
    if "settle" in made and _is_default_settling(scene):
        del made["settle"]
    if "measure" in made:
        made["measure"] = sorted(set(made["measure"]["which"]))
    found: dict[str, Any] = _plain(made)
    return found


def canonical_numbers(scene: SceneDescription) -> dict[str, Any]:
    """Return the canonical form of all that the numbers of a scene depend on: without densities that change none.

    Parameters
    ----------
    scene : SceneDescription
        The scene.
    """
    made = canonical_scene(scene)
    if not _density_counts(scene):
        for table in made.get("layer", [made]):
            for entry in (made["scene"], *table["shape"]):
                entry.pop("density", None)
    return made


def _shape(entry: Mapping[str, Any]) -> dict[str, Any]:
    """Return a [[shape]] without values that equal their defaults."""
    made = dict(entry)
    if "clump" in made:
        method = clump_registry().get(made["clump"].get("method", "optimal"))
        made["clump"] = _without_defaults(made["clump"], ClumpOfShape, method.parameters)
    if "roughen" in made:
        # the seed is a keyword beside the parameters
        made["roughen"] = {"seed": 0} | _without_defaults(made["roughen"], Roughness)
    if "file" in made:
        return _without_defaults(made, AnyShape, ShapeOfFile)
    return _without_defaults(made, families().get(made["family"]).parameters, AnyShape, ShapeOfFamily)


def _without_defaults(given: Mapping[str, Any], *classes: type) -> dict[str, Any]:
    """Return values without those that equal the defaults of parameter classes; the first class that has a key tells
    its default.
    """
    defaults = {item.name: item.default for cls in reversed(classes) for item in parameters_of(cls)}
    return {key: value for key, value in given.items() if key not in defaults or _plain(defaults[key]) != _plain(value)}


def _density_counts(scene: SceneDescription) -> bool:
    """Return whether densities change the numbers of a study: where grains of several densities settle, or a list may
    have masses.
    """
    if scene.grains is not None:
        return True
    parameters = method_registry().get(scene.method).parameters
    if not method_registry().get(scene.method).builds_bed and not issubclass(parameters, Settling):
        return False
    given = scene.density()
    several = isinstance(given, list) and len(set(given)) > 1
    return scene.settle is not False and (several or scene.start is not None)


def _is_default_settling(scene: SceneDescription) -> bool:
    """Return whether the section [settle] says what the method does without it; False where only the shapes tell."""
    method = method_registry().get(scene.method)
    if not method.builds_bed:
        return scene.settle is False
    apart = any(scene.parameters.get(name, 0.0) for name in ("distance", "overlap"))
    pulled = scene.parameters.get("gravity") != "none"
    closed = not any(
        entry.parameters.get("surface") if entry.source == "file" else families().get(entry.name).is_open
        for entry in scene.shapes
    )
    walls = boundary_of(scene.container) is not UNKNOWN
    return scene.settle == Settling() and closed and pulled and walls and not apart


def _plain(value: Any) -> Any:
    """Return a value as JSON-able values of one kind: lists, and integers for numbers that are whole."""

    def leaf(one: Any) -> Any:
        if hasattr(one, "tolist"):
            return _plain(one.tolist())
        if isinstance(one, float) and one.is_integer():
            return int(one)
        return one if isinstance(one, str | int | float | None) else str(one)

    return nested(value, leaf)
