"""The projection of settling: motions nearest to a fall that close no gap further than its limit.

References
----------
Moreau 1988, Unilateral contact and dry friction in finite freedom dynamics, doi:10.1007/978-3-7091-2624-0_1.
"""

import math

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel


@bare_kernel
def project(
    one: Integers,
    other: Integers,
    normal: Floats,
    gap: Floats,
    arm_one: Floats,
    arm_other: Floats,
    light: Floats,
    easy: Floats,
    friction: float,
    slide: Floats,
    spin: Floats,
    push: Floats,
    drag: Floats,
    order: Integers,
    weight: Floats,
    rest: Floats,
    first: int,
    last: int,
    close: float,
    flat: bool,
) -> bool:
    """Change slides and spins until no gap closes further than its limit: projected Gauss-Seidel over the contacts.

    Iterations `first` ... `last` - 1 are made, of which number 0 begins; return whether that was enough.

    light, easy: reciprocal masses and moments of inertia.  push: accumulated impulses along the normals.  drag: those
    of friction across them, no larger than `friction` times the push; both may be those of an earlier projection.
    order: whose turn it is, to and fro; along the fall, a push runs through the bed at once.  weight, rest: a number
    for each contact, kept from the beginning on, and three more to work with.
    """
    for k in range(len(one) if first == 0 else 0):
        weight[k] = light[one[k]] + easy[one[k]] * _square_across(arm_one[k], normal[k], flat)
        if other[k] >= 0:
            weight[k] += light[other[k]] + easy[other[k]] * _square_across(arm_other[k], normal[k], flat)
        for c in range(3):
            rest[c] = push[k] * normal[k, c] + drag[k, c]
        _press(slide, spin, one[k], other[k], arm_one[k], arm_other[k], light, easy, rest, flat)
    many = len(one)
    for turn in range(first, last):
        most = 0.0
        for place in range(many):
            k = order[place if turn % 2 == 0 else many - 1 - place]
            i, j = one[k], other[k]
            n = normal[k]
            if weight[k] == 0.0:
                continue
            _approach(slide, spin, i, j, arm_one[k], arm_other[k], rest)
            closing = n[0] * rest[0] + n[1] * rest[1] + n[2] * rest[2]
            before = push[k]
            push[k] = max(before + (closing - gap[k]) / weight[k], 0.0)
            change = push[k] - before
            most = max(most, abs(change) * weight[k])
            if change != 0.0:
                rest[0], rest[1], rest[2] = change * n[0], change * n[1], change * n[2]
                _press(slide, spin, i, j, arm_one[k], arm_other[k], light, easy, rest, flat)
            if friction > 0.0 and (push[k] > 0.0 or drag[k, 0] != 0.0 or drag[k, 1] != 0.0 or drag[k, 2] != 0.0):
                most = max(
                    most,
                    _drag(i, j, n, arm_one[k], arm_other[k], light, easy, friction * push[k], slide, spin, drag[k],
                          rest, flat),
                )  # fmt: skip
        if most < close:
            return True
    return False


@bare_kernel
def _square_across(arm, n, flat):  # type: ignore[no-untyped-def]
    """Return the square of an arm's moment about a normal."""
    ax, ay, az = arm[1] * n[2] - arm[2] * n[1], arm[2] * n[0] - arm[0] * n[2], arm[0] * n[1] - arm[1] * n[0]
    return az * az if flat else ax * ax + ay * ay + az * az


@bare_kernel
def _approach(slide, spin, i, j, arm, partner, rest):  # type: ignore[no-untyped-def]
    """Write how the place of contact of one grain moves as seen from the other; j below 0 is a wall."""
    for c in range(3):
        a, b = (c + 1) % 3, (c + 2) % 3
        rest[c] = slide[i, c] + spin[i, a] * arm[b] - spin[i, b] * arm[a]
        if j >= 0:
            rest[c] -= slide[j, c] + spin[j, a] * partner[b] - spin[j, b] * partner[a]


@bare_kernel
def _press(slide, spin, i, j, arm, partner, light, easy, impulse, flat):  # type: ignore[no-untyped-def]
    """Let an impulse push two grains apart."""
    for c in range(3):
        a, b = (c + 1) % 3, (c + 2) % 3
        slide[i, c] -= light[i] * impulse[c]
        if not flat or c == 2:
            spin[i, c] -= easy[i] * (arm[a] * impulse[b] - arm[b] * impulse[a])
        if j >= 0:
            slide[j, c] += light[j] * impulse[c]
            if not flat or c == 2:
                spin[j, c] += easy[j] * (partner[a] * impulse[b] - partner[b] * impulse[a])


@bare_kernel
def _drag(i, j, n, arm, partner, light, easy, limit, slide, spin, drag, rest, flat):  # type: ignore[no-untyped-def]
    """Let friction hold back the sliding at a contact, up to a limit; return how much it changed."""
    weight = light[i] + easy[i] * (arm[0] ** 2 + arm[1] ** 2 + arm[2] ** 2)
    if j >= 0:
        weight += light[j] + easy[j] * (partner[0] ** 2 + partner[1] ** 2 + partner[2] ** 2)
    _approach(slide, spin, i, j, arm, partner, rest)
    closing = n[0] * rest[0] + n[1] * rest[1] + n[2] * rest[2]
    length = 0.0
    for c in range(3):
        rest[c] = drag[c] + (rest[c] - closing * n[c]) / weight
        length += rest[c] * rest[c]
    length = math.sqrt(length)
    kept = min(1.0, limit / length) if length > 0.0 else 0.0
    most = 0.0
    for c in range(3):
        wanted = kept * rest[c]
        rest[c] = wanted - drag[c]
        drag[c] = wanted
        most = max(most, abs(rest[c]) * weight)
    _press(slide, spin, i, j, arm, partner, light, easy, rest, flat)
    return most
