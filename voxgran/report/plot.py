"""`plot`: a packing or a shape in a window; a picture in a notebook and on a machine without a display."""

import os
import sys
from typing import Any

import numpy as np

from voxgran._base.arrays import as_choice, check_type
from voxgran._base.lazy import load
from voxgran.packing.model import Packing
from voxgran.report.colors import COLOR_BY, COLORS, ColorBy, coloring
from voxgran.report.scenes import GRAIN_COLOR, SMOOTH, picture_packing
from voxgran.report.stage import look_at, shot, stage_of
from voxgran.shapes.model import Shape


def plot(what: Packing | Shape, *, color: ColorBy = "diameter", window: tuple[int, int] = (900, 900)) -> Any:
    """Show a packing or a shape.

    Parameters
    ----------
    what : Packing or Shape
        What is shown.
    color : {"diameter", "height", "shape", "coordination", "distance", "force"}
        What the colours of grains show, "force" the largest contact force on each where forces are known; not used for
        a shape.
    window : tuple of int
        Width and height, in pixels.

    Returns
    -------
    PIL.Image.Image or None
        The picture in a notebook, which shows it, and where there is no display; None after a window was closed.

    Raises
    ------
    InputError
        If it is neither a packing nor a shape, `color` is unknown, or it is "force" and no forces are known.

    Examples
    --------
    >>> import voxgran as vg
    >>> bed = vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), "rsa", count=10)
    >>> vg.plot(bed, color="coordination")  # doctest: +SKIP
    """
    check_type(what, (Packing, Shape), "what", "a Packing or a Shape; pack or make one")
    as_choice(color, "color", COLOR_BY)
    if _has_window():
        plotter = load("pyvista").Plotter(window_size=list(window))
        mesh, look = what.to_pyvista(), {"color": GRAIN_COLOR}
        if isinstance(what, Packing):
            found = coloring(what, color)
            mesh.cell_data[found.label] = found.values[mesh.cell_data["grain"]]
            look = {"scalars": found.label, "cmap": COLORS}
            plotter.add_mesh(load("pyvista").PolyData.from_regular_faces(*what.container.mesh()), style="wireframe")
        # PyVista refuses empty meshes
        if mesh.n_points:
            plotter.add_mesh(mesh, **look)
        plotter.show()
        return None
    if isinstance(what, Packing):
        picture = picture_packing(what, color_by=color, window=window)
    else:
        with stage_of(window) as stage:
            stage.add_mesh(what.to_pyvista(), color=GRAIN_COLOR, **SMOOTH)
            look_at(stage, np.asarray(what.vertices), flat=what.dimension == 2)
            picture = shot(stage)
    return load("PIL.Image").fromarray(picture)


def _has_window() -> bool:
    """Return whether a window can be opened and nothing better shows the picture."""
    display = sys.platform in ("win32", "darwin") or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    return bool(display) and "ipykernel" not in sys.modules
