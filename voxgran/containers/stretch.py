"""Containers that are stretched along the axes: which axes stretch together, and what becomes of the container."""

from collections.abc import Sequence

from voxgran._base.errors import InputError
from voxgran.containers.make import make_container
from voxgran.containers.model import Container, boundary_of

#: parameters of containers that lengths along axes decide, by the axes
ALONG = {"lengths": (0, 1, 2), "origin": (0, 1, 2), "tilt": (0, 0, 1), "radius": (0,), "height": (2,)}


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
        f"container is a {container.kind}: its walls do not move; compress grains in a box, a rectangle, an upright "
        "cylinder, a disk or a sphere"
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
