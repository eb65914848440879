"""Assemblies of spheres that fill a volume: clumps by birth.

A regular arrangement of points fills a base volume, which may be random itself: the centers of voxels, or the nodes of
a mesh of nearly regular tetrahedra (a body-centered cubic lattice whose points are moved a little at random). Each
point gets a sphere with a given probability. Spheres that belong to no other part of the assembly grow until they do,
along the edges of a minimum spanning tree of the gaps (Kruskal 1956, doi:10.1090/S0002-9939-1956-0078686-7), or are
removed.

The true geometry is the union of the spheres, whose volume is exact and which reach beyond the base volume by up to
their radius.

References
----------
Sajjadi & Khalili 2015, Generating, Reproducing and Packaging of Random Volumes for Discrete Element Analysis of
Discontinuous Materials: spheres at the voxels or mesh nodes of a volume (section 3-1-2)
"""

import math
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers, as_number, as_positive
from voxgran._base.config import check_bounds, parameter, parameter_class
from voxgran._base.errors import InputError
from voxgran._base.lazy import load
from voxgran.geometry.sphere_pairs import near_pairs
from voxgran.lattice.label import components
from voxgran.shapes.family import ShapeFamily, Sized, sized
from voxgran.shapes.generating.base import check_base, made_base
from voxgran.shapes.model import Shape
from voxgran.shapes.spheres import Spheres

#: largest distance along each axis by which a node of tetrahedra is moved, in spacings
JITTER = 0.1
#: largest radius of a sphere, in spacings
LARGEST = 3.0
#: part of a radius by which spheres that just touch may be apart
ROUNDING = 1e-12


@parameter_class
class SphereAssembly(Sized):
    """Parameters of an assembly of spheres.

    Parameters
    ----------
    base
        volume that is filled: a family, a table of family, seed and its parameters, or a Shape.
    arrangement
        points that fill the volume: centers of voxels, or nodes of nearly regular tetrahedra.
    spacing
        distance of neighbouring points, in equivalent diameters of the base.
    probability
        probability that a point gets a sphere.
    radii
        radius of all spheres in spacings, or a range from which each is drawn uniformly; at most 3.
    overlap
        least depth by which two spheres of one piece overlap, in radii of the smaller; at 0 they may just touch.
    isolated
        what becomes of spheres apart from the others: they grow until all are one piece, or only the largest piece
        remains.

    Raises
    ------
    UnknownNameError
        If the base is the name of no family.
    InputError
        If a number is out of range, or the base is no solid.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.shapes.sphere_assembly(base="sphere", spacing=0.4, seed=1)
    Shape('sphere_assembly', spheres, diameter=1)
    """

    base: str | Shape | Mapping[str, Any] = parameter("solid_union")
    arrangement: Literal["voxels", "tetrahedra"] = parameter("voxels")
    spacing: float = parameter(0.15, at_least=0.03, at_most=0.5)
    probability: float = parameter(0.7, above=0.0, at_most=1.0)
    radii: float | tuple[float, float] = parameter((0.6, 0.9))
    overlap: float = parameter(0.2, at_least=0.0, at_most=0.9)
    isolated: Literal["connect", "remove"] = parameter("connect")

    def __post_init__(self) -> None:
        """Check the ranges and the base."""
        check_bounds(self)
        low, high = self.radii if isinstance(self.radii, tuple) else (self.radii, self.radii)
        as_number(low, "radii", above=0.0, at_most=min(as_positive(high, "radii"), LARGEST))
        as_number(high, "radii", at_most=LARGEST)
        check_base(self.base)


def make(parameters: SphereAssembly, generator: np.random.Generator) -> Shape:
    """Return a random assembly."""
    base = made_base(parameters.base, generator)
    spacing = parameters.spacing * base.diameter
    points = _points(base, spacing, parameters.arrangement, generator)
    draw = generator.random(len(points))
    # the smallest number decides where no point would get a sphere
    centers = points[(draw < parameters.probability) | (draw == draw.min())]
    low, high = parameters.radii if isinstance(parameters.radii, tuple) else (parameters.radii, parameters.radii)
    radii = (low + (high - low) * generator.random(len(centers))) * spacing
    if parameters.isolated == "connect":
        radii = connected(centers, radii, parameters.overlap)
    else:
        piece = pieces(centers, radii, parameters.overlap)
        keep = piece == np.bincount(piece).argmax()
        centers, radii = centers[keep], radii[keep]
    record = {"base": base.name, "points": len(points)}
    return sized(Spheres(centers, radii), parameters.diameter, name="sphere_assembly", record=record)


def pieces(centers: Floats, radii: Floats, overlap: float) -> Integers:
    """Return the piece (n,) of each sphere; spheres that overlap deep enough are of one piece."""
    i, j, _ = _gaps(centers, radii, overlap, 0.0)
    return components(len(radii), i, j)


def connected(centers: Floats, radii: Floats, overlap: float) -> Floats:
    """Return radii (n,) with which all spheres are one piece; those at gaps of a minimum spanning tree grow."""
    reach = 0.0
    i, j, gap = _gaps(centers, radii, overlap, reach)
    while components(len(radii), i, j).any():
        reach = 2.0 * reach + float(radii.max())
        i, j, gap = _gaps(centers, radii, overlap, reach)
    grown = radii.copy()
    if reach == 0.0:
        return grown
    # no weight is 0, which would stand for no edge; SciPy 1.13 takes indices of 32 bits only
    pairs = i.astype(np.int32), j.astype(np.int32)
    weights = load("scipy.sparse").coo_array((gap - gap.min() + float(radii.max()), pairs), shape=(len(radii),) * 2)
    tree = load("scipy.sparse.csgraph").minimum_spanning_tree(weights).tocoo()
    for one, two in zip(tree.row, tree.col, strict=True):
        smaller = min(grown[one], grown[two])
        missing = math.dist(centers[one], centers[two]) - (grown[one] + grown[two] - overlap * smaller)
        if missing > 0.0:
            # both grow alike, and so does the overlap that they need
            grown[[one, two]] += (1.0 + ROUNDING) * missing / (2.0 - overlap)
    return grown


def _gaps(centers: Floats, radii: Floats, overlap: float, reach: float) -> tuple[Integers, Integers, Floats]:
    """Return all pairs (m,) of spheres that are short of their overlap by at most `reach`, and by how much."""
    slack = ROUNDING * float(radii.max())
    i, j, _ = near_pairs(centers, radii, reach + slack)
    apart = linear.norm(centers[i] - centers[j], axis=1)
    gap = apart - (radii[i] + radii[j] - overlap * np.minimum(radii[i], radii[j]))
    near = gap <= reach + slack
    return i[near], j[near], gap[near]


def _points(base: Shape, spacing: float, arrangement: str, generator: np.random.Generator) -> Floats:
    """Return the points (n, 3) of a randomly shifted arrangement inside a base volume."""
    low, high = base.bounds
    edge = spacing if arrangement == "voxels" else 2.0 / math.sqrt(3.0) * spacing
    low = low - edge * generator.random(3)
    number = np.ceil((high - low) / edge).astype(np.int64) + 1
    points = low + edge * np.stack(np.meshgrid(*map(np.arange, number), indexing="ij"), axis=-1).reshape(-1, 3)
    if arrangement == "tetrahedra":
        points = np.concatenate([points, points - edge / 2])
        points = points + JITTER * spacing * (2.0 * generator.random(points.shape) - 1.0)
    points = points[base.contains(points)]
    if not len(points):
        raise InputError(
            f"spacing is {spacing / base.diameter:.6g}: no point lies inside base {base.name!r}, which is too thin; "
            f"try {spacing / base.diameter / 2:.3g}"
        )
    return points


registration = ShapeFamily(
    summary="spheres at the voxels or mesh nodes of a volume, connected",
    parameters=SphereAssembly,
    make=make,
    source="Sajjadi & Khalili 2015, Generating, Reproducing and Packaging of Random Volumes for Discrete Element "
    "Analysis of Discontinuous Materials",
    random=True,
    libraries=("manifold3d",),
)
