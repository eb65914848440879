"""A sample beside its twin in numbers and curves, each with the scatter that a packing of its size has.

A packing is cut into eight blocks. The standard deviation of a number over the blocks, over the root of their number,
is its scatter: what another part of the same material would differ by. What is read from images is read from both at
the same voxel.
"""

import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran.io.image import to_image
from voxgran.lattice.along_lines import chord_lengths, two_point_correlation
from voxgran.lattice.diffusion import effective_diffusivity
from voxgran.lattice.necks import touching
from voxgran.measures.describe import describe
from voxgran.measures.pair_window import PairWindow
from voxgran.measures.region import BoxRegion, Regions, gravity_of
from voxgran.measures.registered.coordination import mean_diameter
from voxgran.measures.registered.fabric import long_axes
from voxgran.measures.registered.local_density import local_density
from voxgran.measures.registered.rdf import radial_distribution
from voxgran.packing.model import Packing
from voxgran.scene.twins.differences import dataset_of
from voxgran.scene.twins.sample import Sample, solid_fraction_of
from voxgran.shapes.learning.border import border_weights, is_scan
from voxgran.shapes.learning.steps import voxel_of

if TYPE_CHECKING:
    from xarray import Dataset

#: voxels of a mean diameter where no scan says it, and most voxels of an image
ACROSS, MOST_VOXELS = 20, 1_000_000
#: most voxels of the image in which labels touch: where it is coarser than the scan, of which the surfaces have the
#: steps, grains of the scan have up to one contact more than the same without steps
MOST_COUNTED = 30_000_000
#: distance from walls, in mean diameters, at which the bulk begins; reach of curves and step of g(r) in mean diameters
INSET, REACH, STEP = 1.5, 2.5, 0.1
#: shares of the curve of the gradation and of its numbers
SHARES, PASSING = np.linspace(0.02, 0.98, 49), (0.1, 0.5, 0.9)
#: contact gap, in mean diameters, above which contacts are counted in an image, and faces of voxels that make one.
#: Of known packings as images of 10 to 30 voxels per diameter, segmented, one face gives 0.7 to 1.9 contacts too many,
#: two 0.1 to 1.7, and images of the true labels the same within 0.06 on average. More than two faces depend more on the
#: voxel and on the segmentation, and lose contacts of corners.
NEAR, SHARED = 0.01, 2
#: number of blocks
BLOCKS = 8
FORMS = ("sphericity", "elongation", "flatness", "convexity", "roundness")

Values = dict[str, Any]


@dataclass(frozen=True, slots=True)
class _Scale:
    """Lengths by which the sample and the twin are both measured."""

    voxel: float
    gap: float  # up to which grains touch
    by_faces: bool  # whether the grains that touch are those with faces of voxels in common
    reach: float  # of curves
    inner: float  # distance from walls of the centroids whose pairs count
    far: float  # of g(r), and its step
    step: float
    edges: Floats  # (3,) of the voxels that may have faces in common


@dataclass(frozen=True, eq=False)
class _Known:
    """What of a packing is found once: numbers of its grains and contacts, and the image of its bulk."""

    grains: dict[str, Floats]  # by name, (n,), with their places (n, 3), weights and volumes
    normals: Floats  # (m, 3) of contacts
    points: Floats  # (m, 3)
    image: Integers  # (nx, ny, nz) labels of the bulk
    lower: Floats  # corner of the bulk
    upper: Floats
    voxel: float
    axis: int  # along gravity
    periodic: tuple[bool, ...]


def comparison_of(sample: Sample, twins: Sequence[Packing], voxel_size: float | None) -> "Dataset":
    """Return the measures of a sample and of its twins along the dimension ``measure``, and their curves."""
    given = sample.packing
    packings = [*(() if given is None else (given,)), *twins]
    diameter = float(np.average([shape.diameter for shape in sample.shapes], weights=sample.weights))
    label = None if given is None else voxel_of(given.shapes[0])
    usual = given.contact_gap if given is not None and (sample.scanned or label is not None) else diameter / ACROSS
    bulks = [_bulk(packing) for packing in packings]
    room = max(float(np.prod(upper - lower)) for lower, upper in bulks)
    inner = max(mean_diameter(packing) for packing in packings)
    # of both the same gap is that up to which grains touch
    gap = max(packing.contact_gap for packing in packings)
    voxel = max(usual, (room / MOST_VOXELS) ** (1 / 3)) if voxel_size is None else voxel_size
    scale = _Scale(
        voxel=voxel,
        gap=gap,
        by_faces=gap > NEAR * diameter,
        reach=min(REACH * diameter, *(0.5 * float((upper - lower).min()) for lower, upper in bulks)),
        inner=inner,
        far=min(REACH * diameter, *(PairWindow.of(one, inner, rise=inner).reach for one in packings)),
        step=STEP * diameter,
        edges=np.full(3, voxel) if label is None else label * max(room / label.prod() / MOST_COUNTED, 1.0) ** (1 / 3),
    )
    with warnings.catch_warnings(action="ignore"):
        made = [_measured(one, sample, scale) for one in twins]
        first = _of_shapes(sample) if given is None else _measured(given, sample, scale)
    return dataset_of(first, made, sample.unit, SHARES)


def _of_shapes(sample: Sample) -> tuple[Values, Values]:
    """Return what is known of shapes alone, and its scatter."""
    forms = describe(sample.shapes, FORMS)
    sizes = np.array([shape.diameter for shape in sample.shapes])
    grains = {"weight": sample.weights, "diameter": sizes, "volume": np.pi / 6 * libm.power(sizes, 3)}
    grains |= {name: np.asarray(forms[name].values, dtype=np.float64) for name in FORMS}
    turn = np.arange(len(sizes)) % BLOCKS
    parts = [_grain_values(grains, turn == k) for k in range(BLOCKS)]
    whole = _grain_values(grains, turn >= 0)
    scatter = {name: _scatter([part[name] for part in parts]) for name in whole}
    return whole | {"solid_fraction": sample.solid_fraction}, scatter | {"solid_fraction": 0.0}


def _bulk(packing: Packing) -> tuple[Floats, Floats]:
    """Return the corners of the bulk: a scan up to its border, others at a distance from walls and below the height."""
    inset = 0.0 if is_scan(packing) else INSET * mean_diameter(packing)
    region = Regions(packing).at(inset)
    lower, upper = (np.array(one) for one in packing.container.bounds)
    if isinstance(region, BoxRegion):
        return (region.lower, region.upper) if region.volume > 0 else (lower, upper)
    middle, half = (lower + upper) / 2.0, (upper - lower) / 2.0
    corners = np.array(list(product((-1.0, 1.0), repeat=3)))
    for factor in np.linspace(1.0, 0.1, 91):
        if (packing.container.signed_distance(middle + factor * half * corners) <= -inset).all():
            break
    lower, upper = middle - factor * half, middle + factor * half
    limits = Regions(packing).limits
    return np.maximum(lower, limits[0]), np.minimum(upper, limits[1])


def _measured(packing: Packing, sample: Sample, scale: _Scale) -> tuple[Values, Values]:
    """Return the numbers and curves of a packing, and their scatter."""
    known = _known_of(packing, sample, scale)
    lags = np.arange(0.0, scale.reach, scale.voxel)
    whole = _values(known, (known.lower, known.upper), lags)
    parts = [_values(known, block, lags) for block in _blocks(known)]
    scatter = {name: _scatter([part[name] for part in parts]) for name in whole}
    whole["solid_fraction"] = sample.solid_fraction if packing is sample.packing else solid_fraction_of(packing)
    found = radial_distribution(packing, reach=scale.far, step=scale.step, inset=scale.inner)
    whole["radial_distribution"], scatter["radial_distribution"] = found.g, found.error
    peak = int(np.nanargmax(found.g)) if np.isfinite(found.g).any() else 0
    whole["radial_peak"], scatter["radial_peak"] = float(found.g[peak]), float(found.error[peak])
    return whole | {"distance": found.middle, "lag": lags}, scatter


def _scatter(parts: Sequence[Any]) -> Any:
    """Return the standard error of the mean of a number or a curve over blocks, NaN of fewer than two that know it."""
    rows = np.array(parts, dtype=np.float64)
    many = np.isfinite(rows).sum(axis=0)
    spread = np.sqrt(np.nanmean((rows - np.nanmean(rows, axis=0)) ** 2, axis=0))
    return np.where(many > 1, spread / np.sqrt(np.maximum(many - 1, 1)), np.nan)


def _known_of(packing: Packing, sample: Sample, scale: _Scale) -> _Known:
    """Find what the blocks of a packing share."""
    lower, upper = _bulk(packing)
    weights = border_weights(packing)
    contacts, voxel = packing.contacts(scale.gap), scale.voxel
    image = to_image(packing, voxel)
    number = np.bincount(np.concatenate([contacts.i, contacts.j]), minlength=packing.count)
    if scale.by_faces:
        # a grain smaller than a voxel has none
        number = np.zeros(packing.count, dtype=np.int64)
        labels = image if np.allclose(scale.edges, voxel) else to_image(packing, scale.edges)
        seen = touching(labels, packing.container.periodic, faces=SHARED)[1:]
        number[: len(seen)] = seen
    forms = _forms(packing, sample, weights)
    axes, owner = long_axes(packing)
    along = np.full((packing.count, 3), np.nan)
    along[owner] = axes / linear.norm(axes, axis=1)[:, None]
    grains = {
        "place": packing.position, "weight": weights, "diameter": packing.diameters, "volume": packing.volumes,
        "coordination_number": number.astype(np.float64),
        "local_solid_fraction": local_density(packing).solid_fraction,
        **forms,
        **{f"long_axes_{'xyz'[k]}": along[:, k] ** 2 for k in range(3)},
    }  # fmt: skip
    first = np.maximum(np.round((lower - packing.container.bounds[0]) / voxel), 0).astype(int)
    last = np.maximum(np.round((upper - packing.container.bounds[0]) / voxel).astype(int), first + 4)
    gravity = gravity_of(packing)
    axis = 2 if gravity is None else gravity[0]
    cut = image[tuple(slice(a, b) for a, b in zip(first, last, strict=True))]
    return _Known(grains, contacts.normal, contacts.point, cut, lower, upper, voxel, axis, packing.container.periodic)


def _forms(packing: Packing, sample: Sample, weights: Floats) -> dict[str, Floats]:
    """Return the descriptors of the grains, of a sample by its shapes, which have the resolution of the twin."""
    own = packing is sample.packing
    kept = weights > 0
    known = describe(sample.shapes if own else packing[kept], FORMS)
    found = {name: np.full(packing.count, np.nan) for name in FORMS}
    for name, values in found.items():
        values[kept] = known[name].values
    return found


def _blocks(known: _Known) -> Iterator[tuple[Floats, Floats]]:
    """Yield the corners of the eight blocks of the bulk."""
    half = (known.upper - known.lower) / 2.0
    for corner in product((0, 1), repeat=3):
        lower = known.lower + half * corner
        yield lower, lower + half


def _values(known: _Known, block: tuple[Floats, Floats], lags: Floats) -> Values:
    """Return all numbers and curves of a block."""
    lower, upper = block
    found = _grain_values(known.grains, _in(known.grains["place"], lower, upper, known))
    normals = known.normals[_in(known.points, lower, upper, known)]
    second = (normals**2).mean(axis=0) if len(normals) else np.full(3, np.nan)
    found |= {f"contact_normals_{'xyz'[k]}": float(second[k]) for k in range(3)}
    first = np.round((lower - known.lower) / known.voxel).astype(int)
    last = np.maximum(np.round((upper - known.lower) / known.voxel).astype(int), first + 2)
    part = known.image[tuple(slice(a, b) for a, b in zip(first, last, strict=True))]
    return found | _image_values(part, known, lags)


def _grain_values(grains: Mapping[str, Floats], chosen: Booleans) -> Values:
    """Return means over chosen grains, by their weights, and the sizes that shares of their volume pass."""
    held = chosen & (grains["weight"] > 0)
    weight, found = grains["weight"][held], {}
    for name, values in grains.items():
        if name not in ("place", "weight", "volume", "diameter"):
            found[name] = _mean(values[held], weight)
    if "local_solid_fraction" in grains:
        square = _mean((grains["local_solid_fraction"][held] - found["local_solid_fraction"]) ** 2, weight)
        found["local_solid_fraction_std"] = math.sqrt(square)
    passing = _passing(grains["diameter"][held], weight * grains["volume"][held], np.array([*PASSING, *SHARES]))
    found |= {f"D{round(100 * share)}": float(size) for share, size in zip(PASSING, passing, strict=False)}
    return found | {"gradation": passing[len(PASSING) :]}


def _image_values(part: Integers, known: _Known, lags: Floats) -> Values:
    """Return what an image of labels shows: areas, correlations, chords and transport."""
    solid, voxel = part > 0, known.voxel
    faces, touching, runs = 0.0, 0.0, 0.0
    for axis in range(3):
        one, other = (np.delete(part, end, axis=axis) for end in (-1, 0))
        both = (one > 0) & (other > 0)
        # what lies in the border is not seen: of n voxels in a line n - 1 faces are
        seen = max(1.0 - 1.0 / part.shape[axis], 0.5)
        faces += int(((one > 0) != (other > 0)).sum()) / seen
        touching += int((both & (one != other)).sum()) / seen
        runs += int(((one > 0) & (other == 0)).sum()) / seen
    # the faces of voxels have 3/2 of the area of a surface of any direction
    area = 2.0 / 3.0 / (part.size * voxel)
    pores = ~solid
    pairs = [np.interp(lags, *of, right=math.nan) for of in two_point_correlation(solid, voxel_size=voxel)]
    chords = np.sort(np.concatenate(chord_lengths(pores, voxel_size=voxel)))
    transport = effective_diffusivity(pores, block=2)
    layers = solid.mean(axis=tuple({0, 1, 2} - {known.axis}))
    width = max(round(known.grains["diameter"].mean() / voxel), 1)
    slabs = [layers[k : k + width].mean() for k in range(0, max(len(layers) - width, 0) + 1, width)]
    return {
        "solid_fraction": float(solid.mean()),
        "profile_deviation": float(np.std(slabs)) if len(slabs) > 1 else math.nan,
        "wetted_surface": faces * area,
        "contact_area": touching * area,
        "pore_chord": 3.0 * int(pores.sum()) * voxel / max(runs, 1.0),
        "two_point_correlation": np.mean(pairs, axis=0),
        "pore_chords": 1.0 - np.searchsorted(chords, lags, side="right") / max(len(chords), 1),
        **{f"diffusivity_{'xyz'[k]}": float(transport.relative[k]) for k in range(3)},
        "tortuosity": float(pores.mean() / max(float(np.mean(transport.relative)), 1e-300)),
    }


def _in(places: Floats, lower: Floats, upper: Floats, known: _Known) -> Booleans:
    """Return which points (n, 3) lie in a block; points beyond periodic sides are taken back."""
    period, around = known.upper - known.lower, np.array(known.periodic)
    moved = np.where(around, known.lower + (places - known.lower) % period, places)
    return np.asarray(((moved >= lower) & (moved < upper)).all(axis=1))


def _mean(values: Floats, weights: Floats) -> float:
    """Return the weighted mean of the values that are known, NaN without any."""
    good = np.isfinite(values)
    return float(np.average(values[good], weights=weights[good])) if good.any() else math.nan


def _passing(sizes: Floats, volumes: Floats, shares: Floats) -> Floats:
    """Return the sizes that shares of the volume pass."""
    if not len(sizes):
        return np.full(len(shares), np.nan)
    order = np.argsort(sizes, kind="stable")
    reached = np.cumsum(volumes[order]) - volumes[order] / 2.0
    return np.interp(shares, reached / volumes.sum(), sizes[order])
