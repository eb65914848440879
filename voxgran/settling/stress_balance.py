"""Proof of balance without gravity: forces at the contacts, within their cones, that balance grains under a stress.

As under gravity no motion is looked at (:mod:`voxgran.settling.equilibrium`). The mean stress is a further balance, of
the container, which does not strain where it is met. All forces may be multiplied by one factor, so that a packing
which bears a stress bears each multiple of it.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arrays import Floats
from voxgran._base.errors import InputError, shown
from voxgran.settling.bed import Bed
from voxgran.settling.compression import PLACES, Balanced, balance_grains, without_weight

#: most rounds of iterations
ROUNDS = 100


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


def balance_stress(bed: Bed, stress: Floats, friction: float, *, reach: float, tolerance: float) -> Balanced:
    """Return the forces at the contacts of a bed without gravity within reach that balance its grains under a stress.

    stress: (3, 3) tensor, NaN where it is not prescribed.
    """
    without_weight(bed)
    bed.find(reach, 0.0)
    asked = np.array([stress[place] for place in PLACES])
    known = np.isfinite(asked)
    unit = float(np.abs(asked[known]).max())
    load = np.where(known, asked / unit, 0.0) * bed.assembly.container.volume
    modes = np.diag(known.astype(np.float64))
    found = balance_grains(bed, modes, load, friction=friction, tolerance=tolerance, rounds=ROUNDS)
    return found._replace(forces=found.forces * unit, stress=found.stress * unit)
