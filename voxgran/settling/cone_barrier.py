"""Forces within friction cones that balance grains under a stress, by an interior point.

Half the sum of squared residuals, of all grains and of the stress, is minimised, which is a convex problem. Forces stay
within their cones by a logarithmic barrier, whose weight falls. Newton's equations are reduced to those of the
residuals, with six unknowns for each grain and one for each component of the stress. A force is
``a n + friction (b t + c s)`` with the normal n and two tangents, so that all cones are ``b^2 + c^2 <= a^2``.

References
----------
Nesterov & Nemirovskii 1994, doi:10.1137/1.9781611970791
"""

from typing import Any, NamedTuple

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Booleans, Floats
from voxgran._base.lazy import load
from voxgran._base.stopping import stop_if_asked
from voxgran.contacts.manifolds.rows import ARM_I, ARM_J, GAP, NORMAL
from voxgran.settling.balance import LoadedContacts
from voxgran.settling.interior_point import FrontalMatrix

#: places of the six numbers of a symmetric tensor
PLACES = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
#: weight of the barrier at first, and the factor by which it falls; steps at the most; weight from which on the search
#: ends where a step leaves more than this part of the sum of squared residuals
WEIGHT, FALLS, STEPS, LEAST_WEIGHT, GAINED = 1e-2, 0.2, 20, 1e-5, 0.98
#: part of the way to the nearest edge of a cone that a step goes; step from which on the weight falls
SHORT_OF_EDGE, LONG = 0.95, 0.5
#: least normal part of a force at the beginning, in mean ones, and largest tangential one in it
LEAST, INSIDE = 0.1, 0.9
#: signs of the squares in a cone, and the six vectors whose squares make up symmetric matrices
SIGNS = np.array([1.0, -1.0, -1.0])
PAIRS = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 1, 1], [1, 0, 1], [1, 1, 0]], dtype=np.float64)


class _Program(NamedTuple):
    """Residuals ``matrix @ parts - right``, of grains and then of the stress, and the matrix of those of the grains.

    columns: (m, 3, 3) forces of unit parts.  mean: force that is 1 here.
    """

    matrix: Any
    virial: Floats  # (k, 3 m) the last rows
    right: Floats
    grains: FrontalMatrix
    columns: Floats
    mean: float


def forces_in_cones(
    contacts: LoadedContacts, forces: Floats, *, friction: float | Floats, pressed: Floats, prescribed: Booleans,
    radius: Floats, height: Floats, tolerance: float,
) -> Floats:  # fmt: skip
    """Return forces (m, 3) within their cones that balance grains and the prescribed numbers of a virial best.

    Parameters
    ----------
    contacts : LoadedContacts
        Contacts of grains and walls.
    forces : (m, 3) ndarray of float
        First guess.
    friction : float or (m,) ndarray of float
        Coefficient of friction.
    pressed : (6,) ndarray of float
        Stress times volume: xx, yy, zz, yz, xz, xy.
    prescribed : (6,) ndarray of bool
        Which of these are.
    radius, height : (n,) ndarray of float
        Of the grains: lengths over which torques count, and the order in which equations are solved.
    tolerance : float
        Largest residual, in mean normal forces, with which the search ends.
    """
    program = _program(contacts, np.broadcast_to(friction, len(forces)), pressed, prescribed, (radius, height))
    parts, weight, m, before = _first_parts(program, forces), WEIGHT, len(forces), np.inf
    for _ in range(STEPS):
        stop_if_asked()
        inside = (SIGNS * parts**2).sum(axis=1)
        slope = -2.0 * SIGNS * parts / inside[:, None]
        # inverse of the second derivatives of the barrier
        bend = (parts[:, :, None] * parts[:, None, :] - 0.5 * inside[:, None, None] * np.diag(SIGNS)) / weight
        left = program.matrix @ parts.ravel() - program.right  # bits: sparse
        pull = (program.matrix.T @ left).reshape(m, 3) + weight * slope  # bits: sparse
        free = linear.einsum("mij,mj->mi", bend, pull)
        held = _solved(program, bend, program.matrix @ free.ravel())  # bits: sparse
        if held is None:
            break
        pull = (program.matrix.T @ held).reshape(m, 3)  # bits: sparse
        change = linear.einsum("mij,mj->mi", bend, pull) - free
        length = min(1.0, SHORT_OF_EDGE * _to_the_edge(parts, change))
        parts = parts + length * change
        left = program.matrix @ parts.ravel() - program.right  # bits: sparse
        size = float(linear.matmul(left, left))
        # where nothing balances all grains, what is left over hardly changes any more
        if np.abs(left).max() < tolerance or (weight < LEAST_WEIGHT and size > GAINED * before):
            break
        before = size
        if length > LONG:
            weight *= FALLS
    return np.asarray(linear.einsum("mi,mij->mj", parts, program.columns) * program.mean)


def _program(
    contacts: LoadedContacts, friction: Floats, pressed: Floats, prescribed: Booleans, grains: tuple[Floats, Floats]
) -> _Program:
    """Return the problem in numbers near 1: forces in mean ones, torques over the radii of grains."""
    (radius, height), row, m = grains, contacts.row, len(contacts.i)
    n, normal = len(radius), row[:, NORMAL : NORMAL + 3]
    # a tangent, across the axis that is farthest from the normal
    tangent = np.cross(normal, np.eye(3)[np.abs(normal).argmin(axis=1)])
    tangent /= linear.norm(tangent, axis=1)[:, None]
    columns = np.stack([normal, friction[:, None] * tangent, friction[:, None] * np.cross(normal, tangent)], axis=1)
    partner = np.where(contacts.j < n, contacts.j, -1)
    both = np.stack([contacts.i, np.maximum(partner, 0)], axis=1)
    turns = [np.cross(row[:, None, arm : arm + 3], columns) for arm in (ARM_I, ARM_J)]
    sides = [
        sign * np.concatenate([columns, turn / radius[at, None, None]], axis=2)
        for sign, turn, at in zip((-1.0, 1.0), turns, both.T, strict=True)
    ]
    blocks = np.stack(sides, axis=2)  # (m, part, body, freedom)
    blocks[partner < 0, :, 1] = 0.0
    # fixed grains need no balance
    blocks *= (contacts.bodies[both, 6] > 0.0)[:, None, :, None]
    branch = row[:, ARM_I : ARM_I + 3] - row[:, ARM_J : ARM_J + 3] + row[:, GAP, None] * normal
    mean = float(pressed[:3].sum()) / max(float(np.abs((branch * normal).sum(axis=1)).sum()), 1e-300)
    # the virial is a sum over all contacts
    virial = np.array(
        [(columns[:, :, a] * branch[:, None, b] + columns[:, :, b] * branch[:, None, a]).ravel() for a, b in PLACES]
    )[prescribed] / (2.0 * np.sqrt(m))  # fmt: skip
    places = np.broadcast_to((6 * both[:, None, :, None] + np.arange(6)), blocks.shape)
    unknown = np.broadcast_to(np.arange(3 * m).reshape(m, 3, 1, 1), blocks.shape)
    sparse = load("scipy.sparse")
    balance = sparse.csr_array((blocks.ravel(), (places.ravel(), unknown.ravel())), shape=(6 * n, 3 * m))
    right = np.concatenate([np.zeros(6 * n), pressed[prescribed] / (mean * np.sqrt(m))])
    values = linear.einsum("vp,mpbf->mvbf", PAIRS, blocks).reshape(6 * m, 2, 6)
    fronts = FrontalMatrix(np.repeat(contacts.i, 6), np.repeat(partner, 6), values, np.argsort(height, kind="stable"))
    return _Program(sparse.vstack([balance, sparse.csr_array(virial)]).tocsr(), virial, right, fronts, columns, mean)


def _first_parts(program: _Program, forces: Floats) -> Floats:
    """Return the parts (m, 3) of forces, moved into their cones."""
    size = (program.columns**2).sum(axis=2)
    parts = linear.einsum("mij,mj->mi", program.columns, forces) / np.where(size > 0.0, size, 1.0) / program.mean
    parts[:, 0] = np.maximum(parts[:, 0], LEAST)
    across = linear.norm(parts[:, 1:], axis=1)
    parts[:, 1:] *= np.minimum(1.0, INSIDE * parts[:, 0] / np.maximum(across, 1e-300))[:, None]
    return np.asarray(parts)


def _solved(program: _Program, bend: Floats, right: Floats) -> Floats | None:
    """Return the solution of ``(1 + matrix bend matrix^T) x = right``; None where rounding makes the matrix indefinite.

    The components of the stress are eliminated last.
    """
    mixed = bend[:, [1, 0, 0], [2, 2, 1]]
    pure = bend[:, [0, 1, 2], [0, 1, 2]] - mixed.sum(axis=1)[:, None] + mixed
    k, n = len(program.virial), len(right) - len(program.virial)
    moved = linear.einsum("kmi,mij->kmj", program.virial.reshape(k, -1, 3), bend).reshape(k, -1)
    coupled = program.matrix[:n] @ moved.T  # bits: sparse
    if not program.grains.factorize(np.hstack([pure, mixed]).ravel()):
        return None
    x = program.grains.solve(right[:n])
    by_stress = np.array([program.grains.solve(column) for column in coupled.T])
    rest = np.eye(k) + linear.matmul(moved, program.virial.T) - linear.matmul(by_stress, coupled)
    stress = linear.solve(rest, right[n:] - linear.matmul(coupled.T, x))
    return np.concatenate([x - linear.matmul(stress, by_stress), stress])


def _to_the_edge(parts: Floats, change: Floats) -> float:
    """Return how often the changes can be made until a force is at the edge of its cone."""
    square, both = (SIGNS * change**2).sum(axis=1), (SIGNS * parts * change).sum(axis=1)
    inside = (SIGNS * parts**2).sum(axis=1)
    root = np.sqrt(np.maximum(both**2 - square * inside, 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        ways = np.stack([(-both - root) / square, (-both + root) / square, -parts[:, 0] / change[:, 0]])
    return float(np.where(ways > 0.0, ways, np.inf).min(initial=np.inf))
