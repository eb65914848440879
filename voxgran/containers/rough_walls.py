"""Containers with rough walls: their boundary displaced inward and outward by a random field."""

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np

from voxgran._base.calls import explained
from voxgran._base.config import from_mapping
from voxgran._base.errors import InputError
from voxgran._base.seeds import stream
from voxgran.containers.kinds.mesh import ClosedMesh
from voxgran.containers.kinds.polygon import Polygon
from voxgran.containers.model import Container, boundary_of, check_container
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.roughness.parameters import Method, Roughness
from voxgran.shapes.roughness.roughen import roughened


@explained(hint="rough_walls(container, rms=0.05)")
def rough_walls(
    container: Container,
    *,
    method: Method = "spectral",
    rms: float | None = None,
    correlation_length: float | Sequence[float] | None = None,
    shortest: float | None = None,
    hurst: float | None = None,
    autocorrelation: Literal["exponential", "gaussian", "linear"] | None = None,
    skewness: float = 0.0,
    kurtosis: float = 3.0,
    seed: int = 0,
) -> ClosedMesh | Polygon:
    """Give a container rough walls.

    The walls are those of :func:`voxgran.roughen`, with the same parameters: displaced along their normals, with the
    mean 0, so that the volume is nearly that of the container.

    Parameters
    ----------
    container : Container
        Box, cylinder, sphere or closed mesh; rectangle, disk or polygon without holes. No axis may be periodic.
    method, rms, correlation_length, shortest, hurst, autocorrelation, skewness, kurtosis, seed
        As for :func:`voxgran.roughen`. Diameters in the defaults are those of the sphere (in 2D the disk) whose volume
        is that of the container: 0.02 of it for heights, 0.25 for the correlation length.

    Returns
    -------
    ClosedMesh or Polygon
        In 2D a polygon. The record of the shape of a mesh has what is measured on its walls.

    Raises
    ------
    InputError
        If the container is none or has a periodic axis or holes, a parameter is out of range, or the walls would meet
        each other; the message then gives the largest height.
    TooLargeError
        If the shortest wavelength needs too many faces or too large a field.

    Examples
    --------
    >>> import voxgran as vg
    >>> basin = vg.rough_walls(vg.Cylinder(radius=2, height=4), rms=0.05, correlation_length=0.5, seed=1)
    >>> 0.98 < basin.volume / vg.Cylinder(radius=2, height=4).volume < 1.02
    True
    """
    given = {key: value for key, value in locals().items() if key not in ("container", "seed")}
    roughness = from_mapping(Roughness, given, "rough_walls")
    check_container(container)
    if any(container.periodic):
        axes = ", ".join(axis for axis, wraps in zip("xyz", container.periodic, strict=True) if wraps)
        raise InputError(
            f"container is periodic along {axes}: rough walls close it on all sides; give one without periodic axes"
        )
    made = roughened(_smooth(container), roughness, stream(seed, "rough walls"))
    if isinstance(made.geometry, Outline):
        return Polygon(made.geometry.vertices + np.array(made.offset[:2]))
    return ClosedMesh(made)


def _smooth(container: Container) -> Shape:
    """Return the interior of a container as a shape, whose offset places it."""
    if container.dimension == 3:
        vertices, faces = container.mesh()
        return Shape.from_mesh(vertices, faces, name="container")
    boundary: Any = boundary_of(container)
    if circle := boundary.cylinder:
        return Shape.of(Outline("disk", circle.radius, center=circle.center[:2]), name="container")
    low, high = container.bounds[:, :2]
    loops = boundary.loops or (np.array([low, (high[0], low[1]), high, (low[0], high[1])]),)
    if len(loops) > 1:
        raise InputError(
            f"container has {len(loops) - 1} holes: rough walls in the plane are one loop; give a polygon without holes"
        )
    return Shape.of(Outline("polygon", vertices=loops[0]), name="container")
