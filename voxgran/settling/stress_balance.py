"""Proof of balance without gravity: forces at the contacts, within their cones, that balance grains under a stress.

As under gravity no motion is looked at (:mod:`voxgran.settling.equilibrium`). The mean stress is a further balance, of
the container, which does not strain where it is met. All forces may be multiplied by one factor, so that a packing
which bears a stress bears each multiple of it.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arrays import Booleans, Floats
from voxgran._base.errors import InputError, shown
from voxgran._base.stopping import stop_if_asked
from voxgran.settling.bed import Bed
from voxgran.settling.compression import FINE_SOFTNESS, QUICK, pressed_forces, residuals, stress_of, without_weight

#: most rounds of iterations, and the tolerance with which one ends early
ROUNDS, TOLERANCE = 40, 1e-8
#: places of the six numbers of a symmetric tensor
PLACES = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))


@dataclass(frozen=True, slots=True)
class StressBalance:
    """Forces at contacts, and by how much they fail to balance grains and stress.

    Attributes
    ----------
    forces : (m, 3) ndarray of float
        On grain j of each contact, in the unit of stress times the square of the median diameter.
    residual, residual_torque : (n,) ndarray of float
        Net force on each grain, and net torque over its radius, in mean normal forces.
    bearing : (n,) ndarray of bool
        Which grains bear forces.
    stress : (3, 3) ndarray of float
        Mean stress tensor of the forces.
    missed : float
        Largest difference of the stress from the one that is asked for, over its largest number.
    """

    forces: Floats
    residual: Floats
    residual_torque: Floats
    bearing: Booleans
    stress: Floats
    missed: float


def as_stress(value: "ArrayLike", dimension: int) -> Floats:
    """Return the tensor (3, 3) of a stress: one number, one along each axis, or a tensor; NaN is not prescribed.

    Raises
    ------
    InputError
        If it has another shape, is not symmetric, prescribes nothing, or a principal stress is not above 0.
    """
    try:
        given = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        given = np.zeros(0)
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
    if not len(axes) or np.abs(filled - filled.T).max() > 1e-3 * np.abs(filled).max():
        raise InputError(f"stress is {shown(value)}: it must prescribe a symmetric tensor; correct it")
    least = float(np.linalg.eigvalsh((filled + filled.T)[np.ix_(axes, axes)]).min()) / 2.0
    if least <= 0.0:
        raise InputError(
            f"stress is {shown(value)}: its least principal stress is {least:.3g}, and grains that touch bear no "
            "tension; give stresses above 0"
        )
    return np.asarray((tensor + tensor.T) / 2.0)


def balance_stress(bed: Bed, stress: Floats, friction: float, *, reach: float, tolerance: float) -> StressBalance:
    """Return the forces at the contacts of a bed without gravity within reach that balance its grains under a stress.

    stress: (3, 3) tensor, NaN where it is not prescribed.
    """
    without_weight(bed)
    bed.find(reach, 0.0)
    asked = np.array([stress[place] for place in PLACES])
    known = np.isfinite(asked)
    modes, unit = np.diag(known.astype(np.float64)), float(np.abs(asked[known]).max())
    asked = np.where(known, asked / unit, 0.0)
    load = asked * bed.assembly.container.volume
    found: Any = None
    for _ in range(ROUNDS):
        stop_if_asked()
        forces, accelerations = pressed_forces(
            bed, modes, 1.0 / max(bed.count, 1), load, openness=np.zeros(bed.m), friction=friction,
            skin=FINE_SOFTNESS, iterations=QUICK, tolerance=TOLERANCE,
        )  # fmt: skip
        bed.keep_forces(forces)
        force, torque, bearing = residuals(bed, forces, accelerations)
        tensor = stress_of(bed, forces)
        mean = np.array([(tensor[a, b] + tensor[b, a]) / 2.0 for a, b in PLACES])
        missed = float(np.abs(mean - asked)[known].max())
        before, found = found, StressBalance(forces * unit, force, torque, bearing, tensor * unit, missed)
        worst = float(np.maximum(force, torque).max(initial=0.0))
        if max(worst, missed) <= tolerance:
            break
        if before is not None and np.array_equal(before.forces, found.forces):
            # nothing changes any more
            break
    return found
