"""Densities of the material of grains: one for all shapes of an assembly, or one for each."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arrays import Floats, Integers, as_positive
from voxgran._base.errors import InputError, shown
from voxgran.shapes.model import Shape

#: that of all shapes, or one for each shape
Density: TypeAlias = float | tuple[float, ...]
#: density of grains whose density is not stated
NOT_STATED = 1.0


def as_density(value: Any, shapes: int, name: str = "density") -> Density:
    """Return a density, or one for each of so many shapes; a single number where they are all equal.

    Raises
    ------
    InputError
        If there are more or fewer values than shapes, or one is no finite number above 0.
    """
    if type(value) is float and 0.0 < value < math.inf:
        return value
    if isinstance(value, str | bytes | Mapping) or not isinstance(value, Iterable) or getattr(value, "ndim", 1) == 0:
        return as_positive(value, name)
    given = list(value)
    if len(given) != shapes:
        raise InputError(
            f"{name} is {shown(value)}: it must be one number, or {shapes}, one for each shape; give as many as shapes"
        )
    return merged([as_positive(one, f"{name} of shape {number}") for number, one in enumerate(given)])


def merged(densities: Sequence[float]) -> Density:
    """Return the densities of shapes, as one number where they are all equal."""
    return tuple(densities) if len(set(densities)) != 1 else densities[0]


def by_shape(density: Density, shapes: int) -> tuple[float, ...]:
    """Return the density of each of so many shapes."""
    return density if isinstance(density, tuple) else (density,) * shapes


def density_text(density: Density, form: str = "g") -> str:
    """Return a density in words: one number, or the different ones in the order of the shapes."""
    return ", ".join(format(one, form) for one in dict.fromkeys(by_shape(density, 1)))


def shapes_by_density(
    shapes: Sequence[Shape], shape_id: Integers, densities: ArrayLike
) -> tuple[tuple[Shape, ...], Integers, Density]:
    """Return shapes, the shape of each grain and the densities of the shapes, of grains with densities of their own.

    A shape of which grains have several densities is there once for each.

    Parameters
    ----------
    shapes : sequence of Shape
        The shapes.
    shape_id : (n,) ndarray of int
        Which shape each grain has.
    densities : (n,) array_like of float
        Density of each grain.
    """
    values: Floats = np.asarray(densities, dtype=np.float64)
    if len(np.unique(values)) <= 1:
        return tuple(shapes), shape_id, float(values[0]) if len(values) else NOT_STATED
    pairs, place = np.unique(np.column_stack([shape_id, values]), axis=0, return_inverse=True)
    chosen = tuple(shapes[int(number)] for number, _ in pairs)
    return chosen, place.reshape(-1).astype(np.int64), merged(pairs[:, 1].tolist())
