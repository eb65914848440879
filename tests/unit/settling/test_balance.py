"""Forces that balance bodies: against plain NumPy, least squares with bounds, and closed formulas."""

import numpy as np
import pytest
from scipy.optimize import nnls

from voxgran._base.compiling.threads import using_threads
from voxgran.contacts.manifolds.rounds import rounds_of
from voxgran.geometry import morton
from voxgran.settling import projected_gradient
from voxgran.settling.balance import LoadedContacts, gauss_seidel_forces, net_accelerations
from voxgran.settling.projected_gradient import accelerated_projected_gradient

DOWN = np.array([0.0, 0.0, -1.0])


def heap(seed=0, count=24, *, flat=False, round_grains=True):
    """Return rows, i, j and bodies of grains that touch neighbours at random, on a floor, some with a lid on them.

    The contacts need not belong to any real heap: the solvers know normals and arms only.
    """
    generator = np.random.default_rng(seed)
    position = generator.random((count, 3)) * [4.0, 4.0, 4.0]
    position[:, 1] *= not flat
    i, j, normal, arm_i, arm_j = [], [], [], [], []
    for one in range(count):
        for other in np.argsort(np.linalg.norm(position - position[one], axis=1))[1:4]:
            way = position[other] - position[one]
            i, j = [*i, one], [*j, other]
            normal.append(way / np.linalg.norm(way))
            arm_i.append(0.5 * normal[-1])
            arm_j.append(-0.5 * normal[-1])
        if one % 3 == 0:
            i, j = [*i, one], [*j, -1 if one % 2 else count]
            normal.append(DOWN if one % 2 else -DOWN)
            arm_i.append(0.5 * normal[-1])
            arm_j.append(np.zeros(3))
    row = np.zeros((len(i), 16))
    row[:, :9] = np.hstack([normal, arm_i, arm_j])
    if not round_grains:
        row[:, 3:9] += 0.2 * generator.normal(size=(len(i), 6)) * ([1, 0, 1, 1, 0, 1] if flat else 1)
        row[np.array(j) >= count, 6:9] = 0.0
    bodies = np.zeros((count + 1, 8))
    bodies[:-1, 6] = generator.uniform(0.5, 2.0, count)
    bodies[:-1, 7] = bodies[:-1, 6] / 0.1
    bodies[-1, 6] = 0.1
    return row, np.array(i), np.array(j), bodies


def matrix_of(row, i, j, bodies):
    """Return J (3 m, 6 (n + 1)): the velocities of contact points of j against those of i, by those of the bodies."""
    many, last = len(row), len(bodies) - 1
    matrix = np.zeros((many, 3, last + 1, 6))

    def turning(arm):
        return np.cross(np.eye(3), arm).T

    for k in range(many):
        matrix[k, :, i[k], :3] -= np.eye(3)
        matrix[k, :, i[k], 3:] -= turning(row[k, 3:6])
        if j[k] == last:
            matrix[k, :, last, :3] += np.outer(DOWN, DOWN)
        elif j[k] >= 0:
            matrix[k, :, j[k], :3] += np.eye(3)
            matrix[k, :, j[k], 3:] += turning(row[k, 6:9])
    return matrix.reshape(3 * many, -1)


def masses_of(bodies):
    inverse = np.repeat(bodies[:, 6:8], 3, axis=1)
    return np.where(inverse > 0, 1 / np.where(inverse > 0, inverse, 1), 0).ravel()


def pull(bodies):
    """Return accelerations by gravity alone."""
    return np.hstack([np.where(bodies[:, 6:7] > 0, DOWN, 0), np.zeros((len(bodies), 3))]).ravel()


def twin(row, i, j, bodies, forces):
    inverse = np.repeat(bodies[:, 6:8], 3, axis=1).ravel()
    acted = matrix_of(row, i, j, bodies).T @ forces.ravel()
    found = (pull(bodies) + inverse * acted).reshape(-1, 6)
    roll, torque = bodies[:, 8:], acted.reshape(-1, 6)[:, 3:]
    if roll.size:
        found[:, 3:] += roll * (roll * torque).sum(axis=1)[:, None]
    return found


def slender(bodies):
    """Return rows of bodies of which some roll about an axis more easily than they turn otherwise."""
    roll = 4.0 * np.random.default_rng(4).normal(size=(len(bodies), 3))
    roll[::3] = roll[-1] = 0.0
    return np.hstack([bodies, roll])


@pytest.mark.parametrize("rolls", [False, True])
@pytest.mark.parametrize("round_grains", [True, False])
def test_accelerations_are_those_of_a_matrix(round_grains, rolls):
    row, i, j, bodies = heap(1, round_grains=round_grains)
    bodies = slender(bodies) if rolls else bodies
    forces = np.random.default_rng(2).normal(size=(len(i), 3))
    found = net_accelerations(LoadedContacts(row, i, j, bodies, DOWN), forces)
    np.testing.assert_allclose(found, twin(row, i, j, bodies, forces), atol=1e-12)


def solve(heap_of, friction, near=0.0, iterations=20_000):
    row, i, j, bodies = heap_of
    forces = np.zeros((len(i), 3))
    found, made, distance = accelerated_projected_gradient(
        LoadedContacts(row, i, j, bodies, DOWN),
        forces,
        friction=friction,
        iterations=iterations,
        tolerance=0.0,
        near=near,
    )
    return forces, found, made, distance


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize(("round_grains", "many"), [(True, 1), (False, 1), (False, projected_gradient.MANY)])
def test_forces_in_a_plane_are_those_of_least_squares(monkeypatch, friction, round_grains, many):
    """In a plane a friction cone is all sums of two vectors: a problem for non-negative least squares."""
    monkeypatch.setattr(projected_gradient, "MANY", many)
    row, i, j, bodies = heap(3, flat=True, round_grains=round_grains)
    _, found, _, distance = solve((row, i, j, bodies), friction, near=1e-7)
    across = np.cross(row[:, :3], [0.0, 1.0, 0.0])
    edges = [row[:, :3] + friction * across, row[:, :3] - friction * across]
    m, mass = matrix_of(row, i, j, bodies), np.sqrt(masses_of(bodies))
    inverse = np.where(mass > 0, 1 / np.where(mass > 0, mass, 1), 0)
    columns = [inverse * (m.reshape(-1, 3, m.shape[1])[k].T @ edge[k]) for edge in edges for k in range(len(i))]
    least = nnls(np.array(columns).T, -mass * pull(bodies), maxiter=10_000)[0]
    expected = pull(bodies) + inverse * (np.array(columns).T @ least)
    difference = mass * (found.ravel() - expected)
    # the estimate of how far it is bounds how far it is
    assert np.linalg.norm(difference) / np.sqrt(masses_of(bodies).reshape(-1, 6)[:, 0].sum()) <= distance <= 1e-7
    np.testing.assert_allclose(found.ravel(), expected, atol=1e-5)
    assert np.abs(expected).max() > 0.05


@pytest.mark.parametrize("round_grains", [True, False])
def test_no_change_within_the_cones_lessens_the_residual(round_grains):
    """The conditions of the optimum: forces in their cones, and accelerations in the dual cones, that do no work."""
    one = heap(4, round_grains=round_grains)
    forces, found, _, distance = solve(one, 0.4, near=1e-6)
    row, i, j, bodies = one
    assert distance <= 1e-6
    normal_force = (forces * row[:, :3]).sum(axis=1)
    across = forces - normal_force[:, None] * row[:, :3]
    assert normal_force.min() >= 0.0
    assert (np.linalg.norm(across, axis=1) <= 0.4 * normal_force + 1e-12).all()
    apart = (matrix_of(row, i, j, bodies) @ found.ravel()).reshape(-1, 3)
    opening = (apart * row[:, :3]).sum(axis=1)
    sliding = np.linalg.norm(apart - opening[:, None] * row[:, :3], axis=1)
    assert (opening >= 0.4 * sliding - 1e-4).all()
    assert abs((apart * forces).sum()) < 1e-4
    # some grains are out of balance, some contacts slide, and some stick
    assert np.abs(found).max() > 0.1
    sticks = np.linalg.norm(across, axis=1) < 0.39 * normal_force
    assert sticks.any()
    assert (~sticks & (normal_force > 1e-3)).any()


def test_the_first_guess_does_not_matter():
    one = heap(5)
    _, cold, _, _ = solve(one, 0.5, near=1e-7)
    row, i, j, bodies = one
    forces = 3.0 * row[:, :3]
    warm, _, _ = accelerated_projected_gradient(
        LoadedContacts(row, i, j, bodies, DOWN), forces, friction=0.5, iterations=20_000, tolerance=0.0, near=1e-7
    )
    np.testing.assert_allclose(warm, cold, atol=1e-5)


def plain_sweeps(row, i, j, bodies, forces, openness, friction, skin, iterations, order):
    """Return the forces after sweeps there and back in an order of the rows, by dense matrices, and restarts.

    Between two iterations is the momentum of Nesterov, which begins anew where it points the wrong way.
    """
    matrix = matrix_of(row, i, j, bodies).reshape(len(row), 3, -1)
    inverse = np.repeat(bodies[:, 6:8], 3, axis=1).ravel()
    old, old_velocity, t, momentum, restarts = forces.copy(), twin(row, i, j, bodies, forces).ravel(), 1.0, 0.0, 0
    for _ in range(iterations):
        velocity = twin(row, i, j, bodies, forces).ravel()
        before_it, before_velocity = forces.copy(), velocity.copy()
        forces += momentum * (forces - old)
        velocity = velocity + momentum * (velocity - old_velocity)
        old, old_velocity, ahead = before_it, before_velocity, velocity.copy()
        for k in [*order, *reversed(order)]:
            n, own = row[k, :3], matrix[k]
            along = n @ own @ (inverse * (own.T @ n))
            # a bound of the effect across the normal: that of the whole arms
            wide = bodies[i[k], 6] + bodies[i[k], 7] * row[k, 3:6] @ row[k, 3:6]
            if j[k] == len(bodies) - 1:
                wide += bodies[-1, 6] * np.sqrt(max(1 - (n @ DOWN) ** 2, 0))
            elif j[k] >= 0:
                wide += bodies[j[k], 6] + bodies[j[k], 7] * row[k, 6:9] @ row[k, 6:9]
            apart, before = own @ velocity, forces[k].copy()
            un, fn = n @ apart, n @ before
            push = max(0.0, fn - (un + openness[k] + skin * fn) / (along + skin))
            across = before - fn * n - (apart - un * n) / wide
            length = np.linalg.norm(across)
            across *= min(1.0, friction * push / length) if length > 0 else 0.0
            forces[k] = push * n + across
            velocity += inverse * (own.T @ (forces[k] - before))
        if (masses_of(bodies) * (ahead - velocity)) @ (velocity - old_velocity) > 0:
            t, restarts = 1.0, restarts + 1
        momentum, t = (t - 1) / ((1 + np.sqrt(1 + 4 * t * t)) / 2), (1 + np.sqrt(1 + 4 * t * t)) / 2
    return forces, restarts


@pytest.mark.parametrize("least", [100, 6])
@pytest.mark.parametrize("iterations", [1, 30])
@pytest.mark.parametrize("round_grains", [True, False])
def test_an_iteration_is_two_sweeps_in_the_order_of_the_rows_or_of_rounds(monkeypatch, round_grains, iterations, least):
    """Of one set of contacts, or of those within four blocks of bodies and between them, by any number of threads."""
    row, i, j, bodies = heap(6, round_grains=round_grains)
    generator = np.random.default_rng(7)
    openness, start = 0.1 * generator.normal(size=len(i)), 0.1 * row[:, :3]
    monkeypatch.setattr(morton, "MANY", 1)
    monkeypatch.setattr(morton, "LEAST", least)
    rounds = rounds_of(i, j, len(bodies))
    assert (len(rounds.sets) > 4) == (least == 6)
    order = list(rounds.rows)
    expected, restarts = plain_sweeps(row, i, j, bodies, start.copy(), openness, 0.5, 1e-3, iterations, order)
    assert restarts or iterations == 1
    found = []
    for threads in (1, 2, 3):
        forces = start.copy()
        with using_threads(threads):
            gauss_seidel_forces(
                LoadedContacts(row, i, j, bodies, DOWN), forces, openness, friction=np.full(len(i), 0.5), skin=1e-3,
                iterations=iterations,
            )  # fmt: skip
        np.testing.assert_allclose(forces, expected, atol=1e-9)
        found.append(forces)
    np.testing.assert_array_equal(found[0], found[1])
    np.testing.assert_array_equal(found[0], found[2])


def test_patience_ends_a_search_in_which_a_few_bodies_cannot_rest():
    """Thirty grains rest on the floor and one has no contact: it falls whatever the forces are."""
    count = 31
    row, bodies = np.zeros((count - 1, 16)), np.zeros((count + 1, 8))
    row[:, :6] = [0, 0, -1, 0, 0, -0.5]
    bodies[:-1, 6:] = 1.0, 10.0
    contacts = LoadedContacts(row, np.arange(count - 1), np.full(count - 1, -1), bodies, DOWN)
    made = {}
    for patience in (None, 32):
        forces = np.zeros((count - 1, 3))
        left, made[patience], _ = accelerated_projected_gradient(
            contacts, forces, friction=0.5, iterations=320, tolerance=0.01, near=-1.0, patience=patience
        )
        np.testing.assert_allclose(forces[:, 2], -1.0, atol=0.01)
        np.testing.assert_allclose(left[count - 1], [0, 0, -1, 0, 0, 0])
    assert made == {None: 320, 32: 48}


@pytest.mark.parametrize(("own", "rolls"), [(False, False), (True, False), (True, True)])
@pytest.mark.parametrize("round_grains", [True, False])
def test_sweeps_end_at_the_law_of_coulomb(round_grains, own, rolls):
    """Of one friction, or one of each contact; also of slender bodies."""
    row, i, j, bodies = heap(8, round_grains=round_grains)
    bodies = slender(bodies) if rolls else bodies
    friction = np.random.default_rng(3).uniform(0.0, 0.6, len(i)) if own else 0.3
    openness = 0.05 * np.random.default_rng(9).random(len(i))
    forces, skin = np.zeros((len(i), 3)), 1e-3
    found, made = gauss_seidel_forces(
        LoadedContacts(row, i, j, bodies, DOWN),
        forces,
        openness,
        friction=friction,
        skin=skin,
        iterations=20_000,
        tolerance=1e-12,
    )
    assert made < 20_000
    normal = row[:, :3]
    push = (forces * normal).sum(axis=1)
    apart = (matrix_of(row, i, j, bodies) @ found.ravel()).reshape(-1, 3)
    opening = (apart * normal).sum(axis=1)
    room = opening + openness + skin * push
    assert push.min() >= 0.0
    assert room.min() > -1e-8
    assert (push * room).max() < 1e-7
    across, sliding = forces - push[:, None] * normal, apart - opening[:, None] * normal
    slides = np.linalg.norm(sliding, axis=1) > 1e-5
    limit = (friction * push)[slides, None]
    # what slides is pulled back by the whole friction, without any demand that it opens
    np.testing.assert_allclose(
        across[slides], -limit * sliding[slides] / np.linalg.norm(sliding[slides], axis=1)[:, None], atol=1e-4
    )
    assert (np.linalg.norm(across, axis=1) <= friction * push + 1e-9).all()
    assert (slides & (push > 1e-2)).any()
    assert (~slides & (push > 1e-2)).any()


def test_a_lid_presses_with_its_weight():
    """A grain of weight 1 between the floor and a lid of weight 3."""
    row = np.zeros((2, 16))
    row[0, :6] = [0, 0, -1, 0, 0, -0.5]
    row[1, :6] = [0, 0, 1, 0, 0, 0.5]
    i, j, bodies = np.array([0, 0]), np.array([-1, 1]), np.zeros((2, 8))
    bodies[:, 6] = 1.0, 1.0 / 3.0
    bodies[0, 7] = 10.0
    contacts = LoadedContacts(row, i, j, bodies, DOWN)
    for solver in ("sweeps", "gradient"):
        forces = np.zeros((2, 3))
        if solver == "sweeps":
            gauss_seidel_forces(contacts, forces, np.zeros(2), friction=0.5, skin=0.0, iterations=1000, tolerance=1e-14)
        else:
            accelerated_projected_gradient(contacts, forces, friction=0.5, iterations=2000, tolerance=1e-10, near=0.0)
        np.testing.assert_allclose(forces, [[0, 0, -4], [0, 0, 3]], atol=1e-8)


def test_a_grain_may_touch_its_own_image():
    """In a periodic box as wide as a grain: the two forces cancel, and nothing grows without bound."""
    row = np.zeros((2, 16))
    row[0, :9] = [1, 0, 0, 0.5, 0, 0.2, -0.5, 0, 0.1]
    row[1, :6] = [0, 0, -1, 0, 0, -0.5]
    bodies = np.zeros((2, 8))
    bodies[0, 6:] = 1.0, 10.0
    forces = np.zeros((2, 3))
    found, _ = gauss_seidel_forces(
        LoadedContacts(row, np.array([0, 0]), np.array([0, -1]), bodies, DOWN), forces, np.zeros(2), friction=0.5,
        skin=0.0, iterations=500, tolerance=1e-12,
    )  # fmt: skip
    assert np.abs(found[0]).max() < 1e-6
    np.testing.assert_allclose(forces[1, 2], -1.0, atol=1e-6)


@pytest.mark.parametrize("own", [False, True])
def test_many_rows_are_balanced_with_the_same_bits_by_any_number_of_threads(monkeypatch, own):
    """Three blocks of rows of which the last is not full, with a lid, walls, a fixed grain and one beside itself."""
    row, i, j, bodies = heap(7, round_grains=False)
    j[4] = i[4]
    copies, count = 2 * projected_gradient.BLOCK // len(i) + 20, len(bodies) - 1
    bodies = np.vstack([np.tile(bodies[:-1], (copies, 1)), bodies[-1:]])
    bodies[5, 6:] = 0.0
    begin = count * np.repeat(np.arange(copies), len(i))
    i, j = np.tile(i, copies), np.tile(j, copies)
    j = np.where(j == count, len(bodies) - 1, np.where(j < 0, j, j + begin))
    contacts = LoadedContacts(np.tile(row, (copies, 1)), i + begin, j, bodies, DOWN)
    friction = np.random.default_rng(1).uniform(0.2, 0.6, len(i)) if own else 0.5

    def balanced(many, threads):
        monkeypatch.setattr(projected_gradient, "MANY", many)
        forces = 0.1 * contacts.row[:, :3]
        with using_threads(threads):
            found = accelerated_projected_gradient(
                contacts, forces, friction=friction, iterations=40, tolerance=1e-9, near=-1.0
            )
        return forces, *found

    for other in [(1, 1), (1, 2), (1, 3)]:
        for found, expected in zip(balanced(*other), balanced(len(i) + 1, 1), strict=True):
            np.testing.assert_array_equal(found, expected)
