"""Several packings on one page: numbers side by side, their differences, and whether these mean anything.

Of several packings of a kind (seeds) the mean and its standard error are shown, and differences of means are tested by
Welch's t test. A single packing has no scatter: there the per-grain distributions are compared by the two-sample
Kolmogorov-Smirnov test, and differences of numbers are given without a verdict.
"""

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from voxgran import __version__
from voxgran._base.arrays import Floats
from voxgran._base.errors import InputError
from voxgran._base.files import as_path, refuse_to_replace, write_text
from voxgran._base.lazy import load
from voxgran.measure.model import measure
from voxgran.packing.model import Packing
from voxgran.report import facts, plots, scenes
from voxgran.report.figures import curves_of
from voxgran.report.numbers import json_text
from voxgran.report.page import page_template, view_of

if TYPE_CHECKING:
    from xarray import DataTree

#: colours of the packings in plots, in their order
INKS = ("#2a9d8f", "#e07a3f", "#7a86c8", "#c2476d", "#8a8d3a", "#4f6d7a")
#: probability of a difference by chance below which it is called one
LEVEL = 0.05


@dataclass(frozen=True, slots=True)
class Kind:
    """Packings that are compared as one.

    Attributes
    ----------
    name : str
        What the page calls them.
    packings : tuple of Packing
        One, or several with different seeds.
    trees : tuple of DataTree
        Their measures.
    """

    name: str
    packings: tuple[Packing, ...]
    trees: "tuple[DataTree, ...]"

    def numbers(self) -> dict[str, Floats]:
        """Return each single number of all packings, (k,)."""
        names = [
            str(name)
            for name, value in self.trees[0].data_vars.items()
            if not value.ndim and value.dtype.kind in "biuf" and all(name in tree for tree in self.trees)
        ]
        return {name: np.array([float(tree[name]) for tree in self.trees]) for name in names}

    def sizes(self) -> Floats:
        """Return the equivalent diameters of all grains."""
        return np.concatenate([packing.diameters for packing in self.packings])


def write_comparison(
    packings: Mapping[str, Packing | Sequence[Packing]],
    path: str | os.PathLike[str],
    *,
    which: Sequence[str] | None = None,
    pictures: bool = True,
    title: str = "Comparison of packings",
    overwrite: bool = False,
) -> None:
    """Write one self-contained page that compares packings, and every number of it as JSON beside it.

    Parameters
    ----------
    packings : mapping of str to Packing or sequence of Packing
        At least two kinds; the first is what the others are compared with. Several packings of a kind, such as those
        of several seeds, give it a standard error.
    path : path-like
        File to write, by custom ``.html``; the numbers go to the file of the same name with the suffix ``.json``.
    which : sequence of str, optional
        Measures to compare; all that apply where left out.
    pictures : bool
        Whether one picture of each kind is rendered.
    title : str
        Headline of the page.
    overwrite : bool
        Whether what is there may be replaced.

    Raises
    ------
    InputError
        If there are fewer than two kinds, or one of them is empty.
    UnknownNameError
        If there is no measure of that name.
    OutputExistsError
        If the page or its numbers are there and `overwrite` is false.
    OutputError
        If it cannot be written; what was there before is untouched.
    """
    twin = as_path(path).with_suffix(".json")
    if not overwrite:
        refuse_to_replace(path, twin)
    kinds = _kinds(packings, which)
    rows, tests = compared(kinds), distributions(kinds)
    text = page_template("comparison.html.j2").render(
        version=__version__,
        title=title,
        kinds=[_headline(kind) for kind in kinds],
        head=_head(kinds),
        rows=[_row(row, kinds) for row in rows],
        tests=[_test_row(test) for test in tests],
        views=[_picture(kind) for kind in kinds] if pictures else [],
        figures=_figures(kinds),
        replicated=any(len(kind.packings) > 1 for kind in kinds),
        level=LEVEL,
    )
    write_text(path, text, overwrite=overwrite)
    record = {"voxgran": __version__, "kinds": [kind.name for kind in kinds], "numbers": rows, "distributions": tests}
    write_text(twin, json_text(record), overwrite=overwrite)


def _kinds(packings: Mapping[str, Packing | Sequence[Packing]], which: Sequence[str] | None) -> list[Kind]:
    """Measure all packings."""
    if len(packings) < 2:
        raise InputError(f"packings has {len(packings)} entries: a comparison needs at least two; add another")
    kinds = []
    for name, given in packings.items():
        group = (given,) if isinstance(given, Packing) else tuple(given)
        if not group:
            raise InputError(f"packings {name!r} is empty: give at least one packing")
        kinds.append(Kind(name, group, tuple(measure(packing, which=which) for packing in group)))
    return kinds


def compared(kinds: Sequence[Kind]) -> list[dict[str, Any]]:
    """Return each number of all kinds, its difference from the first kind, and how likely that is by chance.

    Parameters
    ----------
    kinds : sequence of Kind
        The first is the reference.

    Returns
    -------
    list of dict
        With ``name``, and by kind ``mean``, ``standard_error`` (None for one packing), ``difference`` and ``p_value``
        (Welch's t test; None where a kind has one packing).
    """
    all_numbers = [kind.numbers() for kind in kinds]
    names = [name for name in all_numbers[0] if any(name in numbers for numbers in all_numbers[1:])]
    rows = []
    for name in names:
        first, entries = all_numbers[0][name], {}
        attrs = kinds[0].trees[0][name].attrs
        for kind, numbers in zip(kinds, all_numbers, strict=True):
            if name in numbers:
                entries[kind.name] = _entry(numbers[name], first if kind is not kinds[0] else None)
        rows.append(
            {
                "name": name,
                "long_name": str(attrs.get("long_name", name)),
                "unit": str(attrs.get("units", "1")),
                "kinds": entries,
            }
        )
    return rows


def _entry(values: Floats, reference: Floats | None) -> dict[str, float | None]:
    """Return mean, standard error, difference and p-value of the values of a kind."""
    several = len(values) > 1
    entry: dict[str, float | None] = {
        "mean": float(values.mean()),
        "standard_error": float(values.std(ddof=1) / math.sqrt(len(values))) if several else None,
        "difference": None,
        "p_value": None,
    }
    if reference is None:
        return entry
    entry["difference"] = float(values.mean() - reference.mean())
    if several and len(reference) > 1 and np.isfinite(values).all() and np.isfinite(reference).all():
        if np.ptp(values) == np.ptp(reference) == 0:
            entry["p_value"] = 1.0 if values[0] == reference[0] else 0.0
        else:
            entry["p_value"] = float(load("scipy.stats").ttest_ind(values, reference, equal_var=False).pvalue)
    return entry


def distributions(kinds: Sequence[Kind]) -> list[dict[str, Any]]:
    """Compare sizes and coordination numbers of the grains with those of the first kind.

    Parameters
    ----------
    kinds : sequence of Kind
        The first is the reference.

    Returns
    -------
    list of dict
        With ``what``, ``kind``, the Kolmogorov-Smirnov ``distance``, and its ``p_value``.
    """
    found = []
    for what, values_of in (("equivalent diameter", Kind.sizes), ("coordination number", _coordination)):
        first = values_of(kinds[0])
        for kind in kinds[1:]:
            values = values_of(kind)
            if first is None or values is None or not len(first) or not len(values):
                continue
            test = load("scipy.stats").ks_2samp(first, values, method="asymp")
            distance, p_value = float(test.statistic), float(test.pvalue)
            found.append({"what": what, "kind": kind.name, "distance": distance, "p_value": p_value})
    return found


def _coordination(kind: Kind) -> Floats | None:
    """Return the coordination numbers of all grains, where they were measured."""
    grains = [tree["/grains"] for tree in kind.trees if "/grains" in tree.groups]
    if len(grains) < len(kind.trees) or any("coordination_number" not in group for group in grains):
        return None
    return np.concatenate([np.asarray(group["coordination_number"].values, dtype=np.float64) for group in grains])


def _headline(kind: Kind) -> dict[str, str]:
    """Return name and contents of a kind."""
    first, many = kind.packings[0], len(kind.packings)
    method = str(first.provenance.get("method", "")) or "method not known"
    note = f"{first.count} grains, {method}" + (f", {many} packings" if many > 1 else "")
    return {"name": kind.name, "value": f"{np.mean([p.solid_fraction for p in kind.packings]):.4f}", "note": note}


def _head(kinds: Sequence[Kind]) -> list[str]:
    """Return the heads of the columns."""
    return ["", *(kind.name for kind in kinds), *(f"{kind.name} \u2212 {kinds[0].name}" for kind in kinds[1:])]


def _row(row: Mapping[str, Any], kinds: Sequence[Kind]) -> list[str]:
    """Return a row of the table as texts."""
    unit = "" if row["unit"] == "1" else f" ({row['unit']})"
    cells = [f"{row['long_name']}{unit}"]
    for kind in kinds:
        entry = row["kinds"].get(kind.name)
        error = "" if entry is None or entry["standard_error"] is None else f" \u00b1 {entry['standard_error']:.2g}"
        cells.append("" if entry is None else facts.number(entry["mean"]) + error)
    for kind in kinds[1:]:
        entry = row["kinds"].get(kind.name)
        cells.append("" if entry is None else _verdict(entry))
    return cells


def _verdict(entry: Mapping[str, Any]) -> str:
    """Write a difference and whether it means anything."""
    text = facts.number(entry["difference"])
    if entry["p_value"] is None:
        return text
    word = "significant" if entry["p_value"] < LEVEL else "may be chance"
    return f"{text} ({word}, p = {entry['p_value']:.2g})"


def _test_row(test: Mapping[str, Any]) -> list[str]:
    """Return a row of the table of distributions as texts."""
    word = "differ" if test["p_value"] < LEVEL else "may be the same"
    return [test["what"], test["kind"], f"{test['distance']:.3g}", f"{test['p_value']:.2g}", word]


def _picture(kind: Kind) -> Any:
    """Return a picture of the first packing of a kind."""
    picture = scenes.picture_packing(kind.packings[0], window=(600, 600))
    return view_of(picture, f"{kind.name}, seen from outside", kind.name)


def _figures(kinds: Sequence[Kind]) -> list[dict[str, str]]:
    """Return the curves that all kinds have, over each other."""
    curves = [{name: data for data, name in curves_of(kind.packings[0], kind.trees[0])} for kind in kinds]
    figures = []
    if all(kind.packings[0].count for kind in kinds):
        svg = plots.svg_of(partial(_draw_sizes, kinds=kinds), "sizes")
        figures.append({"svg": svg, "alt": "gradation", "caption": "Gradation by volume of each."})
    for name in curves[0]:
        if all(name in found for found in curves):
            found = [one[name] for one in curves]
            draw = partial(_draw, kinds=kinds, found=found, name=name)
            svg = plots.svg_of(draw, name.replace("_", "-"))
            title = str(found[0][name].attrs.get("long_name", name))
            figures.append({"svg": svg, "alt": title, "caption": f"{title[:1].upper()}{title[1:]}."})
    return figures


def _draw_sizes(axes: Any, *, kinds: Sequence[Kind]) -> None:
    """Draw the gradations."""
    for kind, ink in zip(kinds, INKS * len(kinds), strict=False):
        packing = kind.packings[0]
        plots.plot_passing(axes, packing.diameters, packing.volumes, color=ink, label=kind.name)
    axes.set(ylim=(0, 101), xlabel="equivalent diameter", ylabel="passing by volume (%)")
    axes.legend(loc="best")


def _draw(axes: Any, *, kinds: Sequence[Kind], found: Sequence[Any], name: str) -> None:
    """Draw one curve of each kind."""
    label = "solid fraction" if name.startswith("solid_fraction") else name.replace("_", " ")
    for kind, data, ink in zip(kinds, found, INKS * len(kinds), strict=False):
        place = data[name][data[name].dims[0]]
        axes.plot(place.values, data[name].values, color=ink, label=kind.name)
        axes.set(xlabel=str(place.attrs.get("long_name", place.name)), ylabel=label)
        if place.name == "gap" and (place.values > 0).any():
            axes.set_xscale("symlog", linthresh=float(place.values[place.values > 0].min()), linscale=0.4)
    axes.set_ylim(bottom=0)
    axes.legend(loc="best")
