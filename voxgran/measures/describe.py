"""`describe`: the form of shapes, or of all grains of a packing, in numbers."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import Floats, check_type
from voxgran._base.calls import explained
from voxgran._base.errors import InputError, PackingWarning, check_known, warn
from voxgran._base.lazy import Dataset
from voxgran.measures.model import dataset, variable
from voxgran.packing.model import Packing
from voxgran.shapes.describing.ratios import DESCRIPTORS, Form
from voxgran.shapes.model import Shape


@explained(hint="describe(packing)")
def describe(what: Packing | Shape | Sequence[Shape], which: str | Sequence[str] | None = None) -> "Dataset":
    """Describe the form of shapes, or of the grains of a packing.

    Parameters
    ----------
    what : Packing or Shape or sequence of Shape
        Shapes, each of which is one row, or a packing, of which each grain is one at its own size.
    which : str or sequence of str, optional
        Names of descriptors, which alone are computed. Default: all.

    Returns
    -------
    xarray.Dataset
        One variable for each descriptor along the dimension ``shape``, or ``grain`` for a packing, with the attributes
        `units`, `long_name`, `formula` and, where there is one, `source`. NaN where a descriptor is not defined:
        flatness in 2D, sphericity, convexity and roundness of open surfaces, and roundness of a mesh that is too coarse
        to have a curvature.

        ================================================  ======================================================
        ``volume``, ``surface_area``                      exact, of the true geometry
        ``equivalent_diameter``                           of the sphere of equal volume
        ``longest_length``, ``intermediate_length``,      edges L, I and S of the smallest box around the shape
        ``shortest_length``
        ``elongation``, ``flatness``                      I / L and S / I (Zingg)
        ``sphericity``                                    area of the sphere of equal volume over the area (Wadell)
        ``convexity``                                     volume over that of the convex hull
        ``roundness``                                     radius of corners over that of the inscribed sphere (Wadell)
        ``krumbein_sphericity``, ``corey_shape_factor``   (I S / L^2)^(1/3) and S / (L I)^(1/2)
        ================================================  ======================================================

    Raises
    ------
    InputError
        If `what` is neither shapes nor a packing, or the shapes have different units of length.
    UnknownNameError
        If there is no descriptor of a name; the message gives the nearest one.

    Warns
    -----
    PackingWarning
        If meshes are too coarse to have a roundness.

    Examples
    --------
    >>> import voxgran as vg
    >>> table = vg.describe([vg.make_shape("box", lengths=(3, 2, 1)), vg.make_shape("sphere")])
    >>> table.elongation.values.round(3).tolist(), table.flatness.values.tolist()
    ([0.667, 1.0], [0.5, 1.0])
    """
    if isinstance(what, Packing):
        shapes, row = list(what.shapes), "grain"
    else:
        check_type(what, (Shape, Iterable), "what", "a packing, a shape or a list of shapes; make_shapes makes one")
        shapes, row = [what] if isinstance(what, Shape | str) else list(what), "shape"
        for shape in shapes:
            check_type(shape, Shape, "what", "a packing, a shape or a list of shapes; make_shapes makes one")
    names = _checked(which)
    unit = what.unit if isinstance(what, Packing) else _unit_of(shapes)
    values = {name: np.full(len(shapes), np.nan) for name in names}
    for k, shape in enumerate(shapes):
        form = Form(shape)
        for name in names:
            values[name][k] = DESCRIPTORS[name].compute(form)
    _tell_coarse(shapes, values)
    dimension = max((shape.dimension for shape in shapes), default=3)
    made = {}
    for name in names:
        entry, found = DESCRIPTORS[name], values[name]
        power = entry.power_in(dimension)
        if isinstance(what, Packing):
            found = found[what.shape_id] * libm.power(what.scale, power)
        units = "1" if unit == "1" or not power else unit if power == 1 else f"{unit}^{power}"
        dims, data, attributes = variable((row,), found, units, entry.long_name)
        told = {"formula": entry.formula} | ({"source": entry.source} if entry.source else {})
        made[name] = (dims, data, attributes | told)
    labels = np.array([shape.name for shape in shapes], dtype=str)
    if isinstance(what, Packing):
        labels = labels[what.shape_id]
    return dataset(made, {"name": ((row,), labels)})


def _tell_coarse(shapes: Sequence[Shape], values: Mapping[str, Floats]) -> None:
    """Warn of closed shapes without a roundness."""
    missing = np.isnan(values.get("roundness", np.zeros(0)))
    coarse = [shape for shape, lacks in zip(shapes, missing, strict=False) if lacks and not shape.is_open]
    if coarse:
        more = f" and {len(coarse) - 1} more shapes" if len(coarse) > 1 else ""
        warn(
            f"roundness of {coarse[0].name!r}{more} is NaN: too coarse a mesh to tell sharp edges from a curved "
            "surface; give a finer one",
            PackingWarning,
        )


def _checked(which: str | Sequence[str] | None) -> list[str]:
    """Return the names of the descriptors that are asked for."""
    if which is None:
        return list(DESCRIPTORS)
    check_type(which, Iterable, "which", "a name or a list of names, such as ['sphericity']")
    names = [which] if isinstance(which, str) else list(which)
    for name in names:
        check_type(name, str, "which", "a name or a list of names, such as ['sphericity']")
        check_known("descriptor", name, DESCRIPTORS)
    return names


def _unit_of(shapes: Sequence[Shape]) -> str:
    """Return the unit of lengths of shapes, "1" where none is known."""
    units = sorted({shape.unit for shape in shapes if shape.unit})
    if len(units) > 1:
        raise InputError(f"the shapes have the units {', '.join(units)}: they must have one; convert them with to_unit")
    return units[0] if units else "1"
