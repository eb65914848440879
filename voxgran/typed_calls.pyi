# fmt: off
# ruff: noqa: E501
"""Types of the functions that take a name with keywords: one overload for each name. Written by tools/stubs.py.

An overload for names that are not known here takes no parameters, since it would accept misspelt ones: methods of
others are given as parameter objects.
"""

import os
from collections.abc import Mapping, Sequence
from typing import Any, Literal, TypedDict, Unpack, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from voxgran._base.progress import OnStep
from voxgran._base.registry import Parameters
from voxgran.clumps.model import Clump
from voxgran.containers.model import Container
from voxgran.geometry.orientation_laws.law import OrientationLaw
from voxgran.packing.beds.inlet import Inlet
from voxgran.packing.driver import Recorder
from voxgran.packing.model import Packing
from voxgran.settling.materials import Materials
from voxgran.settling.parameters import Lid, Settling, Shaking
from voxgran.shapes.families.random.polyhedron import Solid
from voxgran.shapes.families.random.solid_union import Kind
from voxgran.shapes.generating.regular_solids import PlatonicSolid
from voxgran.shapes.learning.model import ShapeModel
from voxgran.shapes.model import Shape
from voxgran.shapes.size_laws.distribution import SizeDistribution
from voxgran.voxels.model import Voxels

Whole = int | np.integer[Any]
Number = float | np.floating[Any] | np.integer[Any]
WholeRange = Whole | Sequence[Whole]
NumberRange = Number | Sequence[Number]

class PackKeywords(TypedDict, total=False):
    count: Whole | None
    solid_fraction: Number | None
    porosity: Number | None
    void_ratio: Number | None
    sizes: SizeDistribution | None
    grains: Any
    weights: ArrayLike | None
    weights_by: str
    seed: Whole
    start: Packing | None
    obstacles: Packing | None
    unit: str | None
    density: Number | Sequence[float] | None
    checkpoint: str | os.PathLike[str] | None
    resume: bool
    time_limit: Number | None
    threads: Whole | None
    on_step: OnStep | None
    recorder: Recorder | None
    settle: bool | Mapping[str, Any] | Settling | None
    orientations: OrientationLaw | ArrayLike | None
class AdvancingFrontKeywords(PackKeywords, total=False):
    mode: Literal['loose', 'dense']
    order: Literal['random', 'nearest', 'lowest']
    tries: Whole
    grow: Number
class ApollonianKeywords(PackKeywords, total=False):
    smallest: Number | None
class CompressionKeywords(PackKeywords, total=False):
    stress: Number | (Sequence[Number] | NDArray[Any])
    axes: str
    shear: Literal['held', 'free'] | None
    friction: Number | Materials | None
    region: Literal['specimen', 'bulk']
    height: Number | None
    rate: Number | None
    rest: Number
class CompressKeywords(CompressionKeywords, total=False):
    fill: Number | None
class FeedingKeywords(PackKeywords, total=False):
    gravity: Literal['-x', '+x', '-y', '+y', '-z', '+z', 'none'] | (Sequence[Number] | NDArray[Any]) | None
    feed: Literal['rain', 'layers', 'at_once']
    rate: Number
    layer_sweeps: Whole
class WalkingKeywords(FeedingKeywords, total=False):
    lid: bool
    sweeps: Whole
    cycles: Whole | None
    period: Whole | None
    decay: Number | None
class ControlPointKeywords(WalkingKeywords, total=False):
    spacing: Number
    contact: Literal['sdf', 'kdtree']
    points: Literal['surface', 'all']
    tested_points: Literal['both', 'one']
    distance: Number
    overlap: Number
    gravity_bias: Number
    vibration: Literal['cycles', 'collision']
    vibration_up: Number
    rotation_share: Number
    step: Number
class DepositionKeywords(PackKeywords, total=False):
    sticking: Number
    toward: Literal['floor', 'center']
    drops: Whole
    inlet: Inlet | None
class DigitalKeywords(WalkingKeywords, total=False):
    voxel_size: Number | None
    cover: Literal['touch', 'center']
    downward_share: Number
    vibration_up: Number
    rotation_share: Number
    guided: Number
    schedule: Literal['random', 'sorted', 'sleeping']
class LatticeSearchKeywords(PackKeywords, total=False):
    voxel_size: Number | None
    cover: Literal['touch', 'center']
    turned: bool
class DigitalFillKeywords(LatticeSearchKeywords, total=False):
    place: Literal['lowest', 'contact', 'wall']
    gravity: Literal['-x', '+x', '-y', '+y', '-z', '+z', 'none'] | None
    order: Literal['random', 'largest']
class GrowthRateKeywords(PackKeywords, total=False):
    growth_rate: Number
class SettlingKeywords(PackKeywords, total=False):
    friction: Number | Materials | None
    restitution: Number
    shaking: Shaking | None
    lid: Lid | None
    fall_time: Number | None
    rest: Number
    parts: Literal['exact', 'hulls']
class GravityKeywords(SettlingKeywords, total=False):
    gravity: Literal['-x', '+x', '-y', '+y', '-z', '+z'] | (Sequence[Number] | NDArray[Any]) | None
    fill: Number
    height: Number | None
    inlet: Inlet | None
    fall_height: Number | None
class GrowthKeywords(PackKeywords, total=False):
    arrival: Literal['together', 'continuous']
    slowest: Number
    speed: Number
class JamKeywords(GrowthRateKeywords, total=False):
    keep: Literal['container', 'sizes']
class MultilayerKeywords(PackKeywords, total=False):
    layers: Whole
    undercompaction: Number
class RandomApollonianKeywords(PackKeywords, total=False):
    smallest: Number | None
    largest: Number | None
    shift: Whole
    rotate: Whole
    shrink: Number
class RsaKeywords(PackKeywords, total=False):
    scheme: Literal['classic', '1', '2', '3', '4a', '4b', '4c', '4d']
    until: Literal['tries', 'saturated'] | None
    tries: Whole
    retry: Literal['scan', 'next']
    corrections: Whole
    order: Literal['given', 'largest', 'random'] | None
    along: Literal['x', 'y', 'z']
    numbers: Literal['philox', 'lcg']
    aligned: bool
class TetrahedralKeywords(PackKeywords, total=False):
    edge: Number | None
    smallest: Number | None
    largest: Number | None
    jitter: Number
    mesh: str | None
class VoronoiFillKeywords(PackKeywords, total=False):
    fill: Literal['shapes', 'cells']
    smoothing: Whole
    rounds: Whole
@overload
def pack(shapes: Sequence[Shape] | Shape, container: Container, method: Literal["advancing_front"], **keywords: Unpack[AdvancingFrontKeywords]) -> Packing: ...
@overload
def pack(shapes: Sequence[Shape] | Shape, container: Container, method: Literal["apollonian"], **keywords: Unpack[ApollonianKeywords]) -> Packing: ...
@overload
def pack(shapes: Sequence[Shape] | Shape, container: Container, method: Literal["compress"], **keywords: Unpack[CompressKeywords]) -> Packing: ...
@overload
def pack(shapes: Sequence[Shape] | Shape, container: Container, method: Literal["control_point"], **keywords: Unpack[ControlPointKeywords]) -> Packing: ...
@overload
def pack(shapes: Sequence[Shape] | Shape, container: Container, method: Literal["deposition"], **keywords: Unpack[DepositionKeywords]) -> Packing: ...
@overload
def pack(shapes: Sequence[Shape] | Shape, container: Container, method: Literal["digital"], **keywords: Unpack[DigitalKeywords]) -> Packing: ...
@overload
def pack(shapes: Sequence[Shape] | Shape, container: Container, method: Literal["digital_fill"], **keywords: Unpack[DigitalFillKeywords]) -> Packing: ...
@overload
def pack(shapes: Sequence[Shape] | Shape, container: Container, method: Literal["digital_rsa"], **keywords: Unpack[LatticeSearchKeywords]) -> Packing: ...
@overload
def pack(shapes: Sequence[Shape] | Shape, container: Container, method: Literal["expand"], **keywords: Unpack[GrowthRateKeywords]) -> Packing: ...
@overload
def pack(shapes: Sequence[Shape] | Shape, container: Container, method: Literal["gravity"], **keywords: Unpack[GravityKeywords]) -> Packing: ...
@overload
def pack(shapes: Sequence[Shape] | Shape, container: Container, method: Literal["growth"], **keywords: Unpack[GrowthKeywords]) -> Packing: ...
@overload
def pack(shapes: Sequence[Shape] | Shape, container: Container, method: Literal["jam"], **keywords: Unpack[JamKeywords]) -> Packing: ...
@overload
def pack(shapes: Sequence[Shape] | Shape, container: Container, method: Literal["multilayer"], **keywords: Unpack[MultilayerKeywords]) -> Packing: ...
@overload
def pack(shapes: Sequence[Shape] | Shape, container: Container, method: Literal["random_apollonian"], **keywords: Unpack[RandomApollonianKeywords]) -> Packing: ...
@overload
def pack(shapes: Sequence[Shape] | Shape, container: Container, method: Literal["rsa"], **keywords: Unpack[RsaKeywords]) -> Packing: ...
@overload
def pack(shapes: Sequence[Shape] | Shape, container: Container, method: Literal["tetrahedral"], **keywords: Unpack[TetrahedralKeywords]) -> Packing: ...
@overload
def pack(shapes: Sequence[Shape] | Shape, container: Container, method: Literal["voronoi_fill"], **keywords: Unpack[VoronoiFillKeywords]) -> Packing: ...
@overload
def pack(shapes: Sequence[Shape] | Shape, container: Container, method: str | Parameters, **keywords: Unpack[PackKeywords]) -> Packing: ...
@overload
def pack(*, container: Container, method: Literal["advancing_front"], **keywords: Unpack[AdvancingFrontKeywords]) -> Packing: ...
@overload
def pack(*, container: Container, method: Literal["apollonian"], **keywords: Unpack[ApollonianKeywords]) -> Packing: ...
@overload
def pack(*, container: Container, method: Literal["compress"], **keywords: Unpack[CompressKeywords]) -> Packing: ...
@overload
def pack(*, container: Container, method: Literal["control_point"], **keywords: Unpack[ControlPointKeywords]) -> Packing: ...
@overload
def pack(*, container: Container, method: Literal["deposition"], **keywords: Unpack[DepositionKeywords]) -> Packing: ...
@overload
def pack(*, container: Container, method: Literal["digital"], **keywords: Unpack[DigitalKeywords]) -> Packing: ...
@overload
def pack(*, container: Container, method: Literal["digital_fill"], **keywords: Unpack[DigitalFillKeywords]) -> Packing: ...
@overload
def pack(*, container: Container, method: Literal["digital_rsa"], **keywords: Unpack[LatticeSearchKeywords]) -> Packing: ...
@overload
def pack(*, container: Container, method: Literal["expand"], **keywords: Unpack[GrowthRateKeywords]) -> Packing: ...
@overload
def pack(*, container: Container, method: Literal["gravity"], **keywords: Unpack[GravityKeywords]) -> Packing: ...
@overload
def pack(*, container: Container, method: Literal["growth"], **keywords: Unpack[GrowthKeywords]) -> Packing: ...
@overload
def pack(*, container: Container, method: Literal["jam"], **keywords: Unpack[JamKeywords]) -> Packing: ...
@overload
def pack(*, container: Container, method: Literal["multilayer"], **keywords: Unpack[MultilayerKeywords]) -> Packing: ...
@overload
def pack(*, container: Container, method: Literal["random_apollonian"], **keywords: Unpack[RandomApollonianKeywords]) -> Packing: ...
@overload
def pack(*, container: Container, method: Literal["rsa"], **keywords: Unpack[RsaKeywords]) -> Packing: ...
@overload
def pack(*, container: Container, method: Literal["tetrahedral"], **keywords: Unpack[TetrahedralKeywords]) -> Packing: ...
@overload
def pack(*, container: Container, method: Literal["voronoi_fill"], **keywords: Unpack[VoronoiFillKeywords]) -> Packing: ...
@overload
def pack(*, container: Container, method: str | Parameters, **keywords: Unpack[PackKeywords]) -> Packing: ...
class MakeShapeKeywords(TypedDict, total=False):
    seed: Whole
class SizedKeywords(MakeShapeKeywords, total=False):
    diameter: NumberRange | None
class BoxKeywords(SizedKeywords, total=False):
    aspect: Sequence[Number] | NDArray[Any] | None
    lengths: Sequence[Number] | NDArray[Any] | None
class CylinderKeywords(SizedKeywords, total=False):
    aspect: NumberRange | None
    radius: NumberRange | None
    height: NumberRange | None
class ConvexPolyhedronKeywords(SizedKeywords, total=False):
    points: WholeRange
    aspect: Sequence[Number] | NDArray[Any]
class CrumpledKeywords(SizedKeywords, total=False):
    fold_length: NumberRange
    angles: Sequence[Number] | NDArray[Any]
    aspect: Sequence[Number] | NDArray[Any]
class CubeRainKeywords(SizedKeywords, total=False):
    cubes: WholeRange
    edges: Sequence[Number] | NDArray[Any]
    overlap: NumberRange
    fall: Literal['around', 'down']
class SphereKeywords(SizedKeywords, total=False):
    radius: NumberRange | None
class EllipsoidKeywords(SizedKeywords, total=False):
    aspect: Sequence[Number] | NDArray[Any] | None
    semi_axes: Sequence[Number] | NDArray[Any] | None
class RingKeywords(MakeShapeKeywords, total=False):
    aspect: NumberRange | None
    bore: NumberRange | None
    diameter: NumberRange | None
    radius: NumberRange | None
    height: NumberRange | None
    hole_radius: NumberRange | None
    tolerance: NumberRange
class HollowCylinderKeywords(RingKeywords, total=False):
    holes: WholeRange
class LearnedKeywords(SizedKeywords, total=False):
    model: ShapeModel | str
class FourierSpectrumKeywords(MakeShapeKeywords, total=False):
    d_2: NumberRange
    d_3: NumberRange
    d_8: NumberRange
    alpha: NumberRange
    beta: NumberRange
    harmonics: WholeRange
class MollonZhaoKeywords(FourierSpectrumKeywords, total=False):
    subdivisions: WholeRange
    diameter: NumberRange | None
class MollonZhao2dKeywords(FourierSpectrumKeywords, total=False):
    diameter: NumberRange | None
class NoiseStarKeywords(SizedKeywords, total=False):
    deviation: NumberRange
    correlation_angle: NumberRange
    subdivisions: WholeRange
class PlatonicKeywords(SizedKeywords, total=False):
    solid: PlatonicSolid
class PolygonKeywords(SizedKeywords, total=False):
    corners: WholeRange | None
    stretch: NumberRange | None
    vertices: Sequence[Sequence[Number] | NDArray[Any]] | NDArray[Any] | None
class PolyhedronKeywords(SizedKeywords, total=False):
    solid: Solid
    points: WholeRange | (Sequence[Whole] | NDArray[Any]) | None
    aspect: Sequence[Number] | NDArray[Any]
    mirror: bool
    rounding: NumberRange
    tolerance: NumberRange
class RandomGrowthKeywords(SizedKeywords, total=False):
    cubes: WholeRange
    power: NumberRange
    rates: Sequence[Number] | NDArray[Any] | None
    aspect: Sequence[Number] | NDArray[Any] | None
    edge: NumberRange | None
class RandomSurfaceKeywords(SizedKeywords, total=False):
    aspect: Sequence[Number] | NDArray[Any]
    height: NumberRange
    waves: WholeRange
    max_frequency: NumberRange
class RoughnessKeywords(MakeShapeKeywords, total=False):
    method: Literal['spectral', 'patir', 'whitehouse', 'midpoint']
    rms: NumberRange | None
    correlation_length: NumberRange | (Sequence[Number] | NDArray[Any]) | (Sequence[Number] | NDArray[Any]) | None
    shortest: NumberRange | None
    hurst: NumberRange | None
    autocorrelation: Literal['exponential', 'gaussian', 'linear'] | None
    skewness: NumberRange
    kurtosis: NumberRange
class RoughSheetKeywords(RoughnessKeywords, total=False):
    aspect: Sequence[Number] | NDArray[Any] | None
    diameter: NumberRange | None
    lengths: Sequence[Number] | NDArray[Any] | None
class SheetKeywords(SizedKeywords, total=False):
    aspect: Sequence[Number] | NDArray[Any] | None
    roll: NumberRange
    lengths: Sequence[Number] | NDArray[Any] | None
class ShellKeywords(SizedKeywords, total=False):
    opening: NumberRange
class SierpinskiSpongeKeywords(SizedKeywords, total=False):
    kind: Literal['random', 'menger', 'sierpinski', 'carpet']
    divisions: WholeRange
    levels: WholeRange
    hole: WholeRange | None
    removed: WholeRange | None
    kept: NumberRange | None
    piece: Literal['largest', 'whole']
    edge: NumberRange | None
class SolidUnionKeywords(SizedKeywords, total=False):
    solids: WholeRange | (Sequence[Whole] | NDArray[Any])
    kinds: Sequence[Kind] | NDArray[Any]
    counts: Sequence[Whole | (Sequence[Whole] | NDArray[Any])] | NDArray[Any] | None
    lengths: Sequence[Number] | NDArray[Any]
    box: Sequence[Number | (Sequence[Number] | NDArray[Any])] | NDArray[Any] | None
    cylinder: Sequence[Number | (Sequence[Number] | NDArray[Any])] | NDArray[Any] | None
    cone: Sequence[Number | (Sequence[Number] | NDArray[Any])] | NDArray[Any] | None
    ellipsoid: Sequence[Number | (Sequence[Number] | NDArray[Any])] | NDArray[Any] | None
    sphere: NumberRange | (Sequence[Number] | NDArray[Any]) | None
    chord_error: NumberRange
class SphereAssemblyKeywords(SizedKeywords, total=False):
    base: str | Shape | Mapping[str, Any]
    arrangement: Literal['voxels', 'tetrahedra']
    spacing: NumberRange
    probability: NumberRange
    radii: NumberRange | (Sequence[Number] | NDArray[Any])
    overlap: NumberRange
    isolated: Literal['connect', 'remove']
class SphericalHarmonicsKeywords(SizedKeywords, total=False):
    like: str | Shape | Mapping[str, Any] | None
    degree: WholeRange
    roughness: NumberRange | None
    exponent: NumberRange | None
    aspect: Sequence[Number] | NDArray[Any]
    subdivisions: WholeRange
class SpherocylinderKeywords(MakeShapeKeywords, total=False):
    aspect: NumberRange | None
    diameter: NumberRange | None
    radius: NumberRange | None
    height: NumberRange | None
class SuperquadricKeywords(MakeShapeKeywords, total=False):
    e1: NumberRange
    e2: NumberRange
    aspect: Sequence[Number] | NDArray[Any] | None
    diameter: NumberRange | None
    semi_axes: Sequence[Number] | NDArray[Any] | None
    tolerance: NumberRange
class SuperspherizeKeywords(SizedKeywords, total=False):
    base: str | Shape | Mapping[str, Any]
    inflations: WholeRange
    amounts: NumberRange | (Sequence[Number] | NDArray[Any])
    radii: NumberRange | (Sequence[Number] | NDArray[Any])
    half_angles: NumberRange | (Sequence[Number] | NDArray[Any])
    spread: NumberRange
    longest_edge: NumberRange
class TabletKeywords(MakeShapeKeywords, total=False):
    aspect: NumberRange | None
    cap: NumberRange | None
    diameter: NumberRange | None
    radius: NumberRange | None
    height: NumberRange | None
    cap_height: NumberRange | None
    tolerance: NumberRange
class TorusKeywords(MakeShapeKeywords, total=False):
    aspect: NumberRange | None
    diameter: NumberRange | None
    major_radius: NumberRange | None
    minor_radius: NumberRange | None
    tolerance: NumberRange
class VoronoiFragmentKeywords(SizedKeywords, total=False):
    seeds: WholeRange
    process: Literal['random', 'jittered']
    jitter: NumberRange
    boundary: Literal['periodic', 'reflected']
    aspect: Sequence[Number] | NDArray[Any] | None
    cell: WholeRange | None
    lengths: Sequence[Number] | NDArray[Any] | None
class VoxelRainKeywords(SizedKeywords, total=False):
    cubes: WholeRange
    width: Sequence[Whole] | NDArray[Any]
    base: Literal['rectangle', 'ellipse']
    plate: WholeRange
    deposition: Literal['ballistic', 'random', 'relaxed']
    edge: NumberRange | None
@overload
def make_shape(family: Literal["box"], **keywords: Unpack[BoxKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["cone", "cylinder"], **keywords: Unpack[CylinderKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["convex_polyhedron"], **keywords: Unpack[ConvexPolyhedronKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["crumpled"], **keywords: Unpack[CrumpledKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["cube_rain"], **keywords: Unpack[CubeRainKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["disk", "sphere"], **keywords: Unpack[SphereKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["ellipsoid"], **keywords: Unpack[EllipsoidKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["hollow_cylinder"], **keywords: Unpack[HollowCylinderKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["learned"], **keywords: Unpack[LearnedKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["mollon_zhao"], **keywords: Unpack[MollonZhaoKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["mollon_zhao_2d"], **keywords: Unpack[MollonZhao2dKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["noise_star"], **keywords: Unpack[NoiseStarKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["platonic"], **keywords: Unpack[PlatonicKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["polygon"], **keywords: Unpack[PolygonKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["polyhedron"], **keywords: Unpack[PolyhedronKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["random_growth"], **keywords: Unpack[RandomGrowthKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["random_surface"], **keywords: Unpack[RandomSurfaceKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["ring"], **keywords: Unpack[RingKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["rough_sheet"], **keywords: Unpack[RoughSheetKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["sheet"], **keywords: Unpack[SheetKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["shell"], **keywords: Unpack[ShellKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["sierpinski_sponge"], **keywords: Unpack[SierpinskiSpongeKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["solid_union"], **keywords: Unpack[SolidUnionKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["sphere_assembly"], **keywords: Unpack[SphereAssemblyKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["spherical_harmonics"], **keywords: Unpack[SphericalHarmonicsKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["spherocylinder"], **keywords: Unpack[SpherocylinderKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["superquadric"], **keywords: Unpack[SuperquadricKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["superspherize"], **keywords: Unpack[SuperspherizeKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["tablet"], **keywords: Unpack[TabletKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["torus"], **keywords: Unpack[TorusKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["voronoi_fragment"], **keywords: Unpack[VoronoiFragmentKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["voxel_rain"], **keywords: Unpack[VoxelRainKeywords]) -> Shape: ...
@overload
def make_shape(family: str | Parameters, **keywords: Unpack[MakeShapeKeywords]) -> Shape: ...
@overload
def make_shapes(family: Literal["box"], *, count: Whole, **keywords: Unpack[BoxKeywords]) -> list[Shape]: ...
@overload
def make_shapes(family: Literal["cone", "cylinder"], *, count: Whole, **keywords: Unpack[CylinderKeywords]) -> list[Shape]: ...
@overload
def make_shapes(family: Literal["convex_polyhedron"], *, count: Whole, **keywords: Unpack[ConvexPolyhedronKeywords]) -> list[Shape]: ...
@overload
def make_shapes(family: Literal["crumpled"], *, count: Whole, **keywords: Unpack[CrumpledKeywords]) -> list[Shape]: ...
@overload
def make_shapes(family: Literal["cube_rain"], *, count: Whole, **keywords: Unpack[CubeRainKeywords]) -> list[Shape]: ...
@overload
def make_shapes(family: Literal["disk", "sphere"], *, count: Whole, **keywords: Unpack[SphereKeywords]) -> list[Shape]: ...
@overload
def make_shapes(family: Literal["ellipsoid"], *, count: Whole, **keywords: Unpack[EllipsoidKeywords]) -> list[Shape]: ...
@overload
def make_shapes(family: Literal["hollow_cylinder"], *, count: Whole, **keywords: Unpack[HollowCylinderKeywords]) -> list[Shape]: ...
@overload
def make_shapes(family: Literal["learned"], *, count: Whole, **keywords: Unpack[LearnedKeywords]) -> list[Shape]: ...
@overload
def make_shapes(family: Literal["mollon_zhao"], *, count: Whole, **keywords: Unpack[MollonZhaoKeywords]) -> list[Shape]: ...
@overload
def make_shapes(family: Literal["mollon_zhao_2d"], *, count: Whole, **keywords: Unpack[MollonZhao2dKeywords]) -> list[Shape]: ...
@overload
def make_shapes(family: Literal["noise_star"], *, count: Whole, **keywords: Unpack[NoiseStarKeywords]) -> list[Shape]: ...
@overload
def make_shapes(family: Literal["platonic"], *, count: Whole, **keywords: Unpack[PlatonicKeywords]) -> list[Shape]: ...
@overload
def make_shapes(family: Literal["polygon"], *, count: Whole, **keywords: Unpack[PolygonKeywords]) -> list[Shape]: ...
@overload
def make_shapes(family: Literal["polyhedron"], *, count: Whole, **keywords: Unpack[PolyhedronKeywords]) -> list[Shape]: ...
@overload
def make_shapes(family: Literal["random_growth"], *, count: Whole, **keywords: Unpack[RandomGrowthKeywords]) -> list[Shape]: ...
@overload
def make_shapes(family: Literal["random_surface"], *, count: Whole, **keywords: Unpack[RandomSurfaceKeywords]) -> list[Shape]: ...
@overload
def make_shapes(family: Literal["ring"], *, count: Whole, **keywords: Unpack[RingKeywords]) -> list[Shape]: ...
@overload
def make_shapes(family: Literal["rough_sheet"], *, count: Whole, **keywords: Unpack[RoughSheetKeywords]) -> list[Shape]: ...
@overload
def make_shapes(family: Literal["sheet"], *, count: Whole, **keywords: Unpack[SheetKeywords]) -> list[Shape]: ...
@overload
def make_shapes(family: Literal["shell"], *, count: Whole, **keywords: Unpack[ShellKeywords]) -> list[Shape]: ...
@overload
def make_shapes(family: Literal["sierpinski_sponge"], *, count: Whole, **keywords: Unpack[SierpinskiSpongeKeywords]) -> list[Shape]: ...
@overload
def make_shapes(family: Literal["solid_union"], *, count: Whole, **keywords: Unpack[SolidUnionKeywords]) -> list[Shape]: ...
@overload
def make_shapes(family: Literal["sphere_assembly"], *, count: Whole, **keywords: Unpack[SphereAssemblyKeywords]) -> list[Shape]: ...
@overload
def make_shapes(family: Literal["spherical_harmonics"], *, count: Whole, **keywords: Unpack[SphericalHarmonicsKeywords]) -> list[Shape]: ...
@overload
def make_shapes(family: Literal["spherocylinder"], *, count: Whole, **keywords: Unpack[SpherocylinderKeywords]) -> list[Shape]: ...
@overload
def make_shapes(family: Literal["superquadric"], *, count: Whole, **keywords: Unpack[SuperquadricKeywords]) -> list[Shape]: ...
@overload
def make_shapes(family: Literal["superspherize"], *, count: Whole, **keywords: Unpack[SuperspherizeKeywords]) -> list[Shape]: ...
@overload
def make_shapes(family: Literal["tablet"], *, count: Whole, **keywords: Unpack[TabletKeywords]) -> list[Shape]: ...
@overload
def make_shapes(family: Literal["torus"], *, count: Whole, **keywords: Unpack[TorusKeywords]) -> list[Shape]: ...
@overload
def make_shapes(family: Literal["voronoi_fragment"], *, count: Whole, **keywords: Unpack[VoronoiFragmentKeywords]) -> list[Shape]: ...
@overload
def make_shapes(family: Literal["voxel_rain"], *, count: Whole, **keywords: Unpack[VoxelRainKeywords]) -> list[Shape]: ...
@overload
def make_shapes(family: str | Parameters, *, count: Whole, **keywords: Unpack[MakeShapeKeywords]) -> list[Shape]: ...
class FitClumpKeywords(TypedDict, total=False):
    max_spheres: Whole | None
    target: str | None
    value: Number | None
    seed: Whole
class ClusterKeywords(FitClumpKeywords, total=False):
    radius: Number | None
    lattice: Literal['cubic', 'hexagonal']
    spacing: Number | None
    inside: Number | None
    merge: bool
class DynamicKeywords(FitClumpKeywords, total=False):
    steps: Whole
    damping: Number
    min_radius: Number
class FourPointKeywords(FitClumpKeywords, total=False):
    tolerance: Number | None
    trials: Whole
    min_radius: Number
class InnerNormalKeywords(FitClumpKeywords, total=False):
    min_radius: Number | None
    distance: Number | None
    order: Literal['largest', 'random']
class InscribedKeywords(FitClumpKeywords, total=False):
    min_radius: Number
    resolution: Number
class OptimalKeywords(FitClumpKeywords, total=False):
    mode: Literal['balanced', 'inscribed', 'bounding']
    overlap: bool
    uniform: bool
    min_radius: Number
    max_radius: Number | None
    match_volume: bool
@overload
def fit_clump(shape_or_voxels: Shape | Voxels, *, method: Literal["cluster"] = ..., **keywords: Unpack[ClusterKeywords]) -> Clump: ...
@overload
def fit_clump(shape_or_voxels: Shape | Voxels, *, method: Literal["dynamic"] = ..., **keywords: Unpack[DynamicKeywords]) -> Clump: ...
@overload
def fit_clump(shape_or_voxels: Shape | Voxels, *, method: Literal["four_point"] = ..., **keywords: Unpack[FourPointKeywords]) -> Clump: ...
@overload
def fit_clump(shape_or_voxels: Shape | Voxels, *, method: Literal["inner_normal"] = ..., **keywords: Unpack[InnerNormalKeywords]) -> Clump: ...
@overload
def fit_clump(shape_or_voxels: Shape | Voxels, *, method: Literal["inscribed"] = ..., **keywords: Unpack[InscribedKeywords]) -> Clump: ...
@overload
def fit_clump(shape_or_voxels: Shape | Voxels, *, method: Literal["optimal"] = ..., **keywords: Unpack[OptimalKeywords]) -> Clump: ...
@overload
def fit_clump(shape_or_voxels: Shape | Voxels, *, method: str | Parameters = ..., **keywords: Unpack[FitClumpKeywords]) -> Clump: ...
