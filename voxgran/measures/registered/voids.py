"""The pore space: pore sizes, chord lengths and what connects opposite sides; and the specific surface.

The pore size is the local thickness, the diameter of the largest sphere of pores that covers a point, at the centers of
voxels. Its error is the difference from the one on voxels that are twice as large, and at least a voxel, or 0.3 voxels
where the radii are exact, between spheres and disks and walls other than meshes and polygons. Chords are those of the
true shapes on lines about a voxel apart; their error is the standard error of the lines. In beds the pores are those
below the height that holds 85 % of the volume of the grains.

Chords are the parts of straight lines along an axis between grains or walls, in closed form.
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from voxgran._base.arrays import Floats, Integers, as_length
from voxgran._base.kernels import kernel
from voxgran.measures.crossings import Lines, grain_intervals, outside_intervals
from voxgran.measures.model import Groups, Measure, dataset, length_unit, variable
from voxgran.measures.pores import pores_of
from voxgran.measures.region import Regions, gravity_of
from voxgran.measures.registered.density import bed_fraction
from voxgran.measures.wetted import specific_surfaces
from voxgran.packing.model import Packing
from voxgran.packing.start import around_fixed

#: voxels in a mean diameter, in 3D and 2D, and most voxels
RESOLUTION = {3: 20.0, 2: 50.0}
MOST_VOXELS = 20_000_000
#: largest diameter of a pore in voxels up to which its size is found on the same voxels: the time grows with its cube
WIDEST = 24.0
#: smallest error of pore sizes in voxels, where radii are those between true spheres and walls, and elsewhere: what
#: closed formulas of boxes, cylinders and lattices missed at most
LEAST_ERROR = {True: 0.3, False: 1.0}
#: bins of the distributions
BINS = 40


@dataclass(frozen=True, eq=False)
class Chords:
    """Chords of the pore space along an axis."""

    lengths: Floats  # (m,) of the chords between two grains or walls, in the unit of lengths
    mean: float  # twice the length of all lines in the pores over the number of their ends at grains and walls
    error: float  # standard error of the mean, from six interleaved lattices of lines


@dataclass(frozen=True, eq=False)
class Voids:
    """Pore space of a packing, on voxels of one size and lines through them."""

    voxel_size: float
    size_voxel: float  # voxel size of the pore sizes, larger where pores are many voxels wide
    size_error: float  # smallest error of the pore sizes, in the unit of lengths
    porosity: float  # of the image, below the surface of a bed
    sizes: Floats  # (n,) pore size at each voxel of the pores, in the unit of lengths
    chords: tuple[Chords, ...]  # chords along each axis
    percolating: tuple[float, ...]  # share of the pores that connects opposite sides along each axis

    def numbers(self) -> dict[str, float]:
        """Return all numbers by their names."""
        some = len(self.sizes) > 0
        found = {
            "pore_porosity": self.porosity,
            "pore_size_mean": float(self.sizes.mean()) if some else math.nan,
            "pore_size_std": float(self.sizes.std()) if some else math.nan,
            "pore_size_median": float(np.median(self.sizes)) if some else math.nan,
            "pore_size_max": float(self.sizes.max()) if some else math.nan,
        }
        for axis, chords in zip("xyz", self.chords, strict=False):
            found[f"mean_chord_{axis}"] = chords.mean
        for axis, share in zip("xyz", self.percolating, strict=False):
            found[f"percolating_porosity_{axis}"] = share
        return found


def voids(packing: Packing, *, voxel_size: float | None = None) -> Voids:
    """Return pore sizes, chords and connected shares of the pore space.

    Chords are those of the true shapes, on lines along each axis that are about a voxel apart. By default voxels are a
    twentieth of the mean diameter, in two dimensions a fiftieth, or larger where there would be more than 20 million.
    Without grains they divide the container likewise. Where the largest pore is more than 24 voxels wide, pore sizes
    are found on larger voxels, so that it is not. Between spheres or disks, and walls other than meshes and polygons,
    the radii of the spheres of pores are exact; otherwise they are those of the image, and a pore is up to 1.5 voxels
    too narrow or too wide.

    Raises
    ------
    InputError
        If the voxel size is not above 0, or a grain is an open surface.
    """
    size = default_voxel_size(packing) if voxel_size is None else as_length(voxel_size, "voxel_size")
    image = _on_voxels(packing, size)
    chords = tuple(chords_along(packing, axis, image.voxel_size) for axis in range(packing.dimension))
    return replace(image, chords=chords)


def _on_voxels(packing: Packing, size: float) -> Voids:
    """Return what the image of the pore space gives, without chords."""
    pores = pores_of(packing, size)
    widest = pores.widest
    factor = math.ceil(widest / WIDEST) if math.isfinite(widest) else 1
    sized = pores if factor <= 1 else pores_of(packing, factor * pores.voxel_size)
    return Voids(
        pores.voxel_size,
        sized.voxel_size,
        LEAST_ERROR[sized.bodies is not None] * sized.voxel_size,
        pores.porosity,
        sized.sizes(),
        (),
        tuple(pores.percolating(axis) for axis in range(packing.dimension)),
    )


def default_voxel_size(packing: Packing) -> float:
    """Return the voxel size that is used where none is given."""
    d = packing.dimension
    lengths = (packing.container.bounds[1] - packing.container.bounds[0])[:d]
    across = float(packing.diameters.mean()) if packing.count else float(lengths.min())
    longest = float(lengths.max())
    least = longest * (float(np.prod(lengths / longest)) / MOST_VOXELS) ** (1 / d)
    return min(max(across / RESOLUTION[d], least), float(lengths.min()))


def _compute(packing: Packing) -> Groups:
    """Return numbers and distributions of the pore space."""
    fine = voids(packing)
    coarse = _on_voxels(packing, 2.0 * fine.size_voxel)
    unit = length_unit(packing)
    meanings = {
        "pore_porosity": ("1", "share of the voxels that are pores, below the surface of a bed"),
        "pore_size_mean": (unit, "mean pore size over the pore space"),
        "pore_size_std": (unit, "standard deviation of the pore size over the pore space"),
        "pore_size_median": (unit, "median pore size over the pore space"),
        "pore_size_max": (unit, "diameter of the largest sphere of the pore space"),
    }
    for axis in "xyz"[: packing.dimension]:
        share = f"share of the pore space that connects opposite sides along {axis}"
        meanings[f"percolating_porosity_{axis}"] = "1", share
    fines, coarses = fine.numbers(), coarse.numbers()

    def least(name: str) -> float:
        if name == "pore_porosity":
            return abs(fine.porosity - _exact_porosity(packing))
        return fine.size_error if name.startswith("pore_size") else 0.0

    whole = {
        name: variable((), fines[name], *meanings[name], error=_difference(fines[name], coarses[name], least(name)))
        for name in meanings
    }
    for axis, chords in zip("xyz", fine.chords, strict=False):
        text = f"mean chord of the pore space along {axis}"
        whole[f"mean_chord_{axis}"] = variable((), chords.mean, unit, text, error=chords.error)
    whole["pore_voxel_size"] = variable((), fine.voxel_size, unit, "edge of the voxels of the pore space")
    text = "edge of the voxels of the pore sizes"
    whole["pore_size_voxel_size"] = variable((), fine.size_voxel, unit, text)
    whole |= specific_surfaces(around_fixed(packing), bed_fraction(packing))
    return {"/": dataset(whole), "/voids": _distributions(fine, packing, unit)}


def _exact_porosity(packing: Packing) -> float:
    """Return the porosity by the volumes of the grains, below the surface of a bed."""
    bed = bed_fraction(packing)
    return packing.porosity if bed is None or math.isnan(bed) else 1.0 - float(bed)


def _difference(fine: float, coarse: float, least: float) -> float:
    """Return the difference of two numbers, and at least a number; 0 if both are infinite or NaN."""
    if not math.isfinite(fine) and (fine == coarse or (math.isnan(fine) and math.isnan(coarse))):
        return 0.0
    return max(abs(fine - coarse), least)


def _distributions(found: Voids, packing: Packing, unit: str) -> Any:
    """Return the distributions of pore size by volume and of chords by number."""
    per_length = length_unit(packing, power=-1)
    edges, density = _histogram(found.sizes, found.voxel_size)
    kind = "volume" if packing.dimension == 3 else "area"
    values = {
        "pore_size_density": variable(
            ("pore_size",), density, per_length, f"probability density of the pore size by {kind}"
        )
    }
    longest = max((float(one.lengths.max(initial=0.0)) for one in found.chords), default=0.0) or found.voxel_size
    ends = np.linspace(0.0, longest * (1 + 1e-9), BINS + 1)
    for axis, one in zip("xyz", found.chords, strict=False):
        shares = np.histogram(one.lengths, ends)[0] / (max(len(one.lengths), 1) * np.diff(ends))
        text = f"probability density by number of the chords of the pore space along {axis}"
        values[f"chord_density_{axis}"] = variable(("chord_length",), shares, per_length, text)
    coordinates = {
        "pore_size": variable(("pore_size",), (edges[1:] + edges[:-1]) / 2, unit, "pore size, middle of the bin"),
        "chord_length": variable(("chord_length",), (ends[1:] + ends[:-1]) / 2, unit, "chord, middle of the bin"),
    }
    return dataset(values, coordinates)


def _histogram(sizes: Floats, voxel_size: float) -> tuple[Floats, Floats]:
    """Return edges and probability densities of pore sizes."""
    top = float(sizes.max(initial=0.0)) or voxel_size
    edges = np.linspace(0.0, top * (1 + 1e-9), BINS + 1)
    counts = np.histogram(sizes, edges)[0]
    return edges, counts / (max(len(sizes), 1) * np.diff(edges))


registration = Measure(
    summary="pore space: pore sizes, chord lengths, percolating porosity; specific surface",
    groups=("/", "/voids"),
    compute=_compute,
    applies=lambda packing: not any(packing.shapes[k].is_open for k in np.unique(packing.shape_id)),
    usual=False,
    sees_fixed=True,
)


#: length, in spacings of the lines, up to which a gap between solids is closed: that of round-off
CLOSED = 1e-9
#: parts of the rows of lines whose means are compared; every sixth multiple of the golden section is spread well, too
PARTS = 6


def chords_along(packing: Packing, axis: int, spacing: float) -> Chords:
    """Return the chords of a packing along an axis, on lines of a spacing.

    Walls end chords as grains do. The free surface of a bed ends none: lines that it cuts count with their length and
    their other end. Lines without an end count with their length; without any end the mean is infinite.

    Raises
    ------
    InputError
        If a grain is an open surface.
    """
    container, d = packing.container, packing.dimension
    around = bool(container.periodic[axis])
    lower, upper, walls = container.bounds[0].copy(), container.bounds[1].copy(), np.ones(2, dtype=np.bool_)
    gravity = gravity_of(packing)
    if gravity is not None and packing.count:
        down, sign = gravity
        side, bound = (1, upper) if sign < 0 else (0, lower)
        height = float(Regions(packing).limits[side, down])
        if lower[down] < height < upper[down]:
            bound[down] = height
            walls[side] = down != axis
            around = around and down != axis
    lines = Lines.through(axis, lower, upper, spacing, dimension=d)
    line, low, high = (
        np.concatenate(two)
        for two in zip(grain_intervals(packing, lines), outside_intervals(container, lines), strict=True)
    )
    order = np.argsort(line, kind="stable")
    bounds = np.concatenate([[0], np.cumsum(np.bincount(line, minlength=lines.count))])
    lengths, ends = np.zeros(lines.count), np.zeros(lines.count, dtype=np.int64)
    found = np.empty(len(line) + lines.count)
    extent = lines.high - lines.low
    count = _gaps(low[order], high[order], bounds, extent, walls, around, CLOSED * spacing, lengths, ends, found)
    return Chords(found[:count], *_mean_of(lengths, ends, lines.counts))


def _mean_of(lengths: Floats, ends: Integers, counts: tuple[int, int]) -> tuple[float, float]:
    """Return the mean chord and its standard error, NaN where a part of the rows meets no end."""
    total = int(ends.sum())
    mean = 2.0 * float(lengths.sum()) / total if total else math.inf
    # rows are shared out in turn
    part = np.arange(len(ends)) // counts[1] % PARTS
    ends_of = np.bincount(part, ends, minlength=PARTS)
    if not total:
        return mean, 0.0
    if not ends_of.all():
        return mean, math.nan
    means = 2.0 * np.bincount(part, lengths, minlength=PARTS) / ends_of
    return mean, float(means.std(ddof=1)) / math.sqrt(PARTS)


@kernel
def _gaps(low, high, bounds, extent, walls, around, least, lengths, ends, found):  # type: ignore[no-untyped-def]
    """Write length and number of ends of the gaps of each line, and the chords; return the number of chords.

    Intervals `bounds[k]` to `bounds[k + 1]` are those of line k, which runs from 0 to `extent`. Gaps shorter than
    `least` count as closed. A periodic line joins its last gap to its first one.
    """
    count = 0
    for k in range(len(bounds) - 1):
        begin, end = bounds[k], bounds[k + 1]
        for a in range(begin + 1, end):
            start, stop, b = low[a], high[a], a - 1
            while b >= begin and low[b] > start:
                low[b + 1], high[b + 1] = low[b], high[b]
                b -= 1
            low[b + 1], high[b + 1] = start, stop
        reach, head, at_start = 0.0, 0.0, True
        for a in range(begin, end + 1):
            stop = extent if a == end else min(low[a], extent)
            gap, at_end = stop - reach, stop == extent
            if gap > least:
                lengths[k] += gap
                if around and at_start and not at_end:
                    head = gap
                elif around and at_start:
                    # no grain ends the line
                    pass
                else:
                    meets = (walls[0] or not at_start) + (walls[1] or not at_end)
                    chord = gap
                    if around and at_end:
                        chord, head = gap + head, 0.0
                    ends[k] += meets
                    if meets == 2:
                        found[count] = chord
                        count += 1
            if at_end:
                break
            if high[a] > reach:
                reach = high[a]
                at_start = False
        if head > 0.0:
            # a grain lies at the end of the line
            ends[k] += 2
            found[count] = head
            count += 1
    return count
