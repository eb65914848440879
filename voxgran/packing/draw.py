"""Random draw of the grains of a packing: their number, shapes and sizes."""

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import Floats, Integers, as_choice, as_count, as_floats, as_share, check_lengths
from voxgran._base.errors import GrainTooLargeError, InputError, PackingWarning, TooLargeError, numbered, shown, warn
from voxgran._base.registry import Parameters
from voxgran._base.scalars import cube_root
from voxgran._base.seeds import stream
from voxgran.contacts.assembly import as_density, by_shape, shapes_by_density
from voxgran.containers.model import Container, boundary_of
from voxgran.containers.size_limits import can_fit
from voxgran.packing.model import Packing
from voxgran.packing.start import joined_ids
from voxgran.settling.parameters import Settling
from voxgran.shapes.describing.extents import principal_extents
from voxgran.shapes.family import make_shape
from voxgran.shapes.model import Shape, check_shapes
from voxgran.shapes.size_laws.listed import ListedGrains, families_in, grains_of, refuse_too_many
from voxgran.shapes.size_laws.plan import FAR, count_within, stratum_distance
from voxgran.shapes.sizes import SizeDistribution

log = logging.getLogger(__name__)

#: largest solid fraction of equal disks and spheres: the hexagonal and the face-centred cubic lattice
#: (Thue 1910; Hales 2005, doi:10.4007/annals.2005.162.1065)
DENSEST = {2: math.pi / math.sqrt(12.0), 3: math.pi / math.sqrt(18.0)}
#: parts of a circle by which the sizes of grains and the shapes of sizes follow each other, both badly approximable:
#: (sqrt(5) - 1) / 2 and sqrt(2) - 1; and how many grains are then in random order
GOLDEN, SILVER, SHUFFLED = 0.6180339887498949, 0.41421356237309503, 64
#: number of grains drawn at a time, and largest number, if no count is given
BLOCK, MOST_DRAWN = 1024, 10_000_000
#: largest count
MOST_ASKED = 100_000_000
#: counts above this are first checked by so many grains
PROBE = 100_000
#: largest number of grains whose sizes the method makes, if no count is given
MOST_MADE = 250_000


@dataclass(frozen=True, slots=True)
class Request:
    """What :func:`voxgran.packing.pack.pack` is asked for: its arguments, but for checkpoints and progress."""

    shapes: Sequence[Shape] | Shape
    container: Container
    method: str | Parameters
    _: KW_ONLY
    count: int | None = None
    solid_fraction: float | None = None
    sizes: SizeDistribution | None = None
    grains: Any = None  # a list; its grains once it is read
    weights: "ArrayLike | None" = None
    weights_by: str = "number"
    seed: int = 0
    start: Packing | None = None
    obstacles: Packing | None = None
    unit: str | None = None
    density: float | Sequence[float] | None = None
    settle: bool | Mapping[str, Any] | Settling | None = None
    orientations: Any = None
    parameters: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class DrawnGrains:
    """Grains without poses: their shapes and equivalent diameters, (n,), in the unit of lengths.

    removed: count and volume of the drawn grains that cannot fit. grain_id: row of each grain in its list, (n,), -1 for
    grains of no list; None without a list.
    """

    shape_id: Integers
    diameter: Floats
    removed: dict[str, float]
    grain_id: Integers | None = None


def draw_grains(
    request: Request, *, surplus: bool, stretches: bool, sizing: Literal["drawn", "scaled", "made"], own_shapes: bool
) -> DrawnGrains:
    """Draw the grains of a packing.

    The sizes are those of strata (:meth:`SizeDistribution.strata`), unless they are to be independent, and shapes and
    sizes are independent of each other. Without a count and a solid fraction as many grains are drawn as fill the
    container completely; `surplus` allows grains of more volume than the container, of which the method places those
    that fit, and `stretches` those for which it stretches the container. `sizing` is that of the method: sizes that are
    scaled later may be given with a count and a solid fraction; for sizes that the method makes, all grains get the
    diameter at which they have the volume of the container together. With `own_shapes` the method makes the shapes, and
    those that are given tell the volumes only: spheres are then as dense as any.

    Raises
    ------
    InputError
        If a number is out of range, the grains have more volume than the container, the solid fraction of equal spheres
        is beyond that of the densest lattice, or volumes of open surfaces are needed.
    GrainTooLargeError
        If no grain can fit, or one of a list cannot.
    TooLargeError
        If more than 100 million grains are requested.
    """
    shapes, container, sizes, seed = check_shapes(request.shapes), request.container, request.sizes, request.seed
    if request.grains is not None:
        return _listed(shapes, container, request.grains, stretches=stretches)
    surplus = surplus or stretches
    solid_fraction = request.solid_fraction
    count = None if request.count is None else as_count(request.count, "count", at_most=None)
    if count is not None and count > MOST_ASKED:
        raise TooLargeError(
            f"count is {shown(count)}: at most {MOST_ASKED} grains can be packed at a time; pack in parts"
        )
    target = container.volume * (1.0 if solid_fraction is None else as_share(solid_fraction, "solid_fraction"))
    shares = _shares(shapes, request.weights, request.weights_by, sizes is None)
    if sizing == "made":
        return _without_sizes(shapes, container, shares, sizes, count, seed)
    if count is None and all(shape.is_open for shape, share in zip(shapes, shares, strict=True) if share > 0):
        raise InputError("count is None and all shapes are open surfaces: they have no volume to fill; give a count")
    if count is not None and count > PROBE:
        _refuse_too_many(shapes, shares, sizes, container, count, bounded=not surplus and sizing == "drawn", seed=seed)
    filled = count is None or (solid_fraction is not None and sizing == "drawn")
    if sizes is None or sizes.independent:
        shape_id, diameter = _draw(shapes, shares, sizes, count, target, seed)
    else:
        room = target if filled else math.inf
        shape_id, diameter = _laid(shapes, shares, sizes, count=count, target=room, seed=seed)
    volumes = _volumes(shapes, shape_id, diameter)
    if filled and count is not None and len(volumes):
        keep = np.cumsum(volumes) - volumes < target
        shape_id, diameter, volumes = shape_id[keep], diameter[keep], volumes[keep]
    if solid_fraction is not None and not own_shapes and (sizing == "drawn" or count is None):
        _refuse_denser_than_lattice(shapes, container, shape_id, diameter, wanted=solid_fraction)
    fits = can_fit(shapes, container, shape_id, diameter)
    if len(fits) and not fits.any():
        raise GrainTooLargeError(
            f"the smallest grain has the diameter {diameter.min():.6g}: none can fit in the container of "
            f"{_lengths_text(container)}, however it is turned; make the grains smaller or the container larger"
        )
    if count is not None and not surplus and sizing == "drawn" and volumes[fits].sum() > container.volume:
        raise InputError(_too_much(count, volumes[fits].sum() / container.volume))
    removed = {"count": int((~fits).sum()), "volume": float(volumes[~fits].sum())}
    if removed["count"]:
        warn(
            f"{removed['count']} grains of volume {removed['volume']:.6g} cannot fit in the container: the "
            "gradation is cut there; make the container larger to keep it whole",
            PackingWarning,
        )
    return DrawnGrains(shape_id[fits], diameter[fits], removed)


def listed_grains(
    request: Request, shapes: tuple[Shape, ...], unit: str
) -> tuple[tuple[Shape, ...], ListedGrains, Any]:
    """Return shapes, once for each density, grains and densities of the list of a request, with lengths in one unit;
    without shapes, they are of the families that the list names, else spheres, and disks in the plane.

    Raises
    ------
    InputError
        If the list breaks a rule.
    """
    sized, dimension = len(shapes) > 0, request.container.dimension
    if not sized:
        named = families_in(request.grains) or ["sphere" if dimension == 3 else "disk"]
        shapes = tuple(make_shape(family) for family in named)
    shares = _shares(shapes, request.weights, request.weights_by, own_size=False)
    given = None if request.density is None else by_shape(as_density(request.density, len(shapes)), len(shapes))
    found = grains_of(request.grains, shapes, shares, unit=unit, densities=given, sized=sized)
    if found.density is None:
        return shapes, found, request.density
    apart, shape_id, density = shapes_by_density(shapes, found.shape_id, found.density)
    return apart, replace(found, shape_id=shape_id), density


def _listed(shapes: Sequence[Shape], container: Container, grains: ListedGrains, *, stretches: bool) -> DrawnGrains:
    """Return the grains of a list, each once and in its order."""
    wrong = np.flatnonzero(~can_fit(shapes, container, grains.shape_id, grains.diameter))
    if len(wrong):
        raise GrainTooLargeError(
            f"{numbered('row', np.unique(grains.row[wrong]))} of grains (from 0 on), of diameter "
            f"{grains.diameter[wrong[0]]:.6g}, cannot fit in the container of {_lengths_text(container)}, however "
            "turned; take out what is too large, or enlarge the container"
        )
    share = float(_volumes(shapes, grains.shape_id, grains.diameter).sum() / container.volume)
    if share > 1.0 and not stretches:
        raise InputError(_too_much(len(grains.row), share))
    return DrawnGrains(grains.shape_id, grains.diameter, {"count": 0, "volume": 0.0}, grains.row)


def _refuse_too_many(
    shapes: Sequence[Shape],
    shares: Floats,
    sizes: SizeDistribution | None,
    container: Container,
    count: int,
    *,
    bounded: bool,
    seed: int,
) -> None:
    """Refuse, before all grains are drawn, a count that is far beyond the memory or, where `bounded`, the container."""
    refuse_too_many(count)
    shape_id, diameter = _draw_block(shapes, shares, sizes, PROBE, seed, 0)
    fits = can_fit(shapes, container, shape_id, diameter)
    volume = float(_volumes(shapes, shape_id, diameter)[fits].sum()) * (count / PROBE)
    if bounded and volume > 2.0 * container.volume:
        raise InputError(_too_much(count, volume / container.volume))


def _too_much(count: int, share: float) -> str:
    """Return the message for grains of more volume than the container."""
    return (
        f"count is {count}: these grains have {share:.3g} times the volume of the container; ask for fewer or smaller "
        "grains or a larger container"
    )


def _without_sizes(
    shapes: Sequence[Shape],
    container: Container,
    shares: Floats,
    sizes: SizeDistribution | None,
    count: int | None,
    seed: int,
) -> DrawnGrains:
    """Return grains whose sizes the method makes, all of one diameter."""
    if sizes is not None:
        raise InputError("sizes is given: the method makes the sizes of the grains itself; leave it out")
    many = MOST_MADE if count is None else count
    shape_id = stream(seed, "shapes").choice(len(shapes), size=many, p=shares).astype(np.int64)
    room = container.volume / (float(_unit_volumes(shapes)[shape_id].sum()) if many else 1.0)
    diameter = cube_root(room) if container.dimension == 3 else math.sqrt(room)
    return DrawnGrains(shape_id, np.full(many, diameter), {"count": 0, "volume": 0.0})


def joined(start: Packing, grains: DrawnGrains, *, earlier: int) -> DrawnGrains:
    """Return the grains of a start followed by drawn ones, whose shapes come after `earlier` others."""
    return replace(
        grains,
        shape_id=np.concatenate([start.shape_id, earlier + grains.shape_id]),
        diameter=np.concatenate([start.diameters, grains.diameter]),
        grain_id=joined_ids((start.grain_id, start.count), (grains.grain_id, len(grains.shape_id))),
    )


def scaled_to(
    grains: DrawnGrains, shapes: Sequence[Shape], container: Container, solid_fraction: float, *, given: int, kept: int
) -> DrawnGrains:
    """Return grains with a common factor on their diameters that meets a solid fraction.

    Grains after the first `given` were drawn until their volume reached that of the solid fraction: the last of them is
    left out where the factor is then nearer to 1. The first `kept` ones keep their sizes and take no part.
    """
    volumes, target = _volumes(shapes, grains.shape_id, grains.diameter), container.volume * solid_fraction
    volumes[:kept] = 0.0
    total = float(volumes.sum())
    if len(volumes) > max(given, 1) and total / target > target / (total - volumes[-1]):
        total -= float(volumes[-1])
        grains = replace(grains, shape_id=grains.shape_id[:-1], diameter=grains.diameter[:-1])
    factor = (target / total) ** (1.0 / container.dimension) if total > 0.0 else 1.0
    return replace(grains, diameter=grains.diameter * np.where(np.arange(len(grains.diameter)) < kept, 1.0, factor))


def _refuse_denser_than_lattice(
    shapes: Sequence[Shape], container: Container, shape_id: Integers, diameter: Floats, *, wanted: float
) -> None:
    """Refuse equal spheres that would be denser than the densest lattice.

    This holds for boxes and rectangles, which tile space. A round container or a mesh may hold more.
    """
    dimension, densest = container.dimension, DENSEST[container.dimension]
    if wanted <= densest * (1 + 1e-12) or not boundary_of(container).is_flat or not len(diameter):
        return
    spheres = all(shapes[k].is_sphere for k in set(shape_id.tolist()))
    volume = _volumes(shapes, shape_id, diameter).sum()
    if spheres and np.ptp(diameter) <= 1e-12 * diameter.max() and volume > densest * container.volume:
        name = "disks" if dimension == 2 else "spheres"
        raise InputError(
            f"solid_fraction is {wanted:.6g}, a porosity of {1 - wanted:.6g}: equal {name} have a "
            f"porosity of at least {1 - densest:.4f}, that of the densest lattice; ask for less, or for several sizes"
        )


def _shares(shapes: Sequence[Shape], weights: "ArrayLike | None", weights_by: str, own_size: bool) -> Floats:
    """Return the probability of each shape by number."""
    if not len(shapes):
        raise InputError("shapes is empty: a packing needs at least one shape; give one")
    share = np.ones(len(shapes)) if weights is None else as_floats(weights, "weights", shape=(len(shapes),))
    if share.min() < 0 or share.sum() <= 0:
        raise InputError(f"weights are {share.tolist()}: none may be negative and one must be above 0; change them")
    by_volume = as_choice(weights_by, "weights_by", ("number", "volume")) == "volume"
    if by_volume and any(shape.is_open for shape in shapes):
        raise InputError("weights_by is 'volume' and a shape is an open surface: it has no volume; use 'number'")
    if by_volume and own_size:
        # with a size distribution all shapes have equal volumes, and both shares are the same
        share = share / np.array([shape.volume for shape in shapes])
    return share / share.sum()


def _draw(
    shapes: Sequence[Shape], shares: Floats, sizes: SizeDistribution | None, count: int | None, target: float, seed: int
) -> tuple[Integers, Floats]:
    """Draw shapes and diameters, in blocks until the target volume is reached where no count is given."""
    if count is not None:
        return _draw_block(shapes, shares, sizes, count, seed, 0)
    shape_ids, diameters = np.zeros(BLOCK, dtype=np.int64), np.zeros(BLOCK)
    volume, drawn = 0.0, 0
    while drawn < MOST_DRAWN:
        if drawn == len(shape_ids):
            shape_ids, diameters = _doubled(shape_ids), _doubled(diameters)
        shape_id, diameter = _draw_block(shapes, shares, sizes, BLOCK, seed, drawn // BLOCK)
        shape_ids[drawn : drawn + BLOCK], diameters[drawn : drawn + BLOCK] = shape_id, diameter
        volumes = volume + np.cumsum(_volumes(shapes, shape_id, diameter))
        enough = int(np.searchsorted(volumes, target))
        if enough < BLOCK:
            return shape_ids[: drawn + enough + 1], diameters[: drawn + enough + 1]
        volume, drawn = float(volumes[-1]), drawn + BLOCK
    raise InputError(
        f"{drawn} grains were drawn and have {volume / target:.3g} of the wanted volume: give a count or larger sizes"
    )


def _laid(
    shapes: Sequence[Shape], shares: Floats, sizes: SizeDistribution, *, count: int | None, target: float, seed: int
) -> tuple[Integers, Floats]:
    """Return shapes and diameters of the grains of strata: a count, or as many as have the target volume."""
    dimension = shapes[0].dimension
    mean = float((shares * _unit_volumes(shapes) * libm.power(_factors(shapes, sizes), dimension)).sum())
    mean *= sizes.mean_volume(dimension=dimension) * (6.0 if dimension == 3 else 4.0) / math.pi
    room = target / mean if mean > 0.0 else math.inf
    many = min(math.inf if count is None else count, math.ceil(room) if math.isfinite(room) else math.inf)
    if count is None and many > MOST_DRAWN:
        raise InputError(
            f"{many:.3g} grains have the wanted volume, and at most {MOST_DRAWN} are drawn: give a count, or larger "
            "sizes"
        )
    n, most = int(many), MOST_DRAWN if count is None else count
    shape_id, diameter = _strata(shapes, shares, sizes, n, seed)
    # the volume differs from the mean one by the shapes of the largest grains
    while (total := float(_volumes(shapes, shape_id, diameter).sum())) < target and math.isfinite(target) and n < most:
        n = min(most, n + max(1, math.ceil((target - total) / mean)))
        shape_id, diameter = _strata(shapes, shares, sizes, n, seed)
    check_lengths([diameter.min(initial=1.0), diameter.max(initial=1.0)], "diameter of a grain")
    volumes = _volumes(shapes, shape_id, diameter)
    keep = np.cumsum(volumes) - volumes < target
    if n and sizes.basis == "volume" and (distance := stratum_distance(sizes, n, dimension)) > FAR:
        enough = count_within(sizes, 0.05, dimension)
        warn(
            f"{n} grains follow the sizes to {distance:.2g} by volume, the largest difference of the curves: the "
            f"largest grain is {volumes.max() / volumes.sum():.2g} of all; give about {enough} grains for 0.05, or "
            "leave out the finest sizes, which are most of the grains (vg.plan_sizes)",
            PackingWarning,
        )
    return shape_id[keep], diameter[keep]


def _strata(
    shapes: Sequence[Shape], shares: Floats, sizes: SizeDistribution, n: int, seed: int
) -> tuple[Integers, Floats]:
    """Return shapes and diameters of the grains of as many strata.

    Shapes follow each other along the sizes by parts of a circle, so that the grains between any two sizes have them in
    their shares.
    """
    generator = stream(seed, "sizes")
    diameter, shape_id = sizes.strata(n, generator, dimension=shapes[0].dimension), np.zeros(n, dtype=np.int64)
    if len(shapes) > 1:
        sections = (generator.random() + SILVER * np.arange(n)) % 1.0
        last = int(np.flatnonzero(shares)[-1])
        shape_id = np.minimum(np.searchsorted(np.cumsum(shares), sections, side="right"), last)
    diameter = diameter * _factors(shapes, sizes)[shape_id]
    order = _spread(n, generator)
    return shape_id[order], diameter[order]


def _spread(count: int, generator: np.random.Generator) -> Integers:
    """Return the numbers below a count in an order of which every beginning is spread over them: methods that place a
    part of the grains then have grains of all sizes.

    The steps are golden sections of the count, and within blocks the order is random.
    """
    step = max(1, round(GOLDEN * count))
    while math.gcd(step, count) > 1:
        step += 1
    order = (int(generator.integers(max(count, 1))) + step * np.arange(count)) % max(count, 1)
    whole = count // SHUFFLED * SHUFFLED
    order[:whole] = generator.permuted(order[:whole].reshape(-1, SHUFFLED), axis=1).ravel()
    order[whole:] = generator.permutation(order[whole:])
    return order


def _factors(shapes: Sequence[Shape], sizes: SizeDistribution) -> Floats:
    """Return the diameters of shapes over their sizes, which may be intermediate axes."""
    if not sizes.by_intermediate_axis:
        return np.ones(len(shapes))
    return np.array([shape.diameter / principal_extents(shape)[1] for shape in shapes])


def _doubled(array: NDArray[Any]) -> NDArray[Any]:
    """Return an array of twice the length; its zeros take no memory until they are written."""
    longer = np.zeros(2 * len(array), dtype=array.dtype)
    longer[: len(array)] = array
    return longer


def _draw_block(
    shapes: Sequence[Shape], shares: Floats, sizes: SizeDistribution | None, many: int, seed: int, block: int
) -> tuple[Integers, Floats]:
    """Draw shapes and diameters of one block of grains."""
    shape_id = stream(seed, "shapes", block).choice(len(shapes), size=many, p=shares).astype(np.int64)
    diameter = _diameters(shapes, shape_id, sizes, stream(seed, "sizes", block))
    check_lengths([diameter.min(initial=1.0), diameter.max(initial=1.0)], "diameter of a grain")
    return shape_id, diameter


def _diameters(
    shapes: Sequence[Shape], shape_id: Integers, sizes: SizeDistribution | None, generator: np.random.Generator
) -> Floats:
    """Return equivalent diameters, drawn independently."""
    if sizes is None:
        return np.array([shape.diameter for shape in shapes])[shape_id]
    return sizes.sample(len(shape_id), generator, dimension=shapes[0].dimension) * _factors(shapes, sizes)[shape_id]


def _volumes(shapes: Sequence[Shape], shape_id: Integers, diameter: Floats) -> Floats:
    """Return the true volumes of grains."""
    own, volume = np.array([(shape.diameter, shape.volume) for shape in shapes])[shape_id].T
    return volume * libm.power(diameter / own, shapes[0].dimension)


def _unit_volumes(shapes: Sequence[Shape]) -> Floats:
    """Return the volumes of shapes at unit diameter; products have the same bits in any power of two as unit."""
    return np.array([shape.volume / math.prod((shape.diameter,) * shape.dimension) for shape in shapes])


def _lengths_text(container: Container) -> str:
    """Write the lengths of the bounds."""
    return " x ".join(f"{length:.6g}" for length in np.ptp(container.bounds, axis=0)[: container.dimension])
