"""Clumps in place of shapes: one for each shape that is not made of spheres already."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from voxgran._base.arrays import check_type
from voxgran._base.errors import InputError, shown
from voxgran.clumps.fit import fit_clump
from voxgran.clumps.model import Clump
from voxgran.shapes.model import Shape
from voxgran.shapes.spheres import Spheres

#: relative difference of volume and inertia up to which a clump is that of a shape
ALIKE = 1e-6


def as_clumps(
    shapes: Sequence[Shape], clumps: Clump | Sequence[Clump | None] | None, fitting: dict[str, Any]
) -> tuple[tuple[Shape, ...], list[dict[str, Any] | None]]:
    """Return the shapes as clumps, those given or else fitted, and what provenance says of each; spheres, disks and
    clumps stay, with None.

    `fitting` are keywords of :func:`fit_clump`.

    Raises
    ------
    InputError
        If there are not as many clumps as shapes, one is no clump or that of another shape, a shape cannot be fitted,
        or parameters are given beside clumps.
    """
    changed = [not (isinstance(shape.geometry, Spheres) or shape.is_sphere) for shape in shapes]
    if clumps is None:
        given = [fit_clump(shape, **fitting) if other else None for shape, other in zip(shapes, changed, strict=True)]
    elif fitting:
        raise InputError(f"{', '.join(fitting)} is given beside clumps, which are fitted already: leave it out")
    else:
        given = _one_each(clumps, changed)
        for number, (clump, shape) in enumerate(zip(given, shapes, strict=True)):
            if clump is not None:
                _refuse_other(_in_unit(clump.shape, shape.unit), shape, number)
    made = (
        shape if one is None else replace(_in_unit(one.to_shape(), shape.unit), unit=shape.unit)
        for shape, one in zip(shapes, given, strict=True)
    )
    return tuple(made), [None if one is None else record_of(one) for one in given]


def _one_each(clumps: Any, changed: list[bool]) -> list[Clump | None]:
    """Return one clump or None for each shape."""
    wanted = "a Clump, or a list of one for each shape with None for shapes that stay; fit_clump makes one"
    count, few = sum(changed), isinstance(clumps, Clump)
    if few and count > 1:
        raise InputError(f"clumps is a single Clump for {count} shapes: give a list of one for each shape")
    if few:
        return [clumps if other else None for other in changed]
    if isinstance(clumps, int | np.integer):
        given = shown(clumps)
        raise InputError(f"clumps is {given}: it must be {wanted}; a number of spheres is max_spheres={given}")
    check_type(clumps, Sequence, "clumps", wanted)
    if len(clumps) != len(changed):
        raise InputError(f"clumps has {len(clumps)} entries for {len(changed)} shapes: it must be {wanted}")
    for clump in clumps:
        check_type(clump, (Clump, type(None)), "an entry of clumps", wanted)
    return [clump if other else None for clump, other in zip(clumps, changed, strict=True)]


def _in_unit(shape: Shape, unit: str | None) -> Shape:
    """Return a shape in a unit, where both are known; else as it is."""
    return shape if None in (shape.unit, unit) else shape.to_unit(str(unit))


def _refuse_other(solid: Shape, shape: Shape, number: int) -> None:
    """Refuse a clump whose solid is another shape.

    Raises
    ------
    InputError
        If volumes or inertia tensors differ.
    """
    if solid == shape:
        return
    shape.refuse_open("clumps of spheres")
    size = float(np.abs(shape.inertia).max())
    apart = abs(solid.volume / shape.volume - 1), float(np.abs(solid.inertia - shape.inertia).max()) / size
    if max(apart) > ALIKE:
        raise InputError(
            f"clump {number} is that of {solid.name!r} with a volume of {solid.volume:.6g}, shape {number} "
            f"is {shape.name!r} with {shape.volume:.6g}: volume and inertia must agree; fit it to that shape"
        )


def record_of(clump: Clump) -> dict[str, Any]:
    """Return what provenance says of a clump."""
    made = {"shape": clump.shape.name, "spheres": clump.count, "method": clump.method}
    return {**made, "errors": clump.errors.to_mapping()} | ({"reason": clump.reason} if clump.reason else {})
