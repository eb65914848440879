"""Functions that make shapes, one for each family of `voxgran.shapes.families`."""

from collections.abc import Sequence
from typing import Any, Literal

from numpy.typing import NDArray

from voxgran.shapes.families.solid_union import Kind
from voxgran.shapes.model import Shape as Shape
from voxgran.typed_calls import Number, Whole

def box(
    *,
    aspect: Sequence[Number] | NDArray[Any] | None = None,
    diameter: Number | None = None,
    lengths: Sequence[Number] | NDArray[Any] | None = None,
) -> Shape: ...
def cone(
    *,
    aspect: Number | None = None,
    diameter: Number | None = None,
    radius: Number | None = None,
    height: Number | None = None,
) -> Shape: ...
def convex_polyhedron(
    *,
    points: Whole = 20,
    aspect: Sequence[Number] | NDArray[Any] = (1.0, 1.0, 1.0),
    diameter: Number | None = None,
    seed: Whole = 0,
) -> Shape: ...
def cylinder(
    *,
    aspect: Number | None = None,
    diameter: Number | None = None,
    radius: Number | None = None,
    height: Number | None = None,
) -> Shape: ...
def disk(*, diameter: Number | None = None, radius: Number | None = None) -> Shape: ...
def ellipsoid(
    *,
    aspect: Sequence[Number] | NDArray[Any] | None = None,
    diameter: Number | None = None,
    semi_axes: Sequence[Number] | NDArray[Any] | None = None,
) -> Shape: ...
def platonic(
    *,
    solid: Literal["tetrahedron", "cube", "octahedron", "dodecahedron", "icosahedron"] = "icosahedron",
    diameter: Number | None = None,
) -> Shape: ...
def polygon(
    *,
    corners: Whole | None = None,
    stretch: Number | None = None,
    diameter: Number | None = None,
    vertices: Sequence[Sequence[Number] | NDArray[Any]] | NDArray[Any] | None = None,
) -> Shape: ...
def random_surface(
    *,
    aspect: Sequence[Number] | NDArray[Any] = (1.0, 1.0),
    height: Number = 0.15,
    waves: Whole = 6,
    max_frequency: Number = 1.5,
    diameter: Number | None = None,
    seed: Whole = 0,
) -> Shape: ...
def sheet(
    *,
    aspect: Sequence[Number] | NDArray[Any] | None = None,
    roll: Number = 0.0,
    diameter: Number | None = None,
    lengths: Sequence[Number] | NDArray[Any] | None = None,
) -> Shape: ...
def shell(*, opening: Number = 180.0, diameter: Number | None = None) -> Shape: ...
def solid_union(
    *,
    solids: Whole | (Sequence[Whole] | NDArray[Any]) = (3, 6),
    kinds: Sequence[Kind] | NDArray[Any] = ("box", "cylinder", "cone", "ellipsoid", "sphere"),
    lengths: Sequence[Number] | NDArray[Any] = (0.4, 1.0),
    diameter: Number | None = None,
    seed: Whole = 0,
) -> Shape: ...
def sphere(*, diameter: Number | None = None, radius: Number | None = None) -> Shape: ...
