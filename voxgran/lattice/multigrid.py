"""Steady flow through the cells of a lattice: conjugate gradients, preconditioned by multigrid.

On each coarser lattice two cells along each axis are one, and conductances are half the sums of those between pairs,
since the distance is twice as long (Braess 1995, doi:10.1007/BF02238488); one sweep of Gauss and Seidel on the way down
and one back on the way up make the cycle symmetric. Of all potentials the one sought makes the dissipation smallest,
and this smallest value is the flow: each step lowers it by a known amount, and the amounts of the last steps estimate
its error (Hestenes & Stiefel 1952, doi:10.6028/jres.049.044).
"""

from typing import TypeAlias

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel, inlined_kernel

#: relative error of the flow at which iterations end, steps whose sum estimates it, and steps at most
ACCURACY, DELAY, MOST_STEPS = 1e-5, 2, 1000
#: cells along the longest axis of the coarsest lattice, and pairs of sweeps there
COARSEST, SWEEPS = 2, 4

#: conductances (3, nx, ny, nz) to the next cell along each axis, the last to the first; sums (nx, ny, nz) by cell
Level: TypeAlias = tuple[Floats, Floats]


def flow_between(conductance: Floats, inlet: Floats, outlet: Floats, potential: Floats) -> float:
    """Return the flow through cells from a potential of 1 to a potential of 0.

    Parameters
    ----------
    conductance : (3, nx, ny, nz) ndarray of float
        Conductance between each cell and the next one along each axis, for the last one the first; 0 for no face.
    inlet, outlet : (nx, ny, nz) ndarray of float
        Conductance between each cell and what is at 1, and at 0.  Each body of connected cells has one of them.
    potential : (nx, ny, nz) ndarray of float
        First guess, which is overwritten by the solution; 0 where a cell has no conductance.
    """
    levels = _levels(conductance, inlet + outlet)
    product, ahead = np.zeros(potential.shape), np.zeros(potential.shape)
    _multiply(*levels[0], potential, product)
    dissipation = float(((product - 2 * inlet) * potential).sum() + inlet.sum())
    residual = inlet - product
    drops, before = [np.inf] * DELAY, 1.0
    for step in range(MOST_STEPS):
        better = _cycle(levels, residual)
        now = float((residual * better).sum())
        if now <= 0.0 or sum(drops[-DELAY:]) <= ACCURACY * dissipation:
            break
        ahead *= now / before if step else 0.0
        ahead += better
        length = now / _multiply(*levels[0], ahead, product)
        potential += length * ahead
        residual -= length * product
        drops.append(length * now)
        dissipation -= drops[-1]
        before = now
    return dissipation


def pair_sums(values: Floats, axes: tuple[int, ...], width: int = 2) -> Floats:
    """Return sums over each two (or `width`) neighbours along axes; the last one may be alone."""
    for axis in axes:
        lines = np.moveaxis(values, axis, 0)
        total = lines[::width].copy()
        for k in range(1, width):
            more = lines[k::width]
            total[: len(more)] += more
        values = np.moveaxis(total, 0, axis)
    return values


def _levels(conductance: Floats, ends: Floats) -> list[Level]:
    """Return the lattice and all coarser ones."""
    found = []
    while True:
        sums = ends.copy()
        for axis in range(3):
            sums += conductance[axis] + np.roll(conductance[axis], 1, axis=axis)
        found.append((conductance, sums))
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
            coarser.append(faces / 2 if n > 2 else np.zeros(faces.shape))
        conductance, ends = np.stack(coarser), pair_sums(ends, (0, 1, 2)) / 2


def _cycle(levels: list[Level], residual: Floats) -> Floats:
    """Return what a cycle over the lattice and the coarser ones makes of a residual."""
    (conductance, sums), coarser = levels[0], levels[1:]
    found = np.zeros(residual.shape)
    if not coarser:
        for _ in range(SWEEPS):
            _sweep(conductance, sums, residual, found, False)
            _sweep(conductance, sums, residual, found, True)
        return found
    _sweep(conductance, sums, residual, found, False)
    rest = np.zeros(coarser[0][1].shape)
    _restrict(conductance, sums, residual, found, rest)
    _prolong(sums, _cycle(coarser, rest), found)
    _sweep(conductance, sums, residual, found, True)
    return found


@inlined_kernel
def _around(conductance, u, i, j, k):  # type: ignore[no-untyped-def]
    """Return the sum over the faces of a cell of conductance times the potential beyond."""
    nx, ny, nz = u.shape
    a, b = i - 1 if i > 0 else nx - 1, i + 1 if i + 1 < nx else 0
    c, d = j - 1 if j > 0 else ny - 1, j + 1 if j + 1 < ny else 0
    e, f = k - 1 if k > 0 else nz - 1, k + 1 if k + 1 < nz else 0
    along_x = conductance[0, a, j, k] * u[a, j, k] + conductance[0, i, j, k] * u[b, j, k]
    along_y = conductance[1, i, c, k] * u[i, c, k] + conductance[1, i, j, k] * u[i, d, k]
    return along_x + along_y + conductance[2, i, j, e] * u[i, j, e] + conductance[2, i, j, k] * u[i, j, f]


@bare_kernel
def _multiply(conductance, sums, u, out):  # type: ignore[no-untyped-def]
    """Write the net flow out of each cell, and return its product with the potential."""
    total = 0.0
    for i in range(u.shape[0]):
        for j in range(u.shape[1]):
            for k in range(u.shape[2]):
                if sums[i, j, k] > 0.0:
                    out[i, j, k] = sums[i, j, k] * u[i, j, k] - _around(conductance, u, i, j, k)
                    total += out[i, j, k] * u[i, j, k]
    return total


@bare_kernel
def _sweep(conductance, sums, residual, u, back):  # type: ignore[no-untyped-def]
    """Balance one cell after the other, from the first to the last or back."""
    nx, ny, nz = u.shape
    for at in range(nx):
        i = nx - 1 - at if back else at
        for beside in range(ny):
            j = ny - 1 - beside if back else beside
            for above in range(nz):
                k = nz - 1 - above if back else above
                if sums[i, j, k] > 0.0:
                    u[i, j, k] = (residual[i, j, k] + _around(conductance, u, i, j, k)) / sums[i, j, k]


@bare_kernel
def _restrict(conductance, sums, residual, u, out):  # type: ignore[no-untyped-def]
    """Add what is left of the residual over pairs of cells."""
    for i in range(u.shape[0]):
        for j in range(u.shape[1]):
            for k in range(u.shape[2]):
                if sums[i, j, k] > 0.0:
                    left = residual[i, j, k] - sums[i, j, k] * u[i, j, k] + _around(conductance, u, i, j, k)
                    out[i // 2, j // 2, k // 2] += left


@bare_kernel
def _prolong(sums, coarse, u):  # type: ignore[no-untyped-def]
    """Add to each cell what is found for its pair."""
    for i in range(u.shape[0]):
        for j in range(u.shape[1]):
            for k in range(u.shape[2]):
                if sums[i, j, k] > 0.0:
                    u[i, j, k] += coarse[i // 2, j // 2, k // 2]
