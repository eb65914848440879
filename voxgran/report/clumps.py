"""Pictures of clumps: the solid beside its clumps, coloured by the distance from the true surface."""

import os
from collections.abc import Sequence
from typing import Any

import numpy as np

from voxgran._base.arrays import check_type
from voxgran._base.calls import explained
from voxgran._base.errors import InputError
from voxgran._base.files import written_whole
from voxgran.clumps.body import Body
from voxgran.clumps.model import Clump
from voxgran.report.colors import Coloring
from voxgran.report.creases import surface_of
from voxgran.report.legend import legend_of
from voxgran.report.stage import (
    MATERIAL,
    Picture,
    add_label,
    beads,
    check_picture_path,
    look_at,
    png_of,
    shot,
    stage_of,
    text_size,
)

#: colours from inside of the solid to outside
COLORS = "RdBu_r"
#: distances, in equivalent diameters, at which the colours end
FARTHEST = 0.05
#: window of each body, in pixels
WINDOW = (420, 380)
#: number of spheres above which they are drawn with fewer triangles
MANY = 100

_SOLID = "#b9c4cb"


def picture_clumps(
    clumps: Sequence[Clump], *, window: tuple[int, int] = WINDOW, titles: Sequence[str] | None = None
) -> Picture:
    """Draw the solid of the first clump and all clumps in a row, from the same side.

    Blue parts of a clump lie inside of the solid, red ones protrude; white ones are on its surface; a colour bar gives
    the distance. The window, in pixels, is that of each body; titles are those of the clumps. Returns an (h, w, 3)
    array of bytes.
    """
    shape = clumps[0].shape
    corners = [shape.vertices, *(beads(clump.centers, clump.radii, 1).points for clump in clumps)]
    frame = 1.05 * np.concatenate(corners)
    names = ["solid", *(titles or [f"{clump.method}, {clump.count} spheres" for clump in clumps])]
    # a line for the name, and as much again above and below it
    below = 2 * text_size(window)
    images = []
    for clump, name in zip([None, *clumps], names, strict=True):
        with stage_of(window) as stage:
            if clump is None:
                stage.add_mesh(surface_of(shape), color=_SOLID, smooth_shading=True, **MATERIAL)
            else:
                _add_clump(stage, clump)
            add_label(stage, name, (window[0] / 2, below / 4), side="middle")
            look_at(stage, frame, below=below / window[1])
            images.append(shot(stage))
    row = np.concatenate(images, axis=1)
    colors = Coloring(np.array([-FARTHEST, FARTHEST]), "distance from the true surface, above 0 outside", "diameters")
    legend = legend_of(colors, (row.shape[1], window[1]), shades=COLORS)
    if legend is None:
        return row
    with stage_of((row.shape[1], round(legend.height * window[1]))) as stage:
        legend.add_to(stage)
        return np.concatenate([row, shot(stage)])


@explained(hint='save_clump_picture(clumps, "clumps.png")')
def save_clump_picture(
    clumps: Clump | Sequence[Clump], path: str | os.PathLike[str], *, overwrite: bool = False
) -> None:
    """Write a picture of a solid beside its clumps as PNG.

    Blue parts of a clump lie inside of the solid, red ones protrude, both up to 5 % of the equivalent diameter; white
    ones are on its surface. A colour bar gives the distance in equivalent diameters.

    Parameters
    ----------
    clumps : Clump or sequence of Clump
        Clumps of the same solid.
    path : path-like
        File to write.
    overwrite : bool
        Whether a file that is there may be replaced.

    Raises
    ------
    InputError
        If there is no clump, or they are clumps of different solids.
    FileFormatError
        If the suffix is not ``.png``.
    OutputExistsError
        If the file is there and `overwrite` is false.
    OutputError
        If it cannot be written; what was there before is untouched.
    MissingLibraryError
        If PyVista or Matplotlib cannot be loaded.

    Examples
    --------
    >>> import voxgran as vg
    >>> clump = vg.fit_clump(vg.shapes.sphere(), max_spheres=1)
    >>> vg.save_clump_picture(clump, "clump.png")
    """
    rule = "a Clump, or a list of them; fit_clump makes one"
    check_type(clumps, (Clump, Sequence), "clumps", rule)
    drawn = [clumps] if isinstance(clumps, Clump) else list(clumps)
    for clump in drawn:
        check_type(clump, Clump, "clumps", rule)
    if len({clump.shape for clump in drawn}) != 1:
        raise InputError(f"clumps has {len(drawn)} entries: it must be clumps of one solid; fit them to the same shape")
    check_picture_path(path, overwrite=overwrite)
    content = png_of(picture_clumps(drawn))
    with written_whole(path, overwrite=overwrite) as draft:
        draft.write_bytes(content)


def _add_clump(stage: Any, clump: Clump) -> None:
    """Draw the surface of the union, coloured by the signed distance from the surface of the solid."""
    mesh = beads(clump.centers, clump.radii, 4 if clump.count <= MANY else 3)
    places = np.asarray(mesh.points, dtype=np.float64) / clump.shape.diameter
    mesh.point_data["distance"] = -Body(clump.shape).depth(places)
    look = {"cmap": COLORS, "clim": (-FARTHEST, FARTHEST), "show_scalar_bar": False}
    stage.add_mesh(mesh, scalars="distance", smooth_shading=True, **look, **MATERIAL)
