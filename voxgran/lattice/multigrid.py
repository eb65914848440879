"""Steady flow through the cells of a lattice: conjugate gradients, preconditioned by multigrid.

On each coarser lattice two cells along each axis are one, and conductances are half the sums of those between pairs,
since the distance is twice as long (Braess 1995, doi:10.1007/BF02238488); one sweep of Gauss and Seidel on the way down
and one back on the way up make the cycle symmetric. Of all potentials the one sought makes the dissipation smallest,
and this smallest value is the flow: each step lowers it by a known amount, and the amounts of the last steps estimate
its error (Hestenes & Stiefel 1952, doi:10.6028/jres.049.044).
"""

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel, inlined_kernel

Singles: TypeAlias = NDArray[np.float32]

#: relative error of the flow at which iterations end, steps whose sum estimates it, and steps at most
ACCURACY, DELAY, MOST_STEPS = 1e-5, 2, 1000
#: cells along the longest axis of the coarsest lattice, and pairs of sweeps there
COARSEST, SWEEPS = 2, 4

#: a lattice: conductances (3, nx, ny, nz) to the next cell along each axis, the last to the first, and (nx, ny, nz)
#: those to the ends, in single precision: flows between cells are computed from differences of potentials, so that
#: rounding is relative to each flow
Level: TypeAlias = tuple[Singles, Singles]


def flow_between(conductance: Singles, inlet: Floats, outlet: Floats, even: Floats) -> float:
    """Return the flow through cells from a potential of 1 to a potential of 0.

    Parameters
    ----------
    conductance : (3, nx, ny, nz) ndarray of float32
        Conductance between each cell and the next one along each axis, for the last one the first; 0 for no face.
    inlet, outlet : (ny, nz) ndarray of float
        Conductance between the cells of the first layer and what is at 1, and between those of the last layer and what
        is at 0. Each body of connected cells has one of them.
    even : (nx,) ndarray of float
        First guess of the potential of each layer.
    """
    ends = np.zeros(conductance.shape[1:], dtype=np.float32)
    ends[0] += inlet
    ends[-1] += outlet
    levels, residual, ahead = _levels(conductance, ends), np.zeros_like(ends), np.zeros_like(ends)
    start = _multiply(conductance, ends, np.broadcast_to(even[:, None, None], ends.shape), residual)
    dissipation = start + float((inlet * (1.0 - 2.0 * even[0])).sum())
    np.negative(residual, out=residual)
    residual[0] += inlet
    product = np.zeros_like(ends)
    drops, before = [np.inf] * DELAY, 1.0
    for step in range(MOST_STEPS):
        better = _cycle(levels, residual)
        now = _product_of(residual, better)
        if now <= 0.0 or sum(drops[-DELAY:]) <= ACCURACY * dissipation:
            break
        ahead *= now / before if step else 0.0
        ahead += better
        length = now / _multiply(conductance, ends, ahead, product)
        product *= length
        residual -= product
        drops.append(length * now)
        dissipation -= drops[-1]
        before = now
    return dissipation


def pair_sums(values: NDArray[Any], axes: tuple[int, ...], width: int = 2) -> NDArray[Any]:
    """Return sums over each two (or `width`) neighbours along axes; the last one may be alone."""
    for axis in axes if width > 1 else ():
        lines = np.moveaxis(values, axis, 0)
        total = lines[::width].copy()
        for k in range(1, width):
            more = lines[k::width]
            total[: len(more)] += more
        values = np.moveaxis(total, 0, axis)
    return values


def _levels(conductance: Singles, ends: Singles) -> list[Level]:
    """Return the lattice and all coarser ones."""
    found = []
    while True:
        found.append((conductance, ends))
        if max(ends.shape) <= COARSEST:
            return found
        coarser = []
        for axis in range(3):
            lines = np.moveaxis(conductance[axis], axis, 0)
            n = len(lines)
            # of an odd number of cells the last one is a pair, whose face leads to the first pair
            faces = np.moveaxis(np.concatenate([lines[1::2], lines[n - n % 2 :]]), 0, axis)
            faces = pair_sums(faces, tuple(other for other in range(3) if other != axis))
            # a pair is not its own neighbour
            coarser.append(faces / 2 if n > 2 else np.zeros_like(faces))
        conductance = np.stack(coarser, dtype=np.float32)
        ends = np.divide(pair_sums(ends, (0, 1, 2)), 2, dtype=np.float32)


def _cycle(levels: list[Level], residual: Singles) -> Singles:
    """Return what a cycle over the lattice and the coarser ones makes of a residual."""
    (conductance, ends), coarser = levels[0], levels[1:]
    found = np.zeros_like(residual)
    if not coarser:
        for _ in range(SWEEPS):
            _sweep(conductance, ends, residual, found, False)
            _sweep(conductance, ends, residual, found, True)
        return found
    _sweep(conductance, ends, residual, found, False)
    rest = np.zeros_like(coarser[0][1])
    _restrict(conductance, ends, residual, found, rest)
    _prolong(_cycle(coarser, rest), found, conductance, ends)
    _sweep(conductance, ends, residual, found, True)
    return found


@inlined_kernel
def _faces(conductance, i, j, k):  # type: ignore[no-untyped-def]
    """Return the cells before and behind a cell along each axis, and the conductances to them."""
    nx, ny, nz = conductance.shape[1:]
    a, b = i - 1 if i > 0 else nx - 1, i + 1 if i + 1 < nx else 0
    c, d = j - 1 if j > 0 else ny - 1, j + 1 if j + 1 < ny else 0
    e, f = k - 1 if k > 0 else nz - 1, k + 1 if k + 1 < nz else 0
    x, y, z = conductance[0], conductance[1], conductance[2]
    return (a, b, c, d, e, f), (x[a, j, k], x[i, j, k], y[i, c, k], y[i, j, k], z[i, j, e], z[i, j, k])


@inlined_kernel
def _sum_of(ends, at, i, j, k):  # type: ignore[no-untyped-def]
    """Return the sum of the conductances of a cell; 0 where nothing flows."""
    return at[0] + at[1] + at[2] + at[3] + at[4] + at[5] + ends[i, j, k]


@inlined_kernel
def _inflow(near, at, u, i, j, k):  # type: ignore[no-untyped-def]
    """Return the flow into a cell from its neighbours."""
    here = u[i, j, k]
    along_x = at[0] * (u[near[0], j, k] - here) + at[1] * (u[near[1], j, k] - here)
    along_y = at[2] * (u[i, near[2], k] - here) + at[3] * (u[i, near[3], k] - here)
    return along_x + along_y + at[4] * (u[i, j, near[4]] - here) + at[5] * (u[i, j, near[5]] - here)


@bare_kernel
def _multiply(conductance, ends, u, out):  # type: ignore[no-untyped-def]
    """Write the net flow out of each cell, and return its product with the potential."""
    total = 0.0
    for i in range(u.shape[0]):
        for j in range(u.shape[1]):
            for k in range(u.shape[2]):
                near, at = _faces(conductance, i, j, k)
                if _sum_of(ends, at, i, j, k) > 0.0:
                    flow = ends[i, j, k] * u[i, j, k] - _inflow(near, at, u, i, j, k)
                    out[i, j, k] = flow
                    total += np.float64(flow) * u[i, j, k]
    return total


@bare_kernel
def _product_of(a, b):  # type: ignore[no-untyped-def]
    """Return the scalar product of two fields."""
    total = 0.0
    for i in range(a.shape[0]):
        for j in range(a.shape[1]):
            for k in range(a.shape[2]):
                total += np.float64(a[i, j, k]) * b[i, j, k]
    return total


@bare_kernel
def _sweep(conductance, ends, residual, u, back):  # type: ignore[no-untyped-def]
    """Balance one cell after the other, from the first to the last or back."""
    nx, ny, nz = u.shape
    for along in range(nx):
        i = nx - 1 - along if back else along
        for beside in range(ny):
            j = ny - 1 - beside if back else beside
            for above in range(nz):
                k = nz - 1 - above if back else above
                near, at = _faces(conductance, i, j, k)
                total = _sum_of(ends, at, i, j, k)
                if total > 0.0:
                    left = residual[i, j, k] - ends[i, j, k] * u[i, j, k] + _inflow(near, at, u, i, j, k)
                    u[i, j, k] += left / total


@bare_kernel
def _restrict(conductance, ends, residual, u, out):  # type: ignore[no-untyped-def]
    """Add what is left of the residual over pairs of cells."""
    for i in range(u.shape[0]):
        for j in range(u.shape[1]):
            for k in range(u.shape[2]):
                near, at = _faces(conductance, i, j, k)
                if _sum_of(ends, at, i, j, k) > 0.0:
                    left = residual[i, j, k] - ends[i, j, k] * u[i, j, k] + _inflow(near, at, u, i, j, k)
                    out[i // 2, j // 2, k // 2] += left


@bare_kernel
def _prolong(coarse, u, conductance, ends):  # type: ignore[no-untyped-def]
    """Add to each cell what is found for its pair."""
    for i in range(u.shape[0]):
        for j in range(u.shape[1]):
            for k in range(u.shape[2]):
                if _sum_of(ends, _faces(conductance, i, j, k)[1], i, j, k) > 0.0:
                    u[i, j, k] += coarse[i // 2, j // 2, k // 2]
