"""Functions that make shapes, one for each family of `voxgran.shapes.families`."""

from typing import Literal

from voxgran.shapes.families.solid_union import Kind
from voxgran.shapes.model import Shape as Shape

def box(
    *,
    aspect: tuple[float, float, float] | None = None,
    diameter: float | None = None,
    lengths: tuple[float, float, float] | None = None,
) -> Shape: ...
def cone(
    *,
    aspect: float | None = None,
    diameter: float | None = None,
    radius: float | None = None,
    height: float | None = None,
) -> Shape: ...
def convex_polyhedron(
    *,
    points: int = 20,
    aspect: tuple[float, float, float] = (1.0, 1.0, 1.0),
    diameter: float | None = None,
    seed: int = 0,
) -> Shape: ...
def cylinder(
    *,
    aspect: float | None = None,
    diameter: float | None = None,
    radius: float | None = None,
    height: float | None = None,
) -> Shape: ...
def disk(*, diameter: float | None = None, radius: float | None = None) -> Shape: ...
def ellipsoid(
    *,
    aspect: tuple[float, float, float] | None = None,
    diameter: float | None = None,
    semi_axes: tuple[float, float, float] | None = None,
) -> Shape: ...
def platonic(
    *,
    solid: Literal["tetrahedron", "cube", "octahedron", "dodecahedron", "icosahedron"] = "icosahedron",
    diameter: float | None = None,
) -> Shape: ...
def polygon(
    *,
    corners: int | None = None,
    stretch: float | None = None,
    diameter: float | None = None,
    vertices: tuple[tuple[float, float], ...] | None = None,
) -> Shape: ...
def random_surface(
    *,
    aspect: tuple[float, float] = (1.0, 1.0),
    height: float = 0.15,
    waves: int = 6,
    max_frequency: float = 1.5,
    diameter: float | None = None,
    seed: int = 0,
) -> Shape: ...
def sheet(
    *,
    aspect: tuple[float, float] | None = None,
    roll: float = 0.0,
    diameter: float | None = None,
    lengths: tuple[float, float] | None = None,
) -> Shape: ...
def shell(*, opening: float = 180.0, diameter: float | None = None) -> Shape: ...
def solid_union(
    *,
    solids: int | tuple[int, int] = (3, 6),
    kinds: tuple[Kind, ...] = ("box", "cylinder", "cone", "ellipsoid", "sphere"),
    lengths: tuple[float, float] = (0.4, 1.0),
    diameter: float | None = None,
    seed: int = 0,
) -> Shape: ...
def sphere(*, diameter: float | None = None, radius: float | None = None) -> Shape: ...
