"""What `pack` is given, checked before anything is drawn: its types, and lengths that can be computed with."""

import os
from collections.abc import Sequence
from typing import Any

from voxgran._base.arrays import check_lengths
from voxgran._base.errors import InputError
from voxgran.packing.model import Packing
from voxgran.shapes.model import Shape
from voxgran.shapes.sizes import SizeDistribution


def check_asked(shapes: Any, container: Any, sizes: Any, start: Any) -> tuple[Shape, ...]:
    """Return the shapes as a tuple.

    Parameters
    ----------
    shapes, container, sizes, start
        As :func:`voxgran.packing.pack.pack` takes them.

    Raises
    ------
    InputError
        If one of them is of another type, or a shape or the container is smaller than 1e-60 or larger than 1e60.
    """
    given = (shapes,) if isinstance(shapes, Shape) else shapes
    if not isinstance(given, Sequence) or not all(isinstance(shape, Shape) for shape in given):
        raise InputError(f"shapes is {_short(shapes)}: it must be a Shape or a list of them; make_shape makes one")
    known = all(hasattr(container, name) for name in ("dimension", "bounds", "signed_distance"))
    if isinstance(container, type) or not known:
        raise InputError(f"container is {_short(container)}: it must be a container; give a Box, or a Rectangle in 2D")
    if sizes is not None and not isinstance(sizes, SizeDistribution):
        raise InputError(f"sizes is {_short(sizes)}: it must be a size distribution; for one size give sizes.fixed")
    if start is not None and not isinstance(start, Packing):
        raise InputError(f"start is {_short(start)}: it must be a Packing; load or pack one")
    for shape in given:
        check_lengths(shape.bounding_radius, f"bounding radius of shape {shape.name!r}")
    check_lengths(container.bounds[1] - container.bounds[0], "length of the container")
    return tuple(given)


def check_drive(checkpoint: Any, on_step: Any, recorder: Any) -> None:
    """Check what a run is driven with.

    Parameters
    ----------
    checkpoint, on_step, recorder
        As :func:`voxgran.packing.pack.pack` takes them.

    Raises
    ------
    InputError
        If one of them is of another type.
    """
    if checkpoint is not None and not isinstance(checkpoint, str | os.PathLike):
        raise InputError(f"checkpoint is {_short(checkpoint)}: it must be the path of a file; change it")
    if on_step is not None and not callable(on_step):
        raise InputError(f"on_step is {_short(on_step)}: it must be a function of a step; change it")
    if recorder is not None and not (hasattr(recorder, "due") and hasattr(recorder, "record")):
        raise InputError(f"recorder is {_short(recorder)}: it must have the methods due and record; give a Series")


def _short(value: Any) -> str:
    """Return a value as a message shows it."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
