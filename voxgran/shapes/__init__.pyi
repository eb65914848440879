"""Functions that make shapes, one for each family of `voxgran.shapes.families`."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

from numpy.typing import NDArray

from voxgran.shapes.families.random.polyhedron import Solid
from voxgran.shapes.families.random.solid_union import Kind
from voxgran.shapes.generating.regular_solids import PlatonicSolid
from voxgran.shapes.model import Shape as Shape
from voxgran.typed_calls import Number, NumberRange, Whole, WholeRange

def box(
    *,
    aspect: Sequence[Number] | NDArray[Any] | None = None,
    diameter: NumberRange | None = None,
    lengths: Sequence[Number] | NDArray[Any] | None = None,
) -> Shape: ...
def cone(
    *,
    aspect: NumberRange | None = None,
    diameter: NumberRange | None = None,
    radius: NumberRange | None = None,
    height: NumberRange | None = None,
) -> Shape: ...
def convex_polyhedron(
    *,
    points: WholeRange = 20,
    aspect: Sequence[Number] | NDArray[Any] = (1.0, 1.0, 1.0),
    diameter: NumberRange | None = None,
    seed: Whole = 0,
) -> Shape: ...
def crumpled(
    *,
    fold_length: NumberRange = 0.35,
    angles: Sequence[Number] | NDArray[Any] = (20.0, 90.0),
    aspect: Sequence[Number] | NDArray[Any] = (1.0, 1.0),
    diameter: NumberRange | None = None,
    seed: Whole = 0,
) -> Shape: ...
def cube_rain(
    *,
    cubes: WholeRange = 12,
    edges: Sequence[Number] | NDArray[Any] = (0.5, 1.0),
    overlap: NumberRange = 0.3,
    fall: Literal["around", "down"] = "around",
    diameter: NumberRange | None = None,
    seed: Whole = 0,
) -> Shape: ...
def cylinder(
    *,
    aspect: NumberRange | None = None,
    diameter: NumberRange | None = None,
    radius: NumberRange | None = None,
    height: NumberRange | None = None,
) -> Shape: ...
def disk(*, diameter: NumberRange | None = None, radius: NumberRange | None = None) -> Shape: ...
def ellipsoid(
    *,
    aspect: Sequence[Number] | NDArray[Any] | None = None,
    diameter: NumberRange | None = None,
    semi_axes: Sequence[Number] | NDArray[Any] | None = None,
) -> Shape: ...
def mollon_zhao(
    *,
    d_2: NumberRange = 0.1,
    d_3: NumberRange = 0.1,
    d_8: NumberRange = 0.015,
    alpha: NumberRange = -2.0,
    beta: NumberRange = -2.0,
    harmonics: WholeRange = 32,
    subdivisions: WholeRange = 4,
    diameter: NumberRange | None = None,
    seed: Whole = 0,
) -> Shape: ...
def mollon_zhao_2d(
    *,
    d_2: NumberRange = 0.1,
    d_3: NumberRange = 0.1,
    d_8: NumberRange = 0.015,
    alpha: NumberRange = -2.0,
    beta: NumberRange = -2.0,
    harmonics: WholeRange = 32,
    diameter: NumberRange | None = None,
    seed: Whole = 0,
) -> Shape: ...
def noise_star(
    *,
    deviation: NumberRange = 0.2,
    correlation_angle: NumberRange = 35.0,
    subdivisions: WholeRange = 4,
    diameter: NumberRange | None = None,
    seed: Whole = 0,
) -> Shape: ...
def platonic(*, solid: PlatonicSolid = "icosahedron", diameter: NumberRange | None = None) -> Shape: ...
def polygon(
    *,
    corners: WholeRange | None = None,
    stretch: NumberRange | None = None,
    diameter: NumberRange | None = None,
    vertices: Sequence[Sequence[Number] | NDArray[Any]] | NDArray[Any] | None = None,
) -> Shape: ...
def polyhedron(
    *,
    solid: Solid = "random",
    points: WholeRange | (Sequence[Whole] | NDArray[Any]) | None = None,
    aspect: Sequence[Number] | NDArray[Any] = (1.0, 1.0, 1.0),
    mirror: bool = False,
    rounding: NumberRange = 0.0,
    tolerance: NumberRange = 0.002,
    diameter: NumberRange | None = None,
    seed: Whole = 0,
) -> Shape: ...
def random_growth(
    *,
    cubes: WholeRange = 500,
    power: NumberRange = 1.0,
    rates: Sequence[Number] | NDArray[Any] | None = None,
    aspect: Sequence[Number] | NDArray[Any] | None = None,
    diameter: NumberRange | None = None,
    edge: NumberRange | None = None,
    seed: Whole = 0,
) -> Shape: ...
def random_surface(
    *,
    aspect: Sequence[Number] | NDArray[Any] = (1.0, 1.0),
    height: NumberRange = 0.15,
    waves: WholeRange = 6,
    max_frequency: NumberRange = 1.5,
    diameter: NumberRange | None = None,
    seed: Whole = 0,
) -> Shape: ...
def rough_sheet(
    *,
    method: Literal["spectral", "patir", "whitehouse", "midpoint"] = "spectral",
    rms: NumberRange | None = None,
    correlation_length: NumberRange
    | (Sequence[Number] | NDArray[Any])
    | (Sequence[Number] | NDArray[Any])
    | None = None,
    shortest: NumberRange | None = None,
    hurst: NumberRange | None = None,
    autocorrelation: Literal["exponential", "gaussian", "linear"] | None = None,
    skewness: NumberRange = 0.0,
    kurtosis: NumberRange = 3.0,
    aspect: Sequence[Number] | NDArray[Any] | None = None,
    diameter: NumberRange | None = None,
    lengths: Sequence[Number] | NDArray[Any] | None = None,
    seed: Whole = 0,
) -> Shape: ...
def sheet(
    *,
    aspect: Sequence[Number] | NDArray[Any] | None = None,
    roll: NumberRange = 0.0,
    diameter: NumberRange | None = None,
    lengths: Sequence[Number] | NDArray[Any] | None = None,
) -> Shape: ...
def shell(*, opening: NumberRange = 180.0, diameter: NumberRange | None = None) -> Shape: ...
def sierpinski_sponge(
    *,
    kind: Literal["random", "menger", "sierpinski", "carpet"] = "random",
    divisions: WholeRange = 3,
    levels: WholeRange = 2,
    hole: WholeRange | None = None,
    removed: WholeRange | None = None,
    kept: NumberRange | None = None,
    piece: Literal["largest", "whole"] = "largest",
    diameter: NumberRange | None = None,
    edge: NumberRange | None = None,
    seed: Whole = 0,
) -> Shape: ...
def solid_union(
    *,
    solids: WholeRange | (Sequence[Whole] | NDArray[Any]) = (3, 6),
    kinds: Sequence[Kind] | NDArray[Any] = ("box", "cylinder", "cone", "ellipsoid", "sphere"),
    counts: Sequence[Whole | (Sequence[Whole] | NDArray[Any])] | NDArray[Any] | None = None,
    lengths: Sequence[Number] | NDArray[Any] = (0.4, 1.0),
    box: Sequence[Number | (Sequence[Number] | NDArray[Any])] | NDArray[Any] | None = None,
    cylinder: Sequence[Number | (Sequence[Number] | NDArray[Any])] | NDArray[Any] | None = None,
    cone: Sequence[Number | (Sequence[Number] | NDArray[Any])] | NDArray[Any] | None = None,
    ellipsoid: Sequence[Number | (Sequence[Number] | NDArray[Any])] | NDArray[Any] | None = None,
    sphere: NumberRange | (Sequence[Number] | NDArray[Any]) | None = None,
    chord_error: NumberRange = 0.002,
    diameter: NumberRange | None = None,
    seed: Whole = 0,
) -> Shape: ...
def sphere(*, diameter: NumberRange | None = None, radius: NumberRange | None = None) -> Shape: ...
def sphere_assembly(
    *,
    base: str | Shape | Mapping[str, Any] = "solid_union",
    arrangement: Literal["voxels", "tetrahedra"] = "voxels",
    spacing: NumberRange = 0.15,
    probability: NumberRange = 0.7,
    radii: NumberRange | (Sequence[Number] | NDArray[Any]) = (0.6, 0.9),
    overlap: NumberRange = 0.2,
    isolated: Literal["connect", "remove"] = "connect",
    diameter: NumberRange | None = None,
    seed: Whole = 0,
) -> Shape: ...
def spherical_harmonics(
    *,
    like: str | Shape | Mapping[str, Any] | None = None,
    degree: WholeRange = 16,
    roughness: NumberRange | None = None,
    exponent: NumberRange | None = None,
    aspect: Sequence[Number] | NDArray[Any] = (1.0, 1.0, 1.0),
    subdivisions: WholeRange = 4,
    diameter: NumberRange | None = None,
    seed: Whole = 0,
) -> Shape: ...
def spherocylinder(
    *,
    aspect: NumberRange | None = None,
    diameter: NumberRange | None = None,
    radius: NumberRange | None = None,
    height: NumberRange | None = None,
    tolerance: NumberRange = 0.002,
) -> Shape: ...
def superquadric(
    *,
    e1: NumberRange = 0.5,
    e2: NumberRange = 0.5,
    aspect: Sequence[Number] | NDArray[Any] | None = None,
    diameter: NumberRange | None = None,
    semi_axes: Sequence[Number] | NDArray[Any] | None = None,
    tolerance: NumberRange = 0.002,
) -> Shape: ...
def superspherize(
    *,
    base: str | Shape | Mapping[str, Any] = "convex_polyhedron",
    inflations: WholeRange = 4,
    amounts: NumberRange | (Sequence[Number] | NDArray[Any]) = (0.5, 1.0),
    radii: NumberRange | (Sequence[Number] | NDArray[Any]) = (0.4, 0.65),
    half_angles: NumberRange | (Sequence[Number] | NDArray[Any]) = (40.0, 110.0),
    spread: NumberRange = 0.5,
    longest_edge: NumberRange = 0.08,
    diameter: NumberRange | None = None,
    seed: Whole = 0,
) -> Shape: ...
def torus(
    *,
    aspect: NumberRange | None = None,
    diameter: NumberRange | None = None,
    major_radius: NumberRange | None = None,
    minor_radius: NumberRange | None = None,
    tolerance: NumberRange = 0.002,
) -> Shape: ...
def voronoi_fragment(
    *,
    seeds: WholeRange = 64,
    process: Literal["random", "jittered"] = "random",
    jitter: NumberRange = 1.0,
    boundary: Literal["periodic", "reflected"] = "periodic",
    aspect: Sequence[Number] | NDArray[Any] | None = None,
    cell: WholeRange | None = None,
    diameter: NumberRange | None = None,
    lengths: Sequence[Number] | NDArray[Any] | None = None,
    seed: Whole = 0,
) -> Shape: ...
def voxel_rain(
    *,
    cubes: WholeRange = 400,
    width: Sequence[Whole] | NDArray[Any] = (10, 10),
    base: Literal["rectangle", "ellipse"] = "rectangle",
    plate: WholeRange = 1,
    deposition: Literal["ballistic", "random", "relaxed"] = "ballistic",
    diameter: NumberRange | None = None,
    edge: NumberRange | None = None,
    seed: Whole = 0,
) -> Shape: ...
