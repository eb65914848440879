"""The strict solid fraction: grains shrunk until they are free."""

from dataclasses import replace

import numpy as np
import pytest
from kit import slow

from voxgran._base.errors import PackingWarning
from voxgran._base.seeds import stream
from voxgran.contacts.verify import verify
from voxgran.containers.kinds.box import Box
from voxgran.measures.model import measure
from voxgran.measures.registered.strict import PRECISION, strict_solid_fraction
from voxgran.packing.model import Packing
from voxgran.shapes.family import make_shape
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive

BALL = Shape.of(Primitive("sphere", (0.5,)), name="sphere")


def pair(distance, edge=4.0):
    """Return two spheres of diameter 1."""
    return Packing.of([BALL], Box((edge,) * 3), position=[[1, 2, 2], [1 + distance, 2, 2]])


def test_nothing_is_shrunk_where_nothing_overlaps():
    packing = pair(1.0)
    assert strict_solid_fraction(packing) == packing.solid_fraction
    with pytest.warns(PackingWarning, match="the bulk holds 1 of the grains"):
        assert "strict_solid_fraction" not in measure(packing)
    assert float(measure(packing, which=["strict"]).strict_solid_fraction) == packing.solid_fraction


def test_overlapping_spheres_are_shrunk_until_they_touch():
    packing = pair(0.9)
    found = strict_solid_fraction(packing)
    wanted = packing.solid_fraction * 0.9**3
    assert wanted * (1 - 4 * PRECISION) <= found <= wanted * (1 + 1e-7)


def test_a_grain_in_a_wall_is_shrunk_until_it_is_inside():
    packing = Packing.of([BALL], Box((4, 4, 4)), position=[[0.4, 2, 2]])
    assert strict_solid_fraction(packing) == pytest.approx(packing.solid_fraction * 0.8**3, rel=4 * PRECISION)


def test_a_grain_that_lies_outside_leaves_nothing():
    packing = Packing.of([BALL], Box((4, 4, 4)), position=[[-1, 2, 2]])
    assert strict_solid_fraction(packing) == 0.0


def test_it_is_in_the_tree_where_grains_overlap():
    packing = Packing.of([BALL], Box((4, 4, 4), periodic=(True,) * 3), position=[[1, 2, 2], [1.95, 2, 2]])
    tree = measure(packing, which=["strict"])
    assert float(tree.strict_solid_fraction) == strict_solid_fraction(packing)
    assert tree.strict_solid_fraction.attrs["units"] == "1"


def test_no_grains():
    empty = Packing.of([BALL], Box((4, 4, 4)), position=np.zeros((0, 3)))
    assert strict_solid_fraction(empty) == 0.0


@pytest.mark.parametrize("family", ["sphere", slow("polyhedron")])
def test_it_is_that_of_verifying_the_shrunk_packing(family):
    box = Box((3, 3, 3), periodic=(True, False, True))
    place = stream(2, "places").uniform(0.7, 2.3, (14, 3))
    packing = Packing.of([make_shape(family, seed=0)], box, position=place, scale=np.linspace(0.5, 1.0, 14))
    found = strict_solid_fraction(packing)
    factor = (found / packing.solid_fraction) ** (1 / 3)
    assert 0.0 < factor < 0.9
    for step, ok in ((0, True), (1.5 * PRECISION, False)):
        assert verify(replace(packing, scale=packing.scale * (factor + step))).ok == ok
