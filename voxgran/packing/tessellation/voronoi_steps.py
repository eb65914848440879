"""Steps towards cells of given volumes: each computes all cells once, and then moves the seeds and changes the weights.

While the seeds are smoothed they move to the centroids of their cells (Lloyd's method), so that cells become round and
walls lie between them; afterwards the weights alone change until the volumes are met. A step after which a cell has
almost vanished is taken again at half its length.

The volume of a cell grows with its own weight and shrinks with those of its neighbours, by the area of their common
face over twice the distance of the seeds. Newton's method with these derivatives, damped so that no cell becomes empty,
converges from any seeds to the one set of weights, up to a constant (Kitagawa, Mérigot & Thibert).

References
----------
Kitagawa, Mérigot & Thibert 2019, Convergence of a Newton algorithm for semi-discrete optimal transport, Journal of the
European Mathematical Society 21, 2603-2651, doi:10.4171/JEMS/889.
Bourne, Kok, Roper & Spanjer 2020, Laguerre tessellations and polycrystalline microstructures: a fast algorithm for
generating grains of given volumes, Philosophical Magazine 100, 2677-2707, doi:10.1080/14786435.2020.1790053.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats
from voxgran._base.lazy import load
from voxgran.packing.method import State
from voxgran.packing.tessellation.voronoi_cells import Cells, Diagram, seeds_of

#: largest relative error of a volume at the end; where round walls make it larger, steps end below the second number
#: as soon as one of them does not halve the error
EXACT, FAIR = 1e-4, 0.02
#: part of the smallest share of its volume that a cell keeps at a step
KEPT = 0.3
#: steps after the last smoothing one, at most, and diagrams per step
NEWTON_STEPS, DIAGRAMS = 60, 4
#: share of the moves at which cells do not yet have the volumes that are asked for
EVEN = 0.9
#: cells between two looks whether to stop
BLOCK = 400


class Tally(NamedTuple):
    """Places in the array of counts: smoothing steps made, diagrams computed, and whether the cells are final."""

    steps: int = 0
    diagrams: int = 1
    final: int = 2


TALLY = Tally()


def first_arrays(place: Floats) -> dict[str, np.ndarray[tuple[int, ...], np.dtype[np.float64]]]:
    """Return the arrays of a tessellation with seeds at random places, (n, 3) from the lower corner.

    place, weight: seeds of the next diagram.  known_place, known_weight: those of the last diagram that is kept, from
    where move and change lead; length: share of these that was taken.  smallest: smallest share of a volume there.
    """
    n = len(place)
    return {
        "place": place,
        "weight": np.zeros(n),
        "known_place": place.copy(),
        "known_weight": np.zeros(n),
        "move": np.zeros((n, 3)),
        "change": np.zeros(n),
        "length": np.ones(1),
        "smallest": np.zeros(1),
        "error": np.full(1, np.inf),
    }


def most_diagrams(smoothing: int) -> int:
    """Return how many diagrams are computed at most."""
    return DIAGRAMS * (smoothing + NEWTON_STEPS)


def _wanted(share: Floats, steps: int, smoothing: int) -> Floats:
    """Return the shares of all cells in the volume at a step: at first alike, and as asked after half of the moves."""
    grown = libm.power(share, min(1.0, (steps + 1.0) / (EVEN * smoothing + 1.0)))
    return np.asarray(grown / grown.sum())


def step(cells: Cells, state: State, share: Floats, smoothing: int, look: Callable[[], None]) -> None:
    """Compute all cells, whose volumes are to be shares (n,) of all; then move on, or find that they are final.

    Nothing has changed where `look` raises.
    """
    arrays, tally, walls = state.arrays, state.arrays["tally"], cells.walls
    diagram = cells.measured(seeds_of(arrays["place"], arrays["weight"], walls), BLOCK, look)
    volumes = _wanted(share, int(tally[TALLY.steps]), smoothing) * diagram.volume.sum()
    ratio = diagram.volume / volumes
    over = tally[TALLY.diagrams] + 1 >= most_diagrams(smoothing)
    tally[TALLY.diagrams] += 1
    if tally[TALLY.diagrams] > 1 and ratio.min() < KEPT * min(arrays["smallest"][0], 1.0):
        arrays["length"][0] *= 0.5
        if over:
            arrays["length"][0] = 0.0
    else:
        arrays["length"][0], arrays["smallest"][0] = 1.0, ratio.min()
        before, error = arrays["error"][0], np.abs(ratio - 1.0).max()
        arrays["error"][0] = error
        arrays["known_place"], arrays["known_weight"] = arrays["place"], arrays["weight"]
        moves = tally[TALLY.steps] < smoothing
        met = error <= EXACT or (error <= FAIR and error > 0.5 * before)
        if over or (not moves and met):
            tally[TALLY.final] = 1
            return
        tally[TALLY.steps] += 1
        arrays["move"] = diagram.center - arrays["place"] if moves else np.zeros_like(diagram.center)
        arrays["change"] = weight_steps(diagram, volumes)
    length = arrays["length"][0]
    place = arrays["known_place"] + length * arrays["move"]
    wraps = np.flatnonzero(walls.periodic[: walls.dimension])
    place[:, wraps] -= np.floor(place[:, wraps] / walls.lengths[wraps]) * walls.lengths[wraps]
    arrays["place"], arrays["weight"] = place, arrays["known_weight"] + length * arrays["change"]
    tally[TALLY.final] = int(over)


#: relative residual of the linear equations, and most iterations
RESIDUAL, ITERATIONS = 1e-6, 1000


def weight_steps(diagram: Diagram, volumes: Floats) -> Floats:
    """Return what to add to the weights, (n,), so that the cells get the volumes, to first order; their mean is 0."""
    n, sparse = len(volumes), load("scipy.sparse")
    one_way = sparse.csr_array((diagram.slope, diagram.beyond, diagram.start), shape=(n, n))
    # at round walls and at corners of the container, the two sides of a face differ a little
    matrix = load("scipy.sparse.csgraph").laplacian((one_way + one_way.T) / 2.0).tocsr()
    lacking = volumes - diagram.volume
    steps = linear.conjugate_gradient(matrix, lacking - lacking.mean(), relative=RESIDUAL, most=ITERATIONS)
    return np.asarray(steps - steps.mean())
