"""Forces in friction cones that balance grains under a stress: python balance_clarabel.py GIVEN.npz MADE.npz.

The input has contacts: i, j (m,), j -1 at a wall, normal (m, 3) from i to j, arm_i, arm_j (m, 3) from the centroids to
the points of contact, branch (m, 3) and friction (one); n grains with a radius (n,); and the virial (3,) along the
axes. The sum over the grains of the largest component of net force, and of torque over the radius, is made least by
Clarabel. The output has this for each grain, in mean normal forces. Prints the CPU seconds.
"""

import sys
import time

import clarabel
import numpy as np
from scipy import sparse

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
matrix = sparse.vstack([sparse.csc_matrix(stress), balance - slack, -balance - slack, inside]).tocsc()
right = np.concatenate([virial / mean, np.zeros(12 * n + 3 * m)])
settings = clarabel.DefaultSettings()
settings.verbose = False
cost = np.concatenate([np.zeros(3 * m), np.ones(n)])
cones = [clarabel.ZeroConeT(len(axes)), clarabel.NonnegativeConeT(12 * n), *cones]
found = clarabel.DefaultSolver(sparse.csc_matrix((3 * m + n,) * 2), cost, matrix, right, cones, settings).solve()
solved = str(found.status) in ("Solved", "AlmostSolved")
x = np.array(found.x)
left = np.abs((balance @ x).reshape(n, 6)).max(axis=1) if solved else np.ones(n)
np.savez(sys.argv[2], left=left)
sys.stdout.write(f"{time.process_time() - began}\n")
