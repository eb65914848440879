"""Rings: cylinders with a hole along the axis, as column packings and tubes are."""

import math

import numpy as np

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import Floats
from voxgran._base.config import check_bounds, parameter, parameter_class
from voxgran._base.errors import InputError
from voxgran._base.lazy import load
from voxgran._base.scalars import cube_root
from voxgran.shapes.family import ShapeFamily, refuse_both, sized
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.tessellate import sides_of

#: ratio of the radius of a hole to the largest one: by default, and at most (walls keep a width)
USUAL, WIDEST = 0.6, 0.99
#: largest distance of the mesh from the true surface, in widths of the thinnest wall
THINNER = 0.1


@parameter_class
class Ring:
    """Parameters of a ring.

    Parameters
    ----------
    aspect
        ratio of the height to the outer diameter; default: 1.
    bore
        ratio of the diameter of a hole to the outer diameter; default: 0.6 of the largest one.
    diameter
        equivalent diameter; default: 1.
    radius
        outer radius; with height and hole_radius, replaces aspect, bore and diameter.
    height
        height; requires radius and hole_radius.
    hole_radius
        radius of a hole; requires radius and height.
    tolerance
        largest distance of the mesh from the true surface, in equivalent diameters.

    Raises
    ------
    InputError
        If a number is out of range, the size is given twice or in part, or a hole is so wide that no wall is left.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.shapes.ring(radius=5.0, height=10.0, hole_radius=4.0).bounds[1].round(1).tolist()
    [5.0, 5.0, 5.0]
    """

    aspect: float | None = parameter(None, at_least=0.001, at_most=1000.0)
    bore: float | None = parameter(None, at_least=0.001, at_most=WIDEST)
    diameter: float | None = parameter(None, unit="length", above=0.0)
    radius: float | None = parameter(None, unit="length", above=0.0)
    height: float | None = parameter(None, unit="length", above=0.0)
    hole_radius: float | None = parameter(None, unit="length", above=0.0)
    tolerance: float = parameter(0.002, at_least=1e-4, at_most=0.1)

    def __post_init__(self) -> None:
        """Check the values."""
        check_bounds(self)
        lengths = (("radius", self.radius), ("height", self.height), ("hole_radius", self.hole_radius))
        refuse_both(self.diameter, lengths, aspect=self.aspect, bore=self.bore)


def make(parameters: Ring, generator: np.random.Generator) -> Shape:
    """Return the ring, its axis along z; nothing is random."""
    return pierced(parameters, 1, name="ring")


def pierced(parameters: Ring, holes: int, *, name: str) -> Shape:
    """Return a cylinder with equal holes along z, at equal distances from each other and from the mantle.

    Raises
    ------
    InputError
        If the holes are so wide that no wall is left.
    """
    radius, height, hole = parameters.radius, parameters.height, parameters.hole_radius
    # of holes that touch each other and the mantle
    sine = math.sin(math.pi / holes)
    most = 1.0 if holes == 1 else sine / (1.0 + sine)
    given = radius is not None and height is not None and hole is not None
    if radius is None or height is None or hole is None:
        bore = USUAL * most if parameters.bore is None else parameters.bore
        radius, height, hole = 0.5, 1.0 if parameters.aspect is None else parameters.aspect, 0.5 * bore
    if not hole <= WIDEST * most * radius:
        raise InputError(
            f"{'hole_radius' if given else 'bore'} is {hole if given else 2.0 * hole:g}: with {holes} holes it must be "
            f"at most {WIDEST * most * (radius if given else 1.0):.4g}, so that walls are left; make it less"
        )
    away = 0.0 if holes == 1 else (radius + hole) / (1.0 + 2.0 * sine)
    size = cube_root(6.0 * height * (radius**2 - holes * hole**2))
    error = min(parameters.tolerance * size, THINNER * (radius - away - hole))
    turns = 2.0 * np.pi * np.arange(holes) / holes
    centers = away * np.column_stack([libm.cos(turns), libm.sin(turns)])
    rings = [_circle(radius, error), *(center + _circle(hole, error)[::-1] for center in centers)]
    solid = _prism(rings, height)
    return Shape.of(solid, name=name) if given else sized(solid, parameters.diameter, name=name)


def _circle(radius: float, error: float) -> Floats:
    """Return the corners (k, 2) of a regular polygon in a circle, counterclockwise, its sides within an error."""
    sides = sides_of(radius, error)
    turn = 2.0 * np.pi * np.arange(sides) / sides
    return np.column_stack([radius * libm.cos(turn), radius * libm.sin(turn)])


def _prism(rings: list[Floats], height: float) -> Mesh:
    """Return the prism over a polygon: its first ring runs counterclockwise, those around holes clockwise."""
    flat, start = np.concatenate(rings), 0
    many = len(flat)
    upper = np.array(load("manifold3d").triangulate([np.ascontiguousarray(ring) for ring in rings]), dtype=np.int64)
    faces = [upper + many, upper[:, ::-1]]
    for ring in rings:
        here = start + np.arange(len(ring))
        after = np.roll(here, -1)
        faces += [np.column_stack([here, after, after + many]), np.column_stack([here, after + many, here + many])]
        start += len(ring)
    ends = [np.column_stack([flat, np.full(many, end * height)]) for end in (-0.5, 0.5)]
    return Mesh(np.concatenate(ends), np.concatenate(faces))


registration = ShapeFamily(summary="cylinder with a hole along its axis", parameters=Ring, make=make)
