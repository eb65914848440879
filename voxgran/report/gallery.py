"""Pictures of many shapes in rows."""

import math
import os
from collections.abc import Sequence

import numpy as np

from voxgran._base.arrays import as_count, check_type
from voxgran._base.calls import explained
from voxgran._base.errors import InputError
from voxgran._base.files import written_whole
from voxgran.report.creases import creased, shaded
from voxgran.report.scenes import FEWEST_FACES, GRAIN_COLOR, SMOOTH, TRIANGLE_BUDGET, drawn_surface
from voxgran.report.stage import Picture, check_picture_path, look_at, png_of, shot, stage_of, view_axes
from voxgran.shapes.model import Shape

#: width of each shape, in pixels: of a few shapes and of very many
LARGEST, SMALLEST = 220, 60
#: width at which shapes become smaller, in pixels
WIDEST = 1760
#: share of the shapes that are drawn on one scale; larger ones are made as small as the cells of these
MOST = 0.9
#: colors of a file: shades of pale surfaces look the same with so many
COLORS = 128
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
    rule = "a list of shapes; make_shapes makes one"
    check_type(shapes, (Shape, Sequence), "shapes", rule)
    drawn = [shapes] if isinstance(shapes, Shape) else list(shapes)
    for shape in drawn:
        check_type(shape, Shape, "shapes", rule)
    if not drawn:
        raise InputError("shapes is empty: a gallery needs at least one shape; make some")
    if columns is not None:
        as_count(columns, "columns", at_least=1)
    check_picture_path(path, overwrite=overwrite)
    content = png_of(picture_shapes(drawn, columns=columns), colors=COLORS)
    with written_whole(path, overwrite=overwrite) as draft:
        draft.write_bytes(content)
