"""Settling of true shapes: gaps close, nothing overlaps, hand calculations."""

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.rotation import random_rotations, rotation_matrices
from voxgran._base.seeds import stream
from voxgran.contacts.assembly import Assembly
from voxgran.contacts.broad import grain_pairs
from voxgran.settling.contact_points import find_contact_points, joined, near_corners
from voxgran.settling.settle import follow
from voxgran.settling.trial_motion import free_fall, shaken_fall

DOWN = np.array([0.0, 0.0, -1.0])


def settled(assembly, sweeps, step=0.02):
    """Settle with steps that are halved when little is gained."""
    for _ in range(sweeps):
        before = assembly.position[:, 2].mean()
        assembly = follow(assembly, free_fall(assembly, step * DOWN))[0]
        if before - assembly.position[:, 2].mean() < 0.03 * step:
            step = max(step / 2, 2e-5)
    return assembly


def packing_of(assembly):
    return vg.Packing.of(
        assembly.shapes,
        assembly.container,
        position=assembly.position,
        scale=assembly.scale,
        shape_id=assembly.shape_id,
        orientation=assembly.orientation,
    )


def test_a_sphere_falls_to_the_floor():
    one = Assembly.of([vg.make_shape("sphere")], vg.Box((3, 3, 3)), position=[[1.5, 1.5, 0.7]])
    found = settled(one, 80)
    assert found.position[0, 2] == pytest.approx(0.5, abs=1e-4)
    assert found.position[0, 2] >= 0.5
    assert found.position[0, :2] == pytest.approx([1.5, 1.5], abs=1e-12)


def test_a_sphere_rolls_into_the_pocket_of_two():
    """Two spheres fill the floor of a trough; a third comes to rest sqrt(3)/2 diameters above them."""
    trough = vg.Box((1, 2, 3))
    three = Assembly.of([vg.make_shape("sphere")], trough, position=[[0.5, 0.5, 0.5], [0.5, 1.5, 0.5], [0.5, 0.8, 1.5]])
    found = settled(three, 300)
    assert found.position[2] == pytest.approx([0.5, 1.0, 0.5 + np.sqrt(0.75)], abs=2e-3)
    assert find_contact_points(found, 2e-3).gap.min() >= 0
    assert vg.verify(packing_of(found)).ok


def test_a_tilted_box_lies_down_flat():
    shape = vg.make_shape("box", lengths=(1.0, 0.8, 0.5))
    half = np.deg2rad(20) / 2
    tilted = Assembly.of(
        [shape], vg.Box((4, 4, 3)), position=[[2, 2, 0.6]], orientation=[[np.cos(half), np.sin(half), 0, 0]]
    )
    found = settled(tilted, 200)
    matrix = rotation_matrices(found.orientation)[0]
    assert abs(matrix[2, 2]) == pytest.approx(1.0, abs=5e-3)
    assert found.position[0, 2] == pytest.approx(0.25, abs=0.02)
    assert vg.verify(packing_of(found)).ok


def test_nothing_to_gain_stays_where_it_is():
    # a simple cubic lattice that fills its box
    ticks = np.arange(3) + 0.5
    lattice = np.array(np.meshgrid(ticks, ticks, ticks)).reshape(3, -1).T
    full = Assembly.of([vg.make_shape("sphere")], vg.Box((3, 3, 3)), position=lattice)
    found = settled(full, 5, step=1e-3)
    assert vg.verify(packing_of(found)).ok
    assert np.abs(found.position - lattice).max() < 1e-2


def test_random_motion_never_makes_an_overlap():
    generator = stream(4, "places")
    shapes = [vg.make_shape("box"), vg.make_shape("cone"), vg.make_shape("sphere")]
    ticks = np.arange(4) * 1.5 + 1.0
    lattice = np.array(np.meshgrid(ticks, ticks, ticks[:2])).reshape(3, -1).T
    turns = random_rotations(stream(5, "turns"), len(lattice))
    assembly = Assembly.of(
        shapes, vg.Box((7, 7, 4)), position=lattice, shape_id=generator.integers(0, 3, len(lattice)), orientation=turns
    )
    for _ in range(30):
        fall = generator.normal(size=3)
        assembly = follow(assembly, free_fall(assembly, 0.05 * fall / np.linalg.norm(fall)))[0]
        proof = vg.verify(packing_of(assembly))
        assert proof.ok


def test_shaking_pulls_nobody_further_than_its_step():
    """Slides add up to gravity and a pull of at most the strength, all within the step."""
    many = Assembly.of([vg.make_shape("sphere")], vg.Box((9, 9, 9)), position=np.full((4000, 3), 4.0))
    for strength in (0.25, 1.0, 4.0):
        trial = shaken_fall(many, 0.05 * DOWN, strength, stream(1, "test"))
        part = 0.05 / max(1.0, strength)
        pull = np.linalg.norm(trial.translation - part * DOWN, axis=1)
        assert pull.max() == pytest.approx(part * strength, rel=1e-9)
        assert np.abs(trial.translation.mean(axis=0) - part * DOWN).max() < 0.05 * part * strength
        assert np.linalg.norm(trial.rotation, axis=1).max() == pytest.approx(part * strength / 0.5, rel=1e-9)


def test_corners_near_a_face_are_found():
    """A cube above another, shifted along both edges: one corner of each lies over the face of the other."""
    cube = vg.make_shape("platonic", solid="cube")
    edge = (np.pi / 6) ** (1 / 3)
    two = Assembly.of([cube], vg.Box((5, 5, 5)), position=[[2, 2, 2], [2.1, 2.05, 2 + edge + 0.01]])
    places = joined(near_corners(two, grain_pairs(two, 0.02), 0.02))
    assert len(places.i) == 2
    assert places.gap == pytest.approx([0.01, 0.01], abs=1e-12)
    # from grain i to grain j
    assert places.normal[:, 2] == pytest.approx(np.where(places.i == 0, 1.0, -1.0), abs=1e-9)
    corners = two.position[places.j] + places.arm_j
    expected = {0: [2 + edge / 2, 2 + edge / 2, 2 + edge / 2], 1: [2.1 - edge / 2, 2.05 - edge / 2, 2.01 + edge / 2]}
    assert corners == pytest.approx(np.array([expected[j] for j in places.j.tolist()]), abs=1e-12)
    # and the places where the surfaces are nearest
    assert len(find_contact_points(two, 0.02).i) == 3
