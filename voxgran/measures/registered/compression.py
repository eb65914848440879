"""Compression of a packing to a stress: the mean stress tensor, the void ratio, and the path that led there."""

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.errors import InputError
from voxgran.contacts.forces import WALL
from voxgran.containers.model import boundary_of
from voxgran.measures.model import Groups, Measure, dataset, variable
from voxgran.packing.model import Packing
from voxgran.settling.materials import wall_names
from voxgran.settling.stress_balance import shear_ratio

#: cosine of the angle between the normal of a contact at a plane wall and that of the wall
ALIKE = 1.0 - 1e-6


def wall_stresses(packing: Packing) -> dict[str, float]:
    """Return the normal stress at each wall of a container that was compressed, by the name of the wall.

    Friction at other walls makes those of opposite ones differ, of which the mean stress tensor has the mean.
    """
    forces, container, d = packing.forces, packing.container, packing.dimension
    assert forces is not None
    boundary, width = boundary_of(container), np.ptp(container.bounds, axis=0)
    # forces are in stress times this
    push = forces.normal_force * packing.median_diameter ** (d - 1)
    found, left = {}, forces.j == WALL
    for plane, name in zip(boundary.planes, wall_names(boundary), strict=False):
        here = left & (linear.matmul(forces.normal, plane.normal) < -ALIKE)
        found[name] = float(push[here].sum() / container.volume * linear.matmul(np.abs(plane.normal)[:d], width[:d]))
        left &= ~here
    if boundary.round:
        # volume over area: a third of the radius of a sphere, half of that of a cylinder or a disk
        found[wall_names(boundary)[-1]] = float(
            push[left].sum() / container.volume * width[0] / (6.0 if boundary.sphere is not None else 4.0)
        )
    return found


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
    for name, value in wall_stresses(packing).items():
        root[f"stress_at_{name}"] = variable((), value, unit, f"normal stress at the wall {name}")
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
