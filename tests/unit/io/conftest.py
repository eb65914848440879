"""Small packings with every kind of geometry."""

import numpy as np
import pytest

from voxgran._base.seeds import stream
from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.mesh import ClosedMesh
from voxgran.containers.kinds.rectangle import Rectangle
from voxgran.packing.model import Packing
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.spheres import Spheres
from voxgran.shapes.tessellate import sphere, unit_box


def poses(count, shapes, lengths):
    generator = stream(5, "test packing")
    quaternions = generator.normal(size=(count, 4))
    return {
        "position": generator.random((count, 3)) * lengths,
        "orientation": quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True),
        "scale": 0.2 + generator.random(count),
        "shape_id": np.arange(count) % shapes,
    }


@pytest.fixture
def block():
    """Return a mesh that is off the origin and has no round numbers."""
    vertices, faces, _ = unit_box()
    return Shape.from_mesh(vertices * [0.7, 1.1, 1.3] + [3.1, 0.2, -7.7], faces, name="block", unit="mm")


@pytest.fixture
def spheres():
    """Return three spheres in a box, one across a periodic face."""
    return Packing.of(
        [Shape.of(Primitive("sphere", (0.5,)), name="sphere")],
        Box((4, 4, 4), periodic=(True, False, False)),
        position=[[1, 1, 1], [2.2, 1, 1], [3.9, 3, 3]],
        scale=[1.0, 1.4, 0.8],
        unit="mm",
        provenance={"method": "by hand", "seed": 7},
    )


@pytest.fixture
def mixed(block):
    """Return a packing with a mesh, four primitives and a clump."""
    shapes = [
        block,
        Shape.of(Primitive("sphere", (0.5,)), name="sphère µ <&>"),
        Shape.of(Primitive("spherocylinder", (0.3, 0.9), (0.6, 0.0, 0.8, 0.0)), name="rod"),
        Shape.of(Primitive("cone", (0.3, 0.9), (0.6, 0.0, 0.8, 0.0)), name="cone"),
        Shape.of(Spheres(np.array([[0.0, 0, 0], [0.3, 0.1, 0]]), np.array([0.4, 0.3])), name="clump"),
    ]
    return Packing.of(
        shapes,
        Box((4, 5, 6), periodic=(True, False, True), origin=(-1, 0.1, 2)),
        **poses(17, 4, [4, 5, 6]),
        density=2650.0,
        provenance={"method": "by hand", "seed": 7, "misses": [1.5, None, {"a": True}], "timing": {"wall": 0.1}},
        stop_reason="saturated",
        unit="mm",
    )


@pytest.fixture
def flat():
    """Return a packing of disks and triangles in two dimensions."""
    corners = np.array([[0.0, 0.0], [1.0, 0.1], [0.4, 0.9]])
    shapes = [
        Shape.of(Outline("disk", radius=0.5), name="disk"),
        Shape.of(Outline("polygon", vertices=corners), name="triangle"),
    ]
    position = [[1.0, 1.0, 0.0], [3.0, 1.5, 0.0], [1.0, 3.0, 0.0]]
    turn = [[1, 0, 0, 0], [np.cos(0.3), 0, 0, np.sin(0.3)], [1, 0, 0, 0]]
    return Packing.of(shapes, Rectangle((4, 4)), position=position, orientation=turn, shape_id=[0, 1, 1])


@pytest.fixture
def in_a_sphere(block):
    """Return a packing in a container that is a closed mesh."""
    vertices, faces, _ = sphere(2)
    shape = Shape.of(Mesh(vertices * 3.3 + [0.1, 0.2, 0.7], faces), name="drum")
    return Packing.of([block], ClosedMesh(shape), position=[[0.1, 0.2, 0.7]])
