"""Numbers of neighbours, and rattlers."""

import math
from dataclasses import replace

import numpy as np
import pytest
from kit import column, lattice

from voxgran._base.errors import InputError
from voxgran.contacts.walls import walls_touched
from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.cylinder import Cylinder
from voxgran.containers.kinds.disk import Disk
from voxgran.containers.kinds.mesh import ClosedMesh
from voxgran.containers.kinds.rectangle import Rectangle
from voxgran.containers.kinds.sphere import Sphere
from voxgran.measures.model import measure
from voxgran.measures.registered.coordination import (
    REFERENCE_GAP,
    WIDEST_GAP,
    coordination_number,
    find_rattlers,
    near_contacts,
    usual_gap,
)
from voxgran.packing.model import Packing
from voxgran.packing.pack import pack
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.tessellate import unit_box

BALL = Shape.of(Primitive("sphere", (0.5,)), name="sphere")
DISK = Shape.of(Outline("disk", radius=0.5), name="disk")


def row(*gaps, **more):
    """Return spheres of diameter 1 in a row with gaps between them."""
    x = np.concatenate([[1.0], 1.0 + np.cumsum(1 + np.array(gaps))])
    position = np.column_stack([x, np.full_like(x, 2.0), np.full_like(x, 2.0)])
    return Packing.of([BALL], Box((10, 4, 4)), position=position, **more)


def test_it_rises_with_the_gap():
    found = coordination_number(row(0.0, 0.02, 0.3), [0.0, 0.01, 0.02, 0.05, 0.3], reference_gap=0.05)
    assert found.mean.tolist() == [0.5, 0.5, 1.0, 1.0, 1.5]
    assert found.of_grain.tolist() == [1, 2, 1, 0]
    assert found.reference_gap == 0.05


def test_gaps_are_in_mean_diameters():
    small = Packing.of([BALL], Box((9, 9, 9)), position=[[1, 1, 1], [3.2, 1, 1]], scale=[2.0, 2.0])
    assert coordination_number(small, [0.0999, 0.1001]).mean.tolist() == [0.0, 1.0]


def test_a_grain_may_be_its_own_neighbour():
    alone = Packing.of([BALL], Box((1.0, 4, 4), periodic=(True, True, True)), position=[[0, 0, 0]])
    found = coordination_number(alone, [0.0])
    assert found.mean.tolist() == [2.0]
    assert found.of_grain.tolist() == [2]


def test_two_images_of_one_neighbour_count_both():
    two = Packing.of([BALL], Box((2.0, 4, 4), periodic=(True, False, False)), position=[[0, 2, 2], [1, 2, 2]])
    assert coordination_number(two, [0.0]).of_grain.tolist() == [2, 2]


def test_the_curve_starts_at_contact():
    found = coordination_number(row(0.0))
    assert found.gaps[0] == 0.0
    assert found.gaps[1] == pytest.approx(1e-6)
    assert found.gaps[-1] == pytest.approx(WIDEST_GAP)
    assert found.reference_gap == REFERENCE_GAP
    assert (found.mean == 1.0).all()


@pytest.mark.parametrize("method", ["deposition", "advancing_front", "growth", "random_apollonian"])
def test_grains_that_touch_by_construction_are_in_contact(method):
    packing = pack(BALL, Box((4, 4, 5)), method, count=40, seed=1)
    every = packing.contacts(gap=1e-7 * packing.diameters.mean()).count
    assert packing.contacts().count == packing.contacts(gap=0.0).count == every > 0
    assert coordination_number(packing, [0.0]).mean[0] == pytest.approx(2 * every / packing.count)


def test_contacts_are_found_once():
    packing = row(0.001)
    tree = measure(packing, which=["contacts", "coordination"])
    assert list(packing._contacts) == [pytest.approx(WIDEST_GAP)]
    assert near_contacts(packing) is packing.contacts(next(iter(packing._contacts)))
    pairs = tree["contacts"]
    assert (int(pairs.i[0]), int(pairs.j[0])) == (0, 1)
    assert float(pairs.gap[0]) == pytest.approx(0.001, abs=1e-12)
    assert pairs.normal.values.tolist() == [[1, 0, 0]]
    assert pairs.point.values[0] == pytest.approx([1.5005, 2, 2])
    assert pairs.image.values.tolist() == [[0, 0, 0]]
    assert tree["profiles"].coordination_number.dims == ("gap",)


def test_what_a_method_leaves_open_counts_as_contact():
    voxels = row(0.05, 0.2, contact_gap=0.06)
    assert usual_gap(voxels) == pytest.approx(0.06)
    assert coordination_number(voxels).of_grain.tolist() == [1, 1, 0]
    points = row(0.05, 0.2, 0.5, contact_gap=0.3)
    assert usual_gap(points) == 0.3
    tree = measure(points, which=["contacts", "coordination"])
    assert tree["contacts"].sizes["contact"] == 2
    assert tree["grains"].coordination_number.values.tolist() == [1, 2, 1, 0]
    assert float(tree["contacts"].largest_gap) == pytest.approx(0.3)
    assert float(tree.mean_coordination_number) == 1.0
    assert "0.3 mean diameters" in tree["grains"].coordination_number.attrs["long_name"]


def test_a_known_contact_gap_may_be_small():
    settled = row(1e-3, 5e-3, contact_gap=1e-3)
    assert usual_gap(settled) == pytest.approx(1e-3)
    assert coordination_number(settled).of_grain.tolist() == [1, 1, 0]
    assert float(measure(settled, "coordination").mean_coordination_number) == pytest.approx(2 / 3)
    unknown = measure(row(1e-3, 5e-3), "coordination")
    assert float(unknown.mean_coordination_number) == pytest.approx(4 / 3)
    assert "0.01 mean diameters" in unknown.mean_coordination_number.attrs["long_name"]


def test_no_grains():
    found = coordination_number(Packing.of([BALL], Box((4, 4, 4)), position=np.zeros((0, 3))))
    assert np.isnan(found.mean).all()
    assert found.of_grain.shape == (0,)


def test_what_is_refused():
    with pytest.raises(InputError, match="gaps hold -1"):
        coordination_number(row(0.0), [-1.0])
    with pytest.raises(InputError, match="reference_gap is -1"):
        coordination_number(row(0.0), reference_gap=-1.0)


def squares(periodic="xyz", **more):
    """Return 27 spheres on a simple cubic lattice, six contacts each where it is periodic."""
    return Packing.of([BALL], Box((3, 3, 3), periodic), position=lattice(3, 3, 3), **more)


def test_a_periodic_lattice_has_no_rattlers():
    found = find_rattlers(squares())
    assert not found.mask.any()
    assert (found.share, found.coordination) == (0.0, 6.0)
    tree = measure(squares(), "coordination")
    assert tree["contact_numbers"].contact_number.values.tolist() == list(range(7))
    assert tree["contact_numbers"].probability.values.tolist() == [0] * 6 + [1]
    assert tree["contact_numbers"].probability_error.values.tolist() == [0] * 7


def test_spheres_without_gravity_need_more_contacts_than_dimensions():
    # four spheres that touch each other, one that hangs at one of them and one that hangs at that
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / math.sqrt(8) + 4.0
    out = corners[0] + np.array([1, 1, 1]) / math.sqrt(3), corners[0] + np.array([2, 2, 2]) / math.sqrt(3)
    position = np.concatenate([corners, out])
    given = {"position": position, "contact_gap": 1e-9}
    few = find_rattlers(Packing.of([BALL], Box((9, 9, 9), "xyz"), **given))
    # three contacts each do not hold a sphere in space
    assert few.mask.all()
    assert math.isnan(few.coordination)
    assert "fewer than 4 contacts with grains, rattlers removed, and walls" in few.definition
    # by friction the four hold each other; the two that hang go one after the other
    shapes = [BALL, Shape.of(Primitive("box", (0.1, 0.1, 0.1)), name="box")]
    alone = find_rattlers(Packing.of(shapes, Box((9, 9, 9), "xyz"), **given, shape_id=np.zeros(6, dtype=int)))
    assert alone.definition == few.definition
    given |= {"position": np.vstack([position, [[0.5, 0.5, 0.5]]]), "shape_id": [0] * 6 + [1]}
    rough = find_rattlers(Packing.of(shapes, Box((9, 9, 9), "xyz"), **given))
    assert rough.mask.tolist() == [False] * 4 + [True] * 3
    assert rough.coordination == 3.0
    assert "fewer than 2" in rough.definition


def test_under_gravity_a_grain_may_carry_a_rattler():
    # three on top of each other: the upper one carries nothing, the others do
    place = np.column_stack([np.full((3, 2), 2.0), np.arange(3) + 0.5])
    heap = find_rattlers(Packing.of([BALL], Box((4, 4, 4)), position=place))
    assert heap.mask.tolist() == [False, False, True]
    assert heap.coordination == 1.0
    assert heap.share == pytest.approx(1 / 3)
    assert heap.definition == "a grain with fewer than 2 contacts with grains and walls"
    # without gravity nothing holds them
    assert find_rattlers(Packing.of([BALL], Box((4, 4, 4)), position=place, gravity=None)).mask.all()


def test_known_forces_decide():
    packing = column(3)
    forces = replace(packing.forces, rattler=[True, False, False])
    found = find_rattlers(replace(packing, forces=forces))
    assert found.mask.tolist() == [True, False, False]
    assert found.coordination == 1.0
    assert "contact forces" in found.definition
    tree = measure(replace(packing, forces=forces), ["coordination", "forces"])
    assert tree.share_of_rattlers.attrs["definition"] == found.definition
    assert tree["grains"].rattler.values.tolist() == [True, False, False]
    assert float(tree.coordination_without_rattlers) == 1.0


def test_walls_hold_spheres():
    box = Box((3, 3, 3))
    # a cube of 27 between six walls: those in the corners touch three walls and three spheres
    found = find_rattlers(squares("", gravity=None))
    assert not found.mask.any()
    # the mean number of contacts does not count walls
    assert found.coordination == pytest.approx(4.0)
    assert walls_touched(squares(""), 1e-9).tolist() == (np.abs(lattice(3, 3, 3) - 1.5) > 0.9).sum(axis=1).tolist()
    assert walls_touched(squares(""), 2.0).tolist() == [6] * 27
    assert walls_touched(squares("xy"), 1e-9).max() == 1
    assert walls_touched(squares(), 9.0).tolist() == [0] * 27
    lonely = Packing.of([BALL], box, position=[[1.5, 1.5, 1.5]])
    assert walls_touched(lonely, 0.9).tolist() == [0]


@pytest.mark.parametrize("length", [1e-50, 1.0, 1e50])
def test_walls_of_all_containers(length):
    def touched(container, *points, shape=BALL, gap=1e-6):
        scale = np.full(len(points), length)
        position = np.array(points, dtype=float) * length
        return walls_touched(Packing.of([shape], container, position=position, scale=scale), gap * length).tolist()

    drum = Cylinder(2 * length, 4 * length)
    assert touched(drum, (1.5, 0, 0.5), (0, 1.5, 2), (0, 0, 2), (0, 0, 3.5)) == [2, 1, 0, 1]
    assert touched(Sphere(2 * length), (0, 0, 1.5), (0, 0, 1)) == [1, 0]
    assert touched(Disk(2 * length), (1.5, 0, 0), (0, 0, 0), shape=DISK) == [1, 0]
    field = Rectangle((4 * length, 3 * length), periodic="x")
    assert touched(field, (0.5, 0.5, 0), (2, 1.5, 0), (0.1, 2.5, 0), shape=DISK) == [1, 0, 1]


def test_walls_of_meshes_and_true_shapes():
    vertices, faces, _ = unit_box()
    room = ClosedMesh(Shape.from_mesh(vertices * 4.0, faces, name="room"))
    low = room.bounds[0]
    inside = low + np.array([[0.5, 2, 2], [2, 2, 2], [2, 2, 3.5]])
    assert walls_touched(Packing.of([BALL], room, position=inside), 1e-6).tolist() == [1, 0, 1]
    block = Shape.from_mesh(vertices * [1.0, 2.0, 1.0], faces, name="block")
    boxed = Packing.of([block], Box((1, 5, 4)), position=[[0.5, 1.0, 2.0], [0.5, 3.0, 2.0]])
    assert walls_touched(boxed, 1e-9).tolist() == [3, 2]


def test_the_distribution_of_contact_numbers():
    packing = row(0.0, 0.02, 0.3)
    tree = measure(packing, "coordination")["contact_numbers"]
    numbers = coordination_number(packing).of_grain
    share = np.bincount(numbers) / 4
    assert tree.contact_number.values.tolist() == list(range(len(share)))
    assert tree.probability.values == pytest.approx(share)
    assert tree.probability_error.values == pytest.approx(np.sqrt(share * (1 - share) / 4))
    assert tree.rattlers.values.sum() == find_rattlers(packing).mask.sum()
    assert float((tree.contact_number * tree.probability).sum()) == pytest.approx(numbers.mean())


@pytest.mark.parametrize("count", [0, 1])
@pytest.mark.parametrize("dimension", [2, 3])
def test_no_neighbours(count, dimension):
    shape, box = (BALL, Box((4, 4, 4))) if dimension == 3 else (DISK, Rectangle((4, 4), periodic="x"))
    tree = measure(Packing.of([shape], box, position=[[2, 2, 2 * (dimension == 3)]] * count), "coordination")
    assert tree["contact_numbers"].probability.values.tolist() == [1.0] * count
    assert math.isnan(float(tree.coordination_without_rattlers))
    assert tree["grains"].rattler.values.tolist() == [True] * count
    assert float(tree.share_of_rattlers) == 1.0 if count else math.isnan(float(tree.share_of_rattlers))


def test_jammed_spheres_are_isostatic_without_rattlers():
    packing = pack(BALL, Box((6, 6, 6), "xyz"), method="jam", count=100, seed=0)
    found, record = find_rattlers(packing), packing.provenance["compression"]
    assert found.coordination == pytest.approx(record["coordination_without_rattlers"])
    assert found.share == pytest.approx(record["rattlers"])
    assert found.coordination == pytest.approx(6.0, abs=0.3)
