"""Ratios that describe the form of a shape: each descriptor once, with its formula and source."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.lazy import load
from voxgran.shapes.describing.curvature import roundness
from voxgran.shapes.describing.minimal_box import principal_lengths
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive


@dataclass(frozen=True)
class Form:
    """A shape whose descriptors are asked for; what several of them need is computed once.

    Attributes
    ----------
    shape : Shape
        The shape.
    """

    shape: Shape

    @cached_property
    def lengths(self) -> Floats:
        """Edges of the smallest box, (3,), largest first; NaN for the third in 2D (Blott & Pye 2008,
        doi:10.1111/j.1365-3091.2007.00892.x).
        """
        edges = principal_lengths(self.shape)
        return edges if self.shape.dimension == 3 else np.array([edges[0], edges[1], math.nan])


@dataclass(frozen=True, slots=True, kw_only=True)
class Descriptor:
    """One descriptor of the form of shapes.

    Attributes
    ----------
    long_name, formula, source : str
        What it is, how it is computed, and who defined it.
    compute : callable
        Function of a :class:`Form` that returns a number, NaN where it is not defined.
    power : int
        Power of length that is its unit; in 2D, volumes are areas and areas are perimeters.
    """

    long_name: str
    formula: str
    compute: Callable[[Form], float]
    power: int = 0
    source: str = ""

    def power_in(self, dimension: int) -> int:
        """Return the power of length that is the unit in 2D or 3D."""
        return self.power if dimension == 3 or self.power < 2 else self.power - 1


def sphericity(form: Form) -> float:
    """Return the surface area of the sphere of equal volume over that of the shape; in 2D, the perimeters of disks."""
    shape = form.shape
    if shape.is_open:
        return math.nan
    if shape.dimension == 2:
        return math.sqrt(4 * math.pi * shape.volume) / shape.surface_area
    return math.pi * shape.diameter**2 / shape.surface_area


def convexity(form: Form) -> float:
    """Return the volume (in 2D the area) of a shape over that of its convex hull."""
    shape = form.shape
    if shape.is_open:
        return math.nan
    if shape.is_sphere or isinstance(shape.geometry, Primitive):
        return 1.0
    hull = load("scipy.spatial").ConvexHull(shape.vertices[:, : shape.dimension])
    return min(1.0, shape.volume / float(hull.volume))


#: all descriptors by their names
DESCRIPTORS: Mapping[str, Descriptor] = {
    "volume": Descriptor(long_name="volume (in 2D area)", formula="V", compute=lambda f: f.shape.volume, power=3),
    "surface_area": Descriptor(
        long_name="surface area (in 2D perimeter; of an open surface one side)",
        formula="A",
        compute=lambda f: f.shape.surface_area,
        power=2,
    ),
    "equivalent_diameter": Descriptor(
        long_name="diameter of the sphere of equal volume (in 2D and for open surfaces, of the disk of equal area)",
        formula="(6 V / pi)^(1/3); in 2D (4 V / pi)^(1/2)",
        compute=lambda f: f.shape.diameter,
        power=1,
    ),
    "longest_length": Descriptor(
        long_name="longest edge of the smallest box", formula="L", compute=lambda f: float(f.lengths[0]), power=1
    ),
    "intermediate_length": Descriptor(
        long_name="intermediate edge of the smallest box (in 2D the shorter one)",
        formula="I",
        compute=lambda f: float(f.lengths[1]),
        power=1,
    ),
    "shortest_length": Descriptor(
        long_name="shortest edge of the smallest box", formula="S", compute=lambda f: float(f.lengths[2]), power=1
    ),
    "elongation": Descriptor(
        long_name="elongation ratio",
        formula="I / L",
        compute=lambda f: float(f.lengths[1] / f.lengths[0]),
        source="Zingg 1935, doi:10.3929/ethz-a-000103455",
    ),
    "flatness": Descriptor(
        long_name="flatness ratio",
        formula="S / I",
        compute=lambda f: float(f.lengths[2] / f.lengths[1]),
        source="Zingg 1935, doi:10.3929/ethz-a-000103455",
    ),
    "sphericity": Descriptor(
        long_name="sphericity",
        formula="pi^(1/3) (6 V)^(2/3) / A; in 2D (4 pi V)^(1/2) / A",
        compute=sphericity,
        source="Wadell 1932, doi:10.1086/623964",
    ),
    "convexity": Descriptor(long_name="convexity", formula="V over the volume of the convex hull", compute=convexity),
    "roundness": Descriptor(
        long_name="roundness",
        formula="mean radius of curvature of corners, weighted by angle, over the radius of the inscribed sphere",
        compute=lambda f: roundness(f.shape),
        source="Wadell 1932, doi:10.1086/623964",
    ),
    "krumbein_sphericity": Descriptor(
        long_name="intercept sphericity",
        formula="(I S / L^2)^(1/3)",
        compute=lambda f: float((f.lengths[1] * f.lengths[2] / f.lengths[0] ** 2) ** (1 / 3)),
        source="Krumbein 1941, doi:10.1306/D42690F3-2B26-11D7-8648000102C1865D",
    ),
    "corey_shape_factor": Descriptor(
        long_name="shape factor of settling",
        formula="S / (L I)^(1/2)",
        compute=lambda f: float(f.lengths[2] / math.sqrt(f.lengths[0] * f.lengths[1])),
        source="Corey 1949",
    ),
}
