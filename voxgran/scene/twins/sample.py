"""What a twin is made after: the grains of a sample, for how many each stands, and how dense they lie."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from voxgran._base.arrays import Floats, as_share
from voxgran._base.errors import InputError
from voxgran._base.units import NO_UNIT
from voxgran.measures.region import gravity_of
from voxgran.measures.registered.density import main_fraction
from voxgran.packing.jamming.expected import reachable
from voxgran.packing.model import Packing
from voxgran.shapes.learning.border import border_weights, is_scan
from voxgran.shapes.learning.sample import refuse_unread
from voxgran.shapes.learning.steps import KINDS, without_steps
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape, check_shapes
from voxgran.shapes.repairing.simplify import simplified

#: fewest grains that make a sample, the least solid fraction that rigid grains at rest bear, and how much denser than
#: spheres of their sizes at random others become
FEWEST, LOOSEST, DENSER = 10, 0.25, 0.13
#: number of sizes by which it is expected how dense they become
LAID = 1000


@dataclass(frozen=True, eq=False)
class Sample:
    """Grains of a sample at their own sizes, and how dense they lie."""

    shapes: tuple[Shape, ...]  # of the grains that no border cuts
    weights: Floats  # (n,) for how many grains each stands
    solid_fraction: float
    unit: str
    packing: Packing | None = None  # None of shapes alone
    scanned: bool = False  # whether the border of an image cuts grains
    kind: str | None = None  # of the solids that labels are without their steps, as of `without_steps`

    def laid_sizes(self, count: int) -> Floats:
        """Return the diameters (count,), in order, at the middles of equal shares of the distribution by number."""
        sizes = np.array([shape.diameter for shape in self.shapes])
        order = np.argsort(sizes, kind="stable")
        share = np.cumsum(self.weights[order]) - self.weights[order] / 2.0
        laid: Floats = np.interp((np.arange(count) + 0.5) / count, share / self.weights.sum(), sizes[order])
        return laid


def sample_of(given: Packing | Sequence[Shape], solid_fraction: float | None) -> Sample:
    """Return the sample that a packing is, or shapes with a solid fraction.

    Raises
    ------
    InputError
        If no twin can be made of it.
    """
    if isinstance(given, Packing):
        found = _of_packing(given)
    else:
        refuse_unread(given, "sample")
        shapes = tuple(check_shapes(given))
        if solid_fraction is None:
            raise InputError("solid_fraction is None and the sample is shapes only: give that of the twin")
        ones, share = np.ones(len(shapes)), as_share(solid_fraction, "solid_fraction")
        found = Sample(shapes, ones, share, next((one.unit for one in shapes if one.unit), NO_UNIT))
    wanted = found.solid_fraction if solid_fraction is None else as_share(solid_fraction, "solid_fraction")
    _check(found, given, wanted)
    return found


def _of_packing(packing: Packing) -> Sample:
    """Return the sample that a packing is: its whole grains, and the solid fraction of its bulk."""
    scanned, weights = is_scan(packing), border_weights(packing)
    if packing.count and not weights.any():
        raise InputError(
            f"all {packing.count} grains of the sample are cut by the border of the image: no whole grain is known; "
            "take a larger part of the scan"
        )
    kept = np.flatnonzero(weights)
    share = solid_fraction_of(packing)
    own = [packing.shapes[k] for k in packing.shape_id[kept]]
    shapes = tuple(one.scaled(factor) for one, factor in zip(own, packing.scale[kept].tolist(), strict=True))
    return Sample(shapes, weights[kept], share, packing.unit, packing, scanned)


def resolved(sample: Sample, faces: int, kind: str | None = None) -> Sample:
    """Return a sample at the resolution of twins, with meshes of at most so many faces: grains of an image without its
    steps, as solids of a kind that was found before, if there is one.
    """
    if not all(isinstance(shape.geometry, Mesh) for shape in sample.shapes):
        return sample
    found, shapes = without_steps(sample.shapes, sample.weights, faces, tuple(KINDS) if kind is None else (kind,))
    return replace(sample, shapes=simplified(shapes, faces), kind=found)


def solid_fraction_of(packing: Packing) -> float:
    """Return the solid fraction of the bulk: a scan without gravity is bulk up to its border, where grains are cut."""
    whole = is_scan(packing) and gravity_of(packing) is None
    return packing.solid_fraction if whole else main_fraction(packing)[1]


def _check(sample: Sample, given: object, wanted: float) -> None:
    """Refuse a sample of which no twin can be made."""
    count = len(sample.shapes)
    if any(shape.is_open for shape in sample.shapes):
        raise InputError("the sample holds open surfaces, which have no volume: close them with repair first")
    if count < FEWEST:
        cut = "" if not isinstance(given, Packing) else f" of {given.count}, those that no border cuts,"
        raise InputError(f"the sample has {count} whole grains{cut} and a twin needs {FEWEST} at least: give more")
    densest = reachable(sample.laid_sizes(LAID), 3) + DENSER
    if not LOOSEST <= wanted <= densest:
        raise InputError(
            f"the solid fraction is {wanted:.3g} (porosity {1 - wanted:.3g}) and rigid grains of these sizes rest with "
            f"{LOOSEST:g} to {densest:.2g}: give solid_fraction, or check how the image was segmented"
        )
