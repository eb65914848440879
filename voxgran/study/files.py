"""Files that a scene names: as absolute paths, and as hashes of their bytes, so that results know what they are of.

In the canonical form of a scene, values that are written differently and mean the same are equal. Values that equal
their defaults are left out, whole numbers are integers, and sections that change no result of a study are dropped.
"""

import hashlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from voxgran import __version__
from voxgran._base.config import from_mapping, parameters_of, to_mapping
from voxgran._base.errors import InputError
from voxgran._base.files import existing_file
from voxgran._base.scalars import nested
from voxgran.clumps.method import clump_registry
from voxgran.containers.model import UNKNOWN, boundary_of
from voxgran.packing.method import method_registry
from voxgran.scene.description import SceneDescription
from voxgran.scene.keys import AnyShape, ClumpOfShape, ShapeOfFamily, ShapeOfFile, Twinned
from voxgran.settling.parameters import Settling, with_friction
from voxgran.shapes.family import families
from voxgran.shapes.roughness.parameters import Roughness


def with_absolute_files(scene: Mapping[str, Any], folder: str | Path) -> dict[str, Any]:
    """Return the mapping of a scene with absolute paths of the files that it names relative to a folder."""
    place = Path(folder).absolute()
    return with_files(scene, lambda name: str(place / name))


def with_files(scene: Mapping[str, Any], made: Callable[[str], str]) -> dict[str, Any]:
    """Return the mapping of a scene with a function applied to the files that it names: those of shapes, those that
    shapes are like, of obstacles, that of the container, of the sieve curve, of the list of grains, of the start, and
    of the sample of a twin with its model.
    """
    found = dict(scene)
    for name in ("shape", "obstacle"):
        if isinstance(found.get(name), list):
            keys = ("file", "like", "model", "packing")
            found[name] = [_with(entry, made, *keys) if isinstance(entry, Mapping) else entry for entry in found[name]]
    if isinstance(found.get("layer"), list):
        found["layer"] = [with_files(entry, made) if isinstance(entry, Mapping) else entry for entry in found["layer"]]
    for section in ("container", "sizes", "grains", "packing", "twin"):
        if isinstance(found.get(section), Mapping):
            its = {"packing": ("start",), "twin": ("sample", "model")}.get(section, ("file",))
            found[section] = _with(found[section], made, *its)
    return found


def _with(table: Mapping[str, Any], made: Callable[[str], str], *keys: str) -> dict[str, Any]:
    """Return a table with a function applied to the paths under some keys; a family that another is like is none."""
    return {
        key: made(value) if key in keys and isinstance(value, str) and (key != "like" or Path(value).suffix) else value
        for key, value in table.items()
    }


class FileHashes:
    """Hashes of the bytes of files, each read once."""

    def __init__(self) -> None:
        self._known: dict[str, str] = {}

    def of(self, path: str) -> str:
        """Return the SHA-256 of a file.

        Raises
        ------
        MissingFileError
            If there is no such file.
        OutputError
            If it cannot be read.
        """
        if path not in self._known:
            with existing_file(path).open("rb") as file:
                self._known[path] = hashlib.file_digest(file, "sha256").hexdigest()
        return self._known[path]


def files_of(scene: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the files that the mapping of a scene names."""
    found: list[str] = []

    def note(name: str) -> str:
        found.append(name)
        return name

    with_files(scene, note)
    return tuple(dict.fromkeys(found))


def refuse_changed(files: Mapping[str, str]) -> None:
    """Refuse files that are no longer those of some hashes: results of them would be kept under a wrong name.

    Raises
    ------
    InputError
        If one has changed.
    MissingFileError
        If one is gone.
    OutputError
        If one cannot be read.
    """
    for name, known in files.items():
        if FileHashes().of(name) != known:
            raise InputError(
                f"{name} has changed since the study began: results are kept by the content of files; run the study "
                "once more, with --retry where the file is as it was"
            )


def scene_hash(scene: SceneDescription, hashes: FileHashes) -> str:
    """Return the hash of all that the results of a scene depend on but its seed: its values in their canonical form,
    the bytes of the files that it names, and the version of voxgran.
    """
    return _hash(canonical_scene(scene), hashes)


def numbers_hash(scene: SceneDescription, hashes: FileHashes) -> str:
    """Return the hash of all that the numbers of a scene depend on but its seed; scenes whose packings differ in their
    density alone have the same.
    """
    return _hash(canonical_numbers(scene), hashes)


def _hash(mapping: Mapping[str, Any], hashes: FileHashes) -> str:
    """Return the hash of a scene as nested values, with those of its files."""
    text = json.dumps([__version__, with_files(mapping, hashes.of)], sort_keys=True, default=_as_text)
    return hashlib.sha256(text.encode()).hexdigest()


def run_hash(cell: str, seed: int) -> str:
    """Return the name of the results of a cell with a seed."""
    return hashlib.sha256(f"{cell} {seed}".encode()).hexdigest()[:32]


def _as_text(value: Any) -> Any:
    """Return NumPy values as JSON-able values, and others as text."""
    return value.tolist() if hasattr(value, "tolist") else str(value)


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
    is_usual = scene.settle and with_friction(scene.settle) == with_friction(Settling())
    return bool(is_usual) and closed and pulled and walls and not apart


def _plain(value: Any) -> Any:
    """Return a value as JSON-able values of one kind: lists, and integers for numbers that are whole."""

    def leaf(one: Any) -> Any:
        if hasattr(one, "tolist"):
            return _plain(one.tolist())
        if isinstance(one, float) and one.is_integer():
            return int(one)
        return one if isinstance(one, str | int | float | None) else str(one)

    return nested(value, leaf)
