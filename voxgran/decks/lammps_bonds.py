"""Bonded clumps in LAMMPS: spheres joined by beams that break, of the package BPM.

A bond of the area A = pi r^2 has the normal stiffness of the contact law, or of an elastic beam under the law of Hertz,
the shear stiffness of the contact law, and the bending and twisting stiffness of a round beam. It breaks by the
stresses at the rim of the beam (Potyondy & Cundall 2004, doi:10.1016/j.ijrmms.2004.09.011).

References
----------
Formats and commands: docs.lammps.org, pages `bond_bpm_rotational`, `fix_nve_bpm_sphere` and `special_bonds`.
"""

import math
from typing import NamedTuple

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers
from voxgran._base.lazy import Dataset
from voxgran.decks.contact_law import SHEAR_RATIO, ContactLaw

#: digits by which the coefficients of bonds are the same
DIGITS = 12


class BondTexts(NamedTuple):
    """Bonds as LAMMPS reads them."""

    #: lines of the section Bonds of a data file
    section: list[str]
    #: commands that set the coefficients of each type of bond
    commands: list[str]


def bond_texts(bonds: "Dataset", law: ContactLaw, centers: Floats, mass: Floats) -> BondTexts:
    """Return the bonds as a section of a data file and as commands.

    Parameters
    ----------
    bonds : xarray.Dataset
        Bonds in metres and newtons, as of :meth:`voxgran.clumps.Clump.bonds`.
    law : ContactLaw
        Contact law.
    centers, mass : (s, 3) and (s,) ndarray of float
        Centers in m and masses in kg of all spheres.
    """
    first, second = bonds["first"].values, bonds["second"].values
    length = linear.norm(centers[second] - centers[first], axis=1)
    rows = _coefficients(bonds, law, length, mass[first], mass[second])
    scale = np.abs(rows).max(axis=0, initial=1e-300)
    _, found, kind = np.unique(np.round(rows / scale, DIGITS), axis=0, return_index=True, return_inverse=True)
    commands = [f"bond_coeff {k} {' '.join(map(repr, row))}" for k, row in enumerate(rows[found].tolist(), 1)]
    ends = zip((kind.reshape(-1) + 1).tolist(), (first + 1).tolist(), (second + 1).tolist(), strict=True)
    return BondTexts([f"{k} {sort} {a} {b}" for k, (sort, a, b) in enumerate(ends, 1)], commands)


def _coefficients(bonds: "Dataset", law: ContactLaw, length: Floats, one: Floats, other: Floats) -> Floats:
    """Return stiffnesses, limits and damping (m, 12) of bonds, in the order of the bond style."""
    area = bonds["area"].values
    radius = np.sqrt(area / math.pi)
    if law.name == "linear":
        normal = np.full(len(area), law.stiffness)
        shear = np.full(len(area), law.shear_stiffness)
    else:
        # no beam is shorter than it is thick
        normal = law.young_modulus * area / np.maximum(length, radius)
        shear = SHEAR_RATIO * normal
    tension, sliding = bonds["normal_strength"].values, bonds["shear_strength"].values
    effective = one * other / (one + other)
    damping = 2 * law.damping_ratio * np.sqrt(normal * effective)
    sheared = 2 * law.damping_ratio * np.sqrt(shear * effective)
    columns = [
        *(normal, shear, shear * radius**2 / 2, normal * radius**2 / 4),
        *(tension, sliding, tension * radius / 4, sliding * radius / 2),
        *(damping, sheared, damping * radius**2 / 4, sheared * radius**2 / 2),
    ]
    return np.stack(columns, axis=1)


def bond_commands(file: str) -> list[str]:
    """Return the commands that follow the data file; the coefficients are in `file`."""
    # spheres that are bonded do not repel each other until their bond breaks
    return ["special_bonds lj 0.0 1.0 1.0 coul 1.0 1.0 1.0", "bond_style bpm/rotational smooth no", f"include {file}"]


def fitted_poses(before: Floats, after: Floats, grain: Integers, position: Floats) -> tuple[Floats, Floats]:
    """Return centroids (n, 3) and rotations (n, 3, 3) of grains whose spheres have moved.

    The rotation is that of least squares (Kabsch 1976, doi:10.1107/S0567739476001873).

    Parameters
    ----------
    before, after : (s, 3) ndarray of float
        Centers of all spheres.
    grain : (s,) ndarray of int
        Grain of each sphere.
    position : (n, 3) ndarray of float
        Centroids of the grains before.
    """
    count = len(position)
    members = np.bincount(grain, minlength=count)[:, None]
    middle, moved = np.zeros((count, 3)), np.zeros((count, 3))
    np.add.at(middle, grain, before)
    np.add.at(moved, grain, after)
    middle, moved = middle / members, moved / members
    product = np.zeros((count, 3, 3))
    np.add.at(product, grain, (after - moved[grain])[:, :, None] * (before - middle[grain])[:, None, :])
    matrices = linear.nearest_rotations(product)
    return linear.einsum("nij,nj->ni", matrices, position - middle) + moved, matrices
