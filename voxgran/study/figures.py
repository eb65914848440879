"""Figures of a study: density against CPU seconds, and density by shape and method beside experiments."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import Floats, Integers
from voxgran._base.lazy import Dataset, load
from voxgran.report import plots
from voxgran.report.figures import Figure
from voxgran.study.axes import Label
from voxgran.study.cell_values import axes_of, labels_of, text_of, title_of, varied_axes
from voxgran.study.cells import LISTED
from voxgran.study.experiments import Band, check_labels
from voxgran.study.statistics import Interval, summary

MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "p", "*", "d", (4, 1, 0), "h", (8, 1, 0))
#: inches of a figure, and of a legend column beside it
WIDTH, HEIGHT = 7.6, 4.4
#: largest ratio of numbers on an axis that is not logarithmic
MOST_LINEAR = 30.0
#: most letters of all labels of an axis that are not turned
MOST_LETTERS = 50
#: share of the place of a category that its points and its band take
SPREAD, BAND = 0.6, 0.42

#: most labels of an axis that do not cover each other where they are slanted
MOST_SLANTED = 6


@dataclass(frozen=True, slots=True)
class Points:
    """Cells of a study as points of a figure.

    Attributes
    ----------
    labels : list of dict
        What the values of each cell are called, by axis.
    color_axis, marker_axis : str or None
        Axis that colours tell apart, usually `method`, and the one that markers do, usually `shape`; None without it.
    """

    labels: list[dict[str, Label]]
    color_axis: str | None
    marker_axis: str | None

    def values(self, axis: str | None) -> list[Label]:
        """Return the values of an axis, in order, each once."""
        return list(dict.fromkeys(cell[axis] for cell in self.labels)) if axis is not None else []

    def style(self, at: int) -> dict[str, Any]:
        """Return colour, marker and filling of a point."""
        colors, markers = self.values(self.color_axis), self.values(self.marker_axis)
        color = colors.index(self.labels[at][self.color_axis]) if self.color_axis is not None else 0
        marker = markers.index(self.labels[at][self.marker_axis]) if self.marker_axis is not None else 0
        ink = plots.DISTINCT[color % len(plots.DISTINCT)]
        # colours that come again are not filled
        filled = color // len(plots.DISTINCT) % 2 == 0
        return {"color": ink, "marker": MARKERS[marker % len(MARKERS)], "markerfacecolor": ink if filled else "none"}

    def over_categories(self, dataset: "Dataset") -> "Points":
        """Return the points for a figure over the values of the axis of markers, in which markers tell another axis
        apart: the first one that varies besides; none where there is no other.
        """
        taken = (self.color_axis, self.marker_axis, LISTED)
        dimension = axes_of(dataset)
        known = {dimension[name] for name in taken if name in dimension}
        free = [name for name in varied_axes(dataset) if name not in taken and dimension[name] not in known]
        return replace(self, marker_axis=next(iter(free), None))

    def by_style(self, places: Integers, category: str | None = None) -> Iterator[tuple[Integers, dict[str, Any]]]:
        """Yield the points of each colour and marker, and of each value of a category, with their style."""
        groups: dict[tuple[Label, ...], list[int]] = {}
        for at in map(int, places):
            axes = [axis for axis in (self.color_axis, category, self.marker_axis) if axis is not None]
            groups.setdefault(tuple(self.labels[at][axis] for axis in axes), []).append(at)
        for members in groups.values():
            yield np.array(members), self.style(members[0])


def points_of(dataset: "Dataset", over: str | None) -> Points:
    """Return the cells of a study as points.

    Parameters
    ----------
    dataset : xarray.Dataset
        That of a study.
    over : str or None
        Axis that colours tell apart.
    """
    varied = [name for name in varied_axes(dataset) if name != over]
    named = [name for name in varied if name != LISTED] or varied
    dimension = axes_of(dataset)
    # an axis that varies together with the one that is compared tells no more than it does
    named = [name for name in named if over is None or dimension[name] != dimension[over]] or named
    marker = "shape" if "shape" in named else next(iter(named), None)
    return Points(labels_of(dataset), over, marker)


@dataclass(frozen=True, slots=True)
class _Values:
    """Means (cells,) of a variable with the limits of their intervals; NaN where they are not known."""

    mean: Floats
    low: Floats
    high: Floats
    label: str

    def errors(self, places: Integers) -> Floats:
        """Return the lengths (2, n) of the bars below and above means; NaN where they are not known."""
        bars = np.stack([self.mean - self.low, self.high - self.mean])[:, places]
        return np.maximum(bars, 0.0)


def _values(dataset: "Dataset", variable: str, confidence: float, interval: Interval) -> _Values:
    """Return the means of a variable."""
    found = summary(dataset, variable, confidence=confidence, interval=interval)
    mean, low, high = (found[name].values.ravel() for name in ("mean", "confidence_low", "confidence_high"))
    unit = plots.unit_text(str(dataset[variable].attrs.get("units", "1")))
    return _Values(mean, low, high, f"{title_of(dataset, variable)}{unit}")


def _seconds(dataset: "Dataset", confidence: float, interval: Interval) -> _Values:
    """Return the geometric means of the CPU times, whose intervals do not reach below 0 as those of few times do."""
    times = dataset["seconds"]
    logs = times.copy(data=libm.log(np.where(times.values > 0, times.values, np.nan)))
    found = _values(dataset.assign(seconds=logs), "seconds", confidence, interval)
    mean, low, high = (libm.exp(values) for values in (found.mean, found.low, found.high))
    return _Values(mean, low, high, found.label)


def figures_of(
    dataset: "Dataset",
    variable: str,
    *,
    over: str | None,
    bands: Sequence[Band] = (),
    confidence: float = 0.95,
    interval: Interval = "auto",
) -> list[Figure]:
    """Return the figures of one density of a study.

    Parameters
    ----------
    dataset : xarray.Dataset
        That of a study.
    variable : str
        Name of the density.
    over : str or None
        Axis that colours tell apart.
    bands : sequence of Band
        Ranges of experiments, by the values of the axis `shape`, or of the axis that is drawn in its place; across the
        figure where they are of neither.
    confidence, interval : float, str
        Those of :func:`voxgran.study.statistics.summary`.

    Raises
    ------
    UnknownNameError
        If a range belongs to no value of the axis `shape`.
    """
    points = points_of(dataset, over)
    category = points.marker_axis
    labels = [text_of(label) for label in points.values(category)]
    # ranges of shapes belong to shapes; in a study without that axis each is drawn across the figure
    placed = category == "shape" or {band.label for band in bands} <= set(labels)
    if category == "shape":
        check_labels(bands, labels)
    density = _values(dataset, variable, confidence, interval)
    rows = len(points.values(points.color_axis)) + len(points.values(points.marker_axis)) + 3
    size = (WIDTH, max(HEIGHT, 0.28 * rows + 1.0))
    name, what = variable.replace("_", "-"), title_of(dataset, variable)
    bars = f"Bars are {100 * confidence:g} % confidence intervals of the means over the seeds."
    found = []
    if "seconds" in dataset:
        seconds = _seconds(dataset, confidence, interval)
        draw = partial(_draw_against_seconds, points=points, density=density, seconds=seconds)
        svg = plots.svg_of(draw, f"{name}-against-seconds", size=size)
        title = f"{what} against CPU seconds"
        caption = (
            f"{_capital(title)}, one marker a cell at the geometric mean of its times. {bars}{_alike(dataset, points)}"
        )
        found.append(Figure(f"{variable}_against_seconds", svg, title, caption))
    marked = points.over_categories(dataset)
    draw = partial(_draw_by_category, points=points, marked=marked, density=density, bands=bands, placed=placed)
    svg = plots.svg_of(draw, f"{name}-by-cell", size=size)
    by = " and ".join(axis for axis in (category, over) if axis is not None)
    title = f"{what} by {by}" if by else what
    caption = f"{_capital(title)}. {bars}{_alike(dataset, marked, category)}{_sources(bands)}"
    return [*found, Figure(f"{variable}_by_cell", svg, title, caption)]


def _capital(text: str) -> str:
    """Return a text with a capital letter."""
    return f"{text[:1].upper()}{text[1:]}"


def _alike(dataset: "Dataset", points: Points, category: str | None = None) -> str:
    """Return in which axes points that look alike differ, besides that of the abscissa, as part of a caption."""
    shown = (points.color_axis, points.marker_axis, category, LISTED)
    told = [axis for axis in varied_axes(dataset) if axis not in shown]
    return f" Points of the same colour and marker differ in {', '.join(told)}." if told else ""


def _sources(bands: Sequence[Band]) -> str:
    """Return what grey bands are, with their sources, as part of a caption."""
    if not bands:
        return ""
    told = [
        f"{band.label} {band.low:g}\u2013{band.high:g}{f' ({band.source})' if band.source else ''}" for band in bands
    ]
    return f" Grey bands are experiments: {'; '.join(told)}."


def _draw_against_seconds(axes: Any, *, points: Points, density: _Values, seconds: _Values) -> None:
    """Draw the density of each cell against its CPU time."""
    shown = np.flatnonzero(np.isfinite(density.mean) & np.isfinite(seconds.mean))
    for places, style in points.by_style(shown):
        axes.errorbar(
            seconds.mean[places],
            density.mean[places],
            xerr=seconds.errors(places),
            yerr=density.errors(places),
            linestyle="none",
            elinewidth=1.0,
            markersize=7,
            **style,
        )
    if len(shown):
        ends = np.concatenate([seconds.mean[shown], seconds.low[shown], seconds.high[shown]])
        axes.set_xlim(0.8 * np.nanmin(ends), 1.25 * np.nanmax(ends))
    plots.set_log_scale(axes)
    axes.set(xlabel="CPU seconds", ylabel=density.label)
    _legend(axes, points, markers=True)


def _draw_by_category(
    axes: Any, *, points: Points, marked: Points, density: _Values, bands: Sequence[Band], placed: bool
) -> None:
    """Draw the density of each cell over the values of the axis of markers, beside each other by colour; `marked` says
    what markers tell apart here.
    """
    category = points.marker_axis
    values = points.values(category)
    if len(values) > 1 and all(isinstance(value, int | float) for value in values):
        middle, width = _numbers(axes, values)
        place = np.array([middle[text_of(cell[str(category)])] for cell in points.labels])
        _join(axes, points, place, density.mean)
    else:
        middle, width = {text_of(value): float(at) for at, value in enumerate(values or [""])}, 1.0
        place = _beside([middle[text_of(cell[category])] if category else 0.0 for cell in points.labels])
        axes.set_xticks(range(len(middle)), [text_of(value) for value in values] or [""])
        axes.set_xlim(-0.5, len(middle) - 0.5)
        if sum(map(len, middle)) > MOST_LETTERS:
            axes.tick_params(axis="x", labelrotation=90 if len(values) > MOST_SLANTED else 25)
    for band in bands:
        _draw_band(
            axes, band, (middle[band.label] - BAND * width, middle[band.label] + BAND * width) if placed else None
        )
    for places, style in marked.by_style(np.flatnonzero(np.isfinite(density.mean)), category):
        axes.errorbar(
            place[places],
            density.mean[places],
            yerr=density.errors(places),
            linestyle="none",
            elinewidth=1.4,
            markersize=6,
            **style,
        )
    axes.set(xlabel=(category or "").replace("_", " "), ylabel=density.label)
    _legend(axes, marked, markers=marked.marker_axis is not None, bands=bool(bands))


def _numbers(axes: Any, values: Sequence[Any]) -> tuple[dict[str, float], float]:
    """Return the places of numbers by their labels, and the least distance of two; set the scale of the axis."""
    numbers = sorted(float(value) for value in values)
    width = float(np.diff(numbers).min())
    if numbers[0] > 0 and numbers[-1] > MOST_LINEAR * numbers[0]:
        axes.set_xscale("log")
        width = min(width, numbers[0])
    return {text_of(value): float(value) for value in values}, width


def _draw_band(axes: Any, band: Band, ends: tuple[float, float] | None) -> None:
    """Draw a range between these ends, or across the figure."""
    across = {} if ends is not None else {"transform": axes.get_yaxis_transform()}
    ends = ends or (0.0, 1.0)
    axes.fill_between(ends, band.low, band.high, color=plots.INK, alpha=0.16, linewidth=0, zorder=0, **across)
    # the lines show a range that is a single value
    for edge in (band.low, band.high):
        axes.plot(ends, [edge, edge], color=plots.INK, alpha=0.45, linewidth=0.8, zorder=1, **across)


def _beside(middle: Sequence[float]) -> Floats:
    """Return places of points beside each other around the middle of their category, in the order of the cells."""
    place = np.array(middle)
    for value in set(middle):
        members = np.flatnonzero(place == value)
        step = SPREAD / max(len(members), 1)
        place[members] = value + step * (np.arange(len(members)) - (len(members) - 1) / 2)
    return place


def _join(axes: Any, points: Points, place: Floats, mean: Floats) -> None:
    """Draw lines through the points of cells that differ in one number only."""
    lines: dict[tuple[Label, ...], list[int]] = {}
    for at in np.argsort(place, kind="stable"):
        cell = points.labels[at]
        lines.setdefault(tuple(v for name, v in cell.items() if name != points.marker_axis), []).append(int(at))
    for members in lines.values():
        if len(members) > 1:
            axes.plot(place[members], mean[members], color=points.style(members[0])["color"], linewidth=1.2, zorder=1.5)


def _legend(axes: Any, points: Points, *, markers: bool, bands: bool = False) -> None:
    """Draw the legend beside the plot: colours, then markers."""
    line, handles = load("matplotlib.lines").Line2D, []
    one = {value: at for at, cell in reversed(list(enumerate(points.labels))) for value in [_value(cell, points)]}
    for value in points.values(points.color_axis):
        style = {**points.style(one[value]), "marker": "o"}
        handles.append(line([], [], linestyle="none", markersize=7, label=text_of(value), **style))
    if markers:
        for number, value in enumerate(points.values(points.marker_axis)):
            marker = MARKERS[number % len(MARKERS)]
            style = {"color": plots.INK, "marker": marker, "markerfacecolor": "none"}
            handles.append(line([], [], linestyle="none", markersize=7, label=text_of(value), **style))
    if bands:
        patch = load("matplotlib.patches").Patch
        handles.append(patch(facecolor=plots.INK, alpha=0.25, label="experiments"))
    if handles:
        axes.legend(handles=handles, loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)


def _value(cell: dict[str, Label], points: Points) -> Label:
    """Return the value of the axis of colours of a cell."""
    return cell[points.color_axis] if points.color_axis is not None else ""
