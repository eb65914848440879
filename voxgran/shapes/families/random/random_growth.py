"""Random growth: a cube grows by cubes at random free places beside it, as cells of a colony do.

Each free place beside the cluster is taken with a probability that is proportional to a power of the number of its
neighbours in the cluster: power 1 chooses the free faces of the cluster with equal probabilities, power 0 the free
places themselves (the model of Eden 1961); larger powers make smooth, negative ones porous clusters. The
cluster may be stretched along the axes: by given rates along x, y and z, or by rates that are adjusted as it grows, so
that its radii of gyration along the axes have a given ratio (within 3 % from 20 000 cubes on, within 10 % of 500).

References
----------
Chernyh 2013, as surveyed by Sajjadi & Khalili 2015, Generating, Reproducing and Packaging of Random Volumes for
Discrete Element Analysis of Discontinuous Materials

Paiva & Ferreira 2007, Universality class of isotropic on-lattice Eden clusters, arXiv:cond-mat/0611160: the power of
the number of neighbours
"""

import math
from typing import NamedTuple

import numpy as np

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import Booleans, Floats, Integers, as_number, as_positive
from voxgran._base.config import check_bounds, parameter, parameter_class
from voxgran._base.errors import InputError
from voxgran._base.kernels import inlined_kernel, kernel
from voxgran.shapes.family import ShapeFamily, Sized
from voxgran.shapes.generating.voxel_solid import mask_of_cubes, voxel_solid
from voxgran.shapes.model import Shape

MOST_CUBES = 2_000_000
#: largest ratio of two axes, or of two rates
MOST_STRETCHED = 10.0
#: random numbers that are drawn at once
DRAWN = 1 << 14
#: how strongly rates follow the difference of the logarithms of the wanted and the present axes
GAIN = 150.0


@parameter_class
class RandomGrowth(Sized):
    """Parameters of random growth.

    Parameters
    ----------
    cubes
        number of cubes; from 1 to 2 000 000.
    power
        power of the number of neighbours of a free place; from -4 (porous) over 0 and 1 to 4 (smooth).
    rates
        rates of growth along x, y and z; default: equal; at most 10 times each other.
    aspect
        ratio of the axes, met by rates that are adjusted; at most 10 times each other.
    edge
        edge of a cube, in place of the diameter.

    Raises
    ------
    InputError
        If a parameter is out of range, or rates and aspect are both given.

    Examples
    --------
    >>> import voxgran as vg
    >>> round(vg.shapes.random_growth(cubes=20, edge=1.0, seed=1).volume, 6)
    20.0
    """

    cubes: int = parameter(500, at_least=1, at_most=MOST_CUBES)
    power: float = parameter(1.0, at_least=-4.0, at_most=4.0)
    rates: tuple[float, float, float] | None = parameter(None)
    aspect: tuple[float, float, float] | None = parameter(None)
    edge: float | None = parameter(None, unit="length")

    def __post_init__(self) -> None:
        """Check all parameters together."""
        check_bounds(self)
        if self.rates is not None and self.aspect is not None:
            raise InputError(
                "rates and aspect are both given: each decides how far it grows along the axes; leave one out"
            )
        for name in ("rates", "aspect"):
            values = getattr(self, name)
            if values is not None:
                least = min(as_positive(value, name) for value in values)
                as_number(
                    max(values) / least, f"the ratio of the largest to the smallest {name}", at_most=MOST_STRETCHED
                )
        if self.aspect is not None and min(self.aspect) < max(self.aspect):
            # the shortest axis of the ellipsoid is at least two cubes long
            fewest = math.ceil(4 / 3 * math.pi * math.prod(self.aspect) / min(self.aspect) ** 3)
            if self.cubes < fewest:
                raise InputError(
                    f"cubes is {self.cubes}: too few for the aspect {self.aspect}, of which the shortest axis must be "
                    f"at least two cubes long; take at least {fewest}"
                )


def make(parameters: RandomGrowth, generator: np.random.Generator) -> Shape:
    """Return a cluster."""
    cells = grown(parameters, generator)
    places = cells - cells.mean(axis=0)
    # a cube has a moment of its own
    record = {"cubes": len(cells), "gyration_radii": np.sqrt((places**2).mean(axis=0) + 1 / 12)}
    size = {"diameter": parameters.diameter, "edge": parameters.edge}
    return voxel_solid(mask_of_cubes(cells), name="random_growth", record=record, **size)


def grown(parameters: RandomGrowth, generator: np.random.Generator) -> Integers:
    """Return the places of the cubes in the order of growth, (n, 3); the first is at 0."""
    rate = np.array(parameters.rates or (1.0, 1.0, 1.0), dtype=np.float64)
    rate /= rate.max()
    aspect = np.array(parameters.aspect or (1.0, 1.0, 1.0), dtype=np.float64)
    log_aspect, adjusted = libm.log(aspect), len(set(aspect.tolist())) > 1
    cells, bonds = np.zeros((parameters.cubes, 3), dtype=np.int64), np.zeros(6 * parameters.cubes, dtype=np.int64)
    # half widths of the box of the cluster, which is made wider whenever a cube reaches its border
    radius = (parameters.cubes / np.prod(aspect)) ** (1 / 3)
    half = np.ceil(3 + 0.8 * radius * aspect).astype(np.int64)
    count, chance = 1, _chances(float(parameters.power))
    while True:
        grid, moments = np.zeros(2 * half + 3, dtype=np.bool_), np.zeros(6)
        steps = np.array([grid.shape[1] * grid.shape[2], grid.shape[2], 1])
        state, taken = np.array([count, 0, 0]), grid.ravel()
        cluster = Cluster(cells, half, steps, taken, bonds, state, moments)
        _begin(cluster)
        while state[0] < len(cells) and not state[2]:
            _grow(cluster, generator.random(DRAWN), chance, rate, log_aspect, adjusted)
        count = int(state[0])
        if count == len(cells):
            return cells
        reach = np.abs(cells[:count]).max(axis=0)
        half = np.where(reach >= half, np.ceil(1.5 * half).astype(np.int64), half)


def _chances(power: float) -> Floats:
    """Return the chances at which a bond is taken, by the number of neighbours of its place, (7,); at most 1."""
    many = np.arange(1, 7)
    return np.concatenate([[0.0], libm.power(many / 6.0 if power > 1.0 else many * 1.0, power - 1.0)])


class Cluster(NamedTuple):
    """Cubes in a grid, and the free places beside them.

    cells: (n, 3) cubes in the order of growth.  half, steps: (3,) half widths of the grid without its border, and steps
    of the index along its axes.  taken: which places are.  bonds: free places and axes, ``3 * index + axis``.  state:
    (3,) cubes, bonds, and whether a cube is at the border.  moments: (6,) sums of the places and of their squares.
    """

    cells: Integers
    half: Integers
    steps: Integers
    taken: Booleans
    bonds: Integers
    state: Integers
    moments: Floats


@inlined_kernel
def _take(cluster, k, index):  # type: ignore[no-untyped-def]
    """Take the place of cube k, at an index in the grid, and note the free places beside it."""
    cells, _, steps, taken, bonds, state, moments = cluster
    taken[index] = True
    for axis in range(3):
        moments[axis] += cells[k, axis]
        moments[3 + axis] += cells[k, axis] * cells[k, axis]
        for side in (-1, 1):
            beside = index + side * steps[axis]
            if not taken[beside]:
                bonds[state[1]] = 3 * beside + axis
                state[1] += 1


@inlined_kernel
def _adjust(n, moments, log_aspect, rate):  # type: ignore[no-untyped-def]
    """Set the rates along the axes by the aspect that n cubes lack; loops over axes compile faster than arrays."""
    middle, largest = 0.0, -math.inf
    for k in range(3):
        # a cube has a moment of its own
        square = moments[3 + k] / n - (moments[k] / n) ** 2 + 1.0 / 12.0
        rate[k] = log_aspect[k] - 0.5 * math.log(square)
        middle += rate[k]
    for k in range(3):
        rate[k] = GAIN * (rate[k] - middle / 3.0)
        largest = max(largest, rate[k])
    for k in range(3):
        rate[k] = math.exp(rate[k] - largest)


@kernel
def _begin(cluster):  # type: ignore[no-untyped-def]
    """Put the first `state[0]` cubes in a grid."""
    for k in range(cluster.state[0]):
        index = 0
        for axis in range(3):
            index += (cluster.cells[k, axis] + cluster.half[axis] + 1) * cluster.steps[axis]
        _take(cluster, k, index)


@kernel
def _grow(cluster, draws, chance, rate, log_aspect, adjusted):  # type: ignore[no-untyped-def]
    """Add cubes until all are there, a cube is at the border of the grid (`state[2]`), or the random numbers are used.

    A bond is a free place and the axis along which the cluster touches it, so that places have one for each neighbour;
    those of places that are taken meanwhile are removed when they are drawn.
    """
    (cells, half, steps, taken, bonds, state, moments), used = cluster, 0
    while state[0] < len(cells) and not state[2] and used + 2 <= len(draws):
        pick = int(draws[used] * state[1])
        index, axis = bonds[pick] // 3, bonds[pick] % 3
        used += 2
        if taken[index]:
            state[1] -= 1
            bonds[pick] = bonds[state[1]]
            continue
        many = 0
        for k in range(3):
            many += int(taken[index - steps[k]]) + int(taken[index + steps[k]])
        if draws[used - 1] >= rate[axis] * chance[many]:
            continue
        rest = index
        for k in range(3):
            cells[state[0], k] = rest // steps[k] - half[k] - 1
            rest %= steps[k]
            if abs(cells[state[0], k]) >= half[k]:
                state[2] = 1
        _take(cluster, state[0], index)
        state[0] += 1
        if adjusted:
            _adjust(float(state[0]), moments, log_aspect, rate)


registration = ShapeFamily(
    summary="cluster of equal cubes that grows from one at random free places beside it",
    parameters=RandomGrowth,
    make=make,
    source="Chernyh 2013, as surveyed by Sajjadi & Khalili 2015",
    random=True,
    libraries=("numba",),
)
