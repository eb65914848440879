"""What forces at contacts do to bodies, and to a container that deforms under them, in kernels.

The strain of a container is one more body of the quasi-static problem (:mod:`voxgran.settling.balance`), which all
contacts share.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel, inlined_kernel
from voxgran.geometry.vectors import Vector, along, cross, dot, row_of, sub, vector_at


class Cell(NamedTuple):
    """How a container deforms under the forces at its contacts, and what presses it.

    Its strains (xx, yy, zz, 2 yz, 2 xz, 2 xy) take the place of the accelerations of the lid. They move the second body
    of a contact, or the wall, relative to the first one by the strain of the vector between both, and are the product
    of the mobility with what the forces do on them (their virial) beyond the load.

    mobility: (6, 6) strains under unit loads; (0, 6) where the container is rigid.  load: (6,) stress times volume.
    """

    mobility: Floats
    load: Floats


#: columns of bodies, and of accelerations in the work: inverse mass and inverse moment of inertia, and, where rows go
#: on, the vector along the axis of a slender grain whose square is what the inverse moment about the axis has more
INVERSE_MASS, INVERSE_MOMENT, ROLL = 6, 7, 8
#: no force
NONE = (0.0, 0.0, 0.0)
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


@inlined_kernel
def _add(body, b, sign, arm, force):  # type: ignore[no-untyped-def]
    """Add to an acceleration what a force does at an arm of a body with the row b, or what the opposite one does."""
    turn = cross(arm, force)
    body[0], body[1], body[2] = along(vector_at(body, 0), sign * b[INVERSE_MASS], force)
    body[3], body[4], body[5] = along(vector_at(body, 3), sign * b[INVERSE_MOMENT], turn)
    if len(b) > ROLL:
        roll = vector_at(b, ROLL)
        body[3], body[4], body[5] = along(vector_at(body, 3), sign * dot(roll, turn), roll)


@inlined_kernel
def add_to_both(
    accelerations: Floats, bodies: Floats, gravity: Floats, c: Floats, one: int, other: int, force: Vector
) -> None:
    """Add to the accelerations of both bodies of a contact what a force does; a lid moves along gravity only."""
    last = len(bodies) - 1
    _add(accelerations[one], bodies[one], -1.0, vector_at(c, 3), force)
    if other == last:
        axis, lid = vector_at(gravity, 0), accelerations[last]
        lid[0], lid[1], lid[2] = along(vector_at(lid, 0), bodies[last, 6] * dot(force, axis), axis)
    elif other >= 0:
        _add(accelerations[other], bodies[other], 1.0, vector_at(c, 6), force)


@bare_kernel
def add_forces(contacts: Any, forces: Floats, accelerations: Floats) -> None:
    """Write the accelerations (n + 1, 6) of bodies under gravity and under forces (m, 3)."""
    bodies, gravity, last = contacts.bodies, contacts.gravity, len(contacts.bodies) - 1
    cell, deforms = contacts.cell, len(contacts.cell.mobility) > 0
    for k in range(last + 1):
        free = 1.0 if bodies[k, INVERSE_MASS] > 0.0 else 0.0
        for c in range(3):
            accelerations[k, c] = free * gravity[c]
            accelerations[k, 3 + c] = 0.0
    if deforms:
        for k in range(6):
            accelerations[last, k] = 0.0
            for c in range(6):
                accelerations[last, k] -= cell.mobility[k, c] * cell.load[c]
    for k in range(len(contacts.i)):
        force = row_of(forces, k)
        if force == NONE:
            continue
        c, one, other = contacts.row[k], contacts.i[k], contacts.j[k]
        add_to_both(accelerations, bodies, gravity, c, one, other, force)
        if deforms:
            add_to_cell(accelerations[last], cell.mobility, force, branch_of(c))


@bare_kernel
def effective_at(c: Floats, first: int, b: Floats, share: float) -> tuple[float, float]:
    """Return the inverse effective masses, along the normal and at most across it, that a body has at an arm.

    b: row of the body.  share: in how many parts its mass is split. Of more than one, they bound the whole matrix from
    above, whose two directions are coupled.
    """
    mass, moment = share * b[INVERSE_MASS], share * b[INVERSE_MOMENT]
    x, y, z = c[first], c[first + 1], c[first + 2]
    along = x * c[0] + y * c[1] + z * c[2]
    square = x * x + y * y + z * z
    across = max(square - along * along, 0.0)
    normal, most = across, square
    if share > 1.0:
        both = abs(along) * math.sqrt(across)
        normal, most = across + both, max(square, along * along + both)
    normal, most = mass + moment * normal, mass + moment * most
    if len(b) > ROLL:
        moved = cross(vector_at(b, ROLL), (x, y, z))
        all_of_it, along = share * dot(moved, moved), dot(moved, vector_at(c, 0))
        normal, most = normal + (all_of_it if share > 1.0 else along * along), most + all_of_it
    return normal, most


@inlined_kernel
def approach_of(c: Floats, accelerations: Floats, one: int, other: int) -> Vector:
    """Return the acceleration of a contact point of body j relative to that of body i."""
    a = accelerations[one]
    u0 = -(a[0] + a[4] * c[5] - a[5] * c[4])
    u1 = -(a[1] + a[5] * c[3] - a[3] * c[5])
    u2 = -(a[2] + a[3] * c[4] - a[4] * c[3])
    if other >= 0:
        b = accelerations[other]
        u0 += b[0] + b[4] * c[8] - b[5] * c[7]
        u1 += b[1] + b[5] * c[6] - b[3] * c[8]
        u2 += b[2] + b[3] * c[7] - b[4] * c[6]
    return u0, u1, u2
