"""Rain of cubes: equal cubes fall at random on a plate of cubes and on each other, column by column, and stick.

Rules of deposition:

- ``"ballistic"``: a cube sticks where its side or bottom first touches another, so that overhangs and cavities remain;
- ``"random"``: a cube stays on top of its column, and the heights of the columns are independent;
- ``"relaxed"``: a cube stays on top of the lowest of its column and the four beside it.

The record of a shape holds, for each column, the height of its highest cube and the number of cubes that stay in it,
both without the plate; they differ by what is empty below the highest cube. Columns outside of the base have -1.

References
----------
Pokrovskii 2011, as surveyed by Sajjadi & Khalili 2015, Generating, Reproducing and Packaging of Random Volumes for
Discrete Element Analysis of Discontinuous Materials
"""

from typing import Literal

import numpy as np

from voxgran._base.arrays import Booleans, Integers
from voxgran._base.config import parameter, parameter_class
from voxgran._base.errors import InputError
from voxgran._base.kernels import kernel
from voxgran.shapes.family import ShapeFamily, Sized
from voxgran.shapes.generating.voxel_solid import voxel_solid
from voxgran.shapes.model import Shape

RULES = ("ballistic", "random", "relaxed")
#: largest width of the base, number of cubes, and number of voxels of the box that holds them
MOST_WIDE, MOST_CUBES, MOST_VOXELS = 1024, 5_000_000, 200_000_000


@parameter_class
class VoxelRain(Sized):
    """Parameters of a rain of cubes.

    Parameters
    ----------
    cubes
        number of cubes that fall; to 5 000 000.
    width
        cubes along the base in x and y; from 1 to 1024 each.
    base
        form of the base.
    plate
        thickness of the plate on which they fall, in cubes; from 1 to 1024.
    deposition
        where a cube stays: where it first touches another, on its column, or on the lowest column near.
    edge
        edge of a cube, in place of the diameter.

    Raises
    ------
    InputError
        If a parameter is out of range.

    Examples
    --------
    >>> import voxgran as vg
    >>> round(vg.shapes.voxel_rain(cubes=40, width=(4, 4), edge=1.0, seed=1).volume, 6)
    56.0
    """

    cubes: int = parameter(400, at_most=MOST_CUBES)
    width: tuple[int, int] = parameter((10, 10), at_least=1, at_most=MOST_WIDE)
    base: Literal["rectangle", "ellipse"] = parameter("rectangle")
    plate: int = parameter(1, at_least=1, at_most=MOST_WIDE)
    deposition: Literal["ballistic", "random", "relaxed"] = parameter("ballistic")
    edge: float | None = parameter(None, unit="length")


def make(parameters: VoxelRain, generator: np.random.Generator) -> Shape:
    """Return a plate with the cubes that fell on it.

    Raises
    ------
    InputError
        If the cubes reach so high that too many voxels would be made.
    """
    base = base_of(parameters)
    column, level, heights = rained(base, parameters.cubes, parameters.deposition, generator)
    tall = parameters.plate + int(heights.max())
    if tall * base.size > MOST_VOXELS:
        raise InputError(
            f"the cubes reach a height of {tall} over a base of {base.shape[0]} x {base.shape[1]}: at most "
            f"{MOST_VOXELS} voxels are made; take fewer cubes or a wider base"
        )
    mask = np.zeros((base.size, tall), dtype=np.bool_)
    mask[base.ravel(), : parameters.plate] = True
    mask[column, parameters.plate + level] = True
    counts = np.bincount(column, minlength=base.size)
    record = {
        "heights": np.where(base, heights.reshape(base.shape), -1),
        "counts": np.where(base, counts.reshape(base.shape), -1),
        "plate": parameters.plate,
    }
    size = {"diameter": parameters.diameter, "edge": parameters.edge}
    return voxel_solid(mask.reshape(*base.shape, tall), name="voxel_rain", record=record, **size)


def base_of(parameters: VoxelRain) -> Booleans:
    """Return which columns the base has, (nx, ny); of an ellipse those that have their middle in it."""
    if parameters.base == "rectangle":
        return np.ones(parameters.width, dtype=np.bool_)
    x, y = ((2 * np.arange(n) + 1 - n) / n for n in parameters.width)
    return np.asarray(x[:, None] ** 2 + y**2 <= 1.0)


def rained(
    base: Booleans, cubes: int, deposition: str, generator: np.random.Generator
) -> tuple[Integers, Integers, Integers]:
    """Return column and level of each cube that falls on a base (nx, ny), and the height of each of its columns."""
    inside = np.flatnonzero(base)
    column = inside[generator.integers(len(inside), size=cubes)]
    level = np.empty(cubes, dtype=np.int64)
    heights = np.where(base, 0, -1).ravel()
    ties = generator.random(cubes) if deposition == "relaxed" else np.zeros(1)
    _fall(column, level, heights, base.shape[1], RULES.index(deposition), ties)
    return column, level, np.maximum(heights, 0)


@kernel
def _fall(column, level, heights, row, rule, ties):  # type: ignore[no-untyped-def]
    """Let cubes fall on columns, those outside of the base having a height of -1; write the level of each, and for
    rule 2 (relaxed) the column in which it stays.
    """
    near = np.empty(5, np.int64)
    for k in range(len(column)):
        own = column[k]
        near[0] = own
        count = 1
        y = own % row
        if y > 0 and heights[own - 1] >= 0:
            near[count] = own - 1
            count += 1
        if y < row - 1 and heights[own + 1] >= 0:
            near[count] = own + 1
            count += 1
        if own >= row and heights[own - row] >= 0:
            near[count] = own - row
            count += 1
        if own + row < len(heights) and heights[own + row] >= 0:
            near[count] = own + row
            count += 1
        top = heights[own] + 1
        if rule == 0:
            for n in range(1, count):
                top = max(top, heights[near[n]])
        elif rule == 2:
            lowest, equal = heights[own], 0
            for n in range(1, count):
                if heights[near[n]] < lowest:
                    lowest, equal = heights[near[n]], 0
                if heights[near[n]] == lowest and lowest < heights[own]:
                    near[equal] = near[n]
                    equal += 1
            if equal:
                own = near[int(ties[k] * equal)]
            column[k] = own
            top = heights[own] + 1
        level[k] = top - 1
        heights[own] = top


registration = ShapeFamily(
    summary="equal cubes that fall at random on a plate and on each other, and stick",
    parameters=VoxelRain,
    make=make,
    source="Pokrovskii 2011, as surveyed by Sajjadi & Khalili 2015",
    random=True,
    libraries=("numba",),
)
