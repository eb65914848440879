"""Plots of a packing with matplotlib: each function draws on given axes and returns them.

:func:`svg_of` makes one plot for a page, with lines and texts in the text colour of the page, so that it is legible on
light and dark backgrounds.
"""

import io
import re
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arrays import Floats, as_floats
from voxgran._base.lazy import load
from voxgran.measures.registered.gradation import size_range
from voxgran.packing.model import Packing
from voxgran.shapes.describing.extents import principal_extents
from voxgran.shapes.size_laws.distribution import SizeDistribution
from voxgran.shapes.size_laws.plan import SHARES, SizePlan

#: placeholder for the text colour of the page
INK = "#0a0b0c"
PLACED, ASKED, OTHER = "#2a9d8f", "#e07a3f", "#7a86c8"
#: colours of groups in order, which differ for all kinds of colour vision and from light and dark pages: those of Okabe
#: & Ito 2008 without black and yellow
DISTINCT = ("#0072b2", "#e69f00", "#009e73", "#d55e00", "#cc79a7", "#56b4e9")

#: digits as they are raised
RAISED = str.maketrans("-0123456789", "\u207b\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079")
#: free room around a plot, in inches: that of matplotlib's constrained layout
PAD = 3.0 / 72.0

_STYLE = {
    "axes.edgecolor": INK,
    "axes.facecolor": "none",
    "axes.grid": True,
    "axes.labelcolor": INK,
    "axes.labelsize": 12,
    "axes.linewidth": 0.8,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "figure.constrained_layout.use": True,
    "figure.facecolor": "none",
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "grid.alpha": 0.18,
    "grid.color": INK,
    "legend.fontsize": 11,
    "legend.frameon": False,
    "legend.labelcolor": INK,
    "lines.linewidth": 2.0,
    "svg.fonttype": "none",
    "text.color": INK,
    "xtick.color": INK,
    "xtick.labelsize": 11,
    "ytick.color": INK,
    "ytick.labelsize": 11,
}


def svg_of(
    draw: Callable[[Any], Any], name: str, *, size: tuple[float, float] = (5.2, 3.7), projection: str | None = None
) -> str:
    """Draw one plot and return it as an ``<svg>`` element, which is reproducible for the same plot.

    The name is the prefix of all ids in the element, so that one page can contain several plots; the size is in inches.
    """
    matplotlib = load("matplotlib")
    canvas = load("matplotlib.backends.backend_svg").FigureCanvasSVG
    with matplotlib.rc_context({**_STYLE, "svg.hashsalt": name}):
        figure = load("matplotlib.figure").Figure(figsize=size)
        axes = figure.add_subplot(projection=projection)
        draw(axes)
        # what `savefig` does, but for a first drawing that is thrown away and only serves to place the axes
        page, buffer, resolution = canvas(figure), io.StringIO(), figure.dpi
        if projection is None and figure.axes == [axes]:
            fit(axes)
        else:
            figure.get_layout_engine().execute(figure)
        figure.set_layout_engine("none")
        figure.dpi = resolution
        page.print_svg(buffer, metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :].replace(INK, "currentColor")
    text = re.sub(r"<metadata>.*?</metadata>\s*", "", text, flags=re.DOTALL)
    # a style element would apply to the whole page
    text = re.sub(r"<style[^>]*>\*{([^}]*)}</style>", "", text)
    text = re.sub(r' (width|height)="[\d.]+pt"', "", text, count=2)
    text = re.sub(r'(id="|href="#|url\(#)', rf"\g<1>{name}-", text)
    return text.replace("<svg", '<svg style="stroke-linejoin: round; stroke-linecap: butt"', 1)


def fit(axes: Any) -> None:
    """Place axes that are alone so that their labels end where the constrained layout has them end.

    That layout measures them twice, which takes longer than drawing; from a first place near the last one, once does.
    """
    axes.set_position((0.14, 0.15, 0.84, 0.83))
    figure, held = axes.figure, axes.get_position(original=True)
    box = axes.get_tightbbox(for_layout_only=True).transformed(figure.transFigure.inverted())
    pad = PAD / figure.get_size_inches()
    low, high = held.min - box.min + pad, 1.0 + held.max - box.max - pad
    axes.set_position((*low, *(high - low)))


def plot_gradation(axes: Any, packing: Packing) -> Any:
    """Draw the gradation by volume: as placed and, if a distribution was given, as requested.

    A grain passes a sieve by its intermediate axis; the curves over axis and diameter are drawn if they differ.
    """
    diameters = packing.diameters
    ratio = sieve_ratio(packing)
    middle = diameters * ratio
    plot_passing(axes, diameters, packing.volumes, color=PLACED, label="placed, equivalent diameter")
    if packing.count and np.abs(ratio - 1).max() > 0.01 and packing.dimension == 3:
        plot_passing(axes, middle, packing.volumes, color=OTHER, label="placed, intermediate axis")
    asked = packing.asked_sizes
    low, high = 1.0, 1.0
    if packing.count:
        low, high = size_range(np.concatenate([diameters, middle]), asked, packing.dimension)
    if asked is not None and packing.count:
        sizes = np.geomspace(0.8 * low, 1.25 * high, 600)
        shares = 100 * asked.cumulative(sizes, basis="volume", dimension=packing.dimension)
        what = "intermediate axis" if asked.by_intermediate_axis else "equivalent diameter"
        axes.plot(sizes, shares, color=ASKED, linestyle=(0, (4, 2)), label=f"requested, {what}")
    if high > 4 * low:
        set_log_scale(axes)
    axes.set(ylim=(0, 101), xlabel=f"size{unit_text(packing.unit)}", ylabel="passing by volume (%)")
    axes.legend(loc="best")
    return axes


def planned_svg(sizes: SizeDistribution | None, plan: SizePlan | None, *, dimension: int, unit: str) -> str:
    """Return a drawing of a distribution by volume with D10 to D60 of the planned grains; empty without one."""
    if sizes is None:
        return ""
    # laws without a smallest or largest size have long tails
    shares = np.linspace(0.001, 0.999, 101)
    curve = sizes.quantile(shares, basis="volume", dimension=dimension)

    def draw(axes: Any) -> None:
        axes.plot(curve, 100 * shares, color=ASKED, label=None if plan is None else "asked")
        if plan is not None:
            held = [plan.held[name] for name in SHARES]
            axes.plot(held, [100 * share for share in SHARES.values()], "o", color=PLACED, label=f"{plan.count} grains")
            axes.legend(loc="best")
        axes.set(ylim=(0, 101), xlabel=f"size{unit_text(unit)}", ylabel="passing by volume (%)")
        set_log_scale(axes)

    return svg_of(draw, "sizes", size=(4.2, 3.0))


def plot_profile(
    axes: Any,
    place: "ArrayLike",
    solid_fraction: "ArrayLike",
    *,
    name: str,
    unit: str,
    error: "ArrayLike" = 0.0,
    levels: Mapping[str, float] | None = None,
    published: "Mapping[str, ArrayLike] | None" = None,
) -> Any:
    """Draw the solid fraction (n,) over a coordinate (n,) of this name, in the unit of lengths; NaN leaves a gap.

    Errors that are not 0 are drawn as a band on both sides, levels as horizontal lines and published curves (n,) as
    dashed lines, by their names.

    Raises
    ------
    InputError
        If the coordinate is not an (n,) array of finite numbers.
    """
    x, y = as_floats(place, "place", shape=(None,)), np.asarray(solid_fraction, dtype=np.float64)
    marks = {label: value for label, value in (levels or {}).items() if np.isfinite(value)}
    for (label, value), dash in zip(marks.items(), ((2, 2), (6, 2), (6, 2, 1, 2)), strict=False):
        axes.axhline(value, color=INK, linewidth=1.0, linestyle=(0, dash), label=f"{label}: {value:.3f}")
    for (label, curve), color in zip((published or {}).items(), (ASKED, OTHER), strict=False):
        axes.plot(x, curve, color=color, linewidth=1.5, linestyle=(0, (4, 2)), label=label)
    if marks or published:
        axes.legend(loc="best")
    band = np.asarray(error, dtype=np.float64)
    if (band > 0).any():
        axes.fill_between(x, y - band, y + band, color=PLACED, alpha=0.25, linewidth=0)
    axes.plot(x, y, color=PLACED)
    top = max(np.nanmax(y, initial=0.0), *marks.values(), 0.05)
    axes.set(xlabel=f"{name}{unit_text(unit)}", ylabel="solid fraction", ylim=(0, min(1.08 * top, max(1.02, top))))
    return axes


def plot_coordination(
    axes: Any, gap: "ArrayLike", coordination_number: "ArrayLike", *, unit: str, name: str = "gap"
) -> Any:
    """Draw the mean coordination number (n,) over the gap (n,) up to which grains count as neighbours, in `unit`, such
    as ``"mean diameters"``; `name` is the label of the axis.

    Raises
    ------
    InputError
        If the arrays are not (n,) arrays of finite numbers.
    """
    x = as_floats(gap, "gap", shape=(None,))
    y = as_floats(coordination_number, "coordination_number", shape=(len(x),))
    axes.plot(x, y, color=PLACED, marker="o", markersize=4, clip_on=False)
    if len(x) and x.max() > 0:
        # gaps span decades and start at 0
        axes.set_xscale("symlog", linthresh=float(x[x > 0].min()), linscale=0.4)
        axes.xaxis.set_major_formatter(mark_of)
    axes.set(xlabel=f"{name}{unit_text(unit)}", ylabel="mean coordination number")
    axes.set_ylim(0, max(1.08 * float(y.max(initial=0.0)), 1.0))
    return axes


def plot_estimate(
    axes: Any,
    place: "ArrayLike",
    estimate: "ArrayLike",
    *,
    label: str,
    name: str,
    error: "ArrayLike" = 0.0,
    level: float | None = None,
    logarithmic: bool = False,
) -> Any:
    """Draw an estimate (n,) over a coordinate (n,) with its standard errors as a band; NaN leaves a gap.

    `label` is that of the axis of the coordinate, unit included, and `name` that of the other one. A `level` is a
    dashed line; logarithmic axes leave out values that are not above 0.

    Raises
    ------
    InputError
        If the coordinate is not an (n,) array of finite numbers.
    """
    x, y = as_floats(place, "place", shape=(None,)), np.asarray(estimate, dtype=np.float64)
    band = np.nan_to_num(np.asarray(error, dtype=np.float64)) + np.zeros(len(x))
    low, marker = y - band, "o" if logarithmic else None
    if logarithmic:
        y = np.where(y > 0, y, np.nan)
        low = np.where(low > 0, low, 0.5 * y)
        # limits follow from the scale
        axes.set(xscale="log", yscale="log")
    if level is not None:
        axes.axhline(level, color=INK, linewidth=1.0, linestyle=(0, (2, 2)))
    if (band > 0).any():
        axes.fill_between(x, low, y + band, color=PLACED, alpha=0.25, linewidth=0)
    axes.plot(x, y, color=PLACED, marker=marker, markersize=4)
    axes.set(xlabel=label, ylabel=name)
    if logarithmic:
        set_log_scale(axes, "x")
        set_log_scale(axes, "y")
    else:
        axes.set(xlim=(float(x.min(initial=0.0)), None), ylim=(0, None))
    return axes


def plot_contact_numbers(axes: Any, numbers: "ArrayLike", probability: "ArrayLike", *, error: "ArrayLike" = 0.0) -> Any:
    """Draw the probability (n,) of each number of contacts (n,) as bars, with standard errors.

    Raises
    ------
    InputError
        If the arrays are not (n,) arrays of finite numbers.
    """
    x = as_floats(numbers, "numbers", shape=(None,))
    y = as_floats(probability, "probability", shape=(len(x),))
    bars = np.broadcast_to(np.asarray(error, dtype=np.float64), y.shape)
    axes.bar(x, y, width=0.85, color=PLACED, linewidth=0)
    axes.errorbar(x, y, yerr=bars, fmt="none", ecolor=INK, elinewidth=0.8)
    axes.xaxis.set_major_locator(load("matplotlib.ticker").MaxNLocator(integer=True))
    axes.set(xlabel="contacts of a grain with others", ylabel="share of the grains", ylim=(0, None))
    return axes


def plot_forces(axes: Any, relative: "ArrayLike", density: "ArrayLike", *, decay: float = np.nan) -> Any:
    """Draw the probability density (n,) of normal forces over their mean (n,), with the published law of beads under a
    piston, Mueth, Jaeger & Nagel 1998, doi:10.1103/PhysRevE.57.3164; `decay` is that of the tail, NaN if not known.

    Raises
    ------
    InputError
        If the arrays are not (n,) arrays of finite numbers.
    """
    x = as_floats(relative, "relative", shape=(None,))
    y = as_floats(density, "density", shape=(len(x),))
    law = 3.0 * (1.0 - 0.75 * np.exp(-(x**2))) * np.exp(-1.5 * x)
    axes.plot(x, law, color=ASKED, linewidth=1.5, linestyle=(0, (4, 2)), label="Mueth 1998")
    label = f"decay of the tail {decay:.2f}" if np.isfinite(decay) else "here"
    seen = y > 0
    axes.plot(x[seen], y[seen], color=PLACED, marker="o", markersize=4, label=label)
    low = min(float(y[seen].min(initial=1.0)), 0.01)
    axes.set(xlabel="normal force / mean", ylabel="probability density", ylim=(0.5 * low, 2.0), xlim=(0, None))
    set_log_scale(axes, "y")
    axes.legend(loc="best")
    return axes


def plot_densities(axes: Any, place: "ArrayLike", curves: "Mapping[str, ArrayLike]", *, name: str, unit: str) -> Any:
    """Draw probability densities (n,) over the middles (n,) of equal bins of a quantity of this name, in `unit`.

    Several curves have the last parts of their names as labels, such as the axes of chords.

    Raises
    ------
    InputError
        If the arrays are not (n,) arrays of finite numbers.
    """
    x = as_floats(place, "place", shape=(None,))
    for (label, values), color in zip(curves.items(), (PLACED, ASKED, OTHER), strict=False):
        y = as_floats(values, label, shape=(len(x),))
        axes.step(x, y, where="mid", color=color, label=f"along {label[-1]}" if len(curves) > 1 else None)
    if len(curves) > 1:
        axes.legend(loc="best")
    axes.set(xlabel=f"{name}{unit_text(unit)}", ylabel="probability density")
    axes.set_ylim(0, None)
    return axes


def sieve_ratio(packing: Packing) -> Floats:
    """Return the ratio of the intermediate axis of each grain, by which it passes a sieve, to its diameter."""
    of_shape = [principal_extents(shape)[1] / shape.diameter for shape in packing.shapes]
    return np.array([*of_shape, 1.0])[packing.shape_id]


def plot_passing(axes: Any, sizes: Floats, volumes: Floats, *, color: str, label: str | None) -> None:
    """Draw a step curve of the share by volume up to each size, thinned to the resolution of the plot."""
    order = np.argsort(sizes, kind="stable")
    share = 100 * np.cumsum(volumes[order]) / max(float(volumes.sum()), 1e-300)
    keep = np.unique(np.linspace(0, max(len(order) - 1, 0), 400).astype(int))[: len(order)]
    x, y = sizes[order][keep], share[keep]
    axes.step(
        np.concatenate([x[:1], x]), np.concatenate([[0.0] * len(x[:1]), y]), where="post", color=color, label=label
    )


def set_log_scale(axes: Any, along: str = "x") -> None:
    """Make an axis, whose limits are final, logarithmic, with plain numbers at its marks: formulas take far longer."""
    axes.set(**{f"{along}scale": "log"})
    axis, (low, high) = getattr(axes, f"{along}axis"), getattr(axes, f"get_{along}lim")()
    ticker = load("matplotlib.ticker")
    # in few decades numbers at 2 and 5 find room
    axis.set_major_locator(ticker.LogLocator(subs=(1.0, 2.0, 5.0) if high < 100.0 * low else (1.0,)))
    axis.set_major_formatter(mark_of)
    axis.set_minor_formatter(ticker.NullFormatter())


def mark_of(value: float, place: int | None = None) -> str:
    """Return a number at a mark of an axis: digits, or a power of ten where they are many."""
    del place
    if value == 0 or 1e-3 <= abs(value) < 1e4:
        return f"{value:g}"
    # ranges of less than a decade have marks of several digits
    digits, power = f"{value:.5e}".split("e")
    head = {1.0: "", -1.0: "-"}.get(float(digits), f"{float(digits):g}\u00b7")
    return f"{head}10{str(int(power)).translate(RAISED)}"


def unit_text(unit: str) -> str:
    """Return the unit in brackets for the label of an axis; empty if there is none."""
    return "" if unit in ("", "1") else f" ({unit})"
