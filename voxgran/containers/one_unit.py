"""Conversion of shapes and containers to one unit of length.

Shapes without a unit, such as the regular ones, are taken to be in that unit.
"""

from collections.abc import Sequence
from dataclasses import replace

from voxgran._base.units import common_unit, unit_factor
from voxgran.containers.kinds.mesh import ClosedMesh
from voxgran.containers.model import Container
from voxgran.shapes.model import Shape


def shape_of(container: Container) -> Shape | None:
    """Return the shape whose surface a closed mesh is; None for other containers."""
    return container.shape if isinstance(container, ClosedMesh) else None


def in_one_unit(
    shapes: Sequence[Shape], container: Container, unit: str | None
) -> tuple[tuple[Shape, ...], Container, str]:
    """Return shapes and container with all lengths in one unit, and that unit.

    It is the requested one or, if that is None or ``"1"``, the only one that is known; several known ones and unknown
    names are refused. Of the containers only a closed mesh has a unit of its own.
    """
    solid = shape_of(container)
    units = [shape.unit for shape in shapes] + ([] if solid is None else [solid.unit])
    chosen = common_unit(unit, units, "shapes" if solid is None else "shapes and container")
    if solid is not None and solid.unit not in (None, chosen):
        container = ClosedMesh(solid.to_unit(chosen))
    return tuple(s if s.unit in (None, chosen) else s.to_unit(chosen) for s in shapes), container, chosen


def converted(
    shapes: Sequence[Shape], container: Container, source: str, target: str
) -> tuple[tuple[Shape, ...], Container]:
    """Return shapes and container of a packing with their lengths converted from one unit to another."""
    factor = unit_factor(source, target)
    solids = tuple(replace(shape, unit=source).to_unit(target) for shape in shapes)
    solid = shape_of(container)
    if solid is not None:
        return solids, ClosedMesh(replace(solid, unit=source).to_unit(target))
    return solids, container.scaled(factor)
