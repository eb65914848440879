"""What `pack` and its like are given, checked before anything is drawn: types and lengths."""

import os
import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from voxgran._base.arrays import check_lengths, check_type
from voxgran._base.errors import InputError, PackingWarning, shown
from voxgran._base.files import as_path
from voxgran.packing.model import Packing
from voxgran.shapes.model import Shape
from voxgran.shapes.sizes import SizeDistribution

if TYPE_CHECKING:
    from voxgran.packing.problem import Problem

#: parts of the container, by length and by volume, below which sizes are likely in another unit than the container
TINY, NOTHING = 1e-3, 1e-6
#: what an object must have to be a container
CONTAINER = ("kind", "dimension", "periodic", "volume", "bounds", "signed_distance", "mesh", "scaled", "to_mapping")


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
    given = check_shapes(shapes)
    missing = [name for name in CONTAINER if not hasattr(container, name)]
    if isinstance(container, type) or "signed_distance" in missing:
        raise InputError(f"container is {shown(container)}: it must be a container; give a Box, or a Rectangle in 2D")
    if missing:
        raise InputError(f"container has no {', '.join(missing)}: a container needs {', '.join(CONTAINER)}; add them")
    if sizes is not None and not isinstance(sizes, SizeDistribution):
        raise InputError(f"sizes is {shown(sizes)}: it must be a size distribution; for one size give sizes.fixed")
    if start is not None:
        check_packing(start, "start")
    for shape in given:
        check_lengths(shape.bounding_radius, f"bounding radius of shape {shape.name!r}")
    check_lengths(container.bounds[1] - container.bounds[0], "length of the container")
    return given


def check_shapes(shapes: Any) -> tuple[Shape, ...]:
    """Return one shape, or several, as a tuple.

    Raises
    ------
    InputError
        If it is something else.
    """
    given = (shapes,) if isinstance(shapes, Shape) else shapes
    if not isinstance(given, Sequence) or not all(isinstance(shape, Shape) for shape in given):
        raise InputError(f"shapes is {shown(shapes)}: it must be a Shape or a list of them; make_shape makes one")
    return tuple(given)


def check_packing(packing: Any, name: str) -> None:
    """Check that something is a packing.

    Parameters
    ----------
    packing : Packing
        What was given.
    name : str
        What the message calls it.

    Raises
    ------
    InputError
        If it is something else.
    """
    check_type(packing, Packing, name, "a Packing; load or pack one")


def check_drive(checkpoint: Any, resume: Any, on_step: Any, recorder: Any) -> None:
    """Check what a run is driven with.

    Parameters
    ----------
    checkpoint, resume, on_step, recorder
        As :func:`voxgran.packing.pack.pack` takes them.

    Raises
    ------
    InputError
        If one of them is of another type, or the checkpoint is no path.
    OutputError
        If the checkpoint cannot be reached.
    """
    if checkpoint is not None and not isinstance(checkpoint, str | os.PathLike):
        raise InputError(f"checkpoint is {shown(checkpoint)}: it must be the path of a file; change it")
    if checkpoint is not None:
        as_path(checkpoint)
    if not isinstance(resume, bool | np.bool_):
        raise InputError(f"resume is {shown(resume)}: it must be True or False; give the file as checkpoint")
    if on_step is not None and not callable(on_step):
        raise InputError(f"on_step is {shown(on_step)}: it must be a function of a step; change it")
    if recorder is not None and not (hasattr(recorder, "due") and hasattr(recorder, "record")):
        raise InputError(f"recorder is {shown(recorder)}: it must have the methods due and record; give a Series")


def warn_of_units(problem: "Problem") -> None:
    """Warn where grains are so small, and so few, that sizes and container are likely in different units.

    Parameters
    ----------
    problem : Problem
        With the grains drawn.
    """
    if problem.start is not None or not problem.count:
        return
    bounds = problem.container.bounds
    edge = float((bounds[1] - bounds[0])[: problem.dimension].min())
    largest, share = float(problem.diameter.max()), float(problem.volumes.sum()) / problem.container.volume
    if largest <= TINY * edge and share < NOTHING:
        unit = "" if problem.unit == "1" else f" {problem.unit}"
        warnings.warn(
            f"all {problem.count} grains, of diameters up to {largest * problem.unit_length:g}{unit}, fill "
            f"{share:.1g} of a container that is {edge * problem.unit_length:g}{unit} wide: if that is a mistake of "
            "units, give sizes and container in the same one",
            PackingWarning,
            # the same place for a plan and for the run after it, so that it is told once
            stacklevel=2,
        )
