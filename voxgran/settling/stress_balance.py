"""Proof of balance without gravity: forces at the contacts, within their cones, that balance grains under a stress.

As under gravity no motion is looked at (:mod:`voxgran.settling.equilibrium`). The mean stress is a further balance, of
the container, which does not strain where it is met. All forces may be multiplied by one factor, so that a packing
which bears a stress bears each multiple of it.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Booleans, Floats, float_array
from voxgran._base.errors import InputError, shown
from voxgran._base.lazy import load
from voxgran._base.stopping import stop_if_asked
from voxgran.contacts.forces import LID, WALL, ContactForces
from voxgran.contacts.manifolds.rows import ARM_I, ARM_J, GAP, NORMAL
from voxgran.settling.balance import gauss_seidel_forces, net_accelerations
from voxgran.settling.bed import Bed
from voxgran.settling.cell import Cell
from voxgran.settling.cone_barrier import PLACES, forces_in_cones
from voxgran.settling.materials import FrictionTable

#: iterations between two multiplications of all forces, and the range of their factor
SCALED_EVERY, LEAST_FACTOR, MOST_FACTOR = 10, 0.2, 5.0
#: of a round of a search: iterations, those between two multiplications of all forces, mobility of the container (that
#: of a grain over their number is 1), tolerance of the iterations, and compression of a contact by a unit force
ROUND, SCALED_IN_ROUND, MOBILITY, TOLERANCE, SOFTNESS = 100, 50, 0.3, 1e-7, 1e-9
#: relative difference of the stress with which a search ends
STRESS_MET = 1e-3
#: normal force, in mean ones, from which on a contact bears, and bearing contacts of a grain that is no rattler
BEARS, HELD = 1e-3, 2
#: most rounds of iterations, those before the interior point begins, and most grains for which it does: its time grows
#: with their number to the power of 7/3
ROUNDS, FIRST_ROUNDS, MOST_DIRECT = 100, 4, 1500
#: residual with which the interior point ends, in tolerances
ACCURACY = 0.1
#: range of the largest number of a stress
LEAST, MOST = 1e-60, 1e60
#: distance in median diameters within which the point of a contact is that of a known force
SAME = 1e-6
#: known contacts that are looked at beside a contact
NEIGHBOURS = 8


def pressed_forces(
    bed: Bed, mobility: Floats, load: Floats, *, openness: Floats, friction: float | FrictionTable,
    skin: float, iterations: int, tolerance: float, scaled_every: int = SCALED_EVERY,
) -> tuple[Floats, Floats]:  # fmt: skip
    """Return forces (m, 3) that balance grains and the load on their container, and the accelerations that are left.

    Those (n + 1, 6) of the last body are the strains of the container.

    mobility: (6, 6) strains under unit loads.  load: (6,) stress times volume.  openness, skin, tolerance: as in a
    quasi-static step.  scaled_every: iterations between two multiplications of all forces.
    """
    cell, stiffness = Cell(np.ascontiguousarray(mobility), load), linear.pseudoinverse(mobility)
    contacts, forces, made = bed.contacts._replace(cell=cell), bed.forces(), 0
    normal = bed.rows.row[: bed.m, NORMAL : NORMAL + 3]
    inverse, rub = np.repeat(bed.bodies[:-1, 6:8], 3, axis=1), bed.friction_at(friction)
    weight = np.divide(1.0, inverse, out=np.zeros_like(inverse), where=inverse > 0.0)
    pressed = linear.matmul(cell.mobility, load)
    accelerations = net_accelerations(contacts, forces)
    while made < iterations:
        virial = accelerations[-1] + pressed
        energy = float((accelerations[:-1] ** 2 * weight).sum()) + float(
            linear.matmul(linear.matmul(virial, stiffness), virial)
        )
        work = float(linear.matmul(linear.matmul(virial, stiffness), pressed)) - float(
            linear.matmul(openness, (forces * normal).sum(axis=1))
        )
        if energy > 0.0:
            forces *= min(max(work / energy, LEAST_FACTOR), MOST_FACTOR)
        accelerations, turns = gauss_seidel_forces(
            contacts, forces, openness, friction=rub, skin=skin, iterations=scaled_every, tolerance=tolerance
        )
        made += turns
        if turns < scaled_every:
            break
    return forces, accelerations


def evenly(modes: Floats, load: Floats) -> Floats:
    """Return modes (6, 6) in which equal shares of the load (6,) along each axis strain a container alike.

    Without them a small stress beside a large one is met slowly. Shear strains are those of the means of two axes.
    """
    share = load[:3] / np.abs(load).max()
    along = np.sqrt(np.divide(1.0, share, out=np.ones(3), where=share > 0.0))
    scale = np.array([math.sqrt(along[a] * along[b]) for a, b in PLACES])
    return np.asarray(modes * np.outer(scale, scale))


class Balanced(NamedTuple):
    """Forces at contacts, and by how much they fail to balance grains and stress.

    forces: (m, 3) on body j of each contact.  residual, residual_torque: (n,) net force on each grain, and net torque
    over its radius, in mean normal forces.  bearing: (n,) which grains bear forces.  stress: (3, 3) mean stress tensor.
    moving: number of grains that are not in balance over that of the grains that bear forces.  missed: largest
    difference of the stress, over the least one along an axis.
    """

    forces: Floats
    residual: Floats
    residual_torque: Floats
    bearing: Booleans
    stress: Floats
    moving: float
    missed: float

    def rank(self, tolerance: float) -> tuple[bool, float, float]:
        """Return what is the smaller, the better the balance is: the stress comes first."""
        return self.missed > tolerance, self.moving, self.missed


def balance_grains(
    bed: Bed,
    modes: Floats,
    load: Floats,
    *,
    friction: float | FrictionTable,
    tolerance: float,
    rounds: int,
    known: bool = False,
) -> Balanced:
    """Return the forces at the contacts of a bed that balance its grains under a load best, of so many rounds.

    The search begins with the forces that the bed keeps, and the bed keeps those that are found; `known` says that they
    are within the cones of its contacts, so that they may be the best ones. It ends where all grains that bear forces
    are in balance within a tolerance, and the load is met to 1e-3.
    """
    volume, yielding = bed.assembly.container.volume, evenly(modes, load) * (MOBILITY / max(bed.count, 1))
    best: Balanced | None = None
    for number in range(0 if known else 1, rounds + 1):
        stop_if_asked()
        before = bed.forces()
        forces, accelerations = pressed_forces(
            bed, yielding, load, openness=np.zeros(bed.m), friction=friction,
            skin=SOFTNESS, iterations=ROUND if number else 0, tolerance=TOLERANCE, scaled_every=SCALED_IN_ROUND,
        )  # fmt: skip
        bed.keep_forces(forces)
        force, torque, bearing = _residuals(bed, forces, accelerations)
        stress = stress_of(bed, forces)
        excess = linear.matmul(
            modes, np.array([(stress[a, b] + stress[b, a]) / 2.0 for a, b in PLACES]) * volume - load
        )
        axial = linear.matmul(modes, load)[:3]
        missed = float(np.abs(excess).max() / axial[axial > 0.0].min(initial=np.abs(load).max()))
        # a grain that one contact pushes bears nothing, and is not in balance
        unrest, many = int((np.maximum(force, torque) > tolerance).sum()), int(bearing.sum())
        moving = min(unrest / many, 1.0) if many else 1.0
        found = Balanced(forces, force, torque, bearing, stress, moving, missed)
        if best is None or found.rank(tolerance) < best.rank(tolerance):
            best = found
        same = number > 0 and np.allclose(forces, before, rtol=1e-9, atol=0.0)
        if same or (moving == 0.0 and missed <= STRESS_MET):
            break
    assert best is not None
    bed.keep_forces(best.forces)
    return best


def stress_of(bed: Bed, forces: Floats) -> Floats:
    """Return the mean stress tensor (3, 3) of Love and Weber of forces (m, 3), compression above 0."""
    row = bed.rows.row[: bed.m]
    branch = row[:, 3:6] - row[:, 6:9] + row[:, GAP, None] * row[:, NORMAL : NORMAL + 3]
    return np.asarray(linear.matmul(forces.T, branch) / bed.assembly.container.volume)


def shear_ratio(stress: Floats, dimension: int) -> float:
    """Return the largest shear stress of a tensor (3, 3) over the mean of the axial ones; 0 where these are 0."""
    tensor = stress[:dimension, :dimension]
    shear, mean = np.abs((tensor + tensor.T) / 2.0 - np.diag(tensor.diagonal())).max(), tensor.diagonal().mean()
    return float(shear / mean) if mean > 0.0 else 0.0


def _residuals(bed: Bed, forces: Floats, accelerations: Floats) -> tuple[Floats, Floats, Booleans]:
    """Return net force and torque of each grain (n,), in mean normal forces, and which grains bear forces (n,).

    Torques are over the radius of the sphere of equal volume. Of fixed grains all are 0, and none counts as bearing.
    """
    n, row = bed.count, bed.rows.row[: bed.m]
    push = (forces * row[:, NORMAL : NORMAL + 3]).sum(axis=1)
    mean = float(push[push > 0.0].mean()) if (push > 0.0).any() else 1.0
    bears = push > BEARS * mean
    i, j = bed.rows.i[: bed.m], bed.rows.j[: bed.m]
    other = bears & (j >= 0) & (j < n)
    many = np.bincount(i[bears], minlength=n) + np.bincount(j[other], minlength=n)
    force, moment = (
        np.divide(linear.norm(part, axis=1), inverse, out=np.zeros(n), where=inverse > 0.0)
        for part, inverse in ((accelerations[:n, :3], bed.bodies[:n, 6]), (accelerations[:n, 3:], bed.bodies[:n, 7]))
    )
    return force / mean, moment / (0.5 * bed.diameter) / mean, (many >= HELD) & bed.movable


def without_weight(bed: Bed) -> None:
    """Give the bodies of a bed the mobilities of grains that are compressed."""
    bodies, free = bed.bodies[: bed.count], bed.movable
    gyration = bodies[free, 6] / bodies[free, 7]
    bodies[free, 6] = libm.power(bed.diameter[free], 1 - bed.assembly.dimension)
    bodies[free, 7] = bodies[free, 6] / gyration


def as_stress(value: "ArrayLike", dimension: int) -> Floats:
    """Return the tensor (3, 3) of a stress: one number, one along each axis, or a tensor; NaN is not prescribed.

    Numbers along axes prescribe no shear, which a specimen has where its container does not tilt.

    Raises
    ------
    InputError
        If it has another shape, is not symmetric, prescribes nothing, or a principal stress is not above 0.
    """
    if isinstance(value, Sequence) and not isinstance(value, str | bytes):
        value = [math.nan if one is None else one for one in value]
    given = np.zeros(0) if isinstance(value, bool) else float_array(value)
    given = np.zeros(0) if given is None else given
    tensor = np.full((3, 3), math.nan)
    d = dimension
    if given.shape in ((), (d,)):
        axial = np.broadcast_to(given, d)
        # a stress along axes says nothing of shear
        tensor[range(d), range(d)] = axial
    elif given.shape in ((d, d), (3, 3)):
        tensor[:d, :d] = given[:d, :d]
    else:
        raise InputError(
            f"stress is {shown(value)}: it must be one number, {d} numbers along the axes, or a symmetric tensor; "
            "correct it"
        )
    known = np.isfinite(tensor)
    filled = np.where(known, tensor, 0.0)
    axes = np.flatnonzero(known[range(3), range(3)])
    largest = float(np.abs(filled).max())
    if np.isinf(given).any() or (largest > 0.0 and not LEAST < largest < MOST):
        raise InputError(f"stress is {shown(value)}: its numbers must be between {LEAST:g} and {MOST:g}; correct it")
    if not len(axes) or np.abs(filled - filled.T).max() > 1e-3 * np.abs(filled).max():
        raise InputError(f"stress is {shown(value)}: it must prescribe a symmetric tensor; correct it")
    least = float(linear.eigh((filled + filled.T)[np.ix_(axes, axes)])[0].min()) / 2.0
    if least <= 0.0:
        raise InputError(
            f"stress is {shown(value)}: its least principal stress is {least:.3g}, and grains that touch bear no "
            "tension; give stresses above 0"
        )
    return np.asarray((tensor + tensor.T) / 2.0)


def balance_stress(
    bed: Bed,
    stress: Floats,
    friction: float | FrictionTable,
    *,
    reach: float,
    tolerance: float,
    start: ContactForces | None = None,
) -> Balanced:
    """Return the forces at the contacts of a bed without gravity within reach that balance its grains under a stress.

    stress: (3, 3) tensor, NaN where it is not prescribed.  start: forces with which the search begins, of which the
    lengths are in median diameters.
    """
    without_weight(bed)
    bed.find(reach, 0.0)
    asked = np.array([stress[place] for place in PLACES])
    prescribed = np.isfinite(asked)
    unit = float(np.abs(asked[prescribed]).max())
    if start is not None:
        keep_known_forces(bed, start, friction, unit)
    pressed = np.where(prescribed, asked / unit, 0.0) * bed.assembly.container.volume
    modes, direct = np.diag(prescribed.astype(np.float64)), bed.count <= MOST_DIRECT

    def best(rounds: int, *, known: bool) -> Balanced:
        return balance_grains(bed, modes, pressed, friction=friction, tolerance=tolerance, rounds=rounds, known=known)

    found = best(FIRST_ROUNDS if direct else ROUNDS, known=start is not None)
    if direct and found.bearing.any() and (found.moving > 0.0 or found.missed > STRESS_MET):
        forces = forces_in_cones(
            bed.contacts, found.forces, friction=bed.friction_at(friction), pressed=pressed, prescribed=prescribed,
            radius=0.5 * bed.diameter, height=bed.grains.position[:, 2 - int(bed.assembly.dimension == 2)],
            tolerance=ACCURACY * tolerance,
        )  # fmt: skip
        bed.keep_forces(forces)
        found = min(found, best(0, known=True), key=lambda one: one.rank(tolerance))
    return found._replace(forces=found.forces * unit, stress=found.stress * unit)


def keep_known_forces(bed: Bed, known: ContactForces, friction: float | FrictionTable, unit: float) -> None:
    """Let a bed keep known forces at its contacts, in a unit, as far as they lie within the cones of its friction."""
    normal = bed.rows.row[: bed.m, NORMAL : NORMAL + 3]
    forces = _forces_at(bed, known) / unit
    push = (forces * normal).sum(axis=1)
    across = forces - push[:, None] * normal
    push = np.maximum(push, 0.0)
    slides = linear.norm(across, axis=1)
    part = np.minimum(1.0, bed.friction_at(friction) * push / np.maximum(slides, 1e-300))
    bed.keep_forces(push[:, None] * normal + part[:, None] * across)


def _forces_at(bed: Bed, known: ContactForces) -> Floats:
    """Return the known forces at the contacts of a bed, (m, 3); 0 where none is known of the same bodies at a point.

    Each known force is that of one contact: of several that are as near, as where thin grains touch, the nearest one.
    """
    row, found = bed.rows.row[: bed.m], np.zeros((bed.m, 3))
    i, j = bed.contact_grains(wall=WALL, lid=LID)
    if not known.count or not bed.m:
        return found
    # of contacts at one place those of the same direction are the nearest
    tree = load("scipy.spatial").cKDTree(np.column_stack([known.point, SAME * known.normal]))
    rows: list[Floats] = []
    for sign, first, second in ((1.0, known.i, known.j), (-1.0, known.j, known.i)):
        # a contact may be listed from its other side, and so near another periodic image
        grain, arm = (i, ARM_I) if sign > 0.0 else (np.maximum(j, 0), ARM_J)
        at = bed.assembly.position[grain] + row[:, arm : arm + 3]
        key = np.column_stack([at, sign * SAME * row[:, NORMAL : NORMAL + 3]])
        distance, near = tree.query(key, min(NEIGHBOURS, known.count), distance_upper_bound=SAME)
        distance, near = distance.reshape(bed.m, -1), near.reshape(bed.m, -1)
        at_hand = np.isfinite(distance)
        near = np.where(at_hand, near, 0)
        own, rank = np.nonzero(at_hand & (first[near] == i[:, None]) & (second[near] == j[:, None]))
        rows.append(np.column_stack([distance[own, rank], own, near[own, rank], np.full(len(own), sign)]))
    pairs, taken, used = np.concatenate(rows), np.zeros(bed.m, np.bool_), np.zeros(known.count, np.bool_)
    for _, own, one, sign in pairs[np.argsort(pairs[:, 0], kind="stable")].tolist():
        if not taken[int(own)] and not used[int(one)]:
            taken[int(own)] = used[int(one)] = True
            found[int(own)] = sign * known.force[int(one)]
    return found
