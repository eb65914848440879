"""A packing that turns, as one animated picture that any browser and slide program shows."""

import io
import os
from collections.abc import Iterator

import numpy as np

from voxgran._base.arrays import as_count
from voxgran._base.files import written_whole
from voxgran._base.lazy import load
from voxgran._base.progress import OnStep, Step
from voxgran.packing.model import Packing
from voxgran.report.scenes import picture_packing
from voxgran.report.stage import Picture

#: milliseconds a frame is shown
FRAME_TIME = 80
#: colours of the palette that all frames share
PALETTE = 128


def save_turntable(
    packing: Packing,
    path: str | os.PathLike[str],
    *,
    frames: int = 36,
    color_by: str = "diameter",
    window: tuple[int, int] = (480, 480),
    overwrite: bool = False,
    on_step: OnStep | None = None,
) -> None:
    """Write a turn around a packing as an animated GIF.

    Parameters
    ----------
    packing : Packing
        Any packing in three dimensions; a flat one has a single frame.
    path : path-like
        File to write, by custom ``.gif``.
    frames : int
        Pictures in one turn.
    color_by : {"diameter", "shape", "coordination", "distance"}
        What the colours show.
    window : tuple of int
        Width and height, in pixels.
    overwrite : bool
        Whether a file that is there may be replaced.
    on_step : callable, optional
        Told of each frame.

    Raises
    ------
    InputError
        If the number of frames is below 1 or `color_by` is unknown.
    OutputExistsError
        If the file is there and `overwrite` is false.
    OutputError
        If it cannot be written.
    """
    count = as_count(frames, "frames", at_least=1) if packing.dimension == 3 else 1
    with written_whole(path, overwrite=overwrite) as draft:
        draft.write_bytes(animated(_views(packing, count, color_by, window, on_step)))


def _views(
    packing: Packing, count: int, color_by: str, window: tuple[int, int], on_step: OnStep | None
) -> Iterator[Picture]:
    """Draw a packing from all sides."""
    for frame in range(count):
        yield picture_packing(packing, color_by=color_by, window=window, turn=360.0 * frame / count)
        if on_step is not None:
            on_step(Step(stage="drawing", done=frame + 1, total=count))


def animated(pictures: Iterator[Picture]) -> bytes:
    """Return pictures as one animated GIF that goes on for ever.

    Parameters
    ----------
    pictures : iterator of (height, width, 3) ndarray of uint8
        All of one size.

    Returns
    -------
    bytes
    """
    image = load("PIL.Image")
    views = list(pictures)
    # colours that show only on the far side must be in the palette too
    palette = image.fromarray(np.concatenate(views[:: max(1, len(views) // 4)])).quantize(PALETTE)
    frames = [image.fromarray(view).quantize(PALETTE, palette=palette) for view in views]
    buffer = io.BytesIO()
    frames[0].save(
        buffer, format="GIF", save_all=True, append_images=frames[1:], duration=FRAME_TIME, loop=0, optimize=True
    )
    return buffer.getvalue()
