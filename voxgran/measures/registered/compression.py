"""Compression of a packing to a stress: the mean stress tensor, the void ratio, and the path that led there."""

import numpy as np

from voxgran._base.errors import InputError
from voxgran.measures.model import Groups, Measure, dataset, variable
from voxgran.packing.model import Packing
from voxgran.settling.stress_balance import shear_ratio


def _compute(packing: Packing) -> Groups:
    """Return stress and void ratio, and by step of the compression the solid fraction, void ratio and axial stresses.

    Raises
    ------
    InputError
        If the packing was not compressed.
    """
    forces = packing.forces
    if forces is None or forces.stress is None:
        raise InputError(
            "forces of the packing have no stress: they have one where it was compressed; use compress, or leave this "
            "measure out"
        )
    d, stress = packing.dimension, forces.stress
    axial, shear = np.diag(stress)[:d], shear_ratio(stress, d)
    # the pressure of a path that was not recorded is that of its end
    path = np.array(packing.provenance.get("compression", {}).get("path", [])).reshape(-1, 4)
    fraction, along = path[:, 0], path[:, 1 : 1 + d]
    unit = "unit of stress"
    root = {
        "void_ratio": variable((), 1.0 / packing.solid_fraction - 1.0, "1", "volume of the voids over that of grains"),
        "pressure": variable((), axial.mean(), unit, "mean of the axial stresses"),
        "stress_ratio": variable((), axial.min() / axial.max(), "1", "least axial stress over the largest one"),
        "shear_ratio": variable((), shear, "1", "largest shear stress in the axes x, y, z over the pressure"),
        "largest_shear_stress": variable((), shear * axial.mean(), unit, "largest shear stress in the axes x, y, z"),
    }
    axes = ("compression_step", "axis")
    arrays = {
        "stress": variable(("axis", "axis_"), stress[:d, :d], unit, "mean stress tensor of Love and Weber"),
        "path_solid_fraction": variable(axes[:1], fraction, "1", "solid fraction by step"),
        "path_void_ratio": variable(axes[:1], 1.0 / fraction - 1.0, "1", "void ratio by step"),
        "path_stress": variable(axes, along, unit, "axial stresses by step"),
    }
    return {"/": dataset(root), "/compression": dataset(arrays)}


def _applies(packing: Packing) -> bool:
    """Return whether the packing was compressed."""
    return packing.forces is not None and packing.forces.stress is not None


registration = Measure(
    summary="mean stress tensor and void ratio of a compressed packing, and the path of its compression",
    groups=("/", "/compression"),
    compute=_compute,
    tilted=True,
    applies=_applies,
)
