"""What is learned from: solid grains of true size, and how often each stands for grains that the border has cut."""

import os
from collections.abc import Iterable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from voxgran._base.arrays import Floats, as_floats, check_type
from voxgran._base.errors import InputError
from voxgran.shapes.learning.border import Grains, border_weights
from voxgran.shapes.learning.steps import CONVEX, ELLIPSOID, KINDS, without_steps
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.repairing.simplify import simplified

#: fewest grains from which a distribution is learned, and most triangles of labels without their steps
FEWEST, FACES = 10, 200


class Sample(NamedTuple):
    """Solids of true size, and their weights (n,) of sum 1."""

    shapes: list[Shape]
    weights: Floats


def closed_grains(packing: Grains) -> tuple[NDArray[np.int64], Floats]:
    """Return which grains of a packing are whole, and their weights, of sum 1.

    See :func:`voxgran.shapes.learning.border.border_weights`.
    """
    weights = border_weights(packing)
    whole = np.flatnonzero(weights)
    return whole, weights[whole] / max(float(weights.sum()), 1e-300)


def checked_sample(shapes: Any, sizes: "ArrayLike | None", weights: "ArrayLike | None") -> Sample:
    """Return the checked grains of a list of shapes or of a packing, as meshes of true size about their centroids, and
    labels of an image without its steps; of spheres there is no distribution but that of ellipsoids that are nearly so.

    Raises
    ------
    InputError
        If there are fewer than 10, they are open or plane, or a size or a weight is out of range.
    """
    own = None
    if isinstance(shapes, Grains):
        whole, own = closed_grains(shapes)
        if not len(whole):
            raise InputError(
                f"the packing has {len(shapes.shape_id)} grains, all of which the border of the image cuts: whole "
                "grains are needed; take a larger image"
            )
        every = [shapes.shapes[shapes.shape_id[k]].scaled(float(shapes.scale[k])) for k in whole]
    else:
        if isinstance(shapes, str | os.PathLike):
            raise InputError(f"shapes is {str(shapes)!r}: a list or a packing is needed; vg.load reads a packing")
        check_type(shapes, Iterable, "shapes", "a list of shapes or a packing; make_shapes makes a list")
        every = list(shapes)
    for shape in every:
        check_type(shape, Shape, "shapes", "a list of shapes or a packing; make_shapes makes a list")
        shape.refuse_open("distributions of shapes")
        if shape.dimension == 2:
            raise InputError(f"shape {shape.name!r} is plane: distributions are learned from solids; take solids")
    if len(every) < FEWEST:
        raise InputError(f"shapes has {len(every)} whole grains: at least {FEWEST} are needed; give more")
    units = sorted({shape.unit for shape in every if shape.unit})
    if len(units) > 1:
        raise InputError(f"the shapes have the units {', '.join(units)}: they must have one; convert them with to_unit")
    unit = units[0] if units else None
    kind, found = without_steps(every, np.ones(len(every)) if own is None else own, FACES, (ELLIPSOID, CONVEX))
    solids = [meshed(shape, unit) for shape in (simplified(found, FACES) if kind in KINDS else every)]
    if sizes is not None:
        asked = _positive(sizes, "sizes", len(every))
        solids = [shape.scaled(size / shape.diameter) for shape, size in zip(solids, asked, strict=True)]
    if weights is not None:
        own = _positive(weights, "weights", len(every))
    own = np.ones(len(every)) if own is None else own
    return Sample(solids, own / own.sum())


def meshed(shape: Shape, unit: str | None = None) -> Shape:
    """Return a solid as the mesh of its tessellation, so that it is compared with meshes of equal resolution."""
    made = Shape.of(Mesh(np.array(shape.vertices), np.array(shape.faces)), name=shape.name, unit=unit or shape.unit)
    return replace(made, offset=(0.0, 0.0, 0.0))


def _positive(values: "ArrayLike", name: str, count: int) -> Floats:
    """Return numbers above 0, one for each grain."""
    found = as_floats(values, name, shape=(count,))
    if (found <= 0).any():
        raise InputError(f"{name} has {found.min():g}: all must be above 0; change it")
    return found
