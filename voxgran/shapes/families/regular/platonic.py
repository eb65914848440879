"""Platonic solids: the five regular convex polyhedra, the shapes of common dice."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from voxgran._base.arrays import Floats, as_choice
from voxgran._base.config import parameter
from voxgran.shapes.family import ShapeFamily, sized
from voxgran.shapes.mesh import hull_of
from voxgran.shapes.model import Shape

#: the golden ratio
GOLDEN = (1.0 + 5.0**0.5) / 2.0


@dataclass(frozen=True, kw_only=True, slots=True)
class Platonic:
    """Parameters of a Platonic solid."""

    solid: Literal["tetrahedron", "cube", "octahedron", "dodecahedron", "icosahedron"] = parameter(
        "icosahedron", doc="which of the five Platonic solids"
    )
    diameter: float | None = parameter(None, doc="equivalent diameter; default: 1", unit="length")


def make(parameters: Platonic, generator: np.random.Generator) -> Shape:
    """Return the solid; nothing is random."""
    corners = _corners()
    solid = as_choice(parameters.solid, "solid", tuple(corners))
    return sized(hull_of(corners[solid]), parameters.diameter, name="platonic")


def _corners() -> dict[str, Floats]:
    """Return the corners of each solid, centered at the origin."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
    short, long = 1.0 / GOLDEN, GOLDEN

    def rectangles(a: float, b: float) -> Floats:
        """Return the corners (0, +-a, +-b) and their cyclic permutations."""
        flat = signs[signs[:, 0] > 0] * np.array([0.0, a, b])
        return np.concatenate([np.roll(flat, k, axis=1) for k in range(3)])

    return {
        "tetrahedron": signs[signs.prod(axis=1) > 0],
        "cube": signs,
        "octahedron": np.concatenate([np.eye(3), -np.eye(3)]),
        "dodecahedron": np.concatenate([signs, rectangles(short, long)]),
        "icosahedron": rectangles(1.0, long),
    }


registration = ShapeFamily(
    name="platonic",
    summary="tetrahedron, cube, octahedron, dodecahedron or icosahedron",
    parameters=Platonic,
    make=make,
)
