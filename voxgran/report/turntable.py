"""Turntable: an animated GIF of a rotating packing."""

import io
import os
from collections.abc import Iterator
from typing import Any

import numpy as np

from voxgran._base.arrays import as_count
from voxgran._base.calls import explained
from voxgran._base.files import output_suffix, written_whole
from voxgran._base.lazy import load
from voxgran._base.progress import OnStep, Step
from voxgran.packing.model import Packing, check_packing
from voxgran.report.scenes import picture_packing
from voxgran.report.stage import Picture

#: duration of a frame, in milliseconds
FRAME_TIME = 80
#: number of colours of the common palette of all frames
PALETTE = 128


@explained(hint='save_turntable(packing, "bed.gif")')
def save_turntable(
    packing: Packing,
    path: str | os.PathLike[str],
    *,
    frames: int = 36,
    color_by: str = "diameter",
    window: tuple[int, int] = (480, 480),
    legend: bool = True,
    overwrite: bool = False,
    on_step: OnStep | None = None,
) -> None:
    """Write an animated GIF of a rotating packing.

    Parameters
    ----------
    packing : Packing
        The packing; in two dimensions there is a single frame.
    path : path-like
        File to write, ``.gif``.
    frames : int
        Number of frames per turn.
    color_by : {"diameter", "height", "shape", "density", "coordination", "distance", "force", "residual"}
        Quantity shown by the colours.
    window : tuple of int
        Width and height, in pixels.
    legend : bool
        Whether a legend or a colour bar says what the colours mean.
    overwrite : bool
        Whether an existing file may be replaced.
    on_step : callable, optional
        Function called for each frame. Default: none.

    Raises
    ------
    InputError
        If the number of frames is below 1, `color_by` is unknown, or it is "force" or "residual" and no forces
        are known.
    FileFormatError
        If the suffix is not ``.gif``.
    OutputExistsError
        If the file exists and `overwrite` is false.
    OutputError
        If the file cannot be written.

    Examples
    --------
    >>> import voxgran as vg
    >>> bed = vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), "rsa", count=5)
    >>> vg.save_turntable(bed, "bed.gif", frames=2, window=(64, 64))
    """
    output_suffix(path, [".gif"], "turntables are kept")
    check_packing(packing, "packing")
    count = as_count(frames, "frames", at_least=1) if packing.dimension == 3 else 1
    with written_whole(path, overwrite=overwrite) as draft:
        draft.write_bytes(
            animated(_views(packing, count, {"color_by": color_by, "window": window, "legend": legend}, on_step))
        )


def _views(packing: Packing, count: int, look: dict[str, Any], on_step: OnStep | None) -> Iterator[Picture]:
    """Draw a packing from all sides."""
    for frame in range(count):
        yield picture_packing(packing, turn=360.0 * frame / count, **look)
        if on_step is not None:
            on_step(Step(stage="drawing", done=frame + 1, total=count))


def animated(pictures: Iterator[Picture]) -> bytes:
    """Return pictures of the same size as one animated GIF that repeats forever."""
    image = load("PIL.Image")
    views = list(pictures)
    # colours that are visible from other sides only must be in the palette too
    palette = image.fromarray(np.concatenate(views[:: max(1, len(views) // 4)])).quantize(PALETTE)
    frames = [image.fromarray(view).quantize(PALETTE, palette=palette) for view in views]
    buffer = io.BytesIO()
    frames[0].save(
        buffer, format="GIF", save_all=True, append_images=frames[1:], duration=FRAME_TIME, loop=0, optimize=True
    )
    return buffer.getvalue()
