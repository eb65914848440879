"""Forces in cones by an interior point: dense equations as a twin, edges of cones, and proofs without a start."""

from dataclasses import replace

import numpy as np
import pytest

import voxgran as vg
from voxgran.settling import cone_barrier
from voxgran.settling.bed import normalized_bed
from voxgran.settling.stress_balance import stress_of, without_weight

SPHERE, DISK = vg.shapes.sphere(), vg.make_shape("disk")


def loose(count, seed=1):
    edge = (count * np.pi / 6 / 0.3) ** (1 / 3)
    return vg.pack(SPHERE, vg.Box((edge,) * 3, periodic="xyz"), "rsa", count=count, seed=seed)


@pytest.fixture(scope="module")
def specimen():
    return vg.compress(loose(200), friction=0.5)


def bed_of(packing):
    bed = normalized_bed(packing, np.zeros(3))
    without_weight(bed)
    bed.find(1e-3, 0.0)
    return bed


def program_of(bed, friction, prescribed):
    pressed = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]) * bed.assembly.container.volume
    grains = 0.5 * bed.diameter, bed.grains.position[:, 2]
    return cone_barrier._program(bed.contacts, np.full(bed.m, friction), pressed, prescribed, grains)


def test_equations_are_those_of_a_dense_matrix(specimen):
    bed = bed_of(specimen)
    program = program_of(bed, 0.5, np.ones(6, dtype=bool))
    rng = np.random.default_rng(0)
    roots = rng.normal(size=(bed.m, 3, 3))
    bend, right = roots @ roots.transpose(0, 2, 1), rng.normal(size=len(program.right))
    matrix, whole = program.matrix.toarray(), np.zeros((3 * bed.m, 3 * bed.m))
    for k in range(bed.m):
        whole[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = bend[k]
    plain = np.linalg.solve(np.eye(len(right)) + matrix @ whole @ matrix.T, right)
    assert cone_barrier._solved(program, bend, right) == pytest.approx(plain, rel=1e-6, abs=1e-9)


def test_residuals_are_net_forces_torques_and_stress(specimen):
    bed = bed_of(specimen)
    program = program_of(bed, 0.5, np.ones(6, dtype=bool))
    parts = np.random.default_rng(1).normal(size=(bed.m, 3))
    forces = np.einsum("mi,mij->mj", parts, program.columns) * program.mean
    found, n = program.matrix @ parts.ravel(), bed.count
    net, turn = np.zeros((n, 3)), np.zeros((n, 3))
    for k in range(bed.m):
        i, j, row = bed.rows.i[k], bed.rows.j[k], bed.rows.row[k]
        net[i] -= forces[k]
        net[j] += forces[k]
        turn[i] -= np.cross(row[3:6], forces[k]) / 0.5
        turn[j] += np.cross(row[6:9], forces[k]) / 0.5
    assert found[: 6 * n].reshape(n, 6)[:, :3] * program.mean == pytest.approx(net, abs=1e-9)
    assert found[: 6 * n].reshape(n, 6)[:, 3:] * program.mean == pytest.approx(turn, abs=1e-9)
    stress = stress_of(bed, forces)
    asked = [(stress[a, b] + stress[b, a]) / 2 for a, b in cone_barrier.PLACES]
    virial = found[6 * n :] * np.sqrt(bed.m) * program.mean / bed.assembly.container.volume
    assert virial == pytest.approx(asked, abs=1e-9)


def test_the_way_to_the_edge_of_a_cone():
    parts = np.array([[1.0, 0.0, 0.0], [2.0, 1.0, 0.0]])
    assert cone_barrier._to_the_edge(parts, np.array([[-0.5, 0.0, 0.0], [0.0, 0.0, 0.0]])) == pytest.approx(2.0)
    assert cone_barrier._to_the_edge(parts, np.array([[0.0, 0.0, 0.0], [0.0, 0.5, 0.0]])) == pytest.approx(2.0)
    assert cone_barrier._to_the_edge(parts, np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])) == np.inf


@pytest.mark.parametrize("friction", [0.5, 0.3])
def test_a_proof_without_known_forces_is_as_exact_as_with_them(friction):
    made = vg.compress(loose(200), friction=friction)
    cold = vg.equilibrium(replace(made, forces=None), friction, stress=np.eye(3))
    assert cold.attrs["balanced"] == 1
    assert cold.attrs["share_at_rest"] == 1.0
    assert cold.attrs["stress_error"] < 1e-3
    # within the cones
    force, normal = cold["force"].values, cold["normal"].values
    push = (force * normal).sum(axis=1)
    across = np.linalg.norm(force - push[:, None] * normal, axis=1)
    assert push.min() >= 0.0
    assert (across <= friction * push * (1 + 1e-9) + 1e-12).all()
    # the tensor is exact, with shear too
    assert cold["stress"].values == pytest.approx(np.eye(3), abs=2e-3)


def test_shear_walls_and_two_dimensions():
    tensor = np.eye(3)
    tensor[0, 1] = tensor[1, 0] = 0.01

    def bears(seed):
        made = vg.compress(loose(200, seed), friction=0.5)
        return vg.equilibrium(replace(made, forces=None), 0.5, stress=tensor).attrs["balanced"] == 1

    # 13 of 16 moved starts bear the shear
    assert any(bears(seed) for seed in range(1, 8))
    drum = vg.compress(vg.pack(SPHERE, vg.Cylinder(2.5, 7), "rsa", count=70), stress=(0.7, 0.7, 1.0))
    held = vg.equilibrium(replace(drum, forces=None), stress=drum.forces.stress)
    assert held.attrs["share_at_rest_without_rattlers"] > 0.98
    flat = vg.compress(vg.pack(DISK, vg.Rectangle((9, 9), periodic="xy"), "rsa", count=45), friction=0.3)
    again = vg.equilibrium(replace(flat, forces=None), 0.3, stress=flat.forces.stress)
    assert again.attrs["share_at_rest"] > 0.99


def test_what_bears_nothing_is_not_proven(specimen):
    wide = replace(specimen, container=vg.Box(tuple(np.multiply(specimen.container.lengths, 1.01)), periodic="xyz"))
    found = vg.equilibrium(replace(wide, forces=None), 0.5, stress=1.0)
    assert found.attrs["balanced"] == 0
    # a friction of 0.02 does not hold what one of 0.5 does
    slips = vg.equilibrium(replace(specimen, forces=None), 0.02, stress=1.0)
    assert slips.attrs["balanced"] == 0
    assert slips["residual"].max() > 0.02
