"""Arrays of zarr; images of OME-Zarr (NGFF 0.4 in zarr 2, 0.5 in zarr 3), with their axes, edges, unit and scales."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from voxgran._base.errors import FileFormatError, shown
from voxgran._base.guarded import refused
from voxgran._base.units import known_unit
from voxgran._base.vtk_readers import chosen_name
from voxgran.lattice.image import Image, lazily

#: names of units in OME-Zarr that are other than those of voxgran
UNITS = {"meter": "m", "centimeter": "cm", "millimeter": "mm", "micrometer": "um", "nanometer": "nm", "picometer": "pm"}


@dataclass(frozen=True, slots=True)
class Parts:
    """An array of zarr, of which a part that is damaged is told with the folder."""

    path: Path
    array: Any
    dtype: Any
    shape: tuple[int, ...]
    chunks: tuple[int, ...]
    ndim: int

    def __getitem__(self, key: Any) -> NDArray[Any]:
        with refused(self.path):
            return np.asarray(self.array[key])


def parts_of(array: Any, path: Path) -> Any:
    """Return an array of zarr as it is read from a folder."""
    return Parts(path, array, array.dtype, array.shape, array.chunks, array.ndim)


def ome_image(group: Any, key: str | None, path: Path) -> Image | None:
    """Return the image of a group of OME-Zarr, as a dask array with axes x, y, z; None if the group is none.

    `key` is the path of one of its scales; default: the first, which is the finest.

    Raises
    ------
    FileFormatError
        If there is no such scale, axes x, y and z are not there once each, or another axis has more than one entry.
    """
    told = dict(group.attrs)
    scales = told.get("multiscales") or told.get("ome", {}).get("multiscales")
    if not scales:
        return None
    levels = {level["path"]: level for level in scales[0]["datasets"]}
    level = levels[chosen_name(list(levels) if key is not None else [next(iter(levels))], key, path)]
    array = group[level["path"]]
    axes = [axis if isinstance(axis, dict) else {"name": axis} for axis in scales[0]["axes"]]
    names = [axis["name"] for axis in axes]
    others = [(name, n) for name, n in zip(names, array.shape, strict=True) if name not in ("x", "y", "z") and n > 1]
    if sorted(set(names) & {"x", "y", "z"}) != ["x", "y", "z"] or len(set(names)) < len(names) or others:
        listed = ", ".join(f"{n} along {name}" for name, n in zip(names, array.shape, strict=True))
        raise FileFormatError(
            f"{path} has {listed}: one image along x, y and z is needed; write one channel and one time as an array"
        )
    values = lazily(parts_of(array, path), str(path))[
        tuple(slice(None) if name in ("x", "y", "z") else 0 for name in names)
    ]
    left = [name for name in names if name in ("x", "y", "z")]
    edges, centers = dict.fromkeys(names, 1.0), dict.fromkeys(names, 0.0)
    steps = [*level.get("coordinateTransformations", ()), *scales[0].get("coordinateTransformations", ())]
    for step in steps:
        for k, name in enumerate(names):
            if step["type"] == "scale":
                edges[name], centers[name] = edges[name] * step["scale"][k], centers[name] * step["scale"][k]
            elif step["type"] == "translation":
                centers[name] += step["translation"][k]
    units = {str(axis.get("unit", "")) for axis in axes if axis["name"] in left}
    if len(units) > 1:
        raise FileFormatError(
            f"{path} has axes in {', '.join(map(shown, sorted(units)))}: one unit is needed; write it in one"
        )
    unit = units.pop()
    x, y, z = ((edges[name], centers[name] - edges[name] / 2) for name in "xyz")
    size = (x[0], y[0], z[0]) if any(step["type"] == "scale" for step in steps) else None
    order = [left.index(name) for name in "xyz"]
    return Image(values.transpose(order), size, (x[1], y[1], z[1]), known_unit(UNITS.get(unit, unit)))
