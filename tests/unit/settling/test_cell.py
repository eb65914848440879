"""A container that deforms, in the solver: a twin in NumPy of what forces and strains do to each other."""

import numpy as np

from voxgran.settling.balance import LoadedContacts, gauss_seidel_forces, net_accelerations
from voxgran.settling.cell import Cell

PLACES = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
NO_GRAVITY = np.zeros(3)


def random_contacts(n=12, m=30, seed=4):
    """Contacts of random bodies, some of them at walls."""
    draw = np.random.default_rng(seed)
    row = np.zeros((m, 16))
    normal = draw.normal(size=(m, 3))
    row[:, :3] = normal / np.linalg.norm(normal, axis=1)[:, None]
    row[:, 3:9], row[:, 9] = 0.5 * draw.normal(size=(m, 6)), 0.01 * draw.normal(size=m)
    i, j = draw.integers(0, n, m), draw.integers(-1, n, m)
    j[j == i] = -1
    row[j < 0, 6:9] = 0.0
    bodies = np.zeros((n + 1, 8))
    bodies[:n, 6:] = draw.uniform(0.5, 2.0, (n, 2))
    half = draw.normal(size=(6, 6))
    cell = Cell(half @ half.T / 6, draw.uniform(1.0, 2.0, 6))
    return LoadedContacts(row, i, j, bodies, NO_GRAVITY, cell), draw.normal(size=(m, 3))


def branches(contacts):
    """Vectors from the first body of each contact to the second one, or to the wall."""
    row = contacts.row
    return row[:, 3:6] - row[:, 6:9] + row[:, 9:10] * row[:, :3]


def test_forces_strain_the_container_by_their_virial_beyond_the_load():
    contacts, forces = random_contacts()
    virial = forces.T @ branches(contacts)
    six = np.array([(virial[a, b] + virial[b, a]) / 2 for a, b in PLACES])
    strain = net_accelerations(contacts, forces)[-1]
    assert np.allclose(strain, contacts.cell.mobility @ (six - contacts.cell.load), rtol=0, atol=1e-12)


def test_forces_of_a_step_keep_the_gaps_that_move_with_grains_and_container():
    contacts, _ = random_contacts()
    forces, openness = np.zeros((30, 3)), np.full(30, -0.1)
    found, _ = gauss_seidel_forces(
        contacts, forces, openness, friction=0.0, skin=1e-6, iterations=4000, tolerance=1e-13
    )
    strain = np.zeros((3, 3))
    for value, (a, b) in zip(found[-1], PLACES, strict=True):
        # shear strains are those of engineers, twice the numbers of the tensor
        strain[a, b] = strain[b, a] = value if a == b else value / 2
    moved = np.vstack([found[:-1], np.zeros((1, 6))])
    point = [
        moved[at, :3] + np.cross(moved[at, 3:], contacts.row[:, k : k + 3])
        for at, k in ((contacts.i, 3), (contacts.j, 6))
    ]
    apart = point[1] - point[0] + branches(contacts) @ strain
    opening = (apart * contacts.row[:, :3]).sum(axis=1) + openness
    push = (forces * contacts.row[:, :3]).sum(axis=1)
    assert (push > 0.1).sum() > 5
    assert push.min() >= 0
    assert opening.min() > -1e-5
    assert np.abs(opening * push).max() < 1e-4


def test_a_rigid_container_strains_by_nothing():
    contacts, forces = random_contacts()
    rigid = LoadedContacts(*contacts[:5])
    assert not net_accelerations(rigid, forces)[-1].any()
