"""Proof of balance without gravity: forces at the contacts, within their cones, that balance grains under a stress.

As under gravity no motion is looked at (:mod:`voxgran.settling.equilibrium`). The mean stress is a further balance, of
the container, which does not strain where it is met. All forces may be multiplied by one factor, so that a packing
which bears a stress bears each multiple of it.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arrays import Floats, float_array
from voxgran._base.errors import InputError, shown
from voxgran._base.lazy import load
from voxgran.contacts.forces import LID, WALL, ContactForces
from voxgran.contacts.manifolds.rows import ARM_I, GAP, NORMAL
from voxgran.settling.bed import Bed
from voxgran.settling.compression import PLACES, Balanced, balance_grains, without_weight

#: most rounds of iterations
ROUNDS = 100
#: range of the largest number of a stress
LEAST, MOST = 1e-60, 1e60
#: distance in median diameters within which the point of a contact is that of a known force
SAME = 1e-6


def as_stress(value: "ArrayLike", dimension: int) -> Floats:
    """Return the tensor (3, 3) of a stress: one number, one along each axis, or a tensor; NaN is not prescribed.

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
        # shear between axes along which nothing is prescribed is not prescribed either
        tensor[:d, :d] = np.where(np.isnan(axial[:, None] + axial), math.nan, np.diag(np.nan_to_num(axial)))
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
    least = float(np.linalg.eigvalsh((filled + filled.T)[np.ix_(axes, axes)]).min()) / 2.0
    if least <= 0.0:
        raise InputError(
            f"stress is {shown(value)}: its least principal stress is {least:.3g}, and grains that touch bear no "
            "tension; give stresses above 0"
        )
    return np.asarray((tensor + tensor.T) / 2.0)


def balance_stress(
    bed: Bed, stress: Floats, friction: float, *, reach: float, tolerance: float, start: ContactForces | None = None
) -> Balanced:
    """Return the forces at the contacts of a bed without gravity within reach that balance its grains under a stress.

    stress: (3, 3) tensor, NaN where it is not prescribed.  start: forces with which the search begins, of which the
    lengths are in median diameters.
    """
    without_weight(bed)
    bed.find(reach, 0.0)
    known = start is not None and start.friction is not None and start.friction <= friction
    if start is not None:
        bed.keep_forces(_forces_at(bed, start))
    asked = np.array([stress[place] for place in PLACES])
    prescribed = np.isfinite(asked)
    unit = float(np.abs(asked[prescribed]).max())
    bed.keep_forces(bed.forces() / unit)
    pressed = np.where(prescribed, asked / unit, 0.0) * bed.assembly.container.volume
    modes = np.diag(prescribed.astype(np.float64))
    found = balance_grains(bed, modes, pressed, friction=friction, tolerance=tolerance, rounds=ROUNDS, known=known)
    return found._replace(forces=found.forces * unit, stress=found.stress * unit)


def _forces_at(bed: Bed, known: ContactForces) -> Floats:
    """Return the known forces at the contacts of a bed, (m, 3); 0 where none is known of the same bodies at a point."""
    row, found = bed.rows.row[: bed.m], np.zeros((bed.m, 3))
    i, j = bed.contact_grains(wall=WALL, lid=LID)
    if not known.count or not bed.m:
        return found
    points = bed.assembly.position[i] + row[:, ARM_I : ARM_I + 3]
    tree = load("scipy.spatial").cKDTree(known.point)
    for turned in (False, True):
        # a contact may be listed from its other side, whose point is a gap away
        at = points + row[:, GAP, None] * row[:, NORMAL : NORMAL + 3] * turned
        distance, near = tree.query(at, distance_upper_bound=SAME)
        near = np.where(np.isfinite(distance), near, 0)
        first, second = (known.j, known.i) if turned else (known.i, known.j)
        same = np.isfinite(distance) & (first[near] == i) & (second[near] == j)
        found[same] = known.force[near[same]] * (-1.0 if turned else 1.0)
    return found
