import numpy as np
import pytest

from voxgran._base.errors import InputError, MissingFileError
from voxgran._base.seeds import stream
from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.mesh import ClosedMesh
from voxgran.containers.model import Container
from voxgran.shapes.family import make_shape
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive


def moved_box():
    return Box((1.0, 2.0, 3.0), origin=(10.0, 20.0, 30.0))


@pytest.fixture
def container():
    return ClosedMesh(Shape.from_mesh(*moved_box().mesh(), name="bin"))


def test_it_lies_where_the_mesh_lay(container):
    np.testing.assert_allclose(container.bounds, moved_box().bounds, rtol=1e-15)
    np.testing.assert_allclose(container.mesh()[0].min(axis=0), [10, 20, 30], rtol=1e-15)
    assert container.volume == pytest.approx(6.0, rel=1e-14)
    assert isinstance(container, Container)


def test_signed_distance_equals_that_of_the_box(container):
    points = stream(1, "mesh").uniform([9, 19, 29], [12, 23, 34], (500, 3))
    np.testing.assert_allclose(container.signed_distance(points), moved_box().signed_distance(points), atol=1e-14)


def test_scaling_takes_the_place_along(container):
    scaled = container.scaled(4.0)
    np.testing.assert_allclose(scaled.bounds, 4 * moved_box().bounds, rtol=1e-15)
    points = np.array([[44.0, 80.0, 121.0]])
    np.testing.assert_array_equal(scaled.signed_distance(points), 4 * container.signed_distance(points / 4))


@pytest.mark.parametrize("factor", [1e-9, 1e9])
def test_a_tiny_or_huge_shape_keeps_its_place_relative_to_its_size(factor):
    shape = make_shape("convex_polyhedron", seed=1)
    assert np.linalg.norm(shape.offset) > 1e-3
    container = ClosedMesh(shape.scaled(factor))
    assert Mesh(*container.mesh()).volume == pytest.approx(shape.volume * factor**3, rel=1e-14)
    np.testing.assert_allclose(container.bounds, factor * ClosedMesh(shape).bounds, rtol=1e-14)
    points = factor * stream(1, "points").uniform(-0.6, 0.6, (200, 3))
    given = ClosedMesh(shape).signed_distance(points / factor)
    np.testing.assert_allclose(container.signed_distance(points), factor * given, atol=1e-14 * factor)


def test_a_file_makes_a_container(data_dir):
    container = ClosedMesh.from_file(data_dir / "bennu_lp.obj")
    assert container.signed_distance([container.shape.offset])[0] < 0
    with pytest.raises(MissingFileError):
        ClosedMesh.from_file(data_dir / "no_such.obj")


def test_only_meshes_are_taken():
    with pytest.raises(InputError, match="made of triangles"):
        ClosedMesh(Shape.of(Primitive("sphere", (1.0,)), name="sphere"))
    with pytest.raises(InputError, match=r"shape is 'bin.stl': it must be a Shape; for a mesh file use ClosedMesh"):
        ClosedMesh("bin.stl")
    with pytest.raises(InputError, match="path is 3: it must be the path of a file"):
        ClosedMesh.from_file(3)
