"""Homogeneity: how the solid fraction of windows varies with their size, and the representative volume.

The standard deviation over windows of the volume V decays as a power of V: as V**(-1/2) where grains are placed
independently of each other, faster in dense packings, where numbers vary with the surface of the window (Torquato &
Stillinger 2003, doi:10.1103/PhysRevE.68.041113), and not at all where parts of the packing differ. A volume is
representative where the deviation is a stated share of the solid fraction (Kanit et al. 2003,
doi:10.1016/S0020-7683(03)00143-4).

For the solid volume in each cell of a lattice, each grain is cut once by the cells that it touches.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Booleans, Floats, Integers, as_number
from voxgran.containers.model import refuse_tilt
from voxgran.geometry.halfspaces import cut_disks, cut_spheres
from voxgran.measures.model import Groups, Measure, dataset, length_unit, variable
from voxgran.measures.pair_window import PairWindow
from voxgran.measures.registered.coordination import mean_diameter
from voxgran.measures.registered.density import INSET
from voxgran.measures.window import Solids, chosen_planes
from voxgran.packing.model import Packing

#: smallest window in mean diameters, cells along the shortest edge of the region, and cells in all, at most
SMALLEST, MOST_CELLS, ALL_CELLS = 0.5, 48, 300_000
#: ratio of the edges of two windows
RATIO = 1.35
#: windows that fit beside each other, at least, and from how many on their sizes have the same weight in the fit
FEWEST, MANY = 8, 100
#: smallest window of the fit in mean diameters, where three are larger
ASYMPTOTIC = 2.0
#: share of the solid fraction below which a deviation is round-off
ROUND_OFF = 1e-10
#: relative deviation of a representative volume
TOLERANCE = 0.05
#: slowest decay: a representative volume farther away is not known
SLOWEST = -0.05
#: relative change of a deviation by which derivatives are found
SMALL = 1e-4


@dataclass(frozen=True, eq=False)
class Homogeneity:
    """Standard deviation of the solid fraction over windows, from small to large."""

    size: Floats  # (k,) edge of the cube (in 2D square) with the volume of a window, in the unit of lengths
    deviation: Floats  # (k,) standard deviation of the solid fraction
    error: Floats  # (k,) its standard error
    windows: Floats  # (k,) how many windows fit beside each other
    solid_fraction: float  # of the whole region; NaN without one
    exponent: float  # of the decay of the deviation with the volume of the window; NaN where it is 0
    exponent_error: float  # standard error
    representative_size: float  # size at which the relative deviation falls below the tolerance; NaN if it is not known
    representative_size_error: float  # standard error


def homogeneity(packing: Packing, *, tolerance: float = TOLERANCE, inset: float | None = None) -> Homogeneity:
    """Return the standard deviation of the solid fraction over windows of growing size.

    Windows are cubes, in 2D squares, with edges from half a mean diameter (a 48th of the region, if that is more) up
    to half the region; all positions on a lattice with that spacing count. They lie in the whole periodic cell, or at
    least 1.5 median diameters inside all walls and, with gravity, below the height up to which 85 % of the volume of
    the grains lies. Grains are cut exactly, as in the bulk solid fraction; the common volume of overlapping grains
    other than spheres counts for each.

    Since all windows lie in one region, their variance is divided by one minus the share of a window of the region.
    Windows overlap, and those of all sizes see the same grains; standard errors come from the power of the Fourier
    modes of the solid fraction, which are taken as independent of each other. The scatter of exponents over seeds was
    0.8 to 1.3 times the stated error; deviations of windows smaller than a diameter scatter less than stated.

    Parameters
    ----------
    packing : Packing
        The packing.
    tolerance : float, optional
        Relative deviation of the representative volume. Default: 0.05.
    inset : float, optional
        Smallest distance of windows from the walls. Default: 1.5 median diameters.

    Returns
    -------
    Homogeneity
        The exponent is fitted to windows of at least two mean diameters; NaN for fewer than three such sizes. The
        representative size is interpolated between windows, or extrapolated with the exponent from the largest one; it
        is the smallest window where this is below the tolerance.

    Raises
    ------
    InputError
        If the tolerance is not above 0, the inset is negative, or the container is tilted.

    Examples
    --------
    >>> import voxgran as vg
    >>> from voxgran.measures.registered.homogeneity import homogeneity
    >>> box = vg.Box((6, 6, 6), periodic="xyz")
    >>> position = [[x + 0.5, y + 0.5, z + 0.5] for x in range(6) for y in range(6) for z in range(6)]
    >>> found = homogeneity(vg.Packing.of([vg.make_shape("sphere")], box, position=position))
    >>> found.size.tolist(), bool(found.deviation[1] < 1e-12)
    ([0.5, 1.0, 1.5, 2.0, 2.5], True)
    """
    wanted = as_number(tolerance, "tolerance", above=0.0)
    refuse_tilt(packing.container, "homogeneity", "measure it in an upright one")
    if inset is None:
        inset = INSET * float(np.median(packing.diameters)) if packing.count else 0.0
    window = PairWindow.of(packing, as_number(inset, "inset", at_least=0.0))
    d, diameter = packing.dimension, mean_diameter(packing)
    none = np.zeros(0)
    nothing = Homogeneity(none, none, none, none, *[math.nan] * 5)
    # windows are cubes: a region thinner than the smallest one holds none
    if not diameter or 2 * window.reach < SMALLEST * diameter * (1 - 1e-9):
        return nothing
    cells, edges = _lattice(window, diameter)
    held = _held(window, cells, edges)
    if not held.any():
        return nothing
    volume = float(np.prod(edges / edges.max()))
    fraction = cell_volumes(Solids(packing), window.lower, edges, held) / edges.max() ** d / volume
    deviations = {m: _deviation(fraction, held, m, window.periodic) for m in _steps(int(cells.min()))}
    steps = [m for m, one in deviations.items() if held.sum() >= FEWEST * m**d and math.isfinite(one)]
    if not steps:
        return nothing
    size = np.array(steps, dtype=np.float64) * volume ** (1 / d) * edges.max()
    windows = held.sum() / libm.power(np.array(steps, dtype=np.float64), d)
    mean = float(fraction[held].mean())
    if not mean > 0.0:
        # no solid, whose share could be compared
        return nothing
    found = np.array([deviations[m] for m in steps]) / np.sqrt(1 - 1 / windows)
    found[found < ROUND_OFF * mean] = 0.0
    covariance = _covariance(np.where(held, fraction, mean), float(held.mean()), steps, window.periodic)
    rule = libm.power(size / diameter, d), np.minimum(windows - 1, MANY), ASYMPTOTIC**d * (1 - 1e-9), mean * wanted
    exponent, reached = _fit(found, *rule)
    moved = [_fit(found * np.where(np.arange(len(steps)) == k, 1 + SMALL, 1.0), *rule) for k in range(len(steps))]
    change = (np.array(moved) - [exponent, reached]) / SMALL
    doubt = np.sqrt(np.maximum(linear.einsum("ki,kl,li->i", change, covariance, change), 0.0))
    # reached is a volume, in cubed or squared mean diameters
    edge = reached ** (1 / d) * diameter
    error = found * np.sqrt(np.diag(covariance))
    return Homogeneity(
        size, found, error, windows, mean, exponent, float(doubt[0]), edge, float(edge * doubt[1] / (d * reached))
    )


def _lattice(window: PairWindow, diameter: float) -> tuple[Floats, Floats]:
    """Return the numbers (d,) and edges (d,) of nearly cubic cells that fill the bounds of the region."""
    d, longest = len(window.edges), float(window.edges.max())
    all_of = float(np.prod(window.edges / longest) / ALL_CELLS) ** (1 / d) * longest
    edge = max(SMALLEST * diameter, float(window.edges.min()) / MOST_CELLS, all_of)
    cells = np.maximum(np.floor(window.edges / edge * (1 + 1e-9)), 1)
    return cells.astype(np.int64), np.asarray(window.edges / cells)


def _held(window: PairWindow, cells: Floats, edges: Floats) -> Booleans:
    """Return which cells lie in the region: in a box all, in other containers those whose outer spheres lie inside."""
    container, d = window.packing.container, len(cells)
    if window.is_flat:
        return np.ones(tuple(cells), dtype=np.bool_)
    axes = [low + (np.arange(n) + 0.5) * edge for low, n, edge in zip(window.lower, cells, edges, strict=True)]
    middles = np.zeros((int(np.prod(cells)), 3))
    middles[:, :d] = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, d)
    depth = -container.signed_distance(middles) - window.inset
    return np.asarray(depth >= linear.norm(edges) / 2).reshape(tuple(cells))


def _steps(cells: int) -> Iterator[int]:
    """Yield the edges of windows, in cells."""
    last, edge = 0, 1.0
    while int(edge) <= max(cells // 2, 1):
        if int(edge) > last:
            last = int(edge)
            yield last
        edge = max(edge * RATIO, last + 1.0)


def _deviation(fraction: Floats, held: Booleans, step: int, periodic: Booleans) -> float:
    """Return the standard deviation over all windows; NaN without one."""
    cells = step**fraction.ndim
    known = _sums(held.astype(np.float64), step, periodic) > cells - 0.5
    return float((_sums(fraction, step, periodic)[known] / cells).std()) if known.any() else math.nan


def _covariance(fraction: Floats, share: float, steps: list[int], periodic: Booleans) -> Floats:
    """Return the covariance (k, k) of the logarithms of the deviations of windows of `steps` cells.

    The variance over windows of a periodic region is the sum of the power of the Fourier modes, weighted by the square
    of the transform of a window. The power of a mode of a random field has a standard deviation as large as its mean,
    and so half the mean of its square as variance. Between walls fewer windows fit: each axis has the ratio of the
    covariances of uncorrelated cells between walls, in the share of the region that is held, and in a periodic region.
    """
    power = np.abs(np.fft.fftn(fraction - fraction.mean())) ** 2
    power /= power.sum() or 1.0
    transforms = [[_transform(n, step) for n in fraction.shape] for step in steps]
    seen = np.array([(power * math.prod(np.ix_(*of))).ravel() for of in transforms])
    mean = seen.sum(axis=1)
    # a deviation is the root of a variance, so its relative error is half as large
    covariance = linear.matmul(seen, seen.T) / 4 / np.maximum(np.outer(mean, mean), np.finfo(float).tiny)
    for n, wraps in zip(fraction.shape, periodic, strict=True):
        if not wraps:
            held = max(round(n * share ** (1 / fraction.ndim)), *steps)
            covariance *= _common(held, steps, False) / _common(n, steps, True)
    return np.asarray(covariance)


def _transform(n: int, step: int) -> Floats:
    """Return the square of the Fourier transform, (n,), of a window of `step` of n cells."""
    return np.asarray(np.abs(np.fft.fft(np.arange(n) < step) / step) ** 2)


def _common(n: int, steps: list[int], wraps: bool) -> Floats:
    """Return the mean square (k, k) of the cells that windows share, over all their places on an axis of n cells,
    relative to the product of their lengths.
    """
    inside = [(np.arange(n) - np.arange(n if wraps else n - step + 1)[:, None]) % n < step for step in steps]
    rows = [one.astype(np.float64) for one in inside]
    return np.array([[(linear.matmul(a, b.T) ** 2).mean() / (a[0].sum() * b[0].sum()) for b in rows] for a in rows])


def _sums(values: Floats, step: int, periodic: Booleans) -> Floats:
    """Return the sums over all windows of `step` cells along each axis; they reach across periodic faces."""
    for axis, wraps in enumerate(periodic):
        if wraps:
            values = np.concatenate([values, values.take(range(step - 1), axis=axis)], axis=axis)
        parts = [values.take(range(k, values.shape[axis] - step + 1 + k), axis=axis) for k in range(step)]
        values = np.sum(parts, axis=0)
    return values


def _fit(deviation: Floats, volume: Floats, weight: Floats, least: float, wanted: float) -> tuple[float, float]:
    """Return the exponent of the deviation over the volume, fitted from the volume `least` on, and the volume at which
    the deviation falls below `wanted`; an exponent of fewer than three windows is NaN.
    """
    # smaller windows see single grains, whose deviation decays more slowly
    used = (deviation > 0) & (volume >= least)
    exponent = math.nan
    if used.sum() >= 3:
        x, y, w = libm.log(volume[used]), libm.log(deviation[used]), weight[used]
        x, y = x - np.average(x, weights=w), y - np.average(y, weights=w)
        exponent = float((w * x * y).sum() / (w * x * x).sum())
    below = deviation <= wanted
    # from here on all windows are below
    first = len(below) - int(np.argmin(below[::-1])) if not below.all() else 0
    if first == 0:
        return exponent, float(volume[0]) if len(volume) else math.nan
    if first == len(below):
        known = exponent < SLOWEST
        return exponent, float(volume[-1] * (wanted / deviation[-1]) ** (1 / exponent)) if known else math.nan
    if deviation[first] == 0:
        return exponent, float(volume[first])
    share = math.log(deviation[first - 1] / wanted) / math.log(deviation[first - 1] / deviation[first])
    return exponent, float(volume[first - 1] * (volume[first] / volume[first - 1]) ** share)


def _compute(packing: Packing) -> Groups:
    """Return the deviations by size of the window, the exponent and the representative size."""
    found, unit, row = homogeneity(packing), length_unit(packing), ("window_size",)
    kind = "cubes" if packing.dimension == 3 else "squares"
    reached = f"edge of the window at which the deviation is {100 * TOLERANCE:g} % of the solid fraction"
    exponent = "exponent of the decay of the deviation of the solid fraction with the volume of the window"
    numbers = {
        "homogeneity_exponent": variable((), found.exponent, "1", exponent, error=found.exponent_error),
        "representative_size": variable(
            (), found.representative_size, unit, reached, error=found.representative_size_error
        ),
    }
    values = {
        "window_deviation": variable(
            row, found.deviation, "1", f"standard deviation of the solid fraction over {kind} of a size"
        ),
        "window_deviation_error": variable(row, found.error, "1", "standard error of that deviation"),
        "disjoint_windows": variable(row, found.windows, "1", "number of windows that fit beside each other"),
    }
    size = variable(row, found.size, unit, "edge of the window")
    return {"/": dataset(numbers), "/profiles": dataset(values, {"window_size": size})}


registration = Measure(
    summary="deviation of the solid fraction over windows of growing size, and the representative volume",
    groups=("/", "/profiles"),
    compute=_compute,
    usual=False,
)


#: grains that are cut at a time, which bounds the memory
GRAINS = 20_000


def cell_volumes(solids: Solids, lower: Floats, edges: Floats, held: Booleans) -> Floats:
    """Return the volume (in 2D area) of the grains in each cell of a lattice.

    The first cell has the corner `lower`, (d,), all have the `edges`, (d,), and `held` has the shape of the lattice;
    other cells are left at 0. On periodic axes the lattice is one period long. Spheres and disks that overlap count
    once, the common volume of other grains counts for each.
    """
    packing = solids.packing
    volumes = np.zeros(held.size)
    if solids.spheres is not None:
        centers, radii, planes = solids.spheres
    else:
        centers, radii = packing.position, packing.bounding_radii
    d = len(lower)
    low, high = np.zeros(d), np.asarray(edges, dtype=np.float64)
    for body, cell, place in _touched(centers, radii, lower, edges, held, packing.container.periodic):
        if solids.spheres is None:
            shift = np.zeros((len(body), 3))
            shift[:, :d] = place - centers[body, :d]
            parts = solids.cut_grains(body, low, high, shift=shift)[0]
        else:
            start, normals, offsets = chosen_planes(planes, body)
            chosen = start, np.ascontiguousarray(normals[:, :d]), offsets
            cut = cut_spheres if d == 3 else cut_disks
            parts = cut(place, radii[body], lower=low, upper=high, planes=chosen)
        volumes += np.bincount(cell, weights=parts, minlength=held.size)
    return volumes.reshape(held.shape)


def _touched(
    centers: Floats, radii: Floats, lower: Floats, edges: Floats, held: Booleans, periodic: tuple[bool, ...]
) -> Iterator[tuple[Integers, Integers, Floats]]:
    """Yield, for some bodies at a time, body, flat index of a cell that its sphere touches, and center (m, d) relative
    to the corner of that cell.
    """
    d, inside = len(lower), held.reshape(-1)
    for begin in range(0, len(radii), GRAINS):
        body = np.arange(begin, min(begin + GRAINS, len(radii)))
        places, cells = (centers[body, :d] - lower) / edges, np.zeros((len(body), d), np.int64)
        for a in range(d):
            reach = radii[body] / edges[a]
            first = np.floor(places[:, a] - reach).astype(np.int64)
            last = np.floor(places[:, a] + reach).astype(np.int64)
            if not periodic[a]:
                first, last = np.maximum(first, 0), np.minimum(last, held.shape[a] - 1)
            counts = np.maximum(last - first + 1, 0)
            turn = np.arange(int(counts.sum())) - np.repeat(np.cumsum(counts) - counts, counts)
            column = np.repeat(first, counts) + turn
            body, places = np.repeat(body, counts), np.repeat(places, counts, axis=0)
            cells = np.repeat(cells, counts, axis=0)
            cells[:, a] = column
        place = (places - cells) * edges
        flat = np.ravel_multi_index(tuple((cells % held.shape).T), held.shape)
        apart = place - np.clip(place, 0.0, edges)
        near = inside[flat] & (np.sqrt((apart**2).sum(axis=1)) < radii[body])
        yield body[near], flat[near], place[near]
