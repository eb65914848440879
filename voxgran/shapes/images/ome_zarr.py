"""Images of OME-Zarr (NGFF 0.4 in zarr 2, 0.5 in zarr 3), with their axes, edges, unit and scales."""

from pathlib import Path
from typing import Any

from voxgran._base.errors import FileFormatError, shown
from voxgran._base.units import known_unit
from voxgran.lattice.image import Image, lazily
from voxgran.shapes.images.foreign import scales_of

#: names of units in OME-Zarr that are other than those of voxgran
UNITS = {"meter": "m", "centimeter": "cm", "millimeter": "mm", "micrometer": "um", "nanometer": "nm", "picometer": "pm"}


def ome_image(told: dict[str, Any], name: str, values: Any, path: Path) -> Image:
    """Return a scale of a group of OME-Zarr with these attributes, as a dask array with axes x, y, z.

    Raises
    ------
    FileFormatError
        If axes x, y and z are not there once each, or another axis has more than one entry.
    """
    scales = scales_of(told)
    level = next(level for level in scales[0]["datasets"] if level["path"] == name)
    axes = [axis if isinstance(axis, dict) else {"name": axis} for axis in scales[0]["axes"]]
    names = [axis["name"] for axis in axes]
    others = [(name, n) for name, n in zip(names, values.shape, strict=True) if name not in ("x", "y", "z") and n > 1]
    if sorted(set(names) & {"x", "y", "z"}) != ["x", "y", "z"] or len(set(names)) < len(names) or others:
        listed = ", ".join(f"{n} along {name}" for name, n in zip(names, values.shape, strict=True))
        raise FileFormatError(
            f"{path} has {listed}: one image along x, y and z is needed; write one channel and one time as an array"
        )
    lazy = lazily(values, str(path))[tuple(slice(None) if name in ("x", "y", "z") else 0 for name in names)]
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
    return Image(lazy.transpose(order), size, (x[1], y[1], z[1]), known_unit(UNITS.get(unit, unit)))
