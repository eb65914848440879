"""The kernel of contact dynamics against a plain NumPy twin."""

import numpy as np
import pytest
from kit import lattice

import voxgran as vg
from voxgran._base.compiling.threads import using_threads
from voxgran.contacts.assembly import Assembly
from voxgran.contacts.manifolds.rounds import rounds_of
from voxgran.geometry import morton
from voxgran.settling.bed import Bed
from voxgran.settling.impulses import FASTEST, GAIN, LEFT, LOSS, OPENING, SLOW, Fall, advance_bodies

DOWN = np.array([0.0, 0.0, -1.0])


def heap():
    """Return a few spheres of two sizes that touch, overlap slightly or approach each other, with their contacts."""
    generator = np.random.Generator(np.random.Philox(11))
    position = lattice(2, 2, 2) * 0.99 + [0.5, 0.5, 0.0]
    position += 0.02 * generator.normal(size=position.shape)
    scale = np.where(np.arange(8) % 3 == 0, 1.05, 0.98)
    bed = Bed(Assembly.of([vg.make_shape("sphere")], vg.Box((3, 3, 4)), position=position, scale=scale), DOWN)
    bed.find(0.1, 5e-4)
    bed.bodies[:8, :6] = 0.2 * generator.normal(size=(8, 6))
    bed.rows.row[: bed.m, 10] = 0.02 * generator.random(bed.m)
    return bed


def twin(bed, dt, substeps, order, *, friction, restitution, most):
    """Return velocities, motions and impulses after a step, with a plain loop over contacts in an order."""
    m, n, h = bed.m, bed.count, dt / substeps
    row, i, j = bed.rows.row[:m], bed.rows.i[:m], bed.rows.j[:m]
    normal, arm_i, arm_j, gap_0 = row[:, :3], row[:, 3:6], row[:, 6:9], row[:, 9]
    push, drag = row[:, 10].copy(), row[:, 11:14].copy()
    speed, inverse, motion = bed.bodies[:n, :6].copy(), bed.bodies[:n, 6:8], np.zeros((n, 6))

    def of_point(values, k):
        """Return the relative value of the two bodies of a contact at its points."""
        found = -(values[i[k], :3] + np.cross(values[i[k], 3:], arm_i[k]))
        if j[k] >= 0:
            found = found + values[j[k], :3] + np.cross(values[j[k], 3:], arm_j[k])
        return found

    def apply(k, impulse):
        """Apply an impulse to j, and its opposite to i."""
        for body, arm, sign in ((i[k], arm_i[k], -1.0), (j[k], arm_j[k], 1.0)):
            if body >= 0:
                speed[body, :3] += sign * inverse[body, 0] * impulse
                speed[body, 3:] += sign * inverse[body, 1] * np.cross(arm, impulse)

    def masses(k):
        """Return the effective masses along the normal and across it."""
        along = across = 0.0
        for body, arm in ((i[k], arm_i[k]), (j[k], arm_j[k])):
            if body >= 0:
                along += inverse[body, 0] + inverse[body, 1] * (np.cross(arm, normal[k]) ** 2).sum()
                across += inverse[body, 0] + inverse[body, 1] * (arm**2).sum()
        return 1.0 / along, 1.0 / across

    def sweep(order, moving, approach):
        for k in order:
            velocity, gap = of_point(speed, k), gap_0[k] + normal[k] @ of_point(motion, k)
            along, (mass, across) = normal[k] @ velocity, masses(k)
            aim = along
            if gap > 0.0:
                aim = along + gap / h
            elif moving:
                aim = along + max(OPENING * min(gap + LEFT, 0.0) / h, -FASTEST)
            if not moving and restitution > 0.0 and approach[k] < 0.0 and (push[k] > 0.0 or aim < 0.0):
                aim = along + restitution * approach[k]
            soft = moving and gap <= 0.0
            new = push[k] - (GAIN if soft else 1.0) * aim * mass - (LOSS * push[k] if soft else 0.0)
            new = max(new, 0.0)
            rub = drag[k] - (velocity - along * normal[k]) * across
            rub -= (rub @ normal[k]) * normal[k]
            size = np.linalg.norm(rub)
            if size > friction[k] * new:
                rub *= friction[k] * new / size
            impulse = (new - push[k]) * normal[k] + rub - drag[k]
            push[k], drag[k] = new, rub
            apply(k, impulse)

    for _ in range(substeps):
        fast = np.linalg.norm(speed[:, :3], axis=1)
        speed[:, :3] *= np.minimum(1.0, most / np.maximum(fast, 1e-300))[:, None]
        speed[:, :3] += h * DOWN
        approach = np.array([normal[k] @ of_point(speed, k) for k in range(m)])
        approach[approach >= -SLOW] = 0.0
        for k in range(m):
            apply(k, push[k] * normal[k] + drag[k])
        sweep(order, True, approach)
        motion += h * speed
        sweep(reversed(order), False, approach)
    return speed, motion, push, drag


@pytest.mark.parametrize("least", [100, 2])
@pytest.mark.parametrize("friction", [(0.0,), (0.4,), (0.1, 0.9)])
@pytest.mark.parametrize("restitution", [0.0, 0.6])
def test_a_step_is_that_of_a_plain_twin(monkeypatch, friction, restitution, least):
    """With contacts in the order of their rows, or in rounds of those within four blocks of grains and between them."""
    bed = heap()
    assert bed.m > 12
    assert (bed.gap < 0).any()
    assert (bed.gap > 2e-3).any()
    monkeypatch.setattr(morton, "MANY", 1)
    monkeypatch.setattr(morton, "LEAST", least)
    order = list(rounds_of(bed.rows.i[: bed.m], bed.rows.j[: bed.m], 9).rows)
    assert (order == sorted(order)) == (least == 100)
    # one friction of all contacts, or one of each
    rub = np.array(friction) if len(friction) == 1 else np.linspace(*friction, bed.m)
    each = np.broadcast_to(rub, bed.m)
    speed, motion, push, drag = twin(bed, 0.05, 4, order, friction=each, restitution=restitution, most=0.5)
    fall = Fall(rub, restitution, step=0.05, substeps=4, most=0.025)
    approach = np.zeros(bed.m if restitution else 0)
    with using_threads(2):
        advance_bodies(bed.rows, bed.m, bed.bodies, bed.motion, bed.gravity, fall, 1.0, approach)
    row = bed.rows.row[: bed.m]
    np.testing.assert_allclose(bed.bodies[: bed.count, :6], speed, atol=1e-12)
    np.testing.assert_allclose(bed.motion[: bed.count], motion, atol=1e-13)
    np.testing.assert_allclose(row[:, 10], push, atol=1e-12)
    np.testing.assert_allclose(row[:, 11:14], drag, atol=1e-12)
    assert (push > 0).sum() > 2
