"""Forces in friction cones that balance grains under a stress: python balance_clarabel.py GIVEN.npz MADE.npz.

The input has contacts: i, j (m,), j -1 at a wall, normal (m, 3) from i to j, arm_i, arm_j (m, 3) from the centroids to
the points of contact, branch (m, 3) and friction (one); n grains with a radius (n,); and the virial (3,) along the
axes, which is met to 1 %. The sum over the grains of what the largest component of net force, and of torque over the
radius, exceeds 0.01 mean normal forces by is made least by Clarabel. The output has this component for each grain.
It also has the limit of the virial (limit analysis): of what the virial is beyond its least component along all axes,
the largest part with which forces balance all grains to 0.01 mean normal forces; infinite of an isotropic virial, and
minus infinity where no forces balance the grains with any part. Prints the CPU seconds.
"""

import sys
import time

import clarabel
import numpy as np
from scipy import sparse

#: residuals in mean normal forces, and relative differences of the virial, that are allowed
ALLOWED = 0.01

given = np.load(sys.argv[1])
i, j, normal, branch, radius = (given[name] for name in ("i", "j", "normal", "branch", "radius"))
friction, virial = float(given["friction"]), given["virial"]
axes = range(len(virial))
began = time.process_time()
m, n = len(i), len(radius)
tangent = np.cross(normal, np.eye(3)[np.abs(normal).argmin(axis=1)])
tangent /= np.linalg.norm(tangent, axis=1)[:, None]
# unknowns: normal and two tangential forces of each contact, in mean forces, and the slack of each grain
basis = np.stack([normal, tangent, np.cross(normal, tangent)], axis=1)
mean = virial.sum() / np.abs((branch * normal).sum(axis=1)).sum()
rows, columns, values = [], [], []
for body, sign, arm in ((i, -1.0, given["arm_i"]), (j, 1.0, given["arm_j"])):
    real = np.flatnonzero(body >= 0)
    for part in range(3):
        force = sign * basis[real, part]
        torque = np.cross(arm[real], force) / radius[body[real], None]
        for k, value in enumerate(np.hstack([force, torque]).T):
            rows.append(6 * body[real] + k)
            columns.append(3 * real + part)
            values.append(value)
balance = sparse.csc_matrix(
    (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=(6 * n, 3 * m + n)
)
slack = sparse.csc_matrix((np.ones(6 * n), (np.arange(6 * n), 3 * m + np.repeat(np.arange(n), 6))), (6 * n, 3 * m + n))
stress = np.zeros((len(axes), 3 * m + n))
for axis in axes:
    stress[axis, : 3 * m] = (basis[:, :, axis] * branch[:, None, axis]).ravel()
if friction > 0.0:
    scale = np.tile([friction, 1.0, 1.0], m)
    cones = [clarabel.SecondOrderConeT(3)] * m
else:
    # without friction the tangential forces are 0
    scale, cones = np.tile([1.0, 1.0, 1.0], m), [clarabel.NonnegativeConeT(m), clarabel.ZeroConeT(2 * m)]
inside = sparse.hstack([sparse.diags(-scale), sparse.csc_matrix((3 * m, n))])
if friction == 0.0:
    order = np.argsort(np.tile([0, 1, 1], m), kind="stable")
    inside = sparse.csr_matrix(inside)[order]
axial = sparse.csc_matrix(np.vstack([stress, -stress]))
matrix = sparse.vstack([axial, balance - slack, -balance - slack, inside, -slack[::6]]).tocsc()
within = np.concatenate([(1 + ALLOWED) * virial, (ALLOWED - 1) * virial]) / mean
right = np.concatenate([within, np.full(12 * n, ALLOWED), np.zeros(3 * m + n)])
settings = clarabel.DefaultSettings()
settings.verbose = False
lower = clarabel.NonnegativeConeT(2 * len(axes) + 12 * n)


def solved(cost, matrix, right, cones):
    """Return the optimum of a program, or None where there is none."""
    square = sparse.csc_matrix((len(cost),) * 2)
    found = clarabel.DefaultSolver(square, cost, matrix.tocsc(), right, cones, settings).solve()
    return np.array(found.x) if str(found.status) in ("Solved", "AlmostSolved") else None


x = solved(np.repeat([0.0, 1.0], [3 * m, n]), matrix, right, [lower, *cones, clarabel.NonnegativeConeT(n)])
left = np.ones(n) if x is None else np.abs((balance @ x).reshape(n, 6)).max(axis=1)
part = virial - virial.min()
limit = np.inf
if part.any():
    more = np.concatenate([-part, part])[:, None] / mean
    free = sparse.vstack([sparse.csc_matrix(more), sparse.csc_matrix((12 * n + 3 * m, 1))])
    forces = sparse.hstack([matrix[: 2 * len(axes) + 12 * n + 3 * m, : 3 * m], free])
    within = np.concatenate([(1 + ALLOWED) * virial - part, (ALLOWED - 1) * virial + part]) / mean
    bounds = np.concatenate([within, right[2 * len(axes) : len(right) - n]])
    y = solved(np.append(np.zeros(3 * m), -1.0), forces, bounds, [lower, *cones])
    limit = -np.inf if y is None else y[-1]
np.savez(sys.argv[2], left=left, limit=limit)
sys.stdout.write(f"{time.process_time() - began}\n")
