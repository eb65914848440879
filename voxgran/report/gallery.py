"""Pictures of many shapes in rows, and of a solid beside its clumps, coloured by the distance from its surface."""

import math
import os
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np

from voxgran._base.arrays import as_count, check_type
from voxgran._base.calls import explained
from voxgran._base.errors import InputError
from voxgran._base.files import written_whole
from voxgran.clumps.method import Body
from voxgran.clumps.model import Clump
from voxgran.report.colors import Coloring, legend_of
from voxgran.report.creases import creased, shaded, surface_of
from voxgran.report.scenes import FEWEST_FACES, GRAIN_COLOR, SMOOTH, TRIANGLE_BUDGET, drawn_surface
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
    view_axes,
)
from voxgran.shapes.model import Shape

T = TypeVar("T")
#: width of each shape, in pixels: of a few shapes and of very many
LARGEST, SMALLEST = 220, 60
#: width at which shapes become smaller, in pixels
WIDEST = 1760
#: share of the shapes that are drawn on one scale; larger ones are made as small as the cells of these
MOST = 0.9
#: colors of a file: shades of pale surfaces look the same with so many
SHADES = 128
#: distance of neighbours, in widths and heights of a cell
SPACING = 1.12


def picture_shapes(shapes: Sequence[Shape], *, columns: int | None = None) -> Picture:
    """Draw shapes in rows from the same side; an (h, w, 3) array of bytes.

    All are drawn on one scale, but for the largest tenth, which are made smaller where they would touch others. Without
    a number of columns the picture is a little wider than high.
    """
    wide = columns or math.ceil(math.sqrt(1.6 * len(shapes)))
    wide = min(wide, len(shapes))
    rows = math.ceil(len(shapes) / wide)
    flat = all(shape.dimension == 2 for shape in shapes)
    axes = view_axes(flat=flat)
    most = max(FEWEST_FACES, TRIANGLE_BUDGET // len(shapes))
    surfaces = [creased(shape, *drawn_surface(shape, most)) for shape in shapes]
    seen = [points @ axes[:2].T for points, _ in surfaces]
    low, high = (np.array([side(points, axis=0) for points in seen]) for side in (np.min, np.max))
    cell = np.quantile(high - low, MOST, axis=0)
    fitting = np.minimum(1.0, (cell / (high - low)).min(axis=1))
    step = SPACING * cell
    row, column = np.divmod(np.arange(len(shapes)), wide)
    places = np.column_stack([column, -row]) * step - fitting[:, None] * (low + high) / 2
    moved = [s * points + at @ axes[:2] for (points, _), s, at in zip(surfaces, fitting, places, strict=True)]
    first = np.cumsum([0, *map(len, moved)])
    faces = [triangles + begin for (_, triangles), begin in zip(surfaces, first[:-1], strict=True)]
    mesh = shaded(np.concatenate(moved), np.concatenate(faces))
    corners = np.array([(x, y) for x in (-0.5, wide - 0.5) for y in (0.5, 0.5 - rows)]) * step @ axes[:2]
    width = max(SMALLEST, min(LARGEST, WIDEST // wide))
    window = (width * wide, max(1, round(width * rows * step[1] / step[0])))
    with stage_of(window) as stage:
        stage.add_mesh(mesh, color=GRAIN_COLOR, **SMOOTH)
        look_at(stage, corners, flat=flat)
        return shot(stage)


@explained(hint='save_gallery(shapes, "shapes.png")')
def save_gallery(
    shapes: Sequence[Shape], path: str | os.PathLike[str], *, columns: int | None = None, overwrite: bool = False
) -> None:
    """Write a picture of shapes in rows, seen from the same side, as PNG.

    All are drawn on one scale, but for the largest tenth, which are made smaller where they would touch others.

    Parameters
    ----------
    shapes : sequence of Shape
        At least one; outlines are seen from above if there are no others.
    path : path-like
        File to write.
    columns : int, optional
        Shapes in a row. By default the picture is a little wider than high.
    overwrite : bool
        Whether a file that is there may be replaced.

    Raises
    ------
    InputError
        If there is no shape, or `columns` is not a whole number above 0.
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
    >>> vg.save_gallery(vg.make_shapes("convex_polyhedron", count=3), "rocks.png")
    """
    drawn = _listed(shapes, Shape, "shapes", "a list of shapes; make_shapes makes one")
    if not drawn:
        raise InputError("shapes is empty: a gallery needs at least one shape; make some")
    if columns is not None:
        as_count(columns, "columns", at_least=1)
    _write(path, lambda: png_of(picture_shapes(drawn, columns=columns), colors=SHADES), overwrite=overwrite)


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
    drawn = _listed(clumps, Clump, "clumps", "a Clump, or a list of them; fit_clump makes one")
    if len({clump.shape for clump in drawn}) != 1:
        raise InputError(f"clumps has {len(drawn)} entries: it must be clumps of one solid; fit them to the same shape")
    _write(path, lambda: png_of(picture_clumps(drawn)), overwrite=overwrite)


def _listed(given: T | Sequence[T], kind: type[T], name: str, rule: str) -> list[T]:
    """Return one object or several of a kind as a list."""
    check_type(given, (kind, Sequence), name, rule)
    found: list[Any] = [given] if isinstance(given, kind) else list(given)  # type: ignore[arg-type]
    for one in found:
        check_type(one, kind, name, rule)
    return found


def _write(path: str | os.PathLike[str], draw: Callable[[], bytes], *, overwrite: bool) -> None:
    """Write a picture, which is drawn once it is known that it may be written."""
    check_picture_path(path, overwrite=overwrite)
    content = draw()
    with written_whole(path, overwrite=overwrite) as draft:
        draft.write_bytes(content)


def _add_clump(stage: Any, clump: Clump) -> None:
    """Draw the surface of the union, coloured by the signed distance from the surface of the solid."""
    mesh = beads(clump.centers, clump.radii, 4 if clump.count <= MANY else 3)
    places = np.asarray(mesh.points, dtype=np.float64) / clump.shape.diameter
    mesh.point_data["distance"] = -Body(clump.shape).depth(places)
    look = {"cmap": COLORS, "clim": (-FARTHEST, FARTHEST), "show_scalar_bar": False}
    stage.add_mesh(mesh, scalars="distance", smooth_shading=True, **look, **MATERIAL)
