"""Types of the functions that take a name with keywords: one overload for each name.

This file is made by tests/unit/test_public_names.py from the parameter classes. An overload for names that are not
known here takes no parameters, since it would accept misspelt ones: methods of others are given as parameter objects.
"""

import os
from collections.abc import Mapping, Sequence
from typing import Any, Literal, TypedDict, Unpack, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from voxgran._base.calls import Parameters
from voxgran._base.progress import OnStep
from voxgran.clumps.model import Clump
from voxgran.containers.model import Container
from voxgran.packing.driver import Recorder
from voxgran.packing.model import Packing
from voxgran.settling.parameters import Lid, Settling, Shaking
from voxgran.shapes.families.solid_union import Kind
from voxgran.shapes.model import Shape
from voxgran.shapes.size_laws import SizeDistribution
from voxgran.voxels.model import Voxels

Whole = int | np.integer[Any]
Number = float | np.floating[Any] | np.integer[Any]

class PackKeywords(TypedDict, total=False):
    count: Whole | None
    solid_fraction: Number | None
    sizes: SizeDistribution | None
    weights: ArrayLike | None
    weights_by: str
    seed: Whole
    start: Packing | None
    unit: str | None
    density: Number | None
    checkpoint: str | os.PathLike[str] | None
    resume: bool
    time_limit: Number | None
    on_step: OnStep | None
    recorder: Recorder | None
    settle: bool | Mapping[str, Any] | Settling | None

class VoronoiFillKeywords(PackKeywords, total=False):
    fill: Literal["shapes", "cells"]
    smoothing: Whole
    orientations: Whole
    rounds: Whole

class TetrahedralKeywords(PackKeywords, total=False):
    edge: Number | None
    smallest: Number | None
    largest: Number | None
    jitter: Number
    mesh: str | None

class RsaKeywords(PackKeywords, total=False):
    scheme: Literal["classic", "1", "2", "3", "4a", "4b", "4c", "4d"]
    until: Literal["tries", "saturated"] | None
    tries: Whole
    retry: Literal["scan", "next"]
    corrections: Whole
    order: Literal["given", "largest", "random"]
    along: Literal["x", "y", "z"]
    numbers: Literal["philox", "lcg"]
    aligned: bool

class RandomApollonianKeywords(PackKeywords, total=False):
    smallest: Number | None
    largest: Number | None
    shift: Whole
    shrink: Number

class MultilayerKeywords(PackKeywords, total=False):
    layers: Whole
    undercompaction: Number

class JamKeywords(PackKeywords, total=False):
    growth_rate: Number
    keep: Literal["container", "sizes"]

class GrowthKeywords(PackKeywords, total=False):
    arrival: Literal["together", "continuous"]
    slowest: Number
    speed: Number

class GravityKeywords(PackKeywords, total=False):
    friction: Number
    restitution: Number
    shaking: Shaking | None
    lid: Lid | None
    fall_time: Number | None
    rest: Number
    parts: Literal["exact", "hulls"]
    gravity: Literal["-x", "+x", "-y", "+y", "-z", "+z"] | (Sequence[Number] | NDArray[Any]) | None
    fill: Number
    height: Number | None

class ExpandKeywords(PackKeywords, total=False):
    growth_rate: Number

class DigitalRsaKeywords(PackKeywords, total=False):
    voxel_size: Number | None
    cover: Literal["touch", "center"]
    turned: bool
    orientations: Whole

class DigitalFillKeywords(PackKeywords, total=False):
    voxel_size: Number | None
    cover: Literal["touch", "center"]
    turned: bool
    orientations: Whole
    place: Literal["lowest", "contact", "wall"]
    gravity: Literal["-x", "+x", "-y", "+y", "-z", "+z", "none"] | None
    order: Literal["random", "largest"]

class DigitalKeywords(PackKeywords, total=False):
    sweeps: Whole
    cycles: Whole | None
    period: Whole | None
    decay: Number | None
    gravity: Literal["-x", "+x", "-y", "+y", "-z", "+z", "none"] | (Sequence[Number] | NDArray[Any]) | None
    feed: Literal["rain", "layers", "at_once"]
    rate: Number
    layer_sweeps: Whole
    lid: bool
    voxel_size: Number | None
    cover: Literal["touch", "center"]
    downward_share: Number
    vibration_up: Number
    rotation_share: Number
    orientations: Whole
    guided: Number
    schedule: Literal["random", "sorted", "sleeping"]

class DepositionKeywords(PackKeywords, total=False):
    sticking: Number
    toward: Literal["floor", "center"]
    drops: Whole

class ControlPointKeywords(PackKeywords, total=False):
    sweeps: Whole
    cycles: Whole | None
    period: Whole | None
    decay: Number | None
    gravity: Literal["-x", "+x", "-y", "+y", "-z", "+z", "none"] | (Sequence[Number] | NDArray[Any]) | None
    feed: Literal["rain", "layers", "at_once"]
    rate: Number
    layer_sweeps: Whole
    lid: bool
    spacing: Number
    contact: Literal["sdf", "kdtree"]
    points: Literal["surface", "all"]
    tested_points: Literal["both", "one"]
    distance: Number
    overlap: Number
    gravity_bias: Number
    vibration_up: Number
    rotation_share: Number
    step: Number

class ApollonianKeywords(PackKeywords, total=False):
    smallest: Number | None

class AdvancingFrontKeywords(PackKeywords, total=False):
    mode: Literal["loose", "dense"]
    order: Literal["random", "nearest", "lowest"]
    tries: Whole
    grow: Number

@overload
def pack(
    shapes: Sequence[Shape] | Shape,
    container: Container,
    method: Literal["advancing_front"],
    **keywords: Unpack[AdvancingFrontKeywords],
) -> Packing: ...
@overload
def pack(
    shapes: Sequence[Shape] | Shape,
    container: Container,
    method: Literal["apollonian"],
    **keywords: Unpack[ApollonianKeywords],
) -> Packing: ...
@overload
def pack(
    shapes: Sequence[Shape] | Shape,
    container: Container,
    method: Literal["control_point"],
    **keywords: Unpack[ControlPointKeywords],
) -> Packing: ...
@overload
def pack(
    shapes: Sequence[Shape] | Shape,
    container: Container,
    method: Literal["deposition"],
    **keywords: Unpack[DepositionKeywords],
) -> Packing: ...
@overload
def pack(
    shapes: Sequence[Shape] | Shape,
    container: Container,
    method: Literal["digital"],
    **keywords: Unpack[DigitalKeywords],
) -> Packing: ...
@overload
def pack(
    shapes: Sequence[Shape] | Shape,
    container: Container,
    method: Literal["digital_fill"],
    **keywords: Unpack[DigitalFillKeywords],
) -> Packing: ...
@overload
def pack(
    shapes: Sequence[Shape] | Shape,
    container: Container,
    method: Literal["digital_rsa"],
    **keywords: Unpack[DigitalRsaKeywords],
) -> Packing: ...
@overload
def pack(
    shapes: Sequence[Shape] | Shape, container: Container, method: Literal["expand"], **keywords: Unpack[ExpandKeywords]
) -> Packing: ...
@overload
def pack(
    shapes: Sequence[Shape] | Shape,
    container: Container,
    method: Literal["gravity"],
    **keywords: Unpack[GravityKeywords],
) -> Packing: ...
@overload
def pack(
    shapes: Sequence[Shape] | Shape, container: Container, method: Literal["growth"], **keywords: Unpack[GrowthKeywords]
) -> Packing: ...
@overload
def pack(
    shapes: Sequence[Shape] | Shape, container: Container, method: Literal["jam"], **keywords: Unpack[JamKeywords]
) -> Packing: ...
@overload
def pack(
    shapes: Sequence[Shape] | Shape,
    container: Container,
    method: Literal["multilayer"],
    **keywords: Unpack[MultilayerKeywords],
) -> Packing: ...
@overload
def pack(
    shapes: Sequence[Shape] | Shape,
    container: Container,
    method: Literal["random_apollonian"],
    **keywords: Unpack[RandomApollonianKeywords],
) -> Packing: ...
@overload
def pack(
    shapes: Sequence[Shape] | Shape, container: Container, method: Literal["rsa"], **keywords: Unpack[RsaKeywords]
) -> Packing: ...
@overload
def pack(
    shapes: Sequence[Shape] | Shape,
    container: Container,
    method: Literal["tetrahedral"],
    **keywords: Unpack[TetrahedralKeywords],
) -> Packing: ...
@overload
def pack(
    shapes: Sequence[Shape] | Shape,
    container: Container,
    method: Literal["voronoi_fill"],
    **keywords: Unpack[VoronoiFillKeywords],
) -> Packing: ...
@overload
def pack(
    shapes: Sequence[Shape] | Shape, container: Container, method: str | Parameters, **keywords: Unpack[PackKeywords]
) -> Packing: ...

class MakeShapeKeywords(TypedDict, total=False):
    seed: Whole

class SphereKeywords(MakeShapeKeywords, total=False):
    diameter: Number | None
    radius: Number | None

class SolidUnionKeywords(MakeShapeKeywords, total=False):
    solids: Whole | (Sequence[Whole] | NDArray[Any])
    kinds: Sequence[Kind] | NDArray[Any]
    lengths: Sequence[Number] | NDArray[Any]
    diameter: Number | None

class ShellKeywords(MakeShapeKeywords, total=False):
    opening: Number
    diameter: Number | None

class SheetKeywords(MakeShapeKeywords, total=False):
    aspect: Sequence[Number] | NDArray[Any] | None
    roll: Number
    diameter: Number | None
    lengths: Sequence[Number] | NDArray[Any] | None

class RandomSurfaceKeywords(MakeShapeKeywords, total=False):
    aspect: Sequence[Number] | NDArray[Any]
    height: Number
    waves: Whole
    max_frequency: Number
    diameter: Number | None

class PolygonKeywords(MakeShapeKeywords, total=False):
    corners: Whole | None
    stretch: Number | None
    diameter: Number | None
    vertices: Sequence[Sequence[Number] | NDArray[Any]] | NDArray[Any] | None

class PlatonicKeywords(MakeShapeKeywords, total=False):
    solid: Literal["tetrahedron", "cube", "octahedron", "dodecahedron", "icosahedron"]
    diameter: Number | None

class EllipsoidKeywords(MakeShapeKeywords, total=False):
    aspect: Sequence[Number] | NDArray[Any] | None
    diameter: Number | None
    semi_axes: Sequence[Number] | NDArray[Any] | None

class DiskKeywords(MakeShapeKeywords, total=False):
    diameter: Number | None
    radius: Number | None

class CylinderKeywords(MakeShapeKeywords, total=False):
    aspect: Number | None
    diameter: Number | None
    radius: Number | None
    height: Number | None

class ConvexPolyhedronKeywords(MakeShapeKeywords, total=False):
    points: Whole
    aspect: Sequence[Number] | NDArray[Any]
    diameter: Number | None

class ConeKeywords(MakeShapeKeywords, total=False):
    aspect: Number | None
    diameter: Number | None
    radius: Number | None
    height: Number | None

class BoxKeywords(MakeShapeKeywords, total=False):
    aspect: Sequence[Number] | NDArray[Any] | None
    diameter: Number | None
    lengths: Sequence[Number] | NDArray[Any] | None

@overload
def make_shape(family: Literal["box"], **keywords: Unpack[BoxKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["cone"], **keywords: Unpack[ConeKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["convex_polyhedron"], **keywords: Unpack[ConvexPolyhedronKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["cylinder"], **keywords: Unpack[CylinderKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["disk"], **keywords: Unpack[DiskKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["ellipsoid"], **keywords: Unpack[EllipsoidKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["platonic"], **keywords: Unpack[PlatonicKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["polygon"], **keywords: Unpack[PolygonKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["random_surface"], **keywords: Unpack[RandomSurfaceKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["sheet"], **keywords: Unpack[SheetKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["shell"], **keywords: Unpack[ShellKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["solid_union"], **keywords: Unpack[SolidUnionKeywords]) -> Shape: ...
@overload
def make_shape(family: Literal["sphere"], **keywords: Unpack[SphereKeywords]) -> Shape: ...
@overload
def make_shape(family: str | Parameters, **keywords: Unpack[MakeShapeKeywords]) -> Shape: ...

class FitClumpKeywords(TypedDict, total=False):
    max_spheres: Whole | None
    target: str | None
    value: Number | None
    seed: Whole

class OptimalKeywords(FitClumpKeywords, total=False):
    mode: Literal["balanced", "inscribed", "bounding"]
    overlap: bool
    uniform: bool
    min_radius: Number
    max_radius: Number | None
    match_volume: bool

class InscribedKeywords(FitClumpKeywords, total=False):
    min_radius: Number
    resolution: Number

class InnerNormalKeywords(FitClumpKeywords, total=False):
    min_radius: Number | None
    distance: Number | None
    order: Literal["largest", "random"]

class FourPointKeywords(FitClumpKeywords, total=False):
    tolerance: Number | None
    trials: Whole
    min_radius: Number

class DynamicKeywords(FitClumpKeywords, total=False):
    steps: Whole
    damping: Number
    min_radius: Number

class ClusterKeywords(FitClumpKeywords, total=False):
    radius: Number | None
    lattice: Literal["cubic", "hexagonal"]
    spacing: Number | None
    inside: Number | None
    merge: bool

@overload
def fit_clump(
    shape_or_voxels: Shape | Voxels, *, method: Literal["cluster"] = ..., **keywords: Unpack[ClusterKeywords]
) -> Clump: ...
@overload
def fit_clump(
    shape_or_voxels: Shape | Voxels, *, method: Literal["dynamic"] = ..., **keywords: Unpack[DynamicKeywords]
) -> Clump: ...
@overload
def fit_clump(
    shape_or_voxels: Shape | Voxels, *, method: Literal["four_point"] = ..., **keywords: Unpack[FourPointKeywords]
) -> Clump: ...
@overload
def fit_clump(
    shape_or_voxels: Shape | Voxels, *, method: Literal["inner_normal"] = ..., **keywords: Unpack[InnerNormalKeywords]
) -> Clump: ...
@overload
def fit_clump(
    shape_or_voxels: Shape | Voxels, *, method: Literal["inscribed"] = ..., **keywords: Unpack[InscribedKeywords]
) -> Clump: ...
@overload
def fit_clump(
    shape_or_voxels: Shape | Voxels, *, method: Literal["optimal"] = ..., **keywords: Unpack[OptimalKeywords]
) -> Clump: ...
@overload
def fit_clump(
    shape_or_voxels: Shape | Voxels, *, method: str | Parameters = ..., **keywords: Unpack[FitClumpKeywords]
) -> Clump: ...
