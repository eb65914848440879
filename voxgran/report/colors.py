"""Colouring of grains: one value per grain, with name and unit.

Entries of a legend, or a colour bar, in a strip at the lower edge of a picture tell what its colours mean.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, get_args

import numpy as np

from voxgran._base.arrays import Floats, as_choice
from voxgran._base.lazy import load
from voxgran.containers.model import periods_of
from voxgran.geometry.sphere_pairs import spheres_near
from voxgran.measures.registered.coordination import coordination_number
from voxgran.measures.registered.forces import known_forces
from voxgran.packing.grains import ColorBy
from voxgran.packing.model import Packing
from voxgran.report.facts import shape_names
from voxgran.report.stage import LETTERS, add_label, add_tiles, text_size, text_width

COLOR_BY: tuple[ColorBy, ...] = get_args(ColorBy)
#: those that need the forces of the packing
OF_FORCES: tuple[ColorBy, ...] = ("force", "residual")
#: map of the colours, whose lightness increases evenly
COLORS = "viridis"
#: largest number of values that a legend lists
ENTRIES = 10
#: grains whose neighbours are listed at once
GROUP = 100_000
#: relative difference up to which all values are equal
SAME = 1e-9


@dataclass(frozen=True, slots=True)
class Coloring:
    """Values (n,) of grains, NaN of fixed ones, with name and unit (``""`` if none), and names of single values."""

    values: Floats
    label: str
    unit: str = ""
    names: Mapping[float, str] = field(default_factory=dict)

    @property
    def known(self) -> Floats:
        """Values of the grains that are not fixed."""
        return self.values[np.isfinite(self.values)]

    @property
    def same(self) -> bool:
        """Whether all values are equal, but for round-off."""
        low, high = float(self.known.min(initial=np.inf)), float(self.known.max(initial=-np.inf))
        return not low < high - SAME * abs(high)

    @property
    def limits(self) -> tuple[float, float]:
        """Smallest and largest value; slightly different if all values are equal."""
        low, high = float(self.known.min(initial=np.inf)), float(self.known.max(initial=-np.inf))
        if not self.same:
            return low, high
        return (0.6 * low, 1.2 * high) if low <= high and low > 0 else (-0.5, 0.5)

    @property
    def title(self) -> str:
        """Name, with the unit in brackets."""
        return f"{self.label} ({self.unit})" if self.unit else self.label

    @property
    def entries(self) -> dict[float, str]:
        """Values with what they are called, where these can be listed: a few that have names, or a single one."""
        different = self.known[:1] if self.same else np.unique(self.known)
        if len(different) > (ENTRIES if self.names else 1):
            return {}
        return {value: self.names.get(value, f"{value:.4g}") for value in different.tolist()}


def colors_of(packing: Packing) -> list[ColorBy]:
    """Return what the grains of a packing can be coloured by: forces where they are known, densities that differ."""
    known = {"density": isinstance(packing.density, tuple), **dict.fromkeys(OF_FORCES, packing.forces is not None)}
    return [name for name in COLOR_BY if known.get(name, True)]


def coloring(packing: Packing, color_by: str) -> Coloring:
    """Return the colouring of the grains by one of :data:`COLOR_BY`: equivalent diameter, height of the centroid above
    the lowest point of the container, index of the shape, density of its material, number of neighbours within the
    contact gap, distance of the centroid from the nearest other one, largest contact force, or what its forces fail to
    balance.

    Raises
    ------
    InputError
        If `color_by` is unknown, or it is "force" or "residual" and the forces of the packing are not known.
    """
    as_choice(color_by, "color_by", COLOR_BY)
    if packing.fixed is not None:
        shown = coloring(replace(packing, fixed=None), color_by)
        return replace(shown, values=np.where(packing.fixed, np.nan, shown.values))
    unit = "" if packing.unit == "1" else packing.unit
    if color_by in OF_FORCES:
        forces = known_forces(packing)
        if color_by == "residual":
            return Coloring(forces.residual, "residual", forces.unit_of_residual)
        return Coloring(forces.largest_force(), "largest contact force", forces.unit)
    if color_by == "diameter" or not packing.count:
        return Coloring(packing.diameters, "equivalent diameter", unit)
    if color_by == "height":
        return Coloring(_heights(packing), "height of the centroid", unit)
    if color_by == "shape":
        names = {float(index): f"{index}: {name}" for index, name in enumerate(shape_names(packing))}
        return Coloring(packing.shape_id.astype(np.float64), "number of the shape", names=names)
    if color_by == "density":
        values = np.asarray(packing.densities, np.float64)
        names = {value: f"{value:.6g}" for value in np.unique(values).tolist()}
        return Coloring(values, "density of the material, in the unit given", names=names)
    if color_by == "coordination":
        neighbours = coordination_number(packing).of_grain
        return Coloring(neighbours.astype(np.float64), "coordination number")
    return Coloring(_nearest(packing), "distance from the nearest centroid", unit)


def gradient() -> list[str]:
    """Return nine evenly spaced colours of the map, from that of the smallest value to that of the largest."""
    scale = load("matplotlib").colormaps[COLORS]
    return [load("matplotlib.colors").to_hex(scale(k / 8)) for k in range(9)]


def swatches(colors: Coloring) -> list[tuple[str, str]]:
    """Return colour and name of each value, where these can be listed."""
    low, high = colors.limits
    scale, to_hex = load("matplotlib").colormaps[COLORS], load("matplotlib.colors").to_hex
    return [(to_hex(scale((value - low) / (high - low))), name) for value, name in colors.entries.items()]


def _heights(packing: Packing) -> Floats:
    """Return the heights of the centroids against gravity, along the last axis where there is none, above the lowest
    corner of the bounds.
    """
    up = np.eye(3)[packing.dimension - 1] if packing.gravity is None else -np.asarray(packing.gravity, np.float64)
    bounds = packing.container.bounds
    return np.asarray(packing.position @ up - np.minimum(*(bounds * up)).sum())


def _nearest(packing: Packing) -> Floats:
    """Return the distance of each centroid from the nearest other one, across periodic faces too."""
    periods, extent = periods_of(packing.container), np.ptp(packing.container.bounds, axis=0)
    lower, place = packing.container.bounds[0], packing.position
    distance = np.full(packing.count, np.inf)
    d, half = packing.dimension, np.full(packing.count, 0.5)
    # wide enough for most grains of all packings, each of which then has about nine others within reach
    alone, reach = np.arange(packing.count), 1.3 * float((extent[:d].prod() / max(packing.count, 1)) ** (1 / d))
    while len(alone) and reach < 4.0 * float(np.linalg.norm(extent)):
        radii = reach * half
        for some in np.split(alone, range(GROUP, len(alone), GROUP)):
            one, j, image = spheres_near(place[some], radii[some], place, radii, lower=lower, periods=periods)
            i = some[one]
            away = np.linalg.norm(place[j] + image @ periods - place[i], axis=1)
            other = i != j
            np.minimum.at(distance, i[other], away[other])
        alone, reach = alone[np.isinf(distance[alone])], 2.0 * reach
    return np.where(np.isfinite(distance), distance, 0.0)


#: where the strip begins and ends, in widths of the picture; a scale bar is to the left of it
LEFT, RIGHT = 0.34, 0.97
#: largest share of the height of the picture that a legend takes; one that needs more is left out
TALLEST = 0.35
#: lowest point of a legend, in heights of the picture
LOWEST = 0.02
#: largest number of values at a colour bar, and steps of its colours
TICKS, STEPS = 5, 128
#: in sizes of the text: height of a line, of a colour bar and of a mark at it, distance of entries, and of words
LINE, BAR, MARK, APART, SPACE = 1.35, 0.7, 0.25, 1.2, 0.28


@dataclass(frozen=True, slots=True)
class Legend:
    """Texts and coloured tiles, placed in pixels from the lower left corner of a picture."""

    height: float  # of the strip that they take, in heights of the picture
    size: int  # of the texts
    labels: tuple[tuple[str, float, float, str], ...]  # text, x and y of its base line, and which part of it is at x
    tiles: Floats  # (n, 4) left, low, right and high
    colors: Floats  # (n, 3) in [0, 1]

    def add_to(self, stage: Any, *, color: Any = LETTERS) -> None:
        """Draw the legend, with texts of this colour."""
        add_tiles(stage, self.tiles, self.colors)
        for text, x, y, side in self.labels:
            add_label(stage, text, (x, y), side=side, color=color, size=self.size)


def legend_of(colors: Coloring, window: tuple[int, int], *, shades: str = COLORS) -> Legend | None:
    """Return the legend of a colouring for a picture of this size in pixels: an entry for each of a few values that
    have names, or for a single value; else a colour bar.

    `shades` is the map of the colours. None without values, and for a picture in which it would take too much room.
    """
    if not len(colors.values):
        return None
    size, begin, end = text_size(window), LEFT * window[0], RIGHT * window[0]
    low = LOWEST * window[1] + MARK * size
    made = _entries if colors.entries else _bar
    labels, tiles, values, top = made(colors, size, (begin, end, low))
    words = colors.title.split()
    lines = _rows([text_width(word, size) + SPACE * size for word in words], end - begin)
    for k, line in enumerate(reversed(lines)):
        text = " ".join(words[index] for index, _ in line)
        labels.append((text, begin, top + (MARK + LINE * k) * size, "left"))
    highest = top + (MARK + LINE * len(lines)) * size
    if highest > TALLEST * window[1]:
        return None
    bottom, brightest = colors.limits
    shown = load("matplotlib").colormaps[shades]((values - bottom) / (brightest - bottom))[:, :3]
    return Legend(highest / window[1], size, tuple(labels), np.array(tiles), np.asarray(shown, dtype=np.float64))


def _entries(colors: Coloring, size: int, place: tuple[float, float, float]) -> tuple[list[Any], Any, Floats, float]:
    """Return labels, tiles, values and upper end of the entries in rows, from the left end, right end and low end."""
    begin, end, low = place
    names = [_shortened(name, size, end - begin - LINE * size) for name in colors.entries.values()]
    step = (LINE + APART) * size
    # the last of a row needs no distance from a next one
    rows = _rows([text_width(name, size) + step for name in names], end - begin + APART * size)
    labels, tiles = [], []
    top = low + LINE * size * len(rows)
    for k, row in enumerate(rows):
        y = top - LINE * size * (k + 1)
        for index, x in row:
            tiles.append((begin + x, y, begin + x + size, y + 0.8 * size))
            labels.append((names[index], begin + x + LINE * size, y, "left"))
    return labels, tiles, np.array(list(colors.entries)), top


def _bar(colors: Coloring, size: int, place: tuple[float, float, float]) -> tuple[list[Any], Any, Floats, float]:
    """Return labels, tiles, values and upper end of a colour bar, from the left end, right end and low end."""
    begin, end, low = place
    least, most = colors.limits
    foot, end = low + LINE * size, end - APART * size
    edges = np.linspace(begin, end, STEPS + 1)
    tiles = np.column_stack([edges[:-1], np.full(STEPS, foot), edges[1:], np.full(STEPS, foot + BAR * size)])
    whole = bool((colors.values == np.round(colors.values)).all())
    for ticks in range(TICKS, 0, -1):
        locator = load("matplotlib.ticker").MaxNLocator(ticks, steps=[1, 2, 5, 10], integer=whole)
        marks = locator.tick_values(least, most)
        marks = marks[(marks >= least) & (marks <= most)]
        texts = [f"{mark:.10g}" for mark in marks]
        if sum(text_width(text, size) + APART * size for text in texts) <= end - begin:
            break
    places = begin + (marks - least) / (most - least) * (end - begin)
    labels = [(text, x, low, "middle") for text, x in zip(texts, places, strict=True)]
    return labels, tiles, np.linspace(least, most, STEPS), foot + BAR * size


def _rows(widths: Sequence[float], most: float) -> list[list[tuple[int, float]]]:
    """Return items of these widths in rows of at most that width, as the index and the place of each."""
    rows: list[list[tuple[int, float]]] = [[]]
    x = 0.0
    for index, width in enumerate(widths):
        if rows[-1] and x + width > most:
            rows.append([])
            x = 0.0
        rows[-1].append((index, x))
        x += width
    return rows


def _shortened(text: str, size: int, most: float) -> str:
    """Return a text, without its last letters where it is wider."""
    short = text
    while len(short) > 4 and text_width(short, size) > most:
        short = f"{short.removesuffix('...')[:-1]}..."
    return short
