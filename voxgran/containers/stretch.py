"""Containers that are stretched or repeated along the axes, and which axes stretch together."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers, as_count
from voxgran._base.errors import InputError, shown
from voxgran._base.scalars import whole_number_of
from voxgran.containers.model import Container, boundary_of, make_container

#: parameters of containers that lengths along axes decide, by the axes
ALONG = {"lengths": (0, 1, 2), "origin": (0, 1, 2), "tilt": (0, 0, 1), "radius": (0,), "height": (2,)}
#: largest number of copies of a container
MOST_COPIES = 1_000_000


def stretched_together(container: Container) -> tuple[tuple[int, ...], ...]:
    """Return the groups of axes that a container stretches along by one factor each.

    Raises
    ------
    InputError
        If the container has other walls than planes, periodic sides, and one upright cylinder, circle or sphere.
    """
    boundary, axes = boundary_of(container), tuple(range(container.dimension))
    known = set(container.to_mapping()) <= {"kind", "periodic", *ALONG}
    if known and boundary.is_flat:
        return tuple((axis,) for axis in axes)
    if known and boundary.sphere is not None:
        return (axes,)
    if known and boundary.cylinder is not None:
        return ((0, 1), (2,)) if container.dimension == 3 else ((0, 1),)
    raise InputError(
        f"container is of kind {container.kind!r}: its walls do not move; compress grains in a box, a rectangle, an "
        "upright cylinder, a disk or a sphere"
    )


def stretched(container: Container, factors: Sequence[float]) -> Container:
    """Return a container whose coordinates along the axes are multiplied by factors (3,).

    Axes that stretch together have one factor.
    """
    mapping = container.to_mapping()
    for name in ALONG.keys() & mapping.keys():
        value, along = mapping[name], ALONG[name]
        if isinstance(value, list):
            mapping[name] = [one * factors[axis] for one, axis in zip(value, along, strict=False)]
        else:
            mapping[name] = value * factors[along[0]]
    return make_container(mapping)


def deformed(container: Container, gradient: Floats) -> Container:
    """Return a container whose coordinates are multiplied by an upper triangular matrix (3, 3).

    Only boxes and rectangles that are periodic along both axes of a number beside the diagonal have one that is not 0.
    """
    if not np.triu(gradient, 1).any():
        return stretched(container, gradient.diagonal().tolist())
    mapping, d = container.to_mapping(), container.dimension
    turned = gradient[:d, :d].T
    vectors = linear.matmul(np.asarray(container.vectors), turned)  # type: ignore[attr-defined]
    mapping |= {"lengths": vectors.diagonal().tolist(), "tilt": vectors[np.tril_indices(d, -1)].tolist()}
    return make_container(mapping | {"origin": linear.matmul(np.array(mapping["origin"]), turned).tolist()})


def repeated(container: Container, repeats: Any) -> tuple[Container, Integers]:
    """Return a periodic container that holds so many copies of another along its axes, and their cells (k, 3).

    Raises
    ------
    InputError
        If `repeats` are no whole numbers of at least 1, there are more or fewer of them than axes, one is above 1 along
        an axis that is not periodic, there are more than a million copies, or the container is of a class that is not
        known.
    """
    d, periodic, one = container.dimension, container.periodic, whole_number_of(repeats)
    listed = isinstance(repeats, Sequence | np.ndarray) and not isinstance(repeats, str)
    if one is None and not (listed and len(repeats) == d):
        raise InputError(
            f"repeats is {shown(repeats)}: it must be {d} whole numbers, one for each axis, or one number for all "
            f"periodic axes; give {tuple(2 if wraps else 1 for wraps in periodic[:d])}"
        )
    given = repeats if one is None else [one if wraps or not any(periodic) else 1 for wraps in periodic[:d]]
    many = [as_count(times, "repeats", at_least=1) for times in given]
    as_count(math.prod(many), "number of copies", at_most=MOST_COPIES)
    for axis, times in enumerate(many):
        if times > 1 and not periodic[axis]:
            raise InputError(
                f"repeats is {shown(repeats)}: the {container.kind} is not periodic along {'xyz'[axis]}, where copies "
                "would meet at its walls; give 1 there"
            )
    mapping = container.to_mapping()
    if max(many) > 1 and not ("lengths" in mapping and set(mapping) <= {"kind", "periodic", *ALONG}):
        raise InputError(f"container is a {container.kind}: boxes and rectangles are repeated; pack in one of them")
    if "lengths" in mapping:
        mapping["lengths"] = [length * times for length, times in zip(mapping["lengths"], many, strict=True)]
    if "tilt" in mapping:
        # of the second edge along x, and of the third along x and y
        mapping["tilt"] = [tilt * many[axis] for tilt, axis in zip(mapping["tilt"], (1, 2, 2), strict=False)]
    cells = np.indices((*many, 1)[:3]).reshape(3, -1).T
    return make_container(mapping) if max(many) > 1 else container, cells
