"""Forces at contacts without friction, by an interior point: a quasi-static step, or the question whether grains rest.

Without friction a step is a quadratic program: of all accelerations a with ``a_n + gap / dt^2 + skin f >= 0`` at the
contacts those nearest to gravity, weighted by mass and moment of inertia; the forces f are its multipliers. An
iteration solves linear equations of the matrix ``1 + J^T diag(w) J``, where J holds the normals and the moments of their arms.

References
----------
Mehrotra 1992, On the implementation of a primal-dual interior point method, doi:10.1137/0802028
"""

from typing import Any

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.lazy import load
from voxgran._base.stopping import stop_if_asked
from voxgran.settling.contact_rows import ARM_I, ARM_J, NORMAL

#: most factorizations
ITERATIONS = 80
#: part of the way to the nearest bound that a step goes
SHORT_OF_BOUND = 0.99


def frictionless_forces(
    row: Floats, i: Integers, j: Integers, m: int, bodies: Floats, gravity: Floats, *, openness: Floats, skin: float,
    accuracy: float, start: Floats | None = None,
) -> tuple[Floats, Floats, int]:  # fmt: skip
    """Return normal forces (m,), accelerations (n + 1, 6) and the number of factorizations.

    openness: (m,) gaps divided by the square of the length of the step.  skin: acceleration by which a contact may
    approach for a unit of its force.  accuracy: to which all conditions hold at the end, in units of gravity.  start:
    (m,) forces of an earlier step.
    """
    jacobian, freedoms, weight = _program(row[:m], i[:m], j[:m], bodies, gravity)
    first = np.ones(m) if start is None else np.maximum(start, 1.0)
    x, force, made = _solved(jacobian, weight, openness, skin, first, accuracy)
    accelerations = np.zeros((len(bodies), 6))
    accelerations[:-1, :3] = np.where(bodies[:-1, 6:7] > 0.0, gravity, 0.0)
    accelerations[:, freedoms] = x.reshape(len(bodies), -1) * np.sqrt(_inverse_masses(bodies)[:, freedoms])
    return force, accelerations, made


def _inverse_masses(bodies: Floats) -> Floats:
    """Return the inverse masses and moments of inertia of all six freedoms, (n + 1, 6)."""
    return np.repeat(bodies[:, 6:8], 3, axis=1)


def _program(row: Floats, i: Integers, j: Integers, bodies: Floats, gravity: Floats) -> tuple[Any, Integers, Floats]:
    """Return the Jacobian of the gaps (m, (n + 1) d) as a sparse matrix, the d freedoms that occur, and the weight.

    All are scaled by the square roots of mass and moment of inertia.
    """
    normal, m, lid = row[:, NORMAL : NORMAL + 3], len(row), len(bodies) - 1
    root = np.sqrt(_inverse_masses(bodies))
    one = -np.hstack([normal, np.cross(row[:, ARM_I : ARM_I + 3], normal)]) * root[i]
    other = np.hstack([normal, np.cross(row[:, ARM_J : ARM_J + 3], normal)]) * root[j]
    at_lid = j == lid
    other[at_lid] = np.hstack([np.outer(normal[at_lid] @ gravity, gravity), np.zeros((int(at_lid.sum()), 3))])
    other[at_lid] *= root[lid]
    other[j < 0] = 0.0
    pull = np.hstack([np.tile(gravity, (lid + 1, 1)), np.zeros((lid + 1, 3))]) / np.where(root > 0.0, root, np.inf)
    # arms of spheres have no moments, and nothing leaves a plane
    used = [np.abs(part).max(axis=0, initial=0.0) for part in (one, other)]
    freedoms = np.flatnonzero((np.maximum(*used) > 1e-9) | (np.arange(6) == np.argmax(np.abs(gravity))))
    d = len(freedoms)
    column = np.stack([i, np.where(j < 0, 0, j)], axis=1)[:, :, None] * d + np.arange(d)
    values = np.stack([one[:, freedoms], other[:, freedoms]], axis=1)
    sparse = load("scipy.sparse")
    jacobian = sparse.csr_array((values.ravel(), column.ravel(), np.arange(m + 1) * 2 * d), shape=(m, (lid + 1) * d))
    return jacobian, freedoms, pull[:, freedoms].ravel()


def _solved(
    jacobian: Any, weight: Floats, openness: Floats, skin: float, first: Floats, accuracy: float
) -> tuple[Floats, Floats, int]:
    """Return the scaled accelerations, the forces, and the number of factorizations."""
    force, transposed = first.copy(), jacobian.T.tocsr()
    x = weight + transposed @ force
    slack = np.maximum(jacobian @ x + openness + skin * force, 1.0)
    made = 0
    while made < ITERATIONS:
        stop_if_asked()
        rest = x - weight - transposed @ force
        short = jacobian @ x + openness + skin * force - slack
        product = float(slack @ force) / max(len(force), 1)
        worst = max(float(np.abs(one).max(initial=0.0)) for one in (rest, short))
        if product < accuracy**2 and worst < accuracy:
            break
        width = slack + skin * force
        solve = _factorized(jacobian, transposed, force / width)

        def direction(target: Floats) -> tuple[Floats, Floats, Floats]:
            """Return the changes of x, slack and force towards a product of the last two."""
            pull = -(target + force * short) / width  # noqa: B023
            dx = solve(transposed @ pull - rest)  # noqa: B023
            change = jacobian @ dx
            df = pull - force * change / width  # noqa: B023
            return dx, change + skin * df + short, df  # noqa: B023

        _, ds, df = direction(slack * force)
        ahead = float((slack + _part(slack, ds) * ds) @ (force + _part(force, df) * df)) / len(force)
        dx, ds, df = direction(slack * force + ds * df - (ahead / product) ** 3 * product)
        part = min(1.0, SHORT_OF_BOUND * min(_part(slack, ds), _part(force, df)))
        made += 1
        x, slack, force = x + part * dx, slack + part * ds, force + part * df
    return x, force, made


def _factorized(jacobian: Any, transposed: Any, width: Floats) -> Any:
    """Return the function that solves equations of 1 + J^T diag(w) J."""
    sparse, linalg = load("scipy.sparse"), load("scipy.sparse.linalg")
    matrix = (transposed @ sparse.diags_array(width) @ jacobian + sparse.eye_array(jacobian.shape[1])).tocsc()
    return linalg.splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}).solve


def _part(values: Floats, change: Floats) -> float:
    """Return the part of a change, at most 1, up to which no value falls below 0."""
    falls = change < 0.0
    return min(1.0, float((-values[falls] / change[falls]).min())) if falls.any() else 1.0
