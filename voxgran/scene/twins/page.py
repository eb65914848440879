"""Page of a sample and its twin: both in the same view and cut, their differences, the largest first, and curves."""

import os
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from voxgran import __version__
from voxgran._base.files import as_path, write_files
from voxgran._base.lazy import load
from voxgran._base.progress import OnStep, Step, repeated
from voxgran._base.units import NO_UNIT
from voxgran.io.netcdf import save_statistics
from voxgran.packing.model import Packing
from voxgran.report import facts, plots, scenes
from voxgran.report.colors import gradient
from voxgran.report.page import check_page_path, json_text, page_template, view_of
from voxgran.report.view import views_of
from voxgran.scene.twins.differences import CURVES

#: difference, in standard errors, up to which sample and twin are equal
EQUAL = 2.0
LEADS = "Solid fractions: of a scan up to its border, of a bed in its bulk, far from walls and surface."
TELLS = (
    "The scatter is the standard error of a number, from eight blocks of the packing; with several twins it is the "
    "standard deviation between them. The ratio is the difference over both scatters together: sample and twin are "
    f"equal within what another part of the same material differs by where it is below {EQUAL:g}, of one row in twenty "
    "by chance not. The largest ratio comes first."
)
KEEPS = "A twin does not keep the history of the sample, cementation, or the directions of force chains."


def write_page(twin: Any, path: str | os.PathLike[str], *, overwrite: bool) -> None:
    """Write a page of a twin and a JSON file of its numbers."""
    numbers = check_page_path(path, overwrite=overwrite)
    data = twin.comparison
    shown = {"sample": twin.sample.packing, "twin": twin.packing}
    known = {name: packing for name, packing in shown.items() if packing is not None}
    order = np.argsort(-np.nan_to_num(np.abs(data["ratio"].values), nan=-1.0), kind="stable")
    text = page_template("comparison.html.j2").render(
        version=__version__,
        title="Sample and twin",
        lead=LEADS,
        groups=[_headline(name, packing, twin) for name, packing in shown.items()],
        head=["", "sample", "twin", "difference", "ratio"],
        rows=[_row(data, int(k)) for k in order],
        notes=[TELLS, KEEPS],
        tests=[],
        # sample beside twin from outside, and below both cut
        views=[view for pair in zip(*(_pictures(*one) for one in known.items()), strict=True) for view in pair],
        view=views_of(known),
        gradient=", ".join(gradient()),
        figures=_curves(data),
    )
    names = ("sample", "twin", "difference", "sample_scatter", "twin_scatter", "ratio")
    table = [{"measure": str(m), **{n: float(data[n][k]) for n in names}} for k, m in enumerate(data["measure"].values)]
    record = {"voxgran": __version__, "numbers": table}
    write_files({as_path(path): text, numbers: json_text(record)}, overwrite=overwrite)


def written(twin: Any, folder: Path, *, page: bool = True, on_step: OnStep | None = None) -> dict[str, Any]:
    """Write the learned shapes, the comparison and the page of a twin into a folder, and return the main numbers."""
    with repeated(on_step) as told:
        told(Step(stage="comparing", done=0, total=0, text="with the sample"))
        data = twin.comparison
        if twin.model is not None:
            twin.model.save(folder / "shapes.nc", overwrite=True)
        save_statistics(load("xarray").DataTree(dataset=data), folder / "comparison.nc", overwrite=True)
        if page:
            told(Step(stage="comparing", done=0, total=0, text="drawing the page"))
            write_page(twin, folder / "twin.html", overwrite=True)
    ratios = np.nan_to_num(np.abs(data["ratio"].values))
    return {
        "grains": twin.packing.count,
        "sample_solid_fraction": twin.sample.solid_fraction,
        "solid_fraction": float(data["twin"].sel(measure="solid_fraction")),
        "largest_ratio": float(ratios.max()),
        "largest_difference": str(data["text"].values[int(ratios.argmax())]),
    }


def _headline(name: str, packing: Packing | None, twin: Any) -> dict[str, str]:
    """Return the solid fraction and the contents of the sample or the twin."""
    found = twin.comparison[name].sel(measure="solid_fraction")
    many = len(twin.sample.shapes)
    count = f"{facts.number(many)} shapes" if packing is None else f"{facts.number(packing.count)} grains"
    cut = (
        f", {facts.number(many)} of them whole"
        if name == "sample" and packing is not None and many < packing.count
        else ""
    )
    note = count + cut if len(twin.packings) == 1 or name == "sample" else f"{len(twin.packings)} packings of {count}"
    return {"name": name, "value": f"{float(found):.4f}", "note": f"solid fraction; {note}"}


def _row(data: Any, k: int) -> list[str]:
    """Return a row of the table of differences as texts."""
    unit = str(data["unit"].values[k])
    name = str(data["text"].values[k]) + ("" if unit == NO_UNIT else f" ({unit})")
    ratio = float(data["ratio"].values[k])
    difference = float(data["difference"].values[k])
    texts = [_with_error(float(data[n][k]), float(data[f"{n}_scatter"][k])) for n in ("sample", "twin")]
    verdict = "not known" if not np.isfinite(ratio) else f"{ratio:.1f}" + ("" if abs(ratio) <= EQUAL else ", differs")
    return [name, *texts, f"{difference:.3g}" if np.isfinite(difference) else "not known", verdict]


def _with_error(value: float, error: float) -> str:
    """Return a number with its scatter as text."""
    if not np.isfinite(value):
        return "not known"
    known = np.isfinite(error) and error > 1e-9 * abs(value)
    return f"{value:.4g}" + (f" \u00b1 {error:.2g}" if known else "")


def _pictures(name: str, packing: Packing) -> list[Any]:
    """Return a packing seen from outside, and cut through its middle."""
    seen, cut = (draw(packing, window=(600, 600)) for draw in (scenes.picture_packing, scenes.picture_cut))
    return [view_of(seen, f"{name}, seen from outside", name), view_of(cut, f"{name}, cut", f"{name}: cut")]


def _curves(data: Any) -> list[dict[str, str]]:
    """Return the curves of both with their bands."""
    figures = []
    for name, (_, _, _, meaning, _) in CURVES.items():
        svg = plots.svg_of(partial(_draw, data=data, name=name), name.replace("_", "-"))
        caption = f"{meaning[:1].upper()}{meaning[1:]}; the bands are twice the scatter."
        figures.append({"svg": svg, "alt": meaning, "caption": caption})
    return figures


def _draw(axes: Any, *, data: Any, name: str) -> None:
    """Draw a curve of the sample and of the twin, each with twice its scatter."""
    for whose, ink in zip(("sample", "twin"), plots.DISTINCT, strict=False):
        curve, scatter = data[f"{name}_{whose}"], data[f"{name}_{whose}_scatter"].values
        place = data[curve.dims[0]]
        if np.isfinite(curve.values).any():
            axes.plot(place.values, curve.values, color=ink, label=whose)
            low, high = curve.values - EQUAL * scatter, curve.values + EQUAL * scatter
            axes.fill_between(place.values, low, high, color=ink, alpha=0.2, linewidth=0)
    place_unit, unit = (plots.unit_text(str(one.attrs.get("units", NO_UNIT))) for one in (place, curve))
    axes.set(xlabel=f"{place.attrs['long_name']}{place_unit}", ylabel=f"{CURVES[name][3]}{unit}")
    axes.legend(loc="best")
