"""Files that a scene names: as absolute paths, and as hashes of their bytes, so that results know what they are of."""

import hashlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from voxgran import __version__
from voxgran._base.errors import InputError
from voxgran._base.files import existing_file
from voxgran.scene.description import SceneDescription
from voxgran.study.canonical import SEEDS, canonical_numbers, canonical_scene


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


def former_scene_hash(scene: SceneDescription, hashes: FileHashes) -> str:
    """Return the hash that results had before scenes were put in their canonical form, under which those of older
    studies are found.
    """
    mapping = {key: value for key, value in scene.to_mapping().items() if key != "output"}
    mapping["scene"] = {key: value for key, value in mapping["scene"].items() if key not in SEEDS}
    return _hash(mapping, hashes)


def _hash(mapping: Mapping[str, Any], hashes: FileHashes) -> str:
    """Return the hash of a scene as nested values, with those of its files."""
    text = json.dumps([__version__, with_files(mapping, hashes.of)], sort_keys=True, default=_plain)
    return hashlib.sha256(text.encode()).hexdigest()


def run_hash(cell: str, seed: int) -> str:
    """Return the name of the results of a cell with a seed."""
    return hashlib.sha256(f"{cell} {seed}".encode()).hexdigest()[:32]


def _plain(value: Any) -> Any:
    """Return NumPy values as JSON-able values, and others as text."""
    return value.tolist() if hasattr(value, "tolist") else str(value)
