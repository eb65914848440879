"""Grains of a distribution that was learned from a sample, such as that of a scan.

The record of a shape has its `donor`, the grain of the sample that it was made of, and the `map` of its points.
"""

import os
from functools import lru_cache

import numpy as np

from voxgran._base.arrays import as_length
from voxgran._base.config import check_bounds, parameter, parameter_class
from voxgran._base.files import existing_file
from voxgran.shapes.family import ShapeFamily, Sized
from voxgran.shapes.learning.model import ShapeModel
from voxgran.shapes.model import Shape


@parameter_class
class Learned(Sized):
    """Parameters of a grain of a learned distribution.

    Parameters
    ----------
    model
        what vg.learn_shapes returns, or a file of it.
    diameter
        equivalent diameter; default: drawn too, as the sizes of the sample are.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If it is damaged, or holds something else.

    Examples
    --------
    >>> import voxgran as vg
    >>> model = vg.learn_shapes(vg.make_shapes("convex_polyhedron", count=12))
    >>> vg.shapes.learned(model=model, seed=1)
    Shape('learned', mesh, diameter=1)
    """

    model: ShapeModel | str = parameter()

    def __post_init__(self) -> None:
        """Check the diameter."""
        check_bounds(self)


def make(parameters: Learned, generator: np.random.Generator) -> Shape:
    """Return a grain."""
    model = parameters.model
    if isinstance(model, str):
        found = existing_file(model)
        about = os.stat(found)
        model = _loaded(str(found), about.st_mtime_ns, about.st_size)
    shape = model.draw(generator)
    if parameters.diameter is None:
        return shape
    return shape.scaled(as_length(parameters.diameter, "diameter") / shape.diameter)


# a model that makes a thousand grains is read once; a file that has changed is read again
@lru_cache(maxsize=4)
def _loaded(path: str, changed: int, size: int) -> ShapeModel:
    """Return the model of a file, as it was when it was changed."""
    del changed, size
    return ShapeModel.load(path)


registration = ShapeFamily(
    summary="grain of a distribution that was learned from a sample", parameters=Learned, make=make, random=True
)
