"""Rich display of packings in notebooks: a card with numbers, and the interactive view of the report beside it.

`plot` shows a packing or a shape in a window or notebook, or as a picture; `save_picture` writes that picture.
"""

import html
import os
import sys
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np

from voxgran._base.arrays import as_choice, as_flag, as_positive, check_type
from voxgran._base.calls import explained
from voxgran._base.errors import InputError, MissingLibraryError
from voxgran._base.files import as_path, output_suffix, write_files, written_whole
from voxgran._base.lazy import load
from voxgran.measures.registered.density import main_numbers
from voxgran.packing.grains import ColorBy
from voxgran.packing.model import Packing, check_packing
from voxgran.packing.start import around_fixed
from voxgran.report import facts
from voxgran.report.colors import COLOR_BY, COLORS, coloring, gradient, legend_of
from voxgran.report.creases import surface_of
from voxgran.report.page import page_template
from voxgran.report.scenes import GRAIN_COLOR, SMOOTH, drawn_surface, picture_cut, picture_packing
from voxgran.report.stage import Picture, as_window, check_picture_path, look_at, png_of, shot, stage_of
from voxgran.report.view import GRAINS, views_of
from voxgran.shapes.describing.thumbnail import card, picture
from voxgran.shapes.model import Shape

#: triangles of a grain in the small picture, at most
TRIANGLES = 300
#: megabytes of the largest view in a notebook, and height of its frame in pixels
MOST, HEIGHT = 5.0, 900


@dataclass(frozen=True, eq=False, repr=False)
class NotebookView:
    """What a notebook shows of a packing: a card, and a page in a frame or why there is none.

    Attributes
    ----------
    packing : Packing
        The packing.
    page : str
        The page of the interactive view, which loads nothing; empty where the view is static.
    reason : str
        Why it is static, in a sentence; empty where it is not.
    """

    packing: Packing
    page: str
    reason: str

    @property
    def megabytes(self) -> float:
        """Size of the page."""
        return len(self.page.encode()) / 1e6

    def save(self, path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
        """Write the page of the interactive view.

        Parameters
        ----------
        path : path-like
            File to write, ``.html``.
        overwrite : bool
            Whether an existing file may be replaced.

        Raises
        ------
        InputError
            If the view is static.
        FileFormatError
            If the suffix is not ``.html``.
        OutputExistsError
            If the file exists and `overwrite` is false.
        OutputError
            If it cannot be written.
        """
        output_suffix(path, [".html"], "pages are kept", overwrite=overwrite)
        if not self.page:
            raise InputError(f"the view is static: {self.reason}")
        write_files({as_path(path): self.page}, overwrite=overwrite)

    def _repr_html_(self) -> str:
        """Card, and the page in a frame."""
        shown = _card(self.packing)
        if not self.page:
            return shown + (f"<p>{html.escape(self.reason)}</p>" if self.reason else "")
        frame = f'<iframe srcdoc="{html.escape(self.page)}" style="width:100%;height:{HEIGHT}px;border:0" '
        return f'{shown}{frame}title="interactive view" loading="lazy"></iframe><p>{self.megabytes:.1f} MB</p>'

    def __repr__(self) -> str:
        """Size, or why it is static."""
        told = self.reason or f"{self.megabytes:.1f} MB; it turns in a notebook, and save('view.html') writes it"
        return f"NotebookView({self.packing.count} grains, {told})"


@explained(hint='view(packing, color_by="height")')
def view(packing: Packing, *, color_by: ColorBy = "diameter", most: float = MOST, widget: bool = True) -> Any:
    """Show a packing in a notebook, in a view that can be turned, cut and asked for its grains.

    Parameters
    ----------
    packing : Packing
        The packing.
    color_by : {"diameter", "height", "shape", "density", "coordination", "distance", "force", "residual"}
        What the colours show first.
    most : float
        Largest size of the view, which the notebook keeps, in megabytes; above it only a card is shown, with the
        reason. plotly.js, which draws the view, takes about 2 of them.
    widget : bool
        Whether it is the widget of PyVista in a notebook where trame is installed.

    Returns
    -------
    NotebookView or widget
        The view of the report, which needs no server, or the widget of PyVista, which does.

    Raises
    ------
    InputError
        If `color_by` is unknown, it is "force" or "residual" and no forces are known, or `most` is not above 0.

    Examples
    --------
    >>> import voxgran as vg
    >>> bed = vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), "rsa", count=5)
    >>> vg.view(bed).save("view.html")
    """
    check_packing(packing, "packing")
    as_choice(color_by, "color_by", COLOR_BY)
    limit = as_positive(most, "most")
    if as_flag(widget, "widget") and notebook_backend() is not None:
        return plot(packing, color_by=color_by)
    return _made(packing, color_by, limit)


def _made(packing: Packing, color_by: str, most: float) -> NotebookView:
    """Return the view of a packing, or why it is static."""
    if packing.count > GRAINS:
        why = f"The picture does not turn: its view would show {GRAINS} of {packing.count} grains, as save_report does."
        return NotebookView(packing, "", why)
    try:
        parts = views_of({"": packing}, color_by)
    except MissingLibraryError as error:
        return NotebookView(packing, "", f"The picture does not turn: {error}.")
    if parts is None:
        return NotebookView(packing, "", "There are no grains to show.")
    page = page_template("notebook.html.j2").render(
        title=f"Packing of {packing.count} grains", view=parts, gradient=", ".join(gradient())
    )
    if len(page.encode()) > most * 1e6:
        size = f"{len(page.encode()) / 1e6:.1f} MB, more than {most:g}"
        why = f"The picture does not turn: its view takes {size}; view(most=...) or save_report shows it."
        return NotebookView(packing, "", why)
    return NotebookView(packing, page, "")


def _card(packing: Packing) -> str:
    """Return a small picture and numbers of a packing as HTML."""
    names = ", ".join(shape.name for shape in packing.shapes[:4]) + (" ..." if len(packing.shapes) > 4 else "")
    axes = ", ".join(axis for axis, wraps in zip("xyz", packing.container.periodic, strict=True) if wraps)
    known = main_numbers(packing)
    rows = {
        "packing": f"{packing.count} grains of {len(packing.shapes)} shapes: {names}",
        f"solid fraction of the {known['region']}": f"{known['solid_fraction']:.4f}",
        "method": str(packing.provenance.get("method", "not known")),
        **({} if packing.fixed is None else {"fixed grains": str(int(packing.fixed.sum()))}),
        "stopped": packing.stop_reason,
        **_rest(packing),
        "container": packing.container.kind + (f", periodic in {axes}" if axes else ""),
    }
    if not packing.count:
        return card(None, rows)
    unit = "" if packing.unit == "1" else f" {packing.unit}"
    ends = [facts.number(float(end)) for end in (packing.diameters.min(), packing.diameters.max())]
    rows["equivalent diameter"] = f"{ends[0]} to {ends[1]}{unit}"
    surfaces = [drawn_surface(shape, TRIANGLES) for shape in packing.shapes]
    bodies = [vertices[faces] for vertices, faces in surfaces]
    matrices = packing.matrices * packing.scale[:, None, None]
    flat = packing.dimension == 2
    return card(picture(bodies, packing.shape_id, matrices, packing.position, packing.diameters, flat=flat), rows)


def _rest(packing: Packing) -> dict[str, str]:
    """Return how many grains rest; nothing where that is not known."""
    if packing.forces is None or not packing.count:
        return {}
    forces = around_fixed(packing).forces
    shares = forces.share_at_rest, forces.share_of_rattlers
    return {"at rest": "{:.1f} % of the grains, {:.1f} % are rattlers".format(*(100 * share for share in shares))}


#: backends of PyVista before 0.48 whose scenes can be turned in a notebook, and what these need
TURNS = ("trame", "client", "server", "html")
TRAME = ("trame", "trame_vtk", "trame_vuetify")


@explained(hint='plot(packing, color_by="height")')
def plot(
    what: Packing | Shape, *, color_by: ColorBy = "diameter", window: tuple[int, int] = (900, 900), legend: bool = True
) -> Any:
    """Show a packing or a shape.

    Parameters
    ----------
    what : Packing or Shape
        What is shown.
    color_by : {"diameter", "height", "shape", "density", "coordination", "distance", "force", "residual"}
        What the colours of grains show, "force" the largest contact force on each where forces are known; not used for
        a shape.
    window : tuple of int
        Width and height, in pixels.
    legend : bool
        Whether a legend says which colour is which shape or density (ten at most), or a colour bar which is which
        value; it is left out where it would take more than a third of the picture.

    Returns
    -------
    PIL.Image.Image, widget or None
        In a notebook the widget of PyVista's backend, which turns, where trame is installed and the backend is not
        "static"; otherwise a picture there, and where there is no display; None after a window was closed.

    Raises
    ------
    InputError
        If it is neither a packing nor a shape, `color_by` is unknown, or it is "force" or "residual" and no forces are
        known, or `window` is not two whole numbers above 0.

    Examples
    --------
    >>> import voxgran as vg
    >>> bed = vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), "rsa", count=10)
    >>> vg.plot(bed, color_by="coordination")  # doctest: +SKIP
    """
    check_type(what, (Packing, Shape), "what", "a Packing or a Shape; pack or make one")
    as_choice(color_by, "color_by", COLOR_BY)
    window = as_window(window)
    backend = notebook_backend()
    if backend is not None or _has_window():
        plotter = _plotter(what, color_by, window, notebook=backend is not None, legend=legend)
        if backend is None:
            plotter.show()
            return None
        return plotter.show(jupyter_backend=backend, return_viewer=True)
    return load("PIL.Image").fromarray(_picture(what, color_by, window, legend=legend))


@explained(hint='save_picture(packing, "bed.png")')
def save_picture(
    what: Packing | Shape,
    path: str | os.PathLike[str],
    *,
    color_by: ColorBy = "diameter",
    cut: bool = False,
    window: tuple[int, int] = (900, 900),
    legend: bool = True,
    overwrite: bool = False,
) -> None:
    """Write a picture of a packing in its container, or of a shape.

    Parameters
    ----------
    what : Packing or Shape
        What is drawn.
    path : path-like
        File to write, ``.png``.
    color_by : {"diameter", "height", "shape", "density", "coordination", "distance", "force", "residual"}
        What the colours of grains show, from dark to bright, as in :func:`plot`; not used for a shape.
    cut : bool
        Whether the grains with centroids in the quarter of the container that faces the viewer are left out; not used
        for a shape, nor in two dimensions.
    window : tuple of int
        Width and height, in pixels.
    legend : bool
        Whether a legend or a colour bar says what the colours mean, as in :func:`plot`.
    overwrite : bool
        Whether an existing file may be replaced.

    Raises
    ------
    InputError
        If it is neither a packing nor a shape, `color_by` is unknown, or it is "force" or "residual" and no forces are
        known, or `window` is not two whole numbers above 0.
    FileFormatError
        If the suffix is not ``.png``.
    OutputExistsError
        If the file exists and `overwrite` is false.
    OutputError
        If the file cannot be written.

    See Also
    --------
    save_turntable : Write an animated picture of a packing that rotates.
    save_gallery : Write one picture of many shapes.

    Examples
    --------
    >>> import voxgran as vg
    >>> bed = vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), "rsa", count=10)
    >>> vg.save_picture(bed, "bed.png", color_by="coordination", window=(64, 64))
    """
    check_type(what, (Packing, Shape), "what", "a Packing or a Shape; pack or make one")
    as_choice(color_by, "color_by", COLOR_BY)
    check_picture_path(path, overwrite=overwrite)
    content = png_of(_picture(what, color_by, as_window(window), cut=cut, legend=legend))
    with written_whole(path, overwrite=overwrite) as draft:
        draft.write_bytes(content)


def _picture(
    what: Packing | Shape, color_by: str, window: tuple[int, int], *, cut: bool = False, legend: bool = True
) -> Picture:
    """Draw a packing with its container, or a shape."""
    if isinstance(what, Packing):
        return (picture_cut if cut else picture_packing)(what, color_by=color_by, window=window, legend=legend)
    with stage_of(window) as stage:
        stage.add_mesh(surface_of(what), color=GRAIN_COLOR, **SMOOTH)
        look_at(stage, np.asarray(what.vertices), flat=what.dimension == 2)
        return shot(stage)


def _plotter(what: Packing | Shape, color_by: str, window: tuple[int, int], *, notebook: bool, legend: bool) -> Any:
    """Return a plotter that holds a packing with its container, or a shape."""
    plotter = load("pyvista").Plotter(window_size=list(window), notebook=notebook, off_screen=notebook or None)
    mesh, look = what.to_pyvista(), dict[str, Any](color=GRAIN_COLOR)
    if isinstance(what, Packing):
        found = coloring(what, color_by)
        mesh.cell_data[found.label] = found.values[mesh.cell_data["grain"]]
        look = {"scalars": found.label, "cmap": COLORS, "clim": found.limits, "show_scalar_bar": False}
        if legend and (strip := legend_of(found, window)) is not None:
            strip.add_to(plotter, color=load("pyvista").global_theme.font.color)
        plotter.add_mesh(load("pyvista").PolyData.from_regular_faces(*what.container.mesh()), style="wireframe")
    # PyVista refuses empty meshes
    if mesh.n_points:
        plotter.add_mesh(mesh, **look)
    return plotter


def notebook_backend() -> str | None:
    """Return the backend with which PyVista shows a scene that turns in a notebook; None outside of one, where the
    backend chosen gives a picture only, and where none is installed.
    """
    if "ipykernel" not in sys.modules:
        return None
    pyvista = load("pyvista")
    if hasattr(pyvista, "registered_jupyter_backends"):
        installed = [str(entry.name) for entry in pyvista.registered_jupyter_backends()]
    else:
        installed = [*TURNS] if all(find_spec(name) for name in TRAME) else []
    # None stands for the best of what is installed, which is trame itself, before its variants, wherever it is there
    best = "trame" if "trame" in installed else next(iter(installed), None)
    backend = pyvista.global_theme.jupyter_backend or best
    return backend if backend in installed else None


def _has_window() -> bool:
    """Return whether a window can be opened and nothing better shows the picture."""
    display = sys.platform in ("win32", "darwin") or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    return bool(display) and "ipykernel" not in sys.modules
