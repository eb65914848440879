"""Fabric of packings: lattices, aligned ellipsoids, periodic images, few grains."""

import math

import numpy as np
import pytest
from kit import lattice

from voxgran._base.seeds import stream
from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.rectangle import Rectangle
from voxgran.geometry.rotation import quaternions_of
from voxgran.io.netcdf import load_statistics, save_statistics
from voxgran.measures.directions import fabric_of
from voxgran.measures.model import measure
from voxgran.measures.registered.fabric import (
    AXES,
    BRANCHES,
    NORMALS,
    WEIGHTED,
    Vectors,
    fabric,
    fabric_vectors,
    long_axes,
)
from voxgran.packing.model import Packing
from voxgran.packing.pack import pack
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.tessellate import unit_box

BALL = Shape.of(Primitive("sphere", (0.5,)), name="sphere")
DISK = Shape.of(Outline("disk", radius=0.5), name="disk")
LONG = Shape.of(Primitive("ellipsoid", (0.5, 0.3, 0.9)), name="ellipsoid")


def fcc(cells=3):
    """Return touching spheres on a face-centred cubic lattice in a periodic box."""
    corners = np.stack(np.meshgrid(*[np.arange(cells)] * 3, indexing="ij"), axis=-1).reshape(-1, 1, 3)
    basis = np.array([[0, 0, 0], [0.5, 0.5, 0], [0.5, 0, 0.5], [0, 0.5, 0.5]])
    edge = math.sqrt(2.0)
    return Packing.of([BALL], Box((cells * edge,) * 3, "xyz"), position=edge * (corners + basis).reshape(-1, 3))


def test_a_face_centred_lattice():
    found = measure(fcc(), "fabric")["fabric"].sel(vector=NORMALS)
    assert int(found["count"]) == 108 * 6
    assert found.second_order.values == pytest.approx(np.eye(3) / 3, abs=1e-12)
    assert found.fourth_order.values[0, 0, 0, 0] == pytest.approx(1 / 6)
    assert found.fourth_order.values[0, 0, 1, 1] == pytest.approx(1 / 12)
    assert float(found.second_order_anisotropy) == pytest.approx(0.0, abs=1e-9)
    assert float(found.fourth_order_anisotropy_error) == pytest.approx(0.0, abs=1e-7)


def test_periodic_images_have_branches_of_one_diameter():
    for packing in (fcc(), fcc(1)):
        sets = fabric_vectors(packing)
        assert np.linalg.norm(sets[BRANCHES].way, axis=1) == pytest.approx(np.ones(6 * packing.count))
        # spheres: the branch is along the normal
        assert sets[BRANCHES].way == pytest.approx(sets[NORMALS].way)
        assert fabric(packing, sets[WEIGHTED]).second == pytest.approx(np.eye(3) / 3)


def test_long_branches_weigh_more():
    # one pair of large spheres along x, one of small ones along y
    position, scale = [[2, 2, 2], [4, 2, 2], [6.5, 6, 2], [6.5, 7, 2]], [2.0, 2.0, 1.0, 1.0]
    packing = Packing.of([BALL], Box((9, 9, 9)), position=position, scale=scale)
    sets = fabric_vectors(packing)
    assert np.diag(fabric(packing, sets[BRANCHES]).second) == pytest.approx([0.5, 0.5, 0.0])
    assert np.diag(fabric(packing, sets[WEIGHTED]).second) == pytest.approx([0.8, 0.2, 0.0])


def test_aligned_ellipsoids():
    packing = Packing.of([LONG], Box((8, 8, 16)), position=lattice(4, 4, 4) * [2, 2, 4])
    found = measure(packing, "fabric")["fabric"].sel(vector=AXES)
    assert int(found["count"]) == 64
    assert found.second_order.values == pytest.approx(np.diag([0.0, 0.0, 1.0]))
    assert float(found.second_order_anisotropy) == pytest.approx(5.0)
    assert np.abs(found.principal_direction.values[0]) == pytest.approx([0, 0, 1])
    assert found.principal_value.values == pytest.approx([1.0, 0.0, 0.0])
    assert np.flatnonzero(found.density.values).tolist() == [0]


def test_long_axes_turn_with_the_grains():
    way = stream(1, "axes").normal(size=(40, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    turns = []
    for one in way:
        q, _ = np.linalg.qr(np.column_stack([one, [1.0, 0.2, 0.1], [0.3, 1.0, 0.2]]))
        turns.append(np.column_stack([q[:, 1], q[:, 2], q[:, 0]]) * [1, 1, np.linalg.det(q[:, [1, 2, 0]])])
    packing = Packing.of(
        [BALL, LONG],
        Box((99, 99, 99)),
        position=2.0 + 2.0 * lattice(20, 2, 1),
        shape_id=np.arange(40) % 2,
        orientation=quaternions_of(np.array(turns)),
    )
    axes, grains = long_axes(packing)
    assert grains.tolist() == list(range(1, 40, 2))
    assert np.abs(np.einsum("ij,ij->i", axes, way[1::2])) == pytest.approx(np.ones(20))


def test_which_grains_have_a_long_axis():
    def axes(shape):
        box = Box((9, 9, 9)) if shape.dimension == 3 else Rectangle((9, 9))
        return long_axes(Packing.of([shape], box, position=[[4, 4, 4 * (shape.dimension == 3)]]))[0]

    assert len(axes(BALL)) == len(axes(DISK)) == 0
    vertices, faces, _ = unit_box()
    assert len(axes(Shape(Mesh(vertices - vertices.mean(axis=0), faces), "cube"))) == 0
    assert len(axes(Shape.of(Primitive("ellipsoid", (0.3, 0.9, 0.9)), name="plate"))) == 0
    brick = Shape.from_mesh(vertices * [3.0, 2.0, 1.0], faces, name="brick")
    assert np.abs(axes(brick)[0]) == pytest.approx([1, 0, 0])
    bar = Shape.of(Outline("polygon", vertices=np.array([[-0.5, -1.0], [0.5, -1], [0.5, 1], [-0.5, 1]])), name="bar")
    assert np.abs(axes(bar)[0]) == pytest.approx([0, 1, 0])


def test_the_plane(tmp_path):
    # a periodic triangular lattice: the fourth order vanishes too
    step = np.array([[0, 0], [0.5, math.sqrt(3) / 2]])
    corner = np.stack(np.meshgrid(np.arange(6), np.arange(3) * math.sqrt(3)), axis=-1).reshape(-1, 1, 2)
    position = (corner + step).reshape(-1, 2)
    packing = Packing.of(
        [DISK], Rectangle((6, 3 * math.sqrt(3)), "xy"), position=np.pad(position, ((0, 0), (0, 1))), contact_gap=1e-9
    )
    tree = measure(packing, "fabric")
    found = tree["fabric"].sel(vector=NORMALS)
    assert int(found["count"]) == 36 * 3
    assert found.second_order.values == pytest.approx(np.eye(2) / 2, abs=1e-9)
    assert float(found.fourth_order_anisotropy_as_sampled) == pytest.approx(0.0, abs=1e-7)
    assert np.flatnonzero(found.density.values).tolist() == [0, 6, 12]
    assert tree["fabric"].attrs["pole"] == "none"
    save_statistics(tree, tmp_path / "a.nc")
    again = load_statistics(tmp_path / "a.nc")
    assert again["fabric"].vector.values.tolist() == [NORMALS, BRANCHES, WEIGHTED, AXES]
    assert again["fabric"].sel(vector=NORMALS).second_order.values == pytest.approx(np.eye(2) / 2, abs=1e-9)


def test_the_root_has_the_anisotropy_of_the_normals():
    # columns along z with the gap of a hair sideways
    position = lattice(3, 3, 3) * [1.1, 1.1, 1.0]
    packing = Packing.of([BALL], Box((3.3, 3.3, 3), "xyz"), position=position, contact_gap=1e-3)
    tree = measure(packing, "fabric")
    assert float(tree.contact_anisotropy) == pytest.approx(5.0)
    assert tree.contact_anisotropy.attrs["error"] == pytest.approx(0.0, abs=1e-7)
    tilted = measure(Packing.of([BALL], Box((9, 9, 9)), position=[[4, 4, 4]], gravity="-x"), "fabric")
    assert tilted["fabric"].attrs["pole"] == "x"


@pytest.mark.parametrize("count", [0, 1])
@pytest.mark.parametrize("dimension", [2, 3])
def test_no_contacts(count, dimension):
    shape, box = (BALL, Box((4, 4, 4))) if dimension == 3 else (DISK, Rectangle((4, 4)))
    tree = measure(Packing.of([shape], box, position=[[2, 2, 2 * (dimension == 3)]] * count), "fabric")
    assert tree["fabric"]["count"].values.tolist() == [0] * 4
    assert math.isnan(float(tree.contact_anisotropy))
    assert "error" not in tree.contact_anisotropy.attrs


@pytest.mark.parametrize("length", [1e-50, 1e50])
def test_tiny_and_huge_lengths(length):
    position, scale = np.array([[2, 2, 2], [4, 2, 2], [6.5, 6, 2], [6.5, 7, 2]]), np.array([2.0, 2.0, 1.0, 1.0])
    packing = Packing.of([BALL], Box((9 * length,) * 3), position=position * length, scale=scale * length)
    found = measure(packing, "fabric")["fabric"].sel(vector=WEIGHTED)
    assert np.diag(found.second_order.values) == pytest.approx([0.8, 0.2, 0.0])


@pytest.mark.slow
def test_the_error_is_that_of_repeated_packings():
    """Random disks in the plane that pushed each other apart: neighbours within 0.2 diameters."""
    found, independent = [], []
    for seed in range(24):
        packing = pack(DISK, Rectangle((8, 8), "xy"), method="expand", solid_fraction=0.7, seed=seed)
        near = packing.contacts(0.2)
        found.append(fabric(packing, Vectors(near.normal, near.point)).second_order)
        independent.append(fabric_of(near.normal, dimension=2).second_order)
    spread = math.sqrt(np.var([one.deviator for one in found], axis=0, ddof=1).sum() / 4)
    mean_square = np.mean([np.square(one.plain) for one in found])
    # isotropic: a random packing has no anisotropy but that of its scatter, in two components
    assert mean_square == pytest.approx(2 * spread**2, rel=0.3)
    assert np.mean([np.square(one.plain) - np.square(one.unbiased) for one in found]) < 1.3 * mean_square
    errors, others = (np.mean([one.error for one in some]) for some in (found, independent))
    assert errors == pytest.approx(spread, rel=0.5)
    # those of independent normals are too large
    assert others > 1.6 * spread
