"""A container that deforms under the forces at its contacts, in kernels.

Its strain is one more body of the quasi-static problem (:mod:`voxgran.settling.balance`), which all contacts share.
"""

from typing import NamedTuple

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel, inlined_kernel
from voxgran.geometry.vectors import Vector, along, dot, sub, vector_at


class Cell(NamedTuple):
    """How a container deforms under the forces at its contacts, and what presses it.

    Its strains (xx, yy, zz, 2 yz, 2 xz, 2 xy) take the place of the accelerations of the lid. They move the second body
    of a contact, or the wall, relative to the first one by the strain of the vector between both, and are the product
    of the mobility with what the forces do on them (their virial) beyond the load.

    mobility: (6, 6) strains under unit loads; (0, 6) where the container is rigid.  load: (6,) stress times volume.
    """

    mobility: Floats
    load: Floats


#: a container that does not deform
RIGID = Cell(np.zeros((0, 6)), np.zeros(6))


@inlined_kernel
def branch_of(c: Floats) -> Vector:
    """Return the vector from body i of a contact to body j, or to the wall."""
    return along(sub(vector_at(c, 3), vector_at(c, 6)), c[9], vector_at(c, 0))


@inlined_kernel
def strained(strain: Floats, branch: Vector) -> Vector:
    """Return by how much a strain changes a branch."""
    x, y, z = branch
    return (
        strain[0] * x + 0.5 * (strain[5] * y + strain[4] * z),
        strain[1] * y + 0.5 * (strain[5] * x + strain[3] * z),
        strain[2] * z + 0.5 * (strain[4] * x + strain[3] * y),
    )


@inlined_kernel
def _virial(force, branch):  # type: ignore[no-untyped-def]
    """Return the six numbers of the symmetric product of a force and a branch."""
    (p, q, r), (x, y, z) = force, branch
    return p * x, q * y, r * z, 0.5 * (q * z + r * y), 0.5 * (p * z + r * x), 0.5 * (p * y + q * x)


@inlined_kernel
def add_to_cell(strain: Floats, mobility: Floats, force: Vector, branch: Vector) -> None:
    """Add to the strain of the container what the virial of a force does."""
    xx, yy, zz, yz, xz, xy = _virial(force, branch)
    if mobility[3, 3] == mobility[4, 4] == mobility[5, 5] == 0.0:
        # the axes stay at right angles
        for k in range(3):
            m = mobility[k]
            strain[k] += m[0] * xx + m[1] * yy + m[2] * zz
        return
    for k in range(6):
        m = mobility[k]
        strain[k] += m[0] * xx + m[1] * yy + m[2] * zz + m[3] * yz + m[4] * xz + m[5] * xy


@bare_kernel
def effective_cell(mobility: Floats, normal: Vector, branch: Vector) -> tuple[float, float]:
    """Return the inverse effective mass of a container along a normal at a branch, and a bound of those across it."""
    virial = _virial(normal, branch)
    along_it, most = 0.0, 0.0
    for a in range(6):
        row = 0.0
        for b in range(6):
            along_it += virial[a] * mobility[a, b] * virial[b]
            row += abs(mobility[a, b])
        most = max(most, row)
    return along_it, most * dot(branch, branch)
