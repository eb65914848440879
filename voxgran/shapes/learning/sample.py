"""What is learned from: solid grains of true size, and how often each stands for grains that the border has cut."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from voxgran._base.arrays import Floats, as_floats, check_type
from voxgran._base.errors import InputError
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape

#: fewest grains from which a distribution is learned
FEWEST = 10


@runtime_checkable
class Grains(Protocol):
    """What is asked of a packing: its grains, and of a packing of labels where it has been cut."""

    shapes: Sequence[Shape]
    shape_id: NDArray[Any]
    scale: Floats
    container: Any
    provenance: Any
    contact_gap: float

    def world_vertices(self, grain: int) -> Floats:
        """Return the vertices of a grain where it lies."""


class Sample(NamedTuple):
    """Solids of true size, and their weights (n,) of sum 1."""

    shapes: list[Shape]
    weights: Floats


def closed_grains(packing: Grains) -> tuple[NDArray[np.int64], Floats]:
    """Return which grains of a packing are whole, and their weights, of sum 1.

    Of a packing of labels the grains at the border of the image are cut and left out. As a large grain is cut more
    often than a small one, each other grain has the weight of Miles and Lantuejoul, one over the share of places in
    which a grain of its extents lies within the image. Of other packings all grains are whole, with equal weights.

    References
    ----------
    .. [1] Serra 1982, Image Analysis and Mathematical Morphology, on the correction of Miles and Lantuejoul
    """
    count = len(packing.shape_id)
    if packing.provenance.get("method") != "labels":
        return np.arange(count), np.full(count, 1 / max(count, 1))
    lower, upper = np.asarray(packing.container.bounds, dtype=np.float64)
    if packing.provenance["parameters"]["border"] == "drop":
        # the border of the image lies outside of the box around the grains that were kept
        return np.arange(count), np.full(count, 1 / max(count, 1))
    walls = ~np.asarray(packing.container.periodic, dtype=bool)
    corners = [packing.world_vertices(grain) for grain in range(count)]
    low = np.array([points.min(axis=0) for points in corners])
    high = np.array([points.max(axis=0) for points in corners])
    room = np.minimum(low - lower, upper - high)
    whole = np.flatnonzero((room > packing.contact_gap / 2)[:, walls].all(axis=1))
    shares = 1 - (high - low)[whole][:, walls] / (upper - lower)[walls]
    weights = 1 / np.maximum(shares, 1e-3).prod(axis=1)
    return whole, weights / max(weights.sum(), 1e-300)


def checked_sample(shapes: Any, sizes: "ArrayLike | None", weights: "ArrayLike | None") -> Sample:
    """Return the checked grains of a list of shapes or of a packing, as meshes of true size about their centroids.

    Raises
    ------
    InputError
        If there are fewer than 10, they are equal, open or plane, or a size or a weight is out of range.
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
        check_type(shapes, Iterable, "shapes", "a list of shapes or a packing; make_shapes makes a list")
        every = list(shapes)
    for shape in every:
        check_type(shape, Shape, "shapes", "a list of shapes or a packing; make_shapes makes a list")
        shape.refuse_open("distributions of shapes")
        if shape.dimension == 2:
            raise InputError(f"shape {shape.name!r} is plane: distributions are learned from solids; take solids")
    if len(every) < FEWEST:
        raise InputError(f"shapes has {len(every)} whole grains: at least {FEWEST} are needed; give more")
    if len({shape.key for shape in every}) == 1:
        raise InputError(f"shapes is {len(every)} times one shape: there is no distribution; pack that shape itself")
    units = sorted({shape.unit for shape in every if shape.unit})
    if len(units) > 1:
        raise InputError(f"the shapes have the units {', '.join(units)}: they must have one; convert them with to_unit")
    unit = units[0] if units else None
    solids = [meshed(shape, unit) for shape in every]
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
