"""The solid volume in a window, for every kind of grain."""

import itertools
import math

import numpy as np
import pytest

from voxgran._base.errors import InputError
from voxgran._base.lazy import load
from voxgran._base.seeds import stream
from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.rectangle import Rectangle
from voxgran.geometry.rotation import random_rotations
from voxgran.measures.registered.density import window_solid_fraction
from voxgran.measures.window import Estimate, Solids, images
from voxgran.packing.model import Packing
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.spheres import Spheres
from voxgran.shapes.tessellate import sphere, unit_box

BALL = Shape.of(Primitive("sphere", (0.5,)), name="sphere")
CUBE = Shape.of(Primitive("box", (1.0, 1.0, 1.0)), name="cube")
ELLIPSOID = Shape.of(Primitive("ellipsoid", (0.9, 0.5, 0.3)), name="ellipsoid")
CYLINDER = Shape.of(Primitive("cylinder", (0.4, 1.2)), name="cylinder")
CONE = Shape.of(Primitive("cone", (0.6, 1.0)), name="cone")
ROD = Shape.of(Primitive("spherocylinder", (0.4, 0.9)), name="rod")
CLUMP = Shape.of(
    Spheres(np.array([[0.0, 0, 0], [0.5, 0, 0], [0.2, 0.4, 0.1]]), np.array([0.4, 0.3, 0.2])), name="clump"
)
MESH = Shape.of(Mesh(*sphere(2)[:2]), name="icosphere")
DISK = Shape.of(Outline("disk", radius=0.5), name="disk")
SQUARE = Shape.of(Outline("polygon", vertices=np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)), name="square")


def one(shape, position=(0.0, 0.0, 0.0), **more):
    """Return a packing of one grain in a large box."""
    container = Box((100,) * 3, origin=(-50,) * 3) if shape.dimension == 3 else Rectangle((100, 100), origin=(-50, -50))
    return Packing.of([shape], container, position=[position], **more)


def sampled(packing, low, high, steps):
    """Return the share of midpoints of a fine grid in a window that lie in a grain of closed form."""
    axes = [a + (np.arange(steps) + 0.5) * (b - a) / steps for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    inside = np.zeros(len(points), dtype=bool)
    for grain in range(packing.count):
        body = (points - packing.position[grain]) @ packing.matrices[grain] / packing.scale[grain]
        inside |= packing.shapes[packing.shape_id[grain]].geometry.contains(body)
    return inside.mean()


@pytest.mark.parametrize("shape", [BALL, CUBE, ELLIPSOID, CYLINDER, CONE, ROD, CLUMP], ids=lambda s: s.name)
def test_turned_grains_in_windows_agree_with_points(shape):
    generator = stream(0, shape.name)
    for orientation in random_rotations(generator, 4):
        packing = one(shape, (0.1, -0.2, 0.3), scale=[1.3], orientation=[orientation])
        low, high = np.array([-0.2, -0.6, 0.0]), np.array([0.7, 0.1, 0.8])
        found = window_solid_fraction(packing, low, high)
        assert found == pytest.approx(sampled(packing, low, high, 60), abs=4e-3)
        halves = [
            window_solid_fraction(packing, low, [0.25, 0.1, 0.8]),
            window_solid_fraction(packing, [0.25, -0.6, 0], high),
        ]
        assert sum(halves) / 2 == pytest.approx(found, abs=1e-13 + 2 * found.error)


@pytest.mark.parametrize(
    "shape", [BALL, CUBE, ELLIPSOID, CYLINDER, CONE, ROD, CLUMP, MESH, DISK, SQUARE], ids=lambda s: s.name
)
def test_a_window_around_a_grain_holds_its_true_volume(shape):
    packing = one(shape)
    far = np.full(shape.dimension, 3.0)
    found = Solids(packing).volume(-far, far)
    assert found == pytest.approx(shape.volume, rel=1e-12)
    assert found.error == 0.0


@pytest.mark.parametrize("shape", [CYLINDER, CONE], ids=lambda s: s.name)
def test_the_error_of_cylinders_and_cones_is_a_bound(shape):
    # half of each is known: planes that hold the axis
    found = Solids(one(shape)).volume(np.array([0.0, -9, -9]), np.full(3, 9.0))
    assert found == pytest.approx(shape.volume / 2, rel=1e-12)
    assert 0 < found.error < 2e-5 * shape.volume
    radius, height = shape.geometry.dimensions
    found = Solids(one(shape)).volume(np.array([radius / 2, -9, -9]), np.full(3, 9.0))
    # the rest is a stack of segments of disks
    nodes, weights = np.polynomial.legendre.leggauss(80)
    z = 0.5 * (1 + np.sin(np.pi / 2 * nodes))
    weights = 0.5 * np.pi / 2 * np.cos(np.pi / 2 * nodes) * weights
    slices = np.full_like(z, radius) if shape is CYLINDER else radius * (1 - z / 2)
    angle = np.arccos(np.minimum(1.0, radius / 2 / slices))
    exact = height * (1.0 if shape is CYLINDER else 0.5) * (weights * slices**2 * (angle - np.sin(2 * angle) / 2)).sum()
    assert abs(found - exact) <= found.error


def test_an_ellipsoid_cut_through_its_center_is_halved():
    generator = stream(1, "halves")
    for orientation in random_rotations(generator, 10):
        packing = one(ELLIPSOID, orientation=[orientation])
        for axis in range(3):
            low = np.full(3, -np.inf)
            low[axis] = 0.0
            assert Solids(packing).volume(low, np.full(3, np.inf)) == pytest.approx(ELLIPSOID.volume / 2, rel=1e-13)


def test_images_across_periodic_faces():
    box = Box((2, 3, 4), periodic=(True, True, True))
    packing = Packing.of([BALL, CUBE], box, position=[[0, 0, 0], [1, 1.5, 2]], shape_id=[0, 1])
    corner = window_solid_fraction(packing, (-0.5, -0.5, -0.5), (0.5, 0.5, 0.5))
    assert corner == pytest.approx(math.pi / 6, rel=1e-13)
    for shift in itertools.product((-2, 0, 4), (-3, 6), (-4, 8)):
        low = np.array([0.1, 0.2, 0.3]) + shift
        assert window_solid_fraction(packing, low, low + np.array([2, 3, 4])) == pytest.approx(
            packing.solid_fraction, rel=1e-12
        )
        assert window_solid_fraction(packing, low, low + np.array([4, 6, 12])) == pytest.approx(
            packing.solid_fraction, rel=1e-12
        )


def test_images_are_those_that_reach_in():
    box = Box((2, 2, 2), periodic=(True, False, True))
    center, radius = np.array([[0.1, 1.0, 1.0]]), np.array([0.3])
    index, shift = images(center, radius, np.array([-0.5, 0, 0]), np.array([4.0, 2, 2]), box)
    assert index.tolist() == [0, 0, 0]
    assert shift[:, 0].tolist() == [0.0, 2.0, 4.0]
    assert (shift[:, 1:] == 0).all()
    assert len(images(center, radius, np.array([0.4, 0, 0]), np.array([1.8, 2, 2]), box)[0]) == 0
    assert len(images(center, radius, np.array([0, 1.3, 0]), np.array([2, 2, 2]), box)[0]) == 0


def test_overlapping_spheres_count_once():
    box = Box((4, 4, 4), periodic=(True, True, True))
    packing = Packing.of([BALL], box, position=[[1, 1, 1], [1.4, 1, 1], [3.9, 1, 3], [0.3, 1, 3]])
    # Weisstein, Sphere-Sphere Intersection, eq. 18: V = pi (4 R + d) (2 R - d)^2 / 12
    lens = math.pi * (4 * 0.5 + 0.4) * (2 * 0.5 - 0.4) ** 2 / 12
    wanted = 4 * math.pi / 6 - 2 * lens
    assert Solids(packing).volume(np.zeros(3), np.full(3, 4.0)) == pytest.approx(wanted, rel=1e-13)
    # the plane between the centers cuts the lens in halves
    half = Solids(packing).volume(np.array([0, 0, 0.0]), np.array([1.2, 2, 2]))
    assert half == pytest.approx(math.pi / 6 - lens / 2, rel=1e-13)


def test_overlapping_blocks_count_once():
    position = [[1, 1, 1], [1.75, 1, 1], [3.9, 1, 3], [0.5, 1, 3], [3.9, 2.6, 1]]
    packing = Packing.of([CUBE], Box((4, 4, 4), periodic=(True,) * 3), position=position)
    solids = Solids(packing)
    assert solids.volume(np.zeros(3), np.full(3, 4.0)) == pytest.approx(5 - 0.25 - 0.4, rel=1e-12)
    assert solids.volume(np.full(3, -np.inf), np.full(3, np.inf)) == pytest.approx(5 - 0.25 - 0.4, rel=1e-12)
    # the window ends within the part that the first two share
    assert solids.volume(np.zeros(3), np.array([1.4, 2.0, 2.0])) == pytest.approx(0.9, rel=1e-12)


def test_overlapping_squares_and_disks_count_once():
    sides = Rectangle((4, 4), periodic=(True, True))
    squares = Packing.of([SQUARE], sides, position=[[1, 1, 0], [1.75, 1, 0], [3.9, 3, 0], [0.5, 3, 0]])
    assert Solids(squares).volume(np.zeros(2), np.full(2, 4.0)) == pytest.approx(4 - 0.25 - 0.4, rel=1e-12)
    disks = Packing.of([DISK], sides, position=[[1, 1, 0], [1.6, 1, 0]])
    lens = 2 * 0.25 * math.acos(0.6) - 0.6 / 2 * math.sqrt(1 - 0.36)
    assert Solids(disks).volume(np.zeros(2), np.full(2, 4.0)) == pytest.approx(math.pi / 2 - lens, rel=1e-13)


def test_overlapping_ellipsoids_state_an_error():
    packing = Packing.of([ELLIPSOID], Box((4, 4, 4)), position=[[1, 2, 2], [1, 2.9, 2]])
    found = Solids(packing).volume(np.zeros(3), np.full(3, 4.0))
    # stretched to spheres of radius 1 at distance 0.9 / 0.5
    lens = math.pi * (4 + 1.8) * 0.2**2 / 12 * 0.9 * 0.5 * 0.3
    assert found == pytest.approx(2 * ELLIPSOID.volume - lens, abs=found.error)
    assert 0 < found.error < 1.1 * lens


def test_a_mesh_in_a_window_agrees_with_manifold():
    library = load("manifold3d")
    vertices, faces = MESH.vertices, MESH.faces
    packing = one(MESH, (0.1, 0.2, 0.3), scale=[0.7])
    solid = library.Manifold(library.Mesh64(np.ascontiguousarray(packing.world_vertices(0)), faces.astype(np.uint64)))
    low, high = np.array([-0.3, 0.0, 0.1]), np.array([0.4, 0.6, 1.0])
    cut = solid ^ library.Manifold.cube(tuple(high - low)).translate(tuple(low))
    assert Solids(packing).volume(low, high) == pytest.approx(cut.volume(), rel=1e-12)
    assert len(vertices) == 162


def test_grains_of_all_kinds_together():
    shapes = [BALL, CUBE, ELLIPSOID, CYLINDER, CONE, CLUMP, MESH]
    generator = stream(3, "mixed")
    position = np.array([[x, y, 0.0] for x in (0, 3, 6) for y in (0, 3, 6)][:7], dtype=float)
    packing = Packing.of(
        shapes,
        Box((9, 9, 9), periodic=(True, True, True)),
        position=position,
        shape_id=np.arange(7),
        orientation=random_rotations(generator, 7),
    )
    low, high = np.full(3, -0.4), np.array([8.6, 8.6, 0.1])
    whole = Solids(packing).volume(low, low + 9.0)
    assert whole == pytest.approx(packing.volumes.sum(), rel=1e-12)
    parts = [Solids(packing).volume(low, high), Solids(packing).volume(np.array([-0.4, -0.4, 0.1]), low + 9.0)]
    assert sum(parts) == pytest.approx(whole, rel=1e-12)


def test_a_far_grain_loses_no_digits():
    for shape in (CUBE, MESH, ELLIPSOID, BALL):
        near = Solids(one(shape)).volume(np.array([-0.125, -1, -1]), np.ones(3))
        shift = np.full(3, 32.0)
        far = Solids(one(shape, shift)).volume(np.array([-0.125, -1, -1]) + shift, 1 + shift)
        assert far == pytest.approx(near, rel=1e-14)


def test_scaled_by_a_power_of_two_gives_the_same_bits():
    size = 2.0**20
    generator = stream(4, "size")
    orientation = random_rotations(generator, 3)
    position = np.array([[1.0, 1.1, 1.2], [3.0, 2.9, 3.1], [1.0, 3.2, 0.7]])
    for shape in (BALL, CLUMP, CUBE, ELLIPSOID, MESH):
        bits = []
        for factor in (1.0, size):
            packing = Packing.of(
                [shape],
                Box((4, 4, 4), periodic=(True, False, True)).scaled(factor),
                position=position * factor,
                scale=np.array([0.9, 0.7, 0.5]) * factor,
                orientation=orientation,
            )
            low, high = np.array([0.3, 0.2, -0.5]) * factor, np.array([2.7, 3.1, 1.7]) * factor
            bits.append(float(window_solid_fraction(packing, low, high)))
        assert bits[0] == bits[1]


def test_an_estimate_is_a_number():
    number = Estimate(0.5, 0.1)
    assert number == 0.5
    assert number.error == 0.1
    assert isinstance(number, float)


def test_windows_that_are_refused():
    packing = one(CUBE)
    for low, high in [((0, 0, 0), (0, 1, 1)), ((0, 0, 0), (1, 1, math.inf))]:
        with pytest.raises(InputError, match="volume must be finite"):
            window_solid_fraction(packing, low, high)
    with pytest.raises(InputError, match="two corners"):
        window_solid_fraction(packing, (0, 0), (1, 1))
    assert unit_box()[2] == 0.0
