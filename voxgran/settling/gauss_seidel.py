"""Projected Gauss-Seidel solver of settling: motions nearest to a free fall that close no gap beyond its limit.

References
----------
Moreau 1988, Unilateral contact and dry friction in finite freedom dynamics, doi:10.1007/978-3-7091-2624-0_1.
"""

import math

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel


@bare_kernel
def project(
    one: Integers, other: Integers, normal: Floats, gap: Floats, arm_one: Floats, arm_other: Floats,
    inverse_mass: Floats, inverse_inertia: Floats, friction: float, translation: Floats, rotation: Floats,
    normal_impulse: Floats, tangential_impulse: Floats, order: Integers, weight: Floats, rest: Floats, first: int,
    last: int, close: float, flat: bool,
) -> bool:  # fmt: skip
    """Change translations and rotations until no gap closes beyond its limit; return whether they converged.

    Iterations `first` to `last` - 1 are made, of which number 0 initializes.

    normal_impulse, tangential_impulse: accumulated impulses, the latter of friction and no larger than `friction` times
    the former; both may be those of an earlier projection.  order: order of the contacts, reversed in every other
    iteration; along the fall, an impulse then propagates through the whole bed at once.  weight: inverse effective mass
    of each contact, kept from the first iteration on.  rest: three numbers to work with.  close: largest change at
    which the iteration ends.
    """
    grains = (translation, rotation, inverse_mass, inverse_inertia)
    for k in range(len(one) if first == 0 else 0):
        i, j = one[k], other[k]
        weight[k] = inverse_mass[i] + inverse_inertia[i] * _square_across(arm_one[k], normal[k], flat)
        if j >= 0:
            weight[k] += inverse_mass[j] + inverse_inertia[j] * _square_across(arm_other[k], normal[k], flat)
        for c in range(3):
            rest[c] = normal_impulse[k] * normal[k, c] + tangential_impulse[k, c]
        _apply_impulse(grains, i, j, arm_one[k], arm_other[k], rest, flat)
    many = len(one)
    for iteration in range(first, last):
        most = 0.0
        for place in range(many):
            k = order[place if iteration % 2 == 0 else many - 1 - place]
            i, j = one[k], other[k]
            n, tangential = normal[k], tangential_impulse[k]
            if weight[k] == 0.0:
                continue
            _write_velocity(grains, i, j, arm_one[k], arm_other[k], rest)
            closing = n[0] * rest[0] + n[1] * rest[1] + n[2] * rest[2]
            before = normal_impulse[k]
            normal_impulse[k] = max(before + (closing - gap[k]) / weight[k], 0.0)
            change = normal_impulse[k] - before
            most = max(most, abs(change) * weight[k])
            if change != 0.0:
                rest[0], rest[1], rest[2] = change * n[0], change * n[1], change * n[2]
                _apply_impulse(grains, i, j, arm_one[k], arm_other[k], rest, flat)
            rubs = normal_impulse[k] > 0.0 or tangential[0] != 0.0 or tangential[1] != 0.0 or tangential[2] != 0.0
            if friction > 0.0 and rubs:
                limit = friction * normal_impulse[k]
                most = max(most, _rub(grains, i, j, n, arm_one[k], arm_other[k], limit, tangential, rest, flat))
        if most < close:
            return True
    return False


@bare_kernel
def _square_across(arm, n, flat):  # type: ignore[no-untyped-def]
    """Return the square of an arm's moment about a normal."""
    ax, ay, az = arm[1] * n[2] - arm[2] * n[1], arm[2] * n[0] - arm[0] * n[2], arm[0] * n[1] - arm[1] * n[0]
    return az * az if flat else ax * ax + ay * ay + az * az


@bare_kernel
def _write_velocity(grains, i, j, arm, partner, rest):  # type: ignore[no-untyped-def]
    """Write the motion of the point of contact of one grain relative to the other; j below 0 is a wall."""
    translation, rotation, _, _ = grains
    for c in range(3):
        a, b = (c + 1) % 3, (c + 2) % 3
        rest[c] = translation[i, c] + rotation[i, a] * arm[b] - rotation[i, b] * arm[a]
        if j >= 0:
            rest[c] -= translation[j, c] + rotation[j, a] * partner[b] - rotation[j, b] * partner[a]


@bare_kernel
def _apply_impulse(grains, i, j, arm, partner, impulse, flat):  # type: ignore[no-untyped-def]
    """Change the motions of two grains by an impulse that separates them."""
    translation, rotation, inverse_mass, inverse_inertia = grains
    for c in range(3):
        a, b = (c + 1) % 3, (c + 2) % 3
        translation[i, c] -= inverse_mass[i] * impulse[c]
        if not flat or c == 2:
            rotation[i, c] -= inverse_inertia[i] * (arm[a] * impulse[b] - arm[b] * impulse[a])
        if j >= 0:
            translation[j, c] += inverse_mass[j] * impulse[c]
            if not flat or c == 2:
                rotation[j, c] += inverse_inertia[j] * (partner[a] * impulse[b] - partner[b] * impulse[a])


@bare_kernel
def _rub(grains, i, j, n, arm, partner, limit, tangential, rest, flat):  # type: ignore[no-untyped-def]
    """Apply friction at a contact, with an impulse up to a limit; return by how much it changed."""
    _, _, inverse_mass, inverse_inertia = grains
    weight = inverse_mass[i] + inverse_inertia[i] * (arm[0] ** 2 + arm[1] ** 2 + arm[2] ** 2)
    if j >= 0:
        weight += inverse_mass[j] + inverse_inertia[j] * (partner[0] ** 2 + partner[1] ** 2 + partner[2] ** 2)
    _write_velocity(grains, i, j, arm, partner, rest)
    closing = n[0] * rest[0] + n[1] * rest[1] + n[2] * rest[2]
    length = 0.0
    for c in range(3):
        rest[c] = tangential[c] + (rest[c] - closing * n[c]) / weight
        length += rest[c] * rest[c]
    length = math.sqrt(length)
    kept = min(1.0, limit / length) if length > 0.0 else 0.0
    most = 0.0
    for c in range(3):
        wanted = kept * rest[c]
        rest[c] = wanted - tangential[c]
        tangential[c] = wanted
        most = max(most, abs(rest[c]) * weight)
    _apply_impulse(grains, i, j, arm, partner, rest, flat)
    return most
