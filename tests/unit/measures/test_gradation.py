"""Sizes asked for and placed."""

import itertools
import math

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.seeds import stream
from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.rectangle import Rectangle
from voxgran.measures.model import measure
from voxgran.measures.registered.gradation import gradation, size_classes
from voxgran.measures.registered.grains import intermediate_axes
from voxgran.packing.model import Packing
from voxgran.shapes.describing.extents import principal_extents
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.sizes import discrete, fixed, lognormal, sieve

BALL = Shape.of(Primitive("sphere", (0.5,)), name="sphere")
BRICK = Shape.of(Primitive("box", (3.0, 2.0, 1.0)), name="brick")


def packed(sizes, asked=None, shape=BALL, **more):
    """Return grains of given sizes, wherever they lie."""
    scale = np.asarray(sizes, dtype=float) / shape.diameter
    position = np.full((len(scale), 3), 50.0)
    return Packing.of([shape], Box((100,) * 3), position=position, scale=scale, asked_sizes=asked, **more)


def test_placed_curves():
    found = gradation(packed([1.0, 1.0, 2.0, 3.0]))
    assert found.asked == found.distance == {}
    low, high = np.searchsorted(found.sizes, [1.5, 2.5])
    assert found.placed["number"][[low, high]].tolist() == [0.5, 0.75]
    assert found.placed["volume"][[low, high]] == pytest.approx([2 / 37, 10 / 37])
    assert found.placed["number"][[0, -1]].tolist() == [0.0, 1.0]
    assert (np.diff(found.placed["volume"]) >= 0).all()


def test_the_distance_is_that_of_scipy():
    from scipy import stats

    law = lognormal(median=2.0, sigma=0.3)
    sizes = law.sample(500, stream(0, "sizes"))
    found = gradation(packed(sizes, law))
    wanted = stats.kstest(sizes, stats.lognorm(s=0.3, scale=2.0).cdf).statistic
    assert found.distance["number"] == pytest.approx(wanted, abs=1e-8)
    assert found.distance["number"] < 1.63 / math.sqrt(500)
    # by volume the asked distribution is shifted by three variances
    shift = 2.0 * math.exp(3 * 0.09)
    assert found.asked["volume"] == pytest.approx(stats.lognorm(s=0.3, scale=shift).cdf(found.sizes), abs=1e-12)


def test_a_few_sizes_are_met_exactly():
    law = discrete([1.0, 2.0], [0.75, 0.25])
    found = gradation(packed([1.0, 1.0, 1.0, 2.0], law))
    assert found.distance["number"] == pytest.approx(0.0, abs=1e-12)
    assert found.distance["volume"] == pytest.approx(0.0, abs=1e-12)
    assert gradation(packed([1.0, 1.0, 2.0, 2.0], law)).distance["number"] == pytest.approx(0.25)
    assert gradation(packed([1.1], fixed(1.0))).distance["number"] == 1.0
    assert gradation(packed([1.0 + 1e-12, 1.0 - 1e-12], fixed(1.0))).distance["number"] == 0.0


def test_a_cut_gradation_shows():
    law = discrete([1.0, 2.0, 4.0], [1, 1, 2])
    assert gradation(packed([1.0, 2.0], law)).distance["number"] == pytest.approx(0.5)


def test_sieves_pass_by_the_intermediate_axis():
    law = sieve([1.0, 2.0, 4.0], [0.0, 0.5, 1.0])
    generator = stream(1, "sieve")
    axes = law.sample(2000, generator)
    scale = axes / 2.0
    packing = Packing.of([BRICK], Box((100,) * 3), position=np.full((2000, 3), 50.0), scale=scale, asked_sizes=law)
    assert intermediate_axes(packing) == pytest.approx(axes)
    found = gradation(packing)
    assert found.by_axis
    assert found.distance["number"] < 1.63 / math.sqrt(2000)
    assert found.distance["volume"] < 0.1
    by_diameter = sieve([1.0, 2.0, 4.0], [0.0, 0.5, 1.0], as_diameter=True)
    assert not gradation(packed(axes, by_diameter, BRICK)).by_axis
    assert gradation(packed(axes, by_diameter, BRICK)).distance["number"] < 1.63 / math.sqrt(2000)


def test_areas_weigh_in_two_dimensions():
    disk = Shape.of(Outline("disk", radius=0.5), name="disk")
    law = discrete([1.0, 2.0], [1, 1])
    packing = Packing.of([disk], Rectangle((9, 9)), position=[[1, 1, 0], [5, 5, 0]], scale=[1.0, 2.0], asked_sizes=law)
    found = gradation(packing)
    assert found.distance["volume"] == pytest.approx(0.0, abs=1e-12)
    middle = np.searchsorted(found.sizes, 1.5)
    assert found.placed["volume"][middle] == pytest.approx(0.2)


def test_no_grains_and_nothing_asked():
    empty = packed([], lognormal(1.0, 0.2))
    assert gradation(empty).sizes.shape == (0,)
    assert gradation(empty).distance == {}
    assert gradation(packed([1.0])).asked == {}


def test_nothing_is_read_from_the_provenance():
    law = discrete([1.0, 2.0], [1, 1])
    told = packed([1.0], provenance={"sizes": law.to_mapping(), "asked": {"sizes": law.to_mapping()}})
    assert gradation(told).asked == {}


def test_the_curves_in_the_tree():
    found = measure(packed([1.0, 2.0], discrete([1.0, 2.0], [1, 1]), unit="mm"), which=["gradation"])["gradation"]
    assert found["size"].attrs["units"] == "mm"
    assert {"placed_number", "placed_volume", "asked_number", "asked_volume"} <= set(found.data_vars)
    assert {"placed_number_by_axis", "placed_volume_by_axis"} <= set(found.data_vars)
    assert float(found.distance_number) == pytest.approx(0.0, abs=1e-12)
    assert "equivalent diameters" in found.asked_number.attrs["long_name"]


def test_classes_of_a_sieve_curve_are_those_of_its_openings():
    """By the definition: the volume of the grains whose intermediate axis lies between two openings."""
    curve = vg.sizes.sieve([0.5, 1.0, 2.0, 4.0], [0, 20, 60, 100])
    shapes = [vg.shapes.sphere(), vg.shapes.box(aspect=(1, 2, 3))]
    bed = vg.pack(shapes, vg.Box((30, 30, 30)), "rsa", count=1000, sizes=curve, seed=2)
    ends, asked, placed = size_classes(bed)
    assert ends.tolist() == [0.5, 1.0, 2.0, 4.0]
    assert asked == pytest.approx([0.2, 0.4, 0.4], abs=1e-12)
    middle = [principal_extents(shape)[1] / shape.diameter for shape in bed.shapes]
    axis = np.array(middle)[bed.shape_id] * bed.diameters
    inside = [(axis > low) & (axis <= high) for low, high in itertools.pairwise(ends)]
    assert placed == pytest.approx([bed.volumes[mask].sum() / bed.volumes.sum() for mask in inside], abs=1e-9)
    assert placed == pytest.approx(asked, abs=0.05)
    assert size_classes(vg.pack(shapes, vg.Box((9, 9, 9)), "rsa", count=5)) is None
