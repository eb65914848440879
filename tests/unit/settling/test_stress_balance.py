"""Balance of grains under a stress: lattices with known forces, a linear program as a twin, what is refused."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog

import voxgran as vg
from voxgran._base.errors import InputError

SPHERE, DISK = vg.make_shape("sphere"), vg.make_shape("disk")


def cubic_lattice(side=3, size=1.0):
    """Spheres that touch along the axes of a periodic box."""
    place = np.stack(np.meshgrid(*[np.arange(side)] * 3, indexing="ij"), axis=-1).reshape(-1, 3) * size
    box = vg.Box((side * size,) * 3, periodic="xyz")
    return vg.Packing.of([SPHERE.scaled(size)], box, position=place + size / 2)


def compressed_disks(friction=0.3, count=24, seed=3, **more):
    loose = vg.pack(DISK, vg.Rectangle((6.5, 6.5), periodic="xy"), "rsa", count=count, seed=seed)
    return vg.compress(loose, friction=friction, **more)


@pytest.mark.parametrize("size", [1.0, 1e-3])
def test_a_cubic_lattice_bears_each_axis_by_its_own_stress(size):
    found = vg.equilibrium(cubic_lattice(size=size), 0.0, stress=(1.0, 2.0, 3.0))
    along = np.abs(found["normal"].values).argmax(axis=1)
    assert found.sizes["contact"] == 81
    # a face of one squared diameter has one contact; parallel rows share a stress in any way
    along_it = np.abs(found["force"].values[range(81), along])
    assert np.allclose([along_it[along == axis].mean() for axis in range(3)], (1.0, 2.0, 3.0), rtol=1e-3)
    assert found.attrs["balanced"] == 1
    assert found.attrs["stress_error"] < 1e-3
    assert np.allclose(found["stress"], np.diag([1.0, 2.0, 3.0]), atol=2e-3)


def test_a_lattice_bears_shear_by_friction_only():
    tensor = np.diag([1.0, 1.0, 1.0])
    tensor[0, 1] = tensor[1, 0] = 0.2
    held = vg.equilibrium(cubic_lattice(), 0.3, stress=tensor)
    assert held.attrs["balanced"] == 1
    assert held.attrs["share_at_rest"] == 1.0
    assert np.allclose(held["stress"], tensor, atol=0.01)
    for friction in (0.0, 0.15):
        found = vg.equilibrium(cubic_lattice(), friction, stress=tensor)
        assert found.attrs["balanced"] == 0
        assert found.attrs["stress_error"] > 0.03


def test_a_column_of_disks_between_two_walls():
    column = vg.Packing.of([DISK], vg.Rectangle((1.0, 5.0)), position=[(0.5, 0.5 + k, 0.0) for k in range(5)])
    found = vg.equilibrium(column, 0.5, stress=(None, 2.0))
    along = np.abs(found["normal"].values[:, 1]) > 0.5
    # four contacts of disks and two of walls, across a width of one diameter
    assert along.sum() == 6
    assert np.allclose(found["normal_force"].values[along], 2.0, rtol=0.01)
    assert found.attrs["balanced"] == 1


def feasible(packing, friction, stress):
    """Whether a linear program finds forces of disks within their cones that balance them under a stress (2,)."""
    contacts = vg.equilibrium(packing, friction, stress=np.diag(stress))
    i, j, n = contacts["contact_i"].values, contacts["contact_j"].values, packing.count
    normal = contacts["normal"].values[:, :2]
    tangent, m = np.column_stack([-normal[:, 1], normal[:, 0]]), len(i)
    radius = packing.diameters / 2
    gap = contacts["gap"].values
    rows = np.zeros((3 * n + 3, 2 * m))
    for k in range(m):
        for part, direction in ((0, normal[k]), (1, tangent[k])):
            column = 2 * k + part
            for grain, sign, arm in ((i[k], -1.0, radius[i[k]] * normal[k]), (j[k], 1.0, -radius[j[k]] * normal[k])):
                rows[3 * grain : 3 * grain + 2, column] += sign * direction
                rows[3 * grain + 2, column] += sign * (arm[0] * direction[1] - arm[1] * direction[0])
            branch = (radius[i[k]] + radius[j[k]] + gap[k]) * normal[k]
            virial = np.outer(direction, branch)
            rows[3 * n :, column] = virial[0, 0], virial[1, 1], (virial[0, 1] + virial[1, 0]) / 2
    right = np.zeros(3 * n + 3)
    right[3 * n : 3 * n + 2] = np.array(stress) * packing.container.volume
    # |tangential| <= friction * normal, and a slack of all balances that is to be least
    cones = np.zeros((2 * m, 2 * m + 1))
    for k in range(m):
        cones[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[-friction, 1.0], [-friction, -1.0]]
    both = np.vstack([np.column_stack([rows, -np.ones(len(rows))]), np.column_stack([-rows, -np.ones(len(rows))])])
    bounds = [(0, None), (None, None)] * m + [(0, None)]
    cost = np.zeros(2 * m + 1)
    cost[-1] = 1.0
    found = linprog(cost, np.vstack([cones, both]), np.concatenate([np.zeros(2 * m), right, -right]), bounds=bounds)
    return found.x[-1] < 1e-4, contacts.attrs["balanced"] == 1


@pytest.mark.parametrize(
    ("friction", "stress"), [(0.3, (1, 1)), (0.3, (1, 1.3)), (0.3, (1, 6)), (0.0, (1, 1)), (0.6, (2, 1))]
)
def test_a_linear_program_agrees(friction, stress):
    by_program, by_sweeps = feasible(compressed_disks(), friction, stress)
    assert by_program == by_sweeps


def test_a_packing_that_was_compressed_is_asked_for_the_stress_of_its_forces():
    specimen = compressed_disks(stress=(1.0, 1.5))
    found = vg.equilibrium(specimen, 0.3)
    assert found.attrs["balanced"] == 1
    assert np.allclose(found["stress"].values[:2, :2], specimen.forces.stress[:2, :2], atol=0.02)
    loose = vg.pack(DISK, vg.Rectangle((9, 9), periodic="xy"), "rsa", count=20)
    assert vg.equilibrium(loose, stress=1.0).attrs["balanced"] == 0


def test_forces_beyond_their_cones_prove_nothing():
    specimen = compressed_disks(friction=0.6)
    # the same forces, said to be those of grains that hardly rub
    slippery = replace(specimen.forces, friction=0.01)
    told, cold = (
        vg.equilibrium(replace(specimen, forces=forces), 0.01, stress=specimen.forces.stress)
        for forces in (slippery, None)
    )
    assert told.attrs["balanced"] == cold.attrs["balanced"] == 0
    normal, force = told["normal"].values, told["force"].values
    push = (force * normal).sum(axis=1)
    across = np.linalg.norm(force - push[:, None] * normal, axis=1)
    assert push.min() >= 0
    assert (across <= 0.01 * push * (1 + 1e-9) + 1e-12).all()


def test_a_grain_that_one_contact_pushes_is_not_in_balance():
    # two walls press a column, and a disk leans on its side
    place = [(0.5, 0.5 + k, 0.0) for k in range(3)] + [(1.5, 1.5, 0.0)]
    column = vg.Packing.of([DISK], vg.Rectangle((3.0, 3.0), periodic="x"), position=place)
    found = vg.equilibrium(column, 0.5, stress=(None, 1.0))
    assert found.attrs["balanced"] == 1
    assert found["rattler"].values.tolist() == [False, False, False, True]
    pushed = vg.equilibrium(column, 0.5, stress=(1.0, 1.0))
    assert pushed.attrs["balanced"] == 0


@pytest.mark.parametrize(
    ("stress", "words"),
    [
        ((1, -1, 1), "least principal stress is -1"),
        ([[1, 2, 0], [2, 1, 0], [0, 0, 1]], "least principal stress is -1"),
        (0.0, "least principal stress is 0"),
        (True, "3 numbers along the axes"),
        ((1, 1, math.inf), "between 1e-60"),
        ((1, 1), "3 numbers along the axes"),
        ("x", "3 numbers along the axes"),
        ((math.nan,) * 3, "prescribe a symmetric tensor"),
        ([[1, 0.2, 0], [0, 1, 0], [0, 0, 1]], "prescribe a symmetric tensor"),
    ],
)
def test_stresses_that_grains_cannot_bear_are_refused(stress, words):
    with pytest.raises(InputError, match=words):
        vg.equilibrium(cubic_lattice(), stress=stress)


def test_without_gravity_and_stress_both_are_named():
    with pytest.raises(InputError, match="stress=1"):
        vg.equilibrium(cubic_lattice())


def test_the_proof_finds_the_forces_of_a_compression_again():
    loose = vg.pack(SPHERE, vg.Box((6, 6, 6), periodic="xyz"), "rsa", count=110, seed=2)
    specimen = vg.compress(loose, friction=0.4)
    found = vg.equilibrium(specimen, 0.4)
    residual = np.maximum(found["residual"], found["residual_torque"]).values
    bearing = ~specimen.forces.rattler
    assert (residual[bearing] > 0.01).mean() <= (specimen.forces.residual[bearing] > 0.01).mean()
    assert np.allclose(found["stress"], specimen.forces.stress, atol=0.011)
