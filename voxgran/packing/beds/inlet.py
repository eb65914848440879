"""An inlet, below which grains begin to fall: a disk or a rectangle across gravity."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base import ExplainedAttributes
from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran._base.calls import explained_methods
from voxgran._base.config import check_bounds, parameter
from voxgran._base.errors import InputError
from voxgran._base.seeds import stream
from voxgran.containers.model import Container, periods_of, refuse_tilt
from voxgran.geometry.periods import nearest_turns
from voxgran.packing.beds.seeds import SAMPLES, container_levels
from voxgran.packing.problem import Problem

#: radius of an inlet whose radius is left out, in median diameters
RADIUS = 2.0
#: least rate, in grains per sqrt(d / g): no run of so many steps ends
SLOWEST = 1e-3


@explained_methods
@dataclass(frozen=True, slots=True)
class Inlet(ExplainedAttributes):
    """A disk or a rectangle across gravity, below which grains begin to fall.

    Parameters
    ----------
    radius
        radius of the disk, in two dimensions half the width, in units of length; if omitted, two median diameters.
    lengths
        edges of a rectangle in place of the disk, along the two axes across gravity, in units of length.
    center
        a point below the middle of the inlet, of which only the place across gravity matters; if omitted, the middle of
        the bounds of the container.
    height
        height above the lowest point of the container, in units of length, from which grains begin to fall if the bed
        below the inlet is lower; if omitted, the surface of the bed there.
    rate
        how many grains pass the inlet in the time sqrt(d / g), with the median diameter d: they arrive one after the
        other, and the bed moves meanwhile; if omitted, those of a batch begin together.

    Raises
    ------
    InputError
        If a length is not above 0 or a height is negative, or a disk and a rectangle are asked for.

    Examples
    --------
    >>> import voxgran as vg
    >>> heap = vg.pour(vg.make_shape("disk"), vg.Rectangle((16, 8)), count=20, inlet=vg.Inlet(radius=1.5), batch=10)
    >>> heap.count
    20
    """

    radius: float | None = parameter(None, above=0.0)
    lengths: tuple[float, float] | None = parameter(None, above=0.0)
    center: tuple[float, float, float] | None = parameter(None)
    height: float | None = parameter(None, at_least=0.0)
    rate: float | None = parameter(None, at_least=SLOWEST)

    def __post_init__(self) -> None:
        """Check the ranges, and that there is one outline."""
        check_bounds(self, of="inlet")
        if self.radius is not None and self.lengths is not None:
            raise InputError(
                f"radius is {self.radius:g} and lengths are {self.lengths}: an inlet is a disk or a rectangle; give one"
            )


@dataclass(frozen=True, eq=False)
class Column:
    """The part of a container below an inlet, and above it, as a container of its own, which is periodic along axes
    that a rectangle spans.

    half: half the edges of a rectangle across gravity, or the radius of a disk alone; axes: directions of the edges.
    """

    container: Container
    up: Floats
    center: Floats
    half: Floats
    axes: Floats
    periodic: tuple[bool, bool, bool] = (False, False, False)

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return self.container.dimension

    @cached_property
    def bounds(self) -> Floats:
        """Lower and upper corner, (2, 3): those of the container, narrowed where gravity is along an axis."""
        lower, upper = np.array(self.container.bounds, dtype=np.float64)
        if np.abs(self.up).max() == 1.0:
            half = np.abs(linear.matmul(self.half, self.axes)) if len(self.half) > 1 else self.half[0]
            flat = (self.up == 0.0) & (np.arange(3) < self.dimension)
            lower = np.where(flat, np.maximum(lower, self.center - half), lower)
            upper = np.where(flat, np.minimum(upper, self.center + half), upper)
        return np.array([lower, upper])

    @cached_property
    def volume(self) -> float:
        """Volume, estimated from points to about one percent."""
        lower, upper = self.bounds
        points = lower + (upper - lower) * stream(0, "inlet").random((SAMPLES, 3))
        return float((self.signed_distance(points) <= 0.0).mean() * np.prod((upper - lower)[: self.dimension]))

    def signed_distance(self, points: "ArrayLike") -> Floats:
        """Return the distance of (n, 3) points from the nearest wall or from the edge of the column, negative inside;
        outside, it is a lower bound.
        """
        places = np.asarray(points, dtype=np.float64)
        return np.maximum(np.asarray(self.container.signed_distance(places)), self.across(places))

    def across(self, points: Floats) -> Floats:
        """Return the distance of (n, 3) points from the edge of the inlet across gravity, negative below it."""
        offset = points - self.center
        if len(self.half) > 1:
            return np.asarray((np.abs(linear.matmul(offset, self.axes.T)) - self.half).max(axis=1))
        return np.asarray(
            linear.norm(offset - np.outer(linear.matmul(offset, self.up), self.up), axis=1) - self.half[0]
        )

    def surface(self, spheres: Floats) -> float:
        """Return the level of the highest of spheres (n, 4) that reach below the inlet; -inf where none does."""
        centers, radii = spheres[:, :3], spheres[:, 3]
        periods = periods_of(self.container)
        below = self.across(centers - linear.matmul(nearest_turns(centers - self.center, periods), periods)) < radii
        return float((linear.matmul(centers, self.up) + radii)[below].max(initial=-np.inf))


def column_below(inlet: Inlet, problem: Problem, up: Floats, bed: Floats) -> tuple[Any, float]:
    """Return the column below an inlet, and the level from which grains begin to fall upon spheres (n, 4) of a bed,
    centers and radii.

    Raises
    ------
    InputError
        If the inlet is narrower than a grain, reaches beyond the container, lies within walls or above the container,
        or is a rectangle though gravity is along no axis or there are two dimensions.
    """
    refuse_tilt(problem.container, "an inlet", "leave the tilt out, or give vg.pack no inlet")
    unit, flat = problem.unit_length, np.arange(3) < problem.dimension
    lower, upper = np.array(problem.container.bounds, dtype=np.float64)
    center = 0.5 * (lower + upper) if inlet.center is None else np.array(inlet.center) * flat / unit
    axes = np.eye(3)[flat & (up == 0.0)]
    if inlet.lengths is None:
        half = np.array([RADIUS if inlet.radius is None else problem.length(inlet.radius)])
    elif len(axes) != 2:
        raise InputError(
            f"lengths are {inlet.lengths}: an inlet is a rectangle in three dimensions, with gravity along an axis; "
            "give a radius"
        )
    else:
        half = 0.5 * np.array([problem.length(edge) for edge in inlet.lengths])
    radii = problem.bounding_radii
    widest = 2.0 * float(radii[problem.started :].max(initial=0.0))
    if 2.0 * half.min() < widest:
        raise InputError(
            f"inlet is {2.0 * half.min() * unit:g} wide, and the largest grain is {widest * unit:g}: grains do not "
            "pass it; make it wider"
        )
    reach = linear.matmul(half, axes) if len(half) > 1 else half[0] * np.sqrt(np.maximum(1.0 - up**2, 0.0))
    beyond = flat & (np.abs(up) < 1.0) & ((center - reach < lower - 1e-9) | (center + reach > upper + 1e-9))
    if beyond.any():
        axis = "xyz"[int(np.argmax(beyond))]
        ends = [float(f"{value * unit:.6g}") for value in ((center - reach)[beyond][0], (center + reach)[beyond][0])]
        raise InputError(
            f"inlet runs from {ends[0]:g} to {ends[1]:g} along {axis}: it must lie within the bounds of the container; "
            "move it, or make it smaller"
        )
    whole = np.zeros(3, dtype=np.bool_)
    if len(half) > 1:
        # a rectangle from one periodic side to the other has no edge there
        whole = np.array(problem.container.periodic) & (
            linear.matmul(2.0 * half, axes) > (upper - lower) * (1.0 - 1e-9)
        )
        half = np.where(linear.matmul(axes, whole) > 0.0, 2.0 * linear.matmul(axes, upper - lower), half)
    column = Column(problem.container, up, center, half, axes, (bool(whole[0]), bool(whole[1]), bool(whole[2])))
    floor, top = container_levels(problem.container, up)
    level = -np.inf if inlet.height is None else floor + problem.length(inlet.height)
    if level > top - widest:
        raise InputError(
            f"height of inlet is {inlet.height:g}, and the container is {(top - floor) * unit:g} high along gravity: "
            "no grain has room above it; lower it"
        )
    if not column.volume > 0.0:
        raise InputError("inlet lies within walls: no grain has room below it; move it by its center")
    return column, max(float(level), column.surface(bed))
