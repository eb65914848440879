"""Meshes whose vertices are kept as whole steps on a lattice: the same solids as with coordinates, in fewer bytes."""

import pickle

import numpy as np
import pytest

import voxgran as vg
from voxgran.shapes.mesh import LatticePoints, Mesh
from voxgran.shapes.model import Shape

STEP, FIRST = np.array([0.1, 0.25, 1 / 3]) / 1000, np.array([70.0, -3.0, 0.1])


@pytest.fixture
def pair():
    rock = vg.make_shape("solid_union", seed=3, solids=4)
    steps = np.rint((rock.vertices - rock.vertices.min(axis=0)) / np.ptp(rock.vertices) * 1e5).astype(np.int32)
    lattice = LatticePoints(steps, STEP.copy(), FIRST.copy())
    return Mesh(lattice, rock.faces), Mesh(lattice.coordinates.copy(), rock.faces)


def test_a_solid_on_a_lattice_is_the_one_of_its_coordinates(pair):
    own, plain = pair
    assert np.array_equal(own.vertices, plain.vertices)
    assert not own.vertices.flags.writeable
    assert own.content() == plain.content()
    assert own.points.nbytes < 0.51 * plain.points.nbytes + 48
    assert own.volume == pytest.approx(plain.volume, rel=1e-12)
    np.testing.assert_allclose(own.centroid, plain.centroid, rtol=1e-13)
    np.testing.assert_allclose(own.inertia, plain.inertia, rtol=1e-10)
    assert Mesh(own.points, own.corners[:, ::-1]).volume == -own.volume


def test_motion_keeps_the_lattice_and_turns_leave_it(pair):
    own, plain = pair
    moved = own.moved(np.array([1.0, 2.0, -3.0]))
    assert moved.points.steps is own.points.steps
    np.testing.assert_allclose(moved.vertices, plain.moved(np.array([1.0, 2.0, -3.0])).vertices, rtol=1e-14)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert np.array_equal(own.rotated(turn).vertices, plain.rotated(turn).vertices)
    assert np.array_equal(own.scaled(2.0).vertices, plain.scaled(2.0).vertices)
    assert own.scaled(3.0).points.steps is own.points.steps
    np.testing.assert_allclose(own.scaled(3.0).vertices, plain.scaled(3.0).vertices, rtol=1e-14)


def test_shapes_have_their_centroid_at_the_origin_and_can_be_sent(pair):
    shape, other = (Shape.of(mesh, name="rock") for mesh in pair)
    assert abs(shape.geometry.centroid).max() < 1e-12
    np.testing.assert_allclose(shape.offset, other.offset, rtol=1e-13)
    again = pickle.loads(pickle.dumps(shape))
    assert again == shape
    assert again.key == shape.key


def test_a_flat_solid_has_no_volume():
    steps = np.array([[0, 0, 0], [5, 0, 0], [0, 5, 0]], dtype=np.int32)
    flat = Mesh(LatticePoints(steps, STEP.copy(), FIRST.copy()), np.array([[0, 1, 2], [0, 2, 1]]))
    assert flat.volume == 0.0
    assert np.isfinite(flat.centroid).all()
