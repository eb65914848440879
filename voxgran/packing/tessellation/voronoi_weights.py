"""Weights of seeds with which the cells get the volumes that are asked for.

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

import math

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.kernels import kernel
from voxgran._base.lazy import load
from voxgran.packing.tessellation.voronoi_cells import Diagram

#: relative residual of the linear equations, and most iterations
RESIDUAL, ITERATIONS = 1e-6, 1000


def weight_steps(diagram: Diagram, volumes: Floats) -> Floats:
    """Return what to add to the weights, (n,), so that the cells get the volumes, to first order; their mean is 0."""
    n = len(volumes)
    steps = np.zeros(n)
    one_way = load("scipy.sparse").csr_array((diagram.slope, diagram.beyond, diagram.start), shape=(n, n))
    # at round walls and at corners of the container, the two sides of a face differ a little
    both = (one_way + one_way.T).tocsr() / 2.0
    both.sort_indices()
    start, beyond = both.indptr.astype(np.int64), both.indices.astype(np.int64)
    _conjugate_gradients(start, beyond, both.data, volumes - diagram.volume, steps)
    return np.asarray(steps - steps.mean())


@kernel
def _conjugate_gradients(start, beyond, slope, wanted, steps):  # type: ignore[no-untyped-def]
    """Solve ``sum over neighbours of slope * (step - step beyond) = wanted`` with the diagonal as preconditioner."""
    n = len(wanted)
    diagonal, rest, way, image = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    shift = 0.0
    for i in range(n):
        shift += wanted[i] / n
        for k in range(start[i], start[i + 1]):
            if beyond[k] != i:
                diagonal[i] += slope[k]
    square = 0.0
    for i in range(n):
        rest[i] = wanted[i] - shift
        diagonal[i] = diagonal[i] if diagonal[i] > 0.0 else 1.0
        way[i] = rest[i] / diagonal[i]
        square += rest[i] * way[i]
    end = square * RESIDUAL * RESIDUAL
    for _ in range(ITERATIONS):
        if not square > end:
            return
        along = 0.0
        for i in range(n):
            total = 0.0
            for k in range(start[i], start[i + 1]):
                total += slope[k] * (way[i] - way[beyond[k]])
            image[i] = total
            along += way[i] * total
        if not (along > 0.0 and math.isfinite(along)):
            return
        length, before, square = square / along, square, 0.0
        for i in range(n):
            steps[i] += length * way[i]
            rest[i] -= length * image[i]
            square += rest[i] * rest[i] / diagonal[i]
        for i in range(n):
            way[i] = rest[i] / diagonal[i] + square / before * way[i]
