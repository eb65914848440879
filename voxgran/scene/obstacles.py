"""The [[obstacle]] entries of a scene: shapes in their places, and packings of which all grains are fixed."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from voxgran._base.arrays import as_floats, as_positive, check_type
from voxgran._base.errors import InputError, VoxgranError, shown
from voxgran._base.files import existing_file
from voxgran.containers.model import Container
from voxgran.geometry.rotation import normalized
from voxgran.io.files import load
from voxgran.packing.model import Packing
from voxgran.scene.entries import ShapeEntry, shape_entries
from voxgran.scene.keys import Standing, names_of

#: keys that say where a shape stands
PLACE = tuple(name for name in names_of(Standing) if name != "packing")


@dataclass(frozen=True, slots=True)
class ObstacleEntry:
    """One [[obstacle]]: a shape with its place, or the file of a packing."""

    shape: ShapeEntry | None = None
    packing: str | None = None
    position: tuple[float, ...] = ()
    orientation: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0)
    scale: float = 1.0

    def make(self, container: Container, unit: str | None) -> Packing:
        """Return the obstacles as grains in a container.

        Raises
        ------
        InputError
            If the entry stands for several shapes.
        """
        if self.packing is not None:
            bare = {"container": container, "gravity": None, "lid": None, "forces": None, "fixed": None}
            return replace(load(self.packing), **bare)  # type: ignore[arg-type]
        assert self.shape is not None
        shapes = self.shape.make()
        if len(shapes) > 1:
            raise InputError(f"[[obstacle]] is {len(shapes)} shapes: one stands at a position; leave count out")
        place = np.zeros((1, 3))
        place[0, : len(self.position)] = self.position
        turn = normalized(np.array([self.orientation]))
        return Packing.of(
            shapes[0], container, position=place, orientation=turn, scale=[self.scale], unit=unit, gravity=None
        )

    def to_mapping(self) -> dict[str, Any]:
        """Return the entry as nested JSON-able values, as the scene file has it."""
        if self.shape is None:
            return {"packing": self.packing}
        found = {key: value for key, value in self.shape.to_mapping().items() if key != "share"}
        place = {"position": self.position, "orientation": self.orientation}
        return found | {key: list(value) for key, value in place.items()} | {"scale": self.scale}


def obstacle_entries(entries: Any, folder: Path, dimension: int) -> tuple[ObstacleEntry, ...]:
    """Return the checked [[obstacle]] entries of a scene; files are relative to the folder.

    Raises
    ------
    UnknownNameError
        If a key or a family is unknown; the message gives the nearest name.
    InputError
        If a value breaks a rule.
    """
    if not isinstance(entries, list | tuple) or entries == []:
        raise InputError(f"[obstacle] is {shown(entries)}: write [[obstacle]], once per obstacle")
    made = []
    for entry in entries:
        check_type(entry, Mapping, "[[obstacle]]", "a section; write [[obstacle]] above its keys")
        rest = dict(entry)
        if "packing" in rest:
            if len(rest) > 1:
                raise InputError(
                    f"[[obstacle]] has the keys {shown(sorted(rest))}: packing stands alone; leave others out"
                )
            try:
                made.append(ObstacleEntry(packing=str(existing_file(folder / str(rest["packing"])))))
            except VoxgranError as error:
                error.args = (f"[[obstacle]] packing {error}",)
                raise
            continue
        if "position" not in rest:
            raise InputError("[[obstacle]] has no position: give the centroid, such as position = [4, 4, 2]")
        place = {key: rest.pop(key) for key in PLACE if key in rest}
        sizes = {"position": dimension, "orientation": 4}
        found: dict[str, Any] = {
            key: tuple(as_floats(place[key], f"[[obstacle]] {key}", shape=(size,)).tolist())
            for key, size in sizes.items()
            if key in place
        }
        if "orientation" in found and not any(found["orientation"]):
            raise InputError("[[obstacle]] orientation is 0: it must be a quaternion (w, x, y, z) of length above 0")
        scale = as_positive(place.get("scale", 1.0), "[[obstacle]] scale")
        try:
            shape = shape_entries([rest], folder)[0]
        except VoxgranError as error:
            error.args = (str(error).replace("[[shape]]", "[[obstacle]]"),)
            raise
        made.append(ObstacleEntry(shape, **found, scale=scale))
    return tuple(made)


def standing_of(entries: tuple[ObstacleEntry, ...], container: Container, unit: str | None) -> Packing | None:
    """Return all obstacles as one packing in a container; None without any.

    Raises
    ------
    InputError
        If a file is of another unit than the others, or an entry stands for several shapes.
    """
    parts = [entry.make(container, unit) for entry in entries]
    if not parts:
        return None
    found = parts[0]
    for part in parts[1:]:
        found = found + part
    return found
