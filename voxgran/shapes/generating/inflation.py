"""Inflation of surfaces toward spheres, along the rays from their centers.

A point at a distance d from the center, below the radius R of the sphere, moves outward along its ray to d + w (R - d).
The amount w depends on the direction only: it falls smoothly to 0 at the edge of a cone. Points beyond the sphere stay.
For w < 1 this maps the space without the center one-to-one onto a part of itself, so that no surface comes to cross
itself; for w = 1 this holds for surfaces of which the center sees the whole, and the result is the union with the
sphere. What remains are the triangles between the moved vertices: they are divided until they are small, and where the
center does not see the whole, they are tested.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, Integers, as_length, as_number, as_positive, as_share, as_vector, check_type
from voxgran._base.calls import explained
from voxgran._base.errors import InputError, TooLargeError
from voxgran.geometry.triangles import areas_of
from voxgran.shapes.finer import cut_edges, edges_of
from voxgran.shapes.generating.star import is_star_shaped
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.repairing.diagnose import bounds_solid

#: depth of the center below the surface at least, in equivalent diameters
DEPTH = 0.02
#: largest amount where the center does not see the whole surface, and how often it is halved where triangles cross
MOST, HALVINGS = 0.95, 6
#: largest number of triangles, and rounds of bisection of long edges alone, which may not end at the edge of a cone
MOST_FACES, ROUNDS = 2_000_000, 20


@dataclass(frozen=True)
class Inflation:
    """A sphere, and the cone of directions from its center in which a surface is inflated toward it.

    The amount is 1 where the surface reaches the sphere; it falls to 0 over the outer half of the half angle, which is
    in radians; at pi or more it is the same in all directions.
    """

    center: Floats
    radius: float
    amount: float
    axis: Floats
    half_angle: float

    def moved(self, points: Floats) -> Floats:
        """Return where (n, 3) points are moved to."""
        rays = points - self.center
        distance = linear.norm(rays, axis=1)
        weight = np.full(len(points), self.amount)
        if self.half_angle < math.pi:
            angle = libm.arccos(np.clip(linear.matmul(rays, self.axis) / distance, -1.0, 1.0))
            outer = np.clip(2.0 - 2.0 * angle / self.half_angle, 0.0, 1.0)
            weight *= outer * outer * (3.0 - 2.0 * outer)
        outward = weight * np.maximum(self.radius - distance, 0.0)
        return np.where((outward > 0.0)[:, None], self.center + rays * (1.0 + outward / distance)[:, None], points)


def inflated(vertices: Floats, faces: Integers, inflation: Inflation, longest: float) -> tuple[Floats, Integers, float]:
    """Return vertices and faces of an inflated surface, whose edges are at most so long, and the amount.

    The amount is reduced where the triangles would cross; it may become 0.
    """
    for _ in range(HALVINGS):
        source, fine = _divided(vertices, faces, inflation, longest)
        whole = is_star_shaped(source, fine, inflation.center)
        if not whole and inflation.amount > MOST:
            inflation = _with_amount(inflation, MOST)
            continue
        moved = inflation.moved(source)
        if whole or bounds_solid(moved, fine):
            return moved, fine, inflation.amount
        inflation = _with_amount(inflation, inflation.amount / 2)
    return vertices, faces, 0.0


@explained(hint="spherize(shape, 1.0)")
def spherize(
    shape: Shape,
    radius: float,
    *,
    center: "ArrayLike" = (0.0, 0.0, 0.0),
    amount: float = 1.0,
    axis: "ArrayLike" = (0.0, 0.0, 1.0),
    half_angle: float = 180.0,
    longest_edge: float | None = None,
) -> Shape:
    """Inflate a shape toward a sphere.

    Parameters
    ----------
    shape : Shape
        A solid; of round ones and clumps the tessellation is inflated.
    radius : float
        Radius of the sphere, in the unit of lengths. What lies outside of it remains.
    center : (3,) array_like of float
        Center of the sphere in the body frame, inside of the shape.
    amount : float
        How far the surface moves toward the sphere, above 0 and at most 1. With 1 the result is the union with the
        sphere, or the sphere itself where it contains the shape.
    axis : (3,) array_like of float
        Axis of the cone of directions from the center in which the surface is inflated.
    half_angle : float
        Angle between the axis and the edge of the cone, in degrees, above 0 and at most 180, which is everywhere. The
        amount falls smoothly to 0 over the outer half of it.
    longest_edge : float, optional
        Length of the longest edge of the result; default: 0.05 of the equivalent diameter.

    Returns
    -------
    Shape
        A mesh. Where the center does not see the whole surface, the amount is at most 0.95, and it is reduced where
        triangles would cross each other, at last to 0; ``record["amount"]`` is what was reached.

    Raises
    ------
    InputError
        If the shape is no solid, a number is out of range, or the center is not deep enough inside.
    TooLargeError
        If the result would have more than 2 000 000 triangles.

    Notes
    -----
    After the inflation of volumes toward spheres that Sajjadi & Khalili 2015 (Generating, Reproducing and Packaging of
    Random Volumes for Discrete Element Analysis of Discontinuous Materials) cite as superspherize of Johnson 2005.

    Examples
    --------
    >>> import voxgran as vg
    >>> cube = vg.shapes.box(lengths=(1, 1, 1))
    >>> round(vg.spherize(cube, 1.0).volume, 2)  # a sphere of radius 1
    4.19
    """
    check_type(shape, Shape, "shape", "a Shape; make_shape and load_shape make one")
    shape.refuse_open("spheres inside")
    if shape.dimension == 2:
        raise InputError(f"shape {shape.name!r} is plane: only solids are inflated toward spheres; use a solid")
    middle, along = as_vector(center, "center"), as_vector(axis, "axis")
    if not along.any():
        raise InputError("axis is 0 along all directions: it must have a direction; give one")
    longest = as_positive(0.05 * shape.diameter if longest_edge is None else longest_edge, "longest_edge")
    depth = -float(shape.signed_distance(middle[None])[0])
    if depth < DEPTH * shape.diameter:
        raise InputError(
            f"center is {middle.tolist()}: it must be at least {DEPTH} equivalent diameters below the surface; move it "
            "inside"
        )
    inflation = Inflation(
        middle,
        as_length(radius, "radius"),
        as_share(amount, "amount"),
        along / linear.norm(along),
        math.radians(as_number(half_angle, "half_angle", at_least=1e-6, at_most=180.0)),
    )
    vertices, faces, reached = inflated(shape.vertices, shape.faces, inflation, longest)
    record = {"amount": reached}
    return Shape.of(Mesh(vertices.copy(), faces.copy()), name=shape.name, unit=shape.unit, record=record)


def _with_amount(inflation: Inflation, amount: float) -> Inflation:
    """Return an inflation with another amount."""
    return Inflation(inflation.center, inflation.radius, amount, inflation.axis, inflation.half_angle)


def _divided(vertices: Floats, faces: Integers, inflation: Inflation, longest: float) -> tuple[Floats, Integers]:
    """Return the surface with edges bisected until none is longer than `longest` once it is inflated.

    After `ROUNDS` the longest edge of each triangle that is divided is bisected too, as Rivara 1984
    (doi:10.1002/nme.1620200412) does, so that triangles do not become ever thinner and the division ends.
    """
    rounds = 0
    while True:
        ends, index = edges_of(faces)
        image = inflation.moved(vertices)
        long = linear.norm(image[ends[:, 0]] - image[ends[:, 1]], axis=1) > longest
        if not long.any():
            return vertices, faces
        if rounds >= ROUNDS:
            length, before = linear.norm(vertices[ends[:, 0]] - vertices[ends[:, 1]], axis=1), -1
            while (marked := int(long.sum())) > before:
                sides, before = index[long[index].any(axis=1)], marked
                long[sides[np.arange(len(sides)), length[sides].argmax(axis=1)]] = True
        # a triangle is at most as large as the equilateral one
        fewest = areas_of(image[faces]).sum() / (math.sqrt(3) / 4 * longest**2)
        if max(len(faces) + 2 * int(long.sum()), fewest) > MOST_FACES:
            raise TooLargeError(
                f"longest edge {longest:.3g} gives more than {MOST_FACES} triangles: a mesh of this size is refused; "
                "take longer edges"
            )
        new = np.full(len(ends), -1, dtype=np.int64)
        new[long] = len(vertices) + np.arange(int(long.sum()))
        vertices = np.concatenate([vertices, vertices[ends[long]].mean(axis=1)])
        faces = cut_edges(vertices, faces, index, new)
        rounds += 1
