"""Comparison of packings on one page: numbers side by side, their differences and the significance of these.

A group is one packing, or several of a kind, such as those of several seeds. For several packings the mean and its
standard error are shown, and differences of means are tested by Welch's t-test over packings. A single packing has no
scatter: its differences are given without a statement of significance. Distributions over the grains are compared by
the Kolmogorov-Smirnov distance; a probability is given if there are enough packings for a permutation test.
"""

import os
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from voxgran import __version__
from voxgran._base.calls import explained
from voxgran._base.files import as_path, write_files
from voxgran.measures.registered.density import main_fraction
from voxgran.packing.model import Packing
from voxgran.report import facts, plots, scenes
from voxgran.report.colors import gradient
from voxgran.report.figures import curves_of
from voxgran.report.groups import Group, compared, distributions, groups_of
from voxgran.report.page import check_page_path, json_text, page_template, table_files, view_of
from voxgran.report.significance import LEVEL, p_text
from voxgran.report.view import views_of

#: largest number of packings of a group whose curves are drawn
DRAWN = 5
LEADS = (
    "Solid fraction, the mean of each group, of the region that is named below it; the first group is the reference "
    "for the others."
)


@explained(hint='save_comparison({"loose": bed, "dense": other}, "page.html")')
def save_comparison(
    packings: Mapping[str, Packing | Sequence[Packing]],
    path: str | os.PathLike[str],
    *,
    which: Sequence[str] | None = None,
    pictures: bool = True,
    title: str = "Comparison of packings",
    interactive: bool = True,
    overwrite: bool = False,
) -> None:
    """Write a self-contained HTML page that compares packings, and a JSON file with its numbers.

    Parameters
    ----------
    packings : mapping of str to Packing or sequence of Packing
        At least two groups; the first is the reference for the others and defines the unit of lengths. Several packings
        of a group must be independent of each other, such as those of several seeds, and give a standard error.
    path : path-like
        File to write, ``.html``; the numbers are written to the same name with the suffix ``.json``.
    which : sequence of str, optional
        Measures to compare. Default: all that apply.
    pictures : bool
        Whether one picture of each group is rendered; if false, the page has no interactive view.
    title : str
        Title of the page.
    interactive : bool
        Whether the page has a view of the first packing of each group that can be turned and cut in a browser.
    overwrite : bool
        Whether existing files may be replaced.

    Raises
    ------
    InputError
        If there are fewer than two groups, one of them is empty or contains the same packing twice, or only some
        packings have a unit.
    UnknownNameError
        If there is no measure of that name.
    FileFormatError
        If the suffix is not ``.html``.
    OutputExistsError
        If the page or the JSON file exists and `overwrite` is false.
    OutputError
        If a file cannot be written; existing files are then unchanged.

    Notes
    -----
    No significance is stated if a group has one packing. Numbers with a relative difference below 1e-9 are equal. Means
    are compared by Welch's t-test over packings; distributions over grains by a permutation test over packings, if
    there are at least four and four, three and four, or two and five. Groups packed with the same seeds may share
    random draws; both tests are then conservative.

    Examples
    --------
    >>> import voxgran as vg
    >>> dense = vg.pack(vg.shapes.sphere(), vg.Box((5, 5, 5)), "rsa", count=40)
    >>> beds = {"dense": dense, "loose": vg.remove_grains(dense, solid_fraction=0.1)}
    >>> vg.save_comparison(beds, "page.html", which=["coordination"], pictures=False)
    """
    twin = check_page_path(path, overwrite=overwrite)
    groups = groups_of(packings, which)
    rows, tests = compared(groups), distributions(groups)
    text = page_template("comparison.html.j2").render(
        version=__version__,
        title=title,
        lead=LEADS,
        groups=[_headline(group) for group in groups],
        head=_head(groups),
        rows=[_row(row, groups) for row in rows],
        notes=_notes(groups),
        tests=[_test_row(test) for test in tests],
        views=[_picture(group) for group in groups] if pictures else [],
        view=_view(groups) if interactive and pictures else None,
        gradient=", ".join(gradient()) if pictures else "gray, gray",
        figures=_figures(groups),
    )
    record = {
        "voxgran": __version__,
        "groups": [_record(group) for group in groups],
        "level": LEVEL,
        "numbers": rows,
        "distributions": tests,
    }
    tables = {"numbers": [_head(groups), *(_row(row, groups) for row in rows)]}
    if tests:
        tables["distributions"] = [["distribution", "group", "distance", "test"], *map(_test_row, tests)]
    files = table_files(as_path(path), tables)
    write_files({**files, as_path(path): text, twin: json_text(record)}, overwrite=overwrite)


def _record(group: Group) -> dict[str, Any]:
    """Return a JSON-able description of the packings of a group."""
    return {
        "name": group.name,
        **_fraction(group),
        "packings": len(group.packings),
        "grains": [packing.count for packing in group.packings],
        "methods": _methods(group),
        "seeds": [packing.provenance.get("seed") for packing in group.packings],
    }


def _methods(group: Group) -> list[str]:
    """Return the methods of the packings of a group, each once."""
    return list(dict.fromkeys(str(p.provenance.get("method") or "method not known") for p in group.packings))


def _headline(group: Group) -> dict[str, str]:
    """Return name, mean solid fraction and contents of a group."""
    counts = [packing.count for packing in group.packings]
    grains = " to ".join(facts.number(count) for count in sorted({min(counts), max(counts)}))
    many = f"{len(counts)} packings of " if len(counts) > 1 else ""
    known = _fraction(group)
    note = f"solid fraction of the {known['region']}; {many}{grains} grains, {', '.join(_methods(group))}"
    return {"name": group.name, "value": f"{known['solid_fraction']:.4f}", "note": note}


def _fraction(group: Group) -> dict[str, Any]:
    """Return the mean solid fraction of the packings of a group, and of which regions it is."""
    found = [main_fraction(*pair) for pair in zip(group.packings, group.trees, strict=True)]
    regions = " or ".join(dict.fromkeys(region for region, _ in found))
    return {"solid_fraction": float(np.mean([value for _, value in found])), "region": regions}


def _notes(groups: Sequence[Group]) -> list[str]:
    """Return the notes on the numbers of the table and on the significance of their differences."""
    single = [group.name for group in groups if len(group.packings) == 1]
    notes = [f"Differences are from {groups[0].name}; equal: no difference beyond rounding."]
    if len(single) < len(groups):
        notes.append("Of several packings the mean and its standard error are given.")
    if len(groups[0].packings) > 1 and any(len(group.packings) > 1 for group in groups[1:]):
        notes.append(
            "The packings of a group are its independent samples: a difference is called significant where "
            f"Welch\u2019s t-test gives a probability p below {LEVEL:g} for one as large by chance. Where nothing "
            "differs, about one in twenty differences is called so all the same."
        )
    if single:
        one = "has one packing" if len(single) == 1 else "have one packing each"
        notes.append(
            f"No significance is claimed for differences from or of {', '.join(single)}, which {one}: nothing is known "
            "of the scatter between packings. Packings with several seeds would tell."
        )
    return notes


def _head(groups: Sequence[Group]) -> list[str]:
    """Return the heads of the columns."""
    return ["", *(group.name for group in groups), *(f"{group.name} \u2212 {groups[0].name}" for group in groups[1:])]


def _row(row: Mapping[str, Any], groups: Sequence[Group]) -> list[str]:
    """Return a row of the table as texts."""
    unit = "" if row["unit"] == "1" else f" ({row['unit']})"
    entries = [(row["groups"].get(group.name), len(group.packings)) for group in groups]
    cells = ["" if entry is None else _mean_text(entry, many) for entry, many in entries]
    differences = ["" if entry is None else _difference_text(entry) for entry, _ in entries[1:]]
    return [f"{row['long_name']}{unit}", *cells, *differences]


def _mean_text(entry: Mapping[str, Any], packings: int) -> str:
    """Return a mean with its standard error as text, with the number of packings if some have no value."""
    if entry["mean"] is None:
        return "not known"
    known = "" if entry["known"] == packings else f" ({entry['known']} of {packings})"
    mean, error = entry["mean"], entry["standard_error"]
    if not error:
        return _number(mean) + known
    digits = facts.decimals_of(error)
    if digits is None:
        return f"{_number(mean)} \u00b1 {error:.2g}{known}"
    return f"{mean:.{digits}f} \u00b1 {error:.{digits}f}{known}".replace("-", "\u2212")


def _difference_text(entry: Mapping[str, Any]) -> str:
    """Return a difference as text, with its significance if that was tested."""
    if entry["difference"] is None:
        return "not known"
    if entry["verdict"] == "equal":
        return "equal"
    text = _number(entry["difference"])
    return text if entry["p_value"] is None else f"{text} ({entry['verdict']}, {p_text(entry['p_value'])})"


def _number(value: float) -> str:
    """Return a mean as text; whole numbers with all digits."""
    return facts.number(int(value) if value.is_integer() and abs(value) < 1e9 else value)


def _test_row(test: Mapping[str, Any]) -> list[str]:
    """Return a row of the table of distributions as texts."""
    text = test["verdict"] if test["p_value"] is None else f"{test['verdict']}, {p_text(test['p_value'])}"
    return [test["what"], test["group"], f"{test['distance']:.3g}", text]


def _picture(group: Group) -> Any:
    """Return a picture of the first packing of a group."""
    picture = scenes.picture_packing(group.packings[0], window=(600, 600))
    many = len(group.packings)
    caption = group.name if many == 1 else f"{group.name}: the first of {many} packings"
    return view_of(picture, f"{caption}, seen from outside", caption)


def _view(groups: Sequence[Group]) -> dict[str, Any] | None:
    """Return the interactive view of the first packing of each group."""
    return views_of({group.name: group.packings[0] for group in groups})


def _figures(groups: Sequence[Group]) -> list[dict[str, str]]:
    """Return the plots of the curves that all packings have."""
    drawn = [list(zip(group.packings, group.trees, strict=True))[:DRAWN] for group in groups]
    curves = [[{name: data for data, name in curves_of(*pair)} for pair in pairs] for pairs in drawn]
    more = any(len(group.packings) > DRAWN for group in groups)
    note = f" The first {DRAWN} packings of each group are drawn." if more else ""
    figures = []
    if all(packing.count for pairs in drawn for packing, _ in pairs):
        svg = plots.svg_of(partial(_draw_sizes, groups=groups), "sizes")
        caption = f"Gradation: share by volume up to each equivalent diameter.{note}"
        figures.append({"svg": svg, "alt": "gradation", "caption": caption})
    for name in curves[0][0]:
        if all(name in one for of_group in curves for one in of_group):
            found = [[one[name] for one in of_group] for of_group in curves]
            svg = plots.svg_of(partial(_draw, groups=groups, found=found, name=name), name.replace("_", "-"))
            title = str(found[0][0][name].attrs.get("long_name", name))
            caption = f"{title[:1].upper()}{title[1:]}.{note}"
            figures.append({"svg": svg, "alt": title, "caption": caption})
    return figures


def _draw_sizes(axes: Any, *, groups: Sequence[Group]) -> None:
    """Draw the gradations of all packings, those of a group in one colour."""
    for group, ink in zip(groups, plots.DISTINCT * len(groups), strict=False):
        for index, packing in enumerate(group.packings[:DRAWN]):
            label = group.name if index == 0 else None
            plots.plot_passing(axes, packing.diameters, packing.volumes, color=ink, label=label)
    unit = plots.unit_text(groups[0].packings[0].unit)
    axes.set(ylim=(0, 101), xlabel=f"equivalent diameter{unit}", ylabel="passing by volume (%)")
    axes.legend(loc="best")


def _draw(axes: Any, *, groups: Sequence[Group], found: Sequence[Sequence[Any]], name: str) -> None:
    """Draw one curve of each packing, those of a group in one colour."""
    label = "solid fraction" if name.startswith("solid_fraction") else name.replace("_", " ")
    for group, datasets, ink in zip(groups, found, plots.DISTINCT * len(groups), strict=False):
        for index, data in enumerate(datasets):
            place = data[name][data[name].dims[0]]
            line = {"color": ink, "linewidth": 2.0 if len(datasets) == 1 else 1.2}
            axes.plot(place.values, data[name].values, label=group.name if index == 0 else None, **line)
            unit = plots.unit_text(str(place.attrs.get("units", "1")))
            axes.set(xlabel=f"{place.attrs.get('long_name', place.name)}{unit}", ylabel=label)
            if place.name == "gap" and (place.values > 0).any():
                axes.set_xscale("symlog", linthresh=float(place.values[place.values > 0].min()), linscale=0.4)
    axes.set_ylim(bottom=0)
    axes.legend(loc="best")
