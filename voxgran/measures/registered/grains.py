"""Positions, orientations and sizes, one row per grain."""

import numpy as np

from voxgran._base.arrays import Floats
from voxgran.measures.model import Groups, Measure, dataset, length_unit, variable
from voxgran.packing.model import Packing
from voxgran.shapes.describing.extents import principal_extents


def intermediate_axes(packing: Packing) -> Floats:
    """Return the intermediate axis (n,) of each grain, by which it passes a sieve, in the unit of lengths."""
    middle = np.array([principal_extents(shape)[1] for shape in packing.shapes])
    return middle[packing.shape_id] * packing.scale if packing.count else np.zeros(0)


def _compute(packing: Packing) -> Groups:
    """Return one row per grain."""
    unit, size = length_unit(packing), length_unit(packing, power=packing.dimension)
    row = ("grain",)
    values = {
        axis: variable(row, packing.position[:, k], unit, f"{axis} of the centroid") for k, axis in enumerate("xyz")
    }
    kind = "volume" if packing.dimension == 3 else "area"
    values |= {
        "diameter": variable(row, packing.diameters, unit, "equivalent diameter"),
        "intermediate_axis": variable(row, intermediate_axes(packing), unit, "extent along the intermediate axis"),
        "volume": variable(row, packing.volumes, size, f"true {kind}"),
        "shape_id": variable(row, packing.shape_id, "1", "index of the shape"),
        "scale": variable(row, packing.scale, "1", "factor on the lengths of the shape"),
        "orientation": variable(
            (*row, "component"), packing.orientation, "1", "unit quaternion (w, x, y, z) from body to container"
        ),
    }
    if packing.grain_id is not None:
        values["grain_id"] = variable(row, packing.grain_id, "1", "row of the grain in its list, -1 for one of no list")
    return {"/grains": dataset(values)}


registration = Measure(
    summary="position, size and orientation of each grain", groups=("/grains",), compute=_compute, tilted=True
)
