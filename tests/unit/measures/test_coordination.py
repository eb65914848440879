"""Numbers of neighbours."""

import numpy as np
import pytest

from voxgran._base.errors import InputError
from voxgran.containers.box import Box
from voxgran.measures.model import measure
from voxgran.measures.registered.coordination import (
    REFERENCE_GAP,
    WIDEST_GAP,
    coordination_number,
    near_contacts,
    usual_gap,
)
from voxgran.packing.model import Packing
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive

BALL = Shape.of(Primitive("sphere", (0.5,)), name="sphere")


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
