"""Report of a packing: one self-contained page with numbers, pictures, plots, verification and provenance.

Pictures and plots are embedded in the file, which loads no other resource and adapts to light and dark backgrounds and
to wide and narrow windows.

All numbers of a page are in it as JSON, too, for programs that read it.
"""

import base64
import csv
import dataclasses
import io
import json
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from voxgran import __version__
from voxgran._base.arrays import as_flag
from voxgran._base.calls import explained
from voxgran._base.errors import with_article
from voxgran._base.files import as_path, output_suffix, refuse_to_replace, write_files
from voxgran._base.lazy import DataTree, load
from voxgran._base.scalars import finite
from voxgran.contacts.verify import Verification
from voxgran.measures.registered.density import main_numbers
from voxgran.packing.model import Packing, check_packing
from voxgran.report import facts, scenes
from voxgran.report.colors import OF_FORCES, Coloring, coloring, gradient, swatches
from voxgran.report.figures import Figure, figures_of
from voxgran.report.force_chains import picture_forces
from voxgran.report.scenes import picture_contacts
from voxgran.report.stage import Picture, png_of
from voxgran.report.turntable import animated
from voxgran.report.view import views_of
from voxgran.shapes.model import Shape

#: number of shapes that are drawn, and that are listed
SHAPES_DRAWN, SHAPES_LISTED = 3, 20
#: largest number of grains of which all contacts are found for a close-up, which above it shows one of the middle
MOST_FOR_CONTACTS = 50_000
#: heads of tables
SIZES, SHAPES = ("size", "requested", "placed", "difference"), ("shape", "geometry", "grains", "share")
#: number of pictures of a turntable
TURNS = 24


@dataclass(frozen=True, slots=True)
class View:
    """One picture on the page: a data URL, alternative text, caption, and size in pixels."""

    source: str
    alt: str
    caption: str
    width: int
    height: int


@dataclass(frozen=True, slots=True)
class Drawn:
    """All pictures of a page by name, with alternative text and caption."""

    packing: dict[str, tuple[Picture, str, str]]
    grains: dict[str, dict[str, tuple[Picture, str, str]]]


@dataclass(frozen=True, slots=True)
class Shown:
    """What a page shows beside numbers: what gives its pictures (None: none), which another process may draw meanwhile;
    the rest by the names of `save_report`.
    """

    drawn: Callable[[], Drawn] | None
    color_by: str = "diameter"
    turntable: bool = False
    interactive: bool = True


@explained(hint='save_report(packing, "page.html")')
def save_report(
    packing: Packing,
    path: str | os.PathLike[str],
    *,
    statistics: "DataTree | None" = None,
    verification: "Verification | None" = None,
    pictures: bool = True,
    pictures_folder: str | os.PathLike[str] | None = None,
    title: str | None = None,
    comparisons: Mapping[str, Mapping[str, Any]] | None = None,
    color_by: str = "diameter",
    turntable: bool = False,
    interactive: bool = True,
    overwrite: bool = False,
) -> None:
    """Write a self-contained HTML report of a packing, and files with its numbers.

    Parameters
    ----------
    packing : Packing
        The packing.
    path : path-like
        File to write, ``page.html``; beside it ``page.json`` has all numbers, and ``page_NAME.csv`` each table.
    statistics : xarray.DataTree, optional
        Result of :func:`voxgran.measure`; required for profiles and the bulk solid fraction.
    verification : Verification, optional
        Result of :func:`voxgran.verify`.
    pictures : bool
        Whether pictures are rendered; if false, no graphics library is loaded and the page has no interactive view.
    pictures_folder : path-like, optional
        Folder for the pictures as PNG files: whole, cut_open, grain_0, ... Default: none are written.
    title : str, optional
        Title of the page.
    comparisons : mapping of str to mapping, optional
        Rows of a table of packings: name of each packing to a mapping from column names to values.
    color_by : {"diameter", "height", "shape", "density", "coordination", "distance", "force", "residual"}
        Quantity shown by the colours of the grains.
    turntable : bool
        Whether an animated picture of the rotating packing is added.
    interactive : bool
        Whether the page has a view that can be turned and cut in a browser, about 2 MB; the pictures stand without it.
    overwrite : bool
        Whether existing files may be replaced.

    Raises
    ------
    InputError
        If `color_by` is unknown, or it is "force" or "residual" and no forces are known.
    FileFormatError
        If the suffix is not ``.html``.
    OutputExistsError
        If the page, the JSON file or a picture exists and `overwrite` is false.
    OutputError
        If a file cannot be written; existing files are then unchanged.
    MissingLibraryError
        If a required library cannot be loaded.

    Examples
    --------
    >>> import voxgran as vg
    >>> bed = vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), "rsa", count=10)
    >>> vg.save_report(bed, "page.html", verification=vg.verify(bed), pictures=False)
    """
    write_page(
        packing,
        path,
        Shown(partial(draw_pictures, packing, color_by) if pictures else None, color_by, turntable, interactive),
        statistics=statistics,
        verification=verification,
        pictures_folder=pictures_folder,
        title=title,
        comparisons=comparisons,
        overwrite=overwrite,
    )


def write_page(
    packing: Packing,
    path: str | os.PathLike[str],
    shown: Shown,
    *,
    statistics: "DataTree | None",
    verification: "Verification | None",
    pictures_folder: str | os.PathLike[str] | None,
    title: str | None,
    comparisons: Mapping[str, Mapping[str, Any]] | None,
    overwrite: bool,
) -> None:
    """Write what `save_report` does; the pictures are asked for when all else is there."""
    drawn, color_by = shown.drawn, shown.color_by
    check_packing(packing, "packing")
    twin = check_page_path(path, overwrite=overwrite)
    colors = coloring(packing, color_by)
    figures = figures_of(packing, statistics)
    headline, made = facts.headline(packing, statistics, verification), facts.details(packing)
    sieves, shapes = facts.sieve_rows(packing), facts.shape_rows(packing)
    proof = facts.proof_rows(verification) if verification is not None else []
    compared = _comparison(comparisons or {})
    view = views_of({"": packing}, color_by) if shown.interactive and drawn else None
    pictures = drawn() if drawn is not None else Drawn({}, {})
    files: dict[Path, Any] = {**_picture_files(pictures, Path(pictures_folder))} if pictures_folder is not None else {}
    if not overwrite:
        refuse_to_replace(*files)
    text = page_template("template.html.j2").render(
        version=__version__,
        title=title or f"Packing of {packing.count} grains",
        subtitle=_subtitle(packing),
        headline=headline,
        views=[view_of(*parts) for parts in pictures.packing.values()]
        + (_turning(packing, color_by) if shown.turntable else []),
        view=view,
        legend=_legend(colors),
        legend_label=colors.title if colors.entries else colors.label,
        swatches=swatches(colors) if drawn else [],
        gradient=", ".join(gradient()) if drawn else "gray, gray",
        grains=[{"name": n, "views": [view_of(*p) for p in v.values()]} for n, v in pictures.grains.items()],
        grains_note=_grains_note(packing),
        figures=figures,
        proof=proof,
        worst=_worst(verification) if verification is not None else {},
        comparison=compared,
        sieves=sieves,
        details=made,
        shapes=shapes[:SHAPES_LISTED],
        shapes_left=max(0, len(shapes) - SHAPES_LISTED),
        space="volume" if packing.dimension == 3 else "area",
        provenance=json.dumps(packing.provenance, indent=2, default=str, ensure_ascii=False),
    )
    numbers = json_text(page_numbers(packing, statistics, verification, figures=figures))
    told = {"numbers": headline, "verification": proof, "making": made}
    tables: dict[str, Any] = {name: [(one.label, one.value, one.note) for one in rows] for name, rows in told.items()}
    told_of = {"sizes": [SIZES, *sieves] if sieves else [], "shapes": [SHAPES, *shapes] if shapes else []}
    tables |= {**told_of, "comparison": compared}
    files |= table_files(as_path(path), tables)
    write_files({**files, as_path(path): text, twin: numbers}, overwrite=overwrite)


def check_page_path(path: str | os.PathLike[str], *, overwrite: bool) -> Path:
    """Refuse a file that a page cannot be written to, before the work; return the JSON file for its numbers.

    Raises
    ------
    FileFormatError
        If the suffix is not ``.html``.
    OutputExistsError
        If the page or the JSON file is there and `overwrite` is false.
    InputError
        If `overwrite` is neither true nor false.
    """
    output_suffix(path, [".html"], "pages are kept")
    twin = as_path(path).with_suffix(".json")
    if not as_flag(overwrite, "overwrite"):
        refuse_to_replace(path, twin)
    return twin


def page_template(name: str) -> Any:
    """Return a template of this folder; texts are escaped, and an undefined name is an error."""
    jinja2 = load("jinja2")
    return jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent), autoescape=True, undefined=jinja2.StrictUndefined
    ).get_template(name)


def draw_pictures(packing: Packing, color_by: str = "diameter") -> Drawn:
    """Render all pictures."""
    plural = "grain" if packing.count == 1 else "grains"
    what = f"{packing.count} {plural} in {with_article(packing.container.kind)}"
    coarse = ""
    most = scenes.picture_faces(packing)
    spheres = np.array([*(shape.is_sphere and shape.dimension == 3 for shape in packing.shapes), False])
    as_points = int(spheres[packing.shape_id].sum()) > scenes.MOST_SPHERES
    if any(len(shape.faces) > most and not (as_points and shape.is_sphere) for shape in packing.shapes):
        coarse = f" For the picture grains are drawn with about {most} triangles at most."
    if as_points:
        coarse += " Spheres are drawn as points, shaded by the slope of the heap."
    whole = {
        "whole": (
            scenes.picture_packing(packing, color_by=color_by),
            f"{what}, seen from outside",
            f"The whole packing.{coarse}",
        )
    }
    if packing.dimension == 3 and packing.count:
        caption = "Cut open: without the grains with centroids in the near quarter."
        whole["cut_open"] = (
            scenes.picture_cut(packing, color_by=color_by),
            f"{what}, without the near quarter",
            caption,
        )
    many = packing.dimension == 3 and packing.count > scenes.MOST_SPHERES
    middle = scenes.middle_of(packing) if many else packing
    if many and color_by not in OF_FORCES:
        caption = f"The {middle.count} grains of a cube in the middle, with their surfaces."
        whole["middle"] = (scenes.picture_packing(middle, color_by=color_by), f"the middle of {what}", caption)
    large = packing.count > MOST_FOR_CONTACTS
    close = picture_contacts(middle if large else packing) if many or not large else None
    if close is not None:
        caption = "The grain with the most neighbours{}, and the contact points.".format(
            " in that cube" if large else ""
        )
        whole["contacts"] = (close, "one grain among its neighbours", caption)
    chains = picture_forces(packing)
    if chains is not None:
        caption = "Force chains: tubes between grains in contact, as thick as the force; the strongest are dark."
        whole["forces"] = (chains, f"force chains of {what}", caption)
    captions = {
        "surface": "true surface",
        "voxels": "voxels of 1/24 of its diameter",
        "points": "control points with a spacing of a tenth of its diameter",
        "clump": "clump of at most 30 spheres",
    }
    grains = {}
    for shape in _drawn_shapes(packing):
        views = scenes.picture_grain(shape)
        grains[shape.name] = {n: (p, f"{shape.name}: {captions[n]}", captions[n]) for n, p in views.items()}
    return Drawn(whole, grains)


def _drawn_shapes(packing: Packing) -> list[Shape]:
    """Return the most frequent shapes, one of each name."""
    counts = np.bincount(packing.shape_id, minlength=len(packing.shapes))
    named: dict[str, Shape] = {}
    for index in np.argsort(-counts, kind="stable"):
        if counts[index] and len(named) < SHAPES_DRAWN:
            named.setdefault(packing.shapes[index].name, packing.shapes[index])
    return list(named.values())


def _grains_note(packing: Packing) -> str:
    """Return a note on the shapes that are drawn if not all are."""
    counts = np.unique(packing.shape_id, return_counts=True)[1]
    drawn = len(_drawn_shapes(packing))
    if drawn == len(counts):
        return ""
    return f"{drawn} of {len(counts)} shapes, " + (
        "the most frequent ones." if counts.max() > counts.min() else "all of which are equally frequent."
    )


def view_of(picture: Picture, alt: str, caption: str) -> View:
    """Return a picture with its texts and size."""
    source = "data:image/png;base64," + base64.b64encode(png_of(picture)).decode()
    return View(source, alt, caption, picture.shape[1], picture.shape[0])


def _turning(packing: Packing, color_by: str) -> list[View]:
    """Return the turntable."""
    edge = 360
    views = (
        scenes.picture_packing(packing, color_by=color_by, window=(edge, edge), turn=360.0 * k / TURNS)
        for k in range(TURNS if packing.dimension == 3 else 1)
    )
    source = "data:image/gif;base64," + base64.b64encode(animated(views)).decode()
    return [View(source, "the packing, turning", "The packing from all sides.", edge, edge)]


def _picture_files(drawn: Drawn, folder: Path) -> dict[Path, bytes]:
    """Return the pictures as PNG files, the four of a grain side by side."""
    files = {folder / f"{name}.png": png_of(picture) for name, (picture, _, _) in drawn.packing.items()}
    for index, views in enumerate(drawn.grains.values()):
        row = np.hstack([picture for picture, _, _ in views.values()])
        files[folder / f"grain_{index}.png"] = png_of(row)
    return files


def _subtitle(packing: Packing) -> str:
    """Return the subtitle: grains, container and method in one line."""
    names = [row[0] for row in facts.shape_rows(packing)]
    shown = ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")
    method = packing.provenance.get("method")
    return f"{shown or 'no shapes'} in {with_article(packing.container.kind)}" + (
        f", packed by the method {method}" if method else ""
    )


def _legend(colors: Coloring) -> tuple[str, str] | None:
    """Return the values of the darkest and the brightest colour."""
    if not len(colors.values) or colors.same:
        return None
    unit = f" {colors.unit}" if colors.unit else ""
    low, high = (facts.number(value) for value in colors.limits)
    return f"{low}{unit}", f"{high}{unit}"


def _worst(verification: "Verification") -> dict[str, list[list[str]]]:
    """Return the tables of the worst pairs and escapes by title."""
    pairs, escapes = facts.worst_rows(verification.pairs), facts.worst_rows(verification.escapes)
    return {name: rows for name, rows in (("The deepest overlaps", pairs), ("The farthest escapes", escapes)) if rows}


def _comparison(rows: Mapping[str, Mapping[str, Any]]) -> list[list[str]]:
    """Return head and rows of the comparison table; missing values are blank."""
    columns = list(dict.fromkeys(name for row in rows.values() for name in row))
    # a column that only repeats the name of the row is omitted
    columns = [c for c in columns if any(c in row and row[c] != name for name, row in rows.items())]
    body = [[name, *(facts.number(row[c]) if c in row else "" for c in columns)] for name, row in rows.items()]
    return [["packing", *(c.replace("_", " ") for c in columns)], *body] if rows else []


def page_numbers(
    packing: Packing, statistics: "DataTree | None", verification: "Verification | None", *, figures: Sequence[Figure]
) -> dict[str, Any]:
    """Return every number of a page, JSON-able."""
    scalars = {}
    if statistics is not None:
        for name, value in statistics.data_vars.items():
            if not value.ndim and value.dtype.kind in "biuf":
                scalars[str(name)] = {"value": value.item(), **{k: str(v) for k, v in value.attrs.items()}}
    return {
        "voxgran": __version__,
        "count": packing.count,
        **main_numbers(packing, statistics),
        "stop_reason": packing.stop_reason,
        "unit": packing.unit,
        "density": packing.density,
        "diameter": _spread(packing),
        "statistics": scalars,
        "verification": None if verification is None else dataclasses.asdict(verification),
        "figures": {figure.name: figure.numbers for figure in figures},
        "shapes": [
            {"name": name, "geometry": kind, "grains": grains, "share": share}
            for name, kind, grains, share in facts.shape_rows(packing)
        ],
        "provenance": dict(packing.provenance),
    }


def json_text(value: Any) -> str:
    """Return a value as JSON text; numbers that are not finite become null, as JSON cannot represent them."""
    return json.dumps(finite(value), indent=1, default=str, allow_nan=False, ensure_ascii=False) + "\n"


def _spread(packing: Packing) -> dict[str, float | None]:
    """Return smallest, median and largest equivalent diameter."""
    if not packing.count:
        return {"least": None, "median": None, "largest": None}
    low, middle, high = (float(value) for value in np.quantile(packing.diameters, [0.0, 0.5, 1.0]))
    return {"least": low, "median": middle, "largest": high}


def table_files(page: Path, tables: Mapping[str, Iterable[Sequence[str]]]) -> dict[Path, str]:
    """Return tables by their names as CSV files beside a page, ``page_NAME.csv``; empty tables have none.

    Numbers have the digits of the page, the minus sign that programs read, and no spaces between thousands.
    """
    files = {}
    for name, rows in tables.items():
        out = io.StringIO()
        plain = [[text.replace("\u2212", "-").replace("\u202f", "") for text in row] for row in rows]
        csv.writer(out, lineterminator="\n").writerows(plain)
        if plain:
            files[page.with_name(f"{page.stem}_{name}.csv")] = out.getvalue()
    return files
