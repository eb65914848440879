"""Sponges: cubes from which smaller cubes are removed at each of several levels, regularly or at random.

At each level every cube is divided into b x b x b cells, of which N stay. Where N is the same for every cube, the
dimension of the sponge is exactly log N / log b. Regular kinds with a central hole of m cells are

- ``"menger"``: cells with two or three coordinates in the hole are removed, N = b^3 - 3 m^2 (b - m) - m^3;
- ``"sierpinski"``: cells with all coordinates in the hole are removed, which leaves closed cavities, N = b^3 - m^3;
- ``"carpet"``: cells with x and y in the hole are removed, N = b (b^2 - m^2).

The kind ``"random"`` removes cells at places that are drawn anew for each cube: a fixed number of them (the homogeneous
algorithm), or each with a probability (the heterogeneous algorithm; the dimension is that of the mean of N). What falls
apart is cut down to its largest connected piece.

References
----------
Sukop 2006, as surveyed by Sajjadi & Khalili 2015, Generating, Reproducing and Packaging of Random Volumes for Discrete
Element Analysis of Discontinuous Materials

Perfect, Gentry, Sukop & Lawson 2006, Multifractal Sierpinski carpets: Theory and application to upscaling effective
saturated hydraulic conductivity: the homogeneous and the heterogeneous algorithm
"""

import math
from typing import Any, Literal

import numpy as np

from voxgran._base.arrays import Booleans, Integers, as_count, as_share
from voxgran._base.config import check_bounds, parameter, parameter_class
from voxgran._base.errors import InputError, shown
from voxgran.shapes.family import ShapeFamily, Sized
from voxgran.shapes.generating.voxel_solid import largest_piece, mask_of_cubes, voxel_solid
from voxgran.shapes.model import Shape

#: largest number of cells on a side and in all
MOST_ON_SIDE, MOST_CELLS = 256, 1_000_000


@parameter_class
class SierpinskiSponge(Sized):
    """Parameters of a sponge.

    Parameters
    ----------
    kind
        where cells are removed: at random places, or from a central hole along three axes, none or z.
    divisions
        number of cells along an edge into which each cube is divided; from 2 to 16.
    levels
        number of times that all cubes are divided; 0 is a cube.
    hole
        width of the central hole in cells, as even or odd as the divisions; default: 1 or 2; not for 'random'.
    removed
        number of cells removed from each cube, only for 'random'; default: 7 of 27, and in this proportion.
    kept
        probability with which each cell stays, in place of a fixed number; only for 'random'.
    piece
        what is made of a sponge in several pieces: the largest one, or an error.
    edge
        edge of a smallest cube, in place of the diameter.

    Raises
    ------
    InputError
        If a parameter is out of range, or does not belong to the kind.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.shapes.sierpinski_sponge(divisions=3, levels=1, seed=1)
    Shape('sierpinski_sponge', mesh, diameter=1)
    """

    kind: Literal["random", "menger", "sierpinski", "carpet"] = parameter("random")
    divisions: int = parameter(3, at_least=2, at_most=16)
    levels: int = parameter(2)
    hole: int | None = parameter(None)
    removed: int | None = parameter(None)
    kept: float | None = parameter(None)
    piece: Literal["largest", "whole"] = parameter("largest")
    edge: float | None = parameter(None, unit="length")

    def __post_init__(self) -> None:
        """Check all parameters together."""
        check_bounds(self)
        if self.kind == "random":
            if self.hole is not None:
                raise InputError("hole is given: cells are removed at random places; leave it out or choose a kind")
            if self.removed is not None and self.kept is not None:
                raise InputError("removed and kept are both given: each says how many cells stay; leave one out")
            as_count(self.removed or 0, "removed", at_most=self.divisions**3 - 1)
            as_share(1.0 if self.kept is None else self.kept, "kept")
        else:
            for name in ("removed", "kept"):
                if getattr(self, name) is not None:
                    raise InputError(f"{name} is given: only kind 'random' takes it, not {self.kind!r}; leave it out")
            _hole(self)
        _check_levels(self)


def make(parameters: SierpinskiSponge, generator: np.random.Generator) -> Shape:
    """Return a sponge.

    Raises
    ------
    InputError
        If no cell is left by chance, or the sponge is not in one piece and is to be whole.
    """
    cells = np.zeros((1, 3), dtype=np.int64)
    for _ in range(parameters.levels):
        cells = divided(cells, parameters, generator)
        if not len(cells):
            raise InputError(
                f"kept is {parameters.kept}: by chance no cell is left with this seed; raise kept or take another seed"
            )
    whole = mask_of_cubes(cells)
    mask = largest_piece(whole)
    cubes = int(mask.sum())
    if parameters.piece == "whole" and cubes < len(cells):
        raise InputError(
            f"the sponge is in several pieces, the largest of {cubes} of its {len(cells)} cubes: a shape must be one "
            "piece; use piece='largest', remove fewer cells or take another seed"
        )
    record: dict[str, Any] = {"dimension": _dimension(parameters), "cubes": cubes, "whole_cubes": len(cells)}
    return voxel_solid(
        mask, name="sierpinski_sponge", diameter=parameters.diameter, edge=parameters.edge, record=record
    )


def divided(cells: Integers, parameters: SierpinskiSponge, generator: np.random.Generator) -> Integers:
    """Return the cells that stay when each cube, at its (n, 3) place, is divided."""
    b = parameters.divisions
    inside = np.indices((b, b, b)).reshape(3, -1).T
    if parameters.kind != "random":
        stays = np.broadcast_to(_generator_mask(parameters), (len(cells), b**3))
    elif parameters.kept is not None:
        stays = generator.random((len(cells), b**3)) < parameters.kept
    else:
        # the cells with the smallest of random numbers are removed
        draws = generator.random((len(cells), b**3))
        order = np.argsort(draws, axis=1, kind="stable")
        stays = np.ones(draws.shape, dtype=np.bool_)
        np.put_along_axis(stays, order[:, : _removed(parameters)], False, axis=1)
    cube, cell = np.nonzero(stays)
    return np.asarray(b * cells[cube] + inside[cell])


def _generator_mask(parameters: SierpinskiSponge) -> Booleans:
    """Return which of the b^3 cells of a cube stay in a regular sponge."""
    b, m = parameters.divisions, _hole(parameters)
    place = np.indices((b, b, b)).reshape(3, -1)
    central = (place >= (b - m) // 2) & (place < (b + m) // 2)
    if parameters.kind == "carpet":
        return np.asarray(~(central[0] & central[1]))
    return np.asarray(central.sum(axis=0) < (2 if parameters.kind == "menger" else 3))


def _hole(parameters: SierpinskiSponge) -> int:
    """Return the width of the central hole in cells."""
    b = parameters.divisions
    least = 2 - b % 2
    m = least if parameters.hole is None else as_count(parameters.hole, "hole", at_least=1)
    if (b - m) % 2 or m > b - 2:
        largest = b - 2
        remedy = f"take {least} to {largest} in steps of 2" if largest >= least else "take divisions of at least 3"
        raise InputError(
            f"hole is {m} with divisions {b}: the hole is central, with at least a cell on each side; {remedy}"
        )
    return m


def _removed(parameters: SierpinskiSponge) -> int:
    """Return the number of cells that are removed from each cube of a random sponge."""
    return round(7 / 27 * parameters.divisions**3) if parameters.removed is None else parameters.removed


def _staying(parameters: SierpinskiSponge) -> float:
    """Return the number of cells of a cube that stay; where each stays with a probability, its mean."""
    if parameters.kind != "random":
        return int(_generator_mask(parameters).sum())
    cells = parameters.divisions**3
    return cells - _removed(parameters) if parameters.kept is None else cells * parameters.kept


def _dimension(parameters: SierpinskiSponge) -> float:
    """Return log N / log b."""
    return math.log(_staying(parameters)) / math.log(parameters.divisions)


def _check_levels(parameters: SierpinskiSponge) -> None:
    """Refuse levels at which the sponge is too large."""
    b, levels = parameters.divisions, as_count(parameters.levels, "levels", at_most=None)
    per_cube = max(_staying(parameters), 1.0)
    possible = int(math.log(MOST_ON_SIDE) / math.log(b) + 1e-9)
    if per_cube > 1:
        possible = min(possible, int(math.log(MOST_CELLS) / math.log(per_cube) + 1e-9))
    if levels > possible:
        raise InputError(
            f"levels is {shown(levels)} with divisions {b}: at most {MOST_ON_SIDE} cells on a side and {MOST_CELLS} in "
            f"all are made; take at most {possible}"
        )


registration = ShapeFamily(
    summary="sponge of cubes, Menger's or with cells removed at random on several levels",
    parameters=SierpinskiSponge,
    make=make,
    source="Sukop 2006, as surveyed by Sajjadi & Khalili 2015",
    random=True,
)
